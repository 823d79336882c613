"""A run: the reader's loop is obeyed, and no figure of it is false."""

import __future__

import re
from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import BARE, BEGIN, FORCE, KEEP, ROOT, STEP, edited, python
from independent import energy_off, smallest_pulls, weight
from machines import make_system, row, thrown, torn

import constraints as c
from curriculum.ch3_4_constraints import report
from curriculum.ch3_4_constraints.rods.run import conserving, how_many_good
from curriculum.ch3_4_constraints.rods.truth import Truth
from curriculum.common.tracing import NotAState, StepChanged, plain

DT = 0.01
STEPS = 120


DOUBLE = thrown(
    make_system(
        [[0.5, -0.3, 0.2], [0.9, -0.7, -0.4]],
        row(2),
        v=[[0.3, 0.5, 0], [0, 0.6, 0.2]],
        m=[2.0, 0.5],
    )
)
HANGING = make_system([[0.0, -1.0, 0.0]], row(1))


def before(line, text):
    return line, text + line


def later(text):
    """An edit of the loop, from step 50 on."""
    return before(STEP, f"        if i >= 50:\n            {text}\n")


def once(text):
    return before(STEP, f"        if i == 50:\n            {text}\n")


def beside(text):
    """An edit of external_force: another force, too."""
    return FORCE, f"{FORCE} + {text}"


def times(factor, ready=""):
    """An edit of external_force: it is multiplied, after some lines."""
    return FORCE, f"{ready}{FORCE.replace('return ', f'return ({factor}) * (')})"


GLOBAL = "GRAVITY = np"
COUNTER = [before(GLOBAL, "n = 0\n"), times("1 + 1e-3 * n", "global n\n    n += 1\n    ")]
TENTH = KEEP.replace("        all", "            all").replace("[i + 1]", "[(i + 1) // 10]")
TRY = f"        try:\n    {STEP}        except {{}}:\n            break\n"
BRANCH = "f = 1.0\n    try:\n        if q[0, 1] < -0.5:\n            f = 2.0\n"

UNLIKE = {  # the changes, and a word on why it is another run
    "another speed": ([before(BEGIN, "    v[:, 1] = [1.0, 2.0]\n")], "v"),
    "another place": ([before(BEGIN, "    q = q + 0.1\n")], "q"),
    "half the step": ([before(BEGIN, "    dt = dt / 2\n")], "dt"),
    "another force": ([before(BEGIN, "    force = make_force(system, 1.0)\n")], "force"),
    "heavier": ([before(BEGIN, "    m[0] = 5.0\n")], "m"),
    "heavier in place": ([later("m[0] = 9.0")], "m"),
    "fuel": ([before(STEP, "        m = m * 0.999\n")], "m"),
    "longer": ([before(BEGIN, "    system['lengths'][1] *= 1.05\n")], "lengths"),
    "a kick": ([once("v[1, 0] += 2.0")], "v"),
    "a move": ([once("q = q + 0.1")], "q"),
    "two steps a turn": ([(STEP, 2 * STEP)], "steps"),
    "two steps once": ([once(STEP.strip())], "steps"),
    "steps of its own": ([(STEP, STEP.replace("step_fn", "euler_step"))], "steps"),
    "shorter steps": ([later("dt = 0.002")], "dt"),
    "steps by turns": ([(STEP, STEP.replace("dt)", "dt * (1 + i % 2))"))], "dt"),
    "every tenth state": ([(KEEP, f"        if i % 10 == 9:\n{TENTH}")], "steps"),
}
CHANGED = {  # what is an error if it is compiled, and by --plain another run
    "gravity": ([later("GRAVITY[1] = -5.0")], "depends"),
    "a longer rod": ([later("system['lengths'][1] = 0.9")], "lengths"),
    "a force of time": (
        [
            before(GLOBAL, "t = 0.0\n"),
            before(BEGIN, "    global t\n"),
            before(STEP, "        t = i * dt\n"),
            times("1.0 + 3.0 * (0.5 <= t < 1.0)"),
        ],
        "depends",
    ),
    "a counter": (COUNTER, "depends"),
    "a counter under try": ([*COUNTER, (STEP, TRY.format("Exception"))], "depends"),
    "wind": (
        [
            before(GLOBAL, "RNG = np.random.default_rng(1)\n"),
            beside("0.1 * RNG.normal(size=q.shape)"),
        ],
        "depends",
    ),
}
TRUE = {  # the changes of runs whose figures are those of what was done
    "copies": [(STEP, STEP.replace("(q, v,", "(q.copy(), v.copy(),"))],
    "a break": [(STEP, STEP + "        if i == 70:\n            break\n")],
    "drag": [beside("-0.4 * v")],
    "a spring": [beside("-30.0 * q")],
    "a load": [beside("np.array([3.0, 0.0, -1.0])")],
    "a magnet": [beside("np.cross(v, [0.0, 3.0, 0.0])")],
    "damping in a corner": [beside("np.where(q < -0.8, -5.0, 0.0) * v")],
    "a branch": [beside("5.0 * (q[0, 1] < -0.5)")],
    "a branch under try": [times("f", f"{BRANCH}    except Exception:\n        pass\n    ")],
    "another type": [beside("5.0 * isinstance(q[0, 1], float)")],
}
ERRORS = {  # the changes, and what they raise
    "lists": ([before(BEGIN, "    q = q.tolist()\n    v = v.tolist()\n")], NotAState),
    "single precision": ([before(BEGIN, "    q = q.astype(np.float32)\n")], NotAState),
    "a rod that is cut": ([later("system['pairs'] = system['pairs'][:1]")], ValueError),
}
FIGURES = "energy_rel_max", "tension_max", "error"


def taken(changes, plainly, system=DOUBLE, dt=DT, steps=STEPS):
    """A run under an edited file, and its row."""
    chapter = edited(*changes)
    with plain(plainly):
        run = chapter.run_method(system, "baumgarte", "semi_implicit", dt, steps)
        known = Truth(1, "", system["q0"], 1e-12)
        row = chapter.summary(system, run, chapter.make_methods(dt)["baumgarte"], known)
        conserves = conserving(system, chapter.external_force, chapter.energy)
        asked = SimpleNamespace(conserves=conserves)
        return run, report.completed(asked, run, row)


@pytest.mark.parametrize("name", UNLIKE)
def test_what_an_edited_loop_makes_another_run_has_no_figures_and_a_reason(name):
    changes, word = UNLIKE[name]
    usual, _ = taken([], False)
    slow, _ = taken(changes, True)
    run, row = taken(changes, False)
    assert word in run.unlike.split() and row["unlike"] == run.unlike == slow.unlike
    assert [row[key] for key in FIGURES] == [None] * 3
    assert np.array_equal(run.q, slow.q)
    assert not np.array_equal(run.q, usual.q[: len(run.q)])  # it was obeyed


@pytest.mark.parametrize("name", CHANGED)
def test_what_a_step_reads_beside_its_arguments_is_found_if_it_changes(name):
    changes, word = CHANGED[name]
    with pytest.raises(StepChanged):
        taken(changes, False)
    run, row = taken(changes, True)
    assert word in run.unlike.split()
    assert [row[key] for key in FIGURES] == [None] * 3


@pytest.mark.parametrize("plainly", [False, True])
def test_a_force_of_a_tenth_of_the_time_along_a_rod_that_moves_nothing_is_found(plainly):
    """So README loads a hanging rod: 200 N from 2 to 4 s of 20 s."""
    changes, word = CHANGED["a force of time"]
    *ready, (line, _) = changes
    changes = [*ready, (line, f"{FORCE} + np.array([0.0, -200.0 * (2.0 <= t < 4.0), 0.0])")]
    run, row = taken(changes, plainly, HANGING, 0.005, 4000)
    assert np.array_equal(run.q[-1], HANGING["q0"]) and row["tension_max"] is None
    assert word in run.unlike.split()


def seen(changes, steps):
    """What the loop by hand does: at each state q, v, the rods' force and what acts beside it."""
    chapter = edited(*changes)
    found = []
    usual = chapter.constraint_force

    def noted(system, q, v, w):
        rods = usual(system, q, v, w)
        found.append((q.copy(), v.copy(), rods, chapter.external_force(system, q, v)))
        return rods

    chapter.constraint_force = noted
    force = chapter.make_force(DOUBLE, 20.0)
    chapter.trajectory(chapter.semi_implicit_step, DOUBLE, force, DT, steps + 1)
    return [np.array(x) for x in zip(*found, strict=True)]


@pytest.mark.parametrize("plainly", [False, True])
@pytest.mark.parametrize("name", TRUE)
def test_figures_of_an_edited_run_are_those_of_what_was_done(name, plainly):
    run, row = taken(TRUE[name], plainly)
    many = len(run.q)
    assert run.unlike is None and many == (71 if name == "a break" else STEPS + 1)
    q, v, rods, others = (x[:many] for x in seen(TRUE[name], STEPS))
    assert np.array_equal(run.q[: len(q)], q) and np.array_equal(run.v[: len(v)], v)
    pulls = [smallest_pulls(DOUBLE | {"q0": x}, y) for x, y in zip(q, rods, strict=True)]
    assert row["tension_max"] == pytest.approx(np.max(np.abs(pulls)), rel=1e-6)
    power = np.sum((others - weight(DOUBLE)) * v, axis=(1, 2))
    assert row["conserves"] == (np.max(np.abs(power)) < 1e-9)
    assert row["energy_rel_max"] == pytest.approx(energy_off(DOUBLE, q, v), rel=1e-9)


@pytest.mark.parametrize("plainly", [False, True])
@pytest.mark.parametrize("name", ERRORS)
def test_what_is_no_step_is_an_error(name, plainly):
    changes, error = ERRORS[name]
    with pytest.raises(error):
        taken(changes, plainly)


# --- where it ends ---
def test_states_are_good_while_they_are_finite_and_rods_below_a_hundred_times_all_of_them():
    system = {"lengths": np.array([0.5, 1.5])}
    still = np.zeros(4)
    for worst, energies, good in (
        ([0.0, 199.0, 201.0, 0.1], still, 2),
        ([0.0, 0.1, 0.1, np.nan], still, 3),
        (still, [0.0, np.inf, 0.0, 0.0], 1),
        ([np.nan, 0.0, 0.0, 0.0], still, 1),  # the start
        (still, still, 4),
    ):
        assert how_many_good(system, np.array(worst), np.array(energies)) == good


def test_a_run_is_kept_to_where_it_is_good_and_says_whether_its_loop_ended_or_a_step_failed(
    monkeypatch,
):
    system = c.build_system("pendulum")
    monkeypatch.setattr(
        c, "make_methods", lambda *_, **__: {"torn": c.Method(c.make_force, "tears", torn)}
    )
    lost = c.run_method(system, "torn", "rk4", DT, 200)
    assert "it is torn" in lost.lost == lost.stopped
    assert len(lost.q) == len(lost.v) == len(lost.tip) == len(lost.energies) < 200
    assert lost.q[-1, 0, 1] >= -0.5 > lost.q[-1, 0, 1] + DT * lost.v[-1, 0, 1] - 1e-3
    monkeypatch.undo()
    wild = c.run_method(system, "baumgarte", "euler", 0.1, 400, baumgarte=500.0)
    assert wild.lost
    assert how_many_good(system, wild.violations, wild.energies) == len(wild.violations)
    kept, _ = taken(TRUE["a break"], False)
    assert kept.stopped and not kept.lost
    whole, _ = taken([], False)
    assert whole.stopped is whole.lost is None and whole.unlike is None


def test_what_a_run_returns_goes_through_a_pool_of_processes(tmp_path):
    script = tmp_path / "pool.py"
    script.write_text("""
import constraints as c
from curriculum.ch3_4_constraints import report
from multiprocessing import get_context
def run(seed):
    return c.run_method(c.build_system("double", seed), "project", "rk4", 0.005, 40)
if __name__ == "__main__":
    with get_context("spawn").Pool(2) as pool:
        for seed, done in enumerate(pool.map(run, range(2))):
            alone = run(seed)
            assert (alone.q == done.q).all() and (done.tip == done.q[:, -1]).all()
            assert done.report.how == "compiled to Python" and done.report.source
            assert done.pace > 0.0 and done.operations == alone.operations
            assert done.unlike is None and done.report.is_compiled
        print("done")
""")
    done = python(script, variables={"PYTHONPATH": str(ROOT)})
    assert (done.stdout, done.stderr) == ("done\n", "")


# --- the loop by hand ---
BY_HAND = [*product(c.make_methods(), ["semi_implicit"]), ("baumgarte", "rk4"), ("none", "euler")]


def test_what_the_script_says_that_compare_prints_is_what_it_prints(capsys):
    source = (ROOT / "constraints.py").read_text(encoding="utf-8")
    call, said = re.search(r"\n# Then (compare.*) prints\n((?:#     .*\n)+)", source).groups()
    exec(call, vars(c).copy())
    printed = capsys.readouterr().out
    assert printed == said.replace("#     ", "")
    earlier = re.search(r"rod ([\d.]+) mm off with w = 0, and ([\d.]+) mm", source).groups()
    assert [*map(float, earlier)] == [float(x.split()[1]) for x in printed.splitlines()[:2]]


def test_the_rows_of_a_table_that_the_script_shows_are_those_that_main_prints(capsys, tmp_path):
    source = (ROOT / "constraints.py").read_text(encoding="utf-8")
    comment = re.search(r"((?: +# .*\n)+) +return \[\n", source)[1]
    shown = [re.sub(r"^    # ", "", line) for line in comment.splitlines()]
    c.main([*BARE, "--out", str(tmp_path)])
    printed = capsys.readouterr().out.splitlines()
    first = printed.index("") + 1  # of the table
    without_time = slice(0, -len("  a step"))
    assert [x[without_time] for x in shown] == [x[without_time] for x in printed[first:][:3]]


@pytest.mark.parametrize(("name", "integrator"), BY_HAND)
def test_a_loop_by_hand_over_the_file_without_its_report_has_the_bits_of_a_run(name, integrator):
    """So the published course's generator of figures executes it."""
    source = (ROOT / "constraints.py").read_text(encoding="utf-8")
    file = {"__file__": str(ROOT / "constraints.py"), "__name__": "generator"}
    prefix = source[: source.index("# --- region: report ---")]
    as_the_course_does = __future__.annotations.compiler_flag  # in a name that is no module's
    exec(compile(prefix, "constraints.py", "exec", as_the_course_does), file)
    hand = SimpleNamespace(**file)
    system = DOUBLE
    method = hand.make_methods(0.005)[name]
    step_fn = hand.stabilized(hand.INTEGRATORS[integrator], system, method)
    force = method.make_force(system)
    run = c.run_method(system, name, integrator, 0.005, 20)
    q = system["q0"]
    v = system["v0"]
    for i in range(20):
        q, v = step_fn(q, v, system["m"], force, 0.005)
        assert np.array_equal([q, v], [run.q[i + 1], run.v[i + 1]])
        assert hand.energy(system, q, v) == run.energies[i + 1]
        assert hand.constraint_violation(system, q) == run.violations[i + 1]
    measured = hand.simulate(step_fn, system, force, 0.005, 20)
    assert all(map(np.array_equal, measured, (run.tip, run.violations, run.energies)))
    states = hand.trajectory(step_fn, system, force, 0.005, 20)
    assert all(map(np.array_equal, states, (run.q, run.v)))
