use super::*;
use crate::gantry::{Limits, Rectangle, Robot};
use crate::recording::topic::Player;
use proptest::prelude::*;
use std::f64::consts::TAU;

const RATE: f64 = 50.0;

fn workspace() -> Rectangle {
    Robot::default().soft_limits(Player::Left).shrunk(0.01)
}

fn driven(text: &str, samples: usize) -> Reference {
    let pattern: Pattern = text.parse().unwrap();
    let sampling = Sampling { rate_hz: RATE, samples, seed: 3 };
    pattern.reference(&workspace(), &Limits::default(), &sampling).unwrap()
}

fn refused(text: &str) -> TrajectoryError {
    let pattern: Pattern = text.parse().unwrap();
    let sampling = Sampling { rate_hz: RATE, samples: 500, seed: 3 };
    pattern.reference(&workspace(), &Limits::default(), &sampling).unwrap_err()
}

fn velocities(reference: &Reference, axis: usize) -> Vec<f64> {
    reference.setpoints().iter().map(|setpoint| setpoint.velocity[axis]).collect()
}

/// Return the amplitude of the line at `turns` turns within `values`.
fn line(values: &[f64], turns: usize) -> f64 {
    let count = values.len() as f64;
    let (mut re, mut im) = (0.0, 0.0);
    for (k, value) in values.iter().enumerate() {
        let (sin, cos) = (TAU * (k * turns) as f64 / count).sin_cos();
        re += value * cos;
        im -= value * sin;
    }
    2.0 * re.hypot(im) / count
}

#[test]
fn all_start_and_end_at_rest_and_are_as_long_as_was_asked() {
    for pattern in Pattern::ALL {
        for samples in [10, 333, 750] {
            let run = driven(&pattern.to_string(), samples);
            let points = run.setpoints();
            assert_eq!(points.len(), samples);
            assert_eq!([points[0].velocity, points[samples - 1].velocity], [[0.0; 2]; 2]);
        }
        assert!(pattern.purpose().ends_with('.') && 20 < pattern.purpose().len());
    }
}

#[test]
fn positions_are_the_exact_integral_of_the_velocities() {
    for pattern in Pattern::ALL {
        let run = driven(&pattern.to_string(), 500);
        for pair in run.setpoints().windows(2) {
            for axis in 0..2 {
                let next = pair[0].position[axis] + pair[0].velocity[axis] / RATE;
                assert_eq!(pair[1].position[axis], next);
            }
        }
    }
}

#[test]
fn a_circle_stays_on_its_circle_at_its_speed() {
    for turn in ["ccw", "cw"] {
        let run = driven(&format!("circle:radius_m=0.04,speed_m_per_s=0.5,direction={turn}"), 500);
        let [x, y] = workspace().centre();
        for setpoint in run.setpoints() {
            let radius = (setpoint.position[0] - x).hypot(setpoint.position[1] - y);
            assert!((radius - 0.04).abs() < 1e-6, "{radius}");
        }
        // The chord of an arc of 0.5 m/s * 20 ms on this circle.
        let chord = 2.0 * 0.04 * (0.5 * 0.02 / 0.08_f64).sin() / 0.02;
        let [vx, vy] = run.setpoints()[250].velocity;
        assert!((vx.hypot(vy) - chord).abs() < 1e-6);
        let arm = run.setpoints()[250].position;
        let sense = (arm[0] - x) * vy - (arm[1] - y) * vx;
        assert_eq!(0.0 < sense, turn == "ccw");
    }
}

#[test]
fn a_ramp_has_its_rate_and_a_line_its_speed() {
    let run = driven("ramp:direction=x,length_m=0.15,speed_m_per_s=0.4,rate_m_per_s2=1.5", 700);
    let v = velocities(&run, 0);
    // Below the top speed, and before the end of the run, every step is the rate.
    let ramping = v[..690].windows(2).filter(|pair| pair.iter().all(|v| v.abs() < 0.3999));
    let slopes: Vec<f64> = ramping.map(|pair| (pair[1] - pair[0]).abs() * RATE).collect();
    assert!(500 < slopes.len() && slopes.iter().all(|slope| (slope - 1.5).abs() < 1e-9));
    assert!((v.iter().fold(0.0_f64, |top, v| top.max(*v)) - 0.4).abs() < 1e-12);
    assert!((v.iter().fold(0.0_f64, |top, v| top.min(*v)) + 0.4).abs() < 1e-12);

    let run = driven("diagonal:direction=down,length_m=0.12,speed_m_per_s=0.3", 500);
    assert!(run.setpoints().iter().all(|s| (s.velocity[0] + s.velocity[1]).abs() < 1e-12));
    let path = |s: &Setpoint| s.position[0];
    let (low, high) = run
        .setpoints()
        .iter()
        .map(path)
        .fold((9.0_f64, -9.0_f64), |(l, h), x| (l.min(x), h.max(x)));
    let length = (high - low) * 2.0_f64.sqrt();
    assert!(0.12 - 0.3 / RATE < length && length <= 0.12 + 1e-9, "{length}");
}

#[test]
fn creep_passes_zero_slowly_and_evenly() {
    let run = driven("creep:direction=y,speed_m_per_s=0.02,period_s=8", 800);
    let v = velocities(&run, 1);
    let rate = 4.0 * 0.02 / 8.0;
    let steps: Vec<f64> = v.windows(2).map(|pair| (pair[1] - pair[0]).abs() * RATE).collect();
    // The run ends with a stop; before, every step is the rate, except at the rounded peaks.
    assert!(steps[..790].iter().all(|step| *step <= rate * (1.0 + 1e-9)));
    let crossings = v[1..790].windows(2).filter(|p| p[0] * p[1] < 0.0 || p[1] == 0.0).count();
    assert_eq!(crossings, 3);
    let slow = v.iter().filter(|v| v.abs() < 0.005).count();
    assert!(150 < slow, "{slow}");
}

#[test]
fn a_chirp_has_the_frequency_it_should_have_at_each_time() {
    let run = driven("chirp:direction=x,f0_hz=0.5,f1_hz=5,speed_m_per_s=0.1,period_s=20", 1000);
    let v = velocities(&run, 0);
    // Times of upward zero crossings by linear interpolation.
    let upward: Vec<f64> = (1..v.len() - 10)
        .filter(|k| v[*k - 1] < 0.0 && 0.0 <= v[*k])
        .map(|k| (k as f64 - v[k] / (v[k] - v[k - 1])) / RATE)
        .collect();
    let frequency = |t: f64| {
        let rise = if t < 10.0 { t / 10.0 } else { (20.0 - t) / 10.0 };
        0.5 * 10.0_f64.powf(rise)
    };
    assert!(30 < upward.len());
    for pair in upward.windows(2) {
        let (seen, middle) = (1.0 / (pair[1] - pair[0]), f64::midpoint(pair[0], pair[1]));
        let expected = frequency(middle);
        // A period averages the frequency over itself; near the top the sweep reverses.
        assert!((seen / expected - 1.0).abs() < 0.06, "{seen} Hz for {expected} Hz at {middle} s");
    }
}

#[test]
fn a_multisine_has_power_at_its_lines_only_and_each_axis_its_own() {
    let text = "multisine:lines=5,f0_hz=0.4,f1_hz=6,speed_m_per_s=0.2,period_s=5";
    let run = driven(text, 800);
    let all = waves::harmonics(5, [0.4, 6.0], 5.0).unwrap();
    assert_eq!((all[0], all[9]), (2, 30));
    for axis in 0..2 {
        let v = velocities(&run, axis)[250..500].to_vec();
        let own: Vec<usize> = all.iter().copied().skip(axis).step_by(2).collect();
        let amplitude = line(&v, own[0]);
        for turns in 0..125 {
            let found = line(&v, turns);
            if own.contains(&turns) {
                assert!((found / amplitude - 1.0).abs() < 1e-9, "{turns}: {found}");
            } else {
                assert!(found < 1e-12, "{turns}: {found}");
            }
        }
        let peak = v.iter().fold(0.0_f64, |peak, v| peak.max(v.abs()));
        let rms = (v.iter().map(|v| v * v).sum::<f64>() / 250.0).sqrt();
        assert!((peak - 0.2).abs() < 1e-12);
        // All in phase it would be 3.16.
        assert!(peak / rms < 2.2, "crest {}", peak / rms);
    }
}

#[test]
fn a_random_walk_covers_the_window_and_drifts_nowhere() {
    let run = driven("random_walk:speed_m_per_s=0.7", 5000);
    let (workspace, points) = (workspace(), run.setpoints());
    for axis in 0..2 {
        let v = velocities(&run, axis);
        let mean = v.iter().sum::<f64>() / v.len() as f64;
        let top = v.iter().fold(0.0_f64, |top, v| top.max(v.abs()));
        assert!(mean.abs() < 0.002, "{mean}");
        assert!(0.65 < top && top <= 0.7, "{top}");
        let place = |s: &Setpoint| s.position[axis];
        let span =
            [[workspace.x_min_m, workspace.x_max_m], [workspace.y_min_m, workspace.y_max_m]][axis];
        let low = points.iter().map(place).fold(f64::INFINITY, f64::min);
        let high = points.iter().map(place).fold(f64::NEG_INFINITY, f64::max);
        assert!(0.85 * (span[1] - span[0]) < high - low, "{low} to {high} of {span:?}");
    }
    assert_eq!(driven("random_walk:speed_m_per_s=0.7", 5000), run);
}

#[test]
fn a_ladder_steps_from_rest_and_comes_back() {
    let text = "step_ladder:direction=x,speed_m_per_s=0.4,levels=4,hold_s=0.2";
    let run = driven(text, 400);
    let v = velocities(&run, 0);
    let levels: Vec<f64> = (0..4).map(|level| v[40 * level + 9]).collect();
    for (index, level) in levels.iter().enumerate() {
        assert!((level - 0.1 * (index + 1) as f64).abs() < 1e-12);
    }
    assert!((v[1] - 0.1).abs() < 1e-12 && (v[121] - 0.2).abs() < 1e-12, "{:?}", &v[..5]);
    let start = run.setpoints()[0].position[0];
    assert!((run.setpoints()[160].position[0] - start).abs() < 1e-9);
}

#[test]
fn what_does_not_fit_is_refused_with_what_does() {
    use TrajectoryError as E;
    let error = refused("circle:radius_m=0.09,speed_m_per_s=0.1");
    let E::TooLarge { key: "radius_m", largest, .. } = error else { panic!("{error}") };
    // Half the workspace is 0.0765 m; at 0.1 m/s the circle needs slightly more than its radius.
    assert!((0.07..0.0765).contains(&largest), "{largest}");
    let error = refused("y_line:length_m=0.15,speed_m_per_s=0.7");
    let E::TooLarge { key: "length_m", largest, .. } = error else { panic!("{error}") };
    assert!((0.06..0.09).contains(&largest), "{largest}");
    let error = refused("x_line:length_m=0.03,speed_m_per_s=0.7");
    assert!(matches!(error, E::TooShort { .. }), "{error}");
    let error = refused("x_line:length_m=0.2,speed_m_per_s=0.8");
    assert!(matches!(error, E::TooFast { largest, .. } if (largest - 0.7).abs() < 1e-3), "{error}");
    let error = refused("circle:radius_m=0.02,speed_m_per_s=0.6");
    assert!(matches!(error, E::TooAbrupt { .. }), "{error}");
    let error = refused("chirp:f1_hz=15,speed_m_per_s=0.3");
    assert!(matches!(error, E::TooAbrupt { key: "speed_m_per_s", .. }), "{error}");
    assert!(matches!(refused("chirp:f1_hz=21"), E::FrequencyTooHigh { .. }));
    assert!(matches!(refused("multisine:lines=40"), E::TooManyLines { .. }));
    assert!(matches!(refused("ramp:rate_m_per_s2=11"), E::TooAbrupt { key: "rate_m_per_s2", .. }));

    let creep: Pattern = "creep:direction=y".parse().unwrap();
    let (limits, grid) = (Limits::default(), Sampling { rate_hz: RATE, samples: 50, seed: 1 });
    let narrow = workspace().shrunk(0.0764);
    let error = creep.reference(&narrow, &limits, &grid).unwrap_err();
    assert!(matches!(error, E::NoRoom { .. } | E::TooLarge { .. }), "{error}");
    let none = workspace().shrunk(0.2);
    assert!(matches!(creep.reference(&none, &limits, &grid).unwrap_err(), E::NoRoom { .. }));
    let slow = Sampling { rate_hz: 5.0, ..grid };
    assert!(matches!(creep.reference(&workspace(), &limits, &slow).unwrap_err(), E::Rate { .. }));
    let short = Sampling { samples: 9, ..grid };
    assert!(matches!(
        creep.reference(&workspace(), &limits, &short).unwrap_err(),
        E::Samples { .. }
    ));
}

#[test]
fn a_transfer_is_straight_gentle_and_arrives() {
    let (from, to) = ([-0.1, -0.15], [0.1, -0.05]);
    let limits = Limits::default();
    let run = Reference::transfer(from, to, &limits, RATE).unwrap();
    let end = run.end().unwrap();
    assert!((end[0] - to[0]).hypot(end[1] - to[1]) < 1e-12);
    let mut before = [0.0; 2];
    for Setpoint { position, velocity } in run.setpoints() {
        let across = (position[0] - from[0]) * 0.1 - (position[1] - from[1]) * 0.2;
        assert!(across.abs() < 1e-12 && velocity[0].hypot(velocity[1]) <= 0.1 + 1e-12);
        let change = (velocity[0] - before[0]).hypot(velocity[1] - before[1]) * RATE;
        assert!(change <= 0.5 + 1e-9, "{change}");
        let stands = limits.standstill(*position, *velocity);
        assert!(stands[0] <= to[0] + TRANSFER_SLACK_M && stands[1] <= to[1] + TRANSFER_SLACK_M);
        before = *velocity;
    }
    assert!(run.duration_s() < 0.2236 / 0.1 + 1.0, "{}", run.duration_s());
    let nowhere = Reference::transfer(from, from, &limits, RATE).unwrap();
    assert_eq!(nowhere.end(), Some(from));
    assert!(Reference::transfer(from, [f64::NAN, 0.0], &limits, RATE).is_err());
}

#[test]
fn texts_are_read_with_defaults_and_wrong_ones_tell_what_is_allowed() {
    let parse = |text: &str| text.parse::<Pattern>();
    assert_eq!(parse("circle"), Ok(Pattern::ALL[0]));
    assert_eq!(
        parse(" creep : direction = y "),
        Ok(Pattern::Creep { heading: Heading::Y, speed_m_per_s: 0.03, period_s: 5.0 })
    );
    let said = |text: &str| parse(text).unwrap_err().to_string();
    assert!(said("zigzag").contains("'zigzag' is no pattern; choose one of circle, diagonal"));
    assert!(said("circle:radius=1").contains("it has radius_m, speed_m_per_s, direction"));
    assert!(said("circle:radius_m=5").contains("radius_m is '5'; it must be in [0.001, 1] m"));
    assert!(
        said("circle:radius_m=NaN").contains("'NaN'") && said("circle:radius_m").contains("''")
    );
    assert!(said("multisine:lines=0").contains("a whole number in [1, 50]"));
    assert!(said("diagonal:direction=left").contains("one of up, down"));
    assert!(said("creep:period_s=1,period_s=2").contains("given twice"));
    assert!(said("chirp:f0_hz=3,f1_hz=2").contains("f0_hz must be smaller"));
}

#[test]
fn patterns_are_strings_in_json() {
    let text = serde_json::to_string(&Pattern::ALL[2]).unwrap();
    assert_eq!(text, "\"x_line:length_m=0.16,speed_m_per_s=0.4\"");
    assert_eq!(serde_json::from_str::<Pattern>(&text).unwrap(), Pattern::ALL[2]);
    assert!(serde_json::from_str::<Pattern>("\"x_line:length=1\"").is_err());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]

    #[test]
    fn texts_survive_the_round_trip(
        kind in 0..10_usize,
        shares in prop::collection::vec(0.0..1.0_f64, 6),
    ) {
        let mut pattern = Pattern::ALL[kind];
        for ((_, field), fraction) in pattern.fields().into_iter().zip(&shares) {
            match field {
                text::Field::Number { value, low, high, .. } => *value = low + (high - low) * fraction,
                text::Field::Count { value, high } => *value = 1 + (f64::from(high - 1) * fraction) as u32,
                text::Field::Heading(value) => *value = Heading::ALL[(fraction * 4.0) as usize],
                text::Field::Slope(value) => *value = if *fraction < 0.5 { Slope::Up } else { Slope::Down },
                text::Field::Turn(value) => {
                    *value = if *fraction < 0.5 { Turn::Clockwise } else { Turn::Counterclockwise };
                }
            }
        }
        if pattern.check().is_ok() {
            prop_assert_eq!(pattern.to_string().parse::<Pattern>().unwrap(), pattern);
        }
    }

    #[test]
    fn any_text_is_read_or_refused(text in "(circle|ramp|creep|x)?:?[a-z_0-9=,. -]{0,40}") {
        if let Ok(pattern) = text.parse::<Pattern>() {
            prop_assert_eq!(pattern.to_string().parse::<Pattern>().unwrap(), pattern);
        }
    }
}
