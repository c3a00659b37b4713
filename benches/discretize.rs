//! Conversion of splines to polylines by both methods: each pair separately while it is counted,
//! and Algorithm 3 for all curves at once, whose polylines are then counted. Columns: see
//! `benches/README.md`.

mod common;

use common::{Cell, Options, Pools, Table, measure, median, ns_each, time};
use linkwatch::{Polylines, Verifier, homotopic_polylines};

fn main() {
    let (options, pools) = (Options::parse(), Pools::new());
    let mut table = Table::new("discretize", &options, &pools);
    for case in options.cases().filter(|case| case.is_spline()) {
        let m = measure(&case, &pools, options.repeat);
        let [one, all] = m.later;
        let made = homotopic_polylines(&case.curves).expect("fewer points than can be counted");
        let Polylines {
            curves,
            overlaps,
            too_close,
            ..
        } = &made;
        assert!(too_close.is_empty(), "{}: {too_close:?}", case.name);
        let counts = (*overlaps, curves.segments());
        assert!(
            case.algorithm_3.is_none_or(|known| known == counts),
            "{}: {counts:?}",
            case.name
        );
        // Wall-clock and CPU time of the discretization, and of certifying its polylines.
        let runs = pools.alternate(options.repeat, || {
            let (made, wall, cpu) = time(|| homotopic_polylines(&case.curves).expect("as before"));
            let mut verifier = Verifier::default();
            case.check(verifier.certify(&made.curves).0);
            verifier.certify(&made.curves);
            [wall, cpu, verifier.timings().total.as_secs_f64() * 1e3]
        });
        let [[made_one, cpu_one, count_one], [made_all, _, count_all]] =
            runs.map(|runs| [0, 1, 2].map(|k| median(runs.iter().map(|r| r[k]))));
        let segments = m.stats.segments;
        let ms = |x| Cell::Real(x, 3);
        table.row(
            &case,
            vec![
                ("\nsegments", "segments", Cell::Count(segments)),
                ("by pair\nadded", "refined", Cell::Count(m.stats.refined)),
                ("1 thread\nlinks, ms", "links_ms_1", ms(one.links)),
                ("1 thread\nin all, ms", "wall_ms_1", ms(one.total)),
                ("N threads\nms", "wall_ms_all", ms(all.total)),
                (
                    "Algorithm 3\noverlaps",
                    "overlaps",
                    Cell::Count(*overlaps as u64),
                ),
                (
                    "\nadded",
                    "added",
                    Cell::Count((curves.segments() as u64).saturating_sub(segments)),
                ),
                ("\nms", "algorithm_3_ms_1", ms(made_one)),
                ("\ncpu, ms", "algorithm_3_cpu_ms_1", ms(cpu_one)),
                (
                    "a segment\nns",
                    "algorithm_3_ns_segment_1",
                    Cell::Real(ns_each(made_one, segments), 1),
                ),
                ("N threads\nms", "algorithm_3_ms_all", ms(made_all)),
                (
                    "faster\ntimes",
                    "algorithm_3_faster",
                    Cell::Real(made_one / made_all, 2),
                ),
                ("then, ms\n1 thread", "then_ms_1", ms(count_one)),
                ("\nN threads", "then_ms_all", ms(count_all)),
            ],
        );
    }
    table.finish();
}
