//! What others do, on the same recordings.
use crate::{axis::AxisTrace, observe::Observation};
use serde::{Deserialize, Serialize};

#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(crate) struct Said {}

pub(crate) fn gantry(_sessions: &[Observation]) -> Said { Said {} }
pub(crate) fn axis(_sessions: &[AxisTrace]) -> Said { Said {} }
