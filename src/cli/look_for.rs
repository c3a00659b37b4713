//! `--events` and `--self`, of every command that sees frame after frame.

use linkwatch::{AbortOn, Events};

/// Which pull-throughs are looked for from frame to frame.
#[derive(Clone, Copy, Debug, clap::Args)]
#[command(next_help_heading = super::COMPARE)]
pub struct LookFor {
    /// Report every pull-through with its place and moment: also those that cancel, and those of
    /// open curves
    #[arg(long)]
    events: bool,
    /// Report curves that are pulled through themselves, too (implies --events)
    #[arg(long = "self")]
    own: bool,
    /// Motion between two frames, in segment lengths, beyond which two pull-throughs that cancel
    /// count as unresolved: the frames are too far apart to decide whether they took place
    /// [default: 1.5; replay: as recorded]
    #[arg(long, value_name = "LENGTHS")]
    pub motion_limit: Option<f64>,
}

impl LookFor {
    /// What is to be looked for: what was asked for, or what a policy needs.
    pub fn events(self, abort_on: AbortOn) -> Events {
        if self.own {
            Events::All
        } else if self.events || abort_on == AbortOn::Event {
            Events::Between
        } else {
            Events::Off
        }
    }
}
