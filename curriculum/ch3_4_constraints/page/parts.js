"use strict";
// Parts that both pages are made of. A scene is an object that page.py writes: its steps and
// measures are the chapter's own lines, as JavaScript, with Python's bits. Names and lengths:
//
//   plus(a, b, factor), times(a, factor), dot, size, unit, across     vectors [x, y] of the plane
//   fixed(x, digits), metric(x), perCent(share)                       numbers in words
//   make(tag, settings, ...inside), row(className, ...inside), makeButton(text, onclick)
//   new Motion(scene, method, knobs)     under a method; begin(state), step(), measure(name)
//   new Stage(label, box, paint, pad)    a canvas that shows a box of metres; draw(), hand(...)
//       in paint(stage): line, disc, words, arrow, rod, system
//   makeGauge(label, errors)             a bar a rod: too short to the left, too long to the right
//   makePlot(label, axis, curves)        curves over time; axis: decades, distances or shares
//   new Clock(figure, dt, step, draw)    takes steps as time goes by; set(going), speed
//   makeSlider(name, values, index, words, changed)     over exact values
//
// A colour is the name of a variable of CSS, such as "ink".

// --- vectors of the plane, numbers in words, elements of the page ---
const plus = ([a, b], [c, d], factor = 1) => [a + factor * c, b + factor * d];
const times = ([a, b], factor) => [factor * a, factor * b];
const dot = ([a, b], [c, d]) => a * c + b * d;
const size = ([a, b]) => Math.hypot(a, b);
const unit = a => times(a, 1 / (size(a) || 1));
const across = ([a, b]) => [-b, a];
const largest = numbers => numbers.reduce((most, x) => Math.max(most, Math.abs(x)), 0);

const UNITS = [[1, "m", 1], [1e-3, "cm", 1e-2], [1e-6, "µm"], [1e-9, "nm"], [1e-12, "pm"]];
const minus = text => text.replace("-", "\u2212");
const brief = x => minus(String(Number(x.toPrecision(2)))); // two digits, as the table has them
const fixed = (x, digits) => minus((Number(x.toFixed(digits)) + 0).toFixed(digits)); // no -0.0
const perCent = share => `${brief(Math.abs(share) < 1e-6 ? 0 : 100 * share)} %`;
function metric(x) { // a length in m, as the table prints it
  if (x < 1e-12) return "< 1 pm";
  const rounded = Number(x.toPrecision(2));
  const [least, name, each = least] = UNITS.find(([least]) => rounded >= least);
  return `${brief(rounded / each)} ${name}`;
}

function make(tag, settings = {}, ...inside) {
  const element = Object.assign(document.createElement(tag), settings);
  element.append(...inside);
  return element;
}
const row = (className, ...inside) => make("div", {className}, ...inside);
const makeButton = (textContent, onclick) => make("button", {type: "button", textContent, onclick});
const styles = getComputedStyle(document.documentElement); // follows a change to dark by itself
const ink = color => styles.getPropertyValue(`--${color}`);

// --- what moves ---
class Motion {
  // knobs: dt in s, baumgarte in rad/s, time_constant in s, mass (a factor on the last particle's),
  // hand [x, y] in m, and pulls: for each particle the stiffness in N/m of the hand's spring.
  constructor(scene, method, knobs) {
    Object.assign(this, {scene, method, knobs});
    this.settings = new Float64Array(3 * scene.methods.length);
    this.scratch = new Float64Array(1.5 * scene.start.length); // q, v, and q as a step starts
    this.begin();
  }
  static knobs(scene, settings) {
    return {...scene.knobs, mass: 1, hand: [0, 0], pulls: scene.masses.map(() => 0), ...settings};
  }
  begin(state = this.scene.start) { // q, then v: x, y, z of each particle, and z stays 0
    Object.assign(this, {state: Float64Array.from(state), time: 0});
  }
  step(dt = this.knobs.dt) { // an Error says why a step has no result; the state is as it was
    const {scene, method, settings, scratch, knobs, state} = this;
    const row = 3 * scene.methods.indexOf(method);
    const table = [dt, knobs.baumgarte, knobs.time_constant];
    scene.settings(settings, 0, null, ...table);
    const asked = settings.subarray(row, row + 3); // use_jdotv, damping, stiffness
    const felt = [knobs.mass, ...knobs.hand, ...knobs.pulls];
    scratch.set(state);
    scratch.set(state.subarray(0, state.length / 2), state.length);
    scene.steps[scene.kinds[method]](scratch, 0, null, dt, ...asked, ...felt);
    scene.posts[method]?.(scratch, 0, null, ...table, knobs.mass);
    state.set(scratch.subarray(0, state.length));
    this.time += dt;
  }
  measure(name, count = 1) { // as many numbers, of the state as it is
    this.scratch.set(this.state);
    this.scene.measures[name](this.scratch, 0, null, this.knobs.mass);
    return Array.from(this.scratch.subarray(0, count));
  }
  get errors() { return this.measure("errors", this.scene.pairs.length); } // m; above 0: too long
  get energy() { return this.measure("energy")[0]; } // in parts of m g L
  point(k) { // where particle k is; or, below 0, an anchor
    return k < 0 ? this.scene.anchors[-1 - k] : Array.from(this.state.subarray(3 * k, 3 * k + 2));
  }
  get points() { return this.scene.masses.map((_, k) => this.point(k)); }
  get far() { // m: with rods off by more, it has flown apart
    return 100 * this.scene.lengths.reduce((sum, length) => sum + length);
  }
}

class Clock {
  // Takes steps of dt() s as time goes by, draws, and asks for frames only while it goes and
  // `figure` is on the screen. Who wants less motion has to start it.
  constructor(figure, dt, step, draw) {
    Object.assign(this, {dt, step, draw, speed: 1, seen: true, asked: false});
    this.element = makeButton("", () => this.set(!this.going));
    this.set(!matchMedia("(prefers-reduced-motion: reduce)").matches);
    new IntersectionObserver(([{isIntersecting}]) => {
      this.seen = isIntersecting;
      this.set(this.going);
    }).observe(figure);
  }
  set(going) {
    const stops = this.going && !going;
    Object.assign(this, {going, before: null, owed: 0, late: false});
    this.element.textContent = going ? "Pause" : "Play";
    if (stops) this.draw(); // with all that is told less often while it goes
    this.ask();
  }
  ask() {
    if (!this.going || !this.seen || this.asked) return;
    this.asked = true;
    requestAnimationFrame(now => this.frame(now));
  }
  frame(now) {
    this.asked = false;
    if (!this.going) return;
    this.advance(this.before === null ? 0 : Math.min(0.1, (now - this.before) / 1000) * this.speed);
    this.before = now;
    this.draw();
    this.ask();
  }
  advance(elapsed) { // what a frame has no time for is dropped, so that it never races
    const end = performance.now() + 10; // ms
    this.owed += elapsed;
    while (this.owed >= this.dt() && this.going && performance.now() < end) {
      this.step();
      this.owed -= this.dt();
    }
    this.late = this.owed >= this.dt();
    if (this.late) this.owed = 0;
  }
}

// --- what is seen ---
const [PLAIN, BOLD] = ["12px system-ui, sans-serif", "600 13px system-ui, sans-serif"];
const ITALIC = "italic 20px Georgia, serif"; // as formulas are
const ARROWS = {ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1]};

class Stage {
  // A canvas on which paint(stage) draws, from behind to front. It shows a box of metres, [left,
  // bottom, right, top], as large as fits within `pad` pixels; `stretched`, to its edges.
  constructor(ariaLabel, box, paint, pad = [6, 6, 6, 6], stretched = false) {
    this.canvas = make("canvas", {role: "img", ariaLabel});
    this.element = row("stage", this.canvas);
    Object.assign(this, {box, paint, pad, stretched, hands: [], pen: this.canvas.getContext("2d")});
    new ResizeObserver(() => this.fit()).observe(this.canvas);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.draw());
  }
  fit() { // the canvas as sharp as the screen
    const {canvas} = this, sharp = devicePixelRatio;
    [this.width, this.height] = [canvas.clientWidth, canvas.clientHeight];
    Object.assign(canvas, {width: this.width * sharp, height: this.height * sharp});
    this.pen.scale(sharp, sharp);
    Object.assign(this.pen, {lineJoin: "round", lineCap: "round"});
    this.draw();
  }
  aim() { // pixels for each metre, and where the metres' origin is
    const {width, height, box: [left, bottom, right, top], pad: [west, south, east, north]} = this;
    const [wide, tall] = [width - west - east, height - south - north];
    this.scale = [wide / (right - left), tall / (top - bottom)];
    if (!this.stretched) this.scale.fill(Math.min(...this.scale));
    this.origin = [
      west + (wide - this.scale[0] * (left + right)) / 2,
      north + (tall + this.scale[1] * (bottom + top)) / 2,
    ];
  }
  draw() {
    if (!this.width) return; // it is not on the page yet
    this.aim();
    this.pen.clearRect(0, 0, this.width, this.height);
    this.paint(this);
    for (const {hand, where} of this.hands) {
      hand.style.translate = this.pixels(where()).map(x => `${x.toFixed(1)}px`).join(" ");
    }
  }
  pixels([x, y]) {
    return [this.origin[0] + this.scale[0] * x, this.origin[1] - this.scale[1] * y];
  }
  metres({clientX, clientY}) { // where an event is
    const {left, top} = this.canvas.getBoundingClientRect(), [x, y] = this.origin;
    return [(clientX - left - x) / this.scale[0], (y + top - clientY) / this.scale[1]];
  }
  line(points, color, lineWidth = 2, dash = []) {
    Object.assign(this.pen, {strokeStyle: ink(color), lineWidth});
    this.pen.setLineDash(dash);
    this.pen.beginPath();
    for (const point of points) this.pen.lineTo(...this.pixels(point));
    this.pen.stroke();
  }
  circle(at, radius, color) { // of so many metres, dotted
    const angles = Array.from({length: 91}, (_, k) => k * Math.PI / 45);
    const points = angles.map(x => plus(at, [Math.cos(x), Math.sin(x)], radius));
    this.line(points, color, 1, [1, 5]);
  }
  disc(at, radius, color = "ink") { // of so many pixels
    this.pen.beginPath();
    this.pen.arc(...this.pixels(at), radius, 0, 7);
    this.pen.fillStyle = ink(color);
    this.pen.fill();
  }
  words(text, at, color, [right, up] = [0, 0], textAlign = "center", font = BOLD) {
    const [x, y] = this.pixels(at); // and from there so many pixels
    Object.assign(this.pen, {font, textAlign, textBaseline: "middle", fillStyle: ink(color)});
    this.pen.fillText(text, x + right, y - up);
  }
  symbol(text, at, color, aside) { this.words(text, at, color, aside, "center", ITALIC); }
  arrow(from, by, color, lineWidth = 3.5) {
    const tip = plus(from, by), back = times(unit(by), -Math.min(12 / this.scale[0], size(by)));
    const [left, right] = [0.5, -0.5].map(side => plus(plus(tip, back), across(back), side));
    this.line([from, tip, left, tip, right], color, lineWidth);
  }
  rod(from, to, length, color, lineWidth) { // solid red is too much of it, dashed blue is missing
    const right = plus(from, unit(plus(to, from, -1)), length), is = size(plus(to, from, -1));
    this.line([from, is > length ? right : to], color, lineWidth);
    if (Math.abs(is - length) * this.scale[0] < 0.7) return; // of a pixel: nothing to be seen
    if (is > length) this.line([right, to], "long", lineWidth + 2.5);
    else this.line([to, right], "short", lineWidth, [2, lineWidth + 3]);
  }
  system(motion, color = "ink", bobs = color) {
    const {pairs, lengths, anchors} = motion.scene;
    const shortest = this.scale[0] * Math.min(...lengths); // pixels
    const bob = Math.max(2, Math.min(7, shortest / 6));
    for (const anchor of anchors) this.disc(anchor, Math.max(2, 0.7 * bob), "quiet");
    for (const point of motion.points) this.disc(point, bob, bobs); // below the ends of rods
    pairs.forEach(([i, j], k) =>
      this.rod(motion.point(j), motion.point(i), lengths[k], color, Math.max(1.2, bob / 2.5)));
  }
  // Lets a point, where(), be dragged or moved by the arrow keys: move([x, y]) until letGo(). It is
  // a button that floats above the canvas. Where buttons overlap, the nearest point is taken.
  hand(ariaLabel, where, move, letGo = () => {}) {
    let target, offset = [0, 0];
    const to = point => {
      target = point;
      move(point);
    };
    const release = () => {
      if (!target) return;
      target = null;
      letGo();
    };
    const grab = event => {
      event.preventDefault(); // which would focus the button on top
      hand.focus({preventScroll: true});
      hand.setPointerCapture(event.pointerId);
      offset = plus(where(), this.metres(event), -1);
      to(where());
    };
    const hand = make("button", {type: "button", className: "hand", ariaLabel,
      onpointerdown: event => {
        const far = ({where}) => size(plus(where(), this.metres(event), -1));
        this.hands.reduce((one, other) => (far(other) <= far(one) ? other : one)).grab(event);
      },
      onpointermove: event => {
        if (target && hand.hasPointerCapture(event.pointerId)) to(plus(this.metres(event), offset));
      },
      onpointerup: release, onpointercancel: release, onblur: release,
      onkeydown: event => {
        const by = ARROWS[event.key];
        if (event.altKey || event.ctrlKey || event.metaKey) return; // the browser's own
        if (by) to(plus(target ?? where(), by, 12 / this.scale[0]));
        else if (["Enter", " ", "Escape"].includes(event.key)) release();
        else return;
        event.preventDefault();
      }});
    this.hands.push({hand, where, grab});
    this.element.append(hand);
    return hand;
  }
}

// Errors in m of all rods, now: a bar each, a decade a notch, from 1 um in the middle to 1 m.
function makeGauge(label, errors) {
  const gauge = new Stage(label, [-6, 0, 6, 1], () => {
    for (let k = -6; k <= 6; k += 1) gauge.line([[k, 0], [k, 1]], k ? "pale" : "quiet", 1);
    const each = 1 / errors().length;
    errors().forEach((error, k) => {
      const decades = Math.sign(error) * Math.max(0, Math.min(6, 6 + Math.log10(Math.abs(error))));
      const [x, y] = gauge.pixels([0, 1 - k * each]), tall = gauge.scale[1] * each;
      gauge.pen.fillStyle = ink(error > 0 ? "long" : "short");
      gauge.pen.fillRect(x, y + 0.1 * tall, decades * gauge.scale[0], 0.8 * tall);
    });
    if (gauge.width < 200) return;
    gauge.words("short", [-6, 0], "quiet", [0, -10], "left", PLAIN);
    gauge.words("long", [6, 0], "quiet", [0, -10], "right", PLAIN);
  }, [1, 17, 1, 2], true);
  gauge.element.classList.add("gauge");
  return gauge;
}

// How high a value stands in a plot, and the ticks of its axis: values and words.
const decades = {
  ticks: [[1e-12, "1 pm"], [1e-9, "1 nm"], [1e-6, "1 µm"], [1e-2, "1 cm"], [1, "1 m"]],
  up: x => Math.log10(Math.max(x, 1e-13)), low: -13, high: 0.7,
};
const distances = {
  ticks: [[1e-4, "100 µm"], [1e-2, "1 cm"], [1, "1 m"], [10, "10 m"]],
  up: decades.up, low: -4.3, high: 1.3,
};
const shares = { // of m g L, by their square roots: small ones can be seen, too
  ticks: [-1, -0.25, -0.05, 0, 0.05, 0.25, 1].map(x => [x, (x > 0 ? "+" : "") + perCent(x)]),
  up: x => Math.sign(x) * Math.sqrt(Math.abs(x)), low: -1, high: 1,
};

// curves(): a list of {color, points: [[s, value], ...], words, dash}; the words stand at the end.
// It shows 5, 10 or 20 s, and then the last 20.
function makePlot(label, axis, curves) {
  const plot = new Stage(label, [0, 0, 1, 1], () => {
    const {ticks, up, low, high} = plot.axis, lines = curves();
    const now = Math.max(...lines.map(({points}) => points.at(-1)?.[0] ?? 0));
    const span = [5, 10].find(s => s >= now) ?? 20, right = Math.max(span, now);
    const left = right - span, wide = words => plot.pen.measureText(words).width;
    plot.pen.font = BOLD;
    plot.pad[0] = 8 + Math.max(...ticks.map(([, words]) => wide(words)));
    plot.pad[2] = 12 + Math.max(...lines.map(({words}) => wide(words ?? "")));
    plot.box = [left, low, right, high];
    plot.aim();
    const height = value => Math.max(low, Math.min(high, up(value)));
    for (const [value, words] of ticks) {
      plot.line([[left, up(value)], [right, up(value)]], "pale", 1);
      plot.words(words, [left, up(value)], "quiet", [-6, 0], "right", PLAIN);
    }
    for (let s = span / 5 * Math.ceil(5 * left / span); s <= right; s += span / 5) {
      plot.words(`${s} s`, [s, low], "quiet", [0, -11], "center", PLAIN);
    }
    for (const {color, points, dash} of lines) {
      const seen = points.filter(([s]) => s >= left).map(([s, value]) => [s, height(value)]);
      plot.line(seen, color, dash ? 1.2 : 2, dash);
    }
    const ends = lines.filter(({words}) => words).map(({color, points, words}) => ({
      color, words, y: plot.pixels([0, height(points.at(-1)?.[1] ?? 0)])[1],
    })).sort((a, b) => a.y - b.y);
    ends.forEach((end, k) => { // pushed apart, down and then up
      end.y = Math.max(end.y, (ends[k - 1]?.y ?? 0) + 15);
    });
    ends.reverse().forEach((end, k) => {
      end.y = Math.min(end.y, plot.height - 24 - 15 * k);
    });
    for (const {color, words, y} of ends) {
      plot.words(words, [right, low], color, [8, plot.pixels([0, low])[1] - y], "left");
    }
  }, [0, 20, 0, 8], true);
  plot.axis = axis;
  return plot;
}

// A slider over a list, so that each value is exact.
function makeSlider(name, values, index, words, changed) {
  const output = make("output");
  const input = make("input", {type: "range", min: 0, max: values.length - 1, value: index});
  const value = () => values[input.value];
  const say = () => { output.value = input.ariaValueText = words(value()); };
  const set = x => {
    input.value = values.indexOf(x);
    say();
  };
  input.oninput = () => {
    say();
    changed(value());
  };
  say();
  const element = make("label", {}, make("span", {textContent: name}), input, output);
  return {value, set, say, input, element};
}
