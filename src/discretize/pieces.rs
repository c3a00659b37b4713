//! Enumeration of the pairs of near pieces of two polylines.
//!
//! Splines that run near each other are split into thousands of pieces, and each piece is near only
//! a few others. A test of all pairs would be quadratic in the number of pieces, so long polylines
//! are halved until their parts are apart or short. The cost is nearly linear for spatially
//! coherent polylines.

use std::ops::ControlFlow;

/// Maximum number of vertices of a part that is not halved further.
const MAX_PART: usize = 5;

/// A test that proves that two parts of polylines with vertices `V` are apart. Then all pairs of
/// their pieces are apart.
pub(crate) trait Sieve<V> {
    /// Bounds of a part.
    type Bounds;

    fn bounds(&self, vertices: &[V]) -> Self::Bounds;

    fn apart(&self, first: &Self::Bounds, second: &Self::Bounds) -> bool;
}

/// Calls `test` for pairs of pieces, one of each polyline, until it breaks. Skips only pairs that
/// the sieve proves apart.
pub(crate) fn pieces_between<V>(
    p: &[V],
    q: &[V],
    sieve: &impl Sieve<V>,
    test: &mut impl FnMut(&[V], &[V]) -> ControlFlow<()>,
) -> ControlFlow<()> {
    if p.len() <= MAX_PART && q.len() <= MAX_PART {
        return test_all_pairs(p, q, test);
    }
    let parts = [p, q].map(|vertices| (vertices, sieve.bounds(vertices)));
    parts_between([&parts[0], &parts[1]], sieve, test)
}

/// Like [`pieces_between`] for a polyline and itself: every pair of different pieces once.
pub(crate) fn pieces_within<V>(
    p: &[V],
    sieve: &impl Sieve<V>,
    test: &mut impl FnMut(&[V], &[V]) -> ControlFlow<()>,
) -> ControlFlow<()> {
    if p.len() <= MAX_PART {
        for k in 1..p.len() - 1 {
            test_all_pairs(&p[k - 1..=k], &p[k..], test)?;
        }
        return ControlFlow::Continue(());
    }
    let [left, right] = halves(p);
    pieces_within(left, sieve, test)?;
    pieces_within(right, sieve, test)?;
    pieces_between(left, right, sieve, test)
}

/// Calls `test` for all pairs of pieces.
fn test_all_pairs<V>(
    p: &[V],
    q: &[V],
    test: &mut impl FnMut(&[V], &[V]) -> ControlFlow<()>,
) -> ControlFlow<()> {
    for a in p.windows(2) {
        for b in q.windows(2) {
            test(a, b)?;
        }
    }
    ControlFlow::Continue(())
}

/// Returns both halves of a polyline. They share a vertex.
fn halves<V>(p: &[V]) -> [&[V]; 2] {
    let middle = p.len() / 2;
    [&p[..=middle], &p[middle..]]
}

fn parts_between<'a, V, S: Sieve<V>>(
    [p, q]: [&(&'a [V], S::Bounds); 2],
    sieve: &S,
    test: &mut impl FnMut(&[V], &[V]) -> ControlFlow<()>,
) -> ControlFlow<()> {
    let halved = |part: &'a [V]| halves(part).map(|half| (half, sieve.bounds(half)));
    if sieve.apart(&p.1, &q.1) {
        ControlFlow::Continue(())
    } else if p.0.len() <= MAX_PART && q.0.len() <= MAX_PART {
        test_all_pairs(p.0, q.0, test)
    } else if p.0.len() >= q.0.len() {
        let [left, right] = halved(p.0);
        parts_between([&left, q], sieve, test)?;
        parts_between([&right, q], sieve, test)
    } else {
        let [left, right] = halved(q.0);
        parts_between([p, &left], sieve, test)?;
        parts_between([p, &right], sieve, test)
    }
}
