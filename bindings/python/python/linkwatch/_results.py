"""Results of linkwatch as data: they can be pickled, copied, compared, and turned into a dict."""

from __future__ import annotations

import copy
import json
import math
from typing import TYPE_CHECKING, Any

from . import _arguments as arguments

if TYPE_CHECKING:
    from ._linkwatch import Certificate

Point = tuple[float, float, float]
Image = tuple[int, int, int]


class Result:
    """A result. Its fields are the annotations of its class, and cannot be changed."""

    # Not a dataclass: 13 of these were half of the time of `import linkwatch`.
    _json: dict[str, Any]
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

    def __setattr__(self, name: str, value: object) -> None:
        raise AttributeError(f"cannot assign to field {name!r}: results cannot be changed")

    def __delattr__(self, name: str) -> None:
        raise AttributeError(f"cannot delete field {name!r}: results cannot be changed")

    def _compared(self) -> dict[str, Any]:
        self._json  # all fields are there then
        return {name: value for name, value in vars(self).items() if name != "_json"}

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        return self._compared() == other._compared()

    def __hash__(self) -> int:
        return hash(tuple(map(_hashable, self._compared().values())))

    @classmethod
    def _made(cls, json: dict[str, Any], words: str, **other: Any) -> Any:
        """Creates an object of this class from the fields of the JSON and additional ones."""
        made = cls()
        vars(made).update(_json=json, _words=words)
        kinds = _KINDS.get(cls.__name__)
        if kinds is None:
            every = [field for one in cls.__mro__[-2::-1] for field in one.__annotations__.items()]
            kinds = [field for field in every if not field[0].startswith("_")]
            _KINDS[cls.__name__] = kinds
        for name, kind in kinds:
            value = other[name] if name in other else json.get(name)
            if value is None and kind == "float":
                value = math.inf
            elif isinstance(value, list) and not kind.startswith("list"):
                value = _tuple(value)
            vars(made)[name] = value
        return made


#: Names and types of the public fields of a class of results, by its name.
_KINDS: dict[str, list[tuple[str, str]]] = {}


def _tuple(value: Any) -> Any:
    """Returns a list of numbers as a tuple, also inner ones."""
    return tuple(map(_tuple, value)) if isinstance(value, list) else value


def _hashable(value: Any) -> Any:
    """Returns a field as tuples: equal ones are equal, and have one hash."""
    if isinstance(value, dict):
        return frozenset((key, _hashable(one)) for key, one in value.items())
    return tuple(map(_hashable, value)) if isinstance(value, (list, tuple)) else value


class Place(Result):
    """The place at which two curves are closest.

    >>> import linkwatch
    >>> ring = [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]
    >>> other = [[0, 0, -1], [2, 0, -1], [2, 0, 1], [0, 0, 1]]
    >>> far = [[4, 0, -1], [6, 0, -1], [6, 0, 1], [4, 0, 1]]
    >>> (change,) = linkwatch.certify([ring, far]).compare(linkwatch.certify([ring, other]))
    >>> change.place is None  # certificates do not know it, but reports do
    True
    >>> report = linkwatch.check([[ring, other], [ring, far]])
    >>> report.changes[0]["segments"], report.changes[0]["point"], report.changes[0]["distance"]
    ([1, 3], [2.5, 0.0, 0.0], 3.0)

    Attributes:
        segments: segment of each curve, from 0.
        point: midpoint of the shortest connection, in the units of the simulation.
        distance: length of the shortest connection.
    """

    segments: tuple[int, int]
    point: Point
    distance: float


class Finding(Result):
    """A finding about two curves, or one."""

    i: int
    image: Image
    names: tuple[str, ...]


class Change(Finding):
    """A linking number that differs from the expected one.

    >>> import linkwatch
    >>> ring = [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]
    >>> other = [[0, 0, -1], [2, 0, -1], [2, 0, 1], [0, 0, 1]]
    >>> far = [[4, 0, -1], [6, 0, -1], [6, 0, 1], [4, 0, 1]]
    >>> (change,) = linkwatch.certify([ring, far]).compare(linkwatch.certify([ring, other]))
    >>> (change.i, change.j), change.expected, change.found
    ((0, 1), -1, 0)

    Attributes:
        i, j: curves, from 0; equal if a curve is linked with its image.
        image: translation of the second curve, in lattice vectors; zeros without a cell.
        names: names of the curves, if they have names.
        expected: linking number of the baseline.
        found: linking number of the frame.
        place: place, if it is known.
    """

    j: int
    expected: int
    found: int
    place: Place | None


class PullThrough(Finding):
    """A passage of a curve through another one, or through itself, between two frames.

    >>> import linkwatch
    >>> ring = [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]
    >>> other = [[0, 0, -1], [2, 0, -1], [2, 0, 1], [0, 0, 1]]
    >>> far = [[4, 0, -1], [6, 0, -1], [6, 0, 1], [4, 0, 1]]
    >>> (passage,) = linkwatch.pull_throughs([ring, other], [ring, far])
    >>> passage.fraction, passage.sign, passage.point
    (0.25, 1, (1.0, 0.0, 0.0))

    Attributes:
        i, j: curves, from 0; equal if the curve passes through itself.
        image: translation of the second curve, in lattice vectors; zeros without a cell.
        names: names of the curves, if they have names.
        segments: segment of each curve, from 0.
        fraction: time as a fraction of the step between the frames.
        sign: change of the linking number: 1 or -1.
        point: place, in the units of the simulation.
        lengths: relative motion in the step, in segment lengths.
    """

    j: int
    segments: tuple[int, int]
    fraction: float
    sign: int
    point: Point
    lengths: float


class Defect(Finding):
    """A pair of curves, or a curve, that could not be decided or compared.

    >>> import linkwatch
    >>> ring = [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]
    >>> other = [[0, 0, -1], [2, 0, -1], [2, 0, 1], [0, 0, 1]]
    >>> touching = [[1, 0, -1], [3, 0, -1], [3, 0, 1], [1, 0, 1]]
    >>> (defect,) = linkwatch.certify([ring, touching]).undefined
    >>> defect.kind, (defect.i, defect.j), defect.place.point
    ('contact', (0, 1), (1.0, 0.0, 0.0))

    Attributes:
        i, j: curves, from 0; ``j`` is ``None`` if the defect concerns one curve.
        image: translation of the second curve, in lattice vectors; zeros without a cell.
        names: names of the curves, if they have names.
        kind: contact, too-close, degenerate, no-baseline, undecided-step or unaccounted.
        place: where they are closest, or the place on the curve.
    """

    j: int | None
    kind: str
    place: Place


class Clearance(Result):
    """Clearance of a frame.

    >>> import linkwatch
    >>> ring = [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]
    >>> other = [[0, 0, -1], [2, 0, -1], [2, 0, 1], [0, 0, 1]]
    >>> clearance = linkwatch.Session(radius=0.5).step([ring, other]).clearance
    >>> clearance.ratio, clearance.curves, clearance.low  # 1: the surfaces touch
    (1.0, (0, 1), False)

    Attributes:
        at_least: lower bound of the clearance of all strands.
        ratio: distance of the closest centre lines, as a share of the sum of their radii; ``None``
            if no strands are close, as the fields of these strands.
        error: upper bound of the error of the ratio: 0 for polylines.
        curves: curves of the closest strands: the same one twice for two parts of a curve.
        segments: their segments.
        image: translation of the second strand, in lattice vectors; zeros without a cell.
        points: their nearest points: that of the second strand is translated by its image.
        low: True if the clearance is below the level of the warning.
        frames_left: frames until the surfaces touch, or, if they do, until the centre lines meet;
            ``None`` if the clearance does not shrink.
    """

    at_least: float
    ratio: float | None
    error: float | None
    curves: tuple[int, int] | None
    segments: tuple[int, int] | None
    image: Image | None
    points: tuple[Point, Point] | None
    low: bool
    frames_left: float | None


class InvariantChange(Result):
    """Invariants of a knot, or of three curves, that differ from the expected ones.

    >>> import linkwatch
    >>> import numpy as np
    >>> t = 2 * np.pi * np.arange(60) / 60
    >>> r = 2 + np.cos(3 * t)
    >>> trefoil = np.stack([r * np.cos(2 * t), r * np.sin(2 * t), np.sin(3 * t)], axis=1)
    >>> session = linkwatch.Session(events="off", invariants="self")
    >>> session.step([trefoil]).verdict
    'intact'
    >>> [change] = session.step([trefoil * [1, 1, -1]]).invariants
    >>> change.expected, change.found
    ('v2 1, v3 -1, determinant 3', 'v2 1, v3 1, determinant 3')

    Attributes:
        curves: the curve, or three curves, from 0.
        expected, found: invariants in words, in the baseline and in this frame.
    """

    curves: tuple[int, ...]
    expected: str
    found: str


class Report(Result):
    """The verdict on a frame. It is true if the frame is intact.

    >>> import linkwatch
    >>> ring = [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]
    >>> other = [[0, 0, -1], [2, 0, -1], [2, 0, 1], [0, 0, 1]]
    >>> far = [[4, 0, -1], [6, 0, -1], [6, 0, 1], [4, 0, 1]]
    >>> session = linkwatch.Session()
    >>> session.step([ring, other])
    <Report: frame 0: intact>
    >>> report = session.step([ring, far], time=0.1)
    >>> print(report)
    frame 1 at 0.1 s: changed (1 link lost, 1 pull-through)
      curves 0 and 1 came apart: linking number was -1, is 0, near ...
      curves 0 and 1 passed through one another at 0.250 of the step (+1), at ...
    >>> report.abort, report.last_intact, report.safe_fraction
    (True, 0, 0.249999998)

    Attributes:
        seq: number of the frame, from 0.
        time: simulation time of the frame, in seconds.
        verdict: intact, changed, contact, undecided or rejected.
        abort: True if the policy asks the simulator to stop.
        changes: linking numbers that differ from the expected ones, sorted by pair.
        invariants: knots and triple linking numbers that differ from the expected ones.
        pull_throughs: pull-throughs since the last frame, in chronological order.
        unresolved: pull-throughs that cannot be resolved, because the frames are too far apart.
        defects: pairs and curves that could not be decided or compared, sorted by pair.
        findings: a sentence for every finding.
        appeared, gone: names of the curves that appeared since the last verified frame, and that
            are gone.
        last_intact: last frame that is known to be intact; ``None`` if there is none.
        safe_fraction: largest proven fraction of the step from the last intact frame without a
            pull-through; ``None`` if it is unknown.
        clearance: clearance of the strands; ``None`` if it is not measured.
        rejected: reason why the frame was rejected.
    """

    seq: int
    time: float
    verdict: str
    abort: bool
    changes: list[Change]
    invariants: list[InvariantChange]
    pull_throughs: list[PullThrough]
    unresolved: list[PullThrough]
    defects: list[Defect]
    findings: list[str]
    appeared: list[str]
    gone: list[str]
    last_intact: int | None
    safe_fraction: float | None
    clearance: Clearance | None
    rejected: str | None
    #: True if it is intact, and there is nothing else to tell.
    _plain: bool

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            # Most fields of most reports are never needed, so they are read when one is.
            unread = vars(self).pop("_unread", None)
            if unread is None:
                raise AttributeError(f"a report has no attribute {name!r}")
            vars(self).update(vars(_report(*unread)))
            return getattr(self, name)

    @property
    def intact(self) -> bool:
        """True if every linking number was proven to be the expected one."""
        return self.verdict == "intact"

    def __bool__(self) -> bool:
        return self.intact

    def __str__(self) -> str:
        return "\n  ".join([self._words, *self.findings])


class Strut(Result):
    """Two points of curves whose distance is a local minimum.

    >>> import linkwatch
    >>> ring = [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]
    >>> other = [[0, 0, -1], [2, 0, -1], [2, 0, 1], [0, 0, 1]]
    >>> shortest = linkwatch.struts([ring, other], longest=1.5)[0]
    >>> shortest.length, shortest.points
    (1.0, ((0.0, -1.0, 0.0), (0.0, 0.0, 0.0)))

    Attributes:
        curves: curve of each end, from 0.
        segments: segment of each end, from 0.
        t: place of each end on its segment, from 0 to 1.
        image: translation of the second curve, in lattice vectors; zeros without a cell.
        points: both ends: that of the second curve is translated by its image.
        length: distance of the ends.
        error: upper bound of the error of the length: 0 for polylines.
        gradient: derivatives of the length with respect to the start and the end of the first
            segment, and of the second one. ``None`` for splines, and if the length is 0.
    """

    curves: tuple[int, int]
    segments: tuple[int, int]
    t: tuple[float, float]
    image: Image
    points: tuple[Point, Point]
    length: float
    error: float
    gradient: tuple[tuple[Point, Point], tuple[Point, Point]] | None


class Thickness(Result):
    """Length of all curves, their sharpest bend and their shortest strut.

    >>> import linkwatch
    >>> found = linkwatch.thickness([[[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]]])
    >>> found.length, found.min_rad, found.poca is None
    (8.0, 1.0, False)

    Attributes:
        length: length of all curves.
        min_rad: radius of the sharpest bend; ``None`` if no curve bends.
        poca: shortest strut; ``None`` if there is none.
    """

    length: float
    min_rad: float | None
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


class Ribbon(Result):
    """Linking number, twist and writhe of a closed ribbon between two curves.

    >>> import linkwatch
    >>> import numpy as np
    >>> a = 2 * np.pi * np.arange(48) / 48
    >>> axis = np.stack([np.cos(a), np.sin(a), 0 * a], axis=1)
    >>> turns = np.cos(3 * a)[:, None] * axis + np.sin(3 * a)[:, None] * [0, 0, 1]  # three
    >>> found = linkwatch.ribbon([axis, axis + 0.1 * turns], pairing="parallel", axis="first")
    >>> found.linking, round(found.twist, 6), round(found.writhe, 6), found.passages
    (-3, -3.0, 0.0, 0)

    Attributes:
        linking: linking number of the two curves, in the same direction; ``None`` if they touch.
        twist, twist_error: twist about the axis, in turns, and upper bound of its error.
        writhe, writhe_error: writhe of the axis, and upper bound of its error.
        passages: signed number of passages of the ribbon through itself, linking - twist - writhe:
            0 for a ribbon; ``None`` if the errors admit several numbers.
        pairing: vertices that belong together: parallel, antiparallel, or one of these with a
            shift.
        pairing_by: reason for the pairing: given, order (of the vertices) or distances (that vary
            least).
        rivals: pairings that fit nearly as well and have another twist, as tuples (pairing, twist).
    """

    linking: int | None
    twist: float
    twist_error: float
    writhe: float
    writhe_error: float
    passages: int | None
    pairing: str
    pairing_by: str
    rivals: list[tuple[str, float]]


class Diagram(Result):
    """The reduced planar diagram of a closed curve, or of a connected group of them.

    >>> import linkwatch
    >>> import numpy as np
    >>> t = 2 * np.pi * np.arange(60) / 60
    >>> r = 2 + np.cos(3 * t)
    >>> trefoil = np.stack([r * np.cos(2 * t), r * np.sin(2 * t), np.sin(3 * t)], axis=1)
    >>> [found] = linkwatch.diagram([trefoil])
    >>> found.crossings, found.v2, abs(found.v3), found.determinant, found.name
    (3, 1, 1, 3, '3_1')

    Attributes:
        curves: the curves, from 0.
        crossings: number of crossings that are left.
        projected: number of crossings in the projection, before Reidemeister moves I and II.
        signs: sign of each crossing: 1 if the upper strand turns counterclockwise to the lower one.
        pd: PD code: the four arcs of each crossing, counterclockwise, the incoming lower one first;
            from 1. ``snappy.Link(found.pd)`` reads it.
        gauss: Gauss code of each curve: crossings from 1, negative if the curve passes below.
        dt: Dowker-Thistlethwaite code of each curve.
        determinant: that of the knot or link, ``|Delta(-1)|``; ``None`` above 20,000 crossings.
        v2, v3: Vassiliev invariants of a knot; ``v3`` is 1 for the right-handed trefoil. ``None``
            for groups of curves, and ``v3`` for a knot of more than 20,000 crossings.
        name: knot of at most 5 crossings with these invariants: ``"unknot"``, ``"3_1"``, ``"4_1"``,
            ``"5_1"``, ``"5_2"``; else ``None``.
        right_handed: handedness of this knot; ``None`` if it equals its mirror image.
        proven: true if there are at most 5 crossings, so that it is this knot. Otherwise the
            invariants are consistent with it.
        links: linking numbers that are not 0, as tuples (i, j, lambda).
        triples: Milnor's triple linking numbers that are not 0, as tuples (i, j, k, mu, modulus):
            ``mu`` is defined up to multiples of ``modulus``.
    """

    curves: tuple[int, ...]
    crossings: int
    projected: int
    signs: list[int]
    pd: list[tuple[int, int, int, int]]
    gauss: list[list[int]]
    dt: list[list[int]]
    determinant: int | None
    v2: int | None
    v3: int | None
    name: str | None
    right_handed: bool | None
    proven: bool
    links: list[tuple[int, int, int]]
    triples: list[tuple[int, int, int, int, int]]


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


def made_report(text: str, words: list[str], names: list[str], known: dict[str, Any]) -> Report:
    """Returns a report from its JSON, its sentences, and fields that are known."""
    report = Report()
    vars(report).update(known, _words=words[0], _unread=(text, words, names))
    return report


def _report(text: str, words: list[str], names: list[str]) -> Report:
    json_of = json.loads(text)
    findings = iter(words[1:])
    others: dict[str, Any] = {key: json_of.get(key, []) for key in ("appeared", "gone")}
    for name, key, kind in (
        ("changes", "changes", "Change"),
        ("invariants", "invariants", "InvariantChange"),
        ("pull_throughs", "events", "PullThrough"),
        ("defects", "defects", "Defect"),
        ("unresolved", "unresolved", "PullThrough"),
    ):
        others[name] = [_MAKERS[kind](one, [next(findings)], names) for one in json_of.get(key, [])]
    if clearance := json_of.get("clearance"):
        others["clearance"] = _clearance(clearance, words[-1:], names)
    others["findings"] = words[1 : -1 if clearance else None]
    made: Report = Report._made(json_of, words[0], **others)
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


def _diagram(json: dict[str, Any], words: list[str], names: list[str]) -> Any:
    knot = json["knots"][0] if json["knots"] else {}
    name = knot.get("name") or {}
    return Diagram._made(
        json,
        words[0],
        pd=[tuple(crossing) for crossing in json["pd"]],
        determinant=None if json["determinant"] is None else int(json["determinant"]),
        v2=knot.get("v2"),
        v3=knot.get("v3"),
        name=name.get("symbol"),
        right_handed=name.get("right_handed"),
        proven=name.get("proven", False),
        links=[(one["i"], one["j"], one["lambda"]) for one in json["links"]],
        triples=[(*one["curves"], one["mu"], one["modulus"]) for one in json["triples"]],
    )


_MAKERS: dict[str, Any] = {
    "Change": _finding(Change),
    "PullThrough": _finding(PullThrough),
    "Defect": _finding(Defect),
    "Strut": _strut,
    "Thickness": _thickness,
    "Ribbon": _ribbon,
    "Diagram": _diagram,
    "InvariantChange": lambda json, words, names: InvariantChange._made(json, words[0]),
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
