"""Recordings are read by the Python package `mcap`, which is not ours, and converted."""

import dataclasses
import pathlib
import random
from concurrent.futures import ThreadPoolExecutor

import linkwatch
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from test_command import run

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


def test_rollbacks_are_kept_by_conversions_and_not_searched(tmp_path):
    """Regression test: Python and archives reported a rollback as a pull-through."""
    strand = np.array([[-2, 0, 0], [0, 0.01, 0], [2, 0, 0]], float)
    other = strand[:, [1, 0, 2]]
    heights = [0.4, 0.3, -0.3, -0.4]
    cuts = [0, 0, 1, 1]
    frames = [
        linkwatch.io.Frame(
            np.concatenate([strand, other + [0, 0, height]]), [3, 3], seq=k, cuts=cuts[k]
        )
        for k, height in enumerate(heights)
    ]
    paths = [tmp_path / name for name in ("a.npz", "b.mcap", "c.npz")]
    linkwatch.write(frames, paths[0])
    for source, target in zip(paths, paths[1:]):
        assert run("convert", source, target)[0] == 0
    for path in paths:
        assert [frame.cuts for frame in linkwatch.read(path)] == cuts
        assert run("check", path)[0] == 0
        assert linkwatch.check(path).verdict == "intact"
    with ThreadPoolExecutor(2) as client:
        assert linkwatch.check(paths[0], client=client, chunk=1).verdict == "intact"
    uncut = [dataclasses.replace(frame, cuts=0) for frame in frames]
    assert linkwatch.check(uncut).verdict == "changed"


def test_gaps_of_recordings_are_not_searched_and_said(tmp_path):
    """Regression test: a conversion lost the gaps, which became pull-throughs."""
    strand = np.array([[-2, 0, 0], [0, 0.01, 0], [2, 0, 0]], float)
    other = strand[:, [1, 0, 2]]
    # Around the end of the strand, up and down.
    around = [(0, 1), (3, 1), (3, -1), (0, -1), (0, -1.1), (0, -1.2), (0, -1.3)]
    frames = [np.concatenate([strand, other + [x, 0, z]]) for x, z in around]
    made = [linkwatch.io.Frame(frame, [3, 3], seq=k) for k, frame in enumerate(frames)]
    (path,) = linkwatch.write(made, tmp_path / "a.npz")
    thin, again = tmp_path / "b.mcap", tmp_path / "c.npz"
    assert run("check", path, "--record", f"{thin},every=3")[0] == 0
    code, out, _ = run("check", thin)
    assert code == 3
    assert "not verified: pull-throughs in 2 gaps of the recording" in out
    assert run("convert", thin, again)[0] == 3
    assert run("check", again)[0] == 3
    for source in (thin, again):
        found = linkwatch.check(source)
        assert (found.verdict, len(found.pull_throughs)) == ("incomplete", 0)


def comes_and_goes(tmp_path):
    """A recording of rings, of which the third one is there in two frames of six."""
    angles = np.linspace(0, 2 * np.pi, 20, endpoint=False)
    flat = np.stack([np.cos(angles), np.sin(angles), 0 * angles], 1)
    rings = [flat[:, axes] + [k, 0, 0] for k, axes in enumerate(([0, 1, 2], [0, 2, 1], [0, 1, 2]))]
    frames = []
    for k in range(6):
        number = 3 if k in (2, 3) else 2
        positions = np.concatenate(rings[:number]) + [0, 0.01 * k, 0]
        names = [f"ring {i}" for i in range(number)]
        frames.append(linkwatch.io.Frame(positions, [-20] * number, names=names, seq=k, time=k / 2))
    archives = linkwatch.write(frames, tmp_path / "made.npz")
    path = tmp_path / "run.mcap"
    assert run("check", "--one-motion", *archives, "--record", path)[0] == 0
    return frames, path


def test_a_recording_whose_curves_come_and_go_is_read(tmp_path):
    """Regression test: Python and conversions to archives refused it."""
    frames, path = comes_and_goes(tmp_path)
    read = linkwatch.read(path)
    assert len(read) == 6 and str(read.summary) == "2 curves, 2 closed"
    for one, other in zip(read, frames, strict=True):
        assert np.array_equal(one.positions, other.positions)
        assert (one.counts, one.names) == (other.counts, other.names)
        assert (one.seq, one.time) == (other.seq, other.time)
    found = linkwatch.check(path)
    assert found.verdict == "intact"
    with ThreadPoolExecutor(2) as client:
        assert linkwatch.check(path, client=client, chunk=2).frames == found.frames


def test_a_conversion_of_curves_that_come_and_go_writes_further_archives(tmp_path):
    _, path = comes_and_goes(tmp_path)
    code, out, _ = run("convert", path, tmp_path / "out.npz")
    names = [f"{tmp_path}/out{part}.npz" for part in ("", "-2", "-3")]
    assert code == 0 and "check " + " ".join(names) + " --one-motion" in out
    code, out, _ = run("check", *names, "--one-motion")
    assert (code, out.count("curves appeared: ring 2"), out.count("intact")) == (0, 1, 7), out
    again = tmp_path / "again.mcap"
    assert run("convert", *names, again, "--one-motion")[0] == 0
    assert [frame.names for frame in linkwatch.read(again)] == [
        frame.names for frame in linkwatch.read(path)
    ]
    code, _, err = run("convert", path, tmp_path / "out.npz", "--json")
    assert code == 2 and "exists" in err


def test_a_frame_that_was_not_fully_verified_counts_after_a_rollback(tmp_path):
    """Regression test: the link was lost while the curve was gone, and the run had recovered."""
    ring = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
    other = np.array([[0, 0, -1], [2, 0, -1], [2, 0, 1], [0, 0, 1]], float)
    frames = []
    for k in range(8):
        curves = {"a": ring, "b": other + [1.3 * (k > 1), 0, 0.01 * k], "c": ring + [0, 0, 9]}
        if k in (3, 4):
            del curves["b"]
        frames.append(
            linkwatch.io.Frame(
                np.concatenate([*curves.values()]),
                [-4] * len(curves),
                names=[*curves],
                seq=k,
                cuts=int(k > 5),
            )
        )
    archives = linkwatch.write(frames, tmp_path / "run.npz")
    path = tmp_path / "run.mcap"
    code, out, _ = run("check", "--one-motion", *archives, "--record", path)
    assert code == 3 and "what became of curve b while it was gone" in out
    for command in (["check"], ["replay"], ["report", "-o", tmp_path / "run.html"]):
        code, out, err = run(command[0], path, *command[1:])
        assert code == 3 and "recovered" not in err.splitlines()[-1:], (command, out, err)
    # Regression test: a replay that begins with the undecided frame was intact.
    assert [run("replay", path, "--from", str(k))[0] for k in (5, 6)] == [3, 0]


def test_the_step_to_the_next_file_of_a_recording_is_searched(tmp_path):
    """Regression test: with `every=`, each of these steps counted as a gap, and Python searched
    also steps over frames that were left out."""
    ring = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
    other = np.array([[0.9, 0.5, -0.3], [0.9, 0.5, 0.3], [0.7, 0.9, 0.3], [0.7, 0.9, -0.3]])
    # Long, so that each file has one frame.
    steps = np.random.default_rng(1).normal(size=(24_000, 3))
    long = np.cumsum(1e-5 * steps, 0) + 40
    frames = [
        linkwatch.io.Frame(
            np.concatenate([ring, other + np.multiply([0.2, 0.6, 0], k > 3), long]),
            [-4, -4, -24_000],
            seq=k,
        )
        for k in range(8)
    ]
    (path,) = linkwatch.write(frames, tmp_path / "run.npz")
    options = ["--events", "--motion-limit=10"]
    kept = tmp_path / "kept.mcap"
    assert run("check", path, *options, "--record", f"{kept},every=2,max=1MB")[0] == 1
    files = [kept, *(tmp_path / f"kept-part{k}.mcap" for k in range(2, 6))]
    assert [[frame.seq for frame in linkwatch.read(file)] for file in files] == [
        [0], [2], [3], [4], [6]
    ]
    code, out, _ = run("check", *files, *options)
    assert code == 1 and "not verified: pull-throughs in 2 gaps of the recording" in out
    found = linkwatch.check(files, one_motion=True, motion_limit=10)
    assert found.verdict == "changed" and [row["frame"] for row in found.pull_throughs] == [4, 4]
    assert found.left_out == [
        f"frames of the recording before kept-part{k}.mcap" for k in (2, 5)
    ]


def test_a_contact_after_a_rollback_counts_in_a_report(tmp_path):
    """Regression test: the report forgave all frames from the violation to the intact frame."""
    ring = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
    other = np.array([[0, 0, -1], [2, 0, -1], [2, 0, 1], [0, 0, 1]], float)
    places = [0, 0.1, 3, 1, 0.1, 0]
    frames = [
        linkwatch.io.Frame(
            np.concatenate([ring, other + [x, 0, 0]]), [-4, -4], seq=k, cuts=int(k > 2)
        )
        for k, x in enumerate(places)
    ]
    (path,) = linkwatch.write(frames, tmp_path / "run.npz")
    kept = tmp_path / "run.mcap"
    assert run("check", "--events=off", path, "--record", kept)[0] == 3
    for command in (["check", "--events=off"], ["replay"], ["report", "-o", tmp_path / "a.html"]):
        code, out, err = run(command[0], kept, *command[1:])
        assert code == 3, (command, out, err)


def test_each_of_several_recorded_runs_needs_its_last_file(tmp_path):
    """Regression test: only the last file that was given was asked if its run continues."""
    scene = ("generate", "chainmail:rows=12,columns=12", "--frames", "30,diameter=0.2")
    assert run(*scene, "-o", tmp_path / "run.npz")[0] == 0
    for name in "ab":
        record = f"{tmp_path / name}.mcap,max=1MB"
        assert run("check", tmp_path / "run.npz", "--record", record)[0] == 0
    a, b = ([*sorted(tmp_path.glob(f"{name}.mcap")), *sorted(tmp_path.glob(f"{name}-part*"))]
            for name in "ab")
    assert len(a) == len(b) > 2
    assert run("check", *a, *b)[0] == 0
    says = f"{a[-2]}: the run continues in {a[-1].name}, which was not given"
    for option in ([], ["--one-motion"]):
        code, _, err = run("check", *a[:-1], *b, *option)
        assert code == 3 and says in err
    left_out = linkwatch.read(*a[:-1], *b, one_motion=True).summary.left_out
    assert left_out == [f"files of the run after {a[-2].name}"]
    whole = linkwatch.read(*a, one_motion=True).summary
    assert whole.left_out == [] and "continues in" not in str(whole)
    # The frame that was asked for is there.
    code, _, err = run("convert", a[0], tmp_path / "one.npz", "--frame", "1")
    assert code == 0 and "not given" not in err


def test_frames_of_the_command_are_read_one_at_a_time_without_other_files(tmp_path, monkeypatch):
    """Regression test: all frames were first written to a temporary folder."""
    frames = [linkwatch.io.Frame(np.eye(3) + [k, 0, 0], [-3], seq=k, time=k) for k in range(40)]
    (path,) = linkwatch.write(frames, tmp_path / "run.npz")
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "none"))
    read = linkwatch.read(path)
    assert read.length is None and [frame.seq for frame in read] == list(range(40))
    assert len(read) == 40 and str(read.summary) == "1 curve, 1 closed"
    # The summary is complete although only some frames were taken.
    begun = iter(linkwatch.read(path))
    assert [next(begun).seq, next(begun).seq] == [0, 1]
    # Parts in any order are those of all frames.
    rng = random.Random(5)
    for _ in range(60):
        start = rng.randrange(40)
        stop = rng.randrange(start, 41)
        assert [frame.seq for frame in read.part(start, stop)] == list(range(start, stop))


def test_invalid_frames_keep_their_numbers_and_reasons(tmp_path):
    """Also before the first valid frame, and at the end of a file that was cut off."""
    lines = ["3", "Time={k} Properties=species:S:1:pos:R:3:molecule:I:1:closed:L:1"]
    lines += [f"C {x} {y} {z} 0 T" for x, y, z in np.eye(3)]
    text = "\n".join(lines) + "\n"
    parts = [text.replace("{k}", str(k)) for k in range(5)]
    parts[0] = parts[0].replace("C 1.0", "C nan")
    parts[2] = parts[2].replace("C 0.0", "C inf")
    path = tmp_path / "a.xyz"
    path.write_text("".join(parts)[:-20])
    read = linkwatch.read(path)
    found = list(read)
    assert [frame.seq for frame in found] == [0, 1, 2, 3, 4] and len(read) == 5
    assert [frame.rejected is None for frame in found] == [False, True, False, True, False]
    assert "not a finite number" in found[0].rejected and "a.xyz" not in found[0].rejected
    assert "too many" in found[4].rejected and np.isnan(found[4].positions).all()
    run_of_all = linkwatch.check(read)
    assert [row["verdict"] for row in run_of_all.frames].count("rejected") == 3
    path.write_text(parts[0])
    with pytest.raises(ValueError, match="a.xyz, frame 0: .*not a finite number"):
        linkwatch.read(path)
    path.write_text("")
    with pytest.raises(ValueError, match="a.xyz: no frame"):
        linkwatch.read(path)


def test_a_list_of_the_frames_of_a_file_knows_that_the_run_goes_on(tmp_path):
    scene = ("generate", "chainmail:rows=12,columns=12", "--frames", "30,diameter=0.2")
    assert run(*scene, "-o", tmp_path / "run.npz")[0] == 0
    record = f"{tmp_path / 'run.mcap'},max=1MB"
    assert run("check", tmp_path / "run.npz", "--record", record)[0] == 0
    frames = list(linkwatch.read(tmp_path / "run.mcap"))
    assert frames[-1].left_out == ("files of the run after run.mcap",)
    assert linkwatch.check(frames).verdict == "incomplete"
    # Regression test: a second iteration that ended early made the summary incomplete, and the
    # run intact.
    for taken in (0, 1, 3):
        read = linkwatch.read(tmp_path / "run.mcap")
        begun = iter(read)
        for _ in range(taken):
            next(begun)
        checked = linkwatch.check(read)
        next(iter(read))
        assert taken == 0 or next(begun).seq == taken
        assert checked.verdict == "incomplete"
        assert read.summary.left_out == ["files of the run after run.mcap"]


def test_an_invalid_frame_of_files_that_continue_one_another_is_said_once(tmp_path):
    frames = [linkwatch.io.Frame(np.eye(3), [-3], seq=k) for k in range(3)]
    frames[1] = frames[0].invalid("lost", seq=1)
    (first,) = linkwatch.write(frames, tmp_path / "a.npz")
    (second,) = linkwatch.write(frames[2:], tmp_path / "b.npz")
    read = linkwatch.read(first, second, one_motion=True)
    assert len(list(read)) == 4
    (said,) = read.summary.rejected
    assert said.startswith("frame 1 is invalid: ")
