//! Pictures of the worst violations and of the lowest clearance, each before, at and after its
//! frame and from two sides.
//!
//! The recording is read a second time, up to the last frame that a picture needs. Memory: three
//! frames, and the finished pictures.

use super::facts::Facts;
use super::rows::{Moment, names_of};
use super::violations::{Shot, Violation, Violations};
use crate::curve::vector::per_axis;
use crate::curve::{CurveSet, Image, Translated, is_home, words_of_curve};
use crate::ingest::FrameInfo;
use crate::picture::{Panel, Radii, Scene, Window, sheet};
use crate::record::{RecordedFrame, RecordedItem, RecordingReader};
use crate::verdict::{Spot, words_of_pair};
use crate::words::plural;
use maud::PreEscaped;
use std::collections::VecDeque;
use std::io::{Read, Seek};
use std::sync::Arc;

/// Maximum number of violations with pictures, and how many of them are the first ones.
const MOST: usize = 6;
const FIRST: usize = 4;

/// Rule that chooses the violations with pictures.
pub(super) const CHOICE: &str = "The first four violations, the pair with the most pull-throughs, \
     the deepest one (the pair that is furthest apart in the frame in which it changed), and then \
     the next ones. Each is shown in the previous recorded frame, in its own, and in the next one. \
     The window moves with both strands; the second row is the first one after a quarter turn \
     about its vertical. If the strands are near one another, a third row shows the place in it \
     from nearer.";

/// Enlargement above which the place gets a separate picture, because the frames would look alike.
const ALIKE: f64 = 2.5;

/// Pictures of one finding.
pub(super) struct Figure {
    /// Reason for the choice, as a sentence.
    pub reason: String,
    pub shot: Shot,
    /// True if the radii of both strands are known.
    pub thick: bool,
    /// Captions of the frames before, at and after the violation: "frame 27 at 0.9 s".
    pub captions: [String; 3],
    /// Both curves as text.
    pair: String,
    /// Names of both curves, if they have some.
    pub names: Option<[String; 2]>,
    /// The pictures of the frames from both sides, as SVG; `None` if there is none. If the strands
    /// are so near one another that the frames look alike, a third row shows the place.
    pub rows: Vec<[Option<String>; 3]>,
}

/// Chooses the violations that have pictures: see [`CHOICE`]. Returns the position of each pair,
/// and the reasons. Pairs that are undecided have pictures only if no pair changed.
pub(super) fn choose(violations: &Violations) -> Vec<(usize, String)> {
    let ordinal = |v: &Violation| v.shot.as_ref().and_then(|s| s.ordinal);
    let pairs = violations.pairs.iter().enumerate();
    let mut all: Vec<(usize, &Violation)> = pairs.filter(|(_, v)| ordinal(v).is_some()).collect();
    if all.iter().any(|(_, v)| v.changed()) {
        all.retain(|(_, v)| v.changed());
    }
    // In the order of the pictures; a pair may have touched before it changed.
    all.sort_by_key(|(_, v)| ordinal(v));
    let rank = |(k, (pair, _)): (usize, &(usize, &Violation))| match k {
        0 => (*pair, "first".to_owned()),
        k => (*pair, format!("number {}", k + 1)),
    };
    let mut ranks = all.iter().enumerate().map(rank);
    let mut chosen: Vec<(usize, String)> = ranks.by_ref().take(FIRST).collect();
    let place = |v: &Violation| v.link.as_ref()?.place;
    let depth = |v: &Violation| place(v).map_or(0.0, |p| p.distance);
    let last_first = || all.iter().rev();
    let most = last_first().max_by_key(|(_, v)| v.pull_throughs);
    let most = most.filter(|(_, v)| v.pull_throughs > 1);
    let most = most.map(|(pair, v)| (*pair, format!("most pull-throughs ({})", v.pull_throughs)));
    let deepest = last_first().max_by(|a, b| depth(a.1).total_cmp(&depth(b.1)));
    let deepest = deepest.filter(|(_, v)| depth(v) > 0.0 && all.len() > 1);
    let deepest = deepest.map(|(pair, _)| (*pair, "deepest".to_owned()));
    for (pair, reason) in most.into_iter().chain(deepest) {
        match chosen.iter_mut().find(|(known, _)| *known == pair) {
            Some((_, reasons)) => *reasons += &format!(", {reason}"),
            None => chosen.push((pair, reason)),
        }
    }
    for (pair, reason) in ranks {
        if chosen.len() < MOST && chosen.iter().all(|(known, _)| *known != pair) {
            chosen.push((pair, reason));
        }
    }
    chosen
}

/// A frame that a picture shows.
struct Held {
    ordinal: u64,
    moment: Moment,
    set: Arc<CurveSet>,
    info: FrameInfo,
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
            info: frame.info.clone(),
        })
    }

    /// Returns the place in this frame, if it has the curves of another one.
    fn spot(&self, at: &Held, spot: Spot) -> Option<Spot> {
        let index = |i: u32| match at.info.labels.names.get(i as usize) {
            Some(name) => {
                let found = self.info.labels.names.iter().position(|n| n == name);
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
        let mut radii = self.info.labels.radii.clone();
        let Some(cell) = self.info.cell.filter(|_| !is_home(&spot.image)) else {
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

/// Input of a picture: the curves of a frame, the place to show, and the radii of the curves (empty
/// if they are unknown).
type Drawn = (Arc<CurveSet>, Spot, Vec<f32>);

/// Draws the pictures of the worst violations, and that of the lowest clearance if it is too low
/// and no violation shows it, from a second pass over the recording. Returns both.
pub(super) fn draw<R: Read + Seek>(
    mut reader: RecordingReader<R>,
    facts: &Facts,
) -> (Vec<Figure>, Option<Figure>) {
    let pairs = &facts.violations.pairs;
    let chosen = choose(&facts.violations).into_iter();
    let chosen = chosen.filter_map(|(pair, reason)| {
        Some((format!("Chosen as: {reason}."), pairs[pair].shot.clone()?))
    });
    let mut shots: Vec<(String, Shot)> = chosen.collect();
    let violations = shots.len();
    let is_same_place = |(_, s): &(String, Shot), low: &Shot| {
        (s.moment, s.spot.curves, s.spot.image) == (low.moment, low.spot.curves, low.spot.image)
    };
    if let Some((_, low)) = &facts.low
        && !shots.iter().any(|shot| is_same_place(shot, low))
    {
        let frames = plural(facts.clearances[1], "frame");
        let reason = format!(
            "The clearance is below the limit in {frames}. This is the lowest one among the frames \
             whose curves are recorded."
        );
        shots.push((reason, low.clone()));
    }
    let mut pending: Vec<(usize, (String, Shot))> = shots.into_iter().enumerate().collect();
    pending.sort_by_key(|(_, (_, shot))| std::cmp::Reverse(shot.ordinal));
    let mut figures = Vec::new();
    let mut held: VecDeque<Held> = VecDeque::new();
    let mut ordinal = 0;
    let at = |(_, (_, shot)): &(usize, (String, Shot))| shot.ordinal.unwrap_or(0);
    while !pending.is_empty() {
        // Ignores errors, because the first pass has reported them.
        let item = reader.next_item().unwrap_or(None);
        let ended = item.is_none();
        if let Some(RecordedItem::Frame(frame)) = item {
            if pending.iter().any(|order| at(order).abs_diff(ordinal) <= 1) {
                held.extend(Held::of(ordinal, &frame));
                if held.len() > 3 {
                    held.pop_front();
                }
            }
            ordinal += 1;
        }
        // A picture is drawn once its next frame is there.
        while let Some(order) = pending.pop_if(|order| ended || ordinal > at(order) + 1) {
            let at = at(&order);
            let find = |ordinal: Option<u64>| held.iter().find(|h| Some(h.ordinal) == ordinal);
            let frames = [at.checked_sub(1), Some(at), at.checked_add(1)].map(find);
            let (rank, (reason, shot)) = order;
            let what = match rank < violations {
                true => "at the violation",
                false => "lowest clearance",
            };
            let figure = Figure::draw(reason, shot, what, frames, facts.radius());
            figures.push((rank, figure));
        }
    }
    figures.sort_by_key(|(rank, _)| *rank);
    let low = figures.pop_if(|(rank, _)| *rank == violations);
    let figures = figures.into_iter().map(|(_, figure)| figure).collect();
    (figures, low.map(|(_, figure)| figure))
}

impl Figure {
    /// Returns the pictures from the first side, and of the place, as an SVG file.
    pub fn sheet(&self) -> String {
        let panel = |(picture, caption): (&Option<String>, &String)| {
            let picture = PreEscaped(picture.as_ref()?.clone());
            Some((PreEscaped(caption.clone()), picture))
        };
        let row =
            |row: &[Option<String>; 3]| row.iter().zip(&self.captions).filter_map(panel).collect();
        let shown = self.rows.iter().take(1).chain(self.rows.get(2));
        let rows: Vec<Vec<Panel>> = shown.map(row).collect();
        let title = format!("{}: {}", self.shot.moment, self.pair);
        sheet(&title, &self.shot.sentence, &rows)
    }

    /// Draws the pictures of one finding. `what` are words for its frame, `measured` is the radius
    /// of all strands if there is one.
    fn draw(
        reason: String,
        shot: Shot,
        what: &str,
        frames: [Option<&Held>; 3],
        measured: Option<f64>,
    ) -> Figure {
        let at = frames[1];
        let place = |held: &Held| held.spot(at?, shot.spot);
        let captions = per_axis(|k| {
            let name = ["before", what, "after"][k];
            match frames[k] {
                None if k == 0 => format!("{name}: no earlier frame was recorded"),
                None if k == 2 => format!("{name}: no later frame was recorded"),
                None => format!("{name}: the curves of the frame are not valid"),
                Some(held) => {
                    let note = match at {
                        _ if place(held).is_none() => " has other curves",
                        Some(at) if at.info.cuts != held.info.cuts => ", not continuous",
                        _ => "",
                    };
                    format!("{name}: {}{note}", held.moment)
                }
            }
        });
        let drawn = frames.map(|frame| {
            let held = frame?;
            held.with_image(place(held)?)
        });
        let placed = per_axis(|k| drawn[k].as_ref().map(|(set, spot, _)| (&**set, *spot)));
        let radii = per_axis(|k| Radii {
            published: drawn[k].as_ref().map_or(&[], |(.., radii)| radii),
            measured,
        });
        let both = shot.spot.curves.map(|i| radii[1].of(i));
        let windows = Window::around(placed, both.iter().sum());
        let scenes = per_axis(|k| {
            let (set, spot) = placed[k]?;
            Some(Scene::of(set, spot, windows[k]?))
        });
        // The views are those that suit the frame of the violation.
        let mut views = Vec::new();
        if let (Some(at), Some(window)) = (&scenes[1], windows[1]) {
            let shown = || scenes.iter().flatten().flat_map(Scene::own);
            views.extend(at.views().map(|view| view.fitted(shown())));
            let close = views[1].closer(window.apart);
            if window.apart > 0.0 && close.scale > ALIKE * views[1].scale {
                views.push(close);
            }
        }
        let rows = views.into_iter().map(|view| {
            per_axis(|k| {
                let picture = scenes[k].as_ref()?.svg(view, radii[k], &captions[k]);
                Some(picture.into_string())
            })
        });
        let rows = rows.collect();
        let labels = at.map_or(&[][..], |at| &at.info.labels.names);
        Figure {
            reason,
            thick: both.iter().all(|r| *r > 0.0),
            captions,
            pair: match (shot.spot.curves, shot.spot.image) {
                ([i, j], image) if i == j && is_home(&image) => {
                    format!("curve {}", words_of_curve(i, labels))
                }
                (curves, image) => words_of_pair(curves.into(), image, labels),
            },
            names: names_of(shot.spot.curves, labels),
            rows,
            shot,
        }
    }
}
