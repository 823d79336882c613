"""How fast do two double pendulums part that start almost alike?

It prints the largest Lyapunov exponent, with its standard error. With --map it draws map.svg, too:
of all starts at rest, when does the second rod first turn over?
"""

import math
from functools import partial
from pathlib import Path

import numpy as np

import constraints as c
from curriculum.ch3_4_constraints.palette import PAPER
from curriculum.common import cli
from curriculum.common.tracing import fori_loop, vmap

PAIRS, TURNS = 500, 11  # the first turn only finds the direction that grows
NEAR = 1e-7  # m, between neighbours
RENEW, TURN = 0.5, 20.0  # s: neighbours are put back so often; rates are noted so often
EDGE = 240  # starts each way, of the map
SHADES = "#fde725", "#5dc863", "#21908c", "#3b528b", "#440154"  # viridis: 2 s each


def rates(system, q, turns, dt):
    """(turns, R) in 1/s: how fast each of q (R, N, 3), at rest, and a neighbour part in each turn.

    G. Benettin, L. Galgani, J.-M. Strelcyn, Phys. Rev. A 14 (1976) 2338: every RENEW s the
    neighbour is put back to the distance NEAR in (q, T v), T^2 = sum L / g, in the direction it has
    gone to. Both start anew on the rods: project moves them, and leaves v alone but for J v.
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


def first_turn(q, dt, steps):
    """(R,) s until the second rod of each of q (R, 2, 3), at rest, passes the upright, or inf."""
    system = c.build_system("double")
    force = c.make_force(system, c.stabilizations(dt)["impulse"])

    def step(q, v, now, first):
        before = q[1, 0] - q[0, 0]
        q, v = c.semi_implicit_step(q, v, system["m"], force, dt)
        d = q[1] - q[0]
        over = np.where(d[0] * before < 0.0, np.where(d[1] > 0.0, now + dt, np.inf), np.inf)
        return q, v, now + dt, np.minimum(first, over)

    zero = np.zeros(len(q))
    return vmap(partial(fori_loop, steps, step))(q, np.zeros_like(q), zero, zero + np.inf)[-1]


def flip_map():
    """An SVG: a path of horizontal strokes for each 2 s."""
    th = math.pi * (2.0 * np.arange(EDGE) + 1.0 - EDGE) / EDGE  # from straight down
    angles = np.stack(np.meshgrid(th[::-1], th, indexing="ij"), axis=-1).reshape(-1, 2)
    x, y = np.sin(angles), -np.cos(angles)
    q = np.cumsum(np.stack([x, y, 0.0 * x], axis=-1), axis=1)
    times = first_turn(q, 0.005, 2000).reshape(EDGE, EDGE)
    paths = ""
    for shade, colour in enumerate(SHADES):
        strokes = ""
        for row, line in enumerate(np.floor(times / 2.0) == shade):
            ends = np.flatnonzero(np.diff(np.concatenate([[0], line, [0]])))
            strokes += "".join(f"M{a} {row}h{b - a}" for a, b in ends.reshape(-1, 2).tolist())
        paths += f'<path stroke="{colour}" d="{strokes}"/>\n'
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 -0.5 {EDGE} {EDGE}" width="720">\n'
        "<title>Across: the second rod's angle at the start. Up: the first's. In the middle both "
        "hang. Yellow turns over within 2 s, purple within 10, white does not.</title>\n"
        f'<rect y="-0.5" width="{EDGE}" height="{EDGE}" fill="{PAPER[0]}"/>\n{paths}</svg>\n'
    )


def main(argv=None):
    """Measure, print, and draw."""
    parser = cli.Parser(__doc__)
    parser.add_argument("--map", action="store_true", help="draw map.svg, too")
    if parser.parse_args(argv).map:
        Path(__file__).with_name("map.svg").write_text(flip_map(), encoding="utf-8")
    q = np.stack([c.build_system("double", seed)["q0"] for seed in range(PAIRS)])
    for dt in 0.0025, 0.005:
        rate = np.mean(rates(c.build_system("double"), q, TURNS, dt)[1:], axis=0)
        x = f"{rate.mean():.3f} +- {np.std(rate, ddof=1) / math.sqrt(PAIRS):.3f}"
        print(f"{PAIRS} pairs, rk4, {dt:g} s: e^(x t), x = {x} / s")


if __name__ == "__main__":
    cli.run_script(main)
