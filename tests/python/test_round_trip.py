"""Somebody else's simulator against a machine: what it lacks is found, and goes back into it as MJCF.

The simulator is MuJoCo with a model that its user wrote by hand: mass, damping and dry friction. The machine has a spring
and a dead time as well, and other friction. It is simulated here in steps of 0.1 ms, without MuJoCo and without klasktron.
"""

import numpy as np
import pytest

import klasktron

try:
    import mujoco
except ImportError:
    mujoco = None
pytestmark = pytest.mark.skipif(mujoco is None, reason="could not import 'mujoco'")

DT = 2e-3
SIMULATOR = """
<mujoco>
  <option timestep="0.0005" integrator="implicitfast"/>
  <worldbody>
    <body>
      <joint name="axis" type="slide" axis="1 0 0" damping="3.0" frictionloss="1.5"/>
      <inertial pos="0 0 0" mass="2.0" diaginertia="1 1 1"/>
    </body>
  </worldbody>
  <actuator><motor joint="axis"/></actuator>
</mujoco>
"""


def commands(phase):
    """Times (s) and forces (N) of 8 s."""
    times = np.arange(4000) * DT
    return times, 6 * np.sin(4.4 * times + phase) + 4 * np.sin(12 * times) + 3 * np.sin(31 * times + phase)


def machine(times, force):
    """Position (m) of the machine: mass 2.1 kg, friction, a spring of 9 N/m, and commands 8 ms late."""
    steps = 20
    fine = np.interp(np.arange(len(times) * steps) * DT / steps - 0.008, times, force)
    position, velocity, positions = 0.0, 0.0, []
    for index, push in enumerate(fine):
        if index % steps == 0:
            positions.append(position)
        free = velocity + DT / steps * (push - 3.4 * velocity - 9.0 * position) / 2.1
        lost = min(DT / steps * 1.2 / 2.1, abs(free))
        after = free - np.copysign(lost, free)
        position, velocity = position + 0.5 * DT / steps * (velocity + after), after
    return np.array(positions)


def in_mujoco(xml, times, force):
    """Position (m) of a MuJoCo model with one joint and one control."""
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    samples = model.actuator_history[0, 0]
    if 0 < samples:
        # Before the first command, its value, as for the machine and the twin.
        mujoco.mj_initCtrlHistory(model, data, 0, None, np.full(samples, force[0]))
    steps = round(DT / model.opt.timestep)
    positions = []
    for time in times:
        positions.append(data.qpos[0])
        for step in range(steps):
            data.ctrl[0] = np.interp(time + (step + 0.5) * model.opt.timestep, times, force)
            mujoco.mj_step(model, data)
    return np.array(positions)


def recorded(program, folder, name, times, force, position):
    """A recording, by way of the table that any logger writes."""
    table, output = folder / f"{name}.csv", folder / f"{name}.mcap"
    rows = np.column_stack([times, force, position])
    np.savetxt(table, rows, delimiter=",", header="time_s,force_n,position_m", comments="")
    columns = ["--time", "time_s", "--input", "force_n:N", "--position", "position_m"]
    program("import", "csv", table, *columns, "-o", output)
    return output


def test_the_gap_of_a_foreign_simulator_closes(program, tmp_path):
    noise = np.random.default_rng(0)

    def record(name, phase, move):
        times, force = commands(phase)
        position = move(times, force) + noise.normal(0, 2e-5, len(times))
        return recorded(program, tmp_path, name, times, force, position)

    # The simulator's own twin, from recordings of the simulator.
    own = [record(f"own-{index}", index, lambda *given: in_mujoco(SIMULATOR, *given)) for index in (1, 2)]
    simulator = klasktron.calibrate(own).twin
    assert simulator.value("gantry.inertia.mass_kg") == pytest.approx(2.0, rel=0.02)
    assert simulator.value("drive.friction.coulomb.force_n") == pytest.approx(1.5, rel=0.1)  # MuJoCo softens dry friction
    # What that twin lacks of the machine.
    real = [record(f"machine-{index}", index, machine) for index in (3, 4)]
    found = klasktron.gap(real, simulator)
    assert {effect["name"] for effect in found.effects} == {"gantry.stiffness", "drive.delay"}
    # Back into MuJoCo, and on held-out commands.
    times, force = commands(5.0)
    truth = machine(times, force)
    positions = {
        "simulator": in_mujoco(SIMULATOR, times, force),
        "twin": found.twin.simulate(force, times_s=times, unit="N")["position_m"],
        "exported": in_mujoco(found.twin.to_mjcf(strict=True), times, force),
    }
    errors = {name: float(np.sqrt(np.mean((own - truth) ** 2))) for name, own in positions.items()}
    print(f"RMS of the position error (m): {errors}")
    assert errors["exported"] < 1.2 * errors["twin"], errors
    assert errors["exported"] < 0.05 * errors["simulator"], errors
