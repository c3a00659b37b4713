//! The scene: curves by the name of what has them, changed by messages.
//!
//! - Deletions come before additions in a `SceneUpdate`, and their times are ignored, as Foxglove
//!   does it. Markers are in the order of their array.
//! - A lifetime counts from the time in the log, as in Foxglove and RViz: the curves are gone from
//!   the first frame that is logged later than that.
//! - Curves keep the order in which they appeared first.

use crate::curve::{Basis, CurveLabels, CurveSet, Point, Positions, Precision};
use crate::error::Result;
use crate::verdict::LeftOut;
use std::collections::{BTreeSet, HashMap, HashSet};
use std::sync::Arc;

/// A polyline.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Strip {
    pub closed: bool,
    pub points: Vec<Point>,
}

/// An element of a scene that is no line, by its name in the singular and in the plural.
pub(super) type Kind = [&'static str; 2];

/// Elements that may be parts of curves. (Cubes, spheres, points, texts and meshes are not.)
pub(super) const CYLINDER: Kind = ["cylinder", "cylinders"];
pub(super) const TRIANGLES: Kind = ["list of triangles", "lists of triangles"];
pub(super) const ARROW_STRIP: Kind = ["strip of arrows", "strips of arrows"];
/// A type of marker that is not known.
pub(super) const UNKNOWN: Kind = ["marker of unknown type", "markers of unknown types"];
const MAYBE_CURVES: [Kind; 3] = [CYLINDER, ARROW_STRIP, UNKNOWN];

/// Change of the scene by a message.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Update {
    /// Time of the message in nanoseconds, if it has one.
    pub stamp: Option<u64>,
    pub changes: Vec<Change>,
}

/// Change of one entity or marker.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Change {
    /// Adds or replaces the entity of a name.
    Put(String, Entity),
    Delete(String),
    /// Deletes everything, or everything in a namespace.
    DeleteAll(Option<String>),
}

#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Entity {
    pub namespace: String,
    /// Name of the coordinate system.
    pub frame_id: String,
    /// Nanoseconds; 0 without a limit.
    pub lifetime: u64,
    pub strips: Vec<Strip>,
    /// Elements that are no lines.
    pub others: Vec<(Kind, u64)>,
}

/// An entity of the scene.
struct Shown {
    entity: Entity,
    /// Number in the order of appearance.
    order: u64,
    /// Time in the log after which it is gone.
    expires: Option<u64>,
}

#[derive(Default)]
pub(super) struct State {
    entities: HashMap<String, Shown>,
    /// Number of entities that appeared so far.
    appeared: u64,
    /// For each entity that had lines so far, true if it had several at first. Then their names
    /// have numbers; otherwise the first line keeps the name of the entity when more are added.
    numbered: HashMap<String, bool>,
    /// First curve of the file, and its coordinate system.
    frame_id: Option<(String, String)>,
    /// Names that were changed since the frame began.
    changed: HashSet<String>,
    /// Names of the previous frame.
    before: HashSet<String>,
    log_time: u64,
    /// Names of all elements so far that are no lines, in the plural.
    pub seen: BTreeSet<&'static str>,
}

impl State {
    /// Begins a frame: removes everything whose lifetime is over.
    pub fn begin(&mut self, log_time: u64) {
        self.changed.clear();
        self.before = self.entities.keys().cloned().collect();
        self.log_time = log_time;
        let is_alive = |e: &Shown| e.expires.is_none_or(|at| at >= log_time);
        self.entities.retain(|_, e| is_alive(e));
    }

    /// Returns true if an update changes something again that was changed since the frame began.
    pub fn is_changed_by(&self, update: &Update) -> bool {
        update.changes.iter().any(|change| match change {
            Change::Put(name, _) | Change::Delete(name) => self.changed.contains(name),
            Change::DeleteAll(_) => !self.changed.is_empty(),
        })
    }

    /// Returns true if the frame has everything that the previous one had, and all of it changed.
    pub fn is_renewed(&self) -> bool {
        let is_new = |name| self.changed.contains(name) && self.entities.contains_key(name);
        !self.before.is_empty() && self.before.iter().all(is_new)
    }

    pub fn apply(&mut self, update: Update) -> Result<(), String> {
        for change in update.changes {
            match change {
                Change::Delete(name) => {
                    self.entities.remove(&name);
                    self.changed.insert(name);
                }
                Change::DeleteAll(None) => self.entities.clear(),
                Change::DeleteAll(Some(namespace)) => {
                    self.entities.retain(|_, e| e.entity.namespace != namespace);
                }
                Change::Put(name, entity) => {
                    let others = entity.others.iter();
                    self.seen.extend(others.map(|(kind, _)| kind[1]));
                    if !entity.strips.is_empty() {
                        self.check_frame_id(&name, &entity.frame_id)?;
                        let several = entity.strips.len() > 1;
                        self.numbered.entry(name.clone()).or_insert(several);
                    }
                    let order = self.entities.get(&name).map(|before| before.order);
                    let order = order.unwrap_or_else(|| {
                        self.appeared += 1;
                        self.appeared
                    });
                    let lifetime = Some(entity.lifetime).filter(|&ns| ns > 0);
                    let expires = lifetime.map(|ns| self.log_time.saturating_add(ns));
                    let shown = Shown {
                        entity,
                        order,
                        expires,
                    };
                    self.entities.insert(name.clone(), shown);
                    self.changed.insert(name);
                }
            }
        }
        Ok(())
    }

    fn check_frame_id(&mut self, name: &str, frame_id: &str) -> Result<(), String> {
        let first = || (name.to_owned(), frame_id.to_owned());
        let (first, of_first) = self.frame_id.get_or_insert_with(first);
        match of_first == frame_id {
            true => Ok(()),
            false => Err(format!(
                "{name:?} is in the coordinate system {frame_id:?}, but {first:?} in \
                 {of_first:?}; transforms are not read, so write all curves in one of them"
            )),
        }
    }

    /// Returns true if there are no curves.
    pub fn is_empty(&self) -> bool {
        self.entities.values().all(|e| e.entity.strips.is_empty())
    }

    /// Returns the elements of the frame that may be curves, and are not read.
    pub fn left_out(&self) -> Vec<LeftOut> {
        let mut list = Vec::new();
        for (name, entity) in self.in_order() {
            for &(kind, count) in entity.others.iter().filter(|o| MAYBE_CURVES.contains(&o.0)) {
                LeftOut::add_all(&mut list, kind, count, || format!("{name:?}"));
            }
        }
        list
    }

    fn in_order(&self) -> Vec<(&String, &Entity)> {
        let mut entities: Vec<(&String, &Shown)> = self.entities.iter().collect();
        entities.sort_unstable_by_key(|(_, e)| e.order);
        let entities = entities.into_iter();
        entities.map(|(name, e)| (name, &e.entity)).collect()
    }

    /// Returns all curves and their names.
    pub fn curves(&self) -> Result<(CurveSet, Arc<CurveLabels>)> {
        let entities = self.in_order();
        let strips = || entities.iter().flat_map(|(_, e)| &e.strips);
        let points = strips().map(|s| s.points.len()).sum();
        let mut set = CurveSet::builder(Basis::Polyline, Precision::F64, points);
        for strip in strips() {
            set.start_curve(strip.points.len(), strip.closed)?;
            set.push(Positions::F64(strip.points.as_flattened()))?;
        }
        let set = set.finish()?;
        let names = entities.iter().flat_map(|(name, e)| {
            (0..e.strips.len()).map(move |k| match k == 0 && !self.numbered[*name] {
                true => (*name).clone(),
                false => format!("{name}/{k}"),
            })
        });
        let labels = CurveLabels::named(names);
        labels.check(set.len())?;
        Ok((set, Arc::new(labels)))
    }
}
