//! Messages of Foxglove: recordings have them for other tools, and they are read from the files of
//! other programs, in protobuf and in JSON. Source:
//! <https://docs.foxglove.dev/docs/sdk/schemas> and `schemas/foxglove.proto`.
//!
//! In JSON, only the fields that are read are parsed.

use super::protobuf::protobuf;
use prost::Enumeration;
use prost::bytes::Bytes;
use serde::de::IgnoredAny;
use serde::{Deserialize, Deserializer};

protobuf! {
    #[derive(Deserialize)]
    #[serde(default)]
    SceneUpdate {
        1 deletions: Vec<SceneEntityDeletion>, (message, repeated);
        // Added, or replaced if the id exists.
        2 entities: Vec<SceneEntity>, (message, repeated);
    }

    #[derive(Deserialize)]
    #[serde(default)]
    SceneEntityDeletion {
        1 #[serde(skip)] timestamp: Option<Time>, (message, optional);
        // 0: the entity with this id; 1: all entities.
        2 r#type: i32, (int32);
        3 id: String, (string);
    }

    #[derive(Deserialize)]
    #[serde(default)]
    SceneEntity {
        1 timestamp: Option<Time>, (message, optional);
        2 frame_id: String, (string);
        3 id: String, (string);
        // Zero: until it is replaced or deleted.
        4 lifetime: Option<Time>, (message, optional);
        6 #[serde(skip)] metadata: Vec<KeyValuePair>, (message, repeated);
        11 lines: Vec<LinePrimitive>, (message, repeated);
        13 #[serde(deserialize_with = "list")] texts: Vec<TextPrimitive>, (message, repeated);
        7 #[serde(deserialize_with = "list")] arrows: Vec<Ignored>, (message, repeated);
        8 #[serde(deserialize_with = "list")] cubes: Vec<Ignored>, (message, repeated);
        9 #[serde(deserialize_with = "list")] spheres: Vec<Ignored>, (message, repeated);
        10 #[serde(deserialize_with = "list")] cylinders: Vec<Ignored>, (message, repeated);
        12 #[serde(deserialize_with = "list")] triangles: Vec<Ignored>, (message, repeated);
        14 #[serde(deserialize_with = "list")] models: Vec<Ignored>, (message, repeated);
    }

    /// An element that is counted only. A list of them takes no memory.
    #[derive(Deserialize)]
    #[serde(from = "IgnoredAny")]
    Ignored {}

    KeyValuePair {
        1 key: String, (string);
        2 value: String, (string);
    }

    #[derive(Deserialize)]
    #[serde(default)]
    LinePrimitive {
        1 r#type: i32, (int32);
        2 pose: Option<Pose>, (message, optional);
        3 #[serde(skip)] thickness: f64, (double);
        // True if the thickness is in pixels.
        4 #[serde(skip)] scale_invariant: bool, (bool);
        5 points: Vec<Xyz>, (message, repeated);
        6 #[serde(skip)] color: Option<Color>, (message, optional);
        // Points in the order of the line; all points in order if empty.
        8 indices: Vec<u32>, (fixed32, repeated);
    }

    #[derive(Deserialize)]
    #[serde(default)]
    TextPrimitive {
        1 #[serde(skip)] pose: Option<Pose>, (message, optional);
        // True if the text faces the camera.
        2 #[serde(skip)] billboard: bool, (bool);
        3 #[serde(skip)] font_size: f64, (double);
        // True if the font size is in pixels.
        4 #[serde(skip)] scale_invariant: bool, (bool);
        5 #[serde(skip)] color: Option<Color>, (message, optional);
        6 #[serde(skip)] text: String, (string);
    }

    #[derive(Copy, Deserialize)]
    #[serde(default)]
    Pose {
        1 position: Option<Xyz>, (message, optional);
        2 orientation: Option<Quaternion>, (message, optional);
    }

    /// `Vector3` and `Point3`, which have the same fields.
    #[derive(Copy, Deserialize)]
    #[serde(default)]
    Xyz {
        1 x: f64, (double);
        2 y: f64, (double);
        3 z: f64, (double);
    }

    #[derive(Copy, Deserialize)]
    #[serde(default)]
    Quaternion {
        1 x: f64, (double);
        2 y: f64, (double);
        3 z: f64, (double);
        4 w: f64, (double);
    }

    #[derive(Copy)]
    Color {
        1 r: f64, (double);
        2 g: f64, (double);
        3 b: f64, (double);
        4 a: f64, (double);
    }

    PointCloud {
        1 timestamp: Option<Time>, (message, optional);
        2 frame_id: String, (string);
        3 pose: Option<Pose>, (message, optional);
        // Bytes of a point.
        4 point_stride: u32, (fixed32);
        5 fields: Vec<PackedElementField>, (message, repeated);
        6 data: Bytes, (bytes = "bytes");
    }

    PackedElementField {
        1 name: String, (string);
        // First byte of the field in a point.
        2 offset: u32, (fixed32);
        3 r#type: i32, (int32);
    }

    /// A time or a duration: `google.protobuf.Timestamp` and `google.protobuf.Duration`.
    #[derive(Copy, Eq, Hash, Deserialize)]
    #[serde(default)]
    Time {
        1 #[serde(rename = "sec")] seconds: i64, (int64);
        2 #[serde(rename = "nsec")] nanos: i32, (int32);
    }
}

impl From<IgnoredAny> for Ignored {
    fn from(_: IgnoredAny) -> Ignored {
        Ignored {}
    }
}

/// Reads a list that may be null.
fn list<'de, T: Deserialize<'de>, D>(list: D) -> Result<Vec<T>, D::Error>
where
    D: Deserializer<'de>,
{
    Ok(Option::deserialize(list)?.unwrap_or_default())
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Enumeration)]
pub(crate) enum LineType {
    /// 0-1, 1-2, ..., (n-1)-n
    Strip = 0,
    /// 0-1, 1-2, ..., (n-1)-n, n-0
    Loop = 1,
    /// 0-1, 2-3, 4-5, ...
    List = 2,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Enumeration)]
pub(crate) enum NumericType {
    Unknown = 0,
    Uint8 = 1,
    Float32 = 7,
}

impl From<[f64; 3]> for Xyz {
    fn from([x, y, z]: [f64; 3]) -> Xyz {
        Xyz { x, y, z }
    }
}

impl From<Xyz> for [f64; 3] {
    fn from(p: Xyz) -> [f64; 3] {
        [p.x, p.y, p.z]
    }
}

#[cfg(test)]
mod tests {
    use super::super::protobuf::tests::differences;
    use super::*;

    #[test]
    fn the_fields_have_the_names_numbers_and_types_of_the_schema() {
        let schemas = include_bytes!("../../../schemas/foxglove.binpb");
        for (message, fields) in [
            ("SceneUpdate", SceneUpdate::FIELDS),
            ("SceneEntityDeletion", SceneEntityDeletion::FIELDS),
            ("KeyValuePair", KeyValuePair::FIELDS),
            ("TextPrimitive", TextPrimitive::FIELDS),
            ("Pose", Pose::FIELDS),
            ("Vector3", Xyz::FIELDS),
            ("Point3", Xyz::FIELDS),
            ("Quaternion", Quaternion::FIELDS),
            ("Color", Color::FIELDS),
            ("PointCloud", PointCloud::FIELDS),
            ("PackedElementField", PackedElementField::FIELDS),
            ("Timestamp", Time::FIELDS),
            ("Duration", Time::FIELDS),
        ] {
            let only = differences(schemas, message, fields);
            assert!(only.iter().all(Vec::is_empty), "{message}: {only:?}");
        }
        // Neither written nor read.
        let [schema, found] = differences(schemas, "LinePrimitive", LinePrimitive::FIELDS);
        assert_eq!((schema, found), (vec!["colors".into()], vec![]));
        // Only read.
        let [schema, found] = differences(schemas, "SceneEntity", SceneEntity::FIELDS);
        let read = [
            "arrows",
            "cubes",
            "cylinders",
            "models",
            "spheres",
            "triangles",
        ];
        assert_eq!(schema, ["frame_locked"]);
        assert_eq!(found, read);
    }
}
