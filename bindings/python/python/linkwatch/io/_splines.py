"""Splines as cubic Bezier pieces, with the same points at all parameters, up to rounding."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from ._curves import Array


def bezier(points: Array, basis: str, closed: bool) -> Array:
    """Returns the control points of a curve as Bezier pieces, with the last one if it is open."""
    points = points.astype(np.float64)
    if basis == "bezier":
        return points
    if basis == "polyline":
        # The pieces p, p, q, q are the segments exactly.
        p, q = (points, np.roll(points, -1, 0)) if closed else (points[:-1], points[1:])
        return joined([p, p, q, q], closed)
    if closed:
        points = np.concatenate([points, points[:3]])
    p0, p1, p2, p3 = (points[k : len(points) - 3 + k] for k in range(4))
    if basis == "b-spline":
        first, last = (p0 + 4 * p1 + p2) / 6, (p1 + 4 * p2 + p3) / 6
        return joined([first, (2 * p1 + p2) / 3, (p1 + 2 * p2) / 3, last], closed)
    return joined([p1, p1 + (p2 - p0) / 6, p2 - (p3 - p1) / 6, p2], closed)


def joined(pieces: list[Array], closed: bool) -> Array:
    """Returns the control points of pieces, of which each one begins where the last one ends."""
    control = np.stack(pieces[:3], axis=1).reshape(-1, 3)
    return control if closed else np.concatenate([control, pieces[3][-1:]])


def hermite(points: Array, tangents: Array) -> Array:
    """Returns the Bezier pieces of an open curve with a tangent at each of its points."""
    points, tangents = points.astype(np.float64), tangents.astype(np.float64) / 3
    return joined(
        [points[:-1], points[:-1] + tangents[:-1], points[1:] - tangents[1:], points[1:]], False
    )


def nurbs(points: Array, order: int, knots: Array, ends: tuple[float, float]) -> Array:
    """Returns the Bezier pieces of a B-spline of order 2 to 4 between two of its parameters."""
    degree, knots = order - 1, knots.astype(np.float64)
    # Spans of the curve that are no point.
    spans = np.flatnonzero(np.diff(knots) > 0)
    spans = spans[(spans >= degree) & (spans < len(points))]
    spans = spans[(knots[spans] < ends[1]) & (knots[spans + 1] > ends[0])]
    first, last = np.maximum(knots[spans], ends[0]), np.minimum(knots[spans + 1], ends[1])

    def blossom(*arguments: Array) -> Array:
        """Returns the polar form of the polynomial of each span."""
        part = [points[spans - degree + i].astype(np.float64) for i in range(order)]
        for r, u in enumerate(arguments, 1):
            for i in range(degree, r - 1, -1):
                low = knots[spans - degree + i]
                share = ((u - low) / (knots[spans + 1 + i - r] - low))[:, None]
                part[i] = (1 - share) * part[i - 1] + share * part[i]
        return part[degree]

    corners = [blossom(*[first] * (degree - k), *[last] * k) for k in range(order)]
    if degree == 1:
        corners = [corners[0], *corners, corners[1]]
    elif degree == 2:
        a, b, c = corners
        corners = [a, (a + 2 * b) / 3, (2 * b + c) / 3, c]
    return joined(corners, False)
