//! Passages of one pair of curves, or of a curve and itself.

use super::contact::Contact;
use super::net::{Found, cancel};
use super::unresolved::{far_and_cancelling, relative_motion};
use super::{Counts, PullThrough};
use crate::cancel::Cancel;
use crate::certificate::Link;
use crate::curve::{Box3, BoxGroup, CurveSet, Point, point_at};
use crate::discretize::{
    Halving, MovingSeparation, Separation, Sieve, pieces_between, pieces_within,
};
use crate::exact::{Decided, Edges, Moment, Passage, Predicates, Ties, passages, segments_touch};
use crate::pairs::{
    Agenda, CurveTree, Node, Pair, Query, SegmentPairs, Trees, closest_of_segments, descend,
    overlapping,
};
use crate::simd::{LANES, Lanes, Portable, dispatch};
use crate::verdict::{Defect, DefectKind};
use std::ops::{ControlFlow, Range};
use std::sync::atomic::{AtomicU64, Ordering};

/// Minimum number of pieces of a spline segment.
const PIECES: u32 = 4;

/// Number of gathered candidates after which they are tested.
const BATCH: usize = 4096;

/// Number of visited node pairs after which candidates are tested, however few.
const STEPS: usize = 4096;

/// Number of such rounds after which a task shares the rest of its work.
const ROUNDS: usize = 3;

/// Number of segments of a leaf.
const BLOCK: u32 = LANES as u32;

/// Number of blocks of one curve above which they are split into tasks.
const BLOCKS: usize = 1 << 12;

/// Number of near pairs of spline segments above which they are split into tasks.
const GRAIN: usize = 1 << 12;

/// Maximum number of candidates of one pair of curves. Beyond it the pair counts as too close: if
/// everything may have passed through everything, a list of passages is useless. About half a
/// second.
const MAX_CANDIDATES: u64 = 1 << 24;

/// Maximum number of tested pairs of pieces of splines that need more pieces than usual, for one
/// pair of curves. Beyond it the pair counts as too close. About half a second.
const MAX_PIECES: u64 = 1 << 23;

/// Maximum number of exact tests of one pair of curves: a constant, and a number per segment.
/// Beyond it the pair counts as too close. An exact test of strands whose distance is near the
/// rounding error takes about 100 us.
const MAX_EXACT: [u64; 2] = [1 << 12, 4];

/// A step from one frame to the next.
#[derive(Clone, Copy)]
pub(super) struct Step<'a> {
    pub frames: [&'a CurveSet; 2],
    /// Trees of swept boxes.
    pub trees: &'a Trees,
    /// Motion limit in segment lengths.
    pub motion_limit: f64,
    pub cancel: &'a Cancel,
}

/// Results of one task.
#[derive(Debug, Default)]
pub(super) struct Part {
    pub events: Vec<PullThrough>,
    pub unresolved: Vec<PullThrough>,
    pub undecided: Vec<Defect>,
    pub sums: Vec<Link>,
    pub contacts: Vec<Contact>,
    pub counts: Counts,
}

impl Part {
    pub fn clear(&mut self) {
        self.contacts.clear();
        self.events.clear();
        self.unresolved.clear();
        self.undecided.clear();
        self.sums.clear();
        self.counts = Counts::default();
    }
}

/// Buffers of one task.
#[derive(Debug, Default)]
pub(super) struct Workspace {
    gathered: Gathered,
    cuts: Cuts,
}

/// Buffers and results of the visits of one pair.
#[derive(Debug, Default)]
struct Gathered {
    agenda: Agenda,
    candidates: SegmentPairs,
    /// Spline segments that may meet.
    near: Vec<(u32, u32)>,
    found: Findings,
}

/// Results of the tests.
#[derive(Debug, Default)]
struct Findings {
    passages: Vec<Found>,
    /// Contacts in either frame.
    contacts: Vec<Contact>,
    /// Segments that touch in a way that cannot be distinguished from a passage.
    ties: Vec<[u32; 2]>,
    counts: Counts,
}

impl Findings {
    fn clear(&mut self) {
        self.passages.clear();
        self.contacts.clear();
        self.ties.clear();
        self.counts = Counts::default();
    }

    fn append(&mut self, other: &mut Findings) {
        self.passages.append(&mut other.passages);
        self.contacts.append(&mut other.contacts);
        self.ties.append(&mut other.ties);
        self.counts.add(&other.counts);
    }
}

impl<'a> Step<'a> {
    /// Adds the passages of a pair of curves.
    pub fn pair(&self, pair: Pair, workspace: &mut Workspace, part: &mut Part) {
        let task = Task::new(*self, pair);
        let Workspace { gathered, cuts } = workspace;
        task.gather(gathered);
        let Gathered { near, found, .. } = gathered;
        let done = if task.entangled() {
            Err([0, 0])
        } else if near.is_empty() {
            Ok(())
        } else {
            near.sort_unstable();
            // In a closed curve of two segments, each segment is the successor of the other one.
            near.dedup();
            let split = cuts.fill(&task, near);
            split.and_then(|()| {
                task.add_splines_shared(cuts, near, found);
                let (s, t) = near[0];
                if task.entangled() {
                    Err([s, t])
                } else {
                    Ok(())
                }
            })
        };
        task.settle(done, found, part);
    }

    /// [`Step::pair`] with all pairs of segments as candidates, and the splits of the regular
    /// search.
    #[cfg(test)]
    pub fn pair_by_brute_force(&self, pair: Pair, part: &mut Part) {
        let task = Task::new(*self, pair);
        let Workspace {
            mut gathered,
            mut cuts,
        } = Workspace::default();
        task.gather(&mut gathered);
        let Gathered { near, found, .. } = &mut gathered;
        near.sort_unstable();
        near.dedup();
        found.clear();
        let [n, m] = task.curves.map(|i| self.frames[0].curve(i).segments);
        let all = (0..n).flat_map(|s| (0..m).map(move |t| (s, t)));
        let all: Vec<_> = all.filter(|&(s, t)| !task.is_self() || s <= t).collect();
        let done = if task.splines() {
            let split = cuts.fill(&task, near);
            split.map(|()| task.add_all_pieces(&cuts, &all, found))
        } else {
            let joined = |s: u32, t: u32| task.is_self() && task.adjacent(s, t);
            let different = all.iter().filter(|&&(s, t)| !joined(s, t));
            different.for_each(|&(s, t)| task.add_edges(s, t, found));
            Ok(())
        };
        task.settle(done, found, part);
    }
}

/// A part of the visits of a task.
enum Visit {
    /// Descendants of the node pairs of the agenda.
    Agenda,
    /// Blocks of a curve, each with itself.
    Along(Range<u32>),
}

/// One pair of curves, or a curve and itself.
struct Task<'a> {
    step: Step<'a>,
    curves: [usize; 2],
    separation: MovingSeparation<'a>,
    /// Work counters of all tasks of the pair.
    candidates: AtomicU64,
    pieces: AtomicU64,
    exact: AtomicU64,
}

impl<'a> Task<'a> {
    fn new(step: Step<'a>, (i, j): Pair) -> Self {
        let curves = [i as usize, j as usize];
        Task {
            step,
            curves,
            separation: MovingSeparation::new(step.frames, curves),
            candidates: AtomicU64::new(0),
            pieces: AtomicU64::new(0),
            exact: AtomicU64::new(0),
        }
    }

    /// Returns true if this is a curve and itself.
    fn is_self(&self) -> bool {
        self.curves[0] == self.curves[1]
    }

    fn splines(&self) -> bool {
        !self.step.frames[0].basis().is_polyline()
    }

    /// Returns true if the pair needs more work than the limit for one pair, or if the step was
    /// cancelled. Part of the work is then skipped, and which part depends on the order of the
    /// tasks. Whether the limit is exceeded does not.
    fn entangled(&self) -> bool {
        let segments = self.curves.map(|i| self.step.frames[0].curve(i).segments);
        let segments: u64 = segments.into_iter().map(u64::from).sum();
        let over = |count: &AtomicU64, most: u64| count.load(Ordering::Relaxed) > most;
        self.step.cancel.is_set()
            || over(&self.candidates, MAX_CANDIDATES)
            || over(&self.pieces, MAX_PIECES)
            || over(&self.exact, MAX_EXACT[0] + MAX_EXACT[1] * segments)
    }

    /// Counts exact tests. Breaks if the pair exceeds its limits.
    fn count_exact(&self, more: u64) -> ControlFlow<()> {
        if more > 0 {
            self.exact.fetch_add(more, Ordering::Relaxed);
            if self.entangled() {
                return ControlFlow::Break(());
            }
        }
        ControlFlow::Continue(())
    }

    fn tree(&self, side: usize) -> CurveTree<'a> {
        self.step.trees.of(self.step.frames[0], self.curves[side])
    }

    /// Gathers the candidates and tests those that are edges.
    fn gather(&self, gathered: &mut Gathered) {
        gathered.near.clear();
        gathered.found.clear();
        gathered.found.counts.pairs = 1;
        gathered.agenda.clear();
        let (first, second) = (self.tree(0), self.tree(1));
        if self.is_self() {
            self.visit(Visit::Along(0..self.segments().div_ceil(BLOCK)), gathered);
            above_the_leaves(first, &mut gathered.agenda);
        } else {
            gathered.agenda.push((first.root(), second.root()));
        }
        self.visit(Visit::Agenda, gathered);
    }

    /// Returns the number of segments of the first curve.
    fn segments(&self) -> u32 {
        self.step.frames[0].curve(self.curves[0]).segments
    }

    /// Adds the findings to `part`, or a defect if two segments are too close.
    fn settle(&self, done: Result<(), [u32; 2]>, found: &mut Findings, part: &mut Part) {
        let frames = self.step.frames;
        let [i, j] = self.curves.map(|i| i as u32);
        part.counts.add(&found.counts);
        let undecided = |kind, segments| Defect {
            i,
            j: Some(j),
            kind,
            place: closest_of_segments(frames[1], self.curves, segments),
        };
        if let Err(segments) = done {
            let defect = undecided(DefectKind::TooClose, segments);
            return part.undecided.push(defect);
        }
        found.ties.sort_unstable();
        found.ties.dedup();
        let ties = found.ties.iter();
        part.undecided
            .extend(ties.map(|&segments| undecided(DefectKind::Contact, segments)));
        part.contacts.append(&mut found.contacts);
        let curves = self.curves.map(|i| frames[0].curve(i));
        cancel(&mut found.passages, curves);
        let from = part.events.len();
        part.events.extend(found.passages.iter().map(|f| f.event));
        let unresolved = far_and_cancelling(&part.events[from..], self.step.motion_limit);
        let mut index = from..;
        let far = part.events.extract_if(from.., |_| {
            index
                .next()
                .is_some_and(|k| unresolved.contains(&(k - from)))
        });
        part.unresolved.extend(far);
        let signs = found.passages.iter().map(|f| i64::from(f.event.sign));
        let lambda = signs.sum();
        if !self.is_self() && lambda != 0 && curves.iter().all(|c| c.closed) {
            part.sums.push(Link { i, j, lambda });
        }
    }

    /// Returns true if two segments of one curve are equal or consecutive.
    fn adjacent(&self, s: u32, t: u32) -> bool {
        self.step.frames[0].curve(self.curves[0]).adjacent(s, t)
    }

    /// Makes a part of the visits.
    fn visit(&self, visit: Visit, gathered: &mut Gathered) {
        dispatch!(simd => self.visit_with(simd, visit, gathered))
    }

    #[inline(always)]
    fn visit_with<L: Lanes>(&self, simd: L, visit: Visit, gathered: &mut Gathered) {
        match visit {
            Visit::Agenda => self.visit_agenda(simd, gathered),
            Visit::Along(blocks) if blocks.len() > BLOCKS => {
                let middle = blocks.start + blocks.len() as u32 / 2;
                let (left, right) = (blocks.start..middle, middle..blocks.end);
                self.share(gathered, [Visit::Along(left), Visit::Along(right)], vec![]);
            }
            Visit::Along(blocks) => {
                for block in blocks {
                    self.visit_block(simd, block, gathered);
                    if self.entangled() {
                        return;
                    }
                }
            }
        }
    }

    /// Visits all descendants of the node pairs of the agenda.
    #[inline(always)]
    fn visit_agenda<L: Lanes>(&self, simd: L, gathered: &mut Gathered) {
        let both = [self.tree(0), self.tree(1)];
        let query = Query {
            w: 2,
            meeting: false,
            reach: 0.0,
        };
        for round in 0.. {
            let Gathered {
                agenda, candidates, ..
            } = &mut *gathered;
            if agenda.is_empty() {
                return;
            }
            if round >= ROUNDS && agenda.len() > 1 {
                // Every second one, because node pairs at the bottom have more descendants.
                let mut mine = false;
                let others = agenda.extract_if(.., |_| {
                    mine = !mine;
                    !mine
                });
                let others = others.collect();
                return self.share(gathered, [Visit::Agenda, Visit::Agenda], others);
            }
            descend::<L, true>(simd, both, query, agenda, candidates, (STEPS, BATCH));
            self.test_candidates(gathered);
            if self.entangled() {
                gathered.agenda.clear();
            }
        }
    }

    /// Visits the segments of a block of a curve, with one another and (splines) with themselves
    /// and their successors.
    #[inline(always)]
    fn visit_block<L: Lanes>(&self, simd: L, block: u32, gathered: &mut Gathered) {
        let first = block * BLOCK;
        let mut leaf = BoxGroup::EMPTY;
        let boxes = *self.tree(0).children(Node::new(0, block), &mut leaf);
        for k in 0..BLOCK {
            // Skips the next segment, which is adjacent.
            let mut lanes = overlapping(simd, &boxes.lane(k as usize), &boxes) & !0 << (k + 2);
            while lanes != 0 {
                let l = lanes.trailing_zeros();
                gathered.candidates.all.push((first + k, first + l));
                lanes &= lanes - 1;
            }
        }
        self.test_candidates(gathered);
        if !self.splines() {
            return;
        }
        let curve = self.step.frames[0].curve(self.curves[0]);
        let last = (first + BLOCK).min(curve.segments);
        let after = curve.after(last - 1);
        self.separation
            .add_turns(first..last, after, &mut gathered.near);
    }

    /// Makes two parts of the visits in parallel. The second part has a separate agenda.
    #[cold]
    fn share(&self, gathered: &mut Gathered, [mine, others]: [Visit; 2], agenda: Agenda) {
        let mut other = Gathered {
            agenda,
            ..Gathered::default()
        };
        rayon::join(
            || self.visit(mine, gathered),
            || self.visit(others, &mut other),
        );
        gathered.near.append(&mut other.near);
        gathered.found.append(&mut other.found);
    }

    /// Tests candidates that are edges. Keeps spline segments that may meet.
    #[inline(always)]
    fn test_candidates(&self, gathered: &mut Gathered) {
        let Gathered {
            candidates,
            near,
            found,
            ..
        } = gathered;
        let candidates = &mut candidates.all;
        self.candidates
            .fetch_add(candidates.len() as u64, Ordering::Relaxed);
        found.counts.candidates += candidates.len() as u64;
        let same = self.is_self();
        for &(s, t) in candidates.iter() {
            if same && self.adjacent(s, t) {
                continue;
            }
            if !self.splines() {
                let exact = found.counts.exact;
                self.add_edges(s, t, found);
                if self.count_exact(found.counts.exact - exact).is_break() {
                    break;
                }
            } else if !self.separation.apart(s, t) {
                near.push((s, t));
            }
        }
        candidates.clear();
    }

    /// Adds the passages of two edges of polylines.
    fn add_edges(&self, s: u32, t: u32, found: &mut Findings) {
        let [i, j] = self.curves;
        let edges = |set: &CurveSet| {
            [(i, s), (j, t)].map(|(i, s)| [set.knot(i, s as usize), set.knot(i, s as usize + 1)])
        };
        let [before, after] = self.step.frames.map(edges);
        let along = |at: [f64; 2]| [f64::from(s) + at[0], f64::from(t) + at[1]];
        self.add_passages(&before, &after, [s, t], along, found);
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
            segments,
            fraction: p.time,
            sign: p.sign,
            point: p.point,
            lengths: match p.moment {
                Moment::Within { .. } => {
                    let [from, to] = [0.0, 1.0].map(|end| along([end; 2]));
                    let shares = [0, 1].map(|side| to[side] - from[side]);
                    relative_motion([before, after], p.at, shares)
                }
                _ => 0.0,
            },
        };
        if let Some(points) = joint(before, after) {
            // A common end of pieces of one spline is no joint.
            if !self.splines() {
                let contact = |f: usize| Contact {
                    event: PullThrough {
                        i,
                        j,
                        segments,
                        fraction: f as f64,
                        sign: 0,
                        point: points[f],
                        lengths: 0.0,
                    },
                    joint: true,
                    counted: f == 1 || before == after,
                };
                found.contacts.extend([0, 1].map(contact));
            }
            return;
        }
        let ties = if self.is_self() {
            Ties::Report
        } else {
            Ties::Translate
        };
        let Findings {
            passages: list,
            contacts,
            ties: touching,
            counts,
        } = found;
        let first = list.len();
        let mut in_frames = [None; 2];
        let mut decided = passages(before, after, ties, &mut |p| match p.moment {
            Moment::Start => in_frames[0] = Some(p),
            Moment::End => in_frames[1] = Some(p),
            Moment::Within { tie } => list.push(Found {
                event: event(p),
                along: along(p.at),
                tie,
            }),
        });
        if in_frames.iter().any(Option::is_some) {
            let frames = [before, after];
            let beyond =
                |f: usize| in_frames[f].is_some() && self.reaches_neighbours(frames[f], segments);
            if self.is_self() && (0..2).any(beyond) {
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
                contacts.extend(in_frames.into_iter().flatten().map(contact));
            }
        }
        counts.tests += 1;
        counts.exact += u64::from(matches!(decided, Decided::Exact | Decided::Tie));
        if decided == Decided::Tie {
            touching.push(segments);
        }
    }

    /// Returns true if the contact of two edges of one curve in a frame may be connected with pairs
    /// of edges that are not tested, or that are tested with the strands in the other order. That
    /// is so if the contact is at a vertex next to the other edge, or at the first vertex of a
    /// closed curve.
    fn reaches_neighbours(&self, [[a, b], [c, d]]: &Edges, [s, t]: [u32; 2]) -> bool {
        let curve = self.step.frames[0].curve(self.curves[0]);
        let on = |p: &Point, [q, r]: [&Point; 2]| {
            segments_touch(*p, *p, *q, *r, &mut Predicates::default())
        };
        let (first, second) = ([a, b], [c, d]);
        let last = curve.segments - 1;
        self.splines()
            || (curve.after(curve.after(s)) == t && (on(b, second) || on(c, first)))
            || (curve.after(curve.after(t)) == s && (on(d, first) || on(a, second)))
            || (curve.closed && s == 0 && on(a, second))
            || (curve.closed && t == last && on(d, first))
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
        let mut last = None;
        found.counts.near += near.len() as u64;
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
                if pieces == BATCH as u64 {
                    self.pieces.fetch_add(pieces, Ordering::Relaxed);
                    pieces = 0;
                    if self.entangled() {
                        return ControlFlow::Break(());
                    }
                }
                self.count_exact(found.counts.exact - exact)
            };
            let done = match itself {
                true => pieces_within(&p, &MovingBoxes, &mut test),
                false => pieces_between(&p, &q, &MovingBoxes, &mut test),
            };
            self.pieces.fetch_add(pieces, Ordering::Relaxed);
            if done.is_break() {
                return;
            }
        }
    }

    /// [`Task::add_splines`] with all pairs of pieces.
    #[cfg(test)]
    fn add_all_pieces(&self, cuts: &Cuts, near: &[(u32, u32)], found: &mut Findings) {
        let (mut p, mut q) = (Vec::new(), Vec::new());
        for &(s, t) in near {
            cuts.vertices(self, 0, s, &mut p);
            cuts.vertices(self, 1, t, &mut q);
            for (k, a) in p.windows(2).enumerate() {
                // A segment with itself: every pair of pieces once.
                let first = if self.is_self() && s == t { k + 1 } else { 0 };
                for b in q.windows(2).skip(first) {
                    self.add_pieces([s, t], [a, b], found);
                }
            }
        }
    }

    /// Adds the passages of two pieces of spline segments.
    fn add_pieces(&self, [s, t]: [u32; 2], pieces: [&[Vertex]; 2], found: &mut Findings) {
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
}

/// Returns an end that two pieces share in both frames.
#[inline(always)]
fn joint(before: &Edges, after: &Edges) -> Option<[Point; 2]> {
    let ends = [(0, 0), (0, 1), (1, 0), (1, 1)];
    let shared =
        |&(k, l): &(usize, usize)| before[0][k] == before[1][l] && after[0][k] == after[1][l];
    let (k, _) = ends.into_iter().find(shared)?;
    Some([before[0][k], after[0][k]])
}

/// Adds pairs of different children of the same node, above the leaves, with overlapping boxes.
/// Their descendants contain every pair of segments of different leaves once.
fn above_the_leaves(tree: CurveTree<'_>, agenda: &mut Agenda) {
    let mut nodes = vec![tree.root()];
    let mut leaf = BoxGroup::EMPTY;
    while let Some(node) = nodes.pop() {
        if node.level == 0 {
            continue;
        }
        let boxes = *tree.children(node, &mut leaf);
        for k in 0..BLOCK {
            let bounds = boxes.lane(k as usize);
            if bounds == Box3::EMPTY {
                break;
            }
            nodes.push(node.child(k));
            let lanes = overlapping(Portable, &bounds, &boxes);
            let later = (k + 1..BLOCK).filter(|l| lanes >> l & 1 != 0);
            agenda.extend(later.map(|l| (node.child(k), node.child(l))));
        }
    }
}

/// A vertex of a polyline that replaces a spline.
#[derive(Clone, Copy, Debug)]
struct Vertex {
    /// Parameter in the segment.
    at: f64,
    /// Position in both frames.
    points: [Point; 2],
}

/// Sieve for polylines whose vertices move from one frame to the next. Two parts are apart if a
/// coordinate separates them on the same side in both frames, and so at all times in between. The
/// same test comes first for two pieces.
struct MovingBoxes;

impl Sieve<Vertex> for MovingBoxes {
    /// Box in each frame: smallest and largest coordinates.
    type Bounds = [[Point; 2]; 2];

    fn bounds(&self, vertices: &[Vertex]) -> Self::Bounds {
        [0, 1].map(|frame| {
            let (mut lo, mut hi) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
            for vertex in vertices {
                for (x, v) in vertex.points[frame].into_iter().enumerate() {
                    lo[x] = if v < lo[x] { v } else { lo[x] };
                    hi[x] = if v > hi[x] { v } else { hi[x] };
                }
            }
            [lo, hi]
        })
    }

    fn apart(&self, first: &Self::Bounds, second: &Self::Bounds) -> bool {
        let below = |a: &Self::Bounds, b: &Self::Bounds, x: usize| {
            (0..2).all(|frame| a[frame][1][x] < b[frame][0][x])
        };
        (0..3).any(|x| below(first, second, x) || below(second, first, x))
    }
}

/// Splits of the segments of both curves, in addition to the even split of all segments.
#[derive(Debug, Default)]
struct Cuts {
    /// Segment and parameter, sorted.
    at: [Vec<(u32, f64)>; 2],
    close: Vec<(u32, u32)>,
    halving: Halving,
}

impl Cuts {
    /// Computes the splits for both frames, of all segments that are too near in them. Returns two
    /// segments if they are too close to split.
    fn fill(&mut self, task: &Task<'_>, near: &[(u32, u32)]) -> Result<(), [u32; 2]> {
        let Cuts { at, close, halving } = self;
        at.iter_mut().for_each(Vec::clear);
        for set in task.step.frames {
            let separation = Separation::new(set, task.curves);
            close.clear();
            separation.add_close(near, close);
            if task.is_self() {
                // Adjacent segments are joined, so no split separates them.
                close.retain(|&(s, t)| !task.adjacent(s, t));
            }
            if close.is_empty() {
                continue;
            }
            separation.refine(close, halving)?;
            for (side, splits) in halving.splits.iter().enumerate() {
                at[if task.is_self() { 0 } else { side }].extend_from_slice(&splits.at);
            }
        }
        for at in at.iter_mut() {
            at.sort_unstable_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
            at.dedup();
        }
        Ok(())
    }

    /// Replaces `out` by the vertices of the polyline of a segment of one of the curves, including
    /// its ends.
    fn vertices(&self, task: &Task<'_>, side: usize, s: u32, out: &mut Vec<Vertex>) {
        let at = &self.at[if task.is_self() { 0 } else { side }];
        let start = at.partition_point(|c| c.0 < s);
        let splits = at[start..].iter().take_while(|c| c.0 == s).map(|c| c.1);
        out.clear();
        let (i, frames) = (task.curves[side], task.step.frames);
        out.push(Vertex {
            at: 0.0,
            points: frames.map(|set| set.knot(i, s as usize)),
        });
        let segments = frames.map(|set| set.segment(i, s as usize));
        let even = (1..PIECES).map(|k| f64::from(k) / f64::from(PIECES));
        for at in even.chain(splits) {
            out.push(Vertex {
                at,
                points: segments.map(|b| point_at(&b, at)),
            });
        }
        out[1..].sort_unstable_by(|a, b| a.at.total_cmp(&b.at));
        out.dedup_by_key(|v| v.at);
        out.push(Vertex {
            at: 1.0,
            points: frames.map(|set| set.knot(i, s as usize + 1)),
        });
    }
}
