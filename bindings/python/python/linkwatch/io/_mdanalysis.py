"""Molecules of every format that ``MDAnalysis`` reads, as curves along their bonds."""

from __future__ import annotations

import contextlib
import warnings
import weakref
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np

from ._curves import (
    Molecule,
    Options,
    Rules,
    Scene,
    frames_of_scenes,
    in_order,
    is_dump,
    molecules,
    plural,
)
from ._frames import Summary, library
from ._trajectory import (
    H5MD,
    PDB,
    XYZ,
    PassedOver,
    as_mdanalysis_reads,
    chain_ends,
    check_bonds,
    check_end,
    check_number_of_frames,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from typing import Any

    from ._curves import Array
    from ._frames import Frame, Frames

# Suffixes of topologies without coordinates.
TOPOLOGIES = (".psf", ".top", ".prmtop", ".parm7", ".tpr", ".itp")
# Units of the times of files without times.
COUNTED = ("steps of the simulation", "frames")


def read(paths: Sequence[Path], options: Options) -> Frames:
    """Opens a topology and trajectories; the first file is the topology. Its coordinates are frames
    as well if a later file has the same kind: then the files are sorted before."""
    with contextlib.ExitStack() as stack:
        folder = Path(stack.enter_context(TemporaryDirectory(prefix="linkwatch-")))
        frames = _opened(paths, options, folder)
        if any(folder.iterdir()):
            # Copies of the files are read until the frames are deleted.
            weakref.finalize(frames, stack.pop_all().close)
    return frames


def _opened(paths: Sequence[Path], options: Options, folder: Path) -> Frames:
    mda = library("MDAnalysis", "mdanalysis")
    top, *others = paths
    has_frames = top not in others and _kind(top) in map(_kind, others)
    if _kind(top) in XYZ and any(_kind(one) in (PDB[0], *TOPOLOGIES) for one in others):
        raise ValueError(f"{top}: a trajectory has no bonds: give its topology before it")
    others, notes = in_order(paths if has_frames else others, options)
    if has_frames:
        top = others[0]
    elif others and top not in others and top.suffix.lower() not in TOPOLOGIES:
        notes.append(f"{top} is the topology: its coordinates are no frames")
    paths = [top, *others]
    # Files of several folders may have the same name.
    copies = {one: folder / str(k) for k, one in enumerate(dict.fromkeys(paths))}
    read = {one: str(as_mdanalysis_reads(one, copy)) for one, copy in copies.items()}
    # MDAnalysis goes by the suffix, of which H5MD and dumps of LAMMPS have several.
    kind = {"topology_format": "LAMMPSDUMP"} if is_dump(top) else {}
    ways: list[dict[str, Any]] = [{}]
    for path in paths[1:]:
        if is_dump(path):
            ways = [{"format": "LAMMPSDUMP", "additional_columns": ["id"]}]
            with open(path, "rb") as file:
                start = file.read(1 << 10)
            for item, what in (
                (b"BOX BOUNDS abc", "general triclinic box (abc origin)"),
                (b"ITEM: UNITS", "dump with `ITEM: UNITS`"),
                (b"ITEM: TIME\n", "dump with `ITEM: TIME`"),
            ):
                if item in start:
                    raise ValueError(
                        f"{path}: MDAnalysis reads no {what}: give a data file of LAMMPS with the "
                        f"bonds, such as melt.data, in place of {paths[0]}"
                    )
        elif path.suffix.lower() in H5MD:
            # Units are optional.
            ways = [{"format": "H5MD"}, {"format": "H5MD", "convert_units": False}]
    with warnings.catch_warnings():
        # About elements and masses that are guessed, which are not used here.
        warnings.simplefilter("ignore")
        for way in ways:
            try:
                universe = mda.Universe(*map(read.get, paths), to_guess=(), **kind, **way)
                atoms = universe.select_atoms(options.select)
                trajectory = universe.trajectory
                break
            except ImportError:
                raise
            except Exception as why:  # MDAnalysis raises many kinds
                if way is ways[-1]:
                    named = " ".join(map(str, paths))
                    raise ValueError(f"{named}: MDAnalysis cannot read this: {_said(why)}") from why
    known = (hasattr(universe.atoms, name) for name in ("bonds", "names", "types"))
    if not any(known):
        raise ValueError(
            f"{paths[0]}: a trajectory alone does not say which atoms form a curve: give its "
            f"topology before it, such as melt.psf {paths[0]}"
        )
    readers = getattr(trajectory, "readers", [trajectory])
    for path, reader in zip(paths[1:] or paths, readers):
        check_end(path, reader)
    frames = frames_of_atoms(atoms, options, trajectory, paths[0], notes)
    if has_frames:
        frames.runs = sum(len(reader) > 1 for reader in readers)
    return frames


def _kind(path: Path) -> str:
    """Returns the suffix of files of a kind."""
    suffix = path.suffix.lower()
    return "dump" if is_dump(path) else PDB[0] if suffix in PDB else suffix


def _said(why: Exception) -> str:
    """Returns the message of an exception in one line."""
    return " ".join(str(why).split()) or type(why).__name__


def frames_of_atoms(
    atoms: Any,
    options: Options,
    trajectory: Any = None,
    path: Path | None = None,
    notes: Sequence[str] = (),
) -> Frames:
    """Returns the frames of a trajectory: see :func:`linkwatch.io.from_mdanalysis`."""
    atoms = atoms.atoms
    universe = atoms.universe
    trajectory = universe.trajectory if trajectory is None else trajectory
    path = path or Path(str(universe.trajectory.filename or "the universe"))
    if not len(atoms):
        raise ValueError(f"{path}: no atoms are selected")
    check_number_of_frames(universe.trajectory)
    check_bonds(Path(str(universe.filename)))
    options.unwrap = options.unwrap is not False
    topology = Scene(notes=[*notes])
    found = _bonded(atoms, topology)
    by_bonds = found is not None
    if found is None:
        found = _grouped(atoms, topology, path, options.closed)
    order = np.concatenate([one.nodes for one in found] or [[]]).astype(np.int64)
    whole = np.array_equal(order, np.arange(universe.atoms.n_atoms))
    counts = [-len(one.nodes) if one.closed else len(one.nodes) for one in found]
    names, radii = _names(universe, found), _radii(universe, found)
    unit = _unit(universe.trajectory)

    def scenes(trajectory: Any = trajectory) -> Iterator[Scene]:
        frames = iter(trajectory)
        passed_over = PassedOver(universe)
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
            unfit, cell = "", None
            if now.has_positions:
                positions = now.positions
            else:
                unfit = "it has no positions"
                positions = np.full((now.n_atoms, 3), np.nan, np.float32)
            if by_bonds and passed_over.has_other_bonds(now):
                unfit = "it has other bonds than the first frame, whose bonds define the curves"
            try:
                by_id = passed_over.order(now)
                positions = positions if by_id is None else positions[by_id]
                if options.cell is None:
                    cell = passed_over.cell(now)
                    if cell is not None and not np.isfinite(cell).all():
                        cell, unfit = None, "its cell is not finite"
            except ValueError as why:
                unfit = str(why)
            yield Scene(
                # The next frame overwrites the positions.
                points=positions.copy() if whole else np.take(positions, order, axis=0),
                counts=counts,
                names=names,
                radii=radii,
                left_out=topology.left_out,
                notes=topology.notes,
                cell=cell,
                time=float(now.data.get("step", now.frame) if unit in COUNTED else now.time),
                place=f"{path}, frame {now.frame}",
                seq=int(now.frame),
                unfit=unfit,
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
        kind = "molecule(s) with several loops, or a loop and a longer chain"
        scene.left_out.add(kind, f"{len(nodes)} atoms from the index {min(nodes)} on")
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
        kind = "atom(s) of proteins or nucleic acids without bonds"
        scene.left_out.add(kind, f"the index {chains[0].index}", len(chains))
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
    members = [np.flatnonzero(of_atom == group) for group in np.unique(of_atom)]
    numbers = getattr(atoms, "resids", residues)
    part = np.searchsorted(chain_ends(Path(str(atoms.universe.filename))), atoms.indices, "right")
    for one in members if level == "segment" else []:
        repeat = len(np.unique(numbers[one])) < len(one)
        ends = np.flatnonzero(repeat & (np.diff(numbers[one]) < 0) | (np.diff(part[one]) > 0))
        if len(ends):
            before, after = numbers[one[ends[0]]], numbers[one[ends[0] + 1]]
            raise ValueError(
                f"{path}: no bonds, and several chains in segment "
                f"{getattr(atoms, 'segids', segments)[one[0]]}: one ends with residue {before}, "
                f"before residue {after}; give each chain an id, a topology with bonds, or a "
                "narrower `select`, such as 'protein and name CA'"
            )
    found = [Molecule(atoms.indices[one].tolist(), False) for one in members]
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
        scene.left_out.add("possible closing bond(s)", where, len(found))
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
