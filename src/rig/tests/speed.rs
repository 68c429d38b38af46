//! Speed of the rig's simulation. Run it optimized and alone:
//! `cargo test --release --lib -- rig::tests::speed --ignored --nocapture`.

use super::support::Host;
use std::time::Instant;

#[test]
#[ignore = "a measurement for an optimised build"]
fn ten_minutes_take_less_than_ten_seconds() {
    let mut host = Host::from_json(r#"{"ball": {"launch_every_s": 4.0}}"#);
    let begin = Instant::now();
    host.arm();
    let mut events = 0;
    for tick in 0..30_000 {
        let sign = if tick / 10 % 2 == 0 { 1.0 } else { -1.0 };
        for node in 0..4 {
            host.velocity(node, 5.0 * sign);
        }
        host.wait(0.02);
        events += host.messages.len() + host.pictures.len();
        host.messages.clear();
        host.pictures.clear();
    }
    let seconds = begin.elapsed().as_secs_f64();
    println!("600 s simulated in {seconds:.2} s, {events} events");
    assert!(host.link.truth().drives.iter().all(|drive| drive.errors.is_empty()));
    assert!(seconds < 10.0, "{seconds}");
}
