"""Recordings are read by the Python package `mcap`, which is not ours."""

import pathlib

import pytest
from foxglove_schemas_protobuf import PointCloud_pb2, SceneUpdate_pb2
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from test_command import OTHER, RING, run, write_bcc

RECORDINGS = pathlib.Path(__file__).parents[3] / "recordings"

MAGIC = b"\x89MCAP0\r\n"


def messages(path):
    """Decodes all messages: topic, schema, message."""
    with open(path, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for schema, channel, _, message in reader.iter_decoded_messages():
            yield channel.topic, schema, message


@pytest.mark.parametrize("path", sorted(RECORDINGS.glob("*.mcap")), ids=lambda path: path.stem)
def test_every_recording_opens(path):
    finished = path.read_bytes().endswith(MAGIC)
    # Recordings that were cut off say so in their names.
    assert finished == ("cut" not in path.stem)
    if not finished:
        pytest.skip("this package does not open a recording that was cut off")
    verdicts = [m for topic, _, m in messages(path) if topic == "/linkwatch/verdicts"]
    expected = path.with_suffix(".jsonl").read_text().splitlines()
    assert len(verdicts) == len(expected) > 0
    assert all(verdict.HasField("report") for verdict in verdicts)


def fields(descriptor, known):
    """Asserts that all fields of a message are those of the well-known one, recursively."""
    for field in descriptor.fields:
        other = known.fields_by_name[field.name]
        same = ("number", "type", "is_repeated", "full_name")
        assert [getattr(field, a) for a in same] == [getattr(other, a) for a in same]
        if field.message_type:
            fields(field.message_type, other.message_type)
        if field.enum_type:
            values = [[(v.name, v.number) for v in f.enum_type.values] for f in (field, other)]
            assert values[0] == values[1]


def test_messages_for_other_tools_have_their_well_known_types(tmp_path):
    models = []
    for k, far in enumerate([0, 0, 4, 4]):
        path = tmp_path / f"{k}.bcc"
        models.append(write_bcc(path, [RING, OTHER + [far, 0, 0], RING + [9, 0, 0]]))
    recording = tmp_path / "run.mcap"
    code, _, err = run("check", *models, "--record", f"{recording},for=foxglove+rerun")
    assert code == 1, err
    scenes, clouds = [], []
    for topic, schema, message in messages(recording):
        if topic == "/linkwatch/scene":
            assert schema.name == "foxglove.SceneUpdate"
            fields(message.DESCRIPTOR, SceneUpdate_pb2.SceneUpdate.DESCRIPTOR)
            scenes.append(message)
        if topic == "/linkwatch/points":
            assert schema.name == "foxglove.PointCloud"
            fields(message.DESCRIPTOR, PointCloud_pb2.PointCloud.DESCRIPTOR)
            clouds.append(message)
    assert len(scenes) == len(clouds) == 4
    ids = [[entity.id for entity in scene.entities] for scene in scenes]
    broken = ["curves", "curve 0", "curve 1", "findings"]
    assert ids == [["curves"], ["curves"], broken, broken]
    label = scenes[2].entities[3].texts[0].text
    assert label == "0 & 1: linking number was -1, is 0"
    # 16 points per edge.
    assert all(len(cloud.data) == cloud.point_stride * 16 * 12 for cloud in clouds)
