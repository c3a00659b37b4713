//! Messages of Foxglove: recordings have them for other tools, and they are read from the files of
//! other programs, in protobuf and in JSON. Source:
//! <https://docs.foxglove.dev/docs/sdk/schemas> and `schemas/foxglove.proto`.
//!
//! In JSON, only the fields that are read are parsed.

use prost::bytes::Bytes;
use prost::{Enumeration, Message};
use serde::de::IgnoredAny;
use serde::{Deserialize, Deserializer};

#[derive(Clone, PartialEq, Message, Deserialize)]
#[serde(default)]
pub(crate) struct SceneUpdate {
    #[prost(message, repeated, tag = "1")]
    pub deletions: Vec<SceneEntityDeletion>,
    /// Added, or replaced if the id exists.
    #[prost(message, repeated, tag = "2")]
    pub entities: Vec<SceneEntity>,
}

#[derive(Clone, PartialEq, Message, Deserialize)]
#[serde(default)]
pub(crate) struct SceneEntityDeletion {
    #[serde(skip)]
    #[prost(message, optional, tag = "1")]
    pub timestamp: Option<Time>,
    /// 0: the entity with this id; 1: all entities.
    #[serde(rename = "type")]
    #[prost(int32, tag = "2")]
    pub kind: i32,
    #[prost(string, tag = "3")]
    pub id: String,
}

#[derive(Clone, PartialEq, Message, Deserialize)]
#[serde(default)]
pub(crate) struct SceneEntity {
    #[prost(message, optional, tag = "1")]
    pub timestamp: Option<Time>,
    #[prost(string, tag = "2")]
    pub frame_id: String,
    #[prost(string, tag = "3")]
    pub id: String,
    /// Zero: until it is replaced or deleted.
    #[prost(message, optional, tag = "4")]
    pub lifetime: Option<Time>,
    #[serde(skip)]
    #[prost(message, repeated, tag = "6")]
    pub metadata: Vec<KeyValuePair>,
    #[prost(message, repeated, tag = "11")]
    pub lines: Vec<LinePrimitive>,
    #[serde(deserialize_with = "list_or_null")]
    #[prost(message, repeated, tag = "13")]
    pub texts: Vec<TextPrimitive>,
    #[serde(deserialize_with = "list_or_null")]
    #[prost(message, repeated, tag = "7")]
    pub arrows: Vec<Ignored>,
    #[serde(deserialize_with = "list_or_null")]
    #[prost(message, repeated, tag = "8")]
    pub cubes: Vec<Ignored>,
    #[serde(deserialize_with = "list_or_null")]
    #[prost(message, repeated, tag = "9")]
    pub spheres: Vec<Ignored>,
    #[serde(deserialize_with = "list_or_null")]
    #[prost(message, repeated, tag = "10")]
    pub cylinders: Vec<Ignored>,
    #[serde(deserialize_with = "list_or_null")]
    #[prost(message, repeated, tag = "12")]
    pub triangles: Vec<Ignored>,
    #[serde(deserialize_with = "list_or_null")]
    #[prost(message, repeated, tag = "14")]
    pub models: Vec<Ignored>,
}

/// An element that is counted only. A list of them takes no memory.
#[derive(Clone, PartialEq, Message, Deserialize)]
#[serde(from = "IgnoredAny")]
pub(crate) struct Ignored {}

impl From<IgnoredAny> for Ignored {
    fn from(_: IgnoredAny) -> Ignored {
        Ignored {}
    }
}

fn list_or_null<'de, T: Deserialize<'de>, D>(list: D) -> Result<Vec<T>, D::Error>
where
    D: Deserializer<'de>,
{
    Ok(Option::deserialize(list)?.unwrap_or_default())
}

#[derive(Clone, PartialEq, Message)]
pub(crate) struct KeyValuePair {
    #[prost(string, tag = "1")]
    pub key: String,
    #[prost(string, tag = "2")]
    pub value: String,
}

#[derive(Clone, PartialEq, Message, Deserialize)]
#[serde(default)]
pub(crate) struct LinePrimitive {
    #[serde(rename = "type")]
    #[prost(enumeration = "LineType", tag = "1")]
    pub kind: i32,
    #[prost(message, optional, tag = "2")]
    pub pose: Option<Pose>,
    #[serde(skip)]
    #[prost(double, tag = "3")]
    pub thickness: f64,
    /// True if the thickness is in pixels.
    #[serde(skip)]
    #[prost(bool, tag = "4")]
    pub scale_invariant: bool,
    #[prost(message, repeated, tag = "5")]
    pub points: Vec<Xyz>,
    #[serde(skip)]
    #[prost(message, optional, tag = "6")]
    pub color: Option<Color>,
    /// Points in the order of the line; all points in order if empty.
    #[prost(fixed32, repeated, tag = "8")]
    pub indices: Vec<u32>,
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

#[derive(Clone, PartialEq, Message, Deserialize)]
#[serde(default)]
pub(crate) struct TextPrimitive {
    #[serde(skip)]
    #[prost(message, optional, tag = "1")]
    pub pose: Option<Pose>,
    /// True if the text faces the camera.
    #[serde(skip)]
    #[prost(bool, tag = "2")]
    pub billboard: bool,
    #[serde(skip)]
    #[prost(double, tag = "3")]
    pub font_size: f64,
    /// True if the font size is in pixels.
    #[serde(skip)]
    #[prost(bool, tag = "4")]
    pub scale_invariant: bool,
    #[serde(skip)]
    #[prost(message, optional, tag = "5")]
    pub color: Option<Color>,
    #[serde(skip)]
    #[prost(string, tag = "6")]
    pub text: String,
}

#[derive(Clone, Copy, PartialEq, Message, Deserialize)]
#[serde(default)]
pub(crate) struct Pose {
    #[prost(message, optional, tag = "1")]
    pub position: Option<Xyz>,
    #[prost(message, optional, tag = "2")]
    pub orientation: Option<Quaternion>,
}

/// `Vector3` and `Point3`, which have the same fields.
#[derive(Clone, Copy, PartialEq, Message, Deserialize)]
#[serde(default)]
pub(crate) struct Xyz {
    #[prost(double, tag = "1")]
    pub x: f64,
    #[prost(double, tag = "2")]
    pub y: f64,
    #[prost(double, tag = "3")]
    pub z: f64,
}

#[derive(Clone, Copy, PartialEq, Message, Deserialize)]
#[serde(default)]
pub(crate) struct Quaternion {
    #[prost(double, tag = "1")]
    pub x: f64,
    #[prost(double, tag = "2")]
    pub y: f64,
    #[prost(double, tag = "3")]
    pub z: f64,
    #[prost(double, tag = "4")]
    pub w: f64,
}

#[derive(Clone, Copy, PartialEq, Message)]
pub(crate) struct Color {
    #[prost(double, tag = "1")]
    pub r: f64,
    #[prost(double, tag = "2")]
    pub g: f64,
    #[prost(double, tag = "3")]
    pub b: f64,
    #[prost(double, tag = "4")]
    pub a: f64,
}

#[derive(Clone, PartialEq, Message)]
pub(crate) struct PointCloud {
    #[prost(message, optional, tag = "1")]
    pub timestamp: Option<Time>,
    #[prost(string, tag = "2")]
    pub frame_id: String,
    #[prost(message, optional, tag = "3")]
    pub pose: Option<Pose>,
    /// Bytes of a point.
    #[prost(fixed32, tag = "4")]
    pub point_stride: u32,
    #[prost(message, repeated, tag = "5")]
    pub fields: Vec<PackedElementField>,
    #[prost(bytes = "bytes", tag = "6")]
    pub data: Bytes,
}

#[derive(Clone, PartialEq, Message)]
pub(crate) struct PackedElementField {
    #[prost(string, tag = "1")]
    pub name: String,
    /// First byte of the field in a point.
    #[prost(fixed32, tag = "2")]
    pub offset: u32,
    #[prost(enumeration = "NumericType", tag = "3")]
    pub kind: i32,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Enumeration)]
pub(crate) enum NumericType {
    Unknown = 0,
    Uint8 = 1,
    Float32 = 7,
}

/// A time or a duration: `google.protobuf.Timestamp` and `google.protobuf.Duration`.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Message, Deserialize)]
#[serde(default)]
pub(crate) struct Time {
    #[serde(rename = "sec")]
    #[prost(int64, tag = "1")]
    pub seconds: i64,
    #[serde(rename = "nsec")]
    #[prost(int32, tag = "2")]
    pub nanos: i32,
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
    use super::*;
    use std::collections::{BTreeMap, BTreeSet};

    /// A part of `google.protobuf.FileDescriptorSet`.
    #[derive(PartialEq, Message)]
    struct Files {
        #[prost(message, repeated, tag = "1")]
        file: Vec<File>,
    }

    #[derive(PartialEq, Message)]
    struct File {
        #[prost(message, repeated, tag = "4")]
        message_type: Vec<Type>,
    }

    #[derive(PartialEq, Message)]
    struct Type {
        #[prost(string, tag = "1")]
        name: String,
        #[prost(message, repeated, tag = "2")]
        field: Vec<Field>,
    }

    #[derive(PartialEq, Message)]
    struct Field {
        #[prost(int32, tag = "3")]
        number: i32,
        #[prost(int32, tag = "4")]
        label: i32,
        #[prost(int32, tag = "5")]
        kind: i32,
    }

    /// Returns the number and the wire type of each field in an encoded message.
    fn fields(mut bytes: &[u8]) -> BTreeSet<(u32, u8)> {
        let mut found = BTreeSet::new();
        while !bytes.is_empty() {
            let (number, kind) = prost::encoding::decode_key(&mut bytes).unwrap();
            found.insert((number, kind as u8));
            let context = Default::default();
            prost::encoding::skip_field(kind, number, &mut bytes, context).unwrap();
        }
        found
    }

    #[test]
    fn the_fields_that_are_written_have_the_numbers_and_types_of_the_schema() {
        let files = Files::decode(&include_bytes!("../../schemas/foxglove.binpb")[..]).unwrap();
        let messages = files.file.iter().flat_map(|f| &f.message_type);
        let wire = |f: &Field| match (f.kind, f.label) {
            // Packed numbers, strings, messages and bytes.
            (_, 3) | (9 | 11 | 12, _) => 2,
            (1, _) => 1,
            (7, _) => 5,
            _ => 0,
        };
        let numbers = |m: &Type| m.field.iter().map(|f| (f.number as u32, wire(f))).collect();
        let schema: BTreeMap<&str, BTreeSet<(u32, u8)>> =
            messages.map(|m| (m.name.as_str(), numbers(m))).collect();
        let (time, xyz) = (
            Time {
                seconds: 1,
                nanos: 1,
            },
            Xyz {
                x: 1.0,
                y: 1.0,
                z: 1.0,
            },
        );
        let turn = Quaternion {
            x: 1.0,
            y: 1.0,
            z: 1.0,
            w: 1.0,
        };
        let color = Color {
            r: 1.0,
            g: 1.0,
            b: 1.0,
            a: 1.0,
        };
        let pose = Pose {
            position: Some(xyz),
            orientation: Some(turn),
        };
        let text = || "a".to_owned();
        let pair = KeyValuePair {
            key: text(),
            value: text(),
        };
        let line = LinePrimitive {
            kind: 1,
            pose: Some(pose),
            thickness: 1.0,
            scale_invariant: true,
            points: vec![xyz],
            color: Some(color),
            indices: vec![1],
        };
        let label = TextPrimitive {
            pose: Some(pose),
            billboard: true,
            font_size: 1.0,
            scale_invariant: true,
            color: Some(color),
            text: text(),
        };
        let deletion = SceneEntityDeletion {
            timestamp: Some(time),
            kind: 1,
            id: text(),
        };
        let entity = SceneEntity {
            timestamp: Some(time),
            frame_id: text(),
            id: text(),
            lifetime: Some(time),
            metadata: vec![pair.clone()],
            lines: vec![line.clone()],
            texts: vec![label.clone()],
            ..SceneEntity::default()
        };
        let field = PackedElementField {
            name: text(),
            offset: 1,
            kind: 1,
        };
        let cloud = PointCloud {
            timestamp: Some(time),
            frame_id: text(),
            pose: Some(pose),
            point_stride: 1,
            fields: vec![field.clone()],
            data: Bytes::from_static(b"a"),
        };
        // `frame_locked`, and `colors`, are not written.
        let unused = |name: &str| match name {
            "SceneEntity" => vec![(5, 0)],
            "LinePrimitive" => vec![(7, 2)],
            _ => Vec::new(),
        };
        for (name, bytes) in [
            ("Timestamp", time.encode_to_vec()),
            ("Duration", time.encode_to_vec()),
            ("Vector3", xyz.encode_to_vec()),
            ("Point3", xyz.encode_to_vec()),
            ("Quaternion", turn.encode_to_vec()),
            ("Color", color.encode_to_vec()),
            ("Pose", pose.encode_to_vec()),
            ("KeyValuePair", pair.encode_to_vec()),
            ("LinePrimitive", line.encode_to_vec()),
            ("TextPrimitive", label.encode_to_vec()),
            ("SceneEntityDeletion", deletion.encode_to_vec()),
            ("SceneEntity", entity.encode_to_vec()),
            ("PackedElementField", field.encode_to_vec()),
            ("PointCloud", cloud.encode_to_vec()),
        ] {
            let mut found = fields(&bytes);
            found.extend(unused(name));
            assert_eq!(found, schema[name], "{name}");
        }
        let update = SceneUpdate {
            deletions: vec![deletion],
            entities: vec![entity],
        };
        assert_eq!(fields(&update.encode_to_vec()), schema["SceneUpdate"]);
    }
}
