//! Incremental verification: allowances of a reference frame, and the ledger of pull-throughs
//! between frames.
//!
//! ```text
//! frame ─▶ affine frame ─▶ one pass over all points ─┬▶ quiet: as the reference frame
//!              (affine)        (stream)              ├▶ partial: recompute affected pairs (motion)
//!                                                    └▶ full: recompute all ─▶ new reference frame
//!                                                       (reference, monitor; in the background)
//! previous and current frame ─▶ pairs that may have passed through each other (motion)
//!                            ─▶ ledger ─▶ pull-throughs
//! ```
//!
//! Linking numbers depend on no chain of frames: each frame is compared with the reference frame
//! itself, so errors do not accumulate.

mod affine;
mod coverage;
mod covered;
mod events;
mod ledger;
mod monitor;
mod motion;
mod packed;
mod reference;
mod slots;
mod stream;
#[cfg(test)]
mod tests;
mod work;

pub(crate) use coverage::Coverage;
pub use events::Events;
pub(crate) use ledger::{Contacts, Ledger, MOTION_LIMIT, Outcome};
pub(crate) use monitor::Monitor;
pub use work::{Route, Work};
