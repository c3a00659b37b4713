"""Measures the maximum distance of frames, on melts of bead-spring chains that cannot cross.

    pip install openmm numpy
    cargo build --release
    python examples/bead_spring.py --linkwatch target/release/linkwatch

Two melts (Kremer and Grest 1990: FENE bonds, repulsive beads, density 0.85 in a sphere), one of
rings and one of linear chains, are simulated for 60,000 steps, with a frame every 100 steps.
`linkwatch check --events=all` then reads every 1st, 2nd, 5th, .. of these frames. Chains cannot
pass through one another, so every reported pull-through is spurious: the frames are too far apart.
For each distance of the frames, the table has the number of pull-throughs that cancel within their
pair in a step, the number of those that do not, and for both the least, the median and the largest
relative motion, in segment lengths.
"""

import argparse
import collections
import json
import pathlib
import struct
import subprocess
import tempfile

import numpy as np
import openmm as mm
from openmm import unit

CHAINS, BEADS = 16, 40
DENSITY = 0.85
STEP = 0.005
STEPS_A_FRAME, FRAMES = 100, 601
STRIDES = (1, 2, 5, 10, 20, 50)
REPULSION = "(4*((1/r)^12-(1/r)^6)+1)*step(1.122462048-r)"
BOLTZMANN = 0.00831446261815324  # kJ/mol/K: temperature 1 in the units of the model


def start(kind):
    """Returns rings in a stack, or rods side by side: unlinked, and apart."""
    chains = []
    for c in range(CHAINS):
        if kind == "rings":
            t = 2 * np.pi * np.arange(BEADS) / BEADS
            r = 0.97 / (2 * np.sin(np.pi / BEADS))
            z = np.full(BEADS, 1.3 * (c - CHAINS / 2))
            chains.append(np.stack([r * np.cos(t), r * np.sin(t), z], 1))
        else:
            x = (np.arange(BEADS) - BEADS / 2) * 0.97
            y, z = 1.2 * (c % 4 - 1.5), 1.2 * (c // 4 - 1.5)
            chains.append(np.stack([x, np.full(BEADS, y), np.full(BEADS, z)], 1))
    return np.concatenate(chains)


def simulate(kind, folder):
    """Writes the frames of a melt as BCC files."""
    n = CHAINS * BEADS
    system = mm.System()
    bonds = mm.CustomBondForce("-33.75*log(1-(r/1.5)^2) + " + REPULSION)
    beads = mm.CustomNonbondedForce(REPULSION)
    beads.setNonbondedMethod(mm.CustomNonbondedForce.CutoffNonPeriodic)
    beads.setCutoffDistance(1.1225)
    wall = mm.CustomExternalForce("20*max(0, sqrt(x^2+y^2+z^2)-radius)^2")
    radius, wide = (3 * n / (4 * np.pi * DENSITY)) ** (1 / 3), 24.0
    wall.addGlobalParameter("radius", wide)
    for k in range(n):
        system.addParticle(1.0)
        beads.addParticle([])
        wall.addParticle(k, [])
    for c in range(CHAINS):
        for k in range(BEADS if kind == "rings" else BEADS - 1):
            a, b = c * BEADS + k, c * BEADS + (k + 1) % BEADS
            bonds.addBond(a, b, [])
            beads.addExclusion(a, b)
    for force in (bonds, beads, wall):
        system.addForce(force)
    integrator = mm.LangevinMiddleIntegrator(1 / BOLTZMANN, 0.5, STEP)
    integrator.setRandomNumberSeed(1)
    context = mm.Context(system, integrator, mm.Platform.getPlatformByName("CPU"), {"Threads": "1"})
    context.setPositions(start(kind))
    for k in range(100):  # into the sphere
        context.setParameter("radius", wide + (radius - wide) * (k + 1) / 100)
        integrator.step(150)
    integrator.step(5000)
    longest = 0.0
    for k in range(FRAMES):
        state = context.getState(getPositions=True)
        xyz = state.getPositions(asNumpy=True).value_in_unit(unit.nanometer).astype("<f4")
        chains = xyz.reshape(CHAINS, BEADS, 3)
        longest = max(longest, np.linalg.norm(np.diff(chains, axis=1), axis=2).max())
        count = -BEADS if kind == "rings" else BEADS
        with open(folder / f"{k:04}.bcc", "wb") as file:
            file.write(b"BCC\x44PL\x03\x02" + struct.pack("<QQ40s", CHAINS, n, b"bead-spring melt"))
            for chain in chains:
                file.write(struct.pack("<i", count) + chain.tobytes())
        integrator.step(STEPS_A_FRAME)
    # Bonds cannot cross unless they stretch far beyond this.
    assert longest < 1.3, f"a bond of length {longest}"


def measure(linkwatch, folder, stride):
    """Returns the relative motions of the pull-throughs that cancel, and of the others."""
    frames = sorted(folder.glob("*.bcc"))
    certificate = folder / "certificate.txt"
    if not certificate.exists():
        command = [linkwatch, "certify", frames[0], "-o", certificate]
        subprocess.run(command, check=True, capture_output=True)
    command = [linkwatch, "check", *frames[::stride], "--baseline", certificate]
    command += ["--events=all", "--motion-limit", "inf", "--json"]
    run = subprocess.run(command, capture_output=True, text=True)
    assert run.returncode in (0, 1, 3), run.stderr
    cancelling, others = [], []
    for report in (json.loads(line).get("report") for line in run.stdout.splitlines()):
        pairs = collections.defaultdict(lambda: {1: [], -1: []})
        for event in report["events"] if report else []:
            pairs[event["i"], event["j"]][event["sign"]].append(event["lengths"])
        for signs in pairs.values():
            plus, minus = (sorted(signs[sign], reverse=True) for sign in (1, -1))
            n = min(len(plus), len(minus))
            cancelling += plus[:n] + minus[:n]
            others += plus[n:] + minus[n:]
    return cancelling, others


def words(motions):
    if not motions:
        return f"{0:6}  {'-':>18}"
    return f"{len(motions):6}  {min(motions):5.2f} {np.median(motions):5.2f} {max(motions):5.2f} "


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--linkwatch", default="linkwatch", help="the command")
    args = parser.parse_args()
    print("melt     steps   cancelling: motions    others: motions")
    for kind in ("rings", "linear"):
        with tempfile.TemporaryDirectory() as folder:
            folder = pathlib.Path(folder)
            simulate(kind, folder)
            for stride in STRIDES:
                cancelling, others = measure(args.linkwatch, folder, stride)
                steps = stride * STEPS_A_FRAME
                print(f"{kind:7} {steps:6} {words(cancelling)} {words(others)}", flush=True)


if __name__ == "__main__":
    main()
