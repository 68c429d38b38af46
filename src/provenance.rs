//! Provenance of a result: command line, version and commit.

use serde::Serialize;
use std::sync::LazyLock;

/// Version of this crate.
pub const CRATE_VERSION: &str = env!("CARGO_PKG_VERSION");
/// Commit of the source of this program; `unknown` outside a checkout.
pub const GIT_HASH: &str = env!("KLASKTRON_GIT_HASH");

/// Version and commit as printed by `--version`; the version alone outside a checkout.
pub static VERSION_LINE: LazyLock<String> = LazyLock::new(|| match GIT_HASH {
    "unknown" => CRATE_VERSION.to_owned(),
    hash => format!("{CRATE_VERSION} ({hash})"),
});

/// Provenance of a result.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Provenance {
    /// Command line of the run.
    pub command_line: String,
    /// Version of this crate.
    pub crate_version: &'static str,
    /// Commit of the source of this program.
    pub git_hash: &'static str,
}

impl Provenance {
    /// Create the provenance of a result of `command_line`.
    #[must_use]
    pub fn new(command_line: String) -> Self {
        Self { command_line, crate_version: CRATE_VERSION, git_hash: GIT_HASH }
    }

    /// Return the program as pairs of name and value, for a page.
    #[must_use]
    pub fn facts(&self) -> [(&'static str, String); 2] {
        [("crate", self.crate_version.to_owned()), ("commit", self.git_hash.to_owned())]
    }
}
