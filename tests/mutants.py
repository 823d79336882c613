"""Do the tests bite?  One line of a copy is broken at a time, and its tests are run on the copy.

    python -m tests.mutants [WORD ...]      all, or those whose name or file contains a word
    python -m tests.mutants --share 0.1     a tenth of them, drawn by the commit

A mutant that no test catches survives, and then the exit status is 1: a test is missing. So it is
if the line to break is no longer there, or the tests fail before anything is broken: then this file
is to be mended.
"""

import math
import os
import random
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from curriculum.common.banner import progress
from curriculum.common.cli import Parser, number, run_script

ROOT = Path(__file__).resolve().parents[1]
PARTS = "constraints.py", "curriculum", "tests", "pyproject.toml", "README.md"
LIMIT = 300  # s a file: a mutant that hangs is caught, too

MUTANTS = {  # (file, its tests): what is wrong, what stands there once, its replacement, ...
    ("constraints.py", "force"): [
     ("a rod pulls both ends the same way", "jac[..., k, j, :] = -d", "jac[..., k, j, :] = d"),
     ("Jdot v with the wrong sign", "+ hold.use_jdotv * jdotv)", "- hold.use_jdotv * jdotv)"),
     ("damping with the wrong sign", "- hold.damping * gdot", "+ hold.damping * gdot"),
     ("stiffness with the wrong sign", "- hold.stiffness * g\n", "+ hold.stiffness * g\n"),
     ("soft measures g like the others", "    if hold.softness:", "    if False:"),
     ("tensions with the wrong sign", "return -lam * (rod_errors", "return lam * (rod_errors"),
    ],
    ("curriculum/ch3_4_constraints/scene_files.py", "runs"): [
     ("a force for other steps", "if made_for not in (None, dt):", "if False:"),
    ],
    ("curriculum/ch3_4_constraints/studies/chaos.py", "chaos"): [
     ("a standard error without n - 1", "ddof=1", "ddof=0"),
    ],
    ("curriculum/ch3_4_constraints/studies/hard_cases.py", "hard_cases"): [
     ("the longest rod as limit", "RODS * np.min(", "RODS * np.max("),
     ("shares upside down", "if share else", "if not share else"),
    ],
    ("curriculum/ch3_4_constraints/studies/speed_vs_error.py", "real_thing"): [
     ("ahead if anybody is slower", "min(those) >= mine", "min(those) <= mine"),
    ],
    ("curriculum/ch3_4_constraints/tables.py", "real_thing"): [
     ("quartiles swapped", "[50, 25, 75]", "[50, 75, 25]"),
    ],
    ("curriculum/ch3_4_constraints/tables.py", "results"): [
     ("the verdict upside down", "if ratio > 3.0 else", "if ratio < 3.0 else"),
    ],
    ("curriculum/common/elimination.py", "force"): [
     ("the blur is not taken back", "x + rough(rest)", "x + 0.0 * rough(rest)"),
     ("an elimination in any order", "in reversed(order):", "in order:"),
    ],
    ("constraints.py", "motion"): [
     ("semi-implicit Euler is explicit",
        "    v = v + dt * (force(q, v) / m)\n    return q + dt * v, v\n",
        "    return q + dt * v, v + dt * (force(q, v) / m)\n"),
     ("v is not told of the projection", "v = v + (end - q) / dt", "v = v + 0.0 * (end - q) / dt"),
     ("four rounds of Newton's iteration", "repeat(newton, q, 20,", "repeat(newton, q, 4,"),
     ("potential energy with the wrong sign", "- m * dot(q, GRAVITY)", "+ m * dot(q, GRAVITY)"),
     ("Euler's limit is 1.98", '{"euler": 2.0,', '{"euler": 1.98,'),
     ("rk4 weighs its third stage once", "+ 2.0 * a2 + 2.0 * a3 +", "+ 2.0 * a2 + a3 +"),
     ("a step is not mended", 'getattr(force, "after", None)', "None"),
    ],
    ("constraints.py", "results"): [
     ("--smoke ignored", "SMOKE_STEPS if args.smoke else args.steps", "args.steps"),
     ("a verdict on short runs", " and steps >= SMOKE_STEPS", ""),
     ("error_at by the asked step", '"error_at": truth.step * dt',
        '"error_at": truth.step * args.dt'),
    ],
    ("constraints.py", "command_line"): [
     ("--tol accepted without gauss", 'args.tol and args.integrator != "gauss"', "False"),
     ("the out folder not tried before", "if not args.show_step:  # last", "if False:  # last"),
    ],
    ("constraints.py", "runs"): [
    ],
    ("curriculum/common/trace.py", "trace"): [
     ("-a - b is a + b", 'self.note("+", b, self.minus)', 'self.note("+", b)'),
     ("a + 0 is -a", "return b if self.x == 0.0 else self", "return b if self.x == 0.0 else -self"),
     ("a quotient loses its sign", 'self.note("/", b, minus)', 'self.note("/", b)'),
     ("the base of a power loses its minus", 'a.plain().note("**"', 'a.note("**"'),
     ("an argument loses its minus", "symbol.plain().note(name)", "symbol.note(name)"),
     ("a - b is b - a", 'if sign in "+*" and', 'if sign in "+*-" and'),
     ("zeros of a loop stay zero", "if set(grown) <= set(places):", "if True:"),
     ("numbers of an earlier call", "not tape.open or not Tape.current.sees(tape)", "False"),
     ("a refusal that is caught is none", "self.tape.refused.append(why)", "pass"),
     ("an imaginary part is dropped", 'Tape.current.refused.append("it makes',
        '[].append("it makes'),
     ("one trace of a routine for all zeros", "mask.tobytes())", "0)"),
     ("a routine's arguments swapped", "zip(self.inputs, arguments, strict",
        "zip(self.inputs, arguments[::-1], strict"),
     ("a routine is never inlined", "if not program.tape.parts and", "if False and"),
     ("what lasts is done each time", "self.out)]) - set(self.knobs)", "self.out)]) - found"),
     ("a size that stays is no end", " | ((last <= size) & (size <= nearly))", ""),
     ("members that are done go on", "np.where(kept, x, following)", "following"),
    ],
    ("curriculum/common/trace.py", "steps"): [
     ("0 / 0 is 0", "nothing = self.x == 0.0 and safe", "nothing = self.x == 0.0"),
     ("a body works on what it was given", "body(x.copy())", "body(x)"),
    ],
    ("curriculum/common/python.py", "trace"): [
     ("no inf in the code", '{"inf": math.inf, "nan"', '{"nan"'),
     ("a - (b - c) is a - b - c", "text(right, bound + 1)", "text(right, bound)"),
     ("-(a + b) is -a + b", "-{text(s.x, 2)}", "-{text(s.x, 1)}"),
     ("a loop that does not end is fine", 'yield from ("else:",', 'yield from [] and ("else:",'),
     ("what a loop takes is put in place", "operands * 2 if", "operands if"),
     ("a call's arguments swapped", "map(signed, part.arguments)",
        "map(signed, part.arguments[::-1])"),
    ],
    ("curriculum/common/arrays.py", "trace"): [
     ("a buffer is used again too soon", " == k and x not in kept]", " >= 0]"),
     ("a negative over what is still read", 'not in ("part", "of") and not s.minus:',
        'not in ("part", "of"):'),
     ("members that are done go on", "{target}, where=logical_not({done})", "{target}, where=True"),
     ("a loop ends with the first", "{done}.all()", "{done}.any()"),
     ("a size that stays is no end", "({last} <= {size}) & (", "({last} < 0.0) & ("),
     ("an argument loses its minus", "            if symbol.minus:\n                given",
        "            if False:\n                given"),
    ],
    ("curriculum/common/native.py", "native"): [
     ("trouble is ignored", "br i1 {w.trouble}, label %trouble", "br i1 false, label %trouble"),
     ("a divisor of zero is no trouble", 'if sign == "/" and right', "if False and right"),
     ("what is not finite is no trouble", 'if sign != "abs" and self.lanes',
        "if False and self.lanes"),
     ("a routine's trouble is its own", "or i1 {self.trouble}, {failed}",
        "or i1 {self.trouble}, false"),
     ("a call's arguments swapped", "for s in call.arguments]", "for s in call.arguments[::-1]]"),
     ("a lane that is done goes on", "{t} {old}, {t} {new}", "{t} {new}, {t} {new}"),
     ("a loop ends with its first lane", "llvm.vector.reduce.and.v", "llvm.vector.reduce.or.v"),
     ("lanes that never end are zero", "nan = self.constant(np.nan)", "nan = self.constant(0.0)"),
     ("a size that stays is no end", "fcmp ole {t} {last}, {size}",
        "fcmp false {t} {last}, {size}"),
     ("the last lanes are left out", "state[:, whole:] = few[:, : members - whole]", "pass"),
    ],
    ("curriculum/common/steps.py", "steps"): [
     ("halves of the wrong length", "state = step(state, 0.5 * dt)", "state = step(state, dt)"),
     ("halves of halves of the wrong length", "in_halves(step, state, 0.5 * dt, level",
        "in_halves(step, state, dt, level"),
     ("a half is not halved", "if level == HALVINGS or", "if level == 1 or"),
     ("no check at a block's edge", "if self.check and sane and not self.agrees(before",
        "if False and not self.agrees(before"),
     ("what functions keep is not seen", "why = memory.changed() or why", "pass"),
     ("a block begins where the last began", "q, v = q[-1], v[-1]", "q, v = q[0], v[0]"),
     ("a budget without end", "[], self.tries - 1", "[], self.tries"),
     ("no numpy after an arithmetic error", "            return self.by_plain(state, dt)\n",
         "            raise\n"),
     ("zero in one member is zero in all", "zero = [np.all(a == 0.0,", "zero = [np.any(a == 0.0,"),
     ("what begins as zero stays zero", "if all(map(np.array_equal, still, stays)):", "if True:"),
    ],
    ("curriculum/common/runs.py", "runs"): [
     ("what is not finite is sane", " & np.isfinite(energies)", ""),
     ("the pace is off by one step", "max(1, len(self.tip) - 1)", "len(self.tip)"),
     ("time of steps that were not true", "stepper.seconds * self.done / max(1, stepper.taken)",
        "stepper.seconds"),
     ("other steps are kept", "self.kept.append((rows + first,", "self.kept.append((rows,"),
    ],
    ("curriculum/common/gauss.py", "ruler"): [
     ("stages that resolve nothing", "wild = rough / (", "wild = 0.0 * rough / ("),
     ("positions with weights of speeds", "late = b * (1.0 - c)", "late = b"),
     ("nodes for polynomials of less", "n[-2:]]", "n[:2]]"),
    ],
    ("curriculum/common/ruler.py", "ruler"): [
     ("the ruler accepts a millimetre", "KNOWN = 1e-9", "KNOWN = 1e-3"),
     ("a budget that is not spent", "        most -= steps\n", ""),
     ("a tolerance that nobody can judge", "if tol and not truth[1] < tol:", "if False:"),
     ("a step lost", "math.ceil(seconds / dt - 1e-9)", "math.floor(seconds / dt)"),
    ],
    ("curriculum/ch3_4_constraints/large.py", "large"): [
     ("a rod of a chain pulls both ends alike", "felt[..., :-1] -= ", "felt[..., :-1] += "),
     ("a halving forgets the right neighbour", "half -= right * up", "half -= 0.0 * up"),
     ("few rods, all tied, written out", "> FILL", "> 1e9"),
    ],
    ("curriculum/ch3_4_constraints/recording.py", "recording"): [
     ("the trail of another particle", "positions=run.q[:, -1]", "positions=run.q[:, 0]"),
     ("curves swapped", "pulls[mode][:, 0] for mode", "pulls[mode][:, -1] for mode"),
     ("no thinning", "max(1, round(1.0 / (FRAME_RATE * dt)), ", "max(1, "),
     ("no cap", ", -(-(steps + 1) // most)))", ", 1))"),
    ],
    ("curriculum/ch3_4_constraints/scene_files.py", "scenes"): [
     ("the second of two equal keys counts", "if len(found) < len(items):", "if False:"),
     ("a pipe is read", "not path.is_file() or ", ""),
    ],
    ("curriculum/ch3_4_constraints/publish.py", "results"): [
     ("tol missing from the metrics", '"impedance", "tol"', '"impedance"'),
    ],
    ("curriculum/ch3_4_constraints/publish.py", "files"): [
     ("an old recording beside new numbers", ", RECORDING: None}", "}"),
     ("a full disk costs the old recording", "if (args.out / name).exists():", "if False:"),
     ("half a recording stays", "            path.unlink(missing_ok=True)\n", ""),
    ],
    ("curriculum/common/files.py", "files"): [
     ("files written in place", "writers[name](aside / name)", "writers[name](folder / name)"),
     ("two runs at once", "fcntl.flock(handle, fcntl.LOCK_EX)", "pass"),
     ("NaN in JSON", "allow_nan=False", "allow_nan=True"),
     ("a device replaced by a file", "if path.exists() and not path.is_file():",
        "if path.is_dir():"),
     ("what a killed run left stays", "shutil.rmtree(left, ignore_errors=True)", "pass"),
    ],
    ("curriculum/common/cli.py", "command_line"): [
     ("a traceback at | head", "isinstance(error, BrokenPipeError)", "False"),
     ("a signal is not heeded", "is not signal.SIG_IGN", "is signal.SIG_IGN"),
     ("digits of any script", ", text, re.ASCII)", ", text)"),
     ("1e-400 is zero", "if lost or not low", "if not low"),
     ("a file takes a closed stream's place", "os.O_RDWR)) < 3:", "os.O_RDWR)) < 0:"),
     ("frames of ours in a traceback", "shown.stack[:] = own or shown.stack", "pass"),
    ],
    ("curriculum/common/banner.py", "command_line"): [
     ("every run is said to take so long", "if default else ()", "if True else ()"),
     ("progress at once", "taken > max(SURE, shown + 0.1)", "taken > shown + 0.1"),
     ("progress of one part", "(before + step / steps) / parts", "step / steps"),
    ],
}  # fmt: skip


def tests(folder, files):
    """What pytest says of test files in a copy: its exit status, None if it hangs; a last line."""
    command = [sys.executable, "-m", "pytest", "-xqp", "no:cacheprovider"]
    command += [f"tests/test_{name}.py" for name in files]
    settings, limit = os.environ | {"PYTHONDONTWRITEBYTECODE": "1"}, LIMIT * len(files)
    how = {"cwd": folder, "env": settings, "capture_output": True, "text": True}
    try:
        done = subprocess.run(command, timeout=limit, **how)
    except subprocess.TimeoutExpired:
        return None, f"did not end in {limit} s"
    said = done.stdout.strip() or done.stderr.strip() or "nothing"
    return done.returncode, said.splitlines()[-1]


def fate(folder, file, test, old, new):
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
    use = "python -m tests.mutants [--share X] [WORD ...]"
    parser = Parser(prog="mutants", usage=use, description=__doc__)
    parser.add_argument("words", nargs="*", metavar="WORD", help="of a mutant's name or file")
    share = "of them, drawn by the commit's hash"
    parser.add_argument("--share", type=number(high=1.0 + 1e-9), default=1.0, help=share)
    args = parser.parse_args(argv)
    words = args.words or [""]
    chosen = [(*place, *mutant) for place, mutants in MUTANTS.items() for mutant in mutants]
    chosen = [one for one in chosen if any(word in f"{one[0]}: {one[2]}" for word in words)]
    if args.share < 1.0:
        head = subprocess.run(["git", "rev-parse", "HEAD"], cwd=ROOT, capture_output=True).stdout
        drawn = random.Random(head).sample(range(len(chosen)), math.ceil(args.share * len(chosen)))
        chosen = [chosen[k] for k in sorted(drawn)]
    if not chosen:
        parser.error(f"argument WORD: no mutant is called {' or '.join(words)}")
    with tempfile.TemporaryDirectory() as name:
        folder, tick, wrong = Path(name), progress("breaking", len(chosen) + 1), []
        for part in PARTS:
            copy = shutil.copytree if (ROOT / part).is_dir() else shutil.copy
            copy(ROOT / part, folder / part)
        status, said = tests(folder, sorted({mutant[1] for mutant in chosen}))
        if status != 0:
            print(f"mutants: the tests fail before anything is broken: {said}", file=sys.stderr)
            return 1
        for k, (file, test, what, *change) in enumerate(chosen):
            tick(k + 1)
            end = fate(folder, file, test, *change)
            wrong += [] if end.startswith("caught") else [what]
            print(f"{file.rpartition('/')[2]:<15} {what:<42} {end}", flush=True)
        tick(len(chosen) + 1)
    print(f"{len(chosen) - len(wrong)} of {len(chosen)} caught")
    return 1 if wrong else 0


if __name__ == "__main__":
    run_script(main)
