//! Drives and slides of a twin as parameters, as far as other simulators have them.

use super::{Inexpressible, Target};
use crate::{
    effects::{Domain, LoopGains, Physics},
    twin::{Instance, Plant, Twin},
};

/// Displacement at which a magnetic spring has its largest force (m), from which on the spring counts as linear: the
/// striker stays within some millimetres.
const LINEAR_FROM: f64 = 0.1;

/// Mass of the carriage's body (kg) in other simulators; the rest of the moving mass is armature.
/// The bridge has half of it.
pub(super) const CARRIAGE_KG: f64 = 0.25;

/// Parameters of one motor.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Drive {
    /// Dead time of the command (s).
    pub(super) delay: f64,
    /// Command u to `gain * u + offset`.
    pub(super) gain: f64,
    pub(super) offset: f64,
    /// Time constant of a first-order lag (s); 0 for none.
    pub(super) lag: f64,
    /// Slew limit of the setpoint (m/s^2).
    pub(super) slew: Option<f64>,
    /// Velocity loop: force per velocity error (N s/m) and per its integral (N/m), in metres of belt.
    pub(super) proportional: f64,
    pub(super) integral: f64,
    /// Delay of the velocity in the loop (s).
    pub(super) feedback_delay: f64,
    /// Time constant of the estimator of that velocity (s).
    pub(super) estimator_time_constant: f64,
    /// Largest force (N of belt).
    pub(super) force_limit: Option<f64>,
    /// Friction at the motor, in metres of belt.
    pub(super) damping: f64,
    pub(super) friction: f64,
}

/// Parameters of one guide.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Guide {
    pub(super) damping: f64,
    pub(super) friction: f64,
    /// Constant force (N).
    pub(super) force: f64,
    /// Spring to the origin (N/m).
    pub(super) stiffness: f64,
}

/// Linear spring of the striker on its magnet.
#[derive(Debug, Clone, Copy)]
pub(super) struct Coupling {
    /// N/m.
    pub(super) stiffness: f64,
    /// N s/m.
    pub(super) damping: f64,
}

/// Everything that the file has.
#[derive(Debug, Clone, Default)]
pub(super) struct Mechanics {
    pub(super) drives: [Drive; 2],
    pub(super) guides: [Guide; 2],
    /// Moving mass along x and y (kg).
    pub(super) mass: [f64; 2],
    pub(super) coupling: Option<Coupling>,
    pub(super) inexpressible: Vec<Inexpressible>,
    pub(super) outside: Vec<&'static str>,
}

impl Mechanics {
    pub(super) fn of(twin: &Twin, target: Target) -> Self {
        let mut own = Self::default();
        own.drives.iter_mut().for_each(|drive| drive.gain = 1.0);
        for instance in &twin.instances {
            own.add((twin, target), instance);
        }
        own
    }

    fn add(&mut self, (twin, target): (&Twin, Target), instance: &Instance) {
        use Domain::{Ball, Coupling, Drive, Estimator, Gantry, Impact, Sensor};
        match instance.effect.domain {
            Ball | Impact | Sensor | Estimator => {
                if !self.outside.contains(&instance.effect.name) {
                    self.outside.push(instance.effect.name);
                }
            }
            Coupling => self.add_coupling((twin, target), instance),
            Drive | Gantry => {
                let motors = twin.machine.motors();
                let mut missing: Option<Option<String>> = None;
                for index in (0..motors).filter(|index| instance.axis.covers(*index)) {
                    let at_drive = self.add_to_drive((twin, target), instance, index);
                    let added = at_drive.or_else(|| self.add_to_guide(target, instance, index));
                    match added {
                        None => missing = Some(None),
                        Some(Some(part)) => missing = Some(Some(part)),
                        Some(None) => {}
                    }
                }
                if let Some(part) = missing {
                    self.miss(instance, part);
                }
            }
        }
    }

    fn miss(&mut self, instance: &Instance, part: Option<String>) {
        let axis = instance.axis;
        self.inexpressible.push(Inexpressible { effect: instance.effect.name, axis, part });
    }

    /// Add an effect on the command, the loop or the force of motor `index`. `None` where it is another one, else the
    /// part that is missing, if any.
    fn add_to_drive(
        &mut self,
        (twin, target): (&Twin, Target),
        instance: &Instance,
        index: usize,
    ) -> Option<Option<String>> {
        let p = instance.numbers();
        let drive = &mut self.drives[index];
        match instance.effect.name {
            "drive.delay" if p[0] < 0.0 => {
                return Some(Some(format!("a delay of {} s", p[0])));
            }
            "drive.delay" => drive.delay += p[0],
            "drive.gain" => (drive.gain, drive.offset) = (drive.gain * p[0], drive.offset * p[0]),
            "drive.offset" => drive.offset += p[0],
            "drive.lag1" | "drive.current_loop" if 0.0 < drive.lag => {
                return Some(Some("a second lag in series".to_owned()));
            }
            "drive.lag1" => drive.lag = p[0],
            // The force of a single axis is its input.
            "drive.current_loop" if twin.machine.motors() == 1 => drive.lag = p[0],
            "drive.saturation.slew" => {
                drive.slew = Some(drive.slew.map_or(p[0], |other| other.min(p[0])));
            }
            "drive.saturation.torque_speed" if target == Target::Mjcf => {
                drive.force_limit = Some(p[0]);
                return Some(Some(format!(
                    "the decrease of the force to zero at {} m/s, and the stop of the integration at the limit",
                    p[1]
                )));
            }
            "drive.velocity_loop" => {
                let lag = self.add_loop(twin, instance, index);
                let is_missing = 0.0 < lag && target == Target::Mjcf;
                return Some(is_missing.then(|| {
                    format!("the lag of {lag} s of its feedback, by delay and velocity estimator")
                }));
            }
            _ => return None,
        }
        Some(None)
    }

    /// Add the loop of motor `index`; the lag of its feedback behind a steady acceleration (s).
    fn add_loop(&mut self, twin: &Twin, instance: &Instance, index: usize) -> f64 {
        let numbers = instance.numbers();
        let gains = instance.effect.physics.equations().iter().find_map(|own| match own {
            Physics::VelocityLoop(call) => Some(call(&numbers)),
            _ => None,
        });
        let gains: LoopGains = gains.unwrap_or_default();
        let reference =
            twin.controller_reference_mass.unwrap_or_else(|| Plant::new(twin).mean_mass());
        let mass = reference / twin.machine.motors() as f64;
        let drive = &mut self.drives[index];
        drive.proportional = mass * gains.proportional_per_s;
        drive.integral = mass * gains.integral_per_s2;
        drive.feedback_delay = gains.feedback_delay_s;
        drive.estimator_time_constant = gains.estimator_time_constant_s;
        gains.feedback_delay_s + 2.0 * gains.estimator_time_constant_s
    }

    /// Add an effect on the motion along guide or belt `index`; as [`Self::add_to_drive`].
    fn add_to_guide(
        &mut self,
        target: Target,
        instance: &Instance,
        index: usize,
    ) -> Option<Option<String>> {
        let p = instance.numbers();
        let (drive, guide) = (&mut self.drives[index], &mut self.guides[index]);
        let at_motor = instance.axis.is_motor();
        match instance.effect.name {
            "drive.friction.viscous" if at_motor => drive.damping += p[0],
            "drive.friction.viscous" => guide.damping += p[0],
            "drive.friction.coulomb" if at_motor && target == Target::Mjcf => {
                drive.friction += p[0];
            }
            "drive.friction.coulomb" if at_motor => {
                return Some(Some(
                    "friction at the motor, which is no friction of a joint".to_owned(),
                ));
            }
            "drive.friction.coulomb" => guide.friction += p[0],
            "gantry.inertia" => self.mass[index] += p[0],
            "gantry.tilt" => guide.force += p[0],
            "gantry.stiffness" => guide.stiffness += p[0],
            _ => return None,
        }
        Some(None)
    }

    fn add_coupling(&mut self, (twin, target): (&Twin, Target), instance: &Instance) {
        // An actuator moves the carriage; the striker is a body of the scene.
        if instance.effect.name != "coupling.magnet_spring" || target == Target::IsaacLab {
            self.miss(instance, None);
            return;
        }
        let p = instance.numbers();
        let damping = 2.0 * p[1] * (p[0] * twin.striker_mass).sqrt();
        self.coupling = Some(Coupling { stiffness: p[0], damping });
        if p[2] < LINEAR_FROM {
            self.miss(instance, Some(format!("the softening beyond {} m", p[2])));
        }
        // Friction on the board, not on the magnet, so no friction of the spring's joints.
        if let Some(friction) = p.get(3).filter(|own| 0.0 < **own) {
            self.miss(
                instance,
                Some(format!("the striker's friction on the board of {friction} N")),
            );
        }
    }
}
