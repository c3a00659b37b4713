"""Molecules that MDAnalysis reads, and strands of oxDNA."""

import gzip
import warnings

import linkwatch
import numpy as np
import pytest
from linkwatch import io
from linkwatch._run import frames_of
from linkwatch.io._curves import molecules, unwrapped
from test_command import run
from test_formats import EDGES, POINTS, RING, needs, written

# Two linked rings of 12 beads, 10 apart in each direction of a cell of 10 x 11 x 12.
CELL = [10, 11, 12, 90, 90, 90]


def universe(points=POINTS, bonds=EDGES, frames=1, cell=CELL, residues=None, segments=None):
    """Returns a universe whose frames move along x."""
    mda = pytest.importorskip("MDAnalysis", reason="MDAnalysis is not installed")
    n = len(points)
    residues = np.zeros(n, int) if residues is None else np.asarray(residues)
    segments = [0] * (residues.max() + 1) if segments is None else segments
    made = mda.Universe.empty(
        n,
        len(segments),
        max(segments) + 1,
        atom_resindex=residues,
        residue_segindex=segments,
        trajectory=True,
    )
    steps = np.arange(frames)[:, None, None] * [0.1, 0, 0]
    made.load_new(np.float32(points + steps), dimensions=None if cell is None else np.array(cell))
    for name, values in {
        "names": ["C"] * n,
        "types": ["1"] * n,
        "masses": [1.0] * n,
        "resids": range(1, len(segments) + 1),
        "resnames": ["RNG"] * len(segments),
        "segids": [chr(65 + k) for k in range(max(segments) + 1)],
        "chainIDs": [chr(65 + segments[r]) for r in residues],
    }.items():
        made.add_TopologyAttr(name, list(values))
    if bonds is not None:
        made.add_TopologyAttr("bonds", [tuple(map(int, bond)) for bond in bonds])
    return made


def save(made, path, **options):
    """Writes all frames, as MDAnalysis does."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        made.atoms.write(str(path), frames="all", **options)
    return path


def dump(frames):
    """Returns a dump of LAMMPS."""
    text = ""
    for k, points in enumerate(frames):
        rows = "".join(f"{i + 1} {x} {y} {z}\n" for i, (x, y, z) in enumerate(points))
        text += f"ITEM: TIMESTEP\n{k}\nITEM: NUMBER OF ATOMS\n24\nITEM: BOX BOUNDS pp pp pp\n"
        text += f"0 10\n0 11\n0 12\nITEM: ATOMS id x y z\n{rows}"
    return text


def links(frame):
    session = linkwatch.Session(frame.counts)
    report = session.step(frame.positions, cell=frame.cell)
    assert report.intact, report
    found = linkwatch.certify(frame.positions, frame.counts, cell=frame.cell)
    return len(found.links) + len(found.images or [])


def test_bonds_are_rings_and_chains():
    made = universe(
        np.vstack([POINTS, POINTS[:12] + 5]), EDGES + [(24 + i, 25 + i) for i in range(10)]
    )
    frames = io.from_mdanalysis(made)
    (frame,) = frames
    assert frame.counts == [-12, -12, 11]
    assert "1 atoms without bonds are no curves" in str(frames.summary)
    with pytest.warns(linkwatch.UnverifiedWarning, match="1 of 3 curves is open"):
        assert links(frame) == 1
    np.testing.assert_array_equal(frame.cell, np.vstack([np.diag(CELL[:3]), np.zeros(3)]))
    # Of a group, its own bonds count.
    assert next(iter(io.from_mdanalysis(made.atoms[:20]))).counts == [-12, 8]
    assert next(iter(io.from_mdanalysis(made, cell="none"))).cell is None


@pytest.mark.parametrize("suffix", ["xtc", "trr", "dcd", "nc", "h5md", "lammpstrj", "xyz"])
def test_trajectories_follow_their_topology(tmp_path, suffix):
    made = universe(frames=3)
    top = save(made, tmp_path / "a.pdb", bonds="all")
    run_ = tmp_path / f"a.{suffix}"
    if suffix == "h5md":
        needs("h5py")
        made.load_new(str(save(made, tmp_path / "a.xtc")))
        save(made, run_)
    elif suffix == "lammpstrj":
        run_.write_text(dump(ts.positions for ts in made.trajectory))
    else:
        save(made, run_)
    frames = linkwatch.read(top, run_)
    assert "2 curves, 2 closed" in str(frames.summary)
    unit = {"xyz": "frames", "lammpstrj": "ps"}.get(suffix, "ps")
    assert frames.summary.time_unit == unit
    found = list(frames)
    assert [frame.seq for frame in found] == [0, 1, 2]
    assert [links(frame) for frame in found] == [1, 1, 1]
    np.testing.assert_allclose(found[2].positions[0, 0] - found[0].positions[0, 0], 0.2, atol=1e-2)
    out = tmp_path / "out.npz"
    code, _, err = run("convert", top, run_, out)
    assert code == 0, err
    assert f"times in {unit}" in err
    assert run("check", out)[0] == 0


def test_h5md_files_need_no_units(tmp_path):
    needs("h5py")
    made = universe(frames=2)
    top = save(made, tmp_path / "a.pdb", bonds="all")
    frames = linkwatch.read(top, save(made, tmp_path / "a.h5md", convert_units=False))
    assert [links(frame) for frame in frames] == [1, 1]
    assert frames.summary.time_unit == "the unit of the simulation"


def test_lammps_data_files_are_topologies(tmp_path):
    made = universe(frames=2)
    atoms = "".join(f"{i + 1} {i // 12 + 1} 1 {x} {y} {z}\n" for i, (x, y, z) in enumerate(POINTS))
    bonds = "".join(f"{k + 1} 1 {a + 1} {b + 1}\n" for k, (a, b) in enumerate(EDGES))
    text = (
        "rings\n\n24 atoms\n24 bonds\n1 atom types\n1 bond types\n\n0 10 xlo xhi\n0 11 ylo yhi\n"
        f"0 12 zlo zhi\n\nMasses\n\n1 1.0\n\nAtoms # bond\n\n{atoms}\nBonds\n\n{bonds}"
    )
    written(tmp_path, "a.data", text)
    # The command reads both.
    steps = [POINTS, POINTS + [0.1, 0, 0]]
    frames = linkwatch.read(tmp_path / "a.data", written(tmp_path, "a.dump", dump(steps)))
    assert [links(frame) for frame in frames] == [1, 1]
    run_ = save(made, tmp_path / "a.dcd")
    assert [links(frame) for frame in linkwatch.read(tmp_path / "a.data", run_)] == [1, 1]
    # Regression test: the command passed only the trajectory to the reader.
    code, out, err = run("check", tmp_path / "a.data", run_)
    assert code == 0 and "2 frames verified" in out, (out, err)
    topology = save(made, tmp_path / "b.pdb", bonds="all")
    code, out, err = run("check", topology, tmp_path / "a.dump", "--events=off")
    assert code == 0 and "2 frames verified" in out, (out, err)
    # Regression test: the files before it were frames without bonds.
    other = written(tmp_path, "b.data", text)
    assert io.groups([tmp_path / "a.data", other, topology], None) == [1, 1, 1]
    # Regression test: the trajectory came before its topology.
    (tmp_path / "a.dcd.gz").write_bytes(gzip.compress(run_.read_bytes()))
    code, out, err = run("check", topology, tmp_path / "a.dcd.gz", "--events=off")
    assert code == 0 and "2 frames verified" in out, (out, err)


def test_options_of_the_cell_reach_the_readers(tmp_path):
    # Regression test: `--cell none` was lost, so the cell of the file refused its bonds.
    small = save(universe(cell=[1, 1, 1.2, 90, 90, 90]), tmp_path / "a.pdb", bonds="all")
    code, out, err = run("certify", small, "--cell", "none")
    assert (code, out) == (0, "2 # lines: 1\n0,1,-1\n"), err
    # Regression test: coordinates were unwrapped twice.
    wrapped = (POINTS + [9.3, 0, 0]) % CELL[:3]
    path = save(universe(wrapped), tmp_path / "b.pdb", bonds="all")
    for option in ([], ["--wrapped"]):
        assert run("certify", path, *option)[:2] == (0, "periodic 2 # lines: 1\n0,1,0,0,0,-1\n")
    code, out, err = run("certify", small)
    assert code == 2 and "would be a guess (--wrapped=false takes coordinates" in err, err
    # Regression test: the reader unwrapped them in spite of the option.
    (frame,) = frames_of([path], wrapped=False)
    np.testing.assert_allclose(frame.positions, wrapped, atol=1e-3)


def test_gsd_files_have_all(tmp_path):
    needs("MDAnalysis", "gsd")
    hoomd = pytest.importorskip("gsd.hoomd", reason="gsd is not installed")
    with hoomd.open(tmp_path / "a.gsd", "w") as file:
        for k in range(2):
            frame = hoomd.Frame()
            frame.configuration.step = 100 * k
            frame.configuration.box = [*CELL[:3], 0, 0, 0]
            frame.particles.N = 24
            frame.particles.position = POINTS
            frame.particles.diameter = [0.2] * 12 + [0.3] * 12
            frame.bonds.N = 24
            frame.bonds.group = EDGES
            file.append(frame)
    frames = linkwatch.read(tmp_path / "a.gsd")
    found = list(frames)
    assert [links(frame) for frame in found] == [1, 1]
    assert found[0].radii == pytest.approx([0.1, 0.15])


def test_frames_of_gsd_files_with_other_bonds_are_rejected(tmp_path):
    """Regression test: the bonds of the first frame were used for all, and the run was intact."""
    needs("MDAnalysis", "gsd")
    hoomd = pytest.importorskip("gsd.hoomd", reason="gsd is not installed")
    with hoomd.open(tmp_path / "a.gsd", "w") as file:
        for bonds in (EDGES, [edge[::-1] for edge in EDGES[::-1]], EDGES[1:], EDGES):
            frame = hoomd.Frame()
            frame.configuration.box = [*CELL[:3], 0, 0, 0]
            frame.particles.N = 24
            frame.particles.position = POINTS
            frame.bonds.N = len(bonds)
            frame.bonds.group = bonds
            file.append(frame)
    why = [frame.rejected for frame in linkwatch.read(tmp_path / "a.gsd")]
    other = "it has other bonds than the first frame, whose bonds define the curves"
    assert why == [None, None, other, None]
    with hoomd.open(tmp_path / "b.gsd", "w") as file, hoomd.open(tmp_path / "a.gsd") as a:
        file.append(a[2])
    frames = linkwatch.read(tmp_path / "a.gsd", tmp_path / "a.gsd", tmp_path / "b.gsd")
    assert [frame.rejected for frame in frames] == [None, None, other, None, other]
    code, out, err = run("check", tmp_path / "a.gsd")
    assert code == 3 and "3 frames verified, 1 rejected" in out and other in out, (out, err)


def test_all_models_of_a_pdb_file_have_the_cell_before_them(tmp_path):
    """Regression test: MDAnalysis assigned the cell to no model, and the run was intact."""
    points = np.vstack([POINTS[:12], POINTS[12:] + [10, 0, 0]])
    path = save(universe(points, frames=3), tmp_path / "a.pdb", bonds="all")
    assert path.read_text().count("CRYST1") == 1
    assert [links(frame) for frame in linkwatch.read(path)] == [1, 1, 1]
    alone = io.from_mdanalysis(pytest.importorskip("MDAnalysis").Universe(str(path)))
    assert [links(frame) for frame in alone] == [1, 1, 1]
    # A cell that is not needed is not read.
    text = path.read_text()
    bad = text.replace(text[text.index("CRYST1") :].partition("\n")[0], "CRYST1 10 10 10")
    path = written(tmp_path, "b.pdb", bad)
    with pytest.raises(ValueError, match="it has no valid cell: CRYST1 10 10 10"):
        linkwatch.read(path)
    assert [frame.cell for frame in linkwatch.read(path, cell="none")] == [None] * 3


def test_serial_numbers_of_pdb_that_bonds_need_are_unique(tmp_path):
    """Regression test: bonds connected other atoms with equal serial numbers."""
    text = save(universe(frames=2), tmp_path / "a.pdb", bonds="all").read_text()
    ids = [line[6:11] for line in text.splitlines() if line.startswith("ATOM")][:24]
    assert len(set(ids)) == 24 and text.count("CONECT") >= 24
    assert [frame.counts for frame in linkwatch.read(tmp_path / "a.pdb")] == [[-12, -12]] * 2
    # The serial numbers of the second ring repeat those of the first one, or are stars.
    for shown, start in (("1", 0), (r"\*\*\*\*\*", None)):
        found = "".join(
            line[:6] + (ids[ids.index(line[6:11]) - 12] if start == 0 else "*****") + line[11:]
            if line.startswith("ATOM") and line[6:11] in ids[12:]
            else line
            for line in text.splitlines(keepends=True)
        )
        path = written(tmp_path, "b.pdb", found)
        with pytest.raises(ValueError, match=f"atoms have the serial number {shown}, so CONECT"):
            linkwatch.read(path)
        # Without CONECT, or with another topology, serial numbers are not used.
        alone = "".join(x for x in found.splitlines(keepends=True) if not x.startswith("CONECT"))
        assert len(list(linkwatch.read(written(tmp_path, "c.pdb", alone), closed=True))) == 2
        assert len(list(linkwatch.read(tmp_path / "a.pdb", path))) == 4


def test_a_direction_of_a_cell_that_does_not_repeat_has_an_edge_of_0(tmp_path):
    """Regression test: with an edge of 0, the frame had no cell at all."""
    points = np.vstack([POINTS[:12], POINTS[12:] + [10, 0, 0]])
    (frame,) = io.from_mdanalysis(universe(points, cell=[10, 11, 0, 90, 90, 90]))
    np.testing.assert_array_equal(frame.cell, [[10, 0, 0], [0, 11, 0], [0, 0, 0], [0, 0, 0]])
    assert links(frame) == 1
    frames = universe(frames=2)
    frames.trajectory.dimensions_array[1] = [10, 11, 12, 0, 0, 0]
    why = [frame.rejected for frame in io.from_mdanalysis(frames)]
    assert why[0] is None and "no periodic cell has the edges" in why[1]
    assert [frame.rejected for frame in io.from_mdanalysis(frames, cell="none")] == [None, None]


@pytest.mark.parametrize("suffix", ["gro", "pqr"])
def test_files_of_which_mdanalysis_reads_only_the_first_frame_are_errors(tmp_path, suffix):
    """Regression test: the other frames were skipped without a message."""
    made = universe()
    made.add_TopologyAttr("charges", [0.0] * 24)
    made.add_TopologyAttr("radii", [1.0] * 24)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        made.atoms.write(str(tmp_path / f"a.{suffix}"))
    text = (tmp_path / f"a.{suffix}").read_text()
    if suffix == "gro":
        # Bytes of this letter are a line break in another encoding.
        text = text.replace("\n", " in Å\n", 1)
    (frame,) = linkwatch.read(written(tmp_path, f"a.{suffix}", text))
    assert len(frame.positions) == 24
    two = text + text if suffix == "gro" else f"MODEL 1\n{text}MODEL 2\n{text}"
    with pytest.raises(ValueError, match="of which MDAnalysis reads only the first one"):
        linkwatch.read(written(tmp_path, f"b.{suffix}", two))


def test_atoms_of_h5md_files_have_the_order_of_their_ids(tmp_path):
    """Regression test: a change of the order of the atoms was reported as a pull-through."""
    needs("MDAnalysis")
    h5py = pytest.importorskip("h5py", reason="h5py is not installed")
    made = universe(frames=3)
    top = save(made, tmp_path / "a.pdb", bonds="all")
    made.load_new(str(save(made, tmp_path / "a.xtc")))
    path = save(made, tmp_path / "a.h5md")
    ids = np.array([range(24), [*range(12), *range(23, 11, -1)], range(24)])
    with h5py.File(path, "r+") as file:
        (group,) = file["particles"].values()
        group["id/value"] = ids
        group["position/value"][1] = group["position/value"][1][ids[1]]
    # Ids that are the same in all frames, or that hold for several frames.
    for ids_, steps in ((ids[0], None), (ids[:1], [0]), (ids[[0, 2]], [0, 2]), (0 * ids[0], None)):
        constant = tmp_path / f"{np.shape(ids_)}{steps}{np.max(ids_)}.h5md"
        constant.write_bytes(path.read_bytes())
        with h5py.File(constant, "r+") as file:
            (group,) = file["particles"].values()
            group["position/value"][1] = group["position/value"][0]
            del group["id"]
            group["id/value"] = ids_
            if steps:
                group["id/step"] = steps
        assert [links(frame) for frame in linkwatch.read(top, constant)] == [1, 1, 1]
    others = tmp_path / "b.h5md"
    others.write_bytes(path.read_bytes())
    with h5py.File(others, "r+") as file:
        (group,) = file["particles"].values()
        group["id/value"][2, 0] = 99
    run_ = linkwatch.check(linkwatch.read(top, path))
    assert [row["verdict"] for row in run_.frames] == ["intact"] * 3
    why = [frame.rejected for frame in linkwatch.read(top, others)]
    assert why == [None, None, "the ids of its atoms are not those of the first frame, each once"]


def test_trajectories_that_are_numbered_have_the_order_of_their_numbers(tmp_path):
    made = universe(frames=3)
    top = save(universe(), tmp_path / "a.pdb", bonds="all")
    paths = [tmp_path / f"md_{k}.dcd" for k in (1, 2, 10)]
    for k, path in enumerate(paths):
        made.atoms.write(str(path), frames=made.trajectory[[k]])
    frames = linkwatch.read(top, paths[0], paths[2], paths[1])
    assert "by the numbers in their names" in str(frames.summary)
    x = [frame.positions[0, 0] for frame in frames]
    np.testing.assert_allclose(np.diff(x), 0.1, atol=1e-5)
    # Files of equal names in several folders have the order that is given.
    runs = [tmp_path / name / "run1.dcd" for name in ("b", "a")]
    for path, run_ in zip(paths, runs):
        run_.parent.mkdir()
        path.rename(run_)
    x = [frame.positions[0, 0] for frame in linkwatch.read(top, *runs)]
    np.testing.assert_allclose(np.diff(x), 0.1, atol=1e-5)


def test_frames_of_the_first_file_are_frames_if_later_files_have_its_kind(tmp_path):
    """Regression test: only the topology of the first file was read, not its frame."""
    apart = POINTS + np.repeat([[0, 0, 0], [5, 0, 0]], 12, axis=0)
    paths = [
        save(universe(points, cell=None), tmp_path / f"F{k}.pdb", bonds="all")
        for k, points in enumerate((POINTS, apart, apart))
    ]
    assert len(linkwatch.read(*paths)) == 3
    assert linkwatch.check(paths).changes[0]["frame"] == 1
    # The files are sorted by their numbers, the first one as well.
    assert run("check", *paths[::-1], "--events=off")[0] == 1
    other = save(universe(bonds=EDGES[1:], cell=None), tmp_path / "F4.pdb", bonds="all")
    # Regression test: the first argument was used as the topology, whatever its kind.
    for given in ([*paths, other], [other, *paths]):
        rejected = [frame.rejected for frame in linkwatch.read(*given)]
        assert rejected[:3] == [None] * 3 and "other bonds than the first frame" in rejected[3]
        assert linkwatch.check(given).changes[0]["frame"] == 1
    # Regression test: frames of the first file were reported as missing.
    frames = linkwatch.read(paths[0], *paths[:2])
    assert len(frames) == 2 and "is the topology" not in str(frames.summary)
    frames = linkwatch.read(paths[0], save(universe(frames=2), tmp_path / "a.dcd"))
    assert len(frames) == 2 and "F0.pdb is the topology" in str(frames.summary)
    # Files with several frames each may be separate runs.
    paths = [save(universe(frames=2), tmp_path / f"{name}.pdb", bonds="all") for name in "ab"]
    code, out, err = run("check", *paths)
    assert (code, out) == (2, "") and "2 files have several frames each: check each" in err
    code, out, err = run("check", *paths, "--one-motion")
    assert code == 0 and "4 frames verified" in out, (out, err)
    path = written(tmp_path, "a.xyz", extended_xyz([POINTS], "frame"))
    for given in ([path, paths[0]], [path, paths[0], path]):
        with pytest.raises(ValueError, match="a trajectory has no bonds: give its topology before"):
            linkwatch.read(*given)


@pytest.mark.parametrize("name", ["a.xyz", "a.dump"])
def test_the_topology_of_a_trajectory_may_have_no_bonds(tmp_path, name):
    """Regression test: a topology without bonds was refused."""
    text = dump([POINTS]) if name == "a.dump" else extended_xyz([POINTS], "frame")
    path = written(tmp_path, name, text)
    frames = linkwatch.read(path, save(universe(frames=2), tmp_path / "a.dcd"), closed=True)
    assert [frame.counts for frame in frames] == [[-24]] * 2
    assert "the atoms of each residue are a chain" in str(frames.summary)


def psf(bonds):
    """Returns a topology of CHARMM with 24 atoms."""
    atoms = "".join(
        f"{k + 1:8d} A    1    RNG  C    C    {0:10.6f}{12:14.4f}{0:12d}\n" for k in range(24)
    )
    pairs = "".join(
        f"{a + 1:8d}{b + 1:8d}" + "\n" * (k % 4 == 3) for k, (a, b) in enumerate(bonds)
    )
    head = f"PSF\n\n{1:8d} !NTITLE\n REMARKS\n\n{24:8d} !NATOM\n"
    return f"{head}{atoms}\n{len(bonds):8d} !NBOND: bonds\n{pairs}\n"


def test_the_bonds_of_pdb_files_beside_another_topology_do_not_count(tmp_path):
    """Regression test: frames with other CONECT records than the first one were rejected."""
    top = written(tmp_path, "top.psf", psf(EDGES))
    paths = [
        save(universe(bonds=bonds, cell=None), tmp_path / f"G{k}.pdb", bonds="all")
        for k, bonds in enumerate((EDGES[1:], EDGES, EDGES[2:]))
    ]
    frames = [(frame.counts, frame.rejected) for frame in linkwatch.read(top, *paths)]
    assert frames == [([-12, -12], None)] * 3


@pytest.mark.parametrize("cells", [0, 1, 3])
def test_models_that_only_end_separates_are_frames(tmp_path, cells):
    """Regression test: files written by VMD were refused."""
    made = save(universe(frames=3), tmp_path / "a.pdb", bonds=None)
    lines = made.read_text().splitlines()
    lines = ["END" if line == "ENDMDL" else line for line in lines if not line.startswith("MODEL")]
    lines = [line for line in lines if line.startswith(("ATOM", "END"))]
    cell = "CRYST1   40.000   50.000   60.000  90.00  90.00  90.00 P 1           1\n"
    rows = "\n".join([*lines, ""]).replace("END\nEND\n", "END\n").split("END\n")[:3]
    text = "".join(cell * (k < cells) + one + "END\n" for k, one in enumerate(rows))
    frames = [*linkwatch.read(written(tmp_path, "b.pdb", text), closed=False)]
    expected = [*linkwatch.read(made, closed=False)]
    assert len(frames) == 3
    for frame, of_models in zip(frames, expected):
        np.testing.assert_array_equal(frame.positions, of_models.positions)
        assert frame.counts == of_models.counts
        assert (frame.cell is not None) == (cells > 0)


def test_copies_of_files_with_equal_names_are_apart(tmp_path):
    """Regression test: the last file was read in place of all."""
    made = universe(frames=3)
    top = save(made, tmp_path / "top.pdb", bonds="all")
    paths = [tmp_path / name / "run.pdb" for name in "ab"]
    for k, path in enumerate(paths):
        path.parent.mkdir()
        lines = save(made, tmp_path / "a.pdb", bonds=None).read_text().splitlines(keepends=True)
        atoms = [line for line in lines if line.startswith("ATOM")]
        frames = [atoms[:24], atoms[24:48]] if k == 0 else [atoms[24:48], atoms[48:]]
        path.write_text("".join("".join([*frame, "END\n"]) for frame in frames))
    x = [frame.positions[0, 0] for frame in linkwatch.read(top, *paths)]
    np.testing.assert_allclose(np.diff(x), [0.1, 0.1, -0.2, 0.1, 0, 0.1], atol=1e-2)


@pytest.mark.parametrize("edges", [[40.0, 50, 60], np.diag([40.0, 50, 60])])
def test_h5md_files_may_have_one_cell_for_all_frames(tmp_path, edges):
    """Regression test: files with one cell for all frames were refused."""
    needs("MDAnalysis")
    h5py = pytest.importorskip("h5py", reason="h5py is not installed")
    made = universe(frames=3)
    top = save(made, tmp_path / "a.pdb", bonds="all")
    path = save(made, tmp_path / "a.h5md", convert_units=False)
    expected = [frame.positions for frame in linkwatch.read(top, path)]
    fixed = tmp_path / "b.h5md"
    fixed.write_bytes(path.read_bytes())
    with h5py.File(fixed, "r+") as file:
        (group,) = file["particles"].values()
        box = group["box"]
        box.attrs["boundary"] = ["periodic"] * 3
        box.pop("edges", None)
        box["edges"] = edges
    frames = [*linkwatch.read(top, fixed)]
    np.testing.assert_array_equal([frame.positions for frame in frames], expected)
    for frame in frames:
        np.testing.assert_allclose(np.asarray(frame.cell)[:3], np.diag([40.0, 50, 60]))


@pytest.mark.parametrize("cut", [20, 1000])
def test_pdb_and_tinker_files_that_are_cut_off_are_errors(tmp_path, cut):
    """Regression test: without an error, a ring became a chain, or the last frame was missing."""
    text = save(universe(frames=3), tmp_path / "a.pdb", bonds="all").read_text()
    assert len(linkwatch.read(written(tmp_path, "b.pdb", text.rpartition("END")[0]))) == 3
    rows = [f"{i + 1} C {x:.4f} {y:.4f} {z:.4f} 1 {i or 12}" for i, (x, y, z) in enumerate(POINTS)]
    arc = "".join("\n".join(["24 rings", *rows, ""]) for _ in range(3))
    assert len(linkwatch.read(written(tmp_path, "b.arc", arc), closed=False)) == 3
    for name, whole in (("c.pdb", text), ("c.arc", arc)):
        with pytest.raises(ValueError, match=f"{name}: (the last frame is cut off|MDAnalysis)"):
            linkwatch.read(written(tmp_path, name, whole[:-cut]), closed=False)


def test_wrapped_rings_are_unwrapped_along_their_bonds():
    cell = np.array([2.4, 11, 12])
    wrapped = universe(POINTS - cell * np.floor(POINTS / cell), cell=[*cell, 90, 90, 90])
    frames = io.from_mdanalysis(wrapped)
    (frame,) = frames
    assert "unwrapped: every vertex is moved to the image nearest" in str(frames.summary)
    for k in range(2):
        part = slice(12 * k, 12 * k + 12)
        shift = frame.positions[part] - POINTS[part]
        np.testing.assert_allclose(shift, np.broadcast_to(shift[0], shift.shape), atol=1e-6)
    torn = next(iter(io.from_mdanalysis(wrapped, unwrap=False)))
    assert np.abs(np.diff(torn.positions[:12, 0])).max() > 1
    # A ring that leaves the cell later.
    later = universe(POINTS + [5, 5, 5], frames=1)
    outside = POINTS + [9.5, 5, 5]
    outside -= CELL[:3] * np.floor(outside / CELL[:3])
    later.load_new(np.float32([POINTS + [5, 5, 5], outside]), dimensions=np.array(CELL))
    frames = io.from_mdanalysis(later)
    assert "unwrapped" not in str(frames.summary)
    assert [links(frame) for frame in frames] == [1, 1]
    assert "segments of frame 1 crossed" in str(frames.summary)
    # A triclinic cell.
    tilted = universe(POINTS, cell=[9, 9, 9, 70, 80, 60])
    vectors = next(iter(io.from_mdanalysis(tilted))).cell[:3]
    inside = POINTS @ np.linalg.inv(vectors)
    inside = (inside - np.floor(inside)) @ vectors
    (frame,) = io.from_mdanalysis(universe(inside, cell=[9, 9, 9, 70, 80, 60]))
    assert links(frame) == 1


TILTED = np.array([[6, 0, 0], [2.1, 6, 0], [2.1, 1.8, 6]])


def test_the_cell_of_gsd_has_its_tilt_factors(tmp_path):
    """Regression test: tilt factors were read as cosines, and a wrong cell was intact."""
    needs("MDAnalysis", "gsd")
    hoomd = pytest.importorskip("gsd.hoomd", reason="gsd is not installed")
    with hoomd.open(tmp_path / "a.gsd", "w") as file:
        for xy in (0.35, 1.2):
            frame = hoomd.Frame()
            frame.configuration.box = [6, 6, 6, xy, 0.35, 0.3]
            frame.particles.N = 24
            frame.particles.position = POINTS
            frame.bonds.N = 24
            frame.bonds.group = EDGES
            file.append(frame)
    for of_file in (linkwatch.read(tmp_path / "a.gsd"), linkwatch.read(*[tmp_path / "a.gsd"] * 2)):
        cells = [frame.cell[:3] for frame in of_file]
        np.testing.assert_allclose(cells[0], TILTED, atol=1e-6)
        np.testing.assert_allclose(cells[1], TILTED + [[0] * 3, [5.1, 0, 0], [0] * 3], atol=1e-6)
    made = pytest.importorskip("MDAnalysis").Universe(str(tmp_path / "a.gsd"))
    np.testing.assert_allclose(next(iter(io.from_mdanalysis(made))).cell[:3], TILTED, atol=1e-6)
    made.transfer_to_memory()
    with pytest.raises(ValueError, match="other angles than the GSD file: give `cell`"):
        io.from_mdanalysis(made)


def extended_xyz(frames, comment):
    """Returns extended XYZ."""
    rows = ("".join(f"C {x} {y} {z}\n" for x, y, z in points) for points in frames)
    return "".join(f"24\n{comment}\n{one}" for one in rows)


def test_a_trajectory_of_extended_xyz_has_its_lattice(tmp_path):
    """Regression test: the lattice was ignored, and torn rings were intact."""
    top = save(universe(cell=None), tmp_path / "a.pdb", bonds="all")
    lattice = " ".join(map(str, TILTED.ravel()))
    inside = POINTS @ np.linalg.inv(TILTED)
    wrapped = (inside - np.floor(inside)) @ TILTED
    for pbc, cell in (
        ("", TILTED),
        (' pbc="T T T"', TILTED),
        (" pbc=[T, T, F]", TILTED * [[1], [1], [0]]),
    ):
        comment = f'Lattice="{lattice}" Properties=species:S:1:pos:R:3{pbc}'
        points = POINTS if "F" in pbc else wrapped
        path = written(tmp_path, "a.xyz", extended_xyz([points] * 2, comment))
        for frame in linkwatch.read(top, path):
            np.testing.assert_allclose(frame.cell[:3], cell)
            assert links(frame) == 1
    for comment, words in (
        ('Lattice="9 9 9"', "no valid Lattice and pbc: .*: give `cell`"),
        (f'Lattice="{lattice}" pbc="T T"', "no valid Lattice and pbc"),
        ("Properties=id:I:1:species:S:1:pos:R:3", "MDAnalysis reads other columns"),
        ("Properties=species:S:1:pos:R:3:id:I:1", "does not sort by id"),
    ):
        path = written(tmp_path, "b.xyz", extended_xyz([POINTS], comment))
        with pytest.raises(ValueError, match=words):
            linkwatch.read(top, path)
    path = written(tmp_path, "b.xyz", extended_xyz([POINTS], 'Lattice="9 9 9"'))
    assert next(iter(linkwatch.read(top, path, cell="none"))).cell is None


def test_the_boundary_of_h5md_says_which_directions_repeat(tmp_path):
    """Regression test: all directions were periodic, which linked images that do not exist."""
    needs("MDAnalysis")
    h5py = pytest.importorskip("h5py", reason="h5py is not installed")
    made = universe(frames=2)
    top = save(made, tmp_path / "a.pdb", bonds="all")
    path = save(made, tmp_path / "a.h5md", convert_units=False)
    for boundary, repeats in (
        (["periodic", "periodic", "none"], [1, 1, 0]),
        (["none"] * 3, [0, 0, 0]),
        ("none", [0, 0, 0]),
        (["periodic"] * 3, [1, 1, 1]),
    ):
        # Vectors that are not lower triangular, which MDAnalysis turns.
        for edges in (np.diag([40.0, 50, 60]), np.array([[40.0, 5, 0], [0, 50, 7], [0, 0, 60]])):
            with h5py.File(path, "r+") as file:
                (group,) = file["particles"].values()
                group["box"].attrs["boundary"] = boundary
                group["box"].pop("edges")
                group["box"]["edges"] = edges
            for frame in linkwatch.read(top, path):
                if any(repeats):
                    expected = edges * np.reshape(repeats, (3, 1))
                    np.testing.assert_allclose(frame.cell[:3], expected, rtol=1e-6)
                else:
                    assert frame.cell is None


def test_dumps_beside_other_topologies_have_their_boundaries_and_ids(tmp_path):
    """Regression test: all directions were periodic, and atoms were in the order of the lines."""
    top = save(universe(), tmp_path / "a.pdb", bonds="all")
    text = dump([POINTS, POINTS])

    def read(*changes):
        found = text
        for old, new in changes:
            assert old in found
            found = found.replace(old, new)
        return list(linkwatch.read(top, written(tmp_path, "a.lammpstrj", found)))

    assert [links(frame) for frame in read()] == [1, 1]
    for kinds, repeats in (
        ("pp pp ff", [1, 1, 0]), ("pp fs mm", [1, 0, 0]), ("ff ff ff", 0), ("", [1, 1, 1])
    ):  # fmt: skip
        for frame in read(("pp pp pp", kinds)):
            if not any(np.ravel(repeats)):
                assert frame.cell is None
            else:
                np.testing.assert_allclose(frame.cell[:3], np.diag(CELL[:3]) * repeats)
    bounds = ("0 10\n0 11\n0 12\n", "0 12 2\n0 11 0\n0 12 0\n")
    for frame in read(("pp pp pp", "xy xz yz pp pp ff"), bounds):
        np.testing.assert_allclose(frame.cell[:3], [[10, 0, 0], [2, 11, 0], [0, 0, 0]], atol=1e-5)
    with pytest.raises(ValueError, match="without the column id .* write it"):
        read(("ATOMS id", "ATOMS type"))
    with pytest.raises(ValueError, match=r"no general triclinic box \(abc origin\): give a data"):
        read(("pp pp pp", "abc origin pp pp pp"))
    before, line, after = text.rpartition("\n24 ")
    found = before + "\n25 " + after
    frames = linkwatch.read(top, written(tmp_path, "b.lammpstrj", found))
    assert [frame.rejected for frame in frames] == [
        None,
        "the ids of its atoms are not those of the first frame, each once",
    ]


def test_a_ring_around_the_cell_is_a_yarn():
    line = np.stack([np.arange(10.0), np.zeros(10), np.zeros(10)], axis=1)
    bonds = [(i, (i + 1) % 10) for i in range(10)]
    made = universe(line, bonds, cell=[10, 9, 8, 90, 90, 90])
    frames = io.from_mdanalysis(made)
    (frame,) = frames
    assert frame.counts == [11]
    np.testing.assert_array_equal(frame.positions[-1] - frame.positions[0], [10, 0, 0])
    # The nearest image of a bond that is longer than a third of the cell is a guess.
    with pytest.raises(ValueError, match="longer than a third of the cell"):
        io.from_mdanalysis(universe(2 * line, bonds, cell=[5.5, 9, 8, 90, 90, 90]))


def star(arms, length):
    """Returns the bonds of chains that begin at the atom 0."""
    chains = [[0, *range(1 + k * length, 1 + (k + 1) * length)] for k in range(arms)]
    return [bond for chain in chains for bond in zip(chain, chain[1:])]


@pytest.mark.parametrize(
    "bonds, counts, words",
    [
        # A chain of 13 with an arm of 6; a ring of 20 with side groups of one atom.
        (star(3, 6), [13], "1 molecule has branches: the curve is the longest chain of 1; 6 atoms"),
        (
            [(i, (i + 1) % 20) for i in range(20)] + [(i, 20 + i) for i in range(20)],
            [-20],
            "the curve is the ring of 1; 20 atoms beside it are ignored",
        ),
        # A chain through the shorter side of a small ring.
        (
            [(i, i + 1) for i in range(20)] + [(5, 21), (21, 22), (22, 23), (23, 8)],
            [21],
            "3 atoms beside it are ignored",
        ),
        # A ring of 30 with a small ring in it, which is followed along its shorter side.
        (
            [(i, (i + 1) % 30) for i in range(30)] + [(3, 30), (30, 31), (31, 32), (32, 5)],
            [-30],
            "3 atoms beside it are ignored",
        ),
    ],
)
def test_molecules_with_branches_have_a_backbone(bonds, counts, words):
    n = np.max(bonds) + 1
    points = np.random.default_rng(2).normal(size=(n, 3))
    frames = io.from_mdanalysis(universe(points, bonds, cell=None))
    assert next(iter(frames)).counts == counts
    assert words in str(frames.summary)


def test_networks_are_left_out():
    theta = [(i, (i + 1) % 40) for i in range(40)] + [(0, 40), (40, 41), (41, 20)]
    lasso = [(i + 50, (i + 1) % 20 + 50) for i in range(20)] + [
        (50 + 19 + i, 70 + i) for i in range(20)
    ]
    bonds = [*theta, *lasso, (95, 96), (96, 97)]
    points = np.random.default_rng(2).normal(size=(98, 3))
    frames = io.from_mdanalysis(universe(points, bonds, cell=None))
    assert next(iter(frames)).counts == [3]
    (said,) = frames.summary.left_out
    assert said.startswith(
        "2 molecules with several loops, or a loop and a longer chain (the first"
    )
    assert "42 atoms from the index 0 on" in said
    # A file with the bonds of a ligand only.
    made = universe(bonds=EDGES[12:], residues=[0] * 12 + [1] * 12, segments=[0, 0])
    made.residues.resnames = ["ALA", "LIG"]
    (said,) = io.from_mdanalysis(made).summary.left_out
    assert (
        said == "12 atoms of proteins or nucleic acids without bonds (the first one: the index 0)"
    )


def test_a_trajectory_without_its_topology_is_refused(tmp_path):
    universe(bonds=EDGES).atoms.write(tmp_path / "a.xtc")
    with pytest.raises(ValueError, match="a trajectory alone does not say"):
        linkwatch.read(tmp_path / "a.xtc")


def test_without_bonds_segments_or_residues_are_chains(tmp_path):
    chains = universe(bonds=None, residues=range(24), segments=[0] * 12 + [1] * 12)
    frames = io.from_mdanalysis(chains)
    (frame,) = frames
    assert (frame.counts, frame.names) == ([12, 12], ["A", "B"])
    assert "there are no bonds: the atoms of each segment are a chain" in str(frames.summary)
    # Rings would be verified without the bonds that close them.
    (said,) = frames.summary.left_out
    assert said.startswith("2 possible closing bonds (the first one: `closed=True` or ")
    for closed in (True, False):
        assert io.from_mdanalysis(chains, closed=closed).summary.left_out == []
    (frame,) = io.from_mdanalysis(chains, closed=True)
    assert links(frame) == 1
    molecules = universe(bonds=None, residues=[0] * 12 + [1] * 12, segments=[0, 0])
    frames = io.from_mdanalysis(molecules)
    assert next(iter(frames)).counts == [12, 12]
    assert "the atoms of each residue are a chain" in str(frames.summary)
    molecules.residues.resnames = ["ALA", "DA"]
    with pytest.raises(ValueError, match="select one atom of each residue"):
        io.from_mdanalysis(molecules)
    unclear = universe(bonds=None, residues=np.arange(24) // 3, segments=[0] * 4 + [1] * 4)
    with pytest.raises(ValueError, match="select one atom of each residue"):
        io.from_mdanalysis(unclear)
    # From a file, with a selection.
    path = save(
        universe(bonds=None, residues=range(24), segments=[0] * 12 + [1] * 12),
        tmp_path / "a.pdb",
        bonds=None,
    )
    (frame,) = linkwatch.read(path, select="segid B")
    assert frame.counts == [12]
    out = tmp_path / "out.npz"
    code, _, err = run("convert", path, out, "--select", "name C", "--closed")
    assert code == 0, err
    assert run("certify", out, "--cell", "none")[1] == "2 # lines: 1\n0,1,-1\n"


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_files_that_mdanalysis_cannot_read_are_errors(tmp_path):
    needs("MDAnalysis")
    path = written(tmp_path, "a.psf", "not a psf")
    with pytest.raises(ValueError, match="a.psf: MDAnalysis cannot read this: "):
        linkwatch.read(path)
    top = save(universe(), tmp_path / "a.pdb", bonds="all")
    with pytest.raises(ValueError, match="MDAnalysis cannot read this"):
        linkwatch.read(top, written(tmp_path, "a.xtc", "x" * 100))
    with pytest.raises(ValueError, match="MDAnalysis cannot read this"):
        linkwatch.read(top, select="nam C")
    with pytest.raises(ValueError, match="no atoms are selected"):
        linkwatch.read(top, select="name X")


@pytest.mark.parametrize("suffix", ["xtc", "trr", "dcd", "nc", "lammpstrj", "xyz"])
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_trajectories_that_are_cut_off_are_errors(tmp_path, suffix):
    made = universe(frames=3)
    top = save(universe(), tmp_path / "a.pdb", bonds="all")
    whole = tmp_path / f"a.{suffix}"
    if suffix == "lammpstrj":
        whole.write_text(dump(ts.positions for ts in made.trajectory))
    else:
        save(made, whole)
    data = whole.read_bytes()
    for share in (0.5, 0.75, 0.9, 0.99):
        cut = tmp_path / f"{share}.{suffix}"
        cut.write_bytes(data[: int(share * len(data))])
        with pytest.raises(ValueError, match="cut off|can be read|cannot read"):
            list(linkwatch.read(top, cut))
        # Regression test: the end was checked only for the first file, or for all files together.
        with pytest.raises(ValueError, match="cut off|can be read|cannot read"):
            list(linkwatch.read(top, whole, cut))
    more = tmp_path / f"more.{suffix}"
    if suffix in ("lammpstrj", "xyz"):
        more.write_bytes((data.strip() + b"\n") * 5 + b"\n" * (suffix == "xyz"))
        assert len(list(linkwatch.read(top, whole, more))) == 18


def test_a_part_of_a_trajectory_is_read():
    made = universe(frames=10)
    frames = io.from_mdanalysis(made, trajectory=made.trajectory[2::4])
    assert len(frames) == 2
    assert [frame.seq for frame in frames] == [2, 6]


OLD = "24 2\n" + "".join(
    f"{k // 12 + 1} A {12 * (k // 12) + (k - 1) % 12} {12 * (k // 12) + (k + 1) % 12}\n"
    for k in range(24)
)
NEW = "24 2 5->3\nACGT(-10)CGTACGT type=DNA circular=true\nACGTACGTACGT circular=true\n"


def oxdna(frames=1, points=POINTS, box=20):
    rest = " 1 0 0 0 0 1 0 0 0 0 0 0\n"
    text = ""
    for k in range(frames):
        text += f"t = {100 * k}\nb = {box} {box} {box}\nE = -1.4 -1.5 0.1\n"
        text += "".join(f"{x:.8g} {y:.8g} {z:.8g}{rest}" for x, y, z in points)
    return text


@pytest.mark.parametrize("top", [OLD, NEW])
def test_ring_strands_of_oxdna_are_linked(tmp_path, top):
    path = written(tmp_path, "a.top", top)
    data = written(tmp_path, "trajectory.dat", oxdna(3))
    frames = linkwatch.read(data, path)
    found = list(frames)
    assert [frame.counts for frame in found] == [[-12, -12]] * 3
    assert [frame.time for frame in found] == [0, 100, 200]
    assert (found[0].names, frames.summary.time_unit) == (
        ["strand 1", "strand 2"],
        "steps of the simulation",
    )
    assert linkwatch.certify(found[0].positions, found[0].counts).links == [(0, 1, -1)]
    assert [links(frame) for frame in found] == [1, 1, 1]
    code, _, err = run("convert", path, data, tmp_path / "out.npz")
    assert code == 0, err
    # Regression test: empty lines after a configuration were an error.
    blank = written(tmp_path, "b.dat", oxdna(2) + "\n" + oxdna() + "\n\n")
    assert len(list(linkwatch.read(path, blank))) == 3
    # The topology of the same name is taken.
    alone = written(tmp_path, "a.conf", oxdna())
    assert len(list(linkwatch.read(alone))) == 1


def test_trajectories_of_oxdna_have_the_order_that_is_given(tmp_path):
    """Regression test: `md` was read before `relax`, and a pull-through was missed."""
    top = written(tmp_path, "a.top", OLD)
    paths = [written(tmp_path, f"{name}.dat", oxdna(1, POINTS + [k, 0, 0])) for k, name in
             enumerate(("relax", "md", "md2", "md10"))]  # fmt: skip
    for given, expected in ((paths, [0, 1, 2, 3]), (paths[:1:-1], [2, 3]), (paths[:2], [0, 1])):
        frames = linkwatch.read(top, *given)
        x = [frame.positions[0, 0] - RING[0, 0] for frame in frames]
        np.testing.assert_allclose(x, expected, atol=1e-6)
        assert ("by the numbers in their names" in str(frames.summary)) == (given[0] is paths[3])


def test_open_strands_of_oxdna_are_unwrapped(tmp_path):
    top = "24 2\n" + "".join(
        f"{k // 12 + 1} A {k - 1 if k % 12 else -1} {k + 1 if k % 12 < 11 else -1}\n"
        for k in range(24)
    )
    path = written(tmp_path, "a.top", top)
    wrapped = POINTS - 3 * np.floor(POINTS / 3)
    frames = linkwatch.read(path, written(tmp_path, "a.dat", oxdna(1, wrapped, 3)))
    (frame,) = frames
    assert (frame.counts, frames.summary.closed) == ([12, 12], 0)
    assert "unwrapped" in str(frames.summary)
    shift = frame.positions[:12] - POINTS[:12]
    np.testing.assert_allclose(shift, np.broadcast_to(shift[0], shift.shape), atol=1e-6)


@pytest.mark.parametrize(
    "top, data, words",
    [
        (OLD.replace("24 2", "24 3"), oxdna(), "24 nucleotides in 2 strands, but the first line"),
        (OLD.replace("1 A 11 1", "1 A 11 2"), oxdna(), "line 2: nucleotide 2 is a neighbour only"),
        (OLD.replace("1 A 11 1", "1 A 11"), oxdna(), "line 2: expected strand, base"),
        (NEW.replace("24", "25"), oxdna(), "24 nucleotides in 2 strands"),
        (OLD, oxdna(2)[:-900], "a.dat, line 33: the file ends within the 24"),
        (OLD, oxdna().replace("E =", "F ="), "line 3: expected `E = ..`, found 'F ="),
        (OLD, oxdna().replace("b = 20 20", "b = 20"), "line 2: expected 3 numbers"),
        (OLD, oxdna().replace("0.5 0.8660254 0", "0.5 zero 0"), "line 27: in the 24 lines up to"),
        (OLD, oxdna()[:-5], "line 27: the file ends within"),
        (NEW.replace("circular=true", "circular=yes"), oxdna(), "line 2: circular=yes, expected"),
        (OLD, oxdna().replace("0.5 0.8660254 0", "0.5 nan 0"), "point 2 has a coordinate that is"),
    ],
)
def test_damaged_files_of_oxdna_are_refused(tmp_path, top, data, words):
    paths = written(tmp_path, "a.top", top), written(tmp_path, "a.dat", data)
    with pytest.raises(ValueError, match=words):
        list(linkwatch.read(*paths))


def test_oxdna_needs_both_files(tmp_path):
    path = written(tmp_path, "b.top", OLD)
    with pytest.raises(ValueError, match="a topology without a configuration"):
        linkwatch.read(path)
    with pytest.raises(ValueError, match=r"give its topology \(.top\), too: 0 are given"):
        linkwatch.read(written(tmp_path, "c.dat", oxdna()))


def test_rings_and_chains_are_found_in_any_order_of_their_bonds():
    rng = np.random.default_rng(5)
    for _ in range(200):
        label, at, edges, expected = rng.permutation(200), 0, [], []
        for _ in range(rng.integers(1, 8)):
            nodes = label[at : at + rng.integers(3, 20)].tolist()
            ring = bool(rng.random() < 0.5)
            at += len(nodes)
            own = [*zip(nodes, nodes[1:]), *([(nodes[-1], nodes[0])] if ring else [])]
            edges += own
            expected.append((ring, {frozenset(bond) for bond in own}))
        edges = np.array(edges + edges[:2])  # some twice
        edges = rng.permuted(edges[rng.permutation(len(edges))], axis=1)
        found, networks = molecules(edges)
        assert networks == []
        got = []
        for one in found:
            ends = one.nodes[1:] + one.nodes[: one.closed]
            got.append((one.closed, {frozenset(bond) for bond in zip(one.nodes, ends)}))
            assert one.nodes[0] == min(one.nodes if one.closed else (one.nodes[0], one.nodes[-1]))
        assert all(one in expected for one in got)
        assert len(got) == len(expected)


def test_wrapped_curves_are_whole_again_in_any_cell():
    rng = np.random.default_rng(6)
    for _ in range(200):
        cell = np.zeros((4, 3))
        cell[:3] = np.diag(rng.uniform(8, 12, 3)) + rng.uniform(-2, 2, (3, 3))
        curves, counts = [], []
        for _ in range(rng.integers(1, 6)):
            steps = rng.uniform(-0.8, 0.8, (rng.integers(3, 40), 3))
            closed = rng.random() < 0.5
            steps -= steps.mean(axis=0) * closed
            curves.append(np.cumsum(steps, axis=0) + rng.uniform(-30, 30, 3))
            counts.append(-len(steps) if closed else len(steps))
        points = np.concatenate(curves)
        images = rng.integers(-3, 4, points.shape) @ cell[:3]
        found, same, _ = unwrapped(points + images, counts, cell)
        assert same == counts
        for one, whole in zip(np.split(found, np.cumsum(np.abs(counts))[:-1]), curves):
            shift = (one - whole) @ np.linalg.inv(cell[:3])
            np.testing.assert_allclose(
                shift, np.broadcast_to(np.rint(shift[0]), shift.shape), atol=1e-9
            )


def test_chains_with_one_id_are_refused_where_one_ends(tmp_path):
    """Regression test: two chains with one id were read as one chain."""
    atom = "ATOM  {:5d}  CA  ALA {}{:4d}    {:8.3f}{:8.3f}{:8.3f}  1.00  0.00           C\n"
    path = tmp_path / "chains.pdb"

    def written(ids, end="TER\n", first=1):
        text = ""
        for k, chain in enumerate(ids):
            text += "".join(
                atom.format(8 * k + i + 1, chain, first**k + i, i, k, i % 2) for i in range(8)
            )
            text += end
        path.write_text(text + "END\n")
        return linkwatch.read(path, closed=False)

    assert next(iter(written("ABC"))).counts == [8, 8, 8]
    for ids, end, first in (("AAB", "", 1), ("AA", "TER\n", 9)):
        with pytest.raises(ValueError, match=f"one ends with residue 8, before residue {first};"):
            written(ids, end, first)
    assert next(iter(written("AA", "", 9))).counts == [16]


@pytest.mark.parametrize("item", ["UNITS\nlj", "TIME\n0.5"])
def test_a_dump_that_mdanalysis_cannot_read_says_what_to_do(tmp_path, item):
    """Regression test: the message was that of a conversion within MDAnalysis."""
    top, path = save(universe(), tmp_path / "a.pdb", bonds="all"), tmp_path / "a.lammpstrj"
    path.write_text(f"ITEM: {item}\n" + dump([POINTS]))
    with pytest.raises(ValueError, match="MDAnalysis reads no dump with `ITEM: .*melt.data"):
        linkwatch.read(top, path)


def test_a_topology_that_is_cut_off_within_its_bonds_is_refused(tmp_path):
    """Regression test: rings after the end of the truncated file were open chains."""
    path = save(universe(), tmp_path / "a.pdb", bonds="all")
    motion = save(universe(), tmp_path / "a.dcd")
    lines = path.read_text().splitlines(keepends=True)
    last = max(k for k, line in enumerate(lines) if line.startswith("CONECT"))
    for cut in ("".join(lines[: last - 1]), "".join(lines[:last]) + lines[last][:14]):
        path.write_text(cut)
        with pytest.raises(ValueError, match="the file is cut off; if it is complete, add a line"):
            linkwatch.read(path, motion)
        path.write_text(cut.rstrip() + "\nEND\n")
        linkwatch.read(path, motion)
    # All bonds once.
    bonds = [f"CONECT{1 + k:5d}{2 + k:5d}\n" for k in range(3)]
    path.write_text("".join(line for line in lines if line[:4] == "ATOM") + "".join(bonds))
    linkwatch.read(path, motion)


@pytest.mark.parametrize(
    "comment, says",
    [
        ("# CELL(abcABC): 9.5 1e1 9 90 90 90 cell{angstrom}", "give `cell`"),
        ('box="9, 9, 9"', "give `cell`"),
        ("cell 3 of a tissue, supercell 2 2 2", None),
    ],
)
def test_a_cell_of_xyz_that_is_no_lattice_is_not_ignored(tmp_path, comment, says):
    """Regression test: the invalid cell was ignored without a message."""
    top, path = save(universe(), tmp_path / "a.pdb", bonds="all"), tmp_path / "a.xyz"
    lines = "".join(f"C {x} {y} {z}\n" for x, y, z in POINTS.tolist())
    path.write_text(f"{len(POINTS)}\n{comment}\n{lines}")
    if says is None:
        assert next(iter(linkwatch.read(top, path))).rejected is None
    else:
        with pytest.raises(ValueError, match=says):
            list(linkwatch.read(top, path))
    assert next(iter(linkwatch.read(top, path, cell=[9, 9, 9]))).rejected is None


def test_vertices_are_unwrapped_to_the_nearest_image_in_a_sheared_cell(tmp_path):
    """Regression test: fractional coordinates were rounded, which gave a farther image."""
    needs("MDAnalysis", "gsd")
    hoomd = pytest.importorskip("gsd.hoomd", reason="gsd is not installed")
    ring = np.array([[0, 0, 0], [3.2, 0, 0], [3.2, 3.3, 0], [0, 3.3, 0]])
    other = np.array([
        [0.4, 2.8, -1], [0.4, 2.8, 0], [0.4, 2.8, 1], [-1.1, 2.8, 1],
        [-2.6, 2.8, 1], [-2.6, 2.8, 0], [-2.6, 2.8, -1], [-1.1, 2.8, -1],
    ])  # fmt: skip
    bonds = [(k, (k + 1) % 4) for k in range(4)] + [(4 + k, 4 + (k + 1) % 8) for k in range(8)]
    made = []
    with hoomd.open(tmp_path / "a.gsd", "w") as file:
        for k, x in enumerate((0, -0.2, -0.39, -0.6, -0.8, -1)):
            made.append(np.concatenate([ring, other + [x, 0, 0]]))
            frame = hoomd.Frame()
            frame.particles.N, frame.particles.position = 12, made[-1]
            frame.particles.types, frame.particles.typeid = ["A"], [0] * 12
            # The lattice of a cube.
            frame.configuration.box, frame.configuration.step = [10, 10, 10, 3, 0, 0], k
            frame.bonds.N, frame.bonds.group = 12, bonds
            frame.bonds.types, frame.bonds.typeid = ["b"], [0] * 12
            file.append(frame)
    for one, positions in zip(linkwatch.read(tmp_path / "a.gsd"), made):
        assert np.allclose(one.positions, positions, atol=1e-5)
    assert linkwatch.check(tmp_path / "a.gsd").verdict == "changed"
    cell = np.array([[10, 0, 0], [30, 10, 0], [0, 0, 10], [0, 0, 0.0]])
    frames = [linkwatch.io.Frame(p, [-4, -8], cell=cell, seq=k) for k, p in enumerate(made)]
    assert linkwatch.check(frames, wrapped=True).verdict == "changed"


def test_a_trr_file_that_is_cut_off_within_a_header_is_an_error(tmp_path):
    """Regression test: MDAnalysis reads the frames before it, and nothing was said."""
    needs("MDAnalysis")
    universe_ = universe(frames=5)
    save(universe_, tmp_path / "a.trr")
    (tmp_path / "a.psf").write_text(psf(EDGES))
    whole = (tmp_path / "a.trr").read_bytes()
    assert len(list(linkwatch.read(tmp_path / "a.psf", tmp_path / "a.trr"))) == 5
    for cut in (10, len(whole) // 5 - 10, len(whole) // 5 - 60):
        (tmp_path / "a.trr").write_bytes(whole[:-cut])
        with pytest.raises(ValueError, match="cut off|TRR|trr"):
            list(linkwatch.read(tmp_path / "a.psf", tmp_path / "a.trr"))


def test_frames_without_positions_or_with_a_broken_cell_are_rejected(tmp_path):
    """Regression test: they were errors that named no file, and no other frame was read."""
    needs("MDAnalysis", "gsd")
    trr = pytest.importorskip("MDAnalysis.lib.formats.libmdaxdr")
    (tmp_path / "a.psf").write_text(psf(EDGES))
    with trr.TRRFile(str(tmp_path / "a.trr"), "w") as file:
        for k in range(4):
            points = np.float32(POINTS / 10)
            file.write(points if k != 2 else None, points, None, np.eye(3) * 10, k, k, 0, 24)
    why = [one.rejected for one in linkwatch.read(tmp_path / "a.psf", tmp_path / "a.trr")]
    assert why == [None, None, "it has no positions", None]
    hoomd = pytest.importorskip("gsd.hoomd", reason="gsd is not installed")
    with hoomd.open(tmp_path / "a.gsd", "w") as file:
        for edge in (50, np.nan, 50):
            frame = hoomd.Frame()
            frame.particles.N, frame.particles.position = 24, POINTS
            frame.particles.types, frame.particles.typeid = ["A"], [0] * 24
            frame.configuration.box = [edge, edge, edge, 0, 0, 0]
            frame.bonds.N, frame.bonds.group = len(EDGES), EDGES
            frame.bonds.types, frame.bonds.typeid = ["b"], [0] * len(EDGES)
            file.append(frame)
    why = [one.rejected for one in linkwatch.read(tmp_path / "a.gsd")]
    assert why == [None, "its cell is not finite", None]
