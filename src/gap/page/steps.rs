//! Residual RMS of each signal after each step of the search, in multiples of its noise floor.

use crate::{
    gap::{
        floor::{Floor, FloorSource},
        rounds::Outcome,
    },
    report::{Axis, Chart, Colour, Series},
};

/// RMS of each signal after each step.
pub(super) struct Steps {
    /// Name of each step, in lines.
    pub(super) names: Vec<Vec<String>>,
    /// `[step][signal]`.
    pub(super) rms: Vec<Vec<f64>>,
}

/// Steps of `outcome`: given twin, all known parameters fitted, and each added effect, on the validation sessions.
/// Without any: on the training sessions, with the first and the last step only.
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
    // Each round begins with everything fitted, including the effects of earlier rounds.
    let mut rms = vec![outcome.held_out.rms(&outcome.start_held_out)];
    rms.extend(outcome.added.iter().map(|step| step.held_out_steps.0.clone()));
    rms.push(outcome.held_out.rms(&outcome.last_held_out));
    names.extend(outcome.added.iter().map(|step| {
        let mut lines: Vec<String> = step.effect.name.split('.').map(str::to_owned).collect();
        if let Some(first) = lines.first_mut() {
            first.insert_str(0, "+ ");
        }
        let location = step.axis.phrase();
        lines.extend((!location.is_empty()).then(|| location.trim_start().to_owned()));
        lines
    }));
    Steps { names, rms }
}

/// Chart of the steps; `None` where no signal has a noise floor.
pub(super) fn chart(outcome: &Outcome<'_>, floors: &[Floor]) -> Option<Chart> {
    let steps = steps(outcome);
    let channels = outcome.train.parts.first()?.stage.channels();
    let mut series = Vec::new();
    for (index, (channel, floor)) in channels.iter().zip(floors).enumerate() {
        if floor.source == FloorSource::Unknown || floor.rms <= 0.0 {
            continue;
        }
        let points = steps
            .rms
            .iter()
            .enumerate()
            .filter_map(|(step, rms)| rms.get(index).map(|rms| (step as f64, rms / floor.rms)));
        let colour = Colour::of_series(series.len());
        series.push(Series::marked(&channel.signal, colour, points.collect()));
    }
    if series.is_empty() {
        return None;
    }
    let data = if outcome.held_out.parts.is_empty() { "training" } else { "validation" };
    let names = steps.names.into_iter().map(|lines| lines.join("\n")).collect();
    let chart = Chart::of_lines(
        &format!("Residual RMS on {data} data after each step"),
        Axis::of_categories("step", names),
        Axis::new("residual RMS / noise floor", "").logarithmic(),
    );
    let chart = chart.with(Series::level("noise floor", Colour::Grey, 1.0));
    Some(chart.with_all(series).with_height(380))
}
