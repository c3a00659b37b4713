//! `visualization_msgs/msg/Marker` and `MarkerArray` of ROS 2. Source:
//! <https://github.com/ros2/common_interfaces>, `visualization_msgs/msg`.

use super::curves::{self, Pose};
use super::state::{self, ARROW_STRIP, CYLINDER, Change, Entity, TRIANGLES, UNKNOWN, Update};
use crate::curve::Point;
use crate::formats::container::foxglove::LineType;
use serde::Deserialize;

/// Types of markers with lines.
const LINE_STRIP: i32 = 4;
const LINE_LIST: i32 = 5;

/// Names of the other types.
const OTHERS: [(i32, state::Kind); 11] = [
    (0, ["arrow", "arrows"]),
    (1, ["cube", "cubes"]),
    (2, ["sphere", "spheres"]),
    (3, CYLINDER),
    (6, ["list of cubes", "lists of cubes"]),
    (7, ["list of spheres", "lists of spheres"]),
    (8, ["list of points", "lists of points"]),
    (9, ["text", "texts"]),
    (10, ["mesh", "meshes"]),
    (11, TRIANGLES),
    (12, ARROW_STRIP),
];

/// Fields of a marker that not all versions of ROS 2 have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Layout {
    /// Since Humble: `texture_resource`, `texture`, `uv_coordinates`.
    texture: bool,
    /// Since Humble: `mesh_file`.
    mesh_file: bool,
}

impl Layout {
    /// Finds the fields in the text of a schema.
    pub fn of(schema: &[u8]) -> Layout {
        let has = |kind: &str, name: &str| {
            let lines = schema.split(|&b| b == b'\n');
            let mut words = lines.map(|line| {
                let words = line.split(|b| b.is_ascii_whitespace() || *b == b';');
                words.filter(|w| !w.is_empty())
            });
            words.any(|mut words| {
                let is_kind = words.next().is_some_and(|w| w.ends_with(kind.as_bytes()));
                is_kind && words.next() == Some(name.as_bytes())
            })
        };
        Layout {
            texture: has("string", "texture_resource"),
            mesh_file: has("MeshFile", "mesh_file"),
        }
    }
}

#[derive(Deserialize)]
struct Header<'a> {
    seconds: i32,
    nanos: u32,
    frame_id: &'a str,
}

/// A marker. `T` is [`Texture`], and `M` is [`MeshFile`], or nothing in older versions.
#[derive(Deserialize)]
struct Marker<'a, T, M> {
    #[serde(borrow)]
    header: Header<'a>,
    namespace: &'a str,
    id: i32,
    kind: i32,
    action: i32,
    position: Point,
    rotation: [f64; 4],
    _scale: [f64; 3],
    _rgba: [f32; 4],
    lifetime: (i32, u32),
    _frame_locked: u8,
    points: Vec<Point>,
    _colors: Vec<[f32; 4]>,
    _texture: T,
    _text: &'a str,
    _mesh_resource: &'a str,
    _mesh_file: M,
    _mesh_use_embedded_materials: u8,
}

/// Resource, header, format and content of the image, and coordinates.
type Texture<'a> = (&'a str, Header<'a>, &'a str, &'a [u8], Vec<[f32; 2]>);

/// Name and content.
type MeshFile<'a> = (&'a str, &'a [u8]);

/// Reads a `MarkerArray`, or a `Marker`.
pub(super) fn read(message: &[u8], layout: Layout, is_array: bool) -> Result<Update, String> {
    match (layout.texture, layout.mesh_file) {
        (false, false) => update::<(), ()>(message, is_array),
        (false, true) => update::<(), MeshFile>(message, is_array),
        (true, false) => update::<Texture, ()>(message, is_array),
        (true, true) => update::<Texture, MeshFile>(message, is_array),
    }
}

fn update<'a, T, M>(message: &'a [u8], is_array: bool) -> Result<Update, String>
where
    T: Deserialize<'a>,
    M: Deserialize<'a>,
{
    let markers: Vec<Marker<'a, T, M>> = match is_array {
        true => decode(message)?,
        false => vec![decode(message)?],
    };
    let mut update = Update::default();
    for (k, marker) in markers.into_iter().enumerate() {
        let stamp = nanoseconds(marker.header.seconds, marker.header.nanos);
        update.stamp = update.stamp.max((stamp > 0).then_some(stamp));
        let change = change(marker).map_err(|what| format!("marker {k}: {what}"))?;
        update.changes.push(change);
    }
    Ok(update)
}

/// Reads a message: CDR, little-endian (XCDR version 1). Source: OMG *DDS-XTypes* 1.3, section 7.4.
fn decode<'a, M: Deserialize<'a>>(message: &'a [u8]) -> Result<M, String> {
    /// Maximum number of bytes that pad a message.
    const PADDING: usize = 3;
    let bytes = match message {
        [0, 1, _, _, bytes @ ..] => bytes,
        [0, 0, ..] => return Err("big-endian CDR; only little-endian is read".into()),
        [a, b, ..] => {
            return Err(format!(
                "CDR of the kind {a:02x} {b:02x}; only 00 01 (plain, little-endian) is read"
            ));
        }
        _ => return Err("a message without the header of CDR".into()),
    };
    let decoded = re_cdr::from_bytes::<M, re_cdr::LittleEndian>(bytes);
    let (message, used) = decoded.map_err(|e| format!("not a message of its schema: {e}"))?;
    match bytes.len() - used {
        0..=PADDING => Ok(message),
        left => Err(format!(
            "{left} bytes are left after the last marker, whose fields differ from its schema"
        )),
    }
}

fn change<T, M>(marker: Marker<'_, T, M>) -> Result<Change, String> {
    let (id, namespace) = (marker.id, marker.namespace);
    let name = match namespace.is_empty() {
        true => id.to_string(),
        false => format!("{namespace}/{id}"),
    };
    let line = match marker.kind {
        LINE_STRIP => Some(LineType::Strip),
        LINE_LIST => Some(LineType::List),
        _ => None,
    };
    match marker.action {
        // Action 1 is deprecated, and was to modify.
        0 | 1 => {
            let (mut strips, mut others) = (Vec::new(), Vec::new());
            if let Some(line) = line {
                let (position, rotation) = (marker.position, marker.rotation);
                let pose = Pose { position, rotation };
                let found = curves::strips(line, marker.points, &[], &pose);
                strips = found.map_err(|what| format!("{name:?}: {what}"))?;
            } else {
                let known = OTHERS.iter().find(|(number, _)| *number == marker.kind);
                others.push((known.map_or(UNKNOWN, |(_, kind)| *kind), 1));
            }
            // Names with and without a slash were the same in ROS 1.
            let frame_id = marker.header.frame_id;
            let entity = Entity {
                namespace: namespace.into(),
                frame_id: frame_id.strip_prefix('/').unwrap_or(frame_id).into(),
                lifetime: nanoseconds(marker.lifetime.0, marker.lifetime.1),
                strips,
                others,
            };
            Ok(Change::Put(name, entity))
        }
        2 => Ok(Change::Delete(name)),
        3 => {
            let namespace = Some(namespace).filter(|n| !n.is_empty());
            Ok(Change::DeleteAll(namespace.map(str::to_owned)))
        }
        other => Err(format!("action {other}, expected 0 to 3")),
    }
}

/// Returns a time or a duration; 0 if it is negative.
fn nanoseconds(seconds: i32, nanos: u32) -> u64 {
    u64::try_from(seconds).unwrap_or(0) * 1_000_000_000 + u64::from(nanos)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finds_the_fields_of_versions_in_a_schema() {
        let of = |text: &str| {
            let layout = Layout::of(text.as_bytes());
            (layout.texture, layout.mesh_file)
        };
        assert_eq!(
            of("string text\n# string texture_resource\n"),
            (false, false)
        );
        assert_eq!(
            of("  string texture_resource\nMeshFile mesh_file\n"),
            (true, true)
        );
        let idl = "string texture_resource;\nvisualization_msgs::msg::MeshFile mesh_file;\n";
        assert_eq!(of(idl), (true, true));
    }

    #[test]
    fn names_other_kinds_of_cdr() {
        let fails = |message: &[u8]| decode::<u32>(message).unwrap_err();
        assert!(fails(&[0, 0, 0, 0, 1]).contains("big-endian"));
        assert!(fails(&[0, 9, 0, 0, 1]).contains("00 09"));
        assert!(fails(&[0, 1]).contains("00 01"));
        assert!(fails(&[]).contains("without the header"));
        assert!(fails(&[0, 1, 0, 0, 1]).contains("end of input"));
    }
}
