//! Motions with passages that are known by construction.

use super::*;

/// A vertical edge at rest.
const POST: [Point; 2] = [[0.0, 0.0, -4.0], [0.0, 0.0, 4.0]];

#[test]
fn a_pull_through_has_its_time_place_and_sign() {
    let along_x = |y: f64| [[-1.0, y, 2.0], [3.0, y, 2.0]];
    let mut seen = Vec::new();
    for (from, to, time) in [(-3.0, 1.0, 0.75), (-1.0, 1.0, 0.5), (1.0, -7.0, 0.125)] {
        let (before, after) = ([along_x(from), POST], [along_x(to), POST]);
        for (decided, all) in [
            collect(&before, &after, Ties::Translate),
            collect_exactly(&before, &after, Ties::Translate),
        ] {
            assert_ne!(decided, Decided::Apart);
            let [p] = all[..] else { panic!("{all:?}") };
            let near = |a: f64, b: f64| (a - b).abs() < 1e-14;
            assert!(
                near(p.time, time) && near(p.at[0], 0.25) && near(p.at[1], 0.75),
                "{p:?}"
            );
            assert!(near(p.point[0], 0.0) && near(p.point[1], 0.0) && near(p.point[2], 2.0));
            seen.push(p.sign);
        }
    }
    // The oracle confirms the signs in `the_sum_of_passages_is_the_change_of_the_linking_number`.
    assert_eq!(seen, [-1, -1, -1, -1, 1, 1]);
}

/// The first edge turns as it moves, and passes the post twice: its projection contains the origin
/// if `a x b = -6 + 49 t - 49 t^2` is 0, at 1/7 and 6/7.
#[test]
fn finds_two_passages_that_cancel() {
    let before = [[[-6.0, -3.0, 0.0], [10.0, 6.0, 0.0]], POST];
    let after = [[[-6.0, -10.0, 0.0], [3.0, 6.0, 0.0]], POST];
    for (_, all) in [
        collect(&before, &after, Ties::Report),
        collect_exactly(&before, &after, Ties::Report),
    ] {
        let [p, q] = all[..] else { panic!("{all:?}") };
        assert!((p.time - 1.0 / 7.0).abs() < 1e-15 && (q.time - 6.0 / 7.0).abs() < 1e-15);
        assert_eq!(p.sign + q.sign, 0);
        assert!(
            [p, q]
                .iter()
                .all(|p| p.point.iter().all(|x| x.abs() < 1e-14))
        );
    }
}

/// As above with `a x b = -(2 t - 1)^2`: the edges touch and separate again.
#[test]
fn contact_without_crossing_is_no_passage() {
    let before = [[[-2.0, -1.0, 0.0], [3.0, 2.0, 0.0]], POST];
    let after = [[[-2.0, -3.0, 0.0], [1.0, 2.0, 0.0]], POST];
    for ties in [Ties::Translate, Ties::Report] {
        assert_eq!(collect(&before, &after, ties), (Decided::Exact, vec![]));
    }
}

/// A passage exactly in a frame is in one of the adjacent steps. An edge that touches there and
/// turns back has none, or has one in both steps, and they cancel.
#[test]
fn contact_in_a_frame_is_decided_over_both_steps() {
    let frame = |y: f64| [[[-1.0, y, 2.0], [3.0, y, 2.0]], POST];
    for ties in [Ties::Translate, Ties::Report] {
        for (from, to, want) in [
            (-1.0, 1.0, -1),
            (1.0, -1.0, 1),
            (1.0, 1.0, 0),
            (-1.0, -1.0, 0),
        ] {
            let [first, second] = [(from, 0.0), (0.0, to)].map(|(from, to)| {
                let (decided, all) = collect(&frame(from), &frame(to), ties);
                assert_eq!(decided, Decided::Exact);
                let [p] = all[..] else { panic!("{all:?}") };
                p
            });
            assert_eq!((first.moment, first.time), (Moment::End, 1.0));
            assert_eq!((second.moment, second.time), (Moment::Start, 0.0));
            assert_eq!(first.sign + second.sign, want, "{from} {to}");
        }
    }
}

/// The tip of a wedge passes straight through an edge, from any side. Either one edge of the wedge
/// has the passage, or both have one and the two cancel.
#[test]
fn a_tie_at_a_vertex_counts_once() {
    let wedge = |y: f64, bend: f64| [[-2.0, y + bend, 0.0], [0.0, y, 0.0], [2.0, y - 1.0, 0.0]];
    for turn in 0..3 {
        for (bend, want) in [(1.0, 1), (0.0, 1), (-1.0, 1)] {
            let turned = |mut p: Point| {
                p.rotate_left(turn);
                p
            };
            let mut sum = 0;
            for k in 0..2 {
                let frame = |y: f64| {
                    [[wedge(y, bend)[k], wedge(y, bend)[k + 1]], POST].map(|e| e.map(turned))
                };
                let (before, after) = (frame(-1.0), frame(1.0));
                let (decided, all) = collect(&before, &after, Ties::Translate);
                assert_eq!(decided, Decided::Exact);
                assert!(all.iter().all(|p| p.time == 0.5));
                sum += all.iter().map(|p| p.sign).sum::<i32>();
                assert_eq!(
                    collect(&before, &after, Ties::Report),
                    (Decided::Tie, vec![])
                );
            }
            assert_eq!(sum, -want, "{bend} {turn}");
        }
    }
}

/// Edges that lie in one plane at all times are a reported tie only if they meet.
#[test]
fn motion_in_one_plane_is_a_tie_only_if_edges_meet() {
    let at = |x: f64, y: f64| [x, y, x + y];
    let first = [at(0.0, 0.0), at(4.0, 4.0)];
    let cases = [
        // Boxes that overlap, but separated by the sides; apart on one line; through each other; in
        // contact in the first frame only.
        (
            [at(1.0, 0.0), at(3.0, 1.0)],
            [at(1.0, 0.0), at(3.0, 2.0)],
            false,
        ),
        (
            [at(5.0, 5.0), at(6.0, 6.0)],
            [at(7.0, 7.0), at(4.5, 4.5)],
            false,
        ),
        (
            [at(1.0, 0.0), at(3.0, 1.0)],
            [at(0.0, 1.0), at(3.0, 4.0)],
            true,
        ),
        (
            [at(1.0, 1.0), at(3.0, 0.0)],
            [at(1.0, 0.0), at(3.0, 0.0)],
            false,
        ),
    ];
    for (from, to, meet) in cases {
        let (before, after) = ([first, from], [first, to]);
        let (decided, all) = collect_exactly(&before, &after, Ties::Report);
        let contacts = [&before, &after].map(|edges| usize::from(segments_touch(edges)));
        let expected = match meet {
            true => (Decided::Tie, 0),
            false => (Decided::Exact, contacts[0] + contacts[1]),
        };
        assert_eq!((decided, all.len()), expected);
        assert!(all.iter().all(|p| p.moment == Moment::Start));
        collect(&before, &after, Ties::Translate);
    }
}
