//! All stages, from control points in memory to a certificate. Columns: see `benches/README.md`.

mod common;

use common::{Cell, Options, Pools, Rows, measure, ns_each};

fn main() {
    let (options, pools) = (Options::parse(), Pools::new());
    let mut rows = Rows::new("whole", &options, &pools);
    for case in options.cases() {
        let m = measure(&case, &pools, options.repeat);
        let [one, all] = m.later;
        let [first_one, first_all] = m.first;
        let ms = |x| Cell::Real(x, 3);
        rows.row(
            &case,
            vec![
                ("\nsegments", "segments", Cell::Count(m.stats.segments)),
                ("1 thread\nboxes", "boxes_ms_1", ms(one.boxes_ms)),
                ("\npairs", "pairs_ms_1", ms(one.pairs_ms)),
                ("\nlinks", "links_ms_1", ms(one.links_ms)),
                ("\nwall, ms", "wall_ms_1", ms(one.total_ms)),
                ("\ncpu, ms", "cpu_ms_1", ms(one.cpu_ms)),
                (
                    "a segment\nns",
                    "ns_segment_1",
                    Cell::Real(ns_each(one.total_ms, m.stats.segments), 1),
                ),
                ("N threads\nwall, ms", "wall_ms_all", ms(all.total_ms)),
                ("\ncpu, ms", "cpu_ms_all", ms(all.cpu_ms)),
                (
                    "faster\ntimes",
                    "faster",
                    Cell::Real(one.total_ms / all.total_ms, 2),
                ),
                (
                    "first, 1\nwall, ms",
                    "first_wall_ms_1",
                    ms(first_one.total_ms),
                ),
                (
                    "first, N\nwall, ms",
                    "first_wall_ms_all",
                    ms(first_all.total_ms),
                ),
            ],
        );
    }
}
