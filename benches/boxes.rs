//! The first stage: boxes of all segments, and the trees over them. Columns: see
//! `benches/README.md`.

mod common;

use common::{Cell, Options, Pools, Rows, measure, ns_each, on_cpu};

fn main() {
    let (options, pools) = (Options::parse(), Pools::new());
    let mut rows = Rows::new("boxes", &options, &pools);
    for case in options.cases() {
        let m = measure(&case, &pools, options.repeat);
        let [one, all] = m.later;
        rows.row(
            &case,
            vec![
                ("curves", "curves", Cell::Count(m.stats.curves)),
                ("segments", "segments", Cell::Count(m.stats.segments)),
                ("1 thread\nms", "ms_1", Cell::Real(one.boxes_ms, 3)),
                (
                    "a segment\nns",
                    "ns_segment_1",
                    Cell::Real(ns_each(one.boxes_ms, m.stats.segments), 2),
                ),
                ("N threads\nms", "ms_all", Cell::Real(all.boxes_ms, 3)),
                (
                    "faster\ntimes",
                    "faster",
                    Cell::Real(one.boxes_ms / all.boxes_ms, 2),
                ),
                ("cpu\n/ wall", "on_cpu_1", Cell::Real(on_cpu(one), 2)),
            ],
        );
    }
}
