"""What the chapter's figures compute with: scenes as JavaScript, and the ladders of all schemes.

Each step and each measure of a scene is the chapter's own lines.
"""

from functools import cache
from inspect import signature

import numpy as np

import constraints as c
from curriculum.ch3_4_constraints.page.scene import scene_of
from curriculum.ch3_4_constraints.rods.choice import PARTS, RUN, SPAN, Search
from curriculum.ch3_4_constraints.rods.schemes import ENERGY, Stepper, schemes
from curriculum.common.tracing.trace import Program
from curriculum.common.words import in_digits

KNOBS = {name: x.default for name, x in signature(c.make_methods).parameters.items()}
STEPS = 4000  # for so many of the run's steps rods and energy are followed
FINEST = 1e-7  # m: ladders go down until they are right to so much, or for as long as the answer's
COARSEST = 0.5  # m: what is off by more is not shown
SPRING = {"dt": 0.4, "damping": 0.0, "stiffness": 1.0}  # s, 1/s, 1/s^2


def equation(system, q, v):
    """J, and A, b and lambda of A lambda = b, without a spring: what constraint_force goes through.

    At q and v (N, 3) in m and m/s: J (C, 3N) in m, A (C, C) in m^2/kg, b (C,) in m^2/s^2 and lambda
    (C,) in N/m, by these names. They are its lines once more, since it returns none of them; a test
    compares the two.
    """
    m = np.repeat(system["m"], 3)
    f = c.external_force(system, q, v).ravel()
    jac, _, _, jdotv = c.constraint_terms(system, q, v)
    A = (jac / m) @ jac.T
    b = -(jac @ (f / m) + jdotv)
    return {"J": jac, "A": A, "b": b, "lambda": c.solve(system, A, b, v)}


def of_equation(name):
    """A measure: one of what equation has."""
    return lambda *state: equation(*state)[name]


def pull(system, q, v):
    """How hard each rod pulls, (C,) in N, without a spring."""
    return c.tensions(system, q, v, c.make_force(system))


MEASURES = {  # what figures ask of a state, by system, besides what every page has
    "pendulum": {
        "g": lambda *state: c.constraint_terms(*state)[1],
        "gdot": lambda *state: c.constraint_terms(*state)[2],
        "tensions": pull,
        "weight": c.external_force,
    },
    "double": {name: of_equation(name) for name in ("J", "A", "b", "lambda")},
    "peaucellier": {},
}


def scenes():
    """{name: what a figure computes with}; seed1 is where that double pendulum starts."""
    found = {name: without_hand(scene(name, each), name) for name, each in MEASURES.items()}
    other = c.build_system("double", 1)
    found["seed1"] = np.ravel([other["q0"], other["v0"]]).tolist()
    found["jansen_leg"] = with_one_step(scene("jansen_leg", {}), "baumgarte")
    found["spring"] = spring(found["pendulum"])
    found["soft"] = soft(found["pendulum"])
    found["ladders"] = ladders("double")
    return found


def scene(name, measures):
    """A system under each method."""
    system = c.build_system(name)
    return scene_of(c.this_chapter(), system, "semi_implicit", KNOBS, measures=measures)


def without_hand(scene, name):
    """A scene whose steps have no hand in them, which would be a third of their lines."""
    system = c.build_system(name)
    live = np.broadcast_to([True, True, False], system["q0"].shape)

    def step_of(method):
        def step(q, v, *knobs):
            force = c.make_methods(*knobs)[method].make_force(system)
            return c.semi_implicit_step(q, v, system["m"], force, knobs[0])

        return Program(step, live, live, scalars=len(KNOBS), names=["q", "v", *KNOBS])

    return scene | {"steps": {method: step_of(method) for method in scene["steps"]}}


def with_one_step(scene, method):
    """A scene under one method, which has no post_step: a large system's others are many lines."""
    steps = {method: scene["steps"][method]}
    return scene | {"methods": [method], "same_step": {method: method}, "steps": steps, "posts": {}}


def spring(bob):
    """A bob of 1 kg on a spring that pulls along x, under each integrator, by its name."""
    live = np.array([[True, False, False]])

    def step_of(integrator):
        def step(q, v, dt, damping, stiffness):
            def force(q, v):
                return -damping * v - stiffness * q

            return integrator(q, v, np.ones((1, 1)), force, dt)

        return Program(step, live, live, scalars=3, names=["q", "v", *SPRING])

    energy = Program(lambda q, v: 0.5 * np.sum(q * q + v * v), live, live)  # of stiffness 1, in J
    steps = {name: step_of(integrator) for name, integrator in c.INTEGRATORS.items()}
    return bob | own_steps(steps, SPRING, {"energy": energy}) | {"pairs": [], "lengths": []}


def soft(bob):
    """A bob that hangs on a rod of soft's, whose mass is a knob, too."""
    system = c.build_system("pendulum") | {"q0": np.array([[0.0, -1.0, 0.0]])}
    live = np.array([[True, True, False]])
    knobs = {"dt": KNOBS["dt"], "time_constant": KNOBS["time_constant"]}
    knobs |= {"impedance": KNOBS["impedance"], "mass": 1.0}

    def step(q, v, dt, time_constant, impedance, mass):
        m = np.array([[mass]], object)
        method = c.make_methods(dt, time_constant=time_constant, impedance=impedance)["soft"]
        return c.semi_implicit_step(q, v, m, method.make_force(system | {"m": m}), dt)

    steps = {"soft": Program(step, live, live, scalars=4, names=["q", "v", *knobs])}
    start = np.ravel([system["q0"], system["v0"]]).tolist()
    return bob | own_steps(steps, knobs, {"errors": bob["measures"]["errors"]}) | {"start": start}


def own_steps(steps, knobs, measures):
    """Those entries of a scene that say how it moves, for steps {name: Program} of its own."""
    return {
        "takes": list(knobs),
        "methods": list(steps),
        "method_of": {name: name for name in steps},
        "knobs": knobs,
        "same_step": {name: name for name in steps},
        "steps": steps,
        "posts": {},
        "measures": measures,
    }


@cache  # it takes seconds
def ladders(name):
    """The rungs of each scheme for a system: with them a figure finds what choose would.

    A rung is [its step in ms, operations for a second of motion, places, short, long, operations
    over the whole run], lengths in m. `places` is how far they are off at worst. `short` is the
    least tolerance to which it is right while places are compared; `long`, to which it stays right
    for the whole run, as do steps that are slightly shorter and half as long. None is never.
    """
    chapter = c.this_chapter()
    system = c.rods.check_system(c.build_system(name), c.PIVOT)
    search = Search(chapter, system, FINEST, KNOBS["dt"], STEPS)
    found = []
    for scheme in schemes(chapter, {}):
        search.add(Stepper(chapter, system, scheme))
        ladder = search.ladders[scheme.integrator][-1]
        rungs = [numbers(ladder, x) for x in ladder.rungs if not x.lost and x.places < COARSEST]
        row = {"integrator": scheme.integrator, "method": scheme.method, "rungs": rungs}
        found.append(row | {"name": str(scheme)})
    spans = {"seconds": search.yardstick.seconds, "whole": search.yardstick.whole}
    return {**spans, "schemes": found, "integrators": list(chapter.integrators)}


def numbers(ladder, rung):
    """What a figure knows of a Rung: see ladders."""
    yardstick = ladder.yardstick
    short = least(yardstick, rung)
    long = None
    operations = None
    if short and rung.operations * yardstick.whole <= RUN * SPAN:  # others: not for so long
        tries = [ladder.take(step, yardstick.whole) for step in (rung.dt, 0.5 * rung.dt)]
        tries += [ladder.take(rung.dt, yardstick.seconds, part) for part in PARTS]
        operations = tries[0].operations
        found = [least(yardstick, each) for each in tries]
        long = None if None in found else max(found)
    known = [1e3 * rung.dt, rung.operations, rung.places, short, long]
    known.append(operations)
    return [None if x is None else in_digits(x, 4) for x in known]


def least(yardstick, rung):
    """The least tolerance in m to which a Rung is right over its span; None if to none."""
    if rung.lost or (rung.energy is not None and rung.energy > ENERGY):
        return None
    return max(rung.rods, rung.places + yardstick.path.uncertainty)
