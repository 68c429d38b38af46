//! A run that takes moments.

use klasktron::{
    ekf::FilterSettings,
    game::SensorSettings,
    train::{Preset, TrainSettings},
};
use std::path::{Path, PathBuf};

/// Six updates of 32 boards with a small network, a checkpoint before every second one.
pub(crate) fn tiny() -> TrainSettings {
    let mut settings = TrainSettings::preset(Preset::Tuned);
    settings.seed = 7;
    settings.environments = 32;
    settings.ppo.hidden = vec![8];
    settings.ppo.horizon = 16;
    settings.ppo.epochs = 2;
    settings.ppo.minibatch = 128;
    settings.checkpoint_updates = 2;
    settings.opponents.window_games = 1;
    settings.opponents.update_score = -1.0;
    settings.evaluation.games_per_opponent = 4;
    settings.evaluation.games_per_pair = 2;
    settings.evaluation.pool_players = 2;
    settings.evaluation.sample_games = 2;
    settings.sensors = Some(sensors());
    settings.steps = 6 * settings.transitions_per_update();
    settings
}

/// A camera with latency and lost frames, and the untuned filter.
fn sensors() -> SensorSettings {
    let filter = FilterSettings { latency_s: 0.02, ..FilterSettings::default() };
    SensorSettings { lost_fraction: 0.05, ..SensorSettings::of(filter) }
}

/// The settings as a file.
pub(crate) fn settings_file(dir: &Path, settings: &TrainSettings) -> PathBuf {
    let path = dir.join("settings.json");
    std::fs::write(&path, settings.to_json()).unwrap();
    path
}
