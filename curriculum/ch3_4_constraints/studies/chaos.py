"""How fast do two double pendulums part that start almost alike?

It prints the largest Lyapunov exponent, with its standard error.
"""

import math
from functools import partial

import numpy as np

import constraints as c
from curriculum.common import cli
from curriculum.common.tracing import fori_loop, vmap

PAIRS, TURNS = 500, 11  # the first turn only finds the direction that grows
NEAR = 1e-7  # m, between neighbours
RENEW, TURN = 0.5, 20.0  # s: neighbours are put back so often; rates are noted so often


def rates(system, q, turns, dt):
    """(turns, R) in 1/s: how fast each of q (R, N, 3), at rest, and a neighbour part in each turn.

    G. Benettin, L. Galgani, J.-M. Strelcyn, Phys. Rev. A 14 (1976) 2338: every RENEW s the
    neighbour is put back to the distance NEAR in (q, T v), T^2 = sum L / g, along the direction
    of their drift. Both start anew on the rods: project moves them, and leaves v alone but for J v.
    """
    unit = math.sqrt(np.sum(system["lengths"]) / np.linalg.norm(c.GRAVITY))  # s
    force = c.make_force(system, c.stabilizations(dt)["none"])

    def step(q, v):
        return c.rk4_step(q, v, system["m"], force, dt)

    def flown(q, v):
        return fori_loop(round(RENEW / dt), step, *c.project(system, q, q, v, math.inf))

    def renewed(q, v, dq, dv, grown):
        (q, v), (x, w) = flown(q, v), flown(q + dq, v + dv)
        dq, dv = x - q, w - v
        size = np.sqrt(np.sum(dq * dq) + unit**2 * np.sum(dv * dv)) / NEAR
        return q, v, dq / size, dv / size, grown + np.log(size)

    turn = vmap(partial(fori_loop, round(TURN / RENEW), renewed))
    dq, dv = np.random.default_rng(0).standard_normal((2, *q.shape)) * [NEAR, NEAR, 0.0]
    state, found = [q, np.zeros_like(q), dq, dv / unit, np.zeros(len(q))], []
    for _ in range(turns):
        *state, grown = turn(*state[:4], np.zeros(len(q)))
        found.append(grown / TURN)
    return np.array(found)


def main(argv=None):
    """Measure and print."""
    parser = cli.Parser(__doc__)
    parser.add_argument("--quick", action="store_true", help="a fifth of the pairs")
    pairs = PAIRS // 5 if parser.parse_args(argv).quick else PAIRS
    q = np.stack([c.build_system("double", seed)["q0"] for seed in range(pairs)])
    for dt in 0.0025, 0.005:
        rate = np.mean(rates(c.build_system("double"), q, TURNS, dt)[1:], axis=0)
        x = f"{rate.mean():.3f} +- {np.std(rate, ddof=1) / math.sqrt(pairs):.3f}"
        print(f"{pairs} pairs, rk4, {dt:g} s: e^(x t), x = {x} / s")
