"""Helpers of the readers: curves from edges, curves that return, cells, and files of one frame."""

from __future__ import annotations

import dataclasses
import functools
import itertools
import re
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from .. import _arguments as arguments
from .. import _linkwatch
from ._frames import Frame, Frames, LeftOut, Summary

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from typing import Any

    import numpy.typing as npt

    Array = npt.NDArray[Any]

# Number of bonds of the largest ring that is a detail of a molecule, such as an aromatic one.
SMALL_RING = 12
# Longest step between successive vertices, in lattice vectors, whose image is certain.
CERTAIN = 1 / 3


@dataclasses.dataclass
class Options:
    """Options of :func:`linkwatch.read`, besides the files."""

    closed: bool | None = None
    unwrap: bool | None = None
    cell: Any = None
    select: str = "all"
    counts: Any = None
    topic: str | None = None
    one_motion: bool = False
    keep_open: bool = False
    keep_order: bool = False

    def cell_or(self, of_the_file: Array | None) -> Array | None:
        """Returns the cell to use: three vectors and the corner."""
        if self.cell is None:
            return of_the_file
        if isinstance(self.cell, str):
            if self.cell == "none":
                return None
            self.cell = np.array([float(number) for number in self.cell.split(",")])
        return np.reshape(arguments.twelve(self.cell), (4, 3))


@dataclasses.dataclass
class Curve:
    """A curve as a file has it."""

    points: Array
    closed: bool = False
    name: str = ""
    radius: float | None = None


@dataclasses.dataclass
class Scene:
    """Curves of one time: a list, or the points of all with their numbers."""

    curves: list[Curve] = dataclasses.field(default_factory=list)
    points: Array | None = None
    #: Number of points of each curve, negative if it is closed.
    counts: list[int] = dataclasses.field(default_factory=list)
    names: list[str] = dataclasses.field(default_factory=list)
    radii: list[float] = dataclasses.field(default_factory=list)
    left_out: LeftOut = dataclasses.field(default_factory=LeftOut)
    notes: list[str] = dataclasses.field(default_factory=list)
    basis: str = "polyline"
    cell: Array | None = None
    time: float = 0.0
    seq: int | None = None
    #: Names the scene in messages.
    place: str = ""
    #: Reason why the frame is invalid.
    unfit: str = ""

    def flat(self) -> Array:
        """Returns the points of all curves as one array, and sets their counts from a list."""
        curves = self.curves
        if self.points is None and curves:
            self.points = np.concatenate([curve.points for curve in curves])
            self.counts = [-len(c.points) if c.closed else len(c.points) for c in curves]
            names = [curve.name for curve in curves]
            if all(names) and len(set(names)) == len(names):
                self.names = names
            radii = [curve.radius for curve in curves if curve.radius is not None]
            if len(radii) == len(curves):
                self.radii = radii
        if self.points is None or not len(self.points):
            found = [f"not read: {said}" for said in self.left_out.sentences()]
            raise ValueError(": ".join([f"{self.place}: no curves", *found, *self.notes]))
        if self.points.dtype not in (np.float32, np.float64):
            self.points = self.points.astype(np.float64)
        return self.points


class Rules:
    """Turns scenes into frames: the first one decides which curves are closed."""

    def __init__(self, options: Options, summary: Summary) -> None:
        self.options = options
        self.summary = summary
        for said in (summary.left_out, summary.notes, summary.rejected):
            said.clear()
        self._counts: list[int] | None = None
        self._joined: list[int] = []
        self._left_out: list[str] = []
        self._unwrapped = False
        self._last = Frame(np.empty((0, 3)), [])

    def frame(self, scene: Scene, seq: int) -> Frame:
        """Returns the frame of a scene, invalid if a curve does not fit the first frame."""
        seq = seq if scene.seq is None else scene.seq
        first = self._counts is None
        try:
            self._last = self._frame(scene, seq)
        except Unfit as why:
            if first:
                raise ValueError(f"{scene.place}: {why}") from None
            return self._last.invalid(str(why), seq=seq, time=scene.time)
        return self._last

    def _frame(self, scene: Scene, seq: int) -> Frame:
        options, points, given = self.options, scene.flat(), scene.counts
        if scene.unfit:
            raise Unfit(scene.unfit)
        if not np.isfinite(points).all():
            at = int(np.argmin(np.isfinite(points).all(axis=1)))
            raise Unfit(f"point {at} has a coordinate that is not finite")
        decide = given != self._counts
        straight = scene.basis == "polyline"
        joined = self._joined
        meet = ends_meet(points, given) if decide or joined else []
        if decide:
            may_join = [straight and (n < 0 or options.closed is not False) for n in given]
            joined = [k for k, met in enumerate(meet) if met and may_join[k]]
        counts = [*given]
        for k in joined:
            if not meet[k]:
                raise Unfit(f"the ends of curve {k}, which is closed, are apart: it was cut")
            counts[k] = 1 - abs(counts[k])
        if joined:
            points = np.delete(points, np.cumsum(np.abs(given))[joined] - 1, axis=0)
        by_request = 0
        if options.closed and straight:
            by_request = sum(count > 2 for count in counts)
            counts = [-count if count > 2 else count for count in counts]
        cell = options.cell_or(scene.cell)
        crossing = 0
        if cell is not None and options.unwrap:
            points, counts, crossing = unwrapped(points, counts, cell)
        self._say(scene, seq, crossing)
        if decide:
            self._say_closed(scene, counts, len(joined), by_request)
            self._counts, self._joined = given, joined
        return Frame(points, counts, scene.basis, scene.names, scene.radii, cell, seq, scene.time)

    def _say_closed(self, scene: Scene, counts: list[int], joined: int, by_request: int) -> None:
        """Adds which curves there are, and which ones were closed, to the summary."""
        summary, before = self.summary, f"{scene.place}: "
        if self._counts is None:
            before = ""
            summary.curves, summary.closed = len(counts), sum(count < 0 for count in counts)
        for number, what in (
            (joined, "closed, because the last point repeats the first one"),
            (by_request, "closed by a segment from the last point to the first one, as asked for"),
        ):
            if number:
                summary.notes.append(f"{before}{plural(number, 'curve is', 'curves are')} {what}")
        summary.notes += [before + note for note in scene.notes]

    def _say(self, scene: Scene, seq: int, crossing: int) -> None:
        """Adds new kinds of skipped elements and the first unwrapping to the summary."""
        summary, left_out = self.summary, scene.left_out.sentences()
        if left_out != self._left_out:
            before = "" if self._counts is None else f"{scene.place}: "
            summary.left_out += [before + said for said in left_out]
            self._left_out = left_out
        if crossing and not self._unwrapped:
            self._unwrapped = True
            segments = plural(crossing, "segment", "segments")
            summary.notes.append(
                f"unwrapped: every vertex is moved to the image nearest to the previous one; "
                f"{segments} of frame {seq} crossed the boundary of the cell"
            )


class Unfit(Exception):
    """Reason why a frame is invalid, although later ones can be read."""


def plural(number: int, one: str, many: str) -> str:
    """Returns a number with the noun in the right form."""
    return f"{number} {one if number == 1 else many}"


def ends_meet(points: Array, counts: list[int]) -> list[bool]:
    """Returns for each curve if it ends at its start (docs/reference/formats.md)."""
    return _linkwatch.ends_meet(*arguments.frame(points, counts, None))


def unwrapped(points: Array, counts: list[int], cell: Array) -> tuple[Array, list[int], int]:
    """Moves every vertex to the image that is nearest to the previous vertex of its curve.

    A closed curve that ends at another image of its start runs through the cell: it becomes an open
    one that ends there. Returns the points, the counts, and the number of segments that crossed the
    boundary of the cell.

    Raises:
        Unfit: a segment is so long that the nearest image would be a guess.
    """
    sizes = np.abs(counts)
    ends = np.cumsum(sizes)
    starts = ends - sizes
    is_closed = np.asarray(counts) < 0
    vectors, to_cell, limit = _reduced(tuple(cell.ravel().tolist()))
    steps = np.empty_like(points)
    np.subtract(points[1:], points[:-1], out=steps[1:])
    # The step to the first vertex of a curve is that from its last one, if that closes it.
    steps[starts] = (points[starts] - points[ends - 1]) * is_closed[:, None]
    steps = _times(steps, to_cell.astype(steps.dtype))
    images = np.rint(steps)
    steps -= images
    most = max(steps.max(), -steps.min())
    if most > CERTAIN:
        at = int(np.argmax(np.abs(steps).max(axis=1)))
        k = int(np.searchsorted(ends, at, side="right"))
        raise Unfit(
            f"the segment before point {at - starts[k]} of curve {k} is longer than a third of the "
            "cell, so its image would be a guess (`unwrap=False` takes coordinates as they are)"
        )
    if most > limit:
        _check_nearest(steps @ vectors, vectors)
    points = points.astype(np.float64)
    crossing = int(images.any(axis=1).sum()) if images.any() else 0
    if not crossing:
        return points, counts, 0
    around = images[starts]
    images[starts] = 0
    moved = np.cumsum(images, axis=0, dtype=np.float64)
    moved -= np.repeat(moved[starts], sizes, axis=0)
    points -= _times(moved, vectors)
    # Steps of a curve around the cell add up to its period.
    period = around + moved[ends - 1]
    yarns = np.flatnonzero(is_closed & (period != 0).any(axis=1))
    if len(yarns):
        last = points[starts[yarns]] - period[yarns] @ vectors
        points = np.insert(points, ends[yarns], last, axis=0)
        counts = [*counts]
        for k in yarns.tolist():
            counts[k] = 1 - counts[k]
    return points, counts, crossing


@functools.lru_cache(1)
def _reduced(cell: tuple[float, ...]) -> tuple[Array, Array, float]:
    """Returns the shortest vectors of a lattice, the matrix to coordinates along them, and a bound
    on these coordinates of a step below which no other image is nearer."""
    # A vector of zeros means that the direction is not periodic. Rounding gives the nearest image
    # only if vectors are nearly orthogonal.
    vectors = np.array(_linkwatch.reduced_cell([*cell])[:3])
    to_cell = np.linalg.pinv(vectors)
    # No lattice vector is shorter than the least singular value.
    limit = 0.5 / np.linalg.norm(to_cell, 2) / np.linalg.norm(vectors, axis=1).sum()
    return vectors, to_cell, limit


def frames_of_files(
    paths: Sequence[Path], parse: Callable[[Path], Scene], options: Options
) -> Frames:
    """Returns the frames of files of one frame each."""
    ordered, notes = in_order(paths, options)

    def scenes() -> Iterator[Scene]:
        for k, path in enumerate(ordered):
            scene = parse(path)
            scene.place = scene.place or str(path)
            scene.notes += notes * (k == 0)
            yield scene

    return frames_of_scenes(ordered[0], scenes, options, len(ordered))


def frames_of_scenes(
    path: Path, scenes: Callable[[], Iterator[Scene]], options: Options, length: int | None = None
) -> Frames:
    """Returns the frames of scenes, of which the first one is read at once for the summary."""
    summary = Summary()

    def load() -> Iterator[Frame]:
        rules = Rules(options, summary)
        for seq, scene in enumerate(scenes()):
            yield rules.frame(scene, seq)

    if next(load(), None) is None:
        raise ValueError(f"{path}: no frames")
    return Frames(path, load, summary, length)


def is_dump(path: Path) -> bool:
    """Returns if a file is a dump of LAMMPS."""
    with open(path, "rb") as file:
        return file.read(5) == b"ITEM:"


def in_order(paths: Sequence[Path], options: Options) -> tuple[list[Path], list[str]]:
    """Sorts files by the numbers in their names, as the command does, if the names have no other
    differences. Returns a note as well if that changes the order."""
    names = {re.sub(r"\d+(\.\d+)?", "0", str(path)) for path in paths}
    if options.keep_order or len(names) > 1:
        return [*paths], []
    found = [Path(path) for path in _linkwatch.sorted_by_number(list(paths))]
    said = "files follow one another by the numbers in their names, not as they are given"
    return found, [said] * (found != [*paths])


def _check_nearest(steps: Array, vectors: Array) -> None:
    """Raises an error if another image of a step is nearer, as it may be in an oblique cell."""
    squares = (steps**2).sum(axis=1)
    for factors in itertools.product((-1, 0, 1), repeat=3):
        if (((steps + factors @ vectors) ** 2).sum(axis=1) < squares * (1 - 1e-6)).any():
            raise Unfit(
                "a segment is so long, and the cell so oblique, that the image of its end would be "
                "a guess (`unwrap=False` takes coordinates as they are)"
            )


def _times(vectors: Array, matrix: Array) -> Array:
    """Returns vectors times a matrix, faster if it is diagonal."""
    edges = np.diag(matrix)
    product: Array = vectors * edges if (np.diag(edges) == matrix).all() else vectors @ matrix
    return product


@dataclasses.dataclass
class Molecule:
    """Curve of a connected set of nodes."""

    nodes: list[int]
    closed: bool
    #: Number of nodes that are no part of the curve.
    side: int = 0


def molecules(edges: Array) -> tuple[list[Molecule], list[list[int]]]:
    """Returns a curve for each connected set of edges, and the sets that are no curve.

    The first node of a ring is its smallest one, and the second one is the smaller neighbour of
    that node. The first node of a chain is the smaller one of its ends. If a set has branches,
    its curve is its only ring of more than ``SMALL_RING`` nodes, if that is longer than every
    chain. Without such rings, it is the longest chain, which takes the shorter way around smaller
    rings. Other sets are networks.
    """
    edges = np.sort(np.asarray(edges, np.int64).reshape(-1, 2), axis=1)
    edges = np.unique(edges[edges[:, 0] != edges[:, 1]], axis=0)
    near: dict[int, list[int]] = {}
    for a, b in edges.tolist():
        near.setdefault(a, []).append(b)
        near.setdefault(b, []).append(a)
    found: list[Molecule] = []
    networks = []
    seen: set[int] = set()
    for start in sorted(near):
        if start in seen:
            continue
        order, _ = _search(near, start)
        seen.update(order)
        degrees = {node: len(near[node]) for node in order}
        if max(degrees.values()) <= 2:
            ends = [node for node in order if degrees[node] == 1]
            found.append(Molecule(_walk(near, min(ends, default=start)), not ends))
            continue
        one = _backbone(near, order)
        if one is None:
            networks.append(order)
        else:
            found.append(one)
    return found, networks


def _search(near: dict[int, list[int]], start: int) -> tuple[list[int], dict[int, int]]:
    """Returns the nodes that can be reached, nearest first, and the node before each."""
    before = {start: start}
    order = [start]
    for node in order:
        for other in near[node]:
            if other not in before:
                before[other] = node
                order.append(other)
    return order, before


def _walk(near: dict[int, list[int]], start: int) -> list[int]:
    """Returns the nodes of a chain or ring, in order."""
    path, last, node = [start], start, min(near[start])
    while node != start:
        path.append(node)
        following = [other for other in near[node] if other != last]
        if not following:
            break
        last, node = node, following[0]
    return path


def _path(before: dict[int, int], node: int) -> list[int]:
    """Returns the nodes from one back to the start of a search."""
    path = [node]
    while before[node] != node:
        node = before[node]
        path.append(node)
    return path


def _backbone(near: dict[int, list[int]], nodes: list[int]) -> Molecule | None:
    """Returns the curve of a set with branches, or ``None`` if it is a network."""
    order, _ = _search(near, nodes[-1])
    order, before = _search(near, order[-1])
    chain = _path(before, order[-1])
    rings: list[list[int]] = []
    for a in nodes:
        for b in near[a]:
            if a < b and before[a] != b and before[b] != a:
                # An edge that is no part of the search closes a ring.
                one, other = _path(before, a), _path(before, b)
                while len(one) > 1 and len(other) > 1 and one[-2] == other[-2]:
                    one.pop()
                    other.pop()
                ring = one + other[-2::-1]
                if len(ring) > SMALL_RING:
                    rings.append(ring)
    if not rings:
        path = chain if chain[0] < chain[-1] else chain[::-1]
        return Molecule(path, False, len(nodes) - len(chain))
    ring = min(rings, key=len)
    # Rings that differ in a small one only are the same loop.
    same = all(len(set(ring) ^ set(other)) <= SMALL_RING for other in rings)
    if not same or len(ring) <= len(chain):
        return None
    at = ring.index(min(ring))
    ring = ring[at:] + ring[:at]
    if ring[-1] < ring[1]:
        ring[1:] = ring[:0:-1]
    return Molecule(ring, True, len(nodes) - len(ring))


def curves_of_edges(points: Array, edges: Array, scene: Scene, what: str) -> None:
    """Adds the curves that edges between points make; ``what`` names an edge, in the plural."""
    if len(edges) and (edges.min() < 0 or edges.max() >= len(points)):
        raise ValueError(f"{what} refer to point {edges.max()}, but there are {len(points)} points")
    found, networks = molecules(edges)
    scene.curves += [Curve(points[one.nodes], one.closed) for one in found if not one.side]
    branched = [one.nodes for one in found if one.side] + networks
    for nodes in branched:
        scene.left_out.add(f"set(s) of {what} with branches", f"at point {min(nodes)}")
    if found:
        scene.notes.append(f"{what} that share a point are joined")
