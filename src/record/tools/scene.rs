//! The curves as lines, and the findings as marks and labels: `foxglove.SceneUpdate`.
//!
//! Every update replaces all entities of the previous one, and deletes those that it does not have,
//! so a tool that jumps to any frame shows that frame.
//!
//! | entity | content |
//! |---|---|
//! | `curves` | all curves without findings, thinned, as one list of lines |
//! | `curve NAME` | a curve with findings, in full; its index if it has no name |
//! | `findings` | a star at each pull-through, and a label at each place |
//!
//! Lines and labels have sizes in pixels, for scenes of any size.

use super::sample::{Limits, Sample};
use super::{FRAME_ID, State, states, time_of};
use crate::curve::{CurveSet, Point, bounds, words_of_curve};
use crate::formats::container::foxglove::{
    Color, KeyValuePair, LinePrimitive, LineType, Pose, Quaternion, SceneEntity,
    SceneEntityDeletion, SceneUpdate, TextPrimitive, Xyz,
};
use crate::sinks::{FrameRecord, star};
use crate::verdict::Finding;
use std::collections::BTreeSet;

/// A point of the list of lines takes 37 bytes.
const REST: Limits = Limits {
    most: 30_000,
    wanted: 30_000,
    per_segment: 6,
    per_edge: 1,
};

/// A point of another line takes 29 bytes.
const FOUND: Limits = Limits {
    most: 200_000,
    wanted: 30_000,
    per_segment: 6,
    per_edge: 1,
};

/// Maximum number of labels of each kind of finding, because more would hide one another.
const SHOWN: usize = 20;

/// Width of lines and height of letters, in pixels.
const THIN: f64 = 1.0;
const THICK: f64 = 3.0;
const LETTERS: f64 = 14.0;

/// Length of the rays of a star, as a share of the extent of the scene and of its curve.
const STAR: [f64; 2] = [0.02, 0.2];

const CYAN: [u8; 4] = [0x40, 0xd8, 0xff, 0xff];

/// Writes updates of the scene.
#[derive(Default)]
pub(crate) struct Scene {
    /// Entities of the last update.
    shown: BTreeSet<String>,
}

impl Scene {
    /// Returns the message of a frame.
    pub fn update(&mut self, set: &CurveSet, record: &FrameRecord) -> SceneUpdate {
        let report = &record.report;
        let names = &record.info.labels.names;
        let states = states(report, set.len());
        let timestamp = Some(time_of(report));
        let entity = |id: String| SceneEntity {
            timestamp,
            frame_id: FRAME_ID.into(),
            id,
            ..SceneEntity::default()
        };
        let mut entities = Vec::new();
        let rest = rest(set, &states);
        if !rest.points.is_empty() {
            entities.push(SceneEntity {
                metadata: pairs([
                    ("frame", report.seq.to_string()),
                    ("simulation time", report.time.to_string()),
                    ("verdict", report.verdict.to_string()),
                ]),
                lines: vec![rest],
                ..entity("curves".into())
            });
        }
        let found = Sample::new(set, &states, |s| s != State::Intact, FOUND);
        for (i, &state) in states.iter().enumerate() {
            let points: Vec<Xyz> = match state {
                State::Intact => continue,
                _ => found.points(i).map(Xyz::from).collect(),
            };
            let kind = match set.curve(i).closed {
                true => LineType::Loop,
                false => LineType::Strip,
            };
            let name = names.get(i).cloned().unwrap_or_else(|| i.to_string());
            entities.push(SceneEntity {
                metadata: pairs([("curve", words_of_curve(i as u32, names))]),
                lines: vec![line(kind, points, (state.color(), THICK))],
                ..entity(format!("curve {name}"))
            });
        }
        let (stars, texts) = findings(set, record);
        if !texts.is_empty() {
            entities.push(SceneEntity {
                lines: stars.into_iter().collect(),
                texts,
                ..entity("findings".into())
            });
        }
        let shown: BTreeSet<String> = entities.iter().map(|e| e.id.clone()).collect();
        let deletions = self.shown.difference(&shown).map(|id| SceneEntityDeletion {
            timestamp,
            id: id.clone(),
            ..SceneEntityDeletion::default()
        });
        let deletions = deletions.collect();
        self.shown = shown;
        SceneUpdate {
            deletions,
            entities,
        }
    }
}

/// Returns all curves without findings. As one primitive, because tools draw few large primitives
/// faster than thousands of small ones.
fn rest(set: &CurveSet, states: &[State]) -> LinePrimitive {
    let sample = Sample::new(set, states, |s| s == State::Intact, REST);
    let (mut points, mut indices) = (Vec::new(), Vec::new());
    for (i, _) in (0..).zip(states).filter(|(_, s)| **s == State::Intact) {
        let first = points.len() as u32;
        points.extend(sample.points(i).map(Xyz::from));
        let end = points.len() as u32;
        indices.extend((first + 1..end).flat_map(|k| [k - 1, k]));
        if set.curve(i).closed && first < end {
            indices.extend([end - 1, first]);
        }
    }
    LinePrimitive {
        indices,
        ..line(LineType::List, points, (State::Intact.color(), THIN))
    }
}

/// Returns a star at each pull-through, and a label at each place.
fn findings(set: &CurveSet, record: &FrameRecord) -> (Option<LinePrimitive>, Vec<TextPrimitive>) {
    let report = &record.report;
    let names = &record.info.labels.names;
    let texts = report.first_findings(SHOWN).filter_map(|finding| {
        let color = match finding {
            Finding::Change(_) => State::Broken.color(),
            Finding::PullThrough(_) => CYAN,
            Finding::Defect(_) | Finding::Unresolved(_) => State::Undecided.color(),
        };
        let (_, point) = finding.place()?;
        Some(label(point, finding.label(names), color))
    });
    let rays = report.events.iter().flat_map(|e| {
        let reach = reach(set, e.i as usize, report.stats.extent);
        star(e.point, reach).into_iter().flatten().map(Xyz::from)
    });
    let rays: Vec<Xyz> = rays.collect();
    let stars = match rays.is_empty() {
        true => None,
        false => Some(line(LineType::List, rays, (CYAN, THICK))),
    };
    (stars, texts.collect())
}

/// Returns the length of the rays of a star on curve `i`.
fn reach(set: &CurveSet, i: usize, scene: f64) -> f64 {
    /// Number of knots of which the extent is taken.
    const KNOTS: usize = 64;
    let Some(curve) = set.curves().get(i) else {
        return 0.0;
    };
    let step = (curve.segments as usize).div_ceil(KNOTS);
    let knots = (0..=curve.segments as usize).step_by(step.max(1));
    let [lo, hi] = bounds(knots.map(|s| set.knot(i, s)));
    let size = (0..3).map(|x| hi[x] - lo[x]).fold(0.0, f64::max);
    match scene > 0.0 {
        true => (STAR[0] * scene).min(STAR[1] * size),
        false => STAR[1] * size,
    }
}

fn line(kind: LineType, points: Vec<Xyz>, (color, width): ([u8; 4], f64)) -> LinePrimitive {
    LinePrimitive {
        r#type: kind.into(),
        pose: Some(pose([0.0; 3])),
        thickness: width,
        scale_invariant: true,
        points,
        color: Some(color4(color)),
        ..LinePrimitive::default()
    }
}

fn label(place: Point, text: String, color: [u8; 4]) -> TextPrimitive {
    TextPrimitive {
        pose: Some(pose(place)),
        billboard: true,
        font_size: LETTERS,
        scale_invariant: true,
        color: Some(color4(color)),
        text,
    }
}

/// Returns a pose without rotation.
pub(super) fn pose(place: Point) -> Pose {
    Pose {
        position: Some(place.into()),
        orientation: Some(Quaternion {
            w: 1.0,
            ..Quaternion::default()
        }),
    }
}

fn color4(color: [u8; 4]) -> Color {
    let [r, g, b, a] = color.map(|c| f64::from(c) / 255.0);
    Color { r, g, b, a }
}

fn pairs<const N: usize>(pairs: [(&str, String); N]) -> Vec<KeyValuePair> {
    let pair = |(key, value): (&str, String)| KeyValuePair {
        key: key.into(),
        value,
    };
    pairs.map(pair).into()
}
