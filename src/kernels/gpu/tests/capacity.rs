//! Lists that grow, and work in batches if they reach their limit.

use super::*;

#[test]
#[ignore = "needs an adapter"]
fn single_precision_sums_are_kept_if_double_precision_exceeds_a_buffer() {
    let set = CROWDED.parse::<Model>().unwrap().build().unwrap().curves;
    let gpu = adapter();
    let want = sums(&gpu, &set, Kind::Direct)[0].1;
    let capacity = size_of_val(&Frame::<f32>::new(&set).vertices[..]) as u64;
    gpu.lock().adapter.restrict(capacity);
    let sum = DirectSum::new(&gpu, &set);
    assert_eq!(sum.linking_numbers(&[(0, 1)]).unwrap(), [want]);
}

#[test]
#[ignore = "needs an adapter"]
fn the_list_of_undecided_tests_grows() {
    let gpu = adapter();
    gpu.lock().undecided_capacity = 1;
    let scaled: Vec<_> = polygons(KINDS[3]).iter().map(|p| floats(p, 1.0)).collect();
    let (_, undecided) = counts_agree(&gpu, &set_of_all(&scaled, true));
    assert!(undecided > 1 && u64::from(gpu.lock().undecided_capacity) >= undecided);
}

/// With small buffers, the lists grow to their limit, and the rest of the work is done in batches.
/// The results are bitwise equal.
#[test]
#[ignore = "needs an adapter"]
fn sums_in_batches_are_the_same() {
    let gpu = adapter();
    for (text, most) in [
        ("chainmail:rows=4,columns=6", 1 << 16),
        ("torus_link:segments=900,toroidal=2,poloidal=3", 1 << 18),
    ] {
        let set = text.parse::<Model>().unwrap().build().unwrap().curves;
        for kind in [Kind::Direct, Kind::DirectDouble, Kind::BarnesHut(None)] {
            let want = sums(&gpu, &set, kind);
            let small = adapter();
            small.lock().adapter.restrict(most);
            small.lock().sum_capacity = Capacity {
                node_pairs: 64,
                tiles: 16,
            };
            assert_eq!(sums(&small, &set, kind), want, "{text}, {kind:?}");
        }
    }
}

/// With a small capacity for node pairs and short submissions. One scene exceeds the capacity even
/// with a single pair of curves, which the CPU then counts.
#[test]
#[ignore = "needs an adapter"]
fn counts_in_batches_are_the_same() {
    for (text, most) in [
        ("square_link:loops=12,segments=1200", 1 << 15),
        ("woundball:segments=3000,crossings=100", 1 << 17),
        ("woundball:segments=30000,crossings=2000", 1 << 19),
    ] {
        let set = text.parse::<Model>().unwrap().build().unwrap().curves;
        let gpu = adapter();
        {
            let mut state = gpu.lock();
            state.adapter.restrict(most);
            state.crossing_capacity = Capacity {
                node_pairs: 16,
                tiles: 16,
            };
            state.max_work = 64 << 8;
            state.undecided_capacity = 16;
        }
        let (tests, undecided) = counts_agree(&gpu, &set);
        println!(
            "{text}: {undecided} of {tests}, {:?}",
            gpu.lock().crossing_capacity
        );
    }
}

/// Two curves of `2^16` segments, so small beside a third curve that all segment pairs are
/// undecided: `2^32` pairs, a count that wraps to 0 in 32 bits.
#[test]
#[ignore = "needs an adapter, and minutes in software"]
fn an_overflow_of_the_undecided_count_leaves_the_pair_undecided() {
    let n = 1 << 16;
    let angle = |k: usize| k as f64 / n as f64 * std::f64::consts::TAU;
    let small = |p: [f64; 3]| p.map(|x| x * 2f64.powi(-70));
    let first = (0..n).map(|k| small([angle(k).cos(), angle(k).sin(), 0.0]));
    let second = (0..n).map(|k| small([1.0 + angle(k).cos(), 0.0, angle(k).sin()]));
    let large = vec![[0.5, 0.0, 0.0], [0.0, 0.5, 0.0], [0.0, 0.0, 0.5]];
    for single in [true, false] {
        let set = set_of_all(
            &[
                first.clone().collect(),
                second.clone().collect(),
                large.clone(),
            ],
            single,
        );
        let gpu = adapter();
        for kind in [Kind::Direct, Kind::DirectDouble] {
            let found = sums(&gpu, &set, kind)[0];
            assert_eq!((found.0, found.1.integer()), ((0, 1), None), "{found:?}");
        }
    }
}
