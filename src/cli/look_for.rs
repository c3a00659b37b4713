//! `--events` and `--self`, of every command that sees frame after frame.

use linkwatch::{AbortOn, Events};

/// Which pull-throughs are looked for from frame to frame.
#[derive(Clone, Copy, Debug, clap::Args)]
pub struct LookFor {
    /// Tell every pull-through with its place and moment, also those that cancel, and those of open curves
    #[arg(long)]
    events: bool,
    /// Tell curves that are pulled through themselves, too (implies --events)
    #[arg(long = "self")]
    own: bool,
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
