"""Quantities of all frames of a run."""

import warnings

import linkwatch
import numpy as np
import pytest
from linkwatch.io import Frame
from test_linkwatch import OTHER, RING, circle, linked
from test_results import ribbon

FRAMES = [linked(x) for x in (0, 0.5, 2)]


def test_linking_numbers_over_time():
    found = linkwatch.linking(FRAMES)
    assert found.shape == (3, 2, 2)
    assert found[:, 0, 1].tolist() == found[:, 1, 0].tolist() == [-1, -1, 0]
    assert linkwatch.linking(FRAMES, pairs=[(1, 0), (0, 1)]).tolist() == [[-1, -1]] * 2 + [[0, 0]]
    touching = linkwatch.linking([linked(), [RING, OTHER + [1, 0, 0]], linked(np.nan)])
    assert np.isnan(touching[:, 0, 1]).tolist() == [False, True, True]
    assert np.isnan(touching[:, 0, 0]).tolist() == [False, False, True]
    assert linkwatch.linking(FRAMES, pairs=[]).shape == (3, 0)
    assert linkwatch.linking(FRAMES, pairs=iter([(0, 1)])).shape == (3, 1)
    # Regression test: the integrals of other pairs were returned.
    for pairs in ([(0, 2)], [(0, -1)], [(1, 1)]):
        with pytest.raises(IndexError, match="expected two different curves of 0 to 1"):
            linkwatch.linking(FRAMES, pairs=pairs)
    for wrong in ((0, 1), [(0, 1, 1)], [("a", "b")]):
        with pytest.raises(TypeError, match="expected two different curves of 0 to 1"):
            linkwatch.linking(FRAMES, pairs=wrong)


@pytest.mark.parametrize("measure", [linkwatch.writhe, linkwatch.gauss_integrals])
def test_a_tolerance_is_above_0(measure):
    # Regression test: the result was NaN, as for curves that touch.
    for tolerance in (0, -1e-4, np.nan):
        with pytest.raises(ValueError, match="tolerance is .*, expected a number above 0"):
            measure(FRAMES, tolerance=tolerance)
    with pytest.raises(TypeError, match="tolerance is '1' .*, expected a number above 0"):
        measure(FRAMES, tolerance="1")


def test_quantities_are_read_from_files(tmp_path):
    path = tmp_path / "run.npz"
    points = np.stack([np.concatenate(frame) for frame in FRAMES])
    np.savez(path, positions=points, counts=[-4, -4])
    for given in (path, linkwatch.read(path), (Frame(p, [-4, -4]) for p in points)):
        assert linkwatch.linking(given, [(0, 1)])[:, 0].tolist() == [-1, -1, 0]
    assert linkwatch.linking(points, [(0, 1)], counts=[-4, -4])[:, 0].tolist() == [-1, -1, 0]
    assert linkwatch.thickness(path) == pytest.approx([1.0, 0.5, 1.0])
    one = [linkwatch.thickness(frame).thickness() for frame in FRAMES]
    assert linkwatch.thickness(linkwatch.read(path)).tolist() == one


def test_writhe_and_twist_of_a_ribbon():
    angle = 2 * np.pi * np.arange(200) / 200
    flat = circle(200, [0, 0, 0], [[3, 0, 0], [0, 3, 0]])
    # The edge goes around the axis k times.
    out = flat / 3
    up = np.array([0, 0, 1.0])

    def edge(k):
        turn = k * angle[:, None]
        return flat + 0.3 * (np.cos(turn) * out + np.sin(turn) * up)

    frames = [[flat, edge(k)] for k in (0, 1, 3)]
    options = {"pairing": "parallel", "axis": "first"}
    assert np.abs(linkwatch.twist(frames, **options)) == pytest.approx([0, 1, 3], abs=1e-2)
    found = linkwatch.writhe(frames)
    assert found.shape == (3, 2) and np.abs(found[:, 0]).max() < 1e-4
    exact = linkwatch.ribbon(frames[2], strands=(1, 0), **options)
    assert found[2, 1] == pytest.approx(exact.writhe, abs=1e-3)


def test_a_curve_that_only_the_default_closes_stays_open():
    """Regression test: such curves were closed by long segments, without a warning."""
    random = np.random.default_rng(2)
    chains = [np.cumsum(random.normal(size=(30, 3)) + [1.5, 0, 0], 0) for _ in range(2)]
    measures = [
        lambda **closed: linkwatch.writhe([chains] * 2, **closed),
        lambda **closed: linkwatch.gauss_integrals([chains], **closed),
        lambda **closed: linkwatch.thickness(chains, **closed).thickness(),
        lambda **closed: len(linkwatch.struts(chains, 0.5, **closed)),
        lambda **closed: len(linkwatch.diagram(chains, **closed)),
    ]
    for measure in measures:
        with pytest.warns(linkwatch.ClosingWarning, match="2 curves stay open") as said:
            found = measure()
        assert said[0].filename == __file__
        assert np.array_equal(found, measure(closed=False))


def test_a_curve_that_the_boundary_of_the_cell_may_tear_is_a_warning():
    """Regression test: the torn curve was measured without a warning."""
    angles = 2 * np.pi * np.arange(40) / 40
    ring = np.stack([np.cos(angles), np.sin(angles), 0 * angles], 1) + 5
    torn, cell = (ring + 4.5) % 10, [10, 10, 10]
    says = "more than half: unwrap coordinates that are wrapped"
    for certify in (linkwatch.certify, lambda curves, cell: linkwatch.linking([curves], cell=cell)):
        certify([ring], cell=cell)
        with pytest.raises(ValueError, match=says):
            certify([torn], cell=cell)
    for measure in (
        lambda curve: linkwatch.writhe([[curve]], cell=cell),
        lambda curve: linkwatch.gauss_integrals([[curve]], cell=cell, closed=True),
        lambda curve: linkwatch.thickness([curve], cell=cell),
        lambda curve: linkwatch.struts([curve], 0.5, cell=cell, closed=True),
    ):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            measure(ring)
        with pytest.warns(linkwatch.UnverifiedWarning, match=says) as said:
            measure(torn)
        assert said[0].filename == __file__


def test_subchains_do_not_depend_on_which_curves_are_closed():
    chain = [[k, (k * k) % 3, 0] for k in range(30)]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        linkwatch.gauss_integrals([[chain]], subchains=[(0, 1, 20)])


def test_gauss_integrals_of_parts_add_up_to_the_linking_number():
    rings = [circle(40, [0, 0, 0], [[1, 0, 0], [0, 1, 0]]),
             circle(40, [1, 0, 0], [[1, 0, 0], [0, 0, 1]])]
    whole = linkwatch.gauss_integrals([rings])
    assert whole.shape == (1, 2, 2) and np.allclose(whole[0], whole[0].T)
    assert abs(whole[0, 0, 1]) == pytest.approx(1, abs=1e-4)
    # A closed curve as an open one, whose last vertex is its first one again.
    again = [np.concatenate([ring, ring[:1]]) for ring in rings]
    parts = [(k, a, b) for k in (0, 1) for a, b in ((0, 13), (13, 25), (25, 40))]
    options = {"closed": False}
    found = linkwatch.gauss_integrals([again, again], parts, **options)
    assert found.shape == (2, 6, 6)
    assert found[1, :3, 3:].sum() == pytest.approx(whole[0, 0, 1], abs=1e-3)
    for wrong in ((2, 0, 3), (0, 3, 3), (0, 0, 41), (0, -1, 3)):
        with pytest.raises(ValueError, match="no subchain"):
            linkwatch.gauss_integrals([again], [wrong], **options)


def test_frames_without_an_answer_are_nan():
    broken = [[RING], [RING * np.nan], [RING]]
    assert np.isnan(linkwatch.writhe(broken)[:, 0]).tolist() == [False, True, False]
    assert len(linkwatch.writhe([])) == 0
    assert np.isnan(linkwatch.thickness(iter(broken))).tolist() == [False, True, False]
    with pytest.raises(ValueError, match="the number of curves changes"):
        linkwatch.writhe([[RING], linked()])
    with pytest.raises(ValueError, match="splines"):
        linkwatch.writhe([[RING]], basis="b-spline")


def test_a_torn_frame_is_nan_and_the_others_keep_their_values():
    """Regression test: a frame that was torn raised an error for the whole series."""
    whole = [RING, RING[:, [0, 2, 1]] + [1, 0, 0]]
    torn = [np.mod(curve, 10) for curve in whole]
    says = "2 frames have no value; frame 1: curve 0"
    with pytest.warns(linkwatch.UnverifiedWarning, match=says):
        found = linkwatch.linking([whole, torn, torn, whole], pairs=[(0, 1)], cell=[10, 10, 10])
    assert abs(found[0, 0]) == 1 and np.isnan(found[1:3]).all() and found[3] == found[0]
    with pytest.raises(ValueError, match="more than half"):
        linkwatch.linking([torn, whole], cell=[10, 10, 10])


def test_a_ribbon_is_measured_in_one_frame():
    assert ribbon().linking == 0


def test_strands_that_touch_have_no_twist():
    """Regression test: an arbitrary number was returned."""
    axis = circle(12, [0, 0, 0], [[1, 0, 0], [0, 1, 0]])
    touching = axis * 1.2
    touching[0] = axis[0]
    options = {"pairing": "parallel", "axis": "first"}
    assert np.isnan(linkwatch.twist([[axis, touching]], **options)).all()
    assert np.isfinite(linkwatch.twist([[axis, axis * 1.2]], **options)).all()
