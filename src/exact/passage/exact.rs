//! Passages in exact arithmetic, with the translation rule for ties.

use super::super::big::{self, BigPoint, BigPredicates};
use super::super::touch::{segments_touch, touch_by};
use super::polynomial::{Dyadic, Interval, Polynomial, Root};
use super::ring::{Infinitesimal, Ring};
use super::{Edges, Moment, Ties};
use crate::curve::vector::per_axis;
use crate::curve::{SumEdges, SumPoint, single};
use num_bigint::BigInt;

/// Coordinates of a point that moves on a straight line.
type Track<R> = [Polynomial<R>; 3];

/// Two moving edges, as polynomials in time.
#[derive(Clone)]
pub(super) struct MovingEdges<R> {
    /// Vector from the start of the first edge to its end.
    first: Track<R>,
    /// Vector from the start of the second edge to its end.
    second: Track<R>,
    /// Vector from the start of the first edge to the start of the second one.
    between: Track<R>,
}

/// Exponents of the translation of the first curve, `(e, e^16, e^256)`.
///
/// # Proof: no sign below is 0 unless its polynomial is
///
/// All signs below are those of polynomials in the three components of the translation with a
/// degree of at most 8. Their different monomials are different powers of `e`, so a polynomial that
/// is not 0 does not vanish. Its sign is that of the lowest power, which is the same for `k` times
/// the translation with any positive `k`. That matters because every pair of edges has its own unit
/// of length, a power of two, in which its coordinates are integers.
///
/// The degree: if a root is `(x + y sqrt(d)) / z`, then `x` and `z` have a degree of at most 1, `y`
/// of 0, and `d` of 2. A polynomial of degree 2 in time and 1 in the translation has degree 3 at
/// the root, and at most 8 if `p^2` is compared with `q^2 d`.
pub(super) const TRANSLATION: [u32; 3] = [1, 16, 256];

impl MovingEdges<BigInt> {
    pub fn new(before: &Edges, after: &Edges) -> Self {
        let point = |k: usize| [before, after][k / 4][k % 4 / 2][k % 2].map(single);
        MovingEdges::of_points(&big::points(std::array::from_fn(point)))
    }

    /// Ends in this order: a, b of the first edge, c, d of the second one; in both frames.
    fn of_points(all: &[BigPoint; 8]) -> Self {
        let track = |from: usize, to: usize| {
            per_axis(|x| {
                let [start, end] =
                    [0, 4].map(|frame| all[frame + to][x].minus(&all[frame + from][x]));
                let slope = &end - &start;
                Polynomial::new([start, slope])
            })
        };
        MovingEdges {
            first: track(0, 1),
            second: track(2, 3),
            between: track(0, 2),
        }
    }

    /// Returns the motion with the first curve translated by powers of `e`.
    pub fn translated(&self, exponents: [u32; 3]) -> MovingEdges<Infinitesimal> {
        let lift = |track: &Track<BigInt>| {
            per_axis(|x| {
                let lifted = track[x].coefficients().iter();
                Polynomial::new(lifted.map(|c| Infinitesimal::from(c.clone())))
            })
        };
        let mut between = lift(&self.between);
        for (x, along) in between.iter_mut().enumerate() {
            let by = Infinitesimal::term(exponents[x], BigInt::from(1));
            *along = along.minus(&Polynomial::new([by]));
        }
        MovingEdges {
            first: lift(&self.first),
            second: lift(&self.second),
            between,
        }
    }

    /// Returns the vectors from both ends of the first edge to those of the second one along an
    /// axis.
    fn gaps(&self, x: usize) -> [Polynomial<BigInt>; 4] {
        let (c, first) = (&self.between[x], &self.first[x]);
        let d = c.plus(&self.second[x]);
        [c.clone(), c.minus(first), d.minus(first), d]
    }

    /// Returns the relation of the two edges at the single root of `f` in `interval`, a time at
    /// which they lie in one plane.
    fn meeting(&self, f: &Polynomial<BigInt>, interval: &Interval) -> Meeting {
        let sign = |g: &Polynomial<BigInt>| f.signs_at_roots(g, interval);
        // Apart along an axis.
        let apart = |x: usize| {
            let [gap, others @ ..] = self.gaps(x);
            let side = sign(&gap);
            side != 0 && others.iter().all(|other| sign(other) == side)
        };
        if (0..3).any(apart) {
            return Meeting::Apart;
        }
        let normal = cross(&self.first, &self.second);
        let Some(w) = (0..3).find(|&w| sign(&normal[w]) != 0) else {
            // Parallel. They lie on two lines unless both cross products vanish.
            let offset = [&self.second, &self.first].map(|edge| cross(&self.between, edge));
            return if offset.as_flattened().iter().any(|g| sign(g) != 0) {
                Meeting::Apart
            } else {
                Meeting::Tie
            };
        };
        let [a, b, c, d] = self.sides(w).map(|g| sign(&g));
        match (a * b, c * d) {
            (1, _) | (_, 1) => Meeting::Apart,
            (-1, -1) => Meeting::Inside,
            _ => Meeting::Tie,
        }
    }

    /// Proves that the edges, which lie in one plane at all times, are apart at all times of the
    /// interval except the ends of the step. Returns `false` if it finds no proof.
    fn always_apart(&self, interval: &Interval, depth: u32) -> bool {
        // A polynomial without a root inside, and with equal signs at the ends, has one sign.
        let one = Polynomial::new([BigInt::from(1)]);
        let sign = |g: &Polynomial<BigInt>| {
            if g.is_zero() {
                return 0;
            }
            let g = &g.clone().without_roots_at_ends();
            let ends = [&interval.from, &interval.to].map(|t| g.sign_at(t));
            let constant =
                ends[0] == ends[1] && ends[0] != 0 && g.signs_at_roots(&one, interval) == 0;
            if constant { ends[0] } else { 0 }
        };
        let same = |signs: &[i32]| signs[0] != 0 && signs.iter().all(|&s| s == signs[0]);
        let apart = (0..3).any(|x| {
            let [a, b, c, d] = self.sides(x);
            same(&self.gaps(x).map(|g| sign(&g)))
                || same(&[a, b].map(|g| sign(&g)))
                || same(&[c, d].map(|g| sign(&g)))
        });
        let holds = |half: &Interval| self.always_apart(half, depth - 1);
        apart || (depth > 0 && interval.halves().iter().all(holds))
    }
}

/// Relation of two edges at a time at which they lie in one plane.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Meeting {
    /// The edges share no point.
    Apart,
    /// The edges share an inner point of both, and are not parallel.
    Inside,
    /// Any other case: they share an end, or lie on one line.
    Tie,
}

/// Number of times that [`MovingEdges::always_apart`] halves the step.
const HALVINGS: u32 = 6;

/// Net passages at one time, with the sum of their signs.
pub(super) struct Event {
    pub sign: i32,
    pub time: f64,
    pub moment: Moment,
}

/// Returns all passages of a pair of edges, in chronological order. Edges that touch in a frame
/// have an event at that end of the step, even if its sign is 0. Returns `None` if a tie is to be
/// reported.
pub(super) fn events(before: &Edges, after: &Edges, ties: Ties) -> Option<Vec<Event>> {
    let point = |k: usize| [before, after].iter().all(|e| e[k][0] == e[k][1]);
    let at_rest = before == after || point(0) || point(1);
    let contact = [before, after].map(segments_touch);
    events_of(contact, at_rest, || MovingEdges::new(before, after), ties)
}

/// [`events`] of edges whose coordinates are sums.
#[cold]
pub(super) fn events_of_sums(frames: [SumEdges; 2], ties: Ties) -> Option<Vec<Event>> {
    let ends: [SumPoint; 8] = std::array::from_fn(|k| frames[k / 4][k % 4 / 2][k % 2]);
    let all = big::points(ends);
    let [before, after] = [&all[..4], &all[4..]];
    let point = |k: usize| [before, after].iter().all(|ends| ends[k] == ends[k + 1]);
    let at_rest = before == after || point(0) || point(2);
    let contact = [before, after].map(|ends| {
        let [a, b, c, d] = [0, 1, 2, 3].map(|k| &ends[k]);
        touch_by([a, b], [c, d], &mut BigPredicates)
    });
    events_of(contact, at_rest, || MovingEdges::of_points(&all), ties)
}

/// `contact` is true for the frames in which the edges touch, `at_rest` if the edges do not move,
/// or one of them is a point in both frames.
fn events_of(
    contact: [bool; 2],
    at_rest: bool,
    motion: impl FnOnce() -> MovingEdges<BigInt>,
    ties: Ties,
) -> Option<Vec<Event>> {
    let at_end = |end: usize, sign: i32| Event {
        sign,
        time: [0.0, 1.0][end],
        moment: [Moment::Start, Moment::End][end],
    };
    let unchanged = |end: usize| contact[end].then(|| at_end(end, 0));
    if at_rest {
        return Some([0, 1].into_iter().filter_map(unchanged).collect());
    }
    let motion = motion();
    let volume = motion.volume();
    let flat = volume.is_zero();
    let mut translated = None;
    // The translated edges can become coplanar only infinitely near to the roots of this
    // polynomial.
    let plane = match (flat, ties) {
        (false, _) => volume.clone(),
        (true, Ties::Report) if !motion.always_apart(&Interval::step(), HALVINGS) => return None,
        (true, _) => lowest(&translated.insert(motion.translated(TRANSLATION)).volume()),
    };
    if plane.is_zero() {
        // Parallel at all times: the differences of their points fill a surface at most, and the
        // translation is not on it.
        return Some([0, 1].into_iter().filter_map(unchanged).collect());
    }
    // Edges that do not touch at an end of the step have no passage next to it.
    let plane = plane.without_roots_at_ends();
    let free = plane.square_free();
    let mut roots = Vec::new();
    free.isolate(Interval::step(), &mut roots);
    for interval in &mut roots {
        interval.exclude_ends(&free);
    }
    let mut net_passages = |interval: &Interval| {
        translated
            .get_or_insert_with(|| motion.translated(TRANSLATION))
            .net_passages(interval, 0)
    };
    // The translated edges pass through one another only next to a root, or next to a contact in a
    // frame.
    let [start, end] = Interval::step().around(&roots);
    let mut found = Vec::new();
    if contact[0] {
        found.push(at_end(0, net_passages(&start)));
    }
    for mut interval in roots {
        let meeting = match flat {
            true => Meeting::Tie,
            false => motion.meeting(&free, &interval),
        };
        let sign = match (meeting, ties) {
            (Meeting::Apart, _) => 0,
            // The volume either changes its sign or touches zero.
            (Meeting::Inside, _) => {
                (plane.sign_at(&interval.from) - plane.sign_at(&interval.to)) / 2
            }
            (Meeting::Tie, Ties::Report) if !flat => return None,
            // If ties are reported, edges in one plane are proven apart here.
            (Meeting::Tie, _) => net_passages(&interval),
        };
        if sign != 0 {
            interval.narrow(&free);
            found.push(Event {
                sign,
                time: interval.middle(),
                moment: Moment::Within {
                    tie: meeting == Meeting::Tie,
                },
            });
        }
    }
    if contact[1] {
        found.push(at_end(1, net_passages(&end)));
    }
    Some(found)
}

/// Returns the coefficient of the lowest power of `e` that occurs.
fn lowest(f: &Polynomial<Infinitesimal>) -> Polynomial<BigInt> {
    let coefficients = f.coefficients().iter();
    let order = coefficients.clone().filter_map(Infinitesimal::order).min();
    Polynomial::new(coefficients.map(|c| c.coefficient(order.unwrap_or(0))))
}

impl<R: Ring> MovingEdges<R> {
    /// Returns [`orient3d`](super::super::Predicates::orient3d) of the four ends, a cubic
    /// polynomial: `(c - a) . ((b - a) x (d - c))`.
    pub fn volume(&self) -> Polynomial<R> {
        let normal = cross(&self.first, &self.second);
        let part = |x: usize| self.between[x].times(&normal[x]);
        part(0).plus(&part(1)).plus(&part(2))
    }

    /// Returns the sides of the ends `a b c d` relative to the other edge, seen against axis `w`:
    /// `orient2d(c, d, a)`, `orient2d(c, d, b)`, `orient2d(a, b, c)`, `orient2d(a, b, d)`. With
    /// `r = c - a` and `n = (b - a) x (d - c)` these are `r x (d - c)`, the same minus `n`,
    /// `(b - a) x r`, and the same plus `n`.
    pub fn sides(&self, w: usize) -> [Polynomial<R>; 4] {
        let n = cross_along(&self.first, &self.second, w);
        let a = cross_along(&self.between, &self.second, w);
        let c = cross_along(&self.first, &self.between, w);
        let (b, d) = (a.minus(&n), c.plus(&n));
        [a, b, c, d]
    }

    /// Returns the sum of the signs of the passages in `interval`, of a motion in general position.
    /// The result is the same for any axis `w`; see [`super`] for the proof.
    pub fn net_passages(&self, interval: &Interval, w: usize) -> i32 {
        let crossings = self.crossing(&interval.to, w) - self.crossing(&interval.from, w);
        let negated = |p: &Track<R>| per_axis(|x| Polynomial::new([]).minus(&p[x]));
        let (c, a) = (&self.between, &negated(&self.between));
        let (d, b) = (&sum(c, &self.second), &sum(a, &self.first));
        // Vectors from the ends of the first edge to those of the second one: c - a, d - a, and c -
        // b, d - b. The other way round: a - c, b - c, and a - d, b - d.
        let from = |p: &Track<R>, edge: &Track<R>| per_axis(|x| p[x].minus(&edge[x]));
        let (from_b, from_d) = (from(c, &self.first), from(a, &self.second));
        let net_gain = net_gain(c, d, interval, w, -1)
            - net_gain(&from_b, &sum(&from_b, &self.second), interval, w, -1)
            - net_gain(a, b, interval, w, 1)
            + net_gain(&from_d, &sum(&from_d, &self.first), interval, w, 1);
        crossings - net_gain
    }

    /// Returns the contribution of the pair to the linking number at time `t`, seen against axis
    /// `w`: its sign if the first edge passes over the second one, else 0.
    fn crossing(&self, t: &Dyadic, w: usize) -> i32 {
        let [a, b, c, d] = self.sides(w).map(|g| g.sign_at(t));
        if a * b >= 0 || c * d >= 0 || self.volume().sign_at(t) != -d {
            return 0;
        }
        d
    }
}

/// Returns the number of crossings that a pair of edges gains from the neighbours of one of the
/// edges, minus those that it loses to them, while an end of that edge passes over (`height` -1) or
/// under (1) the other edge, seen against axis `w`.
///
/// `x` and `y` are the vectors from that end to the ends of the other edge.
fn net_gain<R: Ring>(
    x: &Track<R>,
    y: &Track<R>,
    interval: &Interval,
    w: usize,
    height: i32,
) -> i32 {
    let plane = [(w + 1) % 3, (w + 2) % 3];
    // If the edge passes above or below the end, the ends of the edge lie on both sides of it along
    // any axis of the plane on which the edge has an extent.
    let Some(u) = plane.into_iter().find(|&u| !x[u].minus(&y[u]).is_zero()) else {
        return 0;
    };
    // The edge meets the vertical line through the end at x + f (y - x), f = x_u / (x_u - y_u).
    let lift = x[u].times(&y[w]).minus(&x[w].times(&y[u]));
    Root::all(&cross_along(x, y, w))
        .iter()
        .filter(|root| {
            let start = root.sign_of(&x[u]);
            start * root.sign_of(&y[u]) < 0
                && root.sign_of(&interval.from.linear_factor()) > 0
                && root.sign_of(&interval.to.linear_factor()) < 0
                && start * root.sign_of(&lift) == height
        })
        .map(|root| root.direction)
        .sum()
}

fn sum<R: Ring>(p: &Track<R>, q: &Track<R>) -> Track<R> {
    per_axis(|x| p[x].plus(&q[x]))
}

fn cross<R: Ring>(p: &Track<R>, q: &Track<R>) -> Track<R> {
    per_axis(|w| cross_along(p, q, w))
}

/// Returns one component of the cross product.
fn cross_along<R: Ring>(p: &Track<R>, q: &Track<R>, w: usize) -> Polynomial<R> {
    let (u, v) = ((w + 1) % 3, (w + 2) % 3);
    p[u].times(&q[v]).minus(&p[v].times(&q[u]))
}
