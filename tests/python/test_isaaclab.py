"""The drives as an explicit actuator in torch, compared with the twin; skipped without torch."""

import importlib.util
import json
import sys

import numpy as np
import pytest
from test_mjcf import random_commands, with_effects

from klasktron import KlasktronError, Twin

torch = pytest.importorskip("torch")

DT = 1e-3


def loaded(text, folder, name):
    """The exported file as a module."""
    path = folder / f"{name}.py"
    path.write_text(text)
    spec = importlib.util.spec_from_file_location(name, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def everything(twin):
    """A twin with every effect that the actuator has."""
    return with_effects(
        twin.with_value("drive.velocity_loop.feedback_delay_s", 2e-4).with_value(
            "drive.velocity_loop.estimator_time_constant_s", 1e-3
        ),
        ("drive.delay", "a", {"delay_s": 0.012}),
        ("drive.delay", "b", {"delay_s": 0.007}),
        ("drive.gain", "a", {"gain": 0.93}),
        ("drive.offset", "a", {"offset": 0.02}),
        ("drive.lag1", "a+b", {"time_constant_s": 0.015}),
        ("drive.friction.viscous", "b", {"coefficient_n_s_per_m": 12.0}),
        ("gantry.tilt", "x", {"force_n": 1.5}),
    )


def relative_error(found, wanted):
    """RMS of the difference, relative to the RMS of `wanted`."""
    return float(np.sqrt(np.mean((found - wanted) ** 2) / np.mean(wanted**2)))


@pytest.mark.parametrize("kind", ["plain", "everything", "calibrated"])
def test_it_moves_as_the_twin_does(kind, twin_file, tmp_path):
    """Random commands in steps of 1 ms, in double precision; the twin takes shorter steps after each command."""
    twin = Twin.load(twin_file) if kind == "calibrated" else Twin.nominal("table")
    twin = everything(twin) if kind == "everything" else twin
    module = loaded(twin.to_isaaclab(strict=True), tmp_path, kind)
    commands, times = random_commands()
    own = twin.simulate(commands, times_s=times, rate_hz=1000)
    steps = len(own["time_s"]) - 1
    held = np.repeat(commands, 20, axis=0)[:steps, None]
    position, _ = module.simulate(held, DT)
    error = relative_error(position[:, 0].numpy(), own["carriage_m"])
    print(f"{kind}: relative RMS error of the position {error:.2e}")
    assert error < 5e-4


@pytest.mark.parametrize("kind", ["plain", "everything", "calibrated"])
def test_each_step_is_that_of_the_twin(kind, twin_file, tmp_path):
    """In equal steps of 1 ms it agrees to rounding; delays and the lag act on the command before."""
    twin = Twin.load(twin_file) if kind == "calibrated" else Twin.nominal("table")
    if kind == "everything":
        twin = everything(twin)
        document = twin.document
        before = ("drive.delay", "drive.lag1")
        document["effects"] = [own for own in document["effects"] if own["name"] not in before]
        twin = Twin.from_json(json.dumps(document))
    module = loaded(twin.to_isaaclab(strict=True), tmp_path, f"steps_{kind}")
    held = np.repeat(random_commands()[0], 20, axis=0)
    _, velocity = module.simulate(held[:, None], DT)
    error = relative_error(velocity[:, 0].numpy(), twin._inner.step_plant(held, DT))
    print(f"{kind}: relative RMS error of equal steps {error:.2e}")
    assert error < 1e-9


def test_environments_are_independent_and_reset_alone(tmp_path):
    module = loaded(everything(Twin.nominal("table")).to_isaaclab(), tmp_path, "batch")
    commands, _ = random_commands(20)
    held = torch.as_tensor(np.repeat(commands, 20, axis=0))
    both = torch.stack([held, -0.5 * held], dim=1)
    _, together = module.simulate(both, DT)
    for index in (0, 1):
        _, alone = module.simulate(both[:, index : index + 1], DT)
        assert torch.equal(together[:, index], alone[:, 0])
    actuator = module.TwinActuator(2, DT)
    command, velocity = torch.full((2, 2), 0.3), torch.zeros(2, 2)
    first = actuator.compute(command, velocity)
    for _ in range(50):
        later = actuator.compute(command, velocity)
    actuator.reset(torch.tensor([1]))
    again = actuator.compute(command, velocity)
    assert torch.allclose(again[1], first[1]) and not torch.allclose(again[0], first[0])
    assert later.dtype == torch.float32 and (later.abs() > 1).any()


def test_with_isaac_lab_it_is_one_of_its_actuators(tmp_path, monkeypatch):
    """A stand-in for Isaac Lab with the interface of its explicit actuators."""
    import types

    class ActuatorBase:
        def __init__(self, cfg, joint_names, joint_ids, num_envs, device):
            self.cfg, self._num_envs, self._device = cfg, num_envs, device

        def _clip_effort(self, effort):
            return effort.clamp(-40, 40)

    class ActuatorBaseCfg:
        pass

    actuators = types.ModuleType("isaaclab.actuators")
    actuators.ActuatorBase, actuators.ActuatorBaseCfg = ActuatorBase, ActuatorBaseCfg
    utils = types.ModuleType("isaaclab.utils")
    utils.configclass = lambda own: own
    for name, module in {
        "isaaclab": types.ModuleType("isaaclab"),
        "isaaclab.actuators": actuators,
        "isaaclab.utils": utils,
    }.items():
        monkeypatch.setitem(sys.modules, name, module)
    twin = Twin.nominal("table")
    module = loaded(twin.to_isaaclab(), tmp_path, "isaac")
    cfg = module.KlasktronActuatorCfg()
    assert cfg.friction == {"x": 1.0, "y": 1.0} and 0 < cfg.armature["x"] < 2.22
    own = cfg.class_type(cfg, ["x", "y"], [0, 1], 3, "cpu")
    action = types.SimpleNamespace(
        joint_positions=torch.zeros(3, 2), joint_velocities=torch.full((3, 2), 0.4), joint_efforts=None
    )
    for _ in range(30):
        action.joint_velocities = torch.full((3, 2), 0.4)
        action = own.compute(action, torch.zeros(3, 2), torch.zeros(3, 2))
    assert action.joint_velocities is None and action.joint_efforts.shape == (3, 2)
    assert torch.equal(action.joint_efforts, own.applied_effort)
    assert (own.computed_effort > 40).all() and (own.applied_effort == 40).all()


def test_an_axis_is_refused_and_missing_effects_are_listed():
    with pytest.raises(KlasktronError, match="single axis; export it with --to mjcf"):
        Twin.nominal("axis").to_isaaclab()
    twin = with_effects(
        Twin.nominal("table"), ("drive.friction.coulomb", "a", {"force_n": 2.0})
    )
    with pytest.warns(UserWarning, match="drive.friction.coulomb on a: friction at the motor"):
        twin.to_isaaclab()
