//! Embedded deformation (Qu & James 2021, section 4.3.3): a ball presses into a coarse cage of
//! tetrahedra, which takes a yarn model with it. Is the yarn still the same topology?
//!
//! Every control point keeps its barycentric coordinates in its tetrahedron. A tetrahedron that is
//! turned inside out takes yarns through one another. To look for those is not enough: splines do
//! not follow the kinks between tetrahedra exactly, so that yarns may pass through one another
//! before the first one is turned.
//!
//! ```sh
//! cargo run --release --example embedded                        # a quarter of its thickness:
//! intact cargo run --release --example embedded -- --depth 1.5         # through the whole cage:
//! changed cargo run --release --example embedded -- --model glove.bcc --out frames
//! linkwatch check frames --events                               # the same verdict, from files
//! ```
//!
//! The exit code is that of `linkwatch check`: 0 intact, 1 changed, 2 bad arguments, 3 undecided.

use linkwatch::scenes::Scene;
use linkwatch::{
    Basis, CurveSet, Events, Positions, Strategy, Verdict, Verifier, VerifierOptions, model,
};
use std::path::PathBuf;
use std::process::ExitCode;

type Point = [f64; 3];

/// Cells of the cage along its longest side, and frames of the motion.
const CELLS: f64 = 8.0;
const FRAMES: u64 = 60;
/// Passes over all constraints in a frame.
const PASSES: usize = 60;
/// Depth in shares of the thickness of the cage to which the ball presses, and the radius of the
/// ball in shares of the longest side.
const GENTLE: f64 = 0.25;
const RADIUS: f64 = 0.25;

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
struct Cage {
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
}

impl Cage {
    fn around(model: &CurveSet) -> Cage {
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
        }
    }

    /// Moves a node, unless it is held.
    fn shift(&mut self, k: usize, t: f64, by: Point) {
        if !self.held[k] {
            self.points[k] = add(self.points[k], t, by);
        }
    }

    /// Moves the ball to a depth, and the nodes to where edges, volumes and the ball want them:
    /// each constraint in turn moves its own nodes (position-based dynamics, without inertia).
    fn press(&mut self, depth: f64) {
        let (mut centre, radius) = self.ball;
        centre[self.up] += depth * self.thickness;
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
    fn inverted(&self) -> usize {
        let turned = |(t, rest): &&([usize; 4], f64)| volume(&self.points, *t) * rest <= 0.0;
        self.tetrahedra.iter().filter(turned).count()
    }

    /// Returns the coordinates of the control points.
    fn embedded(&self) -> Vec<f32> {
        let place = |(corners, weights): &([usize; 4], [f64; 4])| {
            let corners = corners.iter().zip(weights);
            corners.fold([0.0; 3], |sum, (k, w)| add(sum, *w, self.points[*k]))
        };
        self.anchors
            .iter()
            .flat_map(place)
            .map(|x| x as f32)
            .collect()
    }
}

/// Returns six times the volume of a tetrahedron, with its sign.
fn volume(points: &[Point], corners: [usize; 4]) -> f64 {
    let [a, b, c, d] = corners.map(|k| points[k]);
    dot(sub(b, a), cross(sub(c, a), sub(d, a)))
}

fn points_of(model: &CurveSet) -> Vec<Point> {
    let curves = model.curves().iter().enumerate();
    let points = curves.flat_map(|(i, c)| (0..c.points as usize).map(move |k| model.point(i, k)));
    points.collect()
}

/// The run: frames, and what was found in them.
#[derive(Debug, Default)]
struct Found {
    /// The first frame with this verdict.
    changed: Option<u64>,
    undecided: Option<u64>,
    /// The first frame with a tetrahedron that is turned inside out.
    inverted: Option<u64>,
    pull_throughs: usize,
    links: usize,
}

/// Presses the ball into a model, to a depth in shares of its thickness, and verifies each frame.
fn animate(
    model: &CurveSet,
    depth: f64,
    mut keep: impl FnMut(u64, &CurveSet) -> linkwatch::Result<()>,
) -> linkwatch::Result<Found> {
    let counts: Vec<i32> = model.counts().collect();
    let basis: Basis = model.basis();
    let mut cage = Cage::around(model);
    let mut verifier = Verifier::new(VerifierOptions {
        events: Events::Between,
        strategy: Strategy::Incremental,
        ..VerifierOptions::default()
    })?;
    let mut found = Found::default();
    for frame in 0..FRAMES {
        cage.press(depth * frame as f64 / (FRAMES - 1) as f64);
        let xyz = cage.embedded();
        let curves = CurveSet::from_counts(basis, &counts, Positions::F32(&xyz))?;
        let report = verifier.step(frame, frame as f64 / 30.0, &curves)?;
        let inverted = cage.inverted();
        if inverted > 0 && found.inverted.is_none() {
            println!("frame {frame}: {inverted} tetrahedra are turned inside out");
            found.inverted = Some(frame);
        }
        found.pull_throughs += report.events.len();
        found.links = found.links.max(report.changes.len());
        match report.verdict {
            Verdict::Intact => {}
            Verdict::Changed if found.changed.is_none() => {
                println!("{}", report.headline());
                report
                    .findings()
                    .take(3)
                    .for_each(|finding| println!("  {finding}"));
                found.changed = Some(frame);
            }
            Verdict::Changed => {}
            _ if found.undecided.is_none() => {
                println!("{}", report.headline());
                found.undecided = Some(frame);
            }
            _ => {}
        }
        keep(frame, &curves)?;
    }
    Ok(found)
}

/// Returns the value of an option.
fn option(args: &[String], name: &str) -> Option<String> {
    let at = args.iter().position(|a| a == name)?;
    args.get(at + 1).cloned()
}

fn run() -> Result<Found, Box<dyn std::error::Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let model = match option(&args, "--model") {
        Some(path) => model::read(path.as_ref())?,
        None => {
            let knit: Scene = "knit:rows=40,stitches=32,segments=12800".parse()?;
            knit.build()?.curves
        }
    };
    let depth: f64 = option(&args, "--depth").map_or(Ok(GENTLE), |d| d.parse())?;
    let out = option(&args, "--out").map(PathBuf::from);
    if let Some(folder) = &out {
        std::fs::create_dir(folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    }
    let found = animate(&model, depth, |frame, curves| match &out {
        Some(folder) => model::write_bcc(&folder.join(format!("frame-{frame:03}.bcc")), curves),
        None => Ok(()),
    })?;
    let verdict = match (found.changed, found.undecided) {
        (Some(frame), _) => format!(
            "changed from frame {frame} on: {} pull-throughs, up to {} changed links",
            found.pull_throughs, found.links
        ),
        (None, Some(frame)) => format!("undecided from frame {frame} on"),
        (None, None) => "intact".to_owned(),
    };
    println!(
        "{FRAMES} frames of {} control points: {verdict}",
        model.points()
    );
    Ok(found)
}

fn main() -> ExitCode {
    match run() {
        Ok(found) if found.changed.is_some() => ExitCode::from(1),
        Ok(found) if found.undecided.is_some() => ExitCode::from(3),
        Ok(_) => ExitCode::SUCCESS,
        Err(e) => {
            eprintln!("error: {e}");
            ExitCode::from(2)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn knit() -> CurveSet {
        let knit: Scene = "knit:rows=20,stitches=16,segments=2560".parse().unwrap();
        knit.build().unwrap().curves
    }

    #[test]
    fn a_gentle_press_keeps_the_topology() {
        let found = animate(&knit(), GENTLE, |_, _| Ok(())).unwrap();
        assert_eq!(
            (found.inverted, found.changed, found.undecided),
            (None, None, None)
        );
    }

    #[test]
    fn a_press_through_the_cage_turns_tetrahedra_inside_out_and_breaks_the_yarn() {
        let found = animate(&knit(), 1.5, |_, _| Ok(())).unwrap();
        assert!(
            found.inverted.is_some() && found.changed.is_some(),
            "{found:?}"
        );
        assert!(found.pull_throughs > 0, "{found:?}");
    }

    #[test]
    fn an_undeformed_cage_keeps_every_point() {
        let knit = knit();
        let cage = Cage::around(&knit);
        assert_eq!(cage.inverted(), 0);
        let xyz = cage.embedded();
        for (p, q) in points_of(&knit).iter().zip(xyz.chunks(3)) {
            assert!(
                (0..3).all(|x| (p[x] - f64::from(q[x])).abs() < 1e-4),
                "{p:?}, {q:?}"
            );
        }
    }
}
