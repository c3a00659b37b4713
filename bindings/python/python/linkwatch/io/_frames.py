"""Frames of a file, and what is said about them."""

from __future__ import annotations

import dataclasses
import functools
import importlib
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path
    from typing import Any

    import numpy.typing as npt


@dataclass(frozen=True)
class Frame:
    """Curves at one time. ``session.step(frame.positions, frame.time)`` verifies them, by a
    ``Session(frame.counts, names=frame.names, basis=frame.basis)``.

    >>> import linkwatch
    >>> import numpy as np
    >>> triangle = linkwatch.io.Frame(np.eye(3), [-3], names=["triangle"], seq=7, time=0.7)
    >>> triangle.closed, triangle.invalid("it was cut").rejected
    ([True], 'it was cut')
    """

    #: Points of all curves, one after the other, of the shape ``(N, 3)``; NaN if ``rejected``.
    positions: npt.NDArray[Any]
    #: Number of points of each curve, negative if it is closed.
    counts: list[int]
    basis: str = "polyline"
    names: list[str] = field(default_factory=list)
    radii: list[float] = field(default_factory=list)
    #: Lattice vectors and corner of the cell, ``(4, 3)``.
    cell: npt.NDArray[Any] | None = None
    #: Number of the frame, larger than that of the previous one.
    seq: int = 0
    #: In :attr:`Summary.time_unit`.
    time: float = 0.0
    #: Reason why the frame is invalid, although later ones can be read.
    rejected: str | None = None
    #: True if curves are closed only because nothing says which ones are.
    closed_by_default: bool = False
    #: Number of times so far that the simulator rolled back or jumped. The step to a frame in which
    #: it differs is not searched for pull-throughs.
    cuts: int = 0
    #: Elements of the file that may be curves and were not read.
    left_out: tuple[str, ...] = ()

    @property
    def closed(self) -> list[bool]:
        """For each curve, if it is closed."""
        return [count < 0 for count in self.counts]

    def invalid(self, why: str, **changes: Any) -> Frame:
        """Returns the invalid frame in place of one that cannot be read, after this one."""
        nothing = np.full_like(self.positions, np.nan)
        return dataclasses.replace(self, positions=nothing, rejected=why, **changes)


@dataclass
class Summary:
    """Summary of a file: the curves that were read, and the elements that were not.

    >>> import linkwatch
    >>> import numpy as np
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     (path,) = linkwatch.write([linkwatch.io.Frame(np.eye(3), [-3])], f"{folder}/run.npz")
    ...     frames = linkwatch.read(path)
    >>> frames.summary.curves, frames.summary.closed, frames.summary.left_out
    (1, 1, [])
    >>> print(frames.summary)
    1 curve, 1 closed
    """

    #: Number of curves of the first frame, and of those that are closed.
    curves: int = 0
    closed: int = 0
    #: Elements that may be curves and are not read, by kind, with the first one.
    left_out: list[str] = field(default_factory=list)
    #: Decisions that the file leaves open: curves that were closed, joined or unwrapped.
    notes: list[str] = field(default_factory=list)
    #: Frames that are invalid, with the reasons, as far as frames were read.
    rejected: list[str] = field(default_factory=list)
    #: Unit of the times of the frames, if the file states it.
    time_unit: str = ""
    #: Number of the file among those of a recorded run.
    part: int | None = None
    #: True if frames after the last one are not in the recording.
    ends_in_gap: bool = False
    #: True if the recorded run continues in a file that was not given.
    continues: bool = False

    def lines(self) -> list[str]:
        """Returns what was read: the curves, the notes and the unit of the times."""
        curves = "1 curve" if self.curves == 1 else f"{self.curves} curves"
        times = [f"times in {self.time_unit}"] if self.time_unit else []
        return [f"{curves}, {self.closed} closed", *self.notes, *times]

    def __str__(self) -> str:
        lines = self.lines()
        if self.left_out:
            lines.append(f"not read, so not verified: {', '.join(self.left_out)}")
        return "\n".join([*lines, *self.rejected])


class Frames:
    """The frames of a file: an iterable of :class:`Frame`, which reads one at a time.

    >>> import linkwatch
    >>> import numpy as np
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     (path,) = linkwatch.write([linkwatch.io.Frame(np.eye(3), [-3])], f"{folder}/run.npz")
    ...     frames = linkwatch.read(path)
    >>> len(frames), [frame.counts for frame in frames]
    (1, [[-3]])
    """

    def __init__(
        self,
        path: Path,
        load: Callable[[], Iterator[Frame]],
        summary: Summary,
        length: int | None = None,
    ) -> None:
        self.path = path
        #: The summary, as far as frames were read.
        self.known = summary
        #: Number of frames; ``None`` if the file has to be read to count them.
        self.length = length
        #: Returns the number of frames, and completes the summary. Reads all frames if need be.
        self.count: Callable[[], int] | None = None
        #: Number of files that have several frames each, and may be runs of their own.
        self.runs = 0
        #: Reads the frames from one number to another alone, if the format can.
        self.part: Callable[[int, int], Iterator[Frame]] | None = None
        #: Function and arguments that open the same frames again, in another process.
        self.recipe: tuple[Callable[..., Frames], tuple[Any, ...], dict[str, Any]] | None = None
        #: ``"file"``, ``"memory"``, or ``"once"`` for a generator, which cannot be read again.
        self.kind = "file"
        self._load = load

    @property
    def summary(self) -> Summary:
        """What was read, and what was not. Files that the command reads are read for it as a whole,
        unless they were already."""
        self._count()
        return self.known

    def _count(self) -> None:
        """Completes the length and the summary."""
        if self.length is None and self.count is not None:
            self.length = self.count()

    def __iter__(self) -> Iterator[Frame]:
        self.known.rejected.clear()
        for frame in self._load():
            if frame.rejected is not None:
                self.known.rejected.append(f"frame {frame.seq} is invalid: {frame.rejected}")
            left_out = tuple(self.known.left_out)
            if frame.left_out != left_out:
                frame = dataclasses.replace(frame, left_out=left_out)
            yield frame

    def __len__(self) -> int:
        self._count()
        if self.length is None:
            raise TypeError(f"{self.path}: the number of frames is known when all were read")
        return self.length

    def __bool__(self) -> bool:
        return True

    def __reduce__(self) -> Any:
        if self.recipe is None:
            raise TypeError(f"{self!r} cannot be opened in another process")
        known = self.path, self.summary, self.length, self.part is not None
        return _opened_later, (self.recipe, *known)

    def __repr__(self) -> str:
        frames = "" if self.length is None else f", {self.length} frames"
        return f"<linkwatch.io.Frames of {self.path}{frames}>"


def _opened_later(
    recipe: Any, path: Path, summary: Summary, length: int | None, has_parts: bool
) -> Frames:
    """Returns frames that are opened again when they are read."""
    function, args, options = recipe

    @functools.cache
    def frames() -> Any:
        return function(*args, **options)

    found = Frames(path, lambda: iter(frames()), summary, length)
    found.recipe = recipe
    if has_parts:
        found.part = lambda start, stop: frames().part(start, stop)
    return found


class LeftOut:
    """Counts elements that are not read, by kind."""

    def __init__(self) -> None:
        self._found: dict[tuple[str, str], tuple[int, str]] = {}

    def add(self, kind: str, place: str, number: int = 1, many: str = "") -> None:
        """Counts elements of a kind. Its plural follows from ``(s)`` after the noun, or is given
        as well."""
        one, many = kind.replace("(s)", "", 1), many or kind.replace("(s)", "s", 1)
        count, first = self._found.get((one, many), (0, place))
        if number:
            self._found[one, many] = count + number, first

    def sentences(self) -> list[str]:
        """Returns a sentence for each kind, as the command prints it."""
        return [
            f"1 {one} ({first})" if count == 1 else f"{count} {many} (the first one: {first})"
            for (one, many), (count, first) in self._found.items()
        ]


def library(module: str, extra: str, what: str = "reading this file") -> Any:
    """Imports a library that an extra of this package installs, for some purpose."""
    try:
        return importlib.import_module(module)
    except ImportError as why:
        needs = f'{what} needs more libraries: pip install "linkwatch[{extra}]"'
        raise ImportError(f"{needs} ({why})") from why
