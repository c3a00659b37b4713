"""Whole runs: `linkwatch.check` and its results."""

import copy
import json
import os
import pickle
import re
import signal
import subprocess
import sys
import threading
import time
import warnings
import xml.dom.minidom
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import linkwatch
from linkwatch._view import strips
import numpy as np
import pytest
from linkwatch.io import Frame
from test_linkwatch import OTHER, RING, linked

BROKEN = [linked(x) for x in (0, 0.4, 0.8, 1.2, 1.6, 2.0)]


def tables(run):
    """Returns all findings of a run."""
    return {**run.to_dict(), "summary": run.summary}


def test_a_run_has_tables_of_its_frames_and_findings():
    run = linkwatch.check(BROKEN, names=["left", "right"])
    assert run.verdict == "changed" and not run
    assert [row["verdict"] for row in run.frames] == ["intact"] * 3 + ["changed"] * 3
    assert [row["changes"] for row in run.frames] == [0, 0, 0, 1, 1, 1]
    assert [row["pull_throughs"] for row in run.frames] == [0, 0, 0, 1, 0, 0]
    (change,) = run.changes
    assert (change["expected"], change["found"]) == (-1, 0)
    assert (change["frame"], change["last"], change["frames"]) == (3, 5, 3)
    assert change["names"] == ["left", "right"] and len(change["point"]) == 3
    (passage,) = run.pull_throughs
    assert (passage["frame"], passage["sign"], passage["unresolved"]) == (3, 1, False)
    assert passage["fraction"] == pytest.approx(0.5)
    assert "frame 3 at 3 s: changed" in run.summary and "(left)" in run.summary
    assert "1 linking number differs from the baseline\n  1 pull-through" in str(run)
    assert repr(run) == "<Run: changed: 6 frames>"
    assert json.loads(json.dumps(run.to_dict())) == run.to_dict()
    for other in (copy.copy(run), pickle.loads(pickle.dumps(run))):
        assert tables(other) == tables(run)


def test_an_intact_run_is_true():
    run = linkwatch.check(BROKEN[:3], radius=0.1)
    assert run and run.verdict == "intact" and run.changes == run.pull_throughs == []
    assert run.frames[2]["clearance"] == pytest.approx(1.0)
    assert "lowest clearance: 100.0 % of the diameter, in frame 2" in run.summary
    assert linkwatch.check(BROKEN[:1], baseline=linkwatch.certify(linked()))


def incomplete(words, *args, **options):
    run = linkwatch.check(*args, **options)
    assert run.verdict == "incomplete" and not run
    assert words in run.summary, run.summary
    return run


def test_what_was_not_verified_is_no_success(tmp_path):
    touching = [RING, OTHER + [1, 0, 0]]
    rejected = incomplete("the first one is frame 1: curve 1", [linked(), linked(np.nan), linked()])
    assert [row["verdict"] for row in rejected.frames] == ["intact", "rejected", "intact"]
    run = incomplete("1 frame with the verdict contact", [linked(), touching], events="off")
    assert run.defects[0]["kind"] == "contact"
    incomplete("one frame, and nothing to compare it with", [linked()])
    incomplete("no frame was verified", [])
    far = [[RING], [RING + [0, 0, 9], OTHER]]
    incomplete("rejected", far)
    open_curve = [[RING, OTHER]] * 2
    incomplete("not verified: 1 open curve", open_curve, closed=[True, False], events="off")
    # Regression test: only the last frame counted: of the run, or of its last chunk.
    both = Frame(np.concatenate([RING, OTHER]), [-4, 4], names=["ring", "line"])
    ring = Frame(RING, [-4], names=["ring"])
    frames = [replace(one, seq=seq) for seq, one in enumerate([both, both, ring, ring])]
    with ThreadPoolExecutor(1) as client:
        for chunks in ({}, {"client": client, "chunk": 2}):
            incomplete("not verified: 1 open curve", frames, events="off", **chunks)
    run = linkwatch.check(open_curve, closed=[True, False])
    assert run and "1 open curve verified for pull-throughs" in run.summary
    # Regression test: a single frame had this note, too.
    baseline = linkwatch.certify([RING, OTHER + [9, 0, 0]])
    run = linkwatch.check(open_curve[:1], baseline, closed=[True, False])
    assert "not verified: 1 open curve" in run.summary, run.summary
    left = tmp_path / "left.vtk"
    left.write_text(
        "# vtk DataFile Version 3.0\n\nASCII\nDATASET POLYDATA\nPOINTS 4 float\n"
        "0 0 0 1 0 0 1 1 0 0 1 0\nLINES 2 8\n5 0 1 2 3 0\n1 2\n"
    )
    run = incomplete("not read, so not verified: 1 ", [left, left])
    assert run.left_out and len(run.frames) == 2
    # A change is a change, also if other frames were rejected.
    assert linkwatch.check([linked(), linked(np.nan), linked(3)]).verdict == "changed"


def test_curves_that_stay_open_are_noted():
    line = [[k, 9, 0] for k in range(6)]
    run = linkwatch.check([[line, RING, OTHER]] * 2)
    assert "1 curve stays open (curve 0)" in run.notes[0] and run.notes[0] in run.summary
    assert "1 open curve verified for pull-throughs" in run.summary


def test_readers_say_why_a_frame_is_invalid():
    good = Frame(np.concatenate(linked()), [-4, -4], seq=3)
    bad = good.invalid("the file has a hole", seq=4)
    run = linkwatch.check([good, bad, Frame(good.positions, [-4, -4], seq=9, time=0.5)])
    assert [row["frame"] for row in run.frames] == [3, 4, 9]
    assert run.frames[1]["rejected"] == "the file has a hole"
    assert "frame 4: the file has a hole" in run.summary


def test_runs_are_read_from_files_and_universes(tmp_path):
    path = tmp_path / "run.npz"
    points = np.stack([np.concatenate(frame) for frame in BROKEN])
    np.savez(path, positions=points, counts=[-4, -4], times=np.arange(6) * 0.1)
    expected = linkwatch.check(BROKEN)
    for given in (path, str(path), [path], linkwatch.read(path)):
        run = linkwatch.check(given)
        assert run.changes[0]["time"] == pytest.approx(0.3)
        assert [row["frame"] for row in run.frames] == list(range(6))
        assert run.verdict == expected.verdict and len(run.pull_throughs) == 1
    assert linkwatch.check(path, cell="none", format="linkwatch").verdict == "changed"
    for given, option in ((linkwatch.read(path), "cell"), (path, "names"), (BROKEN, "select")):
        with pytest.raises(TypeError, match=f"no option '{option}' for frames of this kind"):
            linkwatch.check(given, **{option: "all"})
    mda = pytest.importorskip("MDAnalysis")
    universe = mda.Universe.empty(8, trajectory=True)
    universe.load_new(points.astype("f4"), order="fac")
    bonds = [(4 * k + i, 4 * k + (i + 1) % 4) for k in range(2) for i in range(4)]
    universe.add_TopologyAttr("bonds", bonds)
    for given in (universe, universe.atoms):
        assert linkwatch.check(given).changes[0]["frame"] == 3


def test_curves_may_come_and_go_by_name():
    def frame(seq, names, curves):
        return Frame(np.concatenate(curves), [-4] * len(names), names=names, seq=seq)

    run = linkwatch.check(
        [
            frame(0, ["a", "b"], linked()),
            frame(1, ["a", "c", "b"], [RING, RING + 20, OTHER]),
            frame(2, ["b", "a"], [OTHER, RING]),
            frame(3, ["b", "a"], [OTHER + [4, 0, 0], RING]),
        ]
    )
    assert [row["verdict"] for row in run.frames] == ["intact"] * 3 + ["changed"]
    assert run.changes[0]["names"] == ["b", "a"]


def test_a_frame_of_other_curves_is_rejected_alone():
    """Regression test: all later frames were rejected, and a change was missed."""
    frames = [*BROKEN]
    frames[1] = frames[1][:1]
    rejected = ["intact", "rejected", "intact", "changed", "changed", "changed"]
    assert [row["verdict"] for row in linkwatch.check(frames).frames] == rejected
    published = [Frame(np.concatenate(f), [-4, -4], radii=[0.1, 0.3]) for f in BROKEN]
    published[1] = replace(published[1], radii=[0.2, 0.2])
    run = linkwatch.check(published, radius="published")
    assert [row["verdict"] for row in run.frames] == rejected
    assert run.frames[1]["rejected"].startswith("other radii than before: give a fixed radius")
    # Regression test: all later frames were rejected after this change, too.
    for change in ({"names": ["a", "b"]}, {"closed_by_default": True}):
        described = [replace(frame, radii=[]) for frame in published]
        described[1] = replace(described[1], **change)
        run = linkwatch.check(described)
        assert [row["verdict"] for row in run.frames] == rejected
        assert run.frames[1]["rejected"].startswith("the curves were described again, but have no")
    # The curves of a first frame that is rejected do not count.
    nothing = described[1].invalid("no file")
    run = linkwatch.check([nothing, *described[2:]])
    assert [row["verdict"] for row in run.frames] == ["rejected", *rejected[2:]]
    named = [replace(frame, names=["a", "b"]) for frame in published]
    assert linkwatch.check(named, radius="published").frames[1]["verdict"] == "intact"


def test_options_are_those_of_a_session():
    assert linkwatch.check(BROKEN, events="off").pull_throughs == []
    baseline = linkwatch.certify(linked(5))
    assert linkwatch.check(BROKEN, baseline=baseline).changes[0]["frame"] == 0
    published = [Frame(np.concatenate(f), [-4, -4], radii=[0.1, 0.3]) for f in BROKEN[:3]]
    run = linkwatch.check(published, radius="published")
    assert run.frames[2]["clearance"] == pytest.approx(0.2 / 0.4)
    for given, options in ((3, {}), (BROKEN, {"client": 3}), (BROKEN, {"baseline": 3})):
        with pytest.raises(TypeError, match="is (a int|3), expected"):
            linkwatch.check(given, **options)
    with pytest.raises(ValueError, match="frame 0 has no radii"):
        linkwatch.check(BROKEN, radius="published")
    with pytest.raises(ValueError, match="events"):
        linkwatch.check(BROKEN, events="some")
    with pytest.raises(ValueError, match="frame 0: curve 0 has the shape"):
        linkwatch.check([[np.zeros((3, 2))]])


def test_tables_plots_and_html_of_a_run(monkeypatch, tmp_path):
    pytest.importorskip("pandas")
    run = linkwatch.check(BROKEN, radius=0.1)
    frames = run.to_pandas()
    assert frames.shape == (6, 10) and list(frames["verdict"][2:4]) == ["intact", "changed"]
    assert run.to_pandas("changes")["found"].tolist() == [0]
    assert run.to_pandas("pull_throughs")["sign"].tolist() == [1]
    assert run.to_pandas("defects").empty and "kind" in run.to_pandas("defects").columns
    with pytest.raises(ValueError, match="table is 'links'"):
        run.to_pandas("links")
    pytest.importorskip("matplotlib")
    assert len(run.plot().axes) == 3
    for other in (linkwatch.check(BROKEN[:2]), linkwatch.check([])):
        assert len(other.plot().axes) == 2
    html = run._repr_html_()
    assert ">changed: 6 frames\n" in html and "data:image/png;base64," in html
    assert "image/svg" not in linkwatch.check(BROKEN[:3])._repr_html_()
    for module, call in (("pandas", run.to_pandas), ("matplotlib.figure", run.plot)):
        monkeypatch.setitem(sys.modules, module, None)
        with pytest.raises(ImportError, match=r'pip install "linkwatch\[analysis\]"'):
            call()
    assert "image/png" not in run._repr_html_()


def shown(run):
    """Returns the first words of the captions of a picture, and the frames."""
    if (svg := run._picture()) is None:
        return []
    xml.dom.minidom.parseString(svg)
    captions = re.findall(r'aria-label="(\w+)[^"]*: frame (\d+)', svg.decode())
    # A second row shows the place from nearer.
    return list(dict.fromkeys(captions))


def test_html_shows_the_pictures_of_the_report(tmp_path):
    points = np.stack([np.concatenate(frame) for frame in BROKEN])
    np.savez(tmp_path / "run.npz", positions=points, counts=[-4, -4], times=np.arange(6) * 0.1)
    lost = linkwatch.certify(linked(5))
    series = BROKEN[:2], BROKEN[:4], BROKEN, tmp_path / "run.npz", BROKEN[:2], iter(BROKEN)
    expected = [], ["2", "3"], ["2", "3", "4"], ["2", "3", "4"], ["0", "1"], []
    for frames, numbers in zip(series, expected):
        run = linkwatch.check(frames, baseline=lost if numbers == ["0", "1"] else None)
        said = run.summary
        assert [number for _, number in shown(run)] == numbers
        assert run.summary == said
        assert run._repr_html_().count("data:image/svg+xml;base64,") == bool(numbers)


@pytest.mark.parametrize("closed", [False, [True, False, False]])
def test_html_shows_open_curves(closed):
    lines = np.array([[-1, 0, 0], [0, 0.1, 0], [1, 0, 0]]), np.array([[0.3, -1, 0], [0.3, 1, 0]])
    falling = [[RING + 9, lines[0], lines[1] + [0, 0, 0.5 - 0.2 * k]] for k in range(5)]
    run = linkwatch.check(falling, closed=closed)
    assert run.pull_throughs[0]["frame"] == 3
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert [word for word, _ in shown(run)] == ["before", "at", "after"]


def test_a_run_is_shown_in_the_viewer(tmp_path, monkeypatch):
    pytest.importorskip("rerun")
    run = linkwatch.check(BROKEN, names=["left", "right"])
    run.view(tmp_path / "run.rrd")
    words = [sys.executable, "-m", "rerun", "rrd", "print", tmp_path / "run.rrd"]
    printed = subprocess.run(words, capture_output=True, text=True, check=True).stdout
    for path in ("/curves", "/pull-throughs", "/log"):
        assert path in printed
    with pytest.raises(ValueError, match="cannot be read again"):
        linkwatch.check(iter(BROKEN)).view(tmp_path / "once.rrd")
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(ImportError, match=r'pip install "linkwatch\[viewer\]"'):
        run.view(tmp_path / "none.rrd")


@pytest.mark.parametrize("basis", ["polyline", "catmull-rom", "b-spline", "bezier"])
@pytest.mark.parametrize("closed", [False, True])
def test_curves_are_drawn_along_their_splines(basis, closed):
    n = {(False, "bezier"): 13, (True, "bezier"): 12}.get((closed, basis), 12)
    points = np.random.default_rng(7).normal(size=(n, 3))
    (drawn,) = strips(linkwatch.io.Frame(points, [-n if closed else n], basis))
    assert (np.linalg.norm(np.diff(drawn, axis=0), axis=1) < 4).all()
    assert np.allclose(drawn[0], drawn[-1]) == closed
    if basis != "b-spline":
        # Points of the curve itself.
        distances = np.linalg.norm(drawn[:, None] - points[::3], axis=2)
        inner = distances[:, 1:-1] if basis == "catmull-rom" and not closed else distances
        assert (inner.min(axis=0) < 1e-12).all()


def test_a_page_and_a_recording_of_a_run(tmp_path):
    run = linkwatch.check(BROKEN, names=["left", "right"])
    page = tmp_path / "run.html"
    run.report(page)
    assert "curves 0 (left) and 1 (right) came apart" in page.read_text()
    with pytest.raises(FileExistsError, match="`force` overwrites it"):
        run.report(page)
    run.report(page, force=True)
    recording = tmp_path / "run.mcap"
    baseline = linkwatch.certify(linked(5))
    linkwatch.check(BROKEN, baseline, "off", keep_open=True).record(recording, settings="every=2")
    words = [sys.executable, "-m", "linkwatch", "report", recording, "--json"]
    told = json.loads(subprocess.run(words, capture_output=True, check=False).stdout)
    assert told["frames"]["verified"] == 6 and told["first_changed"]["frame"] == 0
    once = linkwatch.check(frame for frame in BROKEN)
    with pytest.raises(ValueError, match="cannot be read again"):
        once.report(tmp_path / "once.html")


def test_a_progress_bar_is_shown_as_wanted(capsys, monkeypatch):
    pytest.importorskip("tqdm")
    linkwatch.check(BROKEN)
    assert capsys.readouterr().err == ""
    linkwatch.check(BROKEN, progress=True)
    assert "6/6" in capsys.readouterr().err
    monkeypatch.setitem(sys.modules, "tqdm.auto", None)
    assert linkwatch.check(BROKEN[:2])
    with pytest.raises(ImportError, match="a progress bar needs more libraries"):
        linkwatch.check(BROKEN, progress=True)


def test_one_curve_alone_is_not_intact():
    frames = [[RING], [RING]]
    run = linkwatch.check(frames)
    assert run.verdict == "incomplete" and not run
    assert "nothing was verified: one curve alone" in run.summary
    assert linkwatch.check(frames, events="all").verdict == "intact"


def test_frames_in_memory_without_numbers_are_counted():
    """Regression test: all frames had the number 0."""
    frames = [Frame(np.concatenate(points), [-4, -4]) for points in BROKEN]
    run = linkwatch.check(frames)
    assert [row["frame"] for row in run.frames] == list(range(6))
    numbered = [replace(frame, seq=3 * k + 7) for k, frame in enumerate(frames)]
    assert [row["frame"] for row in linkwatch.check(numbered).frames] == [7, 10, 13, 16, 19, 22]


def test_a_segment_that_spans_half_of_the_scene_is_a_warning():
    """Regression test: torn curves were intact without a warning."""
    angles = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    ring = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1) + [9.5, 5, 5]
    torn = [ring % 10, (ring + [0, 2.5, 0]) % 10]
    with pytest.warns(linkwatch.UnverifiedWarning, match="spans .* % of the scene along x"):
        run = linkwatch.check([torn, torn])
    assert any("give the cell, with wrapped=True" in note for note in run.notes)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert linkwatch.check([torn, torn], cell=[10, 10, 10], wrapped=True).notes == []


def test_options_do_not_hold_for_frames_that_have_them():
    """Regression test: the options were ignored without a warning."""
    frames = [Frame(np.concatenate(points), [-4, -4]) for points in BROKEN]
    for option in (
        {"cell": [10] * 3},
        {"closed": True},
        {"names": ["a", "b"]},
        {"basis": "bezier"},
    ):
        with pytest.raises(TypeError, match=f"there is no option '{next(iter(option))}'"):
            linkwatch.check(frames, **option)
    assert linkwatch.check(frames).verdict == "changed"
    assert linkwatch.check(BROKEN, names=np.array(["a", "b"])).verdict == "changed"


def test_frames_remember_what_their_file_left_out():
    """Regression test: given as a list, the frames of an incomplete file were intact."""
    frames = [Frame(np.concatenate(points), [-4, -4]) for points in BROKEN[:2]]
    frames = [replace(frame, left_out=("1 quadratic edge (cell 2)",)) for frame in frames]
    run = linkwatch.check(frames)
    assert run.verdict == "incomplete" and run.left_out == ["1 quadratic edge (cell 2)"]


@pytest.mark.parametrize("in_pool", [False, True])
def test_a_simulation_may_write_over_its_points(in_pool):
    """Regression test: all frames of a chunk had the points of the last one."""

    def points():
        now = np.empty((8, 3))
        for ring, other in BROKEN:
            now[:4], now[4:] = ring, other
            yield now

    with ThreadPoolExecutor(2) as client:
        client = client if in_pool else None
        assert linkwatch.check(points(), counts=[-4, -4], client=client).verdict == "changed"


def test_open_curves_that_nothing_verifies_are_not_intact():
    """Regression test: such curves were intact, although no knot or step is compared."""
    line = np.random.default_rng(0).normal(size=(2, 12, 3))
    run = linkwatch.check([[line[0]], [line[1]]], closed=False, invariants="self")
    assert run.verdict == "incomplete" and "one curve alone" in run.summary
    ring, other = BROKEN[0]
    frames = [Frame(np.concatenate([ring, other]), [4, -4], seq=k, cuts=k) for k in range(3)]
    run = linkwatch.check(frames)
    assert run.verdict == "incomplete" and "no step was searched" in run.summary
    far = [ring, other + [9, 0, 0]]
    run = linkwatch.check([far], baseline=linkwatch.certify(far), closed=False)
    assert run.verdict == "incomplete" and "nothing was verified" in run.summary


def test_each_curve_may_have_its_own_radius():
    """Regression test: a list of radii was ignored, and an array was an error."""
    of_number = linkwatch.check(BROKEN, radius=0.05).frames
    for radius in ([0.05, 0.05], (0.05, 0.05), np.array([0.05, 0.05])):
        assert linkwatch.check(BROKEN, radius=radius).frames == of_number


def test_a_report_that_ctrl_c_took_makes_the_next_frame_undecided():
    """Regression test: the interrupted step was complete, so repeating it was intact."""
    number = 300_000
    at = np.linspace(-1, 1, number)
    noise = 1e-7 * np.random.default_rng(1).normal(size=(2, number, 3))

    def chains(height):
        one = np.stack([at, 0 * at, 0 * at], axis=1)
        return [one + noise[0], np.stack([0 * at, at, 0 * at + height], axis=1) + noise[1]]

    session = linkwatch.Session(closed=False)
    session.step(chains(2e-6))
    threading.Timer(0.05, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
    with pytest.raises(KeyboardInterrupt):
        session.step(chains(-2e-6))
        time.sleep(1)
    report = session.step(chains(-2e-6))
    # The step was cancelled, or its report is lost.
    assert report.verdict == "changed" or "Ctrl-C" in str(report), report
