"""The command `linkwatch`, as the package installs it."""

import os
import signal
import struct
import subprocess

import linkwatch
import numpy as np
import pytest
from conftest import COMMAND, PATIENCE, until

RING = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float32)
OTHER = np.array([[0, 0, -1], [2, 0, -1], [2, 0, 1], [0, 0, 1]], np.float32)


def write_bcc(path, curves):
    """Writes closed polylines as a BCC file."""
    numbers = (0x44, b"PL", 3, 2, len(curves), 4 * len(curves), b"")
    header = struct.pack("<3sB2s2BQQ40s", b"BCC", *numbers)
    body = b"".join(struct.pack("<i", -4) + curve.astype("<f4").tobytes() for curve in curves)
    path.write_bytes(header + body)
    return path


@pytest.fixture
def linked(tmp_path):
    return write_bcc(tmp_path / "linked.bcc", [RING, OTHER])


@pytest.fixture
def apart(tmp_path):
    return write_bcc(tmp_path / "apart.bcc", [RING, OTHER + np.float32([4, 0, 0])])


def run(*args):
    """Runs the command. Returns the exit code, stdout and stderr."""
    words = [str(arg) for arg in (COMMAND, *args)]
    ended = subprocess.run(words, capture_output=True, text=True, timeout=PATIENCE)
    return ended.returncode, ended.stdout, ended.stderr


def test_the_version_is_that_of_the_package():
    assert run("--version") == (0, f"linkwatch {linkwatch.__version__}\n", "")


def test_certify_prints_the_certificate_of_a_file(linked, tmp_path):
    code, out, err = run("certify", linked)
    assert (code, out) == (0, "2 # lines: 1\n0,1,-1\n"), err
    file = tmp_path / "certificate.txt"
    code, out, err = run("certify", linked, "-o", file)
    assert (code, out) == (0, ""), err
    assert linkwatch.Certificate.read(file) == linkwatch.certify([RING, OTHER])


@pytest.mark.parametrize("where", ["live", "web", "a.rrd"])
def test_the_viewer_is_in_another_build(linked, where):
    code, out, err = run("check", linked, linked, "--show", where)
    assert (code, out) == (2, "")
    assert "this build of linkwatch has no viewer" in err
    assert "cargo install --path . --locked" in err
    assert "linkwatch replay FILE.mcap" in err


def test_check_returns_1_if_a_link_was_lost(linked, apart):
    assert run("check", linked, linked)[0] == 0
    code, out, err = run("check", linked, apart)
    assert code == 1, err
    assert "curves 0 and 1 came apart: linking number was -1, is 0" in out


@pytest.mark.parametrize(
    "args, words",
    [
        (["bogus"], "unrecognized subcommand 'bogus'"),
        (["watch", "--show", "run.rrd"], "this build of linkwatch has no viewer"),
        (["certify", "missing.bcc"], "missing.bcc"),
        (["study"], "study is gone; instead: a command for developers"),
    ],
)
def test_bad_arguments_return_2(args, words):
    code, out, err = run(*args)
    assert (code, out) == (2, ""), err
    assert words in err


def test_a_device_that_is_missing_is_named(linked):
    code, out, err = run("certify", linked, "--device", "gpu")
    assert (code, out) == (2, ""), err
    assert "gpu" in err


def test_a_check_can_be_recorded_and_replayed(linked, apart, tmp_path):
    recording = tmp_path / "run.mcap"
    code, _, err = run("check", linked, linked, apart, "--record", recording)
    assert code == 1, err
    code, out, err = run("replay", recording)
    assert code == 1, err
    assert "3 equal to the recorded ones" in out


def test_closed_streams_do_not_spoil_a_file(linked, tmp_path):
    file = tmp_path / "certificate.txt"
    shell = ["sh", "-c", '"$@" >&- 2>&-', "sh", COMMAND, "certify", linked, "-o", file, "--json"]
    assert subprocess.run(shell, timeout=PATIENCE).returncode == 0
    assert file.read_text() == "2 # lines: 1\n0,1,-1\n"


def test_sigint_ends_a_watch_and_the_exit_code_is_that_of_its_frames(service, start):
    watch = start("watch", "--service", service)
    with linkwatch.Client(service, counts=[-4, -4], lockstep=True) as sim:
        assert sim.wait_for_watcher(PATIENCE)
        sim.begin()[:] = np.concatenate([RING, OTHER])
        sim.publish()
        assert sim.wait(PATIENCE).intact
        watch.signal(signal.SIGINT)
        code, out, err = watch.end()
    assert code == 0, err
    assert "stopped by a signal" in err
    assert "Traceback" not in err
    assert "1 frame verified" in out


def test_sigterm_ends_a_watch_without_a_simulator(service, start):
    watch = start("watch", "--service", service)
    until("the watch", lambda: "waiting for a simulator" in watch.err.read_text())
    watch.signal(signal.SIGTERM)
    code, _, err = watch.end()
    assert code == 3, err
    assert "stopped by a signal" in err


def test_sigint_kills_a_command_that_does_not_handle_it(start, tmp_path):
    pipe = tmp_path / "certificate"
    os.mkfifo(pipe)
    # Blocks until somebody writes a certificate to the pipe.
    check = start("check", "torus_link", "--baseline", pipe)
    until("the command", lambda: "waiting for its writer" in check.err.read_text())
    check.signal(signal.SIGINT)
    code, _, err = check.end()
    assert code == -signal.SIGINT, err
    assert "Traceback" not in err
