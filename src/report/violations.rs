//! Violations: what happened to each pair of curves, over all frames.

use super::rows::{Moment, names_of};
use crate::curve::{Image, Notation, Point};
use crate::verdict::{Change, ChangeKind, DefectKind, Report};
use std::collections::HashMap;

/// Maximum number of pairs that are listed: the first ones.
const MOST: usize = 400;

/// A place between two curves, for a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Spot {
    /// Both curves; the same one twice if it meets itself, or if there is only one.
    pub curves: [u32; 2],
    /// Translation of the second curve, in vectors of the cell.
    pub image: Image,
    pub segments: [u32; 2],
    pub point: Point,
}

/// The frame of a violation that a picture shows.
#[derive(Clone, Debug)]
pub(super) struct Shot {
    /// Position of the frame among all frames of the file; `None` if it is not recorded.
    pub ordinal: Option<u64>,
    pub moment: Moment,
    pub spot: Spot,
    /// The finding in words.
    pub sentence: String,
    /// The pull-through in words, if the finding is a changed linking number that it explains.
    pub passage: Option<String>,
    /// True for a change or a pull-through, false for a pair that is undecided.
    pub changed: bool,
}

/// Linking number of a pair that differs from the expected one.
#[derive(Clone, Debug, serde::Serialize)]
pub(super) struct LinkRow {
    pub kind: ChangeKind,
    pub expected: i64,
    /// Linking number in the first frame in which it differed.
    pub found: i64,
    /// Segments at the place of the closest approach.
    pub segments: Option<[u32; 2]>,
    pub point: Option<Point>,
    /// Distance of the curves in this frame.
    pub distance: Option<f64>,
    /// The place and the distance in words.
    #[serde(skip)]
    pub words: Option<[String; 2]>,
    pub first: Moment,
    pub last: Moment,
    /// Number of frames in which it differed.
    pub frames: u64,
}

/// A pair without a linking number, or with an undecided step.
#[derive(Clone, Debug, serde::Serialize)]
pub(super) struct DefectRow {
    pub kind: DefectKind,
    pub first: Moment,
    pub frames: u64,
    pub sentence: String,
}

/// What happened to a pair of curves, or to a curve and an image of another one or of itself.
#[derive(Clone, Debug, serde::Serialize)]
pub(super) struct Violation {
    pub curves: [u32; 2],
    /// Translation of the second curve, in vectors of the cell.
    pub image: Image,
    /// Names of both curves, if they have some.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub names: Option<[String; 2]>,
    pub link: Option<LinkRow>,
    pub defect: Option<DefectRow>,
    pub pull_throughs: u64,
    pub unresolved: u64,
    #[serde(skip)]
    pub shot: Option<Shot>,
}

impl Violation {
    /// Returns true if the topology of the pair changed.
    pub fn changed(&self) -> bool {
        self.link.is_some() || self.pull_throughs > 0
    }

    /// Replaces the frame of the picture, if this one says more.
    fn shoot(&mut self, shot: impl FnOnce() -> Shot, changed: bool) {
        if self.shot.as_ref().is_none_or(|s| changed && !s.changed) {
            self.shot = Some(shot());
        }
    }
}

/// The first pairs of curves with findings, in the order of their first one.
#[derive(Debug, Default)]
pub(super) struct Violations {
    pub pairs: Vec<Violation>,
    /// True if there are more.
    pub more: bool,
    /// Position of each pair, by its current curves and the image of the second one.
    index: HashMap<([u32; 2], Image), usize>,
}

impl Violations {
    /// Adds the findings of a frame.
    pub fn add(&mut self, report: &Report, names: &[String], ordinal: Option<u64>) {
        let (moment, extent) = (Moment::of(report), report.stats.extent);
        let shot = |spot, sentence, changed| Shot {
            ordinal,
            moment,
            spot,
            sentence,
            passage: None,
            changed,
        };
        let resolved = report.events.iter().map(|event| (event, true));
        let unresolved = report.unresolved.iter().map(|event| (event, false));
        for (event, resolved) in resolved.chain(unresolved) {
            let Some(pair) = self.pair([event.i, event.j], event.image, names) else {
                continue;
            };
            match resolved {
                true => pair.pull_throughs += 1,
                false => pair.unresolved += 1,
            }
            let spot = Spot {
                curves: [event.i, event.j],
                image: event.image,
                segments: event.segments,
                point: event.point,
            };
            let sentence = || event.sentence_named(extent, names);
            pair.shoot(|| shot(spot, sentence(), resolved), resolved);
        }
        for change in &report.changes {
            let Some(pair) = self.pair([change.i, change.j], change.image, names) else {
                continue;
            };
            match &mut pair.link {
                Some(link) => {
                    link.frames += 1;
                    link.last = moment;
                }
                None => pair.link = Some(link_row(change, extent, moment)),
            }
            let sentence = || change.sentence_named(extent, names);
            if let Some(shot) = &mut pair.shot
                && shot.changed
                && shot.moment == moment
                && shot.passage.is_none()
            {
                shot.passage = Some(std::mem::replace(&mut shot.sentence, sentence()));
            }
            if let Some(place) = &change.place {
                let spot = Spot {
                    curves: [change.i, change.j],
                    image: change.image,
                    segments: place.segments,
                    point: place.point,
                };
                pair.shoot(|| shot(spot, sentence(), true), true);
            }
        }
        for defect in &report.defects {
            let sentence = || report.defect(defect, names);
            let curves = [defect.i, defect.j.unwrap_or(defect.i)];
            let Some(pair) = self.pair(curves, defect.image, names) else {
                continue;
            };
            match &mut pair.defect {
                Some(row) => row.frames += 1,
                None => {
                    pair.defect = Some(DefectRow {
                        kind: defect.kind,
                        first: moment,
                        frames: 1,
                        sentence: sentence(),
                    });
                }
            }
            let spot = Spot {
                curves,
                image: defect.image,
                segments: defect.place.segments,
                point: defect.place.point,
            };
            pair.shoot(|| shot(spot, sentence(), false), false);
        }
    }

    /// Follows the pairs by their names, because the next frames have other curves.
    pub fn rename(&mut self, names: &[String]) {
        if names.is_empty() {
            // Curves without names stay the same.
            return;
        }
        let indices = names.iter().map(String::as_str).zip(0_u32..);
        let indices: HashMap<&str, u32> = indices.collect();
        self.index.clear();
        for (k, pair) in self.pairs.iter().enumerate() {
            let now = pair.names.as_ref().and_then(|[a, b]| {
                let [i, j] = [a, b].map(|name| indices.get(name.as_str()).copied());
                Some([i?, j?])
            });
            if let Some([i, j]) = now {
                // The image is that of the second curve.
                let image = match i <= j {
                    true => pair.image,
                    false => pair.image.map(|n| -n),
                };
                self.index.insert(([i.min(j), i.max(j)], image), k);
            }
        }
    }

    fn pair(&mut self, curves: [u32; 2], image: Image, names: &[String]) -> Option<&mut Violation> {
        let next = self.pairs.len();
        let k = match self.index.get(&(curves, image)) {
            Some(&k) => k,
            None if next == MOST => {
                self.more = true;
                return None;
            }
            None => {
                self.index.insert((curves, image), next);
                self.pairs.push(Violation {
                    curves,
                    image,
                    names: names_of(curves, names),
                    link: None,
                    defect: None,
                    pull_throughs: 0,
                    unresolved: 0,
                    shot: None,
                });
                next
            }
        };
        Some(&mut self.pairs[k])
    }
}

fn link_row(change: &Change, extent: f64, moment: Moment) -> LinkRow {
    let words = change.place.map(|place| {
        let notation = Notation::of_scene(extent, place.point);
        [notation.point(place.point), notation.length(place.distance)]
    });
    LinkRow {
        kind: change.kind(),
        expected: change.expected,
        found: change.found,
        segments: change.place.map(|p| p.segments),
        point: change.place.map(|p| p.point),
        distance: change.place.map(|p| p.distance),
        words,
        first: moment,
        last: moment,
        frames: 1,
    }
}
