//! The state of all boards as bytes, so that an interrupted training goes on with the same bytes.
//!
//! One function names every number of the state ([`each_number`]); saving reads them in its order, and
//! restoring writes them. Physics of an episode are not among them: they are drawn anew from its number.

use super::{
    actuation::Actuators,
    biscuit::BiscuitState,
    body::{BallState, StrikerState},
    error::GameError,
    games::Games,
};

/// Bytes of one number.
const BYTES: usize = 8;

/// Calls `visit` with every number of the state, always in the same order.
fn each_number(games: &mut Games, visit: &mut dyn FnMut(&mut f64)) {
    for clock in &mut games.clocks {
        // Exact below 2^53 episodes.
        let (mut episode, mut step) = (clock.episode as f64, f64::from(clock.step));
        visit(&mut episode);
        visit(&mut step);
        (clock.episode, clock.step) = (episode as u64, step as u32);
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
    /// The state of all boards, for [`restore`](Self::restore).
    #[must_use]
    pub fn save(&self) -> Vec<u8> {
        let mut bytes = Vec::new();
        each_number(&mut self.clone(), &mut |number| bytes.extend(number.to_le_bytes()));
        bytes
    }

    /// Puts back the state that games of the same settings, seed and boards have saved; they go on as those
    /// would have.
    ///
    /// # Errors
    /// When `saved` belongs to other settings or another number of boards; then nothing has changed.
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
