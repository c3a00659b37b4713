//! The last stage: linking numbers of all potential links, discretization included. Columns: see
//! `benches/README.md`.

mod common;

use common::{Cell, Options, Pools, Rows, measure, ns_each, on_cpu, ratio};

fn main() {
    let (options, pools) = (Options::parse(), Pools::new());
    let mut rows = Rows::new("links", &options, &pools);
    for case in options.cases() {
        let m = measure(&case, &pools, options.repeat);
        let [one, all] = m.later;
        let s = m.stats;
        rows.row(
            &case,
            vec![
                (
                    "potential\nlinks",
                    "potential_links",
                    Cell::Count(s.potential_links),
                ),
                ("sepa-\nrated", "separated", Cell::Count(s.separated)),
                ("\ntests", "tests", Cell::Count(s.tests)),
                ("\ncrossings", "crossings", Cell::Count(s.crossings)),
                (
                    "tests a\ncrossing",
                    "tests_crossing",
                    Cell::Real(ratio(s.tests as f64, s.crossings), 2),
                ),
                ("\nexact", "exact", Cell::Count(s.exact)),
                ("\nshare", "exact_share", Cell::Percent(s.exact_share())),
                ("1 thread\nms", "ms_1", Cell::Real(one.links_ms, 3)),
                (
                    "a link\nns",
                    "ns_link_1",
                    Cell::Real(ns_each(one.links_ms, s.potential_links), 0),
                ),
                (
                    "a test\nns",
                    "ns_test_1",
                    Cell::Real(ns_each(one.links_ms, s.tests), 1),
                ),
                ("N threads\nms", "ms_all", Cell::Real(all.links_ms, 3)),
                (
                    "faster\ntimes",
                    "faster",
                    Cell::Real(one.links_ms / all.links_ms, 2),
                ),
                ("cpu\n/ wall", "on_cpu_1", Cell::Real(on_cpu(one), 2)),
            ],
        );
    }
}
