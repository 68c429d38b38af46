//! How a result was made, as every result says it.

use serde::Serialize;
use std::sync::LazyLock;

/// Version of this crate.
pub const CRATE_VERSION: &str = env!("CARGO_PKG_VERSION");
/// Commit that this program was built from; `unknown` outside a checkout.
pub const GIT_HASH: &str = env!("KLASKTRON_GIT_HASH");

/// Version and commit, as `--version` prints them; the version alone outside a checkout.
pub static VERSION_LINE: LazyLock<String> = LazyLock::new(|| match GIT_HASH {
    "unknown" => CRATE_VERSION.to_owned(),
    hash => format!("{CRATE_VERSION} ({hash})"),
});

/// What made a result.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Provenance {
    /// The command line that was typed.
    pub command_line: String,
    /// Version of this crate.
    pub crate_version: &'static str,
    /// Commit that the program was built from.
    pub git_hash: &'static str,
}

impl Provenance {
    /// For a result of `command_line`.
    #[must_use]
    pub fn new(command_line: String) -> Self {
        Self { command_line, crate_version: CRATE_VERSION, git_hash: GIT_HASH }
    }

    /// The program by name and value, for a page.
    #[must_use]
    pub fn facts(&self) -> [(&'static str, String); 2] {
        [("crate", self.crate_version.to_owned()), ("commit", self.git_hash.to_owned())]
    }
}
