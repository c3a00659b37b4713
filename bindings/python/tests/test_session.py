"""Sessions in process: curves with names that come and go, cuts, baselines and radii."""

import subprocess
import sys
import warnings

import linkwatch
import numpy as np
import pytest
from conftest import PATIENCE

RING = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
OTHER = np.array([[0, 0, -1], [2, 0, -1], [2, 0, 1], [0, 0, 1]], float)
APART = RING + [20, 0, 0]


def out(distance):
    """The second square, which is linked with the first one up to a distance of 1."""
    return OTHER + [distance, 0, 0]


def links(session):
    return [(i, j) for i, j, _ in session.baseline.links]


@pytest.mark.parametrize("incremental", [False, True])
def test_curves_that_come_and_go_are_compared_by_name(incremental):
    session = linkwatch.Session(names=["left", "right"], incremental=incremental)
    first = session.step([RING, OTHER])
    assert first.intact and (first.appeared, first.gone) == ([], [])
    session.describe(names=["left", "new", "right"])
    report = session.step([RING, APART, OTHER])
    assert report.intact and (report.appeared, report.gone) == (["new"], [])
    assert "curves appeared: new" in str(report)
    assert links(session) == [(0, 2)]
    again = session.step([RING, APART, OTHER])
    assert again.intact and again.appeared == []
    session.describe(names=["right", "left"])
    report = session.step([out(5), RING])
    assert (report.verdict, report.appeared, report.gone) == ("changed", [], ["new"])
    sentence = "curves 0 (right) and 1 (left) came apart"
    assert sentence in str(report) and sentence in str(report.changes[0])
    (passage,) = report.pull_throughs
    assert "curves 0 (right) and 1 (left) passed through" in str(passage)
    assert sentence in report.findings[0]


def test_a_new_curve_is_expected_to_stay_as_it_is_in_its_first_frame():
    session = linkwatch.Session(names=["ring"])
    assert session.step([RING]).intact
    session.describe(names=["ring", "link"])
    assert session.step([RING, OTHER]).appeared == ["link"]
    assert links(session) == [(0, 1)]
    report = session.step([RING, out(4)])
    assert (report.verdict, len(report.pull_throughs)) == ("changed", 1)


def test_frames_of_one_array_are_described_by_counts():
    session = linkwatch.Session([-4, -4], names=["a", "b"])
    assert session.step(np.concatenate([RING, OTHER])).intact
    session.describe([4, -4, -4], names=["open", "b", "a"])
    report = session.step(np.concatenate([APART, OTHER, RING]))
    assert report.intact and report.appeared == ["open"]
    assert session.baseline.open == [0]
    session.describe(names=["open", "a", "b"])  # the counts stay
    assert session.step(np.concatenate([APART, RING, out(0.1)])).intact
    assert session.step(np.concatenate([APART, RING, out(2)])).verdict == "changed"


def test_curves_of_other_shapes_are_closed_as_described():
    session = linkwatch.Session(closed=False, names=["a"], events="off", baseline=None)
    session.describe(closed=[True, False], names=["a", "b"])
    with pytest.warns(linkwatch.UnverifiedWarning, match="1 of 2 curves is open"):
        assert session.step([RING, OTHER]).intact
    session.describe(closed=[False, True, True], names=["b", "c", "a"])
    with pytest.warns(linkwatch.UnverifiedWarning, match="1 of 3 curves is open"):
        assert session.step([OTHER, APART, RING]).appeared == ["c"]
    with pytest.raises(ValueError, match="closed has 3 values for 2 curves"):
        session.step([RING, OTHER])


def test_a_cut_is_not_searched_for_pull_throughs():
    session = linkwatch.Session(events="all")
    assert session.step([RING, OTHER]).intact
    assert session.step([RING, out(4)]).pull_throughs
    # The squares are linked again. After a cut, the step to this frame is not searched.
    session.cut()
    report = session.step([RING, OTHER])
    assert report.intact and report.pull_throughs == []
    session.cut()
    assert session.step([RING, OTHER * np.nan]).verdict == "rejected"
    # The cut is not lost with the frame that was rejected.
    report = session.step([RING, out(4)])
    assert (report.verdict, report.pull_throughs) == ("changed", [])
    assert report.safe_fraction is None


def test_an_accepted_frame_is_the_new_baseline():
    session = linkwatch.Session()
    assert session.step([RING, OTHER]).intact
    assert session.step([RING, out(4)]).verdict == "changed"
    session.accept()
    broken = [RING, out(4) + np.inf]
    assert session.step(broken).verdict == "rejected"
    assert links(session) == [(0, 1)]
    report = session.step([RING, out(4)])
    assert report.intact and report.pull_throughs == []
    assert links(session) == []
    assert session.step([RING, out(4.1)]).intact
    assert session.step([RING, OTHER]).verdict == "changed"
    # It may also have other curves, without names.
    session.describe()
    assert "have no names" in session.step([RING, OTHER, APART]).rejected
    session.accept()
    assert session.step([RING, OTHER, APART]).intact
    assert links(session) == [(0, 1)]


def test_a_given_baseline_is_replaced_by_an_accepted_one():
    session = linkwatch.Session(baseline=linkwatch.certify([RING, OTHER]))
    assert session.step([RING, out(4)]).verdict == "changed"
    session.accept()
    assert session.step([RING, out(4)]).intact
    with pytest.raises(ValueError, match="2 curves"):
        linkwatch.Session(baseline=session.baseline).step([RING])


def test_rejected_frames_change_no_other_report():
    def run(with_rejected):
        session = linkwatch.Session(names=["a", "b"], radius=0.1)
        reports = []
        for k, distance in enumerate((0, 0.2, 0.4, 2.0, 2.0, 0.1)):
            if k == 2:
                session.describe(names=["a", "c", "b"])
            if k == 4:
                session.accept()
            curves = [RING, APART, out(distance)] if k >= 2 else [RING, out(distance)]
            if with_rejected:
                broken = [curve * np.nan for curve in curves]
                for rejected in (broken, curves[:-1], [*curves, APART]):
                    assert session.step(rejected).verdict == "rejected"
            reports.append(session.step(curves))
        return reports

    for a, b in zip(run(False), run(True), strict=True):
        assert a.rejected is None
        for name in ("verdict", "appeared", "gone", "changes", "pull_throughs", "clearance"):
            assert getattr(a, name) == getattr(b, name), name


def test_radii_belong_to_the_curves_that_are_described():
    session = linkwatch.Session(names=["a", "b"], radius=[0.1, 0.3])
    assert session.step([RING, out(0.5)]).clearance.ratio == pytest.approx(0.5 / 0.4)
    with pytest.raises(ValueError, match="radius of each curve"):
        session.describe(names=["b", "a"])
    session.describe(names=["b", "a"], radii=[0.2, 0.2])
    assert session.step([out(0.6), RING]).clearance.ratio == pytest.approx(0.4 / 0.4)
    session.describe(names=["b", "a", "c"], radii=np.float32([0.25, 0.25, 0.25]))
    report = session.step([out(0.6), RING, APART])
    assert report.clearance.ratio == pytest.approx(0.4 / 0.5)
    assert report.appeared == ["c"]


def test_a_clearance_that_cannot_be_measured_is_a_warning_and_leaves_the_verdicts():
    session = linkwatch.Session(radius=0.1)
    assert session.step([RING, out(0.9)]).clearance.ratio == pytest.approx(0.1 / 0.2)
    with pytest.warns(linkwatch.UnverifiedWarning, match="not measured from frame 1 on"):
        assert session.step([RING + 1e31, APART]).verdict == "changed"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        report = session.step([RING, out(0.9)])  # says it once
        assert report.clearance is None and report.verdict != "rejected"
        session.accept()
        assert session.step([RING, out(0.9)]).clearance.ratio == pytest.approx(0.1 / 0.2)


@pytest.mark.parametrize(
    "options, describe, words",
    [
        ({}, {"names": ["a", "a"]}, "which is that of curve 0"),
        ({}, {"names": ["", "a"]}, "1 to 255 bytes"),
        ({}, {"names": ["a", "b"], "radii": [1, 1]}, "radii have no effect"),
        ({"radius": 0.1}, {"names": ["a", "b"], "radii": [1, 1]}, "radii have no effect"),
        ({"radius": [1, 1]}, {"names": ["a", "b"], "radii": [1, 0]}, "positive radius"),
        ({"radius": [1, 1]}, {"names": ["a", "b"], "radii": [1]}, "radii of curves"),
        ({"radius": [1, 1]}, {"names": ["a", "b"], "radii": [1, np.inf]}, "radius inf"),
    ],
)
def test_a_description_that_is_refused_leaves_the_other_one(options, describe, words):
    session = linkwatch.Session(names=["left", "right"], **options)
    assert session.step([RING, OTHER]).intact
    with pytest.raises(ValueError, match=words):
        session.describe(**describe)
    report = session.step([RING, out(4)])
    assert "curves 0 (left) and 1 (right)" in str(report)


def test_a_frame_of_other_curves_than_described_is_rejected():
    session = linkwatch.Session(names=["a", "b"])
    assert "names of curves: 3 promised, 2" in session.step([RING, OTHER, APART]).rejected
    assert session.step([RING, OTHER]).intact
    session.describe(names=["a"])
    assert "names of curves: 2 promised, 1" in session.step([RING, OTHER]).rejected
    report = session.step([RING])
    assert report.intact and report.gone == ["b"]
    assert report.seq == 3


def test_a_session_can_be_closed():
    with linkwatch.Session() as session:
        assert session.step([RING, OTHER]).intact
    for call in (lambda: session.step([RING, OTHER]), lambda: session.baseline, session.cut):
        with pytest.raises((RuntimeError, ValueError), match="the session is closed"):
            call()
    session.close()


INTERRUPTED = """
import os, signal, sys, threading, time
import linkwatch
import numpy as np

# Curves that pass through one another everywhere, which take minutes to verify.
tangle = np.random.default_rng(1).random((400 * 1000, 3))
counts = [-1000] * 400
ring = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]])
session = linkwatch.Session(names=["a", "b"])
assert session.step([ring, ring + [0, 0.5, 0.5]]).intact
session.describe(counts, names=[f"{k}" for k in range(400)])
for call in (
    lambda: linkwatch.certify(tangle, counts),
    lambda: linkwatch.Session(counts).step(tangle),
    lambda: session.step(tangle),
    lambda: linkwatch.check([tangle], counts=counts),
    lambda: linkwatch.thickness(tangle, counts),
    lambda: linkwatch.writhe([tangle[:100000]], counts=[-100000], tolerance=1e-12),
):
    begin = [time.monotonic()]
    def interrupt():
        begin[0] = time.monotonic()
        signal.raise_signal(signal.SIGINT)
    timer = threading.Timer(1, interrupt)
    timer.start()
    try:
        call()
    except KeyboardInterrupt:
        print(round(time.monotonic() - begin[0], 2))
    else:
        timer.cancel()
        print("ended")
session.describe([-4, -4], names=["b", "a"])
report = session.step(np.concatenate([ring + [0, 0.5, 0.5], ring]))
assert report.intact and report.seq == 1, report
os._exit(0)
"""


def test_ctrl_c_ends_a_long_call_and_changes_no_later_report():
    ended = subprocess.run(
        [sys.executable, "-c", INTERRUPTED], capture_output=True, text=True, timeout=2 * PATIENCE
    )
    assert ended.returncode == 0, ended.stderr
    times = ended.stdout.split()
    assert len(times) == 6, ended.stdout
    # A machine with other work needs more than the second.
    assert all(float(time) < 3 for time in times if time != "ended"), times
