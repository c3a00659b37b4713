//! Lines of a scene as polylines.
//!
//! A loop is closed. A strip is open, also if its last point equals its first one:
//! [`Closing`](crate::Closing) closes it. The segments of a list
//! are joined if they share a point, in any order and direction, as edges of an OBJ file: a list
//! has no other notion of a curve. Points are equal if their coordinates are, not their indices,
//! because some programs give each segment its own copies.
//!
//! A pose is applied to the points, in double precision. An identity leaves them bit for bit.

use super::state::Strip;
use crate::curve::Point;
use crate::curve::vector::{add, add_scaled, cross, dot, per_axis};
use crate::formats::chains::{Chain, Chains, Edge};
use crate::formats::container::foxglove::LineType;
use std::collections::HashMap;

/// A position and a rotation.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Pose {
    pub position: Point,
    /// Quaternion: x, y, z, w. No rotation if all are 0, the value of a missing field.
    pub rotation: [f64; 4],
}

impl Pose {
    fn apply(&self, p: Point) -> Point {
        let [x, y, z, w] = self.rotation;
        let axis = [x, y, z];
        let mut moved = p;
        if axis != [0.0; 3] {
            let norm = dot(axis, axis) + w * w;
            let turn = cross(axis, add_scaled(cross(axis, p), w, p));
            moved = per_axis(|k| p[k] + 2.0 * turn[k] / norm);
        }
        add(moved, self.position)
    }

    fn is_identity(&self) -> bool {
        self.position == [0.0; 3] && self.rotation[..3] == [0.0; 3]
    }
}

/// Returns the polylines of a line. `indices` are those of its points in order; if there are none,
/// all points are in order. The error is a text.
pub(super) fn strips(
    kind: LineType,
    mut points: Vec<Point>,
    indices: &[u32],
    pose: &Pose,
) -> Result<Vec<Strip>, String> {
    if !pose.is_identity() {
        points.iter_mut().for_each(|p| *p = pose.apply(*p));
    }
    if !indices.is_empty() {
        let point = |&k: &u32| {
            let there = points.len();
            let point = points.get(k as usize).copied();
            point.ok_or_else(|| format!("index {k} of a line of {there} points"))
        };
        points = indices.iter().map(point).collect::<Result<_, _>>()?;
    }
    if kind == LineType::List {
        return join(&points);
    }
    let closed = kind == LineType::Loop;
    Ok(match points.len() {
        // Nothing is drawn.
        0 | 1 => Vec::new(),
        _ => vec![Strip { closed, points }],
    })
}

/// Joins pairs of points.
fn join(points: &[Point]) -> Result<Vec<Strip>, String> {
    let (pairs, rest) = points.as_chunks::<2>();
    if !rest.is_empty() {
        let found = points.len();
        return Err(format!(
            "a list of segments with an odd number of points: {found}"
        ));
    }
    let mut vertices: Vec<Point> = Vec::new();
    let mut numbers: HashMap<[u64; 3], u32> = HashMap::new();
    let mut vertex = |p: &Point| -> Result<u32, String> {
        // Both zeros are equal.
        let bits = p.map(|x| (x + 0.0).to_bits());
        let next = u32::try_from(vertices.len());
        let next = next.map_err(|_| "too many points in a list of segments".to_owned())?;
        Ok(*numbers.entry(bits).or_insert_with(|| {
            vertices.push(*p);
            next
        }))
    };
    let mut edges = Vec::new();
    for (line, [a, b]) in (0..).zip(pairs) {
        let ends = [vertex(a)?, vertex(b)?];
        if ends[0] != ends[1] {
            edges.push(Edge { ends, line });
        }
    }
    let chains = Chains::new(&edges, vertices.len()).map_err(|third| {
        let ([x, y, z], [p, q, r]) = (vertices[third.vertex as usize], third.lines);
        format!("more than two segments meet at ({x}, {y}, {z}): {p}, {q} and {r} of a list")
    })?;
    let strip = |chain: Chain| {
        let points = chain.vertices.iter().map(|&v| vertices[v as usize]);
        let (closed, points) = (chain.closed, points.collect());
        Strip { closed, points }
    };
    Ok(chains.curves().map(strip).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    const STILL: Pose = Pose {
        position: [0.0; 3],
        rotation: [0.0, 0.0, 0.0, 1.0],
    };

    fn at(x: f64) -> Point {
        [x, 0.1, -0.0]
    }

    fn shape(strips: &[Strip]) -> Vec<(bool, Vec<f64>)> {
        let first = |s: &Strip| (s.closed, s.points.iter().map(|p| p[0]).collect());
        strips.iter().map(first).collect()
    }

    #[test]
    fn a_loop_is_closed_and_a_strip_is_open() {
        let line = |kind, points: &[f64]| {
            let points = points.iter().map(|&x| at(x)).collect();
            shape(&strips(kind, points, &[], &STILL).unwrap())
        };
        let closed = vec![(true, vec![1.0, 2.0, 3.0])];
        assert_eq!(line(LineType::Loop, &[1.0, 2.0, 3.0]), closed);
        let repeated = vec![(false, vec![1.0, 2.0, 3.0, 1.0])];
        assert_eq!(line(LineType::Strip, &[1.0, 2.0, 3.0, 1.0]), repeated);
        let open = vec![(false, vec![1.0, 2.0, 3.0])];
        assert_eq!(line(LineType::Strip, &[1.0, 2.0, 3.0]), open);
        assert_eq!(line(LineType::Strip, &[1.0]), []);
        assert_eq!(line(LineType::List, &[]), []);
    }

    #[test]
    fn segments_of_a_list_are_joined() {
        let points: Vec<Point> = [1.0, 2.0, 9.0, 8.0, 3.0, 2.0, 3.0, 1.0].map(at).into();
        let joined = strips(LineType::List, points, &[], &STILL).unwrap();
        let expected = [(true, vec![1.0, 2.0, 3.0]), (false, vec![9.0, 8.0])];
        assert_eq!(shape(&joined), expected);
        let points: Vec<Point> = [1.0, 2.0, 3.0].map(at).into();
        let joined = strips(LineType::List, points.clone(), &[0, 1, 2, 1], &STILL).unwrap();
        assert_eq!(shape(&joined), [(false, vec![1.0, 2.0, 3.0])]);
        let fails =
            |indices: &[u32]| strips(LineType::List, points.clone(), indices, &STILL).unwrap_err();
        assert!(fails(&[0, 3]).contains("index 3 of a line of 3 points"));
        assert!(fails(&[0, 1, 2]).contains("odd number"));
        let third = fails(&[0, 1, 1, 2, 1, 0]);
        assert!(third.contains("meet at (2, 0.1, 0)") || third.contains("meet at (2, 0.1, -0)"));
    }

    #[test]
    fn a_pose_moves_points_and_an_identity_keeps_them() {
        let pose = Pose {
            position: [10.0, 0.0, 0.0],
            // A quarter turn about z, not normalized.
            rotation: [0.0, 0.0, 3.0, 3.0],
        };
        let moved = strips(
            LineType::Strip,
            vec![[1.0, 0.0, 5.0], [0.0, 2.0, 5.0]],
            &[],
            &pose,
        );
        let points = &moved.unwrap()[0].points;
        for (p, q) in points.iter().zip([[10.0, 1.0, 5.0], [8.0, 0.0, 5.0]]) {
            assert!((0..3).all(|x| (p[x] - q[x]).abs() < 1e-12), "{p:?}");
        }
        let points = vec![[5e-324, -0.0, 1e300]; 2];
        for pose in [STILL, Pose::default()] {
            let kept = &strips(LineType::Strip, points.clone(), &[], &pose).unwrap()[0].points;
            let bits = |p: &[Point]| p.as_flattened().iter().map(|x| x.to_bits()).collect();
            let bits: [Vec<u64>; 2] = [bits(kept), bits(&points)];
            assert_eq!(bits[0], bits[1]);
        }
    }
}
