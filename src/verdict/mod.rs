//! Verdict on a frame: findings, defects, work counters, and the abort policy.

#![cfg_attr(
    not(all(feature = "cli", feature = "rerun")),
    allow(dead_code, unused_imports, reason = "both together use all")
)]

mod change;
mod clearance;
mod finding;
mod lasting;
mod left_out;
mod message;
mod policy;

pub use change::{Change, ChangeKind, ImageLink, InvariantChange, Link, LoopPair, PullThrough};
pub use clearance::{Clearance, CloseStrands};
pub(crate) use finding::{Finding, Spot};
pub use lasting::Lasting;
pub(crate) use lasting::PreviousFindings;
pub use left_out::LeftOut;
pub(crate) use message::{
    label_of_curve, label_of_pair, words_of_count, words_of_frame, words_of_pair,
    words_of_roll_back,
};
pub use policy::AbortOn;

use crate::curve::{Image, Point};
#[cfg(feature = "verify")]
use crate::periodic::ImagePair;

vocabulary! {
    /// Result of comparing the topology of a frame with that of the baseline.
    #[repr(u32)]
    pub enum Verdict {
        /// Every linking number was proven to be the expected one.
        Intact = "intact",
        /// At least one linking number differs from the expected one, or a curve was pulled through
        /// another one or through itself since the previous frame.
        Changed = "changed",
        /// Curves touch, so their linking number is undefined. No pair is known to have changed.
        Contact = "contact",
        /// Some pair could not be decided or compared. No pair is known to have changed or to
        /// touch.
        Undecided = "undecided",
        /// The frame was not verified in time.
        Stale = "stale",
        /// The frame is invalid: NaN, counts that do not match the data, or other curves than in
        /// the previous frame.
        Rejected = "rejected",
    }
}

impl Verdict {
    /// Returns the verdict with this code on the wire.
    pub fn from_code(code: u32) -> Option<Verdict> {
        Self::ALL.get(code as usize).copied()
    }
}

/// Place at which two curves are closest (the point of closest approach, POCA).
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Place {
    /// Segment of the first curve and segment of the second, from 0.
    pub segments: [u32; 2],
    /// Midpoint of the shortest connection, in the units of the simulation.
    pub point: Point,
    /// Length of the shortest connection: the distance of the two curves.
    pub distance: f64,
}

vocabulary! {
    /// Reason why a pair, or every pair of a curve, has no linking number, or why its pull-throughs
    /// in a step are unknown.
    #[non_exhaustive]
    #[repr(u32)]
    pub enum DefectKind {
        /// The curves share a point.
        Contact = "contact",
        /// The splines are closer than their points can be computed, or too close over too long a
        /// distance to refine.
        TooClose = "too-close",
        /// The loop has fewer than three distinct vertices, so it bounds no area.
        Degenerate = "degenerate",
        /// The pair has a linking number now, but none in the baseline to compare it with. This
        /// linking number is expected from this frame on.
        NoBaseline = "no-baseline",
        /// Pull-throughs of the pair since the previous frame are undecided, because the curves
        /// touched or came too close.
        UndecidedStep = "undecided-step",
        /// The change of the linking number differs from the sum of the pull-throughs since the
        /// previous frame.
        Unaccounted = "unaccounted",
    }
}

impl DefectKind {
    /// Returns true if the defect concerns the step from the previous frame, not a linking number.
    pub fn is_of_step(self) -> bool {
        matches!(self, DefectKind::UndecidedStep | DefectKind::Unaccounted)
    }

    /// Returns the predicate of a sentence about curves: "curves 3 and 4 ..".
    pub fn words(self) -> &'static str {
        match self {
            DefectKind::Contact => "touch",
            DefectKind::TooClose => "are too close to decide",
            DefectKind::Degenerate => "has fewer than three distinct vertices",
            DefectKind::NoBaseline => "had no linking number to compare with until now",
            DefectKind::UndecidedStep => "may have passed through one another: too close to decide",
            DefectKind::Unaccounted => {
                "have a change of linking number that differs from the sum of their pull-throughs"
            }
        }
    }
}

/// A pair (or a curve) that could not be decided or compared. It never hides the findings about
/// other pairs.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Defect {
    /// First curve, from 0.
    pub i: u32,
    /// Second curve: greater than `i`, or equal if a curve meets itself. `None` if the defect
    /// concerns a single curve.
    pub j: Option<u32>,
    /// Translation of the second curve, in multiples of the lattice vectors of the
    /// [`Cell`](crate::Cell). 0 without a cell.
    pub image: Image,
    /// Reason.
    pub kind: DefectKind,
    /// Place.
    pub place: Place,
}

impl Defect {
    /// Returns a defect of two curves, or of a curve and itself, without a cell.
    pub(crate) fn of_pair((i, j): (u32, u32), kind: DefectKind, place: Place) -> Defect {
        Defect {
            i,
            j: Some(j),
            image: Default::default(),
            kind,
            place,
        }
    }

    /// Sorts defects by their curves and their image. The sort is stable.
    #[cfg(feature = "verify")]
    pub(crate) fn sort(defects: &mut [Defect]) {
        defects.sort_by_key(|d| (d.i, d.j, d.image));
    }

    /// Returns the two curves, the second one translated, or `None` for a single curve.
    #[cfg(feature = "verify")]
    pub(crate) fn pair(&self) -> Option<ImagePair> {
        let (i, j, image) = (self.i, self.j?, self.image);
        Some(ImagePair { i, j, image })
    }

    /// Returns this defect of a single curve for its pairs with other curves.
    pub(crate) fn with_each_of(self, others: &[u32]) -> impl Iterator<Item = Defect> + '_ {
        let others = others.iter().filter(move |&&j| j != self.i);
        others.map(move |&j| Defect {
            i: self.i.min(j),
            j: Some(self.i.max(j)),
            ..self
        })
    }
}

/// Work counters of a verdict. They do not depend on the number of threads.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[non_exhaustive]
pub struct Stats {
    /// Number of curves.
    pub curves: u64,
    /// Number of segments.
    pub segments: u64,
    /// Number of open curves. They are skipped, because linking numbers are defined for closed
    /// curves only.
    pub open_curves: u64,
    /// Number of polyline vertices that equal their predecessor. They are merged, which changes no
    /// linking number.
    pub repeated_vertices: u64,
    /// Number of pairs of curves with overlapping boxes (potential links). All other pairs are
    /// unlinked.
    pub potential_links: u64,
    /// Number of potential links with linking number 0, proven before any test of segments: a plane
    /// orthogonal to a diagonal of the axes separates the curves, or their projections along some
    /// direction do not overlap.
    pub separated: u64,
    /// Number of segment pairs tested for a crossing.
    pub tests: u64,
    /// Number of counted crossings.
    pub crossings: u64,
    /// Number of pairs of spline segments that the discretization tested, because their boxes
    /// overlap in space.
    pub overlaps: u64,
    /// Number of points that the discretization added.
    pub refined: u64,
    /// Number of tests that floating point could not decide and exact arithmetic decided.
    pub exact: u64,
    /// Number of potential links that were skipped after the first change (early exit).
    pub unchecked: u64,
    /// Extent of the scene: longest side of the bounding box of the first frame, in the units of
    /// the simulation. Coordinates in messages have six significant digits at this scale. 0 if
    /// unknown.
    pub extent: f64,
}

impl Stats {
    /// Returns the share of the tests that exact arithmetic decided, from 0 to 1.
    pub fn exact_share(&self) -> f64 {
        self.exact as f64 / self.tests.max(1) as f64
    }

    /// Adds the counters of another part of the same frame.
    pub fn add(&mut self, o: &Stats) {
        self.curves += o.curves;
        self.segments += o.segments;
        self.open_curves += o.open_curves;
        self.repeated_vertices += o.repeated_vertices;
        self.potential_links += o.potential_links;
        self.separated += o.separated;
        self.tests += o.tests;
        self.crossings += o.crossings;
        self.overlaps += o.overlaps;
        self.refined += o.refined;
        self.exact += o.exact;
        self.unchecked += o.unchecked;
        self.extent = self.extent.max(o.extent);
    }
}

/// Report about one frame. It does not depend on the machine, the clock or the number of threads:
/// the replay of a recording gives equal reports.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
#[must_use]
#[non_exhaustive]
pub struct Report {
    /// Sequence number of the frame, counted by the simulator.
    pub seq: u64,
    /// Simulation time of the frame, in seconds.
    pub time: f64,
    /// Verdict on the frame.
    pub verdict: Verdict,
    /// True if the policy asks the simulator to stop.
    pub abort: bool,
    /// Linking numbers that differ from the expected ones, sorted by pair.
    pub changes: Vec<Change>,
    /// Pull-throughs since the last verified frame, in chronological order. Empty if they are not
    /// searched for ([`Events`](crate::Events)).
    pub events: Vec<PullThrough>,
    /// Pull-throughs that cannot be resolved, because the frames are too far apart: they cancel
    /// within their pair, and moved further than
    /// [the limit](crate::SessionOptions::motion_limit). In chronological order.
    pub unresolved: Vec<PullThrough>,
    /// Invariants of knots and of triples of curves that differ from the expected ones, sorted
    /// ([`SessionOptions::invariants`](crate::SessionOptions::invariants)).
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub invariants: Vec<InvariantChange>,
    /// Pairs and curves that could not be decided or compared, sorted by pair.
    pub defects: Vec<Defect>,
    /// Nonzero linking numbers that the baseline lacked, sorted by pair. They are expected from
    /// this frame on ([`DefectKind::NoBaseline`]).
    pub adopted: Vec<Link>,
    /// Last frame that is known to be intact: this one, or the one to which a simulator can roll
    /// back. After a change, a pull-through, or a step that is undecided, no later frame is known
    /// to be intact until [a cut](crate::Session::cut). `None` if there was no such frame yet.
    pub last_intact: Option<u64>,
    /// Largest proven fraction of the step from the last intact frame before this one, from 0 to 1,
    /// during which nothing was pulled through and no curves came into contact that did not touch
    /// at its start. 1 stands for this frame itself; 0 if nothing is proven. Otherwise it is just
    /// before the first pull-through, usually within a millionth of the step.
    ///
    /// A simulator can go on from `x0 + f (x1 - x0)`, where `f` is this fraction, `x0` are the
    /// positions in the last intact frame, and `x1` those in this frame. The step to this state is
    /// proven, with every operation rounded to the precision of the coordinates. Two curves almost
    /// touch there, so a simulator with soft contacts goes back further. `None` if pull-throughs
    /// are not searched for, or if the last verified frame before this one was not intact.
    pub safe_fraction: Option<f64>,
    /// Clearance of the strands, if it is measured (`SessionOptions::clearance`). It changes no
    /// verdict. It may depend on earlier frames, within the bounds that it states.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub clearance: Option<Clearance>,
    /// Names of the curves that appeared since the last verified frame. Their linking numbers are
    /// expected from this frame on.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub appeared: Vec<String>,
    /// Names of the curves that are gone since the last verified frame.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub gone: Vec<String>,
    /// Reasons why a part of the frame was not verified.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub missing: Vec<String>,
    /// Elements that may be curves and were not read ([`FrameInfo::left_out`](crate::FrameInfo)).
    /// They change no verdict.
    #[serde(skip)]
    pub left_out: Vec<LeftOut>,
    /// The real curves of findings about virtual loops of braids
    /// ([`SessionOptions::braids`](crate::SessionOptions::braids)), sorted by pair.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub loops: Vec<LoopPair>,
    /// Reason why the frame was rejected.
    pub rejected: Option<String>,
    /// Work counters.
    pub stats: Stats,
}

impl Report {
    /// Returns the verdict that follows from the findings.
    pub(crate) fn verdict_of_findings(&self) -> Verdict {
        let changes = self.changes.len() + self.events.len() + self.invariants.len();
        let undecided = self.defects.len() + self.unresolved.len() + self.missing.len();
        match (changes, undecided) {
            (1.., _) => Verdict::Changed,
            _ if self.has_contact() => Verdict::Contact,
            (0, 1..) => Verdict::Undecided,
            (0, 0) => Verdict::Intact,
        }
    }

    /// Creates a report without findings and counters, which does not ask the simulator to stop.
    pub fn new(seq: u64, time: f64, verdict: Verdict) -> Report {
        Report {
            seq,
            time,
            verdict,
            abort: false,
            changes: Vec::new(),
            events: Vec::new(),
            unresolved: Vec::new(),
            invariants: Vec::new(),
            defects: Vec::new(),
            adopted: Vec::new(),
            last_intact: None,
            safe_fraction: None,
            clearance: None,
            appeared: Vec::new(),
            gone: Vec::new(),
            missing: Vec::new(),
            left_out: Vec::new(),
            loops: Vec::new(),
            rejected: None,
            stats: Stats::default(),
        }
    }
}
