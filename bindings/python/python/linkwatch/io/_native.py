"""Files that the command reads itself, through an archive that it writes."""

from __future__ import annotations

import dataclasses
import json
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from .. import _arguments as arguments
from ._curves import is_dump
from ._frames import Frame, Frames, Summary

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from typing import Any

    from ._curves import Array, Options


def read(paths: Sequence[Path], options: Options) -> Frames:
    """Opens files by ``linkwatch convert``."""
    words = [sys.executable, "-m", "linkwatch", "convert", "--json"]
    for option, value in (("closed", options.closed), ("wrapped", options.unwrap)):
        if value is not None:
            words.append(f"--{option}={str(value).lower()}")
    if options.keep_open:
        words.append("--keep-open")
    if options.keep_order:
        words.append("--keep-order")
    if options.counts is not None:
        words.append(f"--counts={','.join(map(str, arguments.integers(options.counts)))}")
    if options.topic is not None:
        words.append(f"--topic={options.topic}")
    if options.cell == "none":
        words.append("--cell=none")
    elif (cell := options.cell_or(None)) is not None:
        words.append(f"--cell={','.join(map(repr, cell.ravel().tolist()))}")
    if len(paths) > 1 and not is_dump(paths[0]) and all(map(is_dump, paths[1:])):
        # As a topology comes before its trajectories.
        words += ["--bonds", str(paths[0])]
        paths = paths[1:]
    if len(paths) > 1 and options.one_motion:
        return _chained([_converted(words, [path], is_alone=False) for path in paths])
    return _converted(words, paths)


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
    summary = parts[0].summary
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


def _converted(words: list[str], paths: Sequence[Path], is_alone: bool = True) -> Frames:
    """Opens files by ``linkwatch convert``; its archives are on the disk while they are read.

    ``is_alone`` is false if the caller also reads the other files of the recording.
    """
    # The archives are mapped to memory, so they exist until the frames are deleted.
    with tempfile.TemporaryDirectory(prefix="linkwatch-") as folder:
        archive = Path(folder) / "frames.npz"
        words = [*words, *map(str, paths), str(archive)]
        ended = subprocess.run(words, capture_output=True, text=True, check=False)
        # Lines are an error, or begin with a level. Options have the names of Python here.
        errors = ended.stderr.replace("option `--", "option `").replace("`wrapped", "`unwrap")
        errors = errors.replace("--wrapped", "`unwrap`").replace("`--cell ", "`cell=")
        errors = errors.replace("give --one-motion", "pass the option `one_motion`")
        said = [line.strip().split(maxsplit=1) for line in errors.splitlines()]
        if not ended.stdout:
            lines = [" ".join(words[words[0] in LEVELS :]) for words in said if words]
            raise ValueError("; ".join(lines).removeprefix("error: "))
        result = json.loads(ended.stdout.splitlines()[-1])
        # Each map takes a file descriptor.
        maps = len(result["files"]) <= 100
        archives = [_Archive(Path(path), maps) for path in result["files"]]
        frames = _opened(archives, paths[0], result["invalid_frames"])
    summary = frames.summary
    summary.part, summary.ends_in_gap = result["part"], result["ends_in_gap"]
    summary.continues = result["continues"]
    summary.left_out += [
        f"{found['count']} {found['kind']} (the first one: {found['first']})"
        for found in result["left_out"]
        if is_alone or found["kind"] != LATER_FILES
    ]
    if is_alone and summary.continues:
        summary.left_out.append(f"files of the run after {paths[-1].name}")
    for level, *rest in filter(None, said):
        # Invalid frames are errors, and rejected when they are read.
        if level != "ERROR" and not any(known in rest[0] for known in KNOWN):
            summary.notes += rest
    return frames


# Kind of element that the command counts as left out if the first file of a recording is missing.
LATER_FILES = "runs without their first file"

# Parts of lines on stderr whose content is in the result as well.
KNOWN = ("not read, so not verified", "the run continues in")

# Levels of the lines on stderr.
LEVELS = ("WARN", "INFO", "ERROR")


class _Archive:
    """An archive of the command. All of its frames have the same curves."""

    def __init__(self, path: Path, maps: bool) -> None:
        with np.load(path) as arrays:
            self.counts = arrays["counts"].tolist()
            self.names = [str(name) for name in arrays["names"]] if "names" in arrays else []
            self.radii = arrays["radii"].tolist() if "radii" in arrays else []
            self.basis = str(arrays["basis"])
            keys = ("times", "seq", "cell", "cuts")
            self.others = {key: arrays[key] for key in keys if key in arrays}
            self.positions = _mapped(path) if maps else arrays["positions"]
        self.numbers = self.others.get("seq", np.arange(len(self.positions))).tolist()

    def frame(self, k: int) -> Frame:
        """Returns the frame at an index."""
        others, cell = self.others, self.others.get("cell")
        return Frame(
            np.array(self.positions[k]).reshape(-1, 3),
            self.counts,
            self.basis,
            self.names,
            self.radii,
            None if cell is None else cell[k] if cell.ndim == 3 else cell,
            self.numbers[k],
            float(others["times"][k]) if "times" in others else 0.0,
            cuts=int(others["cuts"][k]) if "cuts" in others else 0,
        )


def _opened(archives: list[_Archive], path: Path, invalid: list[dict[str, Any]]) -> Frames:
    """Returns the frames of archives of the command, and the invalid ones that they lack."""
    counts = archives[0].counts
    summary = Summary(len(counts), sum(count < 0 for count in counts))
    # An invalid frame has the place of the frame before it.
    places = [(seq, one, k) for one in archives for k, seq in enumerate(one.numbers)]
    rows: list[tuple[int, _Archive, int, dict[str, Any] | None]] = [(*row, None) for row in places]
    numbers = [seq for seq, _, _ in places]
    known = set(numbers)
    for why in invalid:
        if why["frame"] in known:
            summary.left_out.append(f"frame {why['frame']}, which is invalid: {why['error']}")
        else:
            _, one, k = places[max(0, int(np.searchsorted(numbers, why["frame"])) - 1)]
            rows.append((why["frame"], one, k, why))
            known.add(why["frame"])
    rows.sort(key=lambda row: row[0])

    def load(start: int = 0, stop: int = len(rows)) -> Iterator[Frame]:
        for seq, one, k, why in rows[start:stop]:
            frame = one.frame(k)
            if why is None:
                yield frame
                continue
            # A time that is not finite is null in JSON.
            at = frame.time if why["time"] is None else why["time"]
            yield frame.invalid(why["error"], seq=seq, time=at)

    opened = Frames(path, load, summary, len(rows))
    opened.part = load
    return opened


def _mapped(archive: Path) -> Array:
    """Returns the positions in an archive without compression, which are read from the disk."""
    with zipfile.ZipFile(archive) as members:
        with members.open("positions.npy") as member:
            version = np.lib.format.read_magic(member)
            read_header = getattr(np.lib.format, f"read_array_header_{version[0]}_{version[1]}")
            shape, _, dtype = read_header(member)
            header = member.tell()
        info = members.getinfo("positions.npy")
    with open(archive, "rb") as file:
        file.seek(info.header_offset + 26)
        name, extra = np.frombuffer(file.read(4), "<u2")
    start = info.header_offset + 30 + int(name) + int(extra) + header
    return np.memmap(archive, dtype, "r", start, shape)
