//! Exact predicates on the input floats: on which side, over or under, touching or not.
//!
//! A ladder, each rung of which says a sign or hands on: floating point with a proven bound, adaptive
//! expansions (crate `robust`, Shewchuk 1997), and big integers where exponents are so extreme that
//! expansions could overflow or underflow. None of them guesses.

mod big;
mod crossing;
mod passage;
mod predicates;
mod touch;

pub(crate) use crossing::{Batch, Crossing, crossing};
pub(crate) use passage::{Decided, Edges, Moment, Passage, Ties, passages};
pub(crate) use predicates::Predicates;
pub(crate) use touch::segments_touch;
