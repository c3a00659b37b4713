//! Settings of a run: the options of the command, and those of a recording.

use crate::cli::braid_args::{self, BraidArgs};
use crate::cli::cell_args::{CellArgs, KEEP_OPEN};
use crate::cli::clearance_args::{self, ClearanceArgs};
use crate::cli::event_args::EventArgs;
use crate::cli::files::{Files, Overwrite};
use linkwatch::{
    AbortOn, BaselineRecord, Braids, Certificate, ClearanceOptions, Error, Events, Result,
    SessionOptions,
};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::str::FromStr;
use std::sync::Arc;

/// The motion limit in the metadata of a recording.
pub const MOTION_LIMIT: &str = "motion_limit";

/// Baseline, events and policy of a run.
#[derive(Clone, Debug, clap::Args)]
#[command(next_help_heading = crate::cli::COMPARE)]
pub struct Judge {
    /// Expected linking numbers: of the first frame, or a file
    ///
    /// `first-frame`, or a certificate as `linkwatch certify -o` writes it [default: first-frame;
    /// replay: as recorded]
    #[arg(long, value_name = "first-frame|CERT")]
    pub baseline: Option<Baseline>,
    /// Findings that ask the simulator to stop: any, .., never
    ///
    /// any, lost, gained, contact, event, rejected, clearance (any, or strands that come too close,
    /// with --radius) or never [default: any; replay: as recorded]
    #[arg(long, value_name = "WHAT")]
    pub abort_on: Option<AbortOn>,
    #[command(flatten)]
    pub event_args: EventArgs,
    #[command(flatten)]
    pub clearance_args: ClearanceArgs,
    #[command(flatten)]
    pub braid_args: BraidArgs,
    #[command(flatten)]
    pub cell_args: CellArgs,
    /// Reject frames in which the boxes of more pairs of curves overlap
    ///
    /// The memory for them, up to 200 bytes each, may not be there [default: 33554432]
    #[arg(long, value_name = "N", hide_short_help = true)]
    pub max_pairs: Option<usize>,
}

impl Judge {
    /// Returns the files of a command with these settings, for its other inputs and its outputs.
    pub fn files(&self, overwrite: Overwrite) -> Files {
        let mut files = Files::new(overwrite);
        if let Some(Baseline::File(path)) = &self.baseline {
            files.reads(path);
        }
        if let Some(path) = self.braid_args.file() {
            files.reads(path);
        }
        files
    }

    /// Returns the baseline, unless it is the first frame.
    pub(super) fn baseline(&self, recorded: &mut Recorded) -> Result<Option<BaselineRecord>> {
        Ok(match &self.baseline {
            Some(Baseline::File(path)) => Some(BaselineRecord {
                certificate: Arc::new(Certificate::read(path)?),
                origin: path.display().to_string(),
                frame: None,
                unverified: 0,
            }),
            Some(Baseline::FirstFrame) => None,
            None => recorded.baseline.take(),
        })
    }

    /// Returns the options of the session, without its baseline. Adds them to the metadata of a
    /// recording.
    pub(super) fn options(
        &self,
        recorded: Recorded,
        metadata: &mut BTreeMap<String, String>,
    ) -> Result<SessionOptions> {
        let abort_on = self.abort_on.unwrap_or_default();
        metadata.insert("abort_on".into(), abort_on.to_string());
        let default = (Events::Between, SessionOptions::MOTION_LIMIT);
        let (default_events, default_limit) = recorded.events.unwrap_or(default);
        let events = self.event_args.events(abort_on, default_events);
        metadata.insert("events".into(), events.to_string());
        let given_limit = self.event_args.motion_limit;
        let limit = given_limit.unwrap_or(default_limit);
        metadata.insert(MOTION_LIMIT.into(), limit.to_string());
        if self.cell_args.keep_open {
            metadata.insert(KEEP_OPEN.into(), "true".into());
        }
        let clearance = self.clearance_args.options(recorded.clearance)?;
        if let Some(clearance) = &clearance {
            clearance_args::write(clearance, metadata);
        } else if abort_on == AbortOn::Clearance {
            let why = "--abort-on clearance needs --radius";
            return Err(Error::Usage(why.into()));
        }
        let braids = self.braid_args.braids(recorded.braids)?;
        if let Some(braids) = &braids {
            braid_args::write(braids, metadata);
        }
        if let (Some(Braids::Auto), Some(Baseline::File(_))) = (&braids, &self.baseline) {
            let what = "the expected linking numbers are those of another frame";
            return Err(braid_args::other_first_frame(what));
        }
        Ok(SessionOptions {
            abort_on,
            events,
            clearance,
            braids,
            cell: self.cell_args.given(),
            ignore_cell: self.cell_args.ignores_cells(),
            wrapped: self.cell_args.wrapped,
            keep_open: self.cell_args.keep_open,
            max_pairs: self.max_pairs.unwrap_or(SessionOptions::MAX_PAIRS),
            motion_limit: match (events, recorded.events) {
                // A limit needs a search. A replay without one ignores it, since it may come from
                // the recording; another run passes it on, so that it is refused.
                (Events::Off, Some(_)) => None,
                (Events::Off, None) => given_limit,
                _ => Some(limit),
            },
            ..SessionOptions::default()
        })
    }
}

/// Settings of a recording. They apply if the user gives none.
#[derive(Default)]
pub struct Recorded {
    pub baseline: Option<BaselineRecord>,
    /// Events and motion limit.
    pub events: Option<(Events, f64)>,
    pub clearance: Option<ClearanceOptions>,
    pub braids: Option<Braids>,
}

/// Source of the expected linking numbers.
#[derive(Clone, Debug)]
pub enum Baseline {
    FirstFrame,
    File(PathBuf),
}

impl FromStr for Baseline {
    type Err = std::convert::Infallible;
    fn from_str(s: &str) -> std::result::Result<Self, Self::Err> {
        Ok(match s {
            "first-frame" => Baseline::FirstFrame,
            path => Baseline::File(path.into()),
        })
    }
}
