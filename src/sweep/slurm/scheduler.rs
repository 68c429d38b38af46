//! Interface to Slurm's programs: `sbatch`, `squeue`, `scontrol`.

use super::{SweepError, jobs::Task};
use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
    process::{Command, Output},
};

/// Limits on tasks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Limits {
    /// Maximum number of tasks of one array.
    pub(super) array_size: usize,
    /// Maximum number of tasks of one sweep at a time.
    pub(super) most_tasks: usize,
}

/// Defaults of `MaxArraySize` and `MaxJobCount`.
const USUAL_ARRAY_SIZE: usize = 1001;
const USUAL_JOB_COUNT: usize = 10_000;

/// State of a task.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum State {
    /// Not started, or requeued.
    Waiting,
    /// Running, or completing.
    Running,
    /// Ended with status 0.
    Completed,
    /// Ended with another status, or by a signal.
    Failed,
    /// Time limit exceeded.
    TimedOut,
    /// Memory limit exceeded.
    OutOfMemory,
    /// Node failed, and the task was not requeued.
    NodeFailed,
    /// Cancelled by `scancel`.
    Cancelled,
    /// Preempted by a job of a higher priority, and not requeued.
    Preempted,
    /// Deadline missed, or not started because of a node error.
    NotRun,
}

impl State {
    fn named(name: &str) -> Self {
        match name {
            "PENDING" | "REQUEUED" | "REQUEUE_HOLD" | "REQUEUE_FED" | "SPECIAL_EXIT"
            | "RESV_DEL_HOLD" => Self::Waiting,
            "COMPLETED" => Self::Completed,
            "FAILED" => Self::Failed,
            "TIMEOUT" => Self::TimedOut,
            "OUT_OF_MEMORY" => Self::OutOfMemory,
            "NODE_FAIL" => Self::NodeFailed,
            "CANCELLED" => Self::Cancelled,
            "PREEMPTED" | "REVOKED" => Self::Preempted,
            "BOOT_FAIL" | "DEADLINE" => Self::NotRun,
            // RUNNING, CONFIGURING, COMPLETING, SUSPENDED, and future states.
            _ => Self::Running,
        }
    }

    /// Return whether it may still give a result.
    pub(super) fn is_alive(self) -> bool {
        matches!(self, Self::Waiting | Self::Running)
    }
}

/// A task as reported by `squeue`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct TaskState {
    pub(super) job: String,
    pub(super) task: usize,
    pub(super) state: State,
    /// Exit status of its script.
    pub(super) exit_status: i32,
    /// Signal that ended it; 0 without a signal.
    pub(super) signal: i32,
    /// Number of requeues.
    pub(super) restarts: usize,
    /// Reason of its waiting or end, in Slurm's words.
    pub(super) reason: String,
}

impl TaskState {
    /// State of a task that was just submitted.
    pub(super) fn submitted() -> Self {
        Self {
            job: String::new(),
            task: 0,
            state: State::Waiting,
            exit_status: 0,
            signal: 0,
            restarts: 0,
            reason: String::new(),
        }
    }
}

/// Tasks by array and position.
pub(super) type States = BTreeMap<Task, TaskState>;

/// Result of a submission.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Submitted {
    /// Id of the array.
    Job(String),
    /// Limit of Slurm or of the user's account reached.
    Full(String),
}

/// Fields requested from `squeue`, wide enough that no value is cut.
const FIELDS: &str =
    "ArrayJobID:.24,ArrayTaskID:.24,State:.24,exit_code:.24,RestartCnt:.24,Reason:.80";

/// Phrases in the message of `sbatch` for a temporary limit.
const FULL: [&str; 5] = [
    "MaxSubmitJob",
    "MaxJobCount",
    "temporarily unable to accept job",
    "job submit limit",
    "Resource temporarily unavailable",
];
/// Phrase in the message of `squeue` for an unknown job.
const UNKNOWN_JOB: &str = "Invalid job id";
/// Phrases in messages when the controller does not answer.
const NO_ANSWER: [&str; 4] =
    ["Unable to contact", "Connection refused", "timed out", "Zero Bytes were transmitted"];

/// The programs on the PATH.
#[derive(Debug, Clone, Copy)]
pub(super) struct Scheduler;

fn run(program: &'static str, command: &mut Command) -> Result<Output, SweepError> {
    command.output().map_err(|source| SweepError::NoSlurm { program, source })
}

fn said(output: &Output) -> String {
    let text = String::from_utf8_lossy(&output.stderr);
    let lines: Vec<&str> = text.lines().map(str::trim).filter(|line| !line.is_empty()).collect();
    if lines.is_empty() { format!("{}", output.status) } else { lines.join("; ") }
}

impl Scheduler {
    /// Limits of this Slurm installation.
    pub(super) fn limits(self) -> Result<Limits, SweepError> {
        let output = run("scontrol", Command::new("scontrol").args(["show", "config"]))?;
        if !output.status.success() {
            return Err(SweepError::Refused { program: "scontrol", said: said(&output) });
        }
        Ok(limits_of(&String::from_utf8_lossy(&output.stdout)))
    }

    /// Submit an array of `count` tasks that run the lines of `list` from `offset`.
    pub(super) fn submit(
        self,
        script: &Path,
        list: &Path,
        (offset, count): (usize, usize),
    ) -> Result<Submitted, SweepError> {
        let mut command = Command::new("sbatch");
        command.args(["--parsable", &format!("--array=0-{}", count - 1)]);
        command.arg(script).arg(offset.to_string()).arg(list);
        let output = run("sbatch", &mut command)?;
        if !output.status.success() {
            let said = said(&output);
            let full = FULL.iter().any(|word| said.contains(word));
            return if full {
                Ok(Submitted::Full(said))
            } else {
                Err(SweepError::Refused { program: "sbatch", said })
            };
        }
        // `12`, or `12;cluster`.
        let printed = String::from_utf8_lossy(&output.stdout).trim().to_owned();
        let job = printed.split(';').next().unwrap_or_default();
        if job.is_empty() || !job.chars().all(|c| c.is_ascii_digit()) {
            return Err(SweepError::Unexpected { program: "sbatch", printed, expected: "job id" });
        }
        Ok(Submitted::Job(job.to_owned()))
    }

    /// States of all tasks of `jobs` that Slurm knows, including recently ended ones; `None` if it
    /// does not answer.
    pub(super) fn states(self, jobs: &BTreeSet<String>) -> Result<Option<States>, SweepError> {
        let list = jobs.iter().cloned().collect::<Vec<_>>().join(",");
        let mut command = Command::new("squeue");
        command.args([
            "--noheader",
            "--array",
            "--states=all",
            "--jobs",
            &list,
            "--Format",
            FIELDS,
        ]);
        let output = run("squeue", &mut command)?;
        if output.status.success() {
            return Ok(Some(states_of(&String::from_utf8_lossy(&output.stdout))));
        }
        let said = said(&output);
        if said.contains(UNKNOWN_JOB) {
            return Ok(Some(BTreeMap::new()));
        }
        if NO_ANSWER.iter().any(|word| said.contains(word)) {
            return Ok(None);
        }
        Err(SweepError::Refused { program: "squeue", said })
    }
}

fn limits_of(config: &str) -> Limits {
    let number = |name: &str| {
        let line = config.lines().find(|line| line.trim_start().starts_with(name))?;
        line.split_once('=')?.1.trim().parse::<usize>().ok().filter(|number| 0 < *number)
    };
    // Of `SchedulerParameters = a,max_array_tasks=500,b`.
    let most_in_array = config
        .split("max_array_tasks=")
        .nth(1)
        .and_then(|rest| rest.split(|c: char| !c.is_ascii_digit()).next()?.parse::<usize>().ok());
    let array_size = number("MaxArraySize").unwrap_or(USUAL_ARRAY_SIZE);
    let array_size = most_in_array.map_or(array_size, |most| most.clamp(1, array_size));
    // Ended jobs count for some minutes too, and other sweeps have jobs: half is left to them.
    let most_tasks = (number("MaxJobCount").unwrap_or(USUAL_JOB_COUNT) / 2).max(1);
    Limits { array_size: array_size.min(most_tasks), most_tasks }
}

fn states_of(printed: &str) -> States {
    let task = |line: &str| {
        let mut words = line.split_whitespace();
        let job = words.next()?.to_owned();
        let task = words.next()?.parse().ok()?;
        let state = State::named(words.next()?);
        let code: i32 = words.next()?.parse().ok()?;
        let restarts = words.next()?.parse().ok()?;
        let reason = words.collect::<Vec<_>>().join(" ");
        // As in wait(2): the status above eight bits, the signal below.
        let (exit_status, signal) = (code >> 8, code & 0x7f);
        let key = (job.clone(), task);
        Some((key, TaskState { job, task, state, exit_status, signal, restarts, reason }))
    };
    printed.lines().filter_map(task).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_are_those_of_the_configuration() {
        let config = "MaxArraySize            = 501\nMaxJobCount             = 4000\nSchedulerParameters     = \
                      bf_continue,max_array_tasks=100\n";
        assert_eq!(limits_of(config), Limits { array_size: 100, most_tasks: 2000 });
        assert_eq!(limits_of(""), Limits { array_size: 1001, most_tasks: 5000 });
    }

    #[test]
    fn tasks_are_read_as_squeue_prints_them() {
        let states = states_of(
            "   12   0   FAILED   7168   0   NonZeroExitCode\n   12   1   PENDING   0   2   (launch failed \
             requeued held)\n   12   2   TIMEOUT   15   0   TimeLimit\nnonsense\n",
        );
        assert_eq!(states.len(), 3);
        let of = |task: usize| &states[&("12".to_owned(), task)];
        assert_eq!((of(0).state, of(0).exit_status, of(0).signal), (State::Failed, 28, 0));
        assert_eq!((of(1).state, of(1).restarts), (State::Waiting, 2));
        assert_eq!(of(1).reason, "(launch failed requeued held)");
        assert_eq!((of(2).state, of(2).signal), (State::TimedOut, 15));
    }
}
