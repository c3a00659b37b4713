//! Marks of earlier pull-throughs. They stay and move with the curves, so that later frames still
//! show the place where strands passed through one another.

use super::local;
use crate::curve::{CurveSet, Point};
use crate::verdict::Report;
use std::collections::VecDeque;

/// Maximum number of marks, the newest; more would hide the curves.
pub(super) const KEPT: usize = 300;

/// Pull-throughs of a run so far.
#[derive(Debug, Default)]
pub(super) struct Passed {
    /// Curve, segment and parameter of the newest ones.
    pub marks: VecDeque<(u32, u32, f64)>,
    /// Number of all so far, and the frame of the last.
    total: Option<(u64, u64)>,
}

impl Passed {
    /// Adds those of a frame, with the nearest points of its curves.
    pub fn add(&mut self, report: &Report, set: Option<&CurveSet>) {
        if report.events.is_empty() {
            return;
        }
        let count = self.total.map_or(0, |(count, _)| count) + report.events.len() as u64;
        self.total = Some((count, report.seq));
        let marks = report.events.iter().map(|e| {
            let (i, s) = (e.i, e.segments[0]);
            let t = set.and_then(|set| local::nearest(set, i, s, e.point));
            (i, s, t.unwrap_or(0.5))
        });
        self.marks.extend(marks);
        self.marks.drain(..self.marks.len().saturating_sub(KEPT));
    }

    /// Returns the points of the curves where strands passed, at their positions in this frame.
    pub fn points<'a>(&'a self, set: &'a CurveSet) -> impl Iterator<Item = Point> + 'a {
        let place = |&(i, s, t): &(u32, u32, f64)| {
            let (i, s) = (i as usize, s as usize);
            // A set of other curves has other segments.
            let curve = set.curves().get(i)?;
            (s < curve.segments as usize).then(|| set.eval(i, s, t))
        };
        self.marks.iter().filter_map(place)
    }

    /// Returns their number and the frame of the last, or `None` if there are none.
    pub fn words(&self) -> Option<String> {
        let (count, last) = self.total?;
        Some(match count {
            1 => format!("1 pull-through so far, in frame {last}"),
            n => format!("{n} pull-throughs so far, the last in frame {last}"),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::curve::{Basis, Positions};
    use crate::verdict::{PullThrough, Verdict};

    fn report(seq: u64, events: Vec<PullThrough>) -> Report {
        Report {
            abort: true,
            events,
            ..Report::new(seq, 0.0, Verdict::Changed)
        }
    }

    fn event(i: u32, segment: u32) -> PullThrough {
        PullThrough {
            i,
            j: i,
            image: Default::default(),
            segments: [segment, 0],
            fraction: 0.5,
            sign: 1,
            point: [0.0; 3],
            lengths: 0.5,
        }
    }

    /// A triangle at height `z`.
    fn triangle(z: f32) -> CurveSet {
        let points = [0.0, 0.0, z, 2.0, 0.0, z, 0.0, 2.0, z];
        CurveSet::from_counts(Basis::Polyline, &[-3], Positions::F32(&points)).unwrap()
    }

    #[test]
    fn marks_stay_on_their_segments() {
        let mut passed = Passed::default();
        passed.add(&report(3, vec![event(0, 0), event(0, 1)]), None);
        passed.add(&report(4, Vec::new()), None);
        for z in [0.0, 5.0] {
            let points: Vec<_> = passed.points(&triangle(z)).collect();
            let z = f64::from(z);
            assert_eq!(points, [[1.0, 0.0, z], [1.0, 1.0, z]]);
        }
        // At the nearest point of the curve, if the curves of that frame are present.
        let mut beside = event(0, 0);
        beside.point = [0.5, 1.0, 0.0];
        let mut passed_beside = Passed::default();
        passed_beside.add(&report(3, vec![beside]), Some(&triangle(0.0)));
        let points: Vec<_> = passed_beside.points(&triangle(5.0)).collect();
        assert_eq!(points, [[0.5, 0.0, 5.0]]);
        let words = passed.words().unwrap();
        assert_eq!(words, "2 pull-throughs so far, the last in frame 3");
    }

    #[test]
    fn the_newest_marks_are_kept_and_all_are_counted() {
        let mut passed = Passed::default();
        assert_eq!(passed.words(), None);
        for seq in 0..KEPT as u64 {
            passed.add(&report(seq, vec![event(0, 0), event(0, 1)]), None);
        }
        passed.add(&report(999, vec![event(0, 2)]), None);
        assert_eq!(passed.points(&triangle(0.0)).count(), KEPT);
        let last = passed.points(&triangle(0.0)).last();
        assert_eq!(last, Some([0.0, 1.0, 0.0]));
        let words = passed.words().unwrap();
        assert_eq!(words, "601 pull-throughs so far, the last in frame 999");
    }

    #[test]
    fn other_curves_have_no_marks() {
        let mut passed = Passed::default();
        passed.add(&report(1, vec![event(0, 3), event(1, 0)]), None);
        assert_eq!(passed.points(&triangle(0.0)).count(), 0);
    }
}
