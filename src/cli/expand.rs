//! The command line that results from what was typed and from `klasktron.toml`.
//!
//! Settings are put behind what was typed, as if they were typed too, so that whatever a command does with its
//! arguments, such as recording them in its results, it does with both. An option that was typed, or that
//! contradicts a typed one, is left out; `--flag=false` is how a flag of the file is taken back.

use super::settings_file::{self, Setting, SettingsError, USUAL_NAME};
use clap::{ArgAction, ArgMatches, Command, parser::ValueSource};
use std::{
    collections::BTreeSet,
    ffi::OsString,
    path::{Path, PathBuf},
};

/// What to run.
#[derive(Debug, Default)]
pub(crate) struct Expanded {
    /// The whole command line.
    pub(crate) arguments: Vec<OsString>,
    /// What of it came from the file.
    pub(crate) settings: Vec<Setting>,
}

/// The command line for `typed`.
///
/// # Errors
/// When the settings file cannot be read or holds anything that no command takes.
pub(crate) fn expand(command: &Command, typed: Vec<OsString>) -> Result<Expanded, SettingsError> {
    // Leniency reaches every subcommand only before the command line is built.
    let lenient = command.clone().ignore_errors(true);
    let mut command = command.clone();
    command.build();
    let (arguments, taken_back) = without_denials(&command, typed);
    let as_typed = |arguments| Ok(Expanded { arguments, settings: Vec::new() });
    // Whoever asks for help or the version gets it; other mistakes are found by the real parse.
    let Ok(matches) = lenient.try_get_matches_from(&arguments) else { return as_typed(arguments) };
    let (Some(path), Some(deepest)) = (file_of(&matches), Deepest::of(&command, &matches)) else {
        return as_typed(arguments);
    };
    let settings = settings_file::read(&path, &command)?;
    let settings: Vec<Setting> = deepest
        .own(settings)
        .into_iter()
        .filter(|one| !taken_back.contains(&one.key) && !deepest.is_decided(&one.id))
        .collect();
    deepest.check_together(&settings)?;
    Ok(Expanded { arguments: joined(arguments, &settings), settings })
}

/// The file whose settings count.
fn file_of(matches: &ArgMatches) -> Option<PathBuf> {
    if matches.get_flag("no_config") {
        return None;
    }
    let named = matches.get_one::<PathBuf>("config").cloned();
    named.or_else(|| Path::new(USUAL_NAME).exists().then(|| USUAL_NAME.into()))
}

/// The subcommand that was typed.
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

    /// Settings of this command; those of its own table stand for those of `[global]`.
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

    /// Whether this option or one that contradicts it was typed.
    fn is_decided(&self, id: &str) -> bool {
        let ids = self.command.get_arguments().map(|arg| arg.get_id().as_str());
        self.is_typed(id)
            || ids.filter(|other| self.is_typed(other)).any(|other| self.contradict(id, other))
    }

    /// Whether two options cannot stand together.
    fn contradict(&self, one: &str, other: &str) -> bool {
        let excludes = |one: &str, other: &str| {
            let arg = self.command.get_arguments().find(|arg| arg.get_id() == one);
            arg.is_some_and(|arg| {
                let excluded = self.command.get_arg_conflicts_with(arg);
                excluded.iter().any(|arg| arg.get_id() == other)
            })
        };
        excludes(one, other) || excludes(other, one)
    }

    /// Two settings that contradict each other are the file's mistake.
    fn check_together(&self, settings: &[Setting]) -> Result<(), SettingsError> {
        let set: Vec<&Setting> = settings.iter().filter(|one| !one.arguments.is_empty()).collect();
        for (index, later) in set.iter().enumerate() {
            let earlier = set[..index].iter().find(|one| self.contradict(&one.id, &later.id));
            if let Some(earlier) = earlier {
                let what = format!(
                    "{} cannot stand beside {} ({})",
                    later.key, earlier.key, earlier.place
                );
                return Err(SettingsError::Line { place: later.place.clone(), what });
            }
        }
        Ok(())
    }
}

/// The arguments without `--flag=false` (and with `--flag` for `--flag=true`), and the flags that were taken
/// back so.
fn without_denials(command: &Command, typed: Vec<OsString>) -> (Vec<OsString>, BTreeSet<String>) {
    let flags = flags_of_typed(command, &typed);
    let mut taken_back = BTreeSet::new();
    let mut open = true;
    let mut kept = Vec::new();
    for word in typed {
        open &= word != "--";
        let said = word.to_str().and_then(|word| word.strip_prefix("--")?.split_once('='));
        match said.filter(|(flag, _)| open && flags.contains(*flag)) {
            Some((flag, "false")) => {
                taken_back.insert(flag.to_owned());
            }
            Some((flag, "true")) => kept.push(format!("--{flag}").into()),
            _ => kept.push(word),
        }
    }
    (kept, taken_back)
}

/// Long names of all flags, counted ones included, of the commands that were typed.
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

/// The settings behind what was typed, but before what follows a `--`.
fn joined(mut arguments: Vec<OsString>, settings: &[Setting]) -> Vec<OsString> {
    let end = arguments.iter().position(|word| word == "--").unwrap_or(arguments.len());
    let behind = arguments.split_off(end);
    arguments.extend(settings.iter().flat_map(|one| &one.arguments).map(OsString::from));
    arguments.extend(behind);
    arguments
}
