//! Test of the speed dependence of an effect against its physics.
//!
//! An effect that imitates another one fits it on average: friction that grows with position imitates a torque
//! proportional to speed times position. It is too large at low speeds and too small at high ones. The rival is the
//! effect multiplied by the measured speed; the effect must have the smaller residual. This is a test of two models
//! that are not nested (Davidson and MacKinnon, Econometrica 49, 1981), with standard errors by blocks.

use super::{
    evidence::{Amplitude, Blocks},
    problem::{Problem, dot},
};
use crate::effects::Regressor;

/// Whitened residuals without and with an effect, on the training or on the validation sessions.
#[derive(Clone, Copy)]
pub(super) struct SessionResiduals<'p, 'a> {
    pub(super) problem: &'p Problem<'a>,
    pub(super) without: &'p [f64],
    pub(super) with: &'p [f64],
}

/// Return whether the speed at each sample is known.
pub(super) fn are_speeds_known(problem: &Problem<'_>) -> bool {
    problem.parts.iter().all(|part| part.stage.regressor(Regressor::Speed).is_some())
}

/// Return whether the data prefer the rival, which grows with speed. The encompassing amplitude must be above half of
/// `min_amplitude` and beyond chance on training and validation sessions together, and above half of that on each.
pub(super) fn grows_with_speed(sessions: [SessionResiduals<'_, '_>; 2]) -> bool {
    let rivals = sessions.map(|seen| speed_rival(&seen));
    let along: f64 =
        rivals.iter().zip(&sessions).map(|(rival, seen)| dot(rival, seen.without)).sum();
    let whole: f64 = rivals.iter().map(|rival| dot(rival, rival)).sum();
    let left = |seen: &SessionResiduals<'_, '_>, rival: &[f64]| -> Vec<f64> {
        seen.without.iter().zip(rival).map(|(all, own)| all - along / whole * own).collect()
    };
    let lefts = [0, 1].map(|kind| left(&sessions[kind], &rivals[kind]));
    let blocks = sessions.map(|seen| seen.problem.blocks());
    let goes = |kind: usize| Amplitude::of(sessions[kind].with, &lefts[kind], &blocks[kind]).value;
    let with = [sessions[0].with, sessions[1].with].concat();
    let together = Amplitude::of(&with, &lefts.concat(), &Blocks::joined(&blocks));
    log::debug!("in proportion to speed rather: {} and {}, {together:?}", goes(0), goes(1));
    let thresholds = sessions[0].problem.thresholds();
    let least = 0.5 * thresholds.min_amplitude;
    least < together.value
        && 0.5 * least < goes(0).min(goes(1))
        && together.is_above(0.0, thresholds.confirmation_level)
}

/// Change by the effect times the speed, row by row; only for the first signal, whose speed is known.
fn speed_rival(seen: &SessionResiduals<'_, '_>) -> Vec<f64> {
    let mut rival = Vec::with_capacity(seen.with.len());
    for part in &seen.problem.parts {
        let speeds = part.stage.regressor(Regressor::Speed).unwrap_or_default();
        rival.extend(part.layout.rows.iter().map(|row| match row.channel {
            0 => speeds.get(row.sample as usize).copied().unwrap_or(0.0),
            _ => 0.0,
        }));
    }
    let effect = seen.without.iter().zip(seen.with).map(|(without, with)| without - with);
    rival.iter_mut().zip(effect).for_each(|(rival, effect)| *rival *= effect);
    rival
}
