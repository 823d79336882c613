"use strict";
// Parts that both pages are made of. A scene is an object of page/scene.py: its steps and
// measures are the chapter's own lines, as JavaScript, with Python's bits. Names and lengths:
//
//   plus(a, b, factor), times(a, factor), size, unit, across          vectors [x, y] of the plane
//   fixed(x, digits), metric(x), perCent(share)                       numbers in words
//   make(tag, settings, ...inside), row(className, ...inside), makeButton(text, onclick)
//   new Motion(scene, method, knobs)     under a method; begin(state), step(), measure(name)
//   new Stage(label, box, paint, pad)    a canvas that shows a box of metres; draw(), hand(...)
//       in paint(stage): line, disc, words, arrow, rods, system
//   makePlot(label, axis, curves)        curves over time; axis: logarithmic(...) or linear(...)
//   placeNames(stage, names)             where lines end, apart
//   new Clock(figure, dt, step, draw)    takes steps as time goes by; set(going)
//   makeSlider(name, values, index, words, changed)     over exact values
//
// A colour is the name of a variable of CSS, such as "ink".

// --- vectors of the plane, numbers in words, elements of the page ---
const plus = ([a, b], [c, d], factor = 1) => [a + factor * c, b + factor * d];
const times = ([a, b], factor) => [factor * a, factor * b];
const size = ([a, b]) => Math.hypot(a, b);
const unit = a => times(a, 1 / (size(a) || 1));
const across = ([a, b]) => [-b, a];
const largest = numbers => numbers.reduce((most, x) => Math.max(most, Math.abs(x)), 0);

const UNITS = {m: 1, cm: 1e-2, mm: 1e-3, µm: 1e-6, nm: 1e-9, pm: 1e-12}; // in m
const minus = text => text.replace(/^-/, "\u2212");
const fixed = (x, digits) => minus((Number(x.toFixed(digits)) + 0).toFixed(digits)); // no -0.0
const perCent = share => brief(100 * share) + " %";
function inDigits(x, many) { // so many; a tie goes to the even one, as in Python
  const [exact, power] = x.toExponential(many + 24).split("e");
  const isTie = exact.endsWith("5".padEnd(25, "0")) && exact.at(-26) % 2 === 0;
  return Number(isTie ? `${exact.slice(0, -25)}e${power}` : x.toPrecision(many));
}
function brief(x) { // two digits, in the form that Python's :g gives them
  const rounded = inDigits(x, 2);
  const [digits, power = 0] = rounded.toExponential(1).split("e");
  if (x === 0 || (power >= -4 && power < 6)) return minus(String(rounded + 0));
  return `${minus(String(Number(digits)))}e${power[0]}${power.slice(1).padStart(2, "0")}`;
}
function metric(x) { // a length in m, as the table prints it
  if (x < 1e-12) return "< 1 pm";
  const rounded = inDigits(x, 2);
  const unit = Object.keys(UNITS).find(unit => rounded >= UNITS[unit]);
  return `${brief(rounded / UNITS[unit])} ${unit}`;
}

function make(tag, settings = {}, ...inside) {
  const element = Object.assign(document.createElement(tag), settings);
  element.append(...inside);
  return element;
}
const row = (className, ...inside) => make("div", {className}, ...inside);
const makeButton = (textContent, onclick) => make("button", {type: "button", textContent, onclick});
const styles = getComputedStyle(document.documentElement);
const inks = new Map();
const dark = matchMedia("screen and (prefers-color-scheme: dark)"); // paper is white
dark.addEventListener("change", () => inks.clear());
function ink(color) { // kept, since each look into styles may lay out the page
  if (!inks.has(color)) inks.set(color, styles.getPropertyValue(`--${color}`));
  return inks.get(color);
}

// --- what moves ---
class Motion {
  // knobs: dt in s and more of make_methods, which scene.takes puts in order; the hand [x, y] in m;
  // and pulls: for each particle the stiffness in N/m of the hand's spring.
  constructor(scene, method, knobs) {
    Object.assign(this, {scene, method, knobs});
    this.scratch = new Float64Array(1.5 * scene.start.length); // q, v, and q as a step starts
    this.begin();
  }
  static knobs(scene, settings) {
    return {...scene.knobs, hand: [0, 0], pulls: scene.masses.map(() => 0), ...settings};
  }
  begin(state = this.scene.start) { // q, then v: x, y, z of each particle, and z stays 0
    Object.assign(this, {state: Float64Array.from(state), time: 0});
  }
  step(dt = this.knobs.dt) { // an Error says why a step has no result; the state is as it was
    const {scene, method, scratch, state} = this;
    const {hand, pulls} = this.knobs;
    const known = {...this.knobs, dt};
    const taken = scene.takes.map(knob => known[knob]);
    scratch.set(state);
    scratch.set(state.subarray(0, state.length / 2), state.length);
    scene.steps[scene.same_step[method]](scratch, 0, null, ...taken, ...hand, ...pulls);
    scene.posts[scene.method_of[method]]?.(scratch, 0, null, ...taken);
    state.set(scratch.subarray(0, state.length));
    this.time += dt;
  }
  measure(name, count = 1) { // as many numbers, of the state as it is
    this.scratch.set(this.state);
    this.scene.measures[name](this.scratch);
    return Array.from(this.scratch.subarray(0, count));
  }
  get errors() { return this.measure("errors", this.scene.pairs.length); } // m; above 0: too long
  get energy() { return this.measure("energy")[0]; } // in parts of its scale
  point(k) { // where particle k is; or, below 0, an anchor
    return k < 0 ? this.scene.anchors[-1 - k] : [this.state[3 * k], this.state[3 * k + 1]];
  }
  get points() { return this.scene.masses.map((_, k) => this.point(k)); }
  get far() { return this.scene.far; } // m: with rods off by more it is lost
}

class Clock {
  // Takes steps of dt() s as time goes by, draws, and asks for frames only while it goes and
  // `figure` is on the screen. Who wants less motion has to start it.
  constructor(figure, dt, step, draw) {
    Object.assign(this, {dt, step, draw, seen: true, asked: false});
    figure.clock = this;
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
    this.advance(this.before === null ? 0 : (now - this.before) / 1000);
    this.before = now;
    this.draw();
    this.ask();
  }
  advance(elapsed) { // what a frame has no time for is dropped, so that it never races
    const end = performance.now() + 10; // ms
    this.owed += Math.min(0.1, elapsed);
    while (this.owed >= this.dt() && this.going && performance.now() < end) {
      this.step();
      this.owed -= this.dt();
    }
    this.late = elapsed > 0.1 || this.owed >= this.dt();
    if (this.owed >= this.dt()) this.owed = 0;
  }
}

// --- what is seen ---
const PLAIN = "12px system-ui, sans-serif";
const BOLD = "600 13px system-ui, sans-serif";
const FINGER = 44; // pixels
const ARROWS = {ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1]};

class Stage {
  // A canvas on which paint(stage) draws, from behind to front. It shows a box of metres, [left,
  // bottom, right, top], as large as fits within `pad` pixels; `stretched`, to its edges.
  constructor(ariaLabel, box, paint, pad = [6, 6, 6, 6], stretched = false) {
    this.canvas = make("canvas", {role: "img", ariaLabel});
    this.element = row("stage", this.canvas);
    Object.assign(this, {box, paint, pad, stretched, hands: [], pen: this.canvas.getContext("2d")});
    this.reach = FINGER / 2; // pixels: a pointer takes a hand that is as near
    this.followPointers();
    new ResizeObserver(() => this.fit()).observe(this.canvas);
    dark.addEventListener("change", () => this.draw());
  }
  get zoom() { return this.canvas.getBoundingClientRect().width / this.canvas.clientWidth; }
  fit() { // the canvas as sharp as the screen
    const {canvas} = this;
    const sharp = devicePixelRatio * this.zoom;
    this.width = canvas.clientWidth;
    this.height = canvas.clientHeight;
    Object.assign(canvas, {width: this.width * sharp, height: this.height * sharp});
    this.pen.scale(sharp, sharp);
    Object.assign(this.pen, {lineJoin: "round", lineCap: "round"});
    this.draw();
  }
  aim() { // pixels for each metre, and where the metres' origin is
    const {width, height, box: [left, bottom, right, top], pad: [west, south, east, north]} = this;
    const wide = width - west - east;
    const tall = height - south - north;
    this.scale = [wide / (right - left), tall / (top - bottom)];
    if (!this.stretched) this.scale.fill(Math.min(...this.scale));
    this.origin = [
      west + (wide - this.scale[0] * (left + right)) / 2,
      north + (tall + this.scale[1] * (bottom + top)) / 2,
    ];
  }
  draw(placesHands = true) { // which takes a browser as long as to paint
    if (!this.width) return; // it is not on the page yet
    this.aim();
    this.pen.clearRect(0, 0, this.width, this.height);
    this.paint(this);
    if (!placesHands) return;
    for (const {hand, where} of this.hands) {
      hand.style.translate = this.pixels(where()).map(x => `${x.toFixed(1)}px`).join(" ");
    }
  }
  pixels([x, y]) {
    return [this.origin[0] + this.scale[0] * x, this.origin[1] - this.scale[1] * y];
  }
  metresAt([x, y]) {
    return [(x - this.origin[0]) / this.scale[0], (this.origin[1] - y) / this.scale[1]];
  }
  metres({clientX, clientY}) { // where an event is
    const {left, top} = this.canvas.getBoundingClientRect();
    return this.metresAt(times([clientX - left, clientY - top], 1 / this.zoom));
  }
  line(points, ...style) { this.lines([points], ...style); }
  lines(each, color, lineWidth = 2, dash = []) { // in one stroke, which is quicker
    const {pen} = this;
    Object.assign(pen, {strokeStyle: ink(color), lineWidth});
    pen.setLineDash(dash);
    pen.beginPath();
    for (const points of each) {
      points.forEach((point, k) => pen[k ? "lineTo" : "moveTo"](...this.pixels(point)));
    }
    pen.stroke();
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
  arrow(from, by, color, lineWidth = 3.5) {
    const tip = plus(from, by);
    const back = times(unit(by), -Math.min(12 / this.scale[0], size(by)));
    const [left, right] = [0.5, -0.5].map(side => plus(plus(tip, back), across(back), side));
    this.line([from, tip, left, tip, right], color, lineWidth);
  }
  rods(each, color, lineWidth) { // [from, to, length]: solid red is too much, dashed blue missing
    const parts = each.map(([from, to, length]) => {
      const along = plus(to, from, -1);
      const right = plus(from, unit(along), length);
      return {from, to, right, more: size(along) - length};
    });
    const seen = 0.7 / this.scale[0]; // m: 0.7 of a pixel
    const wrong = some => parts.filter(some).map(({right, to}) => [right, to]);
    const long = wrong(({more}) => more > seen);
    const short = wrong(({more}) => more < -seen);
    const whole = parts.map(({from, to, right, more}) => [from, more > 0 ? right : to]);
    this.lines(whole, color, lineWidth);
    if (long.length) this.lines(long, "long", lineWidth + 2.5);
    if (short.length) this.lines(short, "short", lineWidth, [2, lineWidth + 3]);
  }
  system(motion, color = "ink", bobs = color) {
    const {pairs, lengths, anchors} = motion.scene;
    const shortest = this.scale[0] * Math.min(...lengths); // pixels
    const bob = Math.max(2, Math.min(7, shortest / 6));
    for (const anchor of anchors) this.disc(anchor, Math.max(2, 0.7 * bob), "quiet");
    for (const point of motion.points) this.disc(point, bob, bobs); // below the ends of rods
    const rods = pairs.map(([i, j], k) => [motion.point(j), motion.point(i), lengths[k]]);
    this.rods(rods, color, Math.max(1.2, bob / 2.5));
  }
  followPointers() { // they take the nearest hand; a finger that is near none scrolls the page
    const {element} = this;
    let held = null;
    element.onpointerdown = event => {
      const at = this.metres(event);
      const far = ({where}) => size(plus(where(), at, -1)) * this.scale[0];
      const near = this.hands.toSorted((a, b) => far(a) - far(b))[0];
      const reach = event.pointerType === "touch" ? Math.min(this.reach, FINGER) : this.reach;
      if (!near || event.button || far(near) > reach) return;
      event.preventDefault(); // which would focus the button on top
      near.hand.focus({preventScroll: true});
      element.setPointerCapture(event.pointerId);
      const holds = far(near) <= FINGER / 2; // or else it comes to the pointer
      held = {...near, offset: holds ? plus(near.where(), at, -1) : [0, 0]};
      near.grab(plus(at, held.offset));
    };
    element.onpointermove = event => held?.drag(plus(this.metres(event), held.offset));
    element.onpointerup = element.onpointercancel = () => {
      held?.release();
      held = null;
    };
    const stay = event => held && event.preventDefault(); // a finger that holds does not scroll
    element.addEventListener("touchstart", stay, {passive: false});
  }
  // Lets a point, where(), be dragged or moved by the arrow keys: move([x, y]) until letGo(). It is
  // a button that floats above the canvas; Page Up and Page Down go from one to the next.
  hand(ariaLabel, where, move, letGo = () => {}) {
    let target = null;
    const to = point => {
      target = point;
      move(point);
    };
    const release = () => {
      if (!target) return;
      target = null;
      letGo();
    };
    const next = way => {
      const {hands} = this;
      const k = hands.findIndex(each => each.hand === hand);
      hands[(k + way + hands.length) % hands.length].hand.focus();
    };
    const onkeydown = event => {
      const by = ARROWS[event.key];
      const way = {PageUp: 1, PageDown: -1}[event.key];
      if (event.altKey || event.ctrlKey || event.metaKey) return; // the browser's own
      if (by) to(plus(target ?? where(), by, 12 / this.scale[0]));
      else if (way) next(way);
      else if (["Enter", " ", "Escape"].includes(event.key)) release();
      else return;
      event.preventDefault();
    };
    const hand = make("button",
      {type: "button", className: "hand", ariaLabel, onkeydown, onblur: release});
    const drag = point => target && to(point);
    this.hands.push({hand, where, grab: to, drag, release});
    this.element.append(hand);
    return hand;
  }
}

// Axes of a plot: ticks are values and words, up(value) is how high it stands.
function logarithmic(least, most) { // from 10^least m to 10^most m, a tick a decade
  const powers = Array.from({length: most - least + 1}, (_, k) => least + k);
  const values = powers.map(k => Number(`1e${k}`));
  const ticks = values.map((x, k) => [x, (k === 0 ? "\u2264 " : "") + metric(x)]);
  const up = x => Math.log10(Math.max(x, 10 ** least));
  return {ticks, up, low: least - 0.15, high: most + 0.5};
}
function linear(most) { // shares from -most to most
  const ticks = [-1, -0.5, 0, 0.5, 1].map(x => [x * most, (x > 0 ? "+" : "") + perCent(x * most)]);
  return {ticks, up: x => x, low: -1.1 * most, high: 1.1 * most};
}
const decades = logarithmic(-12, 0);

// curves(): a list of {color, points: [[s, value], ...], words, dash, width}; words stand where the
// line ends, with a mark if it has left the axis. It shows 5, 10 or 20 s, and then the last 20.
function makePlot(label, axis, curves) {
  const plot = new Stage(label, [0, 0, 1, 1], () => {
    const {axis: {ticks, up, low, high}, pen} = plot;
    const lines = curves();
    const now = Math.max(...lines.map(({points}) => points.at(-1)?.[0] ?? 0));
    const span = [5, 10].find(s => s >= now) ?? 20;
    const right = Math.max(span, now);
    const left = right - span;
    const wide = words => pen.measureText(words).width;
    pen.font = BOLD;
    plot.pad[0] = 8 + Math.max(...ticks.map(([, words]) => wide(words)));
    plot.pad[2] = 22 + Math.max(...lines.map(({words}) => wide(words ?? "")));
    plot.box = [left, low, right, high];
    plot.aim();
    const each = Math.ceil(14 * (ticks.length - 1) / (plot.scale[1] * (high - low))); // legible
    ticks.toReversed().forEach(([value, words], k) => {
      plot.line([[left, up(value)], [right, up(value)]], "pale", 1);
      if (k % each === 0) plot.words(words, [left, up(value)], "quiet", [-6, 0], "right", PLAIN);
    });
    const apart = plot.scale[0] * span > 5 * 36 ? span / 5 : span; // s
    for (let s = apart * Math.ceil(left / apart); s <= right; s += apart) {
      plot.words(`${s} s`, [s, low], "quiet", [0, -11], "center", PLAIN);
    }
    const [, top] = plot.pixels([0, high]);
    const [, bottom] = plot.pixels([0, low]);
    pen.save();
    pen.beginPath();
    pen.rect(0, top, plot.width, bottom - top);
    pen.clip();
    for (const {color, points, dash, width = 2} of lines) {
      const seen = points.filter(([s]) => s >= left).map(([s, value]) => [s, up(value)]);
      plot.line(seen, color, width, dash);
    }
    pen.restore();
    placeNames(plot, lines.filter(({words}) => words).map(({color, points, words}) => {
      const [s, value] = points.at(-1) ?? [left, 0];
      const y = up(value);
      const mark = y > high ? " \u25b2" : y < low ? " \u25bc" : ""; // it is above, or below
      return {color, words: words + mark, at: [s, Math.max(low, Math.min(high, y))]};
    }));
  }, [0, 20, 0, 8], true);
  plot.axis = axis;
  return plot;
}

// Names [{words, color, at}, ...] beside the ends of lines, pushed apart, down and then up.
function placeNames(stage, names) {
  const ends = names.map(name => {
    const [x, from] = stage.pixels(name.at);
    return {...name, x, from, y: from};
  }).sort((a, b) => a.y - b.y);
  ends.forEach((end, k) => {
    end.y = Math.max(end.y, stage.pad[3] + 8, (ends[k - 1]?.y ?? 0) + 15);
  });
  ends.reverse().forEach((end, k) => {
    end.y = Math.min(end.y, stage.height - 24 - 15 * k);
  });
  for (const {color, words, x, from, y} of ends) {
    stage.line([[x, from], [x + 10, y]].map(at => stage.metresAt(at)), color, 1);
    stage.words(words, stage.metresAt([x, y]), color, [14, 0], "left");
    Object.assign(stage.pen, {strokeStyle: ink("paper"), lineWidth: 5});
    for (const how of ["strokeText", "fillText"]) stage.pen[how](words, x + 14, y); // over lines
  }
}

// A slider over a list, so that each value is exact.
function makeSlider(name, values, index, words, changed) {
  const output = make("output", {ariaLive: "off"}); // the slider says the same
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
