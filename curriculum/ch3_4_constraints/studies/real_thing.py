"""What do engines do with a rod?  MuJoCo's names for what we compute, and other engines' rows.

(a) `soft` is MuJoCo's equality constraint of a tendon: each quantity of a chain, and the largest
gap, with rods that are right, and with rods a few per cent off. (b) Box2D, Jolt and Drake as rows
of one table, read in their sources, each solved exactly here.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

import constraints as c
from curriculum.ch3_4_constraints.rods.systems import energy_scale
from curriculum.ch3_4_constraints.studies._mujoco import started, tendons
from curriculum.common import cli
from curriculum.common.tracing import compiled

DT = 0.005  # s
STEPS = 4000  # of (b)
OFF = 0.03  # of its length: how far rods are off, as a standard deviation
ROUNDING = 1e-12  # a relative gap below is nothing else
AS_SOFT = 'solref="0.02 1" solimp="0.95 0.95 0.001 0.5 2"'


class Row(NamedTuple):
    """How an engine asks for a rod: J a = -damping gdot - stiffness g - softness diag(A) lambda."""

    damping: float  # 1/s
    stiffness: float  # 1/s^2
    softness: float = 0.0
    post_step: Callable | None = None  # what it does after a step

    @property
    def method(self):
        """The row as a Method of the chapter."""
        numbers = {key: getattr(self, key) for key in ("damping", "stiffness", "softness")}
        return c.Method(partial(c.make_engine_force, **numbers), "an engine", self.post_step)


# --- (a) the same quantity, two names ---
def random_chain(rng, count, off=0.0):
    """A chain of `count` rods, off by shares of that size, whose particles move anyhow."""
    q, v = rng.normal(size=(2, count, 3))
    m = rng.uniform(0.3, 3.0, (count, 1))
    system = c.build_system("chain", links=count) | {"q0": q, "v0": v, "m": m}
    lengths = c.rod_lengths(system, q) / (1.0 + off * rng.normal(size=count))
    return system | {"lengths": lengths}


def gaps(system):
    """{(what it is called here, MuJoCo's field): the largest gap, relative to our largest number}.

    Of `soft`. MuJoCo's row of J is ours over |d|, and its force ours times |d|: in newtons.
    """
    import mujoco

    q = system["q0"]
    v = system["v0"]
    row = own_row("soft", DT)
    force = c.make_methods(DT)["soft"].make_force(system)
    jac, g, gdot, _ = c.constraint_terms(system, q, v)
    A = (jac / np.repeat(system["m"], 3)) @ jac.T
    size = c.rod_lengths(system, q)
    ours = {
        ("J / |d|", "efc_J"): jac / size[:, None],
        ("g / |d|", "efc_pos"): g / size,
        ("gdot / |d|", "efc_vel"): gdot / size,
        ("(b + J M^-1 f) / |d|", "efc_aref"): -(row.damping * gdot + row.stiffness * g) / size,
        ("R / |d|^2", "efc_R"): row.softness * np.diag(A) / size**2,
        ("lambda |d|", "efc_force"): -c.tensions(system, q, v, force),
        ("acceleration", "qacc"): force(q, v) / system["m"],
    }
    model, data = started(system, tendons, AS_SOFT, DT, 'tolerance="0" jacobian="dense"')
    mujoco.mj_forward(model, data)
    found = {}
    for (name, field), x in ours.items():
        gap = np.max(np.abs(x.ravel() - getattr(data, field)))
        largest = np.max(np.abs(x))
        found[name, field] = gap / largest if largest > 1e-14 else 0.0  # where all is rounding
    return found


def in_words(gap):
    """A gap in two digits; rounding differs from machine to machine."""
    return f"{gap:.1e}" if gap > ROUNDING else f"< {ROUNDING:.0e}"


def same_names():
    """Print each quantity of a chain, and how far the two are apart."""
    right = random_chain(np.random.default_rng(0), 3)
    off = random_chain(np.random.default_rng(0), 3, OFF)
    worst = np.max(np.abs(c.rod_lengths(off, off["q0"]) / off["lengths"] - 1.0))
    print(f"(a) largest relative gap, with rods right and with rods up to {100 * worst:.2g} % off")
    print(f"{'ours':22}{'MuJoCo':10}{'right':>9}{'off':>9}")
    off_rods = gaps(off)
    for (name, field), gap in gaps(right).items():
        print(f"{name:22}{field:10}{in_words(gap):>9}{in_words(off_rods[name, field]):>9}")


# --- (b) other engines' rods ---
def moved(system, jac, change):
    """M^-1 J^T mu (N, 3), the impulse along the rods that makes J times it what `change` says."""
    m = np.repeat(system["m"], 3)
    mu = c.solve(system, (jac / m) @ jac.T, change)
    return (jac.T @ mu / m).reshape(system["q0"].shape)


def velocity_sweep(system, q_start, q, v, dt):
    """Box2D's second sweep: J v = 0, and q stays."""
    jac, _, gdot, _ = c.constraint_terms(system, q, v)
    return q, v - moved(system, jac, gdot)


def position_sweeps(system, q_start, q, v, dt):
    """Jolt's sweeps over positions: two times a fifth of the error is taken back, v stays."""
    for _ in range(2):
        jac, _, _, _ = c.constraint_terms(system, q, v)
        size = c.rod_lengths(system, q)
        q = q - moved(system, jac, 0.2 * size * (size - system["lengths"]))
    return q, v


def own_row(name, h):
    """The Row of a method of the chapter that asks as engines do, for steps of h s."""
    return Row(**c.make_methods(h)[name].make_force.keywords)


def engines(h):
    """{engine at a tag: its Row}, for steps (of Box2D: sub-steps) of h s.

    All work at velocity level, as `impulse` does: J v_next = -bias g - softness h diag(A) lambda.
    """
    w = 2.0 * np.pi * min(60.0, 0.25 / h)  # rad/s; Box2D's src/joint.c, b2PrepareJoint
    stiff = w / (4.0 + h * w)  # 1/s; its src/solver.h, b2MakeSoft, damping ratio 2
    return {
        "ours, impulse": own_row("impulse", h),
        # src/distance_joint.c, b2SolveDistanceJoint
        "Box2D v3.1.1": Row(1.0 / h, stiff / h, stiff / (h * w * w), velocity_sweep),
        # ConstraintPart/AxisConstraintPart.h
        "Jolt v5.5.0": Row(1.0 / h, 0.0, 0.0, position_sweeps),
        # contact_solvers/sap/sap_holonomic_constraint.cc, beta = 0.1
        "Drake v1.56.0": Row(1.0 / h, 0.5 / (h * h), 0.01 / (4.0 * np.pi**2)),
        "ours, soft (MuJoCo)": own_row("soft", h),
    }


def worst(system, row, steps):
    """The worst rod of a run in m, and the largest change of energy as a share of its scale."""
    method = row.method
    step = compiled(c.stabilized(c.semi_implicit_step, system, method), steps)
    _, violations, energies = c.simulate(step, system, method.make_force(system), DT, steps)
    gained = np.max(np.abs(energies - energies[0]))
    return np.max(violations), gained / energy_scale(system, c.GRAVITY)


def rows():
    """Print each engine's row, and what it makes of the double pendulum."""
    system = c.build_system("double")
    what = f"rows for h = {DT} s, and what each makes of {DT * STEPS:g} s"
    print(f"(b) {what} of the double pendulum")
    print(f"{'':20}h damping h^2 stiffness  softness  rods, mm  energy, %")
    for name, row in engines(DT).items():
        rods, energy = worst(system, row, STEPS)
        cells = f"{DT * row.damping:9.2g} {DT**2 * row.stiffness:13.2g} {row.softness:9.2g}"
        print(f"{name:20}{cells} {1e3 * rods:9.2g} {100.0 * energy:10.2g}")


def main(argv=None):
    """Print the tables."""
    cli.Parser(__doc__).parse_args(argv)
    same_names()
    rows()
