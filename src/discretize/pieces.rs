//! Pairs of pieces of two polylines that are near each other.
//!
//! Splines that run near each other are split into thousands of pieces, and each piece is near a
//! few others. Testing every piece with every other is quadratic in their number, so long polylines
//! are halved as long as their parts are not apart. Near-linear in pieces for polylines that are
//! spatially coherent.

use std::ops::ControlFlow;

/// Vertices of a part that is not halved any more.
const FEW: usize = 5;

/// What keeps parts of polylines apart, for vertices `V`: whatever keeps two parts apart must keep
/// all their pieces apart.
pub(crate) trait Sieve<V> {
    /// What is known of a part.
    type Bounds;

    fn bounds(&self, vertices: &[V]) -> Self::Bounds;

    fn apart(&self, first: &Self::Bounds, second: &Self::Bounds) -> bool;
}

/// Calls `test` for pairs of pieces, one of each polyline, until it breaks: for all but some that
/// are apart.
pub(crate) fn pieces_between<V>(
    p: &[V],
    q: &[V],
    sieve: &impl Sieve<V>,
    test: &mut impl FnMut(&[V], &[V]) -> ControlFlow<()>,
) -> ControlFlow<()> {
    if p.len() <= FEW && q.len() <= FEW {
        return every(p, q, test);
    }
    let parts = [p, q].map(|vertices| (vertices, sieve.bounds(vertices)));
    parts_between([&parts[0], &parts[1]], sieve, test)
}

/// [`pieces_between`] a polyline and itself: every pair of different pieces once.
pub(crate) fn pieces_within<V>(
    p: &[V],
    sieve: &impl Sieve<V>,
    test: &mut impl FnMut(&[V], &[V]) -> ControlFlow<()>,
) -> ControlFlow<()> {
    if p.len() <= FEW {
        for k in 1..p.len() - 1 {
            every(&p[k - 1..=k], &p[k..], test)?;
        }
        return ControlFlow::Continue(());
    }
    let [left, right] = halves(p);
    pieces_within(left, sieve, test)?;
    pieces_within(right, sieve, test)?;
    pieces_between(left, right, sieve, test)
}

/// All pairs of pieces.
fn every<V>(
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

/// Both halves of a polyline. They share a vertex.
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
    } else if p.0.len() <= FEW && q.0.len() <= FEW {
        every(p.0, q.0, test)
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
