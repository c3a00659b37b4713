"""Compares verification in process from Python with Rust, on the same curves.

    linkwatch generate knit:segments=270000 -o /tmp/knit.bcc
    cargo build --release --example in_process_cost
    python examples/python/in_process_cost.py /tmp/knit.bcc target/release/examples/in_process_cost

Both receive a frame and compute all its linking numbers, again and again, alternately. Prints the
median times and their ratio.
"""

import argparse
import pathlib
import statistics
import subprocess
import time

import linkwatch
import numpy as np

BASES = {"PL": "polyline", "C0": "catmull-rom", "BS": "b-spline", "BZ": "bezier"}


def read_bcc(path):
    """Returns the points, the counts and the basis of a BCC file."""
    data = pathlib.Path(path).read_bytes()
    curves = int(np.frombuffer(data, "<u8", 1, 8)[0])
    counts, points, at = [], [], 64
    for _ in range(curves):
        counts.append(int(np.frombuffer(data, "<i4", 1, at)[0]))
        n = abs(counts[-1])
        points.append(np.frombuffer(data, "<f4", 3 * n, at + 4).reshape(n, 3))
        at += 4 + 12 * n
    return np.concatenate(points), counts, BASES[data[4:6].decode()]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("model", help="a BCC file")
    parser.add_argument("command", help="the example in Rust")
    parser.add_argument("--rounds", type=int, default=9)
    args = parser.parse_args()
    points, counts, basis = read_bcc(args.model)
    session = linkwatch.Session(counts=counts, basis=basis, events="off", incremental=False)
    session.step(points)
    python, rust = [], []
    for _ in range(args.rounds):
        # The first frame fills the caches, as it does in the other process.
        session.step(points)
        times = []
        for _ in range(25):
            start = time.perf_counter()
            session.step(points)
            times.append(1e3 * (time.perf_counter() - start))
        python.append(statistics.median(times))
        command = [args.command, args.model, "25"]
        run = subprocess.run(command, check=True, capture_output=True, text=True)
        rust.append(float(run.stdout))
    python, rust = statistics.median(python), statistics.median(rust)
    print(f"Python {python:.3f} ms, Rust {rust:.3f} ms: ratio {python / rust:.2f}")


if __name__ == "__main__":
    main()
