//! Split of a run into training or validation, in the words of markers and metadata.

use serde::{Deserialize, Serialize};
use std::fmt;

/// Split of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Split {
    /// Training data, which may be fitted.
    Train,
    /// Validation data, which is never fitted.
    Validation,
}

impl Split {
    /// Parse a split; `None` for any other text.
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
