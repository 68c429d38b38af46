//! Reports: a page is a list of sections, each of which knows only its own data.
//!
//! Modules produce sections from their results; nothing here knows the meaning of an actuator. Everything
//! returns text, and only the binary writes files. A page is self-contained: its charts are data that a
//! script in the page draws, and the browser loads nothing from elsewhere.

mod chart;
mod html;
mod picture;

pub use chart::{Axis, Chart, Colour, Grid, Points, Ranges, Scale, Series, figure, with_same_y};
pub use html::{Badge, Page, Table, escape};
pub use picture::{Picture, pictures};
