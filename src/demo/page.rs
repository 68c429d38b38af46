//! `index.html` of the demo: the story with its numbers and pictures.

use super::{
    experiment::{Estimate, Experiment},
    plan::{Chapter, HIDDEN, OPPONENTS, POLICIES, Plan, Stage},
    record::Record,
};
use crate::{
    provenance::Provenance,
    report::{Axis, Curve, LinePlot, Page, Scale, Stroke, Table, line_plot, path_plot},
};
use serde_json::Value;
use std::collections::BTreeMap;

const BLUE: [u8; 3] = [31, 105, 180];
const ORANGE: [u8; 3] = [217, 130, 43];
const GREEN: [u8; 3] = [52, 140, 80];
const PURPLE: [u8; 3] = [130, 80, 160];
const GREY: [u8; 3] = [120, 128, 140];

/// Colours of the policies, in their order.
const POLICY_COLOURS: [[u8; 3]; 4] = [GREY, ORANGE, BLUE, GREEN];

const SIZE: (u32, u32) = (480, 280);

/// Curves that the story shows, read from the recordings.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Pictures {
    /// Score against the pool over million transitions, of each policy.
    pub learning: Vec<Vec<(f64, f64)>>,
    /// Command and carriage velocity along x (m/s) over time (s), on Monday.
    pub command: Vec<(f64, f64)>,
    /// See [`command`](Self::command).
    pub carriage: Vec<(f64, f64)>,
    /// Tracks of left striker, right striker and ball in a match (m).
    pub tracks: [Vec<(f64, f64)>; 3],
}

/// What the page is made of.
#[derive(Debug, Clone)]
pub struct Story<'a> {
    /// The commands.
    pub plan: &'a Plan,
    /// What came of them, by name.
    pub records: &'a BTreeMap<String, Record>,
    /// The comparison of the policies.
    pub experiment: Option<&'a Experiment>,
    /// Curves.
    pub pictures: &'a Pictures,
    /// How the demo was made.
    pub provenance: &'a Provenance,
}

/// The page.
#[must_use]
pub fn page(story: &Story<'_>) -> String {
    let mut page = Page::new("klasktron demo");
    page.lead(&lead(story));
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
    page.section("How it was made");
    page.code(&story.provenance.command_line);
    page.paragraph(&format!(
        "klasktron {}, commit {}. Every command above can be typed in this folder.",
        story.provenance.crate_version, story.provenance.git_hash
    ));
    page.finish()
}

fn texts(cells: &[&str]) -> Vec<String> {
    cells.iter().map(|cell| (*cell).to_owned()).collect()
}

fn lead(story: &Story<'_>) -> String {
    let seconds: f64 = story.records.values().map(|record| record.elapsed_s).sum();
    let start = format!(
        "From a table that nobody has measured to a match, without hardware: {} commands, {:.0} s of work.",
        story.records.len(),
        seconds
    );
    let Some(experiment) = story.experiment else { return start };
    let said: Vec<String> = experiment
        .differences
        .iter()
        .map(|one| format!("{} against {}: {}", one.better, one.worse, one.summary()))
        .collect();
    format!("{start} Does knowing the actuator help on the rig? {}.", said.join("; "))
}

fn hidden(page: &mut Page) {
    page.section("What is hidden");
    page.paragraph(
        "The virtual rig shares no line of dynamics with the simulations below. These effects were put into \
         it; no later command is told.",
    );
    let rows = HIDDEN.map(|(what, says)| texts(&[what, says])).into();
    page.table_of_words(&Table { head: texts(&["in the rig", "what it does"]), rows });
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
        page.legend(&[("command", GREY), ("carriage", BLUE)]);
        page.picture(&line_plot(&LinePlot {
            title: "Steps on Monday: the carriage comes late".to_owned(),
            x: "time (s)".to_owned(),
            y: Axis { label: "velocity along x (m/s)".to_owned(), scale: Scale::Linear },
            bands: Vec::new(),
            curves: vec![
                curve(GREY, &story.pictures.command),
                curve(BLUE, &story.pictures.carriage),
            ],
            size: (980, 260),
        }));
    }
}

fn curve(colour: [u8; 3], points: &[(f64, f64)]) -> Curve {
    Curve { colour, stroke: Stroke::Solid, points: points.to_vec() }
}

fn fitted(page: &mut Page, story: &Story<'_>) {
    let Some(document) = result(story, "fit-actuator") else { return };
    let models = [
        ("network", "network"),
        ("arx", "linear ARX"),
        ("fopdt", "first order plus dead time"),
        ("ideal", "ideal"),
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
        head: texts(&["RMSE on held-out runs (mm/s)", "one step", "0.5 s", "2 s"]),
        rows: rows.into(),
    });
    page.link("actuator/index.html", "All of it");
}

fn tuned(page: &mut Page, story: &Story<'_>) {
    let Some(document) = result(story, "tune-ekf") else { return };
    let judged = document["judgement"].as_array().map_or(&[][..], Vec::as_slice);
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
        head: texts(&["velocity RMSE (mm/s)", "tuned", "upstream's filter"]),
        rows: judged.iter().map(row).collect(),
    });
    page.link("ekf/index.html", "All of it");
}

fn closed(page: &mut Page, story: &Story<'_>) {
    let Some(document) = result(story, "gap") else { return };
    page.paragraph(document["summary"].as_str().unwrap_or_default());
    let list = |key: &str| document[key].as_array().map_or(&[][..], Vec::as_slice);
    let parameter = |one: &Value| {
        let number = one["value"].as_f64().map_or_else(String::new, |value| format!("{value:.4}"));
        let range = one["ci95"]
            .as_array()
            .and_then(|ci| Some((ci.first()?.as_f64()?, ci.get(1)?.as_f64()?)));
        let range =
            range.map_or_else(String::new, |(low, high)| format!(" ({low:.4} to {high:.4})"));
        format!("{} {number}{range}", one["name"].as_str().unwrap_or_default())
    };
    let effect = |one: &Value| {
        let parameters = one["parameters"].as_array().map_or(&[][..], Vec::as_slice);
        let parameters: Vec<String> = parameters.iter().map(parameter).collect();
        let text = |key: &str| one[key].as_str().unwrap_or_default().to_owned();
        vec![text("name"), text("location"), parameters.join("; ")]
    };
    page.table_of_words(&Table {
        head: texts(&["added", "location", "parameters (95 %)"]),
        rows: list("effects").iter().map(effect).collect(),
    });
    let residual = |one: &Value| {
        let number = |key: &str| one[key].as_f64();
        let share = number("validation_before").zip(number("validation_after"));
        let text = |value: Option<f64>| {
            value.map_or_else(|| "-".to_owned(), |value| format!("{value:.2e}"))
        };
        vec![
            format!("{} ({})", one["signal"].as_str()?, one["unit"].as_str()?),
            text(number("noise_floor")),
            text(number("validation_before")),
            text(number("validation_after")),
            share.map_or_else(String::new, |(before, after)| {
                format!("{:.0} %", 1e2 * (1.0 - after / before))
            }),
        ]
        .into()
    };
    page.table(&Table {
        head: texts(&[
            "residual on the validation sessions, RMS",
            "noise",
            "before",
            "after",
            "closed",
        ]),
        rows: list("residuals").iter().filter_map(residual).collect(),
    });
    page.link("gap/index.html", "All of it");
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
            "thousand per s",
            "random (%)",
            "goalkeeper (%)",
            "chaser (%)",
            "what its simulation knew",
        ]),
        rows: rows.collect(),
    });
    page.paragraph("In per cent: decided games won in its own simulation.");
    if story.pictures.learning.iter().any(|points| !points.is_empty()) {
        let names: Vec<(&str, [u8; 3])> =
            POLICIES.iter().map(|kind| kind.name).zip(POLICY_COLOURS).collect();
        page.legend(&names);
        let curves = story.pictures.learning.iter().zip(POLICY_COLOURS);
        page.picture(&line_plot(&LinePlot {
            title: "Learning".to_owned(),
            x: "transitions (million)".to_owned(),
            y: Axis { label: "hits of the ball per minute".to_owned(), scale: Scale::Linear },
            bands: Vec::new(),
            curves: curves.map(|(points, colour)| curve(colour, points)).collect(),
            size: (980, 260),
        }));
    }
}

fn played(page: &mut Page, story: &Story<'_>) {
    let [left, right, ball] = &story.pictures.tracks;
    if !ball.is_empty() {
        page.legend(&[("left striker", BLUE), ("right striker", PURPLE), ("ball", ORANGE)]);
        page.picture(&path_plot(&LinePlot {
            title: "The learned policy (left) against the chaser, some seconds by the camera"
                .to_owned(),
            x: "y, from goal to goal (m)".to_owned(),
            y: Axis { label: "x, across (m)".to_owned(), scale: Scale::Linear },
            bands: Vec::new(),
            curves: vec![curve(ORANGE, ball), curve(BLUE, left), curve(PURPLE, right)],
            size: (720, 560),
        }));
    }
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
            "points per min",
            "against",
            "in its own simulation",
            "on the rig",
            "kept (share)",
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
            "on the rig",
            "against",
            "points won (share)",
            "episode (s)",
            "contacts per episode",
            "episodes",
        ]),
        rows: rows.collect(),
    });
    page.paragraph("In brackets: 95 % intervals over whole episodes or games.");
    page.legend(&[("in its own simulation", BLUE), ("on the rig", ORANGE)]);
    page.pictures_in_row(&OPPONENTS.map(|opponent| rates(experiment, opponent)));
    page.subsection("Does the order hold?");
    let rows = experiment.differences.iter().map(|one| {
        let pair = format!("{} minus {}", one.better, one.worse);
        vec![pair, shown(one.net_goals_per_min), one.summary().to_owned()]
    });
    page.table_of_words(&Table {
        head: texts(&["on the rig, both opponents", "net points per min", "the first one is"]),
        rows: rows.collect(),
    });
    page.link("eval/index.html", "All matches, with a replay");
}

/// Points per minute of each policy, simulated beside real, with whiskers.
fn rates(experiment: &Experiment, opponent: &str) -> String {
    let mut curves = Vec::new();
    let contests = experiment.contests.iter().filter(|one| one.opponent == opponent);
    for (number, one) in (1..).zip(contests) {
        let at = f64::from(number);
        for (x, colour, figure) in
            [(at - 0.08, BLUE, one.simulated_goals_per_min), (at + 0.08, ORANGE, one.goals_per_min)]
        {
            let (low, high) =
                figure.ci95.map_or((figure.value, figure.value), |ci| (ci.low, ci.high));
            curves.push(curve(colour, &[(x, low), (x, high)]));
            curves.push(curve(colour, &[(x - 0.06, figure.value), (x + 0.06, figure.value)]));
        }
    }
    // The frame begins at zero.
    curves.push(curve(GREY, &[(0.5, 0.0), (4.5, 0.0)]));
    line_plot(&LinePlot {
        title: format!("Against the {opponent}"),
        x: "policy: 1 ideal, 2 randomized, 3 twin, 4 learned".to_owned(),
        y: Axis { label: "points per minute".to_owned(), scale: Scale::Linear },
        bands: Vec::new(),
        curves,
        size: SIZE,
    })
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
            head: texts(&["took (s)", "command"]),
            rows: stage.steps.iter().map(row).collect(),
        },
    );
}
