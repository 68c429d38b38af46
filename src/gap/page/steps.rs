//! The gap of each signal after each step of the search, in units of its noise floor.

use super::PALETTE;
use crate::{
    gap::{
        floor::{Floor, FloorSource},
        rounds::Outcome,
    },
    report::{Curve, StepPlot, Stroke, step_plot},
};

/// RMS of each signal after each step.
pub(super) struct Steps {
    /// Name of each step, in lines.
    pub(super) names: Vec<Vec<String>>,
    /// `[step][signal]`.
    pub(super) rms: Vec<Vec<f64>>,
}

/// Name and colour of each curve.
pub(super) type Legend = Vec<(String, [u8; 3])>;

/// The steps of `outcome`: as given, all known parameters fitted, and each effect added. On the
/// held-out sessions, or on the fitted ones without any, where only the ends are known.
pub(super) fn steps(outcome: &Outcome<'_>) -> Steps {
    let mut names = vec![vec!["as given".to_owned()], vec!["refitted".to_owned()]];
    if outcome.held_out.parts.is_empty() {
        let mut rms = vec![outcome.train.rms(&outcome.start), outcome.train.rms(&outcome.refitted)];
        if !outcome.added.is_empty() {
            names.push(vec!["+ all that".to_owned(), "was added".to_owned()]);
            rms.push(outcome.train.rms(&outcome.last.point));
        }
        return Steps { names, rms };
    }
    // Each round begins with everything fitted to what the rounds before it added.
    let mut rms = vec![outcome.held_out.rms(&outcome.start_held_out)];
    rms.extend(outcome.added.iter().map(|step| step.held_out_steps.0.clone()));
    rms.push(outcome.held_out.rms(&outcome.last_held_out));
    names.extend(outcome.added.iter().map(|step| {
        let mut lines: Vec<String> = step.effect.name.split('.').map(str::to_owned).collect();
        if let Some(first) = lines.first_mut() {
            first.insert_str(0, "+ ");
        }
        lines.push(format!("on {}", step.axis));
        lines
    }));
    Steps { names, rms }
}

/// The picture with its legend; `None` where no signal has a floor.
pub(super) fn picture(outcome: &Outcome<'_>, floors: &[Floor]) -> Option<(String, Legend)> {
    let steps = steps(outcome);
    let channels = outcome.train.parts.first()?.stage.channels();
    let mut curves = Vec::new();
    let mut legend = Vec::new();
    for (index, (channel, floor)) in channels.iter().zip(floors).enumerate() {
        if floor.source == FloorSource::Unknown || floor.rms <= 0.0 {
            continue;
        }
        let colour = PALETTE[legend.len() % PALETTE.len()];
        let points = steps
            .rms
            .iter()
            .enumerate()
            .filter_map(|(step, rms)| rms.get(index).map(|rms| (step as f64, rms / floor.rms)));
        curves.push(Curve { colour, stroke: Stroke::Solid, points: points.collect() });
        legend.push((channel.signal.clone(), colour));
    }
    let held_out = !outcome.held_out.parts.is_empty();
    let plot = StepPlot {
        title: format!(
            "Gap on {} data after each step",
            if held_out { "held-out" } else { "fitted" }
        ),
        y: "RMS / noise floor".to_owned(),
        steps: steps.names,
        level: 1.0,
        curves,
        size: (980, 360),
    };
    (!legend.is_empty()).then(|| (step_plot(&plot), legend))
}
