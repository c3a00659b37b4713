"""Cost of a frame for a simulator that does not wait, compared with a copy to memory of its own.

    python examples/python/cost.py [SERVICE]

With a service, `linkwatch watch --service SERVICE` runs beside it. Prints medians and their ratio.
"""

import sys
import time

import linkwatch
import numpy as np

RINGS, POINTS, ROUNDS = 14112, 15, 400


def main():
    # Rings apart from one another, because a watcher has much work with a tangle.
    points = np.random.default_rng(1).random((RINGS, POINTS, 3), dtype=np.float32)
    points[:, :, 0] += 2 * np.arange(RINGS)[:, None]
    points = points.reshape(-1, 3)
    own = [np.ones_like(points) for _ in range(2)]
    copied, published = [], []
    service = sys.argv[1] if len(sys.argv) > 1 else "cost"
    with linkwatch.Client(service, counts=[-POINTS] * RINGS) as sim:
        if len(sys.argv) > 1:
            sim.wait_for_watcher()
        for k in range(ROUNDS):
            start = time.perf_counter()
            own[k % 2][:] = points
            middle = time.perf_counter()
            sim.begin(k)[:] = points
            sim.publish()
            published.append(time.perf_counter() - middle)
            copied.append(middle - start)
    copy, publish = (1e6 * np.median(times) for times in (copied, published))
    print(
        f"{points.size} coordinates: own memory {copy:.1f} us, begin, write and publish "
        f"{publish:.1f} us: {publish / copy:.3f} times"
    )


if __name__ == "__main__":
    main()
