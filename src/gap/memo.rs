//! Memo of predictions: the search requests the same simulation repeatedly, with another metric or for another test.

use crate::twin::Twin;
use std::{
    collections::HashMap,
    mem,
    sync::{Arc, Mutex, PoisonError},
};

/// Most values that are kept of recent predictions of one stage, and as many again of earlier ones (16 MB).
const MOST_VALUES: usize = 2_000_000;

/// Prediction for one twin: `[channel][sample]`.
type Predicted = Arc<Vec<Vec<f64>>>;

/// All values of a twin and its nuisances on which a prediction depends.
pub(super) type Key = Vec<u64>;

/// Recent predictions of one stage of one session.
#[derive(Default)]
pub(super) struct Memo {
    generations: Mutex<Generations>,
}

/// Recently made or requested predictions, and earlier ones.
#[derive(Default)]
struct Generations {
    young: HashMap<Key, Predicted>,
    old: HashMap<Key, Predicted>,
    /// Number of values in the recent predictions.
    values: usize,
}

/// Key of `twin` with nuisance parameters.
pub(super) fn key(twin: &Twin, nuisance: &[Vec<f64>]) -> Key {
    let mass = twin.controller_reference_mass;
    let mut key = vec![
        twin.striker_mass.to_bits(),
        twin.belt_metres_per_turn.to_bits(),
        u64::from(mass.is_some()),
        mass.unwrap_or(0.0).to_bits(),
        twin.position_origin().to_bits(),
    ];
    for instance in &twin.instances {
        // Names are those of the catalogue, each at its own address.
        key.push(instance.effect.name.as_ptr().addr() as u64);
        key.push(instance.axis as u64);
        key.extend(instance.values.iter().map(|value| value.value.to_bits()));
    }
    key.extend(nuisance.iter().flatten().map(|value| value.to_bits()));
    key
}

impl Memo {
    /// Prediction for `key`, if it is known.
    pub(super) fn get(&self, key: &Key) -> Option<Vec<Vec<f64>>> {
        let mut all = self.generations.lock().unwrap_or_else(PoisonError::into_inner);
        let known = all.young.get(key).cloned().or_else(|| {
            let old = all.old.remove(key)?;
            all.put(key.clone(), Arc::clone(&old));
            Some(old)
        })?;
        drop(all);
        Some(known.to_vec())
    }

    /// Keep the `predicted` values for `key`.
    pub(super) fn put(&self, key: Key, predicted: &[Vec<f64>]) {
        let predicted = Arc::new(predicted.to_vec());
        self.generations.lock().unwrap_or_else(PoisonError::into_inner).put(key, predicted);
    }
}

impl Generations {
    fn put(&mut self, key: Key, predicted: Predicted) {
        self.values += key.len() + predicted.iter().map(Vec::len).sum::<usize>();
        self.young.insert(key, predicted);
        if MOST_VALUES < self.values {
            self.old = mem::take(&mut self.young);
            self.values = 0;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::twin::{Machine, Slot};

    #[test]
    fn the_key_tells_twins_and_nuisances_apart() {
        let twin = Twin::nominal(Machine::Table);
        let mut moved = twin.clone();
        moved.nudge(Slot { instance: 0, parameter: 0 });
        let mut fewer = twin.clone();
        fewer.instances.pop();
        let keys = [
            key(&twin, &[]),
            key(&moved, &[]),
            key(&fewer, &[]),
            key(&twin, &[vec![1.0]]),
            key(&twin, &[vec![2.0]]),
        ];
        for (k, own) in keys.iter().enumerate() {
            assert!(keys[..k].iter().all(|other| other != own));
        }
        assert_eq!(keys[0], key(&twin.clone(), &[]));
    }

    #[test]
    fn requested_predictions_stay_and_others_are_dropped() {
        let memo = Memo::default();
        let many = vec![vec![0.5; MOST_VALUES / 4]];
        for k in 0..20 {
            memo.put(vec![k], &many);
            assert_eq!(memo.get(&vec![0]).as_ref(), Some(&many));
        }
        assert!(memo.get(&vec![1]).is_none() && memo.get(&vec![19]).is_some());
    }
}
