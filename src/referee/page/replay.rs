//! Replay of the matches: board, controls and data.

use crate::{
    board::{BALL_RADIUS, CUP_DISTANCE, CUP_RADIUS, STRIKER_RADIUS},
    recording::topic::Player,
    referee::{Event, Frame, MatchAnalysis, ScoredMatch},
    report::escape,
};
use serde::Serialize;

const STYLE: &str = include_str!("replay.css");
const SCRIPT: &str = include_str!("replay.js");

/// Most frames on the page; longer matches are decimated.
const FRAMES: usize = 40_000;
/// Highest frame rate on the page (Hz).
const RATE: f64 = 60.0;

#[derive(Serialize)]
struct Data<'a> {
    /// Short and long side (m).
    board: [f64; 2],
    /// Distance from the middle and radius (m).
    cup: [f64; 2],
    /// Of ball and striker (m).
    radii: [f64; 2],
    matches: Vec<Match<'a>>,
}

#[derive(Serialize)]
struct Match<'a> {
    name: String,
    duration: f64,
    /// Times of the frames (ms).
    t: Vec<u64>,
    /// x and y by turns (0.1 mm).
    ball: Vec<Option<i32>>,
    left: Vec<Option<i32>>,
    right: Vec<Option<i32>>,
    episodes: Vec<EpisodeMark>,
    events: Vec<EventMark<'a>>,
}

#[derive(Serialize)]
struct EpisodeMark {
    start: f64,
    end: f64,
    scorer: Option<Player>,
}

#[derive(Serialize)]
struct EventMark<'a> {
    t: f64,
    kind: &'a str,
    player: Option<Player>,
    x: f64,
    y: f64,
    speed_out: f64,
    goal_directed: bool,
}

/// Markup of the replay with its script and data; `matches` holds at least one.
pub(super) fn replay(matches: &[ScoredMatch]) -> String {
    let frames: usize = matches.iter().map(|scored| scored.analysis.track.len()).sum();
    let budget = frames.div_ceil(FRAMES).max(1);
    let board = matches.first().map(|scored| scored.rules.board).unwrap_or_default();
    let data = Data {
        board: [board.short_side, board.long_side],
        cup: [CUP_DISTANCE, CUP_RADIUS],
        radii: [BALL_RADIUS, STRIKER_RADIUS],
        matches: matches.iter().map(|scored| replayed(scored, budget)).collect(),
    };
    let options: String = data
        .matches
        .iter()
        .enumerate()
        .map(|(idx, one)| format!("<option value=\"{idx}\">{}</option>", escape(&one.name)))
        .collect();
    // No character of the data can end the script.
    let json = serde_json::to_string(&data).unwrap_or_default().replace('<', "\\u003c");
    format!(
        "<style>{STYLE}</style>\n<div class=\"replay\" id=\"replay\">\n\
         <div class=\"bar\"><label>match <select id=\"replay-match\">{options}</select></label>\n\
         <label>events <select id=\"replay-kind\"><option value=\"all\">all</option>\
         <option value=\"touches\">touches</option><option value=\"strike\">strikes</option>\
         <option value=\"block\">blocks</option><option value=\"goal\">goals</option>\
         <option value=\"wall_bounce\">wall bounces</option></select></label></div>\n\
         <div class=\"score\" id=\"replay-score\"></div>\n\
         <div class=\"stage\"><canvas class=\"board\" id=\"replay-board\"></canvas>\
         <div class=\"events\" id=\"replay-events\"></div></div>\n\
         <div class=\"bar\"><button type=\"button\" id=\"replay-play\">play</button>\
         <button type=\"button\" id=\"replay-back\">previous event</button>\
         <button type=\"button\" id=\"replay-next\">next event</button>\
         <label>speed <select id=\"replay-speed\"><option value=\"0.1\">0.1</option>\
         <option value=\"0.25\">0.25</option><option value=\"1\" selected>1</option>\
         <option value=\"4\">4</option></select></label>\
         <input type=\"range\" id=\"replay-scrub\" min=\"0\" max=\"1\" step=\"any\" value=\"0\" \
         aria-label=\"time\"><output id=\"replay-time\"></output></div>\n\
         <canvas id=\"replay-timeline\" style=\"height:56px\"></canvas>\n</div>\n\
         <script type=\"application/json\" id=\"replay-data\">{json}</script>\n\
         <script>{SCRIPT}</script>"
    )
}

fn replayed(scored: &ScoredMatch, budget: usize) -> Match<'_> {
    let analysis = &scored.analysis;
    let start = analysis.track.first().map_or(0.0, |frame| frame.time);
    let kept: Vec<&Frame> = analysis.track.iter().step_by(step(analysis).max(budget)).collect();
    let track = |of: &dyn Fn(&Frame) -> Option<[f64; 2]>| {
        let places = kept.iter().map(|frame| of(frame));
        let tenths = |metres: f64| (metres * 1e4).round() as i32;
        places.flat_map(|place| [0, 1].map(|axis| place.map(|place| tenths(place[axis])))).collect()
    };
    Match {
        name: scored.path.display().to_string(),
        duration: rounded(analysis.duration()),
        t: kept.iter().map(|frame| (1e3 * (frame.time - start)).round().max(0.0) as u64).collect(),
        ball: track(&|frame| frame.ball),
        left: track(&|frame| frame.strikers[0]),
        right: track(&|frame| frame.strikers[1]),
        episodes: analysis
            .episodes
            .iter()
            .map(|episode| EpisodeMark {
                start: rounded(episode.span.start - start),
                end: rounded(episode.span.end - start),
                scorer: episode.span.scorer,
            })
            .collect(),
        events: analysis.events.iter().map(|event| mark(event, start)).collect(),
    }
}

/// Decimation of the frames.
fn step(analysis: &MatchAnalysis) -> usize {
    let rate = analysis.track.len() as f64 / analysis.duration().max(f64::MIN_POSITIVE);
    (rate / RATE).round().max(1.0) as usize
}

fn mark(event: &Event, start: f64) -> EventMark<'static> {
    EventMark {
        t: rounded(event.time - start),
        kind: event.kind.name(),
        player: event.player,
        x: rounded(event.position[0]),
        y: rounded(event.position[1]),
        speed_out: rounded(event.speed_out()),
        goal_directed: event.goal_directed,
    }
}

/// To four decimals: 0.1 ms, 0.1 mm.
fn rounded(value: f64) -> f64 {
    (value * 1e4).round() / 1e4
}
