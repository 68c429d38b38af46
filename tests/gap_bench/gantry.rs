//! The CoreXY rig of the bench: what it is made of, and every effect that can be switched on.
//!
//! Coordinates: carriage `x`, `y` (m, board frame), belts `a = x + y`, `b = x - y` (m). Rows of
//! friction are x, y (rails) and a, b (motors); a row with zeros is absent. Zero means off for
//! every effect.

use crate::draw::Draw;

/// Belt per motor turn (m).
pub(crate) const BELT_PER_TURN: f64 = 0.04;
/// Newtons of belt per newton metre of motor.
pub(crate) const BELT_PER_TORQUE: f64 = std::f64::consts::TAU / BELT_PER_TURN;
/// Where the left carriage starts (m).
pub(crate) const HOME: [f64; 2] = [0.0, -0.115];
/// Mass of the peg (kg), and of the parts that the drawing gives.
pub(crate) const PEG_MASS: f64 = 0.012;
pub(crate) const CARRIAGE_MASS: f64 = 0.25;
pub(crate) const BRIDGE_MASS: f64 = 0.45;
/// Rotor inertia seen by the belt (kg): 4e-5 kg m2.
pub(crate) const ROTOR_MASS: f64 = 4.0e-5 * BELT_PER_TORQUE * BELT_PER_TORQUE;
/// Encoder counts per turn: 14 bit.
pub(crate) const COUNTS: f64 = 16384.0;
/// Half widths over which place-dependent effects are scaled (m).
pub(crate) const HALF_STROKE: [f64; 2] = [0.12, 0.07];

/// Command path and motors, each per motor a, b.
#[derive(Debug, Clone, Default)]
pub(crate) struct Drive {
    pub(crate) gain_error: [f64; 2],
    pub(crate) offset: [f64; 2],
    pub(crate) delay: [f64; 2],
    pub(crate) lag: [f64; 2],
    pub(crate) deadband: [f64; 2],
    pub(crate) ramp: [f64; 2],
    pub(crate) kp: [f64; 2],
    pub(crate) ki: [f64; 2],
    pub(crate) force_limit: [f64; 2],
    /// Fall of the available force with speed (s/m): 1 / v0.
    pub(crate) fall: [f64; 2],
    pub(crate) sag: f64,
    pub(crate) backlash: [f64; 2],
    /// Belt compliance (m/N).
    pub(crate) belt: [f64; 2],
    pub(crate) tooth: [f64; 2],
    pub(crate) pulley: [f64; 2],
    pub(crate) eccentricity: [f64; 2],
}

/// Friction of one row: a rail or a motor.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Friction {
    pub(crate) coulomb: f64,
    pub(crate) viscous: f64,
    pub(crate) quadratic: f64,
    /// Coulomb and viscous are `1 + asymmetry` times for v > 0, `1 - asymmetry` times for v < 0.
    pub(crate) asymmetry: f64,
    pub(crate) stribeck: f64,
    /// Stiffness before sliding (N/m).
    pub(crate) presliding: f64,
    pub(crate) load: f64,
    pub(crate) position: f64,
    pub(crate) thermal: f64,
}

/// Speed at which the Stribeck bump has fallen to 1/e (m/s); exponent 1.
pub(crate) const STRIBECK_SPEED: f64 = 0.012;
/// Length of the place-dependent friction (m).
pub(crate) const POSITION_LENGTH: f64 = 0.11;
/// Time constant of the warming up (s).
pub(crate) const THERMAL_TIME: f64 = 10.0;
/// Power at which the supply has sagged by `sag` (W).
pub(crate) const SAG_POWER: f64 = 12.0;
/// Belt pitch (m).
pub(crate) const TOOTH_PITCH: f64 = 0.002;
/// Distance from home to where the end stop begins (m).
pub(crate) const ENDSTOP_START: [f64; 2] = [0.085, 0.045];
/// Natural frequency of the wobbling peg (Hz) and damping ratio.
pub(crate) const WOBBLE: [f64; 2] = [11.0, 0.08];
/// Softening length of the magnet (m).
pub(crate) const MAGNET_LENGTH: f64 = 0.005;

/// Rails, beam and frame.
#[derive(Debug, Clone, Default)]
pub(crate) struct Frame {
    pub(crate) cross_mass: f64,
    pub(crate) racking_mass: f64,
    pub(crate) mass_position: [f64; 2],
    /// Slope (rad).
    pub(crate) tilt: [f64; 2],
    pub(crate) endstop: f64,
    pub(crate) squareness: f64,
}

/// Carriage to peg.
#[derive(Debug, Clone, Default)]
pub(crate) struct Coupling {
    /// Compliance of the magnet (m/N).
    pub(crate) magnet: f64,
    pub(crate) slip_force: f64,
    pub(crate) striker_friction: f64,
    /// Gain of the wobble: shift of the seen point per shift of the foot.
    pub(crate) wobble: f64,
}

/// Camera, estimator and noise.
#[derive(Debug, Clone, Default)]
pub(crate) struct Sensors {
    pub(crate) latency: f64,
    pub(crate) scale_error: f64,
    pub(crate) rotation: f64,
    pub(crate) distortion: f64,
    pub(crate) jitter: f64,
    pub(crate) drop: f64,
    pub(crate) outliers: f64,
    pub(crate) skew: f64,
    pub(crate) camera_noise: f64,
    pub(crate) camera_rho: f64,
    pub(crate) velocity_noise: f64,
    pub(crate) torque_noise: f64,
    pub(crate) disturbance: f64,
    pub(crate) disturbance_rho: f64,
    pub(crate) deadzone: f64,
    pub(crate) estimator_lag: f64,
}

/// What no catalogue lists.
#[derive(Debug, Clone, Default)]
pub(crate) struct Outside {
    pub(crate) hum: f64,
    pub(crate) chirp: f64,
    pub(crate) product_friction: f64,
    pub(crate) dead_spot: f64,
    pub(crate) square_coupling: f64,
    pub(crate) spiral: f64,
}

/// The whole rig.
#[derive(Debug, Clone, Default)]
pub(crate) struct Gantry {
    pub(crate) drive: Drive,
    pub(crate) friction: [Friction; 4],
    pub(crate) frame: Frame,
    pub(crate) coupling: Coupling,
    pub(crate) sensors: Sensors,
    pub(crate) outside: Outside,
    /// Writes `/camera/detections`.
    pub(crate) camera: bool,
    /// Writes `/board/state`.
    pub(crate) board_state: bool,
    /// Motors do not follow: disarmed while commands are logged.
    pub(crate) disarmed: bool,
}

impl Gantry {
    /// Rig number `index` of `seed`; 1 has a camera latency, 2 a command delay, 3 friction at the
    /// motors, 4 a board state.
    pub(crate) fn new(seed: u64, index: usize) -> Self {
        let mut draw = Draw::new(seed, &format!("gantry rig {index}"));
        let mut rig = Self { camera: true, ..Self::default() };
        let ramp = draw.uniform(7.0, 18.0);
        // Load seen by one belt: half of the carriage and bridge, and its own rotor.
        let load = ROTOR_MASS + 0.5 * (CARRIAGE_MASS + 0.5 * BRIDGE_MASS);
        let bandwidth = draw.uniform(55.0, 120.0);
        let damping = draw.uniform(0.8, 1.3);
        let kp = 2.0 * damping * bandwidth * load;
        rig.drive.kp = [kp; 2];
        rig.drive.ki = [bandwidth * bandwidth * load; 2];
        rig.drive.ramp = [ramp; 2];
        rig.drive.force_limit = [ramp * load * 2.5; 2];
        for rail in 0..2 {
            rig.friction[rail].coulomb = draw.uniform(0.8, 3.0);
            rig.friction[rail].viscous = draw.uniform(0.8, 5.0);
        }
        rig.sensors.camera_noise = 2.5e-4;
        rig.sensors.velocity_noise = 4e-4;
        rig.sensors.torque_noise = draw.uniform(0.8e-3, 1.5e-3);
        rig.sensors.disturbance = 0.12;
        match index {
            1 => rig.sensors.latency = draw.uniform(0.006, 0.018),
            2 => rig.drive.delay = [draw.uniform(0.004, 0.010); 2],
            3 => {
                let coulomb = draw.uniform(0.3, 0.7);
                rig.friction[2].coulomb = coulomb;
                rig.friction[3].coulomb = coulomb;
            }
            4 => rig.board_state = true,
            _ => {}
        }
        rig
    }

    /// The same rig with one parameter moved by a hundredth, for each that a plain twin fits. The moving
    /// masses are given by the drawing and are not among them.
    pub(crate) fn neighbours(&self) -> Vec<Self> {
        let moves: [fn(&mut Self); 7] = [
            |rig| rig.drive.kp = rig.drive.kp.map(|kp| 1.01 * kp),
            |rig| rig.drive.ki = rig.drive.ki.map(|ki| 1.01 * ki),
            |rig| rig.drive.ramp = rig.drive.ramp.map(|ramp| 1.01 * ramp),
            |rig| rig.friction[0].coulomb *= 1.01,
            |rig| rig.friction[1].coulomb *= 1.01,
            |rig| rig.friction[0].viscous *= 1.01,
            |rig| rig.friction[1].viscous *= 1.01,
        ];
        let moved = |change: fn(&mut Self)| {
            let mut rig = self.clone();
            change(&mut rig);
            rig
        };
        moves.into_iter().map(moved).collect()
    }

    /// Moving mass in x and y without the rotors (kg).
    pub(crate) fn carried() -> [f64; 2] {
        [CARRIAGE_MASS, CARRIAGE_MASS + BRIDGE_MASS]
    }

    /// Whether motors and carriage need coordinates of their own.
    pub(crate) fn soft_belts(&self) -> bool {
        self.drive.belt.iter().chain(&self.drive.backlash).any(|value| *value > 0.0)
    }

    /// Without anything random, for comparing two simulations.
    pub(crate) fn silent(&self) -> Self {
        let mut rig = self.clone();
        let s = &mut rig.sensors;
        s.camera_noise = 0.0;
        s.velocity_noise = 0.0;
        s.torque_noise = 0.0;
        s.disturbance = 0.0;
        s.outliers = 0.0;
        rig
    }
}
