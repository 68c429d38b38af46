//! Tests of decisions on synthetic frames, without a rig or a session.

use super::{IN_CUP_SECONDS, Match, PlayError, Seat, Who};
use crate::{
    board::CUP_DISTANCE,
    collect::{Carriage, Moment, Pilot},
    ekf::{Detections, FilterSettings},
    game::{Estimator, Observation, ObservationKind, ObservationLayout, PreviousCommands, turned},
    gantry::{PerPlayer, Rectangle, Robot},
    nn::Network,
    opponent::Scripted,
    ppo::{Learner, Policy, PpoSettings, Scratch, Spaces},
    recording::{
        Recording,
        message::{CameraDetections, Point},
        topic::{CAMERA_DETECTIONS, Player},
    },
    train::{Preset, StoredPolicy, TrainSettings},
    units::{NANOS_PER_SECOND, Nanos},
};

const PICTURE_NS: u64 = NANOS_PER_SECOND / 120;

/// Observation of the policies here.
const LAYOUT: ObservationLayout =
    ObservationLayout { state: ObservationKind::Augmented20, commands: 2 };

/// Positions of ball, left and right striker.
type Places = [Option<[f64; 2]>; 3];

/// A robot whose halves are copies turned by 180 degrees, like the board of training.
fn symmetric() -> Robot {
    let field = |y_min_m, y_max_m| Rectangle { x_min_m: -0.15, x_max_m: 0.15, y_min_m, y_max_m };
    Robot {
        workspace: PerPlayer { left: field(-0.21, -0.01), right: field(0.01, 0.21) },
        ..Robot::default()
    }
}

fn play(seats: [Option<Seat>; 2]) -> Match {
    Match::new(seats, &symmetric(), &FilterSettings::default(), 3).unwrap()
}

fn scripted(script: Scripted) -> Option<Seat> {
    Some(Seat::Scripted(script))
}

/// An untrained policy whose weights are `change`d.
fn policy(seed: u64, change: impl Fn(&mut Network)) -> Option<Seat> {
    let spaces = Spaces { observations: LAYOUT.len(), actions: 2 };
    let settings = PpoSettings { hidden: vec![8], ..PpoSettings::paper() };
    let untrained = Learner::new(&settings, spaces, seed).unwrap().policy();
    let mut network = untrained.network().clone();
    change(&mut network);
    let policy = Policy::new(network, untrained.standardizer().clone(), *untrained.gaussian());
    let policy = Box::new(StoredPolicy {
        policy,
        observations: LAYOUT,
        action_scale_m_per_s: 0.4,
        command_slew_m_per_s2: Some(10.0),
        settings: TrainSettings::preset(Preset::Paper),
        metadata: [].into(),
    });
    Some(Seat::Policy { file: "tiny.mcap".to_owned(), sha256: "0".to_owned(), policy })
}

/// Increase the weights so that actions are not zero: an untrained policy hardly moves.
fn strong(network: &mut Network) {
    network.layers.iter_mut().flat_map(|layer| &mut layer.weight).for_each(|w| *w *= 30.0);
}

fn picture(time: Nanos, [ball, left, right]: Places) -> CameraDetections {
    let [ball, left, right] = [ball, left, right].map(|p| p.map(|[x, y]| Point { x, y }));
    CameraDetections { capture_time_ns: time.0, ball, left, right, ..CameraDetections::default() }
}

/// Show `places` from `from` for `seconds`, at 120 Hz.
fn show(game: &mut Match, from: Nanos, seconds: f64, places: impl Fn(f64) -> Places) -> Nanos {
    let pictures = (seconds * 120.0) as u64;
    for k in 0..pictures {
        let time = Nanos(from.0 + k * PICTURE_NS);
        game.see(time, &picture(time, places(k as f64 / 120.0)));
    }
    Nanos(from.0 + pictures * PICTURE_NS)
}

fn decide(game: &mut Match, now: Nanos, carriages: [Option<[f64; 2]>; 2]) -> [[f64; 2]; 2] {
    let carriages = carriages.map(|c| c.map(|position| Carriage { position, velocity: [0.0; 2] }));
    game.decide(&Moment { now, step: 7, carriages }).velocities
}

fn turn(place: [f64; 2]) -> [f64; 2] {
    place.map(|v| -v)
}

/// A recorded match, shown to the pilot of a match and to the estimator of training: a policy gets
/// the same observations, so it decides the same.
#[test]
fn a_policy_sees_a_recorded_match_as_training_would_show_it() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/example-match.mcap");
    let recording = Recording::open(std::path::Path::new(path)).unwrap();
    let frames = recording.series::<CameraDetections>(CAMERA_DETECTIONS).unwrap();
    let (filter, robot) = (FilterSettings::default(), symmetric());
    let seats = [policy(1, strong), policy(2, strong)];
    let policies = seats.clone().map(|seat| match seat {
        Some(Seat::Policy { policy, .. }) => policy,
        _ => unreachable!("both are policies"),
    });
    let mut game = play(seats);
    let home = Player::BOTH.map(|player| [robot.home.of(player).x_m, robot.home.of(player).y_m]);
    let mut estimator = Estimator::new(&filter, home);
    let mut scratch = Scratch::default();
    let mut previous = [PreviousCommands::default(); 2];
    let (mut decided, mut moved) = (0, 0);
    for (number, (arrival, frame)) in frames.iter().enumerate() {
        let shown = Nanos(frame.capture_time_ns);
        game.see(shown, frame);
        estimator.see(&Detections::of(shown, frame));
        if !number.is_multiple_of(3) {
            continue;
        }
        let now = arrival.max(shown);
        let decision = game.decide(&Moment { now, step: 0, carriages: [None, None] });
        let seen = estimator.look(now, [None, None]);
        for player in Player::BOTH {
            let found = decision.velocities[player as usize];
            let Some(ball) = seen.ball else {
                assert_eq!(found, [0.0; 2]);
                previous[player as usize].push([0.0; 2]);
                continue;
            };
            // As in training: observation, normalized network, clamp, scale.
            let mut row = [0.0; LAYOUT.len()];
            let own = &mut previous[player as usize];
            let observation = Observation::of_board(player, &seen.strikers, ball);
            LAYOUT.write(&observation, own, CUP_DISTANCE as f32, &mut row);
            let mut action = [0.0; 2];
            policies[player as usize].policy.act_mean(&row, &mut action, &mut scratch);
            let action = action.map(|a: f32| 0.4 * a.clamp(-1.0, 1.0));
            own.push(action);
            let velocity = action.map(f64::from);
            assert_eq!(found, turned(player, velocity), "frame {number}");
            decided += 1;
            moved += usize::from(1e-3 < found[0].hypot(found[1]));
        }
    }
    assert!(100 < decided && decided / 2 < moved, "{decided} {moved}");
}

#[test]
fn a_turned_table_gives_turned_commands() {
    let (own, other) = ([0.03, -0.12], [-0.05, 0.1]);
    let ball = |t: f64| [0.08 - 0.2 * t, -0.05 + 0.1 * t];
    let mut moved = 0;
    for seat in [Scripted::Goalkeeper, Scripted::Chaser].map(scripted).into_iter().chain([
        policy(1, strong),
        policy(2, strong),
        policy(3, strong),
    ]) {
        let mut left = play([seat.clone(), None]);
        let places = |t| [Some(ball(t)), Some(own), Some(other)];
        let now = show(&mut left, Nanos(0), 0.2, places);
        let as_left = decide(&mut left, now, [Some(own), None])[0];
        let mut right = play([None, seat]);
        let places = |t| [Some(turn(ball(t))), Some(turn(other)), Some(turn(own))];
        let now = show(&mut right, Nanos(0), 0.2, places);
        let as_right = decide(&mut right, now, [None, Some(turn(own))])[1];
        for axis in 0..2 {
            assert!((as_left[axis] + as_right[axis]).abs() < 1e-6, "{as_left:?} {as_right:?}");
        }
        moved += usize::from(0.05 < as_left[0].hypot(as_left[1]));
    }
    assert!(4 <= moved, "{moved} of 5 players moved");
}

#[test]
fn estimates_are_moved_ahead_to_now() {
    // A ball that rolls to the right at 0.5 m/s: 50 ms after the last frame the goalkeeper reacts
    // as to a ball 25 mm further on.
    let lead = |late: f64, shift: f64| {
        let mut game = play([scripted(Scripted::Goalkeeper), None]);
        let places = |t| [Some([shift + 0.5 * t, 0.0]), Some([0.0, -0.12]), Some([0.0, 0.1])];
        let now = show(&mut game, Nanos(0), 0.1, places);
        decide(&mut game, now.after_seconds(late), [Some([0.0, -0.12]), None])[0][0]
    };
    let (late, shifted) = (lead(0.05, -0.05), lead(0.0, -0.025));
    assert!((late - shifted).abs() < 0.01 && 0.05 < late - lead(0.0, -0.05), "{late} {shifted}");
}

#[test]
fn both_stand_while_the_ball_is_not_seen() {
    let mut game = play([scripted(Scripted::Goalkeeper), policy(1, strong)]);
    let carriages = [Some([0.0, -0.12]), Some([0.0, 0.12])];
    let strikers = |ball| [ball, carriages[0], carriages[1]];
    let now = show(&mut game, Nanos(0), 0.2, |_| strikers(Some([0.1, 0.0])));
    assert!(decide(&mut game, now, carriages).iter().all(|v| *v != [0.0; 2]));
    let now = show(&mut game, now, 0.3, |_| strikers(None));
    assert_eq!(decide(&mut game, now, carriages), [[0.0; 2]; 2]);
    let now = show(&mut game, now, 0.1, |_| strikers(Some([0.1, 0.0])));
    assert!(decide(&mut game, now, carriages).iter().all(|v| *v != [0.0; 2]));
}

#[test]
fn a_match_without_a_ball_ends_after_half_a_minute() {
    let mut game = play([scripted(Scripted::Goalkeeper), None]);
    let mut ended_after = |ball_s: f64| {
        let (mut time, mut last) = (0.0, 0.0);
        while time < 100.0 {
            let now = Nanos(1).after_seconds(time);
            let ball = (time < ball_s).then_some(Point { x: 0.1, y: 0.0 });
            let frame = CameraDetections { ball, ..CameraDetections::default() };
            game.see(now, &frame);
            let carriages = [None, None];
            if let Some(reason) = game.decide(&Moment { now, step: 0, carriages }).stop {
                assert_eq!(reason.code(), "ball_missing");
                assert!(reason.to_string().contains("limit 30 s"), "{reason}");
                return time - last;
            }
            if time < ball_s {
                last = time;
            }
            time += 0.02;
        }
        panic!("the match did not end");
    };
    let age = ended_after(40.0);
    // The filter predicts the ball for a while after the last frame.
    assert!((30.0..32.0).contains(&age), "{age}");
}

#[test]
fn both_stand_when_the_ball_stays_in_a_cup() {
    let mut game = play([scripted(Scripted::Chaser), scripted(Scripted::Goalkeeper)]);
    let carriages = [Some([0.05, -0.12]), Some([0.05, 0.12])];
    let in_cup = |_| [Some([0.0, -CUP_DISTANCE]), carriages[0], carriages[1]];
    let now = show(&mut game, Nanos(0), 0.1, in_cup);
    assert_ne!(decide(&mut game, now, carriages), [[0.0; 2]; 2]);
    let now = show(&mut game, now, IN_CUP_SECONDS + 0.02, in_cup);
    assert_eq!(decide(&mut game, now, carriages), [[0.0; 2]; 2]);
    let back = |_| [Some([0.0, -0.06]), carriages[0], carriages[1]];
    let now = show(&mut game, now, 0.1, back);
    assert_ne!(decide(&mut game, now, carriages), [[0.0; 2]; 2]);
}

#[test]
fn a_striker_that_is_not_seen_is_where_its_carriage_is() {
    let decision = |left: Option<[f64; 2]>, carriage| {
        let mut game = play([scripted(Scripted::Goalkeeper), None]);
        let places = |_| [Some([0.0, 0.05]), left, Some([0.0, 0.1])];
        let now = show(&mut game, Nanos(0), 0.2, places);
        decide(&mut game, now, [Some(carriage), None])[0]
    };
    let place = [0.03, -0.12];
    let (seen, unseen) = (decision(Some(place), place), decision(None, place));
    assert!((seen[0] - unseen[0]).hypot(seen[1] - unseen[1]) < 0.01, "{seen:?} {unseen:?}");
    assert!(unseen[0] < -0.1);
}

#[test]
fn the_wall_limiter_holds_at_the_nearer_of_both_fields() {
    // The policy always commands 0.4 m/s to the right and forwards. 30 mm from its wall the robot's
    // workspace ends first and leaves (30 - 13.5)/90 of that. Ahead the workspace of training
    // limits: at 0.02 m, not at 0.01 m from the middle.
    let forwards = policy(1, |network| {
        let last = network.layers.last_mut().unwrap();
        last.weight.fill(0.0);
        last.bias.fill(3.0);
    });
    let mut game = play([forwards, None]);
    let place = [0.12, -0.05];
    let places = |_| [Some([0.15, -0.021]), Some(place), Some([0.0, 0.1])];
    let now = show(&mut game, Nanos(0), 0.2, places);
    let [vx, vy] = decide(&mut game, now, [Some(place), None])[0];
    let cap = 0.4 * (0.03 - 0.0135) / 0.09;
    assert!((vx - cap).abs() < 1e-9 && (vy - cap).abs() < 1e-9, "{vx} {vy}");
}

#[test]
fn a_policy_of_broken_weights_decides_on_no_number() {
    let broken = policy(1, |network| network.layers[0].weight.fill(f32::NAN));
    let mut game = play([broken, None]);
    let places = |_| [Some([0.0, 0.05]), Some([0.0, -0.1]), Some([0.0, 0.1])];
    let now = show(&mut game, Nanos(0), 0.2, places);
    let [vx, vy] = decide(&mut game, now, [Some([0.0, -0.1]), None])[0];
    assert!(vx.is_nan() && vy.is_nan());
}

#[test]
fn who_cannot_play_is_told_why() {
    let refused = |seats, robot: &Robot| -> String {
        let game = Match::new(seats, robot, &FilterSettings::default(), 0);
        game.err().map(|error| error.to_string()).unwrap_or_default()
    };
    let mut slow = Robot::default();
    slow.limits.speed_m_per_s = 0.2;
    let said = refused([policy(1, strong), None], &slow);
    assert!(
        said.contains("tiny.mcap: action_scale_m_per_s is 0.4, but limits.speed_m_per_s"),
        "{said}"
    );
    assert!(said.contains("has 0.2;"), "{said}");
    // A scripted player obeys the robot's limit instead.
    assert_eq!(refused([scripted(Scripted::Chaser), None], &slow), "");
    assert!(refused([None, None], &slow).contains("nobody plays"));
    let mut alone = Robot::default();
    alone.drives.retain(|seat| seat.player == Player::Left);
    let said = refused([None, scripted(Scripted::Random)], &alone);
    assert!(said.contains("no drive of the right player"), "{said}");
}

#[test]
fn a_robot_that_changes_speed_more_slowly_than_in_training_is_a_doubt() {
    let warnings = |seats: [Option<Seat>; 2], slew| {
        let mut robot = symmetric();
        robot.limits.slew_m_per_s2 = slew;
        Match::new(seats, &robot, &FilterSettings::default(), 3).unwrap().warnings(&robot)
    };
    let said = warnings([policy(1, strong), scripted(Scripted::Chaser)], 6.0);
    assert_eq!(said.len(), 1);
    assert!(
        said[0].contains("slew limit of 10 m/s^2") && said[0].contains("robot file is 6"),
        "{said:?}"
    );
    assert!(warnings([policy(1, strong), None], 10.0).is_empty());
    assert!(warnings([scripted(Scripted::Chaser), None], 6.0).is_empty());
}

#[test]
fn players_are_named_as_they_are_typed() {
    assert_eq!("none".parse(), Ok(Who::Nobody));
    assert_eq!("chaser".parse(), Ok(Who::Scripted(Scripted::Chaser)));
    assert_eq!("p/policy.mcap".parse(), Ok(Who::Policy("p/policy.mcap".into())));
    let said = "chasr".parse::<Who>().unwrap_err().to_string();
    assert!(
        said.contains("`chasr` is no player") && said.contains("goalkeeper, chaser, shooter, none")
    );
    let error = Seat::read(&Who::Policy("nowhere.mcap".into())).unwrap_err();
    assert!(matches!(error, PlayError::Recording(_)) && error.to_string().contains("nowhere.mcap"));
}
