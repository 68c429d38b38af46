//! The games against closed formulas, conservation laws and symmetries.

mod actuation;
mod determinism;
mod physics;
mod rules;
mod symmetry;

use super::{
    BallSettings, Ending, EpisodeSettings, GameSettings, Games, Outcomes, settings::instances,
};

/// Where strikers are out of the ball's way.
const ASIDE: [[f64; 2]; 2] = [[-0.14, -0.19], [0.14, 0.19]];

/// Nobody moves.
const STILL: [[f32; 2]; 2] = [[0.0; 2]; 2];

/// A ball that meets no resistance, with the restitution `e` and the friction `mu` of walls and strikers.
fn ball(e: f64, mu: f64) -> BallSettings {
    let effects =
        instances(&[("impact.wall_restitution", &[e]), ("impact.wall_friction_spin", &[mu])]);
    BallSettings { striker_effects: effects.clone(), effects, ..BallSettings::default() }
}

/// One board with `settings`, the ball rolling from `position` (m) with `velocity` (m/s).
fn one(settings: &GameSettings, position: [f64; 2], velocity: [f64; 2]) -> Games {
    let mut games = Games::new(1, settings, 0).unwrap();
    games.place(0, position, velocity, ASIDE);
    games
}

/// Plays the only board until the episode ends; how it ended, and after how many steps.
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

/// Episodes that last.
fn long(settings: GameSettings) -> GameSettings {
    let episode = EpisodeSettings { time_limit: 3600.0, still_limit: 3600.0, ..settings.episode };
    GameSettings { episode, ..settings }
}
