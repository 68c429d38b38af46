//! Domain randomization: physics drawn per episode.

use super::error::{GameError, within};
use crate::seed::Stream;

/// Contact parameters of a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Surface {
    /// Restitution: normal speed after over before an impact, in `[0, 1]`.
    pub restitution: f64,
    /// Static Coulomb friction coefficient.
    pub static_friction: f64,
    /// Kinetic Coulomb friction coefficient.
    pub dynamic_friction: f64,
}

/// Physics of one environment for one episode.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BoardPhysics {
    /// Mass of the ball (kg).
    pub ball_mass: f64,
    /// Surface of the walls.
    pub walls: Surface,
    /// Surface of strikers and biscuits.
    pub strikers: Surface,
}

/// Ranges of the uniform distributions from which each episode draws its physics. Friction and
/// restitution are drawn once for the walls and once for the strikers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Randomization {
    /// Static friction; a draw below the kinetic one is raised to it.
    pub static_friction: [f64; 2],
    /// Kinetic friction.
    pub dynamic_friction: [f64; 2],
    /// Restitution.
    pub restitution: [f64; 2],
    /// Mass of the ball (kg).
    pub ball_mass: [f64; 2],
}

impl Randomization {
    /// Table III of the paper. It gives the ball "1.8 to 2.2 mg"; grams are meant, since the
    /// nominal ball has 1.7 g.
    #[must_use]
    pub fn paper() -> Self {
        Self {
            static_friction: [0.2, 0.5],
            dynamic_friction: [0.3, 0.45],
            restitution: [0.95, 0.99],
            ball_mass: [0.0018, 0.0022],
        }
    }

    pub(super) fn check(&self) -> Result<(), GameError> {
        for (name, [low, high], ends) in [
            ("randomization.static_friction", self.static_friction, [0.0, 2.0]),
            ("randomization.dynamic_friction", self.dynamic_friction, [0.0, 2.0]),
            ("randomization.restitution", self.restitution, [0.0, 1.0]),
            ("randomization.ball_mass_kg", self.ball_mass, [1e-5, 1.0]),
        ] {
            within(name, low, ends[0], ends[1])?;
            within(name, high, ends[0], ends[1])?;
            if high < low {
                return Err(GameError::Range { name, low, high });
            }
        }
        Ok(())
    }

    /// Draw the physics of an episode.
    pub(super) fn draw(&self, stream: &mut Stream) -> BoardPhysics {
        let mut within =
            |[low, high]: [f64; 2]| low + (high - low) * f64::from(stream.uniform_f32(0.0, 1.0));
        let mut surface = || {
            let dynamic_friction = within(self.dynamic_friction);
            Surface {
                restitution: within(self.restitution),
                static_friction: within(self.static_friction).max(dynamic_friction),
                dynamic_friction,
            }
        };
        let (walls, strikers) = (surface(), surface());
        BoardPhysics { ball_mass: within(self.ball_mass), walls, strikers }
    }
}
