//! `klasktron.toml`: options of subcommands, one table each, by their long names.
//!
//! ```toml
//! [global]
//! quiet = true
//!
//! [fit-actuator]
//! epochs = 50
//!
//! [collect]
//! pattern = ["circle", "x_line"]
//! raw = true
//!
//! [import.csv]
//! position-unit = "rad"
//! ```
//!
//! The definition of the command line gives the options of a table and their types. Every table is checked, also
//! the tables of commands that are not run. Old names of options (`out`) are accepted.

use clap::{Arg, ArgAction, Command, error::ErrorKind};
use klasktron::sweep::nearest;
use std::{
    any::TypeId,
    fs, io,
    num::NonZeroUsize,
    ops::Range,
    path::{Path, PathBuf},
};
use toml::{
    Spanned,
    de::{DeTable, DeValue},
};

/// Name of the settings file in the working folder.
pub(crate) const USUAL_NAME: &str = "klasktron.toml";
/// Table of the options of every subcommand.
const GLOBAL: &str = "global";
/// Options that a file cannot hold: they choose the file or end the program.
const TYPED_ONLY: [&str; 4] = ["config", "no_config", "help", "version"];

/// Reason why the settings file cannot be used.
#[derive(Debug, thiserror::Error)]
pub(crate) enum SettingsError {
    /// The file cannot be read.
    #[error("{}: cannot read the settings: {source}; --no-config ignores the file", path.display())]
    Read {
        /// Path of the file.
        path: PathBuf,
        /// Reason.
        source: io::Error,
    },
    /// A line is wrong.
    #[error("{place}: {what}")]
    Line {
        /// File and line.
        place: String,
        /// Description of the error, with the way out.
        what: String,
    },
}

/// One setting of the file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Setting {
    /// Subcommands of its table; empty for `[global]`.
    pub(crate) table: Vec<String>,
    /// Identifier of its option in clap.
    pub(crate) id: String,
    /// Long name of its option.
    pub(crate) key: String,
    /// File and line.
    pub(crate) place: String,
    /// Words on the command line; empty for a flag that is `false`.
    pub(crate) arguments: Vec<String>,
}

impl Setting {
    /// Setting as it would be typed.
    pub(crate) fn as_typed(&self) -> String {
        if self.arguments.is_empty() {
            return format!("no --{}", self.key);
        }
        self.arguments.join(" ")
    }
}

/// Read every setting of the file at `path` for the built command line `root`.
///
/// # Errors
/// The file cannot be read or holds a setting that no command takes.
pub(crate) fn read(path: &Path, root: &Command) -> Result<Vec<Setting>, SettingsError> {
    let text = fs::read_to_string(path)
        .map_err(|source| SettingsError::Read { path: path.to_owned(), source })?;
    let mut reader = Reader { path, text: &text, settings: Vec::new() };
    let document = DeTable::parse(&text)
        .map_err(|error| reader.wrong(error.span().unwrap_or(0..0), error.message().to_owned()))?;
    for (name, value) in in_order(document.get_ref()) {
        reader.top(root, name, value)?;
    }
    Ok(reader.settings)
}

/// State of reading one file.
struct Reader<'a> {
    path: &'a Path,
    text: &'a str,
    settings: Vec<Setting>,
}

type Key<'i> = Spanned<toml::de::DeString<'i>>;
type Value<'i> = Spanned<DeValue<'i>>;

impl Reader<'_> {
    fn place(&self, span: &Range<usize>) -> String {
        let before = &self.text.as_bytes()[..span.start.min(self.text.len())];
        let line = 1 + before.iter().filter(|byte| **byte == b'\n').count();
        format!("{}:{line}", self.path.display())
    }

    fn wrong(&self, span: Range<usize>, what: String) -> SettingsError {
        SettingsError::Line { place: self.place(&span), what }
    }

    /// Read a table of a subcommand, or `[global]`.
    fn top(
        &mut self,
        root: &Command,
        name: &Key<'_>,
        value: &Value<'_>,
    ) -> Result<(), SettingsError> {
        let word = name.get_ref().as_ref();
        let DeValue::Table(table) = value.get_ref() else {
            let is_table = word == GLOBAL || subcommand_of(root, word).is_some();
            let what = if is_table {
                format!(
                    "`{word}` must be one table, written [{word}], not {}",
                    kind(value.get_ref())
                )
            } else {
                format!(
                    "`{word}` is in no table; put it into the table of its command, such as \
                     [fit-actuator], or into [{GLOBAL}]"
                )
            };
            return Err(self.wrong(name.span(), what));
        };
        if word == GLOBAL {
            return self.table(root, &[], table);
        }
        let Some(command) = subcommand_of(root, word) else {
            let names = subcommands(root).chain([GLOBAL]);
            let what = format!("no command is called `{word}`{}", did_you_mean(word, names));
            return Err(self.wrong(name.span(), what));
        };
        self.table(command, &[word], table)
    }

    fn table(
        &mut self,
        command: &Command,
        names: &[&str],
        table: &DeTable<'_>,
    ) -> Result<(), SettingsError> {
        for (key, value) in in_order(table) {
            let word = key.get_ref().as_ref();
            let below = (!names.is_empty()).then(|| subcommand_of(command, word)).flatten();
            if let (Some(below), DeValue::Table(table)) = (below, value.get_ref()) {
                self.table(below, &[names, &[word]].concat(), table)?;
                continue;
            }
            self.setting(command, names, (key, value))?;
        }
        Ok(())
    }

    fn setting(
        &mut self,
        command: &Command,
        names: &[&str],
        (key, value): (&Key<'_>, &Value<'_>),
    ) -> Result<(), SettingsError> {
        let word = key.get_ref().as_ref();
        let header = if names.is_empty() { GLOBAL.to_owned() } else { names.join(".") };
        let Some(arg) = options(command).find(|arg| is_called(arg, word)) else {
            let known = options(command).filter_map(Arg::get_long);
            let what = format!("[{header}] has no option `{word}`{}", did_you_mean(word, known));
            return Err(self.wrong(key.span(), what));
        };
        let arguments = arguments(arg, value.get_ref())
            .and_then(|arguments| accepted(command, &arguments).map(|()| arguments))
            .map_err(|what| self.wrong(value.span(), format!("[{header}] {word}: {what}")))?;
        let table: Vec<String> = names.iter().map(|name| (*name).to_owned()).collect();
        let id = arg.get_id().to_string();
        if let Some(first) = self.settings.iter().find(|own| own.table == table && own.id == id) {
            let what =
                format!("[{header}] {word}: {} is another name of it ({})", first.key, first.place);
            return Err(self.wrong(key.span(), what));
        }
        self.settings.push(Setting {
            table,
            id,
            key: word.to_owned(),
            place: self.place(&key.span()),
            arguments,
        });
        Ok(())
    }
}

/// Return whether `name` is the long name of an option, or an old one.
fn is_called(arg: &Arg, name: &str) -> bool {
    arg.get_long() == Some(name)
        || arg.get_all_aliases().is_some_and(|aliases| aliases.contains(&name))
}

/// Entries in the order of the file.
fn in_order<'a, 'i>(table: &'a DeTable<'i>) -> Vec<(&'a Key<'i>, &'a Value<'i>)> {
    let mut entries: Vec<_> = table.iter().collect();
    entries.sort_by_key(|(key, _)| key.span().start);
    entries
}

fn subcommand_of<'a>(command: &'a Command, name: &str) -> Option<&'a Command> {
    command.get_subcommands().find(|below| below.get_name() == name && name != "help")
}

fn subcommands(command: &Command) -> impl Iterator<Item = &str> {
    command.get_subcommands().map(Command::get_name).filter(|name| *name != "help")
}

/// Options that a file may hold.
fn options(command: &Command) -> impl Iterator<Item = &Arg> {
    command
        .get_arguments()
        .filter(|arg| arg.get_long().is_some() && !TYPED_ONLY.contains(&arg.get_id().as_str()))
}

fn did_you_mean<'a>(word: &str, names: impl Iterator<Item = &'a str>) -> String {
    nearest(word, names).map_or_else(String::new, |name| format!("; did you mean `{name}`?"))
}

/// Words on the command line for `value`.
///
/// # Errors
/// The type that the option takes.
fn arguments(arg: &Arg, value: &DeValue<'_>) -> Result<Vec<String>, String> {
    let option = format!("--{}", arg.get_long().unwrap_or_default());
    let counts = arg.get_num_args().unwrap_or(1.into());
    match (arg.get_action(), value) {
        (ArgAction::SetTrue, DeValue::Boolean(on)) => Ok(repeated(&option, usize::from(*on))),
        (ArgAction::SetTrue, other) => Err(format!("must be true or false, not {}", kind(other))),
        (ArgAction::Count, DeValue::Integer(count)) => match count.as_str().parse::<u8>() {
            Ok(count) => Ok(repeated(&option, count.into())),
            Err(_) => Err("must be a whole number from 0 to 255".to_owned()),
        },
        (ArgAction::Count, other) => Err(format!("must be a whole number, not {}", kind(other))),
        // An option whose value is optional.
        (_, DeValue::Boolean(on)) if counts.min_values() == 0 => {
            Ok(repeated(&option, usize::from(*on)))
        }
        (ArgAction::Append, DeValue::Array(list)) => {
            let texts = list.iter().map(|one| text(arg, one.get_ref()));
            let texts: Vec<String> = texts.collect::<Result<_, _>>()?;
            if 1 < counts.max_values() {
                return Ok(std::iter::once(option).chain(texts).collect());
            }
            Ok(texts.iter().map(|text| format!("{option}={text}")).collect())
        }
        (_, one) if counts.min_values() <= 1 => Ok(vec![format!("{option}={}", text(arg, one)?)]),
        (_, other) => {
            Err(format!("must be a list of {} values, not {}", counts.min_values(), kind(other)))
        }
    }
}

fn repeated(option: &str, count: usize) -> Vec<String> {
    vec![option.to_owned(); count]
}

/// One value as typed text.
fn text(arg: &Arg, value: &DeValue<'_>) -> Result<String, String> {
    let taken = arg.get_value_parser().type_id();
    let is_any = |types: &[TypeId]| types.iter().any(|one| taken == *one);
    let number = is_any(&[
        TypeId::of::<f64>(),
        TypeId::of::<u32>(),
        TypeId::of::<u64>(),
        TypeId::of::<usize>(),
        TypeId::of::<NonZeroUsize>(),
    ]);
    let words = is_any(&[TypeId::of::<String>(), TypeId::of::<PathBuf>()]);
    match value {
        DeValue::String(text) if !number => Ok(text.to_string()),
        DeValue::Integer(value) if !words => Ok(value.to_string()),
        DeValue::Float(value) if !words => Ok(value.to_string()),
        other if number => Err(format!("must be a number, not {}", kind(other))),
        other if words => Err(format!("must be a text in quotes, not {}", kind(other))),
        other => Err(format!("must be a text in quotes or a number, not {}", kind(other))),
    }
}

fn kind(value: &DeValue<'_>) -> &'static str {
    match value {
        DeValue::String(_) => "a text",
        DeValue::Integer(_) | DeValue::Float(_) => "a number",
        DeValue::Boolean(_) => "true or false",
        DeValue::Datetime(_) => "a date",
        DeValue::Array(_) => "a list",
        DeValue::Table(_) => "a table",
    }
}

/// Let the command check the values; missing options are no error here.
fn accepted(command: &Command, arguments: &[String]) -> Result<(), String> {
    let line = std::iter::once(command.get_name()).chain(arguments.iter().map(String::as_str));
    let Err(error) = command.clone().try_get_matches_from(line) else { return Ok(()) };
    match error.kind() {
        ErrorKind::InvalidValue
        | ErrorKind::ValueValidation
        | ErrorKind::TooManyValues
        | ErrorKind::TooFewValues
        | ErrorKind::WrongNumberOfValues => Err(sentence(&error)),
        _ => Ok(()),
    }
}

/// Message of clap about a value, in one line.
fn sentence(error: &clap::Error) -> String {
    let said = error.render().to_string();
    let lines = said.lines().map(str::trim).take_while(|line| {
        !line.starts_with("Usage:") && !line.starts_with("For more information")
    });
    let line = lines.filter(|line| !line.is_empty()).collect::<Vec<_>>().join("; ");
    line.trim_start_matches("error: ").to_owned()
}
