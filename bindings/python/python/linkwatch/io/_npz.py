"""Writes frames as ``.npz`` files, in the layout of docs/reference/formats.md."""

from __future__ import annotations

import shutil
import tempfile
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from .. import _arguments as arguments
from .. import _linkwatch
from ._frames import Frame, Frames

if TYPE_CHECKING:
    import os
    from collections.abc import Iterable
    from typing import Any

    import numpy.typing as npt


def write(
    frames: Iterable[Frame], path: str | os.PathLike[str], *, force: bool = False
) -> list[Path]:
    """Writes frames to an ``.npz`` file, and returns the files that were written.

    >>> import linkwatch
    >>> import numpy as np
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     files = linkwatch.write([linkwatch.io.Frame(np.eye(3), [-3])], f"{folder}/run.npz")
    ...     [file.name for file in files]
    ['run.npz']

    All frames of such a file have the same curves and names. Frames from which on they are others
    are written to further files: ``run.npz``, ``run-2.npz``, ``run-3.npz``; the command checks them
    as one motion with ``--one-motion``. If radii change, a file has the largest one of each curve.

    A frame that is invalid is written as NaN, which the command rejects; before the first valid one
    it is left out, and counted.

    The memory is that of a frame. A file appears under its name when it is complete.

    Raises:
        FileExistsError: a file is there already, and ``force`` is false.
        ValueError: there is no valid frame, the numbers of the frames do not increase, or some
            frames have a cell and others none.
    """
    path = Path(path)
    if path.suffix.lower() != ".npz":
        raise ValueError(
            f"{path}: the name must end with .npz; `linkwatch convert` makes .bcc and .mcap of it"
        )
    invalid: list[str] = []

    def left_out() -> list[str]:
        """Returns what was skipped so far."""
        return [*frames.known.left_out, *invalid] if isinstance(frames, Frames) else invalid

    written: list[Path] = []
    part: _Part | None = None
    last = -1
    try:
        for frame in frames:
            if frame.seq <= last:
                raise ValueError(f"frame {frame.seq} after frame {last}")
            last = frame.seq
            if part is None and frame.rejected is not None:
                invalid.append(f"frame {frame.seq}, which is invalid: {frame.rejected}")
                continue
            if part is None or not part.continues(frame):
                if part is not None:
                    part.save(left_out())
                name = f"{path.stem}-{len(written) + 1}{path.suffix}"
                target = path.with_name(name) if written else path
                if target.exists() and not force:
                    raise FileExistsError(f"{target} exists already: `force` overwrites it")
                written.append(target)
                part = _Part(target, frame)
            part.add(frame)
        if part is None:
            raise ValueError("; ".join(["no valid frame to write", *left_out()]))
        part.save(left_out())
    finally:
        if part is not None:
            part.spool.close()
    return written


class _Part:
    """Frames of the same curves, for one archive. A temporary file holds the positions, because the
    header before them in the archive has the number of frames."""

    def __init__(self, path: Path, first: Frame) -> None:
        self.path = path
        self.first = first
        self.counts = first.counts
        if first.closed_by_default:
            self.counts, _, _ = _linkwatch.decided_counts(*arguments.raw(first), True)
        self.spool = tempfile.TemporaryFile(dir=path.parent)
        self.seqs: list[int] = []
        self.cuts: list[int] = []
        self.times: list[float] = []
        self.cells: list[npt.NDArray[Any]] = []
        self.radii = np.zeros(len(first.radii))

    def continues(self, frame: Frame) -> bool:
        first = self.first
        return frame.rejected is not None or (
            (first.counts, first.basis, first.names, len(first.radii), first.positions.dtype)
            == (frame.counts, frame.basis, frame.names, len(frame.radii), frame.positions.dtype)
        )

    def add(self, frame: Frame) -> None:
        first = self.first
        points = frame.positions
        if frame.rejected is not None:
            # The command rejects a frame of NaN.
            points = np.full_like(first.positions, np.nan)
        if (frame.cell is None) != (first.cell is None) and frame.rejected is None:
            raise ValueError("frames with a periodic cell and others without one")
        self.spool.write(np.ascontiguousarray(points).data)
        self.seqs.append(frame.seq)
        self.cuts.append(frame.cuts)
        self.times.append(frame.time)
        cell = first.cell if frame.cell is None else frame.cell
        if cell is not None:
            self.cells.append(np.asarray(cell, float))
        if frame.rejected is None:
            self.radii = np.maximum(self.radii, frame.radii)

    def save(self, left_out: list[str]) -> None:
        """Writes the archive, under another name until it is complete."""
        first = self.first
        arrays: dict[str, Any] = {
            "counts": np.array(self.counts, np.int32),
            "basis": first.basis,
            "seq": np.array(self.seqs, np.uint64),
            "times": np.array(self.times, float),
        }
        if any(self.cuts):
            arrays["cuts"] = np.array(self.cuts, np.uint32)
        if first.names:
            arrays["names"] = first.names
        if first.radii:
            arrays["radii"] = self.radii.astype(np.float32)
        if self.cells:
            arrays["cell"] = np.stack(self.cells)
        if left_out:
            arrays["left_out"] = left_out
        header = {
            "descr": np.lib.format.dtype_to_descr(first.positions.dtype),
            "fortran_order": False,
            "shape": (len(self.seqs), *first.positions.shape),
        }
        partial = self.path.with_name(self.path.name + ".part")
        try:
            with zipfile.ZipFile(partial, "w") as archive:
                for name, value in arrays.items():
                    with archive.open(f"{name}.npy", "w") as member:
                        np.lib.format.write_array(member, np.array(value), allow_pickle=False)
                with archive.open("positions.npy", "w", force_zip64=True) as member:
                    np.lib.format.write_array_header_1_0(member, header)
                    self.spool.seek(0)
                    shutil.copyfileobj(self.spool, member, 1 << 20)
            partial.replace(self.path)
        finally:
            partial.unlink(missing_ok=True)
            self.spool.close()
