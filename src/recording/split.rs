//! What a run is for, as markers and metadata spell it.

use serde::{Deserialize, Serialize};
use std::fmt;

/// What a run is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Split {
    /// May be fitted.
    Train,
    /// Judges; is never fitted.
    Validation,
}

impl Split {
    /// The split that `text` spells; `None` for any other text.
    #[must_use]
    pub fn from_text(text: &str) -> Option<Self> {
        match text {
            "train" => Some(Self::Train),
            "validation" => Some(Self::Validation),
            _ => None,
        }
    }
}

impl fmt::Display for Split {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Train => "train",
            Self::Validation => "validation",
        })
    }
}
