//! Tests of the bench's own rigs; the bench itself has no test harness.
#![allow(
    clippy::needless_range_loop,
    reason = "loops over two axes or motors read several arrays by the same index"
)]
#![allow(dead_code, reason = "the bench uses what these tests do not")]

mod axis;
mod ball;
mod catalogue;
mod draw;
mod gantry;
mod linear;
mod observe;
mod plan;
mod sanity;
mod step;
mod visibility;
mod wilson;
