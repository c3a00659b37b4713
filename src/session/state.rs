//! State of a session, from which another process continues.

use super::Session;
use super::begin::Begin;
use super::closings::Closings;
use super::coordinates::CoordinateState;
use super::strands::Strands;
use crate::curve::StoredCurves;
use crate::engine::{EngineState, SessionOptions};
use crate::error::{Error, Result};
use crate::ingest::{Decisions, FrameInfo};
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::sync::Arc;

/// Version of the format. A state of another version cannot be read.
const VERSION: u32 = 6;

/// State of a session after a verified frame: the frame, the baseline, and all else that later
/// reports depend on. A clone shares the curves. It can be stored with serde, in a format that
/// keeps floating-point numbers exactly; its size is about that of the frame and of the baseline.
///
/// ```
/// use linkwatch::scenes::Scene;
/// use linkwatch::{Events, FrameInfo, Session, SessionOptions, Verdict};
///
/// let set = "chainmail:rows=2,columns=2".parse::<Scene>()?.build()?.curves;
/// let options = SessionOptions { events: Events::Between, ..Default::default() };
/// let mut first = Session::new(options.clone())?;
/// first.feed(FrameInfo::at(0, 0.0), &set)?;
///
/// let mut second = Session::resume(options, first.state())?;
/// let report = second.feed(FrameInfo::at(1, 0.1), &set)?;
/// assert_eq!((report.verdict, report.last_intact), (Verdict::Intact, Some(1)));
/// # Ok::<(), linkwatch::Error>(())
/// ```
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct SessionState {
    version: u32,
    /// `None` before the first frame.
    verified: Option<Verified>,
}

/// State after a verified frame.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Verified {
    info: FrameInfo,
    curves: StoredCurves,
    engine: EngineState,
    closings: Decisions,
    coordinates: CoordinateState,
    strands: Vec<(u64, f64)>,
    gone: BTreeSet<u64>,
}

impl SessionState {
    /// Returns what the simulator told about the last verified frame; `None` before the first one.
    pub fn info(&self) -> Option<&FrameInfo> {
        self.verified.as_ref().map(|verified| &verified.info)
    }

    /// Returns the state after later frames with the same baseline, of which only this is known:
    /// the number of cuts before the last one ([`FrameInfo::cuts`]), the last frame that is known
    /// to be intact ([`Report::last_intact`](crate::Report::last_intact)), and whether that was the
    /// last one (`intact`).
    ///
    /// The next frame is compared with the baseline. What happened in the step to it is unknown for
    /// the reason `why`. So it is not intact if pull-throughs are searched for, unless it does not
    /// continue the motion.
    pub fn after_unknown_frames(
        mut self,
        cuts: u32,
        last_intact: Option<u64>,
        intact: bool,
        why: String,
    ) -> SessionState {
        if let Some(verified) = &mut self.verified {
            verified.info.cuts = cuts;
            verified.engine.forget_last_frame(last_intact, intact, why);
        }
        self
    }
}

impl Session {
    /// Returns the state after the last verified frame.
    pub fn state(&self) -> SessionState {
        let engine = self.engine.state();
        let curves = self.coordinates.last.as_ref();
        let known = self.last.as_ref().zip(engine).zip(curves);
        SessionState {
            version: VERSION,
            verified: known.map(|((info, engine), (curves, _))| Verified {
                info: info.clone(),
                curves: StoredCurves(Arc::clone(curves)),
                engine,
                closings: self.closings.decisions(),
                coordinates: self.coordinates.state.clone(),
                strands: self.strands.trend(),
                gone: self.gone.clone(),
            }),
        }
    }

    /// Continues from the state of another session with the same options: all later reports are the
    /// same as those of that one, except that a clearance may have another lower bound, and another
    /// place of the same distance ([`Report::clearance`](crate::Report::clearance)).
    ///
    /// # Errors
    ///
    /// The errors of [`Session::new`]; [`Error::Format`] if the state is of another version of
    /// linkwatch; [`Error::Usage`] if it does not fit the options.
    pub fn resume(options: SessionOptions, state: SessionState) -> Result<Session> {
        if state.verified.is_some() && state.version != VERSION {
            let what = format!("version {}, expected {VERSION}", state.version);
            return Err(Error::format("state of a session", "version", what));
        }
        let mut session = Session::new(options)?;
        let Some(verified) = state.verified else {
            return Ok(session);
        };
        let (info, StoredCurves(curves)) = (verified.info, verified.curves);
        let mut engine = Begin::Resumed(&verified.engine).engine(&session, &info)?;
        engine.resume(verified.engine, &curves, info.cell)?;
        session.engine = engine;
        session.closings =
            Closings::decided(session.options.keep_open, info.layout, verified.closings);
        session.coordinates.state = verified.coordinates;
        session.coordinates.last = Some((curves, info.cell));
        session.strands = Strands::resumed(&session.options, &info, verified.strands);
        session.gone = verified.gone;
        session.last = Some(info);
        Ok(session)
    }
}
