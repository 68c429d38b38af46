//! `klasktron gap` and `klasktron calibrate`: fit a twin to recordings, and find the effects that it lacks.

use super::{
    Outcome, loss_sentence, note, print,
    reported_command::ReportedCommand,
    results::{OverwriteArgs, Results, refuse_existing_file, write_file},
    search::{SearchArgs, SearchView},
    tell,
};
use anyhow::bail;
use klasktron::{
    gap::{self, Document, Found, Task},
    provenance::Provenance,
    recording::{ExistingFile, Recording, write_bytes},
    twin::{self, SessionError, SessionOptions, Twin},
};
use std::{
    fs,
    path::{Path, PathBuf},
};

/// Files that `klasktron gap` writes.
const FILES: [&str; 5] = ["gap.json", "twin.json", "index.html", "residuals.svg", "gap.mcap"];

/// Arguments of `klasktron gap`.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Example:\n  klasktron gap monday.mcap tuesday.mcap --twin twin.json -o gap"
)]
pub(crate) struct Args {
    /// Recordings, best of at least two sessions; those marked split=validation are held out
    #[arg(required = true, value_name = "RECORDING")]
    recordings: Vec<PathBuf>,
    /// Initial twin [default: the built-in nominal twin]
    #[arg(long, value_name = "FILE")]
    twin: Option<PathBuf>,
    /// Folder for gap.json, twin.json, index.html and gap.mcap
    #[arg(short, long, alias = "out", value_name = "DIR", default_value = "gap")]
    output: PathBuf,
    #[command(flatten)]
    overwrite: OverwriteArgs,
    /// Print only the result document, on stdout
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    search: SearchArgs,
}

/// Arguments of `klasktron calibrate`.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  klasktron calibrate monday.mcap -o twin.json")]
pub(crate) struct CalibrateArgs {
    /// Recordings; those marked split=validation are held out
    #[arg(required = true, value_name = "RECORDING")]
    recordings: Vec<PathBuf>,
    /// Initial twin [default: the built-in nominal twin]
    #[arg(long, value_name = "FILE")]
    twin: Option<PathBuf>,
    /// Twin to write; its report gets the same name with the extension .html
    #[arg(short, long, alias = "out", value_name = "FILE", default_value = "twin.json")]
    output: PathBuf,
    #[command(flatten)]
    overwrite: OverwriteArgs,
    /// Print only the result document, on stdout
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    search: SearchArgs,
}

/// Recordings and initial twin.
pub(super) struct Inputs {
    recordings: Vec<Recording>,
    pub(super) start: Option<Twin>,
    lost: bool,
}

impl Inputs {
    pub(super) fn read(recordings: &[PathBuf], start: Option<&Path>) -> anyhow::Result<Self> {
        let start = start.map(twin::read_twin).transpose()?;
        let mut opened: Vec<Recording> = Vec::new();
        for path in recordings {
            let recording = Recording::open(path)?;
            if opened.iter().any(|other| other.sha256 == recording.sha256) {
                tell(&format!("warning: {} is given twice; it is used once", path.display()));
                continue;
            }
            if !recording.loss.is_none() {
                tell(&format!("warning: {}", loss_sentence(&recording)));
            }
            opened.push(recording);
        }
        let lost = opened.iter().any(|recording| !recording.loss.is_none());
        Ok(Self { recordings: opened, start, lost })
    }

    pub(super) fn sessions(
        &self,
        options: &SessionOptions,
    ) -> Result<Vec<twin::Session>, SessionError> {
        let sessions = twin::sessions_with(&self.recordings, options)?;
        twin::check_machine(&sessions, self.start.as_ref())?;
        Ok(sessions)
    }
}

/// Run `klasktron gap`.
pub(crate) fn run(args: &Args) -> anyhow::Result<Outcome> {
    let inputs = Inputs::read(&args.search.all_of(&args.recordings), args.twin.as_deref())?;
    let sessions = inputs.sessions(&args.search.of_sessions())?;
    let options = args.search.of_search(&sessions)?;
    let mut results = Results::begin(&args.output, &FILES, args.overwrite)?;
    let plural = if sessions.len() == 1 { "" } else { "s" };
    note(&format!("comparing {} session{plural} with the twin", sessions.len()));
    let view = SearchView::new();
    let context = view.context(&options);
    let found = gap::find(&sessions, inputs.start.as_ref(), Task::CloseGap, context);
    view.close();
    let provenance = Provenance::new(args.command_line());
    if !found.has_twin() {
        results.omit("twin.json");
    }
    write_outcome(&found, &provenance, &inputs, &sessions, &mut results)?;
    let written = results.listed();
    results.finish()?;
    for warning in found.document.doubts() {
        tell(&format!("warning: {warning}"));
    }
    if args.json {
        print(&serde_json::to_string_pretty(&found.document)?)?;
    } else {
        print(&summary(&found.document))?;
        print(&format!("wrote {written} in {}", args.output.display()))?;
    }
    Ok(outcome(&found.document, &inputs))
}

/// Run `klasktron calibrate`.
pub(crate) fn calibrate(args: &CalibrateArgs) -> anyhow::Result<Outcome> {
    let report = args.output.with_extension("html");
    if report == args.output {
        bail!("{}: --output is the twin; name it *.json, the report gets .html", report.display());
    }
    for file in [&args.output, &report] {
        refuse_existing_file(file, args.overwrite)?;
    }
    let inputs = Inputs::read(&args.search.all_of(&args.recordings), args.twin.as_deref())?;
    let sessions = inputs.sessions(&args.search.of_sessions())?;
    let options = args.search.of_search(&sessions)?;
    let view = SearchView::new();
    let context = view.context(&options);
    let found = gap::find(&sessions, inputs.start.as_ref(), Task::Calibrate, context);
    view.close();
    if !found.has_twin() {
        tell(&format!("error: {}", found.document.summary));
        if args.json {
            print(&serde_json::to_string_pretty(&found.document)?)?;
        }
        return Ok(Outcome::Lossy);
    }
    if let Some(parent) = args.output.parent().filter(|parent| !parent.as_os_str().is_empty()) {
        fs::create_dir_all(parent)?;
    }
    let name = args.output.file_name().unwrap_or_default().to_string_lossy();
    let provenance = Provenance::new(args.command_line());
    let page = gap::calibration_page(&found, &name, &provenance, &sessions);
    write_file(&args.output, args.overwrite, |_| Ok(twin::write_twin(&found.twin, &args.output)?))?;
    write_file(&report, args.overwrite, |existing| {
        Ok(write_bytes(&report, existing, page.as_bytes())?)
    })?;
    for warning in found.document.doubts() {
        tell(&format!("warning: {warning}"));
    }
    if args.json {
        print(&serde_json::to_string_pretty(&found.document)?)?;
    } else {
        print(&parameters(&found.twin))?;
        print(&residuals(&found.document))?;
        print(&format!("wrote {} and {}", args.output.display(), report.display()))?;
    }
    Ok(outcome(&found.document, &inputs))
}

impl Args {
    /// Command line without the output folder, so that equal results are equal files.
    fn command_line(&self) -> String {
        command_line("gap", &self.recordings, self.twin.as_deref(), &self.search)
    }
}

impl CalibrateArgs {
    /// Command line without the output file, so that equal results are equal files.
    fn command_line(&self) -> String {
        command_line("calibrate", &self.recordings, self.twin.as_deref(), &self.search)
    }
}

fn command_line(
    subcommand: &str,
    recordings: &[PathBuf],
    twin: Option<&Path>,
    search: &SearchArgs,
) -> String {
    ReportedCommand::new(subcommand)
        .words(recordings.iter().map(|path| path.display()))
        .options("twin", twin.map(Path::display))
        .into_string()
        + &search.words()
}

fn write_outcome(
    found: &Found<'_>,
    provenance: &Provenance,
    inputs: &Inputs,
    sessions: &[twin::Session],
    results: &mut Results,
) -> anyhow::Result<()> {
    let document = serde_json::to_string_pretty(&found.document)? + "\n";
    let names: Vec<String> =
        inputs.recordings.iter().map(|recording| recording.path.display().to_string()).collect();
    let page = gap::page(found, &names.join(", "), provenance, sessions);
    gap::write_tape(found, provenance, sessions, &results.path("gap.mcap"))?;
    write_bytes(&results.path("index.html"), ExistingFile::Replace, page.as_bytes())?;
    match gap::residual_figure(found) {
        None => results.omit("residuals.svg"),
        Some(figure) => {
            let svg = figure.map_err(|reason| anyhow::anyhow!("residuals.svg: {reason}"))?;
            write_bytes(&results.path("residuals.svg"), ExistingFile::Replace, svg.as_bytes())?;
        }
    }
    if found.has_twin() {
        twin::write_twin(&found.twin, &results.path("twin.json"))?;
    }
    write_bytes(&results.path("gap.json"), ExistingFile::Replace, document.as_bytes())?;
    Ok(())
}

/// A refused verdict is a failed check: the data say nothing about the machine.
pub(super) fn outcome(document: &Document, inputs: &Inputs) -> Outcome {
    if inputs.lost || !document.verdict.is_about_the_machine() {
        Outcome::Lossy
    } else {
        Outcome::Done
    }
}

/// Result as text.
fn summary(document: &Document) -> String {
    let mut lines = vec![document.summary.clone()];
    for effect in &document.effects {
        lines.push(format!("  {}{}", effect.name, effect.location.phrase()));
        lines.push(format!("    {}", effect.explanation));
    }
    for change in &document.parameter_changes {
        let [before, after] = [change.before, change.after].map(gap::significant);
        let interval = change.ci95.map(|ends| ends.map(gap::significant));
        let interval =
            interval.map_or_else(String::new, |[low, high]| format!(" ({low} to {high})"));
        lines.push(format!(
            "  {}{}: {before} -> {after}{interval} {}",
            change.name,
            change.location.phrase(),
            change.unit
        ));
    }
    for term in document.description.iter().flat_map(|own| &own.terms) {
        let [low, high] = term.ci95.map(gap::significant);
        let coefficient = gap::significant(term.coefficient);
        lines.push(format!(
            "  {}{}: {coefficient} ({low} to {high}) {}",
            term.feature,
            term.location.phrase(),
            term.unit
        ));
    }
    for own in document.description.iter().flat_map(|own| &own.scales) {
        let (origin, scale) = (gap::significant(own.origin), gap::significant(own.scale));
        lines.push(format!(
            "    {} = ({} - {origin} {unit}) / ({scale} {unit})",
            own.symbol,
            own.quantity,
            unit = own.unit
        ));
    }
    lines.push(residuals(document));
    if let Some(next) = &document.next_experiment {
        lines.push(format!("next experiment: {}, which decides {}", next.motion, next.decides));
        lines.extend(next.command.iter().map(|command| format!("  {command}")));
    }
    lines.join("\n")
}

/// Residuals of each signal as a table.
fn residuals(document: &Document) -> String {
    if document.residuals.is_empty() {
        return "no signal was compared".to_owned();
    }
    let mut lines = vec![format!(
        "{:<24}{:>6}{:>12}{:>12}{:>12}",
        "residual (validation)", "unit", "floor", "before", "after"
    )];
    let figure = |value: Option<f64>| value.map_or("-".to_owned(), gap::significant);
    for own in &document.residuals {
        lines.push(format!(
            "{:<24}{:>6}{:>12}{:>12}{:>12}",
            own.signal,
            own.unit,
            figure(own.noise_floor),
            figure(own.validation_before),
            figure(own.validation_after)
        ));
    }
    lines.join("\n")
}

/// Every parameter of a twin with its interval.
fn parameters(twin: &Twin) -> String {
    let mut lines = Vec::new();
    for instance in &twin.instances {
        for (parameter, value) in instance.effect.parameters.iter().zip(&instance.values) {
            let interval = value.ci95.map_or_else(
                || "not fitted".to_owned(),
                |[low, high]| format!("{low:.5} to {high:.5}"),
            );
            lines.push(format!(
                "{:<52}{:>12.5} {:<8} ({interval})",
                format!("{} {} {}", instance.effect.name, instance.axis, parameter.name),
                value.value,
                parameter.unit
            ));
        }
    }
    lines.join("\n")
}
