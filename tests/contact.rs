//! Curves that touch exactly in a frame. The frames on both sides of a contact decide what passes
//! through it, for open, closed and mixed pairs, and for a curve and itself.

mod support;

use linkwatch::{
    Basis, CurveSet, DefectKind, Events, Point, Positions, Report, Session, SessionOptions,
    Strategy, Verdict,
};
use support::session::Step;

/// Kind of contact between the two strands.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Meeting {
    /// Inner points of two edges touch.
    Edges,
    /// A vertex of the moving strand touches an edge.
    VertexOnEdge,
    /// A vertex of each strand touches.
    Vertices,
    /// Two parallel edges overlap.
    Overlap,
}

const MEETINGS: [Meeting; 4] = [
    Meeting::Edges,
    Meeting::VertexOnEdge,
    Meeting::Vertices,
    Meeting::Overlap,
];

/// Kinds of curves that the two strands belong to.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Curves {
    Open,
    Closed,
    /// One curve is closed: the moving strand if true, else the other one.
    Mixed(bool),
    /// Both strands belong to one curve, open or closed.
    Itself {
        closed: bool,
    },
}

const CURVES: [Curves; 6] = [
    Curves::Open,
    Curves::Closed,
    Curves::Mixed(true),
    Curves::Mixed(false),
    Curves::Itself { closed: false },
    Curves::Itself { closed: true },
];

/// Returns a resting strand along x, and one along y at height `z`.
fn strands(meeting: Meeting, z: f64) -> [Vec<Point>; 2] {
    let middle: &[f64] = match meeting {
        Meeting::Edges => &[-2.0, 2.0],
        Meeting::VertexOnEdge => &[0.0],
        Meeting::Vertices => &[0.0],
        Meeting::Overlap => &[-1.0, 1.0],
    };
    let moving = |y: &f64| match meeting {
        // It moves through the resting strand along x, from one side to the other.
        Meeting::Overlap => [*y, 0.0, z],
        _ => [0.0, *y, z],
    };
    let mut first = vec![[0.0, -8.0, z - 1.0]];
    first.extend(middle.iter().map(moving));
    first.push([0.0, 8.0, z - 1.0]);
    let resting: &[f64] = match meeting {
        Meeting::Edges | Meeting::VertexOnEdge => &[-8.0, -3.0, 3.0, 8.0],
        Meeting::Vertices => &[-8.0, 0.0, 8.0],
        Meeting::Overlap => &[-8.0, -2.0, 2.0, 8.0],
    };
    let second = resting.iter().map(|&x| [x, 0.0, 0.0]).collect();
    [first, second]
}

fn frame(curves: Curves, meeting: Meeting, z: f64) -> CurveSet {
    let [mut first, mut second] = strands(meeting, z);
    // The return path of the moving strand is below, or above, everything; that of the resting one
    // is beside it.
    let under = [[0.5, 20.0, -30.0], [0.5, -20.0, -30.0]];
    let beside = [[20.0, -25.0, 3.0], [-20.0, -25.0, 3.0]];
    let mut counts = Vec::new();
    let mut xyz = Vec::new();
    let mut add = |points: &[Point], closed: bool| {
        let n = points.len() as i32;
        counts.push(if closed { -n } else { n });
        xyz.extend_from_slice(points.as_flattened());
    };
    match curves {
        Curves::Itself { closed } => {
            // Two edges connect the strands, far from both.
            first.insert(0, [0.0, -9.0, -7.0]);
            first.extend([
                [20.0, 20.0, -20.0],
                [-20.0, 20.0, -20.0],
                [-20.0, 5.0, -9.0],
            ]);
            first.append(&mut second);
            if closed {
                first.extend([[30.0, -10.0, 9.0], [30.0, -30.0, 9.0]]);
            }
            add(&first, closed);
        }
        _ => {
            let closed = match curves {
                Curves::Closed => [true, true],
                Curves::Mixed(first) => [first, !first],
                _ => [false, false],
            };
            if closed[0] {
                first.extend(under);
            }
            if closed[1] {
                second.extend(beside);
            }
            add(&first, closed[0]);
            add(&second, closed[1]);
        }
    }
    CurveSet::from_counts(Basis::Polyline, &counts, Positions::F64(&xyz)).unwrap()
}

/// Returns the reports on the frames with the moving strand at these heights, from an incremental
/// session that is compared with a full one.
fn reports(curves: Curves, meeting: Meeting, heights: &[f64]) -> Vec<Report> {
    let own = matches!(curves, Curves::Itself { .. });
    let events = if own { Events::All } else { Events::Between };
    let [mut incremental, mut full] = [Strategy::Paranoid, Strategy::Full].map(|strategy| {
        Session::new(SessionOptions {
            strategy,
            events,
            ..SessionOptions::default()
        })
        .unwrap()
    });
    let mut verify = |(k, &z): (usize, &f64)| {
        let set = frame(curves, meeting, z);
        let verified = incremental.step(k as u64, &set);
        let found = verified.report;
        incremental.settle();
        let expected = full.step(k as u64, &set).report;
        assert!(!verified.work.disagreed, "{curves:?} {meeting:?} frame {k}");
        let reported = |r: &Report| {
            (
                r.verdict,
                r.abort,
                r.changes.clone(),
                r.events.clone(),
                r.defects.clone(),
            )
        };
        assert_eq!(
            reported(&found),
            reported(&expected),
            "{curves:?} {meeting:?} frame {k}"
        );
        found
    };
    heights.iter().enumerate().map(&mut verify).collect()
}

fn signs(reports: &[Report]) -> Vec<Vec<i32>> {
    let events = reports.iter().map(|r| r.events.iter());
    events
        .map(|events| events.map(|e| e.sign).collect())
        .collect()
}

/// Returns the sign of the pull-through from above to below, without a contact. The strands of one
/// curve run in the same directions as open ones.
fn sign(meeting: Meeting) -> i32 {
    let direct = signs(&reports(Curves::Open, meeting, &[1.0, -1.0]));
    let [sign] = direct[1][..] else {
        panic!("{meeting:?}: {direct:?}");
    };
    sign
}

#[test]
fn a_pull_through_with_contact_in_a_frame_is_found_in_the_next_frame() {
    for curves in CURVES {
        for meeting in MEETINGS {
            let what = format!("{curves:?} {meeting:?}");
            let sign = sign(meeting);
            for (heights, sign) in [
                (&[1.0, 0.0, -1.0][..], sign),
                (&[-1.0, 0.0, 1.0], -sign),
                // The strand rests in contact for a while.
                (&[1.0, 0.0, 0.0, 0.0, -1.0], sign),
            ] {
                let reports = reports(curves, meeting, heights);
                let (last, before) = reports.split_last().unwrap();
                let touching = &before[1..];
                assert_eq!(before[0].verdict, Verdict::Intact, "{what}: {before:?}");
                for report in touching {
                    assert_eq!(report.verdict, Verdict::Contact, "{what}: {report:?}");
                    assert!(
                        report.abort && report.events.is_empty(),
                        "{what}: {report:?}"
                    );
                }
                assert_eq!(last.verdict, Verdict::Changed, "{what}: {last:?}");
                assert!(last.abort, "{what}: {last:?}");
                let [event] = last.events[..] else {
                    panic!("{what}: {last:?}");
                };
                assert_eq!((event.sign, event.fraction), (sign, 0.0), "{what}");
                assert!(
                    event.point[0].abs() <= 2.0 && event.point[2] == 0.0,
                    "{what}: {event:?}"
                );
            }
        }
    }
}

#[test]
fn a_strand_that_touches_and_returns_is_not_pulled_through() {
    for curves in CURVES {
        for meeting in MEETINGS {
            for heights in [&[1.0, 0.0, 1.0][..], &[-1.0, 0.0, 0.0, -1.0]] {
                let reports = reports(curves, meeting, heights);
                let what = format!("{curves:?} {meeting:?} {heights:?}: {reports:?}");
                assert!(signs(&reports).iter().all(Vec::is_empty), "{what}");
                assert_eq!(reports.last().unwrap().verdict, Verdict::Intact, "{what}");
                assert_eq!(reports[1].verdict, Verdict::Contact, "{what}");
            }
        }
    }
}

#[test]
fn curves_that_touch_in_the_first_frame_take_their_number_from_the_next() {
    for curves in CURVES {
        for meeting in MEETINGS {
            let reports = reports(curves, meeting, &[0.0, 0.0, -1.0, -1.0, 0.0, 1.0]);
            let verdicts: Vec<_> = reports.iter().map(|r| r.verdict).collect();
            let aborts: Vec<_> = reports.iter().map(|r| r.abort).collect();
            let what = format!("{curves:?} {meeting:?}: {reports:?}");
            let closed = curves == Curves::Closed;
            // Open curves with a common vertex in the first frame are joined at it.
            let joined = meeting == Meeting::Vertices && !closed;
            let first = if joined {
                Verdict::Intact
            } else {
                Verdict::Contact
            };
            assert_eq!(verdicts[..2], [first; 2], "{what}");
            // A contact since the first frame does not ask to stop; a later contact does.
            assert_eq!(aborts, [false, false, false, false, true, true], "{what}");
            let third = if closed {
                Verdict::Undecided
            } else {
                Verdict::Intact
            };
            assert_eq!(verdicts[2], third, "{what}");
            assert_eq!(verdicts[3], Verdict::Intact, "{what}");
            assert_eq!(
                verdicts[4..],
                [Verdict::Contact, Verdict::Changed],
                "{what}"
            );
            let said = |r: &Report| {
                r.defects
                    .iter()
                    .filter(|d| d.kind == DefectKind::NoBaseline)
                    .count()
            };
            assert_eq!(
                reports.iter().map(said).sum::<usize>(),
                usize::from(closed),
                "{what}"
            );
        }
    }
}

/// Regression test: a passage that began in the contact had a motion of 0. So of two pull-throughs
/// that cancel, one was unresolved and the other one was not.
#[test]
fn a_pull_through_that_begins_in_a_contact_may_be_unresolved() {
    let ring = [[-1., -1., 0.], [1., -1., 0.], [1., 1., 0.], [-1., 1., 0.]];
    let frame = |x: f64| {
        let xyz = [&ring[..], &[[x, 0., -1.], [x, 0., 1.]]].concat().concat();
        CurveSet::from_counts(Basis::Polyline, &[-4, 2], Positions::F64(&xyz)).unwrap()
    };
    for touching in [-1.0, -1.0001] {
        let mut session = Session::new(SessionOptions {
            events: Events::Between,
            ..SessionOptions::default()
        })
        .unwrap();
        let reports = [-2.0, touching, 3.0].map(frame).into_iter().zip(0..);
        let reports: Vec<Report> = reports
            .map(|(set, k)| session.step(k, set).report)
            .collect();
        let last = &reports[2];
        assert_eq!(last.verdict, Verdict::Undecided, "{touching}: {last:?}");
        assert_eq!(
            (last.events.len(), last.unresolved.len()),
            (0, 2),
            "{last:?}"
        );
        assert!(
            last.unresolved.iter().all(|event| event.lengths > 1.5),
            "{last:?}"
        );
    }
}
