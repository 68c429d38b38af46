"""Drives of an identified gantry as an explicit actuator for Isaac Lab, in plain torch.

Written by `klasktron export TWIN --to isaaclab`. `TwinActuator` turns velocity commands into forces on the slides x and
y of one gantry. It has the command delay, gain, offset and lag, the slew limit, the velocity loop with its feedback
delay and its velocity estimator, and the viscous friction of belts and guides. Joint friction and armature are settings
of the simulated joints: `JOINT_FRICTION_N` and `JOINT_ARMATURE_KG`.

Without Isaac Lab the file is complete: `simulate` integrates the same gantry in torch. With Isaac Lab it also defines
`KlasktronActuatorCfg`, whose joints are the slides in the order x, y.

Frames and units: board frame (x across, y goal to goal), m, m/s, N, kg. Belts are a = x + y and b = x - y.
"""

import torch

# Numbers of the twin, for motor a and motor b, or for the slides x and y.
@CONSTANTS@

def belts(slides):
    """Belt velocities `[..., a b]` of slide velocities `[..., x y]`."""
    x, y = slides[..., 0], slides[..., 1]
    return torch.stack([x + y, x - y], dim=-1)


def remaining(length):
    """exp(-length) as the twin computes it: by the series of exp(length)."""
    series = torch.ones_like(length)
    for k in range(6, 0, -1):
        series = 1 + length / k * series
    return 1 / series


def on_slides(forces):
    """Slide forces `[..., x y]` of belt forces `[..., a b]`."""
    a, b = forces[..., 0], forces[..., 1]
    return torch.stack([a + b, a - b], dim=-1)


class TwinActuator:
    """Drives of `num_envs` gantries, stepped with the physics.

    Args:
        num_envs: Number of gantries.
        dt: Physics step (s). At 1 ms velocities differ from the twin's, which takes shorter steps after each command,
            by some 1e-4 of their RMS. A delay is rounded to whole steps.
        device: Device of all tensors.
        dtype: Precision; `torch.float64` reproduces the twin, `torch.float32` is common in training.
    """

    def __init__(self, num_envs, dt, device="cpu", dtype=torch.float32):
        self.num_envs, self.dt = num_envs, dt

        def tensor(values):
            return torch.tensor(values, device=device, dtype=dtype)

        self.gain, self.offset = tensor(COMMAND_GAIN), tensor(COMMAND_OFFSET_M_PER_S)
        self.proportional, self.integral_gain = tensor(PROPORTIONAL_N_S_PER_M), tensor(INTEGRAL_N_PER_M)
        self.feedback_delay = tensor(FEEDBACK_DELAY_S)
        self.belt_damping, self.damping = tensor(BELT_DAMPING_N_S_PER_M), tensor(DAMPING_N_S_PER_M)
        self.constant_force, self.mass = tensor(CONSTANT_FORCE_N), tensor(MASS_KG)
        self.friction = tensor(JOINT_FRICTION_N)
        slew = [float("inf") if limit is None else limit for limit in SLEW_LIMIT_M_PER_S2]
        self.most, self.has_ramp = tensor(slew) * dt, tensor([limit is not None for limit in SLEW_LIMIT_M_PER_S2])
        lag = tensor(LAG_S)
        # First order, exact for a command that is held within the step.
        self.decay = torch.where(lag > 0, torch.exp(-dt / lag.clamp(min=1e-12)), torch.zeros_like(lag))
        self.steps = [round(delay / dt) for delay in COMMAND_DELAY_S]
        inverse = 1 / self.mass
        together, apart = inverse[0] + inverse[1], inverse[0] - inverse[1]
        mobility = torch.stack([torch.stack([together, apart]), torch.stack([apart, together])])
        # The estimator of the velocity over half of a step: its output follows the acceleration by `ahead`.
        self.time = tensor(ESTIMATOR_TIME_CONSTANT_S).clamp(min=1e-7)
        self.half = 0.5 * dt / self.time
        self.rest = remaining(self.half)
        self.turned = self.half * self.rest
        self.ahead = self.time * (self.half + self.turned - 2 * (1 - self.rest))
        self.ahead -= self.feedback_delay * (1 - self.rest - self.turned)
        yields = (self.ahead * self.proportional)[:, None] * mobility
        self.solve = torch.linalg.inv(torch.eye(2, device=device, dtype=dtype) + yields)
        zeros = {"device": device, "dtype": dtype}
        self.history = torch.zeros(max(self.steps) + 1, num_envs, 2, **zeros)
        self.state = {name: torch.zeros(num_envs, 2, **zeros) for name in STATES}

    def reset(self, env_ids=slice(None)):
        """Forget commands and integrals of `env_ids`; the gantries are at rest."""
        self.history[:, env_ids] = 0
        for own in self.state.values():
            own[env_ids] = 0

    def compute(self, command, velocity):
        """Forces on the slides `[num_envs][2]` (N) over the next physics step.

        Args:
            command: Commanded velocity of the carriage `[num_envs][2]` (m/s).
            velocity: Velocity of the slides `[num_envs][2]` (m/s), after the last step.
        """
        own, dt = self.state, self.dt
        seen = belts(velocity)
        # The integral of the step that has ended, now that its last velocity is known.
        changed = own["running"] * (seen - own["seen"])
        travelled = (own["middle"] - seen + 0.5 * changed) * dt + self.estimated(changed)
        own["integral"] += own["running"] * self.integral_gain * travelled
        setpoint = self.setpoint(command)
        before = own["setpoint"]
        middle = torch.where(self.has_ramp > 0, 0.5 * (before + setpoint), setpoint)
        drag = self.constant_force - self.damping * velocity
        behind = self.turned * own["first_lag"] + self.rest * own["second_lag"]
        estimate = seen - self.rest * own["first_lag"] - behind - self.feedback_delay * behind / self.time
        error = middle - estimate - self.ahead * belts((drag + own["friction"]) / self.mass)
        now = before - seen + own["first_lag"] + own["second_lag"]
        halfway = own["integral"] + 0.5 * dt * self.integral_gain * now
        force = (self.proportional * error + halfway) @ self.solve.T
        own["running"] = torch.ones_like(seen)
        own["setpoint"], own["middle"], own["seen"] = setpoint, middle, seen
        # The friction that the simulator will apply, so that the loop expects it as the twin's does.
        effort = on_slides(force - self.belt_damping * seen) + drag
        free = velocity + dt * effort / self.mass
        own["friction"] = -torch.sign(free) * torch.minimum(self.friction, free.abs() * self.mass / dt)
        return effort

    def estimated(self, changed):
        """Update the lags of the estimator by a step in which the velocity `changed`; the travel that it missed (m)."""
        own = self.state
        length, rest = 2 * self.half, self.rest * self.rest
        steady = changed / length
        first, second = own["first_lag"] - steady, own["second_lag"] - steady
        first, second = steady + rest * first, steady + rest * (second + length * first)
        after_one = changed - (first - own["first_lag"])
        after_both = after_one - (second - own["second_lag"])
        own["first_lag"], own["second_lag"] = first, second
        return self.time * (after_one + after_both) + self.feedback_delay * after_both

    def setpoint(self, command):
        """Setpoint of each belt (m/s) after delay, gain, offset, lag and slew limit."""
        own = self.state
        self.history = torch.roll(self.history, 1, dims=0)
        self.history[0] = belts(command)
        late = torch.stack([self.history[steps, :, motor] for motor, steps in enumerate(self.steps)], dim=-1)
        wanted = self.gain * late + self.offset
        lagged = own["lagged"] = self.decay * own["lagged"] + (1 - self.decay) * wanted
        change = torch.minimum(torch.maximum(lagged - own["setpoint"], -self.most), self.most)
        return own["setpoint"] + change


def simulate(commands, dt, dtype=torch.float64, device="cpu"):
    """Motion of gantries under commands of each physics step: positions and velocities `[steps + 1][num_envs][2]`.

    `commands` is `[steps][num_envs][2]` (m/s). The gantries start at rest in the origin. Coulomb friction takes away at
    most the whole velocity, as in the twin.
    """
    commands = torch.as_tensor(commands, dtype=dtype, device=device)
    actuator = TwinActuator(commands.shape[1], dt, device, dtype)
    position = torch.zeros(commands.shape[1:], dtype=dtype, device=device)
    velocity = torch.zeros_like(position)
    positions, velocities = [position], [velocity]
    for command in commands:
        effort = actuator.compute(command, velocity)
        free = velocity + dt * effort / actuator.mass
        lost = torch.minimum(dt * actuator.friction / actuator.mass, free.abs())
        after = free - torch.sign(free) * lost
        position = position + 0.5 * dt * (velocity + after)
        velocity = after
        positions.append(position)
        velocities.append(velocity)
    return torch.stack(positions), torch.stack(velocities)


STATES = ("setpoint", "middle", "seen", "first_lag", "second_lag", "integral", "running", "friction", "lagged")

try:
    from isaaclab.actuators import ActuatorBase, ActuatorBaseCfg
    from isaaclab.utils import configclass
except ImportError:
    pass
else:

    class KlasktronActuator(ActuatorBase):
        """Velocity commands of the joints x and y to efforts, by `TwinActuator`."""

        def __init__(self, cfg, *args, **kwargs):
            super().__init__(cfg, *args, **kwargs)
            self.twin = TwinActuator(self._num_envs, cfg.physics_dt, self._device)

        def reset(self, env_ids):
            self.twin.reset(env_ids)

        def compute(self, control_action, joint_pos, joint_vel):
            self.computed_effort = self.twin.compute(control_action.joint_velocities, joint_vel)
            self.applied_effort = self._clip_effort(self.computed_effort)
            control_action.joint_efforts = self.applied_effort
            control_action.joint_positions = None
            control_action.joint_velocities = None
            return control_action

    @configclass
    class KlasktronActuatorCfg(ActuatorBaseCfg):
        """Configuration: the joints are the slides x and y, in this order."""

        class_type: type = KlasktronActuator
        joint_names_expr: list = ["x", "y"]
        stiffness: dict = {".*": 0.0}
        damping: dict = {".*": 0.0}
        armature: dict = {"x": JOINT_ARMATURE_KG[0], "y": JOINT_ARMATURE_KG[1]}
        friction: dict = {"x": JOINT_FRICTION_N[0], "y": JOINT_FRICTION_N[1]}
        physics_dt: float = 0.001
