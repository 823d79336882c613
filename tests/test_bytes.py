"""The bytes of a run: those of another process, of other threads, and of machine code."""

from concurrent.futures import ThreadPoolExecutor

import pytest
from conftest import FILES, contents, python

import constraints as c
from curriculum.ch3_4_constraints.report.files import METRICS, PAGE, RECORDING
from curriculum.common.tracing import llvm

TABLES = METRICS, PAGE


def test_a_smoke_run_twice_gives_the_same_bytes_and_equal_recordings(tmp_path):
    found = []
    recordings = []
    for name in ("first", "second"):
        out = tmp_path / "out"
        done = python("constraints.py", "--smoke", "--seed", 0, "--out", out)
        assert (done.returncode, done.stderr) == (0, "")
        found.append(contents(out))
        recordings.append(out.rename(tmp_path / name) / RECORDING)
    assert found[0].keys() == found[1].keys() == FILES
    first, second = ([files[name] for name in TABLES] for files in found)
    assert first == second
    compared = python("-m", "rerun", "rrd", "compare", *recordings)  # it ignores the header
    assert compared.returncode == 0, compared.stderr


def test_machine_code_and_python_write_the_same_metrics_answer_and_page(tmp_path, monkeypatch):
    pytest.importorskip("llvmlite", reason="llvmlite is not installed")
    built = []
    usual = llvm.written
    monkeypatch.setattr(llvm, "written", lambda *of: built.append(of) or usual(*of))
    flags = "--system fourbar_coupler --dt 0.02 --steps 20 --within 1cm --no-rerun --out"

    def run(repays):
        monkeypatch.setattr(llvm, "repays", lambda *_: repays)
        assert c.main([*flags.split(), str(tmp_path)]) == 0
        return contents(tmp_path)

    plain = run(False)
    assert not built and plain.keys() == {*TABLES}
    assert run(True) == plain and len(built) > 10


def test_main_in_four_threads_writes_what_it_writes_alone(tmp_path):
    def run(flags, name):
        c.main([*flags.split(), "--no-rerun", f"--out={tmp_path / 'below' / name}"])
        return contents(tmp_path / "below" / name)

    every = "--steps 90", "--integrator rk4 --steps 9", "--system spin --steps 9", "--dt 1"
    alone = [run(flags, f"alone{k}") for k, flags in enumerate(every)]
    with ThreadPoolExecutor(4) as pool:
        names = [f"thread{k}" for k in range(8)]
        assert [*pool.map(run, 2 * every, names)] == 2 * alone
