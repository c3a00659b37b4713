"""Results of linkwatch as data: they can be pickled, copied, compared, and turned into a dict."""

from __future__ import annotations

import copy
import json
import math
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any

from . import _arguments as arguments

if TYPE_CHECKING:
    from ._linkwatch import Certificate

Point = tuple[float, float, float]
Image = tuple[int, int, int]


@dataclass(frozen=True, repr=False)
class Result:
    """A result."""

    _json: dict[str, Any] = field(compare=False)
    _words: str

    def to_dict(self) -> dict[str, Any]:
        """Returns the fields of the result, as the command prints them with ``--json``:
        numbers, texts, lists and dicts. Numbers that are infinite are ``None``.
        """
        return copy.deepcopy(self._json)

    def __str__(self) -> str:
        return self._words

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self._words}>"

    @classmethod
    def _made(cls, json: dict[str, Any], words: str, **other: Any) -> Any:
        """Returns the object of this class, whose fields are those of the JSON and others."""
        found: dict[str, Any] = {}
        kinds = _KINDS.get(cls.__name__)
        if kinds is None:
            kinds = [(one.name, str(one.type)) for one in fields(cls)[2:]]
            _KINDS[cls.__name__] = kinds
        for name, kind in kinds:
            value = other[name] if name in other else json.get(name)
            if value is None and kind == "float":
                value = math.inf
            elif isinstance(value, list) and not kind.startswith("list"):
                value = _tuple(value)
            found[name] = value
        return cls(json, words, **found)


#: Names and types of the fields that a class of results has in addition, by its name.
_KINDS: dict[str, list[tuple[str, str]]] = {}


def _tuple(value: Any) -> Any:
    """Returns a list of numbers as a tuple, also inner ones."""
    return tuple(map(_tuple, value)) if isinstance(value, list) else value


@dataclass(frozen=True, repr=False)
class Place(Result):
    """The place at which two curves are closest."""

    #: Segment of each curve, from 0.
    segments: tuple[int, int]
    #: Midpoint of the shortest connection, in the units of the simulation.
    point: Point
    #: Length of the shortest connection.
    distance: float


@dataclass(frozen=True, repr=False)
class Finding(Result):
    """A finding about two curves, or one."""

    #: First curve, from 0.
    i: int
    #: Translation of the second curve, in vectors of the periodic cell; zeros without a cell.
    image: Image
    #: Names of the curves, if they have names.
    names: tuple[str, ...]


@dataclass(frozen=True, repr=False)
class Change(Finding):
    """A linking number that differs from the expected one."""

    #: Second curve; equal to the first one if a curve is linked with its image.
    j: int
    #: Linking number of the baseline.
    expected: int
    #: Linking number of the frame.
    found: int
    #: Place, if it is known.
    place: Place | None


@dataclass(frozen=True, repr=False)
class PullThrough(Finding):
    """A passage of a curve through another one, or through itself, between two frames."""

    #: Second curve; equal to the first one if the curve passes through itself.
    j: int
    #: Segment of each curve, from 0.
    segments: tuple[int, int]
    #: Time as a fraction of the step between the frames.
    fraction: float
    #: Change of the linking number: 1 or -1.
    sign: int
    #: Place, in the units of the simulation.
    point: Point
    #: Relative motion in the step, in segment lengths.
    lengths: float


@dataclass(frozen=True, repr=False)
class Defect(Finding):
    """A pair of curves, or a curve, that could not be decided or compared."""

    #: Second curve; ``None`` if the defect concerns one curve.
    j: int | None
    #: Reason: contact, too-close, degenerate, no-baseline, undecided-step or unaccounted.
    kind: str
    place: Place


@dataclass(frozen=True, repr=False)
class Clearance(Result):
    """Clearance of a frame."""

    #: Lower bound of the clearance of all strands.
    at_least: float
    #: Distance of the closest center lines, as a share of the sum of their radii; ``None`` if no
    #: strands are close, as the fields of these strands.
    ratio: float | None
    #: Upper bound of the error of the ratio: 0 for polylines.
    error: float | None
    #: Curves of the closest strands: the same one twice for two parts of a curve.
    curves: tuple[int, int] | None
    #: Their segments.
    segments: tuple[int, int] | None
    #: Translation of the second strand, in vectors of the periodic cell; zeros without a cell.
    image: Image | None
    #: Their nearest points: that of the second strand is translated by its image.
    points: tuple[Point, Point] | None
    #: True if the clearance is below the level of the warning.
    low: bool
    #: Frames until the surfaces touch, or, if they do, until the center lines meet; ``None`` if the
    #: clearance does not shrink.
    frames_left: float | None


@dataclass(frozen=True, repr=False)
class Report(Result):
    """The verdict on a frame. It is true if the frame is intact."""

    #: Number of the frame, from 0.
    seq: int
    #: Simulation time of the frame, in seconds.
    time: float
    #: intact, changed, contact, undecided or rejected.
    verdict: str
    #: True if the policy asks the simulator to stop.
    abort: bool
    #: Linking numbers that differ from the expected ones, sorted by pair.
    changes: list[Change]
    #: Pull-throughs since the last frame, in chronological order.
    pull_throughs: list[PullThrough]
    #: Pull-throughs that cannot be resolved, because the frames are too far apart.
    unresolved: list[PullThrough]
    #: Pairs and curves that could not be decided or compared, sorted by pair.
    defects: list[Defect]
    #: A sentence for every finding.
    findings: list[str]
    #: Names of the curves that appeared since the last verified frame, and that are gone.
    appeared: list[str]
    gone: list[str]
    #: Last frame that is known to be intact; ``None`` if there is none.
    last_intact: int | None
    #: Largest proven share of the step from the last intact frame without a pull-through; ``None``
    #: if it is unknown.
    safe_fraction: float | None
    #: Clearance of the strands; ``None`` if it is not measured.
    clearance: Clearance | None
    #: Reason why the frame was rejected.
    rejected: str | None

    @property
    def intact(self) -> bool:
        """True if every linking number was proven to be the expected one."""
        return self.verdict == "intact"

    def __bool__(self) -> bool:
        return self.intact

    def __str__(self) -> str:
        return "\n  ".join([self._words, *self.findings])


@dataclass(frozen=True, repr=False)
class Strut(Result):
    """Two points of curves whose distance is a local minimum."""

    #: Curve of each end, from 0.
    curves: tuple[int, int]
    #: Segment of each end, from 0.
    segments: tuple[int, int]
    #: Place of each end on its segment, from 0 to 1.
    t: tuple[float, float]
    #: Translation of the second curve, in vectors of the periodic cell; zeros without a cell.
    image: Image
    #: Both ends: that of the second curve is translated by its image.
    points: tuple[Point, Point]
    #: Distance of the ends.
    length: float
    #: Upper bound of the error of the length: 0 for polylines.
    error: float
    #: Derivatives of the length with respect to the start and the end of the first segment, and of
    #: the second one. ``None`` for splines, and if the length is 0.
    gradient: tuple[tuple[Point, Point], tuple[Point, Point]] | None


@dataclass(frozen=True, repr=False)
class Thickness(Result):
    """How sharply curves bend, and how close they come."""

    #: Length of all curves.
    length: float
    #: Radius of the sharpest bend; ``None`` if no curve bends.
    min_rad: float | None
    #: Shortest strut; ``None`` if there is none.
    poca: Strut | None

    def thickness(self, stiffness: float = 1.0) -> float:
        """Diameter of the thickest tube around all curves that neither bends too sharply nor
        overlaps.
        """
        stiffness = arguments.number("stiffness", stiffness)
        if not stiffness > 0:
            raise ValueError(f"stiffness is {stiffness}, expected a number above 0")
        bend = math.inf if self.min_rad is None else 2 * self.min_rad / stiffness
        return min(bend, math.inf if self.poca is None else self.poca.length)

    def ropelength(self, stiffness: float = 1.0) -> float:
        """Length divided by thickness."""
        thickness = self.thickness(stiffness)
        return self.length / thickness if thickness else math.inf


@dataclass(frozen=True, repr=False)
class Ribbon(Result):
    """Linking number, twist and writhe of a closed ribbon between two curves."""

    #: Linking number of the two curves, in the same direction; ``None`` if they touch.
    linking: int | None
    #: Twist about the axis, in turns, and upper bound of its error.
    twist: float
    twist_error: float
    #: Writhe of the axis, and upper bound of its error.
    writhe: float
    writhe_error: float
    #: Signed number of passages of the ribbon through itself, linking - twist - writhe: 0 for a
    #: ribbon; ``None`` if the errors admit several numbers.
    passages: int | None
    #: Vertices that belong together: parallel, antiparallel, or one of these with a shift.
    pairing: str
    #: Reason for the pairing: given, order (of the vertices) or distances (that are the most
    #: constant).
    pairing_by: str
    #: Pairings that fit nearly as well and have another twist, as tuples (pairing, twist).
    rivals: list[tuple[str, float]]


def made(kind: str, text: str, words: list[str], names: list[str]) -> Any:
    """Returns the results of a kind from their JSON and their sentences."""
    json_of = json.loads(text)
    if isinstance(json_of, list):
        return [_MAKERS[kind](one, [sentence], names) for one, sentence in zip(json_of, words)]
    return _MAKERS[kind](json_of, words, names)


def _finding(cls: type[Finding]) -> Any:
    def make(json: dict[str, Any], words: list[str], names: list[str]) -> Any:
        others: dict[str, Any] = {"names": ()}
        if names:
            pair = [json["i"]] if json["j"] is None else [json["i"], json["j"]]
            json["names"] = [names[curve] for curve in pair]
            others["names"] = tuple(json["names"])
        if place := json.get("place"):
            where = "near {}, segments {} and {}".format(place["point"], *place["segments"])
            others["place"] = Place._made(place, where)
        return cls._made(json, words[0], **others)

    return make


def _report(json: dict[str, Any], words: list[str], names: list[str]) -> Report:
    findings = iter(words[1:])
    others: dict[str, Any] = {"appeared": json.get("appeared", []), "gone": json.get("gone", [])}
    for name, key, kind in (
        ("changes", "changes", "Change"),
        ("pull_throughs", "events", "PullThrough"),
        ("defects", "defects", "Defect"),
        ("unresolved", "unresolved", "PullThrough"),
    ):
        others[name] = [_MAKERS[kind](one, [next(findings)], names) for one in json[key]]
    if clearance := json.get("clearance"):
        others["clearance"] = _clearance(clearance, words[-1:], names)
    others["findings"] = words[1 : -1 if clearance else None]
    made: Report = Report._made(json, words[0], **others)
    return made


def _clearance(json: dict[str, Any], words: list[str], names: list[str]) -> Any:
    closest = json["closest"] or {}
    both = [closest["i"], closest["j"]] if closest else None
    others = {key: closest.get(key) for key in ("ratio", "error", "segments", "image", "points")}
    return Clearance._made(json, words[0], curves=both, **others)


def _strut(json: dict[str, Any], words: list[str], names: list[str]) -> Any:
    a, b = json["ends"]
    ends = {one: [a[key], b[key]] for one, key in zip(ENDS, ENDS.values())}
    return Strut._made(json, words[0], **ends, gradient=json.pop("gradient"))


ENDS = {"curves": "curve", "segments": "segment", "t": "t", "points": "point"}


def _thickness(json: dict[str, Any], words: list[str], names: list[str]) -> Any:
    poca = json["poca_at"] and _strut(json["poca_at"], words[1:], names)
    return Thickness._made(json, words[0], poca=poca)


def _ribbon(json: dict[str, Any], words: list[str], names: list[str]) -> Any:
    others = {"rivals": [tuple(rival) for rival in json.pop("rivals")]}
    for name in ("twist", "writhe"):
        others[name], others[f"{name}_error"] = json[name]["value"], json[name]["bound"]
    return Ribbon._made(json, words[0], **others)


_MAKERS: dict[str, Any] = {
    "Change": _finding(Change),
    "PullThrough": _finding(PullThrough),
    "Defect": _finding(Defect),
    "Report": _report,
    "Strut": _strut,
    "Thickness": _thickness,
    "Ribbon": _ribbon,
    "dict": lambda json, words, names: json,
}


def sparse(certificate: Certificate) -> tuple[Any, Any]:
    """Returns the linking numbers, and 1 for each pair without one: see ``Certificate.sparse``."""
    import numpy as np

    from .io._frames import library

    scipy = library("scipy.sparse", "analysis", "a sparse matrix")
    n = certificate.curves
    alone = {*certificate.open, *(d.i for d in certificate.undefined if d.j is None)}
    pairs = {(d.i, d.j) for d in certificate.undefined if d.j is not None and d.i != d.j}
    pairs |= {(min(i, j), max(i, j)) for i in alone for j in range(n) if i != j}

    def symmetric(entries: Any, kind: Any) -> Any:
        i, j, value = np.array(sorted(entries), np.int64).reshape(-1, 3).T
        both = np.concatenate([i, j]), np.concatenate([j, i])
        return scipy.csr_array((np.concatenate([value, value]).astype(kind), both), shape=(n, n))

    undefined = symmetric({(i, j, 1) for i, j in pairs}, np.int8)
    return symmetric(certificate.links, np.int64), undefined
