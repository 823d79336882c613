"""The pictures of the chapter, made again:  python -m
curriculum.ch3_4_constraints.pictures.make_pictures [NAME ...]

The drawings (SVG) are computed, and are the same bytes each time. The recordings (PNG) are what
Rerun's viewer shows, without a window: rerun-sdk 0.41, and a graphics card or, on Debian, the
package mesa-vulkan-drivers.
"""

import contextlib
import io
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from functools import partial
from pathlib import Path

import constraints as c
from curriculum.ch3_4_constraints.pictures.svg import GREY, INK, LINE, Axis, Chart, Drawing
from curriculum.ch3_4_constraints.recording import TIMELINE
from curriculum.ch3_4_constraints.studies import speed_vs_error
from curriculum.ch3_4_constraints.studies._runs import make_system, run
from curriculum.common.cli import Parser, run_script
from curriculum.common.files import RECORDING, write_whole

import numpy as np

FOLDER = Path(__file__).parent
COLORS = {
    "none": "#c8430f",
    "baumgarte": "#0b7d57",
    "impulse": "#1b73b8",
    "soft": "#7d7a00",
    "project": "#a83a7a",
}
WEIGHT, PULL = "#1b73b8", "#d9560b"
LABELS = {"midpoint8": "midpoint, order 8,", "gauss12": "gauss, 12 stages,"}
METHODS = [
    ("euler", "none"),
    *(("semi_implicit", mode) for mode in ("none", "baumgarte", "project", "impulse")),
]
METHODS += [("rk4", "soft"), ("rk4", "baumgarte"), *((rule, "project") for rule in LABELS)]
TOP_BAR, NOTICES = 37, 8.0  # pixels of the viewer's menu; seconds until its notices are gone
LENGTHS = {1.0: "1 m", 1e-3: "1 mm", 1e-6: "1 \u00b5m", 1e-9: "1 nm", 1e-12: "1 pm", 1e-15: "1 fm"}


def swinging(angle):
    """A bob of 1 kg on a rod of 1 m, `angle` rad from the vertical, as fast as a release at level
    makes it."""
    out, along = (
        np.array([np.sin(angle), -np.cos(angle), 0.0]),
        np.array([-np.cos(angle), -np.sin(angle), 0.0]),
    )
    speed = np.sqrt(2.0 * -c.GRAVITY[1] * max(0.0, np.cos(angle)))
    return make_system([out], [speed * along], 1.0, [(0, -1)], [1.0])


def forces():
    """Weight, pull and their sum at four angles of a pendulum."""
    sheet = Drawing(
        760, 500, "Which force does the rod apply? 1 kg on a rod of 1 m, released level"
    )
    pivot, down = np.array([392.0, 86.0]), np.array([1.0, -1.0])  # the y of a sheet points down
    metre, newton = 310.0, 6.6  # pixels
    arc = [
        pivot + metre * np.array([np.sin(a), np.cos(a)])
        for a in np.radians(np.arange(-18.0, 90.1, 2.0))
    ]
    sheet.line(arc, GREY, 1, "2 5")
    rows = [
        ("angle from", "pull found", "3 m g cos"),
        ("the vertical", "by the solve", "of the angle"),
    ]
    for degrees in (90, 60, 30, 0):
        system = swinging(np.radians(degrees))
        q, v = system["q0"], system["v0"]
        weight, pull = c.external_force(system, q)[0], c.constraint_force(system, q, v)[0]
        rows.append(
            (
                f"{degrees}\u00b0",
                *(f"{x:.2f} N" for x in (np.linalg.norm(pull), 3.0 * weight[1] * q[0, 1])),
            )
        )
        bob = pivot + metre * q[0, :2] * down
        by_weight, by_pull, by_both = (
            newton * force[:2] * down for force in (weight, pull, weight + pull)
        )
        sheet.line([pivot, bob], GREY, 2)
        if 0 < degrees < 90:
            sheet.line([bob + by_weight, bob + by_both, bob + by_pull], GREY, 1, "4 4")
        aside = np.array([12.0 * (degrees in (0, 90)), 0.0])  # there they are on one line
        sheet.arrow(bob, bob + by_pull, PULL)
        sheet.arrow(bob, bob + by_weight, WEIGHT)
        sheet.arrow(bob + aside, bob + aside + by_both, INK)
        sheet.dot(bob, 8, INK)
        sheet.words(
            bob[0] + 16, bob[1] + (18 if degrees < 90 else -8), f"{degrees}\u00b0", weight="bold"
        )
    sheet.dot(pivot, 5, GREY)
    for k, (name, color) in enumerate(
        {"weight, m g": WEIGHT, "pull of the rod": PULL, "their sum, m a": INK}.items()
    ):
        sheet.arrow((24, 86 + 24 * k), (72, 86 + 24 * k), color)
        sheet.words(84, 90 + 24 * k, name, color, weight="bold")
    for k, row in enumerate(rows):
        for x, words in zip((104, 204, 304), row, strict=True):
            sheet.words(
                x, 206 + (LINE * k if k < 2 else 22 * k), words, GREY if k < 2 else INK, "end"
            )
    sheet.words(24, 358, "The pull is at right angles to the path:")
    sheet.words(24, 358 + LINE + 2, "it bends the path and does no work.")
    return sheet.text()


def drift():
    """The worst rod error of the five modes over the default run."""
    dt, steps, every = 0.005, 4000, 20
    x = Axis("time, s", (0.0, steps * dt), (84, 640), {float(t): f"{t}" for t in range(0, 21, 5)})
    y = Axis(
        "worst rod error in each tenth of a second", (1e-16, 3.0), (420, 90), LENGTHS, log=True
    )
    chart = Chart(
        760, 480, f"Who keeps the rods? Double pendulum, semi_implicit, steps of {dt} s", x, y
    )
    for mode in c.hold_table():
        found = run(c.build_system("double"), "semi_implicit", mode, dt, steps).violations[1:]
        worst = np.maximum(np.max(found.reshape(-1, every), axis=1), 1e-16)
        chart.curve(
            mode, zip(dt * every * np.arange(1, len(worst) + 1), worst, strict=True), COLORS[mode]
        )
    return chart.text()


def cost():
    """Error against counted cost, from the study speed_vs_error."""
    system = c.build_system("double")
    seconds, _, truth, known = speed_vs_error.horizon(system)
    solves = {100.0: "100", 1000.0: "1 000", 10_000.0: "10 000"}
    x = Axis(
        "linear systems solved for a simulated second",
        (28.0, 20_000.0),
        (84, 560),
        solves,
        log=True,
    )
    y = Axis(
        f"largest error of a particle within {seconds:g} s",
        (1e-14, 20.0),
        (470, 90),
        LENGTHS,
        log=True,
    )
    chart = Chart(760, 530, "What does an error cost? Double pendulum, ever shorter steps", x, y)
    for rule, mode in METHODS:
        rows = speed_vs_error.ladder(system, seconds, rule, mode, truth)
        spots = [
            (row["solves"], row["error"])
            for row in rows
            if row["solves"] > 28.0 and row["error"] < 20.0
        ]
        last = next(
            (k for k, spot in enumerate(spots) if spot[1] < 10.0 * known), len(spots)
        )  # then all is rounding
        chart.curve(f"{LABELS.get(rule, rule)} {mode}", spots[: last + 1], COLORS[mode], dots=True)
    return chart.text()


def viewed(words, seconds):
    """A PNG of the recording of constraints.py `words`, at a time in s, as the viewer shows it in
    1400 x 900."""
    from PIL import Image  # which Rerun brings along

    with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()):
        c.main([*words, "--out", folder])
        with socket.create_server(("127.0.0.1", 0)) as free:
            port = str(free.getsockname()[1])
        command = [
            sys.executable,
            "-m",
            "rerun",
            "--headless",
            "--window-size",
            "1400x900",
            "--port",
            port,
        ]
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        viewer = subprocess.Popen(
            [*command, f"{folder}/{RECORDING}"], start_new_session=True, **quiet
        )
        try:
            client = connect(f"rerun+http://127.0.0.1:{port}/proxy")
            client.set_time(TIMELINE, duration=seconds, play_state="paused")
            time.sleep(NOTICES)
            picture = Image.open(io.BytesIO(client.take_screenshot()))
        finally:
            os.killpg(
                viewer.pid, signal.SIGTERM
            )  # it is a process that Python started, and the one that that started
            viewer.wait()
    file = io.BytesIO()
    picture.convert("RGB").crop((0, TOP_BAR, *picture.size)).quantize(128).save(
        file, "png", optimize=True
    )
    return file.getvalue()


def connect(url):
    """A client of the viewer at `url`, once it shows a recording."""
    from rerun.experimental import ViewerClient

    for _ in range(150):
        with contextlib.suppress(ConnectionError, RuntimeError):
            client = ViewerClient.connect(url)
            if client.get_state().active_recording:
                return client
        time.sleep(0.2)
    raise SystemExit(
        "make_pictures: the viewer does not start; the first lines of this script say what it needs"
    )


PICTURES = {
    "forces.svg": forces,
    "drift.svg": drift,
    "cost.svg": cost,
    "recording.png": partial(viewed, [], 20.0),
    "jansen_leg.png": partial(viewed, ["--system", "jansen_leg"], 3.0),
}


def main(argv=None):
    """Make the pictures that `argv` names, or all."""
    parser = Parser(prog="make_pictures", description=__doc__)
    parser.add_argument(
        "names", nargs="*", metavar="NAME", help=f"some of {', '.join(PICTURES)} (all)"
    )
    names = parser.parse_args(argv).names or list(PICTURES)
    for name in names:
        if name not in PICTURES:
            parser.error(f"argument NAME: no picture {name!r}, but {', '.join(PICTURES)}")
    for name in names:
        made = PICTURES[name]()
        content = made if isinstance(made, bytes) else made.encode()
        write_whole(FOLDER / name, lambda path, content=content: path.write_bytes(content))
        print(f"wrote {os.path.relpath(FOLDER / name)}, {len(content) / 1e3:.0f} kB")
    return 0


if __name__ == "__main__":
    run_script(main)
