//! `klasktron effects`: the catalogue of physical effects.

use super::{
    Outcome,
    gap::{Inputs, outcome},
    print, tell,
};
use clap::builder::NonEmptyStringValueParser;
use clap::builder::TypedValueParser as _;
use klasktron::{
    effects::{
        self, CATALOGUE, Effect,
        document::{
            AxisForm, DOMAINS, Document, capitalized, markdown, select, similar, symbols_in, title,
        },
    },
    gap::{self, Signature, StageIsolability, Task},
    twin::SessionOptions,
};
use std::{fmt::Write as _, path::PathBuf};

/// Fraction of a squared signature from which a signal is listed.
const LEAST_SHARE: f64 = 0.05;

/// Arguments of `klasktron effects`.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  klasktron effects
  klasktron effects drive.friction
  klasktron effects drive.backlash
  klasktron effects --for circle.mcap ramp.mcap
  klasktron effects --json")]
pub(crate) struct Args {
    /// Effect, or group of effects such as drive.friction [default: all effects by domain]
    #[arg(value_name = "NAME", value_parser = NonEmptyStringValueParser::new().try_map(known))]
    name: Option<String>,
    /// Print which effects the motion of these recordings can show and separate, in which signals
    #[arg(long = "for", value_name = "RECORDING", num_args = 1.., conflicts_with_all = ["name", "markdown", "diagram"])]
    recordings: Vec<PathBuf>,
    /// Twin of the machine of these recordings [default: the built-in one, calibrated on them]
    #[arg(long, value_name = "FILE", requires = "recordings")]
    twin: Option<PathBuf>,
    /// Print one JSON document
    #[arg(long, conflicts_with_all = ["markdown", "diagram"])]
    json: bool,
    /// Print the page docs/effects.md
    #[arg(long, hide = true, conflicts_with_all = ["name", "diagram"])]
    markdown: bool,
    /// Print the diagram docs/pictures/effects.svg
    #[arg(long, hide = true, conflicts_with = "name")]
    diagram: bool,
}

/// Check a typed name against the catalogue.
fn known(name: String) -> Result<String, String> {
    if !select(&name).is_empty() {
        return Ok(name);
    }
    Err(match similar(&name).as_slice() {
        [] => "no such effect; `klasktron effects` lists all".to_owned(),
        names => {
            format!("no such effect; similar: {}; `klasktron effects` lists all", names.join(", "))
        }
    })
}

/// Run `klasktron effects`.
pub(crate) fn run(args: &Args) -> anyhow::Result<Outcome> {
    if !args.recordings.is_empty() {
        return isolability(args);
    }
    let chosen = args.name.as_deref().map_or_else(|| CATALOGUE.to_vec(), select);
    if args.markdown {
        print(markdown().trim_end())?;
    } else if args.diagram {
        print(effects::diagram().trim_end())?;
    } else if args.json {
        print(&serde_json::to_string_pretty(&Document::of(&chosen))?)?;
    } else if let [only] = chosen[..] {
        print(&entry(only))?;
    } else {
        print(&table(&chosen))?;
    }
    Ok(Outcome::Done)
}

/// Print what the motion of the recordings shows of each effect.
fn isolability(args: &Args) -> anyhow::Result<Outcome> {
    let inputs = Inputs::read(&args.recordings, args.twin.as_deref())?;
    let sessions = inputs.sessions(&SessionOptions::default())?;
    let found =
        gap::find(&sessions, inputs.start.as_ref(), Task::Calibrate, gap::Context::default());
    if found.outcomes.is_empty() {
        tell(&found.document.summary);
    } else if args.json {
        print(&serde_json::to_string_pretty(&gap::isolability(&found))?)?;
    } else {
        let stages = gap::isolability(&found).stages;
        stages.iter().try_for_each(|stage| print(stage_table(stage).trim_end()))?;
    }
    Ok(outcome(&found.document, &inputs))
}

/// Effects of one stage: detectability, signals and what the motion does not separate; then what it does not show.
fn stage_table(stage: &StageIsolability) -> String {
    let recordings = match stage.recordings {
        1 => "1 recording".to_owned(),
        count => format!("{count} recordings"),
    };
    let mut text = format!("stage {} ({recordings} to fit)\n", stage.stage);
    let (shown, hidden): (Vec<&Signature>, Vec<&Signature>) =
        stage.effects.iter().partition(|own| own.is_detectable);
    writeln!(text, "  {:<34}{:<10}{:>14}  signals", "effect", "location", "detectability").ok();
    for own in shown {
        let signals: Vec<String> = own
            .signals
            .iter()
            .filter(|own| LEAST_SHARE <= own.fraction)
            .map(|own| format!("{} {:.0} %", own.signal, 100.0 * own.fraction))
            .collect();
        let (name, place) = (own.effect, own.location.to_string());
        let signals = signals.join(", ");
        writeln!(text, "  {name:<34}{place:<10}{:>14.0}  {signals}", own.detectability).ok();
        if !own.inseparable.is_empty() {
            let others: Vec<String> = own
                .inseparable
                .iter()
                .map(|other| {
                    let location = other.location.phrase();
                    format!("{}{location} ({:.2})", other.effect, other.cosine)
                })
                .collect();
            writeln!(text, "{:6}not separable from {}", "", others.join(", ")).ok();
        }
    }
    for own in hidden {
        let (name, place) = (own.effect, own.location.to_string());
        writeln!(text, "  {name:<34}{place:<10}{:>14}  it needs {}", "not shown", own.excitation)
            .ok();
    }
    text
}

/// Effects by domain, with description, parameters and signals.
fn table(chosen: &[&Effect]) -> String {
    let mut text = String::new();
    for domain in DOMAINS {
        let own: Vec<_> = chosen.iter().filter(|effect| effect.domain == domain).collect();
        if own.is_empty() {
            continue;
        }
        writeln!(text, "{}", title(domain)).ok();
        for effect in own {
            let parameters = effect.parameters.iter().map(|own| own.name);
            let signals = effect.signals.iter().map(ToString::to_string);
            writeln!(text, "  {:<32}{}", effect.name, effect.summary).ok();
            writeln!(text, "{:34}parameters: {}", "", parameters.collect::<Vec<_>>().join(", "))
                .ok();
            writeln!(text, "{:34}signals: {}", "", signals.collect::<Vec<_>>().join(", ")).ok();
        }
        text.push('\n');
    }
    text.push_str(
        "`klasktron effects NAME` prints equation, excitation and reference of one effect",
    );
    text
}

/// Full entry of one effect.
fn entry(effect: &'static Effect) -> String {
    let mut text = format!("{}\n{}\n\n", effect.name, capitalized(effect.summary));
    let mut line = |label: &str, value: &str| {
        if !value.is_empty() {
            writeln!(text, "{label:<16}{value}").ok();
        }
    };
    line("equation", effect.equation);
    for (index, (own, null)) in effect.parameters.iter().zip(effect.null).enumerate() {
        let (low, high) = own.plausible;
        let value = format!(
            "{} = {} ({}): typically {low} to {high}; {null} without effect{}",
            own.symbol,
            own.name,
            own.unit,
            if own.per_session { "; one value per session" } else { "" }
        );
        line(if index == 0 { "parameters" } else { "" }, &value);
    }
    let joined = |names: Vec<String>| names.join(", ");
    line("locations", &joined(effect.site.axes().iter().map(ToString::to_string).collect()));
    let signal = |own: &effects::Signal| format!("{own} ({})", own.topic());
    line("signals", &joined(effect.signals.iter().map(signal).collect()));
    line("excitation", effect.excitation);
    if !effect.experiment.is_empty() {
        line("experiment", &format!("klasktron collect --pattern {}", effect.experiment));
    }
    line("confused with", &effect.confused_with.join(", "));
    line("reference", effect.reference);
    for form in AxisForm::all(effect) {
        line("single axis", form.summary);
        line("", form.equation);
        for [name, symbol, unit] in form.parameters {
            line("", &format!("{symbol} = {name} ({unit})"));
        }
    }
    for (index, (symbols, meaning)) in symbols_in(effect.equation).enumerate() {
        line(if index == 0 { "symbols" } else { "" }, &format!("{symbols}: {meaning}"));
    }
    text.trim_end().to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_entry_has_every_field() {
        let text = entry(effects::find("drive.compliance.belt").unwrap());
        let labels = [
            "equation",
            "C = compliance_m_per_n (m/N)",
            "signals",
            "confused",
            "Spong",
            "r = load_fraction (1)",
        ];
        for label in labels {
            assert!(text.contains(label), "{text}");
        }
    }

    #[test]
    fn an_unknown_name_is_refused_with_similar_names() {
        let error = known("drive.backlsh".to_owned()).unwrap_err();
        assert!(error.contains("similar: drive.backlash"), "{error}");
        assert!(known("drive.friction".to_owned()).is_ok());
    }
}
