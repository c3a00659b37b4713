"""A rod of PyElastica that is thrown across a clamped one, watched live by a callback.

    pip install ./bindings/python pyelastica
    linkwatch watch --service rods                             # in another terminal
    python examples/python/attach_pyelastica.py                # the clamped rod catches it
    python examples/python/attach_pyelastica.py --contact 100  # contacts too soft: it passes
"""

import argparse

import elastica as ea
import linkwatch
import numpy as np


class Publish(ea.CallBackBaseClass):
    """Publishes the nodes of all rods every ``interval`` steps, and ends the run on an abort."""

    def __init__(self, rods, client, interval):
        self.rods, self.client, self.interval = rods, client, interval

    def make_callback(self, system, time, current_step):
        if current_step % self.interval == 0:
            self.client.begin(time)[:] = np.hstack([r.position_collection for r in self.rods]).T
            self.client.publish()  # never waits
            if self.client.aborted:
                raise SystemExit(str(self.client.aborted))


class Simulator(
    ea.BaseSystemCollection, ea.Constraints, ea.Forcing, ea.Contact, ea.Damping, ea.CallBacks
):
    """The features that this simulation uses."""


parser = argparse.ArgumentParser()
parser.add_argument("--service", default="rods")
parser.add_argument("--contact", type=float, default=1e4, help="stiffness of contacts, N/m")
args = parser.parse_args()
x, y, z = np.eye(3)
shape = {"base_length": 1.0, "base_radius": 0.02, "density": 1000, "youngs_modulus": 1e6}
clamped = ea.CosseratRod.straight_rod(20, -0.5 * x, x, z, **shape)
thrown = ea.CosseratRod.straight_rod(20, [0.01, -0.5, 0.06], y, z, **shape)
thrown.velocity_collection[2] = -5.0  # m/s
simulator, step = Simulator(), 1e-4  # s
for rod in (clamped, thrown):
    simulator.append(rod)
    simulator.dampen(rod).using(ea.AnalyticalLinearDamper, damping_constant=1.0, time_step=step)
simulator.constrain(clamped).using(ea.FixedConstraint, constrained_position_idx=(0, -1))
simulator.add_forcing_to(thrown).using(ea.GravityForces, acc_gravity=-9.81 * z)
simulator.detect_contact_between(clamped, thrown).using(ea.RodRodContact, k=args.contact, nu=0)

with linkwatch.Client(args.service, counts=[21, 21], radii=[0.02, 0.02]) as client:
    if not client.wait_for_watcher():
        raise SystemExit(f"start this first: linkwatch watch --service {args.service}")
    simulator.collect_diagnostics(thrown).using(Publish, [clamped, thrown], client, 50)
    simulator.finalize()
    ea.integrate(ea.PositionVerlet(), simulator, 1.0, 10_000, progress_bar=False)
print(client.aborted or "no rod was pulled through the other one")
raise SystemExit(1 if client.aborted else 0)
