"""Contents of trajectories that ``MDAnalysis`` passes over in silence."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ._curves import is_dump
from ._frames import library

if TYPE_CHECKING:
    from collections.abc import Sequence
    from typing import Any

    from ._curves import Array

# First bytes of the frames of an .xtc file.
XTC = 1995


class PassedOver:
    """For the current frame of a trajectory: its cell, the order of its atoms, and its bonds."""

    def __init__(self, trajectory: Any) -> None:
        self._trajectory = trajectory
        self._ids: Array | None = None
        readers = getattr(trajectory, "readers", [trajectory])
        self._cells = {id(one): _cell_before_models(one) for one in readers}

    def dimensions(self, now: Any) -> Array | None:
        """Returns the edges and angles of the cell, also if all models of a PDB file share it."""
        if now.dimensions is not None:
            return np.asarray(now.dimensions, np.float64)
        reader, _ = self._reader(now)
        return self._cells.get(id(reader))

    def order(self, now: Any) -> Array | None:
        """Returns the indices of the atoms in the order of their ids, if H5MD has them otherwise.

        Raises:
            ValueError: the frame has other ids than the first one.
        """
        reader, frame = self._reader(now)
        ids = getattr(reader, "_particle_group", {}).get("id")
        if ids is None:
            return None
        # All frames have the same ids if there is no group with steps.
        found = ids["value"][frame] if hasattr(ids, "keys") else ids[()]
        order = np.argsort(found, kind="stable")
        if self._ids is None:
            self._ids = found[order]
        if not np.array_equal(found[order], self._ids) or (np.diff(self._ids) == 0).any():
            raise ValueError("the ids of its atoms are not those of the first frame, each once")
        return order if (np.diff(found) < 0).any() else None

    def has_other_bonds(self, now: Any) -> bool:
        """Returns whether the bonds of a GSD file differ from those of its first frame."""
        reader, frame = self._reader(now)
        if getattr(reader, "format", "") != "GSD" or not frame:
            return False
        file = reader._file
        names = ("bonds/N", "bonds/group")
        if not any(file.file.chunk_exists(frame=frame, name=name) for name in names):
            return False
        return not np.array_equal(file[frame].bonds.group, file[0].bonds.group)

    def _reader(self, now: Any) -> tuple[Any, int]:
        """Returns the reader of the frame, and the number of the frame in its file."""
        whole = self._trajectory
        if not hasattr(whole, "readers"):
            return whole, now.frame
        k, frame = whole._get_local_frame(now.frame)
        return whole.readers[k], frame


def _cell_before_models(reader: Any) -> Array | None:
    """Returns the cell before the first model of a PDB file, which MDAnalysis gives to no model."""
    if "PDB" not in np.atleast_1d(reader.format) or not Path(str(reader.filename)).is_file():
        return None
    with open(reader.filename, encoding="latin-1") as file:
        starts = ("CRYST1", "MODEL", "ATOM", "HETATM")
        line = next((line for line in file if line.startswith(starts)), "")
    if not line.startswith("CRYST1"):
        return None
    ends = [6, 15, 24, 33, 40, 47, 54]
    try:
        found = np.array([float(line[a:b]) for a, b in zip(ends, ends[1:])])
    except ValueError:
        raise ValueError(f"{reader.filename}: not a valid cell: {line.strip()}") from None
    # A cube of one angstrom stands for no cell.
    return None if (found[:3] == 1).all() else found


def ends_without_models(path: Path) -> bool:
    """Returns whether lines END separate the frames of a PDB file, as VMD writes them."""
    with open(path, encoding="latin-1") as file:
        words = [line[:6].strip() for line in file if line.startswith(("END", "MODEL"))]
    return words.count("END") > 1 and "MODEL" not in words


def check_number_of_frames(trajectory: Any) -> None:
    """Raises an error if a file has several frames, of which MDAnalysis reads the first one."""
    base = library("MDAnalysis.coordinates.base", "mdanalysis")
    for reader in getattr(trajectory, "readers", [trajectory]):
        path = Path(str(reader.filename))
        single = isinstance(reader, base.SingleFrameReaderBase) and path.is_file()
        if single and _has_several_frames(path):
            raise ValueError(
                f"{path}: several frames, of which MDAnalysis reads only the first one: convert "
                "them to another format, such as .xtc"
            )


def _has_several_frames(path: Path) -> bool:
    suffix = path.suffix.lower()
    if suffix in (".cif", ".mmcif"):
        gemmi = library("gemmi", "mdanalysis")
        return len(gemmi.make_structure_from_block(gemmi.cif.read(str(path))[0])) > 1
    if suffix not in (".gro", ".pqr", ".pdbqt"):
        return False
    lines = path.read_text(encoding="latin-1").splitlines()
    if suffix == ".gro":
        # A title, the number of atoms, the atoms, and the cell.
        return any(line.strip() for line in lines[int(lines[1]) + 3 :])
    return sum(line.startswith("MODEL") for line in lines) > 1


def check_ends(paths: Sequence[Path], trajectory: Any) -> None:
    """Raises an error if the last frame of a trajectory is cut off, which MDAnalysis ignores."""
    atoms, frames = trajectory.n_atoms, len(trajectory)
    offsets = getattr(getattr(trajectory, "_xdr", None), "offsets", [])
    for path in paths:
        suffix, whole = path.suffix.lower(), True
        with open(path, "rb") as file:
            size = file.seek(0, 2)

            def head(start: int, form: str) -> tuple[int, ...]:
                """Returns integers from a place on."""
                file.seek(start)
                return struct.unpack(form, file.read(struct.calcsize(form)))

            if suffix == ".dcd" and size > 100:
                order = "<" if head(0, "<i") == (84,) else ">"
                (_, *control), (titles,) = head(4, f"{order}21i"), head(96, f"{order}i")
                # A frame has records of coordinates, and of the cell and a fourth coordinate.
                record = 4 * atoms + 8
                frame = 3 * record + (56 * control[10] + record * control[11]) * bool(control[19])
                # Fixed atoms are in the first frame only.
                whole = control[8] > 0 or (size - 116 - 80 * titles) % frame == 0
            elif suffix == ".xtc" and len(offsets) == frames and atoms > 9:
                at = int(offsets[-1])
                # Coordinates are padded to a multiple of 4 bytes.
                magic, length = head(at, ">i84xi") if size >= at + 92 else (XTC, 0)
                whole = magic != XTC or size == at + 92 + length + -length % 4
            elif is_dump(path):
                file.seek(max(0, size - 2 * size // frames))
                last = file.read().rpartition(b"ITEM: TIMESTEP")[2]
                whole = last.count(b"\n") + (not last.endswith(b"\n")) >= atoms + 9
            elif suffix in (".pdb", ".ent", ".arc", ".txyz"):
                file.seek(max(0, size - 1000))
                line = (file.read().splitlines(keepends=True) or [b"\n"])[-1]
                whole = line.endswith((b"\n", b"\r")) or _is_whole(line)
                whole = whole and (suffix in (".pdb", ".ent") or _has_whole_frames(path))
        if not whole:
            raise ValueError(f"{path}: the last frame is cut off")


def _is_whole(line: bytes) -> bool:
    """Returns whether the last line of a PDB file, which no line break ends, is whole."""
    if line.startswith((b"ATOM", b"HETATM")):
        return len(line) >= 54
    # A bond may be missing in a CONECT, and nothing tells.
    return not line.startswith(b"CONECT")


def _has_whole_frames(path: Path) -> bool:
    """Returns whether a Tinker file has all lines of its last frame: atoms that count up."""
    with open(path, "rb") as file:
        lines = [line for line in file if line.strip()]
    # A cell has a line of six numbers after the title.
    cell = len(lines) > 1 and len(lines[1].split()) == 6 and b"." in lines[1].split()[0]
    frame = 1 + int(lines[0].split()[0]) + cell
    return not len(lines) % frame and len(lines[-1].split()) >= len(lines[frame - 1].split())
