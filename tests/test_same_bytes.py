"""Equal runs give equal bytes: from process to process, and whatever the processor lets numpy and its BLAS choose."""

import itertools
import json
import os
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import constraints
from curriculum.common import device

# what numpy found here beyond its baseline, by its own listing: naming anything else would only earn a warning
FEATURES = " ".join(np.show_config(mode="dicts")["SIMD Extensions"].get("found", ()))
CORES = ("Prescott", "Sandybridge", "Haswell", "SkylakeX")  # kernels of OpenBLAS; another BLAS does not ask
ENVIRONMENTS = [
    {},
    {},
    {"NPY_DISABLE_CPU_FEATURES": FEATURES},
    *({"OPENBLAS_CORETYPE": core, "OPENBLAS_NUM_THREADS": n} for core, n in itertools.product(CORES, "12")),
]


def run(folder, *flags, **variables):
    """One process that writes its results to `folder`; nothing it prints may be meant for a terminal."""
    command = [sys.executable, constraints.__file__, "--out", str(folder), *flags]
    done = subprocess.run(command, capture_output=True, env=os.environ | variables, cwd=constraints.HERE)
    assert done.returncode == 0, done.stderr.decode()
    assert not done.stderr
    assert b"\r" not in done.stdout
    return (Path(folder) / "metrics.json").read_bytes()


@pytest.mark.parametrize(
    "flags",
    [
        pytest.param(["--smoke"], id="smoke"),
        pytest.param(["--system", "triple", "--steps", "4000"], id="triple"),
        pytest.param(["--system", "chain", "--links", "40", "--smoke"], id="arrays"),  # past SHORT_CHAIN
        pytest.param(["--system", "triple", "--integrator", "rk4", "--smoke"], id="rk4"),
    ],
)
def test_metrics_are_the_same_bytes_everywhere(flags, tmp_path):
    with ThreadPoolExecutor(2) as pool:
        jobs = [
            pool.submit(run, tmp_path / str(k), "--no-rerun", *flags, **variables)
            for k, variables in enumerate(ENVIRONMENTS)
        ]
        first, *others = [job.result() for job in jobs]
    assert len(json.loads(first)["results"]) >= 4
    for other, variables in zip(others, ENVIRONMENTS[1:], strict=True):
        assert other == first, variables


def test_recordings_are_equal(tmp_path):
    rerun = shutil.which("rerun", path=str(Path(sys.executable).parent))
    if rerun is None:
        pytest.skip("no rerun command beside this python")
    flags = {"one": ["--smoke"], "two": ["--smoke"], "other": ["--smoke", "--seed", "1"]}
    with ThreadPoolExecutor(2) as pool:
        list(pool.map(lambda name: run(tmp_path / name, *flags[name]), flags))
    one, two, other = (str(tmp_path / name / "constraints.rrd") for name in flags)

    def compare(a, b):
        return subprocess.run([rerun, "rrd", "compare", a, b], capture_output=True, text=True)

    same = compare(one, two)
    assert same.returncode == 0, same.stderr
    assert compare(one, other).returncode != 0  # else the line above would mean nothing


@pytest.mark.parametrize("terminal", [False, True])
def test_only_a_terminal_sees_progress(terminal, tmp_path, monkeypatch, capsys):
    ticks = itertools.count(step=10.0)  # a clock on which every block takes long enough to be told of
    monkeypatch.setattr(device, "time", SimpleNamespace(monotonic=lambda: next(ticks)))
    monkeypatch.setattr(sys.stderr, "isatty", lambda: terminal, raising=False)
    constraints.main(["--smoke", "--no-rerun", "--out", str(tmp_path)])
    out, err = capsys.readouterr()
    assert "\r" not in out
    assert ("\r" in err) == terminal
    assert bool(err) == terminal
