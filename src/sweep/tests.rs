use super::*;
use crate::curve::{Basis, Positions};
use crate::scenes::Scene;
use crate::verdict::ChangeKind;

fn scene(text: &str) -> CurveSet {
    text.parse::<Scene>().unwrap().build().unwrap().curves
}

fn sweep(set: CurveSet, reductions: Vec<Reduction>) -> Vec<SweepStep> {
    let sweep = Sweep::new(set, reductions, VerifierOptions::default()).unwrap();
    sweep.map(Result::unwrap).collect()
}

#[test]
fn many_bits_are_intact_and_few_bits_break_a_knit() {
    let set = scene("knit:rows=4,stitches=24,segments=1152");
    let steps = sweep(set, (2..=16).rev().map(Reduction::Bits).collect());
    let verdicts: Vec<Verdict> = steps.iter().map(|s| s.verdict).collect();
    assert_eq!(verdicts[..6], [Verdict::Intact; 6], "{verdicts:?}");
    assert!(verdicts.contains(&Verdict::Changed), "{verdicts:?}");
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

/// A bar through a ring and back, in two strands that both leave the ring if the grid is coarse:
/// the linking number is 0 before and after.
#[test]
fn pull_throughs_that_cancel_are_found() {
    // Corners of the bounding box, which fix the grid: a third curve.
    let corners = [0., 0., 0., 16., 0., 0., 16., 16., 16., 0., 16., 16.];
    // Four cells of 4 per axis; their middles are 2, 6, 10 and 14.
    let ring = [4.5, 4.5, 6., 11.5, 4.5, 6., 11.5, 11.5, 6., 4.5, 11.5, 6.];
    // Both strands cross the plane of the ring beside its side at x = 11.5, which moves to 10.
    let bar = [11., 6., 2.5, 11., 6., 13.5, 11., 9., 13.5, 11., 9., 2.5];
    let xyz = [corners, ring, bar].concat();
    let set = CurveSet::from_counts(Basis::Polyline, &[-4; 3], Positions::F64(&xyz)).unwrap();
    let mut options = VerifierOptions::default();
    options.motion_limit = Some(f64::INFINITY);
    let mut events = 0;
    let mut verdicts = Vec::new();
    let original = Sweep::new(set, [8, 6, 5, 4, 3].map(Reduction::Bits).to_vec(), options).unwrap();
    for step in original {
        let step = step.unwrap();
        assert!(step.report.changes.is_empty(), "{:?}", step.report.changes);
        events += step.report.events.len();
        verdicts.push(step.verdict);
    }
    assert_eq!(events % 2, 0);
    assert!(events > 0, "{verdicts:?}");
    assert_eq!(verdicts.last(), Some(&Verdict::Changed));
}

#[test]
fn a_lost_link_is_named() {
    let set = scene("chainmail:rows=3,columns=3");
    let steps = sweep(set, [12, 8, 4, 3, 2].map(Reduction::Bits).to_vec());
    assert_eq!(steps[0].verdict, Verdict::Intact);
    let lost = steps.iter().map(|s| s.report.count(ChangeKind::Lost)).max();
    assert!(lost > Some(0));
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
        let refused = Sweep::new(set.clone(), reductions, VerifierOptions::default());
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
    assert_eq!(svg.matches("<circle").count(), 6);
    assert!(svg.contains("rings &lt;2&gt;") && svg.contains("bits per coordinate"));
    assert!(!svg.contains("NaN"), "{svg}");
    assert!(plot("", &[]).ends_with("</svg>\n"));
}
