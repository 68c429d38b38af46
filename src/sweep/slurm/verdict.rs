//! Reasons of tasks without a result: from Slurm's state, the log and the exit status of the
//! script.

use super::{
    PROGRAM_MISSING, TASK_DISK_FULL, TASK_INTERRUPTED,
    scheduler::{State, TaskState},
};
use crate::sweep::{error::NO_SPACE, run::last_words};
use std::{fs, path::Path};

/// State of a task without a result.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Verdict {
    /// In Slurm's queue.
    InQueue(TaskState),
    /// Ended with this reason; `hasty` if no result can be on its way.
    Ended { reason: String, hasty: bool },
}

const TIME: &str = "time limit exceeded; request more with --time and --retry";
const NODE: &str = "node failure; --retry runs it on another node";
const DISK: &str = "the disk of the results is full; free space, then --retry";
const MEMORY: &str = "memory limit exceeded; request more with --mem and --retry";
const CANCELLED: &str = "cancelled; --retry runs it again";

/// State of a task that Slurm reports as `state`, with its log.
pub(super) fn verdict(state: Option<&TaskState>, log: &Path) -> Verdict {
    let Some(state) = state else {
        return Verdict::Ended { reason: of_files(log), hasty: true };
    };
    let reason = match state.state {
        State::Waiting | State::Running => return Verdict::InQueue(state.clone()),
        State::Completed => {
            let reason = "Slurm reports it as completed, but its results are missing; is the output folder the \
                          same on every node? --retry runs it again";
            return Verdict::Ended { reason: reason.to_owned(), hasty: false };
        }
        State::TimedOut => TIME.to_owned(),
        State::OutOfMemory => MEMORY.to_owned(),
        State::NodeFailed => NODE.to_owned(),
        State::Cancelled => CANCELLED.to_owned(),
        State::Preempted => "preempted by another job; --retry runs it again".to_owned(),
        State::NotRun => format!("Slurm could not run it ({}); --retry tries again", state.reason),
        State::Failed if state.signal != 0 => {
            format!("killed by signal {}; --retry runs it again", state.signal)
        }
        State::Failed => of_status(state.exit_status, log),
    };
    Verdict::Ended { reason, hasty: true }
}

/// Reason by the exit status of the script.
fn of_status(status: i32, log: &Path) -> String {
    let said = last_words(log);
    if status == i32::from(PROGRAM_MISSING) {
        let said = said.unwrap_or_else(|| "the program is missing on its node".to_owned());
        return format!("{said}; put it into a folder that every node has, then --retry");
    }
    if status == i32::from(TASK_DISK_FULL) {
        return DISK.to_owned();
    }
    if status == i32::from(TASK_INTERRUPTED) {
        return "terminated; --retry runs it again".to_owned();
    }
    // Shells add the number of a signal to this.
    const SIGNALLED: i32 = 128;
    if SIGNALLED < status {
        return format!("killed by signal {}; --retry runs it again", status - SIGNALLED);
    }
    match said {
        Some(said) => format!("status {status}: {said}; --retry runs it again"),
        None if fs::metadata(log).is_err() => format!(
            "status {status} and no log: could its node write there, and is the disk full? --retry runs it again"
        ),
        None => format!("status {status} without a message; --retry runs it again"),
    }
}

/// Reason by log and exit file, when Slurm no longer knows the task.
fn of_files(log: &Path) -> String {
    let text = fs::read_to_string(log).unwrap_or_default();
    let marks = [
        ("DUE TO TIME LIMIT", TIME),
        ("DUE TO NODE FAILURE", NODE),
        ("oom-kill", MEMORY),
        (NO_SPACE, DISK),
        ("CANCELLED AT", CANCELLED),
    ];
    if let Some((_, reason)) = marks.iter().find(|(mark, _)| text.contains(mark)) {
        return (*reason).to_owned();
    }
    let status = fs::read_to_string(log.with_extension("exit"));
    if let Some(status) = status.ok().and_then(|text| text.trim().parse().ok()) {
        return of_status(status, log);
    }
    "Slurm no longer knows it, and it has no result: killed, or a node failure; --retry runs it again".to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reason(state: State, exit_status: i32, signal: i32, log: &Path) -> String {
        let task = TaskState { state, exit_status, signal, ..TaskState::submitted() };
        match verdict(Some(&task), log) {
            Verdict::Ended { reason, .. } => reason,
            Verdict::InQueue(_) => panic!("still in the queue"),
        }
    }

    #[test]
    fn every_end_has_its_own_way_out() {
        let dir = tempfile::tempdir().unwrap();
        let log = dir.path().join("7_3.log");
        fs::write(&log, "error: /opt/klasktron is not on node n1\n").unwrap();
        for (state, status, signal, part) in [
            (State::TimedOut, 0, 15, "--time"),
            (State::OutOfMemory, 0, 9, "--mem"),
            (State::NodeFailed, 1, 0, "on another"),
            (State::Cancelled, 0, 15, "cancelled"),
            (State::Failed, 127, 0, "/opt/klasktron is not on node n1; put it"),
            (State::Failed, 28, 0, "free space"),
            (State::Failed, 137, 0, "killed by signal 9"),
            (State::Failed, 0, 9, "killed by signal 9"),
            (State::Failed, 2, 0, "status 2: /opt/klasktron"),
        ] {
            let reason = reason(state, status, signal, &log);
            assert!(reason.contains(part), "{state:?}: {reason}");
        }
    }

    #[test]
    fn what_slurm_has_forgotten_is_read_from_its_files() {
        let dir = tempfile::tempdir().unwrap();
        let log = dir.path().join("7_3.log");
        let forgotten = || match verdict(None, &log) {
            Verdict::Ended { reason, hasty: true } => reason,
            other => panic!("{other:?}"),
        };
        assert!(forgotten().contains("no longer knows"));
        fs::write(log.with_extension("exit"), "127\n").unwrap();
        assert!(forgotten().contains("every node has"));
        fs::write(
            &log,
            "slurmstepd: error: *** JOB 5 ON vm CANCELLED AT 2026 DUE TO TIME LIMIT ***\n",
        )
        .unwrap();
        assert_eq!(forgotten(), TIME);
    }

    #[test]
    fn a_task_that_slurm_has_is_waited_for() {
        let task = TaskState::submitted();
        assert_eq!(verdict(Some(&task), Path::new("x")), Verdict::InQueue(task));
    }
}
