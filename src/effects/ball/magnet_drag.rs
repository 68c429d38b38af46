//! Attraction of the ball by the magnets of the strikers.

use crate::effects::{Ball, Domain, Effect, Parameter, Physics, Regressor, Signal, Site};

/// `ball.magnet_drag`: attraction of the ball by the magnets of the strikers.
///
/// The exponent is 7 for a steel ball in the field of a dipole (force as the gradient of B^2), and
/// less near an extended magnet. Below half of d0 the attraction stays constant. Strikers that no
/// camera sees do not attract the ball.
pub(crate) static MAGNET_DRAG: Effect = Effect {
    name: "ball.magnet_drag",
    summary: "a striker attracts the ball when it passes closely",
    domain: Domain::Ball,
    site: Site::Whole,
    equation: "a = A · (d0 / d)^n towards each striker at the distance d, d0 = 25 mm",
    parameters: &[
        Parameter {
            name: "attraction_m_per_s2",
            symbol: "A",
            unit: "m/s^2",
            scale: 0.1,
            bounds: (0.0, 50.0),
            plausible: (0.01, 5.0),
            per_session: false,
        },
        Parameter {
            name: "exponent",
            symbol: "n",
            unit: "1",
            scale: 1.0,
            bounds: (1.0, 10.0),
            plausible: (2.0, 8.0),
            per_session: false,
        },
    ],
    null: &[0.0, 4.0],
    probes: &[&[0.05, 4.0], &[0.05, 7.0], &[0.2, 3.0]],
    memory: 0,
    physics: Physics::Roll(draw),
    regressors: &[Regressor::Position],
    signals: Signal::BALL,
    excitation: "slow rolls past a parked striker",
    experiment: "",
    confused_with: &["ball.stiction_patch", "ball.board_curvature"],
    reference: "Furlani 2001, Permanent Magnet and Electromechanical Devices",
};

/// Reference distance of the attraction parameter (m).
const REFERENCE: f64 = 0.025;

fn draw(p: &[f64], ball: &Ball) -> [f64; 2] {
    let mut sum = [0.0; 2];
    if p[0] == 0.0 {
        return sum;
    }
    for striker in ball.strikers.iter().flatten() {
        let way = [striker[0] - ball.position[0], striker[1] - ball.position[1]];
        let distance = way[0].hypot(way[1]).max(REFERENCE / 2.0);
        let size = p[0] * (REFERENCE / distance).powf(p[1]) / distance;
        sum = [sum[0] + size * way[0], sum[1] + size * way[1]];
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn twice_as_far_is_a_power_weaker() {
        let near = Ball { strikers: [Some([0.025, 0.0]), None], ..Ball::default() };
        let far = Ball { strikers: [None, Some([0.0, -0.05])], ..Ball::default() };
        assert!((draw(&[0.8, 3.0], &near)[0] - 0.8).abs() < 1e-12);
        assert!((draw(&[0.8, 3.0], &far)[1] + 0.1).abs() < 1e-12);
        assert_eq!(draw(MAGNET_DRAG.null, &near), [0.0, 0.0]);
    }
}
