//! Dimensionless features of a motion, each as a force along the coordinate.
//!
//! A feature is a user's effect with one parameter, its coefficient, in the unit of the force. It has no name in the
//! catalogue, and its typical sizes belong to the recordings at hand.

use crate::{
    effects::{Coordinates, Definition, Effect, ParameterDefinition, Place, Sign},
    gap::findings::DescriptionScale,
    stats::quantile,
    twin::{AxisFrame, Plant, Stage, Twin},
};

/// Feature: name of its effect, text with the symbols of [`Sizes::scales`], and expression, in which `{v}` is the
/// placeholder of the dimensionless velocity, and so on.
struct Feature {
    name: &'static str,
    shown: &'static str,
    expression: &'static str,
}

const fn feature(name: &'static str, shown: &'static str, expression: &'static str) -> Feature {
    Feature { name, shown, expression }
}

/// Features of every machine. Inertia, viscous and Coulomb friction are parameters of every twin, so `a`, `v` and
/// `sign(v)` are not among them.
const FEATURES: [Feature; 33] = [
    feature("feature.constant", "1", "1"),
    feature("feature.speed", "|v|", "abs({v})"),
    feature("feature.v2", "v^2", "{v}^2"),
    feature("feature.v2_sign", "v |v|", "{v} * abs({v})"),
    feature("feature.v3", "v^3", "{v}^3"),
    feature("feature.v3_size", "|v|^3", "abs({v})^3"),
    feature("feature.v2_forwards", "[v > 0] v^2", "(0.5 * ({v} + abs({v})))^2"),
    feature("feature.v2_backwards", "[v < 0] v^2", "(0.5 * ({v} - abs({v})))^2"),
    feature("feature.v3_forwards", "[v > 0] v^3", "(0.5 * ({v} + abs({v})))^3"),
    feature("feature.v3_backwards", "[v < 0] v^3", "(0.5 * ({v} - abs({v})))^3"),
    feature("feature.x", "x", "{x}"),
    feature("feature.x2", "x^2", "{x}^2"),
    feature("feature.x3", "x^3", "{x}^3"),
    feature("feature.sin_1", "sin(pi x)", "sin(PI * {x})"),
    feature("feature.cos_1", "cos(pi x)", "cos(PI * {x})"),
    feature("feature.sin_2", "sin(2 pi x)", "sin(2 * PI * {x})"),
    feature("feature.cos_2", "cos(2 pi x)", "cos(2 * PI * {x})"),
    feature("feature.sin_3", "sin(3 pi x)", "sin(3 * PI * {x})"),
    feature("feature.cos_3", "cos(3 pi x)", "cos(3 * PI * {x})"),
    feature("feature.x_sign", "x sign(v)", "{x} * signum({v})"),
    feature("feature.x2_sign", "x^2 sign(v)", "{x}^2 * signum({v})"),
    feature("feature.sin_sign", "sin(pi x) sign(v)", "sin(PI * {x}) * signum({v})"),
    feature("feature.cos_sign", "cos(pi x) sign(v)", "cos(PI * {x}) * signum({v})"),
    feature("feature.x_v", "x v", "{x} * {v}"),
    feature("feature.x2_v", "x^2 v", "{x}^2 * {v}"),
    feature("feature.x_a", "x a", "{x} * {a}"),
    feature("feature.x2_a", "x^2 a", "{x}^2 * {a}"),
    feature("feature.a2_sign", "a |a|", "{a} * abs({a})"),
    feature("feature.a_size", "|a|", "abs({a})"),
    feature("feature.a_size_sign", "|a| sign(v)", "abs({a}) * signum({v})"),
    feature("feature.t", "t", "{t}"),
    feature("feature.t_sign", "t sign(v)", "{t} * signum({v})"),
    feature("feature.t_v", "t v", "{t} * {v}"),
];

/// Features of a coordinate that turns: harmonics of one turn.
const OF_A_TURN: [Feature; 4] = [
    feature("feature.turn_sin_1", "sin(theta)", "sin(position)"),
    feature("feature.turn_cos_1", "cos(theta)", "cos(position)"),
    feature("feature.turn_sin_2", "sin(2 theta)", "sin(2 * position)"),
    feature("feature.turn_cos_2", "cos(2 theta)", "cos(2 * position)"),
];

/// Features of a machine whose drive force is simulated. On a single axis the features predict the input, so that it
/// would predict itself.
const OF_THE_INPUT: [Feature; 4] = [
    feature("feature.f_size_sign", "|f| sign(v)", "abs({f}) * signum({v})"),
    feature("feature.f2", "f^2", "{f}^2"),
    feature("feature.f2_sign", "f |f|", "{f} * abs({f})"),
    feature("feature.f3", "f^3", "{f}^3"),
];

/// Fraction of the RMS of the force at which the coefficient of a feature starts, and by which its bounds are scaled.
const TYPICAL: f64 = 0.1;

/// Typical sizes by which a motion becomes dimensionless.
pub(super) struct Sizes {
    /// Position that counts as zero.
    origin: f64,
    position: f64,
    velocity: f64,
    acceleration: f64,
    duration: f64,
    force: f64,
    pub(super) force_unit: String,
    position_unit: String,
    is_axis: bool,
}

impl Sizes {
    /// Sizes of the `stages` to which `twin` was fitted; `None` where nothing moved. A single axis has its own. A table
    /// has the RMS of the velocities, half the range of the belts, and the force that reaches this velocity within one
    /// block of the tests.
    pub(super) fn of(twin: &Twin, stages: &[&dyn Stage]) -> Option<Self> {
        let sizes = match twin.axis_frame {
            Some(frame) => Self::of_axis(&frame),
            None => Self::of_table(twin, stages)?,
        };
        let all = [sizes.position, sizes.velocity, sizes.acceleration, sizes.duration, sizes.force];
        all.iter().all(|size| size.is_finite() && 0.0 < *size).then_some(sizes)
    }

    fn of_axis(AxisFrame { position_origin, scales }: &AxisFrame) -> Self {
        Self {
            origin: rounded_to(*position_origin, scales.position),
            position: short(scales.position),
            velocity: short(scales.velocity),
            acceleration: short(scales.acceleration),
            duration: short(scales.duration),
            force: short(scales.input),
            force_unit: scales.input_unit.to_owned(),
            position_unit: scales.position_unit.to_owned(),
            is_axis: true,
        }
    }

    fn of_table(twin: &Twin, stages: &[&dyn Stage]) -> Option<Self> {
        let channels = || stages.iter().flat_map(|stage| stage.channels());
        let velocities: Vec<f64> = channels()
            .filter(|channel| channel.unit == "m/s")
            .flat_map(|channel| channel.measured.iter().copied().filter(|own| own.is_finite()))
            .collect();
        let positions: Vec<f64> = stages.iter().flat_map(|stage| stage.phase_positions()).collect();
        let squares: f64 = velocities.iter().map(|own| own * own).sum();
        let velocity = (squares / velocities.len().max(1) as f64).sqrt();
        let acceleration = velocity / stages.first()?.block_seconds();
        let lengths = channels().filter_map(|own| Some(own.times.last()? - own.times.first()?));
        Some(Self {
            origin: 0.0,
            position: short(0.5 * (quantile(&positions, 1.0)? - quantile(&positions, 0.0)?)),
            velocity: short(velocity),
            acceleration: short(acceleration),
            duration: short(lengths.fold(0.0, f64::max)),
            force: short(Plant::new(twin).mean_mass() * acceleration),
            force_unit: "N".to_owned(),
            position_unit: "m".to_owned(),
            is_axis: false,
        })
    }

    /// Scales of the symbols of the features.
    pub(super) fn scales(&self) -> Vec<DescriptionScale> {
        let own = |symbol: &str, quantity: &str, origin: f64, scale: f64, unit: String| {
            DescriptionScale {
                symbol: symbol.to_owned(),
                quantity: quantity.to_owned(),
                origin,
                scale,
                unit,
            }
        };
        let position = &self.position_unit;
        let mut all = vec![
            own("x", "position", self.origin, self.position, position.clone()),
            own("v", "velocity", 0.0, self.velocity, format!("{position}/s")),
            own("a", "acceleration", 0.0, self.acceleration, format!("{position}/s^2")),
            own("t", "time", 0.0, self.duration, "s".to_owned()),
        ];
        if self.is_axis {
            all.push(own("theta", "position", 0.0, 1.0, "rad".to_owned()));
        } else {
            all.push(own("f", "input", 0.0, self.force, self.force_unit.clone()));
        }
        all
    }

    /// `template` with the dimensionless quantities written out.
    fn written(&self, template: &str) -> String {
        let origin = match self.origin {
            0.0 => "position".to_owned(),
            origin if origin < 0.0 => format!("(position + {})", -origin),
            origin => format!("(position - {origin})"),
        };
        template
            .replace("{x}", &format!("({origin} / {})", self.position))
            .replace("{v}", &format!("(velocity / {})", self.velocity))
            .replace("{a}", &format!("(acceleration / {})", self.acceleration))
            .replace("{t}", &format!("(time / {})", self.duration))
            .replace("{f}", &format!("(input / {})", self.force))
    }
}

/// `value` with three significant digits: the equation states the same numbers as the fit.
fn short(value: f64) -> f64 {
    format!("{value:.2e}").parse().unwrap_or(value)
}

/// `value` to a hundredth of `size`.
fn rounded_to(value: f64, size: f64) -> f64 {
    let decimals = (2.0 - size.log10().floor()).max(0.0) as usize;
    format!("{value:.decimals$}").parse().unwrap_or(value)
}

/// A feature as an effect that the search can test.
#[derive(Debug, Clone, Copy)]
pub(super) struct Candidate {
    pub(super) effect: &'static Effect,
    /// Text with the symbols of [`Sizes::scales`].
    pub(super) shown: &'static str,
}

/// Every feature of a machine with these sizes.
pub(super) fn candidates(sizes: &Sizes) -> Vec<Candidate> {
    let turns = sizes.is_axis && sizes.position_unit == "rad";
    let of_a_turn = OF_A_TURN.iter().filter(|_| turns);
    let of_the_input = OF_THE_INPUT.iter().filter(|_| !sizes.is_axis);
    FEATURES
        .iter()
        .chain(of_a_turn)
        .chain(of_the_input)
        .map(|own| Candidate { effect: effect(own, sizes), shown: own.shown })
        .collect()
}

fn effect(feature: &Feature, sizes: &Sizes) -> &'static Effect {
    let definition = Definition {
        name: feature.name.to_owned(),
        summary: feature.shown.to_owned(),
        place: Place::Force,
        coordinates: Coordinates::Guides,
        expression: format!("coefficient * {}", sizes.written(feature.expression)),
        excitation: "a motion in which the feature varies".to_owned(),
        confused_with: Vec::new(),
        parameters: vec![ParameterDefinition {
            name: "coefficient".to_owned(),
            unit: sizes.force_unit.clone(),
            typical: TYPICAL * sizes.force,
            sign: Sign::Any,
        }],
    };
    definition.effect().expect("the expressions of features are complete")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::{AxisScales, Motion, Physics};

    fn wheel() -> Sizes {
        let scales = AxisScales {
            input: 3.0,
            position: 2.0,
            velocity: 12.0,
            acceleration: 90.0,
            sample_period: 0.02,
            band: 2.0,
            duration: 30.0,
            input_unit: "V",
            position_unit: "rad",
        };
        Sizes::of_axis(&AxisFrame { position_origin: -0.5, scales })
    }

    #[test]
    fn every_feature_is_a_force_that_is_proportional_to_its_coefficient() {
        let sizes = wheel();
        let motion = Motion {
            position: 0.7,
            velocity: -3.0,
            acceleration: 9.0,
            time: 6.0,
            ..Motion::default()
        };
        let all = candidates(&sizes);
        assert_eq!(all.len(), FEATURES.len() + OF_A_TURN.len());
        for own in all {
            let Physics::Expression(Place::Force, expression) = own.effect.physics else {
                panic!("{} is no force", own.shown)
            };
            let value = expression.value(&[2.0], &motion);
            let (x, v, a, t) = (1.2 / 2.0, -0.25_f64, 0.1_f64, 0.2);
            let expected = match own.shown {
                "[v > 0] v^3" => 0.0,
                "[v < 0] v^3" | "v^3" => v.powi(3),
                "x^2 sign(v)" => -x * x,
                "x^2 a" => x * x * a,
                "t v" => t * v,
                "sin(2 pi x)" => (2.0 * std::f64::consts::PI * x).sin(),
                "cos(2 theta)" => 1.4_f64.cos(),
                _ => value / 2.0,
            };
            assert!((value - 2.0 * expected).abs() < 1e-12, "{}: {value}", own.shown);
            assert_eq!(own.effect.null, [0.0]);
        }
    }

    #[test]
    fn sizes_have_three_digits_and_no_exponent_in_an_expression() {
        assert_eq!(rounded_to(1_000.123_456, 0.3), 1_000.123);
        assert_eq!([1.234_5e-7, 0.0, -98_765.0].map(short), [1.23e-7, 0.0, -98_800.0]);
        let small = Sizes { velocity: 1.23e-7, ..wheel() };
        assert_eq!(
            small.written("{v}^2 * {x}"),
            "(velocity / 0.000000123)^2 * ((position + 0.5) / 2)"
        );
    }
}
