//! The referee: events and score of recorded matches.

use crate::{
    arrays::{from_json, rows, vector},
    error::raised,
};
use klasktron::{
    parallel,
    recording::topic::Player,
    referee::{Event, Rules, Score, ScoredMatch, analyze_matches},
};
use pyo3::{
    prelude::*,
    types::{PyDict, PyList},
};
use std::path::PathBuf;

/// Score of `matches`: the document `score.json`, the events of each match, and warnings.
#[pyfunction]
pub(crate) fn score_matches<'py>(
    py: Python<'py>,
    matches: Vec<PathBuf>,
    seed: u64,
) -> PyResult<Bound<'py, PyDict>> {
    let (document, scored) = py.detach(|| {
        let threads = parallel::cores();
        let scored: Vec<ScoredMatch> =
            analyze_matches(&matches, &Rules::default(), threads, &|| {})
                .into_iter()
                .collect::<Result<_, _>>()
                .map_err(raised)?;
        let document = serde_json::to_string(&Score::new(&scored, seed)).map_err(raised)?;
        Ok::<_, PyErr>((document, scored))
    })?;
    let events = PyList::empty(py);
    for own in &scored {
        events.append(columns(py, &own.analysis.events)?)?;
    }
    let lossy = scored.iter().filter(|own| !own.loss.is_none());
    let warnings: Vec<String> = lossy.map(|own| own.loss.sentence(&own.path)).collect();
    let parts = PyDict::new(py);
    parts.set_item("document", from_json(py, &document)?)?;
    parts.set_item("events", events)?;
    parts.set_item("warnings", warnings)?;
    Ok(parts)
}

fn columns<'py>(py: Python<'py>, events: &[Event]) -> PyResult<Bound<'py, PyDict>> {
    let texts = |of: &dyn Fn(&Event) -> String| -> PyResult<Bound<'py, PyAny>> {
        let list = PyList::new(py, events.iter().map(of))?;
        py.import("numpy")?.call_method1("array", (list, "O"))
    };
    let pairs = |of: fn(&Event) -> [f64; 2]| events.iter().map(of).collect::<Vec<_>>();
    let columns = PyDict::new(py);
    columns.set_item("time_s", vector(py, events.iter().map(|own| own.time).collect()))?;
    columns.set_item("kind", texts(&|own| own.kind.name().to_owned())?)?;
    columns.set_item("player", texts(&|own| player_name(own.player).to_owned())?)?;
    let episodes: Vec<u64> = events.iter().map(|own| own.episode as u64).collect();
    columns.set_item("episode", vector(py, episodes))?;
    columns.set_item("position_m", rows(py, &pairs(|own| own.position))?)?;
    columns.set_item("velocity_in_m_per_s", rows(py, &pairs(|own| own.velocity_in))?)?;
    columns.set_item("velocity_out_m_per_s", rows(py, &pairs(|own| own.velocity_out))?)?;
    let directed: Vec<bool> = events.iter().map(|own| own.goal_directed).collect();
    columns.set_item("goal_directed", vector(py, directed))?;
    let confidence: Vec<f64> = events.iter().map(|own| own.confidence).collect();
    columns.set_item("confidence", vector(py, confidence))?;
    Ok(columns)
}

fn player_name(player: Option<Player>) -> &'static str {
    player.map_or("", Player::name)
}
