//! Pictures of the worst violations and of the lowest clearance, each before, at and after its
//! frame and from two sides.
//!
//! The recording is read a second time, up to the last frame that a picture needs. Memory: three
//! frames, and the finished pictures.

use super::facts::Facts;
use super::picture::{Named, Panel};
use super::rows::Moment;
use super::strands::{Part, Radii, Window, strands};
use super::view::views;
use super::violations::{Shot, Spot, Violation, Violations};
use crate::curve::{Cell, CurveLabels, CurveSet, Image, Translated, is_home};
use crate::sinks::{RecordedFrame, RecordedItem, RecordingReader};
use crate::words::plural;
use std::collections::VecDeque;
use std::io::{Read, Seek};
use std::sync::Arc;

/// Maximum number of violations with pictures, and how many of them are the first ones.
const MOST: usize = 6;
const FIRST: usize = 4;

/// How the violations with pictures are chosen.
pub(super) const CHOICE: &str = "The first four violations, the pair with the most pull-throughs, \
     the deepest one (the pair that is furthest apart in the frame in which it changed), and then \
     the next ones. Each is shown in the previous recorded frame, in its own, and in the next one. \
     The window moves with both strands; the second row is the first one after a quarter turn \
     about its vertical.";

/// A violation with pictures.
#[derive(Clone, Debug)]
pub(super) struct Choice {
    /// Position of the pair.
    pub pair: usize,
    /// Reasons for the choice.
    pub reason: String,
}

/// Pictures of one finding.
pub(super) struct Figure {
    /// Reason for the choice, as a sentence.
    pub reason: String,
    pub shot: Shot,
    /// True if the radii of both strands are known.
    pub thick: bool,
    /// What the frames before, at and after it are: "frame 27 at 0.9 s".
    pub captions: [String; 3],
    /// The pictures of the frames from both sides, as SVG; `None` if there is none.
    pub rows: [[Option<String>; 3]; 2],
}

/// Chooses the violations that have pictures: see [`CHOICE`]. Pairs that are undecided have
/// pictures only if no pair changed.
pub(super) fn choose(violations: &Violations) -> Vec<Choice> {
    let recorded = |v: &Violation| v.shot.as_ref().is_some_and(|s| s.ordinal.is_some());
    let pairs = violations.pairs.iter().enumerate();
    let mut all: Vec<(usize, &Violation)> = pairs.filter(|(_, v)| recorded(v)).collect();
    if all.iter().any(|(_, v)| v.changed()) {
        all.retain(|(_, v)| v.changed());
    }
    // In the order of the pictures; a pair may have touched before it changed.
    all.sort_by_key(|(_, v)| v.shot.as_ref().and_then(|s| s.ordinal));
    let mut chosen: Vec<Choice> = Vec::new();
    let mut add = |pair: usize, reason: String| match chosen.iter().position(|c| c.pair == pair) {
        Some(k) => chosen[k].reason += &format!(", {reason}"),
        None if chosen.len() < MOST => chosen.push(Choice { pair, reason }),
        None => {}
    };
    let rank = |k: usize| match k {
        0 => "first".to_owned(),
        k => format!("number {}", k + 1),
    };
    for (k, (pair, _)) in all.iter().enumerate().take(FIRST) {
        add(*pair, rank(k));
    }
    let most = all.iter().rev().max_by_key(|(_, v)| v.pull_throughs);
    if let Some((pair, v)) = most.filter(|(_, v)| v.pull_throughs > 1) {
        add(*pair, format!("most pull-throughs ({})", v.pull_throughs));
    }
    let depth = |v: &Violation| v.link.as_ref().and_then(|l| l.distance).unwrap_or(0.0);
    let deepest = all
        .iter()
        .rev()
        .max_by(|a, b| depth(a.1).total_cmp(&depth(b.1)));
    if let Some((pair, _)) = deepest.filter(|(_, v)| depth(v) > 0.0 && all.len() > 1) {
        add(*pair, "deepest".into());
    }
    for (k, (pair, _)) in all.iter().enumerate().skip(FIRST) {
        let known = chosen.iter().any(|c| c.pair == *pair);
        if !known && chosen.len() < MOST {
            let (pair, reason) = (*pair, rank(k));
            chosen.push(Choice { pair, reason });
        }
    }
    chosen
}

/// A frame that a picture shows.
struct Held {
    ordinal: u64,
    moment: Moment,
    set: Arc<CurveSet>,
    cell: Option<Cell>,
    labels: Arc<CurveLabels>,
    /// Number of cuts before it.
    cuts: u32,
}

impl Held {
    fn of(ordinal: u64, frame: &RecordedFrame) -> Option<Held> {
        let mut set = None;
        // The curves of a rejected frame have no picture.
        frame.ingest(&mut set).ok()?;
        Some(Held {
            ordinal,
            moment: Moment {
                frame: frame.seq,
                time: frame.time,
            },
            set: Arc::new(set?),
            cell: frame.info.cell,
            labels: Arc::clone(&frame.info.labels),
            cuts: frame.info.cuts,
        })
    }

    /// Returns the place in this frame, if it has the curves of another one.
    fn spot(&self, at: &Held, spot: Spot) -> Option<Spot> {
        let index = |i: u32| match at.labels.names.get(i as usize) {
            Some(name) => {
                let found = self.labels.names.iter().position(|n| n == name);
                found.and_then(|i| u32::try_from(i).ok())
            }
            None => Some(i),
        };
        let [i, j] = spot.curves.map(index);
        let curves = [i?, j?];
        let segments = |set: &CurveSet, i: u32| set.curves().get(i as usize).map(|c| c.segments);
        let same = |k: usize| {
            let there = segments(&at.set, spot.curves[k]);
            there.is_some() && there == segments(&self.set, curves[k])
        };
        (same(0) && same(1)).then_some(Spot { curves, ..spot })
    }

    /// Returns the curves with a place. An image that takes part is added as a curve, with its
    /// radius, which then is the second curve of the place.
    fn with_image(&self, spot: Spot) -> Option<Drawn> {
        let mut radii = self.labels.radii.clone();
        let Some(cell) = self.cell.filter(|_| !is_home(&spot.image)) else {
            return Some((Arc::clone(&self.set), spot, radii));
        };
        let (second, curves) = (spot.curves[1], self.set.len());
        radii.extend(radii.get(second as usize).copied());
        let all = (0..curves as u32).map(|i| (i, Image::default()));
        let all = all.chain([(second, spot.image)]).collect();
        let all = Translated::new(all, &vec![None; curves].into());
        let mut set = None;
        CurveSet::translate(&self.set, &all, &cell, &mut set).ok()?;
        let curves = [spot.curves[0], curves as u32];
        Some((Arc::new(set?), Spot { curves, ..spot }, radii))
    }
}

/// Curves of a frame, a place in them, and the radii of the curves, or none.
type Drawn = (Arc<CurveSet>, Spot, Vec<f32>);

/// A picture to draw: its position on the page, that of its frame, and the rest.
struct Order {
    rank: usize,
    ordinal: u64,
    reason: String,
    shot: Shot,
}

/// Draws the pictures of the worst violations, and of the lowest clearance if it is too low and no
/// violation shows it, from a second pass over the recording.
pub(super) fn draw<R: Read + Seek>(
    mut reader: RecordingReader<R>,
    facts: &Facts,
) -> (Vec<Figure>, Option<Figure>) {
    let pairs = &facts.violations.pairs;
    let choices = choose(&facts.violations).into_iter().filter_map(|choice| {
        let reason = format!("Chosen as: {}.", choice.reason);
        Some((reason, pairs[choice.pair].shot.clone()?))
    });
    let mut choices: Vec<(String, Shot)> = choices.collect();
    let violations = choices.len();
    let shown = |low: &Shot| {
        let mut shots = choices.iter().map(|(_, shot)| shot);
        shots.any(|s| {
            (s.moment, s.spot.curves, s.spot.image) == (low.moment, low.spot.curves, low.spot.image)
        })
    };
    if let Some((_, low)) = facts.low.as_ref().filter(|(_, low)| !shown(low)) {
        let frames = plural(facts.clearances[1], "frame");
        let reason = format!(
            "The clearance is below the limit in {frames}: the lowest one of those whose curves \
             are recorded."
        );
        choices.push((reason, low.clone()));
    }
    let orders = choices.into_iter().enumerate();
    let orders = orders.filter_map(|(rank, (reason, shot))| {
        Some(Order {
            rank,
            ordinal: shot.ordinal?,
            reason,
            shot,
        })
    });
    let mut orders: Vec<Order> = orders.collect();
    orders.sort_by_key(|order| std::cmp::Reverse(order.ordinal));
    let mut figures = Vec::new();
    let mut held: VecDeque<Held> = VecDeque::new();
    let mut ordinal = 0;
    loop {
        let item = match orders.is_empty() {
            true => None,
            // The first pass has reported damage.
            false => reader.next_item().unwrap_or(None),
        };
        if let Some(RecordedItem::Frame(frame)) = &item {
            if orders.iter().any(|o| o.ordinal.abs_diff(ordinal) <= 1) {
                held.extend(Held::of(ordinal, frame));
                if held.len() > 3 {
                    held.pop_front();
                }
            }
            ordinal += 1;
        }
        let ended = item.is_none();
        // A picture is drawn once its next frame is there.
        while let Some(order) = orders.pop_if(|o| ended || ordinal > o.ordinal + 1) {
            let at = order.ordinal;
            let find = |ordinal: Option<u64>| held.iter().find(|h| Some(h.ordinal) == ordinal);
            let frames = [at.checked_sub(1), Some(at), at.checked_add(1)].map(find);
            let what = match order.rank < violations {
                true => "at the violation",
                false => "lowest clearance",
            };
            let figure = figure(order, what, frames, facts.radius());
            figures.push(figure);
        }
        if ended {
            break;
        }
    }
    figures.sort_by_key(|(rank, _)| *rank);
    let low = figures.pop_if(|(rank, _)| *rank == violations);
    let figures = figures.into_iter().map(|(_, figure)| figure).collect();
    (figures, low.map(|(_, figure)| figure))
}

/// Draws the pictures of one finding. `what` are words for its frame, `measured` is the radius of
/// all strands if there is one.
fn figure(
    order: Order,
    what: &str,
    frames: [Option<&Held>; 3],
    measured: Option<f64>,
) -> (usize, Figure) {
    let Order {
        rank, reason, shot, ..
    } = order;
    let mut rows: [[Option<String>; 3]; 2] = Default::default();
    let mut captions = ["before", what, "after"].map(str::to_owned);
    let place = |held: &Held| frames[1].and_then(|at| held.spot(at, shot.spot));
    for (k, frame) in frames.iter().enumerate() {
        captions[k] += &match frame {
            None if k == 0 => ": no earlier frame was recorded".to_owned(),
            None if k == 2 => ": no later frame was recorded".to_owned(),
            None => ": the curves of the frame are not valid".to_owned(),
            Some(held) if place(held).is_none() => format!(": {} has other curves", held.moment),
            Some(held) => {
                let cut = frames[1].is_some_and(|at| at.cuts != held.cuts);
                let cut = if cut { ", not continuous" } else { "" };
                format!(": {}{cut}", held.moment)
            }
        };
    }
    let drawn = frames.map(|frame| {
        let held = frame?;
        held.with_image(place(held)?)
    });
    let drawn = drawn.each_ref().map(Option::as_ref);
    let placed = drawn.map(|drawn| drawn.map(|(set, spot, _)| (&**set, *spot)));
    let radii = drawn.map(|drawn| Radii {
        published: drawn.map_or(&[], |(.., radii)| radii),
        measured,
    });
    let both = shot.spot.curves.map(|i| radii[1].of(i));
    let windows = Window::around(placed, both.iter().sum());
    let shown: [Option<_>; 3] = std::array::from_fn(|k| {
        let ((set, spot), window) = (placed[k]?, windows[k]?);
        Some((strands(set, spot, window), named(set, spot, window), window))
    });
    // The views are those that suit the frame of the violation.
    let views = shown[1].as_ref().map(|(strands, ..)| views(strands));
    for (row, view) in rows.iter_mut().zip(views.into_iter().flatten()) {
        for (k, picture) in row.iter_mut().enumerate() {
            *picture = shown[k].as_ref().map(|(strands, named, window)| {
                let panel = Panel {
                    strands,
                    window: *window,
                    view,
                    named,
                    radii: radii[k],
                    label: captions[k].clone(),
                };
                panel.svg()
            });
        }
    }
    let figure = Figure {
        reason,
        shot,
        thick: both.iter().all(|r| *r > 0.0),
        captions,
        rows,
    };
    (rank, figure)
}

/// Returns the segments of a finding.
fn named(set: &CurveSet, spot: Spot, window: Window) -> Vec<Named> {
    let ends = spot.curves.into_iter().zip(spot.segments);
    let ends = ends.zip([Part::First, Part::Second]);
    let named = ends.filter_map(|((i, segment), part)| {
        let curve = set.curves().get(i as usize)?;
        (segment < curve.segments).then(|| Named {
            segment,
            part,
            middle: window.local(set.eval(i as usize, segment as usize, 0.5)),
        })
    });
    let mut named: Vec<Named> = named.collect();
    // A curve alone is named twice.
    if spot.curves[0] == spot.curves[1] && spot.segments[0] == spot.segments[1] {
        named.truncate(1);
    }
    named
}
