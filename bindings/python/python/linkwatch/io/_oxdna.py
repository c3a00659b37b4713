"""Strands of oxDNA: a topology in either format, and configurations or trajectories."""

from __future__ import annotations

from itertools import islice
from typing import TYPE_CHECKING

import numpy as np

from ._curves import Scene, frames_of_scenes, in_order
from ._text import Lines

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from ._curves import Array, Options
    from ._frames import Frames


def read(paths: Sequence[Path], options: Options) -> Frames:
    """Opens a topology and configurations."""
    tops = [path for path in paths if path.suffix.lower() == ".top"]
    others, notes = in_order([path for path in paths if path not in tops], options)
    if not others:
        raise ValueError(f"{tops[0]}: a topology without a configuration: give the .dat file, too")
    beside = others[0].with_suffix(".top")
    if not tops and beside.exists():
        tops = [beside]
    if len(tops) != 1:
        raise ValueError(f"{others[0]}: give its topology (.top), too: {len(tops)} are given")
    strands, number = _strands(tops[0])
    options.unwrap = options.unwrap is not False
    frames = frames_of_scenes(others[0], lambda: _scenes(others, strands, number, notes), options)
    frames.summary.time_unit = "steps of the simulation"
    return frames


def _strands(path: Path) -> tuple[list[tuple[list[int], bool]], int]:
    """Returns the nucleotides of each strand, if it is a ring, and the number of nucleotides."""
    lines = Lines(path)
    rows = iter(lines)
    header = next(rows, [])
    try:
        number, strands = int(header[0]), int(header[1])
    except (IndexError, ValueError):
        raise lines.error("expected the numbers of nucleotides and strands") from None
    found: list[tuple[list[int], bool]] = []
    if header[2:3] == ["5->3"]:
        first = 0
        for words in rows:
            size = len(_bases(words[0]))
            keys = dict(word.partition("=")[::2] for word in words[1:])
            if (ring := keys.get("circular", "false")) not in ("true", "false"):
                raise lines.error(f"circular={ring}, expected true or false")
            found.append((list(range(first, first + size)), ring == "true"))
            first += size
        total = first
    else:
        following, before = [], []
        for words in rows:
            try:
                before.append(int(words[2]))
                following.append(int(words[3]))
            except (IndexError, ValueError):
                raise lines.error("expected strand, base, 3' and 5' neighbour") from None
        total = len(following)
        for i, (back, on) in enumerate(zip(before, following)):
            for other, links in ((on, before), (back, following)):
                if other >= 0 and (other >= total or links[other] != i):
                    lines.number = i + 2
                    raise lines.error(f"nucleotide {other} is a neighbour only in one direction")
        # Ends first, so that a ring is what is left.
        seen: set[int] = set()
        for start in [i for i in range(total) if before[i] < 0] + list(range(total)):
            nodes = []
            node = start
            while node >= 0 and node not in seen:
                seen.add(node)
                nodes.append(node)
                node = following[node]
            if nodes:
                found.append((nodes, node >= 0))
        found.sort()
    if total != number or len(found) != strands:
        raise ValueError(
            f"{path}: {total} nucleotides in {len(found)} strands, but the first line says "
            f"{number} in {strands}"
        )
    return found, number


def _bases(sequence: str) -> list[str]:
    """Returns the nucleotides of a sequence, in which one may be a number in brackets."""
    bases: list[str] = []
    inside = False
    for letter in sequence:
        if not inside:
            bases.append(letter)
        inside = letter != ")" and (inside or letter == "(")
    return bases


def _scenes(
    paths: Sequence[Path], strands: list[tuple[list[int], bool]], number: int, notes: list[str]
) -> Iterator[Scene]:
    """Yields the configurations of files."""
    curves = [(k, nodes, ring) for k, (nodes, ring) in enumerate(strands) if len(nodes) > 1]
    order = [node for _, nodes, _ in curves for node in nodes]
    single = len(strands) - len(curves)
    notes = notes + [f"{single} strands of one nucleotide are no curves"] * (single > 0)
    for path in paths:
        lines = Lines(path)
        with lines.file:
            while (found := _configuration(lines, number)) is not None:
                time, box, points = found
                yield Scene(
                    points=points[order],
                    counts=[-len(nodes) if ring else len(nodes) for _, nodes, ring in curves],
                    names=[f"strand {k + 1}" for k, _, _ in curves],
                    notes=notes,
                    cell=np.vstack([np.diag(box), np.zeros(3)]) if all(box) else None,
                    time=time,
                    place=str(path),
                )


def _configuration(lines: Lines, number: int) -> tuple[float, list[float], Array] | None:
    """Returns the time, the box and the positions of the next configuration, if there is one."""
    values = {}
    for key in "tbE":
        text = lines.file.readline()
        lines.number += 1
        while key == "t" and not text.strip():
            if not text:
                return None
            # Empty lines may follow a configuration.
            text = lines.file.readline()
            lines.number += 1
        name, _, value = text.partition("=")
        if name.strip() != key:
            raise lines.error(f"expected `{key} = ..`, found {text.strip()!r}")
        if key != "E":
            values[key] = lines.numbers(value.split(), 1 if key == "t" else 3)
    rows = list(islice(lines.file, number))
    lines.number += len(rows)
    # The last line may be cut off.
    if len(rows) < number or len(rows[0].split()) != len(rows[-1].split()):
        raise lines.error(f"the file ends within the {number} nucleotides of a configuration")
    try:
        points = np.loadtxt(rows, float, usecols=(0, 1, 2), ndmin=2, comments=None)
    except ValueError as why:
        raise lines.error(f"in the {number} lines up to this one: {why}") from None
    if len(points) < number:
        raise lines.error(f"{len(points)} of {number} nucleotides in the lines up to this one")
    return values["t"][0], values["b"], points
