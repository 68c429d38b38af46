//! `klasktron sweep`: the file, the local engine, the Slurm engine before a fake Slurm, the presets. A real
//! Slurm is in `scripts/check_sweep`.

mod file;
mod local;
#[cfg(unix)]
mod presets;
#[cfg(unix)]
mod slurm;
mod support;
