"""The constraint force, of few rods and many: what it must bring about, and what no force can."""

import math
from functools import partial, wraps
from itertools import product

import constraints as c
from curriculum.ch3_4_constraints.solving import INSTANT, TURN, turned
from curriculum.ch3_4_constraints.studies._runs import make_system, run
from curriculum.ch3_4_constraints.tables import UNHELD
from curriculum.common.crowds import mapped
from curriculum.common.elimination import LinearSystem, refined

import numpy as np
import pytest

TABLE = c.hold_table(dt=0.005)
DOUBLE = c.build_system("double")


def assert_close(a, b, tolerance=1e-12):
    assert np.abs(a - b).max() <= tolerance * max(1.0, np.abs(b).max())


def row(n):
    return [(k, k - 1) for k in range(n)]


def tree(n, loops=0):
    """Two rods hang on each particle, the first on an anchor; others close so many loops."""
    return [(k, (k - 1) // 2) for k in range(n)] + [(n - 1, -2), *row(n)[2::2]][:loops]


def moving(pairs, short=0.0, loose=0):
    """Random masses, points and velocities; `short`: the share that all rods lack."""
    rng, n = np.random.default_rng(3), 1 + max(pairs)[0] + loose
    points, v, anchors = (rng.normal(size=(k, 3)) for k in (n, n, 2))
    system = make_system(n ** (1 / 3) * points, v, rng.uniform(0.1, 10.0, n), pairs, None, anchors)
    return system | {"lengths": (1.0 - short) * system["lengths"]}


@pytest.mark.parametrize("asked", [*TABLE, 20.0, 0.0])
def test_rods_accelerate_as_the_hold_asks(asked, monkeypatch):
    """Chains, trees and loops, on the rods and off them; a number is a Baumgarte frequency."""
    calls, hold = [], TABLE[{20.0: "baumgarte", 0.0: "none"}.get(asked, asked)]

    def drag(system, q, v=None):
        calls.append(1)
        return system["m"] * c.GRAVITY - 0.3 * v

    monkeypatch.setattr(c, "external_force", drag)
    for pairs, short in product([row(1), row(2), row(7), tree(7), tree(7, 2)], (0.0, 0.02)):
        system = moving(pairs, short)
        q, v, w = system["q0"], system["v0"], np.repeat(1.0 / system["m"][:, 0], 3)
        calls.clear()
        force = c.make_force(system, TABLE.get(asked, asked))(q, v)
        assert len(calls) == 1  # a force may be noise: what is applied is what the rods answer
        (jac, g, gdot, jdotv), off = c.constraint_terms(system, q, v), c.rod_errors(system, q)
        lam = -c.tensions(system, q, v, hold) / (off + system["lengths"])
        assert_close(jac.T @ lam, (force - drag(system, q, v)).ravel(), 1e-11)
        if hold.softness:  # g is as MuJoCo defines it
            g = off * (off + system["lengths"])
        gddot = jac @ (w * force.ravel()) + hold.use_jdotv * jdotv
        gives = hold.softness * np.sum(jac * w * jac, axis=1) * lam
        assert_close(gddot + gives, -hold.damping * gdot - hold.stiffness * g, 1e-11)


class Weight:
    def __call__(self, system, q):
        return system["m"] * c.GRAVITY

    def of(self, system, q):
        return self(system, q)

    @staticmethod
    def times(k, system, q, v):
        return k * system["m"] * c.GRAVITY


WRITTEN = [  # as the course has it: without v, as a list, or as one row for all
    Weight(),
    Weight().of,
    partial(Weight.times, 1.0),
    lambda system, q, k=1.0: k * system["m"] * c.GRAVITY,
    lambda system, q, k=1.0, v=None: k * system["m"] * c.GRAVITY + 0.0 * v,
    lambda system, q, *, v=None: system["m"] * c.GRAVITY + 0.0 * v,
    lambda system, q, v=None, /: system["m"] * c.GRAVITY + 0.0 * v,
    wraps(c.external_force)(lambda *state: state[0]["m"] * c.GRAVITY + 0.0 * state[2]),
    lambda system, q: system["m"] * c.GRAVITY,
    lambda system, q, v: [0.0, -9.81, 0.0],
    lambda *state: c.GRAVITY.tolist(),
]


def test_a_force_may_be_written_in_other_ways_and_one_that_does_not_fit_is_told(monkeypatch):
    state = DOUBLE, DOUBLE["q0"], DOUBLE["v0"]
    expected, tip = c.constraint_force(*state), run(DOUBLE, steps=5).tip
    for force in WRITTEN:
        monkeypatch.setattr(c, "external_force", force)
        assert np.array_equal(c.constraint_force(*state), expected)
        found = run(DOUBLE, steps=5)
        assert found.how.startswith("compiled") and np.array_equal(found.tip, tip)
    wrongs = [(np.zeros((2, 2)), r"lambda> \(test_force.py, line \d+\): an array of shape \(2, 2")]
    wrongs += [(DOUBLE["m"], r"shape \(2, 1\), must be"), (1j * DOUBLE["q0"], "complex numbers")]
    wrongs += [(None, "None wh"), (-9.81, r"shape \(\), must be \(2, 3\)")]
    for wrong, said in wrongs:
        monkeypatch.setattr(c, "external_force", lambda *_, wrong=wrong: wrong)
        with pytest.raises(ValueError, match=said):
            c.constraint_force(*state)


def test_a_state_may_be_lists_and_one_of_another_shape_is_told():
    q, v = DOUBLE["q0"], DOUBLE["v0"] + [0.0, 0.5, 0.0]
    typed = DOUBLE | {"m": [[1], [1]]}
    asked = [c.energy, c.constraint_force, c.tensions, c.unheld]
    asked.append(lambda *state: c.constraint_terms(*state)[0])
    asked += [lambda *state, of=of: of(*state[:2]) for of in (c.rod_errors, c.constraint_violation)]
    for function in asked:
        assert np.array_equal(function(typed, q.tolist(), v.tolist()), function(DOUBLE, q, v))
        with pytest.raises(ValueError, match=r"shape \(1, 3\); must be \(2, 3\)"):
            function(DOUBLE, q[:1], v[:1])


def test_a_system_may_be_lists_and_one_of_another_shape_is_told():
    """Numpy would put a lone anchor [x, y, z] at (x, x, x), and ask each length of all rods."""
    q, typed = DOUBLE["q0"], {key: np.asarray(x).tolist() for key, x in DOUBLE.items()}
    asked = [c.energy, c.constraint_force, c.tensions, c.unheld]
    asked.append(lambda system, q, v: c.make_force(system, "none")(q, v))
    asked.append(lambda system, q, _: c.rod_errors(system, q))
    wrong = [("anchors", 3), ("anchors", (1, 1)), ("m", 2), ("m", ())]
    wrong += [("lengths", (2, 1)), ("lengths", ()), ("lengths", 1)]
    for function in asked:
        assert np.array_equal(function(typed, q, q), function(DOUBLE, q, q))
        for key, shape in wrong:
            with pytest.raises(ValueError, match=rf"{key} has the shape \(.*\), must have \("):
                function(DOUBLE | {key: np.ones(shape)}, q, q)


@pytest.mark.parametrize("kind", [np.float32, np.int8])
def test_lengths_of_a_short_type_are_squared_in_full(kind):
    short = DOUBLE | {"lengths": np.array([20.1, 30.1]).astype(kind)}
    full = short | {"lengths": short["lengths"].astype(float)}
    for hold in TABLE:
        force, expected = (c.constraint_force(x, x["q0"], x["v0"], hold) for x in (short, full))
        assert np.array_equal(force, expected)


def test_jacobian_is_the_derivative_of_g():
    system, eps = moving(tree(5, 2)), 1e-6
    q, v = system["q0"], system["v0"]
    jac, _, gdot, jdotv = c.constraint_terms(system, q, v)
    ahead, behind = (c.constraint_terms(system, q + s * eps * v, v) for s in (1.0, -1.0))
    assert_close((ahead[1] - behind[1]) / (2 * eps), gdot, 1e-8)
    assert_close(jac @ v.ravel(), gdot)
    assert_close((ahead[0] - behind[0]) @ v.ravel() / (2 * eps), jdotv, 1e-8)


def test_a_function_of_one_state_is_mapped_over_many(monkeypatch):
    """Each gives what it gives alone, to the last bit; also where a force branches."""
    system, rng = moving(tree(5, 2), 0.01), np.random.default_rng(5)
    q = system["q0"] + 1e-3 * rng.normal(size=(4, *system["q0"].shape))
    v = rng.normal(size=q.shape)

    def everything(q, v):
        found = [*c.constraint_terms(system, q, v), c.energy(system, q, v)]
        found += [*c.project(system, system["q0"], q, v, 0.01), c.constraint_violation(system, q)]
        asked = product((c.constraint_force, c.tensions), TABLE.values())
        return *found, *(function(system, q, v, hold) for function, hold in asked)

    forces = [lambda s, q, v: -v, lambda s, q, v: v if v[1, 0] > 0.0 else -v]
    first = mapped(everything)
    for force, mapping in ((forces[0], first), (forces[1], mapped(everything)), (forces[1], first)):
        monkeypatch.setattr(c, "external_force", force)
        many = mapping(q, v)
        for k in range(4):
            alone = everything(q[k], v[k])
            assert all(np.array_equal(x[k], y) for x, y in zip(many, alone, strict=True))
    off = mapped(partial(c.rod_errors, system))(q, v)  # it takes no v
    assert np.array_equal(off, [c.rod_errors(system, x) for x in q])


def hung(q, pairs, anchors, v=0.0, m=1.0):
    """Points on rods, at rest and of 1 kg unless told."""
    q = np.array(q, float)
    return make_system(q, v + 0.0 * q, m + 0.0 * q[:, 0], pairs, None, anchors)


def tight_cable(rods, slack, masses, sway):
    """Unit rods that hang at rest between level anchors, longer than their span by `slack`, nearly;
    or that sway out of their plane. Then masses by turns, 1 and `masses`."""
    lifts, bobs = np.arange(rods) - 0.5 * (rods - 1), np.arange(1, rods)
    level = np.sqrt(np.mean(lifts * lifts) / (2.0 * slack))  # a rod's pull, in a bob's weights
    links = np.stack([np.full(rods, level), lifts, 0.0 * lifts], axis=-1)
    *q, end = np.cumsum(links / np.hypot(level, lifts)[:, None], axis=0)
    v = np.outer(sway * np.sin(np.pi * bobs / rods), [0.0, 0.0, 1.0])  # so that J v = 0
    pairs = [*row(rods - 1), (rods - 2, -2)]
    return hung(q, pairs, [0.0 * end, end], v, np.where(bobs % 2, 1.0, masses))


def cantilever(bays):
    """Two nodes a bay, held at the left; of a bay's two diagonals one is too many."""
    n = 2 * bays
    q = [[t // 2 + 1.0, 1.0 - t % 2, 0.0] for t in range(n)]
    rods = [(t, t - 2) for t in range(n)] + [(t, t - 3) for t in range(1, n, 2)]
    return hung(q, [*rods, *row(n)], [(0.0, 0.0, 0.0), (0.0, 1.0, 0.0)])


def nearly_level(sag, fast=None):
    """A bob at rest, so far in m under the middle of two anchors, on rods of 1 m, nearly; and
    another, on a `fast` rod that ties it to this one, 0, or to an anchor, -3."""
    others = {0: [[1, -1 - sag, 0]], -3: [[100, -1, 0]]}.get(fast, [])
    v = np.outer(np.arange(1 + len(others)), [3.0, 0.0, 0.0])  # m/s
    rods = [(0, -1), (0, -2), (1, fast)][: 2 + len(others)]
    return hung([[1, -sag, 0], *others], rods, [[0, 0, 0], [2, 0, 0], [100, 0, 0]], v)


def beside_a_square(bob, pair):
    """A fast rod, which turns a radian in a tenth of a millisecond, beside a diagonal too many."""
    frame = [(0, -1), (1, 0), (2, 1), (2, -1), (1, -1), (2, 0)]
    q = [[0, -1, 0], [1, -1, 0], [1, 0, 0], bob]
    return hung(q, [*frame, pair], [[0, 0, 0], [50, 0, 0]], np.outer([0, 0, 0, 1e4], [1, 0, 0]))


NEEDED = [tight_cable(*x) for x in product((12, 150), (1e-3, 3e-6), (1.0, 1e3), (0.0, 0.1))]
NEEDED += [tight_cable(66, 1e-7, 1.0, 0.0), tight_cable(150, 1e-9, 1.0, 0.0)]
NEEDED += [tight_cable(12, 1e-12, 1e3, 0.0), cantilever(30)]
TONNE = c.build_system("tonne")  # a rod too many
NEEDED += [TONNE, TONNE | {"m": TONNE["m"] ** 2}]
NEEDED += [nearly_level(*x) for x in ((1e-7,), (2e-8,), (1e-7, 0), (1e-7, -3))]
NEEDED += [beside_a_square([50, -1, 0], (3, -2)), beside_a_square([1, -2, 0], (3, 1))]
NET = [[1, -1e-7, 0], [2, -2e-7, 0], [3, -1e-7, 0], [2, -3e-7, 1], [2, -3e-7, -1]]
CORDS = [(0, -1), (1, 0), (2, 1), (2, -2), (3, -3), (3, 1), (4, 1), (4, -4)]  # two, that cross
CORNERS = [[0, 0, 0], [4, 0, 0], [2, 0, 2], [2, 0, -2]]
NEEDED.append(hung(NET, CORDS, CORNERS, m=np.arange(1.0, 6.0)))
LOST = [nearly_level(1e-8, fast) for fast in (None, 0, -3)]  # A is as good as singular


@pytest.mark.parametrize(("system", "met"), [*product(NEEDED, [True]), *product(LOST, [False])])
def test_a_tension_that_is_needed_is_found_or_told(system, met):
    """However small the eigenvalue that carries it: against an SVD of J M^-1/2. A fast rod does not
    hide what a slow one lacks."""
    q, v, w = system["q0"], system["v0"], np.repeat(np.sqrt(1.0 / system["m"][:, 0]), 3)
    jac, _, gdot, jdotv = c.constraint_terms(system, q, v)
    size, free = np.linalg.norm(jac * w, axis=1), np.tile(c.GRAVITY, len(q)) / w
    rows = jac * w / size[:, None]
    away, _, rank, sizes = np.linalg.lstsq(rows, -rows @ free - jdotv / size, rcond=1e-11)
    a, condition = w * (free + away), sizes[0] / sizes[rank - 1]  # of J: A has its square
    off = np.abs(c.make_force(system, 0.0)(q, v) / system["m"] - a.reshape(-1, 3)).max()
    assert np.abs(gdot).max() < 1e-15
    assert met == (off <= max(1e-9, 1e-15 * condition) * max(9.81, np.abs(a).max()))
    unheld = c.unheld(system, q, v)
    assert unheld < 1e-6 if met else unheld > UNHELD


def test_what_no_tension_can_hold_is_let_go_and_told():
    """Windows at their flat pose, a bar 1e-6 off: an exact solve would tear at it by 1 / angle."""
    system, angle = c.build_system("windows"), 1e-5 + 1e-6 * (np.arange(11) == 4)
    out = np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=-1)
    q, v = system["anchors"] + out, 4.0 * np.cross([0.0, 0.0, 1.0], out)
    assert_close(c.constraint_force(system, q, v) / system["m"], -16.0 * out, 1e-4)  # they fall
    assert 1e-12 < c.unheld(system, q, v) < 1e-3
    bob, sideways = nearly_level(1e-7), np.array([[0.0, 0.0, 1e-3]])  # m/s, so that A < T
    assert c.make_force(bob, "none")(bob["q0"], sideways)[0, 1] < -9.0  # N: not held by halves


@pytest.mark.parametrize(("mode", "left"), [("none", 1.0), ("soft", 0.0)])
def test_what_tensions_leave_unanswered_is_measured(mode, left):
    """A bob between two rods in line moves across them: none asks both to shorten, soft lets go.
    The rod beside them lacks nothing: the worst one counts."""
    level = nearly_level(0.0, -3)
    v = level["v0"] + [[0.0, 1.0, 0.0], [0.0, 0.0, 0.0]]
    assert_close(c.unheld(level, level["q0"], v, mode), left, 1e-6)


@pytest.mark.parametrize("stays", [1e-4, 0.2, 0.4, 0.51])
def test_rounds_of_refinement_end_where_1e_15_is_left_or_over_half_of_what_was(stays):
    rounds, b = [], np.array([1.0, 2.0])

    def rough(left):  # this share of it stays
        rounds.append(left)
        return left * (1.0 - stays)

    x, left = refined(LinearSystem(lambda x: x, np.ones(2), b, rough, 0.0, "no end"))
    enough = 1 if stays > 0.5 else math.ceil(math.log(1e-15, stays))
    assert len(rounds) == enough + 1  # the last one finds that it is enough
    assert np.allclose([left, x], [stays**enough * b, b - left], rtol=1e-12)


@pytest.mark.parametrize("mode", ["none", "baumgarte", "impulse", "project"])
def test_a_bob_that_hardly_sags_stays_where_it_is(mode):
    """Its rods pull with 4.9e7 N each; A has the square of 1e-7, beside 1, and J has it itself."""
    system = nearly_level(1e-7)
    pulls = c.tensions(system, system["q0"], system["v0"])
    assert pulls == pytest.approx([9.81 / 2e-7] * 2, rel=1e-13)
    found = run(system, "semi_implicit", mode, 0.005, 400)
    assert not found.stopped and np.abs(found.tip - found.tip[0]).max() < 1e-8


def test_a_loop_is_blurred_by_what_its_rods_turn_in_an_instant_and_by_no_more_than_a_turn():
    system = moving(tree(7, 2))
    q, v, m = system["q0"], system["v0"], np.repeat(system["m"][:, 0], 3)
    now, ahead = (c.constraint_terms(system, x, v)[0] for x in (q, q + INSTANT * v))
    gained = ahead - now
    assert np.allclose(turned(system, v), (gained / m) @ gained.T, rtol=0.03, atol=1e-12)
    share = [sum(1.0 / system["m"][i, 0] for i in pair if i >= 0) for pair in system["pairs"]]
    fast = np.diag(turned(system, 1e9 * v))
    assert np.allclose(fast, (TURN * system["lengths"]) ** 2 * share, rtol=1e-6)


def test_many_rods_find_their_way_back_or_stay_put_and_a_loose_particle_falls():
    """A wheel whose rods all feel each other, a tree with loops, a chain, in compiled steps; and a
    braced truss: with less slack, what rounding leaves between its rods blows up."""
    wheel = [(0, -1), *((k, 0) for k in range(1, 12)), *row(12)[2:]]
    for pairs in (wheel, tree(40, 8), row(60)):
        system = moving(pairs, loose=1)
        q, v = c.project(system, system["q0"], system["q0"], 1e-3 * system["v0"], 1.0)
        found = run(system | {"q0": q, "v0": v}, "rk4", "project", 1e-3, 20)
        assert found.violations.max() < 1e-10 and found.how.startswith("compiled")
        assert_close(found.v[-1, -1], v[-1] + 0.02 * c.GRAVITY)
    assert run(cantilever(20), steps=40).violations.max() < 1e-8
