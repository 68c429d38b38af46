//! Steps, stops and reversals against the measurements of the KlaskTron paper; CoreXY; friction;
//! coupling.

use super::support::{Host, PERIOD};
use crate::{recording::topic::Player, rig::Truth};

/// Relative tolerance to the paper's values.
const TOLERANCE: f64 = 0.2;
/// A speed within 5 % of 0.5 m/s counts as reached.
const REACHED: f64 = 0.025;
const SPEED: f64 = 0.5;

/// Time until `axis` of the right carriage first comes within [`REACHED`] of `goal` (s).
fn time_to_reach(truths: &[(f64, Truth)], axis: usize, goal: f64) -> f64 {
    let begin = truths[0].0 - PERIOD / 20.0;
    let speed = |truth: &Truth| [truth.right.carriage.vx, truth.right.carriage.vy][axis];
    let reached = truths.iter().find(|(_, truth)| (speed(truth) - goal).abs() < REACHED);
    reached.unwrap().0 - begin
}

fn assert_near(name: &str, value: f64, wanted: f64) {
    println!("{name}: {value:.4}, the paper has {wanted}");
    assert!((value / wanted - 1.0).abs() < TOLERANCE, "{name}: {value} instead of {wanted}");
}

fn place(truth: &Truth) -> [f64; 2] {
    [truth.right.carriage.x, truth.right.carriage.y]
}

#[test]
fn steps_stops_and_reversals_are_those_of_the_paper() {
    for axis in 0..2 {
        let mut host = Host::from_json(r#"{"ball": {"start": null}}"#);
        host.arm();
        let along = |speed: f64| if axis == 0 { [speed, 0.0] } else { [0.0, speed] };
        host.drive(along(-0.3), 0.2);
        host.drive([0.0; 2], 0.3);
        let start = host.drive(along(SPEED), 0.2);
        assert_near("mean acceleration", SPEED / time_to_reach(&start, axis, SPEED), 6.25);
        let begin = place(&host.link.truth())[axis];
        let stop = host.drive([0.0; 2], 0.3);
        assert_near("time to stop", time_to_reach(&stop, axis, 0.0), 0.077);
        assert_near("way to stop", place(&stop[stop.len() - 1].1)[axis] - begin, 0.02);
        host.drive(along(-SPEED), 0.16);
        let reversal = host.drive(along(SPEED), 0.2);
        assert_near("time to reverse", time_to_reach(&reversal, axis, SPEED), 0.111);
        let lag = |truth: &Truth| {
            let right = &truth.right;
            (right.carriage.x - right.peg.x).hypot(right.carriage.y - right.peg.y)
        };
        let largest = reversal.iter().map(|(_, truth)| lag(truth)).fold(0.0, f64::max);
        assert_near("lag of the striker", largest, 0.004);
        assert!(host.link.truth().right.coupled);
    }
}

/// `x = d/2 (a + b)`, `y = d/2 (a - b)` with d = 0.04 m, a and b after the sign of each motor.
#[test]
fn turns_and_carriage_agree() {
    for (node, player, sign) in [
        (0, Player::Right, 1.0),
        (1, Player::Right, 1.0),
        (2, Player::Left, -1.0),
        (3, Player::Left, -1.0),
    ] {
        let mut host = Host::from_json("{}");
        host.arm();
        let before = host.link.truth();
        for _ in 0..15 {
            for other in 0..4 {
                host.velocity(other, if other == node { 3.0 } else { 0.0 });
            }
            host.wait(PERIOD);
        }
        let after = host.link.truth();
        let turns = |idx: usize| {
            sign * (after.drives[idx].position_turns - before.drives[idx].position_turns)
        };
        let first = if player == Player::Right { 0 } else { 2 };
        let (a, b) = (turns(first), turns(first + 1));
        let moved = [
            after.player(player).carriage.x - before.player(player).carriage.x,
            after.player(player).carriage.y - before.player(player).carriage.y,
        ];
        assert!(0.5 < turns(usize::from(node)) * sign, "{a} {b}");
        // The friction of the guides stretches the belts by some tens of micrometres.
        assert!((moved[0] - 0.02 * (a + b)).abs() < 1e-4, "{moved:?} {a} {b}");
        assert!((moved[1] - 0.02 * (a - b)).abs() < 1e-4, "{moved:?} {a} {b}");
        assert!(0.01 < moved[0].abs().min(moved[1].abs()));
    }
}

/// Fraction of the time at which the right carriage is at rest during a slow command, and its mean
/// speed (m/s), after three seconds.
fn creep(friction: &str) -> (f64, f64) {
    let text = format!(
        r#"{{"drive": {{"cogging": [], "friction": {friction}}}, "ball": {{"start": null}},
            "gantry": {{"right": {{"y_start_m": 0.1, "x_friction": {{"coulomb_n": 0.5}}}}}}}}"#
    );
    let mut host = Host::from_json(&text);
    host.arm();
    host.drive([0.002, 0.0], 3.0);
    let truths = host.drive([0.002, 0.0], 4.0);
    let standing = |(_, truth): &&(f64, Truth)| truth.right.carriage.vx.abs() < 1e-4;
    let share = truths.iter().filter(standing).count() as f64 / truths.len() as f64;
    let way = truths[truths.len() - 1].1.right.carriage.x - truths[0].1.right.carriage.x;
    (share, way / 4.0)
}

#[test]
fn creeping_sticks_only_with_a_stribeck_bump() {
    let (smooth, mean) = creep(r#"{"coulomb_nm": 0.015, "breakaway_nm": 0.0}"#);
    assert!(smooth < 0.01, "{smooth}");
    assert!((mean / 0.002 - 1.0).abs() < 0.05, "{mean}");
    let (sticking, _) =
        creep(r#"{"coulomb_nm": 0.015, "breakaway_nm": 0.08, "stribeck_turns_per_s": 0.05}"#);
    assert!(0.2 < sticking, "{sticking}");
}

#[test]
fn friction_that_depends_on_direction_shows_in_the_torque() {
    let text = r#"{"drive": {"cogging": [], "friction": {"backward_ratio": 2.0}}}"#;
    let mut host = Host::from_json(text);
    host.arm();
    let mut torque = |speed: f64| {
        host.drive([speed, 0.0], 0.6);
        host.link.truth().drives[0].torque_newton_metres.abs()
    };
    let (forwards, backwards) = (torque(0.1), torque(-0.1));
    // Twice the Coulomb friction of the motor, 0.015 N m, but the same of the guide.
    assert!((backwards - forwards - 0.015).abs() < 0.002, "{forwards} {backwards}");
}

#[test]
fn the_magnet_holds_at_10_m_per_s2_and_loses_its_grip_beyond_its_pull() {
    // The default slew of the drives is 9.6 m/s^2 along an axis: the striker follows.
    let mut host = Host::from_json(r#"{"ball": {"start": null}}"#);
    host.arm();
    for speed in [0.6, -0.6, 0.6, -0.6] {
        host.drive([speed, 0.0], 0.14);
        assert!(host.link.truth().right.coupled);
    }
    // A striker of fifty times the mass needs more force than the magnet has.
    let mut host = Host::from_json(r#"{"peg": {"right": {"mass_kg": 0.5}}}"#);
    host.arm();
    host.drive([0.6, 0.0], 0.2);
    assert!(!host.link.truth().right.coupled);
    let lost = host.link.truth().right;
    assert!(0.02 < (lost.carriage.x - lost.peg.x).hypot(lost.carriage.y - lost.peg.y));
    // It stays decoupled until the magnet is near it again.
    host.drive([0.0, 0.0], 2.0);
    let still = host.link.truth().right;
    assert!(!still.coupled && still.peg.speed() < 1e-9);
    for _ in 0..40 {
        let truth = host.link.truth().right;
        let back = [truth.peg.x - truth.carriage.x, truth.peg.y - truth.carriage.y];
        host.drive(back.map(|way| (way * 3.0).clamp(-0.1, 0.1)), 0.1);
    }
    assert!(host.link.truth().right.coupled);
}

#[test]
fn a_jammed_carriage_stands_while_its_motor_pushes() {
    let text = r#"{"faults": [{"after_arming_s": 0.1, "kind": "stuck", "player": "right"}],
                   "drive": {"guards": {"spinout_enabled": true}}}"#;
    let mut host = Host::from_json(text);
    host.arm();
    host.drive([0.0, 0.0], 0.2);
    let before = host.link.truth();
    host.drive([0.1, 0.0], 0.1);
    let after = host.link.truth();
    assert_eq!(before.right.carriage.x, after.right.carriage.x);
    assert!(0.1 < after.drives[0].torque_newton_metres);
    // With the detection enabled it ends in SPINOUT_DETECTED.
    host.drive([0.5, 0.0], 1.5);
    assert_eq!(host.link.truth().drives[0].errors.0, 0x400_0000);
}
