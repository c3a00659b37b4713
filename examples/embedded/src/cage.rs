//! A cage of tetrahedra that deforms a model embedded in it.
//!
//! # Method
//!
//! Position-based dynamics without inertia: in each pass, every edge is brought to its length,
//! every tetrahedron towards its volume, and every node out of the ball, in turn. Control points
//! keep their barycentric coordinates in their tetrahedra.

use linkwatch::CurveSet;
use sidecar::Scene;

type Point = [f64; 3];

/// Cells of the cage along its longest side.
const CELLS: f64 = 8.0;

/// Passes over all constraints in a frame.
const PASSES: usize = 60;

/// Radius of the ball, in shares of the longest side.
const RADIUS: f64 = 0.25;

/// Frames of the motion.
pub const FRAMES: usize = 60;

fn add(a: Point, t: f64, b: Point) -> Point {
    [0, 1, 2].map(|x| a[x] + t * b[x])
}

fn sub(a: Point, b: Point) -> Point {
    add(a, -1.0, b)
}

fn dot(a: Point, b: Point) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: Point, b: Point) -> Point {
    [0, 1, 2].map(|x| a[(x + 1) % 3] * b[(x + 2) % 3] - a[(x + 2) % 3] * b[(x + 1) % 3])
}

/// A lattice of cubes around a model, each cut into six tetrahedra along its diagonal.
#[derive(Clone)]
pub struct Cage {
    points: Vec<Point>,
    /// True for the upper side of the cage, which does not move.
    held: Vec<bool>,
    /// Ends and length of each edge.
    edges: Vec<([usize; 2], f64)>,
    /// Corners, and six times the volume.
    tetrahedra: Vec<([usize; 4], f64)>,
    /// Tetrahedron and barycentric coordinates of each control point.
    anchors: Vec<([usize; 4], [f64; 4])>,
    /// Axis along which the ball moves, its first centre and its radius.
    up: usize,
    ball: (Point, f64),
    thickness: f64,
    /// Depth of the ball after the last frame, in shares of the thickness, and share of the motion
    /// that is done.
    depth: f64,
    done: f64,
}

impl Cage {
    /// Builds a cage around a model, which a ball will press to a depth, in shares of the thickness
    /// of the cage.
    pub fn around(model: &CurveSet, depth: f64) -> Cage {
        let points = points_of(model);
        let low = [0, 1, 2].map(|x| points.iter().map(|p| p[x]).fold(f64::INFINITY, f64::min));
        let high = [0, 1, 2].map(|x| points.iter().map(|p| p[x]).fold(-f64::INFINITY, f64::max));
        let size = (0..3)
            .map(|x| high[x] - low[x])
            .fold(f64::MIN_POSITIVE, f64::max);
        // A single layer along the thinnest axis, from which the ball comes.
        let thin = (0..3).min_by(|&a, &b| (high[a] - low[a]).total_cmp(&(high[b] - low[b])));
        let up = thin.unwrap_or(2);
        // A margin, so that every point is inside.
        let margin = 0.01 * size;
        let origin = low.map(|x| x - margin);
        let side = [0, 1, 2].map(|x| high[x] - low[x] + 2.0 * margin);
        let cells = [0, 1, 2].map(|x| match x == up {
            true => 1,
            false => (CELLS * side[x] / size).round().max(1.0) as usize,
        });
        let cell = [0, 1, 2].map(|x| side[x] / cells[x] as f64);
        let index = |c: [usize; 3]| c[0] + (cells[0] + 1) * (c[1] + (cells[1] + 1) * c[2]);
        // Corners of the tetrahedron in which the coordinates within a cube have this order.
        let corners = |at: [usize; 3], order: [usize; 3]| {
            let mut at = at;
            let mut corners = [index(at); 4];
            for (k, axis) in order.into_iter().enumerate() {
                at[axis] += 1;
                corners[k + 1] = index(at);
            }
            corners
        };
        let anchors = points.iter().map(|p| {
            let local = [0, 1, 2].map(|x| (p[x] - origin[x]) / cell[x]);
            let at = [0, 1, 2].map(|x| (local[x] as usize).min(cells[x] - 1));
            let share = [0, 1, 2].map(|x| local[x] - at[x] as f64);
            let mut order = [0, 1, 2];
            order.sort_by(|&a, &b| share[b].total_cmp(&share[a]));
            let [a, b, c] = order.map(|x| share[x]);
            (corners(at, order), [1.0 - a, a - b, b - c, c])
        });
        let anchors = anchors.collect();
        let mut nodes = Vec::new();
        let mut tetrahedra = Vec::new();
        for z in 0..=cells[2] {
            for y in 0..=cells[1] {
                for x in 0..=cells[0] {
                    let at = [x, y, z];
                    nodes.push([0, 1, 2].map(|k| origin[k] + at[k] as f64 * cell[k]));
                    if (0..3).all(|k| at[k] < cells[k]) {
                        let orders = [
                            [0, 1, 2],
                            [1, 2, 0],
                            [2, 0, 1],
                            [0, 2, 1],
                            [2, 1, 0],
                            [1, 0, 2],
                        ];
                        tetrahedra.extend(orders.map(|order| corners(at, order)));
                    }
                }
            }
        }
        let pairs = |t: &[usize; 4]| {
            let t = *t;
            (0..4).flat_map(move |i| (0..i).map(move |j| [t[i].min(t[j]), t[i].max(t[j])]))
        };
        let mut edges: Vec<[usize; 2]> = tetrahedra.iter().flat_map(pairs).collect();
        edges.sort_unstable();
        edges.dedup();
        let length = |[i, j]: [usize; 2]| {
            let d = sub(nodes[j], nodes[i]);
            ([i, j], dot(d, d).sqrt())
        };
        let mut centre = [0, 1, 2].map(|x| 0.5 * (low[x] + high[x]));
        centre[up] = origin[up] - RADIUS * size;
        let middle = origin[up] + 0.5 * side[up];
        Cage {
            held: nodes.iter().map(|p| p[up] > middle).collect(),
            edges: edges.into_iter().map(length).collect(),
            tetrahedra: tetrahedra
                .iter()
                .map(|t| (*t, volume(&nodes, *t)))
                .collect(),
            points: nodes,
            anchors,
            up,
            ball: (centre, RADIUS * size),
            thickness: side[up],
            depth,
            done: 0.0,
        }
    }

    /// Moves a node, unless it is held.
    fn shift(&mut self, k: usize, t: f64, by: Point) {
        if !self.held[k] {
            self.points[k] = add(self.points[k], t, by);
        }
    }

    /// Moves the ball to its place, and the nodes to where edges, volumes and the ball want them.
    fn press(&mut self) {
        let (mut centre, radius) = self.ball;
        centre[self.up] += self.done * self.depth * self.thickness;
        for _ in 0..PASSES {
            for k in 0..self.edges.len() {
                let ([i, j], length) = self.edges[k];
                let d = sub(self.points[j], self.points[i]);
                let now = dot(d, d).sqrt().max(f64::MIN_POSITIVE);
                let share = 0.5 * (now - length) / now;
                self.shift(i, share, d);
                self.shift(j, -share, d);
            }
            for k in 0..self.tetrahedra.len() {
                let (corners, rest) = self.tetrahedra[k];
                let [a, b, c, d] = corners.map(|k| self.points[k]);
                let (u, v, w) = (sub(b, a), sub(c, a), sub(d, a));
                let of = [cross(v, w), cross(w, u), cross(u, v)];
                let first = of.iter().fold([0.0; 3], |sum, g| sub(sum, *g));
                let slopes = [first, of[0], of[1], of[2]];
                let sum: f64 = slopes.iter().map(|g| dot(*g, *g)).sum();
                let share = 0.2 * (rest - dot(u, of[0])) / sum.max(f64::MIN_POSITIVE);
                for (k, slope) in corners.into_iter().zip(slopes) {
                    self.shift(k, share, slope);
                }
            }
            for k in 0..self.points.len() {
                let d = sub(self.points[k], centre);
                let far = dot(d, d).sqrt();
                if far < radius {
                    self.shift(k, radius / far.max(f64::MIN_POSITIVE) - 1.0, d);
                }
            }
        }
    }

    /// Returns the number of tetrahedra that are turned inside out.
    pub fn inverted(&self) -> usize {
        let turned = |(t, rest): &&([usize; 4], f64)| volume(&self.points, *t) * rest <= 0.0;
        self.tetrahedra.iter().filter(turned).count()
    }
}

impl Scene for Cage {
    fn advance(&mut self, steps: usize) {
        for _ in 0..steps {
            self.done += 1.0 / ((FRAMES - 1) * steps) as f64;
            self.press();
        }
    }

    /// Writes the control points of the model.
    fn write_positions(&self, out: &mut [f32]) {
        for ((corners, weights), out) in self.anchors.iter().zip(out.chunks_exact_mut(3)) {
            let corners = corners.iter().zip(weights);
            let point = corners.fold([0.0; 3], |sum, (k, w)| add(sum, *w, self.points[*k]));
            out.copy_from_slice(&point.map(|x| x as f32));
        }
    }
}

/// Returns six times the volume of a tetrahedron, with its sign.
fn volume(points: &[Point], corners: [usize; 4]) -> f64 {
    let [a, b, c, d] = corners.map(|k| points[k]);
    dot(sub(b, a), cross(sub(c, a), sub(d, a)))
}

/// Returns the control points of a model.
pub fn points_of(model: &CurveSet) -> Vec<Point> {
    let curves = model.curves().iter().enumerate();
    let points = curves.flat_map(|(i, c)| (0..c.points as usize).map(move |k| model.point(i, k)));
    points.collect()
}
