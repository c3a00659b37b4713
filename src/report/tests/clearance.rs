//! Pictures of the lowest clearance, and of strands whose radius is known.

use super::*;
use crate::verdict::CloseStrands;

fn low(i: u32, j: u32, ratio: f64) -> Clearance {
    Clearance {
        at_least: ratio,
        closest: Some(CloseStrands {
            ratio,
            error: 0.0,
            i,
            j,
            image: Default::default(),
            segments: [1, 3],
            points: [[1.0, 0.0, 0.0], [1.0 - ratio, 0.0, 0.0]],
            distance: ratio,
        }),
        low: ratio < 0.5,
        frames_left: None,
    }
}

/// A run with these clearances, in which the strands have this radius.
fn run(radius: &str, clearances: &[f64]) -> Recorded {
    let start = Recorded::default().with("thickness", radius);
    clearances.iter().fold(start, |run, ratio| {
        run.frame(Verdict::Intact, |r| r.clearance = Some(low(0, 1, *ratio)))
    })
}

fn pictures(figure: &Figure) -> impl Iterator<Item = &String> {
    figure.rows.iter().flatten().flatten()
}

#[test]
fn the_lowest_clearance_below_the_limit_has_pictures() {
    let report = run("0.1", &[0.9, 0.4, 0.2, 0.3]).report();
    assert_eq!(
        (report.figures(), report.conclusion()),
        (0, Conclusion::Intact)
    );
    let figure = report.low_clearance.as_ref().expect("pictures");
    assert_eq!((figure.shot.moment.frame, pictures(figure).count()), (2, 6));
    assert!(
        figure.reason.contains("below the limit in 3 frames"),
        "{}",
        figure.reason
    );
    let html = report.html();
    assert!(html.contains("<h2>Lowest clearance</h2>"), "{html}");
    assert!(html.contains("lowest clearance: frame 2 at 1 s"), "{html}");

    let report = run("0.1", &[0.9, 0.6]).report();
    assert!(report.low_clearance.is_none());
    assert!(!report.html().contains("Lowest clearance"));
}

#[test]
fn pictures_of_a_violation_also_show_a_low_clearance_of_the_same_pair_and_frame() {
    let violation = |of: [u32; 2]| {
        let last = |r: &mut Report| {
            r.changes = vec![change(of[0], of[1])];
            r.clearance = Some(low(0, 1, 0.1));
        };
        run("0.1", &[0.9, 0.4])
            .frame(Verdict::Changed, last)
            .report()
    };
    assert!(violation([0, 1]).low_clearance.is_none());
    assert!(violation([1, 1]).low_clearance.is_some());
}

#[test]
fn strands_have_the_width_of_their_radius_if_it_is_known() {
    let widths = |run: Recorded| {
        let report = run.report();
        let svg = report.low_clearance.as_ref().unwrap().rows[0][1]
            .clone()
            .unwrap();
        let of_class = |class: &str| {
            let band = format!("class=\"{class} w\" style=\"stroke-width:");
            let width = svg.split_once(&band)?.1.split_once('"')?.0;
            width.parse::<f64>().ok()
        };
        let is_named = report.html().contains("diameter of the strands");
        let widths = [of_class("a"), of_class("b")];
        assert_eq!(is_named, widths.iter().all(Option::is_some), "{widths:?}");
        widths
    };
    let one = widths(run("0.1", &[0.4]));
    assert!(one[0].is_some_and(|width| width > 10.0), "{one:?}");
    assert_eq!(one[0], one[1]);
    let published = |radii: &[f32]| {
        let mut run = run("published", &[0.4]);
        run.labels = CurveLabels::default().with_radii(radii.iter().copied());
        run
    };
    let [a, b] = widths(published(&[0.1, 0.2])).map(Option::unwrap);
    assert!((b / a - 2.0).abs() < 0.02, "{a} and {b}");
    assert_eq!(widths(published(&[])), [None; 2]);
    assert!(widths(published(&[0.1, 0.0]))[1].is_none());
}

#[test]
fn impossible_clearances_and_radii_of_a_hostile_recording_are_reported_without_a_panic() {
    for radius in ["0", "-1", "NaN", "inf", "1e300", "1e-300", "x"] {
        for (i, j) in [(0, 1), (0, 0), (7, 9), (u32::MAX, 0)] {
            let hostile = |r: &mut Report| {
                let mut clearance = low(i, j, f64::MIN);
                if let Some(closest) = &mut clearance.closest {
                    closest.segments = [u32::MAX, 3];
                    closest.points[0] = [f64::MAX, f64::MIN, 1e-320];
                }
                r.clearance = Some(clearance);
            };
            let run = run(radius, &[0.1]).frame(Verdict::Intact, hostile);
            let report = run.report();
            assert!(report.html().len() < 100_000);
            for svg in report.low_clearance.iter().flat_map(pictures) {
                assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
            }
        }
    }
}
