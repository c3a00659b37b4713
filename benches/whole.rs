//! All stages, from control points in memory to a certificate. Columns: see `benches/README.md`.

mod common;

use common::{Cell, Options, Pools, Table, measure, ns_each};

fn main() {
    let (options, pools) = (Options::parse(), Pools::new());
    let mut table = Table::new("whole", &options, &pools);
    for case in options.cases() {
        let m = measure(&case, &pools, options.repeat);
        let [one, all] = m.later;
        let [first_one, first_all] = m.first;
        let ms = |x| Cell::Real(x, 3);
        table.row(
            &case,
            vec![
                ("\nsegments", "segments", Cell::Count(m.stats.segments)),
                ("1 thread\nboxes", "boxes_ms_1", ms(one.boxes)),
                ("\npairs", "pairs_ms_1", ms(one.pairs)),
                ("\nlinks", "links_ms_1", ms(one.links)),
                ("\nwall, ms", "wall_ms_1", ms(one.total)),
                ("\ncpu, ms", "cpu_ms_1", ms(one.cpu)),
                (
                    "a segment\nns",
                    "ns_segment_1",
                    Cell::Real(ns_each(one.total, m.stats.segments), 1),
                ),
                ("N threads\nwall, ms", "wall_ms_all", ms(all.total)),
                ("\ncpu, ms", "cpu_ms_all", ms(all.cpu)),
                (
                    "faster\ntimes",
                    "faster",
                    Cell::Real(one.total / all.total, 2),
                ),
                ("first, 1\nwall, ms", "first_wall_ms_1", ms(first_one.total)),
                (
                    "first, N\nwall, ms",
                    "first_wall_ms_all",
                    ms(first_all.total),
                ),
            ],
        );
    }
    table.finish();
}
