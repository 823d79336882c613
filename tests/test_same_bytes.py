"""Equal runs give equal bytes, whatever numpy and its BLAS choose, and without llvmlite, too."""

import json
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
from conftest import python

# what numpy found here beyond its baseline: naming anything else would only earn a warning
FEATURES = " ".join(np.show_config(mode="dicts")["SIMD Extensions"].get("found", ()))
PLAIN = {"NPY_DISABLE_CPU_FEATURES": FEATURES, "OPENBLAS_NUM_THREADS": "1"}
OTHER, INFO = {"OPENBLAS_NUM_THREADS": "3"}, Path("/proc/cpuinfo")
for settings, feature, kernel in ((PLAIN, "sse2", "Prescott"), (OTHER, "avx", "Sandybridge")):
    if INFO.exists() and feature in INFO.read_text("utf-8").split():
        settings["OPENBLAS_CORETYPE"] = kernel  # of OpenBLAS; the default is the newest
RUNS = """
import hashlib, json, sys
sys.modules.update(dict.fromkeys(sys.argv[2:]))  # as if these were not installed
import constraints
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
CASES = [f"triple --steps 500 --integrator {x}" for x in ("semi_implicit", "rk4", "gauss")]
CASES += ["windows --steps 20", "windows --steps 20 --integrator gauss"]
CASES += ["jansen_leg --steps 20 --integrator rk4", "chain --links 100 --steps 20"]
CASES = ["--smoke", *(f"--stabilization project --dt 0.02 --system {case}" for case in CASES)]


def test_metrics_are_the_same_bytes_everywhere(tmp_path):
    def everything(variables, *missing):
        folders = [tempfile.mkdtemp(dir=tmp_path) for _ in CASES]
        flags = json.dumps(dict(zip(folders, CASES, strict=True)))
        done = python("-c", RUNS, flags, *missing, variables=variables, timeout=300)
        assert (done.returncode, done.stderr) == (0, "")
        texts = [path.read_text() for x in folders for path in Path(x).iterdir()]  # a file each
        return texts, done.stdout.splitlines()[-1]

    with ThreadPoolExecutor(2) as pool:
        others = [pool.submit(everything, *x) for x in ((PLAIN,), (OTHER, "llvmlite"))]
        metrics, numbers = everything({})
    for text in metrics:
        assert all(row["stopped"] is None for row in json.loads(text)["results"].values())
    for texts, found in (other.result() for other in others):
        different = [x for x, one, two in zip(CASES, metrics, texts, strict=True) if one != two]
        assert different == [] and numbers == found


def test_smoke_twice_is_the_same_files_and_the_same_recording(smoke):
    one, two = smoke
    recording, *others = sorted(path.name for path in one.iterdir())
    assert recording.endswith(".rrd") and "metrics.json" in others
    assert all((one / name).read_bytes() == (two / name).read_bytes() for name in others)
    compared = python("-m", "rerun", "rrd", "compare", one / recording, two / recording)
    assert compared.returncode == 0, compared.stderr
