"""Equal runs give equal bytes, whatever the processor lets numpy and its BLAS choose."""

import json
import os
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import constraints
from curriculum.ch3_4_constraints.studies._runs import SCENES

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
    constraints.main([*flags, "--no-rerun", "--out", folder])
for seed in range(500):
    numbers.update(constraints.build_system("pendulum", seed)["q0"].tobytes())
print(numbers.hexdigest())
"""


def environments():
    """The default; then kernels, by turns with one thread and numpy's features off, or neither."""
    cpuinfo = Path("/proc/cpuinfo")
    flags = cpuinfo.read_text(encoding="utf-8").split() if cpuinfo.exists() else []
    fit = [kernel for kernel, needs in KERNELS.items() if needs in flags]
    off = {"NPY_DISABLE_CPU_FEATURES": FEATURES}
    yield from ({},) if fit else ({}, off)
    for k, kernel in enumerate(fit):
        threads = {"OPENBLAS_CORETYPE": kernel, "OPENBLAS_NUM_THREADS": str(1 + k % 2)}
        yield threads | ({} if k % 2 else off)


def cases():
    """Flags by name: scenes short, and where chaos makes a last bit large, long; many rods."""
    for rule in ("semi_implicit", "rk4", "gauss"):
        flags = ["--integrator", rule, "--stabilization", "project", "--dt", "0.02", "--steps"]
        yield f"triple_{rule}", ["--system", "triple", *flags, "1000"]
        for name in ("windows", "jansen_leg", "braced"):
            yield f"{name}_{rule}", ["--system", str(SCENES / f"{name}.json"), *flags, "20"]
    yield "smoke", ["--smoke"]
    yield "triple", ["--system", "triple", "--steps", "4000"]
    yield "arrays", ["--system", "chain", "--links", "100", "--steps", "40"]


def python(*arguments, **variables):
    """What a process of its own prints; nothing of it may be meant for a terminal."""
    settings = {"env": os.environ | variables, "cwd": constraints.HERE, "text": True}
    done = subprocess.run([sys.executable, *arguments], capture_output=True, **settings)
    assert (done.returncode, done.stderr) == (0, "") and "\r" not in done.stdout
    return done.stdout


def test_metrics_are_the_same_bytes_everywhere(tmp_path):
    wanted, settings = dict(cases()), list(environments())

    def everything(k):
        flags = {str(tmp_path / str(k) / name): flags for name, flags in wanted.items()}
        printed = python("-c", RUNS, json.dumps(flags), **settings[k])
        metrics = {
            name: (tmp_path / str(k) / name / "metrics.json").read_bytes() for name in wanted
        }
        return metrics, printed.splitlines()[-1]

    with ThreadPoolExecutor(2) as pool:
        (first, numbers), *others = pool.map(everything, range(len(settings)))
    for text in first.values():
        assert all(row["stopped"] is None for row in json.loads(text)["results"].values())
    for (metrics, found), variables in zip(others, settings[1:], strict=True):
        assert [name for name in wanted if metrics[name] != first[name]] == [], variables
        assert found == numbers, variables


def test_smoke_twice_is_the_same_files_and_the_same_recording(tmp_path):
    rerun = shutil.which("rerun", path=str(Path(sys.executable).parent))
    if rerun is None:
        pytest.skip("no rerun command beside this python, to compare recordings with")
    one, two = (tmp_path / name for name in ("one", "two"))
    for folder in (one, two):
        python(constraints.__file__, "--smoke", "--out", str(folder))
    recording, *others = sorted(path.name for path in one.iterdir())
    assert recording.endswith(".rrd") and "metrics.json" in others
    assert all((one / name).read_bytes() == (two / name).read_bytes() for name in others)
    command = [rerun, "rrd", "compare", *(str(folder / recording) for folder in (one, two))]
    same = subprocess.run(command, capture_output=True, text=True)
    assert same.returncode == 0, same.stderr
