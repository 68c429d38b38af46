//! The referee during a match.

use super::{
    episodes::{FEWEST, Moment, Span, Umpire, points},
    frames::Frame,
    rules::Rules,
    sight::{LastStrikers, Sight},
    vector::Vector,
};

/// Referee of a match that is being played: episodes and points by the rules of
/// [`analyze`](super::analyze), frame by frame.
///
/// A ball is believed after four detections without a gap, as there; until then the frames wait. What `analyze` decides
/// with later frames is not known yet: a repeated old frame, or an outlier of the ball's track.
///
/// ```
/// use klasktron::referee::{Frame, LiveReferee, Outcome, Rules};
/// let mut referee = LiveReferee::new(Rules::default());
/// for k in 0..240 {
///     let time = f64::from(k) / 120.0;
///     let ball = Some([0.0, (0.3 * time).min(0.17)]);
///     referee.see(&Frame { time, ball, ..Frame::default() });
/// }
/// assert_eq!(referee.episodes()[0].outcome, Outcome::Goal);
/// assert_eq!(referee.points(), [1, 0]);
/// ```
pub struct LiveReferee {
    rules: Rules,
    umpire: Umpire,
    strikers: LastStrikers,
    /// Frames of a ball that is not believed yet.
    waiting: Vec<Sight>,
    /// Time of the last detection of a believed ball (s).
    believed: Option<f64>,
    /// Time of the last frame (s).
    last: f64,
}

impl LiveReferee {
    /// Referee by `rules`, before the first frame.
    #[must_use]
    pub fn new(rules: Rules) -> Self {
        Self {
            rules,
            umpire: Umpire::new(rules),
            strikers: LastStrikers::default(),
            waiting: Vec::new(),
            believed: None,
            last: f64::NEG_INFINITY,
        }
    }

    /// Take the next frame. A frame that is not later than the one before is ignored.
    pub fn see(&mut self, frame: &Frame) {
        if frame.time.is_nan() || frame.time <= self.last {
            return;
        }
        self.last = frame.time;
        let mut sight = Sight::of(frame, &self.rules);
        self.strikers.check(&mut sight, &self.rules);
        let gap = |since: f64| self.rules.longest_gap < frame.time - since;
        if self.believed.is_some_and(|seen| !gap(seen)) {
            self.believed = sight.ball.map(|_| sight.time).or(self.believed);
            self.umpire.look(&Moment::new(&sight, sight.ball));
            return;
        }
        self.believed = None;
        let newest = self.waiting.iter().rev().find_map(|own| own.ball.map(|_| own.time));
        if newest.is_some_and(gap) {
            // Too few detections for a ball.
            self.release(|_| None);
        }
        self.waiting.push(sight);
        let detections = self.waiting.iter().filter(|own| own.ball.is_some()).count();
        if FEWEST <= detections {
            self.believed = Some(sight.time);
            self.release(|own| own.ball);
        } else if detections == 0 {
            self.release(|_| None);
        }
    }

    /// Pass on the frames that waited, with the ball that `believed` tells.
    fn release(&mut self, believed: impl Fn(&Sight) -> Option<Vector>) {
        for sight in self.waiting.drain(..) {
            self.umpire.look(&Moment::new(&sight, believed(&sight)));
        }
    }

    /// Episodes that have ended, in order.
    #[must_use]
    pub fn episodes(&self) -> &[Span] {
        self.umpire.ended()
    }

    /// Points of the left and the right player.
    #[must_use]
    pub fn points(&self) -> [usize; 2] {
        points(self.episodes())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{recording::topic::Player, referee::Outcome};

    fn referee(frames: impl Iterator<Item = Frame>) -> LiveReferee {
        let mut referee = LiveReferee::new(Rules::default());
        frames.for_each(|frame| referee.see(&frame));
        referee
    }

    fn frame(k: u32, ball: Option<Vector>) -> Frame {
        Frame { time: f64::from(k) / 120.0, ball, ..Frame::default() }
    }

    #[test]
    fn a_few_detections_in_a_cup_are_no_goal() {
        let cup = Rules::default().cup(Player::Right);
        let seen = |k: u32| match k {
            0..60 => Some([0.05, 0.0]),
            100..103 => Some(cup),
            _ => None,
        };
        assert_eq!(referee((0..400).map(|k| frame(k, seen(k)))).points(), [0, 0]);
        let stays = |k: u32| if k < 60 { Some([0.05, 0.0]) } else { (k < 200).then_some(cup) };
        assert_eq!(referee((0..400).map(|k| frame(k, stays(k)))).points(), [1, 0]);
    }

    /// Two biscuits on a striker lose the point, one does not, and two for a moment do not. Missing detections of
    /// some frames do not matter.
    #[test]
    fn two_biscuits_on_one_striker_lose_the_point() {
        let play = |biscuits: &dyn Fn(u32) -> [Option<Vector>; 3]| {
            let striker = |k: u32| [1e-4 * f64::from(k), -0.1];
            let frames = (0..240).map(|k| Frame {
                strikers: [Some(striker(k)), Some([0.0, 0.1])],
                biscuits: biscuits(k).map(|own| own.map(|[x, y]| [x + striker(k)[0], y])),
                ..frame(k, Some([0.05, 5e-4 * f64::from(k)]))
            });
            referee(frames)
        };
        let on = [Some([0.014, -0.1]), Some([-0.01, -0.11]), Some([0.1, 0.0])];
        let one = [on[0], Some([-0.05, -0.1]), on[2]];
        let held = play(&|k| if k % 9 == 0 { [None; 3] } else { on });
        assert_eq!(held.points(), [0, 1]);
        assert_eq!(held.episodes()[0].outcome, Outcome::TwoBiscuits);
        assert_eq!(play(&|_| one).points(), [0, 0]);
        assert_eq!(play(&|k| if k < 50 { on } else { one }).points(), [0, 0]);
    }
}
