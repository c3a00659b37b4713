"""Writes the NumPy files of this folder: two linked rings, and a third one that is apart.

    python3 -m venv venv && venv/bin/pip install numpy
    venv/bin/python generate.py

In the second of two frames the first ring has left the second one.
"""

from pathlib import Path

import numpy as np

FOLDER = Path(__file__).parent
POINTS = 8


def ring(x, upright):
    """Returns the points of a ring around (x, 0, 0)."""
    angles = 2 * np.pi * (np.arange(POINTS) + 0.5) / POINTS
    u, v, zero = np.cos(angles), np.sin(angles), np.zeros(POINTS)
    return np.stack([x + u, zero, v] if upright else [x + u, v, zero], axis=-1)


linked = np.stack([ring(0, False), ring(1, True), ring(9, False)])
apart = np.stack([ring(-9, False), ring(1, True), ring(9, False)])
rings = np.stack([linked, apart])  # frames x curves x points x 3
points = rings.reshape(2, 3 * POINTS, 3)
counts = np.array([-POINTS] * 3)

np.save(FOLDER / "rings.npy", rings)
np.save(FOLDER / "rings-f4.npy", rings.astype("f4"))
np.save(FOLDER / "points-big-endian.npy", points.astype(">f8"))
np.save(FOLDER / "points.npy", points)
np.save(FOLDER / "one-frame.npy", points[0])
np.save(FOLDER / "fortran.npy", np.asfortranarray(points))
np.save(FOLDER / "objects.npy", np.array([[0.0] * 3, None], dtype=object))
np.save(FOLDER / "integers.npy", rings.astype("i4"))
np.savez(FOLDER / "stored.npz", positions=points, counts=counts)
np.savez_compressed(
    FOLDER / "compressed.npz",
    positions=points.astype(">f4"),
    counts=counts.astype(">i2"),
    basis="b-spline",
    times=np.array([0.0, 0.25]),
    seq=np.array([10, 20], dtype="u4"),
    names=np.array(["a", "b", "ring ü"]),
    radii=np.array([0.1, 0.1, 0.2]),
    comment=np.array(["ignored"]),
)

# Five points in two curves, for tests that change every byte.
small = np.array([[[0, 0, 0], [1, 0.5, 0], [10, 1, 0], [0, 1, -2], [3, 3, 3.0]]] * 2)
np.save(FOLDER / "small.npy", small.astype("f4"))
np.savez(FOLDER / "small.npz", positions=small, counts=[-3, 2])
np.savez_compressed(FOLDER / "small-compressed.npz", positions=small, counts=[-3, 2])
