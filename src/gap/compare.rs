//! Comparison of recorded sessions with an unchanged twin: no parameter of the twin is fitted.

use super::{fit, problem::Problem};
use crate::{
    recording::Split,
    twin::{Session, Stage, StageKind, Twin},
};

/// One signal of one session: measured, and simulated by a twin.
#[derive(Debug, Clone)]
pub struct ComparedSignal {
    /// Session in which it was measured.
    pub session: String,
    /// Purpose of the session.
    pub split: Split,
    /// Stage of the measured chain.
    pub stage: StageKind,
    /// Signal, such as `motor_a.velocity`.
    pub signal: String,
    /// Unit of the values.
    pub unit: &'static str,
    /// Time of each sample since the session began (s).
    pub times: Vec<f64>,
    /// Measured values; NaN where none was measured.
    pub measured: Vec<f64>,
    /// Measured minus simulated; NaN where either is missing.
    pub residual: Vec<f64>,
}

impl ComparedSignal {
    /// Return the RMS of the finite residuals; `None` without any.
    #[must_use]
    pub fn residual_rms(&self) -> Option<f64> {
        let finite = || self.residual.iter().filter(|own| own.is_finite());
        let count = finite().count();
        (0 < count).then(|| (finite().map(|own| own * own).sum::<f64>() / count as f64).sqrt())
    }
}

/// Compare `twin` with every signal of `sessions`, stage by stage. Only nuisance parameters (initial states of rolls,
/// offsets of the camera) and parameters that belong to a session are fitted.
#[must_use]
pub fn compare(sessions: &[Session], twin: &Twin) -> Vec<ComparedSignal> {
    sessions.iter().flat_map(|session| of_session(session, twin)).collect()
}

fn of_session(session: &Session, twin: &Twin) -> Vec<ComparedSignal> {
    let stages = session.stages();
    stages.into_iter().flat_map(|stage| of_stage(session, stage, twin)).collect()
}

fn of_stage(session: &Session, stage: &dyn Stage, twin: &Twin) -> Vec<ComparedSignal> {
    let problem = Problem::new(&[stage], twin);
    let point = fit::with_refitted_nuisances(&problem, &problem.start(twin.clone()));
    let residuals = problem.residuals(&point).swap_remove(0);
    let channels = stage.channels().iter().zip(residuals);
    channels
        .map(|(channel, residual)| ComparedSignal {
            session: session.name.clone(),
            split: session.split,
            stage: stage.kind(),
            signal: channel.signal.clone(),
            unit: channel.unit,
            times: channel.times.clone(),
            measured: channel.measured.clone(),
            residual,
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        recording::Recording,
        twin::{Machine, sessions_of},
    };
    use std::path::Path;

    #[test]
    fn residuals_are_measured_minus_simulated_and_depend_on_the_twin() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/example-train.mcap");
        let sessions = sessions_of(&[Recording::open(&path).unwrap()]).unwrap();
        let rms = |twin: &Twin| {
            let compared = compare(&sessions, twin);
            let own = compared.iter().find(|own| own.signal == "motor_a.velocity").unwrap();
            assert_eq!(own.times.len(), own.residual.len());
            own.residual_rms().unwrap()
        };
        let plain = Twin::nominal(Machine::Table);
        let mut slow = plain.clone();
        let ramp = slow.instances.iter_mut().find(|own| own.effect.name == "drive.saturation.slew");
        ramp.unwrap().values[0].value = 1.0;
        let (plain, slow) = (rms(&plain), rms(&slow));
        assert!(0.0 < plain && 1.5 * plain < slow, "{plain} {slow}");
    }
}
