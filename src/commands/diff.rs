//! `klasktron diff`: effects and parameters in which two twins differ.

use super::{Outcome, print};
use klasktron::{
    gap::significant,
    twin::{self, Change, ParameterDiff, TwinDiff},
};
use std::path::PathBuf;

/// Arguments of `klasktron diff`.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  klasktron diff monday/twin.json tuesday/twin.json
  klasktron diff --json monday/twin.json tuesday/twin.json")]
pub(crate) struct Args {
    /// The first twin
    #[arg(value_name = "BEFORE")]
    before: PathBuf,
    /// The second twin
    #[arg(value_name = "AFTER")]
    after: PathBuf,
    /// Print the JSON document instead of tables
    #[arg(long)]
    json: bool,
}

/// Run `klasktron diff`.
pub(crate) fn run(args: &Args) -> anyhow::Result<Outcome> {
    let diff = TwinDiff::new(&twin::read_twin(&args.before)?, &twin::read_twin(&args.after)?);
    if args.json {
        print(&serde_json::to_string_pretty(&diff)?)?;
    } else {
        print(&table(&diff))?;
    }
    Ok(Outcome::Done)
}

/// A line of the table.
enum Line {
    /// Heading of an effect or of the machine.
    Heading(String),
    /// Parameter, value before, value after, unit, relation of the intervals.
    Cells([String; 5]),
}

/// Differences as a table for people.
fn table(diff: &TwinDiff) -> String {
    let lines = lines(diff);
    let mut text = Vec::new();
    let [before, after] = diff.machines;
    if before != after {
        text.push(format!(
            "different machines: the first twin is a {before}, the second a {after}"
        ));
    }
    if lines.is_empty() {
        text.push(format!("no difference in {} effects", diff.effects.len()));
        return text.join("\n");
    }
    let head = ["  parameter", "before", "after", "unit", "intervals"].map(ToOwned::to_owned);
    let lines: Vec<Line> = std::iter::once(Line::Cells(head)).chain(lines).collect();
    let width = |column: usize| {
        let cells = lines.iter().map(|line| match line {
            Line::Heading(_) => 0,
            Line::Cells(cells) => cells[column].chars().count(),
        });
        cells.max().unwrap_or(0)
    };
    let widths = [0, 1, 2, 3, 4].map(width);
    for line in &lines {
        text.push(match line {
            Line::Heading(heading) => heading.clone(),
            Line::Cells(cells) => {
                let cells = cells.iter().zip(widths).map(|(cell, width)| format!("{cell:<width$}"));
                cells.collect::<Vec<_>>().join("  ").trim_end().to_owned()
            }
        });
    }
    let count = |change: Change| diff.effects.iter().filter(|own| own.change == change).count();
    text.push(format!(
        "effects: {} added, {} removed, {} changed, {} equal",
        count(Change::Added),
        count(Change::Removed),
        count(Change::Changed),
        count(Change::Equal)
    ));
    text.join("\n")
}

/// Lines of what differs: properties of the machine, then effect by effect.
fn lines(diff: &TwinDiff) -> Vec<Line> {
    let mut lines = Vec::new();
    if !diff.properties.is_empty() {
        lines.push(Line::Heading("machine: changed".to_owned()));
    }
    for own in &diff.properties {
        let values = [number(own.before, None), number(own.after, None)];
        lines.push(cells(own.name, values, own.unit, None));
    }
    for effect in diff.effects.iter().filter(|effect| effect.change != Change::Equal) {
        let change = match effect.change {
            Change::Added => "added",
            Change::Removed => "removed",
            Change::Changed | Change::Equal => "changed",
        };
        let location = effect.location.phrase();
        lines.push(Line::Heading(format!("{}{location}: {change}", effect.name)));
        let is_shown =
            |own: &&ParameterDiff| effect.change != Change::Changed || own.before != own.after;
        for own in effect.parameters.iter().filter(is_shown) {
            let values = [number(own.before, own.ci95_before), number(own.after, own.ci95_after)];
            lines.push(cells(own.name, values, own.unit, own.intervals_overlap));
        }
    }
    lines
}

/// Line of one parameter.
fn cells(name: &str, [before, after]: [String; 2], unit: &str, overlap: Option<bool>) -> Line {
    let relation = match overlap {
        Some(true) => "overlap",
        Some(false) => "disjoint",
        None => "",
    };
    Line::Cells([format!("  {name}"), before, after, unit.to_owned(), relation.to_owned()])
}

/// A value with its interval; `-` for none.
fn number(value: Option<f64>, ci95: Option<[f64; 2]>) -> String {
    let Some(value) = value else { return "-".to_owned() };
    let interval = ci95.map_or_else(String::new, |[low, high]| {
        format!(" ({} to {})", significant(low), significant(high))
    });
    format!("{}{interval}", significant(value))
}

#[cfg(test)]
mod tests {
    use super::*;
    use klasktron::{
        effects::{self, Axis},
        twin::{Instance, Machine, Source, Twin},
    };

    #[test]
    fn the_table_names_what_changed_and_counts() {
        let before = Twin::nominal(Machine::Table);
        let mut after = before.clone();
        let delay = effects::find("drive.delay").unwrap();
        after.instances.push(Instance::new(delay, Axis::Motors, &[0.0083], Source::Fitted));
        let text = table(&TwinDiff::new(&before, &after));
        assert!(
            text.contains("drive.delay on a+b: added\n  delay_s    -       0.008300  s"),
            "{text}"
        );
        assert!(text.ends_with("effects: 1 added, 0 removed, 0 changed, 10 equal"), "{text}");
        assert_eq!(table(&TwinDiff::new(&before, &before)), "no difference in 10 effects");
    }
}
