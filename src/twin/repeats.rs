//! Repeated camera frames.

/// Steps between frames of fewer quanta than this are those of a coarse grid, on which an object at
/// rest keeps its position.
const MOVES: f64 = 5.0;

/// Distance below which coordinates are the same one, rounded (m).
const ROUNDING_M: f64 = 1e-12;

/// Mark those of `places` (m, frame by frame) that repeat the one before exactly although the
/// object moves. A camera or its driver sent one frame twice, and the second contains nothing about
/// its time.
pub(super) fn repeats(places: &[[f64; 2]]) -> Vec<bool> {
    let step = |k: usize| (places[k][0] - places[k - 1][0]).hypot(places[k][1] - places[k - 1][1]);
    let quantum = quantum(places);
    let mut found = vec![false; places.len()];
    let mut next = f64::NAN;
    for k in (1..places.len()).rev() {
        let own = step(k);
        found[k] = own == 0.0 && MOVES * quantum < next;
        if own != 0.0 {
            next = own;
        }
    }
    found
}

/// Smallest distance between two different values of a coordinate (m): the grid of the detector, or
/// nearly zero if it has no grid.
fn quantum(places: &[[f64; 2]]) -> f64 {
    let of_axis = |axis: usize| {
        let mut values: Vec<f64> =
            places.iter().map(|place| place[axis]).filter(|value| value.is_finite()).collect();
        values.sort_by(f64::total_cmp);
        let gaps = values.windows(2).map(|pair| pair[1] - pair[0]);
        gaps.filter(|gap| ROUNDING_M < *gap).fold(f64::INFINITY, f64::min)
    };
    of_axis(0).min(of_axis(1))
}

#[cfg(test)]
mod tests {
    use super::repeats;
    use crate::seed::Stream;

    /// Motion at 120 Hz with 0.2 mm of noise, rounded to `grid`, with every tenth frame a copy of
    /// the one before.
    fn course(speed: f64, grid: f64) -> Vec<[f64; 2]> {
        let mut stream = Stream::new(1, "course");
        let mut places: Vec<[f64; 2]> = (0..100)
            .map(|k| {
                let mut seen = |place: f64| {
                    let scatter = f64::from(stream.uniform_f32(-2e-4, 2e-4));
                    ((place + scatter) / grid).round() * grid
                };
                [seen(speed * f64::from(k) / 120.0), seen(0.05)]
            })
            .collect();
        (5..100).step_by(10).for_each(|k| places[k] = places[k - 1]);
        places
    }

    #[test]
    fn copies_are_found_where_the_object_moves() {
        let found = repeats(&course(0.37, 1e-7));
        assert!((0..100).all(|k| found[k] == (k % 10 == 5)), "{found:?}");
    }

    #[test]
    fn an_object_that_rests_on_a_coarse_grid_repeats_nothing() {
        assert!(repeats(&course(0.02, 1e-3)).iter().all(|repeated| !repeated));
        assert!(repeats(&[[0.1, 0.2]; 20]).iter().all(|repeated| !repeated));
        assert!(repeats(&[]).is_empty());
    }

    #[test]
    fn what_is_missing_is_no_repeat() {
        let mut places = course(0.37, 1e-7);
        places[20] = [f64::NAN; 2];
        places[21] = [f64::NAN; 2];
        let found = repeats(&places);
        assert!(!found[20] && !found[21] && !found[22]);
    }
}
