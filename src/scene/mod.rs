//! Scene: the curves that are verified together in a frame, and the names of curves in findings.
//!
//! In a periodic cell, these are the curves of the frame and the images that may meet a curve
//! ([`CellScene`]). They form one set of curves with a filter of pairs, so that each pair of a
//! curve and an image is verified once. With braids, these are the curves of the frame and virtual
//! loops ([`BraidScene`]).

mod braid;
mod cell;

pub(crate) use braid::BraidScene;
pub(crate) use cell::{CellScene, CellState, ComparedYarns, Search};
