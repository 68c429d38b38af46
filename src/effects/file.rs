//! Files of effects that a user defines, for `--effects`.
//!
//! ```toml
//! [[effect]]
//! name = "user.cable_drag"
//! summary = "the cable chain pulls back at speed"
//! place = "force"
//! expression = "-drag * velocity * abs(velocity)"
//!
//! [[effect.parameter]]
//! name = "drag"
//! unit = "N s^2/m^2"
//! typical = 2.0
//! sign = "positive"
//! ```

use super::{
    Effect,
    expression::{Definition, define},
};
use serde::Deserialize;
use std::{fs, io, path::Path};
use toml::Spanned;

/// Reason why a file of effects cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum EffectsFileError {
    /// The file cannot be read.
    #[error("cannot read the effects {path}: {source}")]
    Io {
        /// Path of the file.
        path: String,
        /// Reason.
        source: io::Error,
    },
    /// A line is wrong.
    #[error("{path}:{line}:{column}: {what}")]
    Line {
        /// Path of the file.
        path: String,
        /// Line, from 1.
        line: usize,
        /// Column in characters, from 1.
        column: usize,
        /// What is wrong, and the way out.
        what: String,
    },
    /// The file has no effect.
    #[error("{path} defines no effect; write one or more tables [[effect]]")]
    Empty {
        /// Path of the file.
        path: String,
    },
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    #[serde(default)]
    effect: Vec<Spanned<Definition>>,
}

/// Read the effects that the file at `path` defines and make them known to [`find`](super::find).
///
/// # Errors
/// The file cannot be read, or a definition in it is wrong.
pub fn read_effects(path: &Path) -> Result<Vec<&'static Effect>, EffectsFileError> {
    let shown = path.display().to_string();
    let text = fs::read_to_string(path)
        .map_err(|source| EffectsFileError::Io { path: shown.clone(), source })?;
    from_text(&text, shown)
}

fn from_text(text: &str, path: String) -> Result<Vec<&'static Effect>, EffectsFileError> {
    let wrong = |offset: usize, what: String| {
        let before = text.get(..offset).unwrap_or(text);
        let line = 1 + before.matches('\n').count();
        let column = 1 + before.chars().rev().take_while(|own| *own != '\n').count();
        EffectsFileError::Line { path: path.clone(), line, column, what }
    };
    let file: File = toml::from_str(text).map_err(|error| {
        let what = error.message().replace('\n', "; ");
        wrong(error.span().map_or(0, |span| span.start), what)
    })?;
    if file.effect.is_empty() {
        return Err(EffectsFileError::Empty { path });
    }
    let mut effects: Vec<&'static Effect> = Vec::new();
    for spanned in &file.effect {
        let begin = spanned.span().start;
        let within = text.get(begin..).unwrap_or_default();
        let at = |part: &str| begin + within.find(&format!("\"{part}\"")).map_or(0, |at| at + 1);
        let own = spanned.get_ref();
        if effects.iter().any(|effect| effect.name == own.name) {
            return Err(wrong(at(&own.name), format!("'{}' is defined twice", own.name)));
        }
        let effect = define(own).map_err(|error| wrong(at(&error.text), error.what))?;
        effects.push(effect);
    }
    Ok(effects)
}

#[cfg(test)]
mod tests {
    use super::*;

    const CABLE: &str = r#"# Effects of our own.
[[effect]]
name = "user.file_cable"
place = "force"
expression = "-drag * velocity * abs(velocity)"

[[effect.parameter]]
name = "drag"
unit = "N s^2/m^2"
typical = 2.0
sign = "positive"
"#;

    fn error(text: &str) -> String {
        from_text(text, "own.toml".to_owned()).unwrap_err().to_string()
    }

    #[test]
    fn a_file_defines_effects_that_are_found_by_name() {
        let effects =
            from_text(&CABLE.replace("user.file_cable", "user.found_cable"), "own.toml".to_owned())
                .unwrap();
        assert_eq!(effects.len(), 1);
        assert!(std::ptr::eq(super::super::find("user.found_cable").unwrap(), effects[0]));
        assert_eq!(effects[0].parameters[0].bounds, (0.0, 2000.0));
    }

    #[test]
    fn a_mistake_is_told_with_file_line_and_column() {
        for (wrong, message) in [
            (CABLE.replace("velocity * abs", "velocty * abs"), "own.toml:5:15: the expression"),
            (
                CABLE.replace("user.file_cable", "drive.backlash"),
                "own.toml:3:9: 'drive.backlash' is",
            ),
            (CABLE.replace("place =", "plaice ="), "own.toml:4:1: unknown field `plaice`"),
            (CABLE.replace("\"force\"", "\"torque\""), "own.toml:4:9: unknown variant `torque`"),
            (CABLE.replace("2.0", "0.0"), "own.toml:8:9: typical of 'drag' is 0"),
            (CABLE.replace("\"drag\"", "\"drag"), "own.toml:8:"),
            ("# nothing".to_owned(), "own.toml defines no effect"),
        ] {
            let found = error(&wrong);
            assert!(found.starts_with(message), "{found}");
        }
    }
}
