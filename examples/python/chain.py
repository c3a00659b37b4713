"""A chain of rings of beads that is pulled at both ends, verified in its process or by a watcher.

    python examples/python/chain.py              # a small time step: the chain holds
    python examples/python/chain.py --step 0.06  # too large: rings are pulled through others
    python examples/python/chain.py --step 0.06 --roll-back

    linkwatch watch --service chain     # in another terminal: watched live
    python examples/python/chain.py --step 0.06 --roll-back --live chain

With --roll-back the simulation returns to a moment before the first pull-through and goes on with
half the time step. Needs the Python package linkwatch and numpy.
"""

import argparse

import linkwatch
import numpy as np

RINGS, BEADS = 32, 16
RADIUS = 1.0
BOND = 2 * RADIUS * np.sin(np.pi / BEADS)
STIFFNESS, CONTACT, PULL, DRAG = 400.0, 400.0, 3.0, 2.0
CONTACT_DISTANCE = 0.5
END_TIME, SMALLEST_STEP = 12.0, 1e-5


def chain():
    """Returns the beads of all rings, (rings, beads, 3), in alternating planes."""
    angle = 2 * np.pi * np.arange(BEADS) / BEADS
    flat = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    upright = np.stack([np.cos(angle), 0 * angle, np.sin(angle)], axis=1)
    rings = [flat if k % 2 == 0 else upright for k in range(RINGS)]
    centers = np.outer(np.arange(RINGS), [1.2 * RADIUS, 0, 0])
    # Without symmetry, no two edges meet exactly.
    noise = np.random.default_rng(1).normal(0, 0.01, (RINGS, BEADS, 3))
    return RADIUS * np.array(rings) + centers[:, None] + noise


def forces(x, v):
    """Returns the force on each bead: bonds, contacts of neighbouring rings, pull and drag."""
    force = -DRAG * v
    bond = np.roll(x, -1, axis=1) - x
    length = np.linalg.norm(bond, axis=2, keepdims=True)
    tension = STIFFNESS * (length - BOND) * bond / length
    force += tension - np.roll(tension, 1, axis=1)
    # The shape of a ring: each bead and the opposite one keep their distance.
    across = np.roll(x, BEADS // 2, axis=1) - x
    length = np.linalg.norm(across, axis=2, keepdims=True)
    force += 0.1 * STIFFNESS * (length - 2 * RADIUS) * across / length
    for next_but in (1, 2):
        apart = x[next_but:, :, None] - x[:-next_but, None, :]
        distance = np.linalg.norm(apart, axis=3, keepdims=True)
        push = CONTACT * np.maximum(CONTACT_DISTANCE - distance, 0) * apart / distance
        force[next_but:] += push.sum(axis=2)
        force[:-next_but] -= push.sum(axis=1)
    force[0, :, 0] -= PULL
    force[-1, :, 0] += PULL
    return force


class Watched:
    """The calls of a session, answered by a watcher."""

    def __init__(self, service):
        self.sim = linkwatch.Client(
            service,
            counts=[-BEADS] * RINGS,
            names=[f"ring {k}" for k in range(RINGS)],
            radii=[CONTACT_DISTANCE / 2] * RINGS,
            dtype="float64",
            lockstep=True,
        )
        if not self.sim.wait_for_watcher():
            print("no watcher came in time")

    def step(self, points, time):
        self.sim.begin(time)[:] = points
        self.sim.publish()
        verdict = self.sim.wait()
        if verdict is None:
            raise SystemExit(self.sim.no_verdict)
        return verdict

    def cut(self):
        self.sim.resume()

    def finish(self):
        print(self.sim.finish())


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--step", type=float, default=0.01, help="time step")
    parser.add_argument("--roll-back", action="store_true", help="roll back and go on")
    parser.add_argument("--live", metavar="SERVICE", help="publish to linkwatch watch")
    args = parser.parse_args()

    session = Watched(args.live) if args.live else linkwatch.Session([-BEADS] * RINGS)
    x, step, time = chain(), args.step, 0.0
    v = np.zeros_like(x)
    session.step(x.reshape(-1, 3), time)
    while time < END_TIME:
        v_next = v + step * forces(x, v)
        x_next = x + step * v_next
        report = session.step(x_next.reshape(-1, 3), time + step)
        if report.intact:
            x, v, time = x_next, v_next, time + step
            continue
        print(report)
        if not args.roll_back:
            raise SystemExit(1)
        # Half of it: at the moment itself two rings touch, and no contact force separates them.
        # Verified below, as the first frame after the jump.
        fraction = 0.5 * (report.safe_fraction or 0.0)
        x, v, time = x + fraction * (x_next - x), 0 * v, time + fraction * step
        step /= 2
        if step < SMALLEST_STEP:
            raise SystemExit("two rings are stuck; an earlier state would be needed")
        print(f"rolled back to {time:.4f}; the time step is {step} now")
        session.cut()
        if not session.step(x.reshape(-1, 3), time).intact:
            raise SystemExit("the state before is not intact")
    stretch = np.ptp(x[:, :, 0])
    print(f"{RINGS} rings, {stretch:.1f} long: every link is intact")
    if args.live:
        session.finish()


if __name__ == "__main__":
    main()
