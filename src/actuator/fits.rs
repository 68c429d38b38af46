//! Many fits: in parallel, each kept as soon as it is finished, none ever made twice.
//!
//! A finished fit lies in the store under the hash of everything that decides it: its settings,
//! the data and this crate's version. Whoever starts the same work again finds it there.

use super::{
    ActuatorError,
    dataset::Dataset,
    fit::{self, Epoch, Fit, FitConfig, FitObserver},
    model::ActuatorNetwork,
};
use crate::{
    nn::safetensors,
    parallel::in_parallel_on,
    recording::{ExistingFile, RecordingError, hexadecimal, write_bytes},
};
use sha2::{Digest, Sha256};
use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    sync::atomic::AtomicBool,
};

/// Metadata keys of a stored fit.
const CONFIG_KEY: &str = "fit_config";
const CURVE_KEY: &str = "learning_curve";

/// Finished fits in a folder.
#[derive(Debug, Clone)]
pub struct Store {
    folder: PathBuf,
    data_hash: String,
}

impl Store {
    /// Opens the store in `folder`, which is made when it is not there, for fits to `dataset`.
    ///
    /// # Errors
    /// When the folder cannot be made.
    pub fn open(folder: &Path, dataset: &Dataset) -> Result<Self, ActuatorError> {
        fs::create_dir_all(folder).map_err(RecordingError::io(folder, "create the folder"))?;
        let mut hash = Sha256::new();
        hash.update(env!("CARGO_PKG_VERSION"));
        // The runs themselves, so that the same file under another name is the same data, and a
        // run that moved from one side of the split to the other is not.
        for (side, runs) in [("train", &dataset.train), ("held out", &dataset.held_out)] {
            hash.update(side);
            for run in runs {
                hash.update((run.len() as u64).to_le_bytes());
                for value in run.commands.iter().chain(&run.velocities).flatten() {
                    hash.update(value.to_le_bytes());
                }
            }
        }
        let data_hash = hexadecimal(&hash.finalize());
        Ok(Self { folder: folder.to_owned(), data_hash })
    }

    fn path(&self, config: &FitConfig) -> PathBuf {
        let settings = to_json(config);
        let hash = Sha256::new().chain_update(&self.data_hash).chain_update(settings).finalize();
        self.folder.join(format!("{}.safetensors", &hexadecimal(&hash)[..24]))
    }

    /// The finished fit of `config`; `None` when there is none, or none that can be read.
    #[must_use]
    pub fn get(&self, config: &FitConfig) -> Option<Fit> {
        let bytes = fs::read(self.path(config)).ok()?;
        let activation = config.layout.activation();
        let (network, metadata) = safetensors::from_safetensors(&bytes, activation).ok()?;
        let stored: FitConfig = serde_json::from_str(metadata.get(CONFIG_KEY)?).ok()?;
        let curve: Vec<Epoch> = serde_json::from_str(metadata.get(CURVE_KEY)?).ok()?;
        let layout = config.input_layout();
        let fits = stored == *config && network.inputs() == layout.inputs();
        fits.then(|| Fit { config: stored, model: ActuatorNetwork::new(layout, network), curve })
    }

    fn put(&self, fit: &Fit) -> Result<(), ActuatorError> {
        let path = self.path(&fit.config);
        let metadata = BTreeMap::from([
            (CONFIG_KEY.to_owned(), to_json(&fit.config)),
            (CURVE_KEY.to_owned(), to_json(&fit.curve)),
        ]);
        let bytes = safetensors::to_safetensors(&fit.model.network, &metadata);
        Ok(write_bytes(&path, ExistingFile::Replace, &bytes)?)
    }
}

fn to_json(value: &impl serde::Serialize) -> String {
    serde_json::to_string(value).unwrap_or_else(|_plain| unreachable!("plain data"))
}

/// What a set of fits reports while it runs.
pub trait FitsObserver: FitObserver {
    /// A fit was found in the store.
    fn fit_reused(&self, config: &FitConfig);
    /// A fit has ended.
    fn fit_done(&self, config: &FitConfig);
}

/// Makes every fit of `configs` that is not in the store, on `threads` threads, and returns those
/// that are finished, in the order of `configs`: fewer than asked for when `stop` was raised.
///
/// # Errors
/// When a fit diverges or the store cannot be written.
pub fn fit_all(
    configs: &[FitConfig],
    dataset: &Dataset,
    store: &Store,
    (threads, stop): (usize, &AtomicBool),
    observer: &dyn FitsObserver,
) -> Result<Vec<Fit>, ActuatorError> {
    let (train, held_out) = (dataset.train(), dataset.held_out());
    let one = |config: &FitConfig| -> Result<Option<Fit>, ActuatorError> {
        if let Some(fit) = store.get(config) {
            log::info!("fit of seed {} is there already", config.seed);
            observer.fit_reused(config);
            return Ok(Some(fit));
        }
        let FitConfig { seed, history_steps, width, epochs, .. } = config;
        log::info!(
            "fit of seed {seed} begins: history {history_steps}, width {width}, {epochs} epochs"
        );
        let made = fit::fit(config, &train, &held_out, stop, &AsFitObserver(observer))?;
        if let Some(fit) = &made {
            store.put(fit)?;
            log::info!("fit of seed {seed}, history {history_steps}, width {width} is done");
            observer.fit_done(config);
        }
        Ok(made)
    };
    // The largest first, so that no thread is left with a long fit at the end.
    let mut queue: Vec<usize> = (0..configs.len()).collect();
    queue.sort_by_key(|index| std::cmp::Reverse(work(&configs[*index])));
    let made = in_parallel_on(threads, &queue, |index| (*index, one(&configs[*index])));
    let mut by_index = BTreeMap::new();
    for (index, result) in made {
        if let Some(fit) = result? {
            by_index.insert(index, fit);
        }
    }
    Ok(by_index.into_values().collect())
}

/// Multiplications per window, roughly.
fn work(config: &FitConfig) -> usize {
    let hidden = config.width * config.width * (config.hidden_layers - 1);
    (config.input_layout().inputs() * config.width + hidden) * config.epochs * config.horizon
}

struct AsFitObserver<'a>(&'a dyn FitsObserver);

impl FitObserver for AsFitObserver<'_> {
    fn epoch_done(&self) {
        self.0.epoch_done();
    }
}
