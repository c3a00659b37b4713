//! Measurement of the cost of a pair of edges.

use super::methods::meeting;
use super::oracle::pairs;
use super::*;

/// Run with `cargo test --release --lib passage::tests::speed -- --ignored --nocapture`.
#[test]
#[ignore = "a measurement"]
fn speed() {
    use std::hint::black_box;
    use std::time::Instant;
    let mut r = Random::new(6);
    let n = 20_000;
    let far = |(before, after): &(Edges, Edges)| filter::apart(before, after, 0.0);
    let quiet = |m: &(Edges, Edges)| collect(&m.0, &m.1, Ties::Translate).1.is_empty();
    let mut scene = |gap: f64, motion: f64, keep: &dyn Fn(&(Edges, Edges)) -> bool| {
        let all = (0..n).map(|_| meeting(&mut r, gap, motion));
        all.filter(|m| keep(m)).collect::<Vec<_>>()
    };
    let mut scenes = vec![
        ("far", scene(6.0, 0.1, &far)),
        (
            "near, motion 0.01",
            scene(0.3, 0.01, &|m| !far(m) && quiet(m)),
        ),
        (
            "near, motion 0.1",
            scene(0.3, 0.1, &|m| !far(m) && quiet(m)),
        ),
        ("near, motion 1", scene(1.0, 1.0, &|m| !far(m) && quiet(m))),
        ("crossing, motion 0.3", scene(0.1, 0.3, &|m| !quiet(m))),
        ("crossing, motion 3", scene(1.0, 3.0, &|m| !quiet(m))),
    ];
    // Ties of short numbers and of long ones: multiples of a number of 50 bits.
    for (name, factor) in [
        ("ties", 1.0),
        ("ties, long numbers", 1_000_000_007.0 * 1_000_003.0),
    ] {
        let mut lattice = Vec::new();
        while lattice.len() < 2000 {
            let [i, j] = oracle::scene(&mut r);
            let exact =
                |m: &(Edges, Edges)| collect(&m.0, &m.1, Ties::Translate).0 == Decided::Exact;
            lattice.extend(pairs(&i, &j, factor).filter(exact));
        }
        scenes.push((name, lattice));
    }
    println!(
        "{:24}{:>8}{:>12}{:>12}{:>10}",
        "", "pairs", "ns a pair", "exactly", "by exact"
    );
    for (name, pairs) in &scenes {
        let mut best = f64::INFINITY;
        let mut exact = 0;
        for _ in 0..if pairs.len() > 2000 { 20 } else { 3 } {
            exact = 0;
            let start = Instant::now();
            for (before, after) in pairs {
                let decided = passages(before, after, Ties::Translate, &mut |p| {
                    black_box(p);
                });
                exact += u64::from(decided == Decided::Exact);
            }
            best = best.min(start.elapsed().as_nanos() as f64 / pairs.len() as f64);
        }
        let few = &pairs[..pairs.len().min(1000)];
        let start = Instant::now();
        for (before, after) in few {
            exactly(before, after, Ties::Translate, &mut |p| {
                black_box(p);
            });
        }
        let exactly = start.elapsed().as_nanos() as f64 / few.len() as f64;
        println!(
            "{name:24}{:8}{best:12.1}{exactly:12.0}{exact:10}",
            pairs.len()
        );
    }
}
