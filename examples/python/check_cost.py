"""Measures `linkwatch.check`: frames in memory, a universe of MDAnalysis, and workers of Dask.

    pip install "./bindings/python[dask,mdanalysis]"
    python examples/python/check_cost.py [--rings 500] [--frames 400] [--rounds 5]

Prints medians of rounds in which what is compared is measured in turn: elapsed time, and the time
of all cores (CPU), which says more on a machine that others use. The scene is chains of linked
rings of 100 beads, whose beads move by a share of a bond from frame to frame.
"""

import argparse
import os
import tempfile
import time
import warnings
from pathlib import Path

import linkwatch
import numpy as np

BEADS, CHAIN = 100, 50


def simulated(rings, frames, share):
    """Returns frames of the shape (frames, points, 3), in single precision."""
    rng = np.random.default_rng(1)
    angle = 2 * np.pi * np.arange(BEADS) / BEADS
    flat = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    both = flat, flat[:, [0, 2, 1]]
    x = [both[k % 2] + [1.2 * (k % CHAIN), 3.0 * (k // CHAIN), 0] for k in range(rings)]
    x = np.concatenate(x) + rng.normal(0, 0.003, (rings * BEADS, 3))
    # Beads oscillate, so that rings stay where they are.
    phase, amplitude = rng.random((rings * BEADS, 3)) * 2 * np.pi, share * 2 * np.pi / BEADS
    moves = (amplitude / 0.3 * np.sin(phase + 0.3 * k) for k in range(frames))
    return np.array([x + move for move in moves], np.float32)


def measured(rounds, *calls, cpu=time.process_time):
    """Returns the medians of elapsed time and CPU time of each call, and all of them."""
    times = np.empty((rounds + 1, len(calls), 2))
    for row in times:
        for k, call in enumerate(calls):
            start, used = time.perf_counter(), cpu()
            call()
            row[k] = time.perf_counter() - start, cpu() - used
    return np.median(times[1:], axis=0), times[1:]


def in_memory(points, counts, rounds):
    """Frames in memory, with the search for pull-throughs and without."""
    for events in ("between", "off"):

        def check():
            found = linkwatch.check(points, counts=counts, events=events, progress=False)
            assert found, found

        ((took, cpu),), _ = measured(rounds, check)
        rates = f"{points.nbytes / took / 1e9:.2f} GB/s; {points.nbytes / cpu / 1e9:.2f} GB/s CPU"
        print(f"  in memory, events={events!r}: {rates}")


def of_mdanalysis(points, counts, folder, rounds):
    """A universe, beside reading its trajectory alone."""
    import MDAnalysis

    warnings.simplefilter("ignore")  # of MDAnalysis, about its next release
    bonds, end = [], 0
    for count in counts:
        bonds += [(end + i, end + (i + 1) % -count) for i in range(-count)]
        end -= count
    for kind in ("dcd", "xtc"):
        path = folder / f"run.{kind}"
        made = MDAnalysis.Universe.empty(end, trajectory=True)
        made.load_new(points, order="fac")
        with MDAnalysis.Writer(str(path), end) as writer:
            for _ in made.trajectory:
                writer.write(made.atoms)
        made.load_new(str(path))
        made.add_TopologyAttr("bonds", bonds)
        opened = time.perf_counter()
        frames = linkwatch.io.from_mdanalysis(made)
        opened = time.perf_counter() - opened

        def read():
            for _ in made.trajectory:
                pass

        def check():
            assert linkwatch.check(frames, progress=False)

        medians, times = measured(rounds, read, check)
        per_frame = 1e3 * medians / len(points)
        read, check = (f"{took:.2f} ms ({cpu:.2f} CPU)" for took, cpu in per_frame)
        ratio = np.median(times[:, 1, 0] / times[:, 0, 0])
        print(f"  {kind}: reading a frame {read}, check {check}: {ratio:.1f} times")
    print(f"  {opened:.1f} s to find the curves, once")


def by_dask(points, counts, folder, rounds):
    """Chunks of a file, by one and by two workers of one thread each."""
    from dask.distributed import Client, LocalCluster

    np.savez(folder / "run.npz", positions=points, counts=counts)
    opened, frames = linkwatch.read(folder / "run.npz"), len(points)
    large, small = frames // 4, frames // 20
    os.environ["RAYON_NUM_THREADS"] = "1"
    with (
        LocalCluster(1, threads_per_worker=1, dashboard_address=":0") as cluster,
        Client(cluster) as one,
        LocalCluster(2, threads_per_worker=1, dashboard_address=":0") as larger,
        Client(larger) as two,
    ):

        def check(client, chunk):
            return lambda: linkwatch.check(opened, client=client, chunk=chunk, progress=False)

        def cpu():
            return sum([*one.run(time.process_time).values(), *two.run(time.process_time).values()])

        def call():
            """Calls that bring the state of a session back, as those for a chunk do."""
            state = one.submit(os.urandom, points[0].nbytes)
            one.gather([one.submit(lambda state: state, state, pure=False) for _ in range(100)])

        calls = check(one, large), check(two, large), check(one, small), call
        medians, times = measured(rounds, *calls, cpu=cpu)
    rates = " and ".join(f"{rate:.0f}" for rate in frames / medians[:2, 0])
    gain = np.median(times[:, 0, 0] / times[:, 1, 0])
    print(f"  Dask: {rates} frames/s by 1 and 2 workers: {gain:.2f} times")
    chunk = max(0, (medians[2, 1] - medians[0, 1]) / (frames / small - frames / large))
    frame, through = (medians[0, 1] - 4 * chunk) / frames, medians[3, 0] / 100
    print(f"    a frame costs a worker {1e3 * frame:.2f} ms CPU, and a chunk {1e3 * chunk:.0f} ms")
    print(f"    a chunk takes {1e3 * through:.1f} ms to go through the scheduler")
    # The scheduler takes one chunk after the other, and keeps all workers busy if chunks are large.
    least = int(np.ceil((1000 * through - chunk) / frame))
    gain = 1000 * least * frame / (least * frame + chunk)
    print(f"    on paper: {gain:.0f} times by 1000 workers, with {least} frames a chunk or more")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rings", type=int, default=500)
    parser.add_argument("--frames", type=int, default=400)
    parser.add_argument("--rounds", type=int, default=5)
    args = parser.parse_args()
    counts = [-BEADS] * args.rings
    for share in (0.01, 0.2):
        points = simulated(args.rings, args.frames, share)
        print(f"{points.shape[1]} points, {args.frames} frames, motion of {share} bonds a frame:")
        in_memory(points, counts, args.rounds)
        with tempfile.TemporaryDirectory() as folder:
            of_mdanalysis(points, counts, Path(folder), args.rounds)
            by_dask(points, counts, Path(folder), args.rounds)


if __name__ == "__main__":
    main()
