//! Exact test for contact: two segments in space that share a point.

use super::big::{self, BigPredicates};
use super::passage::Edges;
use super::predicates::{Orientation, Predicates};
use crate::curve::SumEdges;

/// Returns true if two closed segments share a point.
///
/// # Proof: segments meet if and only if they are coplanar and their projections meet along all
/// three axes
///
/// Segments that share a point lie in one plane, and their projections meet along every axis.
/// Conversely, let four points lie in a plane (or on a line), and take an axis that is not parallel
/// to it. The projection along that axis is one-to-one on the plane, so projections that meet
/// belong to segments that meet.
pub(crate) fn segments_touch([p, q]: &Edges) -> bool {
    touch_by(p.each_ref(), q.each_ref(), &mut Predicates::default())
}

/// [`segments_touch`] for two segments whose coordinates are sums, in big integers.
#[cold]
pub(crate) fn sums_touch([p, q]: SumEdges) -> bool {
    let [p0, p1, q0, q1] = big::points([p[0], p[1], q[0], q[1]]);
    touch_by([&p0, &p1], [&q0, &q1], &mut BigPredicates)
}

pub(super) fn touch_by<O: Orientation>(
    p: [&O::Point; 2],
    q: [&O::Point; 2],
    predicates: &mut O,
) -> bool {
    predicates.orient3d([p[0], p[1], q[0], q[1]]) == 0
        && (0..3).all(|w| projections_meet(p, q, ((w + 1) % 3, (w + 2) % 3), predicates))
}

/// Returns true if the projections of two closed segments to a plane share a point. Either may be a
/// single point.
fn projections_meet<O: Orientation>(
    p: [&O::Point; 2],
    q: [&O::Point; 2],
    plane: (usize, usize),
    predicates: &mut O,
) -> bool {
    let [q_sides, p_sides] =
        [(p, q), (q, p)].map(|([a, b], ends)| ends.map(|c| predicates.orient2d([a, b, c], plane)));
    if q_sides[0] != q_sides[1] && p_sides[0] != p_sides[1] {
        return true;
    }
    let within = |p: &O::Point, ends: [&O::Point; 2]| {
        [plane.0, plane.1].into_iter().all(|x| {
            let [a, b] = ends.map(|end| O::compare(p, end, x));
            a.is_eq() || b.is_eq() || a != b
        })
    };
    (q_sides[0] == 0 && within(q[0], p))
        || (q_sides[1] == 0 && within(q[1], p))
        || (p_sides[0] == 0 && within(p[0], q))
        || (p_sides[1] == 0 && within(p[1], q))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn touch(p: [[i32; 3]; 4]) -> bool {
        let q = p.map(|p| p.map(f64::from));
        let mut answers = Vec::new();
        // The result depends neither on the order of the segments nor on their directions.
        for (a, b, c, d) in [(0, 1, 2, 3), (1, 0, 2, 3), (2, 3, 0, 1), (3, 2, 1, 0)] {
            answers.push(segments_touch(&[[q[a], q[b]], [q[c], q[d]]]));
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
