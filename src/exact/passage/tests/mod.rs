//! Tests of passages: against the oracle, of the methods against one another, and of known ones.

mod known;
mod methods;
mod oracle;
mod speed;

use super::*;
use crate::random::Random;

type Polygon = Vec<[i64; 3]>;

/// [`passages_of_sums`] without rounding.
fn passages(before: &Edges, after: &Edges, ties: Ties, out: &mut impl FnMut(Passage)) -> Decided {
    passages_of_sums([before, after], 0.0, || unreachable!(), ties, out)
}

/// Returns the passages in the order in which they are reported.
fn collect(before: &Edges, after: &Edges, ties: Ties) -> (Decided, Vec<Passage>) {
    let mut all = Vec::new();
    let decided = passages(before, after, ties, &mut |p| all.push(p));
    (decided, all)
}

fn collect_exactly(before: &Edges, after: &Edges, ties: Ties) -> (Decided, Vec<Passage>) {
    let mut all = Vec::new();
    let decided = exactly(before, after, ties, &mut |p| all.push(p));
    (decided, all)
}
