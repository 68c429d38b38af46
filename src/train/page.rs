//! `index.html` of `train`: how it went, how good it is, how it was made.

use super::{
    CurvePoint,
    evaluate::{Estimate, Evaluation, OpponentEvaluation},
    file::Summary,
};
use crate::{
    report::{Axis, Curve, LinePlot, Page, Scale, Stroke, Table, line_plot},
    stats::Interval,
};

pub(super) const BLUE: [u8; 3] = [31, 105, 180];
pub(super) const SIZE: (u32, u32) = (480, 260);

/// The pictures: title, figure, unit.
pub(super) const PICTURES: [(&str, &str, &str); 10] = [
    ("Score against the pool", "play/score", "won minus lost, share of games"),
    ("Running Elo", "play/elo", "Elo"),
    ("Return of an episode", "play/return", "reward"),
    ("Hits of the ball", "play/hits_per_minute", "per minute"),
    ("Length of an episode", "play/episode_s", "s"),
    ("Lost by own mistake", "play/own_goal_fraction", "share of games"),
    ("Entropy of the policy", "losses/entropy", "nat"),
    ("Divergence by an update", "losses/kl", "nat"),
    ("Value loss", "losses/value", "reward squared"),
    ("Explained variance", "losses/explained_variance", "share"),
];

/// The page.
#[must_use]
pub fn page(summary: &Summary, curve: &[CurvePoint]) -> String {
    let mut page = Page::new("Training");
    page.lead(&lead(summary));
    for warning in &summary.warnings {
        page.warning(warning);
    }
    if let Some(verdict) = &summary.evaluation {
        strength(&mut page, verdict);
    }
    page.section("Learning");
    page.paragraph(
        "Over millions of transitions of all boards together. Whenever the score against the pool passes the \
         update score the policy joins the pool, and the score falls.",
    );
    page.pictures_in_row(&PICTURES.map(|picture| plot(curve, picture)));
    how(&mut page, summary);
    page.finish()
}

fn lead(summary: &Summary) -> String {
    let against = |judged: &OpponentEvaluation| {
        judged.win_rate.map(|share| format!("{:.1} % against {}", 100.0 * share, judged.opponent))
    };
    let verdict = summary.evaluation.as_ref();
    let shares: Vec<String> =
        verdict.iter().flat_map(|verdict| &verdict.opponents).filter_map(against).collect();
    let shares = if shares.is_empty() {
        String::new()
    } else {
        format!(" Of decided games it wins {}.", shares.join(", "))
    };
    format!(
        "{} updates, {:.1} million transitions, actuator {}.{shares}",
        summary.updates,
        summary.transitions as f64 / 1e6,
        summary.actuator.kind
    )
}

fn interval(ci95: Option<Interval>, scale: f64) -> String {
    ci95.map_or_else(
        || "-".to_owned(),
        |ci| format!("{:.1} to {:.1}", scale * ci.low, scale * ci.high),
    )
}

/// `2.3 (2.1 to 2.5)`
fn estimate(estimate: &Estimate) -> String {
    let range = estimate.ci95.map(|ci| format!(" ({:.1} to {:.1})", ci.low, ci.high));
    format!("{:.1}{}", estimate.mean, range.unwrap_or_default())
}

fn strength(page: &mut Page, verdict: &Evaluation) {
    let texts = |cells: &[&str]| cells.iter().map(|cell| (*cell).to_owned()).collect();
    page.section("Strength");
    page.paragraph(
        "The policy plays the means of its actions; every board plays one episode, half of them from each \
         seat. A game that nobody wins in time is drawn and not decided. In brackets: 95 % intervals.",
    );
    let share = |share: Option<f64>| {
        share.map_or_else(|| "-".to_owned(), |share| format!("{:.1}", 100.0 * share))
    };
    let rows = verdict.opponents.iter().map(|judged| {
        let both = judged.score.both();
        vec![
            judged.opponent.clone(),
            both.won.to_string(),
            both.drawn.to_string(),
            both.lost.to_string(),
            share(judged.win_rate),
            interval(judged.win_rate_ci95, 100.0),
            share(judged.score.left.win_rate()),
            share(judged.score.right.win_rate()),
            estimate(&judged.goals_per_min),
            estimate(&judged.conceded_goals_per_min),
            estimate(&judged.episode_length_s),
            estimate(&judged.hits_per_episode),
        ]
    });
    page.table(&Table {
        head: texts(&[
            "opponent",
            "won",
            "drawn",
            "lost",
            "won of decided (%)",
            "95 %",
            "from the left (%)",
            "from the right (%)",
            "scored per min",
            "conceded per min",
            "length (s)",
            "own hits",
        ]),
        rows: rows.collect(),
    });
    if verdict.elo.is_empty() {
        return;
    }
    page.subsection("Elo, K = 10, base 1200");
    let rows = verdict.elo.iter().map(|row| {
        let rating = format!("{:.0}", row.rating);
        vec![row.player.clone(), rating, interval(row.ci95, 1.0), row.games.to_string()]
    });
    page.table(&Table {
        head: texts(&["player", "rating", "95 %", "games"]),
        rows: rows.collect(),
    });
}

fn plot(curve: &[CurvePoint], (title, figure, unit): (&str, &str, &str)) -> String {
    let value = |point: &CurvePoint| {
        point.figures().iter().find(|(name, _)| *name == figure).map(|(_, value)| *value)
    };
    let points = curve
        .iter()
        .filter_map(|point| Some((point.transitions as f64 / 1e6, value(point)?)))
        .collect();
    line_plot(&LinePlot {
        title: title.to_owned(),
        x: "transitions (million)".to_owned(),
        y: Axis { label: unit.to_owned(), scale: Scale::Linear },
        bands: Vec::new(),
        curves: vec![Curve { colour: BLUE, stroke: Stroke::Solid, points }],
        size: SIZE,
    })
}

fn how(page: &mut Page, summary: &Summary) {
    page.section("How it was made");
    page.code(&summary.provenance.command_line);
    let sha256 = summary.actuator.sha256.clone().unwrap_or_else(|| "-".to_owned());
    let asked = summary.actuator_extrapolation_fraction.map_or_else(
        || "-".to_owned(),
        |share| format!("{:.2} % of {}", 100.0 * share, summary.actuator_queries.total),
    );
    let [version, commit] = summary.provenance.facts();
    page.facts([
        version,
        commit,
        ("seed", summary.settings.seed.to_string()),
        ("actuator", summary.actuator.file.clone().unwrap_or(summary.actuator.kind.clone())),
        ("its SHA-256", sha256),
        ("asked outside of its training data", asked),
    ]);
    page.subsection("Settings");
    page.code(&summary.settings.to_json());
}
