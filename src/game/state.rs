//! The state of all environments as bytes, so that an interrupted training resumes with identical
//! results.
//!
//! One function visits every number of the state ([`each_number`]); saving reads them in its order,
//! and restoring writes them. The physics of an episode are not saved: they are drawn again from
//! its number.

use super::{
    actuation::Actuators,
    biscuit::BiscuitState,
    body::{BallState, StrikerState},
    error::GameError,
    games::{Clock, Games},
};

/// Size of one number (bytes).
const BYTES: usize = 8;

/// Call `visit` with every number of the state, always in the same order.
fn each_number(games: &mut Games, visit: &mut dyn FnMut(&mut f64)) {
    for clock in &mut games.clocks {
        // Exact below 2^53 episodes.
        let Clock { episode, step, still } = *clock;
        let mut numbers = [episode as f64, f64::from(step), f64::from(still)];
        numbers.iter_mut().for_each(&mut *visit);
        let [episode, step, still] = numbers;
        *clock = Clock { episode: episode as u64, step: step as u32, still: still as u32 };
    }
    for ball in &mut games.balls {
        let BallState { position, velocity, slip, spin, since_impact, over_cup } = ball;
        [position, velocity, slip].into_iter().flatten().for_each(&mut *visit);
        [spin, since_impact, over_cup].into_iter().for_each(&mut *visit);
    }
    for striker in games.strikers.iter_mut().flatten() {
        let StrikerState { command, carriage, led, led_velocity, recoil, recoil_velocity } =
            striker;
        let pairs = [command, carriage, led, led_velocity, recoil, recoil_velocity];
        pairs.into_iter().flatten().for_each(&mut *visit);
    }
    for biscuit in games.biscuits.iter_mut().flatten() {
        let BiscuitState { position, velocity, holder } = biscuit;
        [position, velocity].into_iter().flatten().for_each(&mut *visit);
        let mut number = holder.map_or(-1.0, f64::from);
        visit(&mut number);
        *holder = (0.0 <= number).then_some(number as u8);
    }
    match &mut games.actuators {
        Actuators::Ideal => {}
        Actuators::Learned(learned) => learned.each_number(visit),
        Actuators::Twin(drives) => drives.each_number(visit),
    }
}

impl Games {
    /// Save the state of all environments, for [`restore`](Self::restore).
    #[must_use]
    pub fn save(&self) -> Vec<u8> {
        let mut bytes = Vec::new();
        each_number(&mut self.clone(), &mut |number| bytes.extend(number.to_le_bytes()));
        bytes
    }

    /// Restore a state that games of the same settings, seed and environments have saved; they
    /// continue with identical results.
    ///
    /// # Errors
    /// When `saved` belongs to other settings or another number of environments; the state is then
    /// unchanged.
    pub fn restore(&mut self, saved: &[u8]) -> Result<(), GameError> {
        let expected = self.save().len();
        if saved.len() != expected {
            let what = "the saved state (in bytes)";
            return Err(GameError::Shape { what, found: saved.len(), expected });
        }
        let mut numbers = saved.chunks_exact(BYTES);
        each_number(self, &mut |number| {
            let bytes = numbers.next().and_then(|bytes| bytes.try_into().ok());
            *number = bytes.map_or(f64::NAN, f64::from_le_bytes);
        });
        (0..self.len()).for_each(|board| self.draw_physics(board));
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::{GameSettings, Games, Outcomes};

    /// Play `steps` control periods with zero commands.
    fn wait(games: &mut Games, steps: usize) {
        let commands = vec![[[0.0; 2]; 2]; games.len()];
        let mut outcomes = Outcomes::new(games.len());
        for _ in 0..steps {
            games.step(&commands, &mut outcomes).unwrap();
        }
    }

    #[test]
    fn restored_boards_go_on_as_the_saved_ones_also_where_the_ball_has_lain_still_for_a_while() {
        let settings = GameSettings::default();
        let mut games = Games::new(8, &settings, 3).unwrap();
        // A ball at rest ends the episode after 2 s: after 2.6 s some environments are in their
        // second episode.
        wait(&mut games, 130);
        let saved = games.save();
        wait(&mut games, 150);
        let mut restored = Games::new(8, &settings, 3).unwrap();
        restored.restore(&saved).unwrap();
        assert!(restored.save() == saved);
        wait(&mut restored, 150);
        assert!(restored.save() == games.save());
    }
}
