//! Reflection of samples, for tasks that are symmetric under it.
//!
//! Half of the samples of every minibatch are replaced by their reflections, drawn anew for each
//! epoch. This doubles the data without another step of an environment, and at no cost in
//! learning. The log-probability of the original action stands for that of its reflection, as in
//! the symmetry augmentation of RSL-RL (Mittal et al., "Symmetry Considerations for Learning
//! Task Symmetric Robot Policies", 2024, section IV-A): it is exact for a symmetric policy, and
//! training draws the policy towards one.

use crate::nn::{MAX_OUTPUTS, Standardizer};

/// Signs of observations and actions under a reflection that maps the task to itself: dynamics and
/// reward are the same.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Reflection {
    /// Sign of each observed value, 1 or -1, `[observations]`.
    pub observations: Vec<i8>,
    /// Sign of each action, 1 or -1, `[actions]`.
    pub actions: Vec<i8>,
}

/// Marks the index of a sample that is used reflected.
const REFLECTED: u32 = 1 << 31;

/// Maximum number of samples in an update: all larger numbers mark reflected ones.
pub(super) const MOST_SAMPLES: usize = REFLECTED as usize;

/// Mark every second sample of a shuffled order.
pub(super) fn reflect_half(order: &mut [u32]) {
    order.iter_mut().skip(1).step_by(2).for_each(|entry| *entry |= REFLECTED);
}

/// Index of the sample of an entry.
pub(super) fn index_of(entry: u32) -> usize {
    (entry & !REFLECTED) as usize
}

/// Return whether the sample of an entry is used reflected.
pub(super) fn is_reflected(entry: u32) -> bool {
    entry & REFLECTED != 0
}

/// A reflection of standardised observations: `z' = shift + sign z`.
#[derive(Debug, Clone, Default)]
pub(super) struct StandardReflection {
    signs: Vec<f32>,
    shifts: Vec<f32>,
    actions: [f32; MAX_OUTPUTS],
}

impl StandardReflection {
    /// Reflection of observations standardised by `standardizer`. The limit of the normalization is
    /// not applied again: it is symmetric, and the mean of a reflected value is close to zero.
    pub(super) fn new(reflection: &Reflection, standardizer: &Standardizer) -> Self {
        let of = standardizer.mean.iter().zip(&standardizer.scale).zip(&reflection.observations);
        let mut actions = [1.0; MAX_OUTPUTS];
        for (sign, own) in actions.iter_mut().zip(&reflection.actions) {
            *sign = f32::from(*own);
        }
        Self {
            signs: reflection.observations.iter().map(|sign| f32::from(*sign)).collect(),
            shifts: of
                .map(|((mean, scale), sign)| if *sign < 0 { -2.0 * mean * scale } else { 0.0 })
                .collect(),
            actions,
        }
    }

    /// Append the reflection of a standardised observation to `out`.
    #[inline]
    pub(super) fn observe(&self, standard: &[f32], out: &mut Vec<f32>) {
        let by = self.signs.iter().zip(&self.shifts);
        out.extend(standard.iter().zip(by).map(|(z, (sign, shift))| shift + sign * z));
    }

    /// Signs of the actions.
    pub(super) fn actions(&self) -> &[f32; MAX_OUTPUTS] {
        &self.actions
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reflected_observation_is_the_standardised_one_of_the_reflected_values() {
        let standardizer =
            Standardizer { mean: vec![0.3, -1.0], scale: vec![2.0, 5.0], limit: 10.0 };
        let reflection = Reflection { observations: vec![-1, 1], actions: vec![-1] };
        let standard = StandardReflection::new(&reflection, &standardizer);
        let (seen, reflected) = ([0.7, 0.2], [-0.7, 0.2]);
        let (mut before, mut expected) = ([0.0; 2], [0.0; 2]);
        standardizer.apply(&seen, &mut before);
        standardizer.apply(&reflected, &mut expected);
        let mut found = Vec::new();
        standard.observe(&before, &mut found);
        assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{found:?}");
        assert_eq!(standard.actions()[0], -1.0);
    }

    #[test]
    fn every_second_entry_is_marked_and_keeps_its_index() {
        let mut order = [7, 0, 3, 9];
        reflect_half(&mut order);
        assert_eq!(order.map(index_of), [7, 0, 3, 9]);
        assert_eq!(order.map(is_reflected), [false, true, false, true]);
    }
}
