"""Thresholds: what is known, refused and advised is the same within a band; beyond, it is false.

A case is a function that asks for something whose truth is known without the code, and says whether
what comes back is right. BANDS has the constants, and the factors between which all cases of their
module say the same. BEYOND has what goes wrong with more or less; where it has nothing, a constant
only makes things take longer.
"""

from collections.abc import Callable
from math import cos, inf, pi, sin, sqrt
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import pytest
from independent import acceleration, energy_off, motion, smallest_pulls, weight
from machines import CRANKS, QUICK, TIED, TRIPLE, four_bar, make_system, parallelogram, row, thrown

import constraints as c
from curriculum.ch3_4_constraints.rods import choice, loops, singular, statics, truth
from curriculum.ch3_4_constraints.rods.schemes import Rung

LINE = [(0, -1), (1, 0), (1, -2)]  # a four-bar, or a cable


def word(off, allowed):
    """What is said of something that is so far off."""
    if np.isnan(off):
        return "unknown"
    return "right" if off <= allowed else "wrong"


# --- loops: the pulls of rods, in least squares ---
def pulls_on_a_line(sag, across):
    """Two rods pull at a bob between them, `sag` rad below their line: 1 N along it, `across` N."""

    def found():
        across_rods = across / sin(sag)
        expected = 0.5 * np.array([across_rods - 1.0 / cos(sag), across_rods + 1.0 / cos(sag)])
        rods = np.array([[-cos(sag), cos(sag)], [sin(sag), sin(sag)]])
        pulls = loops.least_squares(rods, np.array([1.0, across]), np.zeros(2))
        return word(np.max(np.abs(pulls - expected)) / np.max(np.abs(expected)), 0.01)

    return found


def pulls_of_one_too_many(noise):
    """Three cranks hold a triangle, one too many, by 1 N, of which a share is along no rod."""

    def found():
        rng = np.random.default_rng(0)
        jac, *_ = c.constraint_terms(TRIPLE, TRIPLE["q0"], TRIPLE["v0"])
        force = jac.T @ rng.normal(size=6)
        force = force / np.linalg.norm(force)
        other = rng.normal(size=9)
        force = force + noise * other / np.linalg.norm(other)
        pulls = -loops.least_squares(jac.T, force, np.zeros(9)) * TRIPLE["lengths"]
        expected = smallest_pulls(TRIPLE, force.reshape(3, 3))
        return word(np.max(np.abs(pulls - expected)), 1e-4)

    return found


# --- loops: the force of rods that close them ---
def force_on(system, expected=None):
    """The accelerations of a system, beside those of an SVD or what is expected, (N, 3)."""

    def found():
        a = c.make_force(system)(system["q0"], system["v0"]) / system["m"]
        known = acceleration(system, weight(system)) if expected is None else expected
        off = np.max(np.abs(a - known)) / np.max(np.abs(known) + 9.81)
        return word(off, 0.01)

    return found


def sagging(by):
    """A bob at rest between anchors 2 m apart, so many metres below their line."""
    return make_system([[1.0, -by, 0.0]], [(0, -1), (0, -2)], [[0, 0, 0], [2, 0, 0]])


def folded(left, right):
    """A four-bar of rods of 1 m, folded into a line, whose joints are thrown across it."""
    v = [[0.0, left, 0.0], [0.0, right, 0.0]]
    return make_system([[1, 0, 0], [2, 0, 0]], LINE, [[0, 0, 0], [1, 0, 0]], v)


def crank_rocker(short, angle):
    """A crank of 2 m, shorter by `short` m, at an angle (...) from the line to the other anchor.

    A rod of 3 m ties it to a rocker of 2 m, whose anchor is 3 m from the crank's. It passes a
    parallelogram's flat pose at a distance of about sqrt(short) rad. Returns where its joints are,
    (..., 2, 3) in m.
    """
    p = (2.0 - short) * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    if short == 0.0:
        r = p + [3.0, 0.0]
    else:
        to_anchor = [3.0, 0.0] - p
        distance = np.linalg.norm(to_anchor, axis=-1)[..., None]
        along = to_anchor / distance
        reach = (distance**2 + 9.0 - 4.0) / (2.0 * distance)
        left = np.stack([-along[..., 1], along[..., 0]], axis=-1)
        r = p + reach * along + np.sqrt(9.0 - reach**2) * left
    q = np.stack([p, r], axis=-2)
    return np.concatenate([q, 0.0 * q[..., :1]], axis=-1)


def turning_rocker(gap, rate, size=1.0):
    """A crank-rocker of some size, `gap` rad from its dead pose, its crank at a rate in rad/s."""
    q = crank_rocker(gap * gap, np.array(0.0))
    anchor = np.array([3.0, 0.0, 0.0])
    crank = rate * np.cross([0.0, 0.0, 1.0], q[0])
    rocker = np.cross([0.0, 0.0, 1.0], q[1] - anchor)
    coupler = q[1] - q[0]
    v = [crank, rocker * (coupler @ crank) / (coupler @ rocker)]
    anchors = [0.0 * anchor, size * anchor]
    return make_system(size * q, LINE, anchors, np.multiply(size, v))


def twisted(angle, rate, size=1.0):
    """A parallelogram near its flat pose as `project` may leave it, and its accelerations (2, 3).

    Its cranks are 1 urad apart, so that its rods are off by 1e-12 of their lengths. It should go on
    as if they were parallel, which is as a pendulum does.
    """
    angles = np.array([[angle], [angle + 1e-6]])
    along = np.concatenate([np.cos(angles), np.sin(angles), 0.0 * angles], axis=1)
    across = np.concatenate([-np.sin(angles), np.cos(angles), 0.0 * angles], axis=1)
    anchors = size * np.array([[0.0, 0.0, 0.0], [3.0, 0.0, 0.0]])
    q = anchors + 2.0 * size * along
    system = make_system(q, [(0, -1), (1, -2), (1, 0)], anchors, 2.0 * size * rate * across)
    system["lengths"] = size * np.array([2.0, 2.0, 3.0])
    return system, -2.0 * size * rate**2 * along + (c.GRAVITY @ across.T)[:, None] * across


PARALLELOGRAM = twisted(3e-6, 1.0)
SMALL = twisted(3e-6, 3000.0, 1e-6)
LIGHT = PARALLELOGRAM[0] | {"m": np.full((2, 1), 1e-3)}  # which moves as it does
HEAVY = turning_rocker(1e-3, 1.0) | {"m": np.full((2, 1), 1e3)}
LOOPS = {  # what is asked, and what is true
    "pulls at 30 urad": (pulls_on_a_line(3e-5, 1.0), "right"),
    "pulls but for 0.06 %": (pulls_on_a_line(1e-6, 6e-10), "right"),
    "pulls of 2 % of what counts": (pulls_on_a_line(1e-6, 2e-8), "unknown"),
    "pulls at 0.1 nrad": (pulls_on_a_line(1e-10, 1e-10), "unknown"),
    "pulls at 40 prad": (pulls_on_a_line(4e-11, 3e-12), "unknown"),
    "pulls on what is a line": (pulls_on_a_line(1e-12, 1e-8), "unknown"),
    "pulls of one too many": (pulls_of_one_too_many(0.0), "right"),
    "pulls and rounding": (pulls_of_one_too_many(1e-13), "right"),
    "pulls and what an impulse leaves": (pulls_of_one_too_many(1e-10), "right"),
    "a sag of 3 um": (force_on(sagging(3e-6), np.zeros((1, 3))), "right"),
    "folded flat": (force_on(folded(0.0, 0.0)), "right"),
    "near a dead pose": (force_on(turning_rocker(1e-3, 1.0)), "right"),
    "fast, near a dead pose": (force_on(turning_rocker(0.1, 1e3, 1e-6)), "right"),
    "through the flat pose": (force_on(*PARALLELOGRAM), "right"),
    "fast, through the flat pose": (force_on(*SMALL), "right"),
    "light, through the flat pose": (force_on(LIGHT, PARALLELOGRAM[1]), "right"),
    "heavy, near a dead pose": (force_on(HEAVY), "right"),
}


# --- singular: whether a motion goes through a pose in which J loses rank ---
def goes_on(q_of, system, count=40):
    """Whether it is decided how a motion q_of(t) (..., N, 3) of a system goes on, within 1 s."""

    def run(state, count, dt):
        _, start = state
        t = start + dt * np.arange(count + 1)
        return q_of(t), t

    def found():
        exact = SimpleNamespace(start=[None, 0.0], run=run)
        is_undecided = singular.is_undecided(system, exact, 1.0, count)
        return "unknown" if is_undecided else "known"

    return found


def linkage(lengths, anchors=((0.0, 0.0, 0.0), (3.0, 0.0, 0.0))):
    """What is_undecided asks of a four-bar: two cranks, and then the coupler."""
    rods = {"pairs": [(0, -1), (1, -2), (1, 0)], "lengths": np.array(lengths)}
    return rods | {"anchors": np.array(anchors), "m": np.ones((2, 1))}


def round_and_round(count, short=0.0, longer=0.0, level=0.0):
    """A crank turns once in so many steps. A coupler is longer, or an anchor higher, by some m."""
    anchors = [[0.0, 0.0, 0.0], [3.0, level, 0.0]]
    system = linkage([2.0 - short, 2.0, 3.0 + longer], anchors)
    return goes_on(lambda t: crank_rocker(short, 2.2 + 2.0 * pi * t), system, count)


def to_and_fro(amplitude, longer):
    """A parallelogram that swings about its flat pose, by an amplitude in rad."""
    system = linkage([2.0, 2.0, 3.0 + longer])
    return goes_on(lambda t: crank_rocker(0.0, amplitude * np.cos(2.0 * pi * t + 0.3)), system)


def three_cranks(off):
    """Three cranks, one too many, carry a triangle round; the third leads and lags by `off` rad."""

    def q_of(t):
        angles = 2.0 * pi * t[..., None] + off * np.sin(20.0 * t[..., None]) * [0.0, 0.0, 1.0]
        along = np.stack([np.cos(angles), np.sin(angles), 0.0 * angles], axis=-1)
        return np.array(CRANKS) + along

    sides = np.linalg.norm(np.subtract(CRANKS, np.roll(CRANKS, -1, axis=0)), axis=1)
    system = linkage([*sides, 1.0, 1.0, 1.0], CRANKS)
    return goes_on(q_of, system | {"pairs": TIED, "m": np.ones((3, 1))})


SINGULAR = {
    "one that closes": (round_and_round(40), "known"),
    "one that closes, in long steps": (round_and_round(12), "known"),
    "one that does not": (round_and_round(40, longer=1e-14), "unknown"),
    "one that does not, in long steps": (round_and_round(12, longer=1e-14), "unknown"),
    "anchors that are not level": (round_and_round(40, level=1e-6), "unknown"),
    "one that passes by 3 mrad": (round_and_round(12, short=1e-5), "known"),
    "a small swing": (to_and_fro(1e-6, 1e-14), "unknown"),
    "a small swing of one that closes": (to_and_fro(1e-6, 0.0), "known"),
    "one crank too many": (three_cranks(0.0), "known"),
    "one crank too many, and what project leaves": (three_cranks(1e-12), "known"),
}


# --- statics: whether finite tensions can hold a start ---
def stands(system):
    """Whether a start is refused."""

    def found():
        return "known" if statics.refusal(system, c.GRAVITY) is None else "refused"

    return found


def stretched(rate):
    """A rod that turns at 1 rad/s, and grows at a rate in m/s."""
    v = np.array([0.8, 0.6, 0.0]) + rate * np.array([0.6, -0.8, 0.0])
    return make_system([[0.6, -0.8, 0.0]], row(1), v=[v])


STATICS = {  # a folded four-bar unfolds if both of its joints are as fast, or the first is at rest
    "speeds of six digits": (stands(stretched(5e-7)), "known"),
    "a rod that grows": (stands(stretched(1e-4)), "refused"),
    "one that unfolds": (stands(folded(1.0, 1.0)), "known"),
    "one that unfolds, by six digits": (stands(folded(1.0, 1.000002)), "known"),
    "one that tears": (stands(folded(1.0, 1.002)), "refused"),
    "one that tears slowly": (stands(folded(1e-4, 2e-4)), "refused"),
    "a sag that the solve sees": (stands(sagging(3e-6)), "known"),
    "a sag that it does not see": (stands(sagging(1e-7)), "refused"),
}


# --- truth: whether places are known, and if so are where they should be ---
def place(system, time, expected, rounding=0.0):
    """The places after a time in s, beside all that are expected(): a list of some (N, 3).

    Their uncertainty may leave out so many metres of `rounding` elsewhere.
    """

    def found():
        known = truth.true_motion(c.this_chapter(), system, time / 20.0, 20)
        if known.q is None:
            return "unknown"
        off = max(truth.distance(known.q, q) for q in expected())
        return word(off, known.uncertainty + rounding)

    return found


def swung(speed, time, far=0.0):
    """A pendulum of 1 m, `far` m from the origin, thrown from the bottom at so many rad/s.

    Its angle is 2 am(speed t / 2, k), with k^2 = 4 g / (L speed^2).
    """
    system = make_system([[far, -1, 0]], row(1), [[far, 0, 0]], [[speed, 0, 0]])

    def expected():
        special = pytest.importorskip("scipy.special", reason="scipy is not installed")
        sn, cn, *_ = special.ellipj(0.5 * speed * time, 4.0 * 9.81 / speed**2)
        return [np.array([[2.0 * sn * cn + far, sn * sn - cn * cn, 0.0]])]

    return place(system, time, expected)


def typed(digits):
    """A pendulum whose place has so many digits: its length may be right, or the place."""
    rounded = make_system(np.round([[0.744, -0.248, 0.6204]], digits), row(1))
    moved = make_system(rounded["q0"] / rounded["lengths"], row(1))
    system = rounded | {"lengths": np.array([1.0])}
    return place(system, 0.2, lambda: [motion(x, [0.2])[-1] for x in (rounded, moved)])


def on_a_tight_line(time):
    """QUICK swings about its line as a pendulum of 10 um does, from level.

    sin(angle / 2) = k sn(K + w t, k), where k^2 = 1/2. Its rods of 1 m are rounded to 1e-16 m, and
    so these 10 um to 1e-11 m.
    """

    def expected():
        special = pytest.importorskip("scipy.special", reason="scipy is not installed")
        phase = special.ellipk(0.5) + sqrt(9.81 / 1e-5) * time
        sn, _, dn, _ = special.ellipj(phase, 0.5)
        return [1e-5 * np.array([[0.0, sn * sn - 1.0, sqrt(2.0) * sn * dn]])]

    return place(QUICK, time, expected, rounding=1e-11)


def by_its_flat_pose(time):
    """A parallelogram whose coupler is 1 cm longer, past its flat pose, where it is quick."""
    system = thrown(parallelogram(0.01))
    return place(system, time, lambda: [motion(system, [time])[-1]], rounding=1e-12)  # scipy's


TRUTH = {
    "a fast pendulum": (swung(3000.0, 0.01), "right"),
    "a pendulum far away": (swung(20.0, 0.1, 1e4), "right"),
    "one too far away": (swung(20.0, 0.1, 1e7), "unknown"),
    "a bob on a tight line": (on_a_tight_line(0.01), "right"),
    "one that gets quick": (by_its_flat_pose(0.7), "right"),
    "a place of four digits": (typed(4), "right"),
    "a place of one digit": (typed(1), "unknown"),
}


# --- choice: what is advised, of schemes whose errors are given ---
class Given(NamedTuple):
    """A scheme that is off by places(dt) and rods(dt) in m, as long as steps of dt s hold, in s."""

    places: Callable
    rods: Callable = lambda dt: 0.0
    holds: Callable = lambda dt: inf
    work: float = 100.0  # operations, of a step
    system: dict = {"lengths": [1.0]}
    scheme: SimpleNamespace = SimpleNamespace(integrator="given")
    time: float = 1e-9

    def take(self, dt, span, path, within, part):
        dt = dt * float(part)
        held = min(span, self.holds(dt))
        return Rung(
            scheme=self.scheme,
            dt=dt,
            span=span,
            places=self.places(dt),
            rods=self.rods(dt) if held == span else inf,
            energy=0.0,
            operations=self.work / dt,
            held=held,
            lost=None,
        )


def answered(*given):
    """The Answer to 1 mm for 100 s, of which the true motion is known for 2 s; steps are 2^-k s."""
    path = truth.Path(1.0 / 256.0, np.zeros((513, 1, 3)), 0.0)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(choice, "known_path", lambda *_: (path, ""))
        search = choice.Search(None, given[0].system, 1e-3, 1.0 / 128.0, 12_800)
    for stepper in given:
        search.add(stepper)
    return search.answer()


def advised(*given):
    """Whether the step that is advised is right, and so are all shorter ones, for how long."""

    def found():
        verdict = answered(*given).verdict
        if verdict is None:
            return "unknown"
        rung = verdict.rung
        shorter = rung.dt * 0.5 ** np.arange(20)
        is_right = max(map(given[0].places, shorter)) <= 1e-3
        return f"{'right' if is_right else 'wrong'} for {rung.span:g} s"

    return found


def said_of_rods(work):
    """Whether a word is said of a scheme that is right in its rods alone, with so little work."""

    def found():
        one = Given(lambda dt: 0.0 if dt < 0.01 else 1.0, lambda dt: 0.0 if dt < 0.01 else 1.0)
        other = one._replace(places=lambda dt: 1.0, work=100.0 * work)
        return "said" if answered(one, other).rods else "not said"

    return found


def by_luck(dt):
    """Right in two steps by luck, with all that are a little shorter, and below 4 ms."""
    if dt < 0.004 or 0.01 < dt < 0.04:
        return 0.0
    return 0.01 if dt < 0.01 else dt


def from_afar(dt):
    """Of fourth order, once it is off by less than the machine is large."""
    return min(0.5, (100.0 * dt) ** 4)


TIRING = [  # energy is right for 5 s, in shorter steps for 9 s, and for more work for 10 s
    Given(lambda dt: 0.01 * dt, holds=lambda dt: 5.0 if dt > 0.04 else 9.0),
    Given(lambda dt: 0.01 * dt, holds=lambda dt: 10.0, work=300.0),
]
DEAR = Given(lambda dt: 0.01 * dt, holds=lambda dt: 5.3 if dt > 0.04 else inf, work=2e5)
CHOICE = {
    "of first order": (advised(Given(lambda dt: dt)), "right for 100 s"),
    "of order one half": (advised(Given(lambda dt: 0.02 * sqrt(dt))), "right for 100 s"),
    "of fourth order": (advised(Given(from_afar)), "right for 100 s"),
    "a method that is off by 1 cm": (advised(Given(lambda dt: 0.01 + dt)), "unknown"),
    "right by luck": (advised(Given(by_luck)), "right for 100 s"),
    "for longer or for less": (advised(*TIRING), "right for 9 s"),
    "for longer, where shorter steps are tried for less": (advised(DEAR), "right for 5.2 s"),
    "rods for 70 % of the work": (said_of_rods(0.7), "said"),
    "rods for 90 % of the work": (said_of_rods(0.9), "not said"),
}

CASES = {loops: LOOPS, singular: SINGULAR, statics: STATICS, truth: TRUTH, choice: CHOICE}
EVERY = [(module, name) for module, cases in CASES.items() for name in cases]


def label(x):
    return x.__name__.rpartition(".")[-1] if hasattr(x, "__name__") else None


@pytest.mark.parametrize(("module", "case"), EVERY, ids=label)
def test_as_they_stand_what_is_said_is_true(module, case):
    ask, true = CASES[module][case]
    assert ask() == true


BANDS = [  # of a constant: the factors between which nothing that is said changes
    (loops, "SLACK", 1e-3, 10.0),
    (loops, "LOOKAHEAD", 0.3, 3.0),
    (loops, "TURN", 0.01, 3.0),
    (loops, "RIDGE", 0.1, 10.0),
    (loops, "LAST", 1e-3, 10.0),
    (loops, "UNSURE", 0.3, 3.0),
    (loops, "LOST", 0.5, 2.0),
    (loops, "NOISE", 0.2, 3.0),
    (singular, "ZERO", 0.01, 10.0),
    (singular, "NEAR", 0.1, 3.0),
    (singular, "FLAT", 0.3, 100.0),
    (statics, "STILL", 0.6, 10.0),
    (statics, "LOST", 0.3, 2.0),
    (statics, "TAUT", 0.1, 10.0),
    (truth, "FIRST", 0.1, 10.0),
    (truth, "TURN", 0.1, 10.0),
    (truth, "NEAR", 1e-3, 1e3),
    (truth, "ENOUGH", 0.01, 1e3),
    (truth, "KNOWN", 0.1, 10.0),
    (truth, "FITS", 0.1, 10.0),
    (choice, "SURE", 1.0, 3.0),
    (choice, "STALLED", 0.6, 1.4),
    (choice, "NEAR", 1e-3, 3.0),
    (choice, "FEWEST", 0.5, 4.0),
    (choice, "CHEAPER", 0.9, 1.1),
    (choice, "ABOUT", 0.75, 1.1),
]
BEYOND = [  # a factor beyond the band, and a case of which something else is said then
    (loops, "SLACK", 1e-5, "folded flat", "unknown"),
    (loops, "SLACK", 100.0, "a sag of 3 um", "wrong"),
    (loops, "LOOKAHEAD", 0.1, "through the flat pose", "wrong"),
    (loops, "LOOKAHEAD", 10.0, "near a dead pose", "wrong"),
    (loops, "TURN", 1e-3, "fast, through the flat pose", "wrong"),
    (loops, "TURN", 10.0, "fast, near a dead pose", "wrong"),
    (loops, "RIDGE", 1e-4, "pulls of one too many", "wrong"),
    (loops, "RIDGE", 100.0, "pulls at 30 urad", "unknown"),
    (loops, "LAST", 1e3, "pulls at 40 prad", "wrong"),
    (loops, "UNSURE", 0.1, "pulls but for 0.06 %", "unknown"),
    (loops, "UNSURE", 10.0, "pulls of 2 % of what counts", "wrong"),
    (loops, "LOST", 0.1, "pulls and rounding", "unknown"),
    (loops, "LOST", 10.0, "pulls at 40 prad", "wrong"),
    (loops, "NOISE", 0.01, "pulls and what an impulse leaves", "unknown"),
    (loops, "NOISE", 10.0, "pulls on what is a line", "wrong"),
    (singular, "ZERO", 1e-5, "one crank too many, and what project leaves", "unknown"),
    (singular, "ZERO", 100.0, "a small swing", "known"),
    (singular, "NEAR", 0.01, "one that does not, in long steps", "known"),
    (singular, "NEAR", 5.0, "one that passes by 3 mrad", "unknown"),
    (singular, "FLAT", 0.1, "one that closes, in long steps", "unknown"),
    (statics, "STILL", 0.1, "speeds of six digits", "refused"),
    (statics, "STILL", 100.0, "a rod that grows", "known"),
    (statics, "STILL", 100.0, "one that tears slowly", "known"),
    (statics, "LOST", 0.1, "a sag that it does not see", "known"),
    (statics, "LOST", 10.0, "a sag that the solve sees", "refused"),
    (statics, "TAUT", 0.01, "one that unfolds, by six digits", "refused"),
    (statics, "TAUT", 100.0, "one that tears", "known"),
    (truth, "FIRST", 1e-3, "a pendulum far away", "unknown"),
    (truth, "TURN", 1e-3, "a pendulum far away", "unknown"),
    (truth, "KNOWN", 1e-4, "a fast pendulum", "unknown"),
    (truth, "KNOWN", 100.0, "one too far away", "right"),  # as far as it then says
    (truth, "FITS", 0.01, "a place of four digits", "unknown"),
    (truth, "FITS", 100.0, "a place of one digit", "right"),
    (choice, "SURE", 0.7, "right by luck", "wrong for 100 s"),
    (choice, "STALLED", 0.4, "of order one half", "unknown"),
    (choice, "STALLED", 0.15, "of first order", "unknown"),
    (choice, "NEAR", 10.0, "of fourth order", "unknown"),
    (choice, "CHEAPER", 0.8, "rods for 70 % of the work", "not said"),
    (choice, "CHEAPER", 1.2, "rods for 90 % of the work", "said"),
    (choice, "ABOUT", 0.6, "for longer or for less", "right for 5 s"),
    (choice, "ABOUT", 1.2, "for longer or for less", "right for 10 s"),
]
ENDS = [(module, name, factor) for module, name, *ends in BANDS for factor in ends]


def scale(monkeypatch, module, name, factor):
    value = getattr(module, name)
    monkeypatch.setattr(module, name, type(value)(factor * value))


@pytest.mark.parametrize(("module", "name", "factor"), ENDS, ids=label)
def test_within_its_band_a_constant_changes_nothing_that_is_said(module, name, factor, monkeypatch):
    scale(monkeypatch, module, name, factor)
    said = {case: ask() for case, (ask, _) in CASES[module].items()}
    assert said == {case: true for case, (_, true) in CASES[module].items()}


@pytest.mark.filterwarnings("ignore:invalid value")  # of 0 / 0
@pytest.mark.parametrize(("module", "name", "factor", "case", "what"), BEYOND, ids=label)
def test_beyond_its_band_something_else_is_said(module, name, factor, case, what, monkeypatch):
    scale(monkeypatch, module, name, factor)
    ask, true = CASES[module][case]
    assert what != true
    assert ask() == what


# --- budgets: with less work less is known, and nothing else ---
BUDGETS = [  # a tenth, or as good as nothing
    (loops, "ROUNDS", 10),
    (loops, "RIDGE_ROUNDS", 4),
    (singular, "LEVELS", 1),
    (singular, "PARTS", 2),
    (truth, "COUNTS", (2, 3)),
    (truth, "MOST_STEPS", 2000),
    (truth, "STEPS", 80),
    (truth, "DIVIDED", 2),
    (truth, "PARTS", (2, 3)),
    (choice, "HALVED", 0),
    (choice, "TIMES", 64),
    (choice, "WORK", 2.5e6),
    (choice, "MORE", 1e7),
    (choice, "RODS", 1e7),
    (choice, "RUN", 0.0015),  # of SPAN
]


@pytest.mark.parametrize(("module", "name", "value"), BUDGETS, ids=label)
def test_a_smaller_budget_leaves_unknown_what_it_does_not_find(module, name, value, monkeypatch):
    monkeypatch.setattr(module, name, value)
    for ask, true in CASES[module].values():
        said = ask()
        assert said in {true, "unknown", "not said"} or said.startswith("right for")


CHOSEN = {  # what is neither: units, what an answer is about, and what is not asked for
    (truth, "EARTH"),
    (truth, "HORIZON"),
    (truth, "MAX_RODS"),
    (truth, "WHOLE"),
    (choice, "ENERGY"),
    (choice, "PARTS"),
    (choice, "SPAN"),  # RUN is a share of it
}


def test_each_constant_has_a_band_or_is_a_budget_or_a_choice():
    named = {(module, name) for module in CASES for name in vars(module) if name.isupper()}
    assert named == {(module, name) for module, name, *_ in [*BANDS, *BUDGETS]} | CHOSEN


def test_what_is_advised_for_a_tenth_of_the_work_is_right_too(monkeypatch):
    """For as long as it says, not for all of 20 s; an integrator that needs more has no answer."""
    for module, name, value in BUDGETS:
        monkeypatch.setattr(module, name, value)
    chapter = c.this_chapter()._replace(integrators={"rk4": c.rk4_step, "euler": c.euler_step})
    for system, within in ((c.build_system("double"), 1e-4), (four_bar(), 1e-5)):
        answer = choice.choose(chapter, system, within, 0.005, 4000, {})
        (found,) = answer.rows
        (missing,) = answer.missing
        assert missing.integrator == "euler" and missing.best.places > within
        rung = found.rung
        assert answer.seconds <= rung.span < 20.0
        states = 1 + int(answer.seconds / rung.dt + 1e-6)
        known = motion(system, rung.dt * np.arange(states))
        for parts in (1, 2):
            dt = rung.dt / parts
            run = c.run_method(system, rung.scheme.method, "rk4", dt, parts * rung.steps)
            off = np.linalg.norm(run.q[::parts][:states] - known, axis=2)
            assert max(np.max(off), np.max(run.violations)) <= within
            assert energy_off(system, run.q, run.v) <= 0.05
