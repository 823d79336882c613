"""What studies and tests do again and again: a system from arrays, and a run of it by the names of
rule and mode."""

import constraints as c

import numpy as np

SCENES = c.HERE / c.CHAPTER / "scenes"


def make_system(q0, v0, m, pairs, lengths=None, anchors=((0.0, 0.0, 0.0),)):
    """A system dict; masses m (N,) kg, lengths (C,) m by default as in q0."""
    q0, v0, anchors = (np.asarray(x, dtype=float) for x in (q0, v0, anchors))
    system = {
        "q0": q0,
        "v0": v0,
        "m": np.reshape(m, (-1, 1)).astype(float),
        "pairs": list(pairs),
        "anchors": anchors,
    }
    ends = [anchors[-1 - j] if j < 0 else q0[j] for _, j in pairs]
    found = np.array(
        [np.sqrt(c.dot(q0[i] - end, q0[i] - end)) for (i, _), end in zip(pairs, ends, strict=True)]
    )
    return system | {"lengths": found if lengths is None else np.asarray(lengths, dtype=float)}


def scene(name):
    """The system of a shipped scene."""
    return c.build_system(str(SCENES / f"{name}.json"))


def run(system, rule="semi_implicit", hold="none", dt=0.005, steps=4000, keep=()):
    """The Run of a rule (or its name) with a Hold, the name of one, or a Baumgarte frequency."""
    hold = c.hold_table(dt)[hold] if isinstance(hold, str) else hold
    rule = c.INTEGRATORS[rule] if isinstance(rule, str) else rule
    return c.simulate(rule, system, c.make_force(system, hold), dt, steps, keep)


def energy_scale(system):
    """The unit of energy errors in J: sum m |g| sum L."""
    return float(np.sum(system["m"]) * np.abs(c.GRAVITY).max() * np.sum(system["lengths"]))


def drift(system, run):
    """The largest energy error (...) of a run, as a share of that."""
    return np.max(np.abs(run.energies - run.energies[0]), axis=0) / energy_scale(system)
