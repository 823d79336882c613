"""The recording, read back with Rerun's own reader."""

import subprocess
from collections import defaultdict

import numpy as np
import pytest
from conftest import python
from rerun.chunk import RrdReader

import constraints as c
from curriculum.ch3_4_constraints import output, recording


def chunks(reader, **store):
    """{entity: {column: rows}} of a recording or, with `store`, of its blueprint."""
    found = defaultdict(dict)
    for chunk in reader.stream(**store).to_chunks():
        batch = chunk.to_record_batch()
        for name, rows in zip(batch.schema.names, batch.columns, strict=True):
            if name == recording.TIMELINE:
                found[chunk.entity_path]["seconds"] = rows.to_numpy() / np.timedelta64(1, "s")
            elif ":" in name:
                found[chunk.entity_path][name.rpartition(":")[2]] = rows.to_pylist()
    return found


@pytest.fixture(scope="module")
def lost(tmp_path_factory):
    """Entities and blueprint of a run in which baumgarte is lost, and rods are off by much."""
    folder = str(tmp_path_factory.mktemp("lost"))
    c.main(["--dt", "0.05", "--steps", "60", "--baumgarte", "40", "--no-page", "--out", folder])
    reader = RrdReader(f"{folder}/{output.RECORDING}")
    return chunks(reader), chunks(reader, store=reader.blueprints()[0])


@pytest.mark.parametrize("name", ["none", "impulse", "soft", "project"])
def test_particles_rods_and_curves_are_those_of_the_run_and_rod_errors_have_colours(name, lost):
    seen, _ = lost
    system, method = c.build_system("double"), c.stabilizations(0.05)[name]
    run = c.run_method(system, name, "semi_implicit", 0.05, 60)
    tile = {key.rpartition("/")[2]: x for key, x in seen.items() if f"/methods/{name}/" in key}
    assert np.allclose(tile["particles"]["seconds"], 0.05 * np.arange(61))
    assert np.allclose(tile["particles"]["positions"], run.q, atol=1e-6)
    assert np.allclose(tile["path"]["positions"], run.tip[:, None], atol=1e-6)
    radius = tile["particles"]["radii"][0][0]
    for k, (q, v) in enumerate(zip(run.q, run.v, strict=True)):
        (fixed, _), (joint, _) = tile["rods"]["strips"][k]
        assert np.allclose([fixed, joint], [[0.0, 0.0, 0.0], q[0]], atol=1e-6)
        errors = c.rod_errors(system, q)
        for entity, sizes in (
            ("rods", 1.0 + np.minimum(errors, 0.0)),
            ("too_long", errors[errors > radius]),
            ("too_short", -errors[-errors > radius]),
        ):
            strips = tile[entity].get("strips", [[]] * 61)[k] or []
            drawn = [np.linalg.norm(np.subtract(*strip)) for strip in strips]
            assert np.allclose(drawn, sizes, atol=1e-6)
        first = c.tensions(system, q, v, method)[0]
        assert np.allclose(seen[f"/tension/{name}"]["scalars"][k], first)
    energies = (run.energies - run.energies[0]) / (2.0 * 9.81 * 2.0)
    assert np.allclose(np.ravel(seen[f"/energy/{name}"]["scalars"]), energies)
    logs = np.log10(np.maximum(run.violations, 1e-12))
    assert np.allclose(np.ravel(seen[f"/violation/{name}"]["scalars"]), logs)


def test_a_lost_method_leaves_the_picture_says_so_and_bends_no_axis(lost):
    seen, blueprint = lost
    system = c.build_system("double")
    run = c.run_method(system, "baumgarte", "semi_implicit", 0.05, 60, baumgarte=40.0)
    assert np.allclose(seen["/methods/baumgarte"]["seconds"], 0.05 * len(run.tip))
    assert seen["/methods/baumgarte"]["is_recursive"] == [[True]]
    views = {v["space_origin"][0][0]: key for key, v in blueprint.items() if "space_origin" in v}
    names = {origin: blueprint[key]["display_name"][0][0] for origin, key in views.items()}
    assert names["methods/baumgarte"] == f"baumgarte: {run.stopped}"
    assert recording.TITLES.items() | {("guide", "what to look at")} <= names.items()
    ((low, high),) = blueprint[f"{views['energy']}/ScalarAxis"]["range"][0]
    alive = [seen[f"/energy/{x}"]["scalars"] for x in ("none", "impulse", "soft", "project")]
    assert high - low < 1.2 * np.ptp(alive) < np.max(seen["/energy/baumgarte"]["scalars"])


def test_equal_runs_are_equal_recordings_and_a_long_one_stays_small(tmp_path):
    for name, steps in (("a", "99"), ("b", "99"), ("c", "20000")):
        run = "--dt", "0.01", "--steps", steps, "--no-page", "--out", str(tmp_path / name)
        c.main(["--stabilization", "none", *run])
    a, b, other = (tmp_path / name / output.RECORDING for name in "abc")
    assert python("-m", "rerun", "rrd", "compare", a, b).returncode == 0
    assert other.stat().st_size < 1e6
    ids = [RrdReader(str(path)).recordings()[0].recording_id for path in (a, b, other)]
    assert ids[0] == ids[1] != ids[2]  # or a viewer that opens both takes them for one


def test_the_look_line_works_when_pasted(tmp_path, monkeypatch, capsys):
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    c.main(["--steps", "2", "--no-page", "--out", str(tmp_path / "and two")])
    printed = capsys.readouterr().out
    opened, opener = tmp_path / "opened", tmp_path / "browser"
    opener.write_text(f"#!/bin/sh\necho $1 > '{opened}'\nkill 0")  # it ends the viewer, too
    opener.chmod(0o700)
    monkeypatch.setenv("BROWSER", str(opener))
    own = {"start_new_session": True, "stderr": subprocess.DEVNULL, "timeout": 60}
    subprocess.run(f"exec {printed.split('look: ')[1]}", shell=True, **own)
    assert opened.read_text().startswith("http://")
