//! Carriage to striker, through the board.

pub(super) mod magnet_spring;
