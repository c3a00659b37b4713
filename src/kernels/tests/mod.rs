//! Conformance tests of all kernels against the oracle, by one runner: the numbered properties of
//! [`crate::kernels`], error bounds that cover the error, and the minimum number of decisions in
//! the table of tolerances.

pub mod oracle;
mod oracle_itself;
pub mod polygons;
mod runner;
mod table;
mod truth;

use crate::random;

/// Generates one test of each kind for every kernel.
macro_rules! conformance {
    ($($name:ident: $kernel:ident $([$when:meta])?),* $(,)?) => {$(
        mod $name {
            use crate::kernels::tests::{runner, table::$kernel};

            #[test]
            $(#[$when])?
            fn random_polygons_are_within_the_bound() {
                runner::random_polygons(&$kernel, $kernel.tolerance.pairs, 0);
            }

            #[test]
            #[ignore = "a hundred thousand pairs: half a minute and more"]
            fn random_polygons_are_within_the_bound_a_hundred_thousand_times() {
                // 100,000 of these do not touch.
                runner::random_polygons(&$kernel, 140_000, 1000);
            }

            #[test]
            $(#[$when])?
            fn the_numbered_properties_hold() {
                runner::numbered_properties(&$kernel);
            }

            #[test]
            $(#[$when])?
            fn scales_and_offsets_do_not_change_the_result() {
                runner::scales_and_offsets(&$kernel);
            }

            #[test]
            $(#[$when])?
            fn scenes_have_the_linking_numbers_of_their_construction() {
                runner::scenes(&$kernel);
            }

            #[test]
            $(#[$when])?
            fn touching_curves_are_undecided() {
                runner::contact(&$kernel);
            }

            #[test]
            $(#[$when])?
            fn nearly_touching_curves_are_right_or_undecided() {
                runner::near_contact(&$kernel);
            }

            #[test]
            $(#[$when])?
            fn curves_other_than_closed_polylines_are_unknown() {
                runner::other_curves(&$kernel);
            }

            #[test]
            $(#[$when])?
            fn results_do_not_depend_on_the_number_of_threads() {
                runner::threads(&$kernel);
            }
        }
    )*};
}

conformance! {
    crossings: CROSSINGS,
    direct: DIRECT,
    angle_sum: ANGLE_SUM,
    interval: INTERVAL,
    barnes_hut: BARNES_HUT,
    barnes_hut_by_beta: BARNES_HUT_BETA,
    barnes_hut_coarse: BARNES_HUT_COARSE,
    barnes_hut_estimated: BARNES_HUT_ESTIMATED,
    fmm: FMM,
    fmm_of_low_order: FMM_LOW,
}

/// Conformance tests on a GPU adapter: `cargo test --release --lib gpu:: -- --ignored --skip
/// hundred_thousand`.
#[cfg(feature = "gpu")]
mod gpu {
    conformance! {
        crossings: GPU_CROSSINGS [ignore = "needs an adapter"],
        direct: GPU_DIRECT [ignore = "needs an adapter"],
        direct_in_double_precision: GPU_DIRECT_DOUBLE [ignore = "needs an adapter"],
        barnes_hut: GPU_BARNES_HUT [ignore = "needs an adapter"],
    }
}
