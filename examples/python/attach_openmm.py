"""A chain of bead-spring rings in OpenMM at 300 K, watched live by a reporter.

    pip install ./bindings/python openmm
    linkwatch watch --service chain                         # in another terminal
    python examples/python/attach_openmm.py                 # the chain holds
    python examples/python/attach_openmm.py --stiffness 40  # beads too soft: it comes apart
"""

import argparse

import linkwatch
import numpy as np
import openmm.app


class Reporter:
    """Publishes the positions after every ``interval`` steps, and ends the run on an abort."""

    def __init__(self, client, interval):
        self.client, self.interval = client, interval

    def describeNextReport(self, simulation):
        steps = self.interval - simulation.currentStep % self.interval
        return {"steps": steps, "periodic": False, "include": ["positions"]}

    def report(self, simulation, state):
        points = state.getPositions(asNumpy=True).value_in_unit(openmm.unit.nanometer)
        self.client.begin(state.getTime().value_in_unit(openmm.unit.picosecond))[:] = points
        self.client.publish()  # never waits
        if self.client.aborted:
            raise SystemExit(str(self.client.aborted))


parser = argparse.ArgumentParser()
parser.add_argument("--service", default="chain")
parser.add_argument("--stiffness", type=float, default=4000, help="of the beads, kJ/mol/nm^2")
args = parser.parse_args()
rings, beads = 16, 16
flat = np.array([[np.cos(a), np.sin(a), 0] for a in 2 * np.pi * np.arange(beads) / beads])
x = [flat[:, [0, 1, 2] if k % 2 else [0, 2, 1]] + [1.2 * k, 0, 0] for k in range(rings)]
system, bonds = openmm.System(), openmm.HarmonicBondForce()
beads_push = openmm.CustomNonbondedForce(f"{args.stiffness} * max(0, 0.5 - r)^2 / 2")
for bead in range(rings * beads):
    system.addParticle(1.0)
    beads_push.addParticle([])
    bonds.addBond(bead, bead + 1 if (bead + 1) % beads else bead + 1 - beads, 0.39, 4000)
system.addForce(bonds)
system.addForce(beads_push)
integrator = openmm.LangevinMiddleIntegrator(300, 2, 0.01)
run = openmm.app.Simulation(openmm.app.Topology(), system, integrator)
run.context.setPositions(np.concatenate(x))
with linkwatch.Client(args.service, counts=[-beads] * rings) as client:  # minus: closed
    if not client.wait_for_watcher():
        raise SystemExit(f"start this first: linkwatch watch --service {args.service}")
    reporter = Reporter(client, 10)
    reporter.report(run, run.context.getState(positions=True))  # the baseline
    run.reporters.append(reporter)
    run.step(2000)
print(client.aborted or "every link is intact")
raise SystemExit(1 if client.aborted else 0)
