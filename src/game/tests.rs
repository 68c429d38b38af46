//! Tests of the games against closed formulas, conservation laws and symmetries.

mod actuation;
mod determinism;
mod physics;
mod rules;
mod starts;
mod symmetry;

use super::{
    BallSettings, Ending, EpisodeSettings, GameSettings, Games, Outcomes, settings::instances,
};

/// Striker positions out of the ball's way.
const ASIDE: [[f64; 2]; 2] = [[-0.14, -0.19], [0.14, 0.19]];

/// Zero commands.
const STILL: [[f32; 2]; 2] = [[0.0; 2]; 2];

/// A ball without resistance, with restitution `e` and friction `mu` of walls and strikers.
fn ball(e: f64, mu: f64) -> BallSettings {
    let effects =
        instances(&[("impact.wall_restitution", &[e]), ("impact.wall_friction_spin", &[mu, 0.0])]);
    BallSettings { striker_effects: effects.clone(), effects, ..BallSettings::default() }
}

/// One environment with `settings`, the ball at `position` (m) with `velocity` (m/s).
fn one(settings: &GameSettings, position: [f64; 2], velocity: [f64; 2]) -> Games {
    let mut games = Games::new(1, settings, 0).unwrap();
    games.set_positions(0, position, velocity, ASIDE);
    games
}

/// Play the only environment until the episode ends; returns its end and the number of steps.
fn until_end(games: &mut Games, command: [[f32; 2]; 2]) -> (Ending, u32) {
    let mut outcomes = Outcomes::new(1);
    for step in 1..100_000 {
        games.advance(&[command], &mut outcomes).unwrap();
        if let Some(ending) = outcomes.ended[0] {
            return (ending, step);
        }
    }
    panic!("the episode does not end");
}

/// Settings with long episodes.
fn long(settings: GameSettings) -> GameSettings {
    let episode = EpisodeSettings { time_limit: 3600.0, still_limit: 3600.0, ..settings.episode };
    GameSettings { episode, ..settings }
}
