//! Segmentation of a match into episodes: start, end, cause of the end, restart.

use super::{
    event::{Event, EventKind},
    rolls::Stretch,
    rules::{Rules, opponent},
    sight::Sight,
    vector::{Vector, distance, dot, length, minus, plus, times},
};
use crate::{board::CUP_RADIUS, recording::topic::Player};
use serde::Serialize;

/// Distance beyond a cup's radius at which the ball has left it (m).
const OUT: f64 = 0.001;
/// Number of detections for the ball's velocity, and their maximum span (s).
const RECENT: usize = 6;
const RECENT_SPAN: f64 = 0.08;
/// Time (s) before reaching a cup, and distance from its edge (m), within which a vanishing ball
/// counts as captured.
const VANISHED_BEFORE: f64 = 0.05;
const VANISHED_NEAR: f64 = 0.008;
/// Minimum number of samples of a sighting; fewer count as false detections.
pub(super) const FEWEST: usize = 4;
/// Gap in detections after an episode, after which the ball counts as removed (s).
const AWAY: f64 = 0.25;
/// Displacement of a resting ball that counts as motion (m).
const MOVED: f64 = 0.02;
/// Smoothing factor for the position of a resting ball, per detection.
const FOLLOWING: f64 = 0.03;
/// Minimum fraction of a gap without any detection for a lost ball.
const SILENT: f64 = 0.5;

/// End of an episode.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// The ball is in a cup.
    Goal,
    /// Own goal: a striker is in its own cup.
    StrikerInGoal,
    /// Two biscuits are on one striker.
    TwoBiscuits,
    /// The ball has left the board.
    BallLost,
    /// The ball was at rest for too long.
    Timeout,
    /// The recording ended first.
    Unfinished,
}

impl Outcome {
    /// Name in documents.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Goal => "goal",
            Self::StrikerInGoal => "striker_in_goal",
            Self::TwoBiscuits => "two_biscuits",
            Self::BallLost => "ball_lost",
            Self::Timeout => "timeout",
            Self::Unfinished => "unfinished",
        }
    }
}

/// An episode.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Span {
    /// Start time since the recording began (s).
    pub start: f64,
    /// End time since the recording began (s).
    pub end: f64,
    /// End of the episode.
    pub outcome: Outcome,
    /// Player who got the point; `None` without a point.
    pub scorer: Option<Player>,
}

/// Points of the left and the right player in `episodes`.
pub(super) fn points<'a>(episodes: impl IntoIterator<Item = &'a Span>) -> [usize; 2] {
    let mut points = [0; 2];
    for scorer in episodes.into_iter().filter_map(|own| own.scorer) {
        points[scorer as usize] += 1;
    }
    points
}

/// One instant of the ball's track.
#[derive(Debug, Clone, Copy)]
pub(super) struct Moment {
    time: f64,
    ball: Option<Vector>,
    strikers: [Option<Vector>; 2],
    biscuits: [Option<Vector>; 3],
    said: bool,
}

impl Moment {
    /// The instant of `sight`, with the `ball` if it is believed.
    pub(super) fn new(sight: &Sight, ball: Option<Vector>) -> Self {
        let Sight { time, strikers, biscuits, said, .. } = *sight;
        Self { time, ball, strikers, biscuits, said }
    }
}

/// State of play.
enum Play {
    /// Before the first episode.
    Waiting,
    On {
        start: f64,
    },
    /// After an episode, with the absence of the ball since its end and its position then.
    Off {
        away: bool,
        ball: Option<Vector>,
    },
}

/// Episodes, and the events of their starts and ends (with rim-outs).
pub(super) fn spans(
    sights: &[Sight],
    stretches: &[Stretch],
    rules: &Rules,
) -> (Vec<Span>, Vec<Event>) {
    let mut umpire = Umpire::new(*rules);
    for moment in moments(sights, stretches) {
        umpire.look(&moment);
    }
    umpire.finish()
}

/// Instants of the match, with the ball only where a sighting has enough detections.
fn moments(sights: &[Sight], stretches: &[Stretch]) -> impl Iterator<Item = Moment> {
    let mut believed = stretches
        .iter()
        .filter(|stretch| FEWEST <= stretch.samples.len())
        .flat_map(|stretch| stretch.samples.iter())
        .peekable();
    sights.iter().map(move |sight| {
        while believed.next_if(|sample| sample.time < sight.time).is_some() {}
        let ball =
            believed.next_if(|sample| sample.time <= sight.time).map(|sample| sample.position);
        Moment::new(sight, ball)
    })
}

/// State of the segmentation from frame to frame.
pub(super) struct Umpire {
    rules: Rules,
    play: Play,
    spans: Vec<Span>,
    events: Vec<Event>,
    /// Last detections of the ball, oldest first.
    recent: Vec<(f64, Vector)>,
    now: f64,
    /// Time without any detection since the last instant with a ball (s).
    silent: f64,
    /// Owner of the cup that the ball is in, and the time of entry.
    inside: Option<(Player, f64)>,
    /// Time at which each striker entered its own cup, and time of its last detection there.
    striker_inside: [Option<f64>; 2],
    /// When each striker got its second biscuit, and when both were last seen.
    biscuits_on: [Option<[f64; 2]>; 2],
    /// Position and time at which the ball came to rest.
    still: Option<(Vector, f64)>,
}

impl Umpire {
    pub(super) fn new(rules: Rules) -> Self {
        Self {
            rules,
            play: Play::Waiting,
            spans: Vec::new(),
            events: Vec::new(),
            recent: Vec::with_capacity(RECENT + 1),
            now: 0.0,
            silent: 0.0,
            inside: None,
            striker_inside: [None; 2],
            biscuits_on: [None; 2],
            still: None,
        }
    }

    /// Episodes that have ended so far.
    pub(super) fn ended(&self) -> &[Span] {
        &self.spans
    }

    pub(super) fn look(&mut self, moment: &Moment) {
        if !moment.said {
            self.silent += moment.time - self.now;
        }
        self.now = moment.time;
        self.watch_strikers(moment);
        self.watch_biscuits(moment);
        match moment.ball {
            Some(ball) => {
                self.watch_pause(moment.time);
                self.watch_cups(moment.time, ball);
                self.watch_rest(moment.time, ball);
                self.watch_restart(moment.time, ball);
                self.remember(moment.time, ball);
                self.silent = 0.0;
            }
            None => self.watch_pause(moment.time),
        }
    }

    fn remember(&mut self, time: f64, ball: Vector) {
        self.recent.retain(|(before, _)| time - before < RECENT_SPAN);
        if RECENT <= self.recent.len() {
            self.recent.remove(0);
        }
        self.recent.push((time, ball));
    }

    fn last(&self) -> Option<(f64, Vector)> {
        self.recent.last().copied()
    }

    /// Velocity of the ball over its last detections (m/s).
    fn velocity(&self) -> Vector {
        match (self.recent.first(), self.recent.last()) {
            (Some((from, a)), Some((to, b))) if from < to => {
                times(minus(*b, *a), 1.0 / (to - from))
            }
            _ => [0.0; 2],
        }
    }

    fn is_on(&self) -> bool {
        matches!(self.play, Play::On { .. })
    }

    /// Return whether play was on at `time`. A striker that entered its cup later, but is known
    /// earlier, does not count.
    fn was_on_at(&mut self, time: f64) -> bool {
        if self.is_on() {
            return true;
        }
        let hasty = self.spans.last().filter(|span| {
            span.outcome == Outcome::StrikerInGoal && span.start < time && time < span.end
        });
        let Some(start) = hasty.map(|span| span.start) else { return false };
        self.spans.pop();
        self.events.retain(|event| event.kind != EventKind::StrikerInGoal || event.time < start);
        self.play = Play::On { start };
        true
    }

    fn event(&mut self, time: f64, kind: EventKind, player: Option<Player>, confidence: f64) {
        let event = Event {
            time,
            kind,
            player,
            episode: self.spans.len(),
            position: self.last().map_or([0.0; 2], |(_, position)| position),
            velocity_in: self.velocity(),
            velocity_out: if kind == EventKind::RimOut { self.velocity() } else { [0.0; 2] },
            goal_directed: false,
            confidence,
        };
        self.events.push(event);
    }

    /// End the episode at `time`.
    fn end(&mut self, time: f64, outcome: Outcome, scorer: Option<Player>) {
        let Play::On { start } = self.play else { return };
        self.spans.push(Span { start, end: time.max(start), outcome, scorer });
        let in_cup = self.inside.is_some() || outcome == Outcome::BallLost;
        self.play = Play::Off { away: in_cup, ball: self.last().map(|(_, position)| position) };
        self.still = None;
    }

    /// Process a gap in the detections of the ball, up to `time`.
    fn watch_pause(&mut self, time: f64) {
        let Some((seen, position)) = self.last() else { return };
        let pause = time - seen;
        if let Play::Off { away, .. } = &mut self.play {
            *away |= AWAY <= pause;
        }
        if let Some((owner, since)) = self.inside {
            // A ball in a cup is often not detected.
            let stays = self.rules.goal_stay <= (time - since).min(pause);
            if stays && self.was_on_at(since) {
                self.goal(owner, since, 0.9);
            }
        } else if self.rules.lost_after <= pause
            && SILENT * pause <= self.silent
            && self.was_on_at(seen)
        {
            if let Some((owner, after)) = self.would_enter(position) {
                self.inside = Some((owner, seen + after));
                self.goal(owner, seen + after, 0.8);
                return;
            }
            self.event(seen, EventKind::BallLost, None, 1.0);
            self.end(seen, Outcome::BallLost, None);
        }
    }

    fn goal(&mut self, owner: Player, since: f64, confidence: f64) {
        self.event(since, EventKind::Goal, Some(owner), confidence);
        self.end(since, Outcome::Goal, Some(opponent(owner)));
    }

    fn watch_cups(&mut self, time: f64, ball: Vector) {
        if let Some((owner, since)) = self.inside {
            let away = CUP_RADIUS + OUT < distance(ball, self.rules.cup(owner));
            if away {
                self.inside = None;
                if self.is_on() {
                    self.event(time, EventKind::RimOut, Some(owner), 1.0);
                }
            } else if self.rules.goal_stay <= time - since && self.was_on_at(since) {
                self.goal(owner, since, 1.0);
            }
        }
        if self.inside.is_none()
            && let Some(owner) = self.rules.cup_at(ball)
        {
            self.inside = Some((owner, self.entered(time, ball, owner)));
        }
    }

    /// Owner of the cup that the ball would have reached soon after its last detection at
    /// `position`, and the time until then (s).
    fn would_enter(&self, position: Vector) -> Option<(Player, f64)> {
        let velocity = self.velocity();
        Player::BOTH.into_iter().find_map(|owner| {
            let way = minus(self.rules.cup(owner), position);
            if length(way) < CUP_RADIUS + VANISHED_NEAR {
                return Some((owner, 0.0));
            }
            let (speed, along) = (length(velocity), dot(way, velocity));
            let nearest = if 0.0 < speed { along / (speed * speed) } else { 0.0 };
            let miss = distance(times(velocity, nearest), way);
            if CUP_RADIUS <= miss || along < 0.0 {
                return None;
            }
            let half_chord = (CUP_RADIUS * CUP_RADIUS - miss * miss).sqrt();
            let wait = nearest - half_chord / speed.max(f64::MIN_POSITIVE);
            (wait <= VANISHED_BEFORE).then_some((owner, wait.max(0.0)))
        })
    }

    /// Time at which the ball crossed the cup's edge, by linear interpolation from the previous
    /// detection.
    fn entered(&self, time: f64, ball: Vector, owner: Player) -> f64 {
        let Some((before, from)) = self.last() else { return time };
        let cup = self.rules.cup(owner);
        let (outside, inside) = (distance(from, cup), distance(ball, cup));
        if time - before < self.rules.longest_gap && CUP_RADIUS < outside {
            time - (time - before) * (CUP_RADIUS - inside) / (outside - inside)
        } else {
            time
        }
    }

    fn watch_strikers(&mut self, moment: &Moment) {
        for player in Player::BOTH {
            let Some(position) = moment.strikers[player as usize] else { continue };
            let inside = distance(position, self.rules.cup(player)) < CUP_RADIUS;
            let since = &mut self.striker_inside[player as usize];
            if !inside {
                *since = None;
                continue;
            }
            let since = *since.get_or_insert(moment.time);
            if self.rules.striker_stay <= moment.time - since && self.is_on() {
                self.event(since, EventKind::StrikerInGoal, Some(player), 1.0);
                if let Some(event) = self.events.last_mut() {
                    event.position = position;
                }
                self.end(since, Outcome::StrikerInGoal, Some(opponent(player)));
            }
        }
    }

    fn watch_biscuits(&mut self, moment: &Moment) {
        for player in Player::BOTH {
            let Some(striker) = moment.strikers[player as usize] else { continue };
            let seen = moment.biscuits.iter().flatten();
            let on = seen.filter(|at| distance(**at, striker) <= self.rules.biscuit_within);
            let both = &mut self.biscuits_on[player as usize];
            if on.count() < 2 {
                // A detection may be missing for a few frames.
                *both = both.filter(|[_, last]| moment.time - last < self.rules.longest_gap);
                continue;
            }
            let since = both.map_or(moment.time, |[since, _]| since);
            *both = Some([since, moment.time]);
            if self.rules.biscuit_stay <= moment.time - since && self.is_on() {
                self.event(since, EventKind::TwoBiscuits, Some(player), 1.0);
                if let Some(event) = self.events.last_mut() {
                    event.position = striker;
                }
                self.end(since, Outcome::TwoBiscuits, Some(opponent(player)));
            }
        }
    }

    fn watch_rest(&mut self, time: f64, ball: Vector) {
        let (position, since) = self.still.unwrap_or((ball, time));
        if self.rules.still_within < distance(ball, position) {
            self.still = Some((ball, time));
            return;
        }
        // Slow smoothing, so that noise at the threshold does not matter.
        self.still = Some((plus(position, times(minus(ball, position), FOLLOWING)), since));
        if self.rules.timeout_after <= time - since && self.is_on() && self.inside.is_none() {
            let end = since + self.rules.timeout_after;
            self.event(end, EventKind::Timeout, None, 1.0);
            self.end(end, Outcome::Timeout, None);
        }
    }

    fn watch_restart(&mut self, time: f64, ball: Vector) {
        let open = self.inside.is_none()
            && self.striker_inside.iter().all(Option::is_none)
            && self.biscuits_on.iter().all(Option::is_none);
        match self.play {
            Play::Waiting if open => self.play = Play::On { start: time },
            Play::Off { away, ball: lay } if open => {
                let moved = lay.is_none_or(|lay| MOVED < distance(ball, lay));
                if away || moved {
                    self.recent.clear();
                    self.recent.push((time, ball));
                    self.play = Play::On { start: time };
                    self.still = None;
                    self.event(time, EventKind::Restart, None, 1.0);
                }
            }
            _ => {}
        }
    }

    fn finish(mut self) -> (Vec<Span>, Vec<Event>) {
        if let Some((owner, since)) = self.inside
            && self.rules.goal_stay <= self.now - since
            && self.is_on()
        {
            self.goal(owner, since, 0.9);
        }
        self.end(self.now, Outcome::Unfinished, None);
        (self.spans, self.events)
    }
}
