//! Candidates to a number: eight at a time in floating point, one by one exactly where that cannot decide.

use crate::curve::{CurveSet, Point};
use crate::discretize::Splits;
use crate::exact::{Batch, Crossing, Predicates, crossing, segments_touch};
use crate::verdict::Stats;

/// The signed count of one pair of curves, in one direction.
pub(super) struct Count<'a> {
    set: &'a CurveSet,
    /// Upper and lower curve.
    curves: [usize; 2],
    axis: usize,
    predicates: Predicates,
    sum: i64,
    /// First pair of segments that touch.
    contact: Option<[u32; 2]>,
    pub stats: Stats,
}

impl<'a> Count<'a> {
    pub fn new(set: &'a CurveSet, curves: [usize; 2], axis: usize) -> Self {
        Count {
            set,
            curves,
            axis,
            predicates: Predicates::default(),
            sum: 0,
            contact: None,
            stats: Stats::default(),
        }
    }

    /// The sum of the signs so far.
    pub fn sum(&self) -> i64 {
        self.sum
    }

    /// The first pair of segments found to touch, in their order along the curves.
    pub fn contact(&self) -> Option<[u32; 2]> {
        self.contact
    }

    /// Work done.
    pub fn stats(&self) -> Stats {
        Stats {
            exact: self.predicates.exact,
            ..self.stats
        }
    }

    fn edge(&self, side: usize, s: u32) -> (Point, Point) {
        let i = self.curves[side];
        (
            self.set.knot(i, s as usize),
            self.set.knot(i, s as usize + 1),
        )
    }

    /// Looks for contact among polyline segments whose boxes overlap. A contact at a vertex is invisible to
    /// the crossing test, which resolves ties by a translation.
    pub fn touches(&mut self, overlaps: &[(u32, u32)]) {
        self.stats.overlaps += overlaps.len() as u64;
        // Three corners in one plane are common in contact only; exact calls made here are not the crossing
        // tests' and are not counted with them.
        let mut predicates = Predicates::default();
        for &(s, t) in overlaps {
            let ((p0, p1), (q0, q1)) = (self.edge(0, s), self.edge(1, t));
            if segments_touch(p0, p1, q0, q1, &mut predicates) {
                self.found_contact([s, t]);
            }
        }
    }

    fn found_contact(&mut self, segments: [u32; 2]) {
        // The least one in the order of the curves, whatever the order of the visits.
        self.contact = Some(self.contact.map_or(segments, |c| c.min(segments)));
    }

    /// Adds whole segments.
    #[inline(always)]
    pub fn add(&mut self, tests: &[(u32, u32)]) {
        self.stats.tests += tests.len() as u64;
        let axes = [(self.axis + 1) % 3, (self.axis + 2) % 3, self.axis];
        let mut batch = Batch::EMPTY;
        let [upper, lower] = self.curves.map(|i| self.set.knots(i));
        for chunk in tests.chunks(8) {
            for (lane, &(s, t)) in chunk.iter().enumerate() {
                for (x, &axis) in axes.iter().enumerate() {
                    let ([p0, p1], [q0, q1]) = (upper.edge(s, axis), lower.edge(t, axis));
                    batch.ends[0][x][lane] = p0;
                    batch.ends[1][x][lane] = p1;
                    batch.ends[2][x][lane] = q0;
                    batch.ends[3][x][lane] = q1;
                }
            }
            let out = batch.evaluate(chunk.len());
            self.sum += i64::from(out.sum);
            self.stats.crossings += u64::from(out.crossings);
            for (lane, &(s, t)) in chunk.iter().enumerate() {
                if out.undecided >> lane & 1 != 0 {
                    self.add_segments(s, t);
                }
            }
        }
    }

    /// Adds segments of splines, each as the polyline that the pair's discretization made of it.
    #[inline(always)]
    pub fn add_split(&mut self, tests: &[(u32, u32)], splits: &[Splits; 2]) {
        if splits.iter().all(Splits::is_empty) {
            return self.add(tests);
        }
        let is_split = |&(s, t): &(u32, u32)| splits[0].splits(s) || splits[1].splits(t);
        let whole: Vec<_> = tests.iter().copied().filter(|p| !is_split(p)).collect();
        self.add(&whole);
        let (mut upper, mut lower) = (Vec::new(), Vec::new());
        for &(s, t) in tests.iter().filter(|p| is_split(p)) {
            splits[0].polyline(self.set, self.curves[0], s, &mut upper);
            splits[1].polyline(self.set, self.curves[1], t, &mut lower);
            for p in upper.windows(2) {
                for q in lower.windows(2) {
                    self.stats.tests += 1;
                    self.add_edges((p[0], p[1]), (q[0], q[1]), [s, t]);
                }
            }
        }
    }

    fn add_segments(&mut self, s: u32, t: u32) {
        self.add_edges(self.edge(0, s), self.edge(1, t), [s, t]);
    }

    fn add_edges(&mut self, p: (Point, Point), q: (Point, Point), segments: [u32; 2]) {
        match crossing(p.0, p.1, q.0, q.1, self.axis, &mut self.predicates) {
            Crossing::None => {}
            Crossing::Over(sign) => {
                self.sum += i64::from(sign);
                self.stats.crossings += 1;
            }
            Crossing::Contact => self.found_contact(segments),
        }
    }
}
