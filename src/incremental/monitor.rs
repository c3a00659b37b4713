//! Monitor of the reference frame: compares later frames with it, and decides when a new one pays.

use super::affine::Affine;
use super::coverage::Coverage;
use super::motion::MovedBlocks;
use super::reference::Reference;
use super::stream::moved_chunks;
use super::work::{Route, Work};
use crate::certificate::{Certificate, Comparison};
use crate::curve::CurveSet;
use crate::pairs::Pair;
use std::sync::Arc;
use std::thread::JoinHandle;

/// Share of moved chunks above which a search of all pairs costs less than one near these chunks.
/// Measured on a knitted glove (`study frames --diameter 0.1 --motions smooth`): a tenth of the
/// chunks costs half of a search of all pairs.
const MANY_CHUNKS: f64 = 0.15;

/// Number of moved chunks up to which a search near them always pays.
const FEW_CHUNKS: usize = 16;

/// Share of moved chunks above which a new reference frame may pay.
const STALE: f64 = 0.005;

/// Maximum number of frames between two reference frames if they do not pay.
const MAX_BACKOFF: u64 = 256;

/// Back-off after a reference frame that was no better than the one before, in frames per frame
/// that its construction took. On a busy stream, reference frames would compete for CPU time and
/// memory.
const BACKOFF: u64 = 16;

/// Compares the frames of a scene with a reference frame.
#[derive(Debug, Default)]
pub(crate) struct Monitor {
    /// Pairs that a reference frame covers in addition to linking numbers.
    coverage: Coverage,
    reference: Option<Known>,
    /// Thread that builds a reference frame.
    build: Option<JoinHandle<Option<Reference>>>,
    /// Number of the current frame.
    frame: u64,
    /// First frame that may become a reference, and current back-off in frames.
    next_reference: u64,
    backoff: u64,
    /// Number of frames that passed while the last reference was built.
    build_frames: u64,
    /// True if the last reference was better than the one before.
    pays: bool,
    /// The previous frame and the current frame.
    previous: Survey,
    current: Survey,
}

/// A reference frame, and its comparison with the baseline.
#[derive(Debug)]
struct Known {
    reference: Reference,
    comparison: Comparison,
}

/// Result of comparing the points of a frame with the reference frame.
#[derive(Debug, Default)]
struct Survey {
    /// Affine frame of the scene. `None` if there is none, or if too many chunks moved.
    affine: Option<Affine>,
    /// Chunks of slots with a point that moved further than its allowance.
    chunks: Vec<u32>,
}

impl Survey {
    fn of(&mut self, reference: &Reference, set: &CurveSet) {
        self.chunks.clear();
        self.affine = Affine::fit(&reference.sample, set);
        let Some(affine) = &self.affine else {
            return;
        };
        let limit = FEW_CHUNKS.max((reference.chunks() as f64 * MANY_CHUNKS) as usize);
        moved_chunks(reference, affine, set, limit, &mut self.chunks);
        if self.chunks.len() > limit {
            self.affine = None;
        }
    }

    /// Returns the number of chunks that moved, or the largest number if it is unknown.
    fn moved(&self) -> usize {
        self.affine.map_or(usize::MAX, |_| self.chunks.len())
    }
}

impl Monitor {
    /// Returns a monitor whose reference frames have this coverage, so that the ledger can skip
    /// pairs.
    pub fn new(coverage: Coverage) -> Self {
        Monitor {
            coverage,
            ..Monitor::default()
        }
    }

    /// Compares the frame `set` with the reference frame. Returns true if it has the linking
    /// numbers of the reference frame. A new baseline needs a new monitor. `before` is the previous
    /// frame, for [`Monitor::pairs_to_search`].
    pub fn is_quiet(
        &mut self,
        before: Option<&CurveSet>,
        set: &CurveSet,
        baseline: &Certificate,
        work: &mut Work,
    ) -> bool {
        self.frame += 1;
        std::mem::swap(&mut self.previous, &mut self.current);
        *work = Work::default();
        self.reference
            .take_if(|k| !k.reference.set.same_layout(set));
        match &self.reference {
            Some(known) => self.current.of(&known.reference, set),
            None => self.current.affine = None,
        }
        if let Some(built) = self.take_built(set, baseline) {
            self.adopt_if_better(built, before, set);
        }
        let Some(known) = &self.reference else {
            return false;
        };
        let reference = &known.reference;
        work.blocks = reference.neighbours.blocks() as u64;
        work.reference_age = Some(self.frame - reference.frame);
        // The linking numbers of a degenerate loop were not computed in the reference frame.
        let quiet = self.current.moved() == 0 && !reference.certificate.has_degenerate_curves();
        if quiet {
            work.route = Route::Quiet;
        }
        quiet
    }

    /// Returns the pairs of curves (`(i, i)`: a curve and itself), sorted, that may have passed
    /// through each other between the previous frame and the current one. Returns `None` if nothing
    /// is known.
    pub fn pairs_to_search(
        &mut self,
        before: &CurveSet,
        after: &CurveSet,
        work: &mut Work,
    ) -> Option<Vec<Pair>> {
        let known = self.reference.as_ref()?;
        let affines = [
            self.previous.affine.as_ref()?,
            self.current.affine.as_ref()?,
        ];
        let bend = Affine::bend(affines)?;
        let mut chunks = [&self.previous.chunks[..], &self.current.chunks].concat();
        if chunks.is_empty() {
            return Some(Vec::new());
        }
        chunks.sort_unstable();
        chunks.dedup();
        let ends = [(affines[0], before), (affines[1], after)];
        let step = MovedBlocks::new(&known.reference, ends, &chunks, bend);
        work.marked = step.marked() as u64;
        // In the pool, so that its parallel parts do not each pass to another thread and back.
        let affected = rayon::scope(|_| step.affected())?;
        work.recertified = affected.apart as u64;
        Some(affected.pairs)
    }

    /// Returns the linking numbers of the reference frame, and their comparison with the baseline.
    pub fn reference_result(&self) -> Option<(&Arc<Certificate>, &Comparison)> {
        let known = self.reference.as_ref()?;
        Some((&known.reference.certificate, &known.comparison))
    }

    /// Returns true if the current frame would make a better reference.
    pub fn wants_reference(&self) -> bool {
        let chunks = self.reference.as_ref().map_or(0, |k| k.reference.chunks());
        let stale = self.current.affine.is_none()
            || self.current.chunks.len() as f64 > STALE * chunks as f64;
        stale && self.build.is_none() && self.frame >= self.next_reference
    }

    /// Starts to build a reference from the current frame, in a background thread. Does nothing if
    /// boxes dilated by the reach could overflow single precision. The reach is less than four
    /// times the largest coordinate.
    pub fn make_reference(&mut self, set: CurveSet, certificate: Arc<Certificate>) {
        if set.max_abs() > f64::from(f32::MAX) / 16.0 {
            return;
        }
        let frame = self.frame;
        let coverage = self.coverage;
        let build = move || {
            // A separate pool of one thread, because the pool of the stream works on the next
            // frames.
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(1)
                .build()
                .ok()?;
            let reference = || Reference::build(set, certificate, frame, coverage);
            Some(pool.install(reference))
        };
        let thread = std::thread::Builder::new().name("linkwatch-reference".into());
        // Without a thread there is no reference, and every frame is computed in full.
        self.build = thread.spawn(build).ok();
        self.backoff = if self.pays {
            1
        } else {
            let backoff = (2 * self.backoff).max(BACKOFF * self.build_frames);
            backoff.min(MAX_BACKOFF)
        };
        self.next_reference = self.frame + self.backoff;
    }

    /// Compares the reference frame with a baseline that has adopted linking numbers.
    pub fn set_baseline(&mut self, baseline: &Certificate) {
        if let Some(known) = &mut self.reference {
            // Cannot fail: both have the same number of curves.
            if let Ok(comparison) = known.reference.certificate.compare(baseline) {
                known.comparison = comparison;
            }
        }
    }

    /// Waits until a reference frame that is being built is complete.
    pub fn wait_for_reference(&mut self) {
        while self.build.as_ref().is_some_and(|m| !m.is_finished()) {
            std::thread::sleep(std::time::Duration::from_micros(200));
        }
    }

    /// Simulates an error that the paranoid mode must detect: all allowances become infinite.
    #[cfg(test)]
    pub fn make_allowances_infinite(&mut self) {
        let reference = &mut self.reference.as_mut().expect("a reference").reference;
        reference.allowances.fill(f32::INFINITY);
        reference.packed = super::packed::Packed::blocks(&reference.set, &reference.allowances);
    }

    /// Takes a completed reference frame of the same curves.
    fn take_built(&mut self, set: &CurveSet, baseline: &Certificate) -> Option<Known> {
        let build = self.build.take_if(|m| m.is_finished())?;
        // The panic hook has already reported a panic of the thread.
        let reference = build.join().ok()??;
        // The earliest frame that can use it is the one after it.
        self.build_frames = self.frame - reference.frame - 1;
        // Certificates with different numbers of curves cannot be compared.
        let comparison = reference.certificate.compare(baseline).ok()?;
        reference.set.same_layout(set).then_some(Known {
            reference,
            comparison,
        })
    }

    /// Adopts a reference frame if fewer points of the current frame moved relative to it than
    /// relative to the present one.
    fn adopt_if_better(&mut self, built: Known, before: Option<&CurveSet>, set: &CurveSet) {
        let mut survey = Survey::default();
        survey.of(&built.reference, set);
        let present = self.reference.as_ref();
        let present = present.filter(|k| !k.reference.certificate.has_degenerate_curves());
        self.pays = present.is_none() || survey.moved() < self.current.moved();
        if self.pays {
            self.current = survey;
            match before.filter(|before| before.same_layout(set)) {
                Some(before) => self.previous.of(&built.reference, before),
                None => self.previous.affine = None,
            }
            self.reference = Some(built);
        }
    }
}
