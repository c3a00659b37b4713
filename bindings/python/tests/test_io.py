"""Files of other programs, and the archives that the command reads."""

import subprocess
import sys

import linkwatch
import numpy as np
import pytest
from linkwatch import io
from test_command import OTHER, RING, run

RINGS = np.concatenate([RING, OTHER])


def frame(seq=0, **others):
    given = {"positions": RINGS, "counts": [-4, -4], "names": ["a", "b"], **others}
    return io.Frame(seq=seq, time=0.5 * seq, **given)


def test_written_frames_are_those_that_the_command_reads(tmp_path):
    path = tmp_path / "run.npz"
    cell = np.vstack([10 * np.eye(3), np.zeros(3)])
    moved = RINGS + np.repeat([[0, 0, 0], [3, 0, 0]], 4, axis=0).astype(np.float32)
    given = [
        frame(3, cell=cell, radii=[0.1, 0.3]),
        frame(7, cell=1.1 * cell, radii=[0.2, 0.1], positions=moved),
    ]
    assert io.write(iter(given), path) == [path]
    with np.load(path) as arrays:
        assert arrays["radii"].tolist() == np.float32([0.2, 0.3]).tolist()
        assert arrays["cell"].shape == (2, 4, 3)
        assert arrays["positions"].dtype == np.float32
        np.testing.assert_array_equal(arrays["positions"], np.stack([RINGS, moved]))
    code, out, err = run("check", path)
    assert code == 1, err
    assert "frame 3: intact" in out
    assert "curves 0 (a) and 1 (b) came apart" in out
    assert list(tmp_path.iterdir()) == [path]


def test_a_file_is_overwritten_only_by_force(tmp_path):
    path = tmp_path / "run.npz"
    io.write([frame()], path)
    with pytest.raises(FileExistsError, match="run.npz exists already"):
        io.write([frame()], path)
    io.write([frame()], path, force=True)
    with pytest.raises(ValueError, match="must end with .npz"):
        io.write([frame()], tmp_path / "run.bcc")


@pytest.mark.parametrize(
    "frames, words",
    [
        ([], "no valid frame to write"),
        ([frame(1), frame(1)], "frame 1 after frame 1"),
        ([frame(0), frame(1, cell=np.eye(4, 3))], "others without one"),
        ([frame(3, rejected="torn")], "no valid frame to write; frame 3, which is invalid: torn"),
    ],
)
def test_frames_that_an_archive_cannot_hold_leave_no_file(tmp_path, frames, words):
    with pytest.raises(ValueError, match=words):
        io.write(frames, tmp_path / "run.npz")
    assert list(tmp_path.iterdir()) == []


def test_invalid_frames_are_rejected_or_counted(tmp_path):
    path = tmp_path / "run.npz"
    io.write([frame(0, rejected="torn"), frame(1), frame(2, rejected="lost"), frame(3)], path)
    code, out, err = run("check", path)
    assert code == 3, err
    assert "frame 2: rejected" in out
    assert "frame 0, which is invalid: torn" in out
    assert "2 frames verified, 1 rejected" in out


def test_a_session_takes_the_frames(tmp_path):
    first = frame()
    session = linkwatch.Session(first.counts, names=first.names, basis=first.basis)
    assert session.step(first.positions, first.time, cell=first.cell).intact


def test_an_unknown_kind_of_file_is_refused(tmp_path):
    (tmp_path / "scene.abc").write_bytes(b"\0\0\0")
    with pytest.raises(ValueError, match=r"scene.abc: unknown kind of file \(known: .bcc"):
        io.read(tmp_path / "scene.abc")
    with pytest.raises(FileNotFoundError):
        io.read(tmp_path / "scene.vtk")


def test_the_module_is_the_command(tmp_path):
    path = tmp_path / "run.npz"
    io.write([frame()], path)
    words = [sys.executable, "-m", "linkwatch"]
    ended = subprocess.run([*words, "certify", path], capture_output=True, text=True)
    assert (ended.returncode, ended.stdout) == (0, "2 # lines: 1\n0,1,-1\n"), ended.stderr
    # The command itself converts what it reads itself.
    code, _, err = run("convert", path, tmp_path / "run.bcc")
    assert code == 0, err
    assert (tmp_path / "run.bcc").exists()


def test_a_damaged_file_is_named_by_every_command(tmp_path):
    path = tmp_path / "a.ply"
    path.write_text("ply\n")
    for words in (["certify"], ["check"], ["measure", "writhe"]):
        code, out, err = run(*words, path)
        assert (code, out) == (2, "") and f"error: {path}: " in err


def test_a_missing_library_is_named(tmp_path, monkeypatch):
    for module, name, extra in (("MDAnalysis", "a.pdb", "mdanalysis"), ("meshio", "a.msh", "mesh")):
        (tmp_path / name).write_text("")
        monkeypatch.setitem(sys.modules, module, None)
        with pytest.raises(ImportError, match=rf'pip install "linkwatch\[{extra}\]"'):
            linkwatch.read(tmp_path / name)


def test_curves_that_stay_open_are_written_as_open_curves(tmp_path):
    # Regression test: a chain that is not marked as closed was verified as an open curve, but was
    # closed in the recording and the report of the same run.
    t = np.linspace(0, np.pi, 10)
    chain = np.stack([3 * np.cos(t), 3 * np.sin(t), 0 * t], axis=1)
    a = 2 * np.pi * np.arange(12) / 12
    ring = np.stack([0 * a, 0.4 * np.cos(a), 0.4 * np.sin(a)], axis=1)
    frames = [[chain, ring + [0.1, 2.1 - 0.3 * k, 0.01]] for k in range(12)]
    checked = linkwatch.check(frames)
    assert checked.verdict == "intact"
    (path,) = linkwatch.write(checked.source, tmp_path / "run.npz")
    assert np.load(path)["counts"].tolist() == [10, -12]
    assert linkwatch.check(path).verdict == "intact"
