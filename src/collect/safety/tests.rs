use super::*;
use crate::{
    collect::Schedule,
    gantry::{Heading, Pattern, Slope, Turn},
    recording::Split,
};
use proptest::prelude::*;

fn plan_of(pattern: Pattern) -> Plan {
    let run = PlannedRun { number: 1, pattern, split: Split::Train, samples: 400 };
    Plan { name: "test".to_owned(), rate_hz: 50.0, seed: 5, runs: vec![run] }
}

fn check_both(plan: &Plan) -> Result<CheckedPlan, PlanError> {
    check_plan(plan, &Robot::default(), &Player::BOTH)
}

#[test]
fn the_papers_plan_is_safe_for_both_players() {
    let plan = Plan::paper(50.0, 1).unwrap();
    let checked = check_both(&plan).unwrap();
    let extremes = checked.extremes();
    let [x, y] = extremes.max_axis_speed_m_per_s;
    assert!((0.69..=0.7 + 1e-9).contains(&x) && (0.69..=0.7 + 1e-9).contains(&y), "{extremes:?}");
    assert!(0.01 <= extremes.edge_distance_m, "{extremes:?}");
}

#[test]
fn every_default_pattern_is_safe() {
    for pattern in Pattern::ALL {
        if let Err(error) = check_both(&plan_of(pattern)) {
            panic!("{pattern}: {error}");
        }
    }
}

#[test]
fn both_players_do_the_same_turned_by_half_a_turn() {
    let checked = check_both(&plan_of(Pattern::ALL[5])).unwrap();
    let run = &checked.runs()[0];
    let [left, right] = [0, 1].map(|player| run.references()[player].setpoints());
    assert_eq!(left.len(), right.len());
    for (left, right) in left.iter().zip(right) {
        assert_eq!(left.velocity, right.velocity.map(|part| 0.0 - part));
    }
    let [left, right] = [0, 1].map(|player| run.approach()[player].setpoints().len());
    assert_eq!(left, right);
}

#[test]
fn motions_follow_each_other_without_a_jump_and_end_at_home() {
    let patterns = Pattern::ALL;
    let schedule = Schedule { repeat: 1, seconds: 4.0, ..Schedule::default() };
    let plan = Plan::from_patterns(&patterns, &schedule).unwrap();
    let checked = check_both(&plan).unwrap();
    for (index, home) in [[0.0, -0.1], [0.0, 0.1]].into_iter().enumerate() {
        let runs = checked.runs().iter();
        let motions = runs.flat_map(|run| [&run.approach()[index], &run.references()[index]]);
        let mut place = home;
        for motion in motions.chain([&checked.home()[index]]) {
            let start = motion.start().unwrap();
            assert!((start[0] - place[0]).hypot(start[1] - place[1]) < 1e-9);
            place = motion.end().unwrap();
        }
        assert!((place[0] - home[0]).hypot(place[1] - home[1]) < 1e-9);
    }
    let samples: usize = checked
        .runs()
        .iter()
        .map(|run| run.approach()[0].setpoints().len() + run.references()[0].setpoints().len())
        .sum();
    let all = samples + checked.home()[0].setpoints().len();
    assert!((checked.duration_s() - all as f64 / 50.0).abs() < 1e-6);
}

/// Straight motion along x at a speed whose standstill point is exactly `beyond` the allowed edge.
fn just_beyond(beyond: f64) -> (Reference, Limits, Rectangle) {
    let limits = Limits::default();
    let workspace = Rectangle { x_min_m: -0.5, x_max_m: 0.5, y_min_m: -0.5, y_max_m: 0.5 };
    let speeds = [0.0, 0.2, 0.4, 0.4, 0.2, 0.0];
    let velocities = speeds.map(|speed| [speed, 0.0]);
    // The last sample at 0.4 m/s comes after 0.2 and 0.4 m/s for 20 ms each.
    let travelled = (0.2 + 0.4) * 0.02;
    let stop = limits.stopping_distance(0.4);
    let start = 0.5 - limits.tracking_margin_m - stop - travelled + beyond;
    (Reference::from_velocities([start, 0.0], &velocities, 50.0).unwrap(), limits, workspace)
}

#[test]
fn a_path_that_could_only_just_not_stop_inside_is_refused() {
    let gantry = CoreXy::default();
    let (reference, limits, workspace) = just_beyond(-1e-6);
    let extremes = check_reference(&reference, &limits, &workspace, gantry).unwrap();
    assert!((extremes.edge_distance_m - 0.010_001).abs() < 1e-9);
    assert!((extremes.max_motor_turns_per_s - 10.0).abs() < 1e-9);
    let (reference, limits, workspace) = just_beyond(1e-6);
    let (time, violation) = check_reference(&reference, &limits, &workspace, gantry).unwrap_err();
    assert!((time - 0.06).abs() < 1e-9);
    assert!(matches!(violation, Violation::Standstill { .. }), "{violation}");
}

#[test]
fn every_limit_is_found_by_the_check() {
    let limits = Limits::default();
    let workspace = Rectangle { x_min_m: -0.5, x_max_m: 0.5, y_min_m: -0.5, y_max_m: 0.5 };
    let checked = |start, velocities: &[[f64; 2]]| {
        let reference = Reference::from_velocities(start, velocities, 50.0).unwrap();
        check_reference(&reference, &limits, &workspace, CoreXy::default()).unwrap_err().1
    };
    let rest = [0.0; 2];
    assert!(matches!(checked([0.0; 2], &[rest, [0.71, 0.0], rest]), Violation::AxisSpeed { .. }));
    assert!(matches!(checked([0.0; 2], &[rest, [0.21, 0.0], rest]), Violation::Slew { .. }));
    assert!(matches!(checked([0.495, 0.0], &[rest]), Violation::Position { .. }));
    assert!(matches!(checked([f64::NAN, 0.0], &[rest]), Violation::Position { .. }));
    assert!(matches!(checked([0.0; 2], &[rest, [f64::NAN, 0.0]]), Violation::TotalSpeed { .. }));
    assert!(matches!(checked([0.0; 2], &[rest, [0.1, 0.0]]), Violation::NotAtRest { .. }));
    assert!(matches!(checked([0.0; 2], &[[0.1, 0.0], rest]), Violation::NotAtRest { .. }));
    let slow = Limits { total_speed_m_per_s: 0.1, ..limits };
    let both = Reference::from_velocities(rest, &[rest, [0.09, 0.09], rest], 50.0).unwrap();
    let violation = check_reference(&both, &slow, &workspace, CoreXy::default()).unwrap_err().1;
    assert!(matches!(violation, Violation::TotalSpeed { .. }));
}

#[test]
fn refusals_name_run_pattern_value_and_remedy() {
    let large = Pattern::Circle { radius_m: 0.09, speed_m_per_s: 0.2, turn: Turn::Clockwise };
    let said = check_both(&plan_of(large)).unwrap_err().to_string();
    assert!(said.contains("run 1 (circle:radius_m=0.09"), "{said}");
    assert!(said.contains("left player") && said.contains("largest that fits is 0.0"), "{said}");
    let mut robot = Robot::default();
    robot.home.left.x_m = robot.soft_limits(Player::Left).x_max_m - 0.005;
    let creep = plan_of(Pattern::ALL[9]);
    let said = check_plan(&creep, &robot, &[Player::Left]).unwrap_err().to_string();
    assert!(said.contains("the move to the start of run 1"), "{said}");
    assert!(said.contains("tracking_margin_m 0.01"), "{said}");
    assert!(check_plan(&creep, &Robot::default(), &[]).is_err());
    assert!(check_plan(&creep, &Robot::default(), &[Player::Left, Player::Left]).is_err());
    robot.drives.truncate(2);
    assert!(check_plan(&creep, &robot, &[Player::Left]).is_err());
}

fn pattern() -> impl Strategy<Value = Pattern> {
    let heading = prop::sample::select(Heading::ALL.to_vec());
    let sizes = (0.003..0.3_f64, 0.005..1.0_f64, 0.05..30.0_f64, 0.1..20.0_f64, 1_u32..20);
    (0..10_usize, heading, sizes).prop_map(|(kind, heading, (size, speed, rate, time, count))| {
        let (length_m, speed_m_per_s) = (size, speed);
        let (f0_hz, f1_hz, period_s) = (rate / 20.0, rate, time);
        match kind {
            0 => Pattern::Circle { radius_m: size / 2.0, speed_m_per_s, turn: Turn::Clockwise },
            1 => Pattern::Diagonal { slope: Slope::Down, length_m, speed_m_per_s },
            2 => Pattern::XLine { length_m, speed_m_per_s },
            3 => Pattern::YLine { length_m, speed_m_per_s },
            4 => Pattern::Ramp { heading, length_m, speed_m_per_s, rate_m_per_s2: rate },
            5 => {
                let hold_min_s = time / 20.0 + 0.02;
                Pattern::RandomWalk { speed_m_per_s, hold_min_s, hold_max_s: hold_min_s * 3.0 }
            }
            6 => Pattern::Chirp { heading, f0_hz, f1_hz, speed_m_per_s, period_s },
            7 => Pattern::Multisine { lines: count, f0_hz, f1_hz, speed_m_per_s, period_s },
            8 => Pattern::StepLadder { heading, speed_m_per_s, levels: count, hold_s: time / 20.0 },
            _ => Pattern::Creep { heading, speed_m_per_s, period_s },
        }
    })
}

/// Independent formulation of the limits.
fn obeys(reference: &Reference, robot: &Robot, player: Player) -> bool {
    let (limits, workspace) = (robot.limits, robot.soft_limits(player));
    let points = reference.setpoints();
    let bounds = [[workspace.x_min_m, workspace.x_max_m], [workspace.y_min_m, workspace.y_max_m]];
    let mut place = points[0].position;
    (0..points.len()).all(|k| {
        let v = points[k].velocity;
        let before = if k == 0 { [0.0; 2] } else { points[k - 1].velocity };
        let integral = (0..2).all(|i| (place[i] - points[k].position[i]).abs() < 1e-9);
        let axes = (0..2).all(|i| {
            let brake = v[i] * v[i] / 10.0 + 0.04 * v[i].abs() + 0.01 - 1e-8;
            let room = if 0.0 < v[i] { bounds[i][1] - place[i] } else { place[i] - bounds[i][0] };
            let nearest = (bounds[i][1] - place[i]).min(place[i] - bounds[i][0]);
            brake <= room
                && 0.01 - 1e-8 <= nearest
                && v[i].abs() <= 0.7 + 1e-8
                && (v[i] - before[i]).abs() <= 0.2 + 1e-8
        });
        place = [place[0] + v[0] * 0.02, place[1] + v[1] * 0.02];
        let known = limits.braking_m_per_s2 == 5.0 && limits.reaction_s == 0.04;
        known && integral && axes && v[0].hypot(v[1]) <= 1.0 + 1e-8
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(192))]

    #[test]
    fn checked_motions_obey_the_limits(pattern in pattern()) {
        let robot = Robot::default();
        // A refusal is fine; a violation would mean that a pattern broke its own promise.
        match check_both(&plan_of(pattern)) {
            Ok(checked) => {
                let run = &checked.runs()[0];
                for (index, player) in Player::BOTH.into_iter().enumerate() {
                    let motions = [&run.approach()[index], &run.references()[index]];
                    for motion in motions.into_iter().chain([&checked.home()[index]]) {
                        prop_assert!(obeys(motion, &robot, player), "{pattern}");
                        let points = motion.setpoints();
                        prop_assert_eq!(points[0].velocity, [0.0; 2]);
                        prop_assert_eq!(points[points.len() - 1].velocity, [0.0; 2]);
                    }
                }
            }
            Err(PlanError::Trajectory { .. }) => {}
            Err(other) => prop_assert!(false, "{pattern}: {other}"),
        }
    }

    #[test]
    fn the_remedy_of_a_refusal_works(pattern in pattern()) {
        use TrajectoryError::{TooAbrupt, TooFast, TooLarge};
        let Err(PlanError::Trajectory { source, .. }) = check_both(&plan_of(pattern)) else {
            return Ok(());
        };
        let (key, largest) = match &*source {
            TooLarge { key, largest, .. } | TooAbrupt { key, largest, .. } => (*key, *largest),
            TooFast { largest, .. } => ("speed_m_per_s", *largest),
            _ => return Ok(()),
        };
        let text = pattern.to_string();
        let parts = text.split_once(':').unwrap();
        let replaced: Vec<String> = parts.1.split(',').map(|part| {
            if part.starts_with(key) { format!("{key}={largest}") } else { part.to_owned() }
        }).collect();
        let mended: Result<Pattern, _> = format!("{}:{}", parts.0, replaced.join(",")).parse();
        // A remedy for one limit may meet the next limit; a size that fits the workspace meets all.
        if let (TooLarge { .. }, Ok(mended)) = (*source, mended) {
            let checked = check_both(&plan_of(mended));
            prop_assert!(checked.is_ok(), "{pattern} mended to {mended}: {checked:?}");
        }
    }
}
