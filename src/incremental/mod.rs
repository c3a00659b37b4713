//! Incremental verification: allowances of a reference frame, and the ledger of pull-throughs
//! between frames.
//!
//! ```text
//! frame as received ─▶ affine map ───▶ one pass: copy, check, compare ─┬▶ quiet: as the reference
//!                         (affine)        (stream)                     └▶ otherwise:
//! previous and current frame ─▶ pairs near a moved part (motion), or all pairs
//!                            ─▶ ledger ─▶ pull-throughs, pairs that may have changed (partial)
//! no previous frame          ─▶ all pairs (full)
//! a frame that is not quiet  ─▶ new reference frame (reference, monitor; in the background)
//! ```
//!
//! # Proof: the linking numbers of a frame that is not quiet
//!
//! Between two frames, the linking number of two closed curves changes by the sum of the signs of
//! their passages ([`ledger`]). A pair without a passage has the number that it had in the previous
//! frame. A pair that the ledger does not decide, that touches, that had no number, or whose sum is
//! not 0 is computed again. Each of these steps is exact, so errors do not accumulate from frame to
//! frame.

mod affine;
mod blocks;
mod covered;
mod ledger;
mod monitor;
mod motion;
mod packed;
mod quiet_bounds;
mod reference;
mod stream;
#[cfg(test)]
mod tests;
mod work;

pub(crate) use covered::Coverage;
pub(crate) use ledger::{Contacts, Ledger, MOTION_LIMIT, Outcome, Touching, sort_by_time};
pub(crate) use monitor::Monitor;
pub(crate) use quiet_bounds::{PointMap, QuietBounds};
pub use work::{Events, Route, Work};
