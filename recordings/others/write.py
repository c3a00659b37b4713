"""Writes the recordings of other programs in this folder, with the packages of their authors.

    pip install mcap mcap-protobuf-support mcap-ros2-support foxglove-schemas-protobuf
    python recordings/others/write.py

All of them have the same motion at 10 frames a second: two linked rings, one of which is moved out
of the other one in frame 3, and the strand `rope`, which is removed in frame 2.
"""

import json
import math
import pathlib

from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.Point3_pb2 import Point3
from foxglove_schemas_protobuf.SceneEntityDeletion_pb2 import SceneEntityDeletion
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf.json_format import MessageToDict
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from mcap_protobuf.writer import Writer as ProtobufWriter
from mcap_ros2.writer import Writer as Ros2Writer

FOLDER = pathlib.Path(__file__).parent
FRAMES = 5
POINTS = 12
TENTH = 100_000_000
SECOND = 1_000_000_000

# The rotation from the plane of x and y to that of x and z.
TURN = (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))


def ring():
    """Returns a ring around the origin in the plane of x and y."""
    angles = [2 * math.pi * k / POINTS for k in range(POINTS)]
    return [(math.cos(a), math.sin(a), 0.0) for a in angles]


def place(frame):
    """Returns the centre of the second ring, which is turned."""
    return (1.0 if frame < 3 else 4.0, 0.0, 0.0)


def rope(frame):
    return [(0.5 * k, 3.0 + 0.1 * frame, 0.0) for k in range(4)]


def set_time(field, ns):
    field.seconds, field.nanos = ns // SECOND, ns % SECOND


def scene(frame):
    """Returns the update of a frame."""
    now = frame * TENTH
    update = SceneUpdate()

    def add(name, kind, points):
        entity = update.entities.add(id=name, frame_id="world")
        set_time(entity.timestamp, SECOND + now)
        line = entity.lines.add(type=kind, thickness=2, scale_invariant=True)
        line.points.extend(Point3(x=x, y=y, z=z) for x, y, z in points)
        line.pose.orientation.w = 1
        return entity, line

    if frame == 2:
        update.deletions.add(type=SceneEntityDeletion.MATCHING_ID, id="rope")
    add("ring", LinePrimitive.LINE_LOOP, ring())
    # A closed strip, with a pose of its own.
    _, line = add("turned", LinePrimitive.LINE_STRIP, ring() + ring()[:1])
    line.pose.position.x = place(frame)[0]
    pose = line.pose.orientation
    pose.x, pose.y, pose.z, pose.w = TURN
    if frame < 2:
        _, line = add("rope", LinePrimitive.LINE_LIST, rope(frame))
        line.indices.extend([0, 1, 2, 3, 1, 2])
    if frame == 0:
        # Gone in frame 1, because its lifetime is over.
        entity, _ = add("spark", LinePrimitive.LINE_STRIP, [(0, 0, 5), (0, 0, 6)])
        set_time(entity.lifetime, TENTH // 2)
    note = update.entities.add(id="note", frame_id="world")
    note.texts.add(text=f"frame {frame}")
    return update


def write_scene():
    """`foxglove.SceneUpdate` in protobuf, and a topic of another type; compressed by Zstandard."""
    with open(FOLDER / "scene.mcap", "wb") as file:
        writer = ProtobufWriter(file, compression=CompressionType.ZSTD)
        for frame in range(FRAMES):
            time = 1_700_000_000 * SECOND + frame * TENTH
            writer.write_message("/scene", scene(frame), log_time=time)
            writer.write_message("/origin", Point3(), log_time=time)
        writer.finish()


def write_json():
    """`foxglove.SceneUpdate` in JSON, not compressed."""

    def seconds(time):
        return {"sec": time.seconds, "nsec": time.nanos}

    with open(FOLDER / "json.mcap", "wb") as file:
        writer = McapWriter(file, compression=CompressionType.NONE)
        writer.start()
        schema = writer.register_schema("foxglove.SceneUpdate", "jsonschema", b"{}")
        channel = writer.register_channel("/scene", "json", schema)
        for frame in range(FRAMES):
            update = scene(frame)
            message = MessageToDict(
                update, preserving_proto_field_name=True, use_integers_for_enums=True
            )
            for entity, was in zip(message["entities"], update.entities):
                entity["timestamp"] = seconds(was.timestamp)
                entity["lifetime"] = seconds(was.lifetime)
            time = 1_700_000_000 * SECOND + frame * TENTH
            writer.add_message(channel, time, json.dumps(message).encode(), time)
        writer.finish()


HEADER = """
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
================================================================================
MSG: builtin_interfaces/Duration
int32 sec
uint32 nanosec
================================================================================
MSG: geometry_msgs/Pose
Point position
Quaternion orientation
================================================================================
MSG: geometry_msgs/Point
float64 x
float64 y
float64 z
================================================================================
MSG: geometry_msgs/Quaternion
float64 x 0
float64 y 0
float64 z 0
float64 w 1
================================================================================
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
================================================================================
MSG: std_msgs/ColorRGBA
float32 r
float32 g
float32 b
float32 a
"""

MARKER = """
int32 LINE_STRIP=4
std_msgs/Header header
string ns
int32 id
int32 type
int32 action
geometry_msgs/Pose pose
geometry_msgs/Vector3 scale
std_msgs/ColorRGBA color
builtin_interfaces/Duration lifetime
bool frame_locked
geometry_msgs/Point[] points
std_msgs/ColorRGBA[] colors
"""

# Since ROS 2 Humble.
TEXTURE = """
# Texture resource is a special URI.
string texture_resource
sensor_msgs/CompressedImage texture
UVCoordinate[] uv_coordinates
"""

TEXT = """
string text
string mesh_resource
"""

MESH_FILE = """
MeshFile mesh_file
"""

END = """
bool mesh_use_embedded_materials
"""

TEXTURE_TYPES = """
================================================================================
MSG: sensor_msgs/CompressedImage
std_msgs/Header header
string format
uint8[] data
================================================================================
MSG: visualization_msgs/UVCoordinate
float32 u
float32 v
================================================================================
MSG: visualization_msgs/MeshFile
string filename
uint8[] data
"""

SEPARATOR = """
================================================================================
MSG: visualization_msgs/Marker
"""

HUMBLE = MARKER + TEXTURE + TEXT + MESH_FILE + END
FOXY = MARKER + TEXT + END


def marker(frame, namespace, number, kind, points, humble, action=0):
    """Returns a marker as `mcap_ros2` writes it."""
    stamp = {"sec": 1, "nanosec": frame * TENTH}
    header = {"stamp": stamp, "frame_id": "world"}
    x, y, z, w = (0, 0, 0, 1)
    position = (0, 0, 0)
    if namespace == "turned":
        (x, y, z, w), position = TURN, place(frame)
    message = {
        "header": header,
        "ns": namespace,
        "id": number,
        "type": kind,
        "action": action,
        "pose": {
            "position": dict(zip("xyz", position)),
            "orientation": {"x": x, "y": y, "z": z, "w": w},
        },
        "scale": {"x": 0.1, "y": 0, "z": 0},
        "color": {"r": 1, "g": 1, "b": 1, "a": 1},
        "lifetime": {"sec": 0, "nanosec": TENTH // 2 if namespace == "spark" else 0},
        "frame_locked": False,
        "points": [dict(zip("xyz", point)) for point in points],
        "colors": [],
        "text": "a",
        "mesh_resource": "",
        "mesh_use_embedded_materials": False,
    }
    if humble:
        message |= {
            "texture_resource": "",
            "texture": {"header": header, "format": "png", "data": b"12345"},
            "uv_coordinates": [{"u": 0.5, "v": 0.5}],
            "mesh_file": {"filename": "a.stl", "data": b"123"},
        }
    return message


def markers(frame, humble):
    """Returns the markers of a frame."""
    strip, lines, text, delete = (4, 5, 9, 2)
    closed = ring() + ring()[:1]
    found = [
        marker(frame, "ring", 0, strip, closed, humble),
        marker(frame, "turned", 0, strip, closed, humble),
        marker(frame, "note", 1, text, [], humble),
    ]
    if frame < 2:
        a, b, c, d = rope(frame)
        found.append(marker(frame, "rope", 7, lines, [a, b, c, d, b, c], humble))
    if frame == 2:
        found.append(marker(frame, "rope", 7, lines, [], humble, delete))
    if frame == 0:
        found.append(marker(frame, "spark", 0, strip, [(0, 0, 5), (0, 0, 6)], humble))
    return found


def write_markers():
    """`visualization_msgs/msg/MarkerArray` of ROS 2 Humble, compressed by LZ4."""
    with open(FOLDER / "markers.mcap", "wb") as file:
        writer = Ros2Writer(file, compression=CompressionType.LZ4)
        text = "Marker[] markers\n" + SEPARATOR + HUMBLE + HEADER + TEXTURE_TYPES
        schema = writer.register_msgdef("visualization_msgs/msg/MarkerArray", text)
        for frame in range(FRAMES):
            time = 1_700_000_000 * SECOND + frame * TENTH
            message = {"markers": markers(frame, True)}
            writer.write_message("/markers", schema, message, log_time=time)
        writer.finish()


def write_single_markers():
    """`visualization_msgs/msg/Marker` of ROS 2 Foxy: one message a curve."""
    with open(FOLDER / "marker.mcap", "wb") as file:
        writer = Ros2Writer(file, compression=CompressionType.LZ4)
        schema = writer.register_msgdef("visualization_msgs/msg/Marker", FOXY + HEADER)
        for frame in range(FRAMES):
            for k, message in enumerate(markers(frame, False)):
                time = 1_700_000_000 * SECOND + frame * TENTH + 1000 * k
                writer.write_message("/marker", schema, message, log_time=time)
        writer.finish()


if __name__ == "__main__":
    write_scene()
    write_json()
    write_markers()
    write_single_markers()
