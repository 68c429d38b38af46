//! Steps, stops and reversals against the figures of the KlaskTron paper.

use super::support::Host;

#[test]
fn explore() {
    let mut host = Host::from_json("{}");
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
        let show = |name: &str, tr: &[(f64, f64, f64, f64, bool)]| {
            println!("{name} {dir:?}");
            for r in tr.iter().step_by(8).take(24) {
                println!("  {:.3} v {:.4} p {:.4} lag {:.5} {}", r.0 - tr[0].0 + 0.001, r.1, r.2, r.3, r.4);
            }
        };
        show("start", &run(0.5, 0.2));
        show("stop", &run(0.0, 0.3));
        run(-0.5, 0.16);
        show("reverse", &run(0.5, 0.2));
        run(0.0, 0.3);
    }
}
