"""Runs on many workers have the results of a run on one worker."""

import os
import random
import re
import signal
import threading
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context

import linkwatch
import numpy as np
import pytest
from conftest import PATIENCE
from linkwatch.io import Frame
from test_linkwatch import chain, linked
from test_run import BROKEN, tables


def random_run(rng, frames):
    """Rings that move through one another, touch, are rejected, and that come and go."""
    rings = chain(rng.randint(2, 5), points=8)
    names = [f"ring {k}" for k in range(len(rings))]
    kind = rng.choice(["plain", "cell", "broken", "coming", "touching"])
    move = np.zeros((len(rings), 3))
    for k in range(frames):
        move += [[rng.gauss(0, 0.12) for _ in range(3)] for _ in rings]
        chosen = range(len(rings))
        if kind == "coming" and rng.random() < 0.2:
            chosen = rng.sample(chosen, rng.randint(1, len(rings)))
        curves = [rings[i] + move[i] for i in chosen]
        cell = None
        if kind == "cell":
            cell = np.vstack([np.diag([9.0, 9.0, 9.0]), np.zeros(3)])
            curves[0] = curves[0] + [9 * rng.choice([0, 0, 0, 1]), 0, 0]
        if kind == "touching" and rng.random() < 0.2:
            curves[-1] = curves[-1] + curves[0][0] - curves[-1][0]
        counts = [-len(curve) for curve in curves]
        if kind == "cell":
            # A yarn that runs through the cell.
            curves.append(np.array([[0, 0, 0], [4, 0.5, 0], [9, 0, 0]]) + move[-1])
            counts.append(3)
        points = np.concatenate(curves)
        if kind == "broken" and rng.random() < 0.2:
            points[0] = np.nan
        labels = [names[i] for i in chosen] + ["yarn"] * (kind == "cell")
        yield Frame(points, counts, names=labels, cell=cell, seq=2 * k)


@pytest.mark.parametrize("seed", range(60))
def test_the_run_of_many_workers_is_that_of_one(seed):
    rng = random.Random(seed)
    frames = list(random_run(rng, rng.randint(1, 30)))
    options = {"events": rng.choice(["between", "all", "off"])}
    if rng.random() < 0.3:
        options["radius"] = 0.05
    if frames[0].cell is not None:
        options["wrapped"] = rng.choice([None, True, False])
    alone = linkwatch.check(frames, **options)
    with ThreadPoolExecutor(2) as client:
        for chunk in (1, rng.randint(2, 9), None):
            found = linkwatch.check(frames, client=client, chunk=chunk, **options)
            # In a cell, coordinates in texts may be rounded to other digits.
            rounded = [re.sub(r"\.\d+", "", str(run)) for run in (found, alone)]
            assert rounded[0] == rounded[1]
            assert {**tables(found), "summary": ""} == {**tables(alone), "summary": ""}


def test_an_open_curve_after_a_rejected_frame_is_rejected():
    """Regression test: a chunk that began with the open curve raised an error."""
    both, nothing = np.concatenate(linked()), np.full((8, 3), np.nan)
    given = [(nothing, [-4, -4]), (both, [-4, -4]), (both[:4], [4]), (both, [-4, -4])]
    frames = [Frame(*one, seq=k) for k, one in enumerate(given)]
    alone = linkwatch.check(frames, events="off")
    assert [row["verdict"] for row in alone.frames] == ["rejected", "intact"] * 2
    with ThreadPoolExecutor(2) as client:
        run = linkwatch.check(frames, events="off", client=client, chunk=1)
        assert tables(run) == tables(alone)
        with pytest.raises(ValueError, match="none of 1 curves is closed"):
            linkwatch.check(frames[2:3] * 2, events="off", client=client, chunk=1)


def test_chunks_are_verified_again_only_if_they_have_to(monkeypatch):
    from linkwatch import distributed

    calls = []
    verify = distributed._verify

    def counted(part, options, state, assumed):
        calls.append(state is not None and not assumed)
        return verify(part, options, state, assumed)

    monkeypatch.setattr(distributed, "_verify", counted)
    cell = np.vstack([np.diag([9.0, 9.0, 9.0]), np.zeros(3)])

    def frames(cell, jump):
        for k in range(40):
            move = [[0.3 * k + 9 * (jump and k > 10), 0, 0], [0.3 * k, 0, 3 * (k > 20)]]
            points = np.concatenate([a + b for a, b in zip(linked(), move)])
            yield Frame(points, [-4, -4], cell=cell, seq=k)

    with ThreadPoolExecutor(2) as client:
        for given, again in (((None, False), 0), ((cell, False), 0), ((cell, True), 2)):
            calls.clear()
            run = linkwatch.check(frames(*given), client=client, chunk=10)
            assert run.verdict == "changed" and run.frames[21]["pull_throughs"]
            assert (len(calls) - sum(calls), sum(calls)) == (4, again)


def saved(path, frames):
    """Saves a run of squares, and returns the path."""
    points = np.stack([np.concatenate(linked(x)) for x in frames])
    np.savez(path, positions=points, counts=[-4, -4])
    return path


def test_processes_read_files_by_themselves(tmp_path):
    paths = [
        saved(tmp_path / "intact.npz", [0.01 * k for k in range(60)]),
        saved(tmp_path / "broken.npz", [0.1 * k for k in range(60)]),
    ]
    alone = [linkwatch.check(path) for path in paths]
    assert [run.verdict for run in alone] == ["intact", "changed"]
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as client:
        found = linkwatch.check(paths[1], client=client, chunk=7)
        assert tables(found) == tables(alone[1])
        many = linkwatch.distributed.check_many(paths, client)
        assert list(map(tables, many)) == list(map(tables, alone))
        many[1].report(tmp_path / "broken.html")
        with pytest.raises(FileNotFoundError):
            linkwatch.distributed.check_many([tmp_path / "none.npz"], client)
    with ThreadPoolExecutor(1) as client:
        with pytest.raises(ValueError, match="chunk is 0"):
            linkwatch.check(BROKEN, client=client, chunk=0)
        assert tables(linkwatch.check([], client=client)) == tables(linkwatch.check([]))


def test_atoms_are_read_by_the_workers():
    mda = pytest.importorskip("MDAnalysis")
    points = np.stack([np.concatenate(linked(0.05 * k)) for k in range(50)])
    universe = mda.Universe.empty(8, trajectory=True)
    universe.load_new(points.astype("f4"), order="fac")
    bonds = [(4 * k + i, 4 * k + (i + 1) % 4) for k in range(2) for i in range(4)]
    universe.add_TopologyAttr("bonds", bonds)
    frames = linkwatch.io.from_mdanalysis(universe)
    for start, stop in ((0, 3), (7, 9), (49, 50)):
        numbers = [frame.seq for frame in frames.part(start, stop)]
        assert numbers == list(range(start, stop))
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as client:
        found = linkwatch.check(universe, client=client, chunk=9)
    assert tables(found) == tables(linkwatch.check(universe))
    every = linkwatch.io.from_mdanalysis(universe, trajectory=universe.trajectory[::10])
    with ThreadPoolExecutor(2) as client:
        assert len(linkwatch.check(every, client=client, chunk=2).frames) == 5


def test_a_lost_worker_of_dask_costs_its_chunk_only(tmp_path):
    dask = pytest.importorskip("distributed")
    path = saved(tmp_path / "run.npz", [0.002 * k for k in range(1000)])
    alone = linkwatch.check(path)
    options = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": None}
    with dask.LocalCluster(**options) as cluster, dask.Client(cluster) as client:
        pids = client.run(os.getpid)
        killer = threading.Timer(0.3, lambda: os.kill(min(pids.values()), signal.SIGKILL))
        killer.start()
        found = linkwatch.check(path, client=client, chunk=10)
        killer.join(PATIENCE)
        assert tables(found) == tables(alone)
        assert set(client.run(os.getpid).values()) != set(pids.values())
        frames = [Frame(np.concatenate(linked(0.1 * k)), [-4, -4], seq=k) for k in range(30)]
        sent = linkwatch.check(frames, client=client, chunk=4)
        assert tables(sent) == tables(linkwatch.check(frames))


def test_other_curves_without_names_are_rejected_in_every_chunk():
    """Regression test: a resumed session took other curves for the same ones."""
    rings = chain(3, points=8)
    frames = [rings] * 6 + [[rings[0], rings[1][:7], rings[2]]] * 6
    alone = tables(linkwatch.check(frames, events="off"))
    assert alone["verdict"] == "incomplete"
    with ThreadPoolExecutor(2) as client:
        for chunk in (2, 3, 4):
            found = linkwatch.check(frames, events="off", client=client, chunk=chunk)
            assert tables(found) == alone, chunk


def test_chunks_of_single_precision_continue_after_a_jump_in_a_cell():
    """Regression test: every frame after the first chunk was rejected, and the change was lost."""
    ring = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    other = np.array([[0, 0, -1], [2, 0, -1], [2, 0, 1], [0, 0, 1]])
    cell = np.array([[10, 0, 0], [0, 10, 0], [0, 0, 10], [0, 0, 0.0]])
    for jump, wrapped in ((10, None), (0, True), (0, None)):
        curves = [(ring + [jump * (k > 1), 0, 0], other + [0.3 * k, 0, 0]) for k in range(8)]
        frames = [
            Frame(np.float32(np.concatenate(both)), [-4, -4], cell=cell, seq=k)
            for k, both in enumerate(curves)
        ]
        alone = linkwatch.check(frames, wrapped=wrapped)
        assert alone.verdict == "changed"
        with ThreadPoolExecutor(2) as client:
            for chunk in (1, 3):
                found = linkwatch.check(frames, wrapped=wrapped, client=client, chunk=chunk)
                assert found.frames == alone.frames


def test_a_file_that_was_written_again_is_read_again_by_the_same_workers(tmp_path):
    """Regression test: a worker kept the frames that it had read before."""
    path = tmp_path / "run.npz"
    verdicts = []
    with ThreadPoolExecutor(2) as client:
        for step in (0.01, 0.4):
            frames = [np.concatenate(linked(step * k)) for k in range(8)]
            np.savez(path, positions=np.array(frames), counts=[-4, -4])
            verdicts.append(linkwatch.check(path, client=client, chunk=2).verdict)
    assert verdicts == ["intact", "changed"]
