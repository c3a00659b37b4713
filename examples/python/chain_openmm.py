"""A chain of bead-spring rings in OpenMM that is pulled at both ends, watched live by a reporter.

    pip install ./bindings/python openmm
    linkwatch watch --service chain                            # in another terminal

    python examples/python/chain_openmm.py                              # the chain holds
    python examples/python/chain_openmm.py --repulsion 10               # the beads are too soft
    python examples/python/chain_openmm.py --step 0.06                  # the time step is too large
    python examples/python/chain_openmm.py --step 0.06 --roll-back      # goes on with smaller steps

`LinkwatchReporter` publishes the positions of every step, and raises `Stop` if the watcher asks for
it. With --roll-back the simulation returns to a moment before the first pull-through and goes on
with half the time step. Lengths are in nm, times in ps.
"""

import argparse

import linkwatch
import numpy as np
import openmm
from openmm import app, unit

RINGS, BEADS = 32, 16
RADIUS, DISTANCE = 1.0, 0.5
STIFFNESS, PULL = 400.0, 3.0
END_TIME, SMALLEST_STEP = 12.0, 1e-4


class Stop(Exception):
    """The watcher asks the simulation to stop: `verdict` says why."""

    def __init__(self, verdict):
        super().__init__(str(verdict))
        self.verdict = verdict


class LinkwatchReporter:
    """Publishes the positions of every step to `linkwatch watch`, and waits for the verdict."""

    def __init__(self, service, counts):
        self.client = linkwatch.Client(service, counts=counts, dtype="float64", lockstep=True)
        if not self.client.wait_for_watcher():
            raise SystemExit(f"no watcher came: linkwatch watch --service {service}")

    def describeNextReport(self, simulation):
        return {"steps": 1, "periodic": False, "include": ["positions"]}

    def report(self, simulation, state):
        positions = state.getPositions(asNumpy=True).value_in_unit(unit.nanometer)
        self.client.begin(state.getTime().value_in_unit(unit.picosecond))[:] = positions
        self.client.publish()
        verdict = self.client.wait()
        if verdict is None:
            raise SystemExit(self.client.no_verdict)
        if verdict.abort:
            raise Stop(verdict)


def chain():
    """Returns the beads of all rings, (rings * beads, 3), in alternating planes."""
    angle = 2 * np.pi * np.arange(BEADS) / BEADS
    flat = RADIUS * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    rings = [flat if k % 2 == 0 else flat[:, [0, 2, 1]] for k in range(RINGS)]
    centers = np.outer(np.arange(RINGS), [1.2 * RADIUS, 0, 0])
    # Without symmetry, no two edges meet exactly.
    noise = np.random.default_rng(1).normal(0, 0.01, (RINGS, BEADS, 3))
    return (np.array(rings) + centers[:, None] + noise).reshape(-1, 3)


def simulation(step, repulsion):
    """Returns a simulation of the chain."""
    system, topology = openmm.System(), app.Topology()
    bonds = openmm.HarmonicBondForce()
    contacts = openmm.CustomNonbondedForce(f"{repulsion} * max(0, {DISTANCE} - r)^2 / 2")
    contacts.setNonbondedMethod(openmm.CustomNonbondedForce.CutoffNonPeriodic)
    contacts.setCutoffDistance(DISTANCE)
    pull = openmm.CustomExternalForce("-force * x")
    pull.addPerParticleParameter("force")
    length = 2 * RADIUS * np.sin(np.pi / BEADS)
    for ring in range(RINGS):
        residue = topology.addResidue("ring", topology.addChain())
        for k in range(BEADS):
            bead = system.addParticle(1.0)
            topology.addAtom("C", app.Element.getBySymbol("C"), residue)
            contacts.addParticle([])
            if ring in (0, RINGS - 1):
                pull.addParticle(bead, [PULL if ring else -PULL])
        for k in range(BEADS):
            bead, neighbour = ring * BEADS + k, ring * BEADS + (k + 1) % BEADS
            bonds.addBond(bead, neighbour, length, STIFFNESS)
            contacts.addExclusion(bead, neighbour)
    for force in (bonds, contacts, pull):
        system.addForce(force)
    integrator = openmm.LangevinMiddleIntegrator(0.0, 2.0, step)
    platform = openmm.Platform.getPlatformByName("Reference")
    made = app.Simulation(topology, system, integrator, platform)
    made.context.setPositions(chain())
    return made


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--service", default="chain", help="service of linkwatch watch")
    parser.add_argument("--step", type=float, default=0.01, help="time step in ps")
    parser.add_argument("--repulsion", type=float, default=400.0, help="stiffness of contacts")
    parser.add_argument("--roll-back", action="store_true", help="roll back and go on")
    args = parser.parse_args()

    run = simulation(args.step, args.repulsion)
    reporter = LinkwatchReporter(args.service, [-BEADS] * RINGS)  # minus says closed
    run.reporters.append(reporter)

    def positions():
        state = run.context.getState(positions=True)
        return state.getPositions(asNumpy=True).value_in_unit(unit.nanometer)

    with reporter.client as client:
        step, time = args.step, 0.0
        reporter.report(run, run.context.getState(positions=True))
        while time < END_TIME:
            before = positions()
            try:
                run.step(1)
                time += step
            except Stop as stop:
                print(stop)
                if not args.roll_back:
                    raise SystemExit(1) from None
                if step / 2 < SMALLEST_STEP:
                    raise SystemExit("two rings are stuck; an earlier state is needed") from None
                # Half of the safe fraction, because two rings touch at the moment itself.
                share = 0.5 * (stop.verdict.safe_fraction or 0.0)
                time += share * step
                run.context.setPositions(before + share * (positions() - before))
                run.context.setVelocities(np.zeros((RINGS * BEADS, 3)))
                run.context.setTime(time)
                step /= 2
                run.integrator.setStepSize(step)
                client.resume()
                print(f"rolled back to {time:.4f} ps; the time step is {step} ps now")
                reporter.report(run, run.context.getState(positions=True))
        print(f"{RINGS} rings in {time:.2f} ps: every link is intact")
        print(client.finish())


if __name__ == "__main__":
    main()
