//! Exact test for contact: two segments in space that share a point.

use super::predicates::Predicates;
use crate::curve::Point;

/// Returns true if the closed segments `p0 p1` and `q0 q1` share a point.
///
/// # Proof: segments meet if and only if they are coplanar and their projections meet along all
/// three axes
///
/// Segments that share a point lie in one plane, and their projections meet along every axis.
/// Conversely, let four points lie in a plane (or on a line), and take an axis that is not parallel
/// to it. The projection along that axis is one-to-one on the plane, so projections that meet
/// belong to segments that meet.
pub(crate) fn segments_touch(
    p0: Point,
    p1: Point,
    q0: Point,
    q1: Point,
    predicates: &mut Predicates,
) -> bool {
    predicates.orient3d(p0, p1, q0, q1) == 0
        && (0..3).all(|w| {
            let plane = |p: Point| [p[(w + 1) % 3], p[(w + 2) % 3]];
            projections_meet(plane(p0), plane(p1), plane(q0), plane(q1), predicates)
        })
}

/// Returns true if two closed segments of the plane share a point. Either may be a single point.
fn projections_meet(
    p0: [f64; 2],
    p1: [f64; 2],
    q0: [f64; 2],
    q1: [f64; 2],
    predicates: &mut Predicates,
) -> bool {
    let q_sides = [
        predicates.orient2d(p0, p1, q0),
        predicates.orient2d(p0, p1, q1),
    ];
    let p_sides = [
        predicates.orient2d(q0, q1, p0),
        predicates.orient2d(q0, q1, p1),
    ];
    if q_sides[0] != q_sides[1] && p_sides[0] != p_sides[1] {
        return true;
    }
    let within = |p: [f64; 2], a: [f64; 2], b: [f64; 2]| {
        (0..2).all(|x| a[x].min(b[x]) <= p[x] && p[x] <= a[x].max(b[x]))
    };
    (q_sides[0] == 0 && within(q0, p0, p1))
        || (q_sides[1] == 0 && within(q1, p0, p1))
        || (p_sides[0] == 0 && within(p0, q0, q1))
        || (p_sides[1] == 0 && within(p1, q0, q1))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn touch(p: [[i32; 3]; 4]) -> bool {
        let q = p.map(|p| p.map(f64::from));
        let mut answers = Vec::new();
        // The result depends neither on the order of the segments nor on their directions.
        for (a, b, c, d) in [(0, 1, 2, 3), (1, 0, 2, 3), (2, 3, 0, 1), (3, 2, 1, 0)] {
            answers.push(segments_touch(
                q[a],
                q[b],
                q[c],
                q[d],
                &mut Predicates::default(),
            ));
        }
        assert!(
            answers.windows(2).all(|w| w[0] == w[1]),
            "{p:?}: {answers:?}"
        );
        answers[0]
    }

    #[test]
    fn finds_every_kind_of_contact_and_no_other() {
        let o = [0, 0, 0];
        // At inner points, a vertex on an edge, vertex on vertex, overlap on a line, identical, a
        // point.
        assert!(touch([[-1, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0]]));
        assert!(touch([[-1, 0, 0], [1, 0, 0], o, [0, 1, 5]]));
        assert!(touch([o, [1, 0, 0], o, [0, 1, 5]]));
        assert!(touch([o, [2, 2, 2], [1, 1, 1], [3, 3, 3]]));
        assert!(touch([o, [2, 2, 2], o, [2, 2, 2]]));
        assert!(touch([o, o, [-1, -1, -1], [1, 1, 1]]));
        assert!(touch([o, o, o, o]));
        // Apart on one line, parallel, in one plane without contact, skew, a point beside a
        // segment.
        assert!(!touch([o, [1, 1, 1], [2, 2, 2], [3, 3, 3]]));
        assert!(!touch([o, [1, 0, 0], [0, 1, 0], [1, 1, 0]]));
        assert!(!touch([o, [1, 0, 0], [2, -1, 0], [2, 1, 0]]));
        assert!(!touch([o, [1, 0, 0], [0, 1, 1], [1, 1, -3]]));
        assert!(!touch([o, o, [1, 0, 0], [0, 1, 0]]));
        assert!(!touch([o, o, [1, 1, 1], [1, 1, 1]]));
    }
}
