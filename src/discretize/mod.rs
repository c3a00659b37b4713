//! Splines to polylines that are link homotopic to them.
//!
//! If the convex volumes of two pieces of different curves do not meet, each piece can be pulled straight
//! within its own volume without passing through the other (Qu & James 2021, Theorem A.2; it uses only that
//! the volumes are convex). So pieces are halved until no two volumes of different curves meet.
//!
//! Two ways, with the same linking numbers:
//! - [`Separation`]: within one pair of curves, lazily, only where their boxes overlap in space; volumes are
//!   the hulls of the Bezier control points. What the crossing kernel uses.
//! - [`homotopic_polylines`]: Algorithm 3 as published, for all pairs at once, with tight boxes; gives
//!   polylines that stand alone.
//!
//! Polylines go through neither.

mod global;
mod halving;
mod hulls;
mod pair;
mod pieces;

pub use global::{Polylines, homotopic_polylines};
pub(crate) use halving::{Halving, Splits};
pub(crate) use hulls::Hull;
pub(crate) use pair::{MovingSeparation, Separation};
pub(crate) use pieces::{Sieve, pieces_between, pieces_within};

/// Halvings of a segment after which a pair counts as too close: pieces are then `2^-30` of a segment, and
/// their hulls, which flatten with the square of their length, thinner than coordinates can resolve.
const MAX_LEVEL: u32 = 30;

/// Pieces of one pair that may be under-refined at once. Strands that run within rounding of one another
/// would double it at every level until memory ends.
const MAX_FRONT: usize = 1 << 16;
