//! Conversion of splines to polylines by both methods: each pair separately while it is counted,
//! and Algorithm 3 for all curves at once, whose polylines are then counted. Columns: see
//! `benches/README.md`.

mod common;

use common::measure::{Run, median, timed};
use common::{Cell, Options, Pools, Rows, measure, ns_each};
use linkwatch::{Certifier, Polylines, homotopic_polylines};

fn main() {
    let (options, pools) = (Options::parse(), Pools::new());
    let mut rows = Rows::new("discretize", &options, &pools);
    for case in options.cases().filter(|case| case.is_spline()) {
        let m = measure(&case, &pools, options.repeat);
        let [one, all] = m.later;
        let subject = &case.subject;
        let name = &subject.name;
        let made = homotopic_polylines(&subject.curves).expect("fewer points than can be counted");
        let Polylines {
            curves,
            overlaps,
            too_close,
            ..
        } = &made;
        assert!(too_close.is_empty(), "{name}: {too_close:?}");
        let counts = (*overlaps, curves.segments());
        assert!(
            case.algorithm_3.is_none_or(|known| known == counts),
            "{name}: {counts:?}"
        );
        // Wall-clock and CPU time of the discretization, and of certifying its polylines.
        let runs = pools.alternate(options.repeat, || {
            let (made, elapsed) = timed(|| homotopic_polylines(&subject.curves));
            let curves = made.expect("as before").curves;
            let mut certifier = Certifier::default();
            let [first, later] = [(); 2].map(|()| Run::of(&mut certifier, &curves, &subject.exact));
            assert!(
                first.equal && later.equal,
                "{name}: the polylines have other links"
            );
            [elapsed.wall_ms, elapsed.cpu_ms, later.times.total_ms]
        });
        let [[made_one, cpu_one, count_one], [made_all, _, count_all]] =
            runs.map(|runs| [0, 1, 2].map(|k| median(runs.iter().map(|r| r[k]))));
        let segments = m.stats.segments;
        let ms = |x| Cell::Real(x, 3);
        rows.row(
            &case,
            vec![
                ("\nsegments", "segments", Cell::Count(segments)),
                ("by pair\nadded", "refined", Cell::Count(m.stats.refined)),
                ("1 thread\nlinks, ms", "links_ms_1", ms(one.links_ms)),
                ("1 thread\nin all, ms", "wall_ms_1", ms(one.total_ms)),
                ("N threads\nms", "wall_ms_all", ms(all.total_ms)),
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
}
