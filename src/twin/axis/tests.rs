use super::*;
use crate::{
    effects::{self, Axis, AxisScales},
    twin::{AxisFrame, Instance, Machine, Source},
};
use std::{cell::Cell, f64::consts::TAU};

const DT: f64 = 1e-3;

fn twin(effects: &[(&str, &[f64])]) -> Twin {
    let instances = effects
        .iter()
        .map(|(name, values)| {
            let effect = effects::find(name).expect("the catalogue has it");
            Instance::new(effect, Axis::Motors, values, Source::Known)
        })
        .collect();
    Twin {
        machine: Machine::Axis,
        striker_mass: 0.0,
        belt_metres_per_turn: 0.04,
        controller_reference_mass: None,
        axis_frame: None,
        instances,
        reference_residuals: Vec::new(),
        discrepancy: Vec::new(),
        measurement_noise: Vec::new(),
        fitted_to: Vec::new(),
    }
}

/// The twin of an axis with a velocity setpoint in m/s.
fn velocity_driven(effects: &[(&str, &[f64])]) -> Twin {
    let scales = AxisScales {
        input: 0.13,
        position: 0.06,
        velocity: 0.13,
        acceleration: 0.9,
        sample_period: DT,
        band: 0.04 / DT,
        duration: 8.0,
        input_unit: "m/s",
        position_unit: "m",
    };
    Twin { axis_frame: Some(AxisFrame { position_origin: 0.0, scales }), ..twin(effects) }
}

/// Amplitude (m) and rate (rad/s) of the tones in the position of [`stage`].
const TONES: [(f64, f64); 2] = [(0.05, 3.0), (0.01, 11.0)];

/// Two slow tones of position; `force` gives the force at a time, position, velocity and
/// acceleration.
fn stage(force: impl Fn(f64, f64, f64, f64) -> f64) -> AxisStage {
    stage_with("N", force)
}

/// As [`stage`], with an input in `unit`.
fn stage_with(unit: &'static str, input_at: impl Fn(f64, f64, f64, f64) -> f64) -> AxisStage {
    let (mut input, mut position) = (Vec::new(), Vec::new());
    for index in 0..8000 {
        let t = f64::from(index) * DT;
        let [mut q, mut v, mut a] = [0.0; 3];
        for (size, rate) in TONES {
            let (sine, cosine) = (rate * t).sin_cos();
            q += size * sine;
            v += size * rate * cosine;
            a -= size * rate * rate * sine;
        }
        input.push(input_at(t, q, v, a));
        position.push(q);
    }
    let measured = Measured { unit, ..slide(input, position) };
    AxisStage::new(measured, &[0.0..4.0, 4.0..8.0])
}

/// A recording of a slide driven by a force (N) at steps of [`DT`].
fn slide(input: Vec<f64>, position: Vec<f64>) -> Measured {
    Measured {
        name: "slide".into(),
        unit: "N",
        position_unit: "m",
        start: 0.0,
        dt: DT,
        input,
        position,
        velocity: None,
    }
}

/// The input that `twin` predicts.
fn predicted(stage: &AxisStage, twin: &Twin) -> Vec<f64> {
    let mut predicted = vec![Vec::new()];
    stage.predict(twin, &[], &mut predicted);
    predicted.remove(0)
}

/// The largest difference of two predictions.
fn largest_difference(one: &[f64], other: &[f64]) -> f64 {
    one.iter().zip(other).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

fn rms(stage: &AxisStage, twin: &Twin) -> f64 {
    rms_inside(0, stage, twin)
}

/// As [`rms`], without the first and last `ends` compared samples.
fn rms_inside(ends: usize, stage: &AxisStage, twin: &Twin) -> f64 {
    let predicted = predicted(stage, twin);
    let channel = &stage.channels()[0];
    assert_eq!(predicted.len(), channel.measured.len());
    let errors: Vec<f64> = channel.measured.iter().zip(&predicted).map(|(a, b)| a - b).collect();
    let inside = errors[ends..errors.len() - ends].iter();
    let squares: Vec<f64> = inside.filter(|e| e.is_finite()).map(|e| e * e).collect();
    assert!(500 < squares.len());
    (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}

#[test]
fn inverse_dynamics_gives_the_input() {
    let stage = stage(|_, _, v, a| 3.0 * a + 8.0 * v + 1.5 * v.signum() - 0.4);
    let right = twin(&[
        ("gantry.inertia", &[3.0]),
        ("drive.friction.viscous", &[8.0]),
        ("drive.friction.coulomb", &[1.5]),
        ("drive.offset", &[0.4]),
    ]);
    // The input has the sign of each moment, and the prediction the mean sign of a sample.
    const SAMPLED_SIGN: f64 = 0.02;
    assert!(rms(&stage, &right) < SAMPLED_SIGN, "{}", rms(&stage, &right));
    let runs = &stage.channels()[0].runs;
    assert_eq!(runs.len(), 2);
    assert_eq!(runs[0].end, runs[1].start);
}

/// A delay or lag in the twin means that the input came before the motion shows it.
#[test]
fn delays_and_lags_are_undone() {
    let stage = stage(|_, _, _, a| 3.0 * a);
    let mass: (&str, &[f64]) = ("gantry.inertia", &[3.0]);
    let predict = |twin: &Twin| predicted(&stage, twin);
    let plain = predict(&twin(&[mass]));
    for name in ["drive.delay", "drive.lag1", "drive.current_loop"] {
        let (value, step) = (0.0005, 10.0 * DT);
        let changed = predict(&twin(&[mass, (name, &[value])]));
        for k in 20..plain.len() - 20 {
            let ahead = plain[k] + value / step * 0.5 * (plain[k + 1] - plain[k - 1]);
            assert!((changed[k] - ahead).abs() < 0.01, "{name} {} {ahead}", changed[k]);
        }
    }
    let late = predict(&twin(&[mass, ("drive.delay", &[0.02])]));
    for k in 20..plain.len() - 20 {
        assert!((late[k] - plain[k + 2]).abs() < 0.01);
    }
}

/// All dry friction acts through contacts of one stiffness, in metres: z' = v - |v| z k/level, friction k z (Dahl model). Its
/// level grows with the drive force.
#[test]
fn contacts_carry_the_friction_that_the_load_adds() {
    const MASS: f64 = 3.0;
    const COULOMB: f64 = 1.5;
    const OF_LOAD: f64 = 0.3;
    const STIFFNESS: f64 = 750.0;
    const SUBSTEPS: u32 = 20;
    let (deflection, load) = (Cell::new(0.0_f64), Cell::new(0.0_f64));
    let stage = stage(|_, _, v, a| {
        let step = DT / f64::from(SUBSTEPS);
        let level = COULOMB + OF_LOAD * load.get().abs();
        for left in (0..SUBSTEPS).rev() {
            let velocity = v - a * step * f64::from(left);
            let shortened = 1.0 + step * velocity.abs() * STIFFNESS / level;
            deflection.set((deflection.get() + step * velocity) / shortened);
        }
        load.set(MASS * a + STIFFNESS * deflection.get());
        load.get()
    });
    let rigid = [
        ("gantry.inertia", &[MASS][..]),
        ("drive.friction.coulomb", &[COULOMB]),
        ("drive.friction.load", &[OF_LOAD]),
    ];
    let contacts = &[COULOMB, COULOMB / STIFFNESS, 1e-5, 0.0][..];
    let elastic = [&rigid[..], &[("drive.friction.presliding", contacts)]].concat();
    let [without, with] = [rms(&stage, &twin(&rigid)), rms(&stage, &twin(&elastic))];
    assert!(with < 0.01 * COULOMB && 0.1 * COULOMB < without, "{with} N, {without} N");
}

/// Friction that differs between the directions by a constant is a force: neither reversals nor
/// contacts distinguish it from an offset.
#[test]
fn a_constant_difference_of_friction_is_an_offset() {
    const DIFFERENCE: f64 = 2.0;
    const TOLERANCE: f64 = 1e-9;
    let stage = stage(|_, _, v, a| 3.0 * a + 1.5 * v.signum() + 0.5 * DIFFERENCE);
    let with = |own: (&str, &[f64])| {
        let contacts = ("drive.friction.presliding", &[1.0, 1e-3, 1e-5, 0.0][..]);
        let rigid = [("gantry.inertia", &[3.0][..]), ("drive.friction.coulomb", &[1.5])];
        predicted(&stage, &twin(&[&rigid[..], &[contacts, own]].concat()))
    };
    let asymmetric = with(("drive.friction.asymmetric", &[0.0, DIFFERENCE]));
    let offset = with(("drive.offset", &[-0.5 * DIFFERENCE]));
    assert!(largest_difference(&asymmetric, &offset) < TOLERANCE);
}

#[test]
fn a_limit_does_not_hide_what_was_commanded_beyond_it() {
    let stage = stage(|_, _, _, a| 3.0 * a);
    let limited = twin(&[
        ("gantry.inertia", &[3.0]),
        ("drive.saturation.torque_speed", &[100.0, 100.0]),
        ("drive.input_deadband", &[0.0, 0.0]),
    ]);
    assert!(rms(&stage, &limited) < 0.01);
}

/// The offset of the base model acts behind a limit or a dead band that was added later, as a constant load does.
#[test]
fn an_offset_is_a_constant_force_behind_limits_and_dead_bands() {
    const FORCE: f64 = 0.7;
    const TOLERANCE: f64 = 1e-9;
    let stage = stage(|_, _, v, a| 3.0 * a + 0.5 * v.signum() - FORCE);
    for (name, values) in
        [("drive.saturation.speed", &[2.0][..]), ("drive.input_deadband", &[0.5, 1.0])]
    {
        let with = |constant: (&str, &[f64])| {
            let rigid = [("gantry.inertia", &[3.0][..]), ("drive.friction.coulomb", &[0.5])];
            predicted(&stage, &twin(&[&rigid[..], &[constant, (name, values)]].concat()))
        };
        let offset = with(("drive.offset", &[FORCE]));
        let tilt = with(("gantry.tilt", &[FORCE]));
        assert!(largest_difference(&offset, &tilt) < TOLERANCE, "{name}");
    }
}

/// An axis without mass behind a limit of nearly zero predicts no force at all.
#[test]
fn a_low_limit_does_not_explain_every_input() {
    const FORCE_N_PER_M: f64 = 400.0;
    let stage = stage(|_, q, _, a| 3.0 * a + FORCE_N_PER_M * q);
    let nothing =
        |limit: f64| twin(&[("gantry.inertia", &[limit]), ("drive.saturation.speed", &[limit])]);
    let rigid = rms(&stage, &twin(&[("gantry.inertia", &[3.0])]));
    for limit in [1e-1, 1e-2, 1e-3] {
        let left = rms(&stage, &nothing(limit));
        assert!(0.5 * rigid < left, "{limit} {left} {rigid}");
    }
    let right = twin(&[
        ("gantry.inertia", &[3.0]),
        ("gantry.stiffness", &[FORCE_N_PER_M]),
        ("drive.saturation.speed", &[100.0]),
    ]);
    assert!(rms(&stage, &right) < 0.05);
}

#[test]
fn free_run_follows_its_own_input() {
    let stage = stage(|_, _, v, a| 3.0 * a + 8.0 * v);
    let right = twin(&[("gantry.inertia", &[3.0]), ("drive.friction.viscous", &[8.0])]);
    let run = stage.free_run(&right, 1.5).expect("five windows");
    assert_eq!(run.windows, 5);
    assert!(run.position_rms < 2e-4, "{run:?}");
    let heavy = twin(&[("gantry.inertia", &[4.0]), ("drive.friction.viscous", &[8.0])]);
    assert!(1e-3 < stage.free_run(&heavy, 1.5).expect("five windows").position_rms);
}

/// Tolerance of a setpoint (m/s), at a velocity of 0.13 m/s RMS.
const SETPOINT_TOLERANCE: f64 = 3e-4;

#[test]
fn a_velocity_setpoint_passes_gain_and_controller() {
    const COULOMB: f64 = 0.02;
    let stage = stage_with("m/s", |_, _, v, a| (v + 0.03 * a + COULOMB * v.signum() + 0.005) / 0.9);
    assert_eq!(stage.channels()[0].signal, "axis.slide.setpoint");
    let of = |time_constant: f64| {
        velocity_driven(&[
            ("drive.gain", &[0.9]),
            ("drive.friction.coulomb", &[COULOMB]),
            ("drive.offset", &[-0.005]),
            ("drive.velocity_controller", &[time_constant, 0.0]),
        ])
    };
    assert!(rms(&stage, &of(0.03)) < 5.0 * SETPOINT_TOLERANCE, "{}", rms(&stage, &of(0.03)));
    assert!(20.0 * SETPOINT_TOLERANCE < rms(&stage, &of(0.0)));
}

#[test]
fn a_free_run_follows_its_velocity_setpoint() {
    let stage = stage_with("m/s", |_, _, v, a| (v + 0.03 * a) / 0.9);
    let of = |time_constant: f64| {
        let controller: [f64; 2] = [time_constant, 0.0];
        velocity_driven(&[("drive.gain", &[0.9]), ("drive.velocity_controller", &controller)])
    };
    let error = |time_constant: f64| {
        stage.free_run(&of(time_constant), 1.5).expect("five windows").position_rms
    };
    assert!(error(0.03) < 1e-4 && 1e-3 < error(0.0), "{} and {}", error(0.03), error(0.0));
}

/// With the time constant T and the integral rate i, the setpoint of a tone of the velocity v is
/// (1 + T s^2 / (s + i)) v. The controller is enabled at the start, so that the error begins at zero.
#[test]
fn a_setpoint_passes_the_integral_action_of_its_controller() {
    const TIME_CONSTANT: f64 = 0.05;
    const RATE: f64 = 20.0;
    let stage = stage_with("m/s", |t, _, _, _| {
        let setpoint = |(size, rate): &(f64, f64)| {
            let part = TIME_CONSTANT * rate.powi(2) / (RATE.powi(2) + rate.powi(2));
            let (sine, cosine) = (rate * t).sin_cos();
            let since_start = part * RATE * (-RATE * t).exp();
            size * rate * ((1.0 - part * RATE) * cosine - part * rate * sine + since_start)
        };
        TONES.iter().map(setpoint).sum()
    });
    let of = |rate: f64| velocity_driven(&[("drive.velocity_controller", &[TIME_CONSTANT, rate])]);
    assert!(rms(&stage, &of(RATE)) < SETPOINT_TOLERANCE, "{}", rms(&stage, &of(RATE)));
    assert!(10.0 * SETPOINT_TOLERANCE < rms(&stage, &of(0.0)));
    let run = stage.free_run(&of(RATE), 1.5).expect("five windows");
    assert!(run.position_rms < 2e-3, "{run:?}");
}

/// An integral action slower than the recording has no effect, for any friction at the start.
#[test]
fn a_setpoint_hardly_passes_a_slow_integral_action() {
    let stage = stage_with("m/s", |_, _, v, a| v + 0.03 * a + 0.02 * v.signum());
    let of = |rate: f64| {
        let controller: [f64; 2] = [0.03, rate];
        velocity_driven(&[
            ("drive.velocity_controller", &controller),
            ("drive.friction.coulomb", &[0.02]),
        ])
    };
    let [none, slow] = [0.0, 1e-5].map(|rate| predicted(&stage, &of(rate)));
    assert!(largest_difference(&none, &slow) < SETPOINT_TOLERANCE);
}

/// Typical sizes of the axis of [`stage`].
const SLIDE: AxisScales = AxisScales {
    input: 5.0,
    position: 0.06,
    velocity: 0.13,
    acceleration: 0.9,
    sample_period: DT,
    band: 0.04 / DT,
    duration: 8.0,
    input_unit: "N",
    position_unit: "m",
};

/// A mass of 3 kg with the form of `drive.compliance.belt` that has as many parameters as `values`.
fn elastic(values: &[f64]) -> Twin {
    let belt = effects::find("drive.compliance.belt").expect("the catalogue has it");
    let mut forms = belt.forms_on_axis().into_iter();
    let form = forms.find(|form| form.parameters.len() == values.len()).expect("such a form");
    let mut twin = twin(&[("gantry.inertia", &[3.0])]);
    let form = form.on_axis(&SLIDE);
    twin.instances.push(Instance::new(form, Axis::Motors, values, Source::Known));
    twin.axis_frame = Some(AxisFrame { position_origin: 0.0, scales: SLIDE });
    twin
}

/// The force for the tones of [`stage`], whose transfer from acceleration at `rate` (rad/s) is `(in phase, ahead)`.
fn stage_with_transfer(transfer: impl Fn(f64) -> (f64, f64)) -> AxisStage {
    stage_with_transfer_and(|_| 0.0, transfer)
}

/// The same with a further force over time.
fn stage_with_transfer_and(
    further: impl Fn(f64) -> f64,
    transfer: impl Fn(f64) -> (f64, f64),
) -> AxisStage {
    stage(|t, _, _, _| {
        let force = |(size, rate): &(f64, f64)| {
            let ((sine, cosine), (in_phase, ahead)) = ((rate * t).sin_cos(), transfer(*rate));
            -size * rate * rate * (in_phase * sine + ahead * cosine)
        };
        TONES.iter().map(force).sum::<f64>() + further(t)
    })
}

/// Transfer of a mass of 3 kg, of which a `fraction` is a load of angular frequency `omega` (rad/s) behind the motor.
fn load_transfer(fraction: f64, omega: f64, damping: f64) -> impl Fn(f64) -> (f64, f64) {
    move |rate| {
        let (stiff, damped) = (omega * omega - rate * rate, 2.0 * damping * omega * rate);
        let square = stiff * stiff + damped * damped;
        let in_phase = (omega * omega * stiff + damped * damped) / square;
        let ahead = (damped * stiff - omega * omega * damped) / square;
        (3.0 * (1.0 - fraction + fraction * in_phase), 3.0 * fraction * ahead)
    }
}

/// Residual (N) of the correct twin of an elastic axis, less than a hundredth of its force.
const ELASTIC_TOLERANCE: f64 = 0.02;

/// With a measured motor, the acceleration of the load is `(w^2 + 2 i z w s) / (w^2 - s^2 + 2 i z w
/// s)` times that of the motor at the rate s.
#[test]
fn a_load_on_a_belt_oscillates_against_the_measured_motor() {
    const OMEGA: f64 = 20.0;
    const DAMPING: f64 = 0.3;
    // Within 1 s, the initial transient of the load decays to a four-hundredth.
    const START: usize = 100;
    const FRACTION: f64 = 0.7;
    let stage = stage_with_transfer(load_transfer(FRACTION, OMEGA, DAMPING));
    let of = |fraction: f64| elastic(&[fraction, OMEGA / TAU, DAMPING]);
    let [right, half, rigid] =
        [FRACTION, 0.5 * FRACTION, 0.0].map(|own| rms_inside(START, &stage, &of(own)));
    assert!(right < ELASTIC_TOLERANCE, "{right} N");
    assert!(10.0 * ELASTIC_TOLERANCE < half && half < rigid, "{half} N, {rigid} N");
}

/// A free oscillation of the load, which the recording does not show from its beginning, adds a decaying force.
#[test]
fn a_recording_may_begin_while_the_load_swings() {
    const OMEGA: f64 = 20.0;
    const DAMPING: f64 = 0.05;
    const FRACTION: f64 = 0.7;
    let swing = |t: f64| 4.0 * (-DAMPING * OMEGA * t).exp() * (OMEGA * t + 0.7).cos();
    let stage = stage_with_transfer_and(swing, load_transfer(FRACTION, OMEGA, DAMPING));
    let error = rms_inside(20, &stage, &elastic(&[FRACTION, OMEGA / TAU, DAMPING]));
    assert!(error < 2.0 * ELASTIC_TOLERANCE, "{error} N");
}

/// With a measured load, the force of the motor is `1 + 2 i z p s - p^2 s^2` times that on the load
/// at the rate s.
#[test]
fn the_motor_oscillates_against_the_measured_load() {
    const PERIOD: f64 = 0.3;
    const DAMPING: f64 = 0.1;
    let stage = stage_with_transfer(|rate| {
        let turn = PERIOD / TAU * rate;
        (3.0 * (1.0 - turn * turn), 3.0 * 2.0 * DAMPING * turn)
    });
    let of = |period: f64| elastic(&[period, DAMPING]);
    // At the ends the filters know one side only.
    let [right, rigid] = [PERIOD, 0.0].map(|period| rms_inside(20, &stage, &of(period)));
    assert!(right < ELASTIC_TOLERANCE && 10.0 * right < rigid, "{right} N, {rigid} N");
}

/// Consistency of the two directions, not a test against independent truth.
#[test]
fn a_free_run_of_an_elastic_axis_agrees_with_its_inverse_dynamics() {
    let force =
        |t: f64| (1.0 - (-t).exp()) * (4.0 * (7.0 * t).sin() + 2.0 * (17.0 * t + 1.0).sin());
    let input: Vec<f64> = (0..8000).map(|index| force(DT * f64::from(index))).collect();
    for twin in [elastic(&[0.7, 3.0, 0.05]), elastic(&[0.2, 0.1])] {
        let states = respond(&twin, (0.0, DT), &input, [0.0; 2]);
        let positions = states.iter().map(|state| state[0]).collect();
        let measured = slide(input.clone(), positions);
        let error = rms_inside(20, &AxisStage::new(measured, &[0.0..8.0]), &twin);
        assert!(error < ELASTIC_TOLERANCE, "{error} N");
    }
}

/// The part of a voltage against the back-EMF makes no force, so it loads nothing.
#[test]
fn friction_by_load_knows_the_back_emf() {
    const TOLERANCE_V: f64 = 0.01;
    let (inertia, back_emf, coulomb, fraction) = (0.4, 2.0, 0.3, 0.25);
    let parts = [
        ("gantry.inertia", &[inertia][..]),
        ("drive.friction.viscous", &[back_emf]),
        ("drive.friction.coulomb", &[coulomb]),
        ("drive.friction.load", &[fraction]),
    ];
    let input = |_: f64, _: f64, v: f64, a: f64| {
        // The force of the motor is M a + (F_c + K |force|) sign(v).
        let direction = v.signum();
        let free = inertia * a + coulomb * direction;
        let force =
            if 0.0 < free * direction { free / (1.0 - fraction) } else { free / (1.0 + fraction) };
        force + back_emf * v
    };
    let scales = AxisScales { input_unit: "V", ..SLIDE };
    let driven = |unit: &'static str| Twin {
        axis_frame: Some(AxisFrame {
            position_origin: 0.0,
            scales: AxisScales { input_unit: unit, ..scales },
        }),
        ..twin(&parts)
    };
    let recorded = stage_with("V", input);
    let [voltage, force] = ["V", "N"].map(|unit| rms(&recorded, &driven(unit)));
    assert!(voltage < TOLERANCE_V && 10.0 * voltage < force, "{voltage} V, as a force {force}");
}

/// The residual of the correct twin is the noise of the position, propagated to its prediction.
#[test]
fn noise_of_the_position_is_propagated_to_the_input() {
    const NOISE: f64 = 2e-6;
    let mut noise = crate::seed::Stream::new(1, "test");
    let (mut input, mut position) = (Vec::new(), Vec::new());
    for index in 0..16_000 {
        let t = DT * f64::from(index);
        input.push(-3.0 * 0.05 * 9.0 * (3.0 * t).sin());
        let error = 3.0_f64.sqrt() * f64::from(noise.uniform_f32(-1.0, 1.0));
        position.push(0.05 * (3.0 * t).sin() + NOISE * error);
    }
    let stage = AxisStage::new(slide(input, position), &[0.0..16.0]);
    let right = twin(&[("gantry.inertia", &[3.0])]);
    let (residual, propagated) = (rms(&stage, &right), stage.noise(&right)[0]);
    assert!((propagated / residual - 1.0).abs() < 0.15, "{propagated} of {residual} N");
}

#[test]
fn a_shift_reads_ahead() {
    let line: Vec<f64> = (0..20).map(f64::from).collect();
    let ahead = shifted(&line, 1.25);
    assert!((ahead[5] - 6.25).abs() < 1e-12);
    assert!((shifted(&line, -0.5)[5] - 4.5).abs() < 1e-12);
}

#[test]
fn a_position_that_restarts_at_a_run_is_no_acceleration() {
    let at = |index: usize| {
        let t = DT * index as f64;
        (0.05 * (3.0 * t).sin(), -0.45 * (3.0 * t).sin())
    };
    let restarted = |index: usize| if index < 4000 { 0.0 } else { 0.7 };
    let input = (0..8000).map(|index| 3.0 * at(index).1).collect();
    let measured = slide(input, (0..8000).map(|index| at(index).0 + restarted(index)).collect());
    let stage = AxisStage::in_segments(measured, vec![0..4000, 4000..8000], &[0.0..4.0, 4.0..8.0]);
    let right = twin(&[("gantry.inertia", &[3.0])]);
    assert!(rms(&stage, &right) < 0.01, "{}", rms(&stage, &right));
    let [within, square] = stage.input_variation();
    assert!(0.9 * square < within, "{within} {square}");
    assert!(stage.motion_and_input().len() > 500);
}

/// Number of moving samples of a sine of `frequency` (Hz), sampled at 60 Hz for 20 s.
fn moving_samples_at_60_hz(frequency: f64) -> usize {
    let position = |k: usize| 0.3 * (TAU * frequency * k as f64 / 60.0).sin();
    let input = (0..1200).map(|k| -position(k)).collect();
    let measured = Measured { dt: 1.0 / 60.0, ..slide(input, (0..1200).map(position).collect()) };
    let stage = AxisStage::new(measured, &[0.0..20.0]);
    stage.signals.resting.iter().filter(|rests| !**rests).count()
}

#[test]
fn slow_samples_of_a_motion_are_no_rest() {
    let moving = moving_samples_at_60_hz(3.0);
    assert!(moving > 100, "{moving}");
}

#[test]
fn slow_samples_of_a_fast_motion_are_no_rest() {
    let moving = moving_samples_at_60_hz(8.0);
    assert!(moving > 100, "{moving}");
}
