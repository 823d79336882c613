"""The recording, read back with Rerun's own reader."""

from collections import defaultdict
from types import SimpleNamespace

import numpy as np
import pytest

import constraints as c
from curriculum.ch3_4_constraints.page.scene import scene_of
from curriculum.ch3_4_constraints.report import files
from curriculum.common import palette
from curriculum.common.words import length

RrdReader = pytest.importorskip("rerun.chunk", reason="rerun-sdk is not installed").RrdReader
recording = pytest.importorskip("curriculum.ch3_4_constraints.report.recording")


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


def recorded(folder, *flags):
    """What a run's recording holds: its entities, and those of its blueprint."""
    c.main([*flags, "--no-page", f"--out={folder}"])
    reader = RrdReader(str(folder / files.RECORDING))
    return chunks(reader), chunks(reader, store=reader.blueprints()[0])


def titles(blueprint):
    """{what it shows: its title} of each view of a blueprint."""
    views = {v["space_origin"][0][0]: v for v in blueprint.values() if "space_origin" in v}
    return {origin: view["display_name"][0][0] for origin, view in views.items()}


@pytest.fixture(scope="module")
def lost(tmp_path_factory):
    """The recording of a run in which baumgarte is lost, and rods are off by much; and its runs."""
    flags = "--dt=0.05", "--steps=60", "--baumgarte=40"
    settings = "semi_implicit", 0.05, 60
    system = c.build_system("double")
    runs = {x: c.run_method(system, x, *settings, baumgarte=40) for x in c.make_methods()}
    return *recorded(tmp_path_factory.mktemp("of a run"), *flags), runs


@pytest.mark.parametrize("name", ["none", "soft", "project"])
def test_particles_rods_and_curves_are_those_of_the_run_and_rod_errors_have_colours(name, lost):
    seen, _, runs = lost
    run = runs[name]
    system = c.build_system("double")
    tile = {key.rpartition("/")[2]: x for key, x in seen.items() if f"/methods/{name}/" in key}
    assert np.allclose(tile["particles"]["seconds"], 0.05 * np.arange(61))
    assert np.allclose(tile["particles"]["positions"], run.q, atol=1e-6)
    assert np.allclose(tile["path"]["positions"], run.tip[:, None], atol=1e-6)
    assert tile["too_long"]["colors"] == [[int(f"{palette.TOO_LONG[1][1:]}ff", 16)]]
    radius = tile["particles"]["radii"][0][0]
    force = c.make_methods(0.05)[name].make_force(system)
    hardest = 0.0  # N
    for k, (q, v) in enumerate(zip(run.q, run.v, strict=True)):
        tails = [tail for tail, _ in tile["rods"]["strips"][k]]
        assert np.allclose(tails, [c.PIVOT, q[0]], atol=1e-6)
        errors = c.rod_lengths(system, q) - system["lengths"]
        sizes = {"rods": 1.0 + np.minimum(errors, 0.0)}
        sizes |= {"too_long": errors[errors > radius], "too_short": -errors[-errors > radius]}
        for entity, expected in sizes.items():
            strips = tile[entity].get("strips", [[]] * 61)[k] or []
            drawn = [np.linalg.norm(np.subtract(*strip)) for strip in strips]
            assert np.allclose(drawn, expected, atol=1e-6)
        hardest = max(hardest, *np.abs(c.tensions(system, q, v, force)))
        assert np.allclose(seen[f"/force/{name}"]["scalars"][k], hardest)
    energies = (run.energies - run.energies[0]) / (2.0 * 9.81 * 2.0)
    assert np.allclose(np.ravel(seen[f"/energy/{name}"]["scalars"]), energies)
    logs = np.log10(np.maximum(run.violations, 1e-12))
    assert np.allclose(np.ravel(seen[f"/violation/{name}"]["scalars"]), logs)


def test_a_lost_method_leaves_the_picture_says_so_and_bends_no_axis(lost):
    seen, blueprint, runs = lost
    end = 0.05 * len(runs["baumgarte"].tip)
    assert np.allclose(seen["/methods/baumgarte"]["seconds"], end)
    assert seen["/methods/baumgarte"]["is_recursive"] == [[True]]
    names = titles(blueprint)
    assert runs["baumgarte"].stopped in names["methods/baumgarte"]
    assert length(np.max(runs["soft"].violations)) in names["methods/soft"]
    (view,) = [key for key, v in blueprint.items() if v.get("space_origin") == [["energy"]]]
    ((low, high),) = blueprint[f"{view}/ScalarAxis"]["range"][0]
    alive = [seen[f"/energy/{x}"]["scalars"] for x, run in runs.items() if not run.lost]
    assert len(alive) > 1
    assert high - low < 1.2 * np.ptp(alive) < np.max(seen["/energy/baumgarte"]["scalars"])


def test_each_method_and_each_plot_has_the_ground_that_its_colours_are_legible_on(lost):
    _, blueprint, runs = lost
    grounds = [x["color"] for key, x in blueprint.items() if key.endswith("Background")]
    plots = {"violation", "energy", "force"} & {*titles(blueprint)}
    paper = [[int(f"{palette.PAPER[1][1:]}ff", 16)]]
    assert grounds == [paper] * (len(runs) + len(plots))


def test_energy_that_drag_takes_is_called_no_error(monkeypatch, lost, tmp_path):
    _, blueprint, _ = lost
    assert "error" in titles(blueprint)["energy"]
    monkeypatch.setattr(c, "external_force", lambda system, q, v: system["m"] * c.GRAVITY - v)
    _, blueprint = recorded(tmp_path, "--steps=60")
    assert "error" not in titles(blueprint)["energy"]
    known = {"energy_rel_max": 1.0, "tension_max": 1.0}
    rows = [known | {"conserves": answer} for answer in (True, False)]  # drag in one run's way
    assert "error" not in recording.plots(rows, 1.0)["energy"].title


def test_what_is_not_known_of_a_run_is_not_plotted(monkeypatch, tmp_path):
    usual = c.trajectory

    def heavier(step_fn, system, force, dt, steps):
        system["m"] = 2.0 * system["m"]
        return usual(step_fn, system, force, dt, steps)

    monkeypatch.setattr(c, "trajectory", heavier)
    seen, blueprint = recorded(tmp_path, "--steps=60", "--stabilization=none")
    curves = {key for key in seen if key.endswith("/none") and "scalars" in seen[key]}
    assert curves == {"/violation/none"}
    assert {"energy", "force"}.isdisjoint(titles(blueprint))


def test_a_method_has_one_colour_in_recording_and_page_even_where_it_is_alone(tmp_path):
    seen, _ = recorded(tmp_path, "--stabilization=soft", "--steps=60")
    knobs = {"dt": 0.005, "baumgarte": 20.0, "time_constant": 0.02}
    scene = scene_of(c.this_chapter(), c.build_system("double"), "semi_implicit", knobs)
    _, on_dark = palette.METHODS[scene["colors"]["soft"]]
    for entity in "/methods/soft/particles", "/methods/soft/rods", "/energy/soft":
        assert seen[entity]["colors"] == [[int(f"{on_dark[1:]}ff", 16)]]


@pytest.mark.parametrize("system", ["double", "cable", "upright"])
def test_what_moves_fills_its_view_and_each_plot_names_its_curves(system, tmp_path):
    flags = f"--system={system}", "--stabilization=project", "--steps=400"
    seen, blueprint = recorded(tmp_path, *flags)
    (eye,) = [x for key, x in blueprint.items() if key.endswith("EyeControls3D")]
    ((position,),) = eye["position"]
    ((target,),) = eye["look_target"]
    places = np.concatenate(
        [np.reshape(seen["/methods/project/particles"]["positions"], (-1, 3)), [c.PIVOT]]
    )
    assert np.allclose(position[:2], target[:2])
    away = np.linalg.norm(np.subtract(position, target))
    half = away * np.tan(np.radians(27.5))  # m, of Rerun's eye at that distance, up and down
    far = np.max(np.abs(places[:, :2] - target[:2]) / [1.5 * half, half])
    assert 0.8 < far < 0.95
    legends = [x for key, x in blueprint.items() if key.endswith("PlotLegend")]
    curves = {key: x["names"] for key, x in seen.items() if "scalars" in x}
    assert len(legends) == len(curves) > 0
    assert {*map(str, curves.values())} == {"[['project']]"}


@pytest.mark.parametrize(("steps", "shown"), [(600, 180), (20_000, 3600)])
def test_a_recording_has_60_states_a_second_and_a_long_one_stays_small(steps, shown, tmp_path):
    seen, _ = recorded(tmp_path, "--stabilization=none", f"--steps={steps}")
    seconds = seen["/methods/none/particles"]["seconds"]
    assert 0.9 * shown < len(seconds) < 1.2 * shown and seconds[-1] == 0.005 * steps
    assert (tmp_path / files.RECORDING).stat().st_size < 1e6


def test_the_force_is_the_largest_so_far_of_all_steps_though_few_are_shown():
    run = SimpleNamespace(pulls=np.array([1.0, 9.0, 2.0, np.nan, 4.0]), violations=np.ones(5))
    row = {"conserves": False, "energy_rel_max": None, "tension_max": 9.0}
    curves = recording.curves_of(run, row, 1.0, np.array([0, 2, 4]))
    assert curves["force"].tolist() == [1.0, 9.0, 9.0] and "energy" not in curves
