"""The bytes of a run: those of another process, and of other threads."""

from concurrent.futures import ThreadPoolExecutor

from conftest import FILES, contents, python

import constraints as c
from curriculum.ch3_4_constraints.results import output


def test_smoke_run_twice_gives_the_same_metrics_bytes_and_equal_recordings(tmp_path):
    found = []
    recordings = []
    for name in ("first", "second"):
        out = tmp_path / "out"
        done = python("constraints.py", "--smoke", "--seed", 0, "--out", out)
        assert (done.returncode, done.stderr) == (0, "")
        found.append(contents(out))
        recordings.append(out.rename(tmp_path / name) / output.RECORDING)
    first, second = found
    assert first.keys() == second.keys() == FILES
    assert first[output.METRICS] == second[output.METRICS]
    assert first[output.PAGE] == second[output.PAGE]
    compared = python("-m", "rerun", "rrd", "compare", *recordings)  # it ignores the header
    assert compared.returncode == 0, compared.stderr


def test_main_in_four_threads_writes_what_it_writes_alone(tmp_path):
    def run(flags, name):
        c.main([*flags.split(), "--no-rerun", f"--out={tmp_path / 'below' / name}"])
        return contents(tmp_path / "below" / name)

    every = "--steps 90", "--plain --steps 9", "--system spin --steps 9", "--dt 1 --steps 40"
    alone = [run(flags, f"alone{k}") for k, flags in enumerate(every)]
    with ThreadPoolExecutor(4) as pool:
        names = [f"thread{k}" for k in range(8)]
        assert [*pool.map(run, 2 * every, names)] == 2 * alone
