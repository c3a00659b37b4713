//! The options `--events` and `--self` of every command that verifies successive frames.

use linkwatch::{AbortOn, Events};

/// Search for pull-throughs between successive frames.
#[derive(Clone, Copy, Debug, clap::Args)]
#[command(next_help_heading = super::COMPARE)]
pub struct EventArgs {
    /// Report every pull-through with its place and moment: also those that cancel, and those of
    /// open curves
    #[arg(long)]
    events: bool,
    /// Also report curves that are pulled through themselves (implies --events)
    #[arg(long = "self")]
    with_self: bool,
    /// Motion between two frames, in segment lengths, beyond which two pull-throughs that cancel
    /// count as unresolved: the frames are too far apart to decide whether they took place
    /// [default: 1.5; replay: as recorded]
    #[arg(long, value_name = "LENGTHS")]
    pub motion_limit: Option<f64>,
}

impl EventArgs {
    /// Returns the requested events, or those that the policy needs.
    pub fn events(self, abort_on: AbortOn) -> Events {
        if self.with_self {
            Events::All
        } else if self.events || abort_on == AbortOn::Event {
            Events::Between
        } else {
            Events::Off
        }
    }
}
