//! Configuration of gantries, magnets and strikers.

use super::{ConfigError, RigConfig, ranged::ranged};

ranged! {
    /// One gantry. Masses, belts and friction of the table are not published; the defaults are
    /// estimates.
    GantryConfig {
        /// Mass that moves in x and y (kg).
        carriage_mass_kg: 0.5 in [0.01, 100.0];
        /// Mass that moves in y only (kg).
        bridge_mass_kg: 0.7 in [0.0, 100.0];
        /// Stiffness of belt a (N/m); about 1.5e5 N per unit strain over its length.
        belt_a_stiffness_n_per_m: 40_000.0 in [10.0, 1e7];
        /// Stiffness of belt b (N/m).
        belt_b_stiffness_n_per_m: 40_000.0 in [10.0, 1e7];
        /// Damping of each belt (N s/m).
        belt_damping_n_s_per_m: 40.0 in [0.0, 1e5];
        /// Backlash of each belt (m).
        backlash_m: 0.0 in [0.0, 0.01];
        /// Scale error of the motion in x, relative to 1.
        x_scale_error: 0.0 in [-0.2, 0.2];
        /// Scale error of the motion in y, relative to 1.
        y_scale_error: 0.0 in [-0.2, 0.2];
        /// Squareness error: angle of the y axis towards x (rad).
        squareness_rad: 0.0 in [-0.1, 0.1];
        /// Force in x per speed in y and vice versa (N s/m).
        cross_damping_n_s_per_m: 0.0 in [-100.0, 100.0];
        /// Racking: force in x per acceleration in y and displacement in x, because the bridge yaws
        /// (kg/m).
        racking_kg_per_m: 0.0 in [-20.0, 20.0];
        /// Tilt of the table along x (rad).
        x_tilt_rad: 0.0 in [-0.2, 0.2];
        /// Tilt of the table along y (rad).
        y_tilt_rad: 0.0 in [-0.2, 0.2];
        /// Start position of the carriage, across (m).
        x_start_m: 0.0 in [-1.0, 1.0];
        /// Start position of the carriage, from goal to goal (m).
        y_start_m: 0.0 in [-1.0, 1.0];
        /// Travel to either side of the middle line of the board, across (m).
        x_travel_m: 0.165 in [0.001, 1.0];
        /// Minimum distance of the carriage from the centre line between the players (m).
        y_travel_near_m: 0.002 in [-1.0, 1.0];
        /// Maximum distance of the carriage from that line (m).
        y_travel_far_m: 0.215 in [0.01, 1.0];
        /// Stiffness of the end stops (N/m).
        endstop_stiffness_n_per_m: 50_000.0 in [100.0, 1e7];
    }
    other {
        /// Friction of the guides in x.
        x_friction: GuideFriction = GuideFriction::default();
        /// Friction of the guides in y.
        y_friction: GuideFriction = GuideFriction::default();
    }
}

ranged! {
    /// Friction of a linear guide; [`crate::rig`] has the law.
    GuideFriction {
        /// Coulomb friction (N).
        coulomb_n: 1.5 in [0.0, 1e3];
        /// Breakaway friction (N); Stribeck friction when above Coulomb, none when below.
        breakaway_n: 0.0 in [0.0, 1e3];
        /// Stribeck speed (m/s).
        stribeck_m_per_s: 0.01 in [1e-5, 10.0];
        /// Viscous friction (N s/m).
        viscous_n_s_per_m: 2.0 in [0.0, 1e4];
        /// Quadratic friction (N s^2/m^2).
        quadratic_n_s2_per_m2: 0.0 in [0.0, 1e4];
        /// Ratio of friction towards negative and towards positive coordinates.
        backward_ratio: 1.0 in [0.1, 10.0];
        /// Presliding stiffness (N/m); 0 for rigid.
        presliding_stiffness_n_per_m: 0.0 in [0.0, 1e6];
        /// Amplitude of the position-dependent friction, as a fraction.
        position_fraction: 0.0 in [0.0, 0.9];
        /// Wavelength of the position-dependent friction (m).
        position_wavelength_m: 0.1 in [1e-3, 10.0];
    }
}

ranged! {
    /// The magnet under the board: `F = k s / (1 + (s/s0)^2)^2` on the striker at the distance `s`,
    /// largest at `s0 / sqrt 3`. Beyond `lost_at_m` the striker decouples; it couples again nearer
    /// than `caught_at_m`.
    MagnetConfig {
        /// Stiffness `k` at small displacements (N/m).
        stiffness_n_per_m: 140.0 in [0.1, 1e5];
        /// Length scale `s0` (m).
        scale_m: 0.018 in [1e-4, 1.0];
        /// Damping of the striker relative to the magnet while coupled (N s/m).
        damping_n_s_per_m: 0.4 in [0.0, 100.0];
        /// Distance at which the striker decouples (m).
        lost_at_m: 0.03 in [1e-4, 1.0];
        /// Distance at which the striker couples again (m).
        caught_at_m: 0.008 in [1e-4, 1.0];
    }
}

ranged! {
    /// A striker.
    PegConfig {
        /// Radius (m).
        radius_m: 0.0075 in [1e-3, 0.1];
        /// Mass including its magnet (kg).
        mass_kg: 0.010 in [1e-4, 10.0];
        /// Coulomb friction on the board, magnet preload included (N).
        friction_n: 0.25 in [0.0, 100.0];
        /// Viscous friction on the board (N s/m).
        viscous_n_s_per_m: 0.0 in [0.0, 100.0];
        /// Natural frequency of tipping on its foot (Hz); 0 for none.
        wobble_hz: 0.0 in [0.0, 200.0];
        /// Damping ratio of the tipping.
        wobble_damping_ratio: 0.1 in [0.0, 2.0];
    }
}

impl GantryConfig {
    /// Default gantry with its carriage at (`x_m`, `y_m`).
    #[must_use]
    pub fn at(x_m: f64, y_m: f64) -> Self {
        Self { x_start_m: x_m, y_start_m: y_m, ..Self::default() }
    }

    pub(super) fn check(&self, path: &str, rig: &RigConfig) -> Result<(), ConfigError> {
        self.check_numbers(path)?;
        self.x_friction.check_numbers(&format!("{path}x_friction."))?;
        self.y_friction.check_numbers(&format!("{path}y_friction."))?;
        let radius = rig.belt_metres_per_turn / std::f64::consts::TAU;
        let rotor_mass = rig
            .drives
            .iter()
            .map(|seat| seat.own.as_deref().unwrap_or(&rig.drive).rotor_inertia_kg_m2)
            .fold(rig.drive.rotor_inertia_kg_m2, f64::min)
            / radius.powi(2);
        let stiffness = self.belt_a_stiffness_n_per_m.max(self.belt_b_stiffness_n_per_m);
        // Two belts on the carriage, one on each rotor; semi-implicit steps are stable to 2/w.
        let rate = (2.0 * stiffness * (2.0 / self.carriage_mass_kg + 1.0 / rotor_mass)).sqrt();
        let damped = 2.0 * self.belt_damping_n_s_per_m * (1.0 / self.carriage_mass_kg);
        stable(rig.step_s, "belt", rate, damped + self.belt_damping_n_s_per_m / rotor_mass)?;
        let elastic = [&self.x_friction, &self.y_friction]
            .map(|rail| rail.presliding_stiffness_n_per_m)
            .into_iter()
            .fold(0.0, f64::max);
        stable(rig.step_s, "presliding", (elastic / self.carriage_mass_kg).sqrt(), 0.0)?;
        let stop = (self.endstop_stiffness_n_per_m / self.carriage_mass_kg).sqrt();
        stable(rig.step_s, "end stop", stop, stop)
    }
}

impl MagnetConfig {
    pub(super) fn check(
        &self,
        path: &str,
        peg: &PegConfig,
        step_s: f64,
    ) -> Result<(), ConfigError> {
        self.check_numbers(path)?;
        let rate = (self.stiffness_n_per_m / peg.mass_kg).sqrt();
        let damped = (self.damping_n_s_per_m + peg.viscous_n_s_per_m) / peg.mass_kg;
        stable(step_s, "magnet", rate, damped)
    }
}

/// Check that the step is at most half the stability limit of a semi-implicit step, for a mode of
/// angular frequency `rate` (rad/s) and decay rate `damped` (1/s).
fn stable(step_s: f64, spring: &'static str, rate: f64, damped: f64) -> Result<(), ConfigError> {
    let longest_s = 1.0 / rate.max(damped).max(1e-9);
    if longest_s < step_s {
        return Err(ConfigError::Unstable { step_s, spring, longest_s });
    }
    Ok(())
}
