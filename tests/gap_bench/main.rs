//! Blind bench for `klasktron gap`.
#![allow(clippy::print_stdout, reason = "the bench's result is its table")]

mod axis;
mod ball;
mod baseline;
mod cases;
mod catalogue;
mod draw;
mod gantry;
mod generate;
mod observe;
mod plan;
mod record;
mod step;
mod truth;

fn main() -> anyhow::Result<()> {
    let args: Vec<String> = std::env::args().collect();
    let out = std::path::PathBuf::from(&args[1]);
    let extent = match args[2].as_str() { "quick" => cases::Extent::Quick, "all" => cases::Extent::All, n => cases::Extent::About(n.parse()?) };
    let t = std::time::Instant::now();
    let a = generate::generate(&generate::Request { out: &out, seed: 0, extent, jobs: 2 })?;
    println!("{} cases in {:?}", a.cases.len(), t.elapsed());
    Ok(())
}
