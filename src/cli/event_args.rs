//! The options `--events` and `--motion-limit` of every command that verifies successive frames.

use linkwatch::{AbortOn, Events};

/// Search for pull-throughs between successive frames.
#[derive(Clone, Copy, Debug, clap::Args)]
#[command(next_help_heading = super::COMPARE)]
pub struct EventArgs {
    /// Report every pull-through with its place and moment, also those that cancel, and those of
    /// open curves: `between` curves, or `all`: also of a curve through itself
    #[arg(
        long, value_name = "off|between|all", num_args = 0..=1, require_equals = true,
        default_missing_value = "between"
    )]
    events: Option<Events>,
    /// Motion between two frames, in segment lengths, beyond which two pull-throughs that cancel
    /// count as unresolved: the frames are too far apart to decide whether they took place
    /// [default: 1.5; replay: as recorded]
    #[arg(long, value_name = "LENGTHS")]
    pub motion_limit: Option<f64>,
}

impl EventArgs {
    /// Returns the events of the user, or those of a recording; at least those that the policy
    /// needs.
    pub fn events(self, abort_on: AbortOn, recorded: Events) -> Events {
        match self.events.unwrap_or(recorded) {
            Events::Off if abort_on == AbortOn::Event => Events::Between,
            events => events,
        }
    }
}
