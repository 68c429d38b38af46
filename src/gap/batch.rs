//! Batching of simulations from parallel work.
//!
//! Many fits run at once, and each requests few simulations at a time. A stage that simulates several twins side by
//! side ([`Stage::width`]) is far cheaper per twin. So [`in_parallel`] gives each item its own thread. [`predict_each`]
//! waits until the threads together request enough, or until all of them wait. The composition of a batch depends on
//! timing; the predictions do not.

use crate::{
    parallel::{in_parallel_on, threads},
    twin::{Stage, Twin},
};
use std::{
    cell::RefCell,
    collections::BTreeMap,
    sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError},
};

/// Most items that are processed at once.
const MOST_WORKERS: usize = 32;

/// Prediction for one twin: `[channel][sample]`.
type Predicted = Vec<Vec<f64>>;

thread_local! {
    /// Exchange of the item on which this thread works.
    static CURRENT: RefCell<Option<Arc<Exchange>>> = const { RefCell::new(None) };
}

/// Apply `work` to every item; the simulations of all items run side by side. The results are in the order of the
/// items, and independent of the number of threads. A panic in `work` propagates to the caller.
pub(super) fn in_parallel<T: Sync, R: Send>(items: &[T], work: impl Fn(&T) -> R + Sync) -> Vec<R> {
    let is_inside = CURRENT.with_borrow(Option::is_some);
    if is_inside || items.len() < 2 {
        return items.iter().map(work).collect();
    }
    let workers = items.len().min(MOST_WORKERS);
    let exchange = Arc::new(Exchange::new(workers, items.len(), threads()));
    in_parallel_on(workers, items, |item| {
        let _membership = Membership::new(&exchange);
        work(item)
    })
}

/// Predictions of `stage` for each of `twins`.
pub(super) fn predict_each(
    stage: &dyn Stage,
    twins: &[&Twin],
    nuisance: &[Vec<f64>],
) -> Vec<Predicted> {
    let width = stage.width();
    if 1 < width
        && let Some(exchange) = CURRENT.with_borrow(Option::clone)
    {
        return exchange.predict_each(stage, twins, nuisance);
    }
    let groups: Vec<&[&Twin]> = twins.chunks(width).collect();
    let run = |twins: &&[&Twin]| simulated(stage, twins, nuisance);
    let threads = if CURRENT.with_borrow(Option::is_some) { 1 } else { threads() };
    in_parallel_on(threads, &groups, run).into_iter().flatten().collect()
}

/// Address of `stage`, which identifies it during its lifetime.
pub(super) fn address_of(stage: &dyn Stage) -> usize {
    std::ptr::from_ref(stage).cast::<u8>().addr()
}

fn simulated(stage: &dyn Stage, twins: &[&Twin], nuisance: &[Vec<f64>]) -> Vec<Predicted> {
    let channels = stage.channels().iter();
    let nothing: Predicted = channels.map(|channel| vec![f64::NAN; channel.times.len()]).collect();
    let mut predicted = vec![nothing; twins.len()];
    if !stage.predict_each(twins, nuisance, &mut predicted) {
        for (twin, predicted) in twins.iter().zip(&mut predicted) {
            stage.predict(twin, nuisance, predicted);
        }
    }
    predicted
}

/// Work of one thread on one item.
struct Membership<'e> {
    exchange: &'e Arc<Exchange>,
}

impl<'e> Membership<'e> {
    fn new(exchange: &'e Arc<Exchange>) -> Self {
        CURRENT.set(Some(Arc::clone(exchange)));
        drop(exchange.permitted(exchange.state()));
        Self { exchange }
    }
}

impl Drop for Membership<'_> {
    fn drop(&mut self) {
        CURRENT.set(None);
        let mut state = self.exchange.state();
        state.permits += 1;
        state.unfinished -= 1;
        state.is_broken |= std::thread::panicking();
        self.exchange.changed.notify_all();
    }
}

/// Exchange of requests between the threads of one [`in_parallel`].
struct Exchange {
    state: Mutex<State>,
    changed: Condvar,
    workers: usize,
}

struct State {
    /// Number of further threads that may compute.
    permits: usize,
    /// Number of unfinished items.
    unfinished: usize,
    /// Number of incomplete orders.
    waiting: usize,
    /// `true` after a panic in a thread, so that no other thread waits for it.
    is_broken: bool,
    pending: Vec<Request>,
    orders: BTreeMap<u64, Order>,
    next_order: u64,
}

/// Request of one simulation.
struct Request {
    order: u64,
    index: usize,
    /// Address of the stage, which lives while a thread waits.
    stage: usize,
    /// [`Stage::lot`] of the twin.
    lot: usize,
    twin: Twin,
    nuisance: Vec<Vec<f64>>,
}

/// Requests for which one thread waits.
struct Order {
    missing: usize,
    results: Vec<Predicted>,
}

impl Exchange {
    fn new(workers: usize, items: usize, threads: usize) -> Self {
        let state = State {
            permits: threads,
            unfinished: items,
            waiting: 0,
            is_broken: false,
            pending: Vec::new(),
            orders: BTreeMap::new(),
            next_order: 0,
        };
        Self { state: Mutex::new(state), changed: Condvar::new(), workers }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Wait for a change.
    fn wait<'s>(&self, state: MutexGuard<'s, State>) -> MutexGuard<'s, State> {
        self.changed.wait(state).unwrap_or_else(PoisonError::into_inner)
    }

    /// Wait for the permission to compute.
    fn permitted<'s>(&self, mut state: MutexGuard<'s, State>) -> MutexGuard<'s, State> {
        while state.permits == 0 {
            state = self.wait(state);
        }
        state.permits -= 1;
        state
    }

    fn predict_each(
        &self,
        stage: &dyn Stage,
        twins: &[&Twin],
        nuisance: &[Vec<f64>],
    ) -> Vec<Predicted> {
        if twins.is_empty() {
            return Vec::new();
        }
        let address = address_of(stage);
        let width = stage.width();
        let mut state = self.state();
        let order = state.ask(stage, twins, nuisance);
        state.permits += 1;
        self.changed.notify_all();
        loop {
            assert!(!state.is_broken, "a simulation beside this one has panicked");
            if state.orders[&order].missing == 0 {
                break;
            }
            let batch = state.batch(address, width, self.workers);
            if batch.is_empty() {
                state = self.wait(state);
                continue;
            }
            state.permits -= 1;
            drop(state);
            let own: Vec<&Twin> = batch.iter().map(|request| &request.twin).collect();
            let predicted = simulated(stage, &own, &batch[0].nuisance);
            state = self.state();
            state.deliver(batch, predicted);
            state.permits += 1;
            self.changed.notify_all();
        }
        let order = state.orders.remove(&order);
        drop(self.permitted(state));
        order.map(|order| order.results).unwrap_or_default()
    }
}

impl State {
    /// Add requests; return the number of their order.
    fn ask(&mut self, stage: &dyn Stage, twins: &[&Twin], nuisance: &[Vec<f64>]) -> u64 {
        let order = self.next_order;
        self.next_order += 1;
        self.waiting += 1;
        let results = vec![Predicted::new(); twins.len()];
        self.orders.insert(order, Order { missing: twins.len(), results });
        self.pending.extend(twins.iter().enumerate().map(|(index, twin)| Request {
            order,
            index,
            stage: address_of(stage),
            lot: stage.lot(twin),
            twin: (*twin).clone(),
            nuisance: nuisance.to_vec(),
        }));
        order
    }

    /// Take a batch of requests for a stage that simulates `width` twins at once: as soon as there are so many, or when
    /// all threads wait; empty before that.
    fn batch(&mut self, stage: usize, width: usize, workers: usize) -> Vec<Request> {
        let all_wait = self.waiting == self.unfinished.min(workers);
        let is_like = |one: &Request, other: &Request| {
            one.stage == other.stage && one.lot == other.lot && one.nuisance == other.nuisance
        };
        let count_like =
            |one: &Request| self.pending.iter().filter(|own| is_like(one, own)).count();
        let is_ripe = |own: &&Request| own.stage == stage && (all_wait || width <= count_like(own));
        let Some(first) = self.pending.iter().find(is_ripe).filter(|_| 0 < self.permits) else {
            return Vec::new();
        };
        let (lot, nuisance, count) = (first.lot, first.nuisance.clone(), count_like(first));
        let fits = |own: &Request| own.stage == stage && own.lot == lot && own.nuisance == nuisance;
        // Distributed over the free threads, in full vectors.
        let own = count.div_ceil(self.permits).div_ceil(width) * width;
        let own = if all_wait { own } else { own.min(count / width * width) };
        let mut taken = 0;
        let is_taken = |request: &mut Request| {
            let is_taken = fits(request) && taken < own;
            taken += usize::from(is_taken);
            is_taken
        };
        self.pending.extract_if(.., is_taken).collect()
    }

    /// Deliver the `predicted` results of a `batch` to the waiting threads.
    fn deliver(&mut self, batch: Vec<Request>, predicted: Vec<Predicted>) {
        for (request, predicted) in batch.into_iter().zip(predicted) {
            let Some(order) = self.orders.get_mut(&request.order) else { continue };
            order.results[request.index] = predicted;
            order.missing -= 1;
            self.waiting -= usize::from(order.missing == 0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        effects::{Domain, Effect},
        twin::{Channel, Machine, StageKind},
    };
    use std::sync::atomic::{AtomicUsize, Ordering};

    /// Stage that predicts the mass of the striker, and counts the requests of a full vector.
    struct Scale {
        channels: Vec<Channel>,
        whole: AtomicUsize,
    }

    impl Scale {
        const WIDTH: usize = 4;

        fn new() -> Self {
            let channel = Channel {
                signal: String::new(),
                unit: "kg",
                domain: Domain::Drive,
                axis: "a",
                rate_hz: 1.0,
                times: vec![0.0],
                measured: vec![0.0],
                runs: std::iter::once(0..1).collect(),
            };
            Self { channels: vec![channel], whole: AtomicUsize::new(0) }
        }
    }

    impl Stage for Scale {
        fn kind(&self) -> StageKind {
            StageKind::Drive
        }

        fn channels(&self) -> &[Channel] {
            &self.channels
        }

        fn calls(&self, _effect: &Effect) -> bool {
            false
        }

        fn predict(&self, twin: &Twin, _nuisance: &[Vec<f64>], predicted: &mut [Vec<f64>]) {
            assert!(twin.striker_mass < 1e6, "too heavy");
            predicted[0][0] = twin.striker_mass;
        }

        fn predict_each(
            &self,
            twins: &[&Twin],
            nuisance: &[Vec<f64>],
            predicted: &mut [Vec<Vec<f64>>],
        ) -> bool {
            let is_whole = twins.len().is_multiple_of(Self::WIDTH);
            self.whole.fetch_add(usize::from(is_whole), Ordering::Relaxed);
            let each = twins.iter().zip(predicted);
            each.for_each(|(twin, predicted)| self.predict(twin, nuisance, predicted));
            true
        }

        fn width(&self) -> usize {
            Self::WIDTH
        }
    }

    fn heavy(mass: f64) -> Twin {
        Twin { striker_mass: mass, ..Twin::nominal(Machine::Table) }
    }

    /// Item that requests `mass` times, each time for one more twin.
    fn weigh(stage: &Scale, mass: usize) -> f64 {
        let asks = (1..=mass).map(|count| {
            let twins: Vec<Twin> = (0..count).map(|more| heavy((mass + more) as f64)).collect();
            let twins: Vec<&Twin> = twins.iter().collect();
            predict_each(stage, &twins, &[]).iter().map(|own| own[0][0]).sum::<f64>()
        });
        asks.sum()
    }

    #[test]
    fn every_thread_gets_its_predictions_and_single_requests_share_a_vector() {
        let items: Vec<usize> = (0..50).map(|k| k % 7).collect();
        let alone: Vec<f64> = items.iter().map(|mass| weigh(&Scale::new(), *mass)).collect();
        let stage = Scale::new();
        assert_eq!(in_parallel(&items, |mass| weigh(&stage, *mass)), alone);
        let together = Scale::new();
        in_parallel(&[1, 1, 1, 1], |mass| weigh(&together, *mass));
        assert_eq!(together.whole.into_inner(), 1);
    }

    #[test]
    fn a_panic_reaches_the_caller_and_no_thread_waits() {
        let stage = Scale::new();
        let work = |mass: &f64| predict_each(&stage, &[&heavy(*mass)], &[]);
        let found = std::panic::catch_unwind(|| in_parallel(&[1.0, 1e9, 2.0, 3.0, 4.0], work));
        assert!(found.is_err());
    }
}
