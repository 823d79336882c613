"""The physics: forces against other formulations, motions against closed forms, bits everywhere."""

import json
import math
import pickle
from functools import partial
from itertools import product

import numpy as np
import pytest
from conftest import ROOT, python

import constraints as c
from curriculum.ch3_4_constraints.reference import MAX_RODS, find_reference
from curriculum.ch3_4_constraints.studies import hard_cases
from curriculum.common.gauss import make_gauss
from curriculum.common.tracing import StepFailed, vmap

METHODS = c.stabilizations(dt=0.005)
REFERENCE = json.loads((ROOT / "tests/reference.json").read_text(encoding="utf-8"))


def row(n):
    return [(k, k - 1) for k in range(n)]


def tree(n, loops=0):
    """Two rods hang on each particle, the first on an anchor; others close so many loops."""
    return [(k, (k - 1) // 2) for k in range(n)] + [(n - 1, -2), *row(n)[2::2]][:loops]


def make_system(q, pairs, anchors=((0.0, 0.0, 0.0),), v=0.0, m=1.0):
    """A system whose rods are as long as their ends are apart."""
    q, anchors = np.array(q, float), np.array(anchors, float)
    ends = {-1 - k: anchor for k, anchor in enumerate(anchors)} | dict(enumerate(q))
    lengths = np.array([math.dist(ends[i], ends[j]) for i, j in pairs])
    system = {"q0": q, "v0": v + 0.0 * q, "m": np.reshape(m + 0.0 * q[:, 0], (-1, 1))}
    return system | {"pairs": pairs, "lengths": lengths, "anchors": anchors}


def moving(pairs, stretch):
    """Particles, masses and velocities at random; rods are too long by a factor."""
    rng, n = np.random.default_rng(3), 1 + max(pairs)[0]
    q, v = rng.normal(size=(2, n, 3))
    system = make_system(q, pairs, rng.normal(size=(2, 3)), v, rng.uniform(0.1, 10.0, n))
    return system | {"lengths": system["lengths"] / stretch}


def energy_error(run):
    """The largest of a double pendulum, as a share of m g L."""
    return np.max(np.abs(run.energies - run.energies[0])) / (4.0 * 9.81)


def kkt_acceleration(system, f, method):
    """a (N, 3) of [[M, -J^T], [J, R]] [a, lambda] = [f, what the method asks], all at once."""
    q, v, n = system["q0"], system["v0"], len(system["q0"])
    points = np.concatenate([q, system["anchors"][::-1]])  # where -1 is the first anchor
    i, j = np.transpose(system["pairs"])
    incidence = np.eye(len(points))[i] - np.eye(len(points))[j]
    d, d_dot, lengths = incidence @ points, incidence[:, :n] @ v, system["lengths"]
    jac = np.einsum("kn,kx->knx", incidence[:, :n], d).reshape(len(d), -1)
    size, mass = np.linalg.norm(d, axis=1), np.diag(np.repeat(system["m"], 3))
    g = size * (size - lengths) if method.regularization else 0.5 * (size**2 - lengths**2)
    gdot, jdotv = np.sum(d * d_dot, axis=1), np.sum(d_dot**2, axis=1)
    soft = method.regularization * np.diag(np.diag(jac @ np.linalg.solve(mass, jac.T)))
    asked = -method.use_jdotv * jdotv - method.damping * gdot - method.stiffness * g
    whole = np.block([[mass, -jac.T], [jac, soft]])
    solution = np.linalg.lstsq(whole, np.concatenate([f.ravel(), asked]), rcond=1e-13)[0]
    return solution[: q.size].reshape(q.shape)


STAR = [(0, -1), *((k, 0) for k in range(1, 12))]  # whose rods are all coupled
GRAPHS = [row(1), row(7), tree(7), tree(7, 2), [*row(4), (3, -2)], STAR]


@pytest.mark.parametrize("name", METHODS)
def test_the_force_is_that_of_one_dense_system_for_all_unknowns(name, monkeypatch):
    """Chains, trees and loops, on their rods and off them, with drag."""

    def drag(system, q, v):
        return system["m"] * c.GRAVITY - 0.3 * v

    monkeypatch.setattr(c, "external_force", drag)
    systems = [moving(pairs, stretch) for pairs, stretch in product(GRAPHS, (1.0, 1.02))]
    for system in [*systems, c.build_system("braced")]:  # which has a rod too many
        q, v, method = system["q0"], system["v0"], METHODS[name]
        expected = kkt_acceleration(system, drag(system, q, v), method)
        found = c.make_force(system, method)(q, v) / system["m"]
        assert np.max(np.abs(found - expected)) < 1e-9 * np.max(np.abs(expected))


CABLES = [*product((12, 50, 150), (0.02, 0.001), (1.0, 1000.0)), (2, 1e-5, 1.0)]


@pytest.mark.parametrize(("rods", "sag", "heavier"), CABLES)
def test_a_tight_cable_accelerates_as_an_svd_says(rods, sag, heavier):
    """Of J M^-1/2 with rows of length 1: A has the squares of its singular values."""
    x = np.linspace(0.0, 1.0, rods + 1)
    q = rods * np.stack([x, -4.0 * sag * x * (1.0 - x), 0.0 * x], axis=1)
    m = np.where(np.arange(1, rods) % 2, 1.0, heavier)
    system = make_system(q[1:-1], [*row(rods - 1), (rods - 2, -2)], [q[0], q[-1]], m=m)
    q, v, root = system["q0"], system["v0"], np.repeat(np.sqrt(system["m"]), 3)
    jac = np.asarray(c.constraint_terms(system, q, v)[0]) / root
    size, free = np.linalg.norm(jac, axis=1), root * np.tile(c.GRAVITY, len(q))
    held = np.linalg.lstsq(jac / size[:, None], -jac @ free / size, rcond=1e-11)[0]
    a = ((free + held) / root).reshape(q.shape)
    off = np.max(np.abs(c.make_force(system, 0.0)(q, v) / system["m"] - a))
    assert off < 1e-7 * max(9.81, np.max(np.abs(a)))


@pytest.mark.parametrize("name", ["jansen_leg", "windows", "peaucellier"])
def test_tensions_and_residuals_of_many_states_are_those_of_each(name):
    system = c.build_system(name)
    run = c.run_method(system, "impulse", "semi_implicit", 0.005, 400)
    for method, function in product(("none", "soft"), (c.tensions, c.constraint_residual)):
        of_one = partial(function, system, method=METHODS[method])
        many = vmap(of_one)(run.q, run.v)
        for k in range(0, 401, 40):
            assert np.array_equal(many[k], of_one(run.q[k], run.v[k]))
    last = system, run.q[400], run.v[400]
    assert np.array_equal(c.tensions(*last), c.tensions(*last, METHODS["none"]))


def test_a_bob_between_rods_in_line_is_asked_for_what_no_tension_gives():
    """It moves across them at 1 m/s: both are to shorten by v^2/L, which none answers."""
    system = make_system([[1, 0, 0]], [(0, -1), (0, -2)], [[0, 0, 0], [2, 0, 0]], [[0, 1, 0]])
    assert c.constraint_residual(system, system["q0"], system["v0"]) == pytest.approx(1.0, abs=1e-6)


def test_a_pendulum_let_go_level_has_the_period_and_the_pull_of_the_closed_form():
    """T = gamma(1/4)^2 sqrt(L / (pi g)); at the bottom the rod pulls with 3 m g."""
    period = math.gamma(0.25) ** 2 / math.sqrt(math.pi * 9.81)
    system = make_system([[1.0, 0.0, 0.0]], row(1))
    del system["anchors"]  # it hangs on the pivot
    run = c.run_method(system, "project", "gauss", period / 100, 100)
    assert np.max(np.abs(run.q[100] - run.q[0])) < 1e-12
    pull = c.tensions(system, run.q[25], run.v[25], METHODS["project"])
    assert run.q[25, 0] == pytest.approx([0.0, -1.0, 0.0], abs=1e-12)
    assert pull == pytest.approx([3.0 * 9.81], rel=1e-12)


def error_against_angles(name, step_fn, method, dt):
    """The largest distance in m, in 2 s, to where equations in joint angles put a particle."""
    system, method = c.build_system(name), c.stabilizations(dt)[method]
    keep = [round(t / dt) for t in REFERENCE["times"] if t <= 2.0]
    step_fn, force = c.stabilized(step_fn, system, method), c.make_force(system, method)
    run = c.simulate(step_fn, system, force, dt, keep[-1])
    exact = np.array(REFERENCE["cases"][name]["positions"][: len(keep)])
    return np.max(np.linalg.norm(run.q[keep, :, :2] - exact, axis=-1))


ORDERS = [  # an integrator, the method, the longest of three steps in s, and the order
    (c.euler_step, "project", 0.001, 1),
    (c.semi_implicit_step, "project", 0.001, 1),
    (c.rk4_step, "project", 0.0025, 4),
    (make_gauss(2), "project", 0.0125, 4),
    (make_gauss(3), "project", 0.025, 6),
]


@pytest.mark.parametrize(("step_fn", "method", "dt", "order"), ORDERS)
def test_halving_the_step_shows_the_order(step_fn, method, dt, order):
    errors = [error_against_angles("double", step_fn, method, dt / k) for k in (1, 2, 4)]
    assert np.log2(np.divide(errors[:-1], errors[1:])) == pytest.approx(order, abs=0.7)


def test_the_published_course_has_the_same_figures():
    """Recorded by its own script: the worst rod error, that at the end, and energy."""
    double, other = (c.build_system("double", seed) for seed in (0, 1))
    settings = "semi_implicit", 0.005, 4000
    published = {"none": [0.384014620396, 0.384014620396, 0.427091167688]}
    published["baumgarte"] = [0.023470285993, 0.001436710083, 0.32484945881]
    for name, figures in published.items():
        run = c.run_method(double, name, *settings)
        found = max(run.violations), run.violations[-1], energy_error(run)
        assert found == pytest.approx(figures, rel=0.0, abs=3e-12)  # it solves by LAPACK
    apart = math.dist(run.tip[-1], c.run_method(other, "baumgarte", *settings).tip[-1])
    assert f"{apart:.3f}" == "1.117"
    run = c.run_method(c.build_system("pendulum"), "none", "rk4", 0.005, 4000)
    assert f"{max(run.violations):.2e}" == "8.79e-06"


DRIFT = [  # method, integrator, and g of a rod that spins at v m/s in steps of dt s
    ("none", "semi_implicit", lambda dt, v, w: -0.5 * dt * v * v),  # after 1 s
    ("baumgarte", "semi_implicit", lambda dt, v, w: -dt * v * v / w),
    ("baumgarte", "euler", lambda dt, v, w: dt * v * v / w),
    ("impulse", "semi_implicit", lambda dt, v, w: 0.5 * dt * dt * v * v),
]


@pytest.mark.parametrize(("name", "integrator", "expected"), DRIFT)
def test_a_spinning_rod_is_off_by_what_the_derivation_says(name, integrator, expected, monkeypatch):
    monkeypatch.setattr(c, "external_force", lambda system, q, v=None: 0.0 * q)
    rod, dt, w = make_system([[1, 0, 0]], row(1), v=[[0, 5, 0]]), 0.0005, 50.0
    run = c.run_method(rod, name, integrator, dt, 2000, baumgarte=w)
    speed = np.linalg.norm(run.v[-1])  # under euler it grows
    g = 0.5 * (np.sum(run.q[-1] ** 2) - 1.0)
    assert g == pytest.approx(expected(dt, speed, w), rel=0.02, abs=1e-9)


@pytest.mark.parametrize("integrator", c.STABILITY_LIMIT)
def test_baumgarte_is_stable_up_to_the_limit_of_theory(integrator):
    """At rest, the rod 1e-9 m too long: below dt w = limit the error dies, above it grows."""
    hanging = make_system([[0.0, -1.0 - 1e-9, 0.0]], row(1)) | {"lengths": np.ones(1)}
    for share in (0.999, 1.001):
        w = share * c.STABILITY_LIMIT[integrator] / 0.005
        run = c.run_method(hanging, "baumgarte", integrator, 0.005, 20_000, baumgarte=w)
        assert (run.violations[-1] < 1e-9) == (share < 1.0)


def test_project_keeps_rods_and_its_energy_does_not_grow_but_halves_with_the_step():
    system, worst = c.build_system("double"), []
    for dt in (0.005, 0.0025):
        run = c.run_method(system, "project", "semi_implicit", dt, round(50.0 / dt))
        assert max(run.violations) < 2e-12
        worst.append(energy_error(run))
    assert worst[1] / worst[0] == pytest.approx(0.5, abs=0.1)


def test_project_puts_right_rods_and_speeds_wherever_they_are():
    system = moving(tree(12, 3), 1.01)
    for shift in (0.0, 1e7):  # m
        system = system | {"q0": system["q0"] + shift, "anchors": system["anchors"] + shift}
        q, v = c.project(system, system["q0"], system["q0"], system["v0"], 1.0)
        _, g, gdot, _ = c.constraint_terms(system, q, v)
        assert np.max(np.abs(g)) < 1e-11 + 1e-14 * shift
        assert np.max(np.abs(gdot)) < 1e-11


def test_gauss_divides_a_step_that_does_not_converge_and_can_be_pickled():
    step_fn = pickle.loads(pickle.dumps(c.INTEGRATORS["gauss"]))
    still = np.zeros((1, 3))
    q, v = step_fn(still + 1.0, still, 1.0, lambda q, v: -900.0 * q, 1.0)  # 30 rad in a step
    assert np.allclose(q, math.cos(30.0), atol=1e-3)
    assert np.allclose(v, -30.0 * math.sin(30.0), atol=1e-2)
    with pytest.raises(StepFailed, match="the Gauss stages do not converge"):
        step_fn(still, still, 1.0, lambda q, v: np.nan * q, 1.0)


def reference_of(system, dt=0.005, steps=4000, not_compiled=False):
    step = partial(c.one_step, system, "project", "gauss")
    return find_reference(step, system, c.GRAVITY, dt, steps, not_compiled)


@pytest.mark.parametrize("name", REFERENCE["cases"])
def test_gauss_and_the_reference_are_where_joint_angles_put_the_particles(name):
    assert error_against_angles(name, c.INTEGRATORS["gauss"], "project", 0.025) < 1e-12
    found = reference_of(c.build_system(name))
    exact = REFERENCE["cases"][name]["positions"][REFERENCE["times"].index(2.0)]
    assert found.step * 0.005 == 2.0 and found.uncertainty < 1e-11
    assert np.max(np.abs(found.q[:, :2] - exact)) < 1e-12
    assert found.error(np.array([found.q] * 401)) == 0.0 and found.error(found.q[None]) is None


def test_of_millimetres_and_in_strong_gravity_the_reference_is_the_same_in_shorter_time(
    monkeypatch,
):
    """Where lengths are 1/1024, or gravity 1024 g, times are 1/32: the same motion."""
    double = c.build_system("double")
    small = double | {key: double[key] / 1024.0 for key in ("q0", "lengths")}
    found, scaled = reference_of(small, 0.005 / 32.0, 400), reference_of(double, 0.005, 400)
    assert np.max(np.abs(1024.0 * found.q - scaled.q)) < 1e-11
    assert found.time_scale == scaled.time_scale / 32.0
    assert reference_of(small).step == round(20.0 * found.time_scale / 0.005)
    monkeypatch.setattr(c, "GRAVITY", 1024.0 * c.GRAVITY)
    found = reference_of(double, 0.005 / 32.0, 400)
    assert np.max(np.abs(found.q - scaled.q)) < 1e-11 and found.time_scale < 0.01


def test_a_reference_that_is_not_known_has_a_reason_and_a_stiff_start_is_none(monkeypatch):
    double = c.build_system("double")
    away = [1e8, 0.0, 0.0]  # m: there a coordinate is rounded to 15 nm
    far = double | {"q0": double["q0"] + away, "anchors": double["anchors"] + away}
    unknown = {
        "not agree to a nanometre": reference_of(far),
        "shorter steps do not agree": reference_of(c.build_system("peaucellier")),
        f"more than {MAX_RODS} rods": reference_of(c.build_system("chain", links=MAX_RODS + 1)),
        "steps are not compiled": reference_of(double, not_compiled=True),
        "a step takes 3 s": reference_of(double, dt=3.0),
    }
    assert reference_of(c.build_system("heavy_tip")).uncertainty < 1e-9
    monkeypatch.setattr(c, "external_force", lambda system, q, v: q if q[0, 1] < -0.5 else -q)
    unknown["cannot be compiled"] = reference_of(double)
    for why, found in unknown.items():
        assert why in found.why
        assert found.shown(found.error(np.zeros((4001, 2, 3))), str) == "-"


BY_HAND = [(name, x) for name in METHODS for x in ("semi_implicit", "rk4", "gauss")]
BY_HAND.remove(("impulse", "rk4"))
W = {20.0: "baumgarte", 0.0: "none"}  # rad/s: a number is a method, too


@pytest.mark.parametrize(("name", "integrator"), [*BY_HAND, *((w, "semi_implicit") for w in W)])
def test_a_loop_by_hand_over_the_file_without_its_report_has_the_bits_of_a_run(name, integrator):
    """So the published course's generator of figures executes it."""
    source = (ROOT / "constraints.py").read_text(encoding="utf-8")
    file = {"__file__": str(ROOT / "constraints.py"), "__name__": "generator"}
    exec(source[: source.index("# --- region: report ---")], file)
    system = file["build_system"]("double", np.random.default_rng(0))
    method = file["stabilizations"](0.005).get(name, name)
    force, step_fn = file["make_force"](system, method), file["INTEGRATORS"][integrator]
    if name not in W:
        step_fn = file["stabilized"](step_fn, system, method)
    steps = 20 if integrator == "gauss" else 200
    run = c.run_method(system, W.get(name, name), integrator, 0.005, steps)
    q, v = system["q0"], system["v0"]
    for i in range(steps):
        q, v = step_fn(q, v, system["m"], force, 0.005)
        assert np.array_equal(q, run.q[i + 1])
        assert file["energy"](system, q, v) == run.energies[i + 1]
        assert file["constraint_violation"](system, q) == run.violations[i + 1]
    assert all(map(np.array_equal, file["simulate"](step_fn, system, force, 0.005, steps), run))


BITS = """
import hashlib, sys
if "slow" in sys.argv:
    sys.modules["llvmlite"] = None
import constraints as c
from curriculum.common.tracing import plain
every = [("windows", method, "semi_implicit") for method in c.stabilizations(dt=1.0)]
for name, *how in [*every, ("double", "project", "gauss")]:
    with plain("plain" in sys.argv):
        steps = 20 if "plain" in sys.argv else 4000
        run = c.run_method(c.build_system(name), *how, 0.005, steps)
    assert len(sys.argv) > 1 or run.how == "machine code"
    for states in run.q[:20], run.q:
        print(name, *how, hashlib.sha256(states.tobytes()).hexdigest())
"""


def test_bits_are_the_same_over_kernels_and_compilers_and_in_plain_numpy():
    """Two lines for each case: of its first states, and of all."""
    pytest.importorskip("llvmlite", reason="an extra: pip install -e '.[fast]'")

    def bits(*words, **variables):
        done = python("-c", BITS, *words, variables=variables)
        assert done.returncode == 0, done.stderr
        return done.stdout.splitlines()

    usual = bits()
    assert bits("slow", NPY_DISABLE_CPU_FEATURES="X86_V3 X86_V4 AVX512_ICL AVX512_SPR") == usual
    plain = bits("plain", OPENBLAS_CORETYPE="Prescott", OPENBLAS_NUM_THREADS="2")
    assert plain[::2] == usual[::2]


HARD = [  # a scene, the integrator, dt in s, how many starts, and how many must be held
    ("windows", "gauss", 0.02, 1, 1),  # through the flat pose, where J loses rank ten times
    ("light_tip", "rk4", 0.02, 3, 3),
    ("braced", "gauss", 0.02, 1, 1),
    ("spin", "gauss", 0.01, 2, 2),
    ("heavy_tip", "gauss", 0.005, 1, 1),
    ("heavy_tip", "rk4", 0.002, 5, 3),
]


@pytest.mark.parametrize(("name", "integrator", "dt", "starts", "least"), HARD)
def test_hard_scenes_keep_rods_and_energy_from_other_starts(name, integrator, dt, starts, least):
    scene = c.build_system(name)
    run = hard_cases.compiled_for(scene, hard_cases.step_of(f"{integrator} project"))
    many = hard_cases.starts(scene, 2 * starts + 1)[2::2]  # those with other masses and speeds
    assert sum(hard_cases.is_held(scene, run, v, m, dt, 10.0) for v, m in many) >= least
