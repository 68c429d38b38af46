"""Actuator network, state estimator, referee and policy, compared with the program and with plain NumPy."""

import json

import numpy as np
import pytest

import klasktron
from klasktron import ActuatorNet, Ekf, KlasktronError, Policy, Referee


def network(program, actuator, folder):
    """The exported weights: a function from rows of inputs to velocities."""
    path = folder / "weights.npz"
    program("export", actuator, "--to", "npz", "-o", path)
    arrays = dict(np.load(path))
    layers = [name.removesuffix(".weight") for name in arrays if name.endswith(".weight")]

    def forward(rows):
        values = rows.astype(np.float32)
        for index, layer in enumerate(layers):
            values = values @ arrays[f"{layer}.weight"].T + arrays[f"{layer}.bias"]
            if index + 1 < len(layers):
                values = np.maximum(values, 0)
        return values

    return forward


def test_the_actuator_network_is_its_weights(program, actuator, train, tmp_path):
    net = ActuatorNet.load(actuator)
    history = net.history_steps
    assert net.layout == "klasktron" and float(net.metadata["rate_hz"]) == 50.0
    assert net.onnx.startswith(b"\x08")
    generator = np.random.default_rng(0)
    commands = generator.uniform(-0.4, 0.4, (60, 2))
    velocities = generator.uniform(-0.4, 0.4, (60, 2))
    forward = network(program, actuator, tmp_path)

    def row(speeds, at):
        # Newest first, x and y interleaved; commands, then velocities.
        window = slice(at - history + 1, at + 1)
        return np.concatenate([commands[window][::-1].ravel(), speeds[window][::-1].ravel()])

    rows = np.stack([row(velocities, at) for at in range(history - 1, 59)])
    found = net.predict(commands, velocities)
    assert found.shape == (60 - history, 2)
    assert np.allclose(found, forward(rows), atol=1e-5)
    # Free-running: its own predictions instead of the measured velocities.
    known = np.zeros_like(velocities)
    known[:history] = velocities[:history]
    for at in range(history - 1, 59):
        known[at + 1] = forward(row(known, at)[None])[0]
    found = net.simulate(commands, velocities[:history])
    assert np.allclose(found, known[history:], atol=1e-4)


def test_the_actuator_network_refuses_short_and_odd_inputs(actuator):
    net = ActuatorNet.load(actuator)
    with pytest.raises(KlasktronError, match="commands has 4 samples; the network needs at least 11"):
        net.predict(np.zeros((4, 2)), np.zeros((4, 2)))
    with pytest.raises(KlasktronError, match=r"velocities has shape \(19, 2\).*expected are shape \(20, 2\)"):
        net.predict(np.zeros((20, 2)), np.zeros((19, 2)))


def test_a_file_of_another_kind_is_refused(train):
    with pytest.raises(KlasktronError, match="klasktron fit-actuator"):
        ActuatorNet.load(train)
    with pytest.raises(KlasktronError, match="klasktron train"):
        Policy.load(train)


def straight(count=120):
    """Frames at 120 Hz of a ball with constant velocity, left striker at rest, right one never seen."""
    times = np.arange(count) / 120
    seen = np.full((count, 3, 2), np.nan)
    seen[:, 0] = np.array([-0.1, -0.15]) + times[:, None] * np.array([0.1, 0.2])
    seen[:, 1] = [0.02, -0.1]
    return times, seen


def test_steps_equal_the_batch_and_estimate_the_velocity():
    times, seen = straight()
    batch = Ekf().run(times, seen)
    assert batch["mean"].shape == (120, 3, 4) and batch["covariance"].shape == (120, 3, 4, 4)
    filter_ = Ekf()
    for index, (time, frame) in enumerate(zip(times, seen, strict=True)):
        step = filter_.step(time, frame)
        for name, values in step.items():
            assert np.array_equal(values, batch[name][index], equal_nan=values.dtype.kind == "f"), name
    assert np.allclose(batch["mean"][-1, 0, 2:], [0.1, 0.2], atol=0.02)
    assert np.isnan(batch["mean"][:, 2]).all() and not batch["accepted"][:, 2].any()
    covariance = batch["covariance"][-1, 0]
    assert np.array_equal(covariance, covariance.T) and (0 < np.linalg.eigvalsh(covariance)).all()
    ahead = filter_.estimate_at("ball", times[-1] + 0.01)
    assert ahead[1] - step["mean"][0, 1] == pytest.approx(0.002, abs=3e-4)
    assert filter_.estimate_at("right", times[-1]) is None
    filter_.reset()
    assert filter_.estimate_at("ball", times[-1]) is None


def test_a_late_frame_is_inserted_and_an_outlier_gated():
    times, seen = straight()
    order = np.arange(120)
    order[[60, 61]] = order[[61, 60]]
    late = Ekf()
    late.run(times[order], seen[order])
    wanted = Ekf().run(times, seen)["mean"][-1]
    assert np.array_equal(late.estimate_at("ball", times[-1]), wanted[0])
    seen[80, 0] = [0.15, 0.2]
    found = Ekf().run(times, seen)
    assert not found["accepted"][80, 0] and found["accepted"][[79, 81], 0].all()
    assert 20 < found["nis"][80, 0]


def test_the_filter_refuses_wrong_shapes_and_times(tmp_path):
    with pytest.raises(KlasktronError, match=r"detections has shape \(2, 2\).*expected are shape \(3, 2\)"):
        Ekf().step(0.0, np.zeros((2, 2)))
    with pytest.raises(KlasktronError, match="time 1 is -1 s; allowed are 0 to 1e10 s"):
        Ekf().run([0.0, -1.0], np.zeros((2, 3, 2)))
    with pytest.raises(KlasktronError, match="object is 'puck'"):
        Ekf().estimate_at("puck", 0.0)
    path = tmp_path / "ekf.json"
    path.write_text("{}")
    with pytest.raises(KlasktronError, match="ekf.json"):
        Ekf(path)


def test_settings_come_from_a_file(program, match, tmp_path):
    program("tune-ekf", match, "-o", tmp_path / "ekf", accepted=(0, 3))
    path = tmp_path / "ekf" / "ekf.json"
    assert Ekf(path).settings == json.loads(path.read_text())["filter"]


def test_the_score_is_that_of_the_program(program, match, tmp_path):
    said = program("eval", match, "-o", tmp_path / "eval", "--seed", 3, "--json", accepted=(0, 3))
    score = Referee(seed=3).score(match)
    assert score.document == json.loads(said.stdout)
    assert len(score.events) == 1 and len(score.episodes) == 5
    events = score.events[0]
    count = len(events["time_s"])
    assert all(len(column) == count for column in events.values())
    assert (np.diff(events["time_s"]) >= 0).all()
    goals = (events["kind"] == "goal").sum()
    assert goals == sum(own["outcome"] == "goal" for own in score.episodes)
    table = klasktron.read(tmp_path / "eval" / "events.mcap")["/match/event"]
    assert table.count == count


def test_a_policy_acts_within_its_limits(policy):
    own = Policy.load(policy)
    seen = np.random.default_rng(0).uniform(-0.2, 0.2, (1000, own.observation_size))
    actions = own(seen)
    assert actions.shape == (1000, 2) and actions.dtype == np.float32
    assert (np.abs(actions) <= 1).all() and 0.01 < actions.std()
    assert np.array_equal(own(seen[:3]), actions[:3])
    with pytest.raises(KlasktronError, match=r"observations has shape \(2, 3\)"):
        own(np.zeros((2, 3)))
