//! Passages of two edges of polylines, or of the pieces of two spline segments.

use super::cancellation::{LocatedPassage, motion_in_lengths};
use super::contact::Contact;
use super::outcome::Counts;
use super::pair::{Task, TooNear};
use super::pieces::{Cuts, MovingBoxes, PIECES, ROUNDS, Vertex};
use crate::curve::{Parts, Point, SumEdges, point_at};
use crate::discretize::{pieces_between, pieces_within};
use crate::exact::{
    Decided, Edges, Moment, Passage, Ties, equal_sums, passages_of_sums, segments_touch, sums_touch,
};
use crate::verdict::PullThrough;
use std::ops::ControlFlow;
use std::sync::atomic::Ordering;

/// Number of near pairs of spline segments above which they are split into tasks.
const GRAIN: usize = 1 << 12;

/// Number of tested pairs of pieces after which the limits are checked.
const BATCH: u64 = 4096;

/// Results of the tests.
#[derive(Debug, Default)]
pub(super) struct Findings {
    pub passages: Vec<LocatedPassage>,
    /// Contacts in either frame.
    pub contacts: Vec<Contact>,
    /// Segments that touch in a way that cannot be distinguished from a passage.
    pub ties: Vec<[u32; 2]>,
    pub counts: Counts,
}

impl Findings {
    pub fn clear(&mut self) {
        self.passages.clear();
        self.contacts.clear();
        self.ties.clear();
        self.counts = Counts::default();
    }

    pub fn append(&mut self, other: &mut Findings) {
        self.passages.append(&mut other.passages);
        self.contacts.append(&mut other.contacts);
        self.ties.append(&mut other.ties);
        self.counts.add(&other.counts);
    }
}

impl Task<'_> {
    /// Adds the passages of two edges of polylines.
    pub fn add_edges(&self, s: u32, t: u32, found: &mut Findings) {
        let [before, after] = self.step.frames.map(|set| set.edges(self.curves, [s, t]));
        let along = |at: [f64; 2]| [f64::from(s) + at[0], f64::from(t) + at[1]];
        self.add_passages(&before, &after, [s, t], along, found);
    }

    /// Returns two edges of polylines in both frames, as exact sums.
    #[cold]
    fn exact_edges(&self, segments: [u32; 2]) -> [SumEdges; 2] {
        let frames = self.step.frames;
        frames.map(|set| set.exact_edges(self.curves, segments))
    }

    /// Sorts near spline segments and adds their passages, in pieces as short as the limits permit.
    /// Returns two segments if the pair is too near to decide.
    pub fn add_near(
        &self,
        cuts: &mut Cuts,
        near: &mut Vec<(u32, u32)>,
        found: &mut Findings,
    ) -> Result<(), TooNear> {
        if near.is_empty() {
            return Ok(());
        }
        near.sort_unstable();
        // In a closed curve of two segments, each segment is the successor of the other one.
        near.dedup();
        let (counts, segments) = (found.counts, near[0].into());
        for rounds in [ROUNDS, ROUNDS / 2, 0] {
            let fine = cuts.fill(self, near, rounds).map_err(TooNear::at)?;
            self.add_splines_shared(cuts, near, found);
            if !self.exceeds_limits() {
                let searched = true;
                return match fine {
                    true => Ok(()),
                    false => Err(TooNear { segments, searched }),
                };
            }
            found.clear();
            found.counts = counts;
            if self.step.cancel.is_set() {
                break;
            }
            self.pieces.store(0, Ordering::Relaxed);
            self.exact.store(0, Ordering::Relaxed);
        }
        Err(TooNear::at(segments))
    }

    /// Adds the passages of near spline segments. Splits many of them into parallel tasks.
    fn add_splines_shared(&self, cuts: &Cuts, near: &[(u32, u32)], found: &mut Findings) {
        if near.len() <= GRAIN {
            return self.add_splines(cuts, near, found);
        }
        let (left, right) = near.split_at(near.len() / 2);
        let mut other = Findings::default();
        rayon::join(
            || self.add_splines_shared(cuts, left, found),
            || self.add_splines_shared(cuts, right, &mut other),
        );
        found.append(&mut other);
    }

    /// Adds the passages of near spline segments, sorted.
    fn add_splines(&self, cuts: &Cuts, near: &[(u32, u32)], found: &mut Findings) {
        let (mut p, mut q) = (Vec::new(), Vec::new());
        let sieve = MovingBoxes {
            margin: self.separation.margin,
        };
        let mut last = None;
        for &(s, t) in near {
            if last != Some(s) {
                cuts.vertices(self, 0, s, &mut p);
                last = Some(s);
            }
            let itself = self.is_self() && s == t;
            if !itself {
                cuts.vertices(self, 1, t, &mut q);
            }
            // The usual work for a pair of segments is counted as a candidate.
            let split = p.len().max(q.len()) > PIECES as usize + 1;
            let mut pieces = 0;
            let mut test = |a: &[Vertex], b: &[Vertex]| {
                let exact = found.counts.exact;
                self.add_pieces([s, t], [a, b], found);
                pieces += u64::from(split);
                if pieces == BATCH {
                    self.pieces.fetch_add(pieces, Ordering::Relaxed);
                    pieces = 0;
                    if self.exceeds_limits() {
                        return ControlFlow::Break(());
                    }
                }
                self.count_exact(found.counts.exact - exact)
            };
            let done = match itself {
                true => pieces_within(&p, &sieve, &mut test),
                false => pieces_between(&p, &q, &sieve, &mut test),
            };
            self.pieces.fetch_add(pieces, Ordering::Relaxed);
            if done.is_break() {
                return;
            }
        }
    }

    /// [`Task::add_splines`] with all pairs of pieces whose boxes are not apart along a coordinate.
    #[cfg(test)]
    pub fn add_all_pieces(&self, cuts: &Cuts, near: &[(u32, u32)], found: &mut Findings) {
        use crate::discretize::Sieve as _;
        let (mut p, mut q) = (Vec::new(), Vec::new());
        let sieve = MovingBoxes {
            margin: self.separation.margin,
        };
        for &(s, t) in near {
            cuts.vertices(self, 0, s, &mut p);
            cuts.vertices(self, 1, t, &mut q);
            let all = sieve.bounds(&q);
            for (k, a) in p.windows(2).enumerate() {
                // A segment with itself: every pair of pieces once.
                let first = if self.is_self() && s == t { k + 1 } else { 0 };
                let bounds = sieve.bounds(a);
                if MovingBoxes::are_beside(&bounds, &all) {
                    continue;
                }
                let near = |b: &&[Vertex]| !MovingBoxes::are_beside(&bounds, &sieve.bounds(b));
                for b in q.windows(2).skip(first).filter(near) {
                    self.add_pieces([s, t], [a, b], found);
                }
            }
        }
    }

    /// Adds the passages of two pieces of spline segments to `found`.
    fn add_pieces(&self, [s, t]: [u32; 2], pieces: [&[Vertex]; 2], found: &mut Findings) {
        if self.are_joined([s, t], pieces) {
            return;
        }
        let edges = |f: usize| pieces.map(|piece| [0, 1].map(|k| piece[k].points[f]));
        let along = |at: [f64; 2]| {
            let mix = |k: usize| {
                let [start, end] = [0, 1].map(|end| pieces[k][end].at);
                start + at[k] * (end - start)
            };
            [f64::from(s) + mix(0), f64::from(t) + mix(1)]
        };
        self.add_passages(&edges(0), &edges(1), [s, t], along, found);
    }

    /// Returns true if two pieces are on both sides of the joint of a yarn and the image that
    /// continues it. Their common end is rounded differently in both.
    fn are_joined(&self, segments: [u32; 2], pieces: [&[Vertex]; 2]) -> bool {
        let joined = self.parts.filter(|parts| parts.joint() == Some(segments));
        joined.is_some_and(|parts| match parts.is_continued() {
            true => pieces[0][1].at == 1.0 && pieces[1][0].at == 0.0,
            false => pieces[0][0].at == 0.0 && pieces[1][1].at == 1.0,
        })
    }

    /// Adds the passages of two pieces of these segments. `along` maps positions on the pieces to
    /// positions along both curves.
    #[inline(always)]
    fn add_passages(
        &self,
        before: &Edges,
        after: &Edges,
        segments: [u32; 2],
        along: impl Fn([f64; 2]) -> [f64; 2],
        found: &mut Findings,
    ) {
        let [i, j] = self.curves.map(|i| i as u32);
        let event = |p: Passage| PullThrough {
            i,
            j,
            image: Default::default(),
            segments,
            fraction: p.time,
            sign: p.sign,
            point: p.point,
            lengths: self.relative_motion([before, after], p.at, segments),
        };
        if let Some(Joint { points, rests }) = self.joint([before, after], segments) {
            // A common end of two pieces of one spline is not a joint of two curves.
            if !self.splines() {
                let contact = |f: usize| Contact {
                    event: PullThrough {
                        lengths: 0.0,
                        ..event(Passage {
                            time: f as f64,
                            moment: [Moment::Start, Moment::End][f],
                            sign: 0,
                            at: [0.0; 2],
                            point: points[f],
                        })
                    },
                    joint: true,
                    counted: f == 1 || rests,
                };
                found.contacts.extend([0, 1].map(contact));
            }
            return;
        }
        let ties = self.parts.map_or(Ties::Translate, |_| Ties::Report);
        let list = &mut found.passages;
        let first = list.len();
        let mut in_frames = [None; 2];
        let mut add = |p: Passage| match p.moment {
            Moment::Start => in_frames[0] = Some(p),
            Moment::End => in_frames[1] = Some(p),
            Moment::Within { tie } => list.push(LocatedPassage {
                event: event(p),
                along: along(p.at),
                tie,
            }),
        };
        let frames = [before, after];
        let sums = || self.exact_edges(segments);
        let mut decided = passages_of_sums(frames, self.rounding, sums, ties, &mut add);
        if in_frames.iter().any(Option::is_some) {
            let beyond = |f: usize| {
                let parts = self.parts.as_ref().filter(|_| in_frames[f].is_some());
                parts.is_some_and(|p| self.reaches_neighbours(p, f, frames[f], segments))
            };
            if (0..2).any(beyond) {
                decided = Decided::Tie;
            } else {
                if let [Some(start), Some(end)] = &mut in_frames {
                    // The contact is assumed to last for the whole step, so passages at ties belong
                    // to it.
                    let at_ties = list.extract_if(first.., |f| f.tie);
                    start.sign += std::mem::take(&mut end.sign);
                    start.sign += at_ties.map(|f| f.event.sign).sum::<i32>();
                }
                let contact = |p| Contact {
                    event: event(p),
                    joint: false,
                    counted: true,
                };
                let in_frames = in_frames.into_iter().flatten();
                found.contacts.extend(in_frames.map(contact));
            }
        }
        found.counts.tests += 1;
        found.counts.exact += u64::from(matches!(decided, Decided::Exact | Decided::Tie));
        if decided == Decided::Tie {
            found.ties.push(segments);
        }
    }

    /// Returns the relative motion of points of two pieces, in lengths of the longer one of their
    /// segments. Splines are measured along their chords.
    fn relative_motion(&self, pieces: [&Edges; 2], at: [f64; 2], segments: [u32; 2]) -> f64 {
        if !self.splines() {
            let edges = pieces.into_iter().flatten().map(|edge| &edge[..]);
            return motion_in_lengths(pieces, at, edges);
        }
        let chords = self.step.frames.map(|set| {
            [0, 1].map(|side| {
                let segment = set.segment(self.curves[side], segments[side] as usize);
                [0.0, 0.25, 0.5, 0.75, 1.0].map(|at| point_at(&segment, at))
            })
        });
        let chords = chords.as_flattened().iter().map(|points| &points[..]);
        motion_in_lengths(pieces, at, chords)
    }

    /// Returns true if the contact of two edges of one curve in a frame may be connected with pairs
    /// of edges that are not tested, that belong to another pair of parts, or that are tested with
    /// the strands in the other order. This is the case if the contact is at a vertex next to the
    /// other edge, at the first vertex of a closed curve, or at the joint of two periods of a yarn.
    fn reaches_neighbours(&self, parts: &Parts, f: usize, edges: &Edges, [s, t]: [u32; 2]) -> bool {
        let exact = (self.rounding != 0.0).then(|| self.exact_edges([s, t])[f]);
        // Ends: of the first edge, then of the second one.
        let on_other = |side: usize, end: usize| match &exact {
            Some(sums) => sums_touch([[sums[side][end]; 2], sums[1 - side]]),
            None => segments_touch(&[[edges[side][end]; 2], edges[1 - side]]),
        };
        let curve = self.step.frames[0].curve(self.curves[0]);
        let last = curve.segments - 1;
        let (start, end) = (0, 1);
        self.splines()
            || (parts.follows_after_one(s, t) && (on_other(0, end) || on_other(1, start)))
            || (parts.precedes_before_one(s, t) && (on_other(0, start) || on_other(1, end)))
            || match (parts.is_self(), curve.closed) {
                (true, false) => false,
                (true, true) => (s == 0 && on_other(0, start)) || (t == last && on_other(1, end)),
                (false, _) => [s, t].into_iter().enumerate().any(|(side, s)| {
                    (s == 0 && on_other(side, start)) || (s == last && on_other(side, end))
                }),
            }
    }

    /// Returns an end that two edges share in both frames. Rounded coordinates may be equal
    /// although the exact coordinates differ, so exact sums are compared if there are any.
    #[inline(always)]
    fn joint(&self, frames: [&Edges; 2], segments: [u32; 2]) -> Option<Joint> {
        let ends = [(0, 0), (0, 1), (1, 0), (1, 1)];
        let near = |[p, q]: [&Point; 2]| (0..3).all(|x| (p[x] - q[x]).abs() <= 2.0 * self.rounding);
        let shared = |&(k, l): &(usize, usize)| frames.iter().all(|f| near([&f[0][k], &f[1][l]]));
        let mut found = ends.into_iter().filter(shared).peekable();
        let &(k, _) = found.peek()?;
        if self.rounding != 0.0 {
            return self.joint_of_sums(frames, segments, found);
        }
        Some(Joint {
            points: frames.map(|edges| edges[0][k]),
            rests: frames[0] == frames[1],
        })
    }

    /// Same as [`Task::joint`], for exact sums of coordinates: compares the given pairs of ends.
    #[cold]
    fn joint_of_sums(
        &self,
        frames: [&Edges; 2],
        segments: [u32; 2],
        mut ends: impl Iterator<Item = (usize, usize)>,
    ) -> Option<Joint> {
        let sums = self.exact_edges(segments);
        let (k, _) = ends.find(|&(k, l)| sums.iter().all(|f| equal_sums(&f[0][k], &f[1][l])))?;
        let [before, after] = [0, 1].map(|f| sums[f].as_flattened().iter());
        Some(Joint {
            points: frames.map(|edges| edges[0][k]),
            rests: before.zip(after).all(|(p, q)| equal_sums(p, q)),
        })
    }
}

/// An end that two edges share in both frames.
struct Joint {
    /// Its position in both frames.
    points: [Point; 2],
    /// True if the edges do not move.
    rests: bool,
}
