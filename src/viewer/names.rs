//! Names in the viewer: the application, the timelines, and the paths of the entities.

/// Name under which viewers group runs and remember layouts.
pub(super) const APPLICATION: &str = "linkwatch";

/// Timelines: the number of the frame, and the simulation time.
pub(super) const FRAME: &str = "frame";
pub(super) const SIM_TIME: &str = "sim_time";

/// Timeline of the frames up to the first violation. A layout cannot place the time cursor, but a
/// viewer that follows a timeline opens at its end.
pub(super) const UNTIL: &str = "until_violation";

/// Paths of the entities.
pub(super) mod entity {
    pub const CURVES: &str = "curves";
    pub const MOVING: &str = "curves/intact/moving";
    /// Parent of the blocks of curves at rest.
    pub const AT_REST: &str = "curves/intact/at_rest";
    pub const BROKEN: &str = "curves/broken";
    pub const UNDECIDED: &str = "curves/undecided";
    pub const TUBES: &str = "curves/strands";
    /// Entities that the overview of the scene does not show.
    pub const NEAR_ONLY: [&str; 2] = [TUBES, LABELS];
    /// Moments of the first violation: before, at and after its frame.
    pub const MOMENTS: [&str; 3] = ["moments/before", "moments/at", "moments/after"];
    pub const CELL: &str = "curves/cell";
    pub const IMAGES: &str = "curves/images";
    pub const PLACES: &str = "curves/places";
    pub const LABELS: &str = "curves/labels";
    pub const LEADERS: &str = "curves/labels/lines";
    pub const EVENTS: &str = "curves/pull-throughs/now";
    pub const STARS: &str = "curves/pull-throughs/stars";
    pub const PASSED: &str = "curves/pull-throughs/before";
    pub const CLOSE: &str = "curves/clearance/strands";
    pub const CLOSEST: &str = "curves/clearance/places";
    pub const CLOSEST_LINES: &str = "curves/clearance/places/lines";
    pub const CLOSEST_LABEL: &str = "curves/clearance/places/label";
    pub const LOG: &str = "log";
    pub const STATUS: &str = "status";
    pub const KEY: &str = "key";
    pub const SKIPPED: &str = "skipped/frames";
}
