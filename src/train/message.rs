//! Conversion between points of the learning curve and their messages.

use super::CurvePoint;
use crate::{ppo::UpdateReport, recording::message::TrainingUpdate};

/// The message of a point.
pub(super) fn message_of(point: &CurvePoint) -> TrainingUpdate {
    let learning = &point.learning;
    TrainingUpdate {
        update: point.update,
        transitions: point.transitions,
        games: point.games,
        won: point.won,
        lost: point.lost,
        own_mistakes: point.own_goals,
        mean_return: point.mean_return,
        mean_episode_s: point.mean_episode_s,
        hits_per_minute: point.hits_per_minute,
        elo: point.elo,
        pool: point.pool,
        shaping_left: point.shaping_left,
        samples: learning.samples as u64,
        policy_loss: learning.policy_loss,
        value_loss: learning.value_loss,
        bounds_loss: learning.bounds_loss,
        entropy: learning.entropy,
        kl: learning.kl,
        clip_fraction: learning.clip_fraction,
        gradient_norm: learning.gradient_norm,
        shortened_fraction: learning.shortened_fraction,
        explained_variance: learning.explained_variance,
        learning_rate: learning.learning_rate,
        epochs: learning.epochs as u64,
        minibatches: learning.minibatches as u64,
    }
}

/// The point of a message.
pub(super) fn point_of(message: &TrainingUpdate) -> CurvePoint {
    CurvePoint {
        update: message.update,
        transitions: message.transitions,
        games: message.games,
        won: message.won,
        lost: message.lost,
        own_goals: message.own_mistakes,
        mean_return: message.mean_return,
        mean_episode_s: message.mean_episode_s,
        hits_per_minute: message.hits_per_minute,
        elo: message.elo,
        pool: message.pool,
        shaping_left: message.shaping_left,
        learning: UpdateReport {
            update: message.update,
            samples: message.samples as usize,
            policy_loss: message.policy_loss,
            value_loss: message.value_loss,
            bounds_loss: message.bounds_loss,
            entropy: message.entropy,
            kl: message.kl,
            clip_fraction: message.clip_fraction,
            gradient_norm: message.gradient_norm,
            shortened_fraction: message.shortened_fraction,
            explained_variance: message.explained_variance,
            learning_rate: message.learning_rate,
            epochs: message.epochs as usize,
            minibatches: message.minibatches as usize,
        },
    }
}
