//! Steps with passages that are known by construction.
//!
//! A strand moves by one vector past another strand at rest. Both are jittered lines, far longer
//! than the vector. Each ends, or returns at a distance from all others. The place and time at
//! which a moving edge meets a resting one follow from a linear equation. It is solved here by
//! Cramer's rule, independently of the code and the method of the ledger.

use crate::curve::vector::{add, cross, dot, mix, norm, per_axis, sub};
use crate::curve::{Basis, CurveSet, Point, Positions};
use crate::random::Random;

/// Kind of the planted passages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Plant {
    /// One closed curve passes through another one, once.
    Single,
    /// One closed curve passes through another one and back.
    Cancelling,
    /// A curve passes through itself.
    SelfCrossing,
    /// A curve passes through another one, and at least one of them is open.
    Open,
}

/// A passage of a planted step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct PlantedPassage {
    pub curves: [u32; 2],
    pub segments: [u32; 2],
    pub fraction: f64,
    pub sign: i32,
    pub point: Point,
}

/// Two frames and all passages between them, in chronological order.
pub(crate) struct PlantedStep {
    pub frames: [CurveSet; 2],
    pub known: Vec<PlantedPassage>,
}

/// Half the length of a strand.
const LENGTH: f64 = 10.0;

/// Returns the points of the moving strand and of the resting one, and of their returns.
fn strands(r: &mut Random, plant: Plant) -> ([Vec<Point>; 2], [Vec<Point>; 2]) {
    let line = |r: &mut Random, from: Point, to: Point, n: usize| -> Vec<Point> {
        (0..=n)
            .map(|k| {
                let t = k as f64 / n as f64;
                let off = r.point(0.04);
                per_axis(|x| (1.0 - t) * from[x] + t * to[x] + off[x])
            })
            .collect()
    };
    // The moving strand is along z, the resting one along x.
    let n = 16 + r.below(60);
    let a = line(r, [0., 0., -LENGTH], [0., 0., LENGTH], n);
    let m = 16 + r.below(60);
    let slope = r.between(-2.0, 2.0);
    let mut b = line(r, [-LENGTH, 0., -slope], [LENGTH, 0., slope], m);
    if plant == Plant::Cancelling {
        // There and back: a finger.
        let gap = r.between(0.4, 0.6);
        b.extend(line(r, [LENGTH, gap, slope], [-LENGTH, gap, -slope], m));
    }
    // The returns are in the planes of no other strand.
    let a_back = vec![
        [0., -3. * LENGTH, 2. * LENGTH],
        [0., -3. * LENGTH, -2. * LENGTH],
    ];
    let b_back = if plant == Plant::Cancelling {
        vec![[-2. * LENGTH, 0.25, -slope]]
    } else {
        vec![
            [2. * LENGTH, 3. * LENGTH, slope],
            [-2. * LENGTH, 3. * LENGTH, -slope],
        ]
    };
    ([a, b], [a_back, b_back])
}

/// Returns a planted step, or `None` if the segments of a passage are ambiguous, because it is too
/// near to a joint or to an end of the step.
pub(crate) fn planted_step(r: &mut Random, basis: Basis, plant: Plant) -> Option<PlantedStep> {
    let ([a, b], [a_back, b_back]) = strands(r, plant);
    let moving = a.len();
    // Past the resting strand, or past both strands of a finger.
    let far = if plant == Plant::Cancelling { 1.6 } else { 0.8 };
    let start = r.between(-0.75, -0.15);
    let by = [r.between(-0.3, 0.3), r.between(far, far + 0.4), 0.0];
    let shifted = |p: Point, t: f64| [p[0] + t * by[0], p[1] + start + t * by[1], p[2]];
    // The points in the middle move. The ends, the return and the other curves do not.
    let moves = |k: usize| k >= moving / 4 && k < 3 * moving / 4;
    let mut curves: Vec<(bool, [Vec<Point>; 2])> = Vec::new();
    let first = [0.0, 1.0].map(|t| -> Vec<Point> {
        a.iter()
            .enumerate()
            .map(|(k, &p)| shifted(p, if moves(k) { t } else { 0.0 }))
            .collect()
    });
    let both = |mut frames: [Vec<Point>; 2], more: &[Point]| {
        frames.iter_mut().for_each(|f| f.extend_from_slice(more));
        frames
    };
    let closed = |r: &mut Random| r.one_in(2);
    match plant {
        Plant::Single | Plant::Cancelling => {
            curves.push((true, both(first, &a_back)));
            curves.push((true, both([b.clone(), b.clone()], &b_back)));
        }
        Plant::Open => {
            let (one, other) = r.pick(&[(false, false), (true, false), (false, true)]);
            let back = |closed: bool, v: &[Point]| if closed { v.to_vec() } else { Vec::new() };
            curves.push((one, both(first, &back(one, &a_back))));
            curves.push((other, both([b.clone(), b.clone()], &back(other, &b_back))));
        }
        Plant::SelfCrossing => {
            // From the end of one strand to the start of the other one, far from both.
            let way = [
                [0., -3. * LENGTH, 2. * LENGTH],
                [-2. * LENGTH, -3. * LENGTH, 0.],
            ];
            let whole = both(both(first, &way), &b);
            let closed = closed(r);
            let back = [
                [2. * LENGTH, 3. * LENGTH, 0.],
                [0., 3. * LENGTH, -2. * LENGTH],
            ];
            curves.push((closed, if closed { both(whole, &back) } else { whole }));
        }
    }
    if basis == Basis::Bezier {
        for (closed, frames) in &mut curves {
            for f in frames {
                *f = bezier(f, *closed);
            }
        }
    }
    // Adds other curves, and chooses order, orientation, first vertex and coordinate axes at
    // random.
    let mut extra = Vec::new();
    for k in 0..r.below(3) {
        let at = [4.0 * LENGTH * (k as f64 + 1.0), 50.0, 50.0];
        let ring: Vec<Point> = (0..12)
            .map(|k| {
                let t = f64::from(k) / 12.0 * std::f64::consts::TAU;
                [at[0] + t.cos(), at[1] + t.sin(), at[2]]
            })
            .collect();
        extra.push((true, [ring.clone(), ring]));
    }
    let at = r.below(extra.len() as u64 + 1) as usize;
    let (left, right) = extra.split_at(at);
    let mut all: Vec<(bool, [Vec<Point>; 2])> = left.to_vec();
    if r.one_in(2) {
        curves.reverse();
    }
    let planted: Vec<u32> = (0..curves.len()).map(|k| (at + k) as u32).collect();
    all.append(&mut curves);
    all.extend_from_slice(right);
    for (closed, frames) in &mut all {
        if r.one_in(2) {
            // Reversal keeps the first point of a Bezier curve.
            frames.iter_mut().for_each(|f| {
                f.reverse();
                if basis == Basis::Bezier && *closed {
                    f.rotate_right(1);
                }
            });
        }
        if *closed {
            let step = if basis == Basis::Bezier { 3 } else { 1 };
            let by = step * r.below((frames[0].len() / step) as u64) as usize;
            frames.iter_mut().for_each(|f| f.rotate_left(by));
        }
    }
    let turn = r.below(3);
    let scale = 2f64.powi(r.below(40) - 20);
    let offset = r.point(20.0);
    let drift = r.point(5.0);
    let place = |mut p: Point, t: f64| {
        p = per_axis(|x| scale * (p[x] + offset[x] + t * drift[x]));
        p.rotate_left(turn);
        p
    };
    let frames = [0, 1].map(|f| {
        let counts: Vec<i32> = all
            .iter()
            .map(|(closed, frames)| {
                let n = frames[0].len() as i32;
                if *closed { -n } else { n }
            })
            .collect();
        let xyz: Vec<f64> = all
            .iter()
            .flat_map(|(_, frames)| frames[f].iter().flat_map(|&p| place(p, f as f64)))
            .collect();
        CurveSet::from_counts(basis, &counts, Positions::F64(&xyz)).unwrap()
    });
    let motions = [by, drift].map(|v| {
        let mut v = v.map(|x| scale * x);
        v.rotate_left(turn);
        v
    });
    let known = solve(&frames, &planted, motions, scale)?;
    Some(PlantedStep { frames, known })
}

/// Returns the points of a curve as Bezier pieces that are straight.
fn bezier(points: &[Point], closed: bool) -> Vec<Point> {
    let n = points.len();
    let mut out = Vec::new();
    for k in 0..if closed { n } else { n - 1 } {
        let (p, q) = (points[k], points[(k + 1) % n]);
        out.extend([p, mix(p, q, 0.3), mix(p, q, 0.7)]);
    }
    if !closed {
        out.push(points[n - 1]);
    }
    out
}

/// Number of parts of a spline segment whose chords are tested for passages.
const FINE: usize = 16;

/// Returns all passages of the parts that move by `step` through the parts at rest, while all parts
/// drift.
fn solve(
    frames: &[CurveSet; 2],
    planted: &[u32],
    [step, drift]: [Point; 2],
    scale: f64,
) -> Option<Vec<PlantedPassage>> {
    let fine = if frames[0].basis().is_polyline() {
        1
    } else {
        FINE
    };
    struct Fine {
        curve: u32,
        segment: u32,
        at: [f64; 2],
        before: [Point; 2],
        motions: [Point; 2],
    }
    let mut parts: Vec<Fine> = Vec::new();
    for &i in planted {
        for s in 0..frames[0].curve(i as usize).segments as usize {
            for k in 0..fine {
                let at = [k, k + 1].map(|k| k as f64 / fine as f64);
                let [p, q] = frames
                    .each_ref()
                    .map(|set| at.map(|t| set.eval(i as usize, s, t)));
                parts.push(Fine {
                    curve: i,
                    segment: s as u32,
                    at,
                    before: p,
                    motions: [0, 1].map(|e| sub(q[e], p[e])),
                });
            }
        }
    }
    let all_by = |p: &Fine, v: Point| {
        let off = p.motions.map(|m| norm(sub(sub(m, drift), v)));
        off[0].max(off[1]) < 1e-6 * scale
    };
    let (moving, resting): (Vec<&Fine>, Vec<&Fine>) = (
        parts.iter().filter(|p| all_by(p, step)).collect(),
        parts.iter().filter(|p| all_by(p, [0.0; 3])).collect(),
    );
    let mut known = Vec::new();
    let bounds = |points: &[Point]| {
        let least = |x: usize| points.iter().fold(f64::MAX, |m, p| m.min(p[x]));
        let most = |x: usize| points.iter().fold(f64::MIN, |m, p| m.max(p[x]));
        (per_axis(least), per_axis(most))
    };
    let resting: Vec<_> = resting.iter().map(|q| (q, bounds(&q.before))).collect();
    for p in moving {
        let ends = p.before.map(|p| [p, add(p, step)]);
        let (lo, hi) = bounds(ends.as_flattened());
        for (q, (from, to)) in &resting {
            if (0..3).any(|x| hi[x] < from[x] || to[x] < lo[x]) {
                continue;
            }
            // p0 + s d + t v = q0 + u e
            let (d, e) = (sub(p.before[1], p.before[0]), sub(q.before[1], q.before[0]));
            let r = sub(q.before[0], p.before[0]);
            let de = cross(d, e);
            let volume = dot(step, de);
            if volume == 0.0 {
                continue;
            }
            let t = dot(r, de) / volume;
            let rest = per_axis(|x| r[x] - t * step[x]);
            let area = dot(de, de);
            let s = dot(cross(rest, e), de) / area;
            let u = dot(cross(rest, d), de) / area;
            let inside = |x: f64| (0.0..1.0).contains(&x);
            if !(inside(s) && inside(u) && inside(t)) {
                continue;
            }
            // The volume of `p0, p1, q0, q1` is `(d x e) . (q0 - p0)`, minus `t` times that of the
            // motion.
            let sign = if volume > 0.0 { 1 } else { -1 };
            let along = [
                p.at[0] + s * (p.at[1] - p.at[0]),
                q.at[0] + u * (q.at[1] - q.at[0]),
            ];
            let ok = |x: f64| (0.03..0.97).contains(&x);
            if !ok(along[0]) || !ok(along[1]) || !ok(t) {
                return None;
            }
            let point = per_axis(|x| p.before[0][x] + s * d[x] + t * (step[x] + drift[x]));
            let (mut curves, mut segments) = ([p.curve, q.curve], [p.segment, q.segment]);
            if (curves[0], segments[0]) > (curves[1], segments[1]) {
                curves.reverse();
                segments.reverse();
            }
            known.push(PlantedPassage {
                curves,
                segments,
                fraction: t,
                sign,
                point,
            });
        }
    }
    known.sort_by(|a: &PlantedPassage, b: &PlantedPassage| a.fraction.total_cmp(&b.fraction));
    Some(known)
}
