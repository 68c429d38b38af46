//! The sweep file: TOML to settings, with the line of every fault.
//!
//! ```toml
//! command = "fit-actuator"                 # or tune-ekf, gap, train, eval
//! inputs = ["train.mcap", "check.mcap"]    # from the folder of this file
//! seeds = 3                                # 0, 1, 2; or [4, 7]
//! metric = "one_step_rmse_m_per_s.median"  # a path into the result [default: by command]
//! better = "smaller"
//!
//! [options]                                # the same for every point
//! epochs = 300
//!
//! [grid]                                   # every combination, from the simplest to the largest
//! history = [1, 5, 10]
//! width = [32, 64]
//!
//! [[points]]                               # further points
//! history = 20
//!
//! [slurm]                                  # what the command line may say as well
//! partition = "main"
//! time = "1:00:00"
//! cores = 2
//! mem = "4G"
//! lines = ["--gres=gpu:1", "module load klasktron"]
//! ```

use super::{Better, SlurmRequest, SweepError, SweptCommand, command::nearest, error::FileFault};
use std::{
    fs,
    ops::Range,
    path::{Path, PathBuf},
};
use toml::{
    Spanned,
    de::{DeArray, DeTable, DeValue},
};

/// Value of an option in the file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Setting {
    /// `true` or `false`.
    Flag(bool),
    /// A number or text.
    One(String),
    /// A list of these.
    Many(Vec<String>),
}

/// A value with its line in the file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Located<T> {
    /// Line, from 1.
    pub line: usize,
    /// The value.
    pub value: T,
}

/// An option of a table.
pub type NamedSetting = (String, Located<Setting>);

/// An axis of the grid: the option and its values.
pub type NamedAxis = (String, Vec<Located<Setting>>);

/// A parsed sweep file, before its options are checked against the command.
#[derive(Debug, Clone, PartialEq)]
pub struct SweepFile {
    /// Path of the file.
    pub path: PathBuf,
    /// The command.
    pub command: SweptCommand,
    /// Recordings or matches, as in the file.
    pub inputs: Vec<Located<String>>,
    /// Seeds; `None` for the command's own default.
    pub seeds: Option<Vec<u64>>,
    /// Path of the metric in the result.
    pub metric: Option<String>,
    /// Direction of the metric.
    pub better: Option<Better>,
    /// Options of every point.
    pub options: Vec<NamedSetting>,
    /// Axes of the grid, in the order of the file.
    pub grid: Vec<NamedAxis>,
    /// Further points.
    pub points: Vec<Vec<NamedSetting>>,
    /// Resources for Slurm.
    pub slurm: SlurmRequest,
}

const KEYS: [&str; 9] =
    ["command", "inputs", "seeds", "metric", "better", "options", "grid", "points", "slurm"];
const SLURM_KEYS: [&str; 5] = ["partition", "time", "cores", "mem", "lines"];
/// Maximum number of seeds; more are taken for a mistake.
const MOST_SEEDS: i128 = 100_000;

/// Read the sweep file at `path`.
///
/// # Errors
/// When it cannot be read, is not TOML, or has an unknown key or invalid value.
pub fn read_file(path: &Path) -> Result<SweepFile, SweepError> {
    let text = fs::read_to_string(path).map_err(SweepError::io(path, "read"))?;
    parse(path, &text)
}

/// Parse the text of a sweep file; `path` is used in messages.
///
/// # Errors
/// As [`read_file`], except for reading.
pub fn parse(path: &Path, text: &str) -> Result<SweepFile, SweepError> {
    Reader { path, text }.file()
}

type Entry<'a, 'i> = (&'a str, Range<usize>, &'a Spanned<DeValue<'i>>);

struct Reader<'a> {
    path: &'a Path,
    text: &'a str,
}

/// Entries of `table` in the order of the file.
fn entries<'a, 'i>(table: &'a DeTable<'i>) -> Vec<Entry<'a, 'i>> {
    let mut entries: Vec<Entry<'a, 'i>> =
        table.iter().map(|(key, value)| (key.get_ref().as_ref(), key.span(), value)).collect();
    entries.sort_by_key(|(_, span, _)| span.start);
    entries
}

fn kind(value: &DeValue<'_>) -> String {
    match value {
        DeValue::String(text) => format!("the text \"{text}\""),
        DeValue::Integer(number) => format!("the number {number}"),
        DeValue::Float(number) => format!("the number {number}"),
        DeValue::Boolean(value) => value.to_string(),
        DeValue::Datetime(date) => format!("the date {date}"),
        DeValue::Array(_) => "a list".to_owned(),
        DeValue::Table(_) => "a table".to_owned(),
    }
}

fn integer(value: &DeValue<'_>) -> Option<i128> {
    let DeValue::Integer(number) = value else { return None };
    i128::from_str_radix(number.as_str(), number.radix()).ok()
}

/// A number or text as one word: 20e6 becomes 20000000.
fn word(value: &DeValue<'_>) -> Option<String> {
    match value {
        DeValue::String(text) => Some(text.clone().into_owned()),
        DeValue::Integer(_) => integer(value).map(|number| number.to_string()),
        DeValue::Float(number) => {
            number.as_str().parse::<f64>().ok().map(|number| number.to_string())
        }
        _ => None,
    }
}

impl Reader<'_> {
    fn line(&self, span: &Range<usize>) -> usize {
        let before = &self.text.as_bytes()[..span.start.min(self.text.len())];
        before.iter().filter(|byte| **byte == b'\n').count() + 1
    }

    fn fault(&self, span: &Range<usize>, fault: FileFault) -> SweepError {
        let (path, line) = (self.path.to_owned(), self.line(span));
        SweepError::File { path, line, fault: Box::new(fault) }
    }

    fn wrong(&self, key: &str, value: &Spanned<DeValue<'_>>, expected: &str) -> SweepError {
        let found = kind(value.get_ref());
        let (key, expected) = (key.to_owned(), expected.to_owned());
        self.fault(&value.span(), FileFault::WrongKind { key, found, expected })
    }

    fn unknown(&self, entry: &Entry<'_, '_>, place: &'static str, known: &[&str]) -> SweepError {
        let (key, span, _) = entry;
        let nearest = nearest(key, known.iter().copied()).map(str::to_owned);
        let (key, known) = ((*key).to_owned(), known.join(", "));
        self.fault(span, FileFault::UnknownKey { key, place, nearest, known })
    }

    fn file(&self) -> Result<SweepFile, SweepError> {
        let table = DeTable::parse(self.text).map_err(|error| {
            let span = error.span().unwrap_or(0..0);
            self.fault(&span, FileFault::Syntax(error.message().to_owned()))
        })?;
        let entries = entries(table.get_ref());
        let named = |name: &str| {
            entries.iter().find(|(key, _, _)| *key == name).map(|(_, _, value)| *value)
        };
        if let Some(entry) = entries.iter().find(|(key, _, _)| !KEYS.contains(key)) {
            return Err(self.unknown(entry, "the sweep", &KEYS));
        }
        let example = "write command = \"train\" at the top";
        let command = named("command")
            .ok_or_else(|| self.fault(&(0..0), FileFault::Missing { key: "command", example }))?;
        let tables = |name: &str| named(name).map(|value| self.table(name, value)).transpose();
        let text = |name: &str| named(name).map(|value| self.text(name, value)).transpose();
        let better = named("better").map(|value| self.better(value)).transpose()?;
        Ok(SweepFile {
            path: self.path.to_owned(),
            command: self.command(command)?,
            inputs: named("inputs").map_or_else(|| Ok(Vec::new()), |value| self.inputs(value))?,
            seeds: named("seeds").map(|value| self.seeds(value)).transpose()?,
            metric: text("metric")?,
            better,
            options: tables("options")?.map_or_else(|| Ok(Vec::new()), |t| self.settings(t))?,
            grid: tables("grid")?.map_or_else(|| Ok(Vec::new()), |table| self.grid(table))?,
            points: named("points").map_or_else(|| Ok(Vec::new()), |value| self.points(value))?,
            slurm: tables("slurm")?
                .map_or_else(|| Ok(SlurmRequest::default()), |t| self.slurm(t))?,
        })
    }

    fn text(&self, key: &str, value: &Spanned<DeValue<'_>>) -> Result<String, SweepError> {
        match value.get_ref() {
            DeValue::String(text) if !text.contains(['\n', '\r', '\0']) => {
                Ok(text.clone().into_owned())
            }
            _ => Err(self.wrong(key, value, "it must be text in one line")),
        }
    }

    fn table<'a, 'i>(
        &self,
        key: &str,
        value: &'a Spanned<DeValue<'i>>,
    ) -> Result<&'a DeTable<'i>, SweepError> {
        match value.get_ref() {
            DeValue::Table(table) => Ok(table),
            _ => Err(self.wrong(key, value, &format!("write a table: [{key}]"))),
        }
    }

    fn list<'a, 'i>(
        &self,
        key: &str,
        value: &'a Spanned<DeValue<'i>>,
        expected: &str,
    ) -> Result<&'a DeArray<'i>, SweepError> {
        match value.get_ref() {
            DeValue::Array(list) if !list.is_empty() => Ok(list),
            DeValue::Array(_) => {
                let (key, expected) = (key.to_owned(), expected.to_owned());
                let found = "an empty list".to_owned();
                Err(self.fault(&value.span(), FileFault::WrongKind { key, found, expected }))
            }
            _ => Err(self.wrong(key, value, expected)),
        }
    }

    fn command(&self, value: &Spanned<DeValue<'_>>) -> Result<SweptCommand, SweepError> {
        let name = self.text("command", value)?;
        let names = || SweptCommand::ALL.into_iter().map(SweptCommand::name);
        SweptCommand::named(&name).ok_or_else(|| {
            let nearest = nearest(&name, names()).map(str::to_owned);
            let known = names().collect::<Vec<_>>().join(", ");
            self.fault(&value.span(), FileFault::UnknownCommand { name, nearest, known })
        })
    }

    fn better(&self, value: &Spanned<DeValue<'_>>) -> Result<Better, SweepError> {
        let text = self.text("better", value)?;
        text.parse().map_err(|_name: String| {
            self.wrong("better", value, "it must be \"smaller\" or \"larger\"")
        })
    }

    fn inputs(&self, value: &Spanned<DeValue<'_>>) -> Result<Vec<Located<String>>, SweepError> {
        let expected = "it must be a list of paths: inputs = [\"monday.mcap\"]";
        let one = |value: &Spanned<DeValue<'_>>| {
            let text = self.text("inputs", value)?;
            if text.is_empty() || text.starts_with('-') {
                return Err(self.wrong("inputs", value, "it must be a path"));
            }
            Ok(Located { line: self.line(&value.span()), value: text })
        };
        self.list("inputs", value, expected)?.iter().map(one).collect()
    }

    fn seeds(&self, value: &Spanned<DeValue<'_>>) -> Result<Vec<u64>, SweepError> {
        let expected = "it must be a number of seeds, or a list of different seeds, none negative";
        let wrong = |value| self.wrong("seeds", value, expected);
        if let Some(count) = integer(value.get_ref()) {
            let fits = (1..=MOST_SEEDS).contains(&count);
            return if fits { Ok((0..count as u64).collect()) } else { Err(wrong(value)) };
        }
        let mut seeds = Vec::new();
        for value in self.list("seeds", value, expected)? {
            let seed = integer(value.get_ref()).and_then(|seed| u64::try_from(seed).ok());
            let seed = seed.filter(|seed| !seeds.contains(seed)).ok_or_else(|| wrong(value))?;
            seeds.push(seed);
        }
        Ok(seeds)
    }

    fn setting(
        &self,
        key: &str,
        value: &Spanned<DeValue<'_>>,
    ) -> Result<Located<Setting>, SweepError> {
        let expected = "it must be a number, text, true or false, or a list of these";
        let wrong = || self.wrong(key, value, expected);
        let plain = |value: &DeValue<'_>| {
            word(value).filter(|word| !word.contains(['\n', '\r', '\0'])).ok_or_else(wrong)
        };
        let setting = match value.get_ref() {
            DeValue::Boolean(flag) => Setting::Flag(*flag),
            DeValue::Array(list) if !list.is_empty() => {
                let words: Result<_, _> = list.iter().map(|one| plain(one.get_ref())).collect();
                Setting::Many(words?)
            }
            other => Setting::One(plain(other)?),
        };
        Ok(Located { line: self.line(&value.span()), value: setting })
    }

    fn settings(&self, table: &DeTable<'_>) -> Result<Vec<NamedSetting>, SweepError> {
        let one = |(key, _, value): Entry<'_, '_>| Ok((key.to_owned(), self.setting(key, value)?));
        entries(table).into_iter().map(one).collect()
    }

    fn grid(&self, table: &DeTable<'_>) -> Result<Vec<NamedAxis>, SweepError> {
        let mut axes = Vec::new();
        for (key, _, value) in entries(table) {
            let expected = format!("every axis of [grid] is a list: {key} = [1, 2]");
            let mut axis: Vec<Located<Setting>> = Vec::new();
            for one in self.list(key, value, &expected)? {
                let setting = self.setting(key, one)?;
                if axis.iter().any(|other| other.value == setting.value) {
                    return Err(self.wrong(key, one, "and stands twice in the list"));
                }
                axis.push(setting);
            }
            axes.push((key.to_owned(), axis));
        }
        Ok(axes)
    }

    fn points(&self, value: &Spanned<DeValue<'_>>) -> Result<Vec<Vec<NamedSetting>>, SweepError> {
        let list = self.list("points", value, "write every point as a table: [[points]]")?;
        list.iter().map(|one| self.settings(self.table("points", one)?)).collect()
    }

    fn slurm(&self, table: &DeTable<'_>) -> Result<SlurmRequest, SweepError> {
        let mut request = SlurmRequest::default();
        for entry in entries(table) {
            let (key, _, value) = entry;
            match key {
                "partition" => request.partition = Some(self.text(key, value)?),
                "time" => request.time = Some(self.word_of(key, value)?),
                "mem" => request.mem = Some(self.word_of(key, value)?),
                "cores" => {
                    let cores = integer(value.get_ref()).and_then(|n| usize::try_from(n).ok());
                    let cores = cores.filter(|cores| 0 < *cores);
                    let wrong = || self.wrong(key, value, "it must be a number above 0");
                    request.cores = Some(cores.ok_or_else(wrong)?);
                }
                "lines" => {
                    let list = self.list(key, value, "it must be a list of lines")?;
                    let lines: Result<_, _> = list.iter().map(|one| self.text(key, one)).collect();
                    request.lines = lines?;
                }
                _ => return Err(self.unknown(&entry, "[slurm]", &SLURM_KEYS)),
            }
        }
        Ok(request)
    }

    fn word_of(&self, key: &str, value: &Spanned<DeValue<'_>>) -> Result<String, SweepError> {
        word(value.get_ref())
            .filter(|word| !word.contains(['\n', '\r', '\0']))
            .ok_or_else(|| self.wrong(key, value, "it must be text, as sbatch takes it"))
    }
}
