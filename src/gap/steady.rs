//! Whether what an effect does is as large at every speed as its physics says.
//!
//! An effect that imitates another one fits it on average: friction that grows with the place imitates a torque that
//! grows with the product of speed and place, too large at low speeds and too small at high ones. So it meets a rival
//! that does the same in proportion to the measured speed, and has to leave less than that (a test of two models that
//! are not nested: Davidson and MacKinnon, Econometrica 49, 1981, with errors by blocks).

use super::{
    evidence::{Amplitude, Blocks},
    problem::{Problem, dot},
};
use crate::effects::Regressor;

/// One kind of sessions, and whitened residuals of a twin there.
#[derive(Clone, Copy)]
pub(super) struct Seen<'p, 'a> {
    pub(super) problem: &'p Problem<'a>,
    pub(super) without: &'p [f64],
    pub(super) with: &'p [f64],
}

/// Whether the speed at each sample is known.
pub(super) fn are_speeds_known(problem: &Problem<'_>) -> bool {
    problem.parts.iter().all(|part| part.stage.regressor(Regressor::Speed).is_some())
}

/// Whether the residuals without and with an effect, of the fitted and of the judging sessions, go towards its rival:
/// both together by half of `min_amplitude` of the way at least and beyond chance, and each by half of that.
pub(super) fn grows_with_speed(sessions: [Seen<'_, '_>; 2]) -> bool {
    let rivals = sessions.map(|seen| along_speed(&seen));
    let along: f64 =
        rivals.iter().zip(&sessions).map(|(rival, seen)| dot(rival, seen.without)).sum();
    let whole: f64 = rivals.iter().map(|rival| dot(rival, rival)).sum();
    let left = |seen: &Seen<'_, '_>, rival: &[f64]| -> Vec<f64> {
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

/// What the effect does, times the speed, row by row; of the first signal, which is the one whose speed is known.
fn along_speed(seen: &Seen<'_, '_>) -> Vec<f64> {
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
