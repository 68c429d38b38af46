//! `klasktron eval` on matches whose events are known: `eval/game.rs` has a physics of its own.

mod game;
mod hostile;
mod known;
mod program;
mod recorded;
