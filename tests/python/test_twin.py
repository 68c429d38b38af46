"""The twin: parameters, simulation and residuals, compared with the program and with equations."""

import csv
import json
import os
import pickle
import signal
import threading
import time

import numpy as np
import pytest

import klasktron
from klasktron import KlasktronError, Twin


def test_a_twin_is_its_document(twin_file, tmp_path):
    twin = Twin.load(twin_file)
    assert twin.machine == "table"
    assert twin.document == json.loads(twin_file.read_text())
    assert twin.to_json() == twin_file.read_text()
    assert pickle.loads(pickle.dumps(twin)) == twin
    copy = tmp_path / "copy.json"
    twin.save(copy)
    assert copy.read_bytes() == twin_file.read_bytes()
    with pytest.raises(KlasktronError, match="exists"):
        twin.save(copy)
    twin.save(copy, overwrite=True)


def test_parameters_have_value_unit_interval_and_bounds():
    twin = Twin.nominal("table")
    rows = [own for own in twin.parameters if own["effect"] == "drive.saturation.slew"]
    assert [own["name"] for own in rows] == ["limit_m_per_s2"]
    low, high = rows[0]["bounds"]
    assert rows[0]["unit"] == "m/s^2" and rows[0]["source"] == "nominal" and rows[0]["ci95"] is None
    assert low < rows[0]["value"] < high
    name = "drive.saturation.slew.limit_m_per_s2"
    other = twin.with_value(name, 7.5)
    assert other.value(name) == 7.5 and twin.value(name) == rows[0]["value"] and other != twin
    with pytest.raises(KlasktronError, match=f"{name} is 1000000000; allowed are 0.1 to 500 m/s"):
        twin.with_value(name, 1e9)
    with pytest.raises(KlasktronError, match="on x, y; give the axis"):
        twin.value("gantry.inertia.mass_kg")
    assert twin.value("gantry.inertia.mass_kg", "x") < twin.value("gantry.inertia.mass_kg", "y")
    with pytest.raises(KlasktronError, match="no parameter 'drive.nothing.x'"):
        twin.value("drive.nothing.x")


def test_simulation_is_that_of_the_program(program, twin_file, tmp_path):
    times = np.arange(150) * 0.02
    velocity = np.stack([0.3 * np.sin(4 * times), 0.2 * np.cos(3 * times)], axis=1)
    table = tmp_path / "commands.csv"
    lines = ["time_s,command_vx_m_per_s,command_vy_m_per_s"]
    lines += [f"{t!r},{x!r},{y!r}" for t, (x, y) in zip(times.tolist(), velocity.tolist(), strict=True)]
    table.write_text("\n".join(lines) + "\n")
    output = tmp_path / "motion.mcap"
    program("simulate", twin_file, "--commands", table, "--start", "0.05,-0.1", "-o", output)
    with open(output.with_suffix(".csv"), newline="") as file:
        rows = list(csv.DictReader(file))
    column = lambda name: np.array([float(row[name]) for row in rows])  # noqa: E731
    found = Twin.load(twin_file).simulate(velocity, times_s=times, start=[0.05, -0.1])
    assert np.allclose(found["time_s"], column("time_s"), atol=1e-9)
    pairs = {
        "command_m_per_s": ("command_vx_m_per_s", "command_vy_m_per_s"),
        "carriage_m": ("carriage_x_m", "carriage_y_m"),
        "carriage_m_per_s": ("carriage_vx_m_per_s", "carriage_vy_m_per_s"),
        "motor_m_per_s": ("motor_a_velocity_m_per_s", "motor_b_velocity_m_per_s"),
        "motor_torque_nm": ("motor_a_torque_nm", "motor_b_torque_nm"),
        "striker_m": ("striker_x_m", "striker_y_m"),
    }
    for name, columns in pairs.items():
        wanted = np.stack([column(own) for own in columns], axis=1)
        assert np.array_equal(found[name], wanted), name
    # The commands of a recording, with its first position and its end.
    from_file = Twin.load(twin_file).simulate(output)
    assert np.allclose(from_file["carriage_m"][:400], found["carriage_m"][:400], atol=1e-9)


def test_a_single_axis_follows_its_equation():
    """Mass and viscous friction under a step of force, against the closed form; first order in the step."""
    mass, viscous, force = 2.0, 3.0, 4.0
    twin = Twin.nominal("axis").with_value("gantry.inertia.mass_kg", mass)
    twin = twin.with_value("drive.friction.viscous.coefficient_n_s_per_m", viscous)
    errors = []
    for dt in (1e-3, 1e-4):
        times = np.arange(round(2.0 / dt) + 1) * dt
        motion = twin.simulate(np.full(len(times), force), times_s=times, unit="N")
        tau = mass / viscous
        rise = 1 - np.exp(-times / tau)
        assert list(motion) == ["time_s", "force_n", "position_m", "velocity_m_per_s"]
        errors.append(np.abs(motion["velocity_m_per_s"] - force / viscous * rise).max())
    assert errors[0] < 1e-3 and errors[1] < 0.15 * errors[0], errors
    started = twin.simulate(np.zeros(11), dt_s=0.1, start=[0.3, 0.0])
    assert started["position_m"][0] == started["position_m"][-1] == 0.3


@pytest.mark.parametrize(
    ("commands", "options", "sentence"),
    [
        (np.zeros((5, 3)), {}, r"commands has shape \(5, 3\) and dtype float64; expected are shape \(n, 2\)"),
        (np.zeros((5, 2), complex), {}, r"dtype complex128; expected .* dtype float64"),
        ([["a", "b"]], {}, r"commands has shape \(1, 2\) and dtype <U1"),
        (np.zeros((5, 2)), {"times_s": [0, 1]}, r"times_s has shape \(2,\).*expected are shape \(5,\)"),
        (np.zeros((3, 2)), {"times_s": [0, 2, 1]}, r"times_s\[2\] is 1 after 2"),
        (np.zeros((3, 2)), {"rate_hz": 5000}, r"rate_hz is 5000; allowed are 1 to 1000 Hz"),
        (np.zeros((3, 2)), {"dt_s": -1}, r"dt_s is -1; allowed are numbers above 0"),
        ([[0, 0], [np.nan, 0]], {}, r"the command at 0.02 s is not finite"),
        (np.zeros((3, 2)), {"player": "middle"}, r"player is 'middle'; known are"),
    ],
)
def test_wrong_commands_give_one_sentence(commands, options, sentence):
    with pytest.raises(KlasktronError, match=sentence):
        Twin.nominal("table").simulate(commands, **options)


def test_integers_and_single_precision_are_converted():
    twin = Twin.nominal("table")
    whole = twin.simulate(np.array([[1, 0]] * 10))
    single = twin.simulate(np.array([[1, 0]] * 10, np.float32)[::-1])
    assert np.array_equal(whole["carriage_m"], single["carriage_m"])


def test_residuals_are_measured_minus_simulated(train, twin_file):
    plain, fitted = Twin.nominal("table"), Twin.load(twin_file)
    before = {(own.split, own.signal): own for own in plain.residuals(train)}
    after = {(own.split, own.signal): own for own in fitted.residuals([train])}
    assert before.keys() == after.keys() and ("train", "motor_a.velocity") in before
    own = after["train", "motor_a.velocity"]
    assert own.stage == "drive" and own.unit == "m/s"
    finite = own.residual[np.isfinite(own.residual)]
    assert own.rms == pytest.approx(np.sqrt(np.mean(finite**2)), rel=1e-12)
    known = np.isfinite(own.residual)
    assert 1000 < known.sum() and len(own.time_s) == len(own.measured) == len(known)
    assert np.allclose((own.simulated + own.residual)[known], own.measured[known])
    for signal in ("motor_a.velocity", "motor_b.velocity"):
        assert after["train", signal].rms < before["train", signal].rms


def test_another_machine_is_refused(train):
    with pytest.raises(KlasktronError, match="axis"):
        Twin.nominal("axis").residuals(train)


def test_calibrate_is_that_of_the_program(program, train, tmp_path):
    path = tmp_path / "twin.json"
    said = program("calibrate", train, "-o", path, "--json", accepted=(0, 3))
    found = klasktron.calibrate(train)
    assert found.document == json.loads(said.stdout)
    assert found.twin == Twin.load(path)
    assert found.verdict in found.document["verdict"] and found.summary and found.residuals


def recorded_axis(program, folder, name, phase):
    """Recording of an axis with mass, friction and a spring, which the plain twin lacks."""
    dt, count, steps = 2e-3, 4000, 10
    mass, viscous, coulomb, stiffness = 2.0, 3.0, 1.5, 8.0
    times = np.arange(count) * dt
    force = 6 * np.sin(4.4 * times + phase) + 4 * np.sin(12 * times)
    fine = np.interp(np.arange(count * steps) * dt / steps, times, force)
    position, velocity, positions = 0.0, 0.0, []
    for index, push in enumerate(fine):
        if index % steps == 0:
            positions.append(position)
        free = velocity + dt / steps * (push - viscous * velocity - stiffness * position) / mass
        lost = min(dt / steps * coulomb / mass, abs(free))
        after = free - np.copysign(lost, free)
        position, velocity = position + 0.5 * dt / steps * (velocity + after), after
    noise = np.random.default_rng(round(10 * phase)).normal(0, 2e-5, count)
    table = folder / f"{name}.csv"
    rows = np.column_stack([times, force, positions + noise])
    np.savetxt(table, rows, delimiter=",", header="time_s,force_n,position_m", comments="")
    output = folder / f"{name}.mcap"
    columns = ["--time", "time_s", "--input", "force_n:N", "--position", "position_m"]
    program("import", "csv", table, *columns, "-o", output)
    return output


def test_gap_is_that_of_the_program_and_finds_what_is_missing(program, tmp_path):
    recordings = [recorded_axis(program, tmp_path, name, phase) for name, phase in (("a", 0.3), ("b", 1.7))]
    folder = tmp_path / "gap"
    fix = "gantry.inertia.mass_kg=2"
    said = program("gap", *recordings, "--fix", fix, "-o", folder, "--json", accepted=(0, 3))
    found = klasktron.gap(recordings, fix=[fix])
    assert found.document == json.loads(said.stdout)
    assert found.twin == Twin.load(folder / "twin.json")
    assert [own["name"] for own in found.effects] == ["gantry.stiffness"]
    assert found.verdict == "named"
    truth = {"drive.friction.coulomb.force_n": 1.5, "gantry.inertia.mass_kg": 2.0}
    for name, value in truth.items():
        assert found.twin.value(name) == pytest.approx(value, rel=0.02), name
    stiffness = next(own for own in found.twin.parameters if own["effect"] == "gantry.stiffness")
    low, high = stiffness["ci95"]
    assert low < 8.0 < high
    # The twin found predicts a further recording better than the plain one.
    further = recorded_axis(program, tmp_path, "c", 2.9)
    plain = klasktron.calibrate(recordings).twin
    rms = [twin.residuals(further)[0].rms for twin in (plain, found.twin)]
    assert rms[1] < 0.5 * rms[0], rms


def test_a_search_refuses_unknown_effects_and_bad_options(train):
    for options, sentence in [
        ({"only": "drive.frction"}, "'drive.frction' is no effect"),
        ({"alpha": 0.9}, "alpha is 0.9; allowed are"),
        ({"fix": "drive.delay"}, "'drive.delay' is no assignment"),
        ({"validation": "sunday"}, "sunday"),
    ]:
        with pytest.raises(KlasktronError, match=sentence):
            klasktron.gap(train, **options)


def test_a_long_call_releases_the_interpreter_lock(train):
    done = threading.Event()

    def calibrate():
        klasktron.calibrate(train)
        done.set()

    worker = threading.Thread(target=calibrate)
    begun = time.perf_counter()
    worker.start()
    turns, longest, last = 0, 0.0, time.perf_counter()
    while not done.wait(0.001):
        now = time.perf_counter()
        longest, last = max(longest, now - last), now
        turns += 1
    worker.join()
    duration = time.perf_counter() - begun
    # With the lock held, this thread would not have run between the begin and the end.
    assert 5 <= turns and longest < 0.5 * duration, (turns, longest, duration)


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
def test_ctrl_c_interrupts_a_search(train, validation):
    timer = threading.Timer(0.5, os.kill, (os.getpid(), signal.SIGINT))
    begun = time.monotonic()
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        klasktron.gap([train, validation])
    assert time.monotonic() - begun < 3.0
    # The module works afterwards.
    assert klasktron.read(train).runs
