"""Recordings are read by the Python package `mcap`, which is not ours."""

import pathlib

import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

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
