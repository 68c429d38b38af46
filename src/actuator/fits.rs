//! Many fits in parallel. Each finished fit is stored at once, and no fit is repeated.
//!
//! A finished fit is stored under the hash of everything that decides it: its settings, the data
//! and this crate's version. A later run of the same work reuses it.

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

/// Metadata key of the settings of a stored fit.
const CONFIG_KEY: &str = "fit_config";
const CURVE_KEY: &str = "learning_curve";

/// Store of finished fits in a folder.
#[derive(Debug, Clone)]
pub struct Store {
    folder: PathBuf,
    data_hash: String,
}

impl Store {
    /// Open the store in `folder` for fits to `dataset`; a missing folder is created.
    ///
    /// # Errors
    /// When the folder cannot be created.
    pub fn open(folder: &Path, dataset: &Dataset) -> Result<Self, ActuatorError> {
        fs::create_dir_all(folder).map_err(RecordingError::io(folder, "create the folder"))?;
        let mut hash = Sha256::new();
        hash.update(env!("CARGO_PKG_VERSION"));
        // The hash covers the runs themselves. The same file under another name is the same data; a run that moved to the other side of the split is not.
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

    /// Return the finished fit of `config`; `None` when the store has no readable fit.
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

/// Receiver of the progress of a set of fits.
pub trait FitsObserver: FitObserver {
    /// Report a fit that was found in the store.
    fn fit_reused(&self, config: &FitConfig);
    /// Report the end of a fit.
    fn fit_done(&self, config: &FitConfig);
}

/// Make every fit of `configs` that is missing in the store, on `threads` threads. Return the
/// finished fits in the order of `configs`: fewer than requested when `stop` was raised.
///
/// # Errors
/// When a fit diverges or writing to the store fails.
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
            log::info!("fit of seed {} found in the store", config.seed);
            observer.fit_reused(config);
            return Ok(Some(fit));
        }
        let FitConfig { seed, history_steps, width, epochs, .. } = config;
        log::info!(
            "fit of seed {seed} starts: history {history_steps}, width {width}, {epochs} epochs"
        );
        let made = fit::fit(config, &train, &held_out, stop, &AsFitObserver(observer))?;
        if let Some(fit) = &made {
            store.put(fit)?;
            log::info!("fit of seed {seed}, history {history_steps}, width {width} finished");
            observer.fit_done(config);
        }
        Ok(made)
    };
    // The largest first, so that no thread ends with a long fit alone.
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

/// Return the approximate number of multiplications per window.
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
