"""The constraint force: the one that J M^-1 J^T lambda = ... asks for, by two other ways of finding it."""

import numpy as np
import pytest

import constraints as c

TABLE = c.hold_table(dt=0.005)


def random_chain(rng, n, off_length=0.0):
    """A chain in space with random masses and directions; its rods are `off_length` longer than they should be."""
    d = rng.normal(size=(n, 3))
    lengths = np.linalg.norm(d, axis=1)
    m = rng.uniform(0.1, 10.0, n)
    q = np.cumsum(d * (1.0 + off_length / lengths[:, None]), axis=0) + 0.5
    return c.make_system(q, rng.normal(size=(n, 3)), m, [(k, k - 1) for k in range(n)], lengths, [[0.5, 0.5, 0.5]])


def random_linkage(rng, n, rods, off_length=0.0):
    """A connected graph with two anchors: a spanning tree and `rods` more rods at random."""
    points = rng.normal(size=(n, 3)) * n ** (1 / 3)
    anchors = rng.normal(size=(2, 3))
    pairs = [(0, -1)] + [(k, int(rng.integers(-2, k))) for k in range(1, n)]
    free = [(i, j) for i in range(n) for j in range(-2, i) if (i, j) not in pairs]
    pairs += [free[k] for k in rng.choice(len(free), rods, replace=False)]
    ends = np.concatenate([points, anchors[::-1]])
    lengths = [np.linalg.norm(ends[i] - ends[j]) - off_length for i, j in pairs]
    return c.make_system(points, rng.normal(size=(n, 3)), rng.uniform(0.1, 10.0, n), pairs, lengths, anchors)


def textbook_force(system, q, v, hold):
    """J^T lambda with the matrices written out and numpy's solver; soft's position error as MuJoCo defines it."""
    jac, g, gdot, jdotv = c.constraint_terms(system, q, v)
    if hold.softness:
        length = np.sqrt(2.0 * g + system["lengths"] ** 2)
        g = length * (length - system["lengths"])
    w = np.repeat(1.0 / system["m"][:, 0], 3)
    a = (jac * w) @ jac.T
    applied = c.external_force(system, q, v).ravel()
    rhs = -(jac @ (w * applied) + hold.use_jdotv * jdotv) - hold.damping * gdot - hold.stiffness * g
    return (jac.T @ np.linalg.solve(a + hold.softness * np.diag(np.diag(a)), rhs)).reshape(-1, 3)


def assert_close(a, b, tolerance=1e-12):
    assert np.abs(a - b).max() <= tolerance * max(1.0, np.abs(b).max())


@pytest.mark.parametrize("mode", TABLE)
@pytest.mark.parametrize("n", [1, 2, 3, 7, c.SHORT_CHAIN, 40, c.LONG_CHAIN + 1, 2 * c.LONG_CHAIN + 2])
def test_chain_force_solves_the_explicit_system(mode, n):
    rng = np.random.default_rng(n)
    for off in (0.0, 0.02):
        system = random_chain(rng, n, off)
        q, v = system["q0"], system["v0"]
        assert_close(c.constraint_force(system, q, v, TABLE[mode]), textbook_force(system, q, v, TABLE[mode]))


@pytest.mark.parametrize("mode", TABLE)
@pytest.mark.parametrize("rods", [0, 3])
def test_linkage_force_solves_the_explicit_system(mode, rods):
    system = random_linkage(np.random.default_rng(rods), 7, rods, 0.02)
    q, v = system["q0"], system["v0"]
    assert system["tree"] == (rods == 0)
    assert_close(c.constraint_force(system, q, v, TABLE[mode]), textbook_force(system, q, v, TABLE[mode]))


@pytest.mark.parametrize("n", [2, 5, 30])
def test_both_solvers_agree_on_chains(n):
    """The same chain with its last two rods swapped in the list is no chain to the program, but is to physics."""
    rng = np.random.default_rng(n)
    chain = random_chain(rng, n, 0.02)
    order = [*range(n - 2), n - 1, n - 2]
    lengths, pairs = chain["lengths"][order], [chain["pairs"][k] for k in order]
    graph = c.make_system(chain["q0"], chain["v0"], chain["m"], pairs, lengths, chain["anchors"])
    assert chain["chain"] and not graph["chain"]
    for hold in TABLE.values():
        force = c.constraint_force(chain, chain["q0"], chain["v0"], hold)
        assert_close(c.constraint_force(graph, chain["q0"], chain["v0"], hold), force)
        moved = chain["q0"] + 1e-3 * chain["v0"]
        for ours, theirs in zip(*(c.project(s, s["q0"], moved, s["v0"], 1e-3) for s in (chain, graph)), strict=True):
            assert_close(ours, theirs)


def test_rods_keep_g_on_its_way():
    """Along the motion that the force makes, the second difference of g is what the mode asked for: none asks for 0."""
    rng = np.random.default_rng(0)
    for system in (random_chain(rng, 4), random_linkage(rng, 5, 2)):
        q, v, dt = system["q0"], system["v0"], 1e-4
        for hold in (TABLE["none"], TABLE["baumgarte"]):
            _, g, gdot, _ = c.constraint_terms(system, q, v)
            a = c.make_force(system, hold)(q, v) / system["m"]
            g_at = [c.constraint_terms(system, q + t * v + 0.5 * t * t * a, v)[1] for t in (-dt, dt)]
            gddot = (g_at[0] - 2.0 * g + g_at[1]) / dt**2
            assert np.abs(gddot + hold.damping * gdot + hold.stiffness * g).max() < 1e-4 * np.abs(a).max() ** 2


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
    for system in (random_chain(rng, 3, 0.01), random_chain(rng, 152, 1e-4), random_linkage(rng, 5, 2, 0.01)):
        q = system["q0"] + 1e-3 * rng.normal(size=(2, 4, *system["q0"].shape))
        v = rng.normal(size=q.shape)
        stacked = (
            c.constraint_force(system, q, v, TABLE[mode]),
            *c.constraint_terms(system, q, v),
            c.energy(system, q, v),
            c.constraint_violation(system, q),
            *c.project(system, system["q0"], q, v, 0.01),
        )
        for i, j in np.ndindex(2, 4):
            one = (
                c.constraint_force(system, q[i, j], v[i, j], TABLE[mode]),
                *c.constraint_terms(system, q[i, j], v[i, j]),
                c.energy(system, q[i, j], v[i, j]),
                c.constraint_violation(system, q[i, j]),
                *c.project(system, system["q0"], q[i, j], v[i, j], 0.01),
            )
            for many, single in zip(stacked, one, strict=True):
                assert_close(many[i, j], single, 1e-9)


def test_frictionless_rods_act_in_pairs_do_no_work_and_turn_nothing_about_the_pivot():
    rng = np.random.default_rng(7)
    for trial in range(20):
        system = random_linkage(rng, 6, trial % 4) if trial % 2 else random_chain(rng, 6)
        q, v = system["q0"], system["v0"]
        jac, _, _, _ = c.constraint_terms(system, q, v)
        v = (v.ravel() - np.linalg.pinv(jac) @ (jac @ v.ravel())).reshape(-1, 3)  # a motion the rods allow
        force = c.constraint_force(system, q, v, TABLE["none"])
        scale = np.abs(force).max()
        assert abs(np.sum(force * v)) < 1e-10 * scale
        # what the rods at the anchors do to the particles is all that does not cancel in pairs
        lam = np.linalg.lstsq(jac.T, force.ravel(), rcond=None)[0]
        grounded = np.array([j < 0 for _, j in system["pairs"]])
        d = c.rod_vectors(system, q)
        assert np.abs(force.sum(axis=0) - (lam[grounded, None] * d[grounded]).sum(axis=0)).max() < 1e-9 * scale
        if len({j for _, j in system["pairs"] if j < 0}) == 1:
            pivot = system["anchors"][-1 - min(j for _, j in system["pairs"])]
            assert np.abs(np.cross(q - pivot, force).sum(axis=0)).max() < 1e-9 * scale * np.abs(q - pivot).max()


def test_redundant_rods_share_the_load_with_the_smallest_norm():
    """A square with both diagonals hangs by a corner: six rods, five needed. The pull is unique, its split is not."""
    q = np.array([[1.0, 0, 0], [1, -1, 0], [0, -1, 0]])
    pairs = [(0, -1), (1, 0), (2, 1), (2, -1), (1, -1), (2, 0)]
    system = c.make_system(q, np.zeros_like(q), np.ones(3), pairs)
    jac, *_ = c.constraint_terms(system, q, system["v0"])
    rhs = -jac @ np.tile(c.GRAVITY, 3)
    smallest = np.linalg.lstsq(jac @ jac.T, rhs, rcond=1e-9)[0]
    force = c.constraint_force(system, q, system["v0"], 0.0)
    assert_close(force.ravel(), jac.T @ smallest)
    lean = c.make_system(q, np.zeros_like(q), np.ones(3), pairs[:-1])
    assert_close(force, c.constraint_force(lean, q, system["v0"], 0.0))


def test_a_number_is_a_baumgarte_frequency_and_drag_reaches_the_rods(monkeypatch):
    system = random_chain(np.random.default_rng(3), 4, 0.01)
    q, v = system["q0"], system["v0"]
    assert np.array_equal(c.constraint_force(system, q, v, 20.0), c.constraint_force(system, q, v, TABLE["baumgarte"]))
    assert np.array_equal(c.constraint_force(system, q, v, 0.0), c.constraint_force(system, q, v, TABLE["none"]))
    monkeypatch.setattr(c, "external_force", lambda system, q, v: system["weight"] - 0.3 * v)
    alone = c.constraint_force(system, q, v, 0.0)
    assert_close(alone, textbook_force(system, q, v, TABLE["none"]))
    assert_close(c.constraint_force(system, np.stack([q, q]), np.stack([v, v]), 0.0), np.stack([alone, alone]))
