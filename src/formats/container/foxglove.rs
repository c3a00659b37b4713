//! Messages of Foxglove, which are read from the files of other programs, in protobuf and in JSON:
//! the fields that are read. Source: <https://docs.foxglove.dev/docs/sdk/schemas>.

use prost::Enumeration;
use serde::de::IgnoredAny;
use serde::{Deserialize, Deserializer};

/// Defines structs of messages: the number, the name, the type and the kind of each field.
macro_rules! protobuf {
    ($($(#[$about:meta])* $name:ident {
        $($tag:tt $(#[$about_field:meta])* $field:ident: $type:ty, ($($kind:tt)*);)*
    })*) => {$(
        #[derive(Clone, PartialEq, Deserialize, ::prost::Message)]
        #[serde(default)]
        $(#[$about])*
        pub(crate) struct $name {
            $($(#[$about_field])* #[prost($($kind)*, tag = $tag)] pub $field: $type,)*
        }
    )*};
}

protobuf! {
    SceneUpdate {
        1 deletions: Vec<SceneEntityDeletion>, (message, repeated);
        // Added, or replaced if the id exists.
        2 entities: Vec<SceneEntity>, (message, repeated);
    }

    SceneEntityDeletion {
        // 0: the entity with this id; 1: all entities.
        2 r#type: i32, (int32);
        3 id: String, (string);
    }

    SceneEntity {
        1 timestamp: Option<Time>, (message, optional);
        2 frame_id: String, (string);
        3 id: String, (string);
        // Zero: until it is replaced or deleted.
        4 lifetime: Option<Time>, (message, optional);
        11 lines: Vec<LinePrimitive>, (message, repeated);
        13 #[serde(deserialize_with = "list")] texts: Vec<Ignored>, (message, repeated);
        7 #[serde(deserialize_with = "list")] arrows: Vec<Ignored>, (message, repeated);
        8 #[serde(deserialize_with = "list")] cubes: Vec<Ignored>, (message, repeated);
        9 #[serde(deserialize_with = "list")] spheres: Vec<Ignored>, (message, repeated);
        10 #[serde(deserialize_with = "list")] cylinders: Vec<Ignored>, (message, repeated);
        12 #[serde(deserialize_with = "list")] triangles: Vec<Ignored>, (message, repeated);
        14 #[serde(deserialize_with = "list")] models: Vec<Ignored>, (message, repeated);
    }

    /// An element that is counted only. A list of them takes no memory.
    #[serde(from = "IgnoredAny")]
    Ignored {}

    LinePrimitive {
        1 r#type: i32, (int32);
        2 pose: Option<Pose>, (message, optional);
        5 points: Vec<Xyz>, (message, repeated);
        // Points in the order of the line; all points in order if empty.
        8 indices: Vec<u32>, (fixed32, repeated);
    }

    #[derive(Copy)]
    Pose {
        1 position: Option<Xyz>, (message, optional);
        2 orientation: Option<Quaternion>, (message, optional);
    }

    /// `Vector3` and `Point3`, which have the same fields.
    #[derive(Copy)]
    Xyz {
        1 x: f64, (double);
        2 y: f64, (double);
        3 z: f64, (double);
    }

    #[derive(Copy)]
    Quaternion {
        1 x: f64, (double);
        2 y: f64, (double);
        3 z: f64, (double);
        4 w: f64, (double);
    }

    /// A time or a duration: `google.protobuf.Timestamp` and `google.protobuf.Duration`.
    #[derive(Copy, Eq, Hash)]
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

impl From<Xyz> for [f64; 3] {
    fn from(p: Xyz) -> [f64; 3] {
        [p.x, p.y, p.z]
    }
}
