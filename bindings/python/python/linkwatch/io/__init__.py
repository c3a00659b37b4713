"""Reads frames of curves from files of other programs, and writes what the command reads.

>>> import linkwatch
>>> frames = linkwatch.io.read("scene.usdc")  # doctest: +SKIP
>>> print(frames.summary)  # doctest: +SKIP
70 curves, 70 closed
>>> linkwatch.io.write("scene.npz", frames)  # doctest: +SKIP
[PosixPath('scene.npz')]

``python -m linkwatch convert scene.usdc scene.npz`` does the same. Each reader needs a library,
which is an extra of this package: ``pip install "linkwatch[usd]"``.

To add a format, write a function from a path to :class:`Frames`, and name it in ``READERS``.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from . import _usd
from ._frames import Frame, Frames, Summary
from ._npz import write

if TYPE_CHECKING:
    import os
    from collections.abc import Callable

__all__ = ["READERS", "Frame", "Frames", "Summary", "read", "write"]

#: Reader of each suffix, in lower case.
READERS: dict[str, Callable[[Path], Frames]] = {
    **dict.fromkeys((".usd", ".usda", ".usdc", ".usdz"), _usd.read),
}


def read(path: str | os.PathLike[str]) -> Frames:
    """Opens a file, whose suffix selects the reader. Frames are read when they are iterated over.

    Raises:
        ImportError: the library that reads this format is not installed. The message says how.
        OSError: the file cannot be opened.
        ValueError: the suffix is unknown, or the file is damaged or has no curves.
    """
    path = Path(path)
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise ValueError(
            f"{path}: files of this name are not read here ({', '.join(READERS)}); the command "
            "`linkwatch` reads other formats itself"
        )
    with open(path, "rb"):
        return reader(path)
