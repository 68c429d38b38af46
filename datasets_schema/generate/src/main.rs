//! Compile `datasets_schema/klasktron.proto` with protox: the Rust messages and the serialized `FileDescriptorSet`
//! that every recording carries. `--check` compares them with the files in the folder instead and fails where one
//! is older.

use prost::Message as _;
use std::{env, error::Error, fs, path::Path, process::ExitCode};

fn main() -> Result<ExitCode, Box<dyn Error>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let descriptors = protox::compile(["klasktron.proto"], [&folder])?;
    let fds = descriptors.encode_to_vec();
    let out = env::temp_dir().join(format!("generate-schema-{}", std::process::id()));
    fs::create_dir_all(&out)?;
    prost_build::Config::new().enable_type_names().out_dir(&out).compile_fds(descriptors)?;
    let rust = fs::read(out.join("klasktron.rs"))?;
    fs::remove_dir_all(&out)?;
    let is_check = env::args().nth(1).is_some_and(|argument| argument == "--check");
    let mut status = ExitCode::SUCCESS;
    for (name, bytes) in [("klasktron.rs", rust), ("klasktron.fds", fds)] {
        let path = folder.join(name);
        if !is_check {
            fs::write(&path, &bytes)?;
        } else if fs::read(&path).ok().as_ref() != Some(&bytes) {
            eprintln!("datasets_schema/{name} is not what klasktron.proto gives: run scripts/generate_schema");
            status = ExitCode::FAILURE;
        }
    }
    Ok(status)
}
