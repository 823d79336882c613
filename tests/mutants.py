"""Do the tests bite?  One line of a copy is broken at a time, and its tests are run on the copy.

    python -m tests.mutants [WORD ...]      all, or those whose name, file or tests have a word
    python -m tests.mutants --share 0.1     a tenth of them, drawn by the commit

mutants.toml lists them. Status 1: one survives, its line is gone, or tests fail beforehand, too.
"""

import math
import os
import random
import shutil
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

from curriculum.common.cli import Parser, number, run_script

ROOT = Path(__file__).resolve().parents[1]


def tests(folder, names):
    """What pytest says of test files in a copy: its exit status, 1 if it hangs; what failed."""
    command = [sys.executable, "-m", "pytest", "-xq", *(f"tests/test_{x}.py" for x in names)]
    how = {"cwd": folder, "env": os.environ | {"PYTHONDONTWRITEBYTECODE": "1"}, "text": True}
    try:
        done = subprocess.run(command, capture_output=True, timeout=300 * len(names), **how)
    except subprocess.TimeoutExpired:
        return 1, "did not end in time"
    lines = (done.stdout or done.stderr).splitlines()
    return done.returncode, next((x for x in lines if x.startswith("FAILED")), lines[-1])


def fate(folder, file, test, old, new):
    """What becomes of a mutant, in words that begin with "caught" if all is well."""
    text = (folder / file).read_text("utf-8")
    if text.count(old) != 1:
        return f"NOT MADE: its line is there {text.count(old)} times"
    (folder / file).write_text(text.replace(old, new), "utf-8")
    status, said = tests(folder, [test])
    (folder / file).write_text(text, "utf-8")
    return ("SURVIVED: ", "caught: ")[status] + said if status in (0, 1) else f"NO TESTS: {said}"


def main(argv=None):
    """Break, test, mend, in turn; returns 1 unless all are caught."""
    parser = Parser(prog="mutants")
    parser.add_argument("words", nargs="*", default=[""])
    parser.add_argument("--share", type=number(high=1.0 + 1e-9), default=1.0)
    args = parser.parse_args(argv)
    files = tomllib.loads((ROOT / "tests/mutants.toml").read_text("utf-8"))
    places = [(file, test) for file, tested in files.items() for test in tested]
    chosen = [(*place, *mutant) for place in places for mutant in files[place[0]][place[1]].items()]
    chosen = [x for x in chosen if any(word in " ".join(x[:3]) for word in args.words)]
    if not chosen:
        parser.error(f"no mutant is called {' or '.join(args.words)}")
    head = subprocess.run(["git", "rev-parse", "HEAD"], cwd=ROOT, capture_output=True).stdout
    chosen = sorted(random.Random(head).sample(chosen, math.ceil(args.share * len(chosen))))
    caught = 0
    with tempfile.TemporaryDirectory() as name:
        folder = shutil.copytree(ROOT, Path(name, "copy"), ignore=shutil.ignore_patterns(".*"))
        status, said = tests(folder, sorted({test for _, test, *_ in chosen}))
        if status != 0:
            sys.exit(f"mutants: the tests fail before anything is broken: {said}")
        for file, test, what, change in chosen:
            print(f"{file} {test}: {what}:", end := fate(folder, file, test, *change), flush=True)
            caught += end.startswith("caught")
    print(f"{caught} of {len(chosen)} caught")
    return caught != len(chosen)


if __name__ == "__main__":
    run_script(main)
