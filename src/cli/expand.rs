//! Complete command line: typed words and the settings of `klasktron.toml`.
//!
//! Settings are appended to the typed words, so that a command treats both alike, for example when it records its
//! arguments in a result. A setting is dropped where the option was typed, where it conflicts with a typed option,
//! or where the environment sets it. `--flag=false` cancels a flag of the file.

use super::settings_file::{self, Setting, SettingsError, USUAL_NAME};
use clap::{ArgAction, ArgMatches, Command, parser::ValueSource};
use std::{
    collections::BTreeSet,
    ffi::OsString,
    path::{Path, PathBuf},
};

/// Complete command line and the sources of its options.
#[derive(Debug, Default)]
pub(crate) struct Expanded {
    /// All words, the program's name first.
    pub(crate) arguments: Vec<OsString>,
    /// Settings that the file has added.
    pub(crate) settings: Vec<Setting>,
    /// Options that environment variables have set, as text.
    pub(crate) environment: Vec<String>,
}

/// Complete the `typed` words with the settings file.
///
/// # Errors
/// The settings file cannot be read or holds a setting that no command takes.
pub(crate) fn expand(command: &Command, typed: Vec<OsString>) -> Result<Expanded, SettingsError> {
    // Leniency reaches every subcommand only before the command line is built.
    let lenient = command.clone().ignore_errors(true);
    let mut command = command.clone();
    command.build();
    let (arguments, cancelled) = without_denials(&command, typed);
    let without_file =
        |arguments, environment| Ok(Expanded { arguments, environment, settings: Vec::new() });
    // Help and version are answered by the real parse, which also reports usage errors.
    let Ok(matches) = lenient.try_get_matches_from(&arguments) else {
        return without_file(arguments, Vec::new());
    };
    let Some(deepest) = Deepest::of(&command, &matches) else {
        return without_file(arguments, Vec::new());
    };
    let environment = deepest.environment();
    let Some(path) = file_of(&matches) else { return without_file(arguments, environment) };
    let settings = settings_file::read(&path, &command)?;
    let settings: Vec<Setting> = deepest
        .own(settings)
        .into_iter()
        .filter(|one| !cancelled.contains(&one.key) && !deepest.is_decided(&one.id))
        .collect();
    deepest.check_together(&settings)?;
    Ok(Expanded { arguments: joined(arguments, &settings), settings, environment })
}

/// Path of the settings file, if one is used.
fn file_of(matches: &ArgMatches) -> Option<PathBuf> {
    if matches.get_flag("no_config") {
        return None;
    }
    let named = matches.get_one::<PathBuf>("config").cloned();
    named.or_else(|| Path::new(USUAL_NAME).exists().then(|| USUAL_NAME.into()))
}

/// Innermost subcommand that was typed.
struct Deepest<'a> {
    names: Vec<String>,
    command: &'a Command,
    matches: &'a ArgMatches,
}

impl<'a> Deepest<'a> {
    fn of(root: &'a Command, matches: &'a ArgMatches) -> Option<Self> {
        let mut found = Self { names: Vec::new(), command: root, matches };
        while let Some((name, below)) = found.matches.subcommand() {
            found.command = found.command.find_subcommand(name)?;
            found.matches = below;
            found.names.push(name.to_owned());
        }
        (!found.names.is_empty()).then_some(found)
    }

    /// Settings of this command; its own table takes precedence over `[global]`.
    fn own(&self, settings: Vec<Setting>) -> Vec<Setting> {
        let (own, rest): (Vec<_>, Vec<_>) =
            settings.into_iter().partition(|one| one.table == self.names);
        let keys: BTreeSet<String> = own.iter().map(|one| one.key.clone()).collect();
        let global =
            rest.into_iter().filter(|one| one.table.is_empty() && !keys.contains(&one.key));
        global.chain(own).collect()
    }

    fn is_typed(&self, id: &str) -> bool {
        self.matches.value_source(id) == Some(ValueSource::CommandLine)
    }

    fn is_from_environment(&self, id: &str) -> bool {
        self.matches.value_source(id) == Some(ValueSource::EnvVariable)
    }

    /// Options that environment variables set, with variable and value.
    fn environment(&self) -> Vec<String> {
        let arguments = self.command.get_arguments();
        let set = arguments.filter(|arg| self.is_from_environment(arg.get_id().as_str()));
        set.filter_map(|arg| {
            let variable = arg.get_env()?.to_str()?;
            let value = std::env::var(variable).unwrap_or_default();
            Some(format!("--{}={value} ({variable})", arg.get_long()?))
        })
        .collect()
    }

    /// Return whether the command line or the environment decides this option, or the command line holds one that
    /// conflicts with it.
    fn is_decided(&self, id: &str) -> bool {
        let ids = self.command.get_arguments().map(|arg| arg.get_id().as_str());
        self.is_typed(id)
            || self.is_from_environment(id)
            || ids.filter(|other| self.is_typed(other)).any(|other| self.conflict(id, other))
    }

    /// Return whether two options exclude each other.
    fn conflict(&self, one: &str, other: &str) -> bool {
        let excludes = |one: &str, other: &str| {
            let arg = self.command.get_arguments().find(|arg| arg.get_id() == one);
            arg.is_some_and(|arg| {
                let excluded = self.command.get_arg_conflicts_with(arg);
                excluded.iter().any(|arg| arg.get_id() == other)
            })
        };
        excludes(one, other) || excludes(other, one)
    }

    /// Report two settings of the file that exclude each other.
    fn check_together(&self, settings: &[Setting]) -> Result<(), SettingsError> {
        let set: Vec<&Setting> = settings.iter().filter(|one| !one.arguments.is_empty()).collect();
        for (index, later) in set.iter().enumerate() {
            let earlier = set[..index].iter().find(|one| self.conflict(&one.id, &later.id));
            if let Some(earlier) = earlier {
                let what = format!(
                    "{} cannot be used with {} ({})",
                    later.key, earlier.key, earlier.place
                );
                return Err(SettingsError::Line { place: later.place.clone(), what });
            }
        }
        Ok(())
    }
}

/// Remove `--flag=false`, replace `--flag=true` by `--flag`, and return the words with the cancelled flags.
fn without_denials(command: &Command, typed: Vec<OsString>) -> (Vec<OsString>, BTreeSet<String>) {
    let flags = flags_of_typed(command, &typed);
    let mut cancelled = BTreeSet::new();
    let mut open = true;
    let mut kept = Vec::new();
    for word in typed {
        open &= word != "--";
        let said = word.to_str().and_then(|word| word.strip_prefix("--")?.split_once('='));
        match said.filter(|(flag, _)| open && flags.contains(*flag)) {
            Some((flag, "false")) => {
                cancelled.insert(flag.to_owned());
            }
            Some((flag, "true")) => kept.push(format!("--{flag}").into()),
            _ => kept.push(word),
        }
    }
    (kept, cancelled)
}

/// Long names of all flags of the typed commands, counted flags included.
fn flags_of_typed(command: &Command, typed: &[OsString]) -> BTreeSet<String> {
    let is_flag = |action: &ArgAction| matches!(action, ArgAction::SetTrue | ArgAction::Count);
    let mut named = vec![command];
    for word in typed.iter().skip(1).filter_map(|word| word.to_str()) {
        named.extend(named[named.len() - 1].find_subcommand(word));
    }
    let all = named.into_iter().flat_map(Command::get_arguments);
    let flags = all.filter(|arg| is_flag(arg.get_action()));
    flags.filter_map(|arg| arg.get_long().map(ToOwned::to_owned)).collect()
}

/// Append the settings to the typed words, before a `--`.
fn joined(mut arguments: Vec<OsString>, settings: &[Setting]) -> Vec<OsString> {
    let end = arguments.iter().position(|word| word == "--").unwrap_or(arguments.len());
    let behind = arguments.split_off(end);
    arguments.extend(settings.iter().flat_map(|one| &one.arguments).map(OsString::from));
    arguments.extend(behind);
    arguments
}
