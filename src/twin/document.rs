//! `twin.json`.
