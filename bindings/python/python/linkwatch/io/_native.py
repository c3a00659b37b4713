"""Files that the command reads itself, by its own readers."""

from __future__ import annotations

import dataclasses
import itertools
import math
from typing import TYPE_CHECKING

import numpy as np

from .. import _arguments as arguments
from .. import _linkwatch
from ._curves import is_dump
from ._frames import Frame, Frames, Summary

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from ._curves import Options


def read(paths: Sequence[Path], options: Options) -> Frames:
    """Opens files, of which a LAMMPS data file comes before its dumps."""
    bonds = None
    if len(paths) > 1 and not is_dump(paths[0]) and all(map(is_dump, paths[1:])):
        bonds, *paths = paths
    if len(paths) > 1 and options.one_motion:
        return _chained([_opened([path], bonds, options, is_alone=False) for path in paths])
    return _opened(paths, bonds, options)


def _chained(parts: list[Frames]) -> Frames:
    """Returns the frames of files that continue one another, and so do their numbers and cuts."""
    numbers = [part.summary.part or 0 for part in parts]
    steps = zip(numbers, numbers[1:])
    follows = [last == 0 or part in (0, 1, last + 1) for last, part in steps]
    follows.insert(0, numbers[0] in (0, 1))
    ends = [False, *(part.summary.ends_in_gap for part in parts)]
    cuts_before = [gap or not is_next for gap, is_next in zip(ends, follows)]
    for part, is_next, is_cut in zip(parts, follows, cuts_before):
        if not is_next:
            part.summary.left_out.append(f"files of the run before {part.path.name}")
        elif is_cut:
            part.summary.left_out.append(f"frames of the recording before {part.path.name}")
    for part, number_after in zip(parts, [*numbers[1:], 0]):
        if part.summary.continues and number_after in (0, 1):
            part.summary.left_out.append(f"files of the run after {part.path.name}")
    summary = dataclasses.replace(parts[0].summary, rejected=[])
    for said in ("left_out", "notes"):
        every = [one for part in parts for one in getattr(part.summary, said)]
        setattr(summary, said, list(dict.fromkeys(every)))

    def load() -> Iterator[Frame]:
        last, cuts, cuts_in_file = -1, 0, 0
        for part, is_after_cut in zip(parts, cuts_before):
            shift = 0
            for k, frame in enumerate(part):
                shift = max(0, last + 1 - frame.seq) if k == 0 else shift
                last = frame.seq + shift
                # A file either counts on from the one before it, or from 0.
                is_cut = frame.cuts > cuts_in_file if k == 0 else frame.cuts != cuts_in_file
                cuts += is_cut or k == 0 and is_after_cut
                cuts_in_file = frame.cuts
                yield dataclasses.replace(frame, seq=last, cuts=cuts)

    return Frames(parts[0].path, load, summary, sum(map(len, parts)))


# Kind of element that counts as left out if the first file of a recording is missing.
LATER_FILES = "runs without their first file"

# Parts of messages whose content is in the summary as well.
KNOWN = ("not read, so not verified", "the run continues in")


# Formats of one frame a file.
OF_ONE_FRAME = (".bcc", ".obj", ".vect")


def _opened(
    paths: Sequence[Path], bonds: Path | None, options: Options, is_alone: bool = True
) -> Frames:
    """Opens files that are read together. ``is_alone`` is false if the caller also reads the other
    files of the recording."""
    files = _Files(paths, bonds, options, is_alone)
    frames = Frames(paths[0], files.load, files.summary)
    frames.count, frames.part = files.count, files.part
    if len(paths) > 1 and paths[0].suffix.lower() not in OF_ONE_FRAME:
        # Files that are runs of their own are an error, which only reading them shows.
        len(frames)
    return frames


class _Files:
    """Files that are read together: see :func:`_opened`."""

    def __init__(
        self, paths: Sequence[Path], bonds: Path | None, options: Options, is_alone: bool
    ) -> None:
        self.paths, self.bonds, self.options, self.is_alone = paths, bonds, options, is_alone
        self.summary = Summary()
        #: Number of frames, once all were read.
        self._length: int | None = None
        # The first frame tells if the files can be read, and how many curves they have.
        frames = self._new()
        first = next(frames)
        self._begun: Iterator[Frame] | None = itertools.chain([first], frames)
        #: Frames that :meth:`part` reads, the last one of them, and how many it read.
        self._rest: Iterator[Frame] = iter(())
        self._last, self._done = first, -1

    def load(self) -> Iterator[Frame]:
        """Returns the frames. The first time, they are those that were begun."""
        begun, self._begun = self._begun, None
        return self._new() if begun is None else begun

    def count(self) -> int:
        """Returns the number of frames. The summary is complete then."""
        if self._length is None:
            self._length = sum(1 for _ in self.load())
        return self._length

    def part(self, start: int, stop: int) -> Iterator[Frame]:
        """Yields the frames from one number to another. Goes on from the last call if it can."""
        if not 0 <= self._done <= start + 1:
            self._rest, self._done = self.load(), 0
        for number in range(start, stop):
            while self._done <= number:
                self._last = next(self._rest)
                self._done += 1
            yield self._last

    def _new(self) -> Iterator[Frame]:
        """Opens the files, and yields each frame when the next one was read: with the last one, the
        summary is complete."""
        options, cell = self.options, self.options.cell
        if (vectors := options.cell_or(None)) is not None:
            cell = ",".join(map(repr, vectors.ravel().tolist()))
        reader = _linkwatch.FileReader(
            self.paths,
            (options.closed, options.unwrap, options.keep_open, options.keep_order),
            cell,
            None if options.counts is None else arguments.integers(options.counts),
            options.topic,
            self.bonds,
        )
        summary, notes, repeated = self.summary, list[str](), list[str]()
        before, number = None, 0
        for number, frame in enumerate(_valid(reader, repeated), 1):
            if before is None:
                summary.curves, summary.closed = len(frame.counts), sum(frame.closed)
            else:
                yield before
            before = frame
            self._note(reader, notes, repeated)
        if before is None:
            why = "; ".join([*repeated, "the input has no valid frame"])
            raise ValueError(why if repeated else f"{self.paths[0]}: no frame")
        self._note(reader, notes, repeated)
        if self._length is None:
            summary.part, summary.ends_in_gap, summary.continues = reader.ending()
            if self.is_alone and summary.continues:
                summary.left_out.append(f"files of the run after {self.paths[-1].name}")
            self._length = number
        yield before

    def _note(
        self, reader: _linkwatch.FileReader, notes: list[str], repeated: list[str]
    ) -> None:
        """Brings the summary up to date, unless it is complete: a later iteration may end early."""
        if self._length is None:
            said = reader.messages()
            notes += [note for note in said if not any(known in note for known in KNOWN)]
            self.summary.notes[:] = notes
            found = reader.left_out()
            found = [one for one in found if self.is_alone or one[0] != LATER_FILES]
            self.summary.left_out[:] = [*(words for _, words in found), *repeated]


def _valid(reader: _linkwatch.FileReader, repeated: list[str]) -> Iterator[Frame]:
    """Yields the frames of a reader. Those that are invalid have the place of the frame before, or
    of the first valid one. Adds the invalid ones with the number of another frame to a list."""
    last: Frame | None = None
    early: list[tuple[_linkwatch.Row, str]] = []
    counts, basis, names, radii = list[int](), "", list[str](), list[float]()
    while (row := reader.next()) is not None:
        if (why := row.rejected) is not None:
            if last is None:
                early.append((row, why))
            elif row.seq <= last.seq:
                repeated.append(f"frame {row.seq}, which is invalid: {why}")
            else:
                last = _invalid(last, row, why)
                yield last
            continue
        assert row.points is not None
        if row.described is not None:
            counts, basis, names, radii = row.described
        cell = None if row.cell is None else np.array(row.cell)
        last = Frame(
            row.points, counts, basis, names, radii, cell, row.seq, row.time, cuts=row.cuts
        )
        for before, reason in early:
            yield _invalid(last, before, reason)
        early.clear()
        yield last
    repeated += [f"{row.name}: {why}" for row, why in early[:1]]


def _invalid(near: Frame, row: _linkwatch.Row, why: str) -> Frame:
    """Returns an invalid frame in the place of another one."""
    time = row.time if math.isfinite(row.time) else near.time
    return near.invalid(why, seq=row.seq, time=time)
