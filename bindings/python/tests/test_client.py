"""The live client without a watcher. `test_processes.py` has one."""

import asyncio
import gc
import pathlib
import signal
import subprocess
import sys
import threading
import time

import linkwatch
import numpy as np
import pytest
from conftest import PATIENCE


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_frames_are_numbered_and_written_in_place(service, dtype):
    with linkwatch.Client(service, counts=[-5, 4], dtype=dtype) as sim:
        for k in range(100):
            points = sim.begin(0.1 * k)
            assert points.shape == (9, 3)
            assert points.dtype == np.dtype(dtype)
            assert points.ctypes.data % 64 == 0
            points[:] = k
            assert sim.publish() == k
            assert sim.poll() is None
            assert sim.aborted is None
            assert sim.silent_for is None


def test_a_published_view_is_read_only_and_outlives_the_client(service):
    sim = linkwatch.Client(service, counts=[-4])
    points = sim.begin()
    points[:] = 3
    part = points[1:]
    sim.publish()
    with pytest.raises(ValueError, match="read-only"):
        points[0] = 1
    assert sim.finish(0.0) is None
    del sim
    gc.collect()
    assert (points == 3).all()
    assert (part == 3).all()
    # The name is free, although the memory is still mapped.
    with linkwatch.Client(service, counts=[-4]) as again:
        again.begin()[:] = 1
        again.publish()


# Regression test: clients stayed attached to the service, and left folders behind.
@pytest.mark.parametrize(("keep", "count"), [("pass", 5), ("kept += [sim]", 30), ("view = x", 5)])
def test_ended_clients_leave_nothing_behind(service, keep, count):
    nodes = pathlib.Path("/tmp/iceoryx2/nodes")
    before = set(nodes.iterdir()) if nodes.exists() else set()
    program = f"""
import linkwatch
kept = []
for _ in range({count}):
    sim = linkwatch.Client({service!r}, counts=[-4])
    x = sim.begin()
    x[:] = 1
    sim.publish()
    sim.finish(0.0)
    {keep}
    del sim, x
"""
    process = subprocess.Popen([sys.executable, "-c", program])
    assert process.wait(PATIENCE) == 0
    # The lowest 32 bits of the number of a node are those of its process.
    left = [folder.name for folder in set(nodes.iterdir()) - before]
    assert process.pid not in {int(name) % 2**32 for name in left if name.isdigit()}


def test_a_discarded_view_is_read_only(service):
    with linkwatch.Client(service, counts=[-4]) as sim:
        first = sim.begin()
        second = sim.begin()
        with pytest.raises(ValueError, match="read-only"):
            first[0] = 1
        sim.finish(0.0)
        with pytest.raises(ValueError, match="read-only"):
            second[0] = 1


def test_another_thread_may_drop_the_last_view(service, recwarn):
    views = []
    with linkwatch.Client(service, counts=[-4]) as sim:
        views.append(sim.begin())
        views[0][:] = 1
        sim.publish()
    del sim
    thread = threading.Thread(target=views.clear)
    thread.start()
    thread.join()
    gc.collect()
    assert not views
    assert not recwarn.list


def test_memory_does_not_grow(service):
    with linkwatch.Client(service, counts=[-100] * 10) as sim:
        addresses = set()
        for k in range(1000):
            points = sim.begin(k)
            addresses.add(points.ctypes.data)
            points[:] = 0
            sim.publish()
        assert len(addresses) < 30


def test_a_second_simulator_on_one_name_is_refused(service):
    with linkwatch.Client(service, counts=[-4]):
        with pytest.raises(ConnectionError, match="another"):
            linkwatch.Client(service, counts=[-4])


def test_a_cell_of_a_notebook_can_be_run_again(service, monkeypatch):
    first = linkwatch.Client(service, counts=[-4])
    first.begin()[:] = 1
    monkeypatch.setattr("sys.ps1", ">>> ", raising=False)
    with linkwatch.Client(service, counts=[-5]) as again:
        again.begin()[:] = 1
        assert again.publish() == 0
        with pytest.raises(RuntimeError, match="the session has ended"):
            first.publish()


def test_ctrl_c_ends_a_finish(service):
    sim = linkwatch.Client(service, counts=[-4])
    start = time.monotonic()
    threading.Timer(0.2, signal.raise_signal, [signal.SIGINT]).start()
    with pytest.raises(KeyboardInterrupt):
        sim.finish(PATIENCE)
    assert time.monotonic() - start < 1.2


def test_bad_arguments_are_refused(service):
    with pytest.raises(ValueError, match="expected float32 or float64"):
        linkwatch.Client(service, counts=[-4], dtype="int32")
    with pytest.raises(ValueError, match='basis "spline"'):
        linkwatch.Client(service, counts=[-4], basis="spline")
    with pytest.raises(ValueError, match="wait_mode: expected sleep or spin"):
        linkwatch.Client(service, counts=[-4], wait_mode="nap")
    with pytest.raises(ValueError, match="curve 1"):
        linkwatch.Client(service, counts=[-4, 1])
    with linkwatch.Client(service, counts=[-4]) as sim:
        with pytest.raises(RuntimeError, match="no frame was begun"):
            sim.publish()
        with pytest.raises(RuntimeError, match="no frame was published"):
            sim.wait(0.1)
        for seq in (-1, 1 << 64):
            with pytest.raises(ValueError, match=f"seq is {seq}, expected the number of a publi"):
                sim.wait(0.1, seq)
        with pytest.raises(ValueError, match="a wait of -1 seconds"):
            sim.wait_for_watcher(-1)
        with pytest.raises(ValueError, match="broadcast"):
            sim.begin()[:] = np.zeros((5, 3))


def test_an_ended_session_says_so(service):
    with linkwatch.Client(service, counts=[-4]) as sim:
        sim.finish(0.0)
        for call in (sim.begin, sim.publish, sim.poll, sim.finish, sim.resume):
            with pytest.raises(RuntimeError, match="the session has ended"):
                call()
        assert sim.aborted is None


def test_waiting_ends_in_time_and_lets_other_threads_run(service):
    with linkwatch.Client(service, counts=[-4], lockstep=True) as sim:
        sim.begin()[:] = 0
        sim.publish()
        counted = []
        done = threading.Event()

        def count():
            while not done.is_set():
                counted.append(1)
                time.sleep(0.001)

        thread = threading.Thread(target=count)
        thread.start()
        start = time.monotonic()
        assert sim.wait(0.3) is None
        assert not sim.wait_for_watcher(0.2)
        took = time.monotonic() - start
        done.set()
        thread.join()
        assert 0.4 < took < 2
        assert len(counted) > 20


def test_other_threads_use_a_client_in_turns(service):
    with linkwatch.Client(service, counts=[-4]) as sim:
        failed = []

        def publish():
            try:
                for _ in range(50):
                    sim.poll()
                    assert sim.aborted is None and sim.silent_for is None
                    try:
                        sim.begin()[:] = 0
                        sim.publish()
                    except (RuntimeError, ValueError) as error:
                        # Another thread began a frame meanwhile.
                        assert "no frame was begun" in str(error) or "read-only" in str(error)
            except BaseException as error:
                failed.append(error)

        threads = [threading.Thread(target=publish) for _ in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert not failed
        # A thread that waits lets the other threads run.
        waiting = threading.Thread(target=sim.wait, args=(1.0,))
        waiting.start()
        start = time.monotonic()
        for _ in range(5):
            sim.begin()[:] = 0
            sim.publish()
        assert time.monotonic() - start < 0.9 and waiting.is_alive()
        waiting.join()


def test_another_thread_may_open_use_and_drop_a_client(service, recwarn):
    made = []
    thread = threading.Thread(target=lambda: made.append(linkwatch.Client(service, counts=[-4])))
    thread.start()
    thread.join()
    made[0].begin()[:] = 1
    assert made[0].publish() == 0
    thread = threading.Thread(target=made.clear)
    thread.start()
    thread.join()
    gc.collect()
    assert not recwarn.list
    with linkwatch.Client(service, counts=[-4]):
        pass


def test_asyncio_waits_for_a_verdict(service, start):
    watch = start("watch", "--service", service)

    async def simulate():
        with linkwatch.Client(service, counts=[-4], lockstep=True) as sim:
            assert await asyncio.to_thread(sim.wait_for_watcher, PATIENCE)
            sim.begin()[:] = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
            seq = sim.publish()
            verdict, other = await asyncio.gather(sim.verdict(seq, PATIENCE), asyncio.sleep(0, 1))
            assert verdict.intact and verdict.seq == seq and other == 1
            assert (await sim.verdict()).intact
            with pytest.raises(ValueError, match="frame 1 was not published"):
                await sim.verdict(seq + 1)
            return await asyncio.to_thread(sim.finish, PATIENCE)

    assert "1 frames verified" in str(asyncio.run(simulate()))
    assert watch.end()[0] == 0


def test_a_session_without_a_watcher_says_so(service):
    # Regression test: the example of the README printed "not verified: None".
    with linkwatch.Client(service, counts=[-3]) as sim:
        sim.begin(time=0.0)[:] = np.eye(3)
        sim.publish()
        assert sim.no_verdict is None
        assert sim.finish(0.1) is None
    assert sim.no_verdict == "no watcher answered"
