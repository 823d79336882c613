"""The constraint force: the one that J M^-1 J^T lambda = ... asks for, by two other ways of finding
it."""

import constraints as c
from curriculum.ch3_4_constraints import large
from curriculum.ch3_4_constraints.studies._runs import make_system

import numpy as np
import pytest

TABLE = c.hold_table(dt=0.005)


def random_chain(rng, n, off_length=0.0):
    """A chain in space with random masses and directions; its rods are `off_length` longer than
    they should be."""
    d = rng.normal(size=(n, 3))
    lengths = np.linalg.norm(d, axis=1)
    q = np.cumsum(d * (1.0 + off_length / lengths[:, None]), axis=0) + 0.5
    pairs = [(k, k - 1) for k in range(n)]
    return make_system(
        q, rng.normal(size=(n, 3)), rng.uniform(0.1, 10.0, n), pairs, lengths, [[0.5, 0.5, 0.5]]
    )


def random_linkage(rng, n, rods, off_length=0.0):
    """A connected graph with two anchors: a spanning tree and `rods` more rods at random."""
    points, anchors = rng.normal(size=(n, 3)) * n ** (1 / 3), rng.normal(size=(2, 3))
    pairs = [(0, -1)] + [(k, int(rng.integers(-2, k))) for k in range(1, n)]
    free = [(i, j) for i in range(n) for j in range(-2, i) if (i, j) not in pairs]
    pairs += [free[k] for k in rng.choice(len(free), rods, replace=False)]
    ends = np.concatenate([points, anchors[::-1]])
    lengths = [np.linalg.norm(ends[i] - ends[j]) - off_length for i, j in pairs]
    return make_system(
        points, rng.normal(size=(n, 3)), rng.uniform(0.1, 10.0, n), pairs, lengths, anchors
    )


def textbook_force(system, q, v, hold):
    """J^T lambda with the matrices written out and LAPACK's solver; soft's position error as MuJoCo
    defines it."""
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
    """Chains, trees and loops; the slack of loops is taken back to what rounding leaves of a badly
    posed system."""
    rng = np.random.default_rng(1)
    for system in [random_chain(rng, n, off) for n in (1, 2, 3, 7) for off in (0.0, 0.02)]:
        q, v = system["q0"], system["v0"]
        assert_close(
            c.constraint_force(system, q, v, TABLE[mode]), textbook_force(system, q, v, TABLE[mode])
        )
    for system in [random_linkage(rng, 7, rods, 0.02) for rods in (0, 1, 2)]:
        q, v = system["q0"], system["v0"]
        assert_close(
            c.constraint_force(system, q, v, TABLE[mode]),
            textbook_force(system, q, v, TABLE[mode]),
            1e-11,
        )


LARGE = {  # by arrays: chains of every length around a halving, a tree, and loops
    **{
        f"chain{n}": lambda rng, n=n: random_chain(rng, n, 1e-3) for n in (large.CHAIN + 1, 81, 162)
    },
    "tree": lambda rng: random_linkage(rng, large.LINKAGE + 1, 0, 1e-3),
    "loops": lambda rng: random_linkage(rng, large.LINKAGE, 8, 1e-3),
}


SPARSE = [
    (name, installed)
    for name in LARGE
    for installed in (True, False)
    if "chain" not in name or not installed
]


@pytest.mark.parametrize(("name", "installed"), SPARSE)
def test_large_scenes_equal_the_chapters_lines(name, installed, monkeypatch):
    if installed:
        pytest.importorskip(
            "scipy", reason="the sparse solver of large linkages: pip install -e '.[large]'"
        )
    monkeypatch.setattr(large, "find_spec", lambda module: installed)
    system = LARGE[name](np.random.default_rng(3))
    q, v, moved = system["q0"], system["v0"], system["q0"] + 1e-3 * system["v0"]
    assert large.takes(system)
    tolerance = (
        1e-9 if name == "loops" else 1e-12
    )  # where loops are badly posed, the last digits are anybody's
    for hold in (*TABLE.values(), c.Hold(0.0, 200.0, 0.0, 0.0, None, None)):
        force = large.make_force(system, hold, c.external_force)
        expected = c.external_force(system, q, v) + c.constraint_force(system, q, v, hold)
        assert_close(force(q, v), expected, tolerance)
        both = force(np.stack([q, moved]), np.stack([v, v]))
        assert_close(both[0], expected, tolerance)
    errors, ended = c.rod_errors(system, q), c.project(system, q, moved, v, 1e-3)
    monkeypatch.setattr(large, "takes", lambda system: False)
    assert_close(errors, c.rod_errors(system, q))
    for ours, theirs in zip(ended, c.project(system, q, moved, v, 1e-3), strict=True):
        assert_close(ours, theirs, max(tolerance, 1e-10))


def test_rods_keep_g_on_its_way():
    """Along the motion that the force makes, the second difference of g is what the mode asked for:
    none asks for 0."""
    rng = np.random.default_rng(0)
    for system in (random_chain(rng, 4), random_linkage(rng, 5, 2)):
        q, v, dt = system["q0"], system["v0"], 1e-4
        for hold in (TABLE["none"], TABLE["baumgarte"]):
            _, g, gdot, _ = c.constraint_terms(system, q, v)
            a = c.make_force(system, hold)(q, v) / system["m"]
            g_at = [
                c.constraint_terms(system, q + t * v + 0.5 * t * t * a, v)[1] for t in (-dt, dt)
            ]
            gddot = (g_at[0] - 2.0 * g + g_at[1]) / dt**2
            assert (
                np.abs(gddot + hold.damping * gdot + hold.stiffness * g).max()
                < 1e-4 * np.abs(a).max() ** 2
            )


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
            return (
                c.constraint_force(system, q, v, TABLE[mode]),
                *c.constraint_terms(system, q, v),
                c.tensions(system, q, v, TABLE[mode]),
                c.energy(system, q, v),
                c.constraint_violation(system, q),
                *c.project(system, system["q0"] + 0.0 * q, q, v, 0.01),
            )

        stacked = everything(q, v)
        for i, j in np.ndindex(2, 4):
            for many, single in zip(stacked, everything(q[i, j], v[i, j]), strict=True):
                assert_close(many[i, j], single, 1e-9)


def test_rods_act_in_pairs_do_no_work_and_turn_nothing_about_the_pivot():
    rng = np.random.default_rng(7)
    for trial in range(20):
        system = random_linkage(rng, 6, trial % 4) if trial % 2 else random_chain(rng, 6)
        q, v = system["q0"], system["v0"]
        jac, _, _, _ = c.constraint_terms(system, q, v)
        v = (v.ravel() - np.linalg.pinv(jac) @ (jac @ v.ravel())).reshape(
            -1, 3
        )  # a motion the rods allow
        force = c.constraint_force(system, q, v, TABLE["none"])
        scale = np.abs(force).max()
        assert abs(np.sum(force * v)) < 1e-10 * scale
        # what the rods at the anchors do to the particles is all that does not cancel in pairs
        lam = np.linalg.lstsq(jac.T, force.ravel(), rcond=None)[0]
        grounded = np.array([j < 0 for _, j in system["pairs"]])
        d = np.array(
            [q[i] - (system["anchors"][-1 - j] if j < 0 else q[j]) for i, j in system["pairs"]]
        )
        assert (
            np.abs(force.sum(axis=0) - (lam[grounded, None] * d[grounded]).sum(axis=0)).max()
            < 1e-9 * scale
        )
        if len({j for _, j in system["pairs"] if j < 0}) == 1:
            pivot = system["anchors"][-1 - min(j for _, j in system["pairs"])]
            assert (
                np.abs(np.cross(q - pivot, force).sum(axis=0)).max()
                < 1e-9 * scale * np.abs(q - pivot).max()
            )


def test_redundant_rods_share_the_load_and_change_no_motion():
    """A square with both diagonals hangs by a corner: six rods, five needed. The pull is unique,
    its split is not."""
    q = np.array([[1.0, 0, 0], [1, -1, 0], [0, -1, 0]])
    pairs = [(0, -1), (1, 0), (2, 1), (2, -1), (1, -1), (2, 0)]
    system = make_system(q, np.zeros_like(q), np.ones(3), pairs)
    jac, *_ = c.constraint_terms(system, q, system["v0"])
    smallest = np.linalg.lstsq(jac @ jac.T, -jac @ np.tile(c.GRAVITY, 3), rcond=1e-9)[0]
    force = c.constraint_force(system, q, system["v0"], 0.0)
    assert_close(force.ravel(), jac.T @ smallest)
    lean = make_system(q, np.zeros_like(q), np.ones(3), pairs[:-1])
    assert_close(force, c.constraint_force(lean, q, system["v0"], 0.0))


def test_no_tension_is_cut_off_that_is_needed():
    """A tonne at rest under a frame with a brace too many: the smallest eigenvalue that carries it
    is 5e-5 of A's."""
    q = [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.5, -2.0, 0.0]]
    pairs = [(0, -1), (1, -1), (2, 0), (2, 1), (2, -1), (1, 0), (3, 1), (3, 2), (0, -2)]
    system = make_system(
        q, np.zeros((4, 3)), [1.0, 1.0, 1.0, 1000.0], pairs, None, [[0, 0, 0], [1.0, 1.0, 0]]
    )
    jac, *_ = c.constraint_terms(system, system["q0"], system["v0"])
    force = c.make_force(system, 0.0)(system["q0"], system["v0"])
    assert np.abs(jac @ (force / system["m"]).ravel()).max() < 1e-5  # gddot, m^2/s^2


def test_a_number_is_a_baumgarte_frequency_and_drag_reaches_the_rods(monkeypatch):
    system = random_chain(np.random.default_rng(3), 4, 0.01)
    q, v = system["q0"], system["v0"]
    assert np.array_equal(
        c.constraint_force(system, q, v, 20.0), c.constraint_force(system, q, v, TABLE["baumgarte"])
    )
    assert np.array_equal(
        c.constraint_force(system, q, v), c.constraint_force(system, q, v, TABLE["none"])
    )
    monkeypatch.setattr(
        c, "external_force", lambda system, q, v=None: system["m"] * c.GRAVITY - 0.3 * v
    )
    assert_close(c.constraint_force(system, q, v, 0.0), textbook_force(system, q, v, TABLE["none"]))


def test_external_force_is_asked_once_a_force(monkeypatch):
    """Noise that the rods answer must be the noise that is applied."""
    system, calls = random_chain(np.random.default_rng(3), 3), []
    monkeypatch.setattr(c, "external_force", lambda *_: calls.append(1) or system["m"] * c.GRAVITY)
    c.make_force(system, 0.0)(system["q0"], system["v0"])
    assert len(calls) == 1


@pytest.mark.parametrize("length", [1.0, 2.0])
def test_a_hanging_bob_pulls_with_its_weight(length):
    """lambda is minus the tension over the length, in N/m: -9.81 for a metre, -4.905 for two."""
    bob = make_system([[0.0, -length, 0.0]], [[0.0, 0.0, 0.0]], [1.0], [(0, -1)])
    _, lam = c.multipliers(bob, bob["q0"], bob["v0"])
    assert lam == pytest.approx([-9.81 / length], rel=1e-15)
    assert c.tensions(bob, bob["q0"], bob["v0"], 0.0) == pytest.approx([9.81], rel=1e-15)
