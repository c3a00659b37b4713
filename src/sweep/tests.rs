use super::*;
use crate::curve::{Basis, Positions};
use crate::scenes::Scene;

fn scene(text: &str) -> CurveSet {
    text.parse::<Scene>().unwrap().build().unwrap().curves
}

fn sweep(set: CurveSet, reductions: Vec<Reduction>) -> Vec<SweepStep> {
    let sweep = Sweep::new(set, reductions, SessionOptions::default()).unwrap();
    sweep.map(Result::unwrap).collect()
}

#[test]
fn many_bits_keep_a_knit_intact_and_few_do_not() {
    let set = scene("knit:rows=4,stitches=24,segments=1152");
    let steps = sweep(set, (2..=16).rev().map(Reduction::Bits).collect());
    let verdicts: Vec<Verdict> = steps.iter().map(|s| s.verdict).collect();
    assert_eq!(verdicts[..6], [Verdict::Intact; 6], "{verdicts:?}");
    assert_ne!(verdicts.last(), Some(&Verdict::Intact), "{verdicts:?}");
    // Once a curve was pulled through another one, no coarser step is intact.
    let first = verdicts.iter().position(|v| *v != Verdict::Intact).unwrap();
    assert!(
        verdicts[first..].iter().all(|v| *v != Verdict::Intact),
        "{verdicts:?}"
    );
}

#[test]
fn fewer_points_break_a_knit_and_most_points_do_not() {
    let set = scene("knit:rows=3,stitches=16,segments=1152");
    let shares = [1.0, 0.8, 0.6, 0.4, 0.3, 0.2, 0.15, 0.1];
    let steps = sweep(set, shares.map(Reduction::Share).to_vec());
    let verdicts: Vec<Verdict> = steps.iter().map(|s| s.verdict).collect();
    assert_eq!(verdicts[..3], [Verdict::Intact; 3], "{verdicts:?}");
    assert!(verdicts.contains(&Verdict::Changed), "{verdicts:?}");
    let events: usize = steps.iter().map(|s| s.report.events.len()).sum();
    assert!(events > 0);
    for step in &steps {
        for event in &step.report.events {
            for (i, s) in [event.i, event.j].into_iter().zip(event.segments) {
                assert!(s < step.curves.curve(i as usize).segments, "{event:?}");
            }
        }
    }
}

/// A bar goes through a ring in two strands, there and back: its linking number is 0. On a coarse
/// grid both strands are outside of the ring, and the linking number is still 0.
#[test]
fn pull_throughs_that_cancel_are_found() {
    // Corners of the bounding box. On a grid of four cells, coordinates become 2, 6, 10 and 14.
    let corners = [0., 0., 0., 16., 0., 0., 16., 16., 0., 16., 16., 16.];
    let ring = [1.9, 9.9, 6., 13.9, 5.9, 6., 1.9, 1.9, 6.];
    // Both strands move from below the first side of the ring to (6, 10), above it.
    let bar = [
        4.1, 8.1, 2.5, 4.1, 8.1, 13.5, 1., 15., 15., 4.5, 8.2, 13.5, 4.5, 8.2, 2.5, 1., 15., 1.,
    ];
    let xyz = [&corners[..], &ring, &bar].concat();
    let set = CurveSet::from_counts(Basis::Polyline, &[-4, -3, -6], Positions::F64(&xyz)).unwrap();
    let options = SessionOptions {
        motion_limit: Some(f64::INFINITY),
        ..SessionOptions::default()
    };
    let sweep = Sweep::new(set, [8, 6, 2].map(Reduction::Bits).to_vec(), options).unwrap();
    let steps: Vec<SweepStep> = sweep.map(Result::unwrap).collect();
    let verdicts: Vec<Verdict> = steps.iter().map(|s| s.verdict).collect();
    assert_eq!(
        verdicts,
        [Verdict::Intact, Verdict::Intact, Verdict::Changed]
    );
    let report = &steps[2].report;
    assert!(report.changes.is_empty(), "{:?}", report.changes);
    let pairs: Vec<(u32, u32)> = report.events.iter().map(|e| (e.i, e.j)).collect();
    assert_eq!(pairs, [(1, 2), (1, 2)]);
    assert_eq!(report.events[0].sign, -report.events[1].sign);
}

#[test]
fn open_curves_are_swept_for_pull_throughs() {
    let point = |k: usize| {
        let t = k as f64 * 0.1;
        [t.cos(), t.sin(), 0.02 * t]
    };
    let xyz: Vec<f64> = (0..100).flat_map(point).collect();
    let set = CurveSet::from_counts(Basis::CatmullRom, &[100], Positions::F64(&xyz)).unwrap();
    for reductions in [
        [1.0, 0.9].map(Reduction::Share).to_vec(),
        [20, 16].map(Reduction::Bits).to_vec(),
    ] {
        let steps = sweep(set.clone(), reductions);
        assert!(steps.iter().all(|s| s.verdict == Verdict::Intact));
    }
}

#[test]
fn refuses_reductions_before_any_step() {
    let set = scene("chainmail:rows=2,columns=2");
    for (reductions, words) in [
        (vec![], "one reduction"),
        (vec![Reduction::Bits(8), Reduction::Share(0.5)], "one kind"),
        (vec![Reduction::Bits(8), Reduction::Bits(53)], "53 bits"),
        (
            vec![Reduction::Share(1.0), Reduction::Share(1e-9)],
            "leaves 0",
        ),
    ] {
        let refused = Sweep::new(set.clone(), reductions, SessionOptions::default());
        let e = refused.err().expect("refused").to_string();
        assert!(e.contains(words), "{e}");
    }
}

#[test]
fn a_plot_has_a_dot_for_each_step_and_series() {
    let steps = sweep(
        scene("chainmail:rows=2,columns=2"),
        [8, 4, 2].map(Reduction::Bits).to_vec(),
    );
    let svg = plot("rings <2>", &steps);
    assert_eq!(svg.matches("<circle").count(), 9);
    assert!(svg.contains("rings &lt;2&gt;") && svg.contains("bits per coordinate"));
    assert!(!svg.contains("NaN"), "{svg}");
    assert!(plot("", &[]).ends_with("</svg>\n"));
}
