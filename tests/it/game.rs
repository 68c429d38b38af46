//! Games for other software: rolls and bounces that `scripts/check_game_mujoco.py` compares with MuJoCo.

use klasktron::{
    effects::{self, Axis},
    game::{EpisodeSettings, GameSettings, Games, Outcomes},
    twin::{Instance, Source},
};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Directory in which the script leaves `scenarios.json` and finds `trajectories.json`.
const DIRECTORY: &str = "KLASKTRON_GAME_DIR";

/// One ball and two strikers that are told nothing.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Scenario {
    /// Effects on ball and walls, by name.
    effects: Vec<(String, Vec<f64>)>,
    /// Effects of impacts on strikers.
    striker_effects: Vec<(String, Vec<f64>)>,
    ball_position_m: [f64; 2],
    ball_velocity_m_per_s: [f64; 2],
    striker_positions_m: [[f64; 2]; 2],
    /// Control periods of 20 ms.
    steps: usize,
}

/// What is compared, every control period.
#[derive(Serialize)]
struct Sample {
    time_s: f64,
    ball_position_m: [f64; 2],
    ball_velocity_m_per_s: [f64; 2],
}

fn instances(entries: &[(String, Vec<f64>)]) -> Vec<Instance> {
    let of = |(name, values): &(String, Vec<f64>)| {
        Instance::new(effects::find(name).unwrap(), Axis::Whole, values, Source::Known)
    };
    entries.iter().map(of).collect()
}

fn trajectory(scenario: &Scenario) -> Vec<Sample> {
    let mut settings = GameSettings {
        episode: EpisodeSettings {
            time_limit: 3600.0,
            still_limit: 3600.0,
            ..EpisodeSettings::default()
        },
        ..GameSettings::default()
    };
    settings.ball.effects = instances(&scenario.effects);
    settings.ball.striker_effects = instances(&scenario.striker_effects);
    settings.ball.static_friction_ratio = 1.0;
    // The other engine's board has no cups.
    settings.cup.radius = 1e-3;
    let mut games = Games::new(1, &settings, 0).unwrap();
    let Scenario { ball_position_m, ball_velocity_m_per_s, striker_positions_m, .. } = *scenario;
    games.set_positions(0, ball_position_m, ball_velocity_m_per_s, striker_positions_m);
    let mut outcomes = Outcomes::new(1);
    let mut samples = Vec::new();
    for step in 0..=scenario.steps {
        let now = games.snapshot(0);
        samples.push(Sample {
            time_s: 0.02 * step as f64,
            ball_position_m: now.ball_position,
            ball_velocity_m_per_s: now.ball_velocity,
        });
        games.advance(&[[[0.0; 2]; 2]], &mut outcomes).unwrap();
        assert_eq!(outcomes.ended[0], None, "a ball of a scenario fell into a cup");
    }
    samples
}

/// Without the script there is nothing to do.
#[test]
fn trajectories_for_another_engine() {
    let Ok(directory) = std::env::var(DIRECTORY) else { return };
    let directory = Path::new(&directory);
    let text = std::fs::read_to_string(directory.join("scenarios.json")).unwrap();
    let scenarios: Vec<Scenario> = serde_json::from_str(&text).unwrap();
    let trajectories: Vec<Vec<Sample>> = scenarios.iter().map(trajectory).collect();
    let text = serde_json::to_string(&trajectories).unwrap();
    std::fs::write(directory.join("trajectories.json"), text).unwrap();
}
