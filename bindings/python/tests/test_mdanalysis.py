"""`linkwatch.mdanalysis.LinkAnalysis`: its backends find what `linkwatch.check` finds."""

import pickle
import random
import re

import linkwatch
import numpy as np
import pytest
from test_linkwatch import chain, linked
from test_run import tables

MDAnalysis = pytest.importorskip("MDAnalysis")


def universe(frames, dimensions=None):
    """Returns a universe of rings, of frames of lists of rings."""
    sizes = [len(ring) for ring in frames[0]]
    made = MDAnalysis.Universe.empty(sum(sizes), trajectory=True)
    points = np.stack([np.concatenate(frame) for frame in frames])
    made.load_new(points.astype("f4"), order="fac", dimensions=dimensions)
    starts = np.cumsum([0, *sizes])
    bonds = [(a + i, a + (i + 1) % n) for a, n in zip(starts, sizes) for i in range(n)]
    made.add_TopologyAttr("bonds", bonds)
    return made


def random_universe(rng):
    """Rings that move through one another, that touch, jump through the cell, or are rejected."""
    rings, frames = chain(rng.randint(2, 5), points=8), []
    kind = rng.choice(["plain", "cell", "broken", "touching"])
    move = np.zeros((len(rings), 3))
    for _ in range(rng.randint(1, 30)):
        move += [[rng.gauss(0, 0.12) for _ in range(3)] for _ in rings]
        curves = [ring + by for ring, by in zip(rings, move)]
        if kind == "cell":
            curves[0] = curves[0] + [20 * rng.choice([0, 0, 0, 1]), 0, 0]
        if kind == "touching" and rng.random() < 0.2:
            curves[-1] = curves[-1] + curves[0][0] - curves[-1][0]
        if kind == "broken" and rng.random() < 0.2:
            curves[0] = np.full_like(curves[0], np.nan)
        frames.append(curves)
    if kind == "broken":
        frames[0] = rings
    return universe(frames, [20, 20, 20, 90, 90, 90] if kind == "cell" else None)


@pytest.mark.parametrize("seed", range(40))
def test_parts_find_what_a_whole_run_finds(seed):
    rng = random.Random(seed)
    made = random_universe(rng)
    options = {"events": rng.choice(["between", "all", "off"])}
    if rng.random() < 0.3:
        options["radius"] = 0.05
    if made.dimensions is not None:
        options["wrapped"] = rng.choice([None, True, False])
    step = rng.choice([1, 1, 2])
    frames = linkwatch.io.from_mdanalysis(made, trajectory=made.trajectory[::step])
    alone = linkwatch.check(frames, **options)
    for parts in (1, 2, rng.randint(1, len(frames)), len(frames)):
        analysis = linkwatch.mdanalysis.LinkAnalysis(made, **options)
        found = analysis.run(step=step, n_parts=min(parts, len(frames))).results.run
        # In a cell, coordinates in texts may be rounded to other digits.
        rounded = [re.sub(r"\.\d+", "", str(run)) for run in (found, alone)]
        assert rounded[0] == rounded[1]
        assert {**tables(found), "summary": ""} == {**tables(alone), "summary": ""}
        assert analysis.frames.tolist() == [row["frame"] for row in alone.frames]


@pytest.mark.parametrize("backend", ["multiprocessing", "dask"])
def test_the_result_of_a_backend_is_that_of_one_process(backend):
    if backend == "dask":
        pytest.importorskip("dask")
    made = universe([linked(0.07 * k) for k in range(40)])
    alone = linkwatch.mdanalysis.LinkAnalysis(made).run()
    found = linkwatch.mdanalysis.LinkAnalysis(made).run(backend=backend, n_workers=2, n_parts=3)
    assert tables(found.results.run) == tables(alone.results.run) == tables(linkwatch.check(made))
    assert found.results.run.changes[0]["frame"] == 15
    assert (found.times == alone.times).all() and len(found.frames) == 40


def test_frames_are_chosen_as_in_other_analyses(capsys):
    made = universe([linked(0.4 * k) for k in range(6)])
    assert pickle.loads(pickle.dumps(linkwatch.mdanalysis.LinkAnalysis(made).run())).n_frames == 6
    analysis = linkwatch.mdanalysis.LinkAnalysis(made.atoms, events="off", verbose=True)
    assert analysis.run(stop=3).results.run and "3/3" in capsys.readouterr().err
    assert analysis.run(frames=[0, 4], verbose=False).results.run.changes[0]["frame"] == 4
    assert analysis.run(frames=np.arange(6) > 3).results.run.frames[0]["frame"] == 4
    assert analysis.run(stop=0).results.run.verdict == "incomplete" and len(analysis.frames) == 0
    with pytest.raises(TypeError, match="threshold"):
        linkwatch.mdanalysis.LinkAnalysis(made, threshold=1)


def test_an_option_that_fails_says_why():
    """Regression test: the message was about an attribute of None."""
    made = universe([linked(0.1 * k) for k in range(3)])
    for option in ({"events": "x"}, {"radius": -1}, {"invariants": "x"}):
        with pytest.raises(ValueError) as why:
            linkwatch.check(made, **option)
        with pytest.raises(ValueError, match=re.escape(str(why.value))):
            linkwatch.mdanalysis.LinkAnalysis(made, **option).run()
