"""A hanging chain of rings in Newton, on the CPU or a GPU, watched live.

    pip install ./bindings/python newton
    linkwatch watch --service chain                         # in another terminal
    python examples/python/attach_newton.py                 # the chain holds
    python examples/python/attach_newton.py --contact 1e4   # contacts too soft: it comes apart
    python examples/python/attach_newton.py --device cuda:0

The first run compiles the kernels, which takes a minute on a CPU.
"""

import argparse

import linkwatch
import newton
import numpy as np

parser = argparse.ArgumentParser()
parser.add_argument("--service", default="chain")
parser.add_argument("--contact", type=float, default=1e6, help="stiffness of contacts, N/m")
parser.add_argument("--device", default="cpu")
args = parser.parse_args()

rings, segments, step = 6, 16, 0.002
angle = 2 * np.pi * np.arange(segments + 1) / segments
circle = 0.5 * np.stack([np.cos(angle), 0 * angle, np.sin(angle)], axis=1)
circle[-1] = circle[0]
length = np.linalg.norm(circle[1] - circle[0])
builder = newton.ModelBuilder()  # with gravity along -z
builder.default_shape_cfg.ke = args.contact
for k in range(rings):
    ring = circle[:, [0, 1, 2] if k % 2 else [1, 0, 2]] - [0, 0, 0.8 * k]
    rod = newton.Rod(ring, closed=True, radius=0.05)
    bodies, _ = builder.add_rod(rod=rod, bend_stiffness=100.0, bend_damping=1.0)
    if k == 0:
        builder.body_flags[bodies[0]] = int(newton.BodyFlags.KINEMATIC)  # the chain hangs here
builder.color()
model = builder.finalize(device=args.device)
solver = newton.solvers.SolverVBD(model, iterations=5)
pipeline = newton.CollisionPipeline(model)
contacts = pipeline.contacts()
state, other, control = model.state(), model.state(), model.control()

with linkwatch.Client(args.service, counts=[-segments] * rings) as sim:  # minus: closed
    if not sim.wait_for_watcher():
        raise SystemExit(f"start this first: linkwatch watch --service {args.service}")
    for frame in range(500):
        pose = state.body_q.numpy()  # centres of the segments, which point along their local z
        x, y, z, w = pose[:, 3:].T
        along = np.array([2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y)]).T
        sim.begin(frame * step)[:] = pose[:, :3] - length / 2 * along
        sim.publish()  # never waits
        if sim.aborted:
            break
        state.clear_forces()
        pipeline.collide(state, contacts)
        solver.step(state, other, control, contacts, step)
        state, other = other, state
print(sim.aborted or "every link is intact")
raise SystemExit(1 if sim.aborted else 0)
