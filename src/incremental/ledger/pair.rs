//! The passages of one pair of curves, or of a curve and itself.

use super::net::{Found, cancel};
use super::{Counts, Marked, PullThrough};
use crate::certificate::Link;
#[cfg(target_arch = "x86_64")]
use crate::curve::Avx2;
use crate::curve::{BoxGroup, CurveSet, LANES, Lanes, Point, Portable, point_at};
use crate::discretize::{Halving, MovingSeparation, Separation};
use crate::exact::{Decided, Edges, Ties, passages};
use crate::pairs::{
    Agenda, CurveTree, Node, Pair, Query, SegmentPairs, Trees, closest_of_segments, descend,
};
use crate::verdict::{Defect, DefectKind};
use std::sync::atomic::{AtomicU64, Ordering};

/// Pieces of a spline segment, at least.
const PIECES: u32 = 4;

/// Candidates at which they are looked at.
const BATCH: usize = 4096;

/// Node pairs after which candidates are looked at, however few.
const STEPS: usize = 4096;

/// Rounds of these after which a task shares out what is left.
const ROUNDS: usize = 3;

/// Near pairs of spline segments that are worth a task of their own.
const GRAIN: usize = 1 << 12;

/// Candidates of one pair of curves at which it counts as too close: where everything may have passed through
/// everything, a list of passages helps nobody. Half a second.
const MAX_CANDIDATES: u64 = 1 << 24;

/// A step from one frame to the next.
#[derive(Clone, Copy)]
pub(super) struct Step<'a> {
    pub frames: [&'a CurveSet; 2],
    /// Of swept boxes.
    pub trees: &'a Trees,
    pub marked: Option<Marked<'a>>,
}

/// What one task found.
#[derive(Debug, Default)]
pub(super) struct Part {
    pub events: Vec<PullThrough>,
    pub undecided: Vec<Defect>,
    pub sums: Vec<Link>,
    pub counts: Counts,
}

impl Part {
    pub fn clear(&mut self) {
        self.events.clear();
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

/// What a descent gathered of one pair.
#[derive(Debug, Default)]
struct Gathered {
    agenda: Agenda,
    candidates: SegmentPairs,
    /// Spline segments that may meet.
    near: Vec<(u32, u32)>,
    found: Tally,
}

/// Passages and what became of the other tests.
#[derive(Debug, Default)]
struct Tally {
    passages: Vec<Found>,
    /// Segments that touch in a way that cannot be told from a passage.
    ties: Vec<[u32; 2]>,
    counts: Counts,
}

impl Tally {
    fn clear(&mut self) {
        self.passages.clear();
        self.ties.clear();
        self.counts = Counts::default();
    }

    fn append(&mut self, other: &mut Tally) {
        self.passages.append(&mut other.passages);
        self.ties.append(&mut other.ties);
        self.counts.add(&other.counts);
    }
}

impl<'a> Step<'a> {
    /// Adds the passages of a pair of curves.
    pub fn pair(&self, pair: Pair, workspace: &mut Workspace, part: &mut Part) {
        let task = Task::new(*self, pair);
        let Workspace { gathered, cuts } = workspace;
        gathered.near.clear();
        gathered.found.clear();
        gathered.agenda.clear();
        gathered.found.counts.pairs = 1;
        task.start(gathered);
        task.gather(gathered);
        let Gathered { near, found, .. } = gathered;
        let [i, j] = task.curves;
        let undecided = |kind, segments| Defect {
            i: i as u32,
            j: Some(j as u32),
            kind,
            place: closest_of_segments(self.frames[1], [i, j], segments),
        };
        if task.entangled() {
            part.undecided.push(undecided(DefectKind::TooClose, [0, 0]));
            part.counts.add(&found.counts);
            return;
        }
        if !near.is_empty() {
            near.sort_unstable();
            // A closed curve of two segments has each of them after the other.
            near.dedup();
            if let Err(segments) = cuts.fill(&task, near) {
                part.undecided
                    .push(undecided(DefectKind::TooClose, segments));
                part.counts.add(&found.counts);
                return;
            }
            task.add_splines_shared(cuts, near, found);
        }
        part.counts.add(&found.counts);
        found.ties.sort_unstable();
        found.ties.dedup();
        let ties = found.ties.iter();
        part.undecided
            .extend(ties.map(|&segments| undecided(DefectKind::Contact, segments)));
        let curves = [i, j].map(|i| self.frames[0].curve(i));
        cancel(&mut found.passages, curves);
        part.events.extend(found.passages.iter().map(|f| f.event));
        let lambda = found.passages.iter().map(|f| i64::from(f.event.sign)).sum();
        if i != j && lambda != 0 && curves.iter().all(|c| c.closed) {
            let (i, j) = pair;
            part.sums.push(Link { i, j, lambda });
        }
    }
}

/// One pair of curves, or a curve and itself.
struct Task<'a> {
    step: Step<'a>,
    curves: [usize; 2],
    separation: MovingSeparation<'a>,
    /// Of all tasks of the pair.
    candidates: AtomicU64,
}

impl<'a> Task<'a> {
    fn new(step: Step<'a>, (i, j): Pair) -> Self {
        let curves = [i as usize, j as usize];
        Task {
            step,
            curves,
            separation: MovingSeparation::new(step.frames, curves),
            candidates: AtomicU64::new(0),
        }
    }

    /// Whether the curves are one.
    fn own(&self) -> bool {
        self.curves[0] == self.curves[1]
    }

    fn splines(&self) -> bool {
        !self.step.frames[0].basis().is_polyline()
    }

    /// Whether there are more candidates than are looked at. Some are lost then.
    fn entangled(&self) -> bool {
        self.candidates.load(Ordering::Relaxed) > MAX_CANDIDATES
    }

    fn tree(&self, side: usize) -> CurveTree<'a> {
        self.step.trees.of(self.step.frames[0], self.curves[side])
    }

    /// Node pairs to start with.
    fn start(&self, gathered: &mut Gathered) {
        let (first, second) = (self.tree(0), self.tree(1));
        if !self.own() {
            gathered.agenda.push((first.root(), second.root()));
            return;
        }
        gathered.candidates.all.clear();
        off_diagonal(first, first.root(), gathered);
        self.look_at_candidates(gathered);
        if self.splines() {
            self.add_neighbours(&mut gathered.near);
        }
    }

    /// Adds the segments of a curve, with themselves and their successors, along which it does not run one way.
    fn add_neighbours(&self, near: &mut Vec<(u32, u32)>) {
        let curve = self.step.frames[0].curve(self.curves[0]);
        let n = curve.segments;
        for s in 0..n {
            let next = if s + 1 < n { s + 1 } else { 0 };
            // An open curve ends.
            let next = if next == 0 && !curve.closed { s } else { next };
            if self.is_marked(s, next) && !self.separation.one_way(s, next) {
                near.push((s, s));
                if s != next {
                    near.push((s.min(next), s.max(next)));
                }
            }
        }
    }

    fn is_marked(&self, s: u32, t: u32) -> bool {
        let [i, j] = self.curves;
        let block = |s: u32| s / LANES as u32;
        self.step
            .marked
            .is_none_or(|marked| marked(i, block(s)) || marked(j, block(t)))
    }

    /// Whether two segments of one curve follow one another.
    fn adjacent(&self, s: u32, t: u32) -> bool {
        let curve = self.step.frames[0].curve(self.curves[0]);
        let apart = s.abs_diff(t);
        apart <= 1 || (curve.closed && apart == curve.segments - 1)
    }

    /// Visits everything below the node pairs of the agenda.
    fn gather(&self, gathered: &mut Gathered) {
        #[cfg(target_arch = "x86_64")]
        if let Some(avx2) = Avx2::detect() {
            #[expect(unsafe_code, reason = "vector instructions")]
            // SAFETY: the token says that the processor has them.
            return unsafe { self.gather_avx2(avx2, gathered) };
        }
        self.gather_with(Portable, gathered);
    }

    /// [`Task::gather_with`], compiled with AVX2.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2,bmi1,bmi2,popcnt")]
    fn gather_avx2(&self, avx2: Avx2, gathered: &mut Gathered) {
        self.gather_with(avx2, gathered);
    }

    #[inline(always)]
    fn gather_with<L: Lanes>(&self, simd: L, gathered: &mut Gathered) {
        let both = [self.tree(0), self.tree(1)];
        let query = Query {
            w: 2,
            meeting: false,
        };
        for round in 0.. {
            if gathered.agenda.is_empty() {
                return;
            }
            if round >= ROUNDS && gathered.agenda.len() > 1 {
                return self.share(gathered);
            }
            let Gathered {
                agenda, candidates, ..
            } = gathered;
            descend::<L, true>(simd, both, query, agenda, candidates, (STEPS, BATCH));
            self.look_at_candidates(gathered);
            if self.entangled() {
                gathered.agenda.clear();
            }
        }
    }

    /// Gathers in two halves.
    #[cold]
    fn share(&self, gathered: &mut Gathered) {
        let mut other = Gathered::default();
        // Every second one: node pairs at the bottom have more below them.
        let mut mine = false;
        gathered.agenda.retain(|&pair| {
            mine = !mine;
            if !mine {
                other.agenda.push(pair);
            }
            mine
        });
        rayon::join(|| self.gather(gathered), || self.gather(&mut other));
        gathered.near.append(&mut other.near);
        gathered.found.append(&mut other.found);
    }

    /// Tests candidates that are edges; keeps those that are splines and may meet.
    #[inline(always)]
    fn look_at_candidates(&self, gathered: &mut Gathered) {
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
        let own = self.own();
        for &(s, t) in candidates.iter() {
            if (own && self.adjacent(s, t)) || !self.is_marked(s, t) {
                continue;
            }
            if !self.splines() {
                self.add_edges(s, t, found);
            } else if !self.separation.apart(s, t) {
                near.push((s, t));
            }
        }
        candidates.clear();
    }

    /// Adds the passages of two edges of polylines.
    fn add_edges(&self, s: u32, t: u32, found: &mut Tally) {
        let [i, j] = self.curves;
        let edges = |set: &CurveSet| {
            [(i, s), (j, t)].map(|(i, s)| [set.knot(i, s as usize), set.knot(i, s as usize + 1)])
        };
        let [before, after] = self.step.frames.map(edges);
        let along = |at: [f64; 2]| [f64::from(s) + at[0], f64::from(t) + at[1]];
        self.add_passages(&before, &after, [s, t], along, found);
    }

    /// Adds the passages of two pieces, which are within these segments, and `along` both curves.
    #[inline(always)]
    fn add_passages(
        &self,
        before: &Edges,
        after: &Edges,
        segments: [u32; 2],
        along: impl Fn([f64; 2]) -> [f64; 2],
        found: &mut Tally,
    ) {
        if before == after || joined(before, after) {
            return;
        }
        let ties = if self.own() {
            Ties::Report
        } else {
            Ties::Translate
        };
        let [i, j] = self.curves.map(|i| i as u32);
        let Tally {
            passages: list,
            ties: touching,
            counts,
        } = found;
        let decided = passages(before, after, ties, &mut |p| {
            list.push(Found {
                event: PullThrough {
                    i,
                    j,
                    segments,
                    fraction: p.time,
                    sign: p.sign,
                    point: p.point,
                },
                along: along(p.at),
            });
        });
        counts.tests += 1;
        counts.exact += u64::from(matches!(decided, Decided::Exact | Decided::Tie));
        if decided == Decided::Tie {
            touching.push(segments);
        }
    }

    /// Adds the passages of near spline segments, in parts that are shared out.
    fn add_splines_shared(&self, cuts: &Cuts, near: &[(u32, u32)], found: &mut Tally) {
        if near.len() <= GRAIN {
            return self.add_splines(cuts, near, found);
        }
        let (left, right) = near.split_at(near.len() / 2);
        let mut other = Tally::default();
        rayon::join(
            || self.add_splines_shared(cuts, left, found),
            || self.add_splines_shared(cuts, right, &mut other),
        );
        found.append(&mut other);
    }

    /// Adds the passages of near spline segments, sorted.
    fn add_splines(&self, cuts: &Cuts, near: &[(u32, u32)], found: &mut Tally) {
        let (mut p, mut q) = (Vec::new(), Vec::new());
        let mut last = None;
        found.counts.near += near.len() as u64;
        for &(s, t) in near {
            if last != Some(s) {
                cuts.vertices(self, 0, s, &mut p);
                last = Some(s);
            }
            cuts.vertices(self, 1, t, &mut q);
            for (k, a) in p.windows(2).enumerate() {
                // A segment with itself: every two pieces once.
                let first = if self.own() && s == t { k + 1 } else { 0 };
                for b in q.windows(2).skip(first) {
                    let edges = |f: usize| [a, b].map(|piece| [0, 1].map(|k| piece[k].points[f]));
                    let along = |at: [f64; 2]| {
                        let mix = |piece: &[Vertex], at: f64| {
                            piece[0].at + at * (piece[1].at - piece[0].at)
                        };
                        [f64::from(s) + mix(a, at[0]), f64::from(t) + mix(b, at[1])]
                    };
                    self.add_passages(&edges(0), &edges(1), [s, t], along, found);
                }
            }
        }
    }
}

/// Whether two pieces share an end in both frames.
#[inline(always)]
fn joined(before: &Edges, after: &Edges) -> bool {
    (0..2).any(|k| (0..2).any(|l| before[0][k] == before[1][l] && after[0][k] == after[1][l]))
}

/// Adds pairs of different nodes or segments below a node whose boxes overlap, each pair once: nodes to the agenda,
/// segments to the candidates.
fn off_diagonal(tree: CurveTree<'_>, node: Node, gathered: &mut Gathered) {
    let mut room = BoxGroup::EMPTY;
    let group = *tree.children(node, &mut room);
    for k in 0..LANES {
        let own = group.lane(k);
        if own.is_empty() {
            // The curve ends.
            return;
        }
        for l in k + 1..LANES {
            if own.overlaps(&group.lane(l)) {
                let (k, l) = (k as u32, l as u32);
                if node.level > 0 {
                    gathered.agenda.push((node.child(k), node.child(l)));
                } else {
                    gathered.candidates.all.push((node.lane(k), node.lane(l)));
                }
            }
        }
        if node.level > 0 {
            off_diagonal(tree, node.child(k as u32), gathered);
        }
    }
}

/// A vertex of a polyline that stands for a spline.
#[derive(Clone, Copy, Debug)]
struct Vertex {
    /// Its parameter in the segment.
    at: f64,
    /// Where it is in both frames.
    points: [Point; 2],
}

/// Where the segments of both curves are split, beyond the even split of all.
#[derive(Debug, Default)]
struct Cuts {
    /// Segment and parameter, sorted.
    at: [Vec<(u32, f64)>; 2],
    close: Vec<(u32, u32)>,
    halving: Halving,
}

impl Cuts {
    /// Splits for both frames, of all segments that are too near in them. On `Err`, two segments that are too close to
    /// split.
    fn fill(&mut self, task: &Task<'_>, near: &[(u32, u32)]) -> Result<(), [u32; 2]> {
        let Cuts { at, close, halving } = self;
        at.iter_mut().for_each(Vec::clear);
        for set in task.step.frames {
            let separation = Separation::new(set, task.curves);
            close.clear();
            separation.add_close(near, close);
            if task.own() {
                // Neighbours are joined: no split would part them.
                close.retain(|&(s, t)| !task.adjacent(s, t));
            }
            if close.is_empty() {
                continue;
            }
            separation.refine(close, halving)?;
            for (side, splits) in halving.splits.iter().enumerate() {
                at[if task.own() { 0 } else { side }].extend_from_slice(&splits.at);
            }
        }
        for at in at.iter_mut() {
            at.sort_unstable_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
            at.dedup();
        }
        Ok(())
    }

    /// The vertices that stand for a segment of one of the curves, ends included.
    fn vertices(&self, task: &Task<'_>, side: usize, s: u32, out: &mut Vec<Vertex>) {
        let at = &self.at[if task.own() { 0 } else { side }];
        let start = at.partition_point(|c| c.0 < s);
        let own = at[start..].iter().take_while(|c| c.0 == s).map(|c| c.1);
        out.clear();
        let (i, frames) = (task.curves[side], task.step.frames);
        out.push(Vertex {
            at: 0.0,
            points: frames.map(|set| set.knot(i, s as usize)),
        });
        let segments = frames.map(|set| set.segment(i, s as usize));
        let even = (1..PIECES).map(|k| f64::from(k) / f64::from(PIECES));
        for at in even.chain(own) {
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
