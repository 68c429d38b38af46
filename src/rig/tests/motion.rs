//! Steps, stops and reversals against the figures of the KlaskTron paper.

use super::support::Host;

#[test]
fn explore() {
    let mut host = Host::from_json(&std::env::var("RIG").unwrap_or("{}".into()));
    host.arm();
    for dir in [[1.0, 0.0], [0.0, 1.0]] {
        let mut run = |v: f64, s: f64| {
            let t = host.drive([dir[0] * v, dir[1] * v], s);
            t.into_iter()
                .map(|(t, b)| {
                    let r = b.right;
                    let c = dir[0] * r.carriage.vx + dir[1] * r.carriage.vy;
                    let p = dir[0] * r.carriage.x + dir[1] * r.carriage.y;
                    let lag = (r.carriage.x - r.peg.x).hypot(r.carriage.y - r.peg.y);
                    (t, c, p, lag, r.coupled)
                })
                .collect::<Vec<_>>()
        };
        run(-0.3, 0.16);
        run(0.0, 0.3);
        let show = |name: &str, tr: &[(f64, f64, f64, f64, bool)], from: f64, to: f64| {
            let z = tr[0].0 - 0.001;
            let span = (to - from).abs();
            let settle =
                tr.iter().rev().find(|r| 0.05 * 0.5 < (r.1 - to).abs()).map_or(0.0, |r| r.0 - z);
            let reach = tr.iter().find(|r| (r.1 - to).abs() < 0.05 * 0.5).map_or(9.0, |r| r.0 - z);
            let t10 = tr.iter().find(|r| 0.1 * span < (r.1 - from).abs()).map_or(9.0, |r| r.0 - z);
            let t90 = tr.iter().find(|r| 0.9 * span < (r.1 - from).abs()).map_or(9.0, |r| r.0 - z);
            let lag = tr.iter().map(|r| r.3).fold(0.0, f64::max);
            let over = tr.iter().map(|r| (r.1 - to) * (to - from).signum()).fold(0.0, f64::max);
            let dist = (tr.last().unwrap().2 - tr[0].2).abs();
            let cross =
                tr.iter().find(|r| 0.0 < (r.1 * (to - from).signum())).map_or(9.0, |r| r.0 - z);
            println!(
                "{name} {dir:?} settle {settle:.3} reach {reach:.3} t10 {t10:.3} t90 {t90:.3} mean acc to reach {:.2} acc1090 {:.2} lag {lag:.4} over {over:.3} dist {dist:.4} cross {cross:.3}",
                span / reach,
                0.8 * span / (t90 - t10)
            );
        };
        show("start", &run(0.5, 0.2), 0.0, 0.5);
        show("stop", &run(0.0, 0.3), 0.5, 0.0);
        run(-0.5, 0.16);
        show("reverse", &run(0.5, 0.2), -0.5, 0.5);
        run(0.0, 0.3);
    }
}
