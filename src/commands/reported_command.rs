//! Command line that a result reports as its provenance.

use std::fmt::Display;

/// Command line of a result. Outputs are left out, so that equal results are equal files.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct ReportedCommand(String);

impl ReportedCommand {
    /// Begin with the name of the program and the `subcommand`.
    pub(super) fn new(subcommand: &str) -> Self {
        Self(format!("klasktron {subcommand}"))
    }

    /// Append words: input files, or an option without a value.
    pub(super) fn words(mut self, words: impl IntoIterator<Item: Display>) -> Self {
        for word in words {
            self.0 += &format!(" {word}");
        }
        self
    }

    /// Append an option with its value.
    pub(super) fn option(self, name: &str, value: impl Display) -> Self {
        self.options(name, [value])
    }

    /// Append an option once for each value: none or one of an `Option`, all of a repeatable one.
    pub(super) fn options(mut self, name: &str, values: impl IntoIterator<Item: Display>) -> Self {
        for value in values {
            self.0 += &format!(" --{name} {value}");
        }
        self
    }

    /// The line.
    pub(super) fn into_string(self) -> String {
        self.0
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use clap::Parser;

    /// Arguments of a subcommand alone.
    #[derive(Parser)]
    struct Program<A: clap::Args> {
        #[command(flatten)]
        args: A,
    }

    /// Check that the command line that `reported` gives for the arguments of `line` has all words of `line`, and gives
    /// itself again.
    pub(in crate::commands) fn check_reported<A: clap::Args>(
        line: &str,
        reported: impl Fn(&A) -> String,
    ) {
        let report =
            |line: &str| reported(&Program::<A>::parse_from(line.split_whitespace().skip(1)).args);
        let found = report(line);
        for word in line.split_whitespace() {
            assert!(found.split_whitespace().any(|own| own == word), "{word}: {found}");
        }
        assert_eq!(report(&found), found);
    }

    #[test]
    fn words_and_options_follow_the_subcommand() {
        let line = ReportedCommand::new("gap")
            .words(["a.mcap", "b.mcap"])
            .option("alpha", 0.05)
            .options("twin", None::<&str>)
            .options("only", ["x", "y"])
            .words(true.then_some("--k3"))
            .words(false.then_some("--ablate"));
        assert_eq!(
            line.into_string(),
            "klasktron gap a.mcap b.mcap --alpha 0.05 --only x --only y --k3"
        );
    }
}
