//! One stage of the chain: measured input, measured output, prediction between them.

use super::{Instance, Twin, noise::FrameLosses};
use crate::effects::{Axis, Domain, Effect, PhaseSeries, Regressor};
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Kind of a stage.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StageKind {
    /// Command to motor motion.
    Drive,
    /// Carriage to camera.
    Camera,
    /// Free rolls of the ball, in pieces.
    Ball,
    /// Free rolls of the ball from end to end.
    WholeRolls,
    /// A single axis.
    Axis,
    /// Positions to reported velocities.
    Estimator,
}

impl std::fmt::Display for StageKind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Drive => "drive",
            Self::Camera => "camera",
            Self::Ball => "ball",
            Self::WholeRolls => "whole_rolls",
            Self::Axis => "axis",
            Self::Estimator => "estimator",
        })
    }
}

/// One measured signal at the stage's output, in order of time.
#[derive(Debug, Clone)]
pub struct Channel {
    /// Name, such as `motor_a.velocity`.
    pub signal: String,
    /// Unit of the values.
    pub unit: &'static str,
    /// Part of the chain in which a gap of this signal shows.
    pub domain: Domain,
    /// Axis of the signal, such as `a` or `x`.
    pub axis: &'static str,
    /// Nominal rate (Hz).
    pub rate_hz: f64,
    /// Time of each sample since the session began (s).
    pub times: Vec<f64>,
    /// Measured values; not finite where a value is missing.
    pub measured: Vec<f64>,
    /// Samples of each run; every channel of a stage has as many runs, in the same order.
    pub runs: Vec<Range<usize>>,
}

/// One stage of one session: its measurements, and their prediction by a twin.
pub trait Stage: Sync {
    /// Kind of the stage.
    fn kind(&self) -> StageKind;

    /// The measured outputs.
    fn channels(&self) -> &[Channel];

    /// Return whether this stage calls the physics of `effect`, so that it can be fitted here.
    fn calls(&self, effect: &Effect) -> bool;

    /// Return whether `effect` changes anything here when it acts on `axis`.
    fn feels(&self, effect: &Effect, _axis: Axis) -> bool {
        self.calls(effect)
    }

    /// Return whether a `parameter` of `instance` changes anything here that no stage before this one shows better.
    fn feels_parameter(&self, instance: &Instance, _parameter: usize) -> bool {
        self.feels(instance.effect, instance.axis)
    }

    /// Runs that share one set of nuisance parameters (starts of rolls, offsets); empty without
    /// any.
    fn nuisance_groups(&self) -> Vec<Range<usize>> {
        Vec::new()
    }

    /// First guess of the nuisance parameters of `group`.
    fn nuisance_start(&self, _group: usize) -> Vec<f64> {
        Vec::new()
    }

    /// Typical magnitude of each nuisance parameter, by which steps of the fit are scaled.
    fn nuisance_scale(&self) -> Vec<f64> {
        Vec::new()
    }

    /// Offset that `nuisance` adds to every sample of each channel, if its parameters do nothing
    /// else; the prediction without is that of zeros.
    fn offsets(&self, _nuisance: &[Vec<f64>]) -> Option<Vec<f64>> {
        None
    }

    /// Quantity on which a residual of the first channel may depend, sample by sample; `None` where
    /// the stage does not know it.
    fn regressor(&self, _regressor: Regressor) -> Option<Vec<f64>> {
        None
    }

    /// Residuals of the channels over the position on which the phase of a ripple depends.
    fn phase_series(&self, residual: &[Vec<f64>]) -> Vec<PhaseSeries> {
        let (Some(position), Some(residual)) =
            (self.regressor(Regressor::Position), residual.first().cloned())
        else {
            return Vec::new();
        };
        vec![PhaseSeries { position, residual, is_filtered: true }]
    }

    /// Length of the blocks of time over which tests and intervals treat errors as dependent (s).
    fn block_seconds(&self) -> f64 {
        0.5
    }

    /// Lost frames of the camera; `None` if no camera measures this stage.
    fn frame_losses(&self) -> Option<&FrameLosses> {
        None
    }

    /// RMS of the noise of all measured signals in the residual of `twin`, for each channel; empty
    /// where the stage does not know it.
    fn noise(&self, _twin: &Twin) -> Vec<f64> {
        Vec::new()
    }

    /// Predict every sample of every channel: `predicted[channel][sample]`, not finite where the
    /// twin predicts nothing. `nuisance[group]` are the parameters of each group.
    fn predict(&self, twin: &Twin, nuisance: &[Vec<f64>], predicted: &mut [Vec<f64>]);

    /// The same for several twins side by side, with the same nuisance parameters:
    /// `predicted[twin][channel][sample]`. Return false, and predict nothing, where the stage
    /// predicts one twin at a time.
    fn predict_each(
        &self,
        _twins: &[&Twin],
        _nuisance: &[Vec<f64>],
        _predicted: &mut [Vec<Vec<f64>>],
    ) -> bool {
        false
    }

    /// Positions on which the phase of a ripple depends; none where the stage does not know them.
    fn phase_positions(&self) -> Vec<f64> {
        let measured: Vec<Vec<f64>> =
            self.channels().iter().map(|channel| channel.measured.clone()).collect();
        let positions = self.phase_series(&measured).into_iter().flat_map(|own| own.position);
        positions.filter(|position| position.is_finite()).collect()
    }

    /// Positions along `axis`, counted as in the effects of `twin`; none where the stage does not know them.
    fn positions_along(&self, _axis: Axis, _twin: &Twin) -> Vec<f64> {
        Vec::new()
    }

    /// [`predict`](Self::predict) of a stage that implements [`predict_each`](Self::predict_each).
    fn predict_alone(&self, twin: &Twin, nuisance: &[Vec<f64>], predicted: &mut [Vec<f64>]) {
        let mut all = [predicted.iter_mut().map(std::mem::take).collect()];
        self.predict_each(&[twin], nuisance, &mut all);
        let [all] = all;
        predicted.iter_mut().zip(all).for_each(|(to, own)| *to = own);
    }

    /// Twins of the same lot are best predicted at once.
    fn lot(&self, _twin: &Twin) -> usize {
        0
    }

    /// Number of twins that are best predicted at once on this processor; the predictions do not
    /// depend on it.
    fn width(&self) -> usize {
        1
    }
}
