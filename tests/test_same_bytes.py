"""Equal runs give equal bytes, whatever the processor lets numpy and its BLAS choose."""

import json
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import constraints

import numpy as np
import pytest

# what numpy found here beyond its baseline: naming anything else would only earn a warning
FEATURES = " ".join(np.show_config(mode="dicts")["SIMD Extensions"].get("found", ()))
# kernels of OpenBLAS and what they need: without it they end in an illegal instruction
KERNELS = {"Prescott": "sse2", "Nehalem": "sse4_2", "Haswell": "avx2", "SkylakeX": "avx512f"}
RUNS = """
import hashlib, json, sys, constraints
simulate, numbers = constraints.simulate, hashlib.sha256()
def noted(*arguments):
    run = simulate(*arguments)
    for series in (*run[:3], run.q, run.v):
        numbers.update(series.tobytes())
    return run
constraints.simulate = noted  # metrics are rounded: look at every bit, and at the ruler's
for folder, flags in json.loads(sys.argv[1]).items():
    constraints.main([*flags.split(), "--no-rerun", "--no-picture", "--out", folder])
for seed in range(500):
    numbers.update(constraints.build_system("pendulum", seed)["q0"].tobytes())
print(numbers.hexdigest())
"""
# scenes short, and where chaos makes a last bit large, long; many rods
CASES = {
    f"{name}_{rule}": f"--system {name} --integrator {rule} --stabilization project --dt 0.02 "
    + ("--steps 500" if name == "triple" else "--steps 20")
    for rule in ("semi_implicit", "rk4", "gauss")
    for name in ("triple", "windows", "jansen_leg")
}
CASES |= {"smoke": "--smoke", "arrays": "--system chain --links 100 --steps 20"}


def environments():
    """The default; then kernels, by turns with one thread and numpy's features off, or neither."""
    cpuinfo = Path("/proc/cpuinfo")
    flags = cpuinfo.read_text(encoding="utf-8").split() if cpuinfo.exists() else []
    fit = [kernel for kernel, needs in KERNELS.items() if needs in flags]
    off = {"NPY_DISABLE_CPU_FEATURES": FEATURES}
    yield from ({},) if fit else ({}, off)
    for k, kernel in enumerate(fit[:1] + fit[1:][-1:]):  # the oldest and the newest
        threads = {"OPENBLAS_CORETYPE": kernel, "OPENBLAS_NUM_THREADS": str(1 + k % 2)}
        yield threads | ({} if k % 2 else off)


def python(*arguments, **variables):
    """What a process of its own prints; nothing of it may be meant for a terminal."""
    settings = {"env": os.environ | variables, "cwd": constraints.HERE, "text": True}
    done = subprocess.run([sys.executable, *arguments], capture_output=True, **settings)
    assert (done.returncode, done.stderr) == (0, "") and "\r" not in done.stdout
    return done.stdout


def test_metrics_are_the_same_bytes_everywhere(tmp_path):
    settings = list(environments())

    def everything(k):
        folders = {name: tmp_path / str(k) / name for name in CASES}
        flags = {str(folders[name]): CASES[name] for name in CASES}
        printed = python("-c", RUNS, json.dumps(flags), **settings[k])
        metrics = {x: (folders[x] / "metrics.json").read_bytes() for x in CASES}
        return metrics, printed.splitlines()[-1]

    with ThreadPoolExecutor(2) as pool:
        (first, numbers), *others = pool.map(everything, range(len(settings)))
    for text in first.values():
        assert all(row["stopped"] is None for row in json.loads(text)["results"].values())
    for (metrics, found), variables in zip(others, settings[1:], strict=True):
        assert [name for name in CASES if metrics[name] != first[name]] == [], variables
        assert found == numbers, variables


def test_smoke_twice_is_the_same_files_and_the_same_recording(tmp_path):
    pytest.importorskip("rerun", reason="to compare recordings: pip install -e .")
    one, two = (tmp_path / name for name in ("one", "two"))
    for folder in (one, two):
        python(constraints.__file__, "--smoke", "--out", str(folder))
    recording, *others = sorted(path.name for path in one.iterdir())
    assert recording.endswith(".rrd") and "metrics.json" in others
    assert all((one / name).read_bytes() == (two / name).read_bytes() for name in others)
    python("-m", "rerun", "rrd", "compare", str(one / recording), str(two / recording))
