"""What a bad hour may bring: files that are none, full disks, closed streams, signals, sizes that
nobody meant."""

import json
import os
import re
import signal
import subprocess
import sys
from types import SimpleNamespace

import constraints as c
from curriculum.ch3_4_constraints import large
from curriculum.ch3_4_constraints.studies._runs import make_system, run
from curriculum.common import banner as device
from curriculum.common import files, motion, ruler
from curriculum.common.cli import Parser, number, writable

import numpy as np
import pytest

posix = pytest.mark.skipif(os.name == "nt", reason="no signals, limits or pipes in folders there")
SHORT = ("--no-rerun", "--steps", "20", "--stabilization", "none")


def program(*words, before=None, **settings):
    """A process of its own that runs constraints.py, or python with `words` that begin with -c."""
    command = [sys.executable, *([] if words[0] == "-c" else [c.__file__]), *map(str, words)]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "timeout": 20}
    return subprocess.run(command, cwd=c.HERE, preexec_fn=before, **pipes | settings)


def script(lines, before=None):
    """What a process of its own says whose main is `lines`."""
    body = "".join(f"    {line}\n" for line in lines.splitlines())
    code = f"import os, signal, sys\nfrom curriculum.common.cli import run_script\ndef main():\n{body}run_script(main)"
    return program("-c", code, before=before)


def refusal(capsys, *words):
    """The one line with which main refuses `words`."""
    with pytest.raises(SystemExit) as end:
        c.main([str(word) for word in words])
    printed, line = capsys.readouterr()
    assert end.value.code == 2 and printed == "" and line.count("\n") == 1
    return line


# --- files ---
@posix
def test_what_is_no_plain_file_is_never_replaced_by_one(tmp_path, capsys):
    os.mkfifo(tmp_path / "metrics.json")
    assert "metrics.json is no plain file there" in refusal(capsys, *SHORT, "--out", tmp_path)
    for path in (tmp_path / "metrics.json", "/dev/null"):
        parser = Parser(prog="study")
        parser.add_argument("--json", type=writable)
        with pytest.raises(SystemExit, match="2"):
            parser.parse_args(["--json", str(path)])
        assert "is no plain file there" in capsys.readouterr().err and not os.path.isfile(path)


@posix
def test_an_out_that_is_a_link_to_nothing_or_below_one_or_empty(tmp_path, capsys):
    (tmp_path / "link").symlink_to(tmp_path / "nothing")
    assert "it is a link to nothing" in refusal(capsys, *SHORT, "--out", tmp_path / "link")
    assert "link is a link to nothing" in refusal(
        capsys, *SHORT, "--out", tmp_path / "link" / "below"
    )
    assert "the name is empty" in refusal(capsys, *SHORT, "--out", "")


@posix
def test_results_of_another_user_are_found_out_before_the_run(tmp_path, monkeypatch, capsys):
    """In a folder like /tmp, where everybody may write and nobody may remove what is another's."""
    folder = tmp_path / "shared"
    folder.mkdir()
    folder.chmod(0o1777)
    monkeypatch.setattr(files.os, "geteuid", lambda: os.getuid() + 4711)
    assert c.main([*SHORT, "--out", str(folder)]) == 0
    old = (folder / "metrics.json").read_bytes()
    capsys.readouterr()
    assert "metrics.json there is another user's" in refusal(capsys, *SHORT, "--out", folder)
    assert (folder / "metrics.json").read_bytes() == old


@posix
def test_what_a_killed_run_left_is_removed_by_the_next_and_what_a_living_one_writes_is_not(
    tmp_path,
):
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    for name, owner in (
        ("metrics.json", dead.pid),
        ("constraints.rrd", dead.pid),
        ("metrics.json", os.getppid()),
    ):
        (tmp_path / f".{name}.{owner}").write_text("half of the resu")
    (tmp_path / ".metrics.json.notes").write_text("mine")
    c.main([*SHORT, "--out", str(tmp_path)])
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {"metrics.json", ".metrics.json.notes", f".metrics.json.{os.getppid()}"}


def test_a_leftover_that_cannot_be_removed_is_no_reason_to_lose_results(tmp_path, monkeypatch):
    (tmp_path / ".metrics.json.1").mkdir()  # nobody can unlink a folder
    monkeypatch.setattr(files, "alive", lambda process: False)
    assert c.main([*SHORT, "--out", str(tmp_path)]) == 0


def test_an_old_recording_never_lies_beside_new_metrics(tmp_path):
    """It is gone before they come, and they are there before the new one."""
    metrics, recording = tmp_path / files.METRICS, tmp_path / files.RECORDING
    recording.write_text("old")
    seen = []

    def record(path):
        seen.append((json.loads(metrics.read_text())["steps"], recording.exists()))
        raise OSError(28, "No space left on device")

    flags = dict.fromkeys(
        ("integrator", "seed", "baumgarte", "time_constant", "impedance", "tol"), 0
    )
    args = SimpleNamespace(**flags, system="double", out=tmp_path, rerun=True)
    said = files.publish(args, {"steps": 7}, {}, record)
    assert (
        seen == [(7, False)]
        and said.count("\n") == 0
        and "no recording: No space left on device" in said
    )
    assert [path.name for path in tmp_path.iterdir()] == ["metrics.json"]


@posix
def test_a_full_disk_costs_the_recording_and_not_the_numbers(tmp_path):
    import resource

    def few():
        resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, 50_000))

    done = program("--steps", 400, "--out", tmp_path, before=few)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.endswith("but no recording: File too large\n")
    assert [path.name for path in tmp_path.iterdir()] == ["metrics.json"]
    assert json.loads((tmp_path / "metrics.json").read_text())["steps"] == 400


def test_what_cannot_be_written_is_said_of_the_file_and_not_of_a_temporary_one(tmp_path):
    def full(path):
        path.write_text("half")
        raise OSError(28, "No space left on device", str(path))

    with pytest.raises(OSError, match="^.Errno 28. No space left on device: '[^.]*metrics.json'"):
        files.write_whole(tmp_path / "metrics.json", full)
    assert not list(tmp_path.iterdir())


# --- streams and signals ---
@posix
def test_a_full_or_closed_or_narrow_terminal(tmp_path):
    with open("/dev/full", "w") as full:
        done = program(*SHORT, "--out", tmp_path, stdout=full)
    assert (done.returncode, done.stderr) == (1, "constraints.py: error: No space left on device\n")
    for closed in ((1,), (0, 1, 2)):
        (tmp_path / "metrics.json").unlink(missing_ok=True)
        done = program(
            *SHORT, "--out", tmp_path, before=lambda closed=closed: [os.close(k) for k in closed]
        )
        assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
        assert json.loads((tmp_path / "metrics.json").read_text())["steps"] == 20
    narrow = os.environ | {"PYTHONIOENCODING": "ascii"}
    done = program(*SHORT, "--out", tmp_path / "\u00e4", env=narrow)
    assert done.returncode == 0 and done.stdout.rstrip().endswith("\\xe4/metrics.json")


@posix
def test_no_file_takes_the_place_of_a_closed_stream():
    """Or what a library writes there would be in it."""
    done = script(
        "return os.open(os.devnull, os.O_RDONLY)", before=lambda: [os.close(k) for k in range(3)]
    )
    assert done.returncode > 2


@posix
@pytest.mark.parametrize("name", ["SIGTERM", "SIGHUP"])
def test_a_signal_leaves_no_temporary_file(name, tmp_path):
    number = int(getattr(signal, name))
    lines = f"""from curriculum.common.files import write_whole
def write(path):
    path.write_text("half")
    os.kill(os.getpid(), {number})
    while True: pass
write_whole({str(tmp_path / "metrics.json")!r}, write)"""
    done = script(lines)
    assert (done.returncode, done.stdout, done.stderr) == (128 + number, "", "")
    assert not list(tmp_path.iterdir())


@posix
def test_under_nohup_a_hangup_is_nothing():
    kill, deaf = (
        "os.kill(os.getpid(), signal.SIGHUP)",
        lambda: signal.signal(signal.SIGHUP, signal.SIG_IGN),
    )
    assert script(kill, before=deaf).returncode == 0


@pytest.mark.parametrize(
    ("error", "line"),
    [
        ("KeyboardInterrupt", "interrupted"),
        ("ModuleNotFoundError(name='numpy')", "numpy is not installed: pip install -e '.'"),
    ],
)
def test_an_import_that_ends_early_is_one_line(error, line):
    finder = f"class F:\n def find_spec(self, name, *_):\n  if name == 'numpy': raise {error}\n"
    done = program("-c", f"import sys\n{finder}sys.meta_path.insert(0, F())\nimport constraints")
    assert done.returncode and re.fullmatch(f"{line}\n", done.stderr)


def test_a_warning_of_numpys_is_no_line_for_a_reader():
    assert script("import numpy\nnumpy.ones(1) / 0.0").stderr == ""


@posix
def test_no_memory_is_one_line(tmp_path):
    import resource

    def little():
        resource.setrlimit(resource.RLIMIT_AS, (4 << 30, 4 << 30))

    done = program("--steps", 10**9, "--no-rerun", "--out", tmp_path, before=little)
    assert done.returncode == 1 and not list(tmp_path.iterdir())
    assert (
        done.stderr
        == "constraints.py: error: not enough memory; ask for fewer rods, members or steps\n"
    )


# --- what takes long ---
def test_progress_says_how_long_it_will_take_as_soon_as_one_can_tell(monkeypatch, capsys):
    clock = iter([0.0, 0.1, 0.25, 0.3, 9.0, 100.0])
    monkeypatch.setattr(device, "time", SimpleNamespace(monotonic=lambda: next(clock)))
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    tick, shown = device.progress("falling", 1000), []
    for step in (1, 2, 3, 90, 1000):
        tick(step)
        shown.append(capsys.readouterr().err)
    assert shown[0] == shown[2] == ""  # too early, and too soon after the last
    assert (
        "falling:   0%, about 2 min left" in shown[1]
        and "falling:   9%, about 2 min left" in shown[3]
    )
    assert not re.search(r"\w", shown[4].replace("\x1b[K", ""))


def test_what_is_short_shows_no_progress(monkeypatch, capsys):
    clock = iter([0.0, 0.25, 0.5, 1.0])
    monkeypatch.setattr(device, "time", SimpleNamespace(monotonic=lambda: next(clock)))
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    tick = device.progress("falling", 4)
    for step in (1, 2, 4):
        tick(step)
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    ("seconds", "words"),
    [(0.2, "1 s"), (45, "45 s"), (170, "3 min"), (8000, "2 h"), (1e6, "278 h")],
)
def test_an_estimate_has_no_false_digits(seconds, words):
    assert device.about(seconds) == f"about {words}"


@pytest.mark.parametrize("dt", [1e3, 9e11])
def test_the_ruler_does_not_follow_a_step_that_is_too_long_for_it(dt, tmp_path):
    c.main(["--no-rerun", "--dt", str(dt), "--steps", "2", "--out", str(tmp_path)])
    rows = json.loads((tmp_path / "metrics.json").read_text())["results"].values()
    assert [row["error"] for row in rows] == [None] * 5


def test_the_rulers_budget_counts_every_step_and_every_half_of_one():
    """At 10 m/s and more the first rung takes nearly all its steps in halves, and there is no
    second."""
    system, asked = c.build_system("spin"), []

    def counted(rule, dt, steps):
        asked.append(steps)
        found = run(system, rule, "project", dt, steps)
        assert found.halved or found.stopped
        return found

    assert ruler.true_position(counted, 2.0, 125) == (None, np.inf)
    assert (
        asked == [40] and ruler.true_position(counted, 2.0, 119) == (None, np.inf) and asked == [40]
    )


def test_the_ruler_leaves_out_what_is_done_by_arrays():
    system = c.build_system("chain", links=large.CHAIN + 1)

    def simulate(*_):
        raise AssertionError("a run of the ruler")

    def case(mode, rule, dt):
        return None, system, None, dt

    rule, dt, steps, truth = ruler.settle(simulate, case, ["none"], "rk4", 0.005, 400, None)
    assert (rule, dt, steps, truth) == ("rk4", 0.005, 400, (400, None, np.inf))


# --- sizes ---
def star(n):
    """n particles on rods that all feel each other."""
    return make_system(
        [[k + 1, k % 7, k % 5] for k in range(n)],
        np.zeros((n, 3)),
        np.ones(n),
        [(0, -1), *spokes(n)],
    )


def spokes(n):
    return [(k, 0) for k in range(1, n)]


def test_few_rods_that_all_feel_each_other_are_not_written_out():
    assert large.takes(star(30)) and not large.takes(star(10))
    found = run(star(30), steps=2, dt=0.001)
    assert found.way == "by arrays: dense LU" and found.violations[-1] < 1e-5


def test_particles_without_rods_fall_and_cost_little():
    """Many of them are arrays, and a chain with a loose one is no chain."""
    rods = large.CHAIN + 5
    position = [[k + 1.0, 0.0, 0.0] for k in range(2 * large.LINKAGE + 1)]
    pairs = [(k, k - 1) for k in range(rods)]
    for n in (rods + 1, len(position)):
        system = make_system(position[:n], np.zeros((n, 3)), np.ones(n), pairs)
        assert large.takes(system) == (n > rods + 1) and not large.of(system).chain
        found = run(system, "rk4", "project", 0.01, 10)
        assert found.q[-1, -1] == pytest.approx([n, -0.5 * 9.81 * 0.1**2, 0.0], abs=1e-12)


def test_a_long_chain_finds_its_way_back():
    found = run(c.build_system("chain", links=10_000), hold="project", steps=2)
    assert not found.stopped and found.violations.max() < 1e-11


def test_numbers_that_overflow_within_a_step_stop_a_run_with_a_sentence():
    """The sparse solver has an error of its own for that."""
    pytest.importorskip(
        "scipy", reason="the sparse solver of large linkages: pip install -e '.[large]'"
    )
    assert "no finite tensions" in run(star(large.LINKAGE + 1), "rk4", dt=1e80, steps=1).stopped


@pytest.mark.parametrize("n", [11, 13], ids=["dense", "sparse"])
def test_rods_too_many_by_arrays_keep_a_body_rigid(n):
    """All tied to all, and turning: a third of the rods would do, and which of them carry the load
    is open."""
    if n == 13:
        pytest.importorskip(
            "scipy", reason="the sparse solver of large linkages: pip install -e '.[large]'"
        )
    rng = np.random.default_rng(0)
    q, turn = rng.normal(size=(n, 3)), rng.normal(size=3)
    system = make_system(
        q, np.cross(turn, q), rng.uniform(1.0, 2.0, n), [(i, j) for i in range(n) for j in range(i)]
    )
    assert large.takes(system) and ("dense" in large.way(system)) == (n == 11)
    jac, _, _, jdotv = c.constraint_terms(system, q, system["v0"])
    a = c.make_force(system, 0.0)(q, system["v0"]) / system["m"]
    assert np.abs(jac @ a.ravel() + jdotv).max() < 1e-6 * np.abs(jdotv).max()


@pytest.mark.parametrize("rule", ["semi_implicit", "gauss"])
def test_the_edges_of_blocks_change_nothing(rule, monkeypatch):
    """A single run, and members in step; by numbers, by arrays, and step by step."""
    alone, both = c.build_system("double"), c.build_system("double")
    both |= {key: np.stack([both[key], both[key]]) for key in ("q0", "v0")}
    whole = [run(system, rule, steps=100) for system in (alone, both)]
    monkeypatch.setattr(motion, "BLOCK", 100)
    for system, found in zip((alone, both), whole, strict=True):
        pieces = run(system, rule, steps=100)
        assert all(np.array_equal(a, b) for a, b in zip(pieces[:6], found[:6], strict=True))


# --- words ---
@pytest.mark.parametrize("text", ["\u0663", "1_000", " 5", "5\n", "0x10", "1e3", "5.0", ""])
def test_whole_numbers_are_ascii_digits(text):
    with pytest.raises(Exception, match="must be a whole number >= 1 and < 1e.12, not "):
        number(int, 1)(text)


def test_what_is_nearly_right_is_guessed_whatever_its_case(capsys):
    assert "did you mean rk4?" in refusal(capsys, "--integrator", "RK4")
    assert "did you mean --system?" in refusal(capsys, "--SYSTEM", "double")
    assert "did you mean 'triple'?" in refusal(capsys, "--system", "Triple")
    assert len(refusal(capsys, "--out", f"/{'x' * 5000}")) < 300


# --- the ledger ---
def test_the_ledger_has_a_row_for_every_tier():
    rows = [row for row in device.read_ledger() if row["chapter"] == "ch3.4"]
    assert (
        [row["tier"] for row in rows] == list(device.TIERS) == ["cpu-laptop", "mps", "t4", "4090"]
    )
    for row in rows:
        assert row["status"] in ("measured", "not yet measured")
        assert (
            bool(row["minutes"])
            == bool(row["machine"])
            == bool(row["date"])
            == (row["status"] == "measured")
        )
    assert rows[0]["status"] == "measured"


def test_the_banner_speaks_of_a_default_run_and_not_of_this_one(tmp_path):
    ledger = tmp_path / "wallclock.csv"
    head = "chapter,tier,minutes,machine,date,commit,status\n"
    rows = "ch0,cpu-laptop,0.5,a desk,2020-01-01,abc,measured\nch0,mps,7,a guess,2020-01-01,abc,estimated\n"
    ledger.write_text(f"{head}{rows}")
    expected = (
        "ch0 title | device cpu | tier cpu-laptop | a default run took 30 s on a desk, 2020-01-01"
    )
    assert device.banner("ch0", "title", "cpu", ledger=ledger) == expected
    assert device.banner("ch0", "title", "mps", ledger=ledger).endswith(
        "tier mps | a default run is not yet measured"
    )
    assert device.banner("ch0", "title", "cuda", "4090", ledger).endswith(
        "tier 4090 | a default run is not yet measured"
    )
    assert device.banner("ch1", "title", "cpu", ledger=ledger).endswith(
        "| a default run is not yet measured"
    )
    assert (
        "| ch0 | cpu-laptop | 30 s | a desk | 2020-01-01 |\n| ch0 | mps | not yet measured |"
        in device.table(ledger)
    )


def test_measuring_takes_the_median_of_five_in_minutes_and_leaves_a_row_for_each_tier(
    tmp_path, monkeypatch
):
    ledger, clock = tmp_path / "wallclock.csv", iter([0, 6, 6, 7, 7, 10, 10, 70, 70, 72])
    ledger.write_text(
        "chapter,tier,minutes,machine,date,commit,status\nch9,t4,0.5,a desk,2020-01-01,abc,measured\n"
    )
    before = ledger.read_bytes()
    with pytest.raises(subprocess.CalledProcessError):
        device.measure("ch0", "mps", [sys.executable, "-c", "raise SystemExit(1)"], ledger)
    assert ledger.read_bytes() == before
    monkeypatch.setattr(device, "time", SimpleNamespace(perf_counter=lambda: next(clock)))
    monkeypatch.setattr(device.subprocess, "run", lambda *_, **__: SimpleNamespace(stdout="abc\n"))
    assert device.measure("ch0", "mps", ["a", "command"], ledger) == 3
    rows = {(row["chapter"], row["tier"]): row for row in device.read_ledger(ledger)}
    assert list(rows) == [("ch9", "t4"), *(("ch0", tier) for tier in device.TIERS)]
    assert (
        rows["ch0", "mps"]["minutes"] == "0.05000"
        and rows["ch0", "t4"]["status"] == "not yet measured"
    )
    assert " 3 s on " in device.banner("ch0", "title", "mps", ledger=ledger)
