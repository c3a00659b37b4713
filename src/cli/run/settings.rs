//! Settings of a run: the options of the command, and those of a recording.

use crate::cli::braid_args::{self, BraidArgs};
use crate::cli::cell_args::{CellArgs, KEEP_OPEN, WRAPPED};
use crate::cli::clearance_args::{self, ClearanceArgs};
use crate::cli::event_args::EventArgs;
use crate::cli::files::{Files, Overwrite};
use linkwatch::formats::unpacked;
use linkwatch::{
    AbortOn, BaselineRecord, Braids, Certificate, Events, InvariantKind, Result, SessionOptions,
};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::str::FromStr;
use std::sync::Arc;

/// The motion limit in the metadata of a recording.
pub const MOTION_LIMIT: &str = "motion_limit";

/// Baseline, events and policy of a run.
#[derive(Clone, Debug, Default, clap::Args)]
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
            files.reads([path]);
        }
        files.reads(self.braid_args.file());
        files
    }

    /// Returns these options. Those that the user did not give are taken from a recorded run.
    pub fn or_recorded(&self, metadata: &BTreeMap<String, String>) -> Result<Judge> {
        let mut judge = self.clone();
        let abort_on = self.abort_on.or(recorded(metadata, "abort_on"));
        let abort_on = abort_on.unwrap_or_default();
        judge.abort_on = Some(abort_on);
        let given = &mut judge.event_args;
        // Earlier versions recorded neither. The frames of a converted file have only a motion
        // limit, because they are not the record of a run.
        let converted = metadata.contains_key(MOTION_LIMIT);
        let events = given.events.or(recorded(metadata, "events"));
        given.events = events.or((!converted).then_some(Events::Off));
        given.motion_limit = given.motion_limit.or(Some(recorded_limit(metadata)));
        if given.events(abort_on) == Events::Off {
            // A motion limit is of no use without a search for pull-throughs.
            given.motion_limit = None;
        }
        let invariants = &mut judge.event_args.invariants;
        if let (true, Some(words)) = (invariants.is_empty(), metadata.get("invariants")) {
            let kinds = words.split(',').filter_map(|word| word.parse().ok());
            invariants.extend(kinds.collect::<Vec<InvariantKind>>());
        }
        judge.clearance_args = self.clearance_args.or_recorded(metadata);
        judge.braid_args = judge.braid_args.or_recorded(metadata)?;
        // A recorded run already closed its curves.
        judge.cell_args.keep_open |= metadata.contains_key("events");
        let wrapped = &mut judge.cell_args.wrapped;
        *wrapped = wrapped.or(recorded(metadata, WRAPPED));
        Ok(judge)
    }

    /// Returns the options that differ from those of a recorded run, so that verdicts may differ.
    pub fn differing(&self, metadata: &BTreeMap<String, String>) -> Result<Vec<&'static str>> {
        let now = self.or_recorded(metadata)?;
        let then = Judge::default().or_recorded(metadata)?;
        let braids = now.braid_args.braids()? != then.braid_args.braids()?;
        let keep_open = now.cell_args.keep_open != then.cell_args.keep_open;
        let limit = self.event_args.motion_limit;
        let limit = limit.is_some_and(|limit| limit != recorded_limit(metadata));
        let clearance =
            now.abort_on == Some(AbortOn::Clearance) && now.clearance_args != then.clearance_args;
        let invariants = now.event_args.invariants != then.event_args.invariants;
        let is_stricter = |pairs: usize| pairs < SessionOptions::MAX_PAIRS;
        let options = [
            ("--abort-on", now.abort_on != then.abort_on),
            ("--baseline", self.baseline.is_some()),
            ("--braid", braids),
            ("--cell or --wrapped", self.cell_args.are_given()),
            ("--keep-open", keep_open),
            ("--invariants", invariants),
            ("--events", now.event_args.events != then.event_args.events),
            ("--max-pairs", self.max_pairs.is_some_and(is_stricter)),
            ("--motion-limit", limit),
            ("--radius or --min-clearance", clearance),
        ];
        let differing = options.into_iter().filter(|(_, differs)| *differs);
        Ok(differing.map(|(option, _)| option).collect())
    }

    /// Returns the baseline, unless it is the first frame.
    pub fn baseline(&self, recorded: Option<BaselineRecord>) -> Result<Option<BaselineRecord>> {
        Ok(match &self.baseline {
            Some(Baseline::File(path)) => Some(BaselineRecord {
                certificate: Arc::new(unpacked(path, Certificate::read)?),
                origin: path.display().to_string(),
                frame: None,
                unverified: 0,
            }),
            Some(Baseline::FirstFrame) => None,
            None => recorded,
        })
    }

    /// Returns the options of the session, without its baseline. Adds them to the metadata of a
    /// recording.
    pub fn options(&self, metadata: &mut BTreeMap<String, String>) -> Result<SessionOptions> {
        let abort_on = self.abort_on.unwrap_or_default();
        metadata.insert("abort_on".into(), abort_on.to_string());
        let events = self.event_args.events(abort_on);
        metadata.insert("events".into(), events.to_string());
        let limit = self.event_args.motion_limit;
        let known = limit.unwrap_or(SessionOptions::MOTION_LIMIT);
        metadata.insert(MOTION_LIMIT.into(), known.to_string());
        if self.cell_args.keep_open {
            metadata.insert(KEEP_OPEN.into(), "true".into());
        }
        if self.cell_args.wrapped == Some(false) {
            metadata.insert(WRAPPED.into(), "false".into());
        }
        let invariants = self.event_args.invariants.clone();
        if !invariants.is_empty() {
            let words: Vec<&str> = invariants.iter().map(|kind| kind.word()).collect();
            metadata.insert("invariants".into(), words.join(","));
        }
        let clearance = self.clearance_args.options()?;
        if let Some(clearance) = &clearance {
            clearance_args::write(clearance, metadata);
        } else if abort_on == AbortOn::Clearance {
            return Err(usage!("--abort-on clearance needs --radius"));
        }
        let braids = self.braid_args.braids()?;
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
            invariants,
            clearance,
            braids,
            cell: self.cell_args.cell(None),
            ignore_cell: self.cell_args.ignores_cells(),
            wrapped: self.cell_args.wrapped,
            keep_open: self.cell_args.keep_open,
            max_pairs: self.max_pairs.unwrap_or(SessionOptions::MAX_PAIRS),
            motion_limit: limit,
            ..SessionOptions::default()
        })
    }
}

/// Returns the motion limit of a recorded run. Earlier versions had none.
fn recorded_limit(metadata: &BTreeMap<String, String>) -> f64 {
    recorded(metadata, MOTION_LIMIT).unwrap_or(f64::INFINITY)
}

/// Returns a setting of a recorded run. `None` if it is missing, or was written by another version.
pub fn recorded<T: FromStr>(metadata: &BTreeMap<String, String>, key: &str) -> Option<T> {
    metadata.get(key)?.parse().ok()
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
