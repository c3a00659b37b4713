"""Writes the USD files of this folder with Pixar's library: pip install usd-core; python usd.py

Two rings that are linked once, in every basis, and hierarchies, time samples and widths. The files
`*-flat.usdc` have the points of the world, as Pixar's library computes them.
"""

import math
import sys
from pathlib import Path

from pxr import Gf, Sdf, Usd, UsdGeom, UsdUtils, Vt

FOLDER = Path(sys.argv[1] if len(sys.argv) > 1 else __file__).resolve()
FOLDER = FOLDER if FOLDER.is_dir() else FOLDER.parent


def ring(n=12, center=(0, 0, 0), axes=((1, 0, 0), (0, 1, 0)), bezier=False):
    """Control points of a ring. As Bezier pieces they are close to a circle."""
    points = []
    for k in range(n):
        angle, radius = 2 * math.pi * k / n, 1.0
        if bezier and k % 3:
            arc = 2 * math.pi / (n // 3)
            reach = 4 / 3 * math.tan(arc / 4)
            angle = arc * (k // 3 + (k % 3 == 2)) + (1 if k % 3 == 1 else -1) * math.atan(reach)
            radius = math.hypot(1, reach)
        u, v = (Gf.Vec3d(*axis) for axis in axes)
        offset = radius * (math.cos(angle) * u + math.sin(angle) * v)
        points.append(Gf.Vec3f(Gf.Vec3d(*center) + offset))
    return points


def linked(bezier=False):
    return ring(bezier=bezier), ring(center=(1, 0, 0), axes=((1, 0, 0), (0, 0, 1)), bezier=bezier)


def curves(stage, path, loops, kind="linear", basis=None, wrap="periodic"):
    prim = UsdGeom.BasisCurves.Define(stage, path)
    prim.CreateTypeAttr(kind)
    if basis:
        prim.CreateBasisAttr(basis)
    prim.CreateWrapAttr(wrap)
    prim.CreateCurveVertexCountsAttr([len(loop) for loop in loops])
    if loops and loops[0]:
        prim.CreatePointsAttr([point for loop in loops for point in loop])
    return prim


def new(name):
    stage = Usd.Stage.CreateNew(str(FOLDER / name))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    return stage


def bases():
    for kind, basis, name in [
        ("linear", None, "linear.usda"),
        ("cubic", "bezier", "bezier.usdc"),
        ("cubic", "bspline", "bspline.usdc"),
        ("cubic", "catmullRom", "catmull-rom.usda"),
    ]:
        stage = new(name)
        prim = curves(stage, "/rings", linked(basis == "bezier"), kind, basis)
        prim.CreateWidthsAttr([0.25, 0.5])
        prim.SetWidthsInterpolation("uniform")
        stage.Save()
    stage = new("open.usdc")
    arc = ring()[:7]
    curves(stage, "/bezier", [arc], "cubic", "bezier", "nonperiodic")
    prim = curves(stage, "/pinned", [ring()[:4], ring()[4:6]], "cubic", "bezier", "pinned")
    prim.CreateCurveVertexCountsAttr([4, 4])
    prim.CreatePointsAttr(ring()[:8])
    stage.Save()
    for basis, name in [
        ("bspline", "pinned-bspline.usda"),
        ("catmullRom", "pinned-catmull-rom.usdc"),
    ]:
        stage = new(name)
        loops = [ring()[:4], ring()[4:6], ring()[6:11]]
        prim = curves(stage, "/strands", loops, "cubic", basis, "pinned")
        # One at each end of a segment.
        prim.CreateWidthsAttr([0.1, 0.2, 0.3, 0.4, 0.5, 0.4, 0.1, 0.2, 0.7, 0.2, 0.1])
        prim.SetWidthsInterpolation("varying")
        stage.Save()


def pulled_apart():
    """Two rings at 30 time codes per second, one moved by its points, one by its transform."""
    for name in ["apart.usda", "apart.usdc"]:
        stage = new(name)
        stage.SetTimeCodesPerSecond(30)
        first, second = linked()
        a = curves(stage, "/yarn/a", [first])
        b = curves(stage, "/yarn/b", [second])
        for time, shift in [(10, 0.0), (12, 0.5), (14, 1.5), (16, 3.0)]:
            moved = [point - Gf.Vec3f(shift, 0, 0) for point in first]
            a.GetPointsAttr().Set(Vt.Vec3fArray(moved), time)
        move = b.AddTranslateOp()
        move.Set(Gf.Vec3d(0, 0, 0), 10)
        move.Set(Gf.Vec3d(0, 0, 0.5), 15)
        b.CreateWidthsAttr([0.5])
        b.SetWidthsInterpolation("constant")
        a.GetWidthsAttr().Set(Vt.FloatArray([0.25] * len(first)))
        stage.Save()


def hierarchy():
    """Every operation, in a hierarchy with prims that do not count."""
    stage = new("transforms.usda")
    stage.SetFramesPerSecond(25)
    top = UsdGeom.Xform.Define(stage, "/top")
    top.AddTranslateOp().Set(Gf.Vec3d(3, -2, 1))
    top.AddRotateXYZOp().Set(Gf.Vec3f(10, 20, 30))
    top.AddScaleOp().Set(Gf.Vec3f(2, 2, 2))
    first, second = linked()
    a = curves(stage, "/top/a", [first])
    pivot = a.AddTranslateOp(opSuffix="pivot")
    pivot.Set(Gf.Vec3d(0.5, 0.25, -1))
    turn = a.AddOrientOp(UsdGeom.XformOp.PrecisionDouble)
    for time, angle in [(0, 0.0), (1, 50.0), (4, 170.0)]:
        turn.Set(Gf.Quatd(Gf.Rotation(Gf.Vec3d(1, 2, 3), angle).GetQuat()), time)
    a.AddRotateZYXOp(UsdGeom.XformOp.PrecisionHalf).Set(Gf.Vec3h(5, -7, 11))
    a.AddTranslateOp(opSuffix="pivot", isInverseOp=True)
    b = curves(stage, "/top/b", [second, first])
    b.AddTransformOp().Set(Gf.Matrix4d(1, 0.5, 0, 0, 0, 1, 0.25, 0, 0, 0, -1, 0, 1, 2, 3, 1))
    spin = b.AddRotateYOp()
    for time, angle in [(0, 0.0), (2, 90.0)]:
        spin.Set(angle, time)
    apart = curves(stage, "/top/b/world", [first])
    apart.SetResetXformStack(True)
    for add, value in [
        (apart.AddTranslateXOp, 4.0),
        (apart.AddRotateXOp, 30.0),
        (apart.AddRotateZOp, 60.0),
        (apart.AddScaleZOp, 0.5),
    ]:
        add().Set(value)
    for k, order in enumerate(["XZY", "YXZ", "YZX", "ZXY"]):
        prim = curves(stage, f"/top/turn_{order}", [second])
        getattr(prim, f"AddRotate{order}Op")().Set(Gf.Vec3f(20 + k, 40, -60))
    counted = [prim.GetPath() for prim in stage.Traverse() if prim.IsA(UsdGeom.BasisCurves)]
    curves(stage, "/guide", [first]).CreatePurposeAttr("guide")
    curves(stage, "/off", [first]).GetPrim().SetActive(False)
    proxy = UsdGeom.Xform.Define(stage, "/low")
    proxy.CreatePurposeAttr("proxy")
    curves(stage, "/low/curves", [first])
    stage.CreateClassPrim("/kind")
    curves(stage, "/kind/curves", [first])
    UsdGeom.Mesh.Define(stage, "/mesh")
    stage.Save()
    flat = new("transforms-flat.usdc")
    flat.SetTimeCodesPerSecond(25)
    for path in counted:
        source = UsdGeom.BasisCurves(stage.GetPrimAtPath(path))
        name = "/flat/" + path.pathString.strip("/").replace("/", "_")
        counts = source.GetCurveVertexCountsAttr().Get()
        target = curves(flat, name, [[None] * n for n in counts][:0])
        target.CreateCurveVertexCountsAttr(counts)
        for time in [0, 1, 2, 4]:
            world = UsdGeom.XformCache(time).GetLocalToWorldTransform(source.GetPrim())
            local = source.GetPointsAttr().Get(time)
            points = [Gf.Vec3f(world.Transform(Gf.Vec3d(p))) for p in local]
            target.CreatePointsAttr().Set(Vt.Vec3fArray(points), time)
    flat.Save()


def others():
    stage = new("composed.usda")
    prim = curves(stage, "/rings", linked())
    stage.DefinePrim("/copy").GetReferences().AddInternalReference("/rings")
    stage.Save()
    # Long enough for compressed arrays: many rings of one size, and the table of widths.
    stage = new("many.usdc")
    rings = []
    for k in range(24):
        axes = ((1, 0, 0), (0, 1, 0)) if k % 2 == 0 else ((1, 0, 0), (0, 0, 1))
        rings.append(ring(8, (1.25 * k, 0, 0), axes))
    prim = curves(stage, "/chain", rings)
    prim.CreateWidthsAttr([0.125 if k % 3 else 0.25 for k in range(24)])
    prim.SetWidthsInterpolation("uniform")
    stage.Save()
    layer = str(FOLDER / "apart.usdc")
    UsdUtils.CreateNewUsdzPackage(layer, str(FOLDER / "apart.usdz"))


bases()
pulled_apart()
hierarchy()
others()
