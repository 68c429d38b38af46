"""The twin in MuJoCo: motion of the exported model next to that of the twin."""

import json

import numpy as np
import pytest

import klasktron
from klasktron import KlasktronError, Twin

try:
    import mujoco
except ImportError:
    mujoco = None
pytestmark = pytest.mark.skipif(mujoco is None, reason="could not import 'mujoco'")

RATE_HZ = 200.0


def simulated_table(xml, commands, times, samples, start=(0.0, 0.0)):
    """Carriage (x, y, vx, vy) and striker (x, y) of the model at `samples` times, with commands held until the next."""
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    (x, y), (a, b) = start, (start[0] + start[1], start[0] - start[1])
    for name, value in (("x", x), ("y", y), ("setpoint_a", a), ("setpoint_b", b)):
        data.joint(name).qpos[0] = value
    steps = round(1 / RATE_HZ / model.opt.timestep)
    rows, following = [], 0
    for _ in range(samples):
        mujoco.mj_forward(model, data)
        x, y = data.joint("x"), data.joint("y")
        rows.append([x.qpos[0], y.qpos[0], x.qvel[0], y.qvel[0], *data.body("striker").xpos[:2]])
        for _ in range(steps):
            while following < len(times) and times[following] <= data.time + 1e-9:
                vx, vy = commands[following]
                data.ctrl[:2] = vx + vy, vx - vy
                following += 1
            mujoco.mj_step(model, data)
    return np.array(rows)


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


def random_commands(count=200):
    """Velocities (m/s), constant for 0.2 s, and their times."""
    levels = np.random.default_rng(1).uniform(-0.4, 0.4, (count // 10, 2))
    return np.repeat(levels, 10, axis=0), np.arange(count) * 0.02


def with_effects(twin, *effects):
    """A twin with further effects: name, location, values."""
    document = twin.document
    for name, location, values in effects:
        parameters = [{"name": own, "value": value, "source": "known"} for own, value in values.items()]
        document["effects"].append({"name": name, "location": location, "parameters": parameters})
    return Twin.from_json(json.dumps(document))


@pytest.fixture(scope="module")
def twin_without_lag(program, train, tmp_path_factory):
    """A calibrated twin whose velocity loop has no lag in its feedback, which MJCF cannot express."""
    path = tmp_path_factory.mktemp("twin") / "twin.json"
    names = ("feedback_delay_s", "estimator_time_constant_s")
    fixed = [option for name in names for option in ("--fix", f"drive.velocity_loop.{name}=0")]
    program("calibrate", train, "-o", path, *fixed, accepted=(0, 3))
    return path


def test_held_out_commands_move_it_as_they_move_the_twin(twin_without_lag, validation):
    """RMS of the velocity error on a recording to which nothing was fitted: within 10 % of the twin's."""
    twin = Twin.load(twin_without_lag)
    recording = klasktron.read(validation)
    origin = min(topic.log_time_ns[0] for topic in recording.values())
    commands = recording["/striker/left/command"]
    velocity = np.stack([commands["vx"], commands["vy"]], axis=1)
    own = twin.simulate(validation, rate_hz=RATE_HZ)
    times = (commands.log_time_ns - origin) * 1e-9
    other = simulated_table(twin.to_mjcf(strict=True), velocity, times, len(own["time_s"]), own["carriage_m"][0])
    carriage = recording["/striker/left/carriage"]
    measured_at = (carriage.log_time_ns - origin) * 1e-9
    errors = {}
    for name, found in (("twin", own["carriage_m_per_s"]), ("MuJoCo", other[:, 2:4])):
        parts = [
            np.interp(measured_at, own["time_s"], found[:, axis]) - carriage[column]
            for axis, column in enumerate(("vx", "vy"))
        ]
        errors[name] = rms(parts)
    print(f"RMS of the velocity error (m/s): {errors}")
    assert errors["MuJoCo"] < 1.1 * errors["twin"], errors
    assert rms(other[:, 2:4] - own["carriage_m_per_s"]) < 0.3 * errors["twin"]


# With feedback that is not delayed, the model has all of the twin.
EFFECTS = {
    "delay": [("drive.delay", "a+b", {"delay_s": 0.012})],
    "two delays": [("drive.delay", "a", {"delay_s": 0.005}), ("drive.delay", "b", {"delay_s": 0.011})],
    "gain, then offset": [
        ("drive.gain", "a", {"gain": 0.9}),
        ("drive.offset", "a", {"offset": 0.03}),
    ],
    "lag": [("drive.lag1", "a+b", {"time_constant_s": 0.02})],
    "friction of belts": [
        ("drive.friction.coulomb", "a", {"force_n": 4.0}),
        ("drive.friction.viscous", "b", {"coefficient_n_s_per_m": 20.0}),
    ],
    "spring of the striker": [
        (
            "coupling.magnet_spring",
            "all",
            {"stiffness_n_per_m": 60.0, "damping_ratio": 0.2, "softening_m": 1.0, "force_n": 0.0},
        )
    ],
}


@pytest.mark.parametrize("name", EFFECTS)
def test_each_effect_is_in_the_model(name):
    plain = Twin.nominal("table")
    twin = with_effects(plain, *EFFECTS[name])
    commands, times = random_commands()
    own = twin.simulate(commands, times_s=times, rate_hz=RATE_HZ)
    without = plain.simulate(commands, times_s=times, rate_hz=RATE_HZ)
    other = simulated_table(twin.to_mjcf(strict=True), commands, times, len(own["time_s"]))
    if name == "spring of the striker":
        # The camera shows the striker, which the spring lets lag behind.
        lag = own["striker_m"] - own["carriage_m"]
        effect, error = rms(lag), rms(other[:, 4:6] - other[:, :2] - lag)
    else:
        effect = rms(own["carriage_m_per_s"] - without["carriage_m_per_s"])
        error = rms(other[:, 2:4] - own["carriage_m_per_s"])
    assert error < 0.12 * effect + 0.0013, (effect, error)
    assert 2 * error < effect, (effect, error)


def test_the_error_falls_with_the_timestep():
    twin = Twin.nominal("table")
    commands, times = random_commands()
    own = twin.simulate(commands, times_s=times, rate_hz=RATE_HZ)["carriage_m_per_s"]
    xml = twin.to_mjcf()
    assert 'timestep="0.00025"' in xml
    coarse = xml.replace('timestep="0.00025"', 'timestep="0.001"')
    errors = [rms(simulated_table(text, commands, times, len(own))[:, 2:4] - own) for text in (coarse, xml)]
    assert errors[1] < 0.4 * errors[0] and errors[1] < 0.01 * rms(own), errors


def test_a_single_axis_moves_alike():
    twin = Twin.nominal("axis").with_value("gantry.inertia.mass_kg", 2.0)
    twin = twin.with_value("drive.friction.viscous.coefficient_n_s_per_m", 3.0)
    twin = twin.with_value("drive.friction.coulomb.force_n", 1.5).with_value("drive.offset.offset", 0.4)
    twin = with_effects(
        twin,
        ("gantry.stiffness", "x+y", {"stiffness_n_per_m": 8.0}),
        ("drive.delay", "a+b", {"delay_s": 0.004}),
        ("gantry.tilt", "x+y", {"force_n": 0.7}),
    )
    times = np.arange(4000) * 1e-3
    force = 6 * np.sin(4.4 * times) + 4 * np.sin(12 * times)
    own = twin.simulate(force, times_s=times, unit="N")
    model = mujoco.MjModel.from_xml_string(twin.to_mjcf(strict=True))
    data = mujoco.MjData(model)
    steps = round(1e-3 / model.opt.timestep)
    position = []
    for index in range(len(times)):
        position.append(data.qpos[0])
        for step in range(steps):
            data.ctrl[0] = np.interp(times[index] + (step + 0.5) * model.opt.timestep, times, force)
            mujoco.mj_step(model, data)
    error = np.abs(np.array(position) - own["position_m"]).max()
    assert error < 0.01 * np.abs(own["position_m"]).max(), error


def test_what_is_missing_is_listed_with_status_3_or_refused(program, tmp_path):
    twin = with_effects(
        Twin.nominal("table"),
        ("drive.friction.stribeck", "x", {"force_n": 1.0, "velocity_m_per_s": 0.05, "exponent": 1.0}),
    )
    path, output = tmp_path / "twin.json", tmp_path / "model.xml"
    twin.save(path)
    failed = program("export", path, "--to", "mjcf", "--strict", "-o", output, accepted=(1,))
    assert "MJCF cannot express drive.friction.stribeck on x" in failed.stderr and not output.exists()
    said = program("export", path, "--to", "mjcf", "-o", output, accepted=(3,)).stderr
    assert "warning: MJCF cannot express drive.friction.stribeck on x" in said
    assert "outside of it: ball.rolling_resistance" in said
    with pytest.warns(UserWarning, match="cannot express drive.friction.stribeck on x"):
        assert twin.to_mjcf() == output.read_text()
    with pytest.raises(KlasktronError, match="drive.friction.stribeck"):
        twin.to_mjcf(strict=True)
    mujoco.MjModel.from_xml_path(str(output))
    # Status 0 where nothing is missing.
    whole = tmp_path / "whole.json"
    Twin.nominal("table").save(whole)
    program("export", whole, "--to", "mjcf", "-o", tmp_path / "whole.xml")
    said = program("export", tmp_path / "whole.xml", "--to", "mjcf", "-o", tmp_path / "x", accepted=(1,))
    assert "whole.xml is no twin.json" in said.stderr
