//! Scene: the curves of a frame that are verified together, and the names of what is found.
//!
//! If the scene repeats, these are the curves of the frame and the images of them that may meet a
//! curve ([`CellScene`]): one set of curves, with a filter of pairs, so that each pair of a curve
//! and an image is verified once. If it has braids, these are the curves of the frame and virtual
//! loops ([`BraidScene`]).

mod braid;
mod cell;

pub(crate) use braid::BraidScene;
pub(crate) use cell::{CellScene, CellState, ComparedYarns, Search};
