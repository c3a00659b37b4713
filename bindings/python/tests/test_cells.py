"""Periodic cells: in process, and live."""

import linkwatch
import numpy as np
import pytest
from conftest import PATIENCE

RING = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
OTHER = np.array([[-2, 0, -1], [0, 0, -1], [0, 0, 1], [-2, 0, 1]], float)


def across(edge, out=0.0):
    """Two squares that are linked across the boundary of a cell, up to a distance of 1."""
    return [RING, OTHER + [edge - out, 0, 0]]


def images(certificate):
    return [(i, j, image, abs(number)) for i, j, image, number in certificate.images]


@pytest.mark.parametrize(
    "cell",
    [
        [10, 10, 10],
        (10, 0, 0),
        np.array([10, 10, 0], np.float32),
        [10, 0, 0, 3, 10, 0, 0, 0, 12],
        np.diag([10.0, 10.0, 10.0]),
        [[10, 0, 0], [3, 10, 0], [0, 0, 12], [-5, -5, 0]],
        [10, 0, 0, 3, 10, 0, 0, 0, 12, -5, -5, 0],
    ],
)
def test_a_cell_is_given_in_each_form(cell):
    certificate = linkwatch.certify(across(10), cell=cell)
    assert certificate.links == []
    assert images(certificate) == [(0, 1, (-1, 0, 0), 1)]
    assert "1 pairs with periodic images" in repr(certificate)


def test_a_certificate_without_a_cell_has_no_images():
    assert linkwatch.certify(across(10)).images is None
    assert linkwatch.certify([RING, RING + 5], cell=[20, 20, 20]).images == []


@pytest.mark.parametrize(
    "cell, words",
    [
        ([10, 10], r"cell has the shape \(2,\)"),
        (np.zeros((2, 3)), r"cell has the shape \(2, 3\)"),
        (10, r"cell has the shape \(\)"),
        ([0, 0, 0], "no vector"),
        ([np.nan, 1, 1], "not finite"),
        (np.ones((3, 3)), "one plane"),
    ],
)
def test_a_cell_that_is_no_lattice_is_refused(service, cell, words):
    with pytest.raises(ValueError, match=words):
        linkwatch.certify(across(10), cell=cell)
    with pytest.raises(ValueError, match=words):
        linkwatch.Session(cell=cell)
    with pytest.raises(ValueError, match=words):
        linkwatch.Client(service, counts=[-4], cell=cell)
    with linkwatch.Client(service, counts=[-4]) as sim:
        sim.begin()[:] = RING
        with pytest.raises(ValueError, match=words):
            sim.publish(cell=cell)
        assert sim.publish(cell=[10, 10, 10]) == 0


def test_a_session_follows_a_cell_that_changes():
    session = linkwatch.Session(cell=[10, 10, 10])
    assert session.step(across(10)).intact
    assert images(session.baseline) == [(0, 1, (-1, 0, 0), 1)]
    assert session.step(across(10.4), cell=[10.4, 10, 10]).intact
    report = session.step(across(10.4, out=1.6))
    assert report.verdict == "changed"
    (change,) = report.changes
    assert (change.i, change.j, change.image, change.found) == (0, 1, (-1, 0, 0), 0)
    (passage,) = report.pull_throughs
    assert passage.image == (-1, 0, 0)
    assert "other vectors" in session.step(across(10), cell=[10, 10, 0]).rejected
    assert "other vectors" in session.step(across(10)).rejected  # the cell stays as it was given
    assert "more than half of its size" in session.step(across(10.4), cell=[2, 2, 2]).rejected
    with pytest.raises(ValueError, match="no vector"):
        session.step(across(10.4), cell=[0, 0, 0])
    session.cut()
    assert session.step(across(10.4), cell=[10.4, 10, 10]).intact


def test_wrapped_coordinates_are_unwrapped():
    session = linkwatch.Session(wrapped=True)
    for k, edge in enumerate((10, 10.2, 10.4)):
        cell = np.array([edge, 10, 10])
        wrapped = [np.mod(curve + [1.5 * k, 0, 0], cell) for curve in across(edge)]
        assert session.step(wrapped, cell=cell).intact
    lost = [np.mod(curve + [3, 0, 0], cell) for curve in across(edge, out=1.6)]
    report = session.step(lost)
    assert (report.verdict, len(report.pull_throughs)) == ("changed", 1)
    assert "need a periodic cell" in linkwatch.Session(wrapped=True).step(across(10)).rejected


def test_frames_with_and_without_a_cell_are_not_mixed():
    session = linkwatch.Session()
    assert session.step(across(10)).intact
    report = session.step(across(10), cell=[10, 10, 10])
    assert "the previous ones had none" in report.rejected


def test_pull_throughs_and_the_safe_fraction_include_images():
    frames = across(10), across(10, out=4)
    (passage,) = linkwatch.pull_throughs(*frames, cell=[10, 10, 10])
    assert (passage.i, passage.j, passage.image) == (0, 1, (-1, 0, 0))
    assert passage.fraction == pytest.approx(0.25, abs=1e-8)
    assert linkwatch.safe_fraction(*frames, cell=[10, 10, 10]) == pytest.approx(0.25, abs=1e-6)
    assert linkwatch.pull_throughs(*frames) == []


def test_a_live_cell_that_changes_is_verified_with_its_frames(service, start):
    watch = start("watch", "--service", service, "--events")
    with linkwatch.Client(service, counts=[-4, -4], cell=[10, 10, 10], lockstep=True) as sim:
        assert sim.wait_for_watcher(PATIENCE)

        def publish(edge, out, **cell):
            sim.begin()[:] = np.concatenate(across(edge, out))
            sim.publish(**cell)
            verdict = sim.wait(PATIENCE)
            assert verdict is not None, sim.no_verdict
            return verdict

        assert publish(10, 0).intact
        assert publish(10.4, 0, cell=[10.4, 10, 10]).intact
        assert publish(10.4, 0.2).intact
        verdict = publish(10.4, 1.6)
        assert (verdict.verdict, verdict.abort) == ("changed", True)
        first = verdict.first
        assert (first.i, first.j, first.image) == (0, 1, (-1, 0, 0))
        assert "image -1,0,0" in str(verdict)
        verdict = publish(10.4, 0, cell=[10.4, 10, 0])
        assert verdict.verdict == "rejected"
        assert "other vectors" in verdict.rejected
    code, out, err = watch.end()
    assert code == 1, err
    assert "image -1,0,0" in out


def test_thickness_and_struts_count_the_images():
    yarn = np.array([[0, 0, 0], [2, 0, 0]], float)
    cell = [2, 0.5, 3]
    found = linkwatch.thickness([yarn], closed=False, cell=cell)
    assert (found.poca.length, found.poca.image) == (0.5, (0, 1, 0))
    assert linkwatch.thickness([yarn], closed=False).poca is None
    shortest = linkwatch.struts([yarn], 0.6, closed=False, cell=cell)[0]
    assert shortest == found.poca and shortest.points[1][1] == 0.5
    with pytest.raises(ValueError, match="one plane"):
        linkwatch.thickness([yarn], closed=False, cell=np.ones((3, 3)))
    with pytest.raises(ValueError, match="too many periodic cells"):
        linkwatch.struts([yarn], np.inf, closed=False, cell=cell)


def test_clearance_counts_the_images():
    session = linkwatch.Session(radius=0.5, cell=[10, 10, 10])
    report = session.step([RING, RING + [7.5, 0, 0]])
    assert report.clearance.ratio == pytest.approx(0.5)
    assert (report.clearance.curves, report.clearance.image) == ((0, 1), (-1, 0, 0))
    assert "the image -1,0,0 of curve 1" in str(report.clearance)


def test_a_check_of_a_path_unwraps_it(tmp_path):
    """Regression test: files that the command reads were refused without the option `unwrap`."""
    frames = [
        linkwatch.io.Frame(
            np.mod(np.concatenate(across(10)) + [0.5 * k, 0, 0], 10),
            [-4, -4],
            cell=np.array([[10, 0, 0], [0, 10, 0], [0, 0, 10], [0, 0, 0.0]]),
            seq=k,
        )
        for k in range(6)
    ]
    (path,) = linkwatch.write(frames, tmp_path / "torn.npz")
    with pytest.raises(ValueError, match="torn") as error:
        linkwatch.check(path)
    # Regression test: the message named the option of `read`, which does not help here.
    assert "pass the option `wrapped`" in str(error.value)
    assert "`unwrap" not in str(error.value)
    assert linkwatch.check(path, wrapped=True).verdict == "intact"
