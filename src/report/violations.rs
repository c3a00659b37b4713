//! Violations: what happened to each pair of curves, over all frames.

use super::rows::{MOST, Moment, names_of};
use crate::curve::Image;
use crate::verdict::{ChangeKind, DefectKind, Finding, Place, Report, Spot};
use std::collections::HashMap;

/// The frame of a violation that a picture shows.
#[derive(Clone, Debug)]
pub(super) struct Shot {
    /// Position of the frame among all frames of the file; `None` if it is not recorded.
    pub ordinal: Option<u64>,
    pub moment: Moment,
    pub spot: Spot,
    /// The finding as text.
    pub sentence: String,
    /// The pull-through as text, if the finding is a changed linking number that it explains.
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
    /// Place of the closest approach in this frame.
    #[serde(flatten)]
    pub place: Option<Place>,
    /// The change as text.
    pub sentence: String,
    pub first: Moment,
    pub last: Moment,
    /// Number of frames in which it differed.
    pub frames: u64,
}

/// Defect of a pair: it has no linking number, or its pull-throughs in a step are undecided.
#[derive(Clone, Debug, serde::Serialize)]
pub(super) struct DefectRow {
    pub kind: DefectKind,
    pub first: Moment,
    #[serde(skip)]
    pub last: Option<Moment>,
    pub frames: u64,
    pub sentence: String,
}

/// Violation of a pair of curves. In a periodic cell, the second one may be an image, also of the
/// first curve itself.
#[derive(Clone, Debug, Default, serde::Serialize)]
pub(super) struct Violation {
    pub curves: [u32; 2],
    /// Translation of the second curve, in lattice vectors.
    pub image: Image,
    /// Names of both curves; `None` if they have none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub names: Option<[String; 2]>,
    pub link: Option<LinkRow>,
    pub defect: Option<DefectRow>,
    pub pull_throughs: u64,
    /// Number of pull-throughs that are not resolved, because the frames are too far apart.
    pub unresolved: u64,
    #[serde(skip)]
    pub shot: Option<Shot>,
}

impl Violation {
    /// Returns true if the topology of the pair changed.
    pub fn changed(&self) -> bool {
        self.link.is_some() || self.pull_throughs > 0
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
        for finding in report.passages_first() {
            let key = (finding.curves(), finding.pair().2);
            let Some(pair) = self.pair(key, names) else {
                continue;
            };
            let sentence = || match finding {
                Finding::Unresolved(e) => e.sentence_named(extent, names),
                other => report.sentence_of(other, names),
            };
            match finding {
                Finding::Invariant(_) => {}
                Finding::PullThrough(_) => pair.pull_throughs += 1,
                Finding::Unresolved(_) => pair.unresolved += 1,
                Finding::Change(c) => {
                    let link = pair.link.get_or_insert_with(|| LinkRow {
                        kind: c.kind(),
                        expected: c.expected,
                        found: c.found,
                        place: c.place,
                        sentence: sentence(),
                        first: moment,
                        last: moment,
                        frames: 0,
                    });
                    link.frames += 1;
                    link.last = moment;
                    if let Some(shot) = &mut pair.shot
                        && shot.changed
                        && shot.moment == moment
                        && shot.passage.is_none()
                    {
                        shot.passage = Some(std::mem::replace(&mut shot.sentence, sentence()));
                    }
                }
                Finding::Defect(d) => {
                    let row = pair.defect.get_or_insert_with(|| DefectRow {
                        kind: d.kind,
                        first: moment,
                        last: None,
                        frames: 0,
                        sentence: sentence(),
                    });
                    // A pair may have several defects in a frame.
                    row.frames += u64::from(row.last.replace(moment) != Some(moment));
                }
            }
            // The frame of the picture is replaced if this one says more.
            let changed = finding.is_change();
            if let Some(spot) = finding.spot()
                && pair.shot.as_ref().is_none_or(|s| changed && !s.changed)
            {
                pair.shot = Some(Shot {
                    ordinal,
                    moment,
                    spot,
                    sentence: sentence(),
                    passage: None,
                    changed,
                });
            }
        }
    }

    /// Follows the pairs by their names, because the next frames have other curves.
    pub fn rename(&mut self, names: &[String]) {
        if names.is_empty() {
            // Curves without names stay the same.
            return;
        }
        let indices: HashMap<&String, u32> = names.iter().zip(0..).collect();
        self.index.clear();
        for (k, pair) in self.pairs.iter().enumerate() {
            let now = pair.names.as_ref().and_then(|[a, b]| {
                let [i, j] = [a, b].map(|name| indices.get(name).copied());
                Some([i?, j?])
            });
            if let Some([i, j]) = now {
                // The translation is that of the second curve.
                let image = pair.image;
                let image = if i <= j { image } else { image.map(|n| -n) };
                self.index.insert(([i.min(j), i.max(j)], image), k);
            }
        }
    }

    fn pair(&mut self, key: ([u32; 2], Image), names: &[String]) -> Option<&mut Violation> {
        let next = self.pairs.len();
        let k = match self.index.get(&key) {
            Some(&k) => k,
            None if next == MOST => {
                self.more = true;
                return None;
            }
            None => {
                self.index.insert(key, next);
                self.pairs.push(Violation {
                    curves: key.0,
                    image: key.1,
                    names: names_of(key.0, names),
                    ..Violation::default()
                });
                next
            }
        };
        Some(&mut self.pairs[k])
    }
}
