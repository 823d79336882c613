"""The constraint force, by two other ways of finding it."""

from itertools import product

import constraints as c
from curriculum.ch3_4_constraints.studies._runs import make_system, scene

import numpy as np
import pytest

TABLE = c.hold_table(dt=0.005)


def random_chain(rng, n, off_length=0.0):
    """A chain in space, random masses and directions; rods are `off_length` longer than right."""
    d = rng.normal(size=(n, 3))
    lengths = np.linalg.norm(d, axis=1)
    q = np.cumsum(d * (1.0 + off_length / lengths[:, None]), axis=0) + 0.5
    pairs = [(k, k - 1) for k in range(n)]
    v, m = rng.normal(size=(n, 3)), rng.uniform(0.1, 10.0, n)
    return make_system(q, v, m, pairs, lengths, [[0.5, 0.5, 0.5]])


def random_linkage(rng, n, rods, off_length=0.0):
    """A connected graph with two anchors: a spanning tree and `rods` more rods at random."""
    points, anchors = rng.normal(size=(n, 3)) * n ** (1 / 3), rng.normal(size=(2, 3))
    pairs = [(0, -1)] + [(k, int(rng.integers(-2, k))) for k in range(1, n)]
    free = [(i, j) for i in range(n) for j in range(-2, i) if (i, j) not in pairs]
    pairs += [free[k] for k in rng.choice(len(free), rods, replace=False)]
    ends = np.concatenate([points, anchors[::-1]])
    lengths = [np.linalg.norm(ends[i] - ends[j]) - off_length for i, j in pairs]
    v, m = rng.normal(size=(n, 3)), rng.uniform(0.1, 10.0, n)
    return make_system(points, v, m, pairs, lengths, anchors)


def textbook_force(system, q, v, hold):
    """J^T lambda by the matrices and LAPACK; soft's position error as MuJoCo defines it."""
    jac, g, gdot, jdotv = c.constraint_terms(system, q, v)
    if hold.softness:
        length = np.sqrt(2.0 * g + system["lengths"] ** 2)
        g = length * (length - system["lengths"])
    w = np.repeat(1.0 / system["m"][:, 0], 3)
    a = (jac * w) @ jac.T
    applied = np.broadcast_to(c.external_force(system, q, v), q.shape).ravel()
    rhs = -(jac @ (w * applied) + hold.use_jdotv * jdotv) - hold.damping * gdot - hold.stiffness * g
    return (jac.T @ np.linalg.solve(a + hold.softness * np.diag(np.diag(a)), rhs)).reshape(-1, 3)


def assert_close(a, b, tolerance=1e-12):
    assert np.abs(a - b).max() <= tolerance * max(1.0, np.abs(b).max())


@pytest.mark.parametrize("mode", TABLE)
def test_force_solves_the_explicit_system(mode):
    """Chains, trees and loops, on the rods and off them."""
    rng = np.random.default_rng(1)
    cases = [(random_chain(rng, n, off), 1e-12) for n in (1, 2, 7) for off in (0.0, 0.02)]
    cases += [(random_linkage(rng, 7, rods, 0.02), 1e-11) for rods in (0, 2)]
    for system, tolerance in cases:
        case = system, system["q0"], system["v0"], TABLE[mode]
        assert_close(c.constraint_force(*case), textbook_force(*case), tolerance)


def test_jacobian_is_the_derivative_of_g():
    system = random_linkage(np.random.default_rng(1), 5, 2)
    q, v, eps = system["q0"], system["v0"], 1e-6
    jac, _, gdot, jdotv = c.constraint_terms(system, q, v)
    ahead, behind = (c.constraint_terms(system, q + s * eps * v, v) for s in (1.0, -1.0))
    assert_close((ahead[1] - behind[1]) / (2 * eps), gdot, 1e-8)
    assert_close(jac @ v.ravel(), gdot)
    assert_close((ahead[0] - behind[0]) @ v.ravel() / (2 * eps), jdotv, 1e-8)


@pytest.mark.parametrize("mode", TABLE)
def test_leading_axes_are_separate_runs(mode):
    """Everything takes (..., N, 3): a stack of states gives the stack of what each gives alone."""
    rng = np.random.default_rng(5)
    for system in (random_chain(rng, 3, 0.01), random_linkage(rng, 5, 2, 0.01)):
        q = system["q0"] + 1e-3 * rng.normal(size=(2, 4, *system["q0"].shape))
        v = rng.normal(size=q.shape)

        def everything(q, v, system=system):
            found = *c.constraint_terms(system, q, v), c.tensions(system, q, v, TABLE[mode])
            found += c.constraint_force(system, q, v, TABLE[mode]), c.energy(system, q, v)
            ended = c.project(system, system["q0"] + 0.0 * q, q, v, 0.01)
            return *found, c.constraint_violation(system, q), *ended

        for i, j in np.ndindex(2, 4):
            for many, single in zip(everything(q, v), everything(q[i, j], v[i, j]), strict=True):
                assert_close(many[i, j], single, 1e-9)


@pytest.mark.parametrize("seed", range(10))
def test_rods_act_in_pairs_and_do_no_work(seed):
    """So they push no free body and turn it no way, nor a chain about its pivot."""
    rng = np.random.default_rng(seed)
    free, chain = random_linkage(rng, 6, seed % 4), random_chain(rng, 6)
    inner = [k for k, (_, j) in enumerate(free["pairs"]) if j >= 0]
    free |= {"pairs": [free["pairs"][k] for k in inner], "lengths": free["lengths"][inner]}
    for system, arm in ((free, free["q0"]), (chain, chain["q0"] - chain["anchors"][0])):
        q, v = system["q0"], system["v0"]
        jac = c.constraint_terms(system, q, v)[0]
        v = (v.ravel() - np.linalg.pinv(jac) @ jac @ v.ravel()).reshape(-1, 3)  # as rods allow
        force = c.constraint_force(system, q, v, TABLE["none"])
        scale = np.abs(force).max() * np.abs(arm).max()
        assert abs(np.sum(force * v)) < 1e-9 * scale
        assert np.abs(np.cross(arm, force).sum(axis=0)).max() < 1e-9 * scale
        assert system is chain or np.abs(force.sum(axis=0)).max() < 1e-9 * scale


def tight_cable(rods, sag, masses):
    """Rods on a circle's arc between anchors a metre apart, masses 1 and `masses` by turns."""
    radius = (0.25 + sag * sag) / (2.0 * sag)
    turn = np.arcsin(0.5 / radius) * np.linspace(-1.0, 1.0, rods + 1)
    q = radius * np.stack([np.sin(turn), -np.cos(turn), 0.0 * turn], axis=-1)
    m = np.where(np.arange(rods - 1) % 2, masses, 1.0)
    pairs = [(0, -1), *((k, k - 1) for k in range(1, rods - 1)), (rods - 2, -2)]
    return make_system(q[1:-1], np.zeros((rods - 1, 3)), m, pairs, None, q[[0, -1]])


def cantilever(bays):
    """Two nodes a bay, each bay with a diagonal, all held at the left."""
    q = [[k + 1.0, 1.0 - half, 0.0] for k in range(bays) for half in (0, 1)]
    rods = [((t, t - 2), (t + 1, t - 1), (t + 1, t - 2), (t + 1, t)) for t in range(0, 2 * bays, 2)]
    anchors, m = [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]], np.ones(2 * bays)  # -1 is the lower one
    return make_system(q, np.zeros((2 * bays, 3)), m, sum(rods, ()), None, anchors)


CABLES = product((12, 66, 150), (0.02, 0.001), (1.0, 1000.0))  # rods, sag in m, masses
NEEDED = [tight_cable(*cable) for cable in CABLES]
TONNE = scene("tonne")  # hangs on a brace too many; a thousand of them, too
NEEDED += [TONNE, TONNE | {"m": TONNE["m"] ** 2}, cantilever(30)]


@pytest.mark.parametrize("sway", [0.0, 0.1])
@pytest.mark.parametrize("system", NEEDED)
def test_no_tension_is_cut_off_that_is_needed(system, sway):
    """However small the eigenvalue that carries it: against an SVD of J M^-1/2; cables sway."""
    q, w = system["q0"], np.repeat(np.sqrt(1.0 / system["m"][:, 0]), 3)
    sway *= len(system["pairs"]) == len(q) + 1  # a cable: out of its plane, so that J v = 0
    v = sway * np.cos(np.pi * q[:, :1]) * [0.0, 0.0, 1.0]
    jac, _, gdot, jdotv = c.constraint_terms(system, q, v)
    size = np.linalg.norm(jac * w, axis=1)
    left, s, right = np.linalg.svd(jac * w / size[:, None], full_matrices=False)
    left, s, right = left[:, s > 1e-11], s[s > 1e-11], right[s > 1e-11]
    free = np.tile(c.GRAVITY, len(q)) / w
    a = w * (free - right.T @ (right @ free + left.T @ (jdotv / size) / s))
    off = np.abs(c.make_force(system, 0.0)(q, v) / system["m"] - a.reshape(-1, 3)).max()
    assert np.abs(gdot).max() < 1e-15
    assert off <= max(1e-9, 1e-15 * (s[0] / s[-1]) ** 2) * max(9.81, np.abs(a).max())
    assert c.unheld(system, q, v, 0.0) < 1e-7


def test_what_no_tension_can_hold_is_let_go_and_told():
    """Windows at their flat pose, a bar 1e-6 off: an exact solve would tear at it by 1 / angle."""
    system = scene("windows")
    angle = np.full((11, 1), 1e-5) + 1e-6 * (np.arange(11.0) == 4.0)[:, None]
    out = np.hstack([np.cos(angle), np.sin(angle), 0.0 * angle])
    v = 4.0 * np.hstack([-np.sin(angle), np.cos(angle), 0.0 * angle])
    q = np.array(system["anchors"]) + out
    a = c.constraint_force(system, q, v) / system["m"]
    assert_close(a, -16.0 * out, 1e-4)  # centripetal, and they fall freely
    assert 1e-12 < c.unheld(system, q, v, 0.0) < 1e-3


def test_a_number_is_a_baumgarte_frequency_and_drag_reaches_the_rods(monkeypatch):
    """And a force that may be noise is asked once: what the rods answer is what is applied."""
    system, calls = random_chain(np.random.default_rng(3), 4, 0.01), []
    q, v = system["q0"], system["v0"]

    def drag(system, q, v=None):
        calls.append(1)
        return system["m"] * c.GRAVITY - 0.3 * v

    monkeypatch.setattr(c, "external_force", drag)
    for number, mode in ((20.0, "baumgarte"), (0.0, "none")):
        calls.clear()
        force = c.make_force(system, number)(q, v)
        assert len(calls) == 1
        assert_close(force, drag(system, q, v) + textbook_force(system, q, v, TABLE[mode]))


@pytest.mark.parametrize("length", [1.0, 2.0])
def test_a_hanging_bob_pulls_with_its_weight(length):
    """lambda is minus the tension over the length, in N/m: -9.81 for a metre, -4.905 for two."""
    bob = make_system([[0.0, -length, 0.0]], [[0.0, 0.0, 0.0]], [1.0], [(0, -1)])
    _, lam, _ = c.multipliers(bob, bob["q0"], bob["v0"])
    assert lam == pytest.approx([-9.81 / length], rel=1e-15)
    assert c.tensions(bob, bob["q0"], bob["v0"], 0.0) == pytest.approx([9.81], rel=1e-15)
    whole = c.solve(c.build_system("double"), np.array([[2, 1], [1, 2]]), np.array([1, 1]))
    assert whole == pytest.approx([1 / 3, 1 / 3])  # of whole numbers, too
