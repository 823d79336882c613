"""How fast can it be?  Gauss's rule on rods beside heyoka's Taylor series in joint angles.

The double pendulum for 5 s, to four errors. Both are compiled before, and take turns. The settings
of both were found by trial and error, so there may be quicker ones.
"""

import time
from functools import partial
from statistics import median

import numpy as np

import constraints as c
from curriculum.ch3_4_constraints.rods.truth import distance, true_motion
from curriculum.common import cli
from curriculum.common.gauss import collocation
from curriculum.common.tracing import CompiledSteps, fori_loop, vmap

SETTINGS = {  # m: stages, rounds and steps of Gauss's rule, and heyoka's tolerance
    1e-3: (4, 5, 36, 1e-3),
    1e-6: (6, 6, 46, 3e-6),
    1e-9: (6, 6, 88, 1e-9),
    1e-12: (6, 6, 138, 1e-11),
}
TURNS = 25  # of either, one after the other
RUNS = 20  # of a turn, one after the other, so that caches are warm
SYSTEM = c.build_system("double")
SECONDS = 5.0
MANY = 10**9  # steps in all: enough to be worth machine code
FREE = c.make_force(SYSTEM)
G = -c.GRAVITY[1]  # m/s^2


def racing_step(stages, rounds, q, v, a, dt):
    """A step of Gauss's rule: q, v (N, 3), and a (stages N, 3), the accelerations of its stages.

    They are iterated so many rounds, beginning with the polynomial of the step before (E. Hairer,
    C. Lubich, G. Wanner, Geometric Numerical Integration, VIII.6).
    """
    nodes, b, once, twice = collocation(stages)
    beyond = np.linalg.solve(np.vander(nodes).T, np.vander(1.0 + nodes).T).T  # to 1 + nodes

    def summed(weights, a):
        return (weights @ a.reshape(stages, -1)).reshape(q.shape)

    def next_round(a, speeds, moves):
        def stage(node, speed, move):
            return FREE(q + node * dt * v + summed(move, a), v + summed(speed, a)) / SYSTEM["m"]

        return vmap(stage)(nodes, dt * speeds, dt * dt * moves)

    a = next_round(a, once @ beyond, twice @ beyond)
    a = fori_loop(rounds - 1, lambda a: next_round(a, once, twice), a)
    q = q + dt * v + summed(dt * dt * b * (1.0 - nodes), a)
    return q, v + summed(dt * b, a), a.reshape(-1, 3)


def gauss(stages, rounds):
    """run(steps) -> seconds, q at the end; it begins as if the pendulum had coasted before."""
    coasting = np.zeros((stages * len(SYSTEM["m"]), 3))
    start = [SYSTEM["q0"], SYSTEM["v0"], coasting]
    compiled = CompiledSteps(partial(racing_step, stages, rounds), start, MANY, scalars=1)

    def run(steps):
        q, _, _ = compiled(start, steps, SECONDS / steps)
        return compiled.seconds, q[-1]

    return run


def taylor_flow(tol):
    """heyoka's integrator: its state is both rods' angles, in rad from +x, and their rates.

    It has Lagrange's equations for rods of 1 m and bobs of 1 kg, and chooses its steps.
    """
    import heyoka as hy

    th1, th2, w1, w2 = hy.make_vars("th1", "th2", "w1", "w2")
    sin = hy.sin(th1 - th2)
    cos = hy.cos(th1 - th2)
    first = -sin * w2 * w2 - 2.0 * G * hy.cos(th1)
    second = sin * w1 * w1 - G * hy.cos(th2)
    share = 2.0 - cos * cos
    a1 = (first - cos * second) / share
    a2 = (2.0 * second - cos * first) / share
    equations = [(th1, w1), (th2, w2), (w1, a1), (w2, a2)]
    return hy.taylor_adaptive(equations, np.zeros(4), tol=tol, fast_math=True)


def taylor(tol):
    """run() -> seconds, q at the end, of heyoka."""
    flow = taylor_flow(tol)
    x, y, _ = SYSTEM["q0"][0]

    def run():
        angle = np.arctan2(y, x)  # of both rods, which begin in line
        flow.state[:] = angle, angle, 0.0, 0.0
        clock = time.perf_counter()
        flow.propagate_for(SECONDS)
        took = time.perf_counter() - clock
        angles = flow.state[:2]
        rods = np.stack([np.cos(angles), np.sin(angles), 0.0 * angles], axis=1)
        return took, np.cumsum(rods, axis=0)

    return run


def turn(run):
    """How many µs a run takes."""
    return 1e6 * median(run()[0] for _ in range(RUNS))


def main(argv=None):
    """Race, and print who took how long."""
    parser = cli.Parser(__doc__)
    parser.parse_args(argv)
    known = true_motion(c.this_chapter(), SYSTEM, SECONDS, 1).q
    for goal, (stages, rounds, steps, tol) in SETTINGS.items():
        mine = partial(gauss(stages, rounds), steps)
        theirs = taylor(tol)
        for run in mine, theirs:
            _, q = run()
            if distance(q, known) > goal:
                parser.error(f"a setting is no longer within {goal:g} m: change SETTINGS")
        times = [(turn(mine), turn(theirs)) for _ in range(TURNS)]
        mine_us, theirs_us = np.median(times, axis=0)
        first = f"ours gauss({stages}), {rounds} rounds, {steps} steps: {mine_us:.1f} µs"
        second = f"heyoka tol {tol:.0e}: {theirs_us:.1f} µs"
        print(f"{goal:.0e} m  {first}  {second}  ratio {mine_us / theirs_us:.2f}")
