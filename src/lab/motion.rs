//! Measurement of moving frames: incremental verification, compared with a plain read of the frame
//! and a full run.
//!
//! Every frame is read once, then received and verified incrementally. Every few frames a second
//! session receives the frame and computes it in full, for its time and its verdict. All
//! measurements alternate frame by frame, so that a busy machine slows all of them equally.

use super::clock::timed;
use crate::curve::{CurveSet, Positions};
use crate::engine::{SessionOptions, Strategy};
use crate::error::Result;
use crate::incremental::Events;
use crate::ingest::{FrameInfo, RawFrame};
use crate::scenes::{Frames, Motion};
use crate::session::{Session, VerifiedFrame};
use crate::thickness::ClearanceOptions;
use crate::verdict::{Report, Verdict};
use std::hint::black_box;
use std::time::Duration;

/// Number of full runs of a row: enough for a median.
const FULL_RUNS: u64 = 25;

/// Number of first frames after each of which the background work is awaited.
const SETTLED: u64 = 3;

/// A frame of a motion.
#[derive(Clone, Copy, Debug)]
pub struct MovedFrame<'a> {
    /// Positions of all control points.
    pub positions: Positions<'a>,
    /// True if the frame does not continue the previous one.
    pub cut: bool,
}

/// Frames of one motion, in order.
pub trait FrameSource {
    /// Returns the next frame, or `None` at the end. The first one is the baseline.
    fn next(&mut self) -> Result<Option<MovedFrame<'_>>>;
}

/// Generated frames of a motion.
#[derive(Debug)]
pub struct GeneratedMotion<'a> {
    frames: &'a mut Frames,
    motion: &'a Motion,
    /// Amplitude in units of the set.
    amplitude: f64,
    next: u64,
    count: u64,
}

impl<'a> GeneratedMotion<'a> {
    /// Returns `count` frames after the first one, which is at rest. The amplitude is in units of
    /// the set.
    pub fn new(frames: &'a mut Frames, motion: &'a Motion, amplitude: f64, count: u64) -> Self {
        GeneratedMotion {
            frames,
            motion,
            amplitude,
            next: 0,
            count,
        }
    }
}

impl FrameSource for GeneratedMotion<'_> {
    fn next(&mut self) -> Result<Option<MovedFrame<'_>>> {
        if self.next > self.count {
            return Ok(None);
        }
        self.next += 1;
        let positions = self.frames.at(self.motion, self.amplitude, self.next - 1);
        Ok(Some(MovedFrame {
            positions,
            cut: false,
        }))
    }
}

/// Curves that move, and what is measured.
#[derive(Debug)]
pub struct MotionStudy {
    /// The curves, at any positions.
    pub curves: CurveSet,
    /// Pull-throughs that both sessions search for.
    pub events: Events,
    /// Motion beyond which pull-throughs that cancel count as unresolved
    /// ([`SessionOptions::motion_limit`]).
    pub motion_limit: Option<f64>,
    /// Clearance that the incremental session measures.
    pub clearance: Option<ClearanceOptions>,
}

impl MotionStudy {
    /// Creates the incremental session that is measured, and the one that computes frames in full.
    fn sessions(&self) -> Result<[Session; 2]> {
        let session = |strategy| {
            Session::new(SessionOptions {
                strategy,
                events: self.events,
                motion_limit: self.motion_limit,
                clearance: self.clearance.filter(|_| strategy == Strategy::Incremental),
                keep_open: true,
                ..SessionOptions::default()
            })
        };
        Ok([session(Strategy::Incremental)?, session(Strategy::Full)?])
    }

    /// Measures all frames of a motion. `name` and `amplitude` describe it in the row. `count` is
    /// the number of frames, if it is known: then some of many frames are computed in full, else
    /// all. `on_frame` gets the number of each frame, and the full and the incremental report if
    /// they disagree.
    ///
    /// Errors: a frame whose coordinates overflow, or that cannot be read.
    pub fn measure(
        &self,
        (name, amplitude): (String, f64),
        source: &mut dyn FrameSource,
        count: Option<u64>,
        mut on_frame: impl FnMut(u64, Option<[&Report; 2]>),
    ) -> Result<MotionRow> {
        let mut row = MotionRow {
            motion: name,
            amplitude,
            lowest: f64::INFINITY,
            ..MotionRow::default()
        };
        // The search for pull-throughs must see every frame.
        let every = match (self.events, count) {
            (Events::Off, Some(count)) => (count / FULL_RUNS).max(1),
            _ => 1,
        };
        let [mut incremental, mut full] = self.sessions()?;
        let counts: Vec<i32> = self.curves.counts().collect();
        let still = RawFrame {
            basis: self.curves.basis(),
            counts: &counts,
            positions: Positions::F64(&[]),
        };
        if let Some(first) = source.next()? {
            for session in [&mut incremental, &mut full] {
                // The baseline.
                verify(
                    session,
                    0,
                    RawFrame {
                        positions: first.positions,
                        ..still
                    },
                )?;
            }
        }
        for frame in 1.. {
            let Some(MovedFrame { positions, cut }) = source.next()? else {
                break;
            };
            record(&mut row.read, || largest(black_box(positions)));
            if cut {
                incremental.cut();
                full.cut();
            }
            let raw = RawFrame { positions, ..still };
            let verified = verify(&mut incremental, frame, raw)?;
            let report = &verified.report;
            // The clearance has a column of its own.
            let clearance = match &report.clearance {
                Some(found) => {
                    let ratio = found.closest.as_ref().map_or(f64::INFINITY, |c| c.ratio);
                    row.lowest = row.lowest.min(ratio);
                    ms(verified.timings.clearance)
                }
                None => 0.0,
            };
            row.clearance.push(clearance);
            let receive = ms(verified.ingest);
            row.receive.push(receive);
            row.frame
                .push(receive + ms(verified.verification) - clearance);
            let work = verified.work;
            row.routes[work.route as usize] += 1;
            row.blocks += work.blocks;
            row.marked += work.marked;
            row.recertified += work.recertified;
            row.recomputed += work.recomputed;
            row.events += report.events.len() as u64;
            // A simulation leaves enough time for the first reference frame; here frames follow at
            // once.
            if frame < SETTLED {
                incremental.settle();
            }
            if frame % every != 0 {
                on_frame(frame, None);
                continue;
            }
            let computed = verify(&mut full, frame, raw)?;
            let expected = &computed.report;
            row.update.push(ms(computed.ingest));
            row.full.push(ms(computed.ingest + computed.verification));
            row.not_intact += u64::from(expected.verdict != Verdict::Intact);
            let equal = same(expected, report);
            row.equal += u64::from(equal);
            on_frame(frame, (!equal).then_some([expected, report]));
        }
        Ok(row)
    }
}

/// Verifies a frame, which is received as in a live run.
///
/// Errors: those of [`Session::verify`], and the reason why the frame is rejected.
fn verify(session: &mut Session, frame: u64, raw: RawFrame<'_>) -> Result<VerifiedFrame> {
    let received = session.receive(FrameInfo::at(frame, 0.0), |copy| copy(black_box(raw)));
    session.verify(received)?.valid()
}

/// Returns a time in milliseconds.
fn ms(time: Duration) -> f64 {
    time.as_secs_f64() * 1e3
}

/// Measurements of one motion and amplitude. Times are in milliseconds, one for each frame.
#[derive(Clone, Debug, Default)]
pub struct MotionRow {
    /// Name of the motion.
    pub motion: String,
    /// Amplitude in diameters.
    pub amplitude: f64,
    /// Times of a plain read of the frame by one thread.
    pub read: Vec<f64>,
    /// Times to receive a frame for the incremental verification: to copy it, and to compare it on
    /// the way.
    pub receive: Vec<f64>,
    /// Times to receive and to verify a frame incrementally.
    pub frame: Vec<f64>,
    /// Times to measure the clearance, not contained in `frame`.
    pub clearance: Vec<f64>,
    /// Lowest clearance of all frames; infinite if it was not measured, or nothing came close.
    pub lowest: f64,
    /// Times to copy a frame into the arrays of a curve set, for a full run.
    pub update: Vec<f64>,
    /// Times to copy a frame and to verify it in full.
    pub full: Vec<f64>,
    /// Number of frames on the full, the quiet and the partial route.
    pub routes: [u64; 3],
    /// Number of blocks of all frames.
    pub blocks: u64,
    /// Number of marked blocks.
    pub marked: u64,
    /// Number of pairs that were certified again.
    pub recertified: u64,
    /// Number of pairs that were recomputed.
    pub recomputed: u64,
    /// Number of reported pull-throughs.
    pub events: u64,
    /// Number of full runs with an equal result.
    pub equal: u64,
    /// Number of full runs whose verdict was not intact.
    pub not_intact: u64,
}

impl MotionRow {
    /// Returns the number of full runs.
    pub fn compared(&self) -> u64 {
        self.full.len() as u64
    }

    /// Returns the share of the blocks that were marked.
    pub fn marked_share(&self) -> f64 {
        self.marked as f64 / self.blocks.max(1) as f64
    }

    /// Returns the mean over the frames of a sum over all of them.
    pub fn per_frame(&self, sum: u64) -> f64 {
        sum as f64 / self.frame.len() as f64
    }
}

/// Runs `work` and appends the milliseconds that it took.
fn record<T>(times: &mut Vec<f64>, work: impl FnOnce() -> T) -> T {
    let (found, elapsed) = timed(|| black_box(work()));
    times.push(elapsed.wall_ms);
    found
}

/// Returns true if two reports agree on the topology of a frame.
fn same(a: &Report, b: &Report) -> bool {
    (a.verdict, &a.changes) == (b.verdict, &b.changes)
        && (&a.events, &a.defects) == (&b.events, &b.defects)
}

/// Returns the largest coordinate: the minimum work that reads a whole frame, by one thread.
fn largest(positions: Positions<'_>) -> f64 {
    // Computes several maxima in parallel, so that the compiler uses vectors.
    fn of<T: Copy + PartialOrd>(values: &[T], least: T) -> T {
        let larger = |a: T, b: T| if a > b { a } else { b };
        let mut lanes = [least; 32];
        let mut chunks = values.chunks_exact(lanes.len());
        for chunk in &mut chunks {
            for (lane, &x) in lanes.iter_mut().zip(chunk) {
                *lane = larger(*lane, x);
            }
        }
        let rest = chunks.remainder().iter().copied();
        lanes.into_iter().chain(rest).fold(least, larger)
    }
    match positions {
        Positions::F32(v) => of(v, f32::NEG_INFINITY).into(),
        Positions::F64(v) => of(v, f64::NEG_INFINITY),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_plain_read_covers_all_coordinates() {
        let mut v: Vec<f32> = (0..1000).map(|k| -(k as f32)).collect();
        assert_eq!(largest(Positions::F32(&v)), 0.0);
        for at in [1, 500, 999] {
            v[at] = 7.0;
            assert_eq!(largest(Positions::F32(&v)), 7.0);
            v[at] = -1.0;
        }
        assert_eq!(largest(Positions::F64(&[-3.0, -2.0, -5.0])), -2.0);
    }
}
