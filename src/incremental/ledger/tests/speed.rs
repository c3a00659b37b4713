//! Measurement of the cost of a step.

use super::*;

/// Run with `cargo test --release --lib ledger::tests::speed -- --ignored --nocapture`.
#[test]
#[ignore = "a measurement"]
fn speed() {
    use std::time::Instant;
    println!(
        "{:10}{:>7}{:>7}{:>7}{:>11}{:>8}{:>10}{:>8}{:>12}{:>12}{:>12}",
        "scene",
        "motion",
        "self",
        "pairs",
        "candidates",
        "events",
        "boxes, ms",
        "all, ms",
        "ns/segment",
        "ns/candid.",
        "certify, ms"
    );
    for (name, diameter) in [("knit", 1.0), ("chainmail", 0.2)] {
        let before = name
            .parse::<crate::scenes::Scene>()
            .unwrap()
            .build()
            .unwrap()
            .curves;
        let mut bytes = Vec::new();
        before.write_positions(&mut bytes);
        let xyz: Vec<f32> = bytes
            .chunks_exact(4)
            .map(|b| f32::from_le_bytes(b.try_into().unwrap()))
            .collect();
        for motion in [0.001, 0.01, 0.1] {
            let mut r = Random::new(9);
            let moved: Vec<f32> = xyz
                .iter()
                .map(|x| x + (motion * diameter * r.between(-1.0, 1.0)) as f32)
                .collect();
            let mut after = before.clone();
            after.update(Positions::F32(&moved)).unwrap();
            for self_crossings in [false, true] {
                let options = Coverage {
                    self_crossings,
                    open_curves: false,
                };
                let mut ledger = Ledger::default();
                let mut certifier = Certifier::default();
                let mut times = [Vec::new(), Vec::new(), Vec::new()];
                let mut outcome = Outcome::default();
                for _ in 0..31 {
                    let start = Instant::now();
                    ledger.trees.refit([&before, &after], false, None);
                    times[0].push(start.elapsed());
                    let start = Instant::now();
                    outcome = ledger.first_step(&before, &after, options, None);
                    times[1].push(start.elapsed());
                    let start = Instant::now();
                    certifier.certify(&after);
                    times[2].push(start.elapsed());
                }
                let [boxes, all, certify] = times.map(|mut t| {
                    t.sort();
                    t[0].as_secs_f64()
                });
                let c = outcome.counts;
                println!(
                    "{name:10}{motion:>7}{self_crossings:>7}{:>7}{:>11}{:>8}{:>10.2}{:>8.2}\
                     {:>12.1}{:>12.1}{:>12.2}",
                    c.pairs,
                    c.candidates,
                    outcome.events.len(),
                    1e3 * boxes,
                    1e3 * all,
                    1e9 * all / before.segments() as f64,
                    1e9 * (all - boxes) / c.candidates as f64,
                    1e3 * certify,
                );
            }
        }
    }
}
