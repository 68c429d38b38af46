//! Camera frames that came twice.

/// Steps between frames below this many times the smallest are one of a coarse grid, on which an object at rest
/// stays where it is.
const MOVES: f64 = 5.0;

/// Which of `places` (m, frame by frame) repeat the one before exactly although the object moves: a camera or its
/// driver sent one picture twice, and the second says nothing of its time.
pub(super) fn repeats(places: &[[f64; 2]]) -> Vec<bool> {
    let step = |k: usize| (places[k][0] - places[k - 1][0]).hypot(places[k][1] - places[k - 1][1]);
    let least =
        (1..places.len()).map(step).filter(|step| 0.0 < *step).fold(f64::INFINITY, f64::min);
    let mut found = vec![false; places.len()];
    let mut next = f64::NAN;
    for k in (1..places.len()).rev() {
        let own = step(k);
        found[k] = own == 0.0 && MOVES * least < next;
        if own != 0.0 {
            next = own;
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::repeats;
    use crate::seed::Stream;

    /// A course at 120 Hz with 0.2 mm of scatter, rounded to `grid`, with every tenth frame a copy of the one
    /// before.
    fn course(speed: f64, grid: f64) -> Vec<[f64; 2]> {
        let mut stream = Stream::new(1, "course");
        let mut places: Vec<[f64; 2]> = (0..100)
            .map(|k| {
                let scatter = f64::from(stream.uniform_f32(-2e-4, 2e-4));
                [((speed * f64::from(k) / 120.0 + scatter) / grid).round() * grid, 0.0]
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
