//! `index.html` of the demo: every step with its results, and the comparison of the policies.

use super::{
    experiment::{Contest, Estimate, Experiment},
    plan::{Chapter, HIDDEN, OPPONENTS, POLICIES, Plan, Stage},
    record::Record,
};
use crate::{
    board::{BoardSize, CUP_DISTANCE, CUP_RADIUS},
    gap::significant,
    provenance::Provenance,
    report::{Axis, Badge, Chart, Colour, Page, Points, Series, Table, with_same_y},
    rig::RigConfig,
    stats::Interval,
};
use serde_json::Value;
use std::{collections::BTreeMap, f64::consts::TAU};

/// Colours of the policies, in their order.
const POLICY_COLOURS: [Colour; 6] =
    [Colour::Grey, Colour::Orange, Colour::Blue, Colour::Green, Colour::Red, Colour::Purple];

/// Curves of the page, read from the recordings.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Pictures {
    /// Score against the pool over million transitions, of each policy.
    pub learning: Vec<Points>,
    /// Command and carriage velocity along x (m/s) over time (s), on Monday.
    pub command: Points,
    /// See [`command`](Self::command).
    pub carriage: Points,
    /// Tracks of left striker, right striker and ball in a match (m).
    pub tracks: [Points; 3],
}

/// Content of the page.
#[derive(Debug, Clone)]
pub struct Story<'a> {
    /// The commands.
    pub plan: &'a Plan,
    /// Results of the commands, by name.
    pub records: &'a BTreeMap<String, Record>,
    /// The comparison of the policies.
    pub experiment: Option<&'a Experiment>,
    /// Curves.
    pub pictures: &'a Pictures,
    /// Provenance of the demo.
    pub provenance: &'a Provenance,
}

/// Page of the demo.
#[must_use]
pub fn page(story: &Story<'_>) -> String {
    let mut page = Page::new("klasktron demo");
    badge(&mut page, story);
    page.lead(&lead(story));
    transfer(&mut page, story);
    hidden(&mut page);
    for stage in &story.plan.stages {
        page.section(stage.chapter.title());
        page.paragraph(stage.chapter.purpose());
        match stage.chapter {
            Chapter::Collect => collected(&mut page, story),
            Chapter::FitActuator => fitted(&mut page, story),
            Chapter::TuneFilter => tuned(&mut page, story),
            Chapter::CloseGap => closed(&mut page, story),
            Chapter::Train => trained(&mut page, story),
            Chapter::Play => played(&mut page, story),
            Chapter::Score => scored(&mut page, story),
        }
        commands(&mut page, stage, story.records);
    }
    page.section("Provenance");
    page.code(&story.provenance.command_line);
    page.paragraph(&format!(
        "klasktron {}, commit {}. All commands above run in this folder.",
        story.provenance.crate_version, story.provenance.git_hash
    ));
    page.finish()
}

fn texts(cells: &[&str]) -> Vec<String> {
    cells.iter().map(|cell| (*cell).to_owned()).collect()
}

fn badge(page: &mut Page, story: &Story<'_>) {
    let Some(experiment) = story.experiment else {
        page.badge("not finished", Badge::Note);
        return;
    };
    let better = |one: &&super::experiment::Difference| {
        one.net_goals_per_min.ci95.is_some_and(|ci| 0.0 < ci.low)
    };
    let count = experiment.differences.iter().filter(better).count();
    let all = experiment.differences.len();
    let tone = if count == all { Badge::Good } else { Badge::Note };
    page.badge(&format!("actuator knowledge helps in {count} of {all} comparisons"), tone);
}

fn lead(story: &Story<'_>) -> String {
    let seconds: f64 = story.records.values().map(|record| record.elapsed_s).sum();
    let start = format!(
        "From an unidentified table to a match, without hardware: {} commands, {:.0} s of computation.",
        story.records.len(),
        seconds
    );
    let Some(experiment) = story.experiment else { return start };
    // Pairs with the same result are listed together.
    let mut results: Vec<(&str, Vec<String>)> = Vec::new();
    for one in &experiment.differences {
        let pair = format!("{} versus {}", one.better, one.worse);
        match results.iter_mut().find(|(summary, _)| *summary == one.summary()) {
            Some((_, pairs)) => pairs.push(pair),
            None => results.push((one.summary(), vec![pair])),
        }
    }
    let results: Vec<String> =
        results.iter().map(|(summary, pairs)| format!("{summary}: {}", pairs.join(", "))).collect();
    format!("{start} Net goals per minute on the rig: {}.", results.join("; "))
}

/// Net goals and transfer ratio of each policy over all opponents.
fn transfer(page: &mut Page, story: &Story<'_>) {
    let Some(experiment) = story.experiment else { return };
    let in_percent = |(policy, ratio): &(&'static str, Estimate)| {
        let of = |value: f64| 100.0 * value;
        let ci95 = ratio.ci95.map(|ci| Interval { low: of(ci.low), high: of(ci.high) });
        (*policy, Estimate { value: of(ratio.value), ci95 })
    };
    let ratios: Vec<_> = experiment.transfer_ratios.iter().map(in_percent).collect();
    page.chart(&of_policies(
        "Net goals on the rig",
        Axis::new("scored minus conceded", "1/min").including(0.0),
        "net goals per minute",
        &experiment.net_goals_per_min,
    ));
    page.chart(
        &of_policies(
            "Transfer ratio: scoring rate on the rig relative to that in the policy's simulation",
            Axis::new("rig / simulation", "%").including(0.0),
            "transfer ratio",
            &ratios,
        )
        .with(Series::level("equal rates", Colour::Grey, 100.0)),
    );
    page.paragraph(
        "All opponents and both seats together. Rig and simulation have the same serves, rules, time and referee. \
         Whiskers are 95 % intervals over episodes; they do not contain the variance between training seeds.",
    );
}

/// Chart of one estimate, called `name`, for each policy, with error bars.
fn of_policies(
    title: &str,
    axis: Axis,
    name: &str,
    estimates: &[(&'static str, Estimate)],
) -> Chart {
    let places = || estimates.iter().enumerate().map(|(at, (_, one))| (at as f64, one));
    let points = places().map(|(at, one)| (at, one.value)).collect();
    let ranges = places().filter_map(|(at, one)| one.ci95.map(|ci| (at, ci.low, ci.high)));
    let names = estimates.iter().map(|(policy, _)| (*policy).to_owned()).collect();
    Chart::of_lines(title, Axis::of_categories("policy", names), axis)
        .with(Series::dots(name, Colour::Blue, points).with_whiskers(ranges.collect()))
}

fn hidden(page: &mut Page) {
    page.section("Hidden effects");
    page.paragraph(
        "The virtual rig shares no dynamics code with the simulations below. The rig contains these effects; no \
         later command receives them.",
    );
    let rows = HIDDEN.map(|(setting, effect)| texts(&[setting, effect])).into();
    page.table_of_words(&Table { head: texts(&["setting of the rig", "effect"]), rows });
    page.paragraph(&of_any_rig(&RigConfig::default()));
}

/// Effects of every virtual rig that the plain simulation lacks, with the default settings of the `rig`.
fn of_any_rig(rig: &RigConfig) -> String {
    let on_belt = TAU / rig.belt_metres_per_turn;
    let cogging = rig.drive.cogging.iter().map(|own| {
        format!(
            "cogging of {:.2} N with a period of {:.2} mm",
            own.amplitude_nm * on_belt,
            1e3 * rig.belt_metres_per_turn / own.periods_per_turn
        )
    });
    let friction = rig.drive.friction.coulomb_nm * on_belt;
    let compliance = 1e6 / rig.gantry.left.belt_a_stiffness_n_per_m;
    let effects: Vec<String> =
        std::iter::once(format!("Coulomb friction of {friction:.2} N")).chain(cogging).collect();
    format!(
        "Every virtual rig also has these effects at its motors, in terms of the belt, which the plain simulation \
         lacks: {}. Its belts stretch by {compliance:.0} um/N.",
        effects.join(", ")
    )
}

fn result<'a>(story: &Story<'a>, name: &str) -> Option<&'a Value> {
    story.records.get(name).map(|record| &record.result)
}

fn collected(page: &mut Page, story: &Story<'_>) {
    let row = |name: &str| {
        let document = result(story, name)?;
        Some(vec![
            name.trim_start_matches("collect-").to_owned(),
            format!("{}", document["runs_done"]),
            format!("{}", document["samples"]),
            format!("{:.0}", document["duration_s"].as_f64()?),
            format!("{:.1}", 1e3 * document["worst_tracking_m"].as_f64()?),
        ])
    };
    let names = ["collect-monday", "collect-tuesday", "collect-ball"];
    page.table(&Table {
        head: texts(&["recording", "runs", "samples", "length (s)", "worst tracking (mm)"]),
        rows: names.into_iter().filter_map(row).collect(),
    });
    if !story.pictures.command.is_empty() {
        let points = |points: &Points| points.clone();
        page.chart(
            &Chart::of_lines(
                "Steps on Monday: the carriage follows with a delay",
                Axis::new("time", "s"),
                Axis::new("velocity along x", "m/s"),
            )
            .with(Series::line("command", Colour::Grey, points(&story.pictures.command)))
            .with(Series::line(
                "carriage",
                Colour::Blue,
                points(&story.pictures.carriage),
            )),
        );
    }
}

fn fitted(page: &mut Page, story: &Story<'_>) {
    let Some(document) = result(story, "fit-actuator") else { return };
    let models = [
        ("network", "network"),
        ("arx", "linear ARX"),
        ("fopdt", "first order plus dead time"),
        ("ideal", "ideal drive"),
    ];
    let errors = document["errors"].as_array().map_or(&[][..], Vec::as_slice);
    let error = |model: &str, horizon: f64| {
        let of = |one: &&Value| {
            one["model"] == model
                && one["pattern"] == "all"
                && one["component"] == "both"
                && one["horizon_s"].as_f64() == Some(horizon)
        };
        let found = errors.iter().find(of).and_then(|one| one["rmse_m_per_s"].as_f64());
        found.map_or_else(|| "-".to_owned(), |rmse| format!("{:.1}", 1e3 * rmse))
    };
    let rows = models.map(|(model, name)| {
        vec![name.to_owned(), error(model, 0.0), error(model, 0.5), error(model, 2.0)]
    });
    page.table(&Table {
        head: texts(&[
            "RMSE on held-out runs (mm/s)",
            "one step",
            "simulation, 0.5 s",
            "simulation, 2 s",
        ]),
        rows: rows.into(),
    });
    page.link("actuator/index.html", "Full report");
}

fn tuned(page: &mut Page, story: &Story<'_>) {
    let Some(document) = result(story, "tune-ekf") else { return };
    let judged = document["evaluation"].as_array().map_or(&[][..], Vec::as_slice);
    let row = |one: &Value| {
        let speed = |key: &str| {
            let rmse = one[key].as_f64();
            rmse.map_or_else(|| "-".to_owned(), |rmse| format!("{:.0}", 1e3 * rmse))
        };
        let [own, upstream] =
            ["velocity_rmse_m_per_s", "upstream_velocity_rmse_m_per_s"].map(speed);
        vec![one["object"].as_str().unwrap_or("-").to_owned(), own, upstream]
    };
    page.table(&Table {
        head: texts(&["velocity RMSE (mm/s)", "tuned filter", "upstream settings"]),
        rows: judged.iter().map(row).collect(),
    });
    page.link("ekf/index.html", "Full report");
}

fn closed(page: &mut Page, story: &Story<'_>) {
    let Some(document) = result(story, "gap") else { return };
    page.paragraph(document["summary"].as_str().unwrap_or_default());
    let list = |key: &str| document[key].as_array().map_or(&[][..], Vec::as_slice);
    let effect = |one: &Value| {
        let parameters = one["parameters"].as_array().map_or(&[][..], Vec::as_slice);
        let parameters: Vec<String> = parameters.iter().map(parameter).collect();
        let text = |key: &str| one[key].as_str().unwrap_or_default().to_owned();
        vec![text("name"), text("location"), parameters.join("; ")]
    };
    page.table_of_words(&Table {
        head: texts(&["added effect", "location", "parameters (95 % interval)"]),
        rows: list("effects").iter().map(effect).collect(),
    });
    page.table(&Table {
        head: texts(&[
            "residual RMS on validation data",
            "noise floor",
            "before",
            "after",
            "reduction",
        ]),
        rows: list("residuals").iter().filter_map(residual).collect(),
    });
    page.link("gap/index.html", "Full report");
}

/// Parameter of an added effect with its unit and interval.
fn parameter(one: &Value) -> String {
    let number = one["value"].as_f64().map_or_else(String::new, significant);
    let range =
        one["ci95"].as_array().and_then(|ci| Some((ci.first()?.as_f64()?, ci.get(1)?.as_f64()?)));
    let range = range.map_or_else(String::new, |(low, high)| {
        format!(" ({} to {})", significant(low), significant(high))
    });
    let text = |key: &str| one[key].as_str().unwrap_or_default();
    let unit = match text("unit") {
        "" | "1" => String::new(),
        unit => format!(" {unit}"),
    };
    format!("{} {number}{range}{unit}", text("name"))
}

/// Row of one signal: residual RMS and its reduction.
fn residual(one: &Value) -> Option<Vec<String>> {
    let number = |key: &str| one[key].as_f64();
    let both = number("validation_before").zip(number("validation_after"));
    let text =
        |value: Option<f64>| value.map_or_else(|| "–".to_owned(), |value| format!("{value:.2e}"));
    Some(vec![
        format!("{} ({})", one["signal"].as_str()?, one["unit"].as_str()?),
        text(number("noise_floor")),
        text(number("validation_before")),
        text(number("validation_after")),
        both.map_or_else(String::new, |(before, after)| {
            format!("{:.0} %", 1e2 * (1.0 - after / before))
        }),
    ])
}

fn trained(page: &mut Page, story: &Story<'_>) {
    let rows = POLICIES.iter().filter_map(|kind| {
        let document = result(story, &format!("train-{}", kind.name))?;
        let opponents = document.pointer("/evaluation/opponents")?.as_array()?;
        let share = |name: &str| {
            let found = opponents.iter().find(|one| one["opponent"] == name);
            let share = found.and_then(|one| one["win_rate"].as_f64());
            share.map_or_else(|| "-".to_owned(), |share| format!("{:.0}", 1e2 * share))
        };
        Some(vec![
            kind.name.to_owned(),
            format!("{:.1}", document["transitions"].as_f64()? / 1e6),
            format!("{:.0}", document["transitions_per_s"].as_f64()? / 1e3),
            share("random"),
            share("goalkeeper"),
            share("chaser"),
            kind.summary.to_owned(),
        ])
    });
    page.table_of_words(&Table {
        head: texts(&[
            "policy",
            "transitions (million)",
            "thousand transitions/s",
            "win rate, random (%)",
            "win rate, goalkeeper (%)",
            "win rate, chaser (%)",
            "simulation for training",
        ]),
        rows: rows.collect(),
    });
    page.paragraph("Win rate of decided games in the simulation of the training.");
    if story.pictures.learning.iter().any(|points| !points.is_empty()) {
        let kinds = POLICIES.iter().zip(POLICY_COLOURS).zip(&story.pictures.learning);
        page.chart(
            &Chart::of_lines(
                "Learning curves",
                Axis::new("transitions", "million"),
                Axis::new("hits of the ball per minute", "1/min"),
            )
            .with_all(
                kinds.map(|((kind, colour), points)| {
                    Series::line(kind.name, colour, points.clone())
                }),
            ),
        );
    }
}

fn played(page: &mut Page, story: &Story<'_>) {
    let [left, right, ball] = &story.pictures.tracks;
    if ball.is_empty() {
        return;
    }
    page.chart(
        &Chart::of_plane(
            "Learned policy (left) against the chaser: a few seconds, seen by the camera",
            Axis::new("y, goal to goal", "m"),
            Axis::new("x, across the board", "m").reversed(),
        )
        .with_equal_axes()
        .with_height(560)
        .with(Series::line("board", Colour::Ink, outline()).quiet())
        .with(Series::line("ball", Colour::Gold, ball.clone()))
        .with(Series::line("left striker", Colour::Blue, left.clone()))
        .with(Series::line("right striker", Colour::Orange, right.clone())),
    );
}

/// Edge of the board and the goals, with y across as in the replay.
fn outline() -> Points {
    let size = BoardSize::default();
    let (x, y) = (size.short_side / 2.0, size.long_side / 2.0);
    let mut points = vec![(-y, -x), (y, -x), (y, x), (-y, x), (-y, -x)];
    for middle in [-CUP_DISTANCE, CUP_DISTANCE] {
        // A break between the edge and the circle.
        points.push((f64::NAN, f64::NAN));
        points.extend((0..=32).map(|k| {
            let (sin, cos) = (TAU * f64::from(k) / 32.0).sin_cos();
            (middle + CUP_RADIUS * cos, CUP_RADIUS * sin)
        }));
    }
    points
}

/// `2.31 (1.90 to 2.75)`
fn shown(figure: Estimate) -> String {
    let range = figure.ci95.map(|ci| format!(" ({:.2} to {:.2})", ci.low, ci.high));
    format!("{:.2}{}", figure.value, range.unwrap_or_default())
}

fn scored(page: &mut Page, story: &Story<'_>) {
    let Some(experiment) = story.experiment else { return };
    let dash = || "-".to_owned();
    let rows = experiment.contests.iter().map(|one| {
        vec![
            one.policy.to_owned(),
            one.opponent.to_owned(),
            shown(one.simulated_goals_per_min),
            shown(one.goals_per_min),
            one.transfer_ratio.map_or_else(dash, shown),
            shown(one.conceded_goals_per_min),
        ]
    });
    page.table(&Table {
        head: texts(&[
            "policy, goals per minute",
            "opponent",
            "in its own simulation",
            "on the rig",
            "transfer ratio (rig / simulation)",
            "conceded on the rig",
        ]),
        rows: rows.collect(),
    });
    let rows = experiment.contests.iter().map(|one| {
        vec![
            one.policy.to_owned(),
            one.opponent.to_owned(),
            one.win_rate.map_or_else(dash, shown),
            shown(one.episode_length_s),
            shown(one.contacts_per_episode),
            one.episodes.to_string(),
        ]
    });
    page.table(&Table {
        head: texts(&[
            "policy, on the rig",
            "opponent",
            "win rate",
            "seconds per episode",
            "contacts per episode",
            "episodes",
        ]),
        rows: rows.collect(),
    });
    page.paragraph("Brackets hold 95 % intervals over whole episodes or games.");
    compared(page, experiment);
}

/// Rates in simulation and on the rig, and the differences between policies.
fn compared(page: &mut Page, experiment: &Experiment) {
    page.charts(&with_same_y(OPPONENTS.map(|opponent| rates(experiment, opponent)).into()));
    page.subsection("Comparison of the policies");
    let rows = experiment.differences.iter().map(|one| {
        let pair = format!("{} minus {}", one.better, one.worse);
        vec![pair, shown(one.net_goals_per_min), one.summary().to_owned()]
    });
    page.table_of_words(&Table {
        head: texts(&[
            "on the rig, both opponents",
            "net goals per minute",
            "result for the first policy",
        ]),
        rows: rows.collect(),
    });
    for (folder, place) in [("eval", "on the rig"), ("eval-simulated", "in simulation")] {
        page.link(&format!("{folder}/index.html"), &format!("All matches {place}, with replay"));
    }
}

/// Goals per minute of each policy in simulation and on the rig, with error bars.
fn rates(experiment: &Experiment, opponent: &str) -> Chart {
    let contests = || experiment.contests.iter().filter(|one| one.opponent == opponent);
    let series = |name: &str, colour, shift: f64, of: fn(&Contest) -> Estimate| {
        let at = |index: usize| index as f64 + shift;
        let points = contests().enumerate().map(|(k, one)| (at(k), of(one).value)).collect();
        let ranges = contests().enumerate().filter_map(|(k, one)| {
            let ci = of(one).ci95?;
            Some((at(k), ci.low, ci.high))
        });
        Series::dots(name, colour, points).with_whiskers(ranges.collect())
    };
    let names = contests().map(|one| one.policy.to_owned()).collect();
    Chart::of_lines(
        &format!("Against the {opponent} opponent"),
        Axis::of_categories("policy", names),
        Axis::new("goals per minute", "1/min").including(0.0),
    )
    .with(series("in its own simulation", Colour::Blue, -0.08, |one| one.simulated_goals_per_min))
    .with(series("on the rig", Colour::Orange, 0.08, |one| one.goals_per_min))
}

fn commands(page: &mut Page, stage: &Stage, records: &BTreeMap<String, Record>) {
    let row = |step: &super::plan::Step| {
        let took = records
            .get(&step.name)
            .map_or_else(|| "-".to_owned(), |record| format!("{:.1}", record.elapsed_s));
        vec![took, step.line()]
    };
    page.folded_table_of_words(
        "Commands",
        &Table {
            head: texts(&["time (s)", "command"]),
            rows: stage.steps.iter().map(row).collect(),
        },
    );
}
