//! Frame after frame: what moved, and what it may have broken.
//!
//! ```text
//! frame ─▶ affine frame ─▶ one pass over all points ─┬▶ nothing moved too far: as the reference frame
//!              (affine)        (stream)              ├▶ little did: which pairs? (motion) ─▶ only these anew
//!                                                    └▶ much did: all anew ─▶ a new reference, beside the stream
//! ```
//!
//! No chain of frames: each one is compared with the reference frame itself, so nothing adds up.

mod ledger;

pub use ledger::PullThrough;

/// What a frame took. No part of a [`Report`](crate::Report): it depends on the frames before and on the clock.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Work {
    /// The way that the frame took.
    pub route: Route,
    /// Blocks of eight segments in all.
    pub blocks: u64,
    /// Blocks with a point that moved further than it may without a closer look.
    pub marked: u64,
    /// Pairs of curves near such a block, proven to be as they were by the boxes of their motion.
    pub recertified: u64,
    /// Pairs whose linking numbers were computed anew.
    pub recomputed: u64,
    /// Frames since the reference frame, where the frame was compared with one.
    pub reference_age: Option<u64>,
}

/// The way that a frame took.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Route {
    /// All linking numbers were computed.
    #[default]
    Full,
    /// No point moved further than it may: everything is as in the reference frame.
    Quiet,
    /// Some pairs were looked at, or computed anew.
    Partial,
}

mod affine;
mod motion;
mod packed;
mod reference;
mod stream;

use self::affine::Affine;
use self::motion::Motion;
use self::reference::Reference;
use self::stream::{CHUNK, moved_chunks};
use crate::certificate::{Certificate, Comparison};
use crate::curve::CurveSet;
use crate::pairs::{LinkSearch, Pair};
use std::thread::JoinHandle;

#[cfg(test)]
mod tests;

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

/// Follows a scene from frame to frame.
#[derive(Debug, Default)]
pub(crate) struct Monitor {
    reference: Option<Known>,
    /// A reference frame in the making.
    making: Option<JoinHandle<Option<Reference>>>,
    /// Number of the frame in work.
    frame: u64,
    /// First frame that may become a reference, and frames to wait after one that did not pay.
    next_reference: u64,
    pause: u64,
    chunks: Vec<u32>,
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

/// What the reference frame says about a later one.
pub(crate) enum Finding {
    /// Nothing: compute everything.
    Nothing,
    /// All is as it was but for these pairs, sorted, of which nothing is known; none of them on most frames.
    AllBut(Vec<Pair>),
}

impl Monitor {
    /// Looks at a frame. A new baseline needs a new monitor.
    pub fn look(&mut self, set: &CurveSet, baseline: &Certificate, work: &mut Work) -> Finding {
        self.frame += 1;
        self.adopt(set, baseline);
        let chunks = set.slots().div_ceil(CHUNK);
        *work = Work::default();
        let Some(known) = self.reference.as_mut() else {
            return Finding::Nothing;
        };
        let Known {
            reference, paid, ..
        } = known;
        // What a degenerate loop is linked with was not computed there.
        if reference
            .certificate
            .undefined
            .iter()
            .any(|d| d.j.is_none())
        {
            return Finding::Nothing;
        }
        work.blocks = reference.blocks;
        work.reference_age = Some(self.frame - reference.frame);
        let Some(affine) = Affine::fit(&reference.sample, set) else {
            return Finding::Nothing;
        };
        let limit = FEW_CHUNKS.max((chunks as f64 * MANY_CHUNKS) as usize);
        self.chunks.clear();
        moved_chunks(reference, &affine, set, limit, &mut self.chunks);
        if self.chunks.is_empty() {
            *paid = true;
            work.route = Route::Quiet;
            return Finding::AllBut(Vec::new());
        }
        if self.chunks.len() > limit {
            return Finding::Nothing;
        }
        let motion = Motion::new(reference, &affine, set, &self.chunks);
        work.marked = motion.blocks() as u64;
        // A loop that has shrunk to a point or a line is for the full run to tell.
        if motion.curves().any(|i| !set.has_three_distinct_points(i)) {
            return Finding::Nothing;
        }
        let (pairs, recertified) = motion.affected(&mut self.search);
        let many = MANY_PAIRS * reference.potential_links as f64;
        if pairs.len() as f64 > many.max(8.0) {
            return Finding::Nothing;
        }
        *paid = true;
        work.route = Route::Partial;
        work.recertified = recertified as u64;
        work.recomputed = pairs.len() as u64;
        Finding::AllBut(pairs)
    }

    /// The numbers of the reference frame, and how they compare with the baseline.
    pub fn known(&self) -> Option<(&Certificate, &Comparison)> {
        let known = self.reference.as_ref()?;
        Some((&known.reference.certificate, &known.comparison))
    }

    /// Whether the frame looked at last would make a better reference.
    pub fn wants_reference(&self, work: &Work) -> bool {
        let chunks = self
            .reference
            .as_ref()
            .map_or(0, |k| k.reference.set.slots().div_ceil(CHUNK));
        let stale = match work.route {
            Route::Full => true,
            Route::Quiet => false,
            Route::Partial => self.chunks.len() as f64 > STALE * chunks as f64,
        };
        stale && self.making.is_none() && self.frame >= self.next_reference
    }

    /// Makes a reference of the frame looked at last, beside the stream.
    pub fn make_reference(
        &mut self,
        set: CurveSet,
        certificate: Certificate,
        potential_links: usize,
    ) {
        let frame = self.frame;
        let make = move || {
            // A thread of its own: the stream's are busy with the next frames.
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(1)
                .build()
                .ok()?;
            Some(pool.install(|| Reference::build(set, certificate, frame, potential_links)))
        };
        let thread = std::thread::Builder::new().name("linkwatch-reference".into());
        // Without a thread there is no reference, and every frame is computed in full.
        self.making = thread.spawn(make).ok();
        // One reference after another that no frame was quiet for does not pay.
        let paid = self.reference.as_ref().is_none_or(|k| k.paid);
        self.pause = if paid {
            1
        } else {
            (2 * self.pause).min(LONGEST_PAUSE)
        };
        self.next_reference = self.frame + self.pause;
    }

    /// Waits for a reference frame in the making.
    pub fn settle(&mut self) {
        while self.making.as_ref().is_some_and(|m| !m.is_finished()) {
            std::thread::sleep(std::time::Duration::from_micros(200));
        }
    }

    /// Takes a reference frame that is ready, and drops one of other curves.
    fn adopt(&mut self, set: &CurveSet, baseline: &Certificate) {
        if let Some(making) = self.making.take_if(|m| m.is_finished()) {
            // A panic there has been told by its thread.
            if let Ok(Some(reference)) = making.join() {
                // Of two numbers of curves nothing compares.
                if let Ok(comparison) = reference.certificate.compare(baseline) {
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
    }
}
