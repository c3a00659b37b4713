//! Monitor of the reference frame: compares later frames with it, and decides when a new one is
//! worth its cost.

use super::affine::Affine;
use super::covered::Coverage;
use super::motion::MovedBlocks;
use super::quiet_bounds::QuietBounds;
use super::reference::{MOST_NEAR, Reference};
use super::stream::compare;
use super::work::{Route, Work};
use crate::cancel::Cancel;
use crate::certificate::{Certificate, Comparison};
use crate::curve::{Bad, Cell, CurveSet, Frame, Positions, Received};
use crate::error::Result;
use crate::pairs::{Pair, PairFilter, distinct};
use crate::pool;
use std::collections::VecDeque;
use std::sync::Arc;
use std::thread::JoinHandle;

/// Share of moved chunks above which a search of all pairs costs less than a search near the moved
/// chunks. Measured on a knitted glove (`study frames --diameter 0.1 --motions smooth`): if a tenth
/// of the chunks moved, the search near them costs half as much as a search of all pairs.
const MANY_CHUNKS: f64 = 0.15;

/// Number of moved chunks up to which a search near them always costs less.
const FEW_CHUNKS: usize = 16;

/// Share of moved chunks above which a new reference frame may save time.
const STALE: f64 = 0.005;

/// Maximum back-off, in frames, after reference frames that saved no time. Minimum back-off after a
/// build that was given up.
const MAX_BACKOFF: u64 = 256;

/// Back-off after a reference frame that was no better than the one before, in frames per frame
/// that its construction took. On a busy stream, reference frames would compete for CPU time and
/// memory.
const BACKOFF: u64 = 16;

/// Maximum number of received frames whose surveys are kept until the frames are verified.
const RECEIVED: usize = 4;

/// Compares the frames of a scene with a reference frame.
#[derive(Debug, Default)]
pub(crate) struct Monitor {
    /// Pairs that a reference frame covers in addition to linking numbers.
    coverage: Coverage,
    /// Pairs of curves that a reference frame covers; `None`: all.
    filter: Option<PairFilter>,
    reference: Option<Reference>,
    /// Thread that builds a reference frame.
    build: Option<Build>,
    /// Number of the current frame.
    frame: u64,
    /// First frame that may become a reference, and current back-off in frames.
    next_reference: u64,
    backoff: u64,
    /// Number of frames that passed while the last reference was built.
    build_frames: u64,
    /// True if the last reference was better than the one before it.
    pays: bool,
    /// The previous frame and the current frame.
    previous: Survey,
    current: Survey,
    /// Surveys of the received frames that are not verified yet, oldest first, each with the frame
    /// number of its reference.
    received: VecDeque<(u64, Survey)>,
}

/// A thread that builds a reference frame. Dropping this value cancels the build.
#[derive(Debug)]
struct Build {
    thread: JoinHandle<Option<Reference>>,
    _needed: Needed,
}

/// Cancels a build when it is dropped.
#[derive(Debug, Default)]
struct Needed(Cancel);

impl Drop for Needed {
    fn drop(&mut self) {
        self.0.set();
    }
}

/// Result of comparing the points of a frame with the reference frame.
#[derive(Debug, Default)]
struct Survey {
    /// Identifier of the positions ([`CurveSet::contents`]), and the cell.
    contents: Option<(u64, Option<Cell>)>,
    /// Affine map from the reference frame. `None` if there is none, or if too many chunks moved.
    affine: Option<Affine>,
    /// Chunks of points with a point that moved further than its allowance.
    chunks: Vec<u32>,
}

impl Survey {
    /// Compares a frame with a reference frame.
    fn of(reference: &Reference, set: &CurveSet, cell: Option<&Cell>) -> Survey {
        let survey = Survey::read(reference, set.positions(), cell, None, f64::INFINITY);
        Survey {
            contents: Some((set.contents(), cell.copied())),
            // The coordinates of a set are finite.
            ..survey.unwrap_or_default()
        }
    }

    /// Compares positions in a cell with a reference frame, and copies them to `copy`. Fails with
    /// the first value whose magnitude is not within `range`.
    fn read(
        reference: &Reference,
        positions: Positions<'_>,
        cell: Option<&Cell>,
        copy: Option<&mut Received>,
        range: f64,
    ) -> Result<Survey, Bad> {
        let sample = &reference.sample;
        let affine = match (&reference.cell, cell) {
            (Some(from), Some(to)) => Affine::fit_in_cell(sample, positions, [from, to]),
            (None, None) => Affine::fit(sample, positions),
            _ => None,
        };
        let limit = FEW_CHUNKS.max((reference.chunks() as f64 * MANY_CHUNKS) as usize);
        let chunks = compare(reference, affine.as_ref(), positions, copy, range, limit)?;
        let few = chunks.as_ref().is_some_and(|chunks| chunks.len() <= limit);
        Ok(Survey {
            contents: None,
            affine: affine.filter(|_| few),
            chunks: chunks.unwrap_or_default(),
        })
    }

    /// Returns the number of chunks that moved, or the largest number if it is unknown.
    fn moved(&self) -> usize {
        self.affine.map_or(usize::MAX, |_| self.chunks.len())
    }
}

impl Monitor {
    /// Returns a monitor whose reference frames have this coverage, so that the ledger can skip
    /// pairs. They cover the pairs of a filter, or all.
    pub fn new(coverage: Coverage, filter: Option<PairFilter>) -> Self {
        Monitor {
            coverage,
            filter,
            ..Monitor::default()
        }
    }

    /// Copies the positions of another frame to `set`, checks them, and compares them with the
    /// reference frame in the same pass.
    ///
    /// # Errors
    ///
    /// The errors of [`CurveSet::update`].
    pub fn receive(
        &mut self,
        set: &mut CurveSet,
        positions: Positions<'_>,
        cell: Option<&Cell>,
    ) -> Result<()> {
        let same = |reference: &&Reference| reference.given.same_layout(set);
        let Some(reference) = self.reference.as_ref().filter(same) else {
            return set.update(positions);
        };
        let mut found = None;
        set.update_by(positions, |copy, range| {
            found = Some(Survey::read(reference, positions, cell, Some(copy), range)?);
            Ok(())
        })?;
        if self.received.len() == RECEIVED {
            self.received.pop_front();
        }
        self.received.extend(found.map(|survey| {
            let contents = Some((set.contents(), cell.copied()));
            (reference.frame, Survey { contents, ..survey })
        }));
        Ok(())
    }

    /// Compares the curves of a frame, without their images, with the reference frame. Returns true
    /// if all pairs have the linking numbers of the reference frame. `before` is the previous
    /// frame, for [`Monitor::pairs_to_search`]. If the baseline or the set of images changes, the
    /// caller must create a new monitor.
    pub fn is_quiet(
        &mut self,
        before: Option<&Frame>,
        set: &CurveSet,
        cell: Option<&Cell>,
        baseline: &Certificate,
        work: &mut Work,
    ) -> bool {
        self.frame += 1;
        std::mem::swap(&mut self.previous, &mut self.current);
        *work = Work::default();
        self.reference.take_if(|k| !k.given.same_layout(set));
        let received = self.take_survey(set, cell);
        let reference = self.reference.as_ref();
        let survey = received.or_else(|| Some(Survey::of(reference?, set, cell)));
        self.current = survey.unwrap_or_default();
        if let Some(built) = self.take_built(set, baseline) {
            self.adopt_if_better(built, set, cell);
        }
        // The previous survey is of another frame if a frame between the two was rejected, or if
        // the reference frame is new.
        if let (Some(reference), Some(before)) = (&self.reference, before)
            && let given = before.given()
            && self.previous.contents != Some((given.contents(), before.cell().copied()))
        {
            self.previous = match given.same_layout(set) {
                true => Survey::of(reference, given, before.cell()),
                false => Survey::default(),
            };
        }
        let Some(reference) = &self.reference else {
            return false;
        };
        work.blocks = reference.neighbours.blocks.len() as u64;
        work.reference_age = Some(self.frame - reference.frame);
        // A curve that is degenerate in the reference frame has no linking number there to compare
        // with.
        let quiet = self.current.moved() == 0 && !reference.certificate.has_degenerate_curves();
        if quiet {
            work.route = Route::Quiet;
        }
        quiet
    }

    /// Removes and returns the survey of a frame, if the frame was received and compared with the
    /// reference frame. Discards the surveys of earlier frames.
    fn take_survey(&mut self, set: &CurveSet, cell: Option<&Cell>) -> Option<Survey> {
        let reference = self.reference.as_ref()?;
        let k = self.received.iter().position(|(of, survey)| {
            let contents = survey.contents.map(|(contents, _)| contents);
            *of == reference.frame && contents == Some(set.contents())
        })?;
        let (_, survey) = self.received.drain(..=k).next_back()?;
        // The cell may be known in another basis by now.
        let same = survey.contents == Some((set.contents(), cell.copied()));
        same.then_some(survey)
    }

    /// Returns the pairs of curves (`(i, i)`: a curve and itself), sorted, that may have passed
    /// through each other between the previous frame and the current one. Returns `None` if nothing
    /// is known.
    pub fn pairs_to_search(
        &mut self,
        [before, after]: [&Frame; 2],
        work: &mut Work,
    ) -> Option<Vec<Pair>> {
        let reference = self.reference.as_ref()?;
        let surveys = [&self.previous, &self.current];
        let [Some(from), Some(to)] = surveys.map(|survey| survey.affine.as_ref()) else {
            return None;
        };
        let bend = Affine::bend([from, to])?;
        let chunks = distinct(surveys.map(|survey| &survey.chunks[..]).concat());
        if chunks.is_empty() {
            return Some(Vec::new());
        }
        let [before, after] = [&**before.set().ok()?, &**after.set().ok()?];
        let ends = [(from, before), (to, after)];
        let step = MovedBlocks::new(reference, ends, &chunks, bend);
        work.marked = step.marked.len() as u64;
        let mut affected = pool::run(before.segments(), || step.affected())?;
        work.recertified = affected.apart as u64;
        if let Some(filter) = &self.filter {
            filter.retain(&mut affected.pairs);
        }
        Some(affected.pairs)
    }

    /// Returns the linking numbers of the reference frame, and their comparison with the baseline.
    pub fn reference_result(&self) -> Option<(&Arc<Certificate>, &Comparison)> {
        let reference = self.reference.as_ref()?;
        Some((&reference.certificate, reference.comparison.as_ref()?))
    }

    /// Returns bounds of the curves of a frame, if it is the current one, it is quiet, and the
    /// reference frame covers all curves.
    pub fn quiet_bounds(&self, set: &CurveSet) -> Option<QuietBounds<'_>> {
        let (current, reference) = (&self.current, self.reference.as_ref()?);
        let is_of = current.contents.is_some_and(|of| of.0 == set.contents());
        let affine = current.affine.filter(|_| is_of && current.moved() == 0)?;
        let all = reference.coverage.open_curves || reference.given.open_curves() == 0;
        all.then_some(QuietBounds { reference, affine })
    }

    /// Returns true if the current frame should become the reference: the present one is stale,
    /// none is being built, and the back-off is over.
    pub fn wants_reference(&self) -> bool {
        let chunks = self.reference.as_ref().map_or(0, Reference::chunks);
        let stale = self.current.affine.is_none()
            || self.current.chunks.len() as f64 > STALE * chunks as f64;
        stale && self.build.is_none() && self.frame >= self.next_reference
    }

    /// Starts to build a reference from the current frame, in a background thread. Does nothing if
    /// boxes dilated by the reach could overflow single precision. The reach is less than four
    /// times the largest coordinate.
    pub fn make_reference(&mut self, subject: Frame, certificate: Arc<Certificate>) {
        let small = |set: &Arc<CurveSet>| set.max_abs() <= f64::from(f32::MAX) / 16.0;
        if !subject.set().is_ok_and(small) {
            return;
        }
        let frame = self.frame;
        let (coverage, filter) = (self.coverage, self.filter.clone());
        let needed = Needed::default();
        let cancel = needed.0.clone();
        let build = move || {
            // A separate pool of one thread, because the pool of the stream works on the next
            // frames.
            let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build();
            let (filter, most, cancel) = (filter.as_ref(), MOST_NEAR, &cancel);
            let reference =
                || Reference::build(&subject, certificate, frame, coverage, filter, most, cancel);
            pool.ok()?.install(reference)
        };
        let thread = std::thread::Builder::new().name("linkwatch-reference".into());
        // If the thread cannot start, there is no reference, and every frame is computed in full.
        let thread = thread.spawn(build).ok();
        self.build = thread.map(|thread| Build {
            thread,
            _needed: needed,
        });
        let backoff = (2 * self.backoff).max(BACKOFF * self.build_frames);
        self.backoff = match self.pays {
            true => 1,
            false => backoff.min(MAX_BACKOFF),
        };
        self.next_reference = self.frame + self.backoff;
    }

    /// Compares the reference frame with the baseline after it adopted linking numbers.
    pub fn set_baseline(&mut self, baseline: &Certificate) {
        if let Some(reference) = &mut self.reference {
            // Cannot fail: both have the same number of curves.
            if let Ok(comparison) = reference.certificate.compare(baseline) {
                reference.comparison = Some(comparison);
            }
        }
    }

    /// Waits until a reference frame that is being built is complete.
    pub fn wait_for_reference(&mut self) {
        while self.build.as_ref().is_some_and(|m| !m.thread.is_finished()) {
            std::thread::sleep(std::time::Duration::from_micros(200));
        }
    }

    /// Simulates an error that the paranoid mode must detect: all allowances become infinite.
    #[cfg(test)]
    pub fn make_allowances_infinite(&mut self) {
        let reference = self.reference.as_mut().expect("a reference");
        reference.allowances.fill(f32::INFINITY);
        let (points, largest) = (reference.given.positions(), reference.set.max_abs());
        reference.packed = super::packed::Packed::blocks(points, largest, &reference.allowances);
        self.received.clear();
    }

    /// Takes a completed reference frame of the same curves.
    fn take_built(&mut self, set: &CurveSet, baseline: &Certificate) -> Option<Reference> {
        let build = self.build.take_if(|m| m.thread.is_finished())?;
        // The panic hook has already reported a panic of the thread.
        let Some(mut reference) = build.thread.join().ok()? else {
            // Too many segments are near one another, and probably still will be for a while. The
            // build began when `next_reference` was set.
            let took = self.frame + self.backoff - self.next_reference;
            self.backoff = MAX_BACKOFF.max(BACKOFF * took);
            self.next_reference = self.frame + self.backoff;
            return None;
        };
        // The earliest frame that can use it is the one after it.
        self.build_frames = self.frame - reference.frame - 1;
        // Certificates with different numbers of curves cannot be compared.
        reference.comparison = Some(reference.certificate.compare(baseline).ok()?);
        reference.given.same_layout(set).then_some(reference)
    }

    /// Adopts a reference frame if fewer points of the current frame moved too far from it than
    /// from the present one.
    fn adopt_if_better(&mut self, built: Reference, set: &CurveSet, cell: Option<&Cell>) {
        let survey = Survey::of(&built, set, cell);
        let present = self.reference.as_ref();
        let present = present.filter(|k| !k.certificate.has_degenerate_curves());
        self.pays = present.is_none() || survey.moved() < self.current.moved();
        if self.pays {
            self.current = survey;
            self.previous = Survey::default();
            self.reference = Some(built);
        }
    }
}
