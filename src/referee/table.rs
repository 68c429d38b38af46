//! Table of episodes, one row each, for other software.

use super::document::{EpisodeScore, Score};
use crate::recording::{
    ExistingFile, RecordingError,
    table::{Column, ColumnFormat, Values, write_columns},
};
use std::path::Path;

/// Write the episodes of `score` to `path`.
///
/// # Errors
/// When the file cannot be written.
pub fn write_episodes(
    score: &Score,
    path: &Path,
    format: ColumnFormat,
) -> Result<(), RecordingError> {
    let columns = columns(score);
    let rows = score.matches.iter().map(|m| m.episodes.len()).sum();
    write_columns(&columns, rows, path, format, ExistingFile::Replace)
}

fn columns(score: &Score) -> Vec<Column> {
    let rows: Vec<(&str, usize, &EpisodeScore)> = score
        .matches
        .iter()
        .flat_map(|m| m.episodes.iter().enumerate().map(|(at, e)| (m.file.as_str(), at, e)))
        .collect();
    let column = |name: &str, values: Values| Column { name: name.to_owned(), values };
    let text = |name: &str, of: &dyn Fn(&EpisodeScore) -> Option<&'static str>| {
        let values = rows.iter().map(|(.., episode)| of(episode).map(str::to_owned)).collect();
        column(name, Values::Text(values))
    };
    let number = |name: &str, of: &dyn Fn(&EpisodeScore) -> Option<f64>| {
        column(name, Values::F64(rows.iter().map(|(.., episode)| of(episode)).collect()))
    };
    let count = |name: &str, of: &dyn Fn(&EpisodeScore) -> usize| {
        let values = rows.iter().map(|(.., episode)| Some(of(episode) as u64)).collect();
        column(name, Values::Unsigned(values))
    };
    let files = rows.iter().map(|(file, ..)| Some((*file).to_owned())).collect();
    let indices = rows.iter().map(|(_, at, _)| Some(*at as u64)).collect();
    vec![
        column("file", Values::Text(files)),
        column("episode", Values::Unsigned(indices)),
        number("start_s", &|episode| Some(episode.start_s)),
        number("end_s", &|episode| Some(episode.end_s)),
        text("outcome", &|episode| Some(episode.outcome.name())),
        text("scorer", &|episode| episode.scorer.map(|player| player.name())),
        count("contacts", &|episode| episode.contacts),
        count("blocks_left", &|episode| episode.blocks_left),
        count("blocks_right", &|episode| episode.blocks_right),
        count("strikes_left", &|episode| episode.strikes_left),
        count("strikes_right", &|episode| episode.strikes_right),
        count("goal_directed_left", &|episode| episode.goal_directed_left),
        count("goal_directed_right", &|episode| episode.goal_directed_right),
        number("possession_left", &|episode| episode.possession_left),
    ]
}
