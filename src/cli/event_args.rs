//! The options `--events` and `--motion-limit` of every command that verifies successive frames.

use linkwatch::{AbortOn, Events};

/// Search for pull-throughs between successive frames.
#[derive(Clone, Copy, Debug, Default, clap::Args)]
#[command(next_help_heading = super::COMPARE)]
pub struct EventArgs {
    /// Pull-throughs to search for, each with its place and moment
    ///
    /// Also those that cancel, and those of open curves. `between`: of two curves; `all`: also of a
    /// curve through itself; `off`: linking numbers alone, for frames without the motion between
    /// them [default: between; check: off if the first two frames are far apart; replay: as
    /// recorded]
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
}

impl EventArgs {
    /// Returns true if the user chose a search or its limit.
    pub fn are_given(self) -> bool {
        self.events.is_some() || self.motion_limit.is_some()
    }

    /// Searches for no pull-throughs, unless the user asks for them: there is no step to search, or
    /// another option excludes it.
    pub fn off_by_default(self) -> EventArgs {
        EventArgs {
            events: self.events.or(Some(Events::Off)),
            ..self
        }
    }

    /// Returns the pull-throughs to search for: at least those that the policy needs.
    pub fn events(self, abort_on: AbortOn) -> Events {
        match self.events.unwrap_or(Events::Between) {
            Events::Off if abort_on == AbortOn::Event => Events::Between,
            events => events,
        }
    }
}
