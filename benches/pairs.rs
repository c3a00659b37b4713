//! The second stage: the search for potential links. Columns: see `benches/README.md`.

mod common;

use common::{Cell, Options, Pools, Rows, measure, ns_each, on_cpu, ratio};

fn main() {
    let (options, pools) = (Options::parse(), Pools::new());
    let mut rows = Rows::new("pairs", &options, &pools);
    for case in options.cases() {
        let m = measure(&case, &pools, options.repeat);
        let [one, all] = m.later;
        let (curves, found) = (m.stats.curves, m.stats.potential_links);
        rows.row(
            &case,
            vec![
                ("curves", "curves", Cell::Count(curves)),
                ("potential\nlinks", "potential_links", Cell::Count(found)),
                (
                    "links\na curve",
                    "links_curve",
                    Cell::Real(ratio(found as f64, curves), 2),
                ),
                ("1 thread\nms", "ms_1", Cell::Real(one.pairs_ms, 4)),
                (
                    "a curve\nns",
                    "ns_curve_1",
                    Cell::Real(ns_each(one.pairs_ms, curves), 1),
                ),
                (
                    "a link\nns",
                    "ns_link_1",
                    Cell::Real(ns_each(one.pairs_ms, found), 1),
                ),
                ("N threads\nms", "ms_all", Cell::Real(all.pairs_ms, 4)),
                (
                    "faster\ntimes",
                    "faster",
                    Cell::Real(one.pairs_ms / all.pairs_ms, 2),
                ),
                ("cpu\n/ wall", "on_cpu_1", Cell::Real(on_cpu(one), 2)),
            ],
        );
    }
}
