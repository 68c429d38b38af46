//! A mass with Coulomb and viscous friction, integrated in fine steps: under forces that are held from sample to sample,
//! and behind a velocity controller. Friction makes a kink in the velocity at every reversal, and now and then the mass
//! sticks. None of that is a missing effect.

use super::{gap, names};
use crate::support::{klasktron, said};
use klasktron::seed::Stream;
use std::{fmt::Write as _, fs, path::Path};

const SAMPLE_S: f64 = 0.005;
const STEPS_PER_SAMPLE: usize = 100;
const STEP_S: f64 = SAMPLE_S / STEPS_PER_SAMPLE as f64;
const SAMPLES: usize = 8000;
const MASS_KG: f64 = 2.0;
const COULOMB_N: f64 = 1.5;
const VISCOUS_N_S_PER_M: f64 = 3.0;
const ENCODER_M: f64 = 1e-6;
const DISTURBANCE_N: f64 = 0.05;

const GRAVITY_M_PER_S2: f64 = 9.81;
const ARM_M: f64 = 0.3;
const ARM_KG_M2: f64 = 0.2;
const ARM_N_M: f64 = 3.0;
const ARM_COULOMB_N_M: f64 = 0.4;
const ARM_ENCODER_RAD: f64 = 2e-5;

/// Position, velocity and acceleration of the reference at `t` seconds; `phase` makes sessions differ.
fn reference(t: f64, phase: f64) -> [f64; 3] {
    let mut motion = [0.0; 3];
    for (size, rate) in [(0.08, 1.1), (0.05, 2.7), (0.02, 6.1), (0.004, 17.0)] {
        let (sine, cosine) = (rate * t + phase).sin_cos();
        motion[0] += size * sine;
        motion[1] += size * rate * cosine;
        motion[2] -= size * rate * rate * sine;
    }
    motion
}

/// What is not the same on every machine.
#[derive(Clone, Copy)]
struct Machine {
    /// Force at a position (N).
    force: fn(f64) -> f64,
    /// Coulomb friction at a time (N).
    coulomb: fn(f64) -> f64,
    /// Increase of the mass along the axis (kg/m).
    slope: f64,
}

const MACHINE: Machine = Machine { force: |_| 0.0, coulomb: |_| COULOMB_N, slope: 0.0 };

/// The mass, with a coloured random force on it.
struct Mass {
    q: f64,
    v: f64,
    coulomb: f64,
    slope: f64,
    disturbance: f64,
    random: Stream,
}

impl Mass {
    fn new(seed: u64) -> Self {
        let random = Stream::new(seed, "single axis");
        Self { q: 0.0, v: 0.0, coulomb: COULOMB_N, slope: 0.0, disturbance: 0.0, random }
    }

    fn begin_sample(&mut self) {
        let sum: f64 = (0..12).map(|_| f64::from(self.random.uniform_f32(-0.5, 0.5))).sum();
        self.disturbance = 0.7 * self.disturbance + DISTURBANCE_N * sum;
    }

    /// One step under `force` (N), which friction opposes.
    fn step(&mut self, force: f64) {
        let mass = MASS_KG + self.slope * self.q;
        // A mass that grows along the axis is slowed by its own momentum.
        let all = force + self.disturbance
            - VISCOUS_N_S_PER_M * self.v
            - 0.5 * self.slope * self.v.powi(2);
        let free = self.v + STEP_S / mass * all;
        self.v = free.signum() * (free.abs() - STEP_S / mass * self.coulomb).max(0.0);
        self.q += STEP_S * self.v;
    }

    fn encoder_mm(&self) -> f64 {
        1e3 * (self.q / ENCODER_M).round() * ENCODER_M
    }
}

/// Import `table` with its columns of time, input and position.
fn import(dir: &Path, name: &str, table: &str, [time, input, position]: [&str; 3]) -> String {
    let [source, output] = ["csv", "mcap"].map(|end| dir.join(format!("{name}.{end}")));
    fs::write(&source, table).unwrap();
    let [source, output] = [source, output].map(|path| path.display().to_string());
    let words = ["import", "csv", &source, "--time", time, "--input", input];
    let rest = ["--position", position, "-o", &output];
    let (_, errors, status) = said(&klasktron(&[&words[..], &rest].concat()));
    assert_eq!(status, 0, "{errors}");
    output
}

/// A session of a position controller that holds each force until the next sample; `extra` is a force at a position (N).
fn held_forces(dir: &Path, name: &str, seed: u64, extra: fn(f64) -> f64) -> String {
    session(dir, name, seed, reference, Machine { force: extra, ..MACHINE })
}

/// The same along another `reference`.
fn session(
    dir: &Path,
    name: &str,
    seed: u64,
    reference: impl Fn(f64, f64) -> [f64; 3],
    machine: Machine,
) -> String {
    let mut table = "t_ms,force_mn,position_mm\n".to_owned();
    let mut mass = Mass { slope: machine.slope, ..Mass::new(seed) };
    for k in 0..SAMPLES {
        let t = SAMPLE_S * k as f64;
        mass.coulomb = (machine.coulomb)(t);
        let [target, speed, acceleration] = reference(t, seed as f64);
        let force = MASS_KG * acceleration + 900.0 * (target - mass.q) + 60.0 * (speed - mass.v);
        writeln!(table, "{},{},{}", 1e3 * t, 1e3 * force, mass.encoder_mm()).unwrap();
        mass.begin_sample();
        for _ in 0..STEPS_PER_SAMPLE {
            mass.step(force + (machine.force)(mass.q));
        }
    }
    import(dir, name, &table, ["t_ms:ms", "force_mn:mN", "position_mm:mm"])
}

/// A velocity controller and what is in front of it.
#[derive(Clone, Copy)]
struct Drive {
    /// Gains (N s/m and N/m).
    proportional: f64,
    integral: f64,
    /// Dead time of the setpoint in samples, and its first-order lag after that (s).
    late_samples: usize,
    lag_s: f64,
    /// Largest setpoint (m/s).
    limit: f64,
    /// Coulomb friction of the mass (N).
    coulomb: f64,
}

const DRIVE: Drive = Drive {
    proportional: 120.0,
    integral: 0.0,
    late_samples: 0,
    lag_s: STEP_S,
    limit: f64::INFINITY,
    coulomb: COULOMB_N,
};

/// A session of velocity setpoints.
fn velocity_setpoints(dir: &Path, name: &str, seed: u64, drive: Drive) -> String {
    let mut table = "t_ms,setpoint_mm_per_s,position_mm\n".to_owned();
    let mut mass = Mass { coulomb: drive.coulomb, ..Mass::new(seed) };
    let (mut sum, mut smooth) = (0.0, 0.0);
    for k in 0..SAMPLES {
        let t = SAMPLE_S * k as f64;
        let setpoint = |t: f64| reference(t, seed as f64)[1];
        writeln!(table, "{},{},{}", 1e3 * t, 1e3 * setpoint(t), mass.encoder_mm()).unwrap();
        mass.begin_sample();
        for step in 0..STEPS_PER_SAMPLE {
            let arrived = t + STEP_S * step as f64 - SAMPLE_S * drive.late_samples as f64;
            smooth += STEP_S / drive.lag_s * (setpoint(arrived) - smooth);
            let error = smooth.clamp(-drive.limit, drive.limit) - mass.v;
            sum += STEP_S * error;
            mass.step(drive.proportional * error + drive.integral * sum);
        }
    }
    import(dir, name, &table, ["t_ms:ms", "setpoint_mm_per_s:mm/s", "position_mm:mm"])
}

/// A session for training and one for validation.
fn pair(session: impl Fn(&str, u64) -> String) -> [String; 2] {
    [("one", 1), ("validation", 2)].map(|(name, seed)| session(name, seed))
}

/// Result and exit status of `gap` on a pair of sessions, each made in a folder with a name and a seed.
fn answer(session: impl Fn(&Path, &str, u64) -> String) -> (serde_json::Value, i32) {
    let dir = tempfile::tempdir().unwrap();
    let sessions = pair(|name, seed| session(dir.path(), name, seed));
    gap(&sessions, None, &dir.path().join("out"))
}

fn parameter(document: &serde_json::Value, effect: usize, parameter: usize) -> f64 {
    document["effects"][effect]["parameters"][parameter]["value"].as_f64().unwrap()
}

#[test]
fn a_held_input_and_the_reversals_of_friction_are_no_effects() {
    let (document, status) = answer(|dir, name, seed| held_forces(dir, name, seed, |_| 0.0));
    assert_eq!((names(&document), status), (vec![], 0), "{document:#}");
    let warnings = document["warnings"].to_string();
    assert!(warnings.contains("is less than the sample period of 0.005"), "{warnings}");
}

#[test]
fn a_spring_beside_a_held_input_is_named() {
    const SPRING_N_PER_M: f64 = 40.0;
    let spring = |q: f64| -SPRING_N_PER_M * q;
    let (document, _) = answer(|dir, name, seed| held_forces(dir, name, seed, spring));
    assert_eq!(names(&document), ["gantry.stiffness"], "{document:#}");
    let stiffness = parameter(&document, 0, 0);
    assert!((stiffness - SPRING_N_PER_M).abs() < 0.05 * SPRING_N_PER_M, "{stiffness}");
}

/// Moves of 0.4 s with rests between them: most of the compared samples are the first ones of a move.
#[test]
fn a_spring_is_named_from_short_moves() {
    const SPRING_N_PER_M: f64 = 60.0;
    const PERIOD_S: f64 = 1.2;
    const MOVE_S: f64 = 0.4;
    let short = |t: f64, phase: f64| {
        let number = (t / PERIOD_S).floor();
        let [from, to] = [number, number + 1.0].map(|k| 0.1 * (1.7 * k + phase).sin());
        let s = ((t - number * PERIOD_S) / MOVE_S).min(1.0);
        let change = to - from;
        [
            from + change * s.powi(3) * (10.0 - 15.0 * s + 6.0 * s * s),
            change * 30.0 * (s * (1.0 - s)).powi(2) / MOVE_S,
            change * 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / MOVE_S.powi(2),
        ]
    };
    let machine = Machine { force: |q| -SPRING_N_PER_M * q, ..MACHINE };
    let (document, _) = answer(|dir, name, seed| session(dir, name, seed, short, machine));
    assert_eq!(names(&document), ["gantry.stiffness"], "{document:#}");
    let stiffness = parameter(&document, 0, 0);
    assert!((stiffness - SPRING_N_PER_M).abs() < 0.05 * SPRING_N_PER_M, "{stiffness}");
}

#[test]
fn a_validation_session_without_motion_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let train = held_forces(dir.path(), "one", 1, |_| 0.0);
    let validation = session(dir.path(), "validation", 2, |_, _| [0.0; 3], MACHINE);
    let (document, status) = gap(&[train, validation], None, &dir.path().join("out"));
    assert_eq!((&document["verdict"], status), (&"not_testable".into(), 3), "{document:#}");
    let summary = document["summary"].as_str().unwrap();
    assert!(summary.contains("no sample of the validation sessions can be compared"), "{summary}");
}

#[test]
fn a_velocity_controller_with_friction_is_no_effect() {
    for (case, integral) in [("proportional", 0.0), ("integral", 2000.0)] {
        let drive = Drive { integral, ..DRIVE };
        let (document, status) =
            answer(|dir, name, seed| velocity_setpoints(dir, name, seed, drive));
        assert_eq!((names(&document), status), (vec![], 0), "{case}: {document:#}");
        assert_eq!(document["verdict"], "none", "{case}: {document:#}");
    }
}

#[test]
fn the_delay_and_the_limit_of_a_velocity_setpoint_are_named() {
    const LATE_SAMPLES: usize = 4;
    const LIMIT_M_PER_S: f64 = 0.2;
    for (drive, name, value) in [
        (
            Drive { late_samples: LATE_SAMPLES, ..DRIVE },
            "drive.delay",
            SAMPLE_S * LATE_SAMPLES as f64,
        ),
        (Drive { limit: LIMIT_M_PER_S, ..DRIVE }, "drive.saturation.speed", LIMIT_M_PER_S),
    ] {
        let (document, _) = answer(|dir, name, seed| velocity_setpoints(dir, name, seed, drive));
        assert_eq!(names(&document), [name], "{document:#}");
        let found = parameter(&document, 0, 0);
        assert!((found - value).abs() < 0.1 * value, "{name}: {found} of {value}");
    }
}

/// With a fast integral action and much viscous friction, the controller alone predicts a lag and a proportional controller.
#[test]
fn a_lag_before_a_slow_velocity_controller_is_named() {
    const LAG_S: f64 = 0.041;
    let drive = Drive { proportional: 24.0, lag_s: LAG_S, coulomb: 0.15, ..DRIVE };
    let (document, _) = answer(|dir, name, seed| velocity_setpoints(dir, name, seed, drive));
    assert_eq!(names(&document), ["drive.lag1"], "{document:#}");
    let found = parameter(&document, 0, 0);
    assert!((found - LAG_S).abs() < 0.1 * LAG_S, "{found}");
}

/// Most of the change is in one of eight parts of a session.
#[test]
fn friction_that_falls_within_seconds_is_named() {
    const CHANGE_N: f64 = -0.7;
    const TIME_CONSTANT_S: f64 = 4.0;
    let coulomb = |t: f64| COULOMB_N + CHANGE_N * (1.0 - (-t / TIME_CONSTANT_S).exp());
    let machine = Machine { coulomb, ..MACHINE };
    let (document, _) = answer(|dir, name, seed| session(dir, name, seed, reference, machine));
    assert_eq!(names(&document), ["drive.friction.thermal_drift"], "{document:#}");
    let found = parameter(&document, 0, 0);
    assert!((found - CHANGE_N).abs() < 0.1 * CHANGE_N.abs(), "{found}");
}

/// An end stop on both sides of one position is a spring, with two parameters more.
#[test]
fn a_spring_and_a_mass_that_changes_are_named() {
    const SPRING_N_PER_M: f64 = 40.0;
    const SLOPE_KG_PER_M: f64 = 6.0;
    let machine = Machine { force: |q| -SPRING_N_PER_M * q, slope: SLOPE_KG_PER_M, ..MACHINE };
    let (document, _) = answer(|dir, name, seed| session(dir, name, seed, reference, machine));
    let mut found = names(&document);
    found.sort_unstable();
    assert_eq!(found, ["gantry.mass_position", "gantry.stiffness"], "{document:#}");
}

/// An arm that a position controller turns.
#[derive(Clone, Copy)]
struct Arm {
    inertia_kg_m2: f64,
    /// Torque of its weight where it is horizontal.
    weight_n_m: f64,
    /// Friction beyond the dry one at rest, and the speed over which it decays (Gaussian).
    stribeck_n_m: f64,
    stribeck_rad_per_s: f64,
    /// Angle of the reference motion.
    turn_rad_per_m: f64,
}

/// Arm that turns by up to two radians.
const ARM: Arm = Arm {
    inertia_kg_m2: ARM_KG_M2,
    weight_n_m: ARM_N_M,
    stribeck_n_m: 0.0,
    stribeck_rad_per_s: 0.3,
    turn_rad_per_m: 12.0,
};

impl Arm {
    /// The arm with `payload_kg` at [`ARM_M`].
    fn loaded(payload_kg: f64) -> Self {
        Self {
            inertia_kg_m2: ARM.inertia_kg_m2 + payload_kg * ARM_M * ARM_M,
            weight_n_m: ARM.weight_n_m + GRAVITY_M_PER_S2 * ARM_M * payload_kg,
            ..ARM
        }
    }
}

/// A session of an arm.
fn arm(dir: &Path, name: &str, seed: u64, arm: Arm) -> String {
    let (inertia, weight) = (arm.inertia_kg_m2, arm.weight_n_m);
    let mut table = "t_s,torque_nm,angle_deg\n".to_owned();
    let [mut q, mut v] = [0.0_f64; 2];
    for k in 0..SAMPLES {
        let t = SAMPLE_S * k as f64;
        let [target, speed, acceleration] =
            reference(t, seed as f64).map(|own| own * arm.turn_rad_per_m);
        let wanted = acceleration + 200.0 * (target - q) + 25.0 * (speed - v);
        let torque = inertia * wanted + weight * q.sin();
        let angle = (q / ARM_ENCODER_RAD).round() * ARM_ENCODER_RAD;
        writeln!(table, "{t},{torque},{}", angle.to_degrees()).unwrap();
        for _ in 0..STEPS_PER_SAMPLE {
            let free = v + STEP_S / inertia * (torque - weight * q.sin());
            let friction =
                ARM_COULOMB_N_M + arm.stribeck_n_m * (-(v / arm.stribeck_rad_per_s).powi(2)).exp();
            v = free.signum() * (free.abs() - STEP_S / inertia * friction).max(0.0);
            q += STEP_S * v;
        }
    }
    import(dir, name, &table, ["t_s", "torque_nm:Nm", "angle_deg:deg"])
}

#[test]
fn the_weight_of_an_arm_and_its_payload_are_identified() {
    const PAYLOAD_KG: f64 = 0.4;
    const TOLERANCE: f64 = 0.02;
    let dir = tempfile::tempdir().unwrap();
    let out = |name: &str| dir.path().join(name);
    let sessions = pair(|name, seed| arm(dir.path(), name, seed, ARM));
    let (document, _) = gap(&sessions, None, &out("base"));
    assert_eq!(names(&document), ["gantry.gravity"], "{document:#}");
    let sine = parameter(&document, 0, 0);
    assert!((sine - ARM_N_M).abs() < TOLERANCE * ARM_N_M, "{sine} N m");
    let twin = out("base").join("twin.json").display().to_string();
    let loaded = pair(|name, seed| {
        arm(dir.path(), &format!("loaded-{name}"), seed + 2, Arm::loaded(PAYLOAD_KG))
    });
    let hardly_loaded = pair(|name, seed| {
        arm(dir.path(), &format!("hardly-{name}"), seed + 2, Arm::loaded(PAYLOAD_KG / 100.0))
    });
    let (document, _) = gap(&hardly_loaded, Some(&twin), &out("hardly"));
    assert_eq!(document["verdict"], "none", "far below the noise floor: {document:#}");
    let (document, _) = gap(&loaded, Some(&twin), &out("loaded"));
    assert_eq!(document["verdict"], "refit_only", "{document:#}");
    let changes = document["parameter_changes"].as_array().unwrap();
    let after = |name: &str| {
        let own = changes.iter().find(|own| own["name"] == name);
        own.unwrap_or_else(|| panic!("{name}: {changes:?}"))["after"].as_f64().unwrap()
    };
    for (name, truth) in [
        ("gantry.gravity.sine_n", ARM_N_M + GRAVITY_M_PER_S2 * ARM_M * PAYLOAD_KG),
        ("gantry.inertia.mass_kg", ARM_KG_M2 + PAYLOAD_KG * ARM_M * ARM_M),
    ] {
        assert!((after(name) - truth).abs() < TOLERANCE * truth, "{name}: {changes:?}");
    }
}

/// Within a radian, a spring imitates the weight until the Stribeck friction has been added.
#[test]
fn a_spring_that_stood_in_for_the_weight_of_an_arm_is_removed() {
    const TOLERANCE: f64 = 0.1;
    let lying = Arm { weight_n_m: 0.0, turn_rad_per_m: 6.0, ..ARM };
    let upright = Arm { weight_n_m: 1.0, stribeck_n_m: 0.5, ..lying };
    let dir = tempfile::tempdir().unwrap();
    let out = |name: &str| dir.path().join(name);
    let sessions = pair(|name, seed| arm(dir.path(), name, seed, lying));
    let (document, _) = gap(&sessions, None, &out("base"));
    assert!(names(&document).is_empty(), "{document:#}");
    let twin = out("base").join("twin.json").display().to_string();
    let changed = pair(|name, seed| arm(dir.path(), &format!("up-{name}"), seed + 2, upright));
    let (document, _) = gap(&changed, Some(&twin), &out("upright"));
    let journal = document["journal"].as_array().unwrap();
    let moves = |kind: &str, effect: &str| {
        let own = journal.iter().map(|entry| &entry["move"]);
        own.filter(|own| own["kind"] == kind && own["effect"] == effect).count()
    };
    assert_eq!(moves("remove", "gantry.stiffness"), 1, "{journal:#?}");
    let mut found = names(&document);
    found.sort();
    assert_eq!(found, ["drive.friction.stribeck", "gantry.gravity"], "{document:#}");
    let of_effect = |name: &str| {
        let effects = document["effects"].as_array().unwrap();
        parameter(&document, effects.iter().position(|own| own["name"] == name).unwrap(), 0)
    };
    let (weight, stribeck) = (of_effect("gantry.gravity"), of_effect("drive.friction.stribeck"));
    assert!((weight - upright.weight_n_m).abs() < TOLERANCE * upright.weight_n_m, "{weight} N m");
    let relative = stribeck / upright.stribeck_n_m - 1.0;
    assert!(relative.abs() < TOLERANCE, "{stribeck} N m");
}

/// A delay in the given twin is no missing effect of an unchanged axis, and a larger delay is no lag of another kind.
#[test]
fn a_larger_delay_of_a_known_axis_is_a_delay() {
    let dir = tempfile::tempdir().unwrap();
    let session = |name: &str, seed, late_samples| {
        let drive = Drive { late_samples, ..DRIVE };
        velocity_setpoints(dir.path(), name, seed, drive)
    };
    let base = pair(|name, seed| session(name, seed, 1));
    let out = |name: &str| dir.path().join(name);
    gap(&base, None, &out("base"));
    let twin = out("base").join("twin.json").display().to_string();
    let again = pair(|name, seed| session(&format!("again-{name}"), seed + 2, 1));
    let (unchanged, _) = gap(&again, Some(&twin), &out("again"));
    assert_eq!(
        (names(&unchanged), &unchanged["verdict"]),
        (vec![], &"none".into()),
        "{unchanged:#}"
    );
    let late = pair(|name, seed| session(&format!("late-{name}"), seed + 4, 4));
    let (document, _) = gap(&late, Some(&twin), &out("late"));
    let changed = document["parameter_changes"].as_array().unwrap();
    let mut found = names(&document);
    found.extend(changed.iter().map(|own| own["name"].as_str().unwrap()));
    assert!(["drive.delay", "drive.delay.delay_s"].contains(&found[0]), "{document:#}");
    assert_eq!(found.len(), 1, "{document:#}");
}

#[test]
fn a_velocity_setpoint_of_another_coordinate_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let table = (0..400).fold("t_ms,setpoint_rpm,position_mm\n".to_owned(), |mut table, k| {
        writeln!(table, "{},{},{}", 5 * k, 60.0, k).unwrap();
        table
    });
    let recording =
        import(dir.path(), "one", &table, ["t_ms:ms", "setpoint_rpm:rpm", "position_mm:mm"]);
    let out = dir.path().join("out").display().to_string();
    let (_, errors, status) = said(&klasktron(&["gap", &recording, "-o", &out]));
    assert_ne!(status, 0);
    assert!(errors.contains("a velocity setpoint in rad/s and a position in m"), "{errors}");
}

#[test]
fn axes_of_different_units_are_different_machines() {
    let dir = tempfile::tempdir().unwrap();
    let slide = held_forces(dir.path(), "slide", 1, |_| 0.0);
    let turning = arm(dir.path(), "arm", 1, ARM);
    let out = dir.path().join("out").display().to_string();
    let (_, errors, status) = said(&klasktron(&["gap", &slide, &turning, "-o", &out]));
    assert_eq!(status, 1, "{errors}");
    assert!(
        errors.contains("an input in N m and a position in rad") && errors.contains("N and m"),
        "{errors}"
    );
    assert_eq!(errors.trim().lines().count(), 1, "{errors}");
}
