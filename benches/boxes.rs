//! The first stage: boxes of all segments, and the trees over them. Columns: see
//! `benches/README.md`.

mod common;

use common::{Cell, Options, Pools, Table, measure, ns_each};

fn main() {
    let (options, pools) = (Options::parse(), Pools::new());
    let mut table = Table::new("boxes", &options, &pools);
    for case in options.cases() {
        let m = measure(&case, &pools, options.repeat);
        let [one, all] = m.later;
        table.row(
            &case,
            vec![
                ("curves", "curves", Cell::Count(m.stats.curves)),
                ("segments", "segments", Cell::Count(m.stats.segments)),
                ("1 thread\nms", "ms_1", Cell::Real(one.boxes, 3)),
                (
                    "a segment\nns",
                    "ns_segment_1",
                    Cell::Real(ns_each(one.boxes, m.stats.segments), 2),
                ),
                ("N threads\nms", "ms_all", Cell::Real(all.boxes, 3)),
                (
                    "faster\ntimes",
                    "faster",
                    Cell::Real(one.boxes / all.boxes, 2),
                ),
                ("cpu\n/ wall", "on_cpu_1", Cell::Real(one.on_cpu(), 2)),
            ],
        );
    }
    table.finish();
}
