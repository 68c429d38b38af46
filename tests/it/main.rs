//! The one integration binary: it keeps link time down.
#![expect(clippy::unwrap_used, reason = "a test ends at the first surprise")]

mod architecture;
mod bus;
mod camera;
mod codec;
mod collect;
mod contract;
mod conventions;
mod damage;
mod demo;
mod docs;
mod drive;
mod effects;
mod ekf;
mod eval;
mod examples;
mod fit_actuator;
mod foreign;
mod game;
mod gap;
mod import;
mod info;
mod play;
mod policy_out;
mod recover;
mod recover_actuator;
mod schema;
mod settings;
mod shell;
mod simulate;
mod support;
mod sweep;
mod tables;
mod terminal;
mod train;
mod weights_out;
