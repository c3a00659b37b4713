"""Writes gauss.csv again: Gauss linking integrals of random open polylines to 50 digits.

Needs mpmath. Formula: Klenin & Langowski 2000, method 1a (arcsines of the angles between the sides
of a spherical quadrilateral), which differs from that of the kernels. A row has the coordinates of
both curves, and the integral as a sum of two doubles.
"""

import random

from mpmath import asin, mp, mpf, pi, sign, sqrt

mp.dps = 50


def sub(a, b):
    return [x - y for x, y in zip(a, b)]


def dot(a, b):
    return sum(x * y for x, y in zip(a, b))


def cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def unit(a):
    length = sqrt(dot(a, a))
    return [x / length for x in a]


def term(p1, p2, p3, p4):
    r13, r14, r23, r24 = sub(p3, p1), sub(p4, p1), sub(p3, p2), sub(p4, p2)
    side = dot(cross(sub(p4, p3), sub(p2, p1)), r13)
    if side == 0:
        return mpf(0)
    n = [unit(cross(*two)) for two in [(r13, r14), (r14, r24), (r24, r23), (r23, r13)]]
    angle = sum(asin(max(mpf(-1), min(mpf(1), dot(n[k], n[(k + 1) % 4])))) for k in range(4))
    return angle * sign(side) / (4 * pi)


def integral(a, b):
    a, b = ([[mpf(x) for x in p] for p in c] for c in (a, b))
    return sum(term(*s, *t) for s in zip(a, a[1:]) for t in zip(b, b[1:]))


random.seed(2021)
with open("gauss.csv", "w") as out:
    for k in range(60):
        size = [5, 1000][k % 2]
        curves = [
            [[random.randint(-size, size) for _ in range(3)] for _ in range(random.randint(2, 5))]
            for _ in range(2)
        ]
        try:
            value = integral(*curves)
        except ZeroDivisionError:
            continue
        high = float(value)
        low = float(value - mpf(high))
        points = ";".join(" ".join(str(x) for p in c for x in p) for c in curves)
        out.write(f"{points};{high!r};{low!r}\n")
