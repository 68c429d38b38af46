//! Units that a table may have, and their factors to the recorded units.
//!
//! A value is multiplied by the factor of its unit. Constant factors are exact to the last bit of
//! `f64`. Three units need a number from the user: sample numbers their step (s), a duty its supply
//! (V), and encoder counts their number per turn.

use super::{AxisColumns, ColumnError, PositionUnit};
use std::f64::consts::{PI, TAU};

/// Unit of a column, and its conversion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Unit {
    /// Name in the source. `N m` and `mN m` may also be typed without their space.
    pub(super) name: &'static str,
    /// Unit after the conversion.
    pub(super) recorded: &'static str,
    factor: Factor,
}

/// Number that turns a value into the recorded unit.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Factor {
    /// Constant.
    Constant(f64),
    /// Time step of a sample number (s).
    Step,
    /// Supply voltage at a duty of 1 (V).
    Supply,
    /// Angle of one encoder count (rad).
    Count,
}

/// Quantity that a column holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Quantity {
    /// Time of a sample.
    Time,
    /// Input of the axis.
    Input,
    /// Measured position.
    Position,
    /// Measured velocity.
    Velocity,
}

static TIMES: [Unit; 5] = [
    constant("s", "s", 1.0),
    constant("ms", "s", 1e-3),
    constant("us", "s", 1e-6),
    constant("ns", "s", 1e-9),
    Unit { name: "steps", recorded: "s", factor: Factor::Step },
];

/// Micro sign and the Greek letter, which look the same.
const MICRO: [char; 2] = ['\u{b5}', '\u{3bc}'];

/// International inch (m).
const INCH: f64 = 0.0254;

/// Standard gravity (m/s^2).
const GRAVITY: f64 = 9.80665;

/// Pound-force (N): the international pound, 0.45359237 kg, in standard gravity.
const POUND_FORCE: f64 = 0.453_592_37 * GRAVITY;

/// Speeds, which inputs and velocities share.
static SPEEDS: [Unit; 16] = [
    constant("m/s", "m/s", 1.0),
    constant("cm/s", "m/s", 1e-2),
    constant("mm/s", "m/s", 1e-3),
    constant("um/s", "m/s", 1e-6),
    constant("nm/s", "m/s", 1e-9),
    constant("m/min", "m/s", 1.0 / 60.0),
    constant("mm/min", "m/s", 1e-3 / 60.0),
    constant("in/s", "m/s", INCH),
    constant("in/min", "m/s", INCH / 60.0),
    constant("rad/s", "rad/s", 1.0),
    constant("mrad/s", "rad/s", 1e-3),
    constant("deg/s", "rad/s", PI / 180.0),
    constant("rpm", "rad/s", TAU / 60.0),
    constant("turns/s", "rad/s", TAU),
    constant("rev/s", "rad/s", TAU),
    Unit { name: "counts/s", recorded: "rad/s", factor: Factor::Count },
];

/// Inputs other than [`SPEEDS`].
static INPUTS: [Unit; 22] = [
    constant("m", "m", 1.0),
    constant("mm", "m", 1e-3),
    constant("N", "N", 1.0),
    constant("mN", "N", 1e-3),
    constant("kN", "N", 1e3),
    constant("kgf", "N", GRAVITY),
    constant("lbf", "N", POUND_FORCE),
    constant("N m", "N m", 1.0),
    constant("kN m", "N m", 1e3),
    constant("N cm", "N m", 1e-2),
    constant("mN m", "N m", 1e-3),
    constant("kgf m", "N m", GRAVITY),
    constant("kgf cm", "N m", 1e-2 * GRAVITY),
    constant("lbf in", "N m", POUND_FORCE * INCH),
    constant("lbf ft", "N m", POUND_FORCE * 12.0 * INCH),
    constant("ozf in", "N m", POUND_FORCE / 16.0 * INCH),
    constant("V", "V", 1.0),
    constant("mV", "V", 1e-3),
    constant("A", "A", 1.0),
    constant("mA", "A", 1e-3),
    constant("uA", "A", 1e-6),
    Unit { name: "duty", recorded: "V", factor: Factor::Supply },
];

static POSITIONS: [Unit; 12] = [
    constant("m", "m", 1.0),
    constant("cm", "m", 1e-2),
    constant("mm", "m", 1e-3),
    constant("um", "m", 1e-6),
    constant("nm", "m", 1e-9),
    constant("in", "m", INCH),
    constant("rad", "rad", 1.0),
    constant("mrad", "rad", 1e-3),
    constant("deg", "rad", PI / 180.0),
    constant("turns", "rad", TAU),
    constant("rev", "rad", TAU),
    Unit { name: "counts", recorded: "rad", factor: Factor::Count },
];

const fn constant(name: &'static str, recorded: &'static str, factor: f64) -> Unit {
    Unit { name, recorded, factor: Factor::Constant(factor) }
}

impl Quantity {
    /// Option of the command line that names the column.
    pub(super) fn option(self) -> &'static str {
        match self {
            Self::Time => "--time",
            Self::Input => "--input",
            Self::Position => "--position",
            Self::Velocity => "--velocity",
        }
    }

    fn units(self) -> impl Iterator<Item = &'static Unit> {
        let (shared, own): (&[Unit], &[Unit]) = match self {
            Self::Time => (&[], &TIMES),
            Self::Input => (&SPEEDS, &INPUTS),
            Self::Position => (&[], &POSITIONS),
            Self::Velocity => (&SPEEDS, &[]),
        };
        shared.iter().chain(own)
    }

    /// Names of the units, as they are typed without quotes.
    #[must_use]
    pub fn unit_list(self) -> String {
        self.units().map(|unit| unit.name.replace(' ', "")).collect::<Vec<_>>().join(", ")
    }

    /// The unit called `name`; µ may be written as itself or as u.
    fn find(self, name: &str) -> Option<&'static Unit> {
        let name = name.replace(MICRO, "u");
        self.units().find(|unit| unit.name == name || unit.name.replace(' ', "") == name)
    }

    /// Split `column:unit` at its last colon. The unit is `None` where the text behind that colon is
    /// no unit of the quantity; the whole text is the column then.
    pub(super) fn split(self, text: &str) -> (&str, Option<&'static Unit>) {
        match text.rsplit_once(':').map(|(column, unit)| (column, self.find(unit))) {
            Some((column, Some(unit))) => (column, Some(unit)),
            _ => (text, None),
        }
    }

    /// Unit of a column that is given without one: seconds, or that of `--position-unit`.
    pub(super) fn default_unit(self, position_unit: PositionUnit) -> &'static Unit {
        let name = match (self, position_unit) {
            (Self::Time | Self::Input, _) => "s",
            (Self::Position, unit) => unit.name(),
            (Self::Velocity, PositionUnit::Metre) => "m/s",
            (Self::Velocity, PositionUnit::Radian) => "rad/s",
        };
        self.find(name).unwrap_or(&TIMES[0])
    }
}

impl Unit {
    /// Return whether values are converted.
    pub(super) fn is_converted(&self) -> bool {
        self.name != self.recorded
    }

    /// Return whether the unit is one of an angle or angular velocity.
    pub(super) fn is_rotary(&self) -> bool {
        self.recorded.starts_with("rad")
    }

    /// Return whether the unit is a duty, from -1 to 1.
    pub(super) fn is_duty(&self) -> bool {
        self.factor == Factor::Supply
    }

    /// Return the factor to the recorded unit; `quantity` tells the error which option is
    /// incomplete.
    pub(super) fn factor(
        &self,
        quantity: Quantity,
        columns: &AxisColumns,
    ) -> Result<f64, ColumnError> {
        let needed = |value: Option<f64>, needs: &'static str| {
            let (option, unit) = (quantity.option(), self.name);
            value.ok_or(ColumnError::Incomplete { option, unit, needs })
        };
        Ok(match self.factor {
            Factor::Constant(factor) => factor,
            Factor::Step => needed(columns.step_s, "--step-s SECONDS")?,
            Factor::Supply => needed(columns.supply_v, "--supply-v VOLTS")?,
            Factor::Count => TAU / needed(columns.counts_per_turn, "--counts-per-turn COUNT")?,
        })
    }

    /// Return which of `--step-s`, `--supply-v` and `--counts-per-turn` the unit uses, if any.
    pub(super) fn option_used(&self) -> Option<&'static str> {
        match self.factor {
            Factor::Constant(_) => None,
            Factor::Step => Some("--step-s"),
            Factor::Supply => Some("--supply-v"),
            Factor::Count => Some("--counts-per-turn"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const QUANTITIES: [Quantity; 4] =
        [Quantity::Time, Quantity::Input, Quantity::Position, Quantity::Velocity];

    /// Relative tolerance: some roundings of `f64`.
    const TOLERANCE: f64 = 1e-15;

    fn columns() -> AxisColumns {
        AxisColumns {
            step_s: Some(0.002),
            supply_v: Some(12.0),
            counts_per_turn: Some(4096.0),
            ..AxisColumns::new("t", "u:V").position("x")
        }
    }

    /// Quantity, value, unit, the value in the recorded unit, and that unit; computed by hand.
    const EXAMPLES: [(Quantity, f64, &str, f64, &str); 74] = [
        (Quantity::Time, 2.5, "s", 2.5, "s"),
        (Quantity::Time, 1500.0, "ms", 1.5, "s"),
        (Quantity::Time, 250.0, "us", 0.00025, "s"),
        (Quantity::Time, 3e6, "ns", 0.003, "s"),
        (Quantity::Time, 500.0, "steps", 1.0, "s"),
        (Quantity::Input, 0.3, "m/s", 0.3, "m/s"),
        (Quantity::Input, 300.0, "mm/s", 0.3, "m/s"),
        (Quantity::Input, 30.0, "cm/s", 0.3, "m/s"),
        (Quantity::Input, 30.0, "m/min", 0.5, "m/s"),
        (Quantity::Input, 6000.0, "mm/min", 0.1, "m/s"),
        (Quantity::Input, 10.0, "in/s", 0.254, "m/s"),
        (Quantity::Input, 600.0, "in/min", 0.254, "m/s"),
        (Quantity::Input, 250.0, "um/s", 2.5e-4, "m/s"),
        (Quantity::Input, 250.0, "\u{b5}m/s", 2.5e-4, "m/s"),
        (Quantity::Input, 40.0, "nm/s", 4e-8, "m/s"),
        (Quantity::Input, 500.0, "mrad/s", 0.5, "rad/s"),
        (Quantity::Input, 2048.0, "counts/s", PI, "rad/s"),
        (Quantity::Input, 4.0, "rad/s", 4.0, "rad/s"),
        (Quantity::Input, 90.0, "deg/s", PI / 2.0, "rad/s"),
        (Quantity::Input, 60.0, "rpm", TAU, "rad/s"),
        (Quantity::Input, 0.5, "turns/s", PI, "rad/s"),
        (Quantity::Input, 0.5, "rev/s", PI, "rad/s"),
        (Quantity::Input, 0.02, "m", 0.02, "m"),
        (Quantity::Input, 20.0, "mm", 0.02, "m"),
        (Quantity::Input, -7.0, "N", -7.0, "N"),
        (Quantity::Input, 125.0, "mN", 0.125, "N"),
        (Quantity::Input, 0.25, "kN", 250.0, "N"),
        (Quantity::Input, 10.0, "lbf", 44.482_216_152_605, "N"),
        (Quantity::Input, 10.0, "kgf", 98.0665, "N"),
        (Quantity::Input, 10.0, "kgf m", 98.0665, "N m"),
        (Quantity::Input, 10.0, "lbf ft", 13.558_179_483_314_004, "N m"),
        (Quantity::Input, 2.5, "kN m", 2500.0, "N m"),
        (Quantity::Input, 250.0, "N cm", 2.5, "N m"),
        (Quantity::Input, 100.0, "kgf cm", 9.80665, "N m"),
        (Quantity::Input, 1000.0, "lbf in", 112.984_829_027_616_7, "N m"),
        (Quantity::Input, 1000.0, "ozfin", 7.061_551_814_226_044, "N m"),
        (Quantity::Input, 1000.0, "ozf in", 7.061_551_814_226_044, "N m"),
        (Quantity::Input, 1.5, "N m", 1.5, "N m"),
        (Quantity::Input, 1.5, "Nm", 1.5, "N m"),
        (Quantity::Input, 40.0, "mN m", 0.04, "N m"),
        (Quantity::Input, 40.0, "mNm", 0.04, "N m"),
        (Quantity::Input, 12.0, "V", 12.0, "V"),
        (Quantity::Input, 3300.0, "mV", 3.3, "V"),
        (Quantity::Input, 2.0, "A", 2.0, "A"),
        (Quantity::Input, 850.0, "mA", 0.85, "A"),
        (Quantity::Input, 850.0, "uA", 8.5e-4, "A"),
        (Quantity::Input, 0.5, "duty", 6.0, "V"),
        (Quantity::Position, 0.1, "m", 0.1, "m"),
        (Quantity::Position, 100.0, "mm", 0.1, "m"),
        (Quantity::Position, 10.0, "cm", 0.1, "m"),
        (Quantity::Position, 50.0, "um", 5e-5, "m"),
        (Quantity::Position, 50.0, "\u{3bc}m", 5e-5, "m"),
        (Quantity::Position, 50.0, "nm", 5e-8, "m"),
        (Quantity::Position, 2.0, "in", 0.0508, "m"),
        (Quantity::Position, 500.0, "mrad", 0.5, "rad"),
        (Quantity::Position, 1.0, "rad", 1.0, "rad"),
        (Quantity::Position, 180.0, "deg", PI, "rad"),
        (Quantity::Position, -0.25, "turns", -PI / 2.0, "rad"),
        (Quantity::Position, -0.25, "rev", -PI / 2.0, "rad"),
        (Quantity::Position, 4096.0, "counts", TAU, "rad"),
        (Quantity::Velocity, 100.0, "mm/s", 0.1, "m/s"),
        (Quantity::Velocity, 10.0, "cm/s", 0.1, "m/s"),
        (Quantity::Velocity, 3.0, "m/min", 0.05, "m/s"),
        (Quantity::Velocity, 3000.0, "mm/min", 0.05, "m/s"),
        (Quantity::Velocity, 100.0, "in/s", 2.54, "m/s"),
        (Quantity::Velocity, 100.0, "in/min", 0.254 / 6.0, "m/s"),
        (Quantity::Velocity, 100.0, "um/s", 1e-4, "m/s"),
        (Quantity::Velocity, 100.0, "nm/s", 1e-7, "m/s"),
        (Quantity::Velocity, 100.0, "mrad/s", 0.1, "rad/s"),
        (Quantity::Velocity, 180.0, "deg/s", PI, "rad/s"),
        (Quantity::Velocity, 60.0, "rpm", TAU, "rad/s"),
        (Quantity::Velocity, 2.0, "turns/s", 2.0 * TAU, "rad/s"),
        (Quantity::Velocity, 2.0, "rev/s", 2.0 * TAU, "rad/s"),
        (Quantity::Velocity, 1024.0, "counts/s", PI / 2.0, "rad/s"),
    ];

    #[test]
    fn every_unit_converts_as_computed_by_hand() {
        for (quantity, value, name, expected, recorded) in EXAMPLES {
            let text = format!("column:{name}");
            let (column, unit) = quantity.split(&text);
            let unit = unit.unwrap_or_else(|| panic!("{name} is no unit of {quantity:?}"));
            assert_eq!((column, unit.recorded), ("column", recorded), "{name}");
            let found = value * unit.factor(quantity, &columns()).unwrap();
            assert!((found - expected).abs() <= TOLERANCE * expected.abs(), "{name}: {found}");
        }
    }

    #[test]
    fn every_unit_is_among_the_examples_or_is_recorded_as_it_is() {
        for quantity in QUANTITIES {
            for unit in quantity.units() {
                let is_example =
                    EXAMPLES.iter().any(|(q, _, n, ..)| *q == quantity && *n == unit.name);
                let is_same = !unit.is_converted() && unit.factor == Factor::Constant(1.0);
                assert!(is_example || is_same, "{quantity:?} {}", unit.name);
            }
        }
    }

    #[test]
    fn only_a_known_unit_behind_the_last_colon_counts() {
        let split = |text| {
            let (column, unit) = Quantity::Position.split(text);
            (column, unit.map(|unit| unit.name))
        };
        assert_eq!(split("pos"), ("pos", None));
        assert_eq!(split("pos:mm"), ("pos", Some("mm")));
        assert_eq!(split("arm:pos"), ("arm:pos", None));
        assert_eq!(split("arm:pos:deg"), ("arm:pos", Some("deg")));
        assert_eq!(split("pos:mm:mm"), ("pos:mm", Some("mm")), "a column called pos:mm");
        assert_eq!(split("pos:rpm"), ("pos:rpm", None), "no unit of a position");
        assert_eq!(split("pos:"), ("pos:", None));
        assert_eq!(split(":m"), ("", Some("m")));
    }

    #[test]
    fn columns_without_a_unit_have_the_default() {
        let name = |quantity: Quantity, unit| quantity.default_unit(unit).name;
        assert_eq!(name(Quantity::Time, PositionUnit::Radian), "s");
        assert_eq!(name(Quantity::Position, PositionUnit::Metre), "m");
        assert_eq!(name(Quantity::Position, PositionUnit::Radian), "rad");
        assert_eq!(name(Quantity::Velocity, PositionUnit::Metre), "m/s");
        assert_eq!(name(Quantity::Velocity, PositionUnit::Radian), "rad/s");
    }
}
