//! Schedule of faults, and the currently active ones.

use super::config::{FaultKind, FaultPlan, FaultStart};

const NANOS: f64 = 1e9;

/// Faults of the connection between bus and program.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct LinkFaults {
    /// Probability that a frame is lost.
    pub(super) drop_probability: f64,
    /// Additional delay of frames to the program (ns).
    pub(super) delay_ns: u64,
    pub(super) bus_off: bool,
    pub(super) link_down: bool,
}

/// Start or end of a fault.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Change {
    /// Start of the fault.
    Begins(FaultKind),
    /// End of the fault.
    Ends(FaultKind),
}

impl Change {
    /// Kind of the fault, and true at its start.
    pub(super) fn parts(self) -> (FaultKind, bool) {
        match self {
            Self::Begins(kind) => (kind, true),
            Self::Ends(kind) => (kind, false),
        }
    }
}

/// All faults, with their start and end times (ns since the rig's start).
#[derive(Debug, Clone)]
pub(super) struct Schedule {
    plans: Vec<(FaultPlan, Option<u64>, Phase)>,
    /// Time of the next change.
    next_ns: u64,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Phase {
    Ahead,
    Active,
    Over,
}

fn nanos(seconds: f64) -> u64 {
    (seconds * NANOS).round() as u64
}

impl Schedule {
    pub(super) fn new(plans: &[FaultPlan]) -> Self {
        let begin = |plan: &FaultPlan| match plan.start {
            FaultStart::AtSeconds(at) => Some(nanos(at)),
            FaultStart::AfterArmingSeconds(_) => None,
        };
        let plans = plans.iter().map(|plan| (*plan, begin(plan), Phase::Ahead)).collect();
        let mut schedule = Self { plans, next_ns: 0 };
        schedule.look_ahead();
        schedule
    }

    /// Start the faults that count from the first arming of a drive.
    pub(super) fn armed(&mut self, now_ns: u64) {
        for (plan, begin, _) in &mut self.plans {
            if let FaultStart::AfterArmingSeconds(after) = plan.start {
                begin.get_or_insert(now_ns + nanos(after));
            }
        }
        self.look_ahead();
    }

    /// The next change that is due, if any.
    pub(super) fn next_change(&mut self, now_ns: u64) -> Option<Change> {
        if now_ns < self.next_ns {
            return None;
        }
        let due = self.plans.iter_mut().find(|entry| change_ns(entry) <= now_ns);
        let change = due.map(|(plan, _, phase)| {
            if *phase == Phase::Ahead {
                *phase = Phase::Active;
                Change::Begins(plan.kind)
            } else {
                *phase = Phase::Over;
                Change::Ends(plan.kind)
            }
        });
        self.look_ahead();
        change
    }

    fn look_ahead(&mut self) {
        self.next_ns = self.plans.iter().map(change_ns).min().unwrap_or(u64::MAX);
    }
}

fn change_ns((plan, begin, phase): &(FaultPlan, Option<u64>, Phase)) -> u64 {
    let never = u64::MAX;
    match (begin, phase) {
        (Some(begin), Phase::Ahead) => *begin,
        (Some(begin), Phase::Active) => plan.for_s.map_or(never, |for_s| begin + nanos(for_s)),
        _ => never,
    }
}
