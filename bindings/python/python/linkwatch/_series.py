"""Quantities of all frames of a run, as arrays."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

import numpy as np

from . import UnverifiedWarning, _decided, _linkwatch, ribbon
from . import _arguments as arguments
from ._run import frames_of
from .io._curves import plural

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from typing import Any

    import numpy.typing as npt

    from ._linkwatch import Frame

    Array = npt.NDArray[np.float64]


def _series(
    frames: Any, described: dict[str, Any], measure: Callable[[Frame], Any], decide: bool = True
) -> Array:
    """Returns a quantity of all frames. It is NaN in invalid frames and, with a warning, in frames
    that are refused after another one had a value.

    The quantity does not depend on which curves are closed unless ``decide`` is true.
    """
    found: list[Any] = []
    refused: list[str] = []
    decided: dict[tuple[int, ...], list[int]] = {}
    source = frames_of(frames, **described)
    for frame in source:
        if frame.rejected is not None or not np.isfinite(frame.positions).all():
            found.append(None)
            continue
        given = arguments.raw(frame)
        if frame.closed_by_default or source.kind != "file" and given[3] is not None:
            sizes = tuple(map(abs, given[1]))
            first = frame.closed_by_default and sizes not in decided
            if decide and (first or given[3] is not None):
                counts = _decided(*given, first, 4)
            if decide and first:
                decided[sizes] = counts
            if frame.closed_by_default:
                given = given[0], decided.get(sizes, given[1]), *given[2:]
        try:
            found.append(np.asarray(measure(given), np.float64))
        except ValueError as why:
            if all(one is None for one in found):
                raise  # An option may be wrong.
            refused.append(f"frame {frame.seq}: {why}")
            found.append(None)
    if refused:
        number = plural(len(refused), "frame has", "frames have")
        what = f"{number} no value; {refused[0]}"
        warnings.warn(what, UnverifiedWarning, stacklevel=3)
    shapes = {one.shape for one in found if one is not None}
    if len(shapes) > 1:
        raise ValueError(f"the number of curves changes: arrays of the shapes {sorted(shapes)}")
    missing = np.full(shapes.pop() if shapes else (), np.nan)
    return np.array([missing if one is None else one for one in found], np.float64)


def _gauss(frame: Frame, pairs: Any, tolerance: float) -> Array:
    """Returns Gauss integrals, which are NaN if the bound of the error is above the tolerance."""
    tolerance = arguments.tolerance(tolerance)
    values, bounds = map(np.asarray, _linkwatch.gauss(frame, pairs, tolerance))
    return np.where(bounds <= tolerance, values, np.nan)


def writhe(frames: Any, *, tolerance: float = 1e-4, **described: Any) -> Array:
    """Computes the writhe of each curve, open or closed, in all frames.

    >>> import linkwatch
    >>> square = [[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]]
    >>> linkwatch.writhe([[square], [square]])
    array([[0.],
           [0.]])

    Args:
        frames: as of :func:`linkwatch.check`, with the same options (``closed``, ..).
        tolerance: largest error. A smaller one takes longer.

    Returns:
        numpy.ndarray: the shape ``(frames, curves)``. NaN in frames that are invalid, and for
        curves that touch themselves.

    Raises:
        ValueError: the curves are splines, their number changes, or the tolerance is not above 0.
    """
    return _series(frames, described, lambda frame: _gauss(frame, None, tolerance))


def linking(
    frames: Any, pairs: Sequence[tuple[int, int]] | None = None, **described: Any
) -> Array:
    """Computes linking numbers, exactly, in all frames.

    >>> import linkwatch
    >>> ring = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]])
    >>> other = np.array([[0, 0, -1], [2, 0, -1], [2, 0, 1], [0, 0, 1.0]])
    >>> linkwatch.linking([[ring, other + [x, 0, 0]] for x in (0, 2)], pairs=[(0, 1)])
    array([[-1.],
           [ 0.]])

    Args:
        frames: as of :func:`linkwatch.check`, with the same options (``closed``, ..).
        pairs: pairs of different curves; by default, all.

    Returns:
        numpy.ndarray: the shape ``(frames, pairs)``, or ``(frames, curves, curves)`` without
        ``pairs``. NaN in frames that are invalid, and for pairs that have no linking number.
        Numbers with periodic images are not among them: see :func:`linkwatch.certify`.

    Raises:
        IndexError: a pair does not consist of two different curves of each frame.
        ValueError: the number of curves changes.
    """
    chosen = None if pairs is None else list(pairs)

    def measure(frame: Frame) -> Any:
        points, counts, basis, cell = frame
        certificate, _ = _linkwatch.certify(points, counts, basis, False, cell)
        matrix = certificate.matrix(undefined=np.nan)
        if chosen is None:
            return matrix
        try:
            checked = [arguments.indices("a pair", pair, len(matrix)) for pair in chosen]
        except ValueError as why:
            raise IndexError(str(why)) from None
        i, j = np.array(checked, int).reshape(-1, 2).T
        return matrix[i, j]

    return _series(frames, described, measure)


def twist(frames: Any, *, described: dict[str, Any] | None = None, **options: Any) -> Array:
    """Computes the twist of a ribbon, in turns, in all frames.

    >>> import linkwatch
    >>> import numpy as np
    >>> a = 2 * np.pi * np.arange(48) / 48
    >>> axis = np.stack([np.cos(a), np.sin(a), 0 * a], axis=1)
    >>> turns = np.cos(3 * a)[:, None] * axis + np.sin(3 * a)[:, None] * [0, 0, 1]  # three
    >>> frames = [[axis, axis + width * turns] for width in (0.1, 0.2)]
    >>> linkwatch.twist(frames, pairing="parallel", axis="first").round(6)
    array([-3., -3.])

    Args:
        frames: as of :func:`linkwatch.check`; ``described`` are its options (``counts``, ..).
        options: those of :func:`linkwatch.ribbon`: ``strands``, ``pairing``, ``axis``.

    Returns:
        numpy.ndarray: the shape ``(frames,)``. NaN in frames that are invalid, or in
        which the strands touch.

    Raises:
        ValueError: the curves cannot be the strands of a ribbon, or an option is invalid.
    """

    def measure(frame: Frame) -> float:
        found = ribbon(frame[0], frame[1], **options)
        return np.nan if found.linking is None else found.twist

    return _series(frames, described or {}, measure)


def thickness(frames: Any, described: dict[str, Any]) -> Array:
    """Returns the thickness of all frames: see :func:`linkwatch.thickness`."""
    measure = lambda frame: _linkwatch.thickness(frame).thickness()  # noqa: E731
    return _series(frames, described, measure)


def gauss_integrals(
    frames: Any,
    subchains: Sequence[tuple[int, int, int]] | None = None,
    *,
    tolerance: float = 1e-4,
    **described: Any,
) -> Array:
    """Computes Gauss linking integrals of all pairs of curves, open or closed, in all frames.

    They measure how parts of chains entangle, and are the linking number if both curves are closed.

    >>> import linkwatch
    >>> crossed = [[[-1, 0, 0], [1, 0, 0]], [[0, -1, 1], [0, 1, 1]]]
    >>> found = linkwatch.gauss_integrals([crossed], closed=False)
    >>> found.shape, round(abs(float(found[0, 0, 1])), 4)
    ((1, 2, 2), 0.1667)

    Args:
        frames: as of :func:`linkwatch.check`, with the same options (``closed``, ..).
        subchains: parts of curves instead of whole ones: ``(curve, first, last)`` is the open
            polyline from one vertex of a curve to another one.
        tolerance: largest error. A smaller one takes longer.

    Returns:
        numpy.ndarray: the shape ``(frames, n, n)`` for ``n`` curves or subchains, symmetric, with
        the writhe of each one on the diagonal. NaN in frames that are invalid, and for curves that
        touch. Periodic images do not count.

    Raises:
        ValueError: the curves are splines, their number changes, there is no such subchain, or the
            tolerance is not above 0.
    """

    def measure(frame: Frame) -> Any:
        points, counts, basis, _ = frame
        if subchains is not None:
            sizes = np.abs(counts)
            starts = np.cumsum(sizes) - sizes
            for curve, first, last in subchains:
                if not (0 <= curve < len(sizes) and 0 <= first < last < sizes[curve]):
                    what = f"no subchain {curve, first, last}"
                    raise ValueError(f"{what} in {len(sizes)} curves")
            parts = [points[starts[k] + a : starts[k] + b + 1] for k, a, b in subchains]
            points, counts = np.concatenate(parts), [len(part) for part in parts]
        given = points, counts, basis, None
        matrix = np.diag(_gauss(given, None, tolerance))
        if len(counts) > 1:
            i, j = np.triu_indices(len(counts), 1)
            matrix[i, j] = matrix[j, i] = _gauss(given, [], tolerance)
        return matrix

    return _series(frames, described, measure, decide=subchains is None)
