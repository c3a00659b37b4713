"""Results as data: pickle, copies, dicts with the names of the page on JSON, short texts."""

import copy
import json
import math
import pathlib
import pickle
import re
import sys

import linkwatch
import numpy as np
import pytest
from test_command import run, write_bcc
from test_linkwatch import OTHER, RING, chain, linked

PAGE = pathlib.Path(__file__).parents[3] / "docs/reference/json.md"


def fields(name):
    """Returns the fields of an object on the page, without and with those that are optional."""
    table = re.search(rf"^\| \*\*{name}\*\* .*\n(?:\|  \|.*\n)*", PAGE.read_text(), re.M)[0]
    always, all_of_them = set(), set()
    for names, kind in re.findall(r"\| (`[^|]*) \| ([^|]*) \|", table):
        found = set(re.findall(r"`(\w+)`", names))
        all_of_them |= found
        always |= set() if "optional" in kind else found
    return always, all_of_them


def reports():
    session = linkwatch.Session(names=["left", "right"], radius=0.1)
    touching = [RING, OTHER + [1, 0, 0]]
    return [session.step(curves) for curves in (linked(), linked(0.9), linked(4), touching)]


def ribbon():
    angle = 2 * np.pi * np.arange(40) / 40
    axis = np.stack([5 * np.cos(angle), 5 * np.sin(angle), 0 * angle], axis=1)
    return linkwatch.ribbon([axis, axis + [0, 0, 0.3]])


def results():
    """Returns a result of each class, with the name of its object on the page."""
    _, near, changed, touching = reports()
    spline = linkwatch.thickness(chain(2), basis="catmull-rom")
    square = linkwatch.thickness(linked(0.5))
    found = linkwatch.certify([RING, OTHER + [1, 0, 0], RING + 5])
    return {
        "report": near,
        "report of a change": changed,
        "report of a contact": touching,
        "clearance": near.clearance,
        "change": changed.changes[0],
        "pull-through": changed.pull_throughs[0],
        "defect": touching.defects[0],
        "place": changed.changes[0].place,
        "strut": square.poca,
        "strut of splines": spline.poca,
        "measured frame": square,
        "ribbon": ribbon(),
        "certificate": found,
    }


@pytest.mark.parametrize("name", results())
def test_a_result_can_be_copied_pickled_and_turned_into_a_dict(name):
    one = results()[name]
    for other in (copy.copy(one), copy.deepcopy(one), pickle.loads(pickle.dumps(one))):
        assert type(other) is type(one) and other == one
        assert (repr(other), str(other)) == (repr(one), str(one))
        assert other.to_dict() == one.to_dict()
    assert json.loads(json.dumps(one.to_dict(), allow_nan=False)) == one.to_dict()
    always, every = fields(name.split(" of ")[0])
    if name == "ribbon":
        always.remove("image")
    assert always <= set(one.to_dict()) <= every | {"names", "left_out", "open"}
    assert "\n" not in repr(one) and len(repr(one)) < 200


def test_a_report_is_the_same_whenever_its_fields_are_read():
    session = linkwatch.Session([-4, -4])
    for k, out in enumerate((0, 0.5, 3, np.nan)):
        report = session.step(np.concatenate(linked(out)), time=np.inf if k == 1 else 0.5 * k)
        before = report.seq, report.time, report.verdict, report.abort, report.rejected
        early = copy.copy(report)
        assert report.last_intact == min(k, 1) and "stats" in report.to_dict()
        assert before == (k, np.inf if k == 1 else 0.5 * k, *before[2:])
        after = report.seq, report.time, report.verdict, report.abort, report.rejected
        assert after == before and early == report and pickle.loads(pickle.dumps(early)) == report
        assert before[2] == ("intact", "intact", "changed", "rejected")[k]
        with pytest.raises(AttributeError, match="no attribute 'verdicts'"):
            report.verdicts
        with pytest.raises(AttributeError, match="cannot be changed"):
            report.verdict = "intact"


def test_the_dict_is_what_the_command_prints(tmp_path):
    certificate = linkwatch.certify(linked())
    model = write_bcc(tmp_path / "linked.bcc", [curve.astype("f4") for curve in linked()])
    code, out, _ = run("certify", model, "--json")
    assert code == 0 and {**json.loads(out)["certificate"], "open": []} == certificate.to_dict()
    session = linkwatch.Session([-4, -4])
    models = []
    for k, out in enumerate((0, 0.5, 3)):
        curves = [curve.astype("f4") for curve in linked(out)]
        models.append(write_bcc(tmp_path / f"{k}.bcc", curves))
    code, out, _ = run("check", *models, "--json", "--events=between")
    printed = [json.loads(line) for line in out.splitlines()][:3]
    for line, x in zip(printed, (0, 0.5, 3), strict=True):
        own = session.step(np.concatenate(linked(x)).astype("f4"), line["report"]["time"]).to_dict()
        # A simulation is asked to stop, a check of files is not.
        assert own.pop("abort") == (line["report"]["verdict"] != "intact")
        assert not line["report"].pop("abort") and own.pop("left_out") == []
        assert own == line["report"]


def test_findings_have_tuples_and_the_names_of_curves():
    *_, changed, touching = reports()
    (change,) = changed.changes
    assert change.names == ("left", "right") and change.to_dict()["names"] == ["left", "right"]
    for numbers in (change.image, change.place.point, change.place.segments):
        assert isinstance(numbers, tuple) and len(numbers) in (2, 3)
    assert touching.defects[0].names == ("left", "right")
    assert linkwatch.certify(linked()).compare(linkwatch.certify(linked(4)))[0].names == ()
    points = linkwatch.thickness(linked(0.5)).poca.points
    assert isinstance(points, tuple) and isinstance(points[0], tuple)


@pytest.mark.parametrize("name", [name for name in results() if name != "certificate"])
def test_equal_results_have_one_hash(name):
    # Regression test: reports and diagrams had no hash.
    one, other = results()[name], results()[name]
    same = copy.copy(one)
    assert one == same and hash(one) == hash(same) and len({one, same}) == 1
    assert (one != other) or hash(one) == hash(other)
    assert hash(linkwatch.diagram([RING])[0]) == hash(linkwatch.diagram([RING])[0])


def test_results_cannot_be_changed():
    report = reports()[0]
    with pytest.raises(AttributeError):
        report.verdict = "changed"
    report.to_dict()["changes"].append(1)
    assert report.to_dict()["changes"] == []


def test_the_texts_of_a_report_with_many_findings_are_short():
    session = linkwatch.Session(events="off")
    session.step(chain(300))
    report = session.step([ring + [50 * k, 0, 0] for k, ring in enumerate(chain(300))])
    assert len(report.changes) == 299
    assert repr(report) == "<Report: frame 1: changed (299 links lost)>"
    assert len(str(report).splitlines()) == 300
    assert len(repr(linkwatch.certify(chain(300)))) < 60


def test_a_thickness_without_bounds_is_infinite():
    found = linkwatch.thickness([[[0, 0, 0], [1, 0, 0], [2, 0, 0]]], closed=False)
    assert found.min_rad is None and found.poca is None
    assert (found.thickness(), found.ropelength()) == (math.inf, 0.0)
    assert pickle.loads(pickle.dumps(found)).to_dict()["thickness"] is None


def test_a_certificate_is_two_sparse_matrices(monkeypatch):
    scipy = pytest.importorskip("scipy.sparse")
    curves = [*chain(3), RING + [30, 0, 0], OTHER + [31, 0, 0], np.zeros((3, 3)) + 50]
    certificate = linkwatch.certify(curves)
    linking, undefined = certificate.sparse()
    assert scipy.issparse(linking) and linking.dtype == np.int64
    dense = certificate.matrix(undefined=np.nan)
    assert (np.nan_to_num(dense) == linking.toarray()).all()
    # Curves 3 and 4 touch, and curve 5 is a point.
    assert (np.isnan(dense) == undefined.toarray()).all()
    assert undefined.sum() == 2 + 2 * 5
    with pytest.warns(linkwatch.UnverifiedWarning):
        _, undefined = linkwatch.certify(linked(), closed=[True, False]).sparse()
    assert undefined.toarray().tolist() == [[0, 1], [1, 0]]
    monkeypatch.setitem(sys.modules, "scipy.sparse", None)
    with pytest.raises(ImportError, match=r'pip install "linkwatch\[analysis\]"'):
        certificate.sparse()
