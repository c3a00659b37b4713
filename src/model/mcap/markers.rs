//! `visualization_msgs/msg/Marker` and `MarkerArray` of ROS 2. Source:
//! <https://github.com/ros2/common_interfaces>, `visualization_msgs/msg`.

use super::cdr::Cdr;
use super::curves::{self, Pose};
use super::state::{self, ARROW_STRIP, CYLINDER, Change, Entity, TRIANGLES, UNKNOWN, Update};
use crate::container::foxglove::LineType;
use crate::curve::Point;

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

/// Reads a `MarkerArray`.
pub(super) fn array(message: &[u8], layout: Layout) -> Result<Update, String> {
    read(message, layout, |cdr| cdr.count(1))
}

/// Reads a `Marker`.
pub(super) fn single(message: &[u8], layout: Layout) -> Result<Update, String> {
    read(message, layout, |_| Ok(1))
}

fn read(
    message: &[u8],
    layout: Layout,
    count: impl Fn(&mut Cdr) -> Result<usize, String>,
) -> Result<Update, String> {
    /// Maximum number of bytes that pad a message.
    const PADDING: usize = 3;
    let mut cdr = Cdr::new(message)?;
    let mut update = Update::default();
    for k in 0..count(&mut cdr)? {
        let marker = marker(&mut cdr, layout);
        let (stamp, change) = marker.map_err(|what| format!("marker {k}: {what}"))?;
        update.stamp = update.stamp.max(stamp);
        update.changes.push(change);
    }
    match cdr.left() {
        0..=PADDING => Ok(update),
        left => Err(format!(
            "{left} bytes are left after the last marker, whose fields differ from its schema"
        )),
    }
}

/// Reads a marker, and its time if it has one.
fn marker(cdr: &mut Cdr, layout: Layout) -> Result<(Option<u64>, Change), String> {
    let (stamp, frame_id) = header(cdr)?;
    let namespace = cdr.string()?;
    let id = cdr.i32()?;
    let kind = cdr.i32()?;
    let action = cdr.i32()?;
    let pose = Pose {
        position: cdr.f64s()?,
        rotation: cdr.f64s()?,
    };
    let _scale: [f64; 3] = cdr.f64s()?;
    for _rgba in 0..4 {
        cdr.u32()?;
    }
    let lifetime = time(cdr)?;
    let _frame_locked = cdr.u8()?;
    let points = (0..cdr.count(24)?).map(|_| cdr.f64s());
    let points: Vec<Point> = points.collect::<Result<_, _>>()?;
    // Colours of the points.
    cdr.skip(16)?;
    if layout.texture {
        let _resource = cdr.string()?;
        let _header = header(cdr)?;
        let _format = cdr.string()?;
        // The image, and its coordinates at the points.
        cdr.skip(1)?;
        cdr.skip(8)?;
    }
    let _text = cdr.string()?;
    let _mesh_resource = cdr.string()?;
    if layout.mesh_file {
        let _filename = cdr.string()?;
        // The file.
        cdr.skip(1)?;
    }
    let _mesh_use_embedded_materials = cdr.u8()?;

    let name = match namespace.is_empty() {
        true => id.to_string(),
        false => format!("{namespace}/{id}"),
    };
    let change = match action {
        // Action 1 is deprecated, and was to modify.
        0 | 1 => {
            let strips = match kind {
                LINE_STRIP => curves::strips(LineType::Strip, points, &[], &pose),
                LINE_LIST => curves::strips(LineType::List, points, &[], &pose),
                _ => Ok(Vec::new()),
            };
            let others = match kind {
                LINE_STRIP | LINE_LIST => Vec::new(),
                other => {
                    let known = OTHERS.iter().find(|(number, _)| *number == other);
                    vec![(known.map_or(UNKNOWN, |(_, kind)| *kind), 1)]
                }
            };
            let entity = Entity {
                namespace,
                frame_id,
                lifetime,
                strips: strips.map_err(|what| format!("{name:?}: {what}"))?,
                others,
            };
            Change::Put(name, entity)
        }
        2 => Change::Delete(name),
        3 => Change::DeleteAll((!namespace.is_empty()).then_some(namespace)),
        other => return Err(format!("action {other}, expected 0 to 3")),
    };
    Ok(((stamp > 0).then_some(stamp), change))
}

/// Reads the time and the coordinate system of a message.
fn header(cdr: &mut Cdr) -> Result<(u64, String), String> {
    let (stamp, frame_id) = (time(cdr)?, cdr.string()?);
    // Names with and without a slash were the same in ROS 1.
    let frame_id = frame_id
        .strip_prefix('/')
        .map(str::to_owned)
        .unwrap_or(frame_id);
    Ok((stamp, frame_id))
}

/// Reads a time or a duration, in nanoseconds; 0 if it is negative.
fn time(cdr: &mut Cdr) -> Result<u64, String> {
    let (seconds, nanos) = (cdr.i32()?, cdr.u32()?);
    let seconds = u64::try_from(seconds).unwrap_or(0);
    Ok(seconds * 1_000_000_000 + u64::from(nanos))
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
}
