//! What was predicted before: the search asks for the same simulation again and again, with another metric or for
//! another test.

use crate::twin::Twin;
use std::{
    collections::HashMap,
    mem,
    sync::{Arc, Mutex, PoisonError},
};

/// Most numbers that are kept of recent predictions of one stage, and as many again of those before (16 MB).
const MOST_NUMBERS: usize = 2_000_000;

/// What is predicted for one twin: `[channel][sample]`.
type Predicted = Arc<Vec<Vec<f64>>>;

/// All numbers of a twin and its nuisances on which a prediction depends.
pub(super) type Key = Vec<u64>;

/// Recent predictions of one stage of one session.
#[derive(Default)]
pub(super) struct Memo {
    generations: Mutex<Generations>,
}

/// Predictions that were made or asked for lately, and those before.
#[derive(Default)]
struct Generations {
    young: HashMap<Key, Predicted>,
    old: HashMap<Key, Predicted>,
    /// Numbers in the young predictions.
    numbers: usize,
}

/// The key of `twin` with nuisance numbers.
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
        // Names are those of the catalogue, each at its place.
        key.push(instance.effect.name.as_ptr().addr() as u64);
        key.push(instance.axis as u64);
        key.extend(instance.values.iter().map(|value| value.value.to_bits()));
    }
    key.extend(nuisance.iter().flatten().map(|value| value.to_bits()));
    key
}

impl Memo {
    /// What was predicted for `key`, if that is known.
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

    /// Keeps what was `predicted` for `key`.
    pub(super) fn put(&self, key: Key, predicted: &[Vec<f64>]) {
        let predicted = Arc::new(predicted.to_vec());
        self.generations.lock().unwrap_or_else(PoisonError::into_inner).put(key, predicted);
    }
}

impl Generations {
    fn put(&mut self, key: Key, predicted: Predicted) {
        self.numbers += key.len() + predicted.iter().map(Vec::len).sum::<usize>();
        self.young.insert(key, predicted);
        if MOST_NUMBERS < self.numbers {
            self.old = mem::take(&mut self.young);
            self.numbers = 0;
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
    fn what_is_asked_for_stays_and_the_rest_is_forgotten() {
        let memo = Memo::default();
        let many = vec![vec![0.5; MOST_NUMBERS / 4]];
        for k in 0..20 {
            memo.put(vec![k], &many);
            assert_eq!(memo.get(&vec![0]).as_ref(), Some(&many));
        }
        assert!(memo.get(&vec![1]).is_none() && memo.get(&vec![19]).is_some());
    }
}
