//! Blocks of eight segments, and the distance between two of them.

use super::blocks::BlockPair;
use super::{CLOSEST, Layout};
use crate::curve::vector::{add, add_scaled, distance, per_axis, sub};
use crate::curve::{Cell, Curve, CurveSet, Point, Positions, is_home, multiple, point_at, smaller};
use crate::measure::thickness::splines::deviation;
use crate::pairs::{Eight, nearest, squared_distances};
use crate::simd::{LANES, dispatch};
use crate::verdict::CloseStrands;
use rayon::prelude::*;
use std::f64::consts::PI;

/// Chords of a spline are not divided further if they deviate by at most this share of its radius.
const DEVIATION: f64 = 0.02;

/// Maximum number of chords of a segment.
const CHORDS: usize = LANES;

/// Number of pairs of blocks that a task measures.
const RUN: usize = 256;

/// One of this many pairs belongs to the sample that is measured first.
const SAMPLE: usize = 16;

/// Number of blocks in the cache of a task.
const KNOWN: usize = 64;

/// Arc lengths along the curves.
#[derive(Debug)]
pub(super) struct Arcs {
    /// First number of each curve in `lengths`.
    first: Vec<usize>,
    /// For each curve, its length up to the start of each segment, and then up to its end.
    lengths: Vec<f32>,
}

impl Arcs {
    /// Measures the chords of all segments.
    pub fn new(set: &CurveSet) -> Arcs {
        let mut first = Vec::with_capacity(set.len());
        let mut lengths = Vec::with_capacity(set.segments() + set.len());
        for (i, curve) in set.curves().iter().enumerate() {
            first.push(lengths.len());
            let (mut length, mut from) = (0.0, set.knot(i, 0));
            lengths.push(0.0);
            for s in 1..=curve.segments as usize {
                let to = set.knot(i, s);
                length += distance(from, to);
                lengths.push(length as f32);
                from = to;
            }
        }
        Arcs { first, lengths }
    }

    /// Returns the length of curve `i` up to the start of segment `s`.
    fn at(&self, i: usize, s: u32) -> f64 {
        self.lengths[self.first[i] + s as usize].into()
    }

    /// Returns the length of a curve from the end of segment `s` to the start of segment `t`, and
    /// from the end of `t` around a closed curve to the start of `s`.
    fn both_ways(&self, i: usize, curve: &Curve, [s, t]: [u32; 2]) -> [f64; 2] {
        let around = self.at(i, s) + self.at(i, curve.segments) - self.at(i, t + 1);
        [self.at(i, t) - self.at(i, s + 1), around]
    }

    /// Returns the length along curve `i` between two segments. If both are in the same period, `s`
    /// is before `t`; otherwise `later` is the number of periods from `s` to `t`.
    fn between(&self, i: usize, curve: &Curve, [s, t]: [u32; 2], later: i32) -> f64 {
        if later != 0 {
            let by = f64::from(later) * self.at(i, curve.segments);
            let forward = self.at(i, t) + by - self.at(i, s + 1);
            return forward.max(self.at(i, s) - self.at(i, t + 1) - by);
        }
        let [forward, around] = self.both_ways(i, curve, [s, t]);
        match curve.closed {
            true => forward.min(around),
            false => forward,
        }
    }

    /// Returns the smallest and the largest length along curve `i` between segments of two blocks.
    /// If both are in the same period, `a` is not after `b`; otherwise `later` is the number of
    /// periods from `a` to `b`.
    fn between_blocks(&self, i: usize, curve: &Curve, [a, b]: [u32; 2], later: i32) -> [f64; 2] {
        let ends = |block: u32| {
            let first = block * LANES as u32;
            [first, (first + LANES as u32).min(curve.segments) - 1]
        };
        let ([s, last_s], [t, last_t]) = (ends(a), ends(b));
        if later != 0 {
            let near = [[last_s, t], [s, last_t]].map(|pair| self.between(i, curve, pair, later));
            let far = [[s, last_t], [last_s, t]].map(|pair| self.between(i, curve, pair, later));
            // A later block is further forward, an earlier one further backward.
            let k = usize::from(later < 0);
            return [near[k], far[k]];
        }
        let [near, far_around] = self.both_ways(i, curve, [last_s, t]);
        let [far, near_around] = self.both_ways(i, curve, [s, last_t]);
        match curve.closed {
            true => [near.min(near_around), far.min(far_around)],
            false => [near, far],
        }
    }
}

/// Distance of two blocks.
#[derive(Clone, Copy, Debug)]
pub(super) struct Measured {
    /// Lower bound of the distance, as a share of the sum of the radii.
    pub bound: f64,
    /// Closest segments. `None` if they were not compared, because all are beyond the limit.
    pub closest: Option<CloseStrands>,
}

impl Measured {
    /// Returns the distance as a share of the sum of the radii, or a lower bound if it is beyond
    /// the limit.
    pub fn ratio(&self) -> f64 {
        self.closest.map_or(self.bound, |c| c.ratio)
    }
}

/// A part of a curve: its segments, and a sphere around each.
#[derive(Clone)]
struct Block {
    curve: usize,
    first: u32,
    count: usize,
    middles: [[f64; LANES]; 3],
    radii: [f64; LANES],
    /// Upper bounds of the distances of the segments from their chords.
    deviations: [f64; LANES],
    hulls: [[Point; 4]; LANES],
    /// Starts of the chords, and the vectors to their ends.
    chords: [[Eight; 3]; 2],
}

impl Block {
    /// Returns the distances of chord `k` of this block from all chords of another block.
    #[inline(always)]
    fn distances(&self, k: usize, other: &Block) -> [f64; LANES] {
        let one = self.chords.map(|v| Eight::repeat(per_axis(|x| v[x].0[k])));
        squared_distances(one, other.chords).map(f64::sqrt)
    }

    /// Moves the block.
    fn translate(&mut self, by: Point) {
        for (middles, by) in self.middles.iter_mut().zip(by) {
            middles.iter_mut().for_each(|x| *x += by);
        }
        for (starts, by) in self.chords[0].iter_mut().zip(by) {
            starts.0.iter_mut().for_each(|x| *x += by);
        }
        for point in self.hulls.as_flattened_mut() {
            *point = add(*point, by);
        }
    }
}

/// All strands of a frame.
pub(super) struct Strands<'a> {
    /// Only its layout is read here. The positions are read from the frame as received, so that
    /// frames that are only compared need no copy.
    pub set: &'a CurveSet,
    pub positions: Positions<'a>,
    /// Radius of each curve.
    pub radii: &'a [f64],
    pub layout: &'a Layout,
    /// Periodic cell, if there is one.
    pub cell: Option<&'a Cell>,
}

impl Strands<'_> {
    /// Returns the number of periods by which the second block of a pair comes later on the same
    /// curve. `None` if they are blocks of different curves, or of a curve and an image that does
    /// not continue it.
    fn later(&self, pair: &BlockPair) -> Option<i32> {
        let curves = &self.layout.blocks.numbers.curves;
        let [i, j] = pair.blocks.map(|k| curves[k as usize] as usize);
        if i != j {
            return None;
        }
        match is_home(&pair.image) {
            true => Some(0),
            false => multiple(pair.image, self.layout.periods[i]),
        }
    }

    /// Returns the index of each block within its curve.
    fn numbers(&self, pair: &BlockPair) -> [u32; 2] {
        pair.blocks
            .map(|k| self.layout.blocks.numbers.place(k).1 as u32)
    }

    /// Returns true if some segments of two blocks count as two strands. On one curve, they must be
    /// at least `pi` radii apart along it, because neighbouring parts are always close.
    pub fn are_apart(&self, pair: &BlockPair) -> bool {
        let Some(later) = self.later(pair) else {
            return true;
        };
        let i = self.layout.blocks.numbers.curves[pair.blocks[0] as usize] as usize;
        let curve = self.set.curve(i);
        let arcs = &self.layout.arcs;
        let [_, most] = arcs.between_blocks(i, &curve, self.numbers(pair), later);
        most >= PI * self.radii[i]
    }

    /// Measures the distances of pairs of blocks, as shares of the sum of their radii. Distances
    /// beyond `limit` are only bounded from below.
    pub fn measure(&self, pairs: &[BlockPair], limit: f64) -> Vec<Measured> {
        self.measure_by(pairs, limit, !self.set.basis().is_polyline())
    }

    /// Measures only the closest strands of all pairs of blocks. Other pairs have a lower bound,
    /// which is no smaller than the distance of the closest strands.
    pub fn measure_closest(&self, pairs: &[BlockPair], limit: f64) -> Vec<Measured> {
        // The closest strands of a sample give an upper bound of the smallest distance. The limit
        // is slightly larger, so that the same strands are found again if no others are closer.
        let sample: Vec<BlockPair> = pairs.iter().step_by(SAMPLE).copied().collect();
        let sample = self.measure_by(&sample, limit, false);
        let closest = sample.iter().filter_map(|m| m.closest);
        let closest = closest.map(|c| (c.ratio + c.error) * (1.0 + 1e-9));
        // The comparison with the limit is strict, so a limit of 0 would miss strands that touch.
        let limit = closest.fold(limit, f64::min).max(1e-9);
        let mut all = self.measure_by(pairs, limit, false);
        if self.set.basis().is_polyline() {
            return all;
        }
        let measured = (0..all.len()).filter(|&k| all[k].closest.is_some());
        let mut order: Vec<usize> = measured.collect();
        order.sort_unstable_by(|&a, &b| all[a].bound.total_cmp(&all[b].bound).then(a.cmp(&b)));
        let (mut rest, mut best) = (&order[..], limit);
        // Pairs are measured in the order of their bounds, until the next bound is at least the
        // smallest distance. Each round measures as many pairs as all earlier rounds together.
        while rest.first().is_some_and(|&k| all[k].bound < best) {
            let count = (order.len() - rest.len()).max(CLOSEST);
            let (now, later) = rest.split_at(count.min(rest.len()));
            let pairs: Vec<BlockPair> = now.iter().map(|&k| pairs[k]).collect();
            for (&k, measured) in now.iter().zip(self.measure(&pairs, best)) {
                best = best.min(measured.ratio());
                all[k] = measured;
            }
            rest = later;
        }
        // The remaining pairs are no closer. Their closest strands are not reported, because they
        // are those of undivided chords, which may be far from the splines.
        rest.iter().for_each(|&k| all[k].closest = None);
        all
    }

    fn measure_by(&self, pairs: &[BlockPair], limit: f64, precise: bool) -> Vec<Measured> {
        let run =
            |pairs: &[BlockPair]| dispatch!(Strands::measure_run(self, pairs, limit, precise));
        pairs.par_chunks(RUN).map(run).flatten_iter().collect()
    }

    #[inline(always)]
    fn measure_run(&self, pairs: &[BlockPair], limit: f64, precise: bool) -> Vec<Measured> {
        let mut first = None;
        // Blocks that follow one another along a curve have many near blocks in common.
        let mut known = [const { None }; KNOWN];
        let mut out = Vec::with_capacity(pairs.len());
        // A loop, because the body of a closure would not be compiled for the instruction set of
        // this function.
        for pair in pairs {
            let [a, b] = pair.blocks;
            let one = match first.take() {
                Some((number, block)) if number == a => block,
                _ => self.block(a),
            };
            let known = &mut known[b as usize % KNOWN];
            let other = match known {
                Some((number, block)) if *number == b => block,
                _ => &mut known.insert((b, Box::new(self.block(b)))).1,
            };
            let mut moved;
            let mut blocks = [&one, &**other];
            if let Some(cell) = self.cell.filter(|_| !is_home(&pair.image)) {
                moved = (*blocks[1]).clone();
                moved.translate(cell.translation(pair.image));
                blocks[1] = &moved;
            }
            out.push(self.measure_pair(pair, blocks, limit, precise));
            first = Some((a, one));
        }
        out
    }

    #[inline(always)]
    fn measure_pair(
        &self,
        pair: &BlockPair,
        [a, b]: [&Block; 2],
        limit: f64,
        precise: bool,
    ) -> Measured {
        let (i, j) = (a.curve, b.curve);
        let radii = self.radii[i] + self.radii[j];
        let mut squares = [[f64::INFINITY; LANES]; LANES];
        for (k, squares) in squares.iter_mut().enumerate().take(a.count) {
            let middle = per_axis(|x| a.middles[x][k]);
            for (l, square) in squares.iter_mut().enumerate().take(b.count) {
                let d = per_axis(|x| b.middles[x][l] - middle[x]);
                *square = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]) * (1.0 - 1e-12);
            }
        }
        if let Some(later) = self.later(pair) {
            self.exclude(pair, later, [a, b], &mut squares);
        }
        let largest = |block: &Block| block.radii.iter().fold(0.0, |m: f64, &r| m.max(r));
        let spheres = largest(a) + largest(b);
        // Lower bounds of the distances of all pairs of segments, from their spheres or their
        // chords.
        let mut least = f64::INFINITY;
        let mut bounds = [[f64::INFINITY; LANES]; LANES];
        for (k, squares) in squares.iter().enumerate().take(a.count) {
            let (mut near, mut any) = ([false; LANES], false);
            for l in 0..LANES {
                let most = limit * radii + a.radii[k] + b.radii[l];
                near[l] = squares[l] < most * most;
                any |= near[l];
                least = smaller(least, if near[l] { f64::INFINITY } else { squares[l] });
            }
            if any {
                let distances = a.distances(k, b);
                for l in 0..LANES {
                    let bound = distances[l] - a.deviations[k] - b.deviations[l];
                    bounds[k][l] = if near[l] { bound } else { f64::INFINITY };
                }
            }
        }
        // Bound of the pairs of segments whose spheres are beyond the limit.
        let beyond = (least.sqrt() - spheres).max(limit * radii) / radii;
        let (mut closest, mut bound) = (None::<CloseStrands>, beyond);
        let mut most = limit * radii;
        // Compares segments in the order of the bounds, until the next bound is at least the
        // smallest distance. Without `precise`, stops after the first pair, whose bound is that of
        // the whole pair of blocks.
        loop {
            let all = bounds.as_flattened().iter().zip(0..);
            let (&least, at) = all.min_by(|a, b| a.0.total_cmp(b.0)).expect("64 bounds");
            if least >= most {
                bound = bound.min(least / radii);
                break;
            }
            let (k, l) = (at / LANES, at % LANES);
            let strands = self.closest(pair, [a, b], [k, l], radii, precise);
            bound = bound.min(strands.ratio - strands.error);
            if closest.is_none_or(|c| strands.distance < c.distance) {
                closest = Some(strands);
                most = most.min(strands.distance);
            }
            if !precise {
                break;
            }
            bounds[k][l] = f64::INFINITY;
        }
        Measured {
            bound: closest.map_or(bound, |c| bound.min(c.ratio)),
            closest,
        }
    }

    /// Excludes pairs of segments that are near one another along the same curve. `later` is the
    /// number of periods from the first block to the second one.
    fn exclude(
        &self,
        pair: &BlockPair,
        later: i32,
        [a, b]: [&Block; 2],
        squares: &mut [[f64; LANES]; LANES],
    ) {
        let i = a.curve;
        let curve = self.set.curve(i);
        let apart = PI * self.radii[i];
        let numbers = self.numbers(pair);
        let [least, _] = self.layout.arcs.between_blocks(i, &curve, numbers, later);
        if least >= apart {
            return;
        }
        let is_one = |s: u32, t: u32| later == 0 && (s >= t || curve.adjacent(s, t));
        for (s, squares) in (a.first..).zip(squares).take(a.count) {
            for (t, square) in (b.first..).zip(squares) {
                let near = || self.layout.arcs.between(i, &curve, [s, t], later) < apart;
                if t >= curve.segments || is_one(s, t) || near() {
                    *square = f64::INFINITY;
                }
            }
        }
    }

    /// Returns the closest points of two segments: of their chords, or, if `precise` is set, of
    /// several chords of each.
    #[inline(always)]
    fn closest(
        &self,
        pair: &BlockPair,
        [a, b]: [&Block; 2],
        [k, l]: [usize; 2],
        radii: f64,
        precise: bool,
    ) -> CloseStrands {
        let ((distance, points), error) = if precise {
            self.closest_of_chords([a, b], [k, l])
        } else {
            let [one, other] = [a.hulls[k], b.hulls[l]].map(|[from, .., to]| [from, to]);
            let error = a.deviations[k] + b.deviations[l];
            (closest_of_edges(one, other), error)
        };
        CloseStrands {
            ratio: distance / radii,
            error: error / radii,
            i: a.curve as u32,
            j: b.curve as u32,
            image: pair.image,
            segments: [a.first + k as u32, b.first + l as u32],
            points,
            distance,
        }
    }

    /// Returns the closest points of two splines, each divided into as many chords as its deviation
    /// requires, and the error bound of their distance.
    #[inline(always)]
    fn closest_of_chords(
        &self,
        [a, b]: [&Block; 2],
        [k, l]: [usize; 2],
    ) -> ((f64, [Point; 2]), f64) {
        let sides = [(a, k), (b, l)];
        let [m, n] = sides.map(|(block, k)| {
            let parts = block.deviations[k] / (DEVIATION * self.radii[block.curve]);
            (parts.sqrt().ceil() as usize).clamp(1, CHORDS)
        });
        let [one, other] = [(a, k, m), (b, l, n)].map(|(block, k, n)| {
            let hull = &block.hulls[k];
            let point = |q: usize| match q {
                0 => hull[0],
                q if q >= n => hull[3],
                q => point_at(hull, q as f64 / n as f64),
            };
            std::array::from_fn::<Point, { CHORDS + 1 }, _>(point)
        });
        let error = a.deviations[k] / (m * m) as f64 + b.deviations[l] / (n * n) as f64;
        // All chords of the second spline, in the lanes of one vector.
        let mut chords = [[Eight([0.0; LANES]); 3]; 2];
        for q in 0..CHORDS {
            for x in 0..3 {
                chords[0][x].0[q] = other[q][x];
                chords[1][x].0[q] = other[q + 1][x] - other[q][x];
            }
        }
        let mut best = (f64::INFINITY, [0, 0]);
        for p in 0..m {
            let chord = [one[p], sub(one[p + 1], one[p])].map(Eight::repeat);
            let squares = squared_distances(chord, chords);
            for (q, &square) in squares.iter().enumerate().take(n) {
                if square < best.0 {
                    best = (square, [p, q]);
                }
            }
        }
        let [p, q] = best.1;
        let edges = closest_of_edges([one[p], one[p + 1]], [other[q], other[q + 1]]);
        (edges, error)
    }

    /// Reads a block of a curve.
    #[inline(always)]
    fn block(&self, number: u32) -> Block {
        let (i, block) = self.layout.blocks.numbers.place(number);
        let curve = self.set.curve(i);
        let basis = self.set.basis();
        let first = (block * LANES) as u32;
        let count = (curve.segments - first).min(LANES as u32) as usize;
        let start = self.set.points_of(i).start;
        let number = |s: usize, k: usize| start + curve.control_point(basis, s, k);
        let control = |s: usize, k: usize| self.positions.point(number(s, k));
        let mut out = Block {
            curve: i,
            first,
            count,
            middles: [[0.0; LANES]; 3],
            radii: [0.0; LANES],
            deviations: [0.0; LANES],
            hulls: [[[0.0; 3]; 4]; LANES],
            chords: [[Eight([0.0; LANES]); 3]; 2],
        };
        let mut last = control(first as usize, 0);
        for k in 0..count {
            let s = first as usize + k;
            if basis.is_polyline() {
                let to = control(s, 1);
                out.hulls[k] = [last, last, to, to];
                last = to;
            } else {
                let q = [0, 1, 2, 3].map(|k| control(s, k));
                let axes = per_axis(|x| basis.hull([q[0][x], q[1][x], q[2][x], q[3][x]]));
                out.hulls[k] = [0, 1, 2, 3].map(|k| per_axis(|x| axes[x][k]));
                out.deviations[k] = deviation(&out.hulls[k]);
            }
            let [from, .., to] = out.hulls[k];
            for x in 0..3 {
                out.middles[x][k] = 0.5 * (from[x] + to[x]);
                out.chords[0][x].0[k] = from[x];
                out.chords[1][x].0[k] = to[x] - from[x];
            }
            out.radii[k] = (0.5 * distance(from, to)) * (1.0 + 1e-12) + out.deviations[k];
        }
        out
    }
}

/// Returns the distance of two straight segments, and their nearest points.
#[inline(always)]
fn closest_of_edges([p0, p1]: [Point; 2], [q0, q1]: [Point; 2]) -> (f64, [Point; 2]) {
    let (d, e) = (sub(p1, p0), sub(q1, q0));
    let near = nearest([p0, d], [q0, e]);
    let points = [add_scaled(p0, near.s, d), add_scaled(q0, near.t, e)];
    (near.distance_sq.sqrt(), points)
}
