//! What is new: recordings compared with what the given twin is known to leave.
//!
//! Where the search on another recording of the machine ended, the twin left something: sensor noise, and
//! what the simulation cannot follow. Recordings that it leaves no more of hold nothing new, and small
//! effects in them are more often the simulation's own errors under another course than physics.

use super::problem::{Point, Problem};
use crate::twin::Twin;

/// Share of the squared residual by which recordings may exceed what is known to be left and still hold
/// nothing new: sampling, and another course. An effect of a third of the noise is above it.
const NOTHING_NEW: f64 = 0.05;

/// Share of the held-out squared error (whitened) that an effect must explain to be worth a name: a
/// simulator of finite fidelity leaves that much of anything.
const WORTH_NAMING: f64 = 0.02;

/// The same where nothing is new.
const WORTH_NAMING_AGAIN: f64 = 0.1;

/// The largest share of the squared residual of a signal, over all `points`, above what `twin` left when
/// its own search ended; `None` where that is not known of some signal.
pub(super) fn excess<const N: usize>(
    twin: &Twin,
    points: [(&Problem<'_>, &Point); N],
) -> Option<f64> {
    let squares = points.map(|(problem, point)| problem.squares(point));
    let channels = points.first()?.0.parts.first()?.stage.channels();
    let mut most = f64::NEG_INFINITY;
    for (k, channel) in channels.iter().enumerate() {
        let own = squares.iter().filter_map(|problem| problem.get(k));
        let (sum, count) = own.fold((0.0, 0), |all, own| (all.0 + own.0, all.1 + own.1));
        let left = twin.left.iter().find(|left| left.signal == channel.signal && left.searched)?;
        let known = left.residual_rms.powi(2) * count as f64;
        most = most.max(sum / known.max(f64::MIN_POSITIVE) - 1.0);
    }
    Some(most)
}

/// Whether an [`excess`] is none.
pub(super) fn is_nothing_new(excess: Option<f64>) -> bool {
    excess.is_some_and(|excess| excess < NOTHING_NEW)
}

/// Share of the held-out squared error that an effect must explain to be worth a name.
pub(super) fn least_worth(excess: Option<f64>) -> f64 {
    if is_nothing_new(excess) { WORTH_NAMING_AGAIN } else { WORTH_NAMING }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_known_to_be_left_is_nothing_new_and_worth_a_name_only_where_it_is_large() {
        assert!(is_nothing_new(Some(-0.3)) && is_nothing_new(Some(0.04)));
        assert!(!is_nothing_new(Some(0.06)));
        // A twin that no search ended with leaves nothing that is known.
        assert!(!is_nothing_new(None));
        assert!(least_worth(None) < least_worth(Some(0.0)));
        assert_eq!(least_worth(Some(0.5)), least_worth(None));
    }
}
