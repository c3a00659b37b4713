"""The Python package, against linking numbers and moments that follow from the construction."""

import doctest
import importlib
import inspect
import pathlib
import subprocess
import sys
import threading
import time

import linkwatch
import numpy as np
import pytest

MODULES = "_results _run _series distributed io io._frames io._npz mdanalysis"

RING = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
OTHER = np.array([[0, 0, -1], [2, 0, -1], [2, 0, 1], [0, 0, 1]], float)


def linked(out=0.0, dtype=float):
    """Two squares, linked up to a distance of 1."""
    return [RING.astype(dtype), (OTHER + [out, 0, 0]).astype(dtype)]


def circle(points, center, axes):
    angle = np.linspace(0, 2 * np.pi, points, endpoint=False)
    u, v = np.asarray(axes, float)
    return np.asarray(center) + np.outer(np.cos(angle), u) + np.outer(np.sin(angle), v)


def chain(rings, points=12):
    """Circles in alternating planes, each linked with the next one."""
    planes = [([1, 0, 0], [0, 1, 0]), ([1, 0, 0], [0, 0, 1])]
    return [circle(points, [1.5 * k, 0, 0], planes[k % 2]) for k in range(rings)]


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_certify_takes_both_forms_of_a_frame(dtype):
    curves = linked(dtype=dtype)
    certificate = linkwatch.certify(curves)
    assert certificate.curves == 2
    ((i, j, number),) = certificate.links
    assert (i, j, abs(number)) == (0, 1, 1)
    assert linkwatch.certify(np.concatenate(curves), [-4, -4]) == certificate
    assert linkwatch.certify([curve.tolist() for curve in curves]) == certificate
    matrix = certificate.matrix()
    assert matrix.tolist() == [[0, number], [number, 0]]


def test_slices_that_are_not_contiguous_are_verified_as_they_are():
    wide = np.zeros((8, 6), np.float32)
    wide[:, ::2] = np.concatenate(linked())
    assert len(linkwatch.certify(wide[:, ::2], [-4, -4]).links) == 1
    backwards = np.concatenate(linked())[::-1]
    assert len(linkwatch.certify(backwards, [-4, -4]).links) == 1


@pytest.mark.parametrize("basis", ["polyline", "catmull-rom", "b-spline"])
def test_every_basis_finds_the_links_of_a_chain(basis):
    links = linkwatch.certify(chain(12, points=24), basis=basis).links
    assert [(i, j) for i, j, _ in links] == [(k, k + 1) for k in range(11)]


def test_a_session_reports_what_was_pulled_through_what():
    for incremental in (False, True):
        session = linkwatch.Session(incremental=incremental)
        first = session.step(linked(), time=0.0)
        assert first.intact and first.verdict == "intact" and first.safe_fraction is None
        assert session.baseline == linkwatch.certify(linked())
        report = session.step(linked(4.0), time=0.5)
        assert (report.verdict, report.abort, report.time) == ("changed", True, 0.5)
        (change,) = report.changes
        assert (change.i, change.j, abs(change.expected), change.found) == (0, 1, 1, 0)
        (passage,) = report.pull_throughs
        assert passage.fraction == pytest.approx(0.25, abs=1e-8)
        assert passage.point == pytest.approx([1, 0, 0], abs=1e-6)
        assert report.last_intact == 0
        assert 0.25 - 1e-6 < report.safe_fraction < 0.25
        assert "curves 0 and 1 came apart" in str(report)
        session.cut()
        assert session.step(linked()).last_intact == 2


def test_a_frame_that_breaks_its_contract_is_rejected_and_later_frames_are_verified():
    session = linkwatch.Session()
    assert session.step(linked()).intact
    broken = linked(0.1)
    broken[1][2, 1] = np.nan
    report = session.step(broken)
    assert report.verdict == "rejected"
    assert report.rejected == "curve 1, point 2: coordinate y is NaN"
    assert session.step(chain(3)).verdict == "rejected"
    assert session.step(linked(0.1)).intact


def test_pull_throughs_and_the_safe_fraction_of_a_step():
    x0, x1 = linked(), linked(4.0)
    (passage,) = linkwatch.pull_throughs(x0, x1)
    assert (passage.i, passage.j, abs(passage.sign)) == (0, 1, 1)
    share = linkwatch.safe_fraction(x0, x1)
    assert 0.25 - 1e-6 < share < 0.25
    short = [a + share * (b - a) for a, b in zip(x0, x1)]
    assert linkwatch.pull_throughs(x0, short) == []
    long = [a + (share + 1e-6) * (b - a) for a, b in zip(x0, x1)]
    assert len(linkwatch.pull_throughs(x0, long)) == 1
    assert linkwatch.safe_fraction(x0, linked(0.5)) == 1.0
    with pytest.raises(linkwatch.UndecidedError, match="touch"):
        linkwatch.pull_throughs(x0, linked(1.0))
    assert linkwatch.safe_fraction(linked(1.0), x1) == 0.0


def test_a_safe_fraction_of_random_motion_leaves_no_pull_through():
    random = np.random.default_rng(7)
    counts = [-12] * 8
    shortened = 0
    for _ in range(200):
        x0 = np.concatenate(chain(8)).astype(np.float32)
        x1 = x0 + random.normal(0, 0.3, x0.shape).astype(np.float32)
        share = np.float32(linkwatch.safe_fraction(x0, x1, counts))
        assert linkwatch.pull_throughs(x0, x0 + share * (x1 - x0), counts) == []
        shortened += 0 < share < 1
    assert shortened > 100


def test_assert_intact_names_frame_curves_and_place():
    frames = [linked(0.3 * k) for k in range(6)]
    linkwatch.assert_intact(frames[:3])
    with pytest.raises(AssertionError, match=r"frame 4: changed(.|\n)*curves 0 and 1.*near \("):
        linkwatch.assert_intact(frames)
    with pytest.raises(AssertionError, match="no frame"):
        linkwatch.assert_intact([])
    apart = linkwatch.certify(linked(5.0))
    with pytest.raises(AssertionError, match="frame 0: changed"):
        linkwatch.assert_intact(frames[:1], baseline=apart)
    linkwatch.assert_intact(frames[:1], baseline=linkwatch.certify(frames[0]))


def test_assert_intact_fails_if_nothing_was_verified(tmp_path):
    with pytest.raises(AssertionError, match="nothing to compare it with"):
        linkwatch.assert_intact([linked()])
    alone = [linked()[:1]] * 2
    with pytest.raises(AssertionError, match="one curve alone"):
        linkwatch.assert_intact(alone)
    linkwatch.assert_intact(alone, events="all")
    linkwatch.assert_intact(alone, invariants="self")
    knot = tmp_path / "knot.txt"
    knot.write_text("1\ninvariants 1 self\n")
    linkwatch.assert_intact(alone, baseline=linkwatch.Certificate.read(knot))
    linkwatch.assert_intact(alone, cell=[9, 9, 9])
    with pytest.raises(AssertionError, match="one curve alone"):
        linkwatch.assert_intact(alone, cell=None)
    with pytest.raises(AssertionError, match="not verified: 1 open curve"):
        linkwatch.assert_intact([linked()] * 2, closed=[True, False], events="off")


def test_certificates_are_written_and_compared(tmp_path):
    certificate = linkwatch.certify(chain(5))
    path = tmp_path / "c.txt"
    certificate.write(path)
    assert linkwatch.Certificate.read(path) == certificate
    (change,) = linkwatch.certify(linked(5.0)).compare(linkwatch.certify(linked()))
    assert (abs(change.expected), change.found) == (1, 0)
    with pytest.raises(ValueError, match="5"):
        certificate.compare(linkwatch.certify(linked()))
    with pytest.raises(OSError):
        linkwatch.Certificate.read(tmp_path / "none.txt")


def test_assert_intact_says_how_frames_of_files_are_verified():
    frame = linkwatch.io.Frame(np.concatenate(linked()), [-len(curve) for curve in linked()])
    with pytest.raises(TypeError, match="assert linkwatch.check"):
        linkwatch.assert_intact([frame, frame])
    assert linkwatch.check([frame, frame])


def test_comparing_certificates_warns_of_pairs_that_are_not_compared():
    square = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]])
    touching = linkwatch.certify([square, square + [2, 0, 0], square + [9, 0, 0]])
    apart = linkwatch.certify([square, square + [3, 0, 0], square + [9, 0, 0]])
    for new, old in (touching, apart), (apart, touching):
        with pytest.warns(linkwatch.UnverifiedWarning, match="not compared: .*0 and 1"):
            assert new.compare(old) == []


@pytest.mark.parametrize(
    "call, words",
    [
        (lambda: linkwatch.certify([]), "no curves"),
        (lambda: linkwatch.certify(np.zeros((8, 3))), "counts"),
        (lambda: linkwatch.certify(np.zeros((8, 2)), [-8]), "expected (n, 3)"),
        (lambda: linkwatch.certify([np.zeros((4, 2))]), "curve 0"),
        (lambda: linkwatch.certify(np.zeros((8, 3)), [-4, -5]), "27 promised, 24 available"),
        (lambda: linkwatch.certify(linked(), closed=[True]), "closed"),
        (lambda: linkwatch.certify([RING.astype("f4"), OTHER]), "float32, float64"),
        (lambda: linkwatch.certify(linked(dtype=np.float16)), "float16"),
        (lambda: linkwatch.certify(linked(), basis="nurbs"), "nurbs"),
        (lambda: linkwatch.certify([np.full((4, 3), np.inf), OTHER]), "curve 0, point 0"),
        (lambda: linkwatch.Session(events="some"), "events"),
        (lambda: linkwatch.Session(abort_on="some"), "abort_on"),
        (lambda: linkwatch.Session(events="off", motion_limit=1.0), "motion"),
    ],
)
def test_bad_input_is_an_exception_that_names_it(call, words):
    with pytest.raises(ValueError) as error:
        call()
    assert words in str(error.value)


def test_other_threads_run_while_a_frame_is_verified():
    sheet = np.concatenate(chain(500, points=40))
    points = np.concatenate([sheet + [0, 10 * k, 0] for k in range(40)])
    counts = [-40] * (len(points) // 40)
    ticks, done = [], threading.Event()

    def tick():
        while not done.is_set():
            ticks.append(time.perf_counter())
            time.sleep(0.0005)

    thread = threading.Thread(target=tick)
    thread.start()
    start = time.perf_counter()
    assert len(linkwatch.certify(points, counts).links) == 40 * 499
    end = time.perf_counter()
    done.set()
    thread.join()
    assert sum(start < tick < end for tick in ticks) > 5


def test_steps_of_a_small_scene_need_no_more_memory_with_time():
    import resource

    session = linkwatch.Session([-4, -4])
    frames = [np.concatenate(linked(0.1 * k)) for k in range(4)]

    def peak(steps):
        for k in range(steps):
            session.step(frames[k % 4])
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss

    before = peak(5_000)
    assert peak(20_000) - before < 2_000


def test_the_examples_of_the_documentation_say_what_happens(capsys):
    pytest.importorskip("MDAnalysis")
    for name in ("linkwatch", *(f"linkwatch.{module}" for module in MODULES.split())):
        module = importlib.import_module(name)
        assert doctest.testmod(module, optionflags=doctest.ELLIPSIS).failed == 0
    readme = pathlib.Path(__file__).parents[1] / "README.md"
    example = readme.read_text().split("```python\n")[1].split("```")[0]
    exec(example, {})
    printed = capsys.readouterr().out.splitlines()
    results = [line.split("  # ")[1] for line in example.splitlines() if ")  # " in line]
    assert [printed[0], printed[-1]] == [results[0], results[-1]]


def test_every_public_item_has_a_docstring_with_an_example():
    modules = linkwatch, linkwatch.io, linkwatch.distributed
    for module, name in ((module, name) for module in modules for name in module.__all__):
        item = getattr(module, name)
        assert item.__doc__, name
        # Certificates are shown by `certify`, and messages need a watch.
        if callable(item) and name not in ("Certificate", "Message"):
            assert ">>> " in item.__doc__, name
        for part, value in vars(item).items() if inspect.isclass(item) else ():
            if not part.startswith("_") and (callable(value) or isinstance(value, property)):
                assert value.__doc__, f"{name}.{part}"


def test_help_begins_with_what_to_call_and_lists_it():
    first = linkwatch.__doc__.splitlines()[2:12]
    assert all(line.split("(")[0].split(",")[0].split()[0] in linkwatch.__all__ for line in first)
    assert set(linkwatch.__all__) <= set(dir(linkwatch))
    for name in linkwatch.__all__:
        assert getattr(linkwatch, name).__doc__, name


def test_the_import_is_quick():
    # Time of the CPU, because other processes may run.
    code = "import time; s = time.process_time(); import linkwatch; print(time.process_time() - s)"
    run = lambda: float(subprocess.check_output([sys.executable, "-c", code]))
    assert min(run() for _ in range(5)) < 0.05


def test_clearance_warns_before_a_pull_through():
    for radius in (0.1, [0.1, 0.1]):
        session = linkwatch.Session(radius=radius, abort_on="clearance")
        for k in range(16):
            out = 0.705 + 0.02 * k
            report = session.step(linked(out))
            clearance = report.clearance
            if out > 1:
                break
            assert report.intact
            assert clearance.ratio == pytest.approx((1 - out) / 0.2)
            assert clearance.low == report.abort == (out > 0.9)
            assert (clearance.curves, clearance.error) == ((0, 1), 0)
        assert report.verdict == "changed"
        assert "curves 0 and 1" in str(clearance)
    assert linkwatch.Session().step(linked()).clearance is None
    far = linkwatch.Session(radius=0.01).step(linked()).clearance
    assert (far.ratio, far.at_least >= 1, str(far)) == (None, True, "no strands are close")
    with pytest.raises(ValueError, match="radius"):
        linkwatch.Session(radius=[0.1, 0.0])
    with pytest.raises(ValueError, match="radius"):
        linkwatch.Session(abort_on="clearance")
    assert "radii of curves: 2" in linkwatch.Session(radius=[0.1]).step(linked()).rejected


@pytest.mark.parametrize("basis", ["polyline", "catmull-rom", "b-spline"])
def test_thickness_of_linked_circles(basis):
    circles = [circle(96, [0, 0, 0], [[2, 0, 0], [0, 2, 0]]),
               circle(96, [2, 0, 0], [[2, 0, 0], [0, 0, 2]])]
    found = linkwatch.thickness(circles, basis=basis)
    assert found.thickness() == pytest.approx(2, rel=1e-2)
    assert found.ropelength() == pytest.approx(4 * np.pi, rel=1e-2)
    assert found.poca.error <= 2e-4 * found.poca.length


def test_the_gradient_of_a_strut_is_the_derivative_of_its_length():
    # Without symmetry, one strut is the shortest.
    axes = np.eye(3)
    curves = [circle(24, [0, 0, 0], axes[[0, 1]]), circle(24, [1.1, 0.07, 0.1], axes[[0, 2]])]
    strut = linkwatch.struts(curves, 1.0)[0]
    assert strut.curves == (0, 1)
    i, s = strut.curves[1], strut.segments[1]
    for vertex in (0, 1):
        for axis in range(3):
            moved = [curve.copy() for curve in curves]
            moved[i][(s + vertex) % 24, axis] += 1e-6
            length = linkwatch.struts(moved, 1.0)[0].length
            derivative = (length - strut.length) / 1e-6
            assert strut.gradient[1][vertex][axis] == pytest.approx(derivative, abs=1e-4)
    spline = linkwatch.struts(curves, 1.0, basis="catmull-rom")[0]
    assert spline.gradient is None and spline.error > 0


def helix(order, turns=20, pairs=210):
    """Two strands of a relaxed DNA minicircle, the second one in another order."""
    angle = 2 * np.pi * np.arange(pairs) / pairs
    radius = 0.34 * pairs / (2 * np.pi)
    strands = []
    for phase in (0, np.pi):
        out, z = np.cos(turns * angle + phase), np.sin(turns * angle + phase)
        far = radius + out
        strands.append(np.stack([far * np.cos(angle), far * np.sin(angle), z], axis=1))
    return [strands[0], order(strands[1])]


@pytest.mark.parametrize(
    "order, pairing, by",
    [
        (lambda strand: strand, "parallel", "order"),
        (lambda strand: strand[::-1], "antiparallel", "order"),
        (lambda strand: np.roll(strand[::-1], 1, axis=0), "antiparallel:1", "distances"),
        (lambda strand: np.roll(strand, 50, axis=0), "parallel:50", "distances"),
    ],
)
def test_strands_of_dna_are_paired_by_base(order, pairing, by):
    strands = helix(order)
    for dtype in (np.float32, np.float64):
        ribbon = linkwatch.ribbon([strand.astype(dtype) for strand in strands])
        assert (ribbon.pairing, ribbon.pairing_by) == (pairing, by)
        assert (abs(ribbon.linking), ribbon.passages) == (20, 0)
        assert abs(ribbon.twist) == pytest.approx(20, abs=1e-5)
        assert ribbon.writhe == pytest.approx(0, abs=2e-4)
    given = linkwatch.ribbon(np.concatenate(strands), [-210, -210], pairing=pairing)
    assert (given.pairing_by, given.rivals) == ("given", [])
    assert given.linking == ribbon.linking
    assert abs(linkwatch.ribbon(strands, axis="first").twist) < abs(given.twist)


def test_rings_that_repeat_their_first_point_are_closed():
    rings = [np.concatenate([x, x[:1] + 5e-15]) for x in (RING.astype(float), OTHER.astype(float))]
    with pytest.warns(linkwatch.ClosingWarning, match="2 curves end where they start"):
        assert len(linkwatch.certify(rings, closed=False).links) == 1
    session = linkwatch.Session(closed=False)
    with pytest.warns(linkwatch.ClosingWarning, match="without the repeated point"):
        assert session.step(rings).intact
    cut = [rings[0], rings[1] + np.array([[0.0, 0, 0]] * 4 + [[0, 0, 0.5]])]
    assert "curve 1 is closed in the first frame" in str(session.step(cut).rejected)
    apart = [rings[0], rings[1] + [9.0, 0, 0]]
    assert session.step(apart).verdict == "changed"
    with pytest.raises(ValueError, match="none of 2 curves is closed"):
        lifted = np.array([[0.0, 0, 0]] * 4 + [[0, 0, 0.5]])
        linkwatch.certify([x + lifted for x in rings], closed=False)


def test_a_chain_that_is_closed_by_default_stays_open():
    chain = np.array([[float(k), 0.1 * k * (9 - k), 0] for k in range(10)])
    with pytest.warns(linkwatch.ClosingWarning, match="1 curve stays open"):
        with pytest.warns(linkwatch.UnverifiedWarning):
            found = linkwatch.certify([chain, RING])
    assert found.open == [0]
    with pytest.warns(linkwatch.ClosingWarning, match="is closed by a segment that is more than 2"):
        assert linkwatch.certify([chain, RING], closed=True).open == []
