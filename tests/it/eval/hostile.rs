//! What detectors do wrong must not become an event.

use klasktron::referee::{Event, EventKind, Frame, Outcome, Rules, analyze};

const RATE: f64 = 120.0;

/// A ball that crosses the board on a straight line at 0.5 m/s in 0.6 s, both strikers aside. Every
/// coordinate has a little pattern instead of noise, so that no two frames are equal.
fn crossing() -> Vec<Frame> {
    (0..72)
        .map(|k| {
            let time = f64::from(k) / RATE;
            let shake = |n: i32| 3e-4 * f64::from((k * 7 + n * 5) % 11 - 5) / 5.0;
            Frame {
                time,
                ball: Some([-0.06 + 0.2 * time + shake(1), -0.12 + 0.45 * time + shake(2)]),
                strikers: [
                    Some([0.1 + shake(3), -0.1 + 0.05 * time + shake(4)]),
                    Some([-0.02 + shake(5), 0.02 + shake(6)]),
                ],
                ..Frame::default()
            }
        })
        .collect()
}

fn told(frames: &[Frame]) -> Vec<Event> {
    analyze(frames, &Rules::default()).events
}

#[track_caller]
fn says_nothing(frames: &[Frame]) {
    let analysis = analyze(frames, &Rules::default());
    assert_eq!(analysis.events, vec![]);
    assert_eq!(analysis.episodes.len(), 1);
    assert_eq!(analysis.episodes[0].span.outcome, Outcome::Unfinished);
}

#[test]
fn a_straight_way_is_no_event() {
    says_nothing(&crossing());
}

#[test]
fn a_ball_that_vanishes_and_comes_back_is_no_event() {
    for (from, to) in [(20, 23), (20, 40), (30, 60), (5, 70)] {
        let mut frames = crossing();
        frames[from..to].iter_mut().for_each(|frame| frame.ball = None);
        says_nothing(&frames);
    }
}

#[test]
fn a_ball_that_swaps_with_a_striker_is_no_event() {
    for player in 0..2 {
        for (from, to) in [(30, 31), (30, 33), (30, 45)] {
            let mut frames = crossing();
            for frame in &mut frames[from..to] {
                std::mem::swap(&mut frame.ball, &mut frame.strikers[player]);
            }
            says_nothing(&frames);
            // Only the ball is wrong.
            let mut frames = crossing();
            for frame in &mut frames[from..to] {
                frame.ball = frame.strikers[player].map(|[x, y]| [x + 2e-4, y - 3e-4]);
            }
            says_nothing(&frames);
        }
    }
}

#[test]
fn a_frozen_ball_is_no_event() {
    for (from, to) in [(30, 34), (30, 45), (10, 40)] {
        let mut frames = crossing();
        let held = frames[from].ball;
        frames[from..to].iter_mut().for_each(|frame| frame.ball = held);
        says_nothing(&frames);
        // The whole picture stands still.
        let mut frames = crossing();
        let held = frames[from];
        for frame in &mut frames[from..to] {
            *frame = Frame { time: frame.time, ..held };
        }
        says_nothing(&frames);
    }
}

#[test]
fn frames_that_arrive_twice_or_late_are_no_event() {
    let twice = |delay: f64| -> Vec<Frame> {
        crossing()
            .into_iter()
            .flat_map(|frame| [frame, Frame { time: frame.time + delay, ..frame }])
            .collect()
    };
    for delay in [0.0, 0.0005, 0.002] {
        says_nothing(&twice(delay));
    }
    let mut frames = crossing();
    frames.swap(20, 21);
    frames.swap(40, 43);
    says_nothing(&frames);
}

#[test]
fn single_wild_places_are_no_event() {
    let mut frames = crossing();
    for (at, place) in [(10, [0.12, 0.15]), (25, [0.0, 0.0]), (50, [-0.15, -0.2]), (51, [9.0, 0.0])]
    {
        frames[at].ball = Some(place);
    }
    frames[33].ball = Some([f64::NAN, 0.0]);
    says_nothing(&frames);
}

#[test]
fn no_frames_and_no_ball_are_no_match() {
    assert_eq!(told(&[]), vec![]);
    let frames: Vec<Frame> =
        crossing().into_iter().map(|frame| Frame { ball: None, ..frame }).collect();
    let analysis = analyze(&frames, &Rules::default());
    assert_eq!((analysis.events.len(), analysis.episodes.len()), (0, 0));
}

/// A ball that goes over a cup on a chord, 0.25 s inside, and one that stays.
#[test]
fn only_what_stays_in_is_a_goal() {
    let over = |speed: f64, stays: bool| -> Vec<Frame> {
        (0..240)
            .map(|k| {
                let time = f64::from(k) / RATE;
                let along = -0.1 + speed * time;
                let shake = 2e-4 * f64::from((k * 5) % 7 - 3);
                let x = if stays { along.min(0.002) } else { along.min(0.14) };
                Frame { time, ball: Some([x + shake, 0.17 - shake]), ..Frame::default() }
            })
            .collect()
    };
    let kinds = |frames: &[Frame]| told(frames).iter().map(|e| e.kind).collect::<Vec<_>>();
    assert_eq!(kinds(&over(0.15, false))[..1], [EventKind::RimOut]);
    assert!(!kinds(&over(0.15, false)).contains(&EventKind::Goal));
    let goal = told(&over(0.15, true));
    assert_eq!(goal.iter().map(|e| e.kind).collect::<Vec<_>>(), [EventKind::Goal]);
    // The edge is crossed at x = -0.01905, 0.53967 s after the start.
    assert!((goal[0].time - 0.53967).abs() < 1.0 / RATE, "{:?}", goal[0]);
}

/// The detector holds the ball's last place for two seconds: it is neither lost nor at rest for long.
#[test]
fn a_detector_that_hangs_does_not_end_the_episode() {
    let mut frames = crossing();
    let held = frames[40].ball;
    for (k, frame) in frames.iter_mut().enumerate().skip(41) {
        frame.time += 2.0;
        frame.strikers[0] = Some([0.1, -0.1 + 1e-4 * (k % 3) as f64]);
    }
    let hung = (1..240).map(|k| Frame {
        time: 40.0 / RATE + f64::from(k) / RATE,
        ball: held,
        strikers: [Some([0.1, -0.1 - 1e-4 * f64::from(k % 5)]), None],
        ..Frame::default()
    });
    frames.extend(hung);
    says_nothing(&frames);
}
