//! `foxglove.SceneUpdate`, in protobuf and JSON. Source:
//! <https://docs.foxglove.dev/docs/sdk/schemas> and `schemas/foxglove.proto`.

use super::curves::{self, Kind, Pose};
use super::state::{self, CYLINDER, Change, Update};
use crate::curve::Point;
use prost::Message;
use serde::de::IgnoredAny;
use serde::{Deserialize, Deserializer};

#[derive(Deserialize, Message)]
#[serde(default)]
struct SceneUpdate {
    #[prost(message, repeated, tag = "1")]
    deletions: Vec<Deletion>,
    #[prost(message, repeated, tag = "2")]
    entities: Vec<Entity>,
}

#[derive(Deserialize, Message)]
#[serde(default)]
struct Deletion {
    #[prost(int32, tag = "2")]
    #[serde(rename = "type")]
    kind: i32,
    #[prost(string, tag = "3")]
    id: String,
}

/// An entity. Elements that are no lines are counted without their content.
#[derive(Deserialize, Message)]
#[serde(default)]
struct Entity {
    #[prost(message, optional, tag = "1")]
    timestamp: Option<Time>,
    #[prost(string, tag = "2")]
    frame_id: String,
    #[prost(string, tag = "3")]
    id: String,
    #[prost(message, optional, tag = "4")]
    lifetime: Option<Time>,
    #[prost(message, repeated, tag = "7")]
    #[serde(deserialize_with = "count")]
    arrows: Vec<()>,
    #[prost(message, repeated, tag = "8")]
    #[serde(deserialize_with = "count")]
    cubes: Vec<()>,
    #[prost(message, repeated, tag = "9")]
    #[serde(deserialize_with = "count")]
    spheres: Vec<()>,
    #[prost(message, repeated, tag = "10")]
    #[serde(deserialize_with = "count")]
    cylinders: Vec<()>,
    #[prost(message, repeated, tag = "11")]
    lines: Vec<Line>,
    #[prost(message, repeated, tag = "12")]
    #[serde(deserialize_with = "count")]
    triangles: Vec<()>,
    #[prost(message, repeated, tag = "13")]
    #[serde(deserialize_with = "count")]
    texts: Vec<()>,
    #[prost(message, repeated, tag = "14")]
    #[serde(deserialize_with = "count")]
    models: Vec<()>,
}

/// Returns the elements of a list without their content.
fn count<'de, D: Deserializer<'de>>(list: D) -> Result<Vec<()>, D::Error> {
    let list = Option::<Vec<IgnoredAny>>::deserialize(list)?;
    Ok(vec![(); list.map_or(0, |list| list.len())])
}

#[derive(Deserialize, Message)]
#[serde(default)]
struct Line {
    #[prost(int32, tag = "1")]
    #[serde(rename = "type")]
    kind: i32,
    #[prost(message, optional, tag = "2")]
    pose: Option<LinePose>,
    #[prost(message, repeated, tag = "5")]
    points: Vec<Xyz>,
    #[prost(fixed32, repeated, tag = "8")]
    indices: Vec<u32>,
}

#[derive(Clone, Copy, Deserialize, Message)]
#[serde(default)]
struct Time {
    #[prost(int64, tag = "1")]
    #[serde(rename = "sec")]
    seconds: i64,
    #[prost(int64, tag = "2")]
    #[serde(rename = "nsec")]
    nanos: i64,
}

#[derive(Clone, Copy, Deserialize, Message)]
#[serde(default)]
struct LinePose {
    #[prost(message, optional, tag = "1")]
    position: Option<Xyz>,
    #[prost(message, optional, tag = "2")]
    orientation: Option<Quaternion>,
}

#[derive(Clone, Copy, Deserialize, Message)]
#[serde(default)]
struct Xyz {
    #[prost(double, tag = "1")]
    x: f64,
    #[prost(double, tag = "2")]
    y: f64,
    #[prost(double, tag = "3")]
    z: f64,
}

#[derive(Clone, Copy, Deserialize, Message)]
#[serde(default)]
struct Quaternion {
    #[prost(double, tag = "1")]
    x: f64,
    #[prost(double, tag = "2")]
    y: f64,
    #[prost(double, tag = "3")]
    z: f64,
    #[prost(double, tag = "4")]
    w: f64,
}

/// Reads a message in protobuf.
pub(super) fn protobuf(message: &[u8]) -> Result<Update, String> {
    changes(SceneUpdate::decode(message).map_err(|e| e.to_string())?)
}

/// Reads a message in JSON.
pub(super) fn json(message: &[u8]) -> Result<Update, String> {
    let update = serde_json::from_slice(message);
    changes(update.map_err(|e| format!("not a scene update in JSON: {e}"))?)
}

fn changes(update: SceneUpdate) -> Result<Update, String> {
    let stamps = update.entities.iter().filter_map(|e| e.timestamp);
    let stamp = stamps.map(Time::nanoseconds).max().filter(|&ns| ns > 0);
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
            let found = curves::strips(
                kind,
                points,
                &line.indices,
                &line.pose.unwrap_or_default().pose(),
            );
            strips.extend(found.map_err(|what| format!("{name:?}: {what}"))?);
        }
        let others: [(state::Kind, Vec<()>); 7] = [
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
            lifetime: entity.lifetime.map_or(0, Time::nanoseconds),
            strips,
            others: (others.into_iter())
                .filter(|(_, found)| !found.is_empty())
                .map(|(kind, found)| (kind, found.len() as u64))
                .collect(),
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
        let Quaternion { x, y, z, w } = self.orientation.unwrap_or_default();
        Pose {
            position: self.position.unwrap_or_default().point(),
            rotation: [x, y, z, w],
        }
    }
}
