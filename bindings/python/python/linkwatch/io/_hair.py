"""Binary files of hair: ``.hair`` of Cem Yuksel, and ``.data`` of USC-HairSalon."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

import numpy as np

from ._curves import Curve, Scene

if TYPE_CHECKING:
    from pathlib import Path

# Arrays that follow the header of a .hair file, with the bits of the header that announce them.
SEGMENTS, POINTS, THICKNESS = 1, 2, 4
HEADER = struct.Struct("<4s4If f3f88s")


def read_hair(path: Path) -> Scene:
    """Reads the strands of a ``.hair`` file; their radius is half of the largest thickness."""
    data = path.read_bytes()
    if len(data) < HEADER.size or data[:4] != b"HAIR":
        raise ValueError(f"{path}: not a .hair file: it does not begin with HAIR and a header")
    _, strands, points, arrays, segments, thickness, *_ = HEADER.unpack_from(data)
    if max(strands, points) > len(data):
        raise ValueError(f"{path}: {strands} strands of {points} points in {len(data)} bytes")
    at = HEADER.size
    sizes = np.full(strands, segments + 1, np.int64)

    def array(kind: str, number: int) -> np.ndarray:
        nonlocal at
        start, at = at, at + np.dtype(kind).itemsize * number
        if at > len(data):
            raise ValueError(f"{path}: the file ends at byte {len(data)}, expected {at} or more")
        return np.frombuffer(data, kind, number, start)

    if arrays & SEGMENTS:
        sizes = array("<u2", strands).astype(np.int64) + 1
    if not arrays & POINTS:
        raise ValueError(f"{path}: no array of points")
    positions = array("<f4", 3 * points).reshape(-1, 3)
    if sizes.sum() != points:
        raise ValueError(f"{path}: {strands} strands of {sizes.sum()} points, but {points} points")
    widths = array("<f4", points) if arrays & THICKNESS else np.full(points, thickness, "<f4")
    ends = np.cumsum(sizes)[:-1]
    scene = Scene()
    for part, width in zip(np.split(positions, ends), np.split(widths, ends)):
        scene.curves.append(Curve(part, radius=0.5 * float(width.max(initial=0))))
    return _whole(scene)


def read_usc(path: Path) -> Scene:
    """Reads the strands of a ``.data`` file: a count, then count and points of each strand."""
    data = path.read_bytes()
    scene = Scene()
    numbers = np.frombuffer(data, "<i4", len(data) // 4)
    at = 1
    for strand in range(int(numbers[0]) if len(numbers) else 0):
        size = int(numbers[at]) if at < len(numbers) else 0
        start, at = at + 1, at + 1 + 3 * size
        if size < 1 or at > len(numbers):
            raise ValueError(
                f"{path}, byte {4 * (start - 1)}: strand {strand} has {size} points, which do not "
                f"fit a file of {len(data)} bytes"
            )
        points = numbers[start:at].view("<f4").reshape(-1, 3)
        scene.curves.append(Curve(points))
    if 4 * at != len(data):
        raise ValueError(f"{path}: {len(data)} bytes, expected {4 * at} for its strands")
    return _whole(scene)


def _whole(scene: Scene) -> Scene:
    """Removes strands of one point, which mark missing hair, and reports them."""
    strands = len(scene.curves)
    scene.curves = [curve for curve in scene.curves if len(curve.points) > 1]
    if len(scene.curves) < strands:
        scene.notes.append(f"{strands - len(scene.curves)} strands of one point are no curves")
    return scene
