"""Rows of knitting between two rigid bars that are pulled apart: a braid of open curves.

    linkwatch watch --service braid --braid auto &
    python examples/braid.py --live braid              # small steps: intact
    python examples/braid.py --live braid --step 0.12  # large: rows are pulled through others
    python examples/braid.py knit.npz                  # as a file, without the bus
    linkwatch check knit.npz --braid auto

Each row of stitches is an open yarn whose ends are fixed to the bars. Yarns are chains of beads
(position-based dynamics): bonds of fixed length, and beads that keep a distance from others.
With large steps, the yarns move too far in one step for the distances to hold. Needs numpy, and
with --live the Python package linkwatch.
"""

import argparse

import numpy as np

ROWS, STITCHES, BEADS = 6, 4, 24  # beads per stitch
WIDTH, ROW, HEIGHT, DEPTH, SLANT = 2.0, 1.2, 0.95, 0.30, 0.32
THICKNESS, SWEEPS, SPEED, END_TIME = 0.30, 12, 1.5, 0.9


def knit():
    """Returns the beads of all rows, (rows, beads, 3)."""
    t = np.linspace(0, STITCHES, STITCHES * BEADS + 1)
    angle = 2 * np.pi * t
    x = WIDTH * t + SLANT * np.sin(2 * angle)
    row = np.stack([x, -HEIGHT * np.cos(angle), DEPTH * np.cos(2 * angle)], axis=1)
    # From the bars to the first and the last stitch.
    way = np.linspace(0, 1, BEADS // 2, endpoint=False)[:, None]
    start, end = row[0], row[-1]
    bars = np.array([[-1.5, -HEIGHT, 0], [end[0] + 1.5, -HEIGHT, 0]])
    left = bars[0] + (start - bars[0]) * way
    right = (bars[1] + (end - bars[1]) * way)[::-1]
    row = np.concatenate([left, row, right])
    return np.stack([row + [0, ROW * k, 0] for k in range(ROWS)])


def contacts(x):
    """Returns the pairs of beads that are too close, without neighbours on a yarn."""
    beads = x.shape[1]
    p = x.reshape(-1, 3)
    squares = ((p[:, None] - p[None]) ** 2).sum(axis=2)
    i, j = np.nonzero(np.triu(squares < THICKNESS**2, 1))
    near = (i // beads == j // beads) & (j - i < 6)
    return i[~near], j[~near]


def simulate(step):
    """Returns the beads of all frames, one after the other."""
    x = knit()
    lengths = np.linalg.norm(np.diff(x, axis=1), axis=2)
    # The bars pull the stitches tight.
    pull = np.zeros_like(x)
    pull[:, 0, 0], pull[:, -1, 0] = -SPEED, SPEED
    fixed = np.ones(x.shape[:2])
    fixed[:, [0, -1]] = 0
    previous = x.copy()
    yield x
    for _ in range(round(END_TIME / step)):
        x, previous = x + 0.9 * (x - previous) * fixed[..., None] + pull * step, x
        i, j = contacts(x)
        for _ in range(SWEEPS):
            # Bonds, even and odd ones in turn.
            for k in (0, 1):
                d = x[:, k + 1 :: 2] - x[:, k:-1:2]
                w = np.stack([fixed[:, k:-1:2], fixed[:, k + 1 :: 2]])
                length = np.linalg.norm(d, axis=2)
                share = (length - lengths[:, k::2]) / length / w.sum(axis=0).clip(1)
                x[:, k:-1:2] += (w[0] * share)[..., None] * d
                x[:, k + 1 :: 2] -= (w[1] * share)[..., None] * d
            # Contacts.
            p, f = x.reshape(-1, 3), fixed.reshape(-1)
            d = p[j] - p[i]
            length = np.linalg.norm(d, axis=1).clip(1e-9)
            push = 0.4 * (THICKNESS - length).clip(0) / length
            np.add.at(p, i, -(push * f[i])[:, None] * d)
            np.add.at(p, j, (push * f[j])[:, None] * d)
        yield x.copy()


def publish(service, counts, names, frames, step):
    """Publishes frames up to the first one that is not intact. Returns the last verdict."""
    import linkwatch

    curves = {"counts": counts, "names": names, "dtype": "float64"}
    with linkwatch.Client(service, lockstep=True, **curves) as sim:
        if not sim.wait_for_watcher():
            raise SystemExit("no watcher came in time")
        for k, x in enumerate(frames):
            sim.begin(k * step)[:] = x.reshape(-1, 3)
            sim.publish()
            verdict = sim.wait()
            if verdict is None:
                raise SystemExit(sim.no_verdict)
            if not verdict.intact:
                break
    return verdict


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("file", nargs="?", help="file of all frames (.npz)")
    parser.add_argument("--live", metavar="SERVICE", help="publish to linkwatch watch")
    parser.add_argument("--step", type=float, default=0.005, help="time step")
    args = parser.parse_args()
    if not (args.file or args.live):
        parser.error("give a file, or --live")
    counts = [knit().shape[1]] * ROWS
    names = [f"row {k + 1}" for k in range(ROWS)]
    frames = simulate(args.step)
    if args.file:
        frames = np.array(list(frames))
        times = args.step * np.arange(len(frames))
        positions = frames.reshape(len(frames), -1, 3)
        np.savez(args.file, positions=positions, counts=counts, times=times, names=names)
    if args.live:
        verdict = publish(args.live, counts, names, frames, args.step)
        print(verdict)
        raise SystemExit(0 if verdict.intact else 1)


if __name__ == "__main__":
    main()
