"""Molecules of every format that ``MDAnalysis`` reads, as curves along their bonds."""

from __future__ import annotations

import struct
import warnings
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ._curves import Molecule, Options, Rules, Scene, frames_of_scenes, is_dump, molecules, plural
from ._frames import Summary, library

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from typing import Any

    from ._curves import Array
    from ._frames import Frame, Frames

# First bytes of the frames of an .xtc file.
XTC = 1995
# Units of the times of files without times.
COUNTED = ("steps of the simulation", "frames")


def read(paths: Sequence[Path], options: Options) -> Frames:
    """Opens a topology and trajectories; the first file is the topology."""
    mda = library("MDAnalysis", "mdanalysis")
    topology, *trajectories = map(str, paths)
    # MDAnalysis goes by the suffix, of which H5MD and dumps of LAMMPS have several.
    ways: list[dict[str, Any]] = [{}]
    for path in paths[1:]:
        if is_dump(path):
            ways = [{"format": "LAMMPSDUMP"}]
        elif path.suffix.lower() in (".h5md", ".h5", ".hdf5"):
            # Units are optional.
            ways = [{"format": "H5MD"}, {"format": "H5MD", "convert_units": False}]
    with warnings.catch_warnings():
        # About elements and masses that are guessed, which are not used here.
        warnings.simplefilter("ignore")
        for way in ways:
            try:
                universe = mda.Universe(topology, *trajectories, to_guess=(), **way)
                atoms = universe.select_atoms(options.select)
                trajectory = universe.trajectory
                break
            except ImportError:
                raise
            except Exception as why:  # MDAnalysis raises many kinds
                if way is ways[-1]:
                    named = " ".join(map(str, paths))
                    said = _said(why)
                    raise ValueError(f"{named}: MDAnalysis cannot read this: {said}") from why
    known = (hasattr(universe.atoms, name) for name in ("bonds", "names", "types"))
    if len(paths) == 1 and not any(known):
        raise ValueError(
            f"{topology}: a trajectory alone does not say which atoms form a curve: give its "
            f"topology before it, such as melt.psf {topology}"
        )
    _check_ends(paths[1:] or paths, trajectory)
    return frames_of_atoms(atoms, options, trajectory, paths[0])


def _check_ends(paths: Sequence[Path], trajectory: Any) -> None:
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
        if not whole:
            raise ValueError(f"{path}: the last frame is cut off")


def _said(why: Exception) -> str:
    """Returns the message of an exception in one line."""
    return " ".join(str(why).split()) or type(why).__name__


def frames_of_atoms(
    atoms: Any, options: Options, trajectory: Any = None, path: Path | None = None
) -> Frames:
    """Returns the frames of a trajectory: see :func:`linkwatch.io.from_mdanalysis`."""
    atoms = atoms.atoms
    universe = atoms.universe
    trajectory = universe.trajectory if trajectory is None else trajectory
    path = path or Path(str(universe.trajectory.filename or "the universe"))
    if not len(atoms):
        raise ValueError(f"{path}: no atoms are selected")
    options.unwrap = options.unwrap is not False
    topology = Scene()
    found = _bonded(atoms, topology)
    if found is None:
        found = _grouped(atoms, topology, path, options.closed)
    order = np.concatenate([one.nodes for one in found] or [[]]).astype(np.int64)
    whole = np.array_equal(order, np.arange(universe.atoms.n_atoms))
    counts = [-len(one.nodes) if one.closed else len(one.nodes) for one in found]
    names, radii = _names(universe, found), _radii(universe, found)
    unit = _unit(universe.trajectory)

    def scenes(trajectory: Any = trajectory) -> Iterator[Scene]:
        frames = iter(trajectory)
        read = 0
        while True:
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")
                    now = next(frames, None)
            except (OSError, EOFError, ValueError, RuntimeError, IndexError) as why:
                raise ValueError(f"{path}: MDAnalysis cannot read on: {_said(why)}") from why
            if now is None:
                if read < len(trajectory):
                    raise ValueError(f"{path}: only {read} of {len(trajectory)} frames can be read")
                return
            read += 1
            yield Scene(
                # The next frame overwrites the positions.
                points=now.positions.copy() if whole else np.take(now.positions, order, axis=0),
                counts=counts,
                names=names,
                radii=radii,
                left_out=topology.left_out,
                notes=topology.notes,
                cell=_cell(now),
                time=float(now.data.get("step", now.frame) if unit in COUNTED else now.time),
                place=f"{path}, frame {now.frame}",
                seq=int(now.frame),
            )

    def part(start: int, stop: int) -> Iterator[Frame]:
        rules = Rules(options, Summary())
        found = scenes(trajectory[[0, *range(start, stop)]])
        # The first frame decides which curves are closed.
        rules.frame(next(found), 0)
        for seq, scene in enumerate(found, start):
            yield rules.frame(scene, seq)

    frames = frames_of_scenes(path, scenes, options, len(trajectory))
    frames.part = part
    frames.summary.time_unit = unit
    return frames


def _unit(trajectory: Any) -> str:
    """Returns the unit of times: MDAnalysis converts to ps, and counts frames if there is none."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        _ = trajectory.ts.time
    if any("no dt information" in str(warning.message) for warning in said):
        return COUNTED[0] if "step" in trajectory.ts.data else COUNTED[1]
    converted = getattr(trajectory, "convert_units", True)
    return "ps" if converted else str(trajectory.units.get("time") or "the unit of the simulation")


def _cell(now: Any) -> Array | None:
    """Returns the cell of a frame, if it has one."""
    if now.dimensions is None or not now.dimensions[:3].all():
        return None
    core = library("MDAnalysis.lib.mdamath", "mdanalysis")
    vectors = core.triclinic_vectors(now.dimensions, dtype=np.float64)
    return np.vstack([vectors, np.zeros(3)])


def _bonded(atoms: Any, scene: Scene) -> list[Molecule] | None:
    """Returns the curves of molecules with bonds, or ``None`` if there are no bonds."""
    try:
        bonds = atoms.universe.bonds.to_indices()
    except AttributeError:  # NoDataError of MDAnalysis
        return None
    chosen = np.zeros(atoms.universe.atoms.n_atoms, bool)
    chosen[atoms.indices] = True
    bonds = bonds[chosen[bonds].all(axis=1)]
    if not len(bonds):
        return None
    found, networks = molecules(bonds)
    for nodes in networks:
        kind = "with several loops, or a loop and a longer chain"
        place = f"{len(nodes)} atoms from the index {min(nodes)} on"
        scene.left_out.add(f"molecule {kind}", f"molecules {kind}", place)
    branched = [one for one in found if one.side]
    if branched:
        rings = sum(one.closed for one in branched)
        side = sum(one.side for one in branched)
        kinds = ((rings, "ring"), (len(branched) - rings, "longest chain"))
        scene.notes.append(
            f"{plural(len(branched), 'molecule has', 'molecules have')} branches: the curve is "
            + " and ".join(f"the {kind} of {number}" for number, kind in kinds if number)
            + f"; {plural(side, 'atom', 'atoms')} beside it are ignored"
        )
    chosen[bonds] = False
    single = atoms.universe.atoms[chosen]
    chains = _of_life(single)
    if len(chains):
        # Some files have the bonds of ligands only.
        kind = "of proteins or nucleic acids without bonds"
        place = f"the index {chains[0].index}"
        scene.left_out.add(f"atom {kind}", f"atoms {kind}", place, len(chains))
    if len(single) > len(chains):
        scene.notes.append(f"{len(single) - len(chains)} atoms without bonds are no curves")
    return found


def _grouped(atoms: Any, scene: Scene, path: Path, closed: bool | None) -> list[Molecule]:
    """Returns chains of the atoms of each segment, or residue, in the order of the file."""
    segments, residues = atoms.segindices, atoms.resindices
    level, of_atom = "segment", segments
    if (np.bincount(residues)[np.unique(residues)] > 1).any():
        # Several beads in a residue: a residue is a molecule, as in LAMMPS.
        level, of_atom = "residue", residues
        if len(np.unique(segments)) > 1 or len(_of_life(atoms)):
            raise ValueError(
                f"{path}: no bonds, and residues of several atoms: give a topology with bonds, or "
                "select one atom of each residue, such as select='name CA'"
            )
    found = [
        Molecule(atoms.indices[of_atom == group].tolist(), False) for group in np.unique(of_atom)
    ]
    single = sum(len(one.nodes) < 2 for one in found)
    if single:
        scene.notes.append(f"{single} atoms that are alone in their {level} are no curves")
    scene.notes.append(
        f"there are no bonds: the atoms of each {level} are a chain, in the order of the file"
    )
    found = [one for one in found if len(one.nodes) > 1]
    if closed is None and not len(_of_life(atoms)):
        # Rings would be verified without the bonds that close them.
        where = "`closed=True` or `closed=False` decides"
        scene.left_out.add("possible closing bond", "possible closing bonds", where, len(found))
    return found


def _of_life(atoms: Any) -> Any:
    """Returns the atoms of amino acids and nucleotides, of which a residue is no chain."""
    try:
        return atoms.select_atoms("protein or nucleic")
    except AttributeError:  # no names
        return atoms[:0]


def _names(universe: Any, found: list[Molecule]) -> list[str]:
    """Returns the names of the segments, if each has one curve."""
    ids = getattr(universe.atoms, "segids", None)
    names = ["" if ids is None else str(ids[one.nodes[0]]) for one in found]
    return names if all(names) and len(set(names)) == len(names) > 1 else []


def _radii(universe: Any, found: list[Molecule]) -> list[float]:
    """Returns the largest radius of each curve, if the topology has radii."""
    try:
        radii = np.asarray(universe.atoms.radii, float)
    except AttributeError:
        return []
    largest = [float(radii[one.nodes].max()) for one in found]
    return largest if all(radius > 0 for radius in largest) else []
