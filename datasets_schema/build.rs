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

/// Digits of a commit's hash.
const HASH_DIGITS: usize = 12;

/// The commit of the checkout, or the one from which this package was made; `unknown` elsewhere. A
/// package that lies in a checkout of something else is not asked for that one's commit.
fn git_hash() -> String {
    for file in [".git/HEAD", ".git/logs/HEAD", PACKAGED_FROM] {
        if fs::exists(file).unwrap_or(false) {
            println!("cargo::rerun-if-changed={file}");
        }
    }
    let hash = hash_of_package().or_else(hash_of_checkout);
    hash.map_or_else(|| "unknown".to_owned(), |hash| hash.chars().take(HASH_DIGITS).collect())
}

/// Where `cargo package` notes the commit.
const PACKAGED_FROM: &str = ".cargo_vcs_info.json";

fn hash_of_package() -> Option<String> {
    let info = fs::read_to_string(PACKAGED_FROM).ok()?;
    let (_, after) = info.split_once("\"sha1\": \"")?;
    let (hash, _) = after.split_once('"')?;
    let is_hash = HASH_DIGITS <= hash.len() && hash.chars().all(|digit| digit.is_ascii_hexdigit());
    is_hash.then(|| hash.to_owned())
}

fn hash_of_checkout() -> Option<String> {
    if !fs::exists(".git").unwrap_or(false) {
        return None;
    }
    let output = Command::new("git").args(["rev-parse", "HEAD"]).output().ok()?;
    let hash = output.status.success().then_some(output.stdout)?;
    Some(String::from_utf8(hash).ok()?.trim().to_owned())
}
