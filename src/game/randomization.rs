//! Physics that differ from episode to episode.

use super::error::{GameError, within};
use crate::seed::Stream;

/// What a surface does to the ball.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Surface {
    /// Normal speed after over normal speed before an impact, in `[0, 1]`.
    pub restitution: f64,
    /// Coulomb's coefficient at rest.
    pub static_friction: f64,
    /// Coulomb's coefficient while sliding.
    pub dynamic_friction: f64,
}

/// The physics of one board for one episode.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BoardPhysics {
    /// Mass of the ball (kg).
    pub ball_mass: f64,
    /// Walls.
    pub walls: Surface,
    /// Strikers and biscuits.
    pub strikers: Surface,
}

/// Ranges from which every episode draws its own physics, evenly. One draw of friction and restitution is
/// made for the walls and one for the strikers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Randomization {
    /// Friction at rest; a draw below the one of sliding is raised to it.
    pub static_friction: [f64; 2],
    /// Friction while sliding.
    pub dynamic_friction: [f64; 2],
    /// Restitution.
    pub restitution: [f64; 2],
    /// Mass of the ball (kg).
    pub ball_mass: [f64; 2],
}

impl Randomization {
    /// The paper's table III. It gives the ball "1.8 to 2.2 mg"; grams are meant, the nominal ball having
    /// 1.7 g.
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

    /// The next draw.
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
