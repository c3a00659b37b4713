"""Curves of a live simulation that have names, and that come and go."""

import gc

import linkwatch
import numpy as np
import pytest
from conftest import PATIENCE

SQUARE = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float32)
OTHER = np.array([[0, 0, -1], [2, 0, -1], [2, 0, 1], [0, 0, 1]], np.float32)
APART = SQUARE + np.float32([20, 0, 0])


def publish(sim, *curves):
    sim.begin()[:] = np.concatenate(curves)
    sim.publish()
    verdict = sim.wait(PATIENCE)
    assert verdict is not None, sim.no_verdict
    return verdict


def test_curves_that_come_and_go_are_compared_by_name(service, start):
    watch = start("watch", "--service", service, "--events")
    counts, names = [-4, -4], ["left", "right"]
    with linkwatch.Client(
        service, counts=counts, names=names, radii=[0.1, 0.1], time_step=1e-3, lockstep=True
    ) as sim:
        assert sim.wait_for_watcher(PATIENCE)
        assert publish(sim, SQUARE, OTHER).intact
        sim.describe([-4] * 3, names=["left", "new", "right"])
        verdict = publish(sim, SQUARE, APART, OTHER)
        assert (verdict.verdict, verdict.appeared, verdict.gone) == ("intact", 1, 0)
        assert verdict.rejected is None
        assert "curves appeared: new" in str(verdict)
        sim.describe([-4] * 2, names=["right", "left"])
        verdict = publish(sim, OTHER + np.float32([5, 0, 0]), SQUARE)
        assert (verdict.verdict, verdict.appeared, verdict.gone) == ("changed", 0, 1)
        assert "curves 0 (right) and 1 (left) came apart" in str(verdict)
        assert (verdict.first.i, verdict.first.j) == (0, 1)
        with pytest.raises(ConnectionError, match="without names"):
            sim.describe([-4], names=[])
        with pytest.raises(ValueError, match="which is that of curve 0"):
            sim.describe([-4] * 2, names=["a", "a"])
        with pytest.raises(ValueError, match="radius -1"):
            sim.describe([-4] * 2, names=["a", "b"], radii=[1, -1])
    code, out, err = watch.end()
    assert code == 1, err
    assert "curves 0 (right) and 1 (left) came apart" in out


def test_views_of_frames_of_earlier_curves_stay_valid(service):
    views = []
    with linkwatch.Client(service, counts=[-4], names=["0"]) as sim:
        for n in range(1, 5):
            view = sim.begin()
            view[:] = n
            sim.publish()
            views.append(view)
            # Ten times as many points: the memory of earlier frames would be unmapped.
            sim.describe([-4 * 10**n], names=[str(n)])
        with pytest.raises(ValueError, match="arrays of earlier frames"):
            for n in range(20):
                views.append(sim.begin())
                sim.publish()
                sim.describe([-4], names=[str(n)])
    gc.collect()
    assert [view[0, 0] for view in views[:4]] == [1, 2, 3, 4]
    assert [view[-1, 2] for view in views[:4]] == [1, 2, 3, 4]
