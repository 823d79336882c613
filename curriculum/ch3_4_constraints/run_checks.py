"""What a run is asked for, checked before it begins: a mistake is answered by a sentence."""

from collections.abc import Mapping
from numbers import Integral, Real
from types import MappingProxyType

from curriculum.ch3_4_constraints.systems import check_system, need
from curriculum.ch3_4_constraints.tables import UNHELD, say
from curriculum.common.arrays import ordered
from curriculum.common.callbacks import called, shaped
from curriculum.common.cli import meant, shorten
from curriculum.common.elimination import has_loop
from curriculum.common.tape import NoNumber, Stop, current

import numpy as np

TIED = "m", "anchors", "pairs", "lengths"  # what a force knows of its system
NUMBERS = "use_jdotv", "damping", "stiffness", "softness"  # of a Hold; of one's own, one a rod
NO_NUMBER = str, type(None)
RODS = 40  # with more, finding the truth would take longer than the run


def chosen(hold, table):
    """The Hold that is meant: itself, by its name, or by Baumgarte's w in rad/s. table(baumgarte=w)
    -> {name: Hold}. Raises ValueError if there is none of that name."""
    if hasattr(hold, "softness"):
        for name in NUMBERS:
            x = getattr(hold, name)
            endless = isinstance(x, float) and not abs(x) < np.inf
            if endless or isinstance(x, NO_NUMBER):
                said = f"the {name} of a Hold is {shorten(repr(x))}"
                raise ValueError(f"{said}; must be a finite number")
        if hold.softness < 0.0:  # it would count as none
            must = "must be >= 0; it is (1 - p) / p of an impedance p, which is at most 1"
            raise ValueError(f"the softness of a Hold is {hold.softness:g}; {must}")
        return hold
    if isinstance(hold, Real) and not isinstance(hold, bool) and 0.0 <= hold < np.inf:
        return table(baumgarte=hold)["baumgarte"]
    if not isinstance(hold, str):
        must = "must be a Hold, a mode's name, or a finite w >= 0 in rad/s"
        raise ValueError(f"hold is {shorten(repr(hold))}; {must}")
    modes = table()
    if hold not in modes:
        end = meant(hold, modes, f"; modes are {', '.join(modes)}")
        raise ValueError(f"{shorten(hold)!r} is no mode{end}")
    return modes[hold]


def own_force(function, system, q, v):
    """The forces (N, 3) in N that the reader's function(system, q, v) or function(system, q) makes.

    While a step is traced, and it writes what is made of q into an array of numbers, it is called
    again with masses of the kind of q: then f = m * g takes that, as f[0] -= v[0] does. Raises
    ValueError for another shape, and names the function's line.
    """
    try:
        made = called(function, system, q, v)
    except NoNumber:
        current.tape.refused.pop()
        masses = np.array([[x] for x in np.ravel(system["m"])], object)
        made = called(function, MappingProxyType(system | {"m": ordered(masses)}), q, v)
    made = shaped(made, q.shape, function)
    return made + current.hand(q, v) if current.hand else made


def misfit(hold, rule):
    """Why a Hold, if it is one, is nothing for the integrator of this name; None if it fits."""
    if not hold or hold.rule in (None, rule):
        return None
    why = f"does not fit {rule}"
    if hold.rule == "semi_implicit":  # a row of the reader's own may be for another
        why += ", which does not end a step at q + dt (v + dt a)"
    return f"{why}; take {hold.rule}"


def fitting(modes, holds, rule):
    """Those of the modes that fit the integrator of this name; of each other one it prints why."""
    for mode in modes:
        hold = holds[mode]
        if not hasattr(hold, "softness"):
            raise ValueError(f"{mode} is {shorten(repr(hold))} in hold_table; must be a Hold")
    reasons = {mode: misfit(holds[mode], rule) for mode in modes}
    for mode, why in reasons.items():
        if why:
            say(f"{mode} left out: it {why}")
    return [mode for mode, why in reasons.items() if not why]


def or_else(function, value):
    """function(q, v), but `value` where it raises Stop, as where a run has ended."""

    def asked(q, v):
        try:
            return function(q, v)
        except Stop:
            return value

    return asked


def watched(system, function):
    """The function, for a run to watch, or None where no rods close a loop: there tensions answer
    whatever is asked, but for rounding. Where it has no answer it is 0."""
    return or_else(function, 0.0) if has_loop(system["pairs"]) else None


def felt(system, tensions):
    """The function `tensions`(q, v) -> (C,) in N, but 0 where it finds none."""
    return or_else(tensions, 0.0 * system["lengths"])


def unsought(system, unheld, plain, table):
    """Why no truth is looked for, in words, or None. Where tensions do not answer what is asked at
    the start, all rules would agree on a motion that is not the true one. `table`: {mode: Hold}."""
    if plain:
        return "it wants compiled steps"
    if "project" not in table:
        return "hold_table has no row project, by which it is found"
    if len(system["pairs"]) > RODS:
        return f"of more than {RODS} rods it takes too long"
    watch = watched(system, unheld)
    try:
        answered = watch is None or watch(system["q0"], system["v0"]) <= UNHELD
    except Exception:  # a mistake of the reader's shows in the run itself
        return None
    return None if answered else "at the start no tensions make what is asked for"


def righted(system, project):
    """The system with its start put onto the rods, from where the truth is sought; as it is where
    project(system, q_start, q, v, dt) finds no way.

    A start may be off by what a file may round away. A step of `project` divides the way back by
    dt, so it throws the particles, and as far however short it is; one without end does not.
    """
    q, v = system["q0"], system["v0"]
    try:
        with np.errstate(all="ignore"):
            q, v = project(system, q, q, v, np.inf)
    except Exception:  # what stops it, or a mistake of the reader's, shows in the run itself
        return system
    return system | {"q0": np.array(q), "v0": np.array(v)}


def check_run(system, force, dt, steps, keep, way, step_fn, rules, anchors):
    """The system as check_system gives it; ValueError if something does not fit a run. `rules`:
    integrators by name; another step_fn is the caller's affair. `anchors` (K, 3): by default."""
    for name, given, such in (("step_fn", step_fn, "rk4_step"), ("force", force, "make_force's")):
        if not callable(given):
            raise ValueError(f"{name} is {shorten(repr(given))}; must be a function, as {such} is")
    if not callable(way):
        raise ValueError(f"way is {shorten(repr(way))}; must be Compiled or Plain, without quotes")
    hold = getattr(force, "hold", None)
    if hold and hold.dt not in (None, dt):
        other = f"not of {dt!r} s; make it of hold_table({dt!r})[mode]"
        raise ValueError(f"this force is for steps of {hold.dt:g} s, {other}")
    for name, rule in rules.items():
        if rule is step_fn and misfit(hold, name):
            raise ValueError(f"this force {misfit(hold, name)}")
    if isinstance(dt, bool) or not (isinstance(dt, Real) and 0.0 < dt < np.inf):
        raise ValueError(f"dt is {dt!r}; must be a finite number of seconds > 0")
    # a whole number of numpy's may be too short for one step more
    if not (type(steps) in (int, np.int64) and steps >= 0):
        raise ValueError(f"steps is {steps!r}; must be an int >= 0")
    if not np.iterable(keep):
        raise ValueError(f"keep is {keep!r}; must be a list of steps, or a range")
    if iter(keep) is keep:
        raise ValueError("keep can be gone through but once; must be a list, or a range")
    for x in keep:
        whole = isinstance(x, Integral) and not isinstance(x, bool)
        if not (whole and 0 <= x <= steps):
            must = f"must be steps of the run, whole numbers 0 to {steps}"
            raise ValueError(f"keep has {shorten(repr(x))}; {must}")
    system = check_system(system, anchors)
    own = getattr(force, "system", system)
    need(isinstance(own, Mapping), "the system of this force", own, "a dict, as that of the run")
    own = {"anchors": anchors, **own}
    for key in TIED:
        if not np.array_equal(own[key], system[key]):
            raise ValueError(f"this force is for another system: {key} are not those of the run")
    return system
