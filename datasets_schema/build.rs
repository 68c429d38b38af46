//! Tell the program which commit it is built from.

use std::{fs, process::Command};

fn main() {
    println!("cargo::rerun-if-changed=datasets_schema/build.rs");
    println!("cargo::rustc-env=KLASKTRON_GIT_HASH={}", git_hash());
}

/// Digits of a commit's hash.
const HASH_DIGITS: usize = 12;

/// The commit of the checkout, or the one from which this package was made; `unknown` elsewhere. A
/// package that lies in a checkout of something else is not asked for that one's commit.
fn git_hash() -> String {
    let of_checkout = ["HEAD", "logs/HEAD"].into_iter().filter_map(git_path);
    for file in of_checkout.chain([PACKAGED_FROM.to_owned()]) {
        if fs::exists(&file).unwrap_or(false) {
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
    git(&["rev-parse", "HEAD"])
}

/// Path of a file of git's for this checkout: in a work tree, `.git` is a file and the folder is elsewhere.
fn git_path(file: &str) -> Option<String> {
    git(&["rev-parse", "--git-path", file])
}

/// First line that git prints in the checkout of this package; `None` where there is no checkout.
fn git(arguments: &[&str]) -> Option<String> {
    if !fs::exists(".git").unwrap_or(false) {
        return None;
    }
    let output = Command::new("git").args(arguments).output().ok()?;
    let text = output.status.success().then_some(output.stdout)?;
    Some(String::from_utf8(text).ok()?.trim().to_owned())
}
