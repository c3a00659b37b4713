//! Discretization of splines into polylines that are link homotopic to them.
//!
//! If the convex volumes of two pieces of different curves are disjoint, each piece can be pulled
//! straight within its volume without passing through the other one (Qu & James 2021, Theorem A.2,
//! which only requires convex volumes). So pieces are halved until no volumes of different curves
//! meet.
//!
//! There are two algorithms, with the same linking numbers:
//! - [`Separation`]: for one pair of curves, on demand, only at overlapping boxes. The volumes are
//!   the hulls of the Bezier control points. The crossing kernel uses this one.
//! - [`homotopic_polylines`]: Algorithm 3 as published, for all pairs at once, with tight boxes.
//!   The resulting polylines can be used independently of the splines.
//!
//! Linking numbers need no more than that. Diagrams need polylines of the same knot type:
//! [`isotopic_polylines`].
//!
//! Polylines need no discretization.
//!
//! [`Braids`]: open curves between two rigid ends become virtual closed loops.

mod braid;
mod chords;
mod global;
mod halving;
mod hulls;
mod isotopic;
mod pair;
mod pieces;

pub use braid::{Braid, BraidLoops, Braids, End};
pub use chords::chords;
pub use global::{Polylines, homotopic_polylines};
pub(crate) use halving::{Halving, Splits, sort_splits, vertices};
pub(crate) use hulls::Hull;
pub(crate) use isotopic::isotopic_polylines;
pub(crate) use pair::{MovingSeparation, Separation};
pub(crate) use pieces::{Sieve, pieces_between, pieces_within};

/// Number of halvings of a segment after which a pair counts as too close. Pieces then have `2^-30`
/// of the length of a segment. Their hulls, whose thickness is quadratic in that length, are
/// thinner than the resolution of coordinates.
const MAX_LEVEL: u32 = 30;

/// Maximum number of overlapping piece pairs of one pair of curves that are refined at once. For
/// strands within a rounding error of each other, this number would double at every level until
/// memory is exhausted.
const MAX_FRONT: usize = 1 << 16;
