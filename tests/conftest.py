"""What several test files need."""

import os
import shutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

import constraints
from curriculum.ch3_4_constraints.report import files

ROOT = Path(__file__).resolve().parents[1]
BARE = "--no-rerun", "--no-page"
FILES = {files.METRICS, files.PAGE, files.RECORDING}
UNIX = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such signals and files")
SCREENS = [({"width": 1100, "height": 820}, "light"), ({"width": 390, "height": 844}, "dark")]


def python(*words, variables=None):
    """A Python that was run from the project's folder and has ended; its output is text."""
    command = [sys.executable, *map(str, words)]
    env = os.environ | (variables or {})
    return subprocess.run(command, capture_output=True, text=True, cwd=ROOT, env=env)


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


# Of constraints.py, what edits replace
FORCE = 'return system["m"] * GRAVITY + system.get("load", 0.0)'
BEGIN = "    for i in range(steps):\n"
STEP = "        q, v = step_fn(q, v, m, force, dt)\n"
KEEP = "        all_q[i + 1] = q\n        all_v[i + 1] = v\n"


def edited(*changes):
    """constraints.py as a module, with lines changed: (old, new), where the old ones stand once."""
    source = (ROOT / "constraints.py").read_text(encoding="utf-8")
    for old, new in changes:
        assert source.count(old) == 1, old
        source = source.replace(old, new)
    module = ModuleType("edited")
    exec(compile(source, "edited.py", "exec"), vars(module))
    return module


@pytest.fixture
def refused(capsys):
    """refused(*flags): what main says of a command line that it refuses: a line, and exit 2."""

    def line(*flags):
        with pytest.raises(SystemExit, match="2"):
            constraints.main([*map(str, flags)])
        printed, said = capsys.readouterr()
        assert (printed, said.count("\n")) == ("", 1)
        return said

    return line


TROUBLE = []  # what pages in a browser complained about, or asked for, since the last test


@pytest.hookimpl(wrapper=True)
def pytest_pyfunc_call():
    """A test fails, in its own body, if a page of its complains."""
    result = yield
    trouble = [x for x in TROUBLE if not x.startswith("data:")]
    TROUBLE.clear()
    assert trouble == []
    return result


@pytest.fixture(scope="module")
def visit():
    """visit(path, **context): a file in Chromium. What it complains about or asks for, fails."""
    sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    path = shutil.which("chromium") or pytest.skip("chromium is not installed")

    def opened(path, **context):
        usual = {"reduced_motion": "reduce", "viewport": {"width": 1100, "height": 820}}
        page = browser.new_page(**usual | context)
        page.on("pageerror", lambda error: TROUBLE.append(str(error)))
        page.on("console", lambda message: TROUBLE.append(message.text))
        page.on("request", lambda request: TROUBLE.append(request.url))
        page.goto(path.as_uri())
        TROUBLE.remove(path.as_uri())
        return page

    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=["--no-sandbox"])
        yield opened


# What a canvas has drawn since it was cleared is then in its `marks`, in pixels; `aimed` is how
# metres became pixels. A line that ends in a head is an arrow.
RECORD = """() => {
  const before = (proto, name, does) => {
    const own = proto[name];
    proto[name] = function(...given) {
      does(this.canvas, this, ...given);
      return own.apply(this, given);
    };
  };
  const pen = CanvasRenderingContext2D.prototype;
  const apart = ([a, b], [c, d]) => Math.hypot(a - c, b - d);
  const isArrow = ([from, tip, left, again, right, more]) => {
    if (!right || more || apart(tip, again) > 0) return false;
    const neck = [0, 1].map(k => (left[k] + right[k]) / 2); // on the shaft
    const off = apart(from, neck) + apart(neck, tip) - apart(from, tip);
    return off < 0.01 && Math.abs(apart(tip, left) - apart(tip, right)) < 0.01;
  };
  const named = value => [...inks].find(([, each]) => each.trim() === value)?.[0];
  const add = (canvas, {globalAlpha}, color, mark) =>
    canvas.marks?.push({...mark, color: named(color), alpha: globalAlpha});
  const strokes = {stroke: "strokeStyle", fill: "fillStyle"};
  for (const [name, style] of Object.entries(strokes)) before(pen, name, (canvas, each) => {
    const {lineWidth: width, [style]: color} = each;
    for (const {at, radius} of canvas.path) {
      const kind = radius ? "disc" : isArrow(at) ? "arrow" : "line";
      const ends = kind === "arrow" ? at.slice(0, 2) : at;
      add(canvas, each, color, {kind, at: ends, radius, width, dash: each.getLineDash()});
    }
  });
  before(pen, "clearRect", (canvas, each, left, top, width, height) => {
    if (width >= canvas.clientWidth && height >= canvas.clientHeight) canvas.marks = [];
  });
  before(pen, "beginPath", canvas => { canvas.path = []; });
  before(pen, "moveTo", (canvas, each, ...at) => canvas.path.push({at: [at]}));
  before(pen, "lineTo", (canvas, each, ...at) => canvas.path.at(-1).at.push(at));
  before(pen, "arc", (canvas, each, x, y, radius) => canvas.path.push({at: [x, y], radius}));
  before(pen, "fillText", (canvas, each, text, x, y) => {
    const {actualBoundingBoxLeft: left, actualBoundingBoxRight: right,
      actualBoundingBoxAscent: above, actualBoundingBoxDescent: below} = each.measureText(text);
    const at = [x + (right - left) / 2, y + (below - above) / 2];
    add(canvas, each, each.fillStyle, {kind: "words", text, width: left + right, at});
  });
  before(pen, "strokeText", (canvas, each, text) => { // over what stood there
    canvas.marks = canvas.marks?.filter(mark => mark.text !== text);
  });
  const {aim} = Stage.prototype;
  Stage.prototype.aim = function() {
    aim.call(this);
    this.canvas.aimed = [this.origin, this.scale];
  };
  dark.dispatchEvent(new Event("change"));
}"""


MISPLACED = """all => all.flatMap(({marks, clientWidth, clientHeight}) => {
  const words = marks.filter(x => x.text);
  const far = ([x, y], [[a, b], [c, d]]) => {
    const [along, up] = [c - a, d - b];
    const share = ((x - a) * along + (y - b) * up) / (along * along + up * up) || 0;
    const on = Math.max(0, Math.min(1, share));
    return Math.hypot(a + on * along - x, b + on * up - y);
  };
  const isOut = ({at: [x, y], width, text}) => {
    const half = text ? width / 2 : 0;
    return x < half || x > clientWidth - half || y < 0 || y > clientHeight;
  };
  const isOver = ({at: [x, y], width, text}) => words.some(({at, text: other, width: wide}) =>
    other !== text && Math.abs(at[1] - y) < 11 && Math.abs(at[0] - x) < (width + wide) / 2);
  const isLost = ({at: [x, y], width, color}) => {
    const pieces = marks.filter(x => x.color === color && ["line", "arrow"].includes(x.kind))
      .flatMap(({at}) => at.map((point, k) => [point, at[k + 1] ?? point]));
    const nearest = Math.min(...[-0.5, 0, 0.5].flatMap(share =>
      pieces.map(piece => far([x + share * width, y], piece))));
    return color !== "quiet" && !(nearest > 3 && nearest < 80);
  };
  const out = [...words, ...marks.filter(x => x.kind === "disc")].filter(isOut);
  return [...out, ...words.filter(x => isOver(x) || isLost(x))];
})"""


def drawn(found, kind, color=None, nth=0):
    """The marks of a kind and a colour on the nth canvas in sight, from behind to front.

    Their points `at`, (3,) or (many, 3), are in metres, and `pixels` are the same in pixels, as are
    `width` and `radius`. The point of words is their middle.
    """
    canvas = found.locator("canvas").filter(visible=True).nth(nth)
    marks, (origin, scale) = canvas.evaluate("x => [x.marks, x.aimed]")
    marks = [x for x in marks if x["kind"] == kind and color in (None, x["color"])]
    for mark in marks:
        mark["pixels"] = np.array(mark["at"])
        at = (mark["pixels"] - origin) / scale * [1.0, -1.0]
        mark["at"] = np.insert(at, 2, 0.0, axis=-1)
    return [SimpleNamespace(**mark) for mark in marks]


def places(*which):
    """Where such marks are, in metres."""
    return np.array([mark.at for mark in drawn(*which)])


def draws(found, kind, color, wanted, nth=0, within=1e-6):
    """The marks of a kind and a colour are those that are wanted, by their places in m."""
    wanted = np.array(wanted)
    near(places(found, kind, color, nth)[..., : wanted.shape[-1]], wanted, within)


def near(found, wanted, within=1e-6):
    assert np.array(found) == pytest.approx(np.array(wanted), abs=within)


def misplaced(found):
    """What stands on canvases out of sight, and words over others or far from what they name.

    That has their colour.
    """
    return found.locator("canvas").evaluate_all(MISPLACED)


def click(shown, name):
    shown.get_by_role("button", name=name, exact=True).click()


def middle(found):
    """That of an element, in pixels on the screen."""
    x, y, width, height = found.bounding_box().values()
    return np.array([x + width / 2, y + height / 2])


def drag(hand, right, down, aside=(0, 0)):
    """Take a hand, `aside` from its middle, and move it by so many pixels; returns what lets go."""
    mouse = hand.page.mouse
    x, y = middle(hand) + aside
    mouse.move(x, y)
    mouse.down()
    mouse.move(x + right, y + down, steps=5)
    return mouse.up


def contrast(*colors):
    """That of two colours, such as "#1f2328", as WCAG 2 defines it."""
    parts = np.array([[*bytes.fromhex(color[1:])] for color in colors]) / 255.0
    linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
    dark, light = sorted(linear @ [0.2126, 0.7152, 0.0722])
    return (light + 0.05) / (dark + 0.05)
