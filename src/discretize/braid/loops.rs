//! The loops of a frame, and the check of its end volumes.

use super::end::End;
use super::pose::{Pose, mean};
use super::volume::Piece;
use super::{Braid, Braids, auto};
use crate::curve::vector::per_axis;
use crate::curve::{AXES, Basis, CurveSet, Notation, Point, Positions, Shape, bounds, count_of};
use crate::error::{Error, Result};
use crate::pairs::LoopPairs;
use nalgebra::Vector3;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Rounding errors of local coordinates, relative to the largest coordinate. A rotation and a
/// translation round each coordinate by less than 2e-15 of it; the rotation itself is orthogonal
/// within 1e-14.
const ROUNDING: f64 = 1e-12;

/// Sides of a braid, for messages.
const SIDES: [&str; 2] = ["left", "right"];

/// Virtual closed loops of the braids of a scene, from frame to frame.
#[derive(Debug)]
pub struct BraidLoops {
    braids: Vec<Resolved>,
    pairs: Arc<LoopPairs>,
    /// Braid of the first curve of each loop, and its place there.
    places: Vec<(usize, usize)>,
    /// Curves of the first frame.
    shape: Shape,
    /// The curves of the first frame, followed by its loops. These loops are used in frames that
    /// break a condition.
    first: CurveSet,
}

/// A braid with its ends.
#[derive(Clone, Debug)]
struct Resolved {
    curves: Vec<u32>,
    reversed: Vec<bool>,
    ends: [End; 2],
}

/// Returns the points of the left and of the right end of a braid.
fn end_points(set: &CurveSet, curves: &[u32], reversed: &[bool]) -> [Vec<Vector3<f64>>; 2] {
    [false, true].map(|right| {
        let both = curves.iter().zip(reversed);
        both.map(|(&i, &reversed)| {
            let i = i as usize;
            let last = set.curve(i).segments as usize;
            set.knot(i, if reversed == right { 0 } else { last }).into()
        })
        .collect()
    })
}

impl BraidLoops {
    /// Prepares the braids of a scene, whose first frame is `set`.
    ///
    /// # Errors
    ///
    /// [`Error::Braid`] if the braids do not fit the frame, or the frame breaks one of
    /// their conditions: an end that is not rigid, a curve in an end volume, volumes that overlap.
    pub fn new(braids: &Braids, set: &CurveSet) -> Result<BraidLoops> {
        let found;
        let given = match braids {
            Braids::Auto => {
                found = auto::find(set)?;
                &found
            }
            Braids::Given(given) => given,
        };
        let mut found = BTreeMap::new();
        for (b, braid) in given.iter().enumerate() {
            check(b, braid, set, &mut found).map_err(Error::Braid)?;
        }
        let found = found
            .into_iter()
            .map(|(i, (after, place))| ([i, after], place));
        let (pairs, places) = found.unzip();
        let mut loops = BraidLoops {
            braids: Vec::new(),
            pairs: Arc::new(LoopPairs {
                closed: set.curves().iter().map(|c| c.closed).collect(),
                loops: pairs,
            }),
            places,
            shape: set.shape(),
            // Replaced below, once the ends of the loops are known.
            first: set.clone(),
        };
        for (b, braid) in given.iter().enumerate() {
            let resolved = loops.resolve(b, braid, set).map_err(Error::Braid)?;
            loops.braids.push(resolved);
        }
        let poses = loops.poses(set).map_err(Error::Braid)?;
        let mut all = Vec::new();
        let mut sizes = write_curves(set, &mut all);
        sizes.extend(loops.write_loops(set, &poses, &mut all));
        let closed = loops.pairs.closed.iter().chain(std::iter::repeat(&true));
        let counts = sizes.into_iter().zip(closed);
        let counts = counts.map(|(points, closed)| count_of(points, *closed));
        let counts = counts.collect::<Result<Vec<i32>>>()?;
        let basis = match set.basis().is_polyline() {
            true => Basis::Polyline,
            false => Basis::Bezier,
        };
        loops.first = CurveSet::from_counts(basis, &counts, Positions::F64(&all))?;
        Ok(loops)
    }

    /// Finds the ends of a braid such that no curve of the first frame is in their volumes.
    fn resolve(&self, b: usize, braid: &Braid, set: &CurveSet) -> Result<Resolved, String> {
        let reversed = braid.curves.iter().map(|i| braid.reversed.contains(i));
        let reversed: Vec<bool> = reversed.collect();
        let points = end_points(set, &braid.curves, &reversed);
        let given = [&braid.left, &braid.right];
        let references = [0, 1].map(|side| match given[side].points.is_empty() {
            true => points[side].clone(),
            false => given[side].points.iter().map(|p| (*p).into()).collect(),
        });
        let middles = references.each_ref().map(|points| mean(points));
        let now = points.each_ref().map(|points| mean(points));
        let end = |side: usize| {
            let name = format!("the {} end of braid {b}", SIDES[side]);
            let reference = super::End {
                points: references[side].iter().map(|p| (*p).into()).collect(),
                ..given[side].clone()
            };
            let numbers = reference.points.iter().flatten();
            let largest = numbers.fold(set.max_abs(), |a, x| a.max(x.abs()));
            let candidates = End::candidates(&reference, middles[1 - side], largest);
            let candidates = candidates.map_err(|why| format!("{name}: {why}"))?;
            let mut why = None;
            let fits = candidates.into_iter().find(|end| {
                let (ends, other) = (&points[side], now[1 - side]);
                let placed = self.place(set, end, &braid.curves, ends, other, &name);
                placed.map_err(|e| why.get_or_insert(e)).is_ok()
            });
            fits.ok_or_else(|| why.unwrap_or_default())
        };
        Ok(Resolved {
            curves: braid.curves.clone(),
            ends: [end(0)?, end(1)?],
            reversed,
        })
    }

    /// Returns a bound of the rounding errors in a frame.
    fn slack(set: &CurveSet) -> f64 {
        ROUNDING * set.max_abs()
    }

    /// Returns the pose of an end, given its points and the middle of the other end, or an error
    /// that names the violated condition: the end must have a pose, and its volume must contain no
    /// curve, except each curve of the braid in the tube of its own stub.
    fn place(
        &self,
        set: &CurveSet,
        end: &End,
        curves: &[u32],
        points: &[Vector3<f64>],
        other: Vector3<f64>,
        name: &str,
    ) -> Result<Pose, String> {
        let pose = end.pose(points, other, curves);
        let pose = pose.map_err(|why| format!("{name} {why}"))?;
        let slack = Self::slack(set);
        let around: Vec<Piece> = end.pieces().map(|p| p.bounds(pose, slack)).collect();
        let mut all = around[0];
        for b in &around {
            all.lo = all.lo.inf(&b.lo);
            all.hi = all.hi.sup(&b.hi);
        }
        for i in 0..set.len() {
            let [lo, hi] = set.bounds_along(i, &AXES).map(Vector3::from);
            let by = set.basis().overshoot() * (hi - lo) + Vector3::repeat(slack);
            let coarse = Piece {
                lo: lo - by,
                hi: hi + by,
            };
            let counts = || set.curve(i).closed || self.find(i as u32).is_some();
            if !coarse.overlaps(&all) || !counts() {
                continue;
            }
            for s in 0..set.curve(i).segments as usize {
                let segment = set.segment(i, s);
                let [lo, hi] = bounds(segment).map(Vector3::from);
                let hull = Piece { lo, hi };
                if !hull.overlaps(&all) {
                    continue;
                }
                let pieces = end.pieces().zip(&around).enumerate();
                for (k, (piece, bounds)) in pieces {
                    let own = k > 0 && curves[k - 1] as usize == i;
                    if own || !hull.overlaps(bounds) {
                        continue;
                    }
                    if let Some(place) = piece.entered_by(pose, &segment, slack) {
                        let place = Notation::of_scene(0.0, place).point(place);
                        return Err(format!(
                            "curve {i} enters the volume of {name}, at {place}, segment {s}"
                        ));
                    }
                }
            }
        }
        Ok(pose)
    }

    /// Returns the poses of both ends of each braid, or which condition the frame breaks.
    fn poses(&self, set: &CurveSet) -> Result<Vec<[Pose; 2]>, String> {
        let mut poses = Vec::with_capacity(self.braids.len());
        for (b, braid) in self.braids.iter().enumerate() {
            let points = end_points(set, &braid.curves, &braid.reversed);
            let middles = points.each_ref().map(|points| mean(points));
            let pose = |side: usize| {
                let name = format!("the {} end of braid {b}", SIDES[side]);
                let (end, other) = (&braid.ends[side], middles[1 - side]);
                self.place(set, end, &braid.curves, &points[side], other, &name)
            };
            poses.push([pose(0)?, pose(1)?]);
        }
        self.check_overlap(set, &poses)?;
        Ok(poses)
    }

    /// Checks that the volumes of different ends do not overlap.
    fn check_overlap(&self, set: &CurveSet, poses: &[[Pose; 2]]) -> Result<(), String> {
        let slack = Self::slack(set);
        let mut ends = Vec::new();
        for (b, (braid, poses)) in self.braids.iter().zip(poses).enumerate() {
            for side in [0, 1] {
                let pose = poses[side];
                let pieces = braid.ends[side].pieces();
                let bounded: Vec<_> = pieces.map(|p| (p, p.bounds(pose, slack))).collect();
                ends.push(((b, SIDES[side]), pose, bounded));
            }
        }
        for (k, (name, pose, pieces)) in ends.iter().enumerate() {
            for (other_name, at, others) in &ends[..k] {
                let meet = pieces.iter().any(|(p, bounds)| {
                    let mut near = others.iter().filter(|(_, other)| bounds.overlaps(other));
                    near.any(|(q, _)| p.meets_piece(*pose, q, *at, slack))
                });
                if meet {
                    return Err(format!(
                        "the volumes of the {} end of braid {} and the {} end of braid {} overlap",
                        other_name.1, other_name.0, name.1, name.0
                    ));
                }
            }
        }
        Ok(())
    }

    /// Returns the braids with everything that was found in the first frame, so that other runs
    /// close them in the same way.
    pub fn braids(&self) -> Braids {
        let braid = |b: &Resolved| Braid {
            curves: b.curves.clone(),
            reversed: {
                let both = b.curves.iter().zip(&b.reversed);
                both.filter(|(_, r)| **r).map(|(i, _)| *i).collect()
            },
            left: b.ends[0].given.clone(),
            right: b.ends[1].given.clone(),
        };
        Braids::Given(self.braids.iter().map(braid).collect())
    }

    /// Returns the curves of a frame with loops in place of the curves of braids. The loop of a
    /// curve and the next one of its braid has the index of the first one. Closed curves, and open
    /// curves of no braid, stay the same.
    ///
    /// # Errors
    ///
    /// [`Error::Braid`] if the frame breaks a condition of the braids; [`Error::Usage`] if
    /// it has other curves than the first one.
    pub fn close(&self, set: &CurveSet) -> Result<CurveSet> {
        if self.shape != set.shape() {
            let what = "braids: the frame has other curves than the first one";
            return Err(Error::Usage(what.into()));
        }
        let mut all = None;
        let broken = self.write(set, &mut all)?;
        match (broken, all) {
            (None, Some(all)) => {
                let closed = (0..set.len() as u32).map(|i| self.number(i).unwrap_or(i));
                Ok(all.subset(&closed.collect::<Vec<u32>>()))
            }
            (broken, _) => Err(Error::Braid(broken.unwrap_or_default())),
        }
    }

    /// Writes the curves of a frame, and after them its loops, into `out`: the set of an earlier
    /// frame, or nothing. If the frame breaks a condition of the braids, the loops are those of the
    /// first frame. Returns this condition as text. The frame has the curves of the first one.
    ///
    /// # Errors
    ///
    /// A coordinate is too large.
    pub(crate) fn write(
        &self,
        set: &CurveSet,
        out: &mut Option<CurveSet>,
    ) -> Result<Option<String>> {
        let poses = self.poses(set);
        let out = out.get_or_insert_with(|| self.first.clone());
        out.update_with(|positions| {
            write_curves(set, positions);
            match &poses {
                Ok(poses) => drop(self.write_loops(set, poses, positions)),
                Err(_) => {
                    let loops = set.len()..self.first.len();
                    positions.extend(loops.flat_map(|i| self.first.points_in(i)).flatten());
                }
            }
        })?;
        Ok(poses.err())
    }

    /// Appends the points of all loops. Returns the number of points of each.
    fn write_loops(
        &self,
        set: &CurveSet,
        poses: &[[Pose; 2]],
        positions: &mut Vec<f64>,
    ) -> Vec<usize> {
        let loops = self.pairs.loops.iter().zip(&self.places);
        let write = |(&[i, after], &(b, k)): (&[u32; 2], &(usize, usize))| {
            let braid = &self.braids[b];
            let [(left, at_left), (right, at_right)] =
                [0, 1].map(|side| (&braid.ends[side], poses[b][side]));
            let mut pen = Pen::new(set, positions);
            pen.curve(i as usize, braid.reversed[k]);
            right.connection(at_right, k).for_each(|p| pen.vertex(p));
            let backward = !braid.reversed[(k + 1) % braid.curves.len()];
            pen.curve(after as usize, backward);
            left.connection(at_left, k)
                .rev()
                .for_each(|p| pen.vertex(p));
            pen.close()
        };
        loops.map(write).collect()
    }

    /// Returns the pairs that are verified among the curves of a frame and its loops.
    pub(crate) fn pairs(&self) -> &Arc<LoopPairs> {
        &self.pairs
    }

    /// Returns the number of the loop of a curve among the curves of a frame and its loops, if it
    /// is in a braid.
    pub(crate) fn number(&self, curve: u32) -> Option<u32> {
        Some((self.pairs.closed.len() + self.find(curve)?) as u32)
    }

    /// Returns the number of the loop of a curve among the loops.
    fn find(&self, curve: u32) -> Option<usize> {
        let loops = &self.pairs.loops;
        loops.binary_search_by_key(&curve, |pair| pair[0]).ok()
    }

    /// Returns the curve and the segment of a segment of the loop of a curve, or `None` on a
    /// virtual connection.
    pub(crate) fn origin(&self, set: &CurveSet, [i, j]: [u32; 2], s: u32) -> Option<[u32; 2]> {
        let (b, k) = self.places[self.find(i)?];
        let braid = &self.braids[b];
        let segments = |i: u32| set.curve(i as usize).segments;
        let real = |i: u32, s: u32, backward: bool| match backward {
            true => [i, segments(i) - 1 - s],
            false => [i, s],
        };
        if s < segments(i) {
            return Some(real(i, s, braid.reversed[k]));
        }
        let start = segments(i) + braid.ends[1].connection_len(k) as u32 + 1;
        let s = s.checked_sub(start).filter(|&s| s < segments(j))?;
        Some(real(j, s, !braid.reversed[(k + 1) % braid.curves.len()]))
    }
}

/// For the first curve of each loop, the second one, the braid, and the place of the loop there.
type Found = BTreeMap<u32, (u32, (usize, usize))>;

/// Checks a braid, and records its loops.
fn check(b: usize, braid: &Braid, set: &CurveSet, found: &mut Found) -> Result<(), String> {
    let fail = |what: String| Err(format!("braid {b} {what}"));
    let (curves, n) = (&braid.curves, braid.curves.len());
    if n < 4 {
        return fail(format!(
            "has {n} curves {curves:?}, a braid needs at least 4"
        ));
    }
    for (k, &i) in curves.iter().enumerate() {
        let Some(curve) = set.curves().get(i as usize) else {
            let n = set.len();
            return fail(format!("names curve {i}, but the frame has {n} curves"));
        };
        if curve.closed {
            return fail(format!("names curve {i}, which is closed"));
        }
        if found.insert(i, (curves[(k + 1) % n], (b, k))).is_some() {
            return fail(format!("names curve {i}, which is named twice"));
        }
    }
    if let Some(i) = braid.reversed.iter().find(|i| !curves.contains(i)) {
        return fail(format!("lists curve {i} as reversed, but does not have it"));
    }
    for (side, end) in SIDES.iter().zip([&braid.left, &braid.right]) {
        let points = end.points.len();
        if points != 0 && points != n {
            return fail(format!(
                "has {n} curves, but {points} points of its {side} end"
            ));
        }
        let mut numbers = end.points.iter().chain(&end.outward).flatten();
        if numbers.any(|x| !x.is_finite()) {
            return Err(format!(
                "a point of the {side} end of braid {b} is not finite"
            ));
        }
    }
    Ok(())
}

/// Appends the points of all curves. Returns the number of points of each.
fn write_curves(set: &CurveSet, positions: &mut Vec<f64>) -> Vec<usize> {
    let write = |i: usize| {
        let mut pen = Pen::new(set, positions);
        pen.curve(i, false);
        match set.curve(i).closed {
            true => pen.close(),
            false => pen.end(),
        }
    };
    (0..set.len()).map(write).collect()
}

/// Writes one curve: vertices of a polyline, or control points of Bezier segments.
struct Pen<'a> {
    set: &'a CurveSet,
    out: &'a mut Vec<f64>,
    /// Number of coordinates before the curve.
    start: usize,
    first: Option<Point>,
    /// Last vertex. For splines, it is written with the segment that follows.
    last: Option<Point>,
}

impl<'a> Pen<'a> {
    fn new(set: &'a CurveSet, out: &'a mut Vec<f64>) -> Pen<'a> {
        Pen {
            set,
            start: out.len(),
            out,
            first: None,
            last: None,
        }
    }

    /// Adds a curve of the frame, connected to what comes before by a straight line.
    fn curve(&mut self, i: usize, backward: bool) {
        let c = self.set.curve(i);
        if self.set.basis().is_polyline() {
            let n = c.points as usize;
            let order = |k: usize| if backward { n - 1 - k } else { k };
            (0..n).for_each(|k| self.vertex(self.set.point(i, order(k))));
            return;
        }
        let n = c.segments as usize;
        for s in (0..n).map(|s| if backward { n - 1 - s } else { s }) {
            let mut b = self.set.segment(i, s);
            if backward {
                b.reverse();
            }
            if self.last != Some(b[0]) {
                self.vertex(b[0]);
            }
            self.out.extend(b[..3].iter().flatten());
            self.last = Some(b[3]);
        }
    }

    /// Adds a vertex, connected to the last one by a straight line.
    fn vertex(&mut self, p: Point) {
        if self.set.basis().is_polyline() {
            self.out.extend(p);
            return;
        }
        if let Some(a) = self.last {
            let at = |t: f64| per_axis(|x| a[x] + (p[x] - a[x]) * t);
            self.out
                .extend([a, at(1.0 / 3.0), at(2.0 / 3.0)].iter().flatten());
        }
        self.first.get_or_insert(p);
        self.last = Some(p);
    }

    /// Closes the curve. Returns its number of points.
    fn close(mut self) -> usize {
        if let Some(first) = self.first
            && self.last != Some(first)
        {
            self.vertex(first);
        }
        (self.out.len() - self.start) / 3
    }

    /// Ends an open curve. Returns its number of points.
    fn end(self) -> usize {
        if let Some(last) = self.last.filter(|_| !self.set.basis().is_polyline()) {
            self.out.extend(last);
        }
        (self.out.len() - self.start) / 3
    }
}
