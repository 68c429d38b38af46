//! The filter of one object: predict, gate, update.

use super::{
    matrix::Matrix4,
    motion::{Estimate, Obstacle, Rolling, add_acceleration_noise},
    region::{Region, Regions, Strikers},
    settings::{FilterSettings, Object},
};

/// Longest step of the transition (s); longer intervals are divided.
const LONGEST_STEP: f64 = 0.02;

/// Detection of one object, as the filter takes it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measurement {
    /// Position (m).
    pub position: [f64; 2],
    /// Covariance xx, xy, yy (m2) that the detector has given; `None` where it gives none.
    pub covariance: Option<[f64; 3]>,
}

impl From<[f64; 2]> for Measurement {
    fn from(position: [f64; 2]) -> Self {
        Self { position, covariance: None }
    }
}

/// Measurement noise R (m2).
#[derive(Debug, Clone, Copy)]
enum Noise {
    /// The same variance in each axis, uncorrelated.
    Isotropic(f64),
    /// xx, xy, yy.
    Full([f64; 3]),
}

impl Noise {
    fn matrix(self) -> [[f64; 2]; 2] {
        match self {
            Self::Isotropic(r) => [[r, 0.0], [0.0, r]],
            Self::Full([xx, xy, yy]) => [[xx, xy], [xy, yy]],
        }
    }

    /// Covariance P + R of the innovation.
    #[inline]
    fn added_to(self, p: &Matrix4) -> [[f64; 2]; 2] {
        match self {
            Self::Isotropic(r) => [[p[0][0] + r, p[0][1]], [p[0][1], p[1][1] + r]],
            Self::Full([xx, xy, yy]) => {
                [[p[0][0] + xx, p[0][1] + xy], [p[0][1] + xy, p[1][1] + yy]]
            }
        }
    }

    /// Element of K R K' for two rows of the gain K.
    #[inline]
    fn between(self, a: [f64; 2], b: [f64; 2]) -> f64 {
        match self {
            Self::Isotropic(r) => r * (a[0] * b[0] + a[1] * b[1]),
            Self::Full([xx, xy, yy]) => {
                xx * a[0] * b[0] + xy * (a[0] * b[1] + a[1] * b[0]) + yy * a[1] * b[1]
            }
        }
    }
}

/// Decision of the gate on a detection.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Gate {
    /// The detection updated the estimate.
    Accepted,
    /// The normalized innovation squared exceeds the gate; the estimate remains the prediction.
    Rejected,
}

/// Innovation: a detection minus its prediction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Innovation {
    /// Detected minus predicted position (m).
    pub residual: [f64; 2],
    /// Covariance S = H P H' + R (m2).
    pub covariance: [[f64; 2]; 2],
    /// Normalised innovation squared residual' S^-1 residual: chi-square with two degrees of
    /// freedom for a consistent filter.
    pub nis: f64,
    /// Decision of the gate.
    pub gate: Gate,
}

/// The filter of one object: parameters only, no state. Nothing in it allocates.
///
/// ```
/// use klasktron::ekf::{FilterSettings, Object, ObjectFilter};
/// let filter = ObjectFilter::new(&FilterSettings::default(), Object::Ball);
/// let mut ball = filter.start([0.0, 0.0]);
/// for frame in 1..=12 {
///     let seen = [0.0, 0.5 * f64::from(frame) / 120.0];
///     filter.predict(&mut ball, 1.0 / 120.0, &[None, None]);
///     filter.update(&mut ball, seen);
/// }
/// assert!((ball.mean[3] - 0.5).abs() < 0.02);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ObjectFilter {
    measurement_variance: f64,
    covariance_scale: f64,
    start_speed_variance: f64,
    open_psd: f64,
    largest_nis: f64,
    ball: Option<Ball>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Ball {
    rolling: Rolling,
    regions: Regions,
    restitution: f64,
    restitution_sigma: f64,
    tangential_sigma: f64,
}

impl ObjectFilter {
    /// Build the filter of `object`.
    #[must_use]
    pub fn new(settings: &FilterSettings, object: Object) -> Self {
        let own = settings.object(object);
        Self {
            measurement_variance: own.measurement_sigma_m.powi(2),
            covariance_scale: own.covariance_scale.unwrap_or(1.0),
            start_speed_variance: own.start_speed_sigma_m_per_s.powi(2),
            open_psd: own.open_psd_m2_per_s3,
            // The tail of chi-square with two degrees of freedom is exp(-x/2).
            largest_nis: -2.0 * settings.gate_probability.ln(),
            ball: own.ball.map(|ball| Ball {
                rolling: Rolling {
                    deceleration: ball.rolling_deceleration_m_per_s2,
                    drag: ball.rolling_drag_per_s,
                },
                regions: Regions::new(&settings.board, own.open_psd_m2_per_s3, &ball),
                restitution: ball.wall_restitution,
                restitution_sigma: ball.wall_restitution_sigma,
                tangential_sigma: ball.wall_tangential_sigma,
            }),
        }
    }

    /// Variance of a detection without a covariance, in each axis (m2).
    #[must_use]
    pub fn measurement_variance(&self) -> f64 {
        self.measurement_variance
    }

    /// Measurement noise: the scaled covariance of the detection, or the constant of the settings.
    #[inline]
    fn noise(&self, covariance: Option<[f64; 3]>) -> Noise {
        match covariance {
            Some(own) => Noise::Full(own.map(|value| self.covariance_scale * value)),
            None => Noise::Isotropic(self.measurement_variance),
        }
    }

    /// Standard deviation of an unknown initial velocity (m/s).
    pub(super) fn start_speed_sigma(&self) -> f64 {
        self.start_speed_variance.sqrt()
    }

    /// Estimate after a first detection.
    #[must_use]
    pub fn start(&self, seen: impl Into<Measurement>) -> Estimate {
        let Measurement { position, covariance } = seen.into();
        let (r, s) = (self.noise(covariance).matrix(), self.start_speed_variance);
        let mut covariance = [[0.0; 4]; 4];
        for i in 0..2 {
            covariance[i][..2].copy_from_slice(&r[i]);
            covariance[i + 2][i + 2] = s;
        }
        Estimate { mean: [position[0], position[1], 0.0, 0.0], covariance }
    }

    /// Estimate after two detections `dt` (s) apart.
    pub(super) fn start_between(
        &self,
        before: Measurement,
        seen: Measurement,
        dt: f64,
    ) -> Estimate {
        let mut estimate = self.start(seen);
        let [old, new] = [before, seen].map(|own| self.noise(own.covariance).matrix());
        for i in 0..2 {
            estimate.mean[i + 2] = (seen.position[i] - before.position[i]) / dt;
            for j in 0..2 {
                let p = &mut estimate.covariance;
                p[i][j + 2] = new[i][j] / dt;
                p[i + 2][j] = new[i][j] / dt;
                p[i + 2][j + 2] = (old[i][j] + new[i][j]) / (dt * dt);
            }
        }
        add_acceleration_noise(&mut estimate.covariance, [self.open_psd; 2], dt);
        estimate
    }

    /// Predict `dt` (s) ahead with the strikers at `strikers` (m). Returns the region of the path.
    #[inline]
    pub fn predict(&self, estimate: &mut Estimate, dt: f64, strikers: &Strikers) -> Region {
        let steps = if dt <= LONGEST_STEP { 1 } else { (dt / LONGEST_STEP).ceil() as usize };
        let dt = dt / steps as f64;
        let mut region = Region::Open;
        for _ in 0..steps {
            region = match &self.ball {
                Some(ball) => ball.step(estimate, dt, strikers),
                None => {
                    Rolling::NONE.advance(estimate, dt);
                    add_acceleration_noise(&mut estimate.covariance, [self.open_psd; 2], dt);
                    Region::Open
                }
            };
        }
        region
    }

    /// Innovation of a detection, with the decision of the gate.
    #[must_use]
    #[inline]
    pub fn innovation(&self, estimate: &Estimate, seen: impl Into<Measurement>) -> Innovation {
        let Measurement { position, covariance } = seen.into();
        let covariance = self.noise(covariance).added_to(&estimate.covariance);
        let residual = [position[0] - estimate.mean[0], position[1] - estimate.mean[1]];
        let [a, b] = residual;
        let [[xx, xy], [_, yy]] = covariance;
        let nis = (yy * a * a - 2.0 * xy * a * b + xx * b * b) / (xx * yy - xy * xy);
        let gate = if nis <= self.largest_nis { Gate::Accepted } else { Gate::Rejected };
        Innovation { residual, covariance, nis, gate }
    }

    /// Update with a detection, unless the gate rejects it. The covariance is updated in Joseph form,
    /// (I - K H) P (I - K H)' + K R K', which keeps it symmetric and positive definite.
    pub fn update(&self, estimate: &mut Estimate, seen: impl Into<Measurement>) -> Innovation {
        let seen = seen.into();
        let innovation = self.innovation(estimate, seen);
        if innovation.gate == Gate::Accepted {
            correct(estimate, &innovation, self.noise(seen.covariance));
        }
        innovation
    }
}

#[inline]
fn correct(estimate: &mut Estimate, innovation: &Innovation, noise: Noise) {
    let [[xx, xy], [_, yy]] = innovation.covariance;
    let share = 1.0 / (xx * yy - xy * xy);
    let inverse = [[yy * share, -xy * share], [-xy * share, xx * share]];
    let p = estimate.covariance;
    let gain: [[f64; 2]; 4] = std::array::from_fn(|row| {
        std::array::from_fn(|c| p[row][0] * inverse[0][c] + p[row][1] * inverse[1][c])
    });
    for (value, gain) in estimate.mean.iter_mut().zip(&gain) {
        *value += gain[0] * innovation.residual[0] + gain[1] * innovation.residual[1];
    }
    estimate.covariance = joseph(&p, &gain, noise);
}

/// Joseph form (I - K H) P (I - K H)' + K R K' for H = [I 0].
///
/// With A = (I - K H) P by rows, the result is A minus its first two columns times K', plus the
/// noise.
#[inline]
fn joseph(p: &Matrix4, gain: &[[f64; 2]; 4], noise: Noise) -> Matrix4 {
    let a: Matrix4 = std::array::from_fn(|i| {
        std::array::from_fn(|j| p[i][j] - gain[i][0] * p[0][j] - gain[i][1] * p[1][j])
    });
    let mut result = [[0.0; 4]; 4];
    for i in 0..4 {
        for j in i..4 {
            let own = noise.between(gain[i], gain[j]);
            let cell = a[i][j] - a[i][0] * gain[j][0] - a[i][1] * gain[j][1] + own;
            result[i][j] = cell;
            result[j][i] = cell;
        }
    }
    result
}

impl Ball {
    #[inline]
    fn step(&self, estimate: &mut Estimate, dt: f64, strikers: &Strikers) -> Region {
        let from = [estimate.mean[0], estimate.mean[1]];
        self.rolling.advance(estimate, dt);
        let to = [estimate.mean[0], estimate.mean[1]];
        let (region, psd) = self.regions.along(from, to, strikers);
        add_acceleration_noise(&mut estimate.covariance, psd, dt);
        for axis in 0..2 {
            let gap = self.regions.reach[axis] - estimate.mean[axis].abs();
            let variance = estimate.covariance[axis][axis];
            if gap <= 0.0 || gap * gap <= Obstacle::CERTAIN * Obstacle::CERTAIN * variance {
                self.wall(axis, estimate.mean[axis]).bounce(estimate);
            }
        }
        region
    }
    /// The wall across `axis` on the side of `position`.
    fn wall(&self, axis: usize, position: f64) -> Obstacle {
        let mut normal = [0.0; 2];
        normal[axis] = 1.0_f64.copysign(position);
        Obstacle {
            normal,
            reach: self.regions.reach[axis],
            speed: 0.0,
            restitution: self.restitution,
            restitution_sigma: self.restitution_sigma,
            tangential_sigma: self.tangential_sigma,
        }
    }
}
