//! placeholder
mod data; mod error; mod filter; mod matrix; mod motion; mod region; mod settings; mod track; mod upstream; mod tune; mod judge; mod slope;
pub use data::*; pub use error::EkfError; pub use filter::*; pub use motion::Estimate; pub use region::*; pub use settings::*; pub use track::*; pub use upstream::UpstreamFilter; pub use tune::*; pub use judge::*; pub use slope::*;
