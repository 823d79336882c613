"""Breaks one place of the code at a time and runs the tests, which should notice.

python .ci/mutants.py           run the sample in mutants.json, two at a time; fail under 90 %
python .ci/mutants.py --draw    draw a new sample, with a fixed seed, and write it there
"""

import json
import random
import re
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SAMPLE = Path(__file__).with_name("mutants.json")
SEED, CAUGHT = 34, 0.9
CHAPTER, TRACING = "curriculum/ch3_4_constraints", "curriculum/common/tracing"
GROUPS = [  # how many, of which files, and the tests that are to notice, the quickest first
    (9, ["constraints.py"], "test_studies_hard test_output test_command_line test_physics"),
    (5, [f"{TRACING}/*.py"], "test_tracing"),
    (4, [f"{CHAPTER}/{x}.py" for x in ("output", "table", "run")], "test_output test_recording"),
    (5, [f"{CHAPTER}/page/{x}.js" for x in ("play", "parts")], "test_page"),
]
SWAPS = [  # (pattern, what stands there instead)
    (r" \+ ", " - "),
    (r" - ", " + "),
    (r" \* ", " / "),
    (r" / ", " * "),
    (r" < ", " <= "),
    (r" > ", " >= "),
    (r" <= ", " > "),
    (r" >= ", " < "),
    (r" == | === ", " != "),
    (r" != | !== ", " == "),
    (r"\bmax\b", "min"),
    (r"\b2(\.0)?\b", "3"),
    (r"\b0\.5\b", "0.25"),
    (r"\b1\b", "2"),
    (r"\b0\b", "1"),
]
MORE = {
    ".py": [(r" and ", " or "), (r"\bnot ", ""), (r"\bTrue\b", "False"), (r"\bFalse\b", "True")],
    ".js": [(r" && ", " || "), (r"!(?=\w)", ""), (r"\btrue\b", "false"), (r"\bfalse\b", "true")],
}
NOT_CODE = r'^\s*(#|//|"""|\*|/\*|import|from)|"""$'


def places(path):
    """[(line number, old, new)] of all that could be broken in a file."""
    found, in_docstring = [], False
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines()):
        quotes = line.count('"""')
        inside, in_docstring = in_docstring, in_docstring ^ (quotes % 2 == 1)
        if inside or quotes or re.search(NOT_CODE, line):
            continue
        code = re.split(r"  # | // ", line)[0]
        code = re.sub(r'"[^"]*"|`[^`]*`', lambda text: "~" * len(text[0]), code)  # not in strings
        for pattern, new in SWAPS + MORE[path.suffix]:
            for match in re.finditer(pattern, code):
                broken = line[: match.start()] + new + line[match.end() :]
                found.append((number, line, broken))  # noqa: PERF401 - three loops deep
    return found


def draw():
    """Write a new sample: of each group's places so many, with a fixed seed."""
    rng, sample = random.Random(SEED), []
    for many, patterns, tests in GROUPS:
        files = sorted(path for pattern in patterns for path in ROOT.glob(pattern))
        known = [(str(path.relative_to(ROOT)), *place) for path in files for place in places(path)]
        for file, number, old, new in rng.sample(known, many):
            sample.append({"file": file, "line": number + 1, "old": old, "new": new, "by": tests})
    SAMPLE.write_text(json.dumps(sample, indent=1) + "\n", encoding="utf-8")


def caught(mutant, folder):
    """Whether the tests fail in a copy of the project with this one line broken."""
    path = folder / mutant["file"]
    text = path.read_text(encoding="utf-8")
    lines = text.split("\n")
    if lines[mutant["line"] - 1] != mutant["old"]:
        raise SystemExit(f"{mutant['file']} has changed: python .ci/mutants.py --draw")
    lines[mutant["line"] - 1] = mutant["new"]
    path.write_text("\n".join(lines), encoding="utf-8")
    files = [f"tests/{name}.py" for name in mutant["by"].split()]
    command = [sys.executable, "-B", "-m", "pytest", "-xq", "-p", "no:cacheprovider", *files]
    try:
        ended = subprocess.run(command, cwd=folder, capture_output=True, timeout=100).returncode
    except subprocess.TimeoutExpired:
        ended = 1
    path.write_text(text, encoding="utf-8")
    return ended != 0


def run():
    """Run the sample in two copies of the project; exit 1 if too many survive."""
    sample = json.loads(SAMPLE.read_text(encoding="utf-8"))
    with tempfile.TemporaryDirectory() as work, ThreadPoolExecutor(2) as pool:
        copies = [Path(work, str(k)) for k in range(2)]
        for copy in copies:
            shutil.copytree(ROOT, copy, ignore=shutil.ignore_patterns(".git", ".venv", "outputs"))
        halves = [sample[0::2], sample[1::2]]
        parts = pool.map(lambda half, at: [caught(x, at) for x in half], halves, copies)
        found = [each for part in parts for each in part]
    mixed = [x for half in halves for x in half]
    for mutant, noticed in zip(mixed, found, strict=True):
        if not noticed:
            print(f"survived: {mutant['file']}:{mutant['line']}: {mutant['new'].strip()}")
    print(f"{sum(found)} of {len(found)} mutants caught")
    return sum(found) < CAUGHT * len(found)


if __name__ == "__main__":
    sys.exit(draw() if "--draw" in sys.argv else run())
