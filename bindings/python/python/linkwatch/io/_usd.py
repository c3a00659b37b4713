"""Curves of USD stages, read by ``usd-core``, by the rules of docs/reference/formats.md."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from . import _splines
from ._curves import ends_meet, plural
from ._frames import Frame, Frames, LeftOut, Summary, library

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path
    from typing import Any

    from ._curves import Array, Options

# Bases by `type` and `basis`.
BASES = {"bezier": "bezier", "bspline": "b-spline", "catmullRom": "catmull-rom"}
# Knots of a NURBS curve whose distances differ by less than this share of their range are uniform.
KNOTS = 1e-9
# Largest number of time codes that are numbers of frames.
EXACT = 2.0**53


class Unread(Exception):
    """Reason why a prim with curves is not read."""


def read(paths: Sequence[Path], options: Options) -> Frames:
    """Opens a stage, composed with all that it refers to."""
    if len(paths) != 1:
        raise ValueError(f"{len(paths)} stages: give one that refers to the others")
    path = paths[0]
    usd = library("pxr.Usd", "usd")
    try:
        stage = usd.Stage.Open(str(path))
        # USD shares layers in a process, and keeps those that are open although their files change.
        for layer in stage.GetUsedLayers():
            if not (layer.dirty or layer.anonymous):
                layer.Reload()
    except RuntimeError as why:
        raise ValueError(f"{path}: not a valid USD file: {_reason(why)}") from None
    scene = _Scene(stage, options)
    if not scene.batches:
        found = scene.left_out.sentences()
        what = f"not read: {', '.join(found)}" if found else "no BasisCurves are defined and active"
        raise ValueError(f"{path}: no curves: {what}")
    summary = Summary(left_out=scene.left_out.sentences())
    summary.time_unit = "seconds" if scene.animated else ""
    if any(batch.basis != scene.basis for batch in scene.batches):
        bases = ", ".join(sorted({batch.basis for batch in scene.batches}))
        summary.notes.append(
            f"there are curves of several bases ({bases}): all are converted to Bezier pieces, "
            "which are rounded to double precision"
        )
    for batch in scene.batches:
        summary.curves += (n := batch.number_of_curves(scene.times[0]))
        summary.closed += n if batch.wrap == "periodic" else 0
        if batch.source:
            what = f"{batch.source} curves, read as {batch.basis} curves"
            summary.notes.append(f"{batch.path}: {what}")
    first = next(scene.frames())
    if first.basis == "polyline" and first.rejected is None:
        meet = ends_meet(first.positions, first.counts)
        met = sum(n > 0 and meets for n, meets in zip(first.counts, meet))
        if met:
            are = plural(met, "open curve ends where it starts", "open curves end where they start")
            summary.notes.append(f"{are}; a session and the command close such curves")
    bare = [batch.path for batch in scene.batches if batch.widths is None]
    if bare and len(bare) < len(scene.batches):
        summary.notes.append(f"no radii, because {bare[0]} has no widths")
    return Frames(path, scene.frames, summary, len(scene.times))


def _reason(why: RuntimeError) -> str:
    """Returns what the library says, without the places in its sources."""
    said = [line.split(" : '", 1) for line in str(why).split("Error in")]
    return next((parts[1].strip(" '\n\t") for parts in said if len(parts) == 2), str(why))


class _Scene:
    """The prims of a stage that have curves."""

    def __init__(self, stage: Any, options: Options) -> None:
        # A stage that nothing refers to is closed, and its prims are invalid then.
        self.stage = stage
        self.cell = options.cell_or(None)
        self.usd = library("pxr.Usd", "usd")
        self.geom = library("pxr.UsdGeom", "usd")
        self.left_out = LeftOut()
        self.batches: list[_Batch] = []
        for error in stage.GetCompositionErrors():
            self.left_out.add("part(s) of the stage that cannot be opened", str(error))
        prims = self._below(stage.GetPseudoRoot(), self.usd.PrimDefaultPredicate)
        for prim in prims:
            if prim.IsA(self.geom.PointInstancer):
                # Its prototypes are drawn where they are copied, and not where they are defined.
                prims.PruneChildren()
                self._copy(prim)
            else:
                self._add(prim, None)
        bases = {batch.basis for batch in self.batches}
        # A set of curves has one basis.
        self.basis = bases.pop() if len(bases) == 1 else "bezier"
        samples = {t for batch in self.batches for t in batch.samples}
        self.animated = bool(samples)
        self.times = sorted(samples) or [0.0]
        self.codes_per_second = stage.GetTimeCodesPerSecond()
        top = next(iter(stage.GetPseudoRoot().GetChildren()), None)
        # Times of frames in seconds, in files that linkwatch wrote.
        self.seconds = top and top.GetAttribute("linkwatch:time")

    def _below(self, prim: Any, predicate: Any) -> Any:
        """Returns an iterator over a prim and those below it, of instances, too."""
        return iter(self.usd.PrimRange(prim, self.usd.TraverseInstanceProxies(predicate)))

    def _copy(self, instancer: Any) -> None:
        """Adds the curves that a ``PointInstancer`` copies."""
        stage = instancer.GetStage()
        targets = self.geom.PointInstancer(instancer).GetPrototypesRel().GetForwardedTargets()
        # Prototypes are often below a prim that is not defined, so that only copies are drawn.
        predicate = self.usd.PrimIsActive & self.usd.PrimIsLoaded
        for k, target in enumerate(targets):
            prototype = stage.GetPrimAtPath(target)
            if not prototype:
                self.left_out.add("missing prototype(s)", str(target))
                continue
            prims = self._below(prototype, predicate)
            for prim in prims:
                if prim.IsA(self.geom.PointInstancer):
                    prims.PruneChildren()
                    kind = "PointInstancer(s) in the prototype of another one"
                    self.left_out.add(kind, str(prim.GetPath()))
                else:
                    self._add(prim, (instancer, k, prototype))

    def _add(self, prim: Any, copied: tuple[Any, int, Any] | None) -> None:
        """Adds the curves of a prim, or counts them as skipped."""
        geom, path = self.geom, str(prim.GetPath())
        if not prim.IsA(geom.Curves):
            has = (prim.HasAttribute(name) for name in ("points", "curveVertexCounts"))
            if all(has) and not prim.IsA(geom.Mesh):
                self.left_out.add(
                    "prim of an unknown type with curves",
                    f"{path} of type {prim.GetTypeName() or 'none'}",
                    many="prims of unknown types with curves",
                )
        elif geom.Imageable(prim).ComputePurpose() in ("proxy", "guide"):
            self.left_out.add("prim(s) with curves of purpose proxy or guide", path)
        else:
            try:
                self.batches.append(_Batch(self, prim, copied))
            except Unread as why:
                self.left_out.add("prim(s) with curves that are not read", f"{path}: {why}")

    def frames(self) -> Iterator[Frame]:
        """Yields a frame for each time code at which something has a sample."""
        numbered = self.animated and all(0 <= t <= EXACT and t == int(t) for t in self.times)
        last = None
        for k, code in enumerate(self.times):
            seq = int(code) if numbered else k
            seconds = 0.0
            if self.animated:
                own = self.seconds.Get(code) if self.seconds else None
                seconds = code / self.codes_per_second if own is None else own
            try:
                frame = self._frame(code)
            except Unread as why:
                frame = (last or Frame(np.empty((0, 3)), [])).invalid(str(why))
            else:
                last = frame
            yield dataclasses.replace(frame, seq=seq, time=seconds)

    def _frame(self, code: float) -> Frame:
        # Single precision is kept if no coordinate has to be computed.
        single = not any(b.computed or b.basis != self.basis for b in self.batches)
        cache = self.geom.XformCache(code)
        positions: list[Array] = []
        counts: list[int] = []
        names: list[str] = []
        radii: list[Array] = []
        for batch in self.batches:
            try:
                own_points, own_counts, own_radii = batch.at(code, self.basis)
                for path, matrix in batch.places(cache, code):
                    points = batch.transformed(own_points, matrix)
                    positions.append(points if single else points.astype(np.float64, copy=False))
                    counts += own_counts
                    names += batch.names(path, len(own_counts))
                    if own_radii is not None:
                        radii.append(_stretch(matrix) * own_radii)
            except Unread as why:
                raise Unread(f"{batch.path}, time code {code:g}: {why}") from None
        with_radii = all(batch.widths is not None for batch in self.batches)
        return Frame(
            positions=np.concatenate(positions) if positions else np.empty((0, 3)),
            counts=counts,
            basis=self.basis,
            cell=self.cell,
            names=names if any(batch.own_names != [] for batch in self.batches) else [],
            radii=np.concatenate(radii).tolist() if radii and with_radii else [],
        )


class _Batch:
    """A prim with curves, which a ``PointInstancer`` may copy."""

    def __init__(self, scene: _Scene, prim: Any, copied: tuple[Any, int, Any] | None) -> None:
        geom = scene.geom
        self.geom = geom
        self.prim = prim
        self.path = str(prim.GetPath())
        # The instancer, the index of the prototype, and the prototype that has the prim.
        self.copied = copied
        curves = geom.Curves(prim)
        self.points = curves.GetPointsAttr()
        self.counts = curves.GetCurveVertexCountsAttr()
        for attribute in (self.points, self.counts):
            if not attribute.HasValue():
                raise Unread(f"no {attribute.GetName()}")
        primvars = geom.PrimvarsAPI(prim)
        has_joints = primvars.FindPrimvarWithInheritance("skel:jointIndices").HasValue()
        if has_joints or prim.GetAttribute("skel:blendShapes").HasValue():
            raise Unread("a skeleton moves them")
        self.wrap = "nonperiodic"
        # Kind of the curves if they are no BasisCurves, and the knots or tangents for Bezier
        # pieces.
        self.source = ""
        self.knots: list[_Knots] = []
        self.tangents: Any = None
        attributes = [self.points, self.counts]
        if prim.IsA(geom.NurbsCurves):
            self.source = "NURBS"
            self.basis, self.knots = _basis_of_nurbs(geom.NurbsCurves(prim))
        elif prim.IsA(geom.HermiteCurves):
            self.source, self.basis = "Hermite", "bezier"
            self.tangents = geom.HermiteCurves(prim).GetTangentsAttr()
            attributes.append(self.tangents)
        elif prim.IsA(geom.BasisCurves):
            self.basis, self.wrap = _basis_and_wrap(geom.BasisCurves(prim))
        else:
            raise Unread(f"type {prim.GetTypeName()}: convert them to BasisCurves")
        primvar, attribute = primvars.GetPrimvar("widths"), curves.GetWidthsAttr()
        self.widths: Any = None
        if primvar.HasValue():
            self.widths = primvar
            attributes.append(primvar.GetAttr())
        elif attribute.HasValue():
            self.widths = attribute
            attributes.append(attribute)
        own = prim.GetAttribute("linkwatch:names")
        # Names in files that linkwatch wrote. They are empty if the curves have none.
        self.own_names = [str(name) for name in own.Get() or []] if own else None
        self.counted = not self.counts.GetTimeSamples()
        if copied:
            names = ("protoIndices", "positions", "orientations", "orientationsf", "scales", "ids")
            attributes += [copied[0].GetAttribute(name) for name in names]
        self.samples = {t for a in attributes if a for t in a.GetTimeSamples()}
        moving = {*self._times_of_transforms(prim)}
        if copied:
            moving.update(self._times_of_transforms(copied[0]))
        self.samples |= moving
        world = np.array(geom.XformCache(0.0).GetLocalToWorldTransform(prim))
        moved = copied or moving or not np.array_equal(world, np.eye(4))
        # A point beyond the end of a pinned spline may need more than single precision.
        pieces = bool(self.knots) or self.tangents is not None
        self.computed = bool(moved) or self.wrap == "pinned" or pieces

    def _times_of_transforms(self, prim: Any) -> Iterator[float]:
        """Yields the times of the samples of all transforms that move a prim."""
        while prim:
            xform = self.geom.Xformable(prim)
            order = xform.GetXformOpOrderAttr().Get() if xform else None
            for token in order or []:
                name = token.removeprefix("!invert!")
                attribute = prim.GetAttribute(name)
                if name == "!resetXformStack!":
                    continue
                if not attribute:
                    raise Unread(f"xformOpOrder of {prim.GetPath()} names {name}, which is missing")
                if attribute.HasSpline():
                    raise Unread(f"{name} of {prim.GetPath()} is a spline: write time samples")
                yield from attribute.GetTimeSamples()
            try:
                xform and xform.GetOrderedXformOps()
            except RuntimeError as why:
                raise Unread(f"transform of {prim.GetPath()}: {_reason(why)}") from None
            prim = prim.GetParent()

    def number_of_curves(self, code: float) -> int:
        """Returns the number of curves at a time, with all copies."""
        try:
            copies = sum(1 for _ in self.places(self.geom.XformCache(code), code))
        except Unread:  # the frame is invalid
            copies = 0
        return len(self.counts.Get(code) or []) * copies

    def at(self, code: float, basis: str) -> tuple[Array, list[int], Array | None]:
        """Reads the curves at a time, in their own basis or as Bezier pieces: points before the
        transform, the number of points of each curve, negative if it is closed, and radii."""
        points, counts = self.points.Get(code), self.counts.Get(code)
        if points is None or counts is None:
            raise Unread(f"{'points' if points is None else 'curveVertexCounts'} has no value")
        points, sizes = np.asarray(points), np.asarray(counts, np.int64)
        if points.dtype != np.float64:
            points = points.astype(np.float32, copy=False)  # from half precision
        for k in np.flatnonzero(sizes < 1)[:1]:
            raise Unread(f"curve {k} of curveVertexCounts has {sizes[k]} points")
        if sizes.sum() != len(points):
            raise Unread(f"curveVertexCounts add up to {sizes.sum()}, points has {len(points)}")
        radii = None if self.widths is None else self._radii(code, sizes)
        if self.wrap == "pinned":
            if (sizes < 2).any():
                raise Unread("a pinned curve of one point")
            # P[-1] = 2 P[0] - P[1], so that the spline begins at P[0]; likewise at the end.
            ends = np.cumsum(sizes)
            starts = ends - sizes
            points = points.astype(np.float64)
            first = 2 * points[starts] - points[starts + 1]
            last = 2 * points[ends - 1] - points[ends - 2]
            # The end of a curve comes before the start of the next one, at the same index.
            at = np.concatenate([ends, starts])
            points = np.insert(points, at, np.concatenate([last, first]), axis=0)
            sizes = sizes + 2
        closed = self.wrap == "periodic"
        if self.knots or self.tangents is not None or basis != self.basis:
            parts = np.split(points, np.cumsum(sizes)[:-1])
            parts = self._pieces(parts, closed, code)
            points, sizes = np.concatenate(parts), np.array([len(part) for part in parts])
        return points, (-sizes if closed else sizes).tolist(), radii

    def _pieces(self, parts: list[Array], closed: bool, code: float) -> list[Array]:
        """Returns the curves as Bezier pieces."""
        if self.knots:
            if [len(part) for part in parts] != [one.points for one in self.knots]:
                raise Unread("curveVertexCounts that do not fit the knots")
            return [_splines.nurbs(part, *one[1:]) for part, one in zip(parts, self.knots)]
        if self.tangents is not None:
            tangents = np.asarray(self.tangents.Get(code) or np.empty((0, 3)))
            sizes = [len(part) for part in parts]
            if len(tangents) != sum(sizes):
                raise Unread(f"{len(tangents)} tangents for {sum(sizes)} points")
            return list(map(_splines.hermite, parts, np.split(tangents, np.cumsum(sizes)[:-1])))
        least = {"polyline": 2, "bezier": 1}.get(self.basis, 3 if closed else 4)
        for k, part in enumerate(parts):
            if len(part) < least:
                raise Unread(f"curve {k} has {len(part)} points, expected {least} or more")
        return [_splines.bezier(part, self.basis, closed) for part in parts]

    def _radii(self, code: float, sizes: Array) -> Array:
        """Returns half of the largest width of each curve."""
        if isinstance(self.widths, self.geom.Primvar):
            found = self.widths.ComputeFlattened(code)
            authored = self.widths.HasAuthoredInterpolation()
            rule = self.widths.GetInterpolation() if authored else None
        else:
            found = self.widths.Get(code)
            rule = self.widths.GetMetadata("interpolation")
        if found is None:
            raise Unread("widths has no value")
        widths = np.asarray(found, np.float64)
        # The rule of USD is `vertex`; many files have one width without a rule.
        rule = rule or ("constant" if len(widths) == 1 else "vertex")
        parts = {
            "constant": np.array([1]),
            "uniform": np.ones_like(sizes),
            "vertex": sizes,
            "varying": self._ends_of_segments(sizes),
            "faceVarying": self._ends_of_segments(sizes),
        }.get(rule)
        if parts is None:
            raise Unread(f"widths with the interpolation {rule!r}")
        if widths.shape != (parts.sum(),):
            found = f"{len(widths)} widths with the interpolation {rule}"
            raise Unread(f"{found}, expected {parts.sum()}")
        if not (np.isfinite(widths) & (widths >= 0)).all():
            wrong = widths[~(np.isfinite(widths) & (widths >= 0))][0]
            raise Unread(f"a width of {wrong:g}, expected at least 0")
        largest = [part.max(initial=0) for part in np.split(widths, np.cumsum(parts)[:-1])]
        return 0.5 * np.broadcast_to(largest, len(sizes))

    def _ends_of_segments(self, sizes: Array) -> Array:
        """Returns the number of ends of segments of each curve."""
        if self.tangents is not None:
            return sizes
        if self.source:
            orders = [one.order for one in self.knots] or (2 if self.basis == "polyline" else 4)
            return sizes - orders + 2
        closed = self.wrap == "periodic"
        step, less = {"polyline": (1, 1), "bezier": (3, 1)}.get(self.basis, (1, 3))
        if self.wrap == "pinned":
            less = 1
        segments = sizes // step if closed else np.maximum(sizes - less, 0) // step
        return segments + (not closed)

    def places(self, cache: Any, code: float) -> Iterator[tuple[str, Array]]:
        """Yields the path and the transform to the world of each copy of the prim."""
        if self.copied is None:
            yield self.path, np.array(cache.GetLocalToWorldTransform(self.prim))
            return
        prim, index, prototype = self.copied
        instancer = self.geom.PointInstancer(prim)
        indices = instancer.GetProtoIndicesAttr().Get(code) or []
        ids = instancer.GetIdsAttr().Get(code) or range(len(indices))
        inactive = prim.GetMetadata("inactiveIds")
        skipped = set(inactive.GetAppliedItems()) if inactive else set()
        # Instances that are only invisible can be pulled through as well.
        moves = instancer.ComputeInstanceTransformsAtTime(
            code, code, instancer.IncludeProtoXform, instancer.IgnoreMask
        )
        if not len(moves) == len(ids) == len(indices):
            raise Unread(f"{prim.GetPath()}: its instances have arrays of different lengths")
        inner, _ = cache.ComputeRelativeTransform(self.prim, prototype)
        outer = cache.GetLocalToWorldTransform(prim)
        below = self.path.removeprefix(str(prototype.GetPath()).rsplit("/", 1)[0])
        for k, move in enumerate(moves):
            if indices[k] == index and ids[k] not in skipped:
                yield f"{prim.GetPath()}[{ids[k]}]{below}", np.array(inner * move * outer)

    def transformed(self, points: Array, matrix: Array) -> Array:
        """Returns points in the world."""
        if np.array_equal(matrix, np.eye(4)):
            return points
        if not np.isfinite(matrix).all() or not np.array_equal(matrix[:, 3], [0, 0, 0, 1]):
            raise Unread("a transform that is not affine, or not finite")
        moved: Array = points.astype(np.float64) @ matrix[:3, :3] + matrix[3, :3]
        return moved

    def names(self, path: str, curves: int) -> list[str]:
        """Returns the names of the curves of a copy: its path, with an index if it has several."""
        if self.own_names and len(self.own_names) == curves and self.copied is None:
            return self.own_names
        if curves == 1 and self.counted:
            return [path]
        return [f"{path}[{k}]" for k in range(curves)]


def _basis_and_wrap(curves: Any) -> tuple[str, str]:
    """Returns basis and wrap of ``BasisCurves``."""
    attributes = (curves.GetTypeAttr(), curves.GetBasisAttr(), curves.GetWrapAttr())
    kind, basis, wrap = (str(_fixed(attribute)) for attribute in attributes)
    if kind not in ("linear", "cubic"):
        raise Unread(f"type {kind!r}; linear and cubic are read")
    if kind == "cubic" and basis not in BASES:
        raise Unread(f"basis {basis!r}; {', '.join(BASES)} are read")
    if wrap not in ("nonperiodic", "periodic", "pinned"):
        raise Unread(f"wrap {wrap!r}; nonperiodic, periodic and pinned are read")
    basis = "polyline" if kind == "linear" else BASES[basis]
    # Polylines and Bezier curves reach their ends without more points.
    if wrap == "pinned" and basis in ("polyline", "bezier"):
        wrap = "nonperiodic"
    return basis, wrap


def _fixed(attribute: Any) -> Any:
    """Returns the value of an attribute, which must not change over time."""
    if attribute.GetTimeSamples():
        raise Unread(f"{attribute.GetName()} changes over time")
    return attribute.Get()


class _Knots(NamedTuple):
    """Parameters of a NURBS curve: its order, knots, and the range that is drawn."""

    points: int
    order: int
    knots: Array
    ends: tuple[float, float]


def _basis_of_nurbs(curves: Any) -> tuple[str, list[_Knots]]:
    """Returns the basis of NURBS curves, and their parameters if they become Bezier pieces."""
    attributes = (
        curves.GetCurveVertexCountsAttr(),
        curves.GetOrderAttr(),
        curves.GetKnotsAttr(),
        curves.GetRangesAttr(),
        curves.GetPointWeightsAttr(),
    )
    given = (np.asarray(_fixed(attribute) or []) for attribute in attributes)
    sizes, orders, knots, ranges, weights = given
    if len(orders) != len(sizes) or len(knots) != sizes.sum() + orders.sum():
        raise Unread("NURBS curves whose orders and knots do not fit their points")
    if len(weights) and len(weights) != sizes.sum():
        raise Unread(f"{len(weights)} pointWeights for {sizes.sum()} points")
    if len(ranges) and len(ranges) != len(sizes):
        raise Unread(f"{len(ranges)} ranges for {len(sizes)} curves")
    found = []
    uniform = True
    for k, (n, order, end) in enumerate(zip(sizes, orders, np.cumsum(sizes))):
        curve = f"NURBS curve {k}"
        if not 2 <= order <= 4 or n < order:
            raise Unread(f"{curve} of {n} points and order {order}; orders 2 to 4 are read")
        if len(weights) and np.ptp(weights[end - n : end]) > 0:
            raise Unread(f"{curve} has different weights; convert it to BasisCurves")
        start = end - n + orders[:k].sum()
        own = knots[start : start + n + order].astype(np.float64)
        # The outermost knots have no influence, and as many equal ones as the order make a gap.
        gaps = np.diff(own[1:-1])
        if not np.isfinite(own).all() or (np.diff(own) < 0).any():
            raise Unread(f"{curve} has knots that decrease, or are not finite")
        if (own[order:-1] - own[1:-order] <= 0).any():
            raise Unread(f"{curve} has {order} equal knots")
        whole = own[[order - 1, n]]
        ends = np.array(ranges[k], float) if len(ranges) else whole
        near = KNOTS * np.ptp(whole)
        if not (whole[0] - near <= ends[0] < ends[1] <= whole[1] + near):
            raise Unread(f"{curve} has a range outside of its knots")
        simple = order == 2 or (order == 4 and np.ptp(gaps) <= near)
        uniform &= bool(simple and np.allclose(ends, whole, rtol=0, atol=near))
        ends = np.clip(ends, *whole)
        found.append(_Knots(int(n), int(order), own, (float(ends[0]), float(ends[1]))))
    if uniform and len(set(orders.tolist())) == 1:
        return "polyline" if orders[0] == 2 else "b-spline", []
    return "bezier", found


def _stretch(matrix: Array) -> float:
    """Returns an upper bound of the factor by which lengths grow: exact for equal scales."""
    linear = matrix[:3, :3]
    return float(np.sqrt(np.abs(linear @ linear.T).sum(axis=1).max()))
