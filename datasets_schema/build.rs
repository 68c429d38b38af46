//! Compiles `datasets_schema/klasktron.proto` with protox, so that no protoc is needed, and tells
//! the program which commit it is built from.
//!
//! Writes the Rust messages and the serialised `FileDescriptorSet` that every recording carries.

use prost::Message as _;
use std::{env, error::Error, fs, path::PathBuf, process::Command};

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo::rerun-if-changed=datasets_schema");
    let descriptors = protox::compile(["klasktron.proto"], ["datasets_schema"])?;
    let out = PathBuf::from(env::var("OUT_DIR")?);
    fs::write(out.join("klasktron.fds"), descriptors.encode_to_vec())?;
    prost_build::Config::new().enable_type_names().compile_fds(descriptors)?;
    println!("cargo::rustc-env=KLASKTRON_GIT_HASH={}", git_hash());
    Ok(())
}

/// The commit of the checkout; `unknown` in a package without one.
fn git_hash() -> String {
    for file in [".git/HEAD", ".git/logs/HEAD"] {
        if fs::exists(file).unwrap_or(false) {
            println!("cargo::rerun-if-changed={file}");
        }
    }
    Command::new("git")
        .args(["rev-parse", "--short=12", "HEAD"])
        .output()
        .ok()
        .filter(|output| output.status.success())
        .and_then(|output| String::from_utf8(output.stdout).ok())
        .map_or_else(|| "unknown".to_owned(), |hash| hash.trim().to_owned())
}
