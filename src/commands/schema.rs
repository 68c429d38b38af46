//! `klasktron schema`: JSON Schema of a result document.

use super::{Outcome, print};
use clap::ValueEnum;

/// Documents that have a schema.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum DocumentKind {
    /// `gap.json`, result of `klasktron gap`
    Gap,
    /// `twin.json`, simulation model of one machine
    Twin,
    /// `ekf.json`, result of `klasktron tune-ekf`
    Ekf,
    /// `score.json`, result of `klasktron eval`
    Score,
    /// Output of `klasktron info --json`
    Info,
    /// `sweep.json`, result of `klasktron sweep`
    Sweep,
}

/// Arguments of `klasktron schema`.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  klasktron schema gap > gap.schema.json
  check-jsonschema --schemafile gap.schema.json gap/gap.json")]
pub(crate) struct Args {
    /// Document
    #[arg(value_enum, value_name = "DOCUMENT")]
    document: DocumentKind,
}

impl DocumentKind {
    /// JSON Schema, draft 2020-12.
    fn schema(self) -> &'static str {
        match self {
            Self::Gap => include_str!("../../datasets_schema/gap.schema.json"),
            Self::Twin => include_str!("../../datasets_schema/twin.schema.json"),
            Self::Ekf => include_str!("../../datasets_schema/ekf.schema.json"),
            Self::Score => include_str!("../../datasets_schema/score.schema.json"),
            Self::Info => include_str!("../../datasets_schema/info.schema.json"),
            Self::Sweep => include_str!("../../datasets_schema/sweep.schema.json"),
        }
    }
}

/// Run `klasktron schema`.
pub(crate) fn run(args: &Args) -> anyhow::Result<Outcome> {
    print(args.document.schema().trim_end())?;
    Ok(Outcome::Done)
}
