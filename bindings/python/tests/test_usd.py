"""USD stages, which Pixar's library writes and linkwatch.io reads."""

import json
import math
import sys

import linkwatch
import numpy as np
import pytest
from linkwatch import io
from test_command import run

pytest.importorskip("pxr", reason="usd-core is not installed")
from pxr import Gf, Sdf, Ts, Usd, UsdGeom, UsdSkel

X, Y, Z = np.eye(3)
BASES = {
    "polyline": ("linear", None),
    "bezier": ("cubic", "bezier"),
    "b-spline": ("cubic", "bspline"),
    "catmull-rom": ("cubic", "catmullRom"),
}


def ring(n=12, center=(0, 0, 0), axes=(X, Y), bezier=False):
    """Control points of a ring. As Bezier pieces they are close to a circle."""
    angle, radius = 2 * math.pi * np.arange(n) / n, np.ones(n)
    if bezier:
        arc = 2 * math.pi / (n // 3)
        reach = 4 / 3 * math.tan(arc / 4)
        for k in range(n):
            if k % 3:
                side = math.copysign(math.atan(reach), 1.5 - k % 3)
                angle[k] = arc * (k // 3 + k % 3 // 2) + side
                radius[k] = math.hypot(1, reach)
    points = np.outer(radius * np.cos(angle), axes[0]) + np.outer(radius * np.sin(angle), axes[1])
    return (points + center).astype(np.float32)


def linked(bezier=False):
    return [ring(bezier=bezier), ring(center=X, axes=(X, Z), bezier=bezier)]


def curves(stage, path, loops, basis="polyline", wrap="periodic"):
    prim = UsdGeom.BasisCurves.Define(stage, path)
    kind, name = BASES[basis]
    prim.CreateTypeAttr(kind)
    if name:
        prim.CreateBasisAttr(name)
    prim.CreateWrapAttr(wrap)
    prim.CreateCurveVertexCountsAttr([len(loop) for loop in loops])
    prim.CreatePointsAttr(np.concatenate(loops))
    return prim


@pytest.fixture
def stage(tmp_path):
    return Usd.Stage.CreateNew(str(tmp_path / "a.usda"))


def saved(stage):
    """Saves a stage, and returns its path."""
    stage.Save()
    return stage.GetRootLayer().realPath


def frames(stage):
    return list(io.read(saved(stage)))


def certify(frame):
    return linkwatch.certify(frame.positions, frame.counts, basis=frame.basis)


@pytest.mark.parametrize("suffix", ["usda", "usdc"])
@pytest.mark.parametrize("basis", BASES)
def test_linked_rings_of_every_basis_are_linked(tmp_path, basis, suffix):
    path = tmp_path / f"a.{suffix}"
    stage = Usd.Stage.CreateNew(str(path))
    prim = curves(stage, "/rings", linked(basis == "bezier"), basis)
    prim.CreateWidthsAttr([0.25, 0.5])
    prim.SetWidthsInterpolation("uniform")
    stage.Save()
    found = io.read(path)
    assert (found.summary.curves, found.summary.closed, len(found)) == (2, 2, 1)
    (frame,) = found
    assert (frame.basis, frame.counts, frame.closed) == (basis, [-12, -12], [True, True])
    assert frame.positions.dtype == np.float32
    assert (frame.names, frame.radii) == (["/rings[0]", "/rings[1]"], [0.125, 0.25])
    assert (frame.seq, frame.time, frame.cell) == (0, 0.0, None)
    assert certify(frame).links == [(0, 1, -1)]
    out = tmp_path / "a.npz"
    code, _, err = run("convert", path, out)
    assert code == 0, err
    assert "2 curves, 2 closed" in err
    assert run("certify", out)[:2] == (0, "2 # lines: 1\n0,1,-1\n")


def test_open_and_pinned_curves_reach_their_ends(stage):
    arc = ring()
    for basis in ("b-spline", "catmull-rom"):
        strands = [arc[:4], arc[4:6], arc[6:11]]
        prim = curves(stage, "/strands", strands, basis, "pinned")
        # One at each end of a segment.
        prim.CreateWidthsAttr([0.1, 0.2, 0.3, 0.4, 0.5, 0.4, 0.1, 0.2, 0.7, 0.2, 0.1])
        prim.SetWidthsInterpolation("varying")
        (frame,) = frames(stage)
        assert frame.counts == [6, 4, 7]
        assert frame.radii == pytest.approx([0.2, 0.25, 0.35])
        points = np.split(frame.positions, [6, 10])
        for found, given in zip(points, strands):
            np.testing.assert_array_equal(found[1:-1], given)
            np.testing.assert_allclose(found[0], 2.0 * given[0] - given[1], atol=1e-7)
            np.testing.assert_allclose(found[-1], 2.0 * given[-1] - given[-2], atol=1e-7)
    curves(stage, "/strands", [arc[:7], arc[:4]], "bezier", "pinned").GetWidthsAttr().Clear()
    (frame,) = frames(stage)
    assert (frame.counts, frame.positions.dtype) == ([7, 4], np.float32)


def test_samples_of_several_prims_are_frames(stage):
    stage.SetTimeCodesPerSecond(30)
    first, second = linked()
    a = curves(stage, "/yarn/a", [first])
    b = curves(stage, "/yarn/b", [second])
    for time, shift in [(10, 0.0), (12, 0.5), (14, 1.5), (16, 3.0)]:
        a.GetPointsAttr().Set(first - np.float32([shift, 0, 0]), time)
    move = b.AddTranslateOp()
    move.Set(Gf.Vec3d(0, 0, 0), 10)
    move.Set(Gf.Vec3d(0, 0, 0.5), 15)
    b.CreateWidthsAttr([0.5])
    a.CreateWidthsAttr([0.25] * len(first))
    found = frames(stage)
    assert [frame.seq for frame in found] == [10, 12, 14, 15, 16]
    assert [frame.time for frame in found] == [seq / 30 for seq in (10, 12, 14, 15, 16)]
    assert all(frame.names == ["/yarn/a", "/yarn/b"] for frame in found)
    assert all(frame.radii == [0.125, 0.25] for frame in found)
    assert [len(certify(frame).links) for frame in found] == [1, 1, 0, 0, 0]
    # Between two samples, values are interpolated; after the last one, they are held.
    np.testing.assert_allclose(found[3].positions[0], [1 - 2.25, 0, 0])
    np.testing.assert_allclose(found[1].positions[12], [2, 0, 0.2])
    np.testing.assert_allclose(found[4].positions[12], [2, 0, 0.5])
    out = saved(stage).replace("usda", "npz")
    assert run("convert", saved(stage), out)[0] == 0
    code, said, err = run("check", out)
    assert code == 1, err
    assert "curves 0 (/yarn/a) and 1 (/yarn/b) came apart" in said


def test_times_that_are_no_integers_are_counted(stage):
    prim = curves(stage, "/a", [ring()])
    for time in (-1.5, 0, 1):
        prim.GetPointsAttr().Set(ring(), time)
    found = frames(stage)
    assert [frame.seq for frame in found] == [0, 1, 2]
    assert [frame.time for frame in found] == [-1.5 / 24, 0, 1 / 24]


def test_transforms_of_a_hierarchy_are_applied(stage):
    top = UsdGeom.Xform.Define(stage, "/top")
    top.AddTranslateOp().Set(Gf.Vec3d(3, -2, 1))
    top.AddRotateZOp().Set(90)
    top.AddScaleOp().Set(Gf.Vec3f(2, 2, 2))
    a = curves(stage, "/top/a", [ring()])
    a.CreateWidthsAttr([0.5])
    pivot = a.AddTranslateOp(opSuffix="pivot")
    pivot.Set(Gf.Vec3d(1, 0, 0))
    turn = a.AddOrientOp(UsdGeom.XformOp.PrecisionDouble)
    for time, angle in [(0, 0.0), (2, 180.0)]:
        turn.Set(Gf.Quatd(Gf.Rotation(Gf.Vec3d(0, 0, 1), angle).GetQuat()), time)
    a.AddTranslateOp(opSuffix="pivot", isInverseOp=True)
    b = curves(stage, "/top/b", [ring()])
    b.SetResetXformStack(True)
    b.CreateWidthsAttr([0.5])
    b.AddScaleOp().Set(Gf.Vec3f(1, 1, 3))
    found = frames(stage)
    assert [frame.seq for frame in found] == [0, 2]
    x, y, z = ring().T.astype(float)
    np.testing.assert_allclose(
        found[0].positions[:12], np.stack([3 - 2 * y, 2 * x - 2, 2 * z + 1], 1), atol=1e-6
    )
    x, y = 2 - x, -y
    np.testing.assert_allclose(
        found[1].positions[:12], np.stack([3 - 2 * y, 2 * x - 2, 2 * z + 1], 1), atol=1e-6
    )
    np.testing.assert_allclose(found[0].positions[12:], ring(), atol=1e-6)
    assert found[0].positions.dtype == np.float64
    assert found[0].radii == pytest.approx([0.5, 0.75])


def test_a_transform_that_does_nothing_keeps_single_precision(stage):
    curves(stage, "/a", [ring()]).AddTranslateOp().Set(Gf.Vec3d(0, 0, 0))
    assert frames(stage)[0].positions.dtype == np.float32


def test_references_and_instances_are_composed(stage, tmp_path):
    other = Usd.Stage.CreateNew(str(tmp_path / "other.usda"))
    other.SetDefaultPrim(UsdGeom.Xform.Define(other, "/rings").GetPrim())
    curves(other, "/rings/a", [ring()])
    other.Save()
    for k, path in enumerate(["/first", "/second"]):
        prim = UsdGeom.Xform.Define(stage, path)
        prim.GetPrim().GetReferences().AddReference("other.usda")
        prim.GetPrim().SetInstanceable(True)
        prim.AddTranslateOp().Set(Gf.Vec3d(k, 0, 0))
        prim.AddRotateXOp().Set(90 * k)
    (frame,) = frames(stage)
    assert frame.names == ["/first/a", "/second/a"]
    assert len(certify(frame).links) == 1


def test_a_point_instancer_copies_its_prototypes(stage):
    instancer = UsdGeom.PointInstancer.Define(stage, "/copies")
    instancer.AddTranslateOp().Set(Gf.Vec3d(0, 0, 5))
    UsdGeom.Xform.Define(stage, "/copies/bead").AddTranslateOp().Set(Gf.Vec3d(0, 7, 0))
    curves(stage, "/copies/bead/a", [ring(), ring() * np.float32(0.5)])
    curves(stage, "/copies/unused", [ring()])
    instancer.CreatePrototypesRel().SetTargets(["/copies/unused", "/copies/bead"])
    instancer.CreateProtoIndicesAttr([1, 1, 1])
    instancer.CreatePositionsAttr([(0, 0, 0), (10, 0, 0), (20, 0, 0)])
    instancer.DeactivateId(1)
    instancer.InvisId(2, 0)
    found = io.read(saved(stage))
    assert found.summary.curves == 4
    frame = next(iter(found))
    assert frame.names == [f"/copies[{k}]/bead/a[{i}]" for k in (0, 2) for i in (0, 1)]
    np.testing.assert_allclose(frame.positions[0], [1, 7, 5])
    np.testing.assert_allclose(frame.positions[24], [21, 7, 5])


def test_prototypes_that_are_not_defined_are_copied(stage):
    stage.CreateClassPrim("/kinds")
    curves(stage, "/kinds/a", [ring()])
    instancer = UsdGeom.PointInstancer.Define(stage, "/copies")
    instancer.CreatePrototypesRel().SetTargets(["/kinds/a", "/kinds/none", "/nested"])
    instancer.CreateProtoIndicesAttr([0])
    instancer.CreatePositionsAttr([(1, 2, 3)])
    UsdGeom.PointInstancer.Define(stage, "/nested")
    found = io.read(saved(stage))
    assert "1 missing prototype (/kinds/none)" in str(found.summary)
    assert "1 PointInstancer in the prototype of another one (/nested)" in str(found.summary)
    (frame,) = found
    assert frame.names == ["/copies[0]/a"]
    np.testing.assert_allclose(frame.positions[0], [2, 2, 3])
    instancer.CreatePositionsAttr([])
    found = io.read(saved(stage))
    assert found.summary.curves == 0
    assert "arrays of different lengths" in next(iter(found)).rejected


def test_hidden_curves_are_read_and_those_that_are_not_are_counted(stage, tmp_path):
    curves(stage, "/rings", linked()).MakeInvisible()
    curves(stage, "/off", [ring()]).GetPrim().SetActive(False)
    curves(stage, "/guide", [ring()]).CreatePurposeAttr("guide")
    UsdGeom.Xform.Define(stage, "/low").CreatePurposeAttr("proxy")
    curves(stage, "/low/curves", [ring()])
    stage.CreateClassPrim("/kind")
    curves(stage, "/kind/curves", [ring()])
    UsdGeom.Mesh.Define(stage, "/mesh")
    UsdGeom.HermiteCurves.Define(stage, "/hermite").CreatePointsAttr(ring())
    strange = stage.DefinePrim("/strange", "Spaghetti")
    strange.CreateAttribute("points", Sdf.ValueTypeNames.Point3fArray).Set(ring())
    strange.CreateAttribute("curveVertexCounts", Sdf.ValueTypeNames.IntArray).Set([12])
    curves(stage, "/odd", [ring()]).CreateTypeAttr("round")
    spun = curves(stage, "/spun", [ring()])
    spun.AddTranslateXOp().GetAttr().SetSpline(Ts.Spline())
    missing = UsdGeom.Xform.Define(stage, "/missing")
    missing.GetPrim().GetReferences().AddReference("nowhere.usda")
    found = io.read(saved(stage))
    text = str(found.summary)
    assert "2 curves, 2 closed" in text
    assert "2 prims with curves of purpose proxy or guide (the first one: /guide)" in text
    assert "1 prim of an unknown type with curves (/strange of type Spaghetti)" in text
    assert "prims with curves that are not read (the first one: /hermite: no" in text
    assert "nowhere.usda" in text
    (frame,) = found
    assert frame.names == ["/rings[0]", "/rings[1]"]
    out = tmp_path / "a.npz"
    code, _, err = run("convert", saved(stage), out)
    assert code == 3
    assert "not read, so not verified" in err
    # The archive says so, too.
    code, _, err = run("certify", out)
    assert code == 3
    assert "kinds of elements that the archive leaves out (the first one: 1 part of the" in err


@pytest.mark.parametrize(
    "change, words",
    [
        (lambda prim: prim.CreateTypeAttr("round"), "type 'round'; linear and cubic are read"),
        (lambda prim: prim.CreateWrapAttr("odd"), "wrap 'odd'"),
        (lambda prim: prim.CreateWrapAttr().Set("pinned", 0), "wrap changes over time"),
        (lambda prim: prim.GetPointsAttr().Clear(), "no points"),
        (lambda prim: prim.CreatePurposeAttr("guide"), "purpose proxy or guide (/a)"),
        (
            lambda prim: prim.CreateXformOpOrderAttr(["xformOp:scale"]),
            "names xformOp:scale, which is missing",
        ),
        (
            lambda prim: UsdGeom.PrimvarsAPI(prim).CreatePrimvar(
                "skel:jointIndices", Sdf.ValueTypeNames.IntArray
            ).Set([0]),
            "a skeleton moves them",
        ),
        # Regression test: curves that blend shapes move were read at rest.
        (
            lambda prim: UsdSkel.BindingAPI.Apply(prim.GetPrim()).CreateBlendShapesAttr(["out"]),
            "a skeleton moves them",
        ),
    ],
)
def test_a_stage_without_curves_is_refused_with_the_reason(stage, change, words):
    change(curves(stage, "/a", [ring()]))
    with pytest.raises(ValueError, match="no curves") as error:
        io.read(saved(stage))
    assert words in str(error.value)


def test_rings_that_repeat_their_first_point_are_noted(stage):
    curves(stage, "/a", [[*loop, loop[0]] for loop in linked()], wrap="nonperiodic")
    found = io.read(saved(stage))
    assert "2 open curves end where they start; a session and the command close" in str(
        found.summary
    )
    (frame,) = found
    with pytest.warns(linkwatch.ClosingWarning):
        assert certify(frame).links == [(0, 1, -1)]


@pytest.mark.parametrize("basis", BASES)
def test_curves_of_several_bases_become_bezier_pieces(stage, basis):
    first, second = linked(basis == "bezier")
    a = curves(stage, "/a", [first], basis)
    a.CreateWidthsAttr([0.5])
    b = curves(stage, "/b", [second if basis != "bezier" else linked()[1]])
    b.CreateWidthsAttr([0.5] * 12)
    curves(stage, "/c", [ring()[:7]], "catmull-rom", "pinned").CreateWidthsAttr([0.25])
    found = io.read(saved(stage))
    assert "all are converted to Bezier pieces" in str(found.summary)
    (frame,) = found
    first_piece = {"bezier": 12}.get(basis, 36)
    assert (frame.basis, frame.counts) == ("bezier", [-first_piece, -36, 19])
    assert frame.radii == [0.25, 0.25, 0.125]
    with pytest.warns(linkwatch.UnverifiedWarning):
        assert certify(frame).links == [(0, 1, -1)]
    # Points of the same parameters are equal: the pieces begin at corners of the polyline.
    np.testing.assert_array_equal(frame.positions[first_piece : first_piece + 36 : 3], linked()[1])
    curves(stage, "/c", [ring()[:3]], "b-spline", "nonperiodic")
    (frame,) = io.read(saved(stage))
    assert frame.rejected == "/c, time code 0: curve 0 has 3 points, expected 4 or more"


def test_hermite_curves_are_bezier_pieces(stage):
    angle = 2 * math.pi * np.arange(9) / 8
    points = np.stack([np.cos(angle), np.sin(angle), 0 * angle], 1).astype(np.float32)
    points[-1] = points[0]
    tangents = 2 * math.pi / 8 * np.stack([-np.sin(angle), np.cos(angle), 0 * angle], 1)
    prim = UsdGeom.HermiteCurves.Define(stage, "/hermite")
    prim.CreatePointsAttr(points)
    prim.CreateCurveVertexCountsAttr([9])
    prim.CreateTangentsAttr(tangents.astype(np.float32))
    curves(stage, "/other", [ring(center=X, axes=(X, Z), bezier=True)], "bezier")
    found = io.read(saved(stage))
    assert "/hermite: Hermite curves, read as bezier curves" in str(found.summary)
    (frame,) = found
    assert frame.counts == [25, -12]
    a, b, c, d = frame.positions[:4]
    middle = [math.cos(math.pi / 8), math.sin(math.pi / 8), 0]
    np.testing.assert_allclose((a + 3 * b + 3 * c + d) / 8, middle, atol=1e-3)
    with pytest.warns(linkwatch.ClosingWarning):
        assert certify(frame).links == [(0, 1, -1)]
    prim.CreateTangentsAttr(tangents[:3].astype(np.float32))
    (frame,) = io.read(saved(stage))
    assert "3 tangents for 9 points" in frame.rejected


def nurbs(stage, loops, order=4, knots=None):
    prim = UsdGeom.NurbsCurves.Define(stage, "/nurbs")
    sizes = [len(loop) for loop in loops]
    prim.CreateCurveVertexCountsAttr(sizes)
    prim.CreatePointsAttr(np.concatenate(loops))
    prim.CreateOrderAttr([order] * len(loops))
    if knots is None:
        knots = np.concatenate([np.arange(n + order) / 7 for n in sizes])
    prim.CreateKnotsAttr(np.asarray(knots, float))
    return prim


def test_uniform_cubic_nurbs_are_b_splines(stage):
    loops = [np.concatenate([loop, loop[:3]]) for loop in linked()]
    prim = nurbs(stage, loops)
    prim.CreateRangesAttr([Gf.Vec2d(3 / 7, 15 / 7)] * 2)
    prim.CreatePointWeightsAttr([2.0] * 30)
    found = io.read(saved(stage))
    assert "/nurbs: NURBS curves, read as b-spline curves" in str(found.summary)
    (frame,) = found
    assert (frame.basis, frame.counts) == ("b-spline", [15, 15])
    # A spline that repeats its first three control points is closed.
    with pytest.warns(linkwatch.ClosingWarning):
        assert certify(frame).links == [(0, 1, -1)]
    nurbs(stage, [ring()], order=2).GetRangesAttr().Clear()
    stage.GetPrimAtPath("/nurbs").RemoveProperty("pointWeights")
    assert [frame.basis for frame in frames(stage)] == ["polyline"]


@pytest.mark.parametrize(
    "change, words",
    [
        (lambda p: p.CreateKnotsAttr([0, 1, 2, 3, 4, 4, 4, 4, *np.arange(5.0, 13)]), "4 equal"),
        (lambda p: p.CreateKnotsAttr([1.0] + [0.0] * 15), "has knots that decrease"),
        (lambda p: p.CreateKnotsAttr([0.0, 1.0]), "do not fit their points"),
        (lambda p: p.CreateOrderAttr([3]), "do not fit their points"),
        (lambda p: p.CreateRangesAttr([Gf.Vec2d(0.1, 1)]), "has a range outside of its knots"),
        (lambda p: p.CreatePointWeightsAttr([1.0] * 11 + [2.0]), "has different weights"),
        (lambda p: p.CreatePointWeightsAttr([1.0]), "1 pointWeights for 12 points"),
    ],
)
def test_other_nurbs_are_counted(stage, change, words):
    change(nurbs(stage, [ring()]))
    with pytest.raises(ValueError, match="no curves: not read: 1 prim .*/nurbs: .*" + words):
        io.read(saved(stage))


@pytest.mark.parametrize("order", [2, 3, 4])
def test_other_nurbs_are_their_bezier_pieces(stage, order):
    interpolate = pytest.importorskip("scipy.interpolate", reason="scipy is not installed")
    loop = ring(12)
    inside = [1, 1.5, 4, 4, 5, 6, 7.5, 8, 9, 10][: 12 - order]
    if order == 2:
        inside[3] = 4.5
    knots = np.array([0.0] * order + inside + [11.0] * order)
    ends = (0.5, 10.5)
    prim = nurbs(stage, [loop, loop], order, np.concatenate([knots, knots]))
    prim.CreateRangesAttr([Gf.Vec2d(*ends), Gf.Vec2d(0, 11)])
    prim.CreateWidthsAttr(np.linspace(1, 2, 2 * (14 - order)).astype(np.float32))
    prim.SetWidthsInterpolation("varying")
    (frame,) = frames(stage)
    assert frame.basis == "bezier"
    spline = interpolate.BSpline(knots, loop.astype(float), order - 1)
    corners = np.array([ends[0], *sorted({k for k in inside if ends[0] < k < ends[1]}), ends[1]])
    p = frame.positions[: frame.counts[0]]
    assert len(p) == 3 * len(corners) - 2
    np.testing.assert_allclose(p[::3], spline(corners), atol=1e-6)
    middle = (p[:-1:3] + 3 * p[1::3] + 3 * p[2::3] + p[3::3]) / 8
    np.testing.assert_allclose(middle, spline((corners[1:] + corners[:-1]) / 2), atol=1e-6)
    assert frame.radii[1] == 1.0


def test_clamped_nurbs_that_return_are_closed(stage):
    loops = [np.concatenate([loop, loop[:1]]) for loop in linked()]
    knots = [0.0] * 4 + [*range(1, 10)] + [10.0] * 4
    nurbs(stage, loops, 4, knots * 2)
    (frame,) = frames(stage)
    assert frame.basis == "bezier"
    with pytest.warns(linkwatch.ClosingWarning):
        assert certify(frame).links == [(0, 1, -1)]


@pytest.mark.parametrize(
    "rule, widths, radii",
    [
        (None, [0.5], [0.25, 0.25]),
        (None, np.arange(7), [1.5, 3.0]),
        ("constant", [0.5], [0.25, 0.25]),
        ("uniform", [1, 2], [0.5, 1.0]),
        ("vertex", [0, 3, 1, 2, 5, 4, 3], [1.5, 2.5]),
        ("varying", [0, 3, 1, 2, 5, 4, 3], [1.5, 2.5]),
        ("vertex", [1, 2], "2 widths with the interpolation vertex, expected 7"),
        ("odd", [1, 2], "the interpolation 'odd'"),
        ("uniform", [1, -2], "a width of -2, expected at least 0"),
        ("uniform", [1, math.nan], "a width of nan"),
    ],
)
def test_radii_are_half_of_the_largest_width(stage, rule, widths, radii):
    prim = curves(stage, "/a", [ring(4), ring(3)], wrap="periodic")
    prim.CreateWidthsAttr(np.asarray(widths, np.float32))
    if rule:
        prim.GetWidthsAttr().SetMetadata("interpolation", rule)
    (frame,) = frames(stage)
    if isinstance(radii, str):
        assert radii in frame.rejected
    else:
        assert frame.radii == radii
    # Indexed widths have precedence.
    primvar = UsdGeom.PrimvarsAPI(prim).CreatePrimvar("widths", Sdf.ValueTypeNames.FloatArray)
    primvar.Set([4.0, 6.0])
    primvar.SetIndices([1, 0])
    primvar.SetInterpolation("uniform")
    assert frames(stage)[0].radii == [3.0, 2.0]
    curves(stage, "/b", [ring()])
    found = io.read(saved(stage))
    assert "no radii, because /b has no widths" in str(found.summary)
    assert [frame.radii for frame in found] == [[]]


def test_an_invalid_frame_does_not_hide_later_ones(stage, tmp_path):
    prim = curves(stage, "/a", [ring(3)])
    points = prim.GetPointsAttr()
    points.Set(ring(3), 0)
    points.Set(ring(2), 1)
    points.Set(Sdf.ValueBlock(), 2)
    points.Set(ring(3) + np.float32(1), 3)
    found = io.read(saved(stage))
    reasons = [frame.rejected for frame in found]
    expected = "/a, time code 1: curveVertexCounts add up to 3, points has 2"
    assert reasons == [None, expected, "/a, time code 2: points has no value", None]
    assert [len(frame.positions) for frame in found] == [3] * 4
    assert str(found.summary).count("is invalid") == 2
    out = tmp_path / "a.npz"
    assert run("convert", saved(stage), out)[0] == 3
    code, said, _ = run("check", out)
    assert code == 3 and "2 invalid frames (the first one: " in said
    code, said, _ = run("check", saved(stage))
    assert (code, said.count("rejected\n")) == (3, 2)


def test_curves_that_come_and_go_are_several_files_of_one_motion(stage, tmp_path):
    prim = curves(stage, "/a", linked())
    three = [*linked(), ring(center=9 * X)]
    for time, loops in [(0, linked()), (1, linked()), (2, three), (3, three), (4, linked())]:
        prim.GetCurveVertexCountsAttr().Set([len(loop) for loop in loops], time)
        prim.GetPointsAttr().Set(np.concatenate(loops), time)
    out = tmp_path / "a.npz"
    code, said, err = run("convert", saved(stage), out)
    assert code == 0, err
    names = [out, tmp_path / "a-2.npz", tmp_path / "a-3.npz"]
    assert "linkwatch check " + " ".join(map(str, names)) + " --one-motion" in said
    code, said, err = run("check", *names, "--one-motion")
    assert code == 0, said + err
    assert "curves appeared: /a[2]" in said
    assert "5 frames verified" in said
    # Regression test: such a file was refused with `--each`.
    code, said, err = run("check", "--each", saved(stage))
    assert code == 0 and json.loads(said)["summary"]["verified"] == 5, (said, err)


def test_an_archive_has_the_largest_radius_of_each_curve(stage, tmp_path):
    # Regression test: `convert` kept the radii of the first frame.
    prim = curves(stage, "/a", linked())
    widths = prim.CreateWidthsAttr()
    prim.SetWidthsInterpolation("uniform")
    for time, both in ((0, [0.1, 0.1]), (1, [0.5, 0.1]), (2, [0.1, 0.3])):
        widths.Set(both, time)
    out = tmp_path / "a.npz"
    assert run("convert", saved(stage), out)[0] == 0
    np.testing.assert_allclose(np.load(out)["radii"], [0.25, 0.15])
    # Each frame of a check has its own.
    code, said, err = run("check", saved(stage), "--events=off")
    assert code == 0 and "3 frames verified" in said, (said, err)


def test_files_of_linkwatch_have_their_names_and_times(stage):
    UsdGeom.Scope.Define(stage, "/linkwatch")
    time = stage.GetPrimAtPath("/linkwatch").CreateAttribute(
        "linkwatch:time", Sdf.ValueTypeNames.Double
    )
    prim = curves(stage, "/linkwatch/closed", linked())
    for k in range(2):
        prim.GetPointsAttr().Set(np.concatenate(linked()), k)
        time.Set(0.1 * k, k)
    names = prim.GetPrim().CreateAttribute("linkwatch:names", Sdf.ValueTypeNames.StringArray)
    names.Set(["sleeve", "collar"])
    found = frames(stage)
    assert [frame.time for frame in found] == [0, 0.1]
    assert found[1].names == ["sleeve", "collar"]
    names.Set([])
    assert frames(stage)[0].names == []


def test_a_damaged_file_is_refused(tmp_path):
    for name, content, words in [
        ("a.usda", b'#usda 1.0\ndef "a" {\n', "Expected }"),
        ("a.usdc", b"PXR-USDC" + bytes(90), "obsolete version 0.0.0"),
        ("a.usda", b"solid x", "not a valid USD file"),
        ("a.usdz", b"PK", "not a valid USD file"),
    ]:
        path = tmp_path / name
        path.write_bytes(content)
        with pytest.raises(ValueError, match="not a valid USD file") as error:
            io.read(path)
        assert words in str(error.value)
        code, _, err = run("convert", path, tmp_path / "b.npz")
        assert code == 2
        assert err.startswith(f"error: {path}: not a valid USD file")
    with pytest.raises(FileNotFoundError):
        io.read(tmp_path / "missing.usd")


def test_a_truncated_file_is_refused_or_rejected(tmp_path):
    path = tmp_path / "a.usdc"
    stage = Usd.Stage.CreateNew(str(path))
    curves(stage, "/rings", linked())
    stage.Save()
    whole = path.read_bytes()
    for k in range(0, len(whole), len(whole) // 9 + 1):
        cut = tmp_path / f"cut-{k}.usdc"
        cut.write_bytes(whole[:k])
        with pytest.raises(ValueError, match="not a valid USD file"):
            io.read(cut)


def test_a_missing_library_is_named_with_the_way_to_install_it(stage, monkeypatch):
    curves(stage, "/a", [ring()])
    path = saved(stage)
    monkeypatch.setitem(sys.modules, "pxr.Usd", None)
    with pytest.raises(ImportError, match=r'pip install "linkwatch\[usd\]"'):
        io.read(path)


def test_a_file_that_was_written_again_is_read_again(tmp_path):
    """Regression test: USD keeps the layers of stages that are open, so the old one was read."""
    rings = [ring(), *(ring(center=(x, 0, 0), axes=(X, Z)) for x in (1, 9))]
    kept, links = [], []
    for other in rings[1:]:
        made = Usd.Stage.CreateInMemory()
        curves(made, "/a", [rings[0], other])
        made.GetRootLayer().Export(str(tmp_path / "a.usda"))
        kept.append(linkwatch.read(tmp_path / "a.usda"))
        links.append(len(certify(next(iter(kept[-1]))).links))
    assert links == [1, 0]
