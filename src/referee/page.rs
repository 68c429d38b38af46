//! `index.html` of `eval`: the score, its metrics, and a replay of the matches.

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
    report::{Axis, Badge, Chart, Colour, Page, Series, Table, escape},
};

/// Width of a bin of the speed histogram, and its upper end (m/s).
const SPEED_BIN: f64 = 0.05;
const FASTEST: f64 = 2.0;

/// Page of `matches`, in the order of `score`; `lost` are the files that could not be analysed.
#[must_use]
pub fn page(
    matches: &[ScoredMatch],
    score: &Score,
    lost: &[String],
    provenance: &Provenance,
) -> String {
    let mut page = Page::new("Score of the matches");
    badge(&mut page, matches);
    page.lead(&lead(matches));
    key_figures(&mut page, score);
    for sentence in lost {
        page.warning(&format!("Not analysed: {sentence}."));
    }
    quality(&mut page, matches);
    if let Some(comparison) = &score.comparison {
        compared(&mut page, comparison);
    }
    summary(&mut page, score);
    if !matches.is_empty() {
        page.section("Replay");
        page.paragraph(
            "The timeline shows each episode as a band that ends in the colour of the scorer. Marks above the middle are \
             events of the left player, marks below are events of the right player. Click the timeline or an event \
             to jump there.",
        );
        page.widget(&replay::replay(matches));
        maps_and_speeds(&mut page, matches);
    }
    per_match(&mut page, matches, score);
    definitions(&mut page);
    page.section("Provenance");
    page.code(&provenance.command_line);
    page.paragraph(&format!(
        "klasktron {}, commit {}.",
        provenance.crate_version, provenance.git_hash
    ));
    page.finish()
}

/// State the points of both players.
fn badge(page: &mut Page, matches: &[ScoredMatch]) {
    let points = matches.iter().map(|scored| scored.analysis.points());
    let [left, right] = points.fold([0, 0], |sum, [l, r]| [sum[0] + l, sum[1] + r]);
    let tone = if left + right == 0 { Badge::Warn } else { Badge::Note };
    page.badge(&format!("left {left} : {right} right"), tone);
}

/// The first metrics of the score with their intervals.
fn key_figures(page: &mut Page, score: &Score) {
    let figures: Vec<(&str, String)> = Metric::ALL
        .into_iter()
        .filter(|metric| score.summary[metric.name()].mean.is_some())
        .take(4)
        .map(|metric| (metric.title(), figure(&score.summary[metric.name()])))
        .collect();
    if !figures.is_empty() {
        page.key_figures(&figures);
    }
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
        "{}, {}, {:.1} min of play: {} for the left player, {} for the right player.",
        matches_of(matches.len()),
        count(episodes, "episode"),
        play / 60.0,
        count(left, "point"),
        count(right, "point")
    )
}

fn matches_of(number: usize) -> String {
    if number == 1 { "1 match".to_owned() } else { format!("{number} matches") }
}

fn quality(page: &mut Page, matches: &[ScoredMatch]) {
    for scored in matches {
        let file = scored.path.display();
        if !scored.loss.is_none() {
            page.warning(&format!(
                "{file} is damaged ({}); the analysis covers the rest.",
                scored.loss
            ));
        }
        if scored.source == Source::BoardState {
            page.warning(&format!(
                "{file} contains no camera detections. The analysis uses the filtered board state, whose lag smears \
                 and delays contacts."
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
        "Brackets hold 95 % intervals by bootstrap over episodes. The column of the paper is its table I: ten games of a \
         human against the robot, with possession and win rate of the robot. The paper does not define block, strike \
         and possession, so its values may not be comparable.",
    );
    let rows = Metric::ALL.into_iter().map(|metric| {
        let found = &score.summary[metric.name()];
        let paper = metric.in_paper().map_or_else(|| "-".to_owned(), |value| value.to_string());
        vec![metric.title().to_owned(), figure(found), found.n.to_string(), paper]
    });
    page.table(&Table {
        head: words(&["metric", "mean (95 % interval)", "episodes", "paper"]),
        rows: rows.collect(),
    });
}

fn compared(page: &mut Page, comparison: &Comparison) {
    let [a, b] = &comparison.groups;
    page.section(&format!("{b} compared with {a}"));
    let mut sentence = comparison.summary.clone();
    sentence.push('.');
    page.lead(&sentence);
    page.paragraph(&format!(
        "{a}: {}, {}. {b}: {}, {}. The difference is {b} minus {a}, with its 95 % interval by bootstrap \
         over episodes. p-values by permutation of episodes, Holm-corrected over all metrics. Episodes of \
         one match are assumed to be independent.",
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
            "metric".to_owned(),
            a.clone(),
            b.clone(),
            "difference (95 % interval)".to_owned(),
            "p, corrected".to_owned(),
        ],
        rows: comparison.metrics.iter().map(row).collect(),
    });
}

fn maps_and_speeds(page: &mut Page, matches: &[ScoredMatch]) {
    let board = matches.first().map(|scored| scored.rules.board).unwrap_or_default();
    page.section("Positions");
    page.paragraph(
        "The left player defends the goal on the left. A strike is a line along the path of the ball, as long as the \
         ball moves in 0.05 s.",
    );
    page.charts(&[
        maps::shot_map(matches, board),
        maps::heat(matches, board, "Position of the ball", &|frame| frame.ball),
        maps::heat(matches, board, "Position of the left striker", &|frame| {
            frame.strikers[Player::Left as usize]
        }),
        maps::heat(matches, board, "Position of the right striker", &|frame| {
            frame.strikers[Player::Right as usize]
        }),
    ]);
    page.section("Speed of the ball");
    page.chart(&speed_histogram(matches));
}

fn speed_histogram(matches: &[ScoredMatch]) -> Chart {
    let bins = (FASTEST / SPEED_BIN) as usize;
    let mut counts = vec![0_usize; bins];
    let speeds = matches.iter().flat_map(|scored| &scored.analysis.speeds);
    let mut total = 0_usize;
    for speed in speeds {
        counts[((speed / SPEED_BIN) as usize).min(bins - 1)] += 1;
        total += 1;
    }
    let percent = |count: usize| 100.0 * count as f64 / total.max(1) as f64;
    let steps = counts.iter().enumerate();
    let mut points: Vec<(f64, f64)> =
        steps.map(|(bin, count)| (bin as f64 * SPEED_BIN, percent(*count))).collect();
    points.push((FASTEST, percent(counts[bins - 1])));
    Chart::of_lines(
        "Histogram of the ball speed in play; the last bin holds all larger speeds",
        Axis::new("speed", "m/s"),
        Axis::new("fraction of play", "%").including(0.0),
    )
    .with(Series::steps("", Colour::Blue, points))
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
            "measurement noise (mm)",
        ]),
        rows: rows.collect(),
    });
}

fn definitions(page: &mut Page) {
    page.section("Definitions");
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
