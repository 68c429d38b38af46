//! Expansion of a sweep file into points: grid and listed points, for every seed.

use super::{
    Better, Metric, OptionKind, OptionSpec, Point, SlurmRequest, SweepError, SweepFile,
    SweptCommand,
    command::nearest,
    error::FileFault,
    file::{Located, NamedSetting, Setting},
    point::InputHashes,
};
use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::{Path, PathBuf},
};

/// Maximum number of points; more are taken for a mistake.
pub const MOST_POINTS: usize = 100_000;

/// An axis of the grid.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct GridAxis {
    /// Name of the option.
    pub name: String,
    /// Values in the order of the file.
    pub values: Vec<String>,
}

/// Plan of a sweep: points and metric.
#[derive(Debug, Clone)]
pub struct Plan {
    /// The command of every point.
    pub command: SweptCommand,
    /// Folder in which the points are run: that of the sweep file.
    pub working_folder: PathBuf,
    /// Axes of the grid.
    pub axes: Vec<GridAxis>,
    /// Every point once.
    pub points: Vec<Point>,
    /// Metric of the comparison.
    pub metric: Metric,
    /// Resources for Slurm.
    pub slurm: SlurmRequest,
}

/// Options of a command, and a check of its arguments.
pub struct CommandLine<'a> {
    /// All options.
    pub options: &'a [OptionSpec],
    /// Check of a command line; the error is a sentence.
    pub check: &'a dyn Fn(&[String]) -> Result<(), String>,
}

/// Options of one point before its seed.
type Options = BTreeMap<String, Located<Setting>>;

impl Plan {
    /// Expand `file`, with the options and checks of the command line.
    ///
    /// # Errors
    /// When the command does not have an option or rejects a value, or an input cannot be read.
    pub fn new(file: &SweepFile, line: &CommandLine<'_>) -> Result<Self, SweepError> {
        let parent = file.path.parent().filter(|parent| !parent.as_os_str().is_empty());
        let folder = parent.unwrap_or(Path::new("."));
        let working_folder = fs::canonicalize(folder).map_err(SweepError::io(folder, "find"))?;
        let planner = Planner { file, line, folder: &working_folder };
        planner.check_options()?;
        let combinations = planner.combinations()?;
        planner.check_values(&combinations)?;
        let points = planner.points(&combinations)?;
        let axes = file.grid.iter().map(|(name, values)| GridAxis {
            name: name.clone(),
            values: values.iter().map(|value| planner.shown(name, &value.value)).collect(),
        });
        let metric = match &file.metric {
            // A metric given by the user is an error (smaller is better) unless stated otherwise.
            Some(path) => Metric {
                path: path.clone(),
                title: path.clone(),
                better: file.better.unwrap_or(Better::Smaller),
            },
            None => {
                let own = file.command.metric();
                Metric { better: file.better.unwrap_or(own.better), ..own }
            }
        };
        Ok(Self {
            command: file.command,
            axes: axes.collect(),
            points,
            metric,
            slurm: file.slurm.clone(),
            working_folder: working_folder.clone(),
        })
    }
}

struct Planner<'a> {
    file: &'a SweepFile,
    line: &'a CommandLine<'a>,
    folder: &'a Path,
}

impl Planner<'_> {
    fn fault(&self, line: usize, fault: FileFault) -> SweepError {
        SweepError::File { path: self.file.path.clone(), line, fault: Box::new(fault) }
    }

    fn spec(&self, option: &str) -> Option<&OptionSpec> {
        self.line.options.iter().find(|spec| spec.name == option)
    }

    fn check_options(&self) -> Result<(), SweepError> {
        let file = self.file;
        if file.seeds.is_some() && !file.command.has_seed() {
            return Err(self.fault(1, FileFault::NoSeeds { command: file.command.name() }));
        }
        let axes =
            file.grid.iter().flat_map(|(name, axis)| axis.iter().map(move |one| (name, one)));
        let listed = file.points.iter().flatten().map(|(name, one)| (name, one));
        let fixed = file.options.iter().map(|(name, one)| (name, one));
        for (name, setting) in fixed.chain(axes).chain(listed) {
            self.check_option(name, setting)?;
        }
        for (name, axis) in &file.grid {
            if file.options.iter().any(|(other, _)| other == name) {
                let (option, first, second) = (name.clone(), "[options]", "[grid]");
                return Err(self.fault(axis[0].line, FileFault::Twice { option, first, second }));
            }
        }
        Ok(())
    }

    fn check_option(&self, name: &str, setting: &Located<Setting>) -> Result<(), SweepError> {
        let command = self.file.command;
        if let Some(why) = command.reserved(name) {
            let option = name.to_owned();
            return Err(self.fault(setting.line, FileFault::Reserved { option, why }));
        }
        if name == "seeds" && self.file.seeds.is_some() {
            let (option, first, second) = (name.to_owned(), "the sweep", "its options");
            return Err(self.fault(setting.line, FileFault::Twice { option, first, second }));
        }
        let Some(spec) = self.spec(name) else {
            let names = self.line.options.iter().map(|spec| spec.name.as_str());
            let names = names.filter(|name| command.reserved(name).is_none());
            let nearest = nearest(name, names).map(str::to_owned);
            let option = name.to_owned();
            let fault = FileFault::UnknownOption { command: command.name(), option, nearest };
            return Err(self.fault(setting.line, fault));
        };
        let expected = match (spec.kind, &setting.value) {
            (OptionKind::Flag, Setting::Flag(_))
            | (OptionKind::One, Setting::One(_))
            | (OptionKind::Delimited(_), Setting::One(_) | Setting::Many(_)) => return Ok(()),
            (OptionKind::Words(count), Setting::Many(words)) if words.len() == count => {
                return Ok(());
            }
            (OptionKind::Flag, _) => "it is a flag: true or false".to_owned(),
            (OptionKind::Words(count), _) => format!("it takes a list of {count}"),
            (OptionKind::Delimited(_), _) => "it takes a value or a list".to_owned(),
            (OptionKind::One, _) => "it takes one value".to_owned(),
        };
        let found = match &setting.value {
            Setting::Flag(flag) => flag.to_string(),
            Setting::One(word) => format!("'{word}'"),
            Setting::Many(words) => format!("a list of {}", words.len()),
        };
        let key = name.to_owned();
        Err(self.fault(setting.line, FileFault::WrongKind { key, found, expected }))
    }

    /// Combinations of the grid, the first axis outermost, then all listed points.
    fn combinations(&self) -> Result<Vec<Options>, SweepError> {
        let file = self.file;
        let grid: u128 = file.grid.iter().map(|(_, axis)| axis.len() as u128).product();
        let grid = if file.grid.is_empty() && !file.points.is_empty() { 0 } else { grid };
        let seeds = file.seeds.as_ref().map_or(1, Vec::len) as u128;
        let points = (grid + file.points.len() as u128) * seeds;
        if (MOST_POINTS as u128) < points {
            return Err(self.fault(1, FileFault::TooMany { points, most: MOST_POINTS }));
        }
        let fixed: Options = file.options.iter().cloned().collect();
        let mut all = if grid == 0 { Vec::new() } else { vec![fixed.clone()] };
        for (name, axis) in &file.grid {
            let with = |options: &Options, value: &Located<Setting>| {
                let mut options = options.clone();
                options.insert(name.clone(), value.clone());
                options
            };
            all = all.iter().flat_map(|one| axis.iter().map(|value| with(one, value))).collect();
        }
        let listed = |point: &Vec<NamedSetting>| {
            let mut options = fixed.clone();
            options.extend(point.iter().cloned());
            options
        };
        all.extend(file.points.iter().map(listed));
        Ok(all)
    }

    /// Check each value once with the command line: the first combination of the grid with one
    /// value changed, and every listed point.
    fn check_values(&self, combinations: &[Options]) -> Result<(), SweepError> {
        let listed = combinations.len() - self.file.points.len();
        if let Some(first) = combinations[..listed].first() {
            self.check_words(first, 1)?;
            for (name, axis) in &self.file.grid {
                for value in axis {
                    let mut options = first.clone();
                    options.insert(name.clone(), value.clone());
                    self.check_words(&options, value.line)?;
                }
            }
        }
        for (options, point) in combinations[listed..].iter().zip(&self.file.points) {
            self.check_words(options, point.first().map_or(1, |(_, setting)| setting.line))?;
        }
        Ok(())
    }

    fn check_words(&self, options: &Options, line: usize) -> Result<(), SweepError> {
        let seed = self.file.seeds.as_ref().and_then(|seeds| seeds.first().copied());
        (self.line.check)(&self.words(options, seed)).map_err(|said| {
            // Line of the option in the message, if it is one of this point.
            let named =
                |(name, _): &(&String, &Located<Setting>)| said.contains(&format!("'--{name} "));
            let line = options.iter().find(named).map_or(line, |(_, setting)| setting.line);
            let command = self.file.command.name();
            self.fault(line, FileFault::RefusedPoint { command, said })
        })
    }

    /// Words typed after `klasktron`, options by name.
    fn words(&self, options: &Options, seed: Option<u64>) -> Vec<String> {
        let command = self.file.command;
        let mut words = vec![command.name().to_owned()];
        words.extend(self.file.inputs.iter().map(|input| input.value.clone()));
        for (name, setting) in options {
            match &setting.value {
                Setting::Flag(false) => {}
                Setting::Flag(true) => words.push(format!("--{name}")),
                Setting::One(word) => words.extend(option_words(name, word)),
                Setting::Many(list) => match self.spec(name).map(|spec| spec.kind) {
                    Some(OptionKind::Words(_)) => {
                        words.push(format!("--{name}"));
                        words.extend(list.iter().cloned());
                    }
                    _ => words.extend(option_words(name, &self.shown(name, &setting.value))),
                },
            }
        }
        if let Some(seed) = seed {
            words.extend(["--seed".to_owned(), seed.to_string()]);
            words.extend(command.words_of_one_seed().iter().map(|word| (*word).to_owned()));
        }
        words
    }

    /// Value for people and tables.
    fn shown(&self, name: &str, setting: &Setting) -> String {
        match setting {
            Setting::Flag(flag) => flag.to_string(),
            Setting::One(word) => word.clone(),
            Setting::Many(words) => match self.spec(name).map(|spec| spec.kind) {
                Some(OptionKind::Delimited(between)) => words.join(&between.to_string()),
                _ => words.join(" "),
            },
        }
    }

    fn points(&self, combinations: &[Options]) -> Result<Vec<Point>, SweepError> {
        let file = self.file;
        let axes = file.grid.iter().map(|(name, _)| name);
        let listed = file.points.iter().flatten().map(|(name, _)| name);
        let varying: BTreeSet<&String> = axes.chain(listed).collect();
        let mut hashes = InputHashes::default();
        let mut inputs = Vec::new();
        for input in &file.inputs {
            inputs.push(self.hash(&mut hashes, &input.value, input.line)?);
        }
        let seeds: Vec<Option<u64>> = file
            .seeds
            .as_ref()
            .map_or_else(|| vec![None], |s| s.iter().copied().map(Some).collect());
        let mut known = BTreeSet::new();
        let mut points = Vec::new();
        for options in combinations {
            let inputs = self.inputs_of(options, &inputs, &mut hashes)?;
            let shown = |name: &&String| {
                let setting = options.get(*name)?;
                Some(((*name).clone(), self.shown(name, &setting.value)))
            };
            let settings: BTreeMap<String, String> = varying.iter().filter_map(shown).collect();
            for seed in &seeds {
                let mut point = Point::new(self.words(options, *seed), &inputs);
                point.settings.clone_from(&settings);
                point.seed = *seed;
                // A listed point may be in the grid too.
                if known.insert(point.hash.clone()) {
                    points.push(point);
                }
            }
        }
        Ok(points)
    }

    /// Hashes of the inputs and of the files in options.
    fn inputs_of(
        &self,
        options: &Options,
        inputs: &[String],
        hashes: &mut InputHashes,
    ) -> Result<Vec<String>, SweepError> {
        let mut all = inputs.to_vec();
        for (name, setting) in options {
            let words: &[String] = match &setting.value {
                Setting::Flag(_) => &[],
                Setting::One(word) => std::slice::from_ref(word),
                Setting::Many(words) => words,
            };
            for word in words.iter().filter(|word| self.file.command.is_file(name, word)) {
                all.push(self.hash(hashes, word, setting.line)?);
            }
        }
        Ok(all)
    }

    fn hash(
        &self,
        hashes: &mut InputHashes,
        path: &str,
        line: usize,
    ) -> Result<String, SweepError> {
        hashes
            .of(&self.folder.join(path))
            .map_err(|error| self.fault(line, FileFault::Input(error.to_string())))
    }
}

/// Words of an option; a value that looks like an option is attached with `=`.
fn option_words(name: &str, value: &str) -> Vec<String> {
    if value.starts_with('-') {
        vec![format!("--{name}={value}")]
    } else {
        vec![format!("--{name}"), value.to_owned()]
    }
}
