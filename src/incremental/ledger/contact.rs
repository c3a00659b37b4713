//! Contacts in a frame: the steps on both sides of a contact decide if one curve passed through the
//! other.
//!
//! The passages of edges that touch exactly in a frame depend, in the adjacent steps, on an
//! infinitesimal translation of one curve ([`crate::exact`]). Only their sum over both steps is
//! meaningful: 0 if the strands touched and separated again, 1 or -1 if one passed through the
//! other. So these passages are no events yet. They are kept until the contact ends.
//!
//! # Components
//!
//! A contact at a vertex belongs to two or four pairs of edges, and the translation may assign the
//! passage to any of them. Edges that overlap on a line belong to more. Pairs of edges whose
//! contacts are connected form a component. Its sign is the sum of their signs. A component
//! continues in those components of the next frame that share a pair of segments with it, or have a
//! neighbouring one. If there is none, it ends, and its sum becomes an event at the start of the
//! step in which it ends.
//!
//! # Limits
//!
//! If curves touch in the first frame, it is unknown on which side they were before, so the end of
//! such a contact is no event. Curves with a common vertex in both frames of a step are joined
//! there. A *joint* that exists in the first frame (two rods at a node, for example) is not
//! reported as a contact. Passages during the motion of a joint are not counted: if a joint that
//! formed during the run opens after it moved, the step is undecided.

use super::outcome::Outcome;
use crate::curve::{Curve, CurveSet};
use crate::exact::segments_touch;
use crate::pairs::{Pair, closest_of_segments};
use crate::verdict::{Defect, DefectKind, PullThrough};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Two edges that touch in a frame of a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Contact {
    /// Pair of curves, segments and place; the fraction is 0 or 1. The sign is the net number of
    /// passages of the translated edges next to this end of the step. If the edges touch at both
    /// ends, the contact at the start has the passages of the whole step.
    pub event: PullThrough,
    /// True if the edges share a vertex in both frames.
    pub joint: bool,
    /// True if the sign is known. The sign of a moving joint is not; this is recorded at the start
    /// of the step.
    pub counted: bool,
}

impl Contact {
    fn pair(&self) -> Pair {
        (self.event.i, self.event.j)
    }

    fn at_start(&self) -> bool {
        self.event.fraction == 0.0
    }
}

/// Sum of the signs of a component, as far as it is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
enum Passed {
    /// Sum since the curves came into contact.
    Sum(i32),
    /// The contact has existed since the first frame, so there is no state to compare with.
    FromTheStart,
    /// A passage may have been missed.
    Unknown,
}

impl Passed {
    fn and(self, other: Passed) -> Passed {
        match (self, other) {
            (Passed::Sum(a), Passed::Sum(b)) => Passed::Sum(a + b),
            (Passed::FromTheStart, Passed::FromTheStart | Passed::Sum(0))
            | (Passed::Sum(0), Passed::FromTheStart) => Passed::FromTheStart,
            _ => Passed::Unknown,
        }
    }
}

/// Connected contacts of one pair of curves in a frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Component {
    pair: Pair,
    /// Pairs of segments, sorted.
    segments: Vec<[u32; 2]>,
    passed: Passed,
}

/// The contacts in the last frame of a step, with the sum of the passages through them so far.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Contacts {
    /// Components, sorted by pair.
    components: Vec<Component>,
}

/// Two curves that touch in a frame, or a curve that touches itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Touching {
    pub defect: Defect,
    /// True if they have touched in every frame since the first.
    pub from_the_start: bool,
}

impl Contacts {
    /// Returns these contacts with other numbers of the curves; `None` if a pair has none.
    pub fn renamed(&self, pair: impl Fn(Pair) -> Option<Pair>) -> Option<Contacts> {
        let mut out = self.clone();
        for component in &mut out.components {
            component.pair = pair(component.pair)?;
        }
        out.components.sort_by_key(|component| component.pair);
        Some(out)
    }

    /// Keeps the contacts of some pairs.
    pub fn retain(&mut self, keep: impl Fn(Pair) -> bool) {
        self.components.retain(|component| keep(component.pair));
    }

    /// Returns true if no curves touch.
    pub fn is_empty(&self) -> bool {
        self.components.is_empty()
    }

    /// Returns the contacts of a first frame; `found` has the contacts of a step from the frame to
    /// itself.
    pub fn of_first_frame(found: &[Contact], set: &CurveSet) -> (Contacts, Vec<Touching>) {
        let (mut contacts, mut touches) = (Contacts::default(), Vec::new());
        for found in found.chunk_by(|a, b| a.pair() == b.pair()) {
            let found: Vec<&Contact> = found.iter().filter(|c| c.at_start()).collect();
            let mut components = components(&found, set);
            for component in &mut components {
                component.passed = Passed::FromTheStart;
            }
            touches.extend(touching(&components, &found, set));
            contacts.components.extend(components);
        }
        (contacts, touches)
    }

    /// Returns the pairs of curves in contact, sorted.
    pub fn pairs(&self) -> Vec<Pair> {
        let mut pairs: Vec<Pair> = self.components.iter().map(|c| c.pair).collect();
        pairs.dedup();
        pairs
    }

    /// Follows the contacts of the first frame of a step to the last one. `found` has all contacts
    /// of the step, sorted by pair. An undecided pair has none in `found`: its contacts are
    /// discarded, and the sums of those that the next step finds are unknown.
    ///
    /// Adds to `out` an event for each passage through a contact that ended, an undecided pair for
    /// each contact that ended with an unknown sum, and one contact for each pair of curves that
    /// touches in the last frame, except joints of the first frame.
    pub(super) fn follow(&self, found: &[Contact], frames: [&CurveSet; 2], out: &mut Outcome) {
        for found in found.chunk_by(|a, b| a.pair() == b.pair()) {
            let pair = found[0].pair();
            let from = self.components.partition_point(|c| c.pair < pair);
            let to = self.components.partition_point(|c| c.pair <= pair);
            follow_pair(&self.components[from..to], found, frames, out);
        }
    }
}

/// [`Contacts::follow`] for one pair of curves.
fn follow_pair(open: &[Component], found: &[Contact], frames: [&CurveSet; 2], out: &mut Outcome) {
    let pair = found[0].pair();
    let (start, end): (Vec<&Contact>, Vec<&Contact>) = found.iter().partition(|c| c.at_start());
    let mut starts = components(&start, frames[0]);
    let owners = owners(open);
    for component in &mut starts {
        // The components of this frame equal those at the end of the previous step, unless the pair
        // was undecided in either step.
        let owner = component.segments.iter().find_map(|s| owners.get(s));
        component.passed = match owner.map(|&k| &open[k]) {
            Some(before) if before.passed == Passed::FromTheStart => Passed::FromTheStart,
            Some(before) if before.segments == component.segments => {
                component.passed.and(before.passed)
            }
            _ => Passed::Unknown,
        };
    }
    let mut ends = components(&end, frames[1]);
    let owners = self::owners(&ends);
    let curves = [pair.0, pair.1].map(|i| frames[0].curve(i as usize));
    for component in starts {
        let segments = component.segments.iter();
        let mut near = segments.flat_map(|&s| around(s, curves));
        if let Some(&next) = near.find_map(|s| owners.get(&s)) {
            ends[next].passed = ends[next].passed.and(component.passed);
            continue;
        }
        let is_in_component =
            |c: &&&Contact| component.segments.binary_search(&c.event.segments).is_ok();
        match component.passed {
            Passed::Sum(0) | Passed::FromTheStart => {}
            Passed::Sum(sum) => {
                // Any of the contacts can serve as the place; prefer one with the sign of the sum.
                let places = start.iter().filter(is_in_component);
                let place = places.max_by_key(|c| c.event.sign * sum.signum());
                let event = place.map(|c| PullThrough {
                    sign: sum.signum(),
                    ..c.event
                });
                out.events.extend((0..sum.abs()).filter_map(|_| event));
            }
            Passed::Unknown => {
                let place = start.iter().find(is_in_component);
                out.undecided.extend(place.map(|c| defect(c, frames[1])));
            }
        }
    }
    out.touching.extend(touching(&ends, &end, frames[1]));
    out.contacts.components.extend(ends);
}

/// Maps each pair of segments to its component.
fn owners(components: &[Component]) -> BTreeMap<[u32; 2], usize> {
    let all = components.iter().enumerate();
    all.flat_map(|(k, c)| c.segments.iter().map(move |&s| (s, k)))
        .collect()
}

/// Iterates over a pair of segments and the pairs with the segments before and after either.
fn around([s, t]: [u32; 2], [first, second]: [Curve; 2]) -> impl Iterator<Item = [u32; 2]> {
    let [p, q] = [(first, s), (second, t)].map(|(c, s)| [s, c.before(s), c.after(s)]);
    p.into_iter().flat_map(move |s| q.map(|t| [s, t]))
}

/// Returns a contact of these components to be reported, if any. Prefers one that began during the
/// run.
fn touching(components: &[Component], contacts: &[&Contact], set: &CurveSet) -> Option<Touching> {
    let (i, j) = contacts.first()?.pair();
    if i != j && [i, j].iter().all(|&i| set.curve(i as usize).closed) {
        // The certificate reports two closed curves that touch: they have no linking number.
        return None;
    }
    let owners = owners(components);
    let from_the_start = |c: &Contact| {
        let owner = owners.get(&c.event.segments);
        owner.is_some_and(|&k| components[k].passed == Passed::FromTheStart)
    };
    let report = |from: bool| {
        let matches = |c: &&&Contact| from_the_start(c) == from && !(from && c.joint);
        contacts.iter().find(matches).map(|c| Touching {
            defect: defect(c, set),
            from_the_start: from,
        })
    };
    report(false).or_else(|| report(true))
}

fn defect(contact: &Contact, set: &CurveSet) -> Defect {
    let (i, j) = contact.pair();
    let curves = [i, j].map(|i| i as usize);
    let place = closest_of_segments(set, curves, contact.event.segments);
    Defect::of_pair((i, j), DefectKind::Contact, place)
}

/// Returns the components of the contacts of a pair of curves in one frame.
fn components(contacts: &[&Contact], set: &CurveSet) -> Vec<Component> {
    let Some(first) = contacts.first() else {
        return Vec::new();
    };
    let pair = first.pair();
    let curves = [pair.0, pair.1].map(|i| set.curve(i as usize));
    let mut passed: BTreeMap<[u32; 2], Passed> = BTreeMap::new();
    for contact in contacts {
        let sign = match contact.counted {
            true => Passed::Sum(contact.event.sign),
            false => Passed::Unknown,
        };
        let sum = passed.entry(contact.event.segments);
        let sum = sum.or_insert(Passed::Sum(0));
        *sum = sum.and(sign);
    }
    let mut rest = passed.clone();
    let mut out = Vec::new();
    while let Some((start, _)) = rest.pop_first() {
        let mut component = Component {
            pair,
            segments: vec![start],
            passed: passed[&start],
        };
        let mut next = 0;
        while let Some(&from) = component.segments.get(next) {
            next += 1;
            for to in around(from, curves) {
                if rest.contains_key(&to) && connected(pair, from, to, set) {
                    rest.remove(&to);
                    component.segments.push(to);
                    component.passed = component.passed.and(passed[&to]);
                }
            }
        }
        component.segments.sort_unstable();
        out.push(component);
    }
    out
}

/// Returns true if the contacts of two pairs of edges of the same two curves, all of which touch,
/// share a point: a common vertex of both edges of one curve that is also on both edges of the
/// other.
fn connected((i, j): Pair, a: [u32; 2], b: [u32; 2], set: &CurveSet) -> bool {
    let curves = [i, j].map(|i| i as usize);
    let knot = |side: usize, k: u32| set.knot(curves[side], k as usize);
    let edge = |side: usize, s: u32| [knot(side, s), knot(side, s + 1)];
    // Common point of two successive edges; both ends if the edges are equal.
    let common = |side: usize| {
        let (s, t) = (a[side], b[side]);
        let curve = set.curve(curves[side]);
        match () {
            _ if s == t => Some(edge(side, s)),
            _ if curve.after(s) == t => Some([knot(side, s + 1); 2]),
            _ if curve.after(t) == s => Some([knot(side, t + 1); 2]),
            _ => None,
        }
    };
    let points = common(0).zip(common(1));
    points.is_some_and(|(p, q)| segments_touch(&[p, q]))
}
