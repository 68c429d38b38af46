//! `index.html`: the score, what it is made of, and the matches themselves.

mod maps;
mod replay;

use super::{
    DEFINITIONS,
    compare::{Comparison, Difference},
    document::Score,
    frames::Source,
    matches::ScoredMatch,
    metric::{Figure, Metric},
};
use crate::{
    provenance::Provenance,
    recording::topic::Player,
    report::{Axis, Curve, LinePlot, Page, Scale, Stroke, Table, escape, line_plot},
};

/// Width of a bar of the histogram of speeds (m/s), and where it ends.
const SPEED_BIN: f64 = 0.05;
const FASTEST: f64 = 2.0;
const INK: [u8; 3] = [29, 39, 51];

/// The page of `matches`, in the order of `score`; `lost` are the files that could not be judged.
#[must_use]
pub fn page(
    matches: &[ScoredMatch],
    score: &Score,
    lost: &[String],
    provenance: &Provenance,
) -> String {
    let mut page = Page::new("Score of the matches");
    page.lead(&lead(matches));
    for sentence in lost {
        page.warning(&format!("Not judged: {sentence}."));
    }
    doubts(&mut page, matches);
    if let Some(comparison) = &score.comparison {
        compared(&mut page, comparison);
    }
    summary(&mut page, score);
    if !matches.is_empty() {
        page.section("Replay");
        page.paragraph(
            "The timeline shows episodes as bands that end in the colour of who scored, and events \
             as marks: the left player's above the middle, the right player's below. A click on it, \
             or on an event, goes there.",
        );
        page.widget(&replay::replay(matches));
        maps_and_speeds(&mut page, matches);
    }
    per_match(&mut page, matches, score);
    definitions(&mut page);
    page.section("How it was made");
    page.code(&provenance.command_line);
    page.paragraph(&format!(
        "klasktron {}, commit {}.",
        provenance.crate_version, provenance.git_hash
    ));
    page.finish()
}

fn count(number: usize, noun: &str) -> String {
    if number == 1 { format!("1 {noun}") } else { format!("{number} {noun}s") }
}

fn lead(matches: &[ScoredMatch]) -> String {
    let play: f64 = matches.iter().map(|scored| scored.analysis.play()).sum();
    let points = matches.iter().map(|scored| scored.analysis.points());
    let [left, right] = points.fold([0, 0], |sum, [l, r]| [sum[0] + l, sum[1] + r]);
    let episodes = matches.iter().map(|scored| scored.analysis.episodes.len()).sum();
    format!(
        "{}, {}, {:.1} min of play: {left} points for the left player, {right} for the right.",
        matches_of(matches.len()),
        count(episodes, "episode"),
        play / 60.0
    )
}

fn matches_of(number: usize) -> String {
    if number == 1 { "1 match".to_owned() } else { format!("{number} matches") }
}

fn doubts(page: &mut Page, matches: &[ScoredMatch]) {
    for scored in matches {
        let file = scored.path.display();
        if !scored.loss.is_none() {
            page.warning(&format!("{file} is damaged ({}); the rest was judged.", scored.loss));
        }
        if scored.source == Source::BoardState {
            page.warning(&format!(
                "{file} holds no detections of the camera: it was judged by the filtered state of \
                 the board, whose lag smears and delays contacts."
            ));
        }
    }
}

/// `12.3 (10.1 to 14.5)`.
fn figure(figure: &Figure) -> String {
    match (figure.mean, figure.ci95) {
        (Some(mean), Some([low, high])) => format!("{mean:.3} ({low:.3} to {high:.3})"),
        (Some(mean), None) => format!("{mean:.3}"),
        (None, _) => "-".to_owned(),
    }
}

fn words(texts: &[&str]) -> Vec<String> {
    texts.iter().map(|text| (*text).to_owned()).collect()
}

fn summary(page: &mut Page, score: &Score) {
    page.section("Score");
    page.paragraph(
        "95 % intervals by bootstrap over episodes. The paper's column is table I, ten games of a \
         human against the robot; its possession and win rate are the robot's, and its definitions of \
         block, strike and possession are not given, so they may differ from ours.",
    );
    let rows = Metric::ALL.into_iter().map(|metric| {
        let found = &score.summary[metric.name()];
        let paper = metric.in_paper().map_or_else(|| "-".to_owned(), |value| value.to_string());
        vec![metric.title().to_owned(), figure(found), found.n.to_string(), paper]
    });
    page.table(&Table {
        head: words(&["figure", "mean (95 %)", "episodes", "paper"]),
        rows: rows.collect(),
    });
}

fn compared(page: &mut Page, comparison: &Comparison) {
    let [a, b] = &comparison.groups;
    page.section(&format!("{b} against {a}"));
    let mut sentence = comparison.summary.clone();
    sentence.push('.');
    page.lead(&sentence);
    page.paragraph(&format!(
        "{a}: {}, {}. {b}: {}, {}. Difference is {b} minus {a}, with its 95 % interval by bootstrap \
         over episodes; p by permutation of episodes, corrected for the number of figures (Holm). \
         Episodes of one match are taken for independent.",
        matches_of(comparison.matches[0]),
        count(comparison.episodes[0], "episode"),
        matches_of(comparison.matches[1]),
        count(comparison.episodes[1], "episode"),
    ));
    let title = |name: &str| {
        Metric::ALL.into_iter().find(|metric| metric.name() == name).map_or("", Metric::title)
    };
    let row = |difference: &Difference| {
        let p = difference.p_value_corrected.map_or_else(|| "-".to_owned(), |p| format!("{p:.4}"));
        let own = Figure { mean: difference.difference, ci95: difference.ci95, n: 0 };
        vec![
            title(difference.metric).to_owned(),
            figure(&difference.a),
            figure(&difference.b),
            figure(&own),
            p,
        ]
    };
    page.table(&Table {
        head: vec![
            "figure".to_owned(),
            a.clone(),
            b.clone(),
            "difference (95 %)".to_owned(),
            "p, corrected".to_owned(),
        ],
        rows: comparison.metrics.iter().map(row).collect(),
    });
}

fn maps_and_speeds(page: &mut Page, matches: &[ScoredMatch]) {
    let board = matches.first().map(|scored| scored.rules.board).unwrap_or_default();
    page.section("Where");
    page.paragraph(
        "The left player plays from the left. Strikes are lines from the contact along the ball's way, \
         as long as it moves in 0.05 s; thick ones are goal-directed. Rings are blocks, crosses goals. \
         Darker is longer.",
    );
    page.legend(&[("left", [31, 105, 180]), ("right", [208, 112, 24]), ("goals", [176, 48, 48])]);
    let striker = |player: Player| {
        maps::heat(matches, board, &format!("{player} striker"), &move |frame| {
            frame.strikers[player as usize]
        })
    };
    page.pictures_in_row(&[
        maps::shot_map(matches, board),
        maps::heat(matches, board, "ball", &|frame| frame.ball),
        striker(Player::Left),
        striker(Player::Right),
    ]);
    page.section("Speed of the ball in play");
    page.picture(&speed_histogram(matches));
}

fn speed_histogram(matches: &[ScoredMatch]) -> String {
    let bins = (FASTEST / SPEED_BIN) as usize;
    let mut counts = vec![0_usize; bins];
    let speeds = matches.iter().flat_map(|scored| &scored.analysis.speeds);
    let mut total = 0_usize;
    for speed in speeds {
        counts[((speed / SPEED_BIN) as usize).min(bins - 1)] += 1;
        total += 1;
    }
    let share = |count: usize| 100.0 * count as f64 / total.max(1) as f64;
    let points = counts.iter().enumerate().flat_map(|(bin, count)| {
        let left = bin as f64 * SPEED_BIN;
        [(left, share(*count)), (left + SPEED_BIN, share(*count))]
    });
    line_plot(&LinePlot {
        title: String::new(),
        x: "speed (m/s); the last bin holds all above".to_owned(),
        y: Axis { label: "share of play (%)".to_owned(), scale: Scale::Linear },
        bands: vec![],
        curves: vec![Curve { colour: INK, stroke: Stroke::Solid, points: points.collect() }],
        size: (980, 280),
    })
}

fn per_match(page: &mut Page, matches: &[ScoredMatch], score: &Score) {
    page.section("Matches");
    let rows = matches.iter().zip(&score.matches).map(|(scored, own)| {
        let [left, right] = scored.analysis.points();
        let sum = |of: &dyn Fn(&super::document::EpisodeScore) -> usize| {
            own.episodes.iter().map(of).sum::<usize>().to_string()
        };
        vec![
            own.file.clone(),
            own.winner.map_or_else(|| "-".to_owned(), |player| player.to_string()),
            format!("{left} : {right}"),
            format!("{:.1}", own.duration_s),
            own.episodes.len().to_string(),
            sum(&|episode| episode.blocks_left + episode.blocks_right),
            sum(&|episode| episode.strikes_left + episode.strikes_right),
            sum(&|episode| episode.goal_directed_left + episode.goal_directed_right),
            format!("{:.2}", 1e3 * scored.analysis.noise),
        ]
    });
    page.table(&Table {
        head: words(&[
            "file",
            "winner",
            "left : right",
            "seconds",
            "episodes",
            "blocks",
            "strikes",
            "goal-directed",
            "noise (mm)",
        ]),
        rows: rows.collect(),
    });
}

fn definitions(page: &mut Page) {
    page.section("What the words mean");
    let figures: String = DEFINITIONS
        .iter()
        .map(|definition| {
            format!(
                "<figure>{}<figcaption><b>{}.</b> {}</figcaption></figure>",
                definition.picture,
                escape(definition.word),
                escape(definition.sentence)
            )
        })
        .collect();
    page.widget(&format!("<div class=\"definitions\">{figures}</div>"));
}
