//! `foxglove.SceneUpdate`, in protobuf and JSON. Source:
//! <https://docs.foxglove.dev/docs/sdk/schemas> and `schemas/foxglove.proto`.

use super::curves::{self, Kind, Pose};
use super::protobuf::{Message, Value, merge};
use super::state::{self, CYLINDER, Change, Update};
use crate::curve::Point;
use serde::de::IgnoredAny;
use serde::{Deserialize, Deserializer};

#[derive(Default, Deserialize)]
#[serde(default)]
struct SceneUpdate {
    deletions: Vec<Deletion>,
    entities: Vec<Entity>,
}

#[derive(Default, Deserialize)]
#[serde(default)]
struct Deletion {
    #[serde(rename = "type")]
    kind: i64,
    id: String,
}

#[derive(Default, Deserialize)]
#[serde(default)]
struct Entity {
    timestamp: Time,
    frame_id: String,
    id: String,
    lifetime: Time,
    lines: Vec<Line>,
    #[serde(deserialize_with = "count")]
    arrows: u64,
    #[serde(deserialize_with = "count")]
    cubes: u64,
    #[serde(deserialize_with = "count")]
    spheres: u64,
    #[serde(deserialize_with = "count")]
    cylinders: u64,
    #[serde(deserialize_with = "count")]
    triangles: u64,
    #[serde(deserialize_with = "count")]
    texts: u64,
    #[serde(deserialize_with = "count")]
    models: u64,
}

/// Returns the number of elements of a list.
fn count<'de, D: Deserializer<'de>>(list: D) -> Result<u64, D::Error> {
    let list = Option::<Vec<IgnoredAny>>::deserialize(list)?;
    Ok(list.map_or(0, |list| list.len() as u64))
}

#[derive(Default, Deserialize)]
#[serde(default)]
struct Line {
    #[serde(rename = "type")]
    kind: i64,
    pose: LinePose,
    points: Vec<Xyz>,
    indices: Vec<u32>,
}

#[derive(Clone, Copy, Default, Deserialize)]
#[serde(default)]
struct Time {
    #[serde(rename = "sec")]
    seconds: i64,
    #[serde(rename = "nsec")]
    nanos: i64,
}

#[derive(Clone, Copy, Default, Deserialize)]
#[serde(default)]
struct LinePose {
    position: Xyz,
    orientation: Quaternion,
}

#[derive(Clone, Copy, Default, Deserialize)]
#[serde(default)]
struct Xyz {
    x: f64,
    y: f64,
    z: f64,
}

#[derive(Clone, Copy, Default, Deserialize)]
#[serde(default)]
struct Quaternion {
    x: f64,
    y: f64,
    z: f64,
    w: f64,
}

/// Reads a message in protobuf.
pub(super) fn protobuf(message: &[u8]) -> Result<Update, String> {
    let mut update = SceneUpdate::default();
    merge(&mut update, message)?;
    changes(update)
}

/// Reads a message in JSON.
pub(super) fn json(message: &[u8]) -> Result<Update, String> {
    let update = serde_json::from_slice(message);
    changes(update.map_err(|e| format!("not a scene update in JSON: {e}"))?)
}

fn changes(update: SceneUpdate) -> Result<Update, String> {
    let stamps = update.entities.iter().map(|e| e.timestamp.nanoseconds());
    let stamp = stamps.max().filter(|&ns| ns > 0);
    let mut changes = Vec::new();
    for deletion in update.deletions {
        changes.push(match deletion.kind {
            0 => Change::Delete(name_of(deletion.id)),
            1 => Change::DeleteAll(None),
            other => return Err(format!("a deletion of type {other}, expected 0 or 1")),
        });
    }
    for entity in update.entities {
        let name = name_of(entity.id);
        let mut strips = Vec::new();
        for line in entity.lines {
            let kind = match line.kind {
                0 => Kind::Strip,
                1 => Kind::Loop,
                2 => Kind::List,
                other => return Err(format!("{name:?}: a line of type {other}, expected 0 to 2")),
            };
            let points = line.points.into_iter().map(Xyz::point).collect();
            let found = curves::strips(kind, points, &line.indices, &line.pose.pose());
            strips.extend(found.map_err(|what| format!("{name:?}: {what}"))?);
        }
        let others: [(state::Kind, u64); 7] = [
            (["arrow", "arrows"], entity.arrows),
            (["cube", "cubes"], entity.cubes),
            (["sphere", "spheres"], entity.spheres),
            (CYLINDER, entity.cylinders),
            (
                ["list of triangles", "lists of triangles"],
                entity.triangles,
            ),
            (["text", "texts"], entity.texts),
            (["model", "models"], entity.models),
        ];
        changes.push(Change::Put {
            name,
            namespace: String::new(),
            frame_id: entity.frame_id,
            lifetime: entity.lifetime.nanoseconds(),
            strips,
            others: others.into_iter().filter(|other| other.1 > 0).collect(),
        });
    }
    Ok(Update { stamp, changes })
}

/// Returns the name of an entity. Programs with one entity often leave its id empty.
fn name_of(id: String) -> String {
    match id.is_empty() {
        true => "(without id)".into(),
        false => id,
    }
}

impl Time {
    /// Returns 0 for a time before 1970.
    fn nanoseconds(self) -> u64 {
        let ns = self.seconds.saturating_mul(1_000_000_000);
        u64::try_from(ns.saturating_add(self.nanos)).unwrap_or(0)
    }
}

impl Xyz {
    fn point(self) -> Point {
        [self.x, self.y, self.z]
    }
}

impl LinePose {
    fn pose(self) -> Pose {
        let Quaternion { x, y, z, w } = self.orientation;
        Pose {
            position: self.position.point(),
            rotation: [x, y, z, w],
        }
    }
}

/// Reads a message and appends it.
fn push<M: Message + Default>(to: &mut Vec<M>, value: &Value<'_>) -> Result<(), String> {
    let mut message = M::default();
    merge(&mut message, value.bytes()?)?;
    to.push(message);
    Ok(())
}

impl Message for SceneUpdate {
    fn field(&mut self, number: u64, value: &Value<'_>) -> Result<(), String> {
        match number {
            1 => push(&mut self.deletions, value),
            2 => push(&mut self.entities, value),
            _ => Ok(()),
        }
    }
}

impl Message for Deletion {
    fn field(&mut self, number: u64, value: &Value<'_>) -> Result<(), String> {
        match number {
            2 => self.kind = value.integer()?,
            3 => self.id = value.string()?,
            _ => {}
        }
        Ok(())
    }
}

impl Message for Entity {
    fn field(&mut self, number: u64, value: &Value<'_>) -> Result<(), String> {
        match number {
            1 => merge(&mut self.timestamp, value.bytes()?)?,
            2 => self.frame_id = value.string()?,
            3 => self.id = value.string()?,
            4 => merge(&mut self.lifetime, value.bytes()?)?,
            7 => self.arrows += 1,
            8 => self.cubes += 1,
            9 => self.spheres += 1,
            10 => self.cylinders += 1,
            11 => push(&mut self.lines, value)?,
            12 => self.triangles += 1,
            13 => self.texts += 1,
            14 => self.models += 1,
            _ => {}
        }
        Ok(())
    }
}

impl Message for Line {
    fn field(&mut self, number: u64, value: &Value<'_>) -> Result<(), String> {
        match number {
            1 => self.kind = value.integer()?,
            2 => merge(&mut self.pose, value.bytes()?)?,
            5 => push(&mut self.points, value)?,
            8 => value.fixed32(&mut self.indices)?,
            _ => {}
        }
        Ok(())
    }
}

impl Message for Time {
    fn field(&mut self, number: u64, value: &Value<'_>) -> Result<(), String> {
        match number {
            1 => self.seconds = value.integer()?,
            2 => self.nanos = value.integer()?,
            _ => {}
        }
        Ok(())
    }
}

impl Message for LinePose {
    fn field(&mut self, number: u64, value: &Value<'_>) -> Result<(), String> {
        match number {
            1 => merge(&mut self.position, value.bytes()?),
            2 => merge(&mut self.orientation, value.bytes()?),
            _ => Ok(()),
        }
    }
}

impl Message for Xyz {
    fn field(&mut self, number: u64, value: &Value<'_>) -> Result<(), String> {
        match number {
            1 => self.x = value.double()?,
            2 => self.y = value.double()?,
            3 => self.z = value.double()?,
            _ => {}
        }
        Ok(())
    }
}

impl Message for Quaternion {
    fn field(&mut self, number: u64, value: &Value<'_>) -> Result<(), String> {
        match number {
            1 => self.x = value.double()?,
            2 => self.y = value.double()?,
            3 => self.z = value.double()?,
            4 => self.w = value.double()?,
            _ => {}
        }
        Ok(())
    }
}
