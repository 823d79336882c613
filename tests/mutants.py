"""Do the tests bite?  One line of a copy is broken at a time, and the tests that should notice are
run on it.

    python -m tests.mutants [WORD ...]      all of them, or those whose name or file contains a
    word; a few minutes

A mutant that no test catches survives, and then the exit status is 1: a test is missing. So it is
if the line to break is no longer there, or the tests fail before anything is broken: then this file
is to be mended.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from curriculum.common.banner import progress
from curriculum.common.cli import Parser, run_script

ROOT = Path(__file__).resolve().parents[1]
PARTS = "constraints.py", "curriculum", "tests", "pyproject.toml", "README.md"
LIMIT = 60  # s a file: a mutant that hangs is caught, too
FORCE, MOTION, UNROLL, RULER = (
    "tests/test_force.py",
    "tests/test_motion.py",
    "tests/test_unroll.py",
    "tests/test_ruler.py",
)
LINE, FILES, RESULTS = (
    "tests/test_command_line.py",
    "tests/test_files.py",
    "tests/test_results.py",
)
LARGE = "tests/test_large.py"
SCENES, RECORDING = "tests/test_scenes.py", "tests/test_recording.py"

MUTANTS = {  # file: [(what is wrong, the text as it stands there once, what takes its place, who should notice)]
    "constraints.py": [
        ("a rod pulls both ends the same way", "jac[..., k, j, :] = -d", "jac[..., k, j, :] = d", FORCE),
        ("Jdot v with the wrong sign", "+ hold.use_jdotv * jdotv)", "- hold.use_jdotv * jdotv)", FORCE),
        ("damping with the wrong sign", "- hold.damping * gdot", "+ hold.damping * gdot", FORCE),
        ("stiffness with the wrong sign", "- hold.stiffness * g\n", "+ hold.stiffness * g\n", FORCE),
        ("soft measures g like the others", "    if hold.softness:", "    if False:", FORCE),
        ("tensions with the wrong sign", "return -lam * (rod_errors", "return lam * (rod_errors", FORCE),
        ("the slack is not taken back", "lam = b + spare * lam", "lam = b + 0.0 * lam", FORCE),
        ("an elimination in any order", "in reversed(order):", "in order:", FORCE),
        ("rk4 weighs its third stage once", "2.0 * (a2 + a3)", "(2.0 * a2 + a3)", MOTION),
        ("semi-implicit Euler is explicit", "    v = v + dt * (force(q, v) / m)\n    return q + dt * v, v\n",
            "    return q + dt * v, v + dt * (force(q, v) / m)\n", MOTION),
        ("v is not told of the projection", "v = v + (end - q) / dt", "v = v + 0.0 * (end - q) / dt", MOTION),
        ("four rounds of Newton's iteration", "repeat(newton, q, 20,", "repeat(newton, q, 4,", MOTION),
        ("potential energy with the wrong sign", "- m * dot(q, GRAVITY)", "+ m * dot(q, GRAVITY)", MOTION),
        ("what is not finite is sane", " & np.isfinite(energies)", "", MOTION),
        ("Euler's limit is 1.98", '{"euler": 2.0,', '{"euler": 1.98,', MOTION),
        ("--smoke ignored", "SMOKE_STEPS if args.smoke else args.steps", "args.steps", RESULTS),
        ("--tol accepted without gauss", 'args.tol and args.integrator != "gauss"', "False", LINE),
        ("a verdict on short runs", 'len(runs["none"].tip) > SMOKE_STEPS', "True", RESULTS),
        ("error_at by the asked step", '"error_at": truth.step * dt', '"error_at": truth.step * args.dt', RESULTS),
        ("the out folder not tried before the run",
            'args.out = parser.attempt("--out", results_folder, args.out)', "args.out = Path(args.out)", LINE),
        ("the verdict upside down", "none > 3.0 * helped", "none < 3.0 * helped", RESULTS),
    ],
    "curriculum/common/trace.py": [
        ("-a - b is a + b", 'self.note("+", b, self.minus)', 'self.note("+", b)', UNROLL),
        ("a + 0 is -a", "return b if self.x == 0.0 else self", "return b if self.x == 0.0 else -self", UNROLL),
        ("a quotient loses its sign", "self.note(\"/\", b, minus)", "self.note(\"/\", b)", UNROLL),
    ],
    "curriculum/common/arrays.py": [
        ("a buffer is used again too soon", " == k and x not in kept}", " >= 0}", UNROLL),
    ],
    "curriculum/common/motion.py": [
        ("a block begins where the last began", "self.columns = states[-1]", "self.columns = states[0]", MOTION),
        ("the pace is off by one step", "max(1, len(self.tip) - 1)", "len(self.tip)", MOTION),
        ("a step is never tried in halves", "if level == HALVINGS or", "if level == 0 or", RULER),
    ],
    "curriculum/common/gauss.py": [
        ("gauss remembers across dt", "(gauss_step, dt, q.shape)", "(gauss_step, q.shape)", RULER),
        ("gauss never mends a step ahead", "if k > 2 and (settled", "if False and (settled", RULER),
    ],
    "curriculum/common/ruler.py": [
        ("the ruler accepts a millimetre", "KNOWN = 1e-9", "KNOWN = 1e-3", RULER),
        ("a budget without end", "self.left -= 1", "self.left -= 0", RULER),
        ("a tolerance that nobody can judge", "if tol and not truth[1] < tol:", "if False:", RESULTS),
        ("a step lost", "math.ceil(seconds / dt - 1e-9)", "math.floor(seconds / dt)", RESULTS),
    ],
    "curriculum/ch3_4_constraints/large.py": [
        ("a rod of a chain pulls both ends alike", "felt[..., :-1] -= ", "felt[..., :-1] += ", FORCE),
        ("a halving forgets the right neighbour", "half -= right * up", "half -= 0.0 * up", FORCE),
        ("loops without slack", "((slack, rounds) if rods.loop else (0.0, 1))", "(0.0, 1)", LARGE),
        ("few rods, all tied, written out", "> FILL", "> 1e9", LARGE),
        ("an endless way back for long chains", "np.all(np.abs(g) <= near)",
            "np.all(np.sum(np.square(g / near), axis=-1) <= 1.0)", LARGE),
    ],
    "curriculum/ch3_4_constraints/recording.py": [
        ("one colour for all modes", "COLORS.get(mode, GREY)", "GREY", RECORDING),
        ("the trail of another particle", "positions=run.q[:, -1]", "positions=run.q[:, 0]", RECORDING),
        ("the camera behind the scene", "half[2] + reach / SLOPE]", "-half[2] - reach / SLOPE]", RECORDING),
        ("no anchors", '["$origin/**", "scene/anchors"]', '["$origin/**"]', RECORDING),
        ("curves swapped", "pulls[mode][:, 0] for mode", "pulls[mode][:, -1] for mode", RECORDING),
        ("no thinning", "max(1, round(1.0 / (FRAME_RATE * dt)), ", "max(1, ", RECORDING),
        ("no cap", ", -(-(steps + 1) // most)))", ", 1))", RECORDING),
    ],
    "curriculum/ch3_4_constraints/scene_files.py": [
        ("a taut cable let through", "if abs(row @ curl) > TAUT", "if abs(row @ curl) > 1e9", SCENES),
        ("the second of two equal keys counts", "if len(found) < len(items):", "if False:", SCENES),
        ("any number of particles", "0 < len(rows) <= MOST", "0 < len(rows)", SCENES),
        ("a pipe is read", "not path.is_file() or ", "", SCENES),
    ],
    "curriculum/ch3_4_constraints/publish.py": [
        ("tol missing from the metrics", '"impedance", "tol"', '"impedance"', RULER),
        ("an old recording beside new numbers", ", RECORDING: None}", "}", FILES),
        ("a full disk costs the old recording", "if (args.out / name).exists():", "if False:", FILES),
        ("half a recording stays", "            path.unlink(missing_ok=True)\n", "", FILES),
    ],
    "curriculum/common/files.py": [
        ("files written in place", "writers[name](aside / name)", "writers[name](folder / name)", FILES),
        ("two runs at once", "fcntl.flock(handle, fcntl.LOCK_EX)", "pass", FILES),
        ("Ctrl-C between two files", "stack.enter_context(ThreadPoolExecutor(1)).submit(rename).result()",
            "rename()", FILES),
        ("NaN in JSON", "allow_nan=False", "allow_nan=True", FILES),
        ("a device replaced by a file", "if path.exists() and not path.is_file():", "if path.is_dir():", FILES),
        ("what a killed run left stays", "shutil.rmtree(left, ignore_errors=True)", "pass", FILES),
    ],
    "curriculum/common/cli.py": [
        ("a traceback at | head", "isinstance(error, BrokenPipeError)", "False", LINE),
        ("a signal is not heeded", "is not signal.SIG_IGN", "is signal.SIG_IGN", LINE),
        ("digits of any script", ", text, re.ASCII)", ", text)", LINE),
        ("1e-400 is zero", "if lost or not low", "if not low", LINE),
        ("a file takes a closed stream's place", "os.O_RDWR)) < 3:", "os.O_RDWR)) < 0:", LINE),
        ("frames of ours in a traceback", "shown.stack[:] = own or shown.stack", "pass", LINE),
    ],
    "curriculum/common/banner.py": [
        ("every run is said to take so long", "if default else ()", "if True else ()", LINE),
        ("progress at once", "taken > max(SURE, shown + 0.1)", "taken > shown + 0.1", LINE),
        ("progress of one part", "(before + step / steps) / parts", "step / steps", LINE),
    ],
}  # fmt: skip


def tests(folder, files):
    """What pytest says of test files in a copy of the tree: its exit status and its last line; None
    if it hangs."""
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", *files]
    settings, limit = os.environ | {"PYTHONDONTWRITEBYTECODE": "1"}, LIMIT * len(files)
    try:
        done = subprocess.run(
            command, cwd=folder, env=settings, capture_output=True, text=True, timeout=limit
        )
    except subprocess.TimeoutExpired:
        return None, f"did not end in {limit} s"
    return done.returncode, (done.stdout.strip() or done.stderr.strip() or "nothing").splitlines()[
        -1
    ]


def fate(folder, file, old, new, test):
    """What becomes of a mutant, in words that begin with "caught" if all is well."""
    path = folder / file
    text = path.read_text(encoding="utf-8")
    if text.count(old) != 1:
        return f"NOT MADE: its line is there {text.count(old)} times"
    path.write_text(text.replace(old, new), encoding="utf-8")
    try:
        status, said = tests(folder, [test])
    finally:
        path.write_text(text, encoding="utf-8")
    if status in (None, 1):  # 1: a test failed
        return f"caught: {said}"
    return f"SURVIVED: {said}" if status == 0 else f"NO TESTS: {said}"


def main(argv=None):
    """Break, test, mend, in turn; returns 1 unless all are caught."""
    parser = Parser(prog="mutants", usage="python -m tests.mutants [WORD ...]", description=__doc__)
    parser.add_argument(
        "words", nargs="*", metavar="WORD", help="only mutants whose name or file contains it"
    )
    words = parser.parse_args(argv).words or [""]
    chosen = [(file, *mutant) for file, mutants in MUTANTS.items() for mutant in mutants]
    chosen = [
        mutant for mutant in chosen if any(word in f"{mutant[0]}: {mutant[1]}" for word in words)
    ]
    if not chosen:
        parser.error(f"argument WORD: no mutant is called {' or '.join(words)}")
    with tempfile.TemporaryDirectory() as name:
        folder, tick, wrong = Path(name), progress("breaking", len(chosen) + 1), []
        for part in PARTS:
            copy = shutil.copytree if (ROOT / part).is_dir() else shutil.copy
            copy(ROOT / part, folder / part)
        status, said = tests(folder, sorted({mutant[-1] for mutant in chosen}))
        if status != 0:
            print(f"mutants: the tests fail before anything is broken: {said}", file=sys.stderr)
            return 1
        for k, (file, what, *rest) in enumerate(chosen):
            tick(k + 1)
            end = fate(folder, file, *rest)
            wrong += [] if end.startswith("caught") else [what]
            print(f"{file.rpartition('/')[2]:<15} {what:<42} {end}", flush=True)
        tick(len(chosen) + 1)
    print(f"{len(chosen) - len(wrong)} of {len(chosen)} caught")
    return 1 if wrong else 0


if __name__ == "__main__":
    run_script(main)
