"""Reads frames of curves from files of other programs, and writes what the command reads.

>>> import linkwatch
>>> frames = linkwatch.read("scene.usdc")  # doctest: +SKIP
>>> print(frames.summary)  # doctest: +SKIP
70 curves, 70 closed
>>> linkwatch.write(frames, "scene.npz")  # doctest: +SKIP
[PosixPath('scene.npz')]

``python -m linkwatch convert scene.usdc scene.npz`` does the same. Some readers need a library,
which is an extra of this package: ``pip install "linkwatch[mdanalysis]"``. ``FORMATS`` has them
all.

To add a format of one frame a file, write a function from a path to a ``Scene`` of curves, and name
it in ``FORMATS``.
"""

from __future__ import annotations

import bz2
import contextlib
import glob
import gzip
import lzma
import os
import re
import shutil
import weakref
import zlib
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from .. import _arguments as arguments
from . import _hair, _mdanalysis, _mesh, _native, _oxdna, _text, _usd
from ._curves import Options, is_dump
from ._frames import Frame, Frames, Summary
from ._mesh import read_files
from ._npz import write

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from typing import Any

__all__ = ["FORMATS", "Format", "Frame", "Frames", "Summary", "from_mdanalysis", "read", "write"]

#: Suffixes of files that the command always reads itself, and of those that are no molecules.
MODELS = (".bcc", ".npy", ".npz", ".mcap", ".obj", ".vect")
OWN = (*MODELS, ".xyz", ".extxyz", ".dump", ".lammpstrj")

#: Bytes at the beginning of a file that may tell its format.
HEAD = 1 << 10


@dataclass(frozen=True)
class Format:
    """A format of files, and its reader.

    >>> import linkwatch
    >>> [one.suffixes for one in linkwatch.io.FORMATS if one.name == "vtk-xml"]
    ['.vtp .vtu .pvtp .pvtu .vtm']
    """

    name: str
    #: Suffixes in lower case, separated by spaces.
    suffixes: str
    read: Callable[[Sequence[Path], Options], Frames]
    #: Pattern that the file begins with, if other formats have the same suffixes.
    begins: str = ""
    #: Options of :func:`read` that the reader has, besides those of all.
    options: str = "closed unwrap cell"

    def has(self, path: Path) -> bool:
        """Returns if a file has this format."""
        if path.suffix.lower() not in self.suffixes.split():
            return False
        return not self.begins or re.match(self.begins.encode(), _head(path), re.I) is not None


#: The formats, of which the first one that has a file reads it. All others are the command's.
FORMATS = [
    Format("usd", ".usd .usda .usdc .usdz", _usd.read, options="cell"),
    Format("oxdna", ".top", _oxdna.read, r"\s*\d+[ \t]+\d+\s"),
    Format("oxdna", ".dat .conf .oxdna", _oxdna.read, "t *="),
    Format(
        "mdanalysis",
        ".pdb .ent .xpdb .pdbqt .pqr .cif .mmcif .mmtf .gro .psf .top .prmtop .parm7 .tpr .itp "
        ".mol2 .dms .txyz .arc .crd .gsd .xtc .trr .dcd .nc .ncdf .trz .tng .h5md .h5 .hdf5",
        _mdanalysis.read,
        options="closed unwrap cell select",
    ),
    Format("vtk", ".vtk", read_files(_mesh.read_vtk)),
    Format("vtk-xml", ".vtp .vtu .pvtp .pvtu .vtm", read_files(_mesh.read_xml)),
    Format("pvd", ".pvd", _mesh.read_pvd),
    Format("ply", ".ply", read_files(_mesh.read_ply)),
    Format("meshio", ".msh .inp .xdmf .med .mesh .bdf .nas .fem", read_files(_mesh.read_meshio)),
    Format("makegrid", ".coils", read_files(_text.read_coils)),
    Format("houdini", ".poly", read_files(_text.read_poly)),
    # By this name only: the command reads what most files have.
    Format("obj", "", read_files(_text.read_obj), options="cell"),
    Format("texgen", ".tg3", read_files(_text.read_texgen), options="unwrap cell"),
    Format("hair", ".hair", read_files(_hair.read_hair)),
    Format("usc-hair", ".data", read_files(_hair.read_usc), r"[\s\S]{0,1000}\x00"),
    # Files whose format the name does not tell.
    Format("linkwatch", "", _native.read, options="closed unwrap cell counts topic one_motion"),
]


#: Suffixes of compressed files, and what opens them.
COMPRESSED: dict[str, Callable[..., Any]] = {
    ".gz": gzip.open, ".bz2": bz2.open, ".xz": lzma.open
}


# Suffixes of files that refer to others.
REFERRING = ".pvd .pvtp .pvtu .vtm .xdmf .usd .usda".split()


def unpacked(paths: Sequence[Path], folder: Path) -> list[Path]:
    """Returns files, with the contents of the compressed ones in a folder. Files whose names differ
    in suffixes only, such as a topology, or that they may refer to, are then beside them."""
    found = [_unpacked(path, folder) for path in paths]
    for path, plain in zip(paths, found):
        near = "*" if plain.suffix.lower() in REFERRING else f"{glob.escape(plain.stem)}.*"
        others = [] if path == plain else path.parent.glob(near)
        for other in others:
            beside = plain.parent / other.name
            if other.suffix.lower() not in COMPRESSED and not os.path.lexists(beside):
                with contextlib.suppress(OSError):  # Windows needs a privilege
                    beside.symlink_to(other.absolute())
    return found


def _unpacked(path: Path, folder: Path) -> Path:
    """Returns a file, or the contents of a compressed one, in a folder."""
    open_it = COMPRESSED.get(path.suffix.lower())
    if open_it is None:
        return path
    # Files of several folders may have the same name, and the numbers in the names of folders
    # decide the order.
    place = Path(os.path.abspath(path))
    plain = folder / place.relative_to(place.anchor) / path.stem
    plain.parent.mkdir(parents=True, exist_ok=True)
    try:
        with open_it(path, "rb") as packed, open(plain, "wb") as file:
            shutil.copyfileobj(packed, file)
    except (EOFError, lzma.LZMAError, zlib.error) as why:
        raise ValueError(f"{path}: {why}") from None
    return plain


def _head(path: Path) -> bytes:
    """Returns the beginning of a file."""
    with open(path, "rb") as file:
        return file.read(HEAD)


def format_of(path: Path) -> Format:
    """Returns the format of a file: the last one, read by the command, if no other matches."""
    found = next((one for one in FORMATS if one.has(path)), FORMATS[-1])
    if path.name.lower().startswith("coils."):
        is_unknown = found is FORMATS[-1] and not path.name.lower().endswith(OWN)
        if is_unknown or re.match(rb"\s*periods\s", _head(path), re.I):
            return next(one for one in FORMATS if one.name == "makegrid")
    return found


# Names of formats that are read together: a topology may be one that the command reads as well.
TOGETHER = ({"mdanalysis", "linkwatch"}, {"mdanalysis", "oxdna"})


def groups(paths: Sequence[Path], format: str | None) -> list[int]:
    """Divides files into successive ones that the package reads together, as topologies and their
    trajectories, and returns their numbers. ``format`` is that of :func:`read`."""
    found: list[list[str]] = []
    for path in paths:
        name, last = "", found[-1] if found else []
        if path.is_file() and path.suffix.lower() not in MODELS:
            name = format or format_of(path).name
        # A topology that the command reads comes first of all.
        follows = name == "mdanalysis" and found == [["linkwatch"]]
        if {"mdanalysis", "oxdna"} & {*last} and any({name, *last} <= one for one in TOGETHER):
            follows = name != "linkwatch" or path.suffix.lower() in OWN or is_dump(path)
        if follows:
            last.append(name)
        else:
            found.append([name])
    return [len(one) for one in found]


def _format_of_all(paths: Sequence[Path]) -> Format:
    """Returns the format of files that are read together."""
    found = [format_of(path) for path in paths]
    both = {one.name for one in found}
    if len(both) == 1:
        return found[0]
    if both in TOGETHER:
        return next(one for one in found if one.name == "mdanalysis")
    raise ValueError(
        "these files have different formats, so they are no frames of one motion: "
        + ", ".join(f"{path} ({one.name})" for path, one in zip(paths, found))
    )


def read(
    path: str | os.PathLike[str],
    *more: str | os.PathLike[str],
    closed: bool | None = None,
    keep_open: bool = False,
    unwrap: bool | None = None,
    select: str | None = None,
    cell: Any = None,
    counts: Any = None,
    topic: str | None = None,
    one_motion: bool = False,
    keep_order: bool = False,
    format: str | None = None,
) -> Frames:
    """Opens files, whose names and contents select the reader. Frames are read one at a time.
    Files that end with ``.gz``, ``.bz2`` or ``.xz`` are unpacked to a temporary folder.

    >>> import linkwatch
    >>> import numpy as np
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     (path,) = linkwatch.write([linkwatch.io.Frame(np.eye(3), [-3])], f"{folder}/run.npz")
    ...     frames = linkwatch.read(path)
    ...     [frame.positions.shape for frame in frames]
    [(3, 3)]

    Args:
        path: a file. Formats that the command reads itself are read by it.
        more: further files: trajectories that follow a topology, or one file for each frame.
        closed: True closes curves that the files leave open, False keeps curves open that only end
            where they start.
        keep_open: keeps curves open that only end where they start, in files of all formats.
        unwrap: whether every vertex is moved to the image nearest to the previous one, in a
            periodic cell. By default, as the format needs it: True for molecules and oxDNA.
        select: atoms to read of molecules, in the language of MDAnalysis.
        cell: periodic cell in place of that of the files: see ``help(linkwatch)``. ``"none"``
            ignores the cell.
        counts: number of points of each curve, negative if it is closed, of files that do not say
            it: ``.npy``, plain text, and extended XYZ without molecules.
        topic: topic to read of a MCAP file of another program, if several have curves.
        one_motion: files with several frames each continue one another, in the order that is given:
            ``run.npz`` and ``run-2.npz`` of :func:`write`.
        keep_order: files keep the order in which they are given, whatever numbers their names have.
        format: name of one of ``FORMATS``, if the names of the files do not say it.

    Returns:
        Frames: an iterable of :class:`Frame`. Its ``summary`` says what was read, closed,
        unwrapped, and left out.

    Raises:
        ImportError: the library that reads this format is not installed. The message says how.
        OSError: a file cannot be opened.
        ValueError: a file is damaged, has no curves, or is of an unknown kind.
    """
    paths = [Path(one) for one in (path, *more)]
    for one in paths:
        with open(one, "rb"):
            pass
    again = tuple(one.absolute() for one in paths)
    folder = None
    if any(one.suffix.lower() in COMPRESSED for one in paths):
        folder = TemporaryDirectory(prefix="linkwatch-")
        paths = unpacked(paths, Path(folder.name))
    named = {one.name: one for one in FORMATS}
    if format is not None and format not in named:
        raise ValueError(f"format is {format!r}, expected one of {', '.join(named)}")
    found = named[format] if format else _format_of_all(paths)
    closed = arguments.flag_or_none("closed", closed)
    unwrap = arguments.flag_or_none("unwrap", unwrap)
    keep_open = arguments.flag("keep_open", keep_open)
    one_motion = arguments.flag("one_motion", one_motion)
    keep_order = arguments.flag("keep_order", keep_order)
    given = {"closed": closed, "unwrap": unwrap, "cell": cell, "select": select}
    given |= {"counts": counts, "topic": topic, "one_motion": one_motion or None}
    for name, value in given.items():
        if value is not None and name not in found.options.split():
            raise ValueError(f"{path}: `{name}` is no option for files of the format {found.name}")
    if keep_open and closed is None and found is not FORMATS[-1]:
        closed = False
    options = Options(closed, unwrap, cell, select or "all", counts, topic, one_motion)
    options.keep_open, options.keep_order = keep_open, keep_order
    frames = found.read(paths, options)
    if folder is not None:
        weakref.finalize(frames, folder.cleanup)
    given |= {"one_motion": one_motion, "keep_open": keep_open, "keep_order": keep_order}
    given["format"] = format
    frames.recipe = read, again, given
    return frames


def from_mdanalysis(
    atoms: Any,
    *,
    trajectory: Any = None,
    closed: bool | None = None,
    unwrap: bool = True,
    cell: Any = None,
) -> Frames:
    """Returns the frames of a ``Universe`` or an ``AtomGroup`` of MDAnalysis.

    A connected set of bonds is a curve: a ring is closed, a chain open. The curve of a molecule
    with branches is its longest chain, or its only ring of more than 12 atoms if that is longer.
    Networks are left out. Without bonds, the atoms of each segment are a chain, or those of each
    residue if residues have several atoms. The summary says so.

    >>> import linkwatch
    >>> import MDAnalysis
    >>> import numpy as np
    >>> universe = MDAnalysis.Universe.empty(4, trajectory=True)
    >>> universe.atoms.positions = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    >>> universe.add_TopologyAttr("bonds", [(0, 1), (1, 2), (2, 3), (3, 0)])
    >>> [frame.counts for frame in linkwatch.io.from_mdanalysis(universe)]
    [[-4]]

    Args:
        atoms: a universe or a group of atoms, of which bonds within the group count.
        trajectory: frames to read, such as ``universe.trajectory[::10]``.
        closed, unwrap, cell: those of :func:`read`.
    """
    closed, unwrap = arguments.flag_or_none("closed", closed), arguments.flag("unwrap", unwrap)
    frames = _mdanalysis.frames_of_atoms(atoms, Options(closed, unwrap, cell), trajectory)
    given = {"trajectory": trajectory, "closed": closed, "unwrap": unwrap, "cell": cell}
    if trajectory is None:
        frames.recipe = from_mdanalysis, (atoms,), given
    return frames
