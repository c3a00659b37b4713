"""Files and contents of trajectories that ``MDAnalysis`` does not read, or ignores in silence."""

from __future__ import annotations

import functools
import os
import re
import struct
from collections import Counter
from itertools import takewhile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ._curves import is_dump
from ._frames import library

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence
    from typing import Any

    from ._curves import Array

# Suffixes of PDB and of H5MD files.
PDB = (".pdb", ".ent")
H5MD = (".h5md", ".h5", ".hdf5")
# Kinds of trajectories that the command reads itself.
XYZ = (".xyz", ".extxyz", "dump")
# First bytes of the frames of an .xtc file.
XTC = 1995
# Columns of extended XYZ that are not an element and the position, or say the order; its cell.
OTHER = re.compile(r"\bproperties\s*=(?!\s*[\"']?\w+:\w:1:pos:R:3)|\bid:I:1\b", re.I)
LATTICE = re.compile(r"""\blattice\s*=\s*["'{[]?([^"'}=]*)""", re.I)
PBC = re.compile(r"""\bpbc\s*=\s*(?:["'{[]([^"'}\]]*)|(\w+))""", re.I)
# A cell in another form: three numbers after its name, perhaps with a word between them.
OTHER_CELL = re.compile(r"\b(?:cell|box)\b\W*(?:[a-z]+\W+)?(?:\d[\d.e+-]*[\s,]+){2}\d", re.I)
FLAGS = {**dict.fromkeys(("t", "true", "1"), True), **dict.fromkeys(("f", "false", "0"), False)}

OTHER_IDS = "the ids of its atoms are not those of the first frame, each once"


class PassedOver:
    """For the current frame of a trajectory: its cell, the order of its atoms, and its bonds."""

    def __init__(self, universe: Any) -> None:
        self._trajectory = universe.trajectory
        self._topology = Path(str(universe.filename))
        self._ids: Array | None = None
        self._bonds: Array | None = None
        # By reader: the cell of a PDB file, and whether a file begins with other bonds.
        self._cells: dict[int, Array | None] = {}
        self._begins: dict[int, bool] = {}

    def cell(self, now: Any) -> Array | None:
        """Returns the vectors of the cell, of which those of directions that do not repeat are
        zeros, and its corner.

        Raises:
            ValueError: the file does not tell the cell, or MDAnalysis computes another one.
        """
        reader, frame = self._reader(now)
        kind, box = getattr(reader, "format", ""), self._dimensions(now)
        if kind == "GSD" and not reader.transformations:
            vectors = _vectors_of_gsd(reader._file.file, frame)
        elif kind == "XYZ" and box is None:
            vectors = _lattice(self._head(now)[1])
        elif box is None or not box[:3].any():
            return None
        elif _is_gsd(reader) and not (abs(box[3:] - 90) < 1e-4).all():
            raise ValueError("MDAnalysis has other angles than the GSD file: give `cell`")
        else:
            vectors = _vectors(tuple(box.tolist())).copy()
        if kind == "H5MD" and "edges" in reader._particle_group["box"]:
            group = reader._particle_group["box"]
            edges = np.asarray(group["edges/value"][frame], np.float64)
            if edges.ndim == 2 and edges[0].any() and not reader.transformations:
                # MDAnalysis turns the vectors. These have the unit of the positions.
                vectors = edges * np.linalg.norm(vectors[0]) / np.linalg.norm(edges[0])
            boundary = np.ravel(group.attrs.get("boundary", "periodic"))
            is_none = [one in ("none", b"none") for one in boundary]
            vectors[np.broadcast_to(is_none, 3)] = 0
        elif kind == "LAMMPSDUMP":
            # Three kinds of boundaries, after the tilt factors. Dumps of old versions have none.
            kinds = [one for one in self._head(now)[4].split()[3:] if one not in ("xy", "xz", "yz")]
            vectors[[k for k, one in enumerate(kinds) if one[0] != "p"]] = 0
        return np.vstack([vectors, np.zeros(3)]) if vectors.any() else None

    def _dimensions(self, now: Any) -> Array | None:
        """Returns the edges and angles of the cell, also if all models of a PDB file share it."""
        if now.dimensions is not None:
            return np.asarray(now.dimensions, np.float64)
        reader, _ = self._reader(now)
        if id(reader) not in self._cells:
            self._cells[id(reader)] = _cell_of_all_models(reader)
        return self._cells[id(reader)]

    def _head(self, now: Any) -> list[str]:
        """Returns the lines before the atoms of a frame in a text file."""
        reader, frame = self._reader(now)
        len(reader)  # finds the places of the frames
        file = reader.xyzfile if reader.format == "XYZ" else reader._file
        at = file.tell()
        file.seek(reader._offsets[frame])
        found = [file.readline() for _ in range(9)]
        # MDAnalysis reads the next frame from its own position in the file.
        file.seek(at)
        return found

    def order(self, now: Any) -> Array | None:
        """Returns the indices of the atoms in the order of their ids, if H5MD has them otherwise.

        Raises:
            ValueError: the file does not tell the order, or the first frame has other ids.
        """
        reader, frame = self._reader(now)
        kind = getattr(reader, "format", "")
        if kind == "XYZ" and OTHER.search(self._head(now)[1]):
            raise ValueError(
                "MDAnalysis reads other columns, and does not sort by id: write the atoms in the "
                "order of the topology, with Properties=species:S:1:pos:R:3"
            )
        if kind == "LAMMPSDUMP":
            if "id" not in self._head(now)[8].split():
                raise ValueError(
                    "a dump without the column id does not tell which atom a line is: write it "
                    "with the ids (dump custom .. id x y z)"
                )
            # Sorted by MDAnalysis, as the positions.
            found = now.data.get("id", np.empty(0))
            self._ids = found if self._ids is None else self._ids
            if not (np.diff(found) > 0).all() or not np.array_equal(found, self._ids):
                raise ValueError(OTHER_IDS)
            return None
        group = getattr(reader, "_particle_group", {})
        if "id" not in group:
            return None
        found = _ids(group, frame)
        if self._ids is None:
            is_one_each = len(np.unique(found)) == len(found) == len(now.positions)
            self._ids = found if is_one_each else np.empty(0)
            if is_one_each and (np.diff(found) < 0).any():
                raise ValueError(
                    "the ids of its atoms do not ascend, so it is unclear which atoms have bonds: "
                    "sort the atoms by id"
                )
        if not len(self._ids) or np.array_equal(found, self._ids):
            return None
        order = np.argsort(found, kind="stable")
        if not np.array_equal(found[order], self._ids):
            raise ValueError(OTHER_IDS)
        return order

    def has_other_bonds(self, now: Any) -> bool:
        """Returns whether a GSD file has other bonds than the first frame of all, or a PDB file
        than the topology, if that is a PDB file as well."""
        reader, frame = self._reader(now)
        kind = getattr(reader, "format", "")
        if "PDB" in kind:
            if id(reader) not in self._begins:
                path = Path(str(reader.filename))
                both = [] if path == self._topology else [_conects(path), self._conects]
                self._begins[id(reader)] = len(both) == 2 and all(both) and both[0] != both[1]
            return self._begins[id(reader)]
        if kind != "GSD":
            return False
        if self._bonds is None:
            first = getattr(self._trajectory, "readers", [reader])[0]
            self._bonds = _bonds(first if getattr(first, "format", "") == "GSD" else reader, 0)
        file = reader._file.file
        names = ("bonds/N", "bonds/group")
        if any(file.chunk_exists(frame=frame, name=name) for name in names):
            return not np.array_equal(_bonds(reader, frame), self._bonds)
        # A frame without bonds has those of the first frame of its file.
        if id(reader) not in self._begins:
            self._begins[id(reader)] = not np.array_equal(_bonds(reader, 0), self._bonds)
        return self._begins[id(reader)]

    @functools.cached_property
    def _conects(self) -> set[tuple[str, ...]]:
        """Bonds of the topology, if it is a PDB file."""
        return _conects(self._topology)

    def _reader(self, now: Any) -> tuple[Any, int]:
        """Returns the reader of the frame, and the number of the frame in its file."""
        whole = self._trajectory
        if not hasattr(whole, "readers"):
            return whole, now.frame
        k, frame = whole._get_local_frame(now.frame)
        return whole.readers[k], int(frame)


@functools.lru_cache(1)
def _vectors(box: tuple[float, ...]) -> Array:
    """Returns the vectors of a cell with some edges and angles: an edge of 0 stands for no
    repetition."""
    core = library("MDAnalysis.lib.mdamath", "mdanalysis")
    edges, angles = np.array(box[:3]), np.array(box[3:])
    repeats = edges != 0
    edged = [*np.where(repeats, edges, 1.0), *angles]
    vectors: Array = core.triclinic_vectors(edged, dtype=np.float64) * repeats[:, None]
    if not vectors.any():
        raise ValueError(f"no periodic cell has the edges {edges} and the angles {angles}")
    return vectors


def _is_gsd(reader: Any) -> bool:
    """Returns whether a reader has a GSD file, or its frames in memory."""
    return str(getattr(reader, "filename", "")).lower().endswith(".gsd")


def _vectors_of_gsd(file: Any, frame: int) -> Array:
    """Returns the vectors of the cell of a GSD file. Its tilt factors are no cosines of angles, as
    which MDAnalysis takes them. A frame without a box has that of the first frame."""
    box = np.array([1, 1, 1, 0, 0, 0])
    for at in (0, frame):
        if file.chunk_exists(frame=at, name="configuration/box"):
            box = file.read_chunk(frame=at, name="configuration/box")
    x, y, z, xy, xz, yz = box.astype(np.float64)
    return np.array([[x, 0, 0], [xy * y, y, 0], [xz * z, yz * z, z]])


def _lattice(comment: str) -> Array:
    """Returns the vectors of the cell of a frame of extended XYZ, which MDAnalysis ignores."""
    lattice, pbc = LATTICE.search(comment), PBC.search(comment)
    if lattice is None:
        if OTHER_CELL.search(comment):
            raise ValueError(f"a cell that is no Lattice: {comment.strip()}: give `cell`")
        return np.zeros((3, 3))
    try:
        numbers = re.split(r"[\s,[\]]+", lattice[1].strip(" ,[]"))[:9]
        vectors = np.array(numbers, float).reshape(3, 3)
        words = re.split(r"[\s,]+", (pbc[1] or pbc[2] or "").strip().lower()) if pbc else ["t"]
        vectors[~np.broadcast_to([FLAGS[word] for word in words], 3)] = 0
    except (ValueError, KeyError):
        raise ValueError(f"no valid Lattice and pbc: {comment.strip()}: give `cell`") from None
    return vectors


def _bonds(reader: Any, frame: int) -> Array:
    """Returns the bonds of a frame of a GSD file, sorted."""
    return np.unique(np.sort(reader._file[frame].bonds.group, axis=1), axis=0)


def _conects(path: Path) -> set[tuple[str, ...]]:
    """Returns the pairs of serial numbers that CONECT of a PDB file names."""
    if path.suffix.lower() not in PDB or not path.is_file():
        return set()
    found: set[tuple[str, ...]] = set()
    with open(path, encoding="latin-1") as file:
        for line in file:
            if line.startswith("CONECT"):
                found.update(tuple(sorted(pair)) for pair in _conect(line))
    return found


def _conect(line: str) -> list[tuple[str, str]]:
    """Returns the serial numbers of an atom and of each other one that a line CONECT names."""
    text = line[6:].rstrip()
    atoms = [text[k : k + 5].strip() for k in range(0, len(text), 5)]
    return [(atoms[0], other) for other in atoms[1:] if other]


def _ids(group: Any, frame: int) -> Array:
    """Returns the ids of the atoms in a frame of a H5MD file."""
    ids = group["id"]
    if not hasattr(ids, "keys"):
        return np.ravel(ids[()])
    values, positions = ids["value"], group["position"]
    if values.ndim == 1:
        return np.ravel(values[()])
    if len(values) != len(positions["value"]):
        # The last ones before the frame.
        steps = [np.atleast_1d(of["step"][()]) for of in (ids, positions)]
        at = steps[1][frame] if len(steps[1]) > frame else frame
        frame = int(np.searchsorted(steps[0], at, side="right")) - 1
    return np.ravel(values[min(max(frame, 0), len(values) - 1)])


def _cell_of_all_models(reader: Any) -> Array | None:
    """Returns the only cell of a PDB file, which MDAnalysis gives to none of several models."""
    kinds = {"PDB", "XPDB"} & set(np.atleast_1d(getattr(reader, "format", "")))
    if not kinds or not Path(str(reader.filename)).is_file():
        return None
    with open(reader.filename, encoding="latin-1") as file:
        lines = [line for line in file if line.startswith("CRYST1")]
    if len(lines) != 1:
        return None
    ends = [6, 15, 24, 33, 40, 47, 54]
    try:
        found = np.array([float(lines[0][a:b]) for a, b in zip(ends, ends[1:])])
    except ValueError:
        raise ValueError(f"it has no valid cell: {lines[0].strip()}") from None
    # A cube of one angstrom means that there is no cell.
    return None if (found[:3] == 1).all() else found


def as_mdanalysis_reads(path: Path, folder: Path) -> Path:
    """Returns a file, or a copy in a folder if MDAnalysis does not read its kind: PDB files whose
    frames lines END separate, as VMD writes them, and H5MD files with one cell for all frames."""
    found = path
    if path.suffix.lower() in PDB:
        with open(path, encoding="latin-1") as file:
            ends = [word for line in file if (word := line[:6].strip()) in ("END", "MODEL")]
            if ends.count("END") > 1 and "MODEL" not in ends:
                file.seek(0)
                folder.mkdir()
                found = folder / path.name
                with open(found, "w", encoding="latin-1") as made:
                    made.writelines(_with_models(file))
    elif path.suffix.lower() in H5MD and (h5py := library("h5py", "mdanalysis")).is_hdf5(path):
        with h5py.File(path) as given:
            groups = given.get("particles", {})
            fixed = [name for name in groups if isinstance(_edges(groups[name]), h5py.Dataset)]
            if fixed:
                folder.mkdir()
                found = folder / path.name
                with h5py.File(found, "w") as made:
                    _link(given, made, leave=["particles"])
                    for name in groups:
                        _link(groups[name], made.create_group(f"particles/{name}"), leave=["box"])
                        _copy_box(groups[name], made[f"particles/{name}"], name in fixed)
    return found


def _with_models(lines: Iterable[str]) -> Iterator[str]:
    """Returns the lines of a PDB file whose lines END end models, with lines MODEL."""
    model, is_open = 0, False
    for line in lines:
        word = line[:6].strip()
        if not is_open and word in ("CRYST1", "ATOM", "HETATM"):
            model, is_open = model + 1, True
            yield f"MODEL     {model:4}\n"
        if word != "END":
            yield line
        elif is_open:
            is_open = False
            yield "ENDMDL\n"
    if is_open:
        yield "ENDMDL\n"


def _edges(group: Any) -> Any:
    return group["box"].get("edges") if "box" in group else None


def _link(given: Any, made: Any, leave: Sequence[str]) -> None:
    """Links the members of a group of HDF5, except some, in another file, which saves a copy of the
    data. Copies the attributes."""
    h5py = library("h5py", "mdanalysis")
    made.attrs.update(given.attrs)
    for name in given:
        if name not in leave:
            made[name] = h5py.ExternalLink(os.path.abspath(given.file.filename), given[name].name)


def _copy_box(given: Any, made: Any, is_fixed: bool) -> None:
    """Copies the box of H5MD. Edges that hold for all frames are repeated for each."""
    if "box" not in given:
        return
    _link(given["box"], made.create_group("box"), leave=["edges"] if is_fixed else [])
    if is_fixed:
        positions, edges = given["position"], _edges(given)
        frames = len(positions["value"])
        value = made.create_dataset(
            "box/edges/value", data=np.broadcast_to(edges[()], (frames, *edges.shape))
        )
        value.attrs.update(edges.attrs)
        _link(positions, made["box/edges"], leave=["value"])


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
    lines = path.read_bytes().splitlines()
    if suffix == ".gro":
        # A title, the number of atoms, the atoms, and the cell.
        return any(line.strip() for line in lines[int(lines[1]) + 3 :])
    return sum(line.startswith(b"MODEL") for line in lines) > 1


def chain_ends(path: Path) -> list[int]:
    """Returns the number of atoms before each TER in the first model of a PDB file."""
    atoms, ends = 0, []
    if path.suffix.lower() in (*PDB, ".xpdb") and path.is_file():
        with open(path, encoding="latin-1") as file:
            for line in takewhile(lambda line: not line.startswith("END"), file):
                atoms += line.startswith(("ATOM", "HETATM"))
                if line.startswith("TER"):
                    ends.append(atoms)
    return ends


def check_bonds(path: Path) -> None:
    """Raises an error if CONECT of a PDB file does not tell the bonds: its serial numbers have five
    digits, so they begin again after 99,999 atoms, and MDAnalysis takes the last of equal ones; or
    a file without END is cut off, so that some bonds are there for one of their atoms only."""
    if path.suffix.lower() not in (*PDB, ".xpdb") or not path.is_file():
        return
    serials: Counter[str] = Counter()
    bonds: set[tuple[str, str]] = set()
    is_first, line = True, ""
    with open(path, encoding="latin-1") as file:
        for line in file:
            if line.startswith("CONECT"):
                bonds.update(_conect(line))
            elif is_first and line.startswith(("ATOM", "HETATM")):
                serials[line[6:11].strip()] += 1
            # The first model is the topology.
            is_first = is_first and not line.startswith("END")
    bonded = {atom for bond in bonds for atom in bond}
    twice = next((one for one in serials if serials[one] > 1 and one in bonded), None)
    # MDAnalysis drops all bonds if serial numbers are stars.
    if twice or bonded and "*****" in serials:
        raise ValueError(
            f"{path}: {serials[twice or '*****']} atoms have the serial number "
            f"{twice or '*****'}, so CONECT does not tell the bonds: give a topology that has "
            f"them before it, such as melt.psf {path}"
        )
    once = sorted((a, b) for a, b in bonds if (b, a) not in bonds and b in serials)
    if 0 < len(once) < len(bonds) and line.startswith("CONECT"):
        raise ValueError(
            f"{path}: CONECT of atom {once[0][0]} names atom {once[0][1]}, but not the other way "
            "round: the file is cut off; if it is complete, add a line END"
        )


def check_end(path: Path, trajectory: Any) -> None:
    """Raises an error if the last frame of a trajectory is cut off, which MDAnalysis ignores."""
    atoms, frames = trajectory.n_atoms, len(trajectory)
    offsets = getattr(getattr(trajectory, "_xdr", None), "offsets", [])
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
        elif suffix == ".trr" and len(offsets) == frames > 1:
            # Frames have equal lengths, unless some lack velocities or forces.
            lengths = set(np.diff(offsets).tolist())
            whole = size - int(offsets[-1]) in lengths
        elif suffix == ".xtc" and len(offsets) == frames and atoms > 9:
            at = int(offsets[-1])
            # Coordinates are padded to a multiple of 4 bytes.
            magic, length = head(at, ">i84xi") if size >= at + 92 else (XTC, 0)
            whole = magic != XTC or size == at + 92 + length + -length % 4
        elif is_dump(path):
            file.seek(max(0, size - 2 * size // frames))
            last = file.read().rpartition(b"ITEM: TIMESTEP")[2]
            whole = last.count(b"\n") + (not last.endswith(b"\n")) >= atoms + 9
        elif suffix in PDB:
            file.seek(max(0, size - 1000))
            line = (file.read().splitlines(keepends=True) or [b"\n"])[-1]
            whole = line.endswith((b"\n", b"\r")) or _is_whole(line)
        elif suffix in XYZ:
            file.seek(0)
            breaks = sum(chunk.count(b"\n") for chunk in iter(lambda: file.read(1 << 20), b""))
            file.seek(max(0, size - 1000))
            last = file.read()
            # Empty lines may follow the last frame.
            text = last.rstrip()
            lines = breaks - last[len(text) :].count(b"\n") + 1
            whole = lines % (atoms + 2) == 0 and len(text.split(b"\n")[-1].split()) > 3
        elif suffix in (".arc", ".txyz"):
            file.seek(0)
            whole = _has_whole_frames(file)
    if not whole:
        raise ValueError(f"{path}: the last frame is cut off")


def _is_whole(line: bytes) -> bool:
    """Returns whether the last line of a PDB file, which no line break ends, is whole."""
    if line.startswith((b"ATOM", b"HETATM")):
        return len(line) >= 54
    # A bond may be missing in a CONECT, and nothing tells.
    return line.startswith((b"END", b"TER", b"MASTER"))


def _has_whole_frames(text: Iterable[bytes]) -> bool:
    """Returns true if the lines of a Tinker file form complete frames."""
    lines = [line for line in text if line.strip()]
    # A cell has a line of six numbers after the title.
    cell = len(lines) > 1 and len(lines[1].split()) == 6 and b"." in lines[1].split()[0]
    frame = 1 + int(lines[0].split()[0]) + cell
    return not len(lines) % frame and len(lines[-1].split()) >= len(lines[frame - 1].split())
