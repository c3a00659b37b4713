"""Verifies the topology of simulations of yarn, chainmail, rods, ring polymers and other curves.

A *frame* is a list of curves. All functions take frames in one of two forms:

- a sequence of arrays of the shape ``(n, 3)``, one for each curve, and ``closed``: one boolean, or
  one for each curve;
- one array of the shape ``(N, 3)`` and ``counts``, the number of points of each curve, negative if
  the curve is closed. This form is not copied if it is contiguous.

Coordinates are ``float32`` or ``float64``, and are verified in the precision that they have. A
closed curve does not repeat its first point. ``basis`` is ``"polyline"``, ``"catmull-rom"``,
``"b-spline"`` or ``"bezier"``.

>>> import linkwatch
>>> ring = [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]
>>> other = [[0, 0, -1], [2, 0, -1], [2, 0, 1], [0, 0, 1]]
>>> linkwatch.certify([ring, other]).links
[(0, 1, -1)]
"""

from __future__ import annotations

import operator
from typing import TYPE_CHECKING

from ._linkwatch import Certificate, Change, Defect, Place, PullThrough, Report, __version__
from ._linkwatch import Verifier as _Verifier

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from typing import Any

    import numpy.typing as npt

    Frame = Sequence[npt.ArrayLike] | npt.NDArray[Any]
    Counts = Sequence[int] | npt.NDArray[Any]
    Closed = bool | Sequence[bool]

__all__ = [
    "Certificate",
    "Change",
    "Defect",
    "Place",
    "PullThrough",
    "Report",
    "UndecidedError",
    "Verifier",
    "assert_intact",
    "certify",
    "pull_throughs",
    "safe_fraction",
]


class UndecidedError(Exception):
    """It cannot be decided what happened: curves touch, or are too close."""


def _frame(
    curves: Frame, counts: Counts | None, closed: Closed
) -> tuple[npt.NDArray[Any], list[int]]:
    """Returns the points of all curves as one array, and the counts."""
    # Here, so that importing the package takes no time.
    import numpy as np

    if counts is None:
        if isinstance(curves, np.ndarray) and curves.ndim == 2:
            raise ValueError("one array of points needs counts, the number of points of each curve")
        arrays = [np.asarray(curve) for curve in curves]
        if not arrays:
            raise ValueError("the frame holds no curves")
        for i, array in enumerate(arrays):
            if array.ndim != 2 or array.shape[1] != 3:
                raise ValueError(f"curve {i} has the shape {array.shape}, expected (n, 3)")
        flags = [closed] * len(arrays) if isinstance(closed, bool) else list(closed)
        if len(flags) != len(arrays):
            raise ValueError(f"closed has {len(flags)} values for {len(arrays)} curves")
        counts = [-len(a) if flag else len(a) for a, flag in zip(arrays, flags)]
        types = {str(array.dtype) for array in arrays if array.dtype.kind == "f"}
        if len(types) > 1:
            raise ValueError(f"curves have different types: {', '.join(sorted(types))}")
        points = np.concatenate(arrays)
    else:
        points = np.asarray(curves)
        counts = _integers(counts)
    if points.dtype.kind == "f" and points.dtype.itemsize not in (4, 8):
        raise ValueError(f"points have the type {points.dtype}, expected float32 or float64")
    single = points.dtype.type is np.float32
    return np.ascontiguousarray(points, np.float32 if single else np.float64), counts


def _integers(counts: Counts) -> list[int]:
    """Returns the counts as a list, which a verifier does once."""
    return counts if isinstance(counts, list) else [operator.index(n) for n in counts]


class Verifier:
    """Verifies successive frames of the same curves.

    Args:
        counts: number of points of each curve, negative if the curve is closed, if frames are
            single arrays.
        closed: whether curves are closed, if frames are sequences of arrays.
        basis: rule that turns points into curves.
        baseline: expected linking numbers; by default those of the first frame.
        events: pull-throughs to search for from frame to frame: ``"between"`` different curves,
            ``"all"`` (also of a curve through itself) or ``"off"``.
        abort_on: findings that set ``Report.abort``: ``"any"``, ``"lost"``, ``"gained"``,
            ``"contact"``, ``"event"``, ``"rejected"`` or ``"never"``.
        incremental: compute only linking numbers that may have changed. The verdicts are the same.
        motion_limit: motion between two frames, in segment lengths, up to which pull-throughs that
            cancel count as real.

    Raises:
        ValueError: an option has an invalid value, or has no effect.
    """

    def __init__(
        self,
        counts: Counts | None = None,
        *,
        closed: Closed = True,
        basis: str = "polyline",
        baseline: Certificate | None = None,
        events: str = "between",
        abort_on: str = "any",
        incremental: bool = True,
        motion_limit: float | None = None,
    ) -> None:
        self._counts = None if counts is None else _integers(counts)
        self._closed = closed
        self._verifier = _Verifier(
            basis_name=basis,
            baseline=baseline,
            events=events,
            abort_on=abort_on,
            incremental=incremental,
            motion_limit=motion_limit,
        )

    def step(self, curves: Frame, time: float = 0.0) -> Report:
        """Verifies the next frame, and returns its :class:`Report`.

        Other threads of Python run meanwhile. A frame that breaks its contract (NaN, other curves
        than before) has the verdict ``"rejected"``.

        Raises:
            ValueError: the frame does not have one of the two forms, or does not fit the baseline.
        """
        return self._verifier.step(*_frame(curves, self._counts, self._closed), time)

    def cut(self) -> None:
        """Marks the next frame as not continuing the previous one: after a roll back or a jump."""
        self._verifier.cut()

    @property
    def baseline(self) -> Certificate | None:
        """Expected linking numbers (:class:`Certificate`), or ``None`` before the first frame."""
        return self._verifier.baseline()


def certify(
    curves: Frame,
    counts: Counts | None = None,
    *,
    closed: Closed = True,
    basis: str = "polyline",
) -> Certificate:
    """Computes the linking numbers of all pairs of closed curves, exactly.

    Returns:
        Certificate: all linking numbers that are not 0, and the pairs that touch.

    Raises:
        ValueError: a coordinate is not finite, or a curve has too few points.
    """
    verifier = Verifier(counts, closed=closed, basis=basis, events="off")
    return verifier._verifier.certify(*_frame(curves, counts, closed))


def _step(
    x0: Frame, x1: Frame, counts: Counts | None, closed: Closed, basis: str, events: str
) -> list[Report]:
    """Returns the reports on two successive frames."""
    verifier = Verifier(counts, closed=closed, basis=basis, events=events, incremental=False)
    reports = [verifier.step(x) for x in (x0, x1)]
    for k, report in enumerate(reports):
        if report.verdict == "rejected":
            raise ValueError(f"x{k}: {report.rejected}")
    return reports


def pull_throughs(
    x0: Frame,
    x1: Frame,
    counts: Counts | None = None,
    *,
    closed: Closed = True,
    basis: str = "polyline",
    events: str = "all",
) -> list[PullThrough]:
    """Finds every passage of a curve through another one, or through itself, between two frames.

    Points move on straight lines at constant speed.

    Returns:
        list[PullThrough]: in chronological order, with the time as a fraction of the step.

    Raises:
        UndecidedError: curves touch in a frame, or are too close to decide.
        ValueError: a coordinate is not finite, or a curve has too few points.
    """
    reports = _step(x0, x1, counts, closed, basis, events)
    undecided = [d for r in reports for d in r.defects if d.kind != "no-baseline"]
    if undecided:
        raise UndecidedError("; ".join(str(d) for d in undecided))
    found = reports[1].pull_throughs + reports[1].unresolved
    return sorted(found, key=lambda p: p.fraction)


def safe_fraction(
    x0: Frame,
    x1: Frame,
    counts: Counts | None = None,
    *,
    closed: Closed = True,
    basis: str = "polyline",
    events: str = "all",
) -> float:
    """Returns the largest proven share of the step from ``x0`` to ``x1`` without a pull-through.

    The share ``f`` is 1 if the step to ``x1`` is safe, and 0 if nothing is proven. Otherwise the
    step from ``x0`` to ``x0 + f * (x1 - x0)`` is proven, with every operation rounded to the
    precision of the points, and usually ends within a millionth of the step of the first
    pull-through. Two curves almost touch there.

    Raises:
        ValueError: a coordinate is not finite, or a curve has too few points.
    """
    share = _step(x0, x1, counts, closed, basis, events)[1].safe_fraction
    return 0.0 if share is None else share


def assert_intact(
    frames: Iterable[Frame],
    counts: Counts | None = None,
    *,
    baseline: Certificate | None = None,
    **options: Any,
) -> None:
    """Fails unless every frame is intact; for tests of simulations.

    Args:
        frames: frames of one simulation, in order.
        counts, baseline, options: those of :class:`Verifier`.

    Raises:
        AssertionError: names the first frame that is not intact, its curves and the place.
    """
    verifier = Verifier(counts, baseline=baseline, **options)
    verified = 0
    for frame in frames:
        report = verifier.step(frame)
        if not report.intact:
            raise AssertionError(str(report))
        verified += 1
    if verified == 0:
        raise AssertionError("no frame was verified")
