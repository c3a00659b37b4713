"""Wrong arguments: each is an exception that names the argument and what was expected."""

import itertools
import warnings

import linkwatch
import numpy as np
import pytest
from test_linkwatch import OTHER, RING, linked

FLAT = np.concatenate(linked())


def client(service, **options):
    """Opens a client and closes it."""
    linkwatch.Client(service, **{"counts": [-4], **options}).finish(0)


def masked():
    return np.ma.masked_array(RING, mask=RING > 0)


@pytest.mark.parametrize(
    "call, kind, words",
    [
        (lambda: linkwatch.certify(None), TypeError, "curves is None"),
        (lambda: linkwatch.certify("ring.obj"), TypeError, "curves is 'ring.obj' (str), exp"),
        (lambda: linkwatch.certify([1, 2]), TypeError, "curve 0 is 1 (int), expected"),
        (lambda: linkwatch.certify([["a"] * 3] * 2), ValueError, "curve 0"),
        (lambda: linkwatch.certify([RING, [[1, 2], [3]]]), ValueError, "curve 1: "),
        (lambda: linkwatch.certify([RING[:, :2]]), ValueError, "curve 0 has the shape (4, 2)"),
        (lambda: linkwatch.certify(FLAT), ValueError, "needs counts"),
        (lambda: linkwatch.certify(FLAT.T, [-8]), ValueError, "curves has the shape (3, 8)"),
        (lambda: linkwatch.certify([RING + 0j]), ValueError, "curve 0 has the type complex128"),
        (lambda: linkwatch.certify(FLAT + 0j, [-8]), ValueError, "curves has the type complex128"),
        (lambda: linkwatch.certify([RING > 0]), ValueError, "curve 0 has the type bool"),
        (lambda: linkwatch.certify([masked()]), ValueError, "curve 0 has masked points"),
        (lambda: linkwatch.certify([RING.astype(object)]), ValueError, "the type object"),
        (lambda: linkwatch.certify([RING.astype("i8") + 2**60]), ValueError, "beyond 2**53"),
        (lambda: linkwatch.certify(FLAT, -8), TypeError, "counts is -8 (int), expected a sequence"),
        (lambda: linkwatch.certify(FLAT, "-8"), TypeError, "counts is '-8' (str)"),
        (lambda: linkwatch.certify(FLAT, [-8.0]), TypeError, "counts[0] is -8.0 (float)"),
        (lambda: linkwatch.certify(FLAT, [True]), TypeError, "counts[0] is True (bool)"),
        (lambda: linkwatch.certify(FLAT, [-(2**40)]), ValueError, "counts[0] is -1099511627776"),
        (lambda: linkwatch.certify(FLAT, [8, 8], closed=True), ValueError, "closed says True of"),
        (lambda: linkwatch.certify(FLAT, [-8], closed=False), ValueError, "counts[0] is -8"),
        (lambda: linkwatch.certify(linked(), closed="yes"), TypeError, "closed is 'yes' (str)"),
        (lambda: linkwatch.certify(linked(), closed=[1, 0]), TypeError, "closed[0] is 1 (int)"),
        (lambda: linkwatch.certify(linked(), closed=[True]), ValueError, "1 values for 2 curves"),
        (lambda: linkwatch.certify(linked(), closed=False), ValueError, "none of 2 curves is"),
        (lambda: linkwatch.certify(linked(), basis=3), TypeError, "basis is 3 (int), expected"),
        (lambda: linkwatch.certify(linked(), cell="10"), ValueError, "cell has the shape ()"),
        (lambda: linkwatch.certify(linked(), cell=["a"] * 3), TypeError, "cell has the type"),
        (lambda: linkwatch.certify(linked(), cell=[1j, 1, 1]), TypeError, "cell has the type"),
        (lambda: linkwatch.Session(events=True), TypeError, "events is True (bool), expected 'be"),
        (lambda: linkwatch.Session(abort_on=None), TypeError, "abort_on is None"),
        (lambda: linkwatch.Session(baseline="c.txt"), TypeError, "Certificate.read(path)"),
        (lambda: linkwatch.Session(incremental="yes"), TypeError, "incremental is 'yes' (str)"),
        (lambda: linkwatch.Session(motion_limit="1"), TypeError, "motion_limit is '1' (str)"),
        (lambda: linkwatch.Session(radius="1"), TypeError, "radius is '1' (str)"),
        (lambda: linkwatch.Session(radius=["1"]), TypeError, "radius[0] is '1' (str)"),
        (lambda: linkwatch.Session(names=[1]), TypeError, "names[0] is 1 (int), expected a text"),
        (lambda: linkwatch.Session().describe(names="ab"), TypeError, "names is 'ab' (str)"),
        (lambda: linkwatch.Session().describe(radii=["1"]), TypeError, "radii[0] is '1' (str)"),
        (lambda: linkwatch.Session(min_clearance=1.0), ValueError, "min_clearance has no effect"),
        (lambda: linkwatch.Session().step(linked(), time="0"), TypeError, "time is '0' (str)"),
        (lambda: linkwatch.Session().step(linked(), time=1j), TypeError, "time is 1j (complex)"),
        (lambda: linkwatch.pull_throughs(linked(), [RING[0]]), ValueError, "x1: curve 0"),
        (lambda: linkwatch.safe_fraction(3, linked()), TypeError, "x0 is 3 (int)"),
        (lambda: linkwatch.struts(linked(), "far"), TypeError, "longest is 'far' (str)"),
        (lambda: linkwatch.thickness(linked(), basis=None), TypeError, "basis is None"),
        (lambda: linkwatch.ribbon(linked(), strands=(0, 2)), ValueError, "strands is (0, 2)"),
        (lambda: linkwatch.ribbon(linked(), strands=1), TypeError, "different curves of 0 to 1"),
        (lambda: linkwatch.ribbon(linked(), pairing="near"), ValueError, "expected auto, parallel"),
        (lambda: linkwatch.ribbon(linked(), axis="middle"), ValueError, "axis is 'middle'"),
        (lambda: linkwatch.ribbon(linked(), tolerance=0), ValueError, "tolerance is 0"),
        (lambda: linkwatch.Certificate.read(3), TypeError, "path is 3 (<class 'int'>), expected a"),
        (lambda: linkwatch.certify(linked()).write(None), TypeError, "path is None"),
        (lambda: linkwatch.certify(linked()).compare("c.txt"), TypeError, "baseline is 'c.txt'"),
        (lambda: linkwatch.certify(linked()).matrix(undefined="-"), TypeError, "undefined is '-'"),
        (lambda: linkwatch.Verifier(), AttributeError, "'Verifier' (it is Session now)"),
    ],
)
def test_a_wrong_argument_is_named_with_what_was_expected(call, kind, words):
    with pytest.raises(kind) as error:
        call()
    assert words in str(error.value)


@pytest.mark.parametrize(
    "options, kind, words",
    [
        ({"counts": 4}, TypeError, "counts is 4 (int), expected a sequence of integers"),
        ({"counts": [-4.5]}, TypeError, "counts[0] is -4.5 (float), expected an integer"),
        ({"radii": 0.5}, TypeError, "radii is 0.5 (float), expected a sequence of numbers"),
        ({"radii": ["a"]}, TypeError, "radii[0] is 'a' (str)"),
        ({"radii": [np.nan]}, ValueError, "radius NaN"),
        ({"names": "ring"}, TypeError, "names is 'ring' (str), expected a sequence of texts"),
        ({"names": [3]}, TypeError, "names[0] is 3 (int), expected a text"),
        ({"dtype": "double64"}, TypeError, "dtype: "),
        ({"dtype": complex}, ValueError, "dtype is complex128"),
        ({"time_step": None}, TypeError, "time_step is None"),
        ({"time_step": -1}, ValueError, "a time step of -1"),
        ({"lockstep": 1}, TypeError, "lockstep is 1 (int), expected True or False"),
        ({"basis": 1}, TypeError, "basis is 1 (int)"),
        ({"wait_mode": 1}, TypeError, "wait_mode is 1 (int)"),
        ({"cell": "box"}, ValueError, "cell has the shape ()"),
    ],
)
def test_a_wrong_argument_of_a_client_is_named(service, options, kind, words):
    with pytest.raises(kind) as error:
        client(service, **options)
    assert words in str(error.value)


def test_a_missing_file_is_a_file_not_found_error(tmp_path):
    path = tmp_path / "none.txt"
    with pytest.raises(FileNotFoundError) as error:
        linkwatch.Certificate.read(path)
    assert str(path) in str(error.value)
    with pytest.raises(OSError):
        linkwatch.Certificate.read(tmp_path)


def test_a_certificate_with_pairs_without_a_number_says_so():
    touching = linkwatch.certify([RING, RING, OTHER])
    assert "1 undefined" in repr(touching)
    with pytest.raises(ValueError, match=r"curves 0 and 1(.|\n)*matrix\(undefined=numpy.nan\)"):
        touching.matrix()
    matrix = touching.matrix(undefined=np.nan)
    assert np.isnan(matrix[0, 1]) and np.isnan(matrix[1, 0])
    assert abs(matrix[0, 2]) == abs(matrix[2, 1]) == 1 and matrix[0, 0] == 0
    assert linkwatch.certify(linked()).matrix().dtype == np.int64
    point = linkwatch.certify([RING * 0, *linked()])
    assert np.isnan(point.matrix(undefined=np.nan)[0, 1:]).all()


def test_open_curves_have_no_numbers_and_are_reported():
    with pytest.warns(linkwatch.UnverifiedWarning, match="1 of 3 curves is open") as warned:
        certificate = linkwatch.certify([*linked(), RING + 9], closed=[True, True, False])
    assert warned[0].filename == __file__
    assert certificate.open == [2] and "1 open" in repr(certificate)
    with pytest.raises(ValueError, match="curve 2 is open"):
        certificate.matrix()
    matrix = certificate.matrix(undefined=-99)
    assert matrix[2].tolist() == [-99, -99, 0] and abs(matrix[0, 1]) == 1
    session = linkwatch.Session(closed=[True, False], events="off")
    with pytest.warns(linkwatch.UnverifiedWarning, match="1 of 2 curves is open"):
        session.step(linked())
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert session.step(linked()).intact  # says it once
        linkwatch.Session(closed=[True, False]).step(linked())  # verified for pull-throughs
        yarn = np.array([[x, 0, 0.0] for x in range(-5, 6)])
        linkwatch.certify([RING, yarn], closed=[True, False], cell=[10, 10, 10])


def test_a_report_is_true_if_the_frame_is_intact():
    session = linkwatch.Session()
    assert bool(session.step(linked())) is True
    assert bool(session.step(linked(4.0))) is False
    assert bool(session.step([RING, OTHER + np.nan])) is False


def test_closed_that_agrees_with_the_counts_is_accepted():
    expected = linkwatch.certify(linked())
    assert linkwatch.certify(FLAT, [-4, -4], closed=True) == expected
    assert linkwatch.certify(FLAT, [-4, -4], closed=[True, np.True_]) == expected


def test_a_client_takes_double_precision_unless_told_otherwise(service):
    with linkwatch.Client(service, counts=[-4]) as sim:
        assert sim.begin().dtype == np.float64


# Values of many types. None of them is a frame.
ODD = [
    None,
    True,
    0,
    -1,
    10**30,
    0.5,
    np.nan,
    np.inf,
    1j,
    "",
    "text",
    b"bytes",
    [],
    [[]],
    [None],
    ["a", "b"],
    [[[1, 2, 3]]],
    [[1, 2, 3]],
    {},
    {"a": 1},
    {1, 2},
    object(),
    len,
    iter([1]),
    range(3),
    np.zeros(0),
    np.zeros((0, 3)),
    np.zeros((2, 3), complex),
    np.zeros((3, 3, 3)),
    np.array("text"),
    np.array([None, 1], object),
    np.zeros(3, "datetime64[s]"),
    np.zeros((2, 3), [("x", "f4")]),
    np.ma.masked_all((2, 3)),
    np.float16(1),
    np.int8(-4),
    np.array(3),
    linkwatch.certify([RING]),
    linkwatch.Session(),
]


def survives(call, *args, **options):
    """Calls with any arguments. Only ordinary exceptions may come."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return call(*args, **options)
    except (TypeError, ValueError, OSError, RuntimeError, linkwatch.UndecidedError) as error:
        assert str(error) and "internal error" not in str(error)
    return None


def test_odd_arguments_of_functions_are_ordinary_exceptions():
    calls = {
        linkwatch.certify: ("curves", "counts", "closed", "basis", "cell"),
        linkwatch.thickness: ("curves", "counts", "closed", "basis", "cell"),
        linkwatch.struts: ("curves", "longest", "counts", "closed", "basis", "cell"),
        linkwatch.ribbon: ("curves", "counts", "strands", "pairing", "axis", "tolerance"),
        linkwatch.pull_throughs: ("x0", "x1", "counts", "closed", "events", "cell"),
        linkwatch.safe_fraction: ("x0", "x1", "counts", "closed", "basis", "cell"),
        linkwatch.assert_intact: (),
    }
    fine = {"curves": linked(), "longest": 1.0, "x0": linked(), "x1": linked(0.1)}
    for call, names in calls.items():
        for name, value in itertools.product(names, ODD):
            given = {key: fine[key] for key in names if key in fine}
            survives(call, **{**given, name: value})
            if "counts" in names and name != "counts":
                flat = {key: FLAT for key in given if key != "longest"}
                survives(call, **{**given, **flat, "counts": [-4, -4], name: value})
    for value in ODD:
        try:
            survives(linkwatch.assert_intact, value)
        except AssertionError:
            pass


def test_odd_arguments_of_a_session_are_ordinary_exceptions(tmp_path):
    options = (
        "counts closed names basis baseline events abort_on incremental motion_limit thickness "
        "min_clearance cell wrapped keep_open"
    ).split()
    for name, value in itertools.product(options, ODD):
        session = survives(linkwatch.Session, **{name: value})
        if session is not None:
            survives(session.step, linked())
            survives(session.step, FLAT)
    session = linkwatch.Session()
    for value in ODD:
        survives(session.step, value)
        survives(session.step, linked(), value)
        survives(session.step, linked(), cell=value)
        survives(session.describe, value)
        survives(session.describe, closed=value, names=["a", "b"])
        survives(session.describe, names=value)
        survives(session.describe, names=["a", "b"], radii=value)
        survives(session.step, linked())
    certificate = linkwatch.certify(linked())
    for value in (v for v in ODD if v is not None and not isinstance(v, (int, str, bytes))):
        survives(linkwatch.Certificate.read, value)
        survives(certificate.write, value)
    for value in ODD:
        survives(certificate.compare, value)
        survives(certificate.matrix, undefined=value)
        survives(linkwatch.thickness(linked()).thickness, value)


def test_odd_arguments_of_a_client_are_ordinary_exceptions(service):
    options = "counts names radii time_step cell dtype basis lockstep wait_mode".split()
    for name, value in itertools.product(options, ODD):
        sim = survives(linkwatch.Client, service, **{"counts": [-4], name: value})
        if sim is not None:
            survives(sim.begin)
            survives(sim.publish)
            sim.finish(0)
        del sim
    sim = linkwatch.Client(service, counts=[-4], names=["a"])
    for value in ODD:
        survives(linkwatch.Client, value, counts=[-4])
        survives(sim.begin, value)
        survives(sim.publish, cell=value)
        survives(sim.set_time_step, value)
        survives(sim.describe, value, names=["a"])
        survives(sim.describe, [-4], names=value)
        survives(sim.describe, [-4], names=["a"], radii=value)
        if not (isinstance(value, (int, float)) and value > 1):
            survives(sim.wait, value)
            survives(sim.wait_for_watcher, value)
    for value in ODD[:4]:
        survives(sim.finish, value)


def test_misaligned_points_are_verified():
    points = np.concatenate([RING, OTHER])
    moved = np.frombuffer(b"x" + points.tobytes(), "<f8", offset=1).reshape(-1, 3)
    assert not moved.flags.aligned
    assert linkwatch.certify(moved, [-4, -4]) == linkwatch.certify(points, [-4, -4])
