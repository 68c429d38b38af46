//! An identified effect with its evidence, and its explanation in sentences.

use super::{
    findings::{Evidence, IdentifiedEffect, IdentifiedParameter},
    page::text::{label, sentence},
    rounds::{self, Added, Outcome, RankedCandidate, Unstated},
};
use crate::{
    effects::{Axis, Effect, Parameter},
    twin::{Channel, Twin, Value},
};

/// Effect with positions as parameters.
const ENDSTOP: &str = "gantry.endstop";

/// Residual that an effect changes most, before and after it was added.
struct Reduction {
    signal: String,
    unit: String,
    /// RMS on the validation sessions; `None` without any.
    before: Option<f64>,
    after: Option<f64>,
}

/// The effect of `step` of `outcome`, with its parameters in the final `twin`.
pub(super) fn identified(outcome: &Outcome<'_>, step: &Added, twin: &Twin) -> IdentifiedEffect {
    let instance = rounds::instance_of(twin, step).map(|index| &twin.instances[index]);
    let parameters: Vec<IdentifiedParameter> = instance
        .map(|instance| {
            step.effect.parameters.iter().zip(&instance.values).map(parameter).collect()
        })
        .unwrap_or_default();
    let has_validation = !outcome.held_out.parts.is_empty();
    let reduction = reduction(outcome, step);
    IdentifiedEffect {
        name: step.effect.name.to_owned(),
        location: step.axis,
        evidence: Evidence {
            log_score_gain: step.log_score.map(|gain| gain.value),
            standard_error: step.log_score.map(|gain| gain.standard_error),
            p_value: step.p_value,
            data: step.data.clone(),
            comparisons: step.comparisons,
        },
        validation_gain: has_validation
            .then_some(step.validation_gain)
            .filter(|gain| gain.is_finite()),
        explanation: explanation(step, reduction.as_ref(), &parameters)
            + &origin(step.effect, twin).unwrap_or_default(),
        rmse_before: reduction.as_ref().and_then(|own| own.before),
        rmse_after: reduction.as_ref().and_then(|own| own.after),
        signal: reduction.as_ref().map(|own| own.signal.clone()),
        unit: reduction.map(|own| own.unit),
        estimates_after_step: step.estimates.clone(),
        parameters,
    }
}

fn parameter((parameter, value): (&Parameter, &Value)) -> IdentifiedParameter {
    let plausible = parameter.plausible.0..=parameter.plausible.1;
    let is_plausible = plausible.contains(&value.value.abs()) || plausible.contains(&value.value);
    IdentifiedParameter {
        name: parameter.name.to_owned(),
        value: value.value,
        unit: parameter.unit.to_owned(),
        ci95: value.ci95,
        outside_plausible_range: !parameter.per_session && !is_plausible,
    }
}

/// The signal whose residual the step reduces most. An effect on the measurement noise leaves every residual as it is:
/// there it is the difference between the measured noise and that of the twin.
fn reduction(outcome: &Outcome<'_>, step: &Added) -> Option<Reduction> {
    let channels: &[Channel] =
        outcome.train.parts.first().map_or(&[], |part| part.stage.channels());
    let finite = |value: f64| Some(value).filter(|value| value.is_finite());
    match step.unstated {
        Some(Unstated::Variance(before, after)) => channels.first().map(|channel| Reduction {
            signal: format!("measurement noise of {}", channel.signal),
            unit: channel.unit.to_owned(),
            before: finite(before.max(0.0).sqrt()),
            after: finite(after.max(0.0).sqrt()),
        }),
        Some(Unstated::FramesLost(before, after)) => Some(Reduction {
            signal: "fraction of lost frames".to_owned(),
            unit: "1".to_owned(),
            before: finite(before),
            after: finite(after),
        }),
        None => {
            let (before, after) = &step.held_out_steps;
            let index = (0..before.len())
                .filter(|k| 0.0 < after[*k])
                .max_by(|a, b| (before[*a] / after[*a]).total_cmp(&(before[*b] / after[*b])))?;
            let channel = channels.get(index)?;
            Some(Reduction {
                signal: channel.signal.clone(),
                unit: channel.unit.to_owned(),
                before: finite(before[index]),
                after: finite(after[index]),
            })
        }
    }
}

/// Explanation of an identified effect: law, parameters, reduction of the residual, evidence, second best.
fn explanation(
    step: &Added,
    reduction: Option<&Reduction>,
    parameters: &[IdentifiedParameter],
) -> String {
    let values: Vec<String> = parameters.iter().filter_map(with_interval).collect();
    let mut text = lead(step.axis, step.effect.summary);
    if !values.is_empty() {
        text = format!("{}; {}.", text.trim_end_matches('.'), values.join(", "));
    }
    text += &derived_estimates(step);
    text += &reduction.and_then(|own| reduction_sentence(step, own)).unwrap_or_default();
    text += &format!(
        " The p-value of {:.1e} is of the {}, corrected for {} comparisons.",
        step.p_value, step.data, step.comparisons
    );
    text + &second_best(step)
}

/// Sentence about the origin of the positions among the parameters of `effect`, on a single axis.
fn origin(effect: &Effect, twin: &Twin) -> Option<String> {
    let frame = twin.axis_frame.filter(|_| effect.name == ENDSTOP)?;
    Some(format!(
        " These positions count from {} {}, the middle of the recorded range.",
        significant(frame.position_origin),
        frame.scales.position_unit
    ))
}

/// Sentence about the law of an effect and where it acts.
fn lead(axis: Axis, summary: &str) -> String {
    match axis {
        Axis::Single => sentence(summary),
        _ => sentence(&format!("on {axis}: {summary}")),
    }
}

/// Label, value and 95 % interval of a parameter that the data determine.
fn with_interval(parameter: &IdentifiedParameter) -> Option<String> {
    let [low, high] = parameter.ci95?;
    let unit = match parameter.unit.as_str() {
        "1" => String::new(),
        unit => format!(" {unit}"),
    };
    Some(format!(
        "{} {}{unit} ({} to {})",
        label(&parameter.name),
        significant(parameter.value),
        significant(low),
        significant(high)
    ))
}

/// Sentence about the validation sessions. An effect is added for the fit to the whitened residual, so the RMS may rise.
fn reduction_sentence(step: &Added, reduction: &Reduction) -> Option<String> {
    let Reduction { signal, unit, before: Some(first), after: Some(last) } = reduction else {
        return None;
    };
    let (before, after) = (significant(*first), significant(*last));
    let what = match step.unstated {
        Some(Unstated::FramesLost(..)) => {
            return Some(format!(
                " On the validation sessions it reduces the unexplained {signal} from {before} to {after}."
            ));
        }
        Some(Unstated::Variance(..)) => format!("unexplained {signal}"),
        None => format!("residual of {signal}"),
    };
    let gain = step.validation_gain;
    Some(if last < first || !gain.is_finite() {
        format!(
            " On the validation sessions it reduces the {what} from {before} to {after} {unit} RMS."
        )
    } else {
        format!(
            " On the validation sessions the {what} is {before} {unit} RMS before and {after} {unit} RMS after the step; \
             the squared whitened residual, which the search compares, falls by {:.1} %.",
            100.0 * gain
        )
    })
}

/// Sentence about the other candidates of the round.
fn second_best(step: &Added) -> String {
    if !step.indistinguishable.is_empty() {
        return format!(
            " The data cannot distinguish it from {}.",
            step.indistinguishable.join(" or ")
        );
    }
    let name = |other: &RankedCandidate| other.effect.name;
    match step.ranking.iter().find(|other| step.is_less_significant_than(other)).map(name) {
        Some(name) => {
            format!(
                " {name} is more significant. It was not selected in this step, because it has more \
                 parameters or reduces the residual much less."
            )
        }
        None => step.runner_up().map(name).map_or_else(String::new, |name| {
            format!(" The second best of {} simulated candidates is {name}.", step.ranking.len())
        }),
    }
}

/// Well-known quantities that follow from the parameters of the effect, as they were after the step.
fn derived_estimates(step: &Added) -> String {
    let derived = step.estimates.iter().filter_map(|own| {
        let own = (own.location == step.axis).then_some(own)?;
        let name = own.name.strip_prefix(step.effect.name)?.strip_prefix('.')?;
        let is_derived = step.effect.parameters.iter().all(|parameter| parameter.name != name);
        is_derived.then(|| format!("{} {}", label(name), significant(own.value)))
    });
    match derived.collect::<Vec<_>>().join(", ") {
        none if none.is_empty() => none,
        estimates => format!(" Estimates after this step: {estimates}."),
    }
}

/// Four significant digits, without an exponent where it is not needed.
#[must_use]
pub fn significant(value: f64) -> String {
    let size = value.abs();
    if size == 0.0 || (1e-3..1e5).contains(&size) {
        let before = if size == 0.0 { 1 } else { size.log10().floor() as i32 + 1 };
        format!("{value:.*}", (4 - before).clamp(0, 7) as usize)
    } else {
        format!("{value:.3e}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_have_four_digits() {
        for (value, shown) in
            [(0.0, "0.000"), (12.3456, "12.35"), (-0.012_345_6, "-0.01235"), (2e-7, "2.000e-7")]
        {
            assert_eq!(significant(value), shown);
        }
    }
}
