"""Simulators and watchers that are killed, interrupted and restarted, as separate processes."""

import json
import signal
import sys
import threading
import time

import linkwatch
import numpy as np
import pytest
from conftest import PATIENCE, until

RING = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float32)
OTHER = np.array([[0, 0, -1], [2, 0, -1], [2, 0, 1], [0, 0, 1]], np.float32)

# Publishes intact frames until it is killed.
SIMULATOR = """
import json, sys, time, linkwatch
with linkwatch.Client(sys.argv[1], counts=[-4, -4]) as sim:
    sim.wait_for_watcher(float(sys.argv[2]))
    while True:
        sim.begin()[:] = json.loads(sys.argv[3])
        sim.publish()
        time.sleep(0.002)
"""


def squares(shift=0.0):
    """Two squares, linked up to a shift of 1, touching at 1."""
    return np.concatenate([RING, OTHER + np.float32([shift, 0, 0])])


def lockstep(service, counts=(-4, -4)):
    sim = linkwatch.Client(service, counts=counts, lockstep=True)
    assert sim.wait_for_watcher(PATIENCE)
    return sim


def publish(sim, shift=0.0):
    sim.begin()[:] = squares(shift)
    return sim.publish()


def step(sim, shift=0.0):
    """Publishes a frame, and returns the verdict on it."""
    publish(sim, shift)
    verdict = sim.wait(PATIENCE)
    assert verdict is not None, sim.no_verdict
    assert sim.no_verdict is None
    return verdict


def finish(sim, watch):
    """Ends the session. Returns the last message, and the exit code and stdout of the watch."""
    last = sim.finish(PATIENCE)
    code, out, err = watch.end()
    assert last is not None, err
    return last, code, out


# Regression test: the call waited until its time limit.
def test_a_wait_for_an_earlier_frame_ends_at_once(service, start):
    watch = start("watch", "--service", service)
    with lockstep(service) as sim:
        for _ in range(3):
            assert step(sim).intact
        begin = time.monotonic()
        assert sim.wait(PATIENCE, 0) is None
        assert time.monotonic() - begin < PATIENCE / 2
        why = "no verdict on frame 0: the watcher skipped it, or answered a later frame before"
        assert sim.no_verdict == why
        finish(sim, watch)


def test_a_watcher_killed_during_a_lockstep_wait_ends_the_wait(service, start):
    watch = start("watch", "--service", service)
    with lockstep(service) as sim:
        assert step(sim).intact
        watch.stop()
        seq = publish(sim)
        killer = threading.Timer(0.3, watch.kill)
        killer.start()
        assert sim.wait(PATIENCE) is None
        killer.join()
        died = "no verdict on frame {}: the watcher died without a goodbye"
        assert sim.no_verdict == died.format(seq)
        # The next frames do not wait for a dead watcher, and do not count as intact.
        for _ in range(3):
            seq = publish(sim)
            assert sim.wait(PATIENCE) is None
            assert sim.no_verdict == died.format(seq)
        assert sim.silent_for is None
        # Another watcher takes over, with the next frame as its baseline.
        watch = start("watch", "--service", service)
        assert sim.wait_for_watcher(PATIENCE)
        assert step(sim).intact
        last, code, _ = finish(sim, watch)
    assert code == 0
    assert "linkwatch is done with this session" in str(last)


def test_a_watcher_that_is_interrupted_says_goodbye(service, start):
    watch = start("watch", "--service", service)
    with lockstep(service) as sim:
        for _ in range(3):
            assert step(sim).intact
        watch.signal(signal.SIGINT)
        code, out, err = watch.end()
        assert code == 0, err
        assert "stopped by a signal" in err
        assert "3 frames verified" in out
        for _ in range(3):
            seq = publish(sim)
            assert sim.wait(PATIENCE) is None
            assert sim.no_verdict == f"no verdict on frame {seq}: the watcher said goodbye"
        assert sim.silent_for is None
        assert sim.finish(PATIENCE) is None


def test_an_interrupt_during_a_long_check_frees_a_simulator_in_lockstep(service, start):
    watch = start("watch", "--service", service)
    points = 400 * 1000
    with lockstep(service, [-1000] * 400) as sim:
        # Curves that pass through one another everywhere, which take minutes to verify.
        sim.begin()[:] = np.random.default_rng(1).random((points, 3))
        sim.publish()
        interrupt = threading.Timer(1, watch.signal, [signal.SIGINT])
        interrupt.start()
        assert sim.wait(PATIENCE) is None
        assert sim.no_verdict == "no verdict on frame 0: the watcher said goodbye"
    code, out, err = watch.end()
    assert code == 3, err
    assert "stopped by a signal" in err
    assert "0 frames verified" in out


def test_a_killed_simulator_ends_the_watch_and_frees_the_name(service, start):
    watch = start("watch", "--service", service, "--json")
    square = json.dumps(squares().tolist())
    code = ("-c", SIMULATOR, service, PATIENCE, square)
    simulator = start(*code, program=(sys.executable,))
    until("20 frames", lambda: watch.out.read_text().count("\n") >= 20)
    with pytest.raises(ConnectionError, match="already has a simulator") as refused:
        linkwatch.Client(service, counts=[-4, -4])
    assert f'service "{service}" already has' in str(refused.value)
    assert f"process {simulator.process.pid}, " in str(refused.value)
    assert "another service name" in str(refused.value)
    simulator.kill()
    code, out, err = watch.end()
    assert code == 3, err
    assert "the simulator died without ending the session" in err
    assert json.loads(out.splitlines()[-1])["summary"]["verified"] >= 20

    watch = start("watch", "--service", service)
    with lockstep(service) as sim:
        assert step(sim).intact
        assert finish(sim, watch)[1] == 0


def test_a_second_watcher_is_refused(service, start):
    watch = start("watch", "--service", service)
    with lockstep(service) as sim:
        code, _, err = start("watch", "--service", service).end()
        assert code == 2, err
        assert f'service "{service}" is already watched' in err
        assert step(sim).intact
        assert finish(sim, watch)[1] == 0


def test_a_frame_with_nan_is_rejected_with_its_curve_and_point(service, start):
    watch = start("watch", "--service", service)
    with lockstep(service) as sim:
        assert step(sim).intact
        verdict = step(sim, np.nan)
        assert (verdict.verdict, verdict.intact, verdict.abort) == ("rejected", False, True)
        assert verdict.rejected == "curve 1, point 0: coordinate x is NaN"
        assert (verdict.last_intact, verdict.safe_fraction) == (0, None)
        assert str(sim.aborted) == (
            "frame 1: rejected: curve 1, point 0: coordinate x is NaN. "
            "Stop or roll back: frame 0 is intact"
        )
        sim.resume()
        assert step(sim).intact
        assert sim.aborted is None
        last, code, out = finish(sim, watch)
    assert code == 0
    assert (last.abort, last.recovered) == (False, 1)
    assert "recovered: 2 frames verified, 0 skipped, 1 rejected" in out


@pytest.mark.parametrize("resumes", [True, False])
def test_a_pull_through_is_aborted_once_if_the_simulator_rolls_back(service, start, resumes):
    watch = start("watch", "--service", service, "--events", "--motion-limit", "5")
    aborts = []
    with lockstep(service) as sim:
        # One square passes through the other one, which no linking number detects.
        for shift in (3, 3, 3.001, -5, 3, 3.001, 2.9):
            verdict = step(sim, shift)
            if verdict.verdict == "changed":
                aborts.append(verdict.seq)
                assert verdict.abort and verdict.first.sign in (1, -1)
                assert str(verdict).startswith(
                    f"frame {verdict.seq}: changed, 4 pull-throughs: curves 0 and 1 passed through"
                )
                assert sim.aborted.seq == (verdict.seq if resumes else 3)
                if verdict.seq == 3:
                    assert verdict.last_intact == 2
                    assert 0 < verdict.safe_fraction < 1
                if resumes:
                    sim.resume()
                    assert sim.aborted is None
        last, code, out = finish(sim, watch)
    # Without `resume`, the way back is a pull-through as well.
    assert aborts == ([3] if resumes else [3, 4])
    assert code == (0 if resumes else 1)
    assert "7 frames verified, 0 skipped, 0 rejected" in str(last)
    assert (last.abort, last.recovered) == (not resumes, int(resumes))
    if resumes:
        assert "recovered: 1 violation was rolled back" in str(last)
    else:
        assert "frame 4: changed, 4 pull-throughs" in str(last)
    assert "first violation: frame 3" in out


def test_an_accepted_state_is_the_new_baseline(service, start):
    watch = start("watch", "--service", service)
    with lockstep(service) as sim:
        assert step(sim, 0).intact
        verdict = step(sim, 2.5)
        assert (verdict.verdict, verdict.findings) == ("changed", 2)
        sim.accept()
        assert sim.aborted is None
        assert step(sim, 2.5).intact
        assert step(sim, 0).verdict == "changed"
        _, code, out = finish(sim, watch)
    assert code == 1
    assert "the baseline is frame 2, accepted by the simulator" in out


def test_a_jump_after_a_cut_is_not_a_pull_through(service, start):
    watch = start("watch", "--service", service, "--events", "--motion-limit", "5")
    with lockstep(service) as sim:
        assert step(sim, 3).intact
        sim.cut()
        assert step(sim, -5).intact
        assert sim.aborted is None
        last, code, out = finish(sim, watch)
    assert code == 0
    assert not last.abort
    assert "intact: 2 frames verified" in out
