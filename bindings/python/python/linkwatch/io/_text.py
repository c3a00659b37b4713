"""Text files with curves: coils of MAKEGRID, OBJ, ``.poly`` of Houdini, yarns of TexGen."""

from __future__ import annotations

from typing import TYPE_CHECKING
from xml.etree import ElementTree

import numpy as np

from . import _splines
from ._curves import Curve, Scene, curves_of_edges, ends_meet

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from ._curves import Array


class Lines:
    """The lines of a text file as words, with their numbers for messages."""

    def __init__(self, path: Path, comment: str | None = None) -> None:
        self.path = path
        self.number = 0
        self.file = open(path, encoding="utf-8-sig", errors="replace")
        self._comment = comment

    def __iter__(self) -> Iterator[list[str]]:
        """Yields the words of each line that is not empty."""
        with self.file:
            for line in self.file:
                self.number += 1
                words = (line.split(self._comment)[0] if self._comment else line).split()
                if words:
                    yield words

    def error(self, why: str) -> ValueError:
        """Returns an error that names the line."""
        return ValueError(f"{self.path}, line {self.number}: {why}")

    def numbers(self, words: Sequence[str], expected: int) -> list[float]:
        """Returns the first words as finite numbers."""
        try:
            # Fortran writes exponents with D, too.
            found = [float(word.upper().replace("D", "E")) for word in words[:expected]]
        except ValueError:
            found = []
        if len(found) < expected or not np.isfinite(found).all():
            raise self.error(f"expected {expected} numbers, found {' '.join(words)!r}")
        return found


def read_coils(path: Path) -> Scene:
    """Reads the filaments of a ``coils.*`` file of MAKEGRID: a current of 0 ends one."""
    scene, lines = Scene(), Lines(path)
    names: dict[str, int] = {}
    points: list[list[float]] = []
    ended = False
    for words in lines:
        if ended:
            raise lines.error("text after `end`: keep one block of filaments, before one `end`")
        if lines.number <= 3:
            # The last of three lines of a header is `mirror NIL`, or free text.
            if lines.number == 1 and words[0].lower() != "periods":
                raise lines.error("expected `periods N`, as MAKEGRID has it")
            try:
                lines.numbers(words, 4)
            except ValueError:
                continue
            raise lines.error("a point in the header, which has three lines: add `mirror NIL`")
        if words[0].lower() == "end":
            ended = True
            continue
        x, y, z, current = lines.numbers(words, 4)
        points.append([x, y, z])
        if current == 0:
            group = " ".join(words[4:]) or f"line {lines.number}"
            names[group] = names.get(group, 0) + 1
            name = group if names[group] == 1 else f"{group} [{names[group]}]"
            if len(points) > 2:
                scene.curves.append(Curve(np.array(points), False, name))
            else:  # a circular filament has its radius, height and current in one line
                kind = "coil(s) of MAKEGRID with fewer than 3 points"
                scene.left_out.add(kind, f"line {lines.number}")
            points = []
    if points or not ended:
        what = "before a line with the current 0" if points else "without a line `end`"
        raise lines.error(f"the file ends {what}")
    return scene


# Statements of OBJ that are no curves.
NO_CURVES = frozenset(
    "bevel bmat bsp bzp c_interp cdp con csh ctech d_interp end f fo g hole lod maplib mg mtllib "
    "o p parm res s scrv shadow_obj sp stech step surf trace_obj trim usemap usemtl vc vn vp "
    "vt".split()
)
# Those that are curves of other kinds.
UNREAD = {
    "curv2": ("curve on a surface (curv2)", "curves on surfaces (curv2)"),
    "cdc": ("free-form curve(s)", ""),
}


def read_obj(path: Path) -> Scene:
    """Reads the lines and the free-form curves of an OBJ file, as Bezier pieces if one is curved.

    The command reads all but curves of a degree above 1 itself, and faster.
    """
    scene, lines = Scene(), Lines(path, "#")
    vertices: list[list[float]] = []
    edges: list[list[int]] = []
    # The last polyline, which an edge may close.
    line: list[int] = []
    curves: list[tuple[int, list[int], list[str], list[str]]] = []
    kind, degree, knots = [""], "", list[str]()
    for lines.number, (name, *words) in _statements(lines):
        if name == "v":
            # Without a weight, and with a colour in its place, it is 1.
            vertices.append(lines.numbers([*words[:3], words[3] if len(words) == 4 else "1"], 4))
        elif name == "cstype":
            kind = words
        elif name == "deg":
            degree = words[0]
        elif name in ("l", "curv"):
            try:
                # A texture may follow the number of a vertex. Negative ones count back.
                numbers = [int(w.split("/")[0]) for w in words[2 * (name == "curv") :]]
            except ValueError:
                raise lines.error(f"expected numbers of vertices, found {words!r}") from None
            numbers = [k - 1 if k > 0 else len(vertices) + k for k in numbers]
            knots = []
            if name == "l" and len(numbers) == 2:
                if numbers == line[-1:] + line[:1]:
                    line.append(numbers[1])
                else:
                    edges.append(numbers)
            else:
                line = numbers if name == "l" else line
                spline = [degree, *kind, *words[:2]] if name == "curv" else []
                curves.append((lines.number, numbers, spline, knots))
        elif name == "parm" and words[:1] == ["u"]:
            knots += words[1:]
        elif name not in NO_CURVES:
            what, many = UNREAD.get(name, ("unknown statement(s)", ""))
            scene.left_out.add(what, f"line {lines.number}: {name!r}", many=many)
    points = np.array(vertices).reshape(-1, 4)
    curves_of_edges(points[:, :3], np.array(edges), scene, "lines")
    for lines.number, numbers, spline, knots in curves:
        if not all(0 <= k < len(points) for k in numbers):
            raise lines.error(f"a vertex beyond the {len(points)} of the file")
        try:
            control = points[numbers]
            parameters = np.array(knots, float)
            if not spline or spline[0] == "1" and _is_whole(control, spline, parameters, lines):
                # A curve that returns to its first vertex is closed, also with `keep_open`.
                closed = len(numbers) > 3 and numbers[0] == numbers[-1]
                scene.curves.append(Curve(control[: len(control) - closed, :3], closed))
                continue
            pieces = _bezier_of_obj(control, spline, parameters, lines)
            scene.curves.append(Curve(pieces, name="bezier"))
        except _Unread as why:
            scene.left_out.add("free-form curve(s)", f"line {lines.number}, {why}")
    if any(curve.name for curve in scene.curves):
        scene.basis = "bezier"
        for curve in scene.curves:
            if not curve.closed and ends_meet(curve.points, [len(curve.points)])[0]:
                curve.points, curve.closed = curve.points[:-1], True
            if not curve.name:
                curve.points = _splines.bezier(curve.points, "polyline", curve.closed)
            curve.name = ""
    return scene


class _Unread(Exception):
    """A curve that no basis represents, and why."""


def _statements(lines: Lines) -> Iterator[tuple[int, list[str]]]:
    """Yields the statements of an OBJ file, which a backslash continues on the next line."""
    begun: list[str] = []
    first = 0
    for words in lines:
        first = first or lines.number
        begun += [*words[:-1], words[-1].removesuffix("\\")]
        if not words[-1].endswith("\\"):
            yield first, [word for word in begun if word]
            begun, first = [], 0


def _is_whole(control: Array, spline: list[str], knots: Array, lines: Lines) -> bool:
    """Returns whether a curve of degree 1 is the polyline of all its control points."""
    _, *kind, first, last = spline
    ends = lines.numbers([first, last], 2)
    if kind[-1:] not in (["bezier"], ["bspline"]) or (control[:, 3] <= 0).any():
        return False
    if not len(knots):
        return True
    near = 1e-5 * np.ptp(knots)
    if len(knots) == len(control) + 2:
        knots = knots[1:-1]
        if (np.diff(knots) <= 0).any():
            return False
    return bool(ends[0] <= knots[0] + near and knots[-1] - near <= ends[1])


def _bezier_of_obj(control: Array, spline: list[str], knots: Array, lines: Lines) -> Array:
    """Returns the Bezier pieces of control points with weights, and of ``[degree, kind, ends]``."""
    degree, *kind, first, last = spline
    ends = lines.numbers([first, last], 2)
    if kind[-1:] not in (["bezier"], ["bspline"]) or degree not in ("1", "2", "3"):
        raise _Unread(f"of the cstype {' '.join(kind)!r} and degree {degree!r}")
    if kind[0] == "rat" and np.ptp(control[:, 3]) > 0:
        raise _Unread("rational, with weights that differ")
    n, d = len(control), int(degree)
    if kind[-1] == "bezier":
        knots = knots if len(knots) else np.arange((n - 1) / d + 1)
        if (n - 1) % d or len(knots) != (n - 1) // d + 1:
            raise _Unread(f"with {n} points and {len(knots)} parameters of Bezier pieces")
        knots = np.concatenate([knots[:1], np.repeat(knots, d), knots[-1:]])
    # Decimals are rounded. Some exporters write a wrong number of equidistant knots.
    near = 1e-5 * np.ptp(knots) if len(knots) else 0.0
    if len(knots) > 2 and len(knots) != n + d + 1:
        covered = ends[0] <= knots[0] + near and knots[-1] - near <= ends[1]
        if covered and np.ptp(np.diff(knots)) <= near:
            knots = np.arange(n + d + 1.0)
            ends = [knots[0], knots[-1]]
    inside = knots[1:-1]
    if len(knots) != n + d + 1 or (np.diff(knots) < 0).any() or (inside[d:] <= inside[:-d]).any():
        raise _Unread(f"with {len(knots)} knots, expected {n + d + 1} that increase")
    begin, end = max(ends[0], knots[d]), min(ends[1], knots[n])
    if begin - knots[d] <= near and knots[n] - end <= near:
        begin, end = knots[d], knots[n]
    if not begin < end:
        raise _Unread(f"with the range {ends[0]} to {ends[1]}")
    return _splines.nurbs(control[:, :3], d + 1, knots, (begin, end))


def read_poly(path: Path) -> Scene:
    """Reads the polygons of a ``.poly`` file of Houdini: ``POINTS``, ``POLYS``, ``END``.

    A polygon that ends with ``<`` is closed. Points have the numbers before the colon.
    """
    scene, lines = Scene(), Lines(path)
    points: dict[int, list[float]] = {}
    section = ""
    polygons: list[tuple[int, list[int], bool]] = []
    for words in lines:
        if words[0] in ("POINTS", "POLYS", "END"):
            section = words[0]
            continue
        label, colon, rest = " ".join(words).partition(":")
        if section not in ("POINTS", "POLYS") or not colon or not label.strip().isdigit():
            what = "expected `NUMBER: ..` below POINTS or POLYS, as Houdini writes it"
            raise lines.error(f"{what} (files of TetGen and Triangle have faces, and no curves)")
        found = rest.split()
        if section == "POINTS":
            if int(label) in points:
                raise lines.error(f"a second point with the number {label}")
            points[int(label)] = lines.numbers(found, 3)
            continue
        closed = found[-1:] == ["<"]
        try:
            numbers = [int(word) for word in found[: len(found) - closed]]
        except ValueError:
            raise lines.error(f"expected numbers of points, found {rest.strip()!r}") from None
        polygons.append((lines.number, numbers, closed))
    if section != "END":
        raise lines.error("the file ends without a line END")
    if any(0 in polygon for _, polygon, _ in polygons) and 0 not in points:
        # As in the documentation of the format, points then count from 0, whatever their numbers.
        points = dict(enumerate(points.values()))
        scene.notes.append("points are counted from 0, in their order")
    for lines.number, polygon, closed in polygons:
        missing = [number for number in polygon if number not in points]
        if missing:
            raise lines.error(f"there is no point {missing[0]}")
        if polygon[:1] == polygon[-1:] and len(polygon) > 1:
            polygon, closed = polygon[:-1], True
        if len(polygon) < 2 + closed:
            raise lines.error(f"a polygon of fewer than {2 + closed} points")
        scene.curves.append(Curve(np.array([points[number] for number in polygon]), closed))
    return scene


def read_texgen(path: Path) -> Scene:
    """Reads the yarns of a ``.tg3`` model of TexGen, as the splines through their nodes."""
    try:
        root = ElementTree.parse(path).getroot()
    except ElementTree.ParseError as why:
        raise ValueError(f"{path}: not a valid TexGen model: {why}") from None
    textiles = root.findall("Textile")
    if len(textiles) != 1:
        raise ValueError(f"{path}: {len(textiles)} elements Textile, expected 1: save one textile")
    yarns = textiles[0].findall("Yarn")
    if not yarns:
        raise ValueError(
            f"{path}: the textile has no yarns, because it was saved with minimal output; save it "
            "with standard or full output"
        )
    scene = Scene()
    repeats: list[Array] = []
    kinds = {(_interpolation(yarn).get("type") or "") for yarn in yarns}
    scene.basis = "polyline" if kinds == {"CInterpolationLinear"} else "bezier"
    for k, yarn in enumerate(yarns):
        name = f"yarn {yarn.get('index', k)}"
        nodes = yarn.findall("MasterNode")
        if len(nodes) < 2:
            raise ValueError(f"{path}: {name} has {len(nodes)} nodes, expected 2 or more")
        points, tangents = (
            np.array([_vector(path, name, node, key) for node in nodes])
            for key in ("Position", "Tangent")
        )
        try:
            points = _spline(points, tangents, _interpolation(yarn), scene.basis)
        except ValueError as why:
            many = "yarns that are not read"
            scene.left_out.add("yarn that is not read", f"{name}: {why}", many=many)
            continue
        scene.curves.append(Curve(points, False, name))
        for repeat in yarn.findall("Repeat"):
            vector = _vector(path, name, repeat, "value")
            if not any(np.array_equal(vector, other) for other in repeats):
                repeats.append(vector)
    if repeats:
        if len(repeats) > 3 or np.linalg.matrix_rank(repeats) < len(repeats):
            raise ValueError(f"{path}: {len(repeats)} repeat vectors, which span no cell")
        scene.cell = np.zeros((4, 3))
        scene.cell[: len(repeats)] = repeats
        scene.notes.append(f"the cell has the {len(repeats)} repeat vectors of the yarns")
    return scene


def _interpolation(yarn: ElementTree.Element) -> ElementTree.Element:
    """Returns how a yarn is interpolated; TexGen's default is Bezier."""
    found = yarn.find("Interpolation")
    if found is None:
        found = ElementTree.Element("Interpolation", type="CInterpolationBezier")
    return found


def _vector(path: Path, name: str, element: ElementTree.Element, key: str) -> Array:
    """Returns an attribute with three numbers."""
    text = element.get(key, "0, 0, 0" if key == "Tangent" else "")
    try:
        vector = np.array([float(number) for number in text.split(",")])
    except ValueError:
        vector = np.empty(0)
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise ValueError(f"{path}: {name}: {element.tag} has {key} {text!r}, expected 3 numbers")
    return vector


def _spline(points: Array, tangents: Array, how: ElementTree.Element, basis: str) -> Array:
    """Returns control points of the curve that TexGen makes of the nodes of a yarn.

    ``CInterpolationCubic`` is the cubic spline with knots at the integers, ``CInterpolationBezier``
    has Bezier segments whose handles are a third of the segment long.
    """
    kind, periodic = how.get("type", ""), how.get("Periodic", "1") not in ("0", "false")
    if basis == "polyline":
        return points
    if kind == "CInterpolationLinear":
        return _splines.bezier(points, "polyline", False)
    if kind == "CInterpolationCubic":
        return _splines.hermite(points, _slopes(points, periodic))
    if kind != "CInterpolationBezier":
        raise ValueError(f"interpolation {kind}")
    # A node points from the previous one to the next one, unless it has a tangent.
    before, after = points[0], points[-1]
    if periodic:
        before, after = points[-2] - (after - before), points[1] + (after - before)
    around = np.vstack([before, points, after])
    found = around[2:] - around[:-2]
    found /= np.linalg.norm(found, axis=1, keepdims=True)
    found = np.where(tangents.any(axis=1, keepdims=True), tangents, found)
    if how.get("ForceMasterNodeTangent", "0") not in ("0", "false"):
        found[:, 2] = 0
    third = np.linalg.norm(np.diff(points, axis=0), axis=1, keepdims=True) / 3
    handles = points[:-1] + found[:-1] * third, points[1:] - found[1:] * third
    return _splines.joined([points[:-1], *handles, points[1:]], False)


def _slopes(points: Array, periodic: bool) -> Array:
    """Returns the derivatives of the cubic spline through points at the integers.

    The second derivative is 0 at its ends, or the spline repeats with a period.
    """
    n = len(points) - periodic
    chords = np.diff(points, axis=0)
    matrix = np.diag(np.full(n, 4.0)) + np.diag(np.ones(n - 1), 1) + np.diag(np.ones(n - 1), -1)
    right = np.zeros((n, 3))
    right[: len(chords)] += 3 * chords[:n]
    right[1:] += 3 * chords[: n - 1]
    if periodic:
        matrix[0, -1] += 1
        matrix[-1, 0] += 1
        right[0] += 3 * chords[-1]
    else:
        matrix[0, 0] = matrix[-1, -1] = 2
    slopes = np.linalg.solve(matrix, right)
    return np.vstack([slopes, slopes[:1]]) if periodic else slopes
