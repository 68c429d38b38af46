//! Colour model: the probability of each kind of piece for every colour.
//!
//! Each class (background, ball, striker, biscuit) has a histogram of its colours in Y, U, V with 32 steps per
//! channel, smoothed by two Gaussian kernels. The membership of a colour in a class is its fraction of the summed
//! densities, `p_c / (w p_background + p_ball + p_striker + p_biscuit)`, with a small uniform density of the
//! background, so that an unknown colour is background. The weight `w` is 1, and for the strikers the root of the ratio
//! of the pixel counts: a shadow is a small part of the background, but it lies next to the striker that casts it.
//! A larger weight for the biscuits would give their white to the lines of the field. Source: M. J. Jones and J. M. Rehg, "Statistical color
//! models with application to skin detection", IJCV 46 (2002).
//!
//! Light that drifts: the mean red, green and blue of the empty field are compared with those of the recording that
//! the model was fitted to. Their ratios (von Kries' diagonal model) move the tables along, a part per frame.

use super::frame::{linear_rgb, yuv_of_rgb};
use serde::{Deserialize, Serialize};

/// Kinds of pieces that a colour can belong to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// The ball.
    Ball,
    /// A striker.
    Striker,
    /// A biscuit.
    Biscuit,
}

impl Kind {
    /// All kinds.
    pub const ALL: [Self; 3] = [Self::Ball, Self::Striker, Self::Biscuit];

    /// Return the name as in files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Ball => "ball",
            Self::Striker => "striker",
            Self::Biscuit => "biscuit",
        }
    }

    pub(super) fn index(self) -> usize {
        self as usize
    }
}

/// Steps per channel.
const STEPS: usize = 32;
/// Width of a step (levels of 0 to 255).
const STEP_LEVELS: usize = 256 / STEPS;
/// Number of colours of a table.
const COLORS: usize = STEPS * STEPS * STEPS;
/// Standard deviations of the two kernels (steps) and their weights: the narrow one follows the recording, the wide
/// one covers light that the recording does not have.
const KERNELS: [(f64, f64); 2] = [(0.7, 0.9), (1.8, 0.1)];
/// Weight of the uniform density of the background; a larger one refuses more unknown colours.
const UNKNOWN_WEIGHT: f64 = 0.05;
/// Largest weight of the background's density.
const MAX_BACKGROUND_WEIGHT: f64 = 50.0;
/// Colours whose table is renewed in each frame: the whole table follows the light within 16 frames.
const RENEWED_PER_FRAME: usize = COLORS / 16;
/// Change of the light (as a logarithm) that renews the whole table in one frame, which takes about 0.5 ms: somebody
/// has switched a lamp.
const LIGHT_JUMP: f64 = 0.06;
/// Gains outside of this range are not followed: the frame is too dark or too bright anyway.
const GAIN_RANGE: [f64; 2] = [0.4, 2.5];

/// Colour of a histogram with its number of pixels.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ColorCount(
    /// Y, U and V in steps of 8 levels (0 to 31).
    pub [u8; 3],
    /// Number of pixels.
    pub u32,
);

/// Fitted colour model, as `detector.json` keeps it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ColorModel {
    /// Mean red, green and blue of the empty field in the recording of the fit (0 to 255).
    pub field_rgb: [f64; 3],
    /// Colours of everything else.
    pub background: Vec<ColorCount>,
    /// Colours of the ball.
    pub ball: Vec<ColorCount>,
    /// Colours of the strikers.
    pub striker: Vec<ColorCount>,
    /// Colours of the biscuits; empty for a table without biscuits.
    #[serde(default)]
    pub biscuit: Vec<ColorCount>,
}

/// Histogram while a model is being fitted.
#[derive(Debug, Clone)]
pub(super) struct Histogram(Vec<u32>);

impl Histogram {
    pub(super) fn new() -> Self {
        Self(vec![0; COLORS])
    }

    pub(super) fn add(&mut self, yuv: [u8; 3]) {
        self.0[index_of(yuv)] += 1;
    }

    pub(super) fn total(&self) -> u64 {
        self.0.iter().map(|&count| u64::from(count)).sum()
    }

    pub(super) fn counts(&self) -> Vec<ColorCount> {
        let seen = self.0.iter().enumerate().filter(|(_, count)| 0 < **count);
        seen.map(|(at, &count)| ColorCount(steps_of(at), count)).collect()
    }
}

#[inline]
fn index_of([y, u, v]: [u8; 3]) -> usize {
    (usize::from(y >> 3) << 10) | (usize::from(u >> 3) << 5) | usize::from(v >> 3)
}

fn steps_of(at: usize) -> [u8; 3] {
    [at >> 10, (at >> 5) & 31, at & 31].map(|step| step as u8)
}

/// Error: a colour model that cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ColorError {
    /// A class without pixels.
    #[error(
        "the colour model has no pixels of class {class}; fit it anew with `klasktron tune-detector`"
    )]
    Empty {
        /// Name of the class.
        class: &'static str,
    },
    /// A step outside of 0 to 31.
    #[error("the colour model has the step {step} in class {class}; steps are 0 to 31")]
    Step {
        /// Name of the class.
        class: &'static str,
        /// Value found.
        step: u8,
    },
    /// A field colour outside of its range.
    #[error("field_rgb is {value}; it must lie above 0 and up to 255")]
    Field {
        /// Value found.
        value: f64,
    },
}

/// Tables from colour to class, adapted to the light.
#[derive(Debug, Clone)]
pub(super) struct ColorTable {
    field_rgb: [f64; 3],
    /// Memberships under the light of the fit, 0 to 255 for each kind.
    fitted: [Vec<u8>; 3],
    /// The same under the light of the present frames.
    memberships: [Vec<u8>; 3],
    /// 0 for background, 1 + index of the kind for a membership above one half.
    labels: Vec<u8>,
    /// Ratios of red, green and blue to those of the fit.
    gains: [f64; 3],
    /// Those that the whole table was last renewed for.
    table_gains: [f64; 3],
    /// First colour to be renewed in the next frame.
    next: usize,
}

impl ColorTable {
    pub(super) fn new(model: &ColorModel) -> Result<Self, ColorError> {
        for value in model.field_rgb {
            if !(0.0 < value && value <= 255.0) {
                return Err(ColorError::Field { value });
            }
        }
        let background = density("background", &model.background)?;
        let kinds = [
            density("ball", &model.ball)?,
            density("striker", &model.striker)?,
            density("biscuit", &model.biscuit)?,
        ];
        let unknown = UNKNOWN_WEIGHT / COLORS as f64;
        let pixels = |counts: &[ColorCount]| counts.iter().map(|own| f64::from(own.1)).sum::<f64>();
        let shadows = (pixels(&model.background) / pixels(&model.striker)).sqrt();
        let weights = [1.0, shadows.clamp(1.0, MAX_BACKGROUND_WEIGHT), 1.0];
        let fitted = [0, 1, 2].map(|kind: usize| {
            (0..COLORS)
                .map(|at| {
                    let of_kinds = kinds[0][at] + kinds[1][at] + kinds[2][at];
                    let all = unknown + weights[kind] * background[at] + of_kinds;
                    (255.0 * kinds[kind][at] / all).round() as u8
                })
                .collect::<Vec<u8>>()
        });
        let mut table = Self {
            field_rgb: model.field_rgb,
            memberships: fitted.clone(),
            fitted,
            labels: vec![0; COLORS],
            gains: [1.0; 3],
            table_gains: [1.0; 3],
            next: 0,
        };
        table.renew_all();
        Ok(table)
    }

    /// Follow the light: `field_rgb` is the mean colour of the field in this frame.
    pub(super) fn adapt(&mut self, field_rgb: [f64; 3]) {
        let gains = [0, 1, 2].map(|k| field_rgb[k].max(1.0) / self.field_rgb[k]);
        if gains.iter().any(|gain| !(GAIN_RANGE[0]..=GAIN_RANGE[1]).contains(gain)) {
            return;
        }
        let jump = (0..3).map(|k| (gains[k] / self.table_gains[k]).ln().abs()).fold(0.0, f64::max);
        self.gains = gains;
        if LIGHT_JUMP < jump {
            self.renew_all();
        } else {
            self.renew(RENEWED_PER_FRAME);
        }
    }

    fn renew_all(&mut self) {
        self.table_gains = self.gains;
        self.next = 0;
        self.renew(COLORS);
    }

    fn renew(&mut self, count: usize) {
        for at in self.next..(self.next + count).min(COLORS) {
            let middle =
                steps_of(at).map(|step| (usize::from(step) * STEP_LEVELS + STEP_LEVELS / 2) as f64);
            let rgb = linear_rgb(middle);
            let seen = [0, 1, 2].map(|k| (rgb[k] / self.gains[k]).round().clamp(0.0, 255.0) as u8);
            let from = index_of(yuv_of_rgb(seen));
            let mut label = 0;
            for (kind, fitted) in self.fitted.iter().enumerate() {
                self.memberships[kind][at] = fitted[from];
                if 127 < fitted[from] {
                    label = 1 + kind as u8;
                }
            }
            self.labels[at] = label;
        }
        self.next = (self.next + count) % COLORS;
        if self.next == 0 {
            self.table_gains = self.gains;
        }
    }

    /// Return 0 for background, 1 + index of the kind otherwise.
    #[inline]
    pub(super) fn label(&self, yuv: [u8; 3]) -> u8 {
        self.labels[index_of(yuv)]
    }

    /// Return the table of memberships (0 to 255) of a kind.
    #[inline]
    pub(super) fn memberships(&self, kind: Kind) -> &[u8] {
        &self.memberships[kind.index()]
    }

    /// Return the index of a colour in the tables.
    #[inline]
    pub(super) fn index(yuv: [u8; 3]) -> usize {
        index_of(yuv)
    }
}

/// Smoothed density of a histogram; its sum is 1.
fn density(class: &'static str, counts: &[ColorCount]) -> Result<Vec<f64>, ColorError> {
    let mut histogram = vec![0.0; COLORS];
    for ColorCount(steps, count) in counts {
        if let Some(&step) = steps.iter().find(|step| STEPS <= usize::from(**step)) {
            return Err(ColorError::Step { class, step });
        }
        let [y, u, v] = steps.map(usize::from);
        histogram[(y << 10) | (u << 5) | v] += f64::from(*count);
    }
    let total: f64 = histogram.iter().sum();
    if total <= 0.0 {
        // A table may be played without biscuits.
        return if class == Kind::Biscuit.name() {
            Ok(histogram)
        } else {
            Err(ColorError::Empty { class })
        };
    }
    let mut smooth = vec![0.0; COLORS];
    for (sigma, weight) in KERNELS {
        let blurred = blur(&histogram, sigma);
        // Mass beyond the edges of the cube is lost; dividing by the rest keeps the sum.
        let kept: f64 = blurred.iter().sum();
        smooth.iter_mut().zip(&blurred).for_each(|(s, b)| *s += weight * b / kept);
    }
    Ok(smooth)
}

/// Gaussian blur along the three axes of the cube.
fn blur(values: &[f64], sigma: f64) -> Vec<f64> {
    let reach = (3.0 * sigma).ceil() as isize;
    let kernel: Vec<f64> =
        (-reach..=reach).map(|d| (-0.5 * (d as f64 / sigma).powi(2)).exp()).collect();
    let mut current = values.to_vec();
    for stride in [1, STEPS, STEPS * STEPS] {
        let mut next = vec![0.0; COLORS];
        for (at, value) in current.iter().enumerate().filter(|(_, value)| 0.0 < **value) {
            let place = ((at / stride) % STEPS) as isize;
            for (weight, offset) in kernel.iter().zip(-reach..=reach) {
                let target = place + offset;
                if (0..STEPS as isize).contains(&target) {
                    next[(at as isize + offset * stride as isize) as usize] += weight * value;
                }
            }
        }
        current = next;
    }
    current
}

#[cfg(test)]
mod tests {
    use super::*;

    fn one(rgb: [u8; 3]) -> Vec<ColorCount> {
        let mut histogram = Histogram::new();
        (0..100).for_each(|_| histogram.add(yuv_of_rgb(rgb)));
        histogram.counts()
    }

    fn model() -> ColorModel {
        ColorModel {
            field_rgb: [30.0, 60.0, 120.0],
            background: one([30, 60, 120]),
            ball: one([237, 158, 25]),
            striker: one([9, 9, 10]),
            biscuit: one([237, 237, 230]),
        }
    }

    #[test]
    fn colours_get_the_class_that_they_were_fitted_to() {
        let table = ColorTable::new(&model()).unwrap();
        let label = |rgb| table.label(yuv_of_rgb(rgb));
        assert_eq!([label([30, 60, 120]), label([237, 158, 25])], [0, 1]);
        assert_eq!([label([9, 9, 10]), label([237, 237, 230])], [2, 3]);
        // A colour that nobody has shown is background.
        assert_eq!(label([10, 240, 10]), 0);
    }

    #[test]
    fn the_table_follows_the_light() {
        let mut table = ColorTable::new(&model()).unwrap();
        let dim = |rgb: [u8; 3]| yuv_of_rgb(rgb.map(|c| (f64::from(c) * 0.55).round() as u8));
        assert_eq!(table.label(dim([237, 158, 25])), 0);
        // A slow drift: the table follows part by part.
        for step in 0..200 {
            let gain = 1.0 - 0.45 * f64::from(step) / 199.0;
            table.adapt([30.0, 60.0, 120.0].map(|own| gain * own));
        }
        for _ in 0..16 {
            table.adapt([16.5, 33.0, 66.0]);
        }
        assert_eq!(table.label(dim([237, 158, 25])), 1);
        // A lamp is switched: one frame is enough.
        table.adapt([30.0, 60.0, 120.0]);
        assert_eq!(table.label(yuv_of_rgb([237, 158, 25])), 1);
        assert_eq!(table.label(dim([30, 60, 120])), 0);
    }

    #[test]
    fn models_without_a_class_are_refused() {
        let error = ColorTable::new(&ColorModel { ball: Vec::new(), ..model() }).unwrap_err();
        assert_eq!(error, ColorError::Empty { class: "ball" });
        let wrong = vec![ColorCount([0, 32, 0], 1)];
        let error = ColorTable::new(&ColorModel { striker: wrong, ..model() }).unwrap_err();
        assert_eq!(error, ColorError::Step { class: "striker", step: 32 });
    }
}
