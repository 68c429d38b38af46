//! Record of submissions: `jobs.json` and the lists of points.

use super::SweepError;
use crate::{
    recording::{ExistingFile, write_bytes},
    sweep::{
        Point,
        store::{read_json, to_json},
    },
};
use serde::{Deserialize, Serialize};
use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::Path,
};

const JOBS_FILE: &str = "jobs.json";

/// Id of an array, and index of a task in it.
pub(super) type Task = (String, usize);

/// An array of jobs.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Array {
    /// Id of the array.
    pub(super) job: String,
    /// Line of the list of task 0.
    pub(super) offset: usize,
    /// Number of tasks.
    pub(super) count: usize,
}

/// A list of points with the arrays that run it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Submission {
    /// File name of the list.
    pub(super) list: String,
    pub(super) arrays: Vec<Array>,
}

/// All submissions, oldest first.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Jobs {
    pub(super) submissions: Vec<Submission>,
}

impl Jobs {
    /// Read the submissions recorded in `folder`; empty without any.
    pub(super) fn read(folder: &Path) -> Self {
        read_json(&folder.join(JOBS_FILE)).unwrap_or_default()
    }

    pub(super) fn write(&self, folder: &Path) -> Result<(), SweepError> {
        let path = folder.join(JOBS_FILE);
        Ok(write_bytes(&path, ExistingFile::Replace, to_json(self).as_bytes())?)
    }

    pub(super) fn is_empty(&self) -> bool {
        self.submissions.iter().all(|submission| submission.arrays.is_empty())
    }

    pub(super) fn job_ids(&self) -> BTreeSet<String> {
        let arrays = self.submissions.iter().flat_map(|submission| &submission.arrays);
        arrays.map(|array| array.job.clone()).collect()
    }

    /// Name of the next list.
    pub(super) fn next_list(&self) -> String {
        format!("points-{:03}.jsonl", self.submissions.len() + 1)
    }

    /// Newest task of every point: array and index in it.
    pub(super) fn tasks(&self, folder: &Path) -> BTreeMap<String, Task> {
        let mut tasks = BTreeMap::new();
        for submission in &self.submissions {
            let hashes = hashes(&folder.join(&submission.list));
            for array in &submission.arrays {
                for task in 0..array.count {
                    if let Some(hash) = hashes.get(array.offset + task) {
                        tasks.insert(hash.clone(), (array.job.clone(), task));
                    }
                }
            }
        }
        tasks
    }
}

/// Hashes in a list. Every line begins with its hash, so that it need not be parsed completely.
fn hashes(list: &Path) -> Vec<String> {
    let text = fs::read_to_string(list).unwrap_or_default();
    let hash = |line: &str| line.strip_prefix("{\"hash\":\"")?.split('"').next().map(str::to_owned);
    text.lines().filter_map(hash).collect()
}

/// Write the points of a submission; returns the name of the file.
pub(super) fn write_list(
    folder: &Path,
    name: String,
    points: &[&Point],
) -> Result<String, SweepError> {
    let mut text = String::new();
    for point in points {
        let line = serde_json::to_string(point).unwrap_or_else(|_plain| unreachable!("plain data"));
        text.push_str(&line);
        text.push('\n');
    }
    write_bytes(&folder.join(&name), ExistingFile::Replace, text.as_bytes())?;
    Ok(name)
}

/// Read the point in line `index`, from 0, of `list`.
///
/// # Errors
/// When there is no such line.
pub fn read_task(list: &Path, index: usize) -> Result<Point, SweepError> {
    let text = fs::read_to_string(list).map_err(SweepError::io(list, "read"))?;
    let point = text.lines().nth(index).and_then(|line| serde_json::from_str(line).ok());
    point.ok_or_else(|| SweepError::NoTask { path: list.to_owned(), index })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_newest_task_of_a_point_counts() {
        let dir = tempfile::tempdir().unwrap();
        let point = |name: &str| Point::new(vec![name.to_owned()], &[]);
        let points = ["a", "b", "c"].map(point);
        let all: Vec<&Point> = points.iter().collect();
        let array = |job: &str, offset, count| Array { job: job.to_owned(), offset, count };
        let first = write_list(dir.path(), "points-001.jsonl".to_owned(), &all).unwrap();
        let second = write_list(dir.path(), "points-002.jsonl".to_owned(), &all[1..2]).unwrap();
        let jobs = Jobs {
            submissions: vec![
                Submission { list: first, arrays: vec![array("7", 0, 2), array("8", 2, 1)] },
                Submission { list: second.clone(), arrays: vec![array("9", 0, 1)] },
            ],
        };
        jobs.write(dir.path()).unwrap();
        assert_eq!(Jobs::read(dir.path()), jobs);
        let tasks = jobs.tasks(dir.path());
        let task = |index: usize| tasks[&points[index].hash].clone();
        assert_eq!(task(0), ("7".to_owned(), 0));
        assert_eq!(task(1), ("9".to_owned(), 0));
        assert_eq!(task(2), ("8".to_owned(), 0));
        assert_eq!(read_task(&dir.path().join(&second), 0).unwrap(), points[1]);
        assert!(read_task(&dir.path().join(second), 1).is_err());
    }
}
