//! What stops a free stretch, and what does not.

use super::{
    START,
    bench::{Bench, of_scripts},
    series,
};
use crate::collect::bench::BenchOutcome;
use klasktron::{
    collect::{Decision, Moment, Pilot, SessionError},
    opponent::Scripted,
    recording::{
        SESSION_METADATA,
        message::{CameraDetections, CarriageState, RunMarker, run_marker::Phase},
        topic::{self, Player},
    },
    seed::Stream,
    units::Nanos,
};

/// Drives both carriages to and fro along x, without looking.
struct Sweeper {
    /// Speed (m/s) and control periods in one direction.
    speed: f64,
    periods: u64,
}

impl Pilot for Sweeper {
    fn see(&mut self, _shown: Nanos, _picture: &CameraDetections) {}

    fn decide(&mut self, moment: &Moment) -> Decision {
        // Half a sweep first, so that it goes as far to one side as to the other.
        let way = (moment.step + self.periods / 2) / self.periods;
        let speed = if way.is_multiple_of(2) { self.speed } else { -self.speed };
        Decision { velocities: [[speed, 0.0]; 2], ..Decision::default() }
    }
}

/// Drives at full speed in random directions, a new one after 20 to 400 ms.
struct Madman {
    draws: Stream,
    until: u64,
    /// Along each axis (m/s).
    top: f64,
    velocities: [[f64; 2]; 2],
}

impl Pilot for Madman {
    fn see(&mut self, _shown: Nanos, _picture: &CameraDetections) {}

    fn decide(&mut self, moment: &Moment) -> Decision {
        if self.until <= moment.step {
            self.until = moment.step + 1 + self.draws.below(20) as u64;
            let mut full = || if self.draws.below(2) == 0 { self.top } else { -self.top };
            self.velocities = [[full(), full()], [full(), full()]];
        }
        Decision { velocities: self.velocities, ..Decision::default() }
    }
}

/// What holds for every reason: it is in a whole file, and nothing moves or is armed any more.
fn stops(outcome: &BenchOutcome, code: &str) {
    let report = outcome.report.as_ref().unwrap();
    assert_eq!(report.stop, code, "{}", report.stop_text);
    assert_eq!(report.runs_done, 0);
    assert!(report.not_confirmed_off.is_empty());
    outcome.all_idle();
    outcome.all_still();
    let recording = outcome.recording.as_ref().expect("what was recorded is kept");
    assert!(recording.loss.is_none());
    assert_eq!(recording.metadata[SESSION_METADATA]["stop"], code);
    let markers = series::<RunMarker>(recording, topic::RUN_MARKER);
    assert_eq!(markers.last().unwrap().1.phase(), Phase::End);
}

/// When the stretch began and ended (s since the rig's start).
fn span(outcome: &BenchOutcome) -> [f64; 2] {
    let markers = series::<RunMarker>(outcome.recording.as_ref().unwrap(), topic::RUN_MARKER);
    [0, 1].map(|at| markers[at].0.seconds_since(START))
}

#[test]
fn a_mad_pilot_stays_within_its_stop_limits() {
    // Top speed of the game with the usual following error; then as fast as the robot may, where on diagonals one
    // motor alone turns 1 m/s around and commands run ahead of it by more than that.
    for (top, seed, following_error_m) in [(0.4, 4, 0.06), (5.0, 4, 0.1), (5.0, 5, 0.1)] {
        let mut bench = Bench::new("{}", 60.0);
        bench.robot.limits.following_error_m = following_error_m;
        let draws = Stream::new(seed, "madman");
        let outcome = bench.run(&mut Madman { draws, until: 0, top, velocities: [[0.0; 2]; 2] });
        let report = outcome.report.as_ref().unwrap();
        assert_eq!(report.stop, "completed", "{}", report.stop_text);
        let recording = outcome.recording.as_ref().unwrap();
        let (mut nearest, mut fastest) = (f64::INFINITY, 0.0_f64);
        for player in Player::BOTH {
            let window = bench.robot.stop_limits(player);
            for (_, state) in series::<CarriageState>(recording, &topic::carriage(player)) {
                nearest = nearest.min(window.depth([state.x, state.y]));
                fastest = fastest.max(state.vx.hypot(state.vy));
            }
        }
        println!(
            "{top} m/s: {fastest:.2} m/s at most, {:.1} mm inside the stop window at least, {:.1} mm \
             behind commands at most",
            1e3 * nearest,
            1e3 * report.worst_tracking_m
        );
        assert!(0.0 < nearest && 0.5 < fastest, "{nearest} m, {fastest} m/s");
    }
}

#[test]
fn a_jammed_carriage_is_noticed_soon_and_a_normal_lag_never() {
    for (speed, periods, within) in [(0.4, 30, 0.8), (0.12, 80, 1.2)] {
        let mut sweeper = Sweeper { speed, periods };
        let outcome = Bench::new("{}", 6.0).run(&mut sweeper);
        let report = outcome.report.as_ref().unwrap();
        assert_eq!(report.stop, "completed", "{}", report.stop_text);
        assert!(report.worst_tracking_m < 0.02, "{} m", report.worst_tracking_m);
        let bench = Bench::with_fault(r#""kind": "stuck", "player": "right""#, 20.0);
        let outcome = bench.run(&mut Sweeper { speed, periods });
        stops(&outcome, "following_error");
        let text = &outcome.report.as_ref().unwrap().stop_text;
        assert!(text.contains("the right carriage"), "{text}");
        let [start, end] = span(&outcome);
        // The fault comes 4 s after the first arming, which comes 1.7 s after the start.
        println!("{speed} m/s: noticed {:.2} s after the jam", end - 5.7);
        assert!(start < 5.7 && (0.0..within).contains(&(end - 5.7)), "{start} {end}");
    }
}

#[test]
fn a_silent_camera_ends_a_match() {
    let bench = Bench::with_fault(r#""kind": "camera_stops""#, 20.0);
    let outcome = bench.run(&mut of_scripts([Some(Scripted::Random), Some(Scripted::Random)]));
    stops(&outcome, "camera_silent");
}

#[test]
fn a_lost_striker_ends_a_match() {
    let bench = Bench::with_fault(r#""kind": "peg_lost", "player": "left""#, 20.0);
    let outcome = bench.run(&mut of_scripts([Some(Scripted::Random), Some(Scripted::Random)]));
    stops(&outcome, "striker_lost");
}

#[test]
fn ctrl_c_ends_a_match() {
    for (presses, code) in [(1, "interrupted"), (2, "interrupted_twice")] {
        let bench = Bench { presses, ..Bench::new("{}", 4.0) };
        let outcome = bench.run(&mut of_scripts([Some(Scripted::Chaser), Some(Scripted::Random)]));
        stops(&outcome, code);
    }
}

/// Decides on no number after a second of driving.
struct Broken;

impl Pilot for Broken {
    fn see(&mut self, _shown: Nanos, _picture: &CameraDetections) {}

    fn decide(&mut self, moment: &Moment) -> Decision {
        let vx = if moment.step < 50 { 0.05 } else { f64::NAN };
        Decision { velocities: [[0.0; 2], [vx, 0.0]], ..Decision::default() }
    }
}

#[test]
fn a_decision_that_is_no_number_ends_a_match() {
    let outcome = Bench::new("{}", 4.0).run(&mut Broken);
    stops(&outcome, "no_decision");
    let text = &outcome.report.as_ref().unwrap().stop_text;
    assert!(text.contains("the right player commanded (NaN, 0) m/s"), "{text}");
    let [start, end] = span(&outcome);
    assert!((end - start - 1.0).abs() < 0.05, "{start} {end}");
    assert_eq!(outcome.report.unwrap().samples, 50);
}

#[test]
fn without_pictures_nothing_is_armed() {
    let rig = r#"{"faults": [{"at_s": 0.0, "kind": "camera_stops"}]}"#;
    let outcome = Bench::new(rig, 4.0).run(&mut Broken);
    assert!(outcome.recording.is_none(), "nothing was recorded, so there is no file");
    let Err(SessionError::Preflight(problems)) = outcome.report else { panic!("it went on") };
    assert_eq!(problems.len(), 1);
    assert!(problems[0].to_string().contains("no camera frame"), "{problems:?}");
}
