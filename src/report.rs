//! Reports: a page is a list of sections, each of which knows only its own data.
//!
//! Rooms produce sections from their results; nothing here knows what an actuator is. Everything
//! returns text, and only the binary writes files. Pages are self-contained: pictures are inline
//! SVG, and nothing is loaded from anywhere.

mod html;
mod plot;

pub use html::{Page, Table, escape};
pub use plot::{
    Axis, Band, Curve, HeatMap, LinePlot, Scale, StepPlot, Stroke, heat_map, heat_map_within,
    line_plot, path_plot, step_plot,
};
