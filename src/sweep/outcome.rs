//! Merged state of a sweep: finished rows, failures, choice, and the files that report them.

use super::{
    Choice, Combination, Metric, Plan, Point, Row, Store, SweepError, choose, combinations, merge,
    page,
    store::{Failure, to_json},
};
use crate::{
    provenance::{GIT_HASH, Provenance},
    recording::{ExistingFile, write_bytes},
};
use serde::Serialize;
use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
};

/// A point without a result, with the reason.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct FailedPoint {
    /// Hash of the point.
    pub hash: String,
    /// Title of the point.
    pub title: String,
    /// Last line of its log, or the end of its task.
    pub reason: String,
    /// Path of the log.
    pub log: PathBuf,
    /// The Slurm task that ran it.
    pub task: Option<String>,
}

impl FailedPoint {
    /// Failure of `point`, from `failure` in the store and its `log`.
    pub(super) fn new(point: &Point, failure: Failure, log: PathBuf) -> Self {
        let Failure { reason, task, .. } = failure;
        Self { hash: point.hash.clone(), title: point.title(), reason, log, task }
    }
}

/// Merged state of all points.
#[derive(Debug, Clone)]
pub struct Merged {
    /// Finished points, in the order of the plan.
    pub rows: Vec<Row>,
    /// Failed points, in the order of the plan.
    pub failures: Vec<FailedPoint>,
    /// Combinations of finished points.
    pub combinations: Vec<Combination>,
    /// Best and chosen combination.
    pub choice: Option<Choice>,
    /// Warnings, as sentences.
    pub warnings: Vec<String>,
}

/// The result document: `sweep.json`.
#[derive(Debug, Serialize)]
struct Document<'a> {
    schema_version: u32,
    command: &'static str,
    points: usize,
    finished: usize,
    metric: &'a Metric,
    combinations: &'a [Combination],
    best: Option<&'a Combination>,
    chosen: Option<&'a Combination>,
    failed: &'a [FailedPoint],
    warnings: &'a [String],
    provenance: &'a Provenance,
}

impl Merged {
    /// Read the results of `plan` in `store`; `known` are further failures reported by an engine.
    ///
    /// # Errors
    /// When the store cannot be read.
    pub fn read(
        plan: &Plan,
        store: &Store,
        known: &BTreeMap<String, FailedPoint>,
    ) -> Result<Self, SweepError> {
        let finished = store.finished(&plan.points)?;
        let (rows, unreadable) = merge::rows(plan, store, &finished);
        let mut warnings = warnings(plan, &rows);
        warnings.extend(unreadable.into_iter().map(|point| {
            let folder = store.folder(point);
            let folder = folder.display();
            format!("{folder}: cannot be read; remove this folder and run the same command again")
        }));
        let recorded = store.failed()?;
        let mut failures = Vec::new();
        for point in plan.points.iter().filter(|point| !finished.contains(&point.hash)) {
            if let Some(failure) = known.get(&point.hash) {
                failures.push(failure.clone());
            } else if let Some(failure) =
                recorded.contains(&point.hash).then(|| store.failure(point)).flatten()
            {
                failures.push(FailedPoint::new(point, failure, store.failed_log(point)));
            }
        }
        let combinations = combinations(plan, &rows);
        let choice = choose(&combinations, plan.metric.better);
        Ok(Self { rows, failures, combinations, choice, warnings })
    }

    /// The result document.
    #[must_use]
    pub fn to_json(&self, plan: &Plan, provenance: &Provenance) -> String {
        let at = |of: fn(Choice) -> usize| self.choice.map(|choice| &self.combinations[of(choice)]);
        to_json(&Document {
            schema_version: 1,
            command: plan.command.name(),
            points: plan.points.len(),
            finished: self.rows.len(),
            metric: &plan.metric,
            combinations: &self.combinations,
            best: at(|choice| choice.best),
            chosen: at(|choice| choice.chosen),
            failed: &self.failures,
            warnings: &self.warnings,
            provenance,
        })
    }

    /// Write `table.csv`, `table.parquet`, `sweep.json`, and `page` as `index.html`, next to the
    /// points.
    ///
    /// # Errors
    /// When a file cannot be written.
    pub fn write(
        &self,
        (plan, store): (&Plan, &Store),
        provenance: &Provenance,
        page: &str,
    ) -> Result<(), SweepError> {
        let root = store.root();
        self.write_files((plan, root), provenance, page).map_err(|error| {
            match error.is_disk_full() {
                true => SweepError::DiskFull { path: root.to_owned() },
                false => error,
            }
        })
    }

    fn write_files(
        &self,
        (plan, root): (&Plan, &Path),
        provenance: &Provenance,
        page: &str,
    ) -> Result<(), SweepError> {
        merge::write_tables(plan, &self.rows, root)?;
        let json = self.to_json(plan, provenance);
        write_bytes(&root.join("sweep.json"), ExistingFile::Replace, json.as_bytes())?;
        write_bytes(&root.join("index.html"), ExistingFile::Replace, page.as_bytes())?;
        Ok(())
    }

    /// Table for people.
    #[must_use]
    pub fn table(&self, plan: &Plan) -> String {
        const MOST: usize = 30;
        let mut lines = vec![format!("{:<44}{:>6}  {}", "combination", "seeds", plan.metric.title)];
        for one in self.combinations.iter().take(MOST) {
            let figure = one.mean.map_or_else(|| "-".to_owned(), page::digits);
            let error = one.standard_error.map(|error| format!(" ± {}", page::digits(error)));
            let (name, seeds) = (page::title(one), one.values.len());
            lines.push(format!("{name:<44}{seeds:>6}  {figure}{}", error.unwrap_or_default()));
        }
        if MOST < self.combinations.len() {
            lines.push(format!("and {} more", self.combinations.len() - MOST));
        }
        if let Some(choice) = self.choice {
            let [best, chosen] =
                [choice.best, choice.chosen].map(|index| page::title(&self.combinations[index]));
            lines.push(format!("best: {best}"));
            lines.push(format!("chosen by the one-standard-error rule: {chosen}"));
        }
        lines.join("\n")
    }
}

/// Warnings about `rows`.
fn warnings(plan: &Plan, rows: &[Row]) -> Vec<String> {
    let mut warnings = Vec::new();
    let others: BTreeSet<&str> =
        rows.iter().map(|row| row.git_hash.as_str()).filter(|hash| *hash != GIT_HASH).collect();
    if !others.is_empty() {
        let others = others.into_iter().collect::<Vec<_>>().join(", ");
        warnings.push(format!(
            "some points were made by commit {others} of the program, this is {GIT_HASH}; remove their folders to run \
             them again"
        ));
    }
    if !rows.is_empty() && rows.iter().all(|row| row.metric.is_none()) {
        warnings.push(format!(
            "no finished point has a number at '{}' of its result; choose another with --metric, see the columns of \
             table.csv",
            plan.metric.path
        ));
    }
    warnings
}
