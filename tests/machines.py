"""Systems that tests share: masses, lengths and speeds that differ, in the plane and in space."""

import json
import math

import numpy as np

import constraints as c
from curriculum.ch3_4_constraints.rods.systems import check_system


def row(n):
    """The pairs of a chain of n rods."""
    return [(k, k - 1) for k in range(n)]


def make_system(q, pairs, anchors=((0.0, 0.0, 0.0),), v=0.0, m=1.0):
    """A system whose rods are as long as their ends are apart."""
    q = np.array(q, float)
    anchors = np.array(anchors, float)
    ends = {-1 - k: anchor for k, anchor in enumerate(anchors)} | dict(enumerate(q))
    lengths = [math.dist(ends[i], ends[j]) for i, j in pairs]
    m = np.reshape(m + 0.0 * q[:, 0], (-1, 1))
    parts = {"q0": q, "v0": v + 0.0 * q, "m": m, "pairs": pairs, "lengths": lengths}
    return check_system(parts | {"anchors": anchors}, c.PIVOT)


def at_random(pairs):
    """Particles, masses and velocities at random, in space."""
    rng = np.random.default_rng(3)
    n = 1 + max(pairs)[0]
    q, v = rng.normal(size=(2, n, 3))
    return make_system(q, pairs, rng.normal(size=(3, 3)), v, rng.uniform(0.1, 10.0, n))


def thrown(system):
    """The system, whose velocities keep its lengths."""
    _, v = c.project(system, system["q0"], system["q0"], system["v0"], 1.0)
    return system | {"v0": v}


def cable(rods, sag, heavier):
    """A parabola, of masses that are 1 kg and `heavier` by turns; rods of 1 m, sag by its span."""
    x = np.linspace(0.0, 1.0, rods + 1)
    q = rods * np.stack([x, -4.0 * sag * x * (1.0 - x), 0.0 * x], axis=1)
    m = np.where(np.arange(1, rods) % 2, 1.0, heavier)
    return make_system(q[1:-1], [*row(rods - 1), (rods - 2, -2)], [q[0], q[-1]], m=m)


def four_bar():
    """Cranks of 0.1 and 0.25 m, and a bob on the coupler that a force pulls sideways."""
    q = [[0.05, -0.0866025403784, 0.0], [0.3, -0.2, 0.0], [0.2, -0.35, 0.0]]
    pairs = [(0, -1), (1, -2), (1, 0), (2, 0), (2, 1)]
    system = make_system(q, pairs, [[0.0, 0.0, 0.0], [0.3, 0.05, 0.0]], m=[0.2, 0.3, 0.5])
    return system | {"load": np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [4.0, 1.0, 0.0]])}


def parallelogram(off):
    """Two cranks of 2 m, 3 m apart, thrown so that they will lie flat; one end is `off` m off."""
    q = [[-1.2, -1.6, 0.0], [1.8 + off, -1.6, 0.0]]
    anchors = [[0.0, 0.0, 0.0], [3.0, 0.0, 0.0]]
    return make_system(q, [(0, -1), (1, -2), (1, 0)], anchors, [6.4, -4.8, 0.0])


STAR = [(0, -1), *((k, 0) for k in range(1, 12))]  # whose rods are all coupled
LINKAGE = [*row(4), (3, -2), (2, -3), (3, 0)]
APART = [*row(2), (1, -2), (2, -3), (3, 2)]  # a loop, and a chain that it does not meet
GRAPHS = [row(1), row(7), STAR, [*row(4), (3, 0)], LINKAGE, APART]
BLOCK = [(0, -1), (1, 0), (2, 0), (2, 1), (3, 0), (3, 1), (3, 2), (4, 0), (4, 1), (4, 2), (4, 3)]

# About the line of its rods of 1 m a bob swings on 10 um: w = sqrt(g / 10 um) is far quicker.
QUICK = make_system([[0, 0, 1e-5]], [(0, -1), (0, -2)], [[-1, 0, 0], [1, 0, 0]])

CRANKS = [[0, 0, 0], [2, 0, 0], [0.7, 1.1, 0]]  # three, and one would be too many for a square
TIED = [(1, 0), (2, 1), (2, 0), (0, -1), (1, -2), (2, -3)]
TRIPLE = make_system(np.add(CRANKS, [0.8, -0.6, 0.0]), TIED, CRANKS)


def torn(system, q_start, q, v, dt):
    """A post_step, that of a method that is lost as soon as the first bob is below -0.5 m."""
    low = {"most": 5, "failure": "it is torn"}
    return c.tracing.while_loop(lambda x: x[0, 1] < -0.5, lambda x: x, q, **low), v


def as_scene(system):
    """What a scene's file has of a system, as JSON."""
    load = system.get("load", 0.0 * system["q0"])
    columns = system["q0"], system["v0"], system["m"][:, 0], load
    keys = "position", "velocity", "mass", "load"
    rows = zip(*(x.tolist() for x in columns), strict=True)
    particles = [dict(zip(keys, row, strict=True)) for row in rows]
    rods = [{"pair": [*pair]} for pair in system["pairs"]]
    return json.dumps({"anchors": system["anchors"].tolist(), "particles": particles, "rods": rods})
