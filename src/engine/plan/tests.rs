use super::*;
use crate::curve::{Basis, Positions};
use crate::engine::Certifier;
use crate::pairs::SMALL;

fn scene(text: &str) -> CurveSet {
    let scene: crate::scenes::Scene = text.parse().unwrap();
    scene.build().unwrap().curves
}

fn on<T: Send>(threads: usize, work: impl Send + FnOnce() -> T) -> T {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
    pool.build().unwrap().install(work)
}

#[test]
fn only_splines_are_discretized() {
    let polylines = Plan::of(&scene("ribbon:segments=2000"));
    assert!(!polylines.splines && polylines.segments == 2000);
    let splines = Plan::of(&scene("knit:rows=3,stitches=16,segments=384"));
    assert!(splines.splines);
    assert_eq!(polylines.overlaps, 0);
    assert!(splines.overlaps > 0 && splines.links.ms > 0.0);
}

#[test]
fn small_loops_use_the_direction_formula() {
    let plan = Plan::of(&scene("chainmail:rows=4,columns=5"));
    assert!(plan.potential_links > 0);
    assert_eq!(plan.by_formula, plan.potential_links - plan.discarded);
    // With one more segment, the trees have one more level.
    for (segments, formula) in [(SMALL, 1), (SMALL + 1, 0)] {
        let segments = 2 * segments;
        let plan = Plan::of(&scene(&format!("ribbon:segments={segments},lambda=1")));
        assert_eq!(plan.by_formula, formula);
    }
}

#[test]
fn two_huge_loops_are_one_link_split_among_threads() {
    let set = scene("torus_link:segments=100000,toroidal=100,poloidal=100");
    let plan = on(2, || Plan::of(&set));
    assert_eq!((plan.threads, plan.busy_threads), (2, 2));
    let Prediction { one_thread_ms, ms } = plan.links;
    assert_eq!(one_thread_ms, 2.0 * ms);
    // A single link of little work keeps one thread busy.
    let plan = on(2, || Plan::of(&scene("ribbon:segments=2000")));
    assert_eq!(plan.busy_threads, 1);
}

#[test]
fn plans_empty_sets_open_curves_and_degenerate_curves() {
    let xyz: Vec<f64> = (0..36).map(f64::from).collect();
    let nothing = CurveSet::from_counts(Basis::Polyline, &[], Positions::F64(&[])).unwrap();
    let open = CurveSet::from_counts(Basis::CatmullRom, &[6, 6], Positions::F64(&xyz)).unwrap();
    for (set, open) in [(nothing, 0), (open, 2)] {
        let plan = Plan::of(&set);
        let counts = (plan.pairs, plan.potential_links, plan.open_curves);
        assert_eq!(counts, (0, 0, open));
        assert_eq!((plan.busy_threads, plan.tests), (0, 0));
    }
    // Two curves of four distinct points, the third of one, inside the boxes of both.
    let xyz: Vec<f64> = [[0., 0., 0.], [4., 0., 0.], [4., 4., 4.], [0., 4., 0.]]
        .repeat(2)
        .into_iter()
        .chain([[1.0; 3]; 4])
        .flatten()
        .collect();
    let counts = [-4, -4, -4];
    let set = CurveSet::from_counts(Basis::Polyline, &counts, Positions::F64(&xyz)).unwrap();
    let plan = Plan::of(&set);
    let counts = (plan.degenerate_curves, plan.pairs, plan.potential_links);
    assert_eq!(counts, (1, 1, 1));
}

#[test]
fn counts_do_not_depend_on_time_or_threads() {
    let set = scene("knit:rows=80,stitches=16,segments=12800");
    let [one, three] = [1, 3].map(|threads| on(threads, || Plan::of(&set)));
    assert_eq!((one.sampled, one.tests), (three.sampled, three.tests));
    assert_eq!(one.total.one_thread_ms, three.total.one_thread_ms);
    assert_eq!(one.total.ms, one.total.one_thread_ms);
    assert!(three.total.ms < one.total.ms);
}

/// Compares the work predicted by the sample with the work done, for scenes with many links and
/// with a few huge ones.
#[test]
fn the_sample_predicts_the_work() {
    for text in [
        "chainmail:rows=20,columns=20,crumple=0.7",
        "knit:rows=80,stitches=16,segments=11520",
        "ribbon:segments=20000",
        "rubber_bands:bands=200",
        "square_link:loops=100,segments=20000",
        "torus_link:segments=100000,toroidal=100,poloidal=100",
        "torus_zero:segments=40000,periods=20",
        "woundball:segments=100000,crossings=300",
    ] {
        let set = scene(text);
        let plan = Plan::of(&set);
        let (_, stats) = Certifier::default().certify(&set);
        assert_eq!(plan.potential_links as u64, stats.potential_links);
        for (what, predicted, done) in [
            ("tests", plan.tests, stats.tests),
            ("overlaps", plan.overlaps, stats.overlaps),
        ] {
            let ratio = (predicted as f64 + 20.0) / (done as f64 + 20.0);
            assert!(
                (0.6..1.6).contains(&ratio),
                "{text}: {what} {predicted}, {done}"
            );
        }
    }
}

fn offer(calibration: &Calibration) -> Offer<'_> {
    Offer {
        adapter: &calibration.adapter,
        requested: false,
        calibration: Some(calibration),
    }
}

fn device(set: &CurveSet, calibration: &Calibration) -> DevicePlan {
    let plan = Plan::of_filter(set, Some(offer(calibration)), None);
    plan.device.unwrap()
}

#[test]
fn crossings_go_to_an_adapter_that_is_predicted_to_win() {
    let sets = [
        "chainmail:rows=2,columns=2",
        "chainmail:rows=40,columns=40",
        "torus_link:segments=100000,toroidal=100,poloidal=100",
    ]
    .map(scene);
    let fast = Calibration::made_up(0.05, 1e4);
    let slow = Calibration::made_up(0.05, 1e-3);
    let far_away = Calibration::made_up(1e4, 1e4);
    for (calibration, want) in [
        (&fast, [false, true, true]),
        (&slow, [false; 3]),
        (&far_away, [false; 3]),
    ] {
        for (set, want) in sets.iter().zip(want) {
            let plan = Plan::of_filter(set, Some(offer(calibration)), None);
            let device = plan.device.clone().unwrap();
            assert_eq!(device.chosen, want, "{device:?}");
            let (there, here) = (device.adapter_ms.unwrap(), device.cpu_ms.unwrap());
            assert_eq!(there < here, want, "{device:?}");
            assert_eq!(plan.links.ms == there, want);
        }
    }
}

#[test]
fn the_choice_changes_at_the_break_even_point() {
    let set = scene("chainmail:rows=20,columns=20");
    let mut c = Calibration::made_up(1.0, 1e9);
    let here = device(&set, &c).cpu_ms.unwrap();
    for (factor, want) in [(0.9, true), (1.1, false)] {
        c.crossings.round_trip_ms = factor * here;
        assert_eq!(device(&set, &c).chosen, want);
    }
    // The factor scales the CPU of the table to this one.
    c.crossings.cpu_factor = 1.3;
    let found = device(&set, &c);
    assert!(found.chosen);
    assert!((found.cpu_ms.unwrap() / here - 1.3).abs() < 1e-9);
    c.crossings.round_trip_ms = f64::NAN;
    assert!(!device(&set, &c).chosen);
}

#[test]
fn long_links_are_summed_unless_an_adapter_counts_them_faster() {
    let set = scene("woundball:segments=600000,crossings=5000");
    let alone = Plan::of(&set);
    assert_eq!(alone.kernel, Method::Fmm);
    assert_eq!(alone.device, None);
    let mut c = Calibration::made_up(0.1, 1e6);
    // The limit is between the time of the sum and the time of counting on the CPU.
    let summed = device(&set, &c).cpu_ms.unwrap();
    for (ms, want) in [(0.9, Method::Crossings), (1.1, Method::Fmm)] {
        c.crossings.round_trip_ms = ms * summed;
        let plan = Plan::of_filter(&set, Some(offer(&c)), None);
        assert_eq!(plan.kernel, want);
        assert_eq!(plan.device.unwrap().chosen, want == Method::Crossings);
    }
}

#[test]
fn splines_use_the_cpu_and_a_requested_adapter_is_used() {
    let fast = Calibration::made_up(1e-3, 1e6);
    let splines = scene("knit:rows=30,stitches=16,segments=3840");
    let found = device(&splines, &fast);
    assert_eq!((found.chosen, found.adapter_ms), (false, None));
    // The adapter is also named if it is slower, or was never measured.
    let slow = Calibration::made_up(1e4, 1e-3);
    let polylines = scene("chainmail:rows=3,columns=3");
    for calibration in [Some(&slow), None] {
        let requested = Offer {
            adapter: "made up",
            requested: true,
            calibration,
        };
        let plan = Plan::of_filter(&polylines, Some(requested), None);
        let found = plan.device.unwrap();
        assert!(found.chosen, "{found:?}");
        assert_eq!(found.adapter_ms.is_some(), calibration.is_some());
        assert_eq!(found.direct_from, Some(0));
        let splines = Plan::of_filter(&splines, Some(requested), None);
        assert!(!splines.device.unwrap().chosen);
    }
}
