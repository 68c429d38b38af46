//! Text form of patterns, `name:key=value,key=value`: one table of parameters for reading, writing
//! and checking.

use super::{Heading, Pattern, Slope, TrajectoryError, Turn};
use std::{fmt, str::FromStr};

/// Parameter with its location and allowed range.
pub(super) enum Field<'a> {
    /// Number from `low` to `high`, with its unit.
    Number { value: &'a mut f64, low: f64, high: f64, unit: &'static str },
    /// Integer from 1 to `high`.
    Count { value: &'a mut u32, high: u32 },
    /// Direction.
    Heading(&'a mut Heading),
    /// Diagonal.
    Slope(&'a mut Slope),
    /// Sense of rotation.
    Turn(&'a mut Turn),
}

type Named<'a> = (&'static str, Field<'a>);

const HEADINGS: [(&str, Heading); 4] =
    [("x", Heading::X), ("y", Heading::Y), ("up", Heading::Up), ("down", Heading::Down)];
const SLOPES: [(&str, Slope); 2] = [("up", Slope::Up), ("down", Slope::Down)];
const TURNS: [(&str, Turn); 2] = [("ccw", Turn::Counterclockwise), ("cw", Turn::Clockwise)];

fn speed(value: &mut f64) -> Named<'_> {
    ("speed_m_per_s", Field::Number { value, low: 0.001, high: 2.0, unit: "m/s" })
}

fn length(value: &mut f64) -> Named<'_> {
    ("length_m", Field::Number { value, low: 0.001, high: 2.0, unit: "m" })
}

fn seconds<'a>(key: &'static str, value: &'a mut f64) -> Named<'a> {
    (key, Field::Number { value, low: 0.02, high: 100.0, unit: "s" })
}

fn hertz<'a>(key: &'static str, value: &'a mut f64) -> Named<'a> {
    (key, Field::Number { value, low: 0.01, high: 400.0, unit: "Hz" })
}

fn count<'a>(key: &'static str, value: &'a mut u32) -> Named<'a> {
    (key, Field::Count { value, high: 50 })
}

fn direction(value: &mut Heading) -> Named<'_> {
    ("direction", Field::Heading(value))
}

impl Pattern {
    /// Return the parameters in the order of the text.
    pub(super) fn fields(&mut self) -> Vec<Named<'_>> {
        match self {
            Self::Circle { radius_m: value, speed_m_per_s, turn } => {
                let radius = Field::Number { value, low: 0.001, high: 1.0, unit: "m" };
                vec![("radius_m", radius), speed(speed_m_per_s), ("direction", Field::Turn(turn))]
            }
            Self::Diagonal { slope, length_m, speed_m_per_s } => {
                let slope = ("direction", Field::Slope(slope));
                vec![slope, length(length_m), speed(speed_m_per_s)]
            }
            Self::XLine { length_m, speed_m_per_s } | Self::YLine { length_m, speed_m_per_s } => {
                vec![length(length_m), speed(speed_m_per_s)]
            }
            Self::Ramp { heading, length_m, speed_m_per_s, rate_m_per_s2: value } => {
                let rate = Field::Number { value, low: 0.001, high: 100.0, unit: "m/s^2" };
                let rate = ("rate_m_per_s2", rate);
                vec![direction(heading), length(length_m), speed(speed_m_per_s), rate]
            }
            Self::RandomWalk { speed_m_per_s, hold_min_s, hold_max_s } => vec![
                speed(speed_m_per_s),
                seconds("hold_min_s", hold_min_s),
                seconds("hold_max_s", hold_max_s),
            ],
            Self::Chirp { heading, f0_hz, f1_hz, speed_m_per_s, period_s } => vec![
                direction(heading),
                hertz("f0_hz", f0_hz),
                hertz("f1_hz", f1_hz),
                speed(speed_m_per_s),
                seconds("period_s", period_s),
            ],
            Self::Multisine { lines, f0_hz, f1_hz, speed_m_per_s, period_s } => vec![
                count("lines", lines),
                hertz("f0_hz", f0_hz),
                hertz("f1_hz", f1_hz),
                speed(speed_m_per_s),
                seconds("period_s", period_s),
            ],
            Self::StepLadder { heading, speed_m_per_s, levels, hold_s } => vec![
                direction(heading),
                speed(speed_m_per_s),
                count("levels", levels),
                seconds("hold_s", hold_s),
            ],
            Self::Creep { heading, speed_m_per_s, period_s } => {
                vec![direction(heading), speed(speed_m_per_s), seconds("period_s", period_s)]
            }
        }
    }

    /// Check every parameter, also of a pattern that was built in code.
    ///
    /// # Errors
    /// At the first value out of range.
    pub fn check(&self) -> Result<(), TrajectoryError> {
        let mut copy = *self;
        for (key, field) in copy.fields() {
            if !field.is_in_range() {
                return Err(field.out_of_range(self.name(), key, &field.to_string()));
            }
        }
        let ordered = |low, low_value, high, high_value| {
            if low_value < high_value {
                return Ok(());
            }
            let pattern = self.name();
            Err(TrajectoryError::Order { pattern, low, low_value, high, high_value })
        };
        match *self {
            Self::Chirp { f0_hz, f1_hz, .. } | Self::Multisine { f0_hz, f1_hz, .. } => {
                ordered("f0_hz", f0_hz, "f1_hz", f1_hz)
            }
            Self::RandomWalk { hold_min_s, hold_max_s, .. } => {
                ordered("hold_min_s", hold_min_s, "hold_max_s", hold_max_s)
            }
            _ => Ok(()),
        }
    }

    /// Return the value of a number; `None` for an unknown key.
    pub(super) fn number(&self, wanted: &str) -> Option<f64> {
        let mut copy = *self;
        copy.fields().into_iter().find_map(|(key, field)| match field {
            Field::Number { value, .. } if key == wanted => Some(*value),
            _ => None,
        })
    }

    /// Return the pattern with another value of one of its numbers.
    pub(super) fn with(&self, wanted: &str, new: f64) -> Self {
        let mut copy = *self;
        for (key, field) in copy.fields() {
            if let Field::Number { value, .. } = field
                && key == wanted
            {
                *value = new;
            }
        }
        copy
    }
}

fn choose<T: Copy>(choices: &[(&str, T)], text: &str, value: &mut T) -> bool {
    let found = choices.iter().find(|(name, _)| *name == text);
    found.inspect(|(_, choice)| *value = *choice).is_some()
}

fn name_of<T: PartialEq>(choices: &[(&'static str, T)], value: &T) -> &'static str {
    choices.iter().find(|(_, choice)| choice == value).map_or("", |(name, _)| name)
}

fn names<T>(choices: &[(&str, T)]) -> String {
    let names: Vec<&str> = choices.iter().map(|(name, _)| *name).collect();
    format!("one of {}", names.join(", "))
}

impl Field<'_> {
    fn is_in_range(&self) -> bool {
        match self {
            Self::Number { value, low, high, .. } => (*low..=*high).contains(&**value),
            Self::Count { value, high } => (1..=*high).contains(&**value),
            Self::Heading(_) | Self::Slope(_) | Self::Turn(_) => true,
        }
    }

    fn range(&self) -> String {
        match self {
            Self::Number { low, high, unit, .. } => format!("in [{low}, {high}] {unit}"),
            Self::Count { high, .. } => format!("a whole number in [1, {high}]"),
            Self::Heading(_) => names(&HEADINGS),
            Self::Slope(_) => names(&SLOPES),
            Self::Turn(_) => names(&TURNS),
        }
    }

    /// Read the value from `text`; return whether this was possible.
    fn read(&mut self, text: &str) -> bool {
        match self {
            Self::Number { value, .. } => text.parse().map(|new| **value = new).is_ok(),
            Self::Count { value, .. } => text.parse().map(|new| **value = new).is_ok(),
            Self::Heading(value) => choose(&HEADINGS, text, *value),
            Self::Slope(value) => choose(&SLOPES, text, *value),
            Self::Turn(value) => choose(&TURNS, text, *value),
        }
    }

    fn out_of_range(
        &self,
        pattern: &'static str,
        key: &'static str,
        value: &str,
    ) -> TrajectoryError {
        let (value, range) = (value.to_owned(), self.range());
        TrajectoryError::OutOfRange { pattern, key, value, range }
    }
}

impl fmt::Display for Field<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Number { value, .. } => write!(f, "{value}"),
            Self::Count { value, .. } => write!(f, "{value}"),
            Self::Heading(value) => f.write_str(name_of(&HEADINGS, value)),
            Self::Slope(value) => f.write_str(name_of(&SLOPES, value)),
            Self::Turn(value) => f.write_str(name_of(&TURNS, value)),
        }
    }
}

impl fmt::Display for Pattern {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())?;
        let mut copy = *self;
        for (index, (key, field)) in copy.fields().into_iter().enumerate() {
            let mark = if index == 0 { ':' } else { ',' };
            write!(f, "{mark}{key}={field}")?;
        }
        Ok(())
    }
}

impl FromStr for Pattern {
    type Err = TrajectoryError;

    fn from_str(text: &str) -> Result<Self, TrajectoryError> {
        let (name, rest) = text.trim().split_once(':').unwrap_or((text.trim(), ""));
        let name = name.trim_end();
        let found = Self::ALL.into_iter().find(|pattern| pattern.name() == name);
        let mut pattern = found.ok_or_else(|| {
            let allowed = Self::ALL.map(|pattern| pattern.name()).join(", ");
            TrajectoryError::UnknownPattern { given: name.to_owned(), allowed }
        })?;
        let name = pattern.name();
        let mut given = Vec::new();
        for part in rest.split(',').map(str::trim).filter(|part| !part.is_empty()) {
            let (key, value) = part.split_once('=').unwrap_or((part, ""));
            let (key, value) = (key.trim(), value.trim());
            let mut fields = pattern.fields();
            let allowed = fields.iter().map(|(key, _)| *key).collect::<Vec<_>>().join(", ");
            let Some((key, field)) = fields.iter_mut().find(|(known, _)| *known == key) else {
                let given = key.to_owned();
                return Err(TrajectoryError::UnknownKey { pattern: name, given, allowed });
            };
            if given.contains(key) {
                return Err(TrajectoryError::Twice { pattern: name, key });
            }
            given.push(*key);
            if !field.read(value) || !field.is_in_range() {
                return Err(field.out_of_range(name, key, value));
            }
        }
        pattern.check()?;
        Ok(pattern)
    }
}

impl TryFrom<String> for Pattern {
    type Error = TrajectoryError;

    fn try_from(text: String) -> Result<Self, TrajectoryError> {
        text.parse()
    }
}

impl From<Pattern> for String {
    fn from(pattern: Pattern) -> Self {
        pattern.to_string()
    }
}
