//! x
mod ablation;
mod baseline;
mod coverage;
mod dataset;
mod error;
mod fit;
mod fits;
mod judge;
mod layout;
mod model;
mod run;
mod window;
pub use ablation::*; pub use baseline::*; pub use coverage::*; pub use dataset::*; pub use error::ActuatorError; pub use fit::*; pub use fits::*; pub use judge::*; pub use layout::*; pub use model::*; pub use run::*; pub use window::*;
