"""When does a double pendulum turn over?  A picture of all starts at rest, a pixel each.

From left to right the second rod's angle goes once round, from bottom to top the first's; in the
middle both hang. The colour is the time at which the second rod first passes the upright: bright
is early, black is never. Starts inside the white curve have too little energy to turn over. Below
the line, as in a mirror, are the lowest rows once more by the mode `none`, whose rods let energy
leak: what turns over late there does not turn over at all.
"""

import base64
import math
import struct
import zlib

import constraints as c
from curriculum.ch3_4_constraints.studies import _runs
from curriculum.ch3_4_constraints.svg import GREY, INK, Drawing
from curriculum.ch3_4_constraints.tables import show
from curriculum.common.cli import number, writable
from curriculum.common.files import write_whole
from curriculum.common.progress import work

import numpy as np

DT, MODE = 0.005, "impulse"  # s; what holds the rods but in the strip
LOOK, BATCH = 8, 32768  # steps; members that go in step: memory is theirs, and a byte a pixel
NEVER, WHITE = 0, 255  # of the palette; between them are the times
STRIP = 6  # of so many rows one is shown by `none` as well
EDGE, LEFT, TOP = 560, 76, 16  # pixels of the sheet: the map's edge, and what is left of it, above


def starts(angles):
    """q (R, 2, 3) in m of unit rods at `angles` (R, 2) from straight down, in rad."""
    x, y = np.sin(angles), -np.cos(angles)
    return np.cumsum(np.stack([x, y, 0.0 * x], axis=-1), axis=1)


def first_turns(angles, mode, seconds):
    """The look (R,) at which the second rod has first passed the upright; 0: it does not.

    A rod is looked at every LOOK steps. While energy is kept, it turns by no more than sqrt(24 g /
    L), 15 rad/s: far less than a quarter turn. So a rod that went over stands left of its joint at
    one look and right of it at the next, and above it. One that falls back between two looks has
    not turned.
    """
    q, turns = starts(angles), np.zeros(len(angles), dtype=int)
    start = c.build_system("double") | {"q0": q, "v0": np.zeros_like(q)}
    crowd = _runs.crowd(start, "semi_implicit", mode, DT)
    for look in range(1, round(seconds / (LOOK * DT)) + 1):
        before = q[:, 1, 0] - q[:, 0, 0]
        crowd.advance(LOOK)
        q, _ = crowd.states()
        d = q[:, 1] - q[:, 0]
        turns[(turns == 0) & (d[:, 0] * before < 0.0) & (d[:, 1] > 0.0)] = look
    return turns


def angle(size):
    """The angles (size,) of a map's rows and columns in rad, symmetric to the last bit."""
    return math.pi * (2.0 * np.arange(size) + 1.0 - size) / size


def lights(size, rows, mode, seconds):
    """Palette entries (rows, size) of the lowest rows of a map, the lowest first."""
    pixels, looks = np.zeros(rows * size, dtype=np.uint8), round(seconds / (LOOK * DT))
    for begin in work.through(f"turning, {mode}", range(0, rows * size, BATCH)):
        place = np.arange(begin, min(begin + BATCH, rows * size))
        angles = angle(size)[np.stack([place // size, place % size], axis=1)]
        turns = first_turns(angles, mode, seconds)
        late = (WHITE - 2) * (turns - 1) // looks
        pixels[place] = np.where(turns > 0, WHITE - 1 - late, NEVER)
    return pixels.reshape(rows, size)


def png(pixels):
    """The bytes of a PNG of palette entries (rows, columns), from black over red to white."""
    share = np.linspace(0.0, 1.0, 256)[:, None]
    palette = 255.0 * np.clip(3.0 * share - [0.0, 1.0, 2.0], 0.0, 1.0)
    rows = b"".join(b"\0" + row.tobytes() for row in pixels)
    parts = {b"IHDR": struct.pack(">IIBBBBB", *pixels.shape[::-1], 8, 3, 0, 0, 0)}
    parts[b"PLTE"] = palette.round().astype(np.uint8).tobytes()
    parts |= {b"IDAT": zlib.compress(rows, 9), b"IEND": b""}
    found = b"\x89PNG\r\n\x1a\n"
    for name, data in parts.items():
        found += struct.pack(">I", len(data)) + name + data
        found += struct.pack(">I", zlib.crc32(name + data))
    return found


def sheet(pixels, size, gap, seconds):
    """The text of an SVG: a map of palette entries (rows, size), its axes, and what colours mean.

    Of its rows the first `size` are the map, then `gap` a line, and the last the strip by `none`.
    """
    tall = EDGE * len(pixels) / size  # pixels of the sheet
    drawn = Drawing(LEFT + EDGE + 104, round(TOP + tall + 64), "When does it turn over?")

    def image(what, x, y, width, height):
        data = f"data:image/png;base64,{base64.b64encode(png(what)).decode()}"
        place = {"x": x, "y": y, "width": width, "height": f"{height:.1f}"}
        drawn.add("image", href=data, preserveAspectRatio="none", **place)

    image(pixels, LEFT, TOP, EDGE, tall)
    for degrees in (-180, -90, 0, 90, 180):
        words, share = f"{degrees}\u00b0", EDGE * (degrees + 180) / 360
        across, up = LEFT + share, TOP + EDGE - share
        drawn.line([(across, TOP + tall), (across, TOP + tall + 6)], GREY, 1)
        drawn.line([(LEFT - 6, up), (LEFT, up)], GREY, 1)
        drawn.words(across, TOP + tall + 22, words, GREY, "middle")
        drawn.words(LEFT - 10, up + (0 if degrees == -180 else 10), words, GREY, "end")
    drawn.words(LEFT + EDGE / 2, TOP + tall + 46, "second rod's angle at the start", INK, "middle")
    strip = TOP + EDGE * (size + gap) / size
    drawn.words(LEFT - 10, (strip + TOP + tall) / 2 + 5, "none", INK, "end", weight="bold")
    side = {"transform": f"translate(18 {TOP + EDGE / 2}) rotate(-90)", "text_anchor": "middle"}
    drawn.add("text", "first rod's angle at the start", fill=INK, font_size=15, **side)
    right, low, high = LEFT + EDGE + 20, TOP + 0.75 * EDGE, TOP + 0.3 * EDGE
    image(np.arange(WHITE - 1, 0, -1, dtype=np.uint8)[:, None], right, high, 18, low - high)
    image(np.array([[NEVER]], dtype=np.uint8), right, low + 16, 18, 18)
    drawn.words(right, high - 30, "turns over")
    drawn.words(right, high - 12, "after")
    for share in (1.0, 0.5, 0.0):
        at = high + share * (low - high)
        drawn.words(right + 24, at + 5, f"{share * seconds:.3g} s", GREY)
    drawn.words(right + 24, low + 30, "never", GREY)
    return drawn.text()


def main(argv=None):
    """Compute, print what share turns over, write the picture."""
    parser = _runs.study_parser("map", __doc__, {"size": 100, "seconds": 5.0})
    add = parser.add_argument
    add("--size", type=number(int, 8, 20_000), default=1000, help="pixels along an edge (1000)")
    add("--seconds", type=number(float, 0.1, 1000), default=10.0, help="to wait for it (10)")
    add("--out", type=writable, default="outputs/map.svg", metavar="PATH", help="of the picture")
    args = parser.parse_args(argv)
    size, seconds, rows = args.size, args.seconds, []
    _runs.host(size=size, seconds=seconds, dt=DT)
    half, strip = (size + 1) // 2, max(1, size // STRIP)
    low, leaky = lights(size, half, MODE, seconds), lights(size, strip, "none", seconds)
    # a mirror image moves as the mirror image of the motion, to the last bit: half was enough
    whole = np.concatenate([low, low[size // 2 - 1 :: -1, ::-1]])
    # those with less energy than the lowest pose with the second rod up; of these the outermost
    poor = 2.0 * np.cos(angle(size))[:, None] + np.cos(angle(size)) > 1.0
    inner = [np.roll(poor, shift, axis) for shift in (1, -1) for axis in (0, 1)]
    edge = poor & ~np.logical_and.reduce(inner)
    for mode, seen in ((MODE, whole), (MODE, whole[:strip]), ("none", leaky)):
        row = {"mode": mode, "rows": len(seen), "turned over": np.mean(seen > NEVER)}
        rows.append(row | {"without the energy": np.sum(seen[poor[: len(seen)]] > NEVER)})
    show(f"share of starts at rest that turn over within {seconds:g} s", rows)
    line = np.full((max(1, size // 200), size), WHITE, dtype=np.uint8)
    image = np.concatenate([np.where(edge, WHITE, whole)[::-1], line, leaky]).astype(np.uint8)
    write_whole(args.out, sheet(image, size, len(line), seconds))
    print(f"wrote {args.out}")
