"""Children that are forked from a process that used linkwatch."""

import multiprocessing
import os
import signal
import threading
import time

import linkwatch
import numpy as np
import pytest
from conftest import PATIENCE
from test_linkwatch import chain, linked

pytestmark = pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")


def child(work):
    """Runs a function in a forked child. Returns its exit code."""
    pid = os.fork()
    if pid == 0:
        code = 1
        try:
            work()
            code = 0
        finally:
            os._exit(code)
    start = time.monotonic()
    while not (ended := os.waitpid(pid, os.WNOHANG))[0]:
        if time.monotonic() - start > PATIENCE:
            os.kill(pid, signal.SIGKILL)
            os.waitpid(pid, 0)
            raise AssertionError("the child hangs")
        time.sleep(0.005)
    return os.waitstatus_to_exitcode(ended[1])


def refused(call):
    with pytest.raises(RuntimeError, match="this process was forked from process"):
        call()


def test_a_child_of_a_process_that_used_the_threads_gets_an_error_and_does_not_hang():
    session = linkwatch.Session()
    large = chain(400, points=40)
    assert session.step(large).intact

    def work():
        refused(lambda: session.step(large))
        refused(session.cut)
        refused(linkwatch.Session)
        refused(lambda: linkwatch.certify(large))
        refused(lambda: linkwatch.certify(linked(), cell=[9, 9, 9]))
        refused(lambda: linkwatch.pull_throughs(linked(), linked(4.0)))
        refused(lambda: linkwatch.thickness(large))
        refused(lambda: linkwatch.struts(large, 1.0))
        refused(lambda: linkwatch.ribbon(linked()))

    assert child(work) == 0
    assert session.step(large).intact


def test_a_child_that_is_forked_during_a_step_gets_an_error():
    session = linkwatch.Session()
    large = chain(400, points=40)
    done = threading.Event()

    def verify():
        while not done.is_set():
            session.step(large)

    thread = threading.Thread(target=verify)
    thread.start()
    try:
        for _ in range(20):
            assert child(lambda: refused(lambda: session.step(large))) == 0
    finally:
        done.set()
        thread.join()


def test_a_child_of_a_process_that_only_imported_the_package_verifies():
    code = (
        "import os, linkwatch\n"
        "pid = os.fork()\n"
        "if pid == 0:\n"
        "    ring = [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]\n"
        "    linkwatch.certify([ring])\n"
        "    os._exit(0)\n"
        "raise SystemExit(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]))\n"
    )
    import subprocess
    import sys

    assert subprocess.run([sys.executable, "-c", code], timeout=PATIENCE).returncode == 0


def use(sim):
    for call in (
        sim.begin,
        sim.publish,
        sim.poll,
        sim.wait,
        sim.wait_for_watcher,
        sim.cut,
        sim.finish,
        lambda: sim.aborted,
        lambda: sim.silent_for,
        lambda: sim.describe([-4], names=["a"]),
    ):
        refused(call)


@pytest.mark.parametrize("how", ["exits", "uses", "drops", "multiprocessing"])
def test_a_child_leaves_the_session_of_its_parent_alone(service, start, how):
    watch = start("watch", "--service", service)
    sims = [linkwatch.Client(service, counts=[-4, -4], lockstep=True)]
    sim = sims[0]
    assert sim.wait_for_watcher(PATIENCE)
    views = [sim.begin()]

    def work():
        if how == "uses":
            use(sims[0])
        if how == "drops":
            # The references of the enclosing function are those of the parent.
            sims.clear()
            views.clear()
            nonlocal sim
            del sim

    if how == "multiprocessing":
        process = multiprocessing.get_context("fork").Process(target=use, args=(sim,))
        process.start()
        process.join(PATIENCE)
        assert process.exitcode == 0
    else:
        assert child(work) == 0
    for _ in range(3):
        sim.begin()[:] = np.concatenate(linked())
        sim.publish()
        assert sim.wait(PATIENCE).intact
    last = sim.finish(PATIENCE)
    assert "3 frames verified" in str(last)
    code, out, err = watch.end()
    assert code == 0, err
