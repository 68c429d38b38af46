//! Physics of the bench's own rigs: energy, signs, units, and that equal seeds give equal cases.

use crate::{
    axis::{self, AxisRig, Travel},
    ball::{self, BallRig, Start},
    catalogue,
    draw::Draw,
    gantry::{BELT_PER_TURN, Gantry, HOME, ROTOR_MASS},
    linear::{fit, rest},
    observe::observe,
    plan::{Excitation, plan},
    step::{Commands, Phases, Trace, simulate},
    wilson::wilson,
};

const PHASES: Phases = Phases { tooth: [0.0; 2], hum: 0.0 };

fn run(rig: &Gantry, commands: &[[f64; 2]]) -> Trace {
    simulate(rig, Commands::Replay(commands), PHASES, &mut Draw::new(0, "sanity"))
}

fn last(trace: &Trace) -> [f64; 2] {
    trace.seen[trace.seen.len() - 1]
}

#[test]
fn a_command_along_x_moves_x_by_its_integral_and_both_motors_alike() {
    let rig = Gantry::new(1, 0).silent();
    let mut commands = vec![[0.1, 0.0]; 50];
    commands.extend(vec![[0.0, 0.0]; 25]);
    let trace = run(&rig, &commands);
    let at = last(&trace);
    assert!((at[0] - HOME[0] - 0.1).abs() < 2e-3, "{at:?}");
    assert!((at[1] - HOME[1]).abs() < 1e-4, "{at:?}");
    let [a, b] = trace.belt[trace.belt.len() - 1];
    assert!((a - b).abs() < 1e-4 && (a - 0.1).abs() < 2e-3, "{a} {b}");
    let seen = observe(&rig, &trace, &mut Draw::new(0, "o"));
    let turns = seen.turns[seen.turns.len() - 1];
    assert!((turns[0] * BELT_PER_TURN - a).abs() < 1e-12);
}

#[test]
fn constant_speed_costs_rail_friction_shared_by_both_motors() {
    let mut rig = Gantry::new(1, 0).silent();
    rig.friction[0].coulomb = 2.0;
    rig.friction[0].viscous = 5.0;
    let trace = run(&rig, &[[0.1, 0.0]; 60]);
    let [a, b] = trace.force[trace.force.len() - 1];
    // 2 N + 5 N s/m * 0.1 m/s, half of it per belt.
    assert!((a + b - 2.5).abs() < 0.02, "{a} {b}");
    assert!((a - b).abs() < 1e-3, "{a} {b}");
}

#[test]
fn the_ramp_bounds_the_acceleration_and_the_force_is_mass_times_it() {
    let mut rig = Gantry::new(1, 0).silent();
    rig.friction = Default::default();
    rig.drive.ramp = [8.0; 2];
    let trace = run(&rig, &[[0.5, 0.0]; 6]);
    let rate = (trace.speed[5][0] - trace.speed[4][0]) / 0.01;
    // The loop catches up with its setpoint, so it may be a little faster than the ramp.
    assert!((rate - 8.0).abs() < 1.5, "{rate}");
    let pull = trace.force[5][0] + trace.force[5][1];
    let expected = (Gantry::carried()[0] + 2.0 * ROTOR_MASS) * rate;
    assert!((pull / expected - 1.0).abs() < 0.1, "{pull} {expected}");
}

#[test]
fn tilt_pulls_a_free_carriage_and_friction_holds_it() {
    let mut rig = Gantry::new(1, 0).silent();
    rig.disarmed = true;
    rig.frame.tilt = [0.02, 0.0];
    let held = last(&run(&rig, &[[0.0; 2]; 50]));
    assert!((held[0] - HOME[0]).abs() < 1e-12, "{held:?}");
    rig.friction = Default::default();
    let free = last(&run(&rig, &[[0.0; 2]; 50]));
    let carried = Gantry::carried()[0];
    let rate = carried * 9.81 * 0.02_f64.sin() / (carried + 2.0 * ROTOR_MASS);
    assert!((free[0] - HOME[0] - 0.5 * rate).abs() < 1e-3 * rate, "{free:?}");
}

#[test]
fn every_effect_changes_something_and_its_value_reads_back() {
    let plan = plan(Excitation::Full, 6.4, 1.0, &mut Draw::new(2, "plan"));
    for spec in catalogue::all() {
        let look = |rig: &Gantry| {
            let mut draw = Draw::new(4, "look");
            let trace = simulate(rig, Commands::Follow(&plan), PHASES, &mut draw);
            let o = observe(rig, &trace, &mut draw);
            assert!(trace.seen.iter().flatten().all(|v| v.abs() < 0.5), "{}", spec.name);
            (o.turns, o.state, o.frames.iter().map(|f| (f.time, f.at)).collect::<Vec<_>>())
        };
        let base = Gantry::new(3, spec.rig.unwrap_or(0));
        for magnitude in spec.range {
            let mut rig = base.clone();
            (spec.apply)(&mut rig, [1.0, 1.0], magnitude);
            assert!((spec.value)(&rig, 0).is_finite(), "{}", spec.name);
            let changed = look(&base) != look(&rig);
            // The smallest size may be below what the motion reaches, as a limit can be.
            assert!(changed || magnitude < spec.range[1], "{} changes nothing", spec.name);
        }
    }
}

#[test]
fn every_effect_of_the_axis_stays_finite_over_its_range() {
    let mut draw = Draw::new(0, "axis");
    let reference = axis::reference(Travel::Full, 6.0, 1.0, &mut draw);
    for spec in axis::EFFECTS {
        for magnitude in spec.range {
            let mut rig = AxisRig::new(1, 0);
            (spec.apply)(&mut rig, magnitude);
            let trace = axis::simulate(&rig, &reference, 0.0, &mut draw);
            assert!(trace.position.iter().all(|q| q.abs() < 1.0), "{} {magnitude}", spec.name);
        }
    }
}

#[test]
fn a_ball_slows_by_rolling_resistance_and_loses_energy_at_walls() {
    let mut rig = BallRig::new(0, 0);
    rig.rolling = 0.01;
    rig.restitution = 0.8;
    let start = Start { at: [-0.1, 0.0], velocity: [0.2, 0.0], spin: 0.0 };
    let path = ball::roll(&rig, start, 0.0);
    // One second: 0.2 m - g c / 2.
    let expected = -0.1 + 0.2 - 0.5 * 9.81 * 0.01;
    assert!((path[120][0] - expected).abs() < 1e-4, "{} {expected}", path[120][0]);
    let fast = Start { at: [0.0, 0.0], velocity: [1.5, 0.0], spin: 0.0 };
    let path = ball::roll(&rig, fast, 0.0);
    let speed = |i: usize| (path[i + 1][0] - path[i][0]) * 120.0;
    let before = speed(8);
    let after = speed(14);
    assert!((after / before + 0.8).abs() < 0.02, "{before} {after}");
}

#[test]
fn a_ball_on_a_level_board_without_losses_keeps_its_energy() {
    let rig = BallRig { restitution: 0.95, sag: 1e-3, ..BallRig::default() };
    let start = Start { at: [0.05, 0.05], velocity: [0.1, -0.1], spin: 0.0 };
    let path = ball::roll(&rig, start, 0.0);
    let energy = |i: usize| {
        let v = [0, 1].map(|k| (path[i + 1][k] - path[i - 1][k]) * 60.0);
        let height = 1e-3 * ((path[i][0] / 0.16).powi(2) + (path[i][1] / 0.21).powi(2));
        0.5 * (v[0] * v[0] + v[1] * v[1]) + 9.81 * height
    };
    let (first, later) = (energy(1), energy(70));
    assert!((later / first - 1.0).abs() < 0.01, "{first} {later}");
}

#[test]
fn the_axis_follows_and_its_mean_force_is_friction() {
    let mut rig = AxisRig::new(0, 0);
    (rig.disturbance, rig.encoder) = (0.0, 0.0);
    let mut draw = Draw::new(0, "axis");
    let reference = axis::reference(Travel::Full, 6.0, 1.0, &mut draw);
    let trace = axis::simulate(&rig, &reference, 0.0, &mut draw);
    let error = reference.iter().zip(&trace.position).map(|(r, q)| (r - q).abs());
    assert!(error.fold(0.0, f64::max) < 8e-3);
    let most = trace.force.iter().fold(0.0, |most: f64, force| most.max(force.abs()));
    assert!(most < rig.mass * 3.0 * 2.5 + rig.coulomb * 2.0 + rig.viscous, "{most} {}", rig.mass);
}

#[test]
fn equal_seeds_give_equal_motion() {
    let rig = Gantry::new(5, 2);
    let look = || {
        let mut draw = Draw::new(5, "repeat");
        let plan = plan(Excitation::Full, 3.2, 1.0, &mut draw);
        let trace = simulate(&rig, Commands::Follow(&plan), PHASES, &mut draw);
        observe(&rig, &trace, &mut draw).torque_nm
    };
    assert_eq!(look(), look());
}

#[test]
fn the_rivals_find_a_line() {
    let x: Vec<f64> = (0..50).map(f64::from).collect();
    let one = vec![1.0; 50];
    let y: Vec<f64> = x.iter().map(|x| 3.0 - 0.5 * x).collect();
    let found = fit(&[&one, &x], &y, 0.0);
    assert!((found[0] - 3.0).abs() < 1e-6 && (found[1] + 0.5).abs() < 1e-7, "{found:?}");
    assert!(rest(&[&one, &x], &y, &found) < 1e-9);
}

#[test]
fn wilson_is_known_at_ten_of_a_hundred() {
    let [low, high] = wilson(10, 100).expect("there are cases");
    assert!((low - 0.0552).abs() < 1e-3 && (high - 0.1744).abs() < 1e-3, "{low} {high}");
    assert!(wilson(0, 0).is_none());
}

#[test]
fn references_and_carriages_stay_on_the_board() {
    for seed in 0..40 {
        let mut draw = Draw::new(seed, "reach");
        let plan = plan(Excitation::Full, 30.0, 1.0, &mut draw);
        for at in &plan.position {
            let off = [at[0] - HOME[0], at[1] - HOME[1]];
            assert!(off[0].abs() < 0.15 && off[1].abs() < 0.1, "reference {seed} {off:?}");
        }
        if seed < 5 {
            let rig = Gantry::new(0, seed as usize);
            let trace = simulate(&rig, Commands::Follow(&plan), PHASES, &mut draw);
            let far = trace.seen.iter().flatten().map(|v| v.abs()).fold(0.0, f64::max);
            assert!(far < 0.25, "carriage {seed} {far}");
        }
    }
}

#[test]
fn what_resistance_and_restitution_imitate_is_no_size_of_a_ball_effect() {
    let rig =
        BallRig { rolling: 0.01, restitution: 0.8, camera_noise: 2.5e-4, ..BallRig::default() };
    let starts = ball::starts(ball::Rolls::Full, 1.0, &mut Draw::new(0, "imitated"));
    let look = |name: &str, m: f64| {
        let spec = ball::spec(name);
        let mut with = rig.clone();
        (spec.apply)(&mut with, m);
        let size = |known: &[ball::Knob]| ball::visibility(&rig, &with, &starts, known);
        (size(&[]), size(&ball::imitators(spec)))
    };
    // What is known itself is sized against the other one only.
    let (alone, beside) = look("ball.rolling_resistance", 0.002);
    assert!(1.0 < beside && beside < alone, "{alone} {beside}");
    // A restitution that falls with speed is mostly a lower restitution; a slope of the board is nothing alike.
    let (alone, beside) = look("impact.wall_restitution_speed", 0.01);
    assert!(beside < 0.6 * alone, "{alone} {beside}");
    let (alone, beside) = look("ball.tilt", 0.002);
    assert!(0.8 * alone < beside, "{alone} {beside}");
}
