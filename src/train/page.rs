//! `index.html` of `train`: learning curves, evaluation and provenance.

use super::{
    CurvePoint,
    evaluate::{Estimate, Evaluation, OpponentEvaluation},
    file::Summary,
};
use crate::{
    report::{Axis, Badge, Chart, Colour, Page, Points, Series, Table},
    stats::Interval,
};

/// Height of a learning curve (px).
const HEIGHT: u32 = 260;

/// Learning curves: title, metric, quantity, unit.
const CURVES: [(&str, &str, &str, &str); 10] = [
    ("Score against the opponents", "play/score", "won minus lost", "fraction"),
    ("Running Elo", "play/elo", "Elo", ""),
    ("Episode return", "play/return", "return", ""),
    ("Hits of the ball", "play/hits_per_minute", "rate", "1/min"),
    ("Episode length", "play/episode_s", "length", "s"),
    ("Own goals", "play/own_goal_fraction", "own goals", "fraction"),
    ("Policy entropy", "losses/entropy", "entropy", "nat"),
    ("Approximate KL per update", "losses/kl", "KL divergence", "nat"),
    ("Value loss", "losses/value", "loss", ""),
    ("Explained variance", "losses/explained_variance", "fraction", ""),
];

/// Page of one training run.
#[must_use]
pub fn page(summary: &Summary, curve: &[CurvePoint]) -> String {
    let mut page = Page::new("Training");
    badge(&mut page, summary);
    page.lead(&lead(summary));
    page.key_figures(&key_figures(summary));
    for warning in &summary.warnings {
        page.warning(warning);
    }
    if let Some(verdict) = &summary.evaluation {
        evaluation(&mut page, verdict);
    }
    page.section("Learning curves");
    page.paragraph(
        "All metrics cover all environments together. When the score against the pool passes the update score, \
         the policy joins the pool and the score falls.",
    );
    let series = |metric: &str| vec![Series::line("", Colour::Blue, learning(curve, metric))];
    page.charts(&learning_charts(&series));
    how(&mut page, summary);
    page.finish()
}

/// Points of one metric over million transitions.
pub(super) fn learning(curve: &[CurvePoint], metric: &str) -> Points {
    let value = |point: &CurvePoint| {
        point.figures().iter().find(|(name, _)| *name == metric).map(|(_, value)| *value)
    };
    let points = curve.iter();
    points.filter_map(|point| Some((point.transitions as f64 / 1e6, value(point)?))).collect()
}

/// Charts of all metrics with a shared cursor; `series` draws one metric.
pub(super) fn learning_charts(series: &dyn Fn(&str) -> Vec<Series>) -> Vec<Chart> {
    let chart = |(title, metric, quantity, unit): (&str, &str, &str, &str)| {
        Chart::of_lines(title, Axis::new("transitions", "million"), Axis::new(quantity, unit))
            .with_all(series(metric))
            .with_height(HEIGHT)
            .in_group("learning")
    };
    CURVES.map(chart).into()
}

fn badge(page: &mut Page, summary: &Summary) {
    let evaluation = summary.evaluation.as_ref().filter(|own| !own.opponents.is_empty());
    let Some(verdict) = evaluation else {
        page.badge("not evaluated", Badge::Note);
        return;
    };
    let better = |judged: &&OpponentEvaluation| judged.win_rate_ci95.is_some_and(|ci| 0.5 < ci.low);
    let count = verdict.opponents.iter().filter(better).count();
    let all = verdict.opponents.len();
    let tone = if count == all { Badge::Good } else { Badge::Warn };
    page.badge(&format!("better than {count} of {all} opponents"), tone);
}

fn key_figures(summary: &Summary) -> Vec<(&'static str, String)> {
    let mut figures = vec![
        ("transitions", format!("{:.1} million", summary.transitions as f64 / 1e6)),
        ("updates", summary.updates.to_string()),
    ];
    let opponents = summary.evaluation.iter().flat_map(|verdict| &verdict.opponents);
    let rates: Vec<String> = opponents
        .filter_map(|judged| {
            Some(format!("{:.0}\u{a0}% {}", 100.0 * judged.win_rate?, judged.opponent))
        })
        .collect();
    if !rates.is_empty() {
        figures.push(("win rate of decided games against", rates.join(", ")));
    }
    figures
}

fn lead(summary: &Summary) -> String {
    format!(
        "Self-play PPO: {} updates, {:.1} million transitions, actuator model {}.",
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

fn evaluation(page: &mut Page, verdict: &Evaluation) {
    let texts = |cells: &[&str]| cells.iter().map(|cell| (*cell).to_owned()).collect();
    page.section("Evaluation");
    page.paragraph(
        "The policy plays its mean actions. Each environment plays one episode, half of them from each side. A game \
         without a winner at the time limit is drawn and not decided. Brackets hold 95 % intervals.",
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
            format!("{:.1}", 100.0 * judged.own_goal_fraction.mean),
        ]
    });
    page.table(&Table {
        head: texts(&[
            "opponent",
            "won",
            "drawn",
            "lost",
            "win rate (%)",
            "95 % interval",
            "as left player (%)",
            "as right player (%)",
            "goals per minute",
            "conceded per minute",
            "episode length (s)",
            "own hits per episode",
            "own goals (% of games)",
        ]),
        rows: rows.collect(),
    });
    if verdict.elo.is_empty() {
        return;
    }
    page.subsection("Elo rating (K = 10, base 1200)");
    let rows = verdict.elo.iter().map(|row| {
        let rating = format!("{:.0}", row.rating);
        vec![row.player.clone(), rating, interval(row.ci95, 1.0), row.games.to_string()]
    });
    page.table(&Table {
        head: texts(&["player", "rating", "95 % interval", "games"]),
        rows: rows.collect(),
    });
}

fn how(page: &mut Page, summary: &Summary) {
    page.section("Provenance");
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
        ("SHA-256 of the actuator", sha256),
        ("actuator queries out of distribution", asked),
    ]);
    page.subsection("Settings");
    page.code(&summary.settings.to_json());
}
