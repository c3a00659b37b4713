//! Exact predicates on the input floats: the side of a point, crossings of projected segments,
//! contact, and passages of moving edges.
//!
//! Each predicate tries up to three methods, and each method either proves the sign or defers to
//! the next one: floating point with a proven error bound, adaptive expansions (crate `robust`,
//! Shewchuk 1997), and big integers if exponents are so extreme that expansions could overflow or
//! underflow. The result is always exact.

mod big;
mod crossing;
mod passage;
mod predicates;
mod projection;
mod touch;

pub(crate) use crossing::{Batch, BatchOutcome, Crossing, crossing, crossing_of_sums};
pub(crate) use passage::{Decided, Edges, Moment, Passage, Ties, equal_sums, passages_of_sums};
pub(crate) use predicates::Predicates;
pub(crate) use projection::{Direction, Seen, are_collinear};
pub(crate) use touch::{segments_touch, sums_touch};
