"""Equal runs give equal bytes, whatever the processor lets numpy and its BLAS choose."""

import json
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

# what numpy found here beyond its baseline: naming anything else would only earn a warning
FEATURES = " ".join(np.show_config(mode="dicts")["SIMD Extensions"].get("found", ()))
PLAIN = {"NPY_DISABLE_CPU_FEATURES": FEATURES, "OPENBLAS_NUM_THREADS": "1"}
if Path("/proc/cpuinfo").exists() and "sse2" in Path("/proc/cpuinfo").read_text("utf-8").split():
    PLAIN["OPENBLAS_CORETYPE"] = "Prescott"  # OpenBLAS's oldest kernel; the default is the newest
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
SCENES = {"triple": 500, "windows": 20, "jansen_leg": 20}  # steps: long where chaos helps
FLAGS = "--system {} --steps {} --integrator {} --stabilization project --dt 0.02"
RULES = "semi_implicit", "rk4", "gauss"
CASES = [FLAGS.format(*scene, rule) for scene in SCENES.items() for rule in RULES]
CASES += ["--smoke", "--system chain --links 100 --steps 20"]  # and many rods


def test_metrics_are_the_same_bytes_everywhere(python, tmp_path):
    def everything(variables):
        folders = [str(tmp_path / f"{len(variables)}" / str(k)) for k in range(len(CASES))]
        flags = json.dumps(dict(zip(folders, CASES, strict=True)))
        done = python("-c", RUNS, flags, variables=variables, timeout=300)
        assert (done.returncode, done.stderr) == (0, "")
        return [Path(x, "metrics.json").read_text() for x in folders], done.stdout.splitlines()[-1]

    with ThreadPoolExecutor(2) as pool:
        (metrics, numbers), (others, found) = pool.map(everything, ({}, PLAIN))
    for text in metrics:
        assert all(row["stopped"] is None for row in json.loads(text)["results"].values())
    different = [x for x, one, two in zip(CASES, metrics, others, strict=True) if one != two]
    assert different == [] and numbers == found


def test_smoke_twice_is_the_same_files_and_the_same_recording(python, smoke):
    one, two = smoke
    recording, *others = sorted(path.name for path in one.iterdir())
    assert recording.endswith(".rrd") and "metrics.json" in others
    assert all((one / name).read_bytes() == (two / name).read_bytes() for name in others)
    compared = python("-m", "rerun", "rrd", "compare", one / recording, two / recording)
    assert compared.returncode == 0, compared.stderr
