//! The reference frame: which one there is, what it says about a later frame, and when a new one pays.

use super::affine::Affine;
use super::motion::{Motion, Space};
use super::reference::Reference;
use super::stream::moved_chunks;
use super::{Cover, Route, Work};
use crate::certificate::{Certificate, Comparison};
use crate::curve::CurveSet;
use crate::pairs::{LinkSearch, Pair};
use std::thread::JoinHandle;

/// Of all chunks of slots, the share above which a closer look costs more than computing everything.
const MANY_CHUNKS: f64 = 0.02;

/// Chunks that are always worth a closer look.
const FEW_CHUNKS: usize = 16;

/// Of all potential links, the share above which it does.
const MANY_PAIRS: f64 = 0.25;

/// Of all chunks, the share from which on a new reference frame may pay.
const STALE: f64 = 0.005;

/// Frames from one reference frame to the next, at most, where they do not pay.
const LONGEST_PAUSE: u64 = 256;

/// Frames to wait, for each that went by while a reference frame was made, where they do not pay: beside a busy stream
/// they would take its processors and its memory from it.
const REST: u64 = 16;

/// Follows a scene from frame to frame.
#[derive(Debug, Default)]
pub(crate) struct Monitor {
    /// What else a reference frame is to cover, beside the linking numbers.
    cover: Cover,
    reference: Option<Known>,
    /// A reference frame in the making.
    making: Option<JoinHandle<Option<Reference>>>,
    /// Number of the frame in work.
    frame: u64,
    /// First frame that may become a reference, and frames to wait after one that did not pay.
    next_reference: u64,
    pause: u64,
    /// Frames that went by while the last one was made.
    in_making: u64,
    /// The frame before, and the one in work.
    before: Survey,
    now: Survey,
    search: LinkSearch,
}

/// A reference frame, and how it compares with the baseline.
#[derive(Debug)]
struct Known {
    reference: Reference,
    comparison: Comparison,
    /// Whether some frame was quiet for it.
    paid: bool,
}

/// How a frame compares with the reference frame.
#[derive(Debug, Default)]
struct Survey {
    /// Where the reference frame went as a whole; none where so much moved beside that nothing else is known.
    affine: Option<Affine>,
    /// Chunks of slots with a point that moved further than it may.
    chunks: Vec<u32>,
}

/// What the reference frame says about a later one.
pub(crate) enum Finding {
    /// Nothing: compute everything.
    Nothing,
    /// All is as it was but for these pairs, sorted, of which nothing is known; none of them on most frames.
    AllBut(Vec<Pair>),
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
}

impl Monitor {
    /// A monitor that also tells a ledger with this cover where it need not look.
    pub fn new(cover: Cover) -> Self {
        Monitor {
            cover,
            ..Monitor::default()
        }
    }

    /// Looks at a frame. A new baseline needs a new monitor. `before` is the frame before, for
    /// [`Monitor::may_have_passed`].
    pub fn look(
        &mut self,
        before: Option<&CurveSet>,
        set: &CurveSet,
        baseline: &Certificate,
        work: &mut Work,
    ) -> Finding {
        self.frame += 1;
        std::mem::swap(&mut self.before, &mut self.now);
        self.now.affine = None;
        let adopted = self.adopt(set, baseline);
        *work = Work::default();
        let Some(known) = self.reference.as_mut() else {
            return Finding::Nothing;
        };
        let reference = &known.reference;
        // What a degenerate loop is linked with was not computed there.
        let undefined = &reference.certificate.undefined;
        if undefined.iter().any(|d| d.j.is_none()) {
            return Finding::Nothing;
        }
        work.blocks = reference.blocks;
        work.reference_age = Some(self.frame - reference.frame);
        if adopted && let Some(before) = before {
            self.before.of(reference, before);
        }
        self.now.of(reference, set);
        let Survey { affine, chunks } = &self.now;
        let Some(affine) = affine else {
            return Finding::Nothing;
        };
        if chunks.is_empty() {
            known.paid = true;
            work.route = Route::Quiet;
            return Finding::AllBut(Vec::new());
        }
        let still = Affine::identity();
        let ends = [(&still, &reference.set), (affine, set)];
        let motion = Motion::new(reference, ends, chunks, Space::Reference);
        work.marked = motion.blocks() as u64;
        // A loop that has shrunk to a point or a line is for the full run to tell.
        if !motion.loops().all(|i| set.has_three_distinct_points(i)) {
            return Finding::Nothing;
        }
        let (pairs, recertified) = motion.affected(&mut self.search);
        let many = MANY_PAIRS * reference.potential_links as f64;
        if pairs.len() as f64 > many.max(8.0) {
            return Finding::Nothing;
        }
        known.paid = true;
        work.route = Route::Partial;
        work.recertified = recertified as u64;
        work.recomputed = pairs.len() as u64;
        Finding::AllBut(pairs)
    }

    /// The pairs of curves (`(i, i)`: a curve and itself), sorted, that may have passed through one another from
    /// the frame before to the one looked at last; none where nothing is known.
    pub fn may_have_passed(&mut self, before: &CurveSet, after: &CurveSet) -> Option<Vec<Pair>> {
        let reference = &self.reference.as_ref()?.reference;
        let affines = [self.before.affine.as_ref()?, self.now.affine.as_ref()?];
        let bend = Affine::bend(affines)?;
        let mut chunks = [&self.before.chunks[..], &self.now.chunks].concat();
        if chunks.is_empty() {
            return Some(Vec::new());
        }
        chunks.sort_unstable();
        chunks.dedup();
        let ends = [(affines[0], before), (affines[1], after)];
        let motion = Motion::new(reference, ends, &chunks, Space::World { bend });
        Some(motion.affected(&mut self.search).0)
    }

    /// The numbers of the reference frame, and how they compare with the baseline.
    pub fn known(&self) -> Option<(&Certificate, &Comparison)> {
        let known = self.reference.as_ref()?;
        Some((&known.reference.certificate, &known.comparison))
    }

    /// Whether the frame looked at last would make a better reference.
    pub fn wants_reference(&self, work: &Work) -> bool {
        let chunks = self.reference.as_ref().map_or(0, |k| k.reference.chunks());
        let stale = match work.route {
            Route::Full => true,
            Route::Quiet => false,
            Route::Partial => self.now.chunks.len() as f64 > STALE * chunks as f64,
        };
        stale && self.making.is_none() && self.frame >= self.next_reference
    }

    /// Makes a reference of the frame looked at last, beside the stream; not where its boxes cannot grow by the reach,
    /// which is less than four times its largest coordinate, in single precision.
    pub fn make_reference(
        &mut self,
        set: CurveSet,
        certificate: Certificate,
        potential_links: usize,
    ) {
        if set.max_abs() > f64::from(f32::MAX) / 16.0 {
            return;
        }
        let frame = self.frame;
        let cover = self.cover;
        let make = move || {
            // A thread of its own: the stream's are busy with the next frames.
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(1)
                .build()
                .ok()?;
            let build = || Reference::build(set, certificate, frame, potential_links, cover);
            Some(pool.install(build))
        };
        let thread = std::thread::Builder::new().name("linkwatch-reference".into());
        // Without a thread there is no reference, and every frame is computed in full.
        self.making = thread.spawn(make).ok();
        // One reference after another that no frame was quiet for does not pay.
        let paid = self.reference.as_ref().is_none_or(|k| k.paid);
        self.pause = if paid {
            1
        } else {
            let pause = (2 * self.pause).max(REST * self.in_making);
            pause.min(LONGEST_PAUSE)
        };
        self.next_reference = self.frame + self.pause;
    }

    /// Compares the reference frame with a baseline that has more numbers than before.
    pub fn compare_again(&mut self, baseline: &Certificate) {
        if let Some(known) = &mut self.reference {
            // Cannot fail: both have the same number of curves.
            if let Ok(comparison) = known.reference.certificate.compare(baseline) {
                known.comparison = comparison;
            }
        }
    }

    /// Waits for a reference frame in the making.
    pub fn settle(&mut self) {
        while self.making.as_ref().is_some_and(|m| !m.is_finished()) {
            std::thread::sleep(std::time::Duration::from_micros(200));
        }
    }

    /// An error, to be noticed: from now on nothing ever moves too far.
    #[cfg(test)]
    pub fn go_blind(&mut self) {
        let reference = &mut self.reference.as_mut().expect("a reference").reference;
        reference.allowances.fill(f32::INFINITY);
        reference.packed = super::packed::Packed::blocks(&reference.set, &reference.allowances);
    }

    /// Takes a reference frame that is ready, and drops one of other curves. Whether there is another one than before.
    fn adopt(&mut self, set: &CurveSet, baseline: &Certificate) -> bool {
        let mut adopted = false;
        if let Some(making) = self.making.take_if(|m| m.is_finished()) {
            // A panic there has been told by its thread.
            if let Ok(Some(reference)) = making.join() {
                // At best it is ready for the next frame.
                self.in_making = self.frame - reference.frame - 1;
                // Of two numbers of curves nothing compares.
                if let Ok(comparison) = reference.certificate.compare(baseline) {
                    adopted = true;
                    self.reference = Some(Known {
                        reference,
                        comparison,
                        paid: false,
                    });
                }
            }
        }
        self.reference
            .take_if(|k| !k.reference.set.same_layout(set));
        adopted
    }
}
