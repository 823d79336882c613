"""The constraint force, by two other ways of finding it."""

from itertools import product

import constraints as c
from curriculum.ch3_4_constraints.scene_files import parse_scene
from curriculum.ch3_4_constraints.scenes import make_scenes
from curriculum.ch3_4_constraints.studies._runs import make_system, scene

import numpy as np
import pytest

TABLE = c.hold_table(dt=0.005)


def assert_close(a, b, tolerance=1e-12):
    assert np.abs(a - b).max() <= tolerance * max(1.0, np.abs(b).max())


def row(n):
    return [(k, k - 1) for k in range(n)]


def tree(n, more=0):
    """Each particle on an earlier one or an anchor, and `more` rods that close loops."""
    rng = np.random.default_rng(n)
    pairs = [(k, int(rng.integers(-2, k))) for k in range(n)]
    spare = [(i, j) for i in range(n) for j in range(-2, i) if (i, j) not in pairs]
    return pairs + [spare[k] for k in rng.choice(len(spare), more, replace=False)]


def moving(n, pairs, short=0.0, points=None, seed=3):
    """n particles of random masses at random points; `short`: the share that their rods lack."""
    rng = np.random.default_rng(seed)
    points = n ** (1 / 3) * rng.normal(size=(n, 3)) if points is None else points
    v, m, anchors = rng.normal(size=(n, 3)), rng.uniform(0.1, 10.0, n), rng.normal(size=(2, 3))
    system = make_system(points, v, m, pairs, None, anchors)
    return system | {"lengths": (1.0 - short) * system["lengths"]}


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


@pytest.mark.parametrize("mode", TABLE)
def test_force_solves_the_explicit_system(mode):
    """Chains, trees and loops, on the rods and off them."""
    cases = [(moving(n, row(n), short), 1e-12) for n in (1, 2, 7) for short in (0.0, 0.02)]
    cases += [(moving(7, tree(7, more), 0.02), 1e-11) for more in (0, 2)]
    for system, tolerance in cases:
        case = system, system["q0"], system["v0"], TABLE[mode]
        assert_close(c.constraint_force(*case), textbook_force(*case), tolerance)


def test_jacobian_is_the_derivative_of_g():
    system, eps = moving(5, tree(5, 2)), 1e-6
    q, v = system["q0"], system["v0"]
    jac, _, gdot, jdotv = c.constraint_terms(system, q, v)
    ahead, behind = (c.constraint_terms(system, q + s * eps * v, v) for s in (1.0, -1.0))
    assert_close((ahead[1] - behind[1]) / (2 * eps), gdot, 1e-8)
    assert_close(jac @ v.ravel(), gdot)
    assert_close((ahead[0] - behind[0]) @ v.ravel() / (2 * eps), jdotv, 1e-8)


@pytest.mark.parametrize("system", [moving(3, row(3), 0.01), moving(5, tree(5, 2), 0.01)])
def test_leading_axes_are_separate_runs(system):
    """Everything takes (..., N, 3): a stack of states gives the stack of what each gives alone."""
    rng = np.random.default_rng(5)
    q = system["q0"] + 1e-3 * rng.normal(size=(2, 2, *system["q0"].shape))
    v = rng.normal(size=q.shape)

    def everything(q, v):
        found = *c.constraint_terms(system, q, v), c.energy(system, q, v)
        for hold in TABLE.values():
            found += c.constraint_force(system, q, v, hold), c.tensions(system, q, v, hold)
        ended = c.project(system, system["q0"] + 0.0 * q, q, v, 0.01)
        return *found, c.constraint_violation(system, q), *ended

    together = everything(q, v)
    for i, j in np.ndindex(2, 2):
        for many, single in zip(together, everything(q[i, j], v[i, j]), strict=True):
            assert_close(many[i, j], single, 1e-9)


@pytest.mark.parametrize("seed", range(10))
def test_rods_act_in_pairs_and_do_no_work(seed):
    """So they push no free body and turn it no way, nor a chain about its pivot."""
    inner = [(i, j) for i, j in tree(6, seed % 4) if j >= 0]
    free, chain = moving(6, inner, seed=seed), moving(6, row(6), seed=seed)
    for system, arm in ((free, free["q0"]), (chain, chain["q0"] - chain["anchors"][0])):
        q, v = system["q0"], system["v0"]
        jac = c.constraint_terms(system, q, v)[0]
        v = (v.ravel() - np.linalg.pinv(jac) @ jac @ v.ravel()).reshape(-1, 3)  # as rods allow
        force = c.constraint_force(system, q, v, TABLE["none"])
        scale = np.abs(force).max() * np.abs(arm).max()
        assert abs(np.sum(force * v)) < 1e-9 * scale
        assert np.abs(np.cross(arm, force).sum(axis=0)).max() < 1e-9 * scale
        assert system is chain or np.abs(force.sum(axis=0)).max() < 1e-9 * scale


def tight_cable(rods, slack, masses, sway):
    """Rods that hang at rest, or sway out of their plane; then masses by turns, 1 and `masses`."""
    system, bobs = parse_scene(make_scenes.tight_cable(rods, slack)), np.arange(1, rods)
    v = np.outer(sway * np.sin(np.pi * bobs / rods), [0.0, 0.0, 1.0])  # so that J v = 0
    return system | {"v0": v, "m": np.where(bobs % 2, 1.0, masses)[:, None]}


def cantilever(bays, both=False):
    """Two nodes a bay, at rest, held at the left; a diagonal a bay or, a rod too many, both."""
    q = [[k + 1.0, 1.0 - half, 0.0] for k in range(bays) for half in (0, 1)]
    rods = []
    for t in range(0, 2 * bays, 2):
        rods += [(t, t - 2), (t + 1, t - 1), (t + 1, t - 2), (t + 1, t), *[(t, t - 1)] * both]
    anchors, n = [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]], 2 * bays  # -1 is the lower one
    return make_system(q, np.zeros((n, 3)), np.ones(n), rods, None, anchors)


CABLES = product((12, 66, 150), (1e-3, 3e-6), (1.0, 1000.0), (0.0, 0.1))  # sway in m/s
NEEDED = [tight_cable(*cable) for cable in CABLES]
TONNE = scene("tonne")  # hangs on a brace too many; a thousand of them, too
NEEDED += [TONNE, TONNE | {"m": TONNE["m"] ** 2}, cantilever(30)]


@pytest.mark.parametrize("system", NEEDED)
def test_no_tension_is_cut_off_that_is_needed(system):
    """However small the eigenvalue that carries it: against an SVD of J M^-1/2."""
    q, v, w = system["q0"], system["v0"], np.repeat(np.sqrt(1.0 / system["m"][:, 0]), 3)
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
    system, calls = moving(4, row(4), 0.01), []
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
    _, lam = c.multipliers(bob, bob["q0"], bob["v0"])
    assert lam == pytest.approx([-9.81 / length], rel=1e-15)
    assert c.tensions(bob, bob["q0"], bob["v0"], 0.0) == pytest.approx([9.81], rel=1e-15)
    whole = c.solve(c.build_system("double"), np.array([[2, 1], [1, 2]]), np.array([1, 1]))
    assert whole == pytest.approx([1 / 3, 1 / 3])  # of whole numbers, too
