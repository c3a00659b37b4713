//! What is said about a frame: certificate change and policy in, verdict out.

mod change;
mod message;
mod policy;
mod pull_through;

pub use change::{Change, ChangeKind, Link};
pub use policy::AbortOn;
pub use pull_through::PullThrough;

use crate::curve::Point;

/// The answer to "is the topology of this frame the one that it started with?".
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, serde::Serialize)]
#[serde(rename_all = "lowercase")]
#[repr(u32)]
pub enum Verdict {
    /// Every linking number was proven to be the expected one.
    Intact = 0,
    /// At least one linking number is another than expected, or a curve was pulled through another or through itself
    /// since the frame before.
    Changed = 1,
    /// Curves touch: their linking number is not defined. No pair is known to have changed.
    Contact = 2,
    /// Some pair could not be decided or compared. No pair is known to have changed or to touch.
    Undecided = 3,
    /// The frame was not verified in time.
    Stale = 4,
    /// The frame breaks its contract (NaN, counts that lie, other curves than before).
    Rejected = 5,
}

impl Verdict {
    /// Every verdict, in the order of its code on the wire.
    pub const ALL: [Verdict; 6] = [
        Verdict::Intact,
        Verdict::Changed,
        Verdict::Contact,
        Verdict::Undecided,
        Verdict::Stale,
        Verdict::Rejected,
    ];

    /// The verdict with this code on the wire.
    pub fn from_code(code: u32) -> Option<Verdict> {
        Self::ALL.get(code as usize).copied()
    }

    /// One word.
    pub fn word(self) -> &'static str {
        match self {
            Verdict::Intact => "intact",
            Verdict::Changed => "changed",
            Verdict::Contact => "contact",
            Verdict::Undecided => "undecided",
            Verdict::Stale => "stale",
            Verdict::Rejected => "rejected",
        }
    }
}

/// Where two curves come closest to one another (the point of closest approach, POCA).
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Place {
    /// Segment of the first curve and segment of the second, from 0.
    pub segments: [u32; 2],
    /// Middle of the shortest connection, in the units of the simulation.
    pub point: Point,
    /// Its length: the distance of the two curves.
    pub distance: f64,
}

/// Why a pair, or every pair of a curve, has no linking number; or why it is not told what happened to it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
#[repr(u32)]
pub enum DefectKind {
    /// The curves share a point, exactly.
    Contact = 0,
    /// The splines come closer than their points can be computed, or stay close for too long to refine.
    TooClose = 1,
    /// The loop has fewer than three distinct vertices; it bounds nothing.
    Degenerate = 2,
    /// The pair has a linking number now, but had none in the baseline to compare with. It is
    /// expected from this frame on.
    NoBaseline = 3,
    /// Whether one was pulled through the other since the frame before cannot be told: they touched, or came too close.
    Untold = 4,
    /// The linking number changed by another number than the pull-throughs since the frame before add up to.
    Unaccounted = 5,
}

impl DefectKind {
    /// Every kind, in the order of its code in recordings.
    pub const ALL: [DefectKind; 6] = [
        DefectKind::Contact,
        DefectKind::TooClose,
        DefectKind::Degenerate,
        DefectKind::NoBaseline,
        DefectKind::Untold,
        DefectKind::Unaccounted,
    ];

    /// Whether it is about the step from the frame before, not about a linking number.
    pub fn is_of_step(self) -> bool {
        matches!(self, DefectKind::Untold | DefectKind::Unaccounted)
    }

    /// In words, for "curves 3 and 4 ..".
    pub fn words(self) -> &'static str {
        match self {
            DefectKind::Contact => "touch",
            DefectKind::TooClose => "are too close to decide",
            DefectKind::Degenerate => "has fewer than three distinct vertices",
            DefectKind::NoBaseline => "had no linking number to compare with until now",
            DefectKind::Untold => "may have passed through one another: too close to tell",
            DefectKind::Unaccounted => {
                "changed their linking number by more than was pulled through"
            }
        }
    }
}

/// A pair (or a curve) without a verdict of its own. It never hides the verdict on the others.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Defect {
    /// First curve, from 0.
    pub i: u32,
    /// Second curve, greater than `i`, or equal where a curve meets itself; none where the curve alone is the matter.
    pub j: Option<u32>,
    /// What is wrong.
    pub kind: DefectKind,
    /// Where.
    pub place: Place,
}

/// Counts of the work that a verdict took. The same for any number of threads.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Stats {
    /// Curves of the frame.
    pub curves: u64,
    /// Segments of the frame.
    pub segments: u64,
    /// Open curves, left out: linking numbers are defined for closed curves only.
    pub open_curves: u64,
    /// Vertices of polylines that repeat the one before them (merged: they change nothing).
    pub repeated_vertices: u64,
    /// Pairs of curves whose boxes overlap (potential links); all others are unlinked.
    pub potential_links: u64,
    /// Potential links that a direction without any overlap proved to be 0.
    pub separated: u64,
    /// Segment pairs tested for a crossing.
    pub tests: u64,
    /// Crossings counted.
    pub crossings: u64,
    /// Segment pairs of splines whose boxes overlap in space, which the discretization looked at.
    pub overlaps: u64,
    /// Points that the discretization added.
    pub refined: u64,
    /// Tests that floating point could not decide and exact arithmetic did.
    pub exact: u64,
    /// Potential links left out, since the first change was all that was asked for.
    pub unchecked: u64,
    /// Extent of the scene: longest side of the bounding box of the first frame, in the units of
    /// the simulation. Sentences about the frame have six significant digits of it. 0 if unknown.
    pub extent: f64,
}

impl Stats {
    /// Share of the tests that exact arithmetic decided, from 0 to 1.
    pub fn exact_share(&self) -> f64 {
        self.exact as f64 / self.tests.max(1) as f64
    }

    /// Adds the counts of another part of the same frame.
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

/// Everything that is said about one frame. It does not depend on the machine, the clock or the number of
/// threads: a recording replayed gives equal reports.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Report {
    /// Sequence number of the frame, as the simulator counts.
    pub seq: u64,
    /// Simulation time of the frame, in seconds.
    pub time: f64,
    /// The answer.
    pub verdict: Verdict,
    /// Whether the policy asks the simulator to stop.
    pub abort: bool,
    /// Linking numbers that are not the expected ones, sorted by pair.
    pub changes: Vec<Change>,
    /// Pull-throughs since the last frame that was verified, in the order in which they came; empty where they are not
    /// looked for ([`Events`](crate::Events)).
    pub events: Vec<PullThrough>,
    /// Pull-throughs that cannot be resolved, because the frames are too far apart: they cancel
    /// within their pair, and moved further than [the limit](crate::Verifier::set_motion_limit). In
    /// chronological order.
    pub unresolved: Vec<PullThrough>,
    /// What could not be decided or compared, sorted by pair.
    pub defects: Vec<Defect>,
    /// Nonzero linking numbers that the baseline lacked, sorted by pair. They are expected from
    /// this frame on ([`DefectKind::NoBaseline`]).
    pub adopted: Vec<Link>,
    /// Why the frame was rejected, in words.
    pub rejected: Option<String>,
    /// The work done.
    pub stats: Stats,
}
