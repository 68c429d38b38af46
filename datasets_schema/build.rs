//! Compiles `datasets_schema/klasktron.proto` with protox, so that no protoc is needed.
//!
//! Writes the Rust messages and the serialised `FileDescriptorSet` that every recording carries.

use prost::Message as _;
use std::{env, error::Error, fs, path::PathBuf};

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo::rerun-if-changed=datasets_schema");
    let descriptors = protox::compile(["klasktron.proto"], ["datasets_schema"])?;
    let out = PathBuf::from(env::var("OUT_DIR")?);
    fs::write(out.join("klasktron.fds"), descriptors.encode_to_vec())?;
    prost_build::Config::new().enable_type_names().compile_fds(descriptors)?;
    Ok(())
}
