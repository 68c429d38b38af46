//! Analysis of a match: from its frames to events and episodes.

use super::{
    episodes::{self, Span},
    event::{Event, EventKind},
    frames::Frame,
    impacts::{self, Impact},
    rolls::{self, Sample},
    rules::Rules,
    sight::{self, Sight},
    touches,
    vector::distance,
};
use crate::{recording::topic::Player, stats};

/// Range of the camera's noise (m): pixel size, and a value that no camera exceeds.
const NOISE: (f64, f64) = (1e-4, 2e-3);
/// Ratio of the standard deviation of second differences to that of independent noise.
const SECOND_DIFFERENCE: f64 = 2.449_489_742_783_178;
const MEDIAN_SIZE: f64 = 0.674_489_750_196_082;

/// One episode with its statistics.
#[derive(Debug, Clone, PartialEq)]
pub struct Episode {
    /// Start, end and outcome.
    pub span: Span,
    /// Numbers of blocks, by left and right player.
    pub blocks: [usize; 2],
    /// Numbers of strikes.
    pub strikes: [usize; 2],
    /// Numbers of goal-directed strikes.
    pub goal_directed: [usize; 2],
    /// Time for which each player was the last to touch the ball (s).
    pub held: [f64; 2],
    /// Mean speed of the ball while it was detected (m/s); `None` without detections.
    pub mean_speed: Option<f64>,
    /// 99th percentile of that speed (m/s).
    pub top_speed: Option<f64>,
}

impl Episode {
    /// Duration (s).
    #[must_use]
    pub fn duration(&self) -> f64 {
        self.span.end - self.span.start
    }

    /// Number of blocks and strikes of both players.
    #[must_use]
    pub fn contacts(&self) -> usize {
        self.blocks.iter().chain(&self.strikes).sum()
    }

    /// Possession of `player`: fraction of the time since the first touch in which the player was
    /// the last to touch the ball; `None` without a touch.
    #[must_use]
    pub fn possession(&self, player: Player) -> Option<f64> {
        let total = self.held[0] + self.held[1];
        (0.0 < total).then(|| self.held[player as usize] / total)
    }
}

/// Analysis of one match.
#[derive(Debug, Clone, Default)]
pub struct MatchAnalysis {
    /// Events in order of time.
    pub events: Vec<Event>,
    /// Episodes in order of time.
    pub episodes: Vec<Episode>,
    /// Frames with accepted ball positions, for pictures and replay.
    pub track: Vec<Frame>,
    /// Speed of the ball in play (m/s), one value per frame.
    pub speeds: Vec<f64>,
    /// Standard deviation of one coordinate, estimated from the track (m).
    pub noise: f64,
}

/// Analyze a match.
///
/// ```
/// use klasktron::referee::{Frame, Outcome, Rules, analyze};
/// // A ball that rolls into the cup of the right player and stays there.
/// let frames: Vec<Frame> = (0..240)
///     .map(|k| {
///         let time = f64::from(k) / 120.0;
///         Frame { time, ball: Some([0.0, (0.3 * time).min(0.17)]), ..Frame::default() }
///     })
///     .collect();
/// let analysis = analyze(&frames, &Rules::default());
/// assert_eq!(analysis.episodes[0].span.outcome, Outcome::Goal);
/// ```
#[must_use]
pub fn analyze(frames: &[Frame], rules: &Rules) -> MatchAnalysis {
    let sights = sight::believe(frames, rules);
    let samples: Vec<Sample> = sights.iter().filter_map(sample).collect();
    let noise = noise_of(&samples);
    let stretches = rolls::divide(&samples, noise, rules);
    let impacts: Vec<Impact> =
        stretches.iter().flat_map(|stretch| impacts::find(stretch, noise, rules)).collect();
    let (spans, mut events) = episodes::spans(&sights, &stretches, rules);
    let touched = touches::touches_and_bounces(&impacts, &sights, rules);
    events.extend(touched.into_iter().filter_map(|event| in_play(event, &spans)));
    events.sort_by(|a, b| a.time.total_cmp(&b.time));
    let speeds: Vec<(f64, f64)> = speeds_of(&samples, rules);
    let episodes = spans.iter().enumerate().map(|(idx, span)| {
        episode(*span, events.iter().filter(|event| event.episode == idx), &speeds)
    });
    MatchAnalysis {
        episodes: episodes.collect(),
        track: track(&sights, &stretches),
        speeds: spans.iter().flat_map(|span| within(&speeds, span)).map(|(_, v)| *v).collect(),
        events,
        noise,
    }
}

fn sample(sight: &Sight) -> Option<Sample> {
    let position = sight.ball?;
    Some(Sample { time: sight.time, position, strikers: sight.strikers })
}

/// Noise from second differences: their standard deviation is sqrt 6 times that of independent
/// noise.
fn noise_of(samples: &[Sample]) -> f64 {
    let bends: Vec<f64> = samples
        .windows(3)
        .flat_map(|w| [0, 1].map(|k| w[2].position[k] - 2.0 * w[1].position[k] + w[0].position[k]))
        .map(f64::abs)
        .collect();
    let noise = stats::median(&bends).unwrap_or(0.0) / (MEDIAN_SIZE * SECOND_DIFFERENCE);
    noise.clamp(NOISE.0, NOISE.1)
}

/// Assign `event` to its episode; `None` outside play.
fn in_play(event: Event, spans: &[Span]) -> Option<Event> {
    let episode = spans.partition_point(|span| span.end < event.time);
    let span = spans.get(episode)?;
    (span.start <= event.time).then_some(Event { episode, ..event })
}

/// Times and speeds of the ball over five frames.
fn speeds_of(samples: &[Sample], rules: &Rules) -> Vec<(f64, f64)> {
    samples
        .windows(5)
        .filter_map(|w| {
            let (first, last) = (w[0], w[4]);
            let span = last.time - first.time;
            (0.0 < span && span < rules.longest_gap)
                .then(|| (w[2].time, distance(first.position, last.position) / span))
        })
        .collect()
}

/// Those of `speeds` in `span`.
fn within<'a>(speeds: &'a [(f64, f64)], span: &Span) -> &'a [(f64, f64)] {
    let from = speeds.partition_point(|(time, _)| *time < span.start);
    let to = speeds.partition_point(|(time, _)| *time <= span.end);
    &speeds[from..to.max(from)]
}

fn episode<'a>(
    span: Span,
    events: impl Iterator<Item = &'a Event>,
    speeds: &[(f64, f64)],
) -> Episode {
    let mut episode = Episode {
        span,
        blocks: [0; 2],
        strikes: [0; 2],
        goal_directed: [0; 2],
        held: [0.0; 2],
        mean_speed: None,
        top_speed: None,
    };
    let mut holder: Option<(usize, f64)> = None;
    for event in events.filter(|event| event.kind.is_touch()) {
        let Some(player) = event.player.map(|player| player as usize) else { continue };
        match event.kind {
            EventKind::Block => episode.blocks[player] += 1,
            EventKind::Strike => episode.strikes[player] += 1,
            _ => {}
        }
        episode.goal_directed[player] += usize::from(event.goal_directed);
        if let Some((before, since)) = holder.replace((player, event.time)) {
            episode.held[before] += event.time - since;
        }
    }
    if let Some((player, since)) = holder {
        episode.held[player] += span.end - since;
    }
    let own: Vec<f64> = within(speeds, &span).iter().map(|(_, speed)| *speed).collect();
    episode.mean_speed = stats::mean(&own);
    episode.top_speed = stats::quantile(&own, 0.99);
    episode
}

/// Frames with accepted ball positions only.
fn track(sights: &[Sight], stretches: &[rolls::Stretch]) -> Vec<Frame> {
    let mut believed = stretches.iter().flat_map(|stretch| &stretch.samples).peekable();
    sights
        .iter()
        .map(|sight| {
            while believed.next_if(|sample| sample.time < sight.time).is_some() {}
            let ball = believed.next_if(|sample| sample.time <= sight.time);
            let ball = ball.map(|sample| sample.position);
            Frame { time: sight.time, ball, strikers: sight.strikers, biscuits: sight.biscuits }
        })
        .collect()
}

impl MatchAnalysis {
    /// Points of the left and the right player.
    #[must_use]
    pub fn points(&self) -> [usize; 2] {
        episodes::points(self.episodes.iter().map(|episode| &episode.span))
    }

    /// Player with more points; `None` for a draw.
    #[must_use]
    pub fn winner(&self) -> Option<Player> {
        let [left, right] = self.points();
        match left.cmp(&right) {
            std::cmp::Ordering::Less => Some(Player::Right),
            std::cmp::Ordering::Equal => None,
            std::cmp::Ordering::Greater => Some(Player::Left),
        }
    }

    /// Total duration of the episodes (s).
    #[must_use]
    pub fn play(&self) -> f64 {
        self.episodes.iter().map(Episode::duration).sum()
    }

    /// Duration of the recorded match (s).
    #[must_use]
    pub fn duration(&self) -> f64 {
        match (self.track.first(), self.track.last()) {
            (Some(first), Some(last)) => last.time - first.time,
            _ => 0.0,
        }
    }
}
