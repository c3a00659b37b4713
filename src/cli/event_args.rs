//! The options `--events`, `--motion-limit` and `--invariants` of every command that verifies
//! successive frames.

use linkwatch::{AbortOn, Events, InvariantKind};

/// Search for pull-throughs between successive frames.
#[derive(Clone, Debug, Default, clap::Args)]
#[command(next_help_heading = super::COMPARE)]
pub struct EventArgs {
    /// Pull-throughs to search for, each with its place and moment
    ///
    /// Also those that cancel, and those of open curves. `between`: of two curves; `all`: also of a
    /// curve through itself; `off`: linking numbers alone, for frames without the motion between
    /// them [default: between; check: off if the first two frames of a run are far apart; replay:
    /// as recorded]
    #[arg(
        long, value_name = "off|between|all", num_args = 0..=1, require_equals = true,
        default_missing_value = "between"
    )]
    pub events: Option<Events>,
    /// Motion beyond which pull-throughs that cancel are unresolved
    ///
    /// Motion between two frames, in segment lengths: beyond it the frames are too far apart to
    /// decide whether the two pull-throughs took place [default: 1.5; replay: as recorded]
    #[arg(long, value_name = "LENGTHS")]
    pub motion_limit: Option<f64>,
    /// Invariants to compare beside linking numbers: of each curve, or of triples
    ///
    /// `self`: v2, v3 and the determinant of each closed curve, which tell if its knot changed;
    /// `triple`: Milnor's triple linking numbers, as of Borromean rings. For frames without the
    /// motion between them [default: those of the baseline, if it is a file; replay: as recorded]
    #[arg(long, value_name = "self,triple", value_delimiter = ',')]
    pub invariants: Vec<InvariantKind>,
}

impl EventArgs {
    /// Returns true if the user chose a search or its limit.
    pub fn are_given(&self) -> bool {
        self.events.is_some() || self.motion_limit.is_some()
    }

    /// Returns the pull-throughs to search for: at least those that the policy needs.
    pub fn events(&self, abort_on: AbortOn) -> Events {
        match self.events.unwrap_or(Events::Between) {
            Events::Off if abort_on == AbortOn::Event => Events::Between,
            events => events,
        }
    }
}
