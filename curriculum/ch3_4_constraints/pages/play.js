// The page of a scene: a copy of it under each method, a hand, sliders and questions. What Python
// found stands on it already; found.answers has a sentence and a table's rows for each tolerance.
const SPAN = 20; // s that the plot shows
const BIN = 0.04; // s: one point of the plot
const TRAIL = 1.5; // s of the last bob's path
// Steps of the true motion in one, at least, and how long they are at most, in s.
const [FINE, FINEST] = scene.pairs.length > 8 ? [10, 0.001] : [20, 0.00025];
const UNSURE = 0.1; // of the scene's size: the true motion is known to so much, or not at all
const HAND = 15; // rad/s: the hand's spring has HAND^2 times the bob's mass
const CHANGES = 0.02; // of m g L: energy that changes by as much can be seen to
const DASHES = [[], [9, 5], [1, 5], [9, 5, 1, 5], [18, 5], [5, 5]]; // as many as colours
const decadesTo = (least, most) =>
  logarithmic(least, Math.max(0, Math.ceil(Math.log10(most) - 0.5)));
const VIEWS = { // of the plot: what it shows, its axis for values up to `most`, and one in words
  rods: {name: "Rods", title: "Worst rod so far", axis: most => decadesTo(-6, most), words: metric},
  energy: {
    name: "Energy", title: "Energy off, in % of weight \u00d7 length",
    axis: most => linear(roundUp(most)), words: x => (x > 0 ? "+" : "") + perCent(x),
  },
  motion: {
    name: "True motion", title: "Farthest from the true motion so far",
    axis: most => decadesTo(-4, most), words: metric,
  },
};
const knobs = Motion.knobs(scene);
const last = scene.masses.length - 1;
const byId = id => document.getElementById(id);
const has = method => scene.methods.includes(method);
const colorOf = method => `m${scene.colors[method]}`;
const three = x => Number(x.toPrecision(3)); // digits
const ms = dt => `${three(1000 * dt)} ms`;

function roundUp(x) { // to 1, 2 or 5 times a power of ten, at least 1 %
  const power = 10 ** Math.floor(Math.log10(Math.max(0.01, x)));
  return power * [1, 2, 5, 10].find(k => k * power >= x);
}

// --- the hand: time passes while it pulls ---
const hand = {
  copy: null, particle: 0, waits: false, // waits: time stood still before it pulled
  drag(copy, particle, point) {
    if (!this.copy) this.waits = !clock.going;
    this.copy = copy;
    this.particle = particle;
    knobs.hand = point;
    knobs.pulls[particle] = HAND * HAND * scene.masses[particle];
    if (!clock.going) clock.set(true);
  },
  letGo() {
    if (!this.copy) return;
    this.copy = null;
    knobs.pulls.fill(0);
    for (const copy of [...run.copies, ...run.halves]) copy.level = copy.energy;
    if (this.waits) clock.set(false);
  },
};

// --- the copies, and the true motion ---
class Copy extends Motion {
  begin(state) {
    super.begin(state);
    this.curves = {rods: [], energy: [], motion: []};
    this.worst = {rods: 0, energy: 0, motion: 0};
    this.trail = [];
    this.lost = null; // why it ended
    this.rods = this.errors;
    this.level = this.energy;
    this.box = [...this.scene.anchors, ...this.points].reduce(around, [1e99, 1e99, -1e99, -1e99]);
  }
  advance(dt = this.knobs.dt, truth = null) { // which it is compared with, if that is known
    const {time} = this;
    attempt(() => this.step(dt), why => { this.lost = why; });
    const rods = this.errors;
    const energy = this.energy - this.level;
    if (!(largest(rods) < this.far && Number.isFinite(energy))) this.lost ??= "its rods flew apart";
    if (this.lost) this.time = time; // of its last state, as in the run's table
    if (this.lost) return;
    this.rods = rods;
    this.note("rods", largest(rods));
    if (!hand.copy) this.note("energy", energy); // what a hand adds is no error
    if (truth?.known) this.note("motion", apart(this, truth.fine));
    this.box = this.points.reduce(around, this.box);
    this.trail.push([this.time, this.point(last)]);
    while (this.trail[0][0] < this.time - TRAIL) this.trail.shift();
  }
  note(view, value) {
    const points = this.curves[view];
    const bin = ([time]) => Math.floor(time / BIN);
    if (Math.abs(value) > Math.abs(this.worst[view])) this.worst[view] = value;
    if (points.length && bin(points.at(-1)) === bin([this.time])) points.pop();
    points.push([this.time, view === "energy" ? value : this.worst[view]]);
    if (points.length > 1.1 * SPAN / BIN) points.shift();
  }
}

function attempt(step, failed) { // a step without a result throws a plain Error, which says why
  try {
    step();
  } catch (why) {
    if (why.constructor !== Error) throw why;
    failed(why.message);
  }
}

function apart(a, b) { // m: the farthest that a particle is from where it is in another motion
  return Math.max(...a.points.map((point, k) => size(plus(point, b.point(k), -1))));
}

function around([left, bottom, right, top], [x, y]) {
  return [Math.min(left, x), Math.min(bottom, y), Math.max(right, x), Math.max(top, y)];
}

const best = has("project") ? "project" : scene.methods.at(-1);
const scout = new Copy(scene, best, Motion.knobs(scene));
for (let k = 0; k < 1000 && !scout.lost; k++) scout.advance();
const home = scout.box; // what all tiles show, at least
const extent = Math.max(home[2] - home[0], home[3] - home[1]); // m

// `project` in much smaller steps, and in steps twice as long: where these part, chaos decides.
const truth = {
  fine: new Motion(scene, best, knobs),
  coarse: new Motion(scene, best, knobs),
  doubt: 0, // m
  begin() {
    this.fine.begin();
    this.coarse.begin();
    this.doubt = best === "project" ? 0 : Infinity;
  },
  step() {
    if (!this.known) return;
    const parts = 2 * Math.ceil(Math.max(FINE, knobs.dt / FINEST) / 2);
    const dt = knobs.dt / parts;
    attempt(() => {
      for (let part = 0; part < parts; part++) this.fine.step(dt);
      for (let part = 0; part < parts; part += 2) this.coarse.step(2 * dt);
      this.doubt = Math.max(this.doubt, apart(this.fine, this.coarse));
    }, () => { this.doubt = Infinity; });
  },
  get known() { return this.doubt < UNSURE * extent; },
};

// All copies, step by step; if a question asks for it, `halves` go along: others, in half the step.
const run = {
  copies: scene.methods.map(method => new Copy(scene, method, knobs)),
  halves: [], taken: 0, box: home,
  get time() { return this.taken * knobs.dt; },
  get alive() { return this.copies.filter(({lost}) => !lost); },
  goWith(halves) {
    this.halves = halves ? scene.methods.map(method => new Copy(scene, method, knobs)) : [];
  },
  begin() {
    hand.letGo();
    this.taken = 0;
    this.box = home;
    for (const copy of [...this.copies, ...this.halves]) copy.begin();
    truth.begin();
    drawing.draw();
  },
  step() {
    this.taken += 1;
    truth.step();
    for (const copy of this.alive) copy.advance(knobs.dt, truth);
    for (const half of this.halves) {
      if (!half.lost) half.advance(knobs.dt / 2);
      if (!half.lost) half.advance(knobs.dt / 2, truth);
    }
  },
  widen() { // the box, where copies go a little beyond it
    const [left, bottom, right, top] = home;
    const near = ([x, y]) => Math.max(left - x, x - right, bottom - y, y - top) < 0.5 * extent;
    for (const {points} of this.alive) this.box = points.filter(near).reduce(around, this.box);
  },
};

// --- what is seen ---
function makeTile(copy) {
  const {method} = copy;
  const off = make("b");
  const away = make("div");
  const now = make("div", {className: "now"}, off, away);
  const lost = make("p", {className: "lost", ariaLive: "polite"});
  const name = make("b", {className: colorOf(method), textContent: method});
  copy.view = new Stage(`${method}: the scene`, [0, 0, 1, 1], () => paint(copy), [12, 44, 12, 8]);
  copy.tell = () => {
    const worst = largest(copy.rods);
    const side = Math.max(...copy.rods) === worst ? "long" : "short";
    off.textContent = worst < 1e-9 ? "rods are right" : `${metric(worst)} too ${side}`;
    off.className = `off ${worst < 1e-6 ? "" : side}`;
    away.textContent = truth.known ? `${metric(apart(copy, truth.fine))} from true motion` : "";
    now.hidden = Boolean(copy.lost);
    const when = `lost at ${fixed(copy.time, 2)} s`;
    const why = copy.lost ? `${when}: ${copy.lost}. Try a shorter step.` : "";
    if (lost.textContent !== why) lost.textContent = why; // so it is announced once
    copy.view.element.inert = Boolean(copy.lost); // there is nothing to pull
  };
  for (let i = 0; i <= last; i++) { // the last one on top
    const label = `${method}: pull bob ${i + 1} of ${last + 1} by the arrow keys; Escape lets go,`
      + " Page Up and Page Down change the bob";
    const move = point => hand.drag(copy, i, point);
    const button = copy.view.hand(label, () => copy.point(i), move, () => hand.letGo());
    button.tabIndex = i === last ? 0 : -1;
  }
  const caption = make("figcaption", {}, name, ` ${scene.words[method]}`);
  return make("figure", {className: "tile"}, caption, copy.view.element, now, lost);
}

function paint(copy) {
  const {view} = copy;
  const faded = alpha => { view.pen.globalAlpha = alpha; };
  if (truth.known) {
    faded(0.8 * (1 - truth.doubt / (UNSURE * extent)));
    view.lines(scene.pairs.map(ends => ends.map(i => truth.fine.point(i))), "reference", 5);
  }
  faded(copy.lost ? 0.2 : 0.6);
  view.line(copy.trail.map(([, point]) => point), colorOf(copy.method), 1.2);
  faded(copy.lost ? 0.2 : 1);
  view.system(copy, "ink", colorOf(copy.method));
  faded(1);
  if (hand.copy) view.line([copy.point(hand.particle), knobs.hand], "quiet", 1.5, [2, 4]);
}

const board = { // the plot, and what it shows
  view: "rods",
  plot: makePlot("", decades, () => board.lines()),
  show(view) {
    this.view = view;
    byId("title").textContent = VIEWS[view].title;
    for (const key in VIEWS) byId(key).ariaPressed = key === view;
    drawing.draw();
  },
  words({lost, curves, worst}) { // of a copy; "" before there is anything
    if (lost) return "lost";
    return curves[this.view].length ? VIEWS[this.view].words(worst[this.view]) : "";
  },
  lines() {
    const line = ({method, curves}) => ({
      color: colorOf(method), points: curves[this.view], dash: DASHES[scene.colors[method]],
    });
    const lines = run.copies.map((copy, k) => {
      const half = run.halves[k] ? `, ${this.words(run.halves[k])}` : "";
      return {...line(copy), words: `${copy.method} ${this.words(copy)}${half}`};
    });
    return [...lines, ...run.halves.map(half => ({...line(half), width: 0.8}))];
  },
  draw() {
    this.plot.axis = VIEWS[this.view].axis(largest(run.alive.map(({worst}) => worst[this.view])));
    this.plot.draw();
    const words = this.lines().map(({words}) => words).filter(Boolean);
    this.plot.canvas.ariaLabel = `${VIEWS[this.view].title}: ${words.join("; ")}`;
  },
};

const drawing = {
  told: 0, frames: 0, // ms: when it last told what is said in words; and how often it has drawn
  draw() {
    run.widen();
    this.frames += 1;
    for (const {view} of run.copies) {
      view.box = run.box;
      view.draw(!clock.going || this.frames % 3 === 0);
    }
    if (clock.going && performance.now() - this.told < 100) return; // faster cannot be read
    this.told = performance.now();
    board.draw();
    for (const copy of run.copies) copy.tell();
    byId("time").textContent = `${fixed(run.time, 2)} s${clock.late ? ", in slow motion" : ""}`;
  },
};

// --- sliders, over exact values: for knobs of the run, if the method that they need is here ---
const SLIDERS = [
  {
    key: "dt", label: "Step", begins: true, words: ms,
    values: [0.000625, 0.00125, 0.0025, 0.005, 0.01, 0.02, 0.04, 0.05, scene.knobs.dt / 2,
      ...Object.values(found.answers).flatMap(({steps}) => steps)], // those that are advised
  },
  {
    key: "baumgarte", label: "Stiffness of baumgarte", needs: "baumgarte",
    values: [0, 5, 10, 20, 40, 60, 80, 120, 160, 200, 320],
    words: w => `${three(w)}/s; step \u00d7 stiffness = ${fixed(knobs.dt * w, 2)}`
      + (scene.limit ? `, breaks at ${fixed(scene.limit, 2)}` : ""),
  },
  {
    key: "time_constant", label: "Softness of soft", needs: "soft",
    values: [0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1],
    words: T => ms(T) + (T < 2 * knobs.dt ? `, taken as two steps: ${ms(2 * knobs.dt)}` : ""),
  },
];
const sliders = [];
for (const {key, label, needs, begins, words, values} of SLIDERS) {
  if (!(key in scene.knobs) || (needs && !has(needs))) continue;
  const all = [...new Set([...values, scene.knobs[key]])].sort((a, b) => a - b);
  const slider = makeSlider(label, all, all.indexOf(knobs[key]), words, value => {
    knobs[key] = value;
    showKnobs();
    if (begins) run.begin(); // an old error in a new step would be a blow
  });
  slider.element.id = key;
  sliders.push(Object.assign(slider, {key, values: all}));
}

function showKnobs() { // and a mark where the stiffness breaks
  const share = three(knobs.dt / scene.knobs.dt);
  const others = Object.entries(scene.made_for).map(([method, integrator]) =>
    ` ${method} is left out: it is made for ${integrator}.`);
  byId("facts").textContent = `${scene.integrator}, steps of ${ms(knobs.dt)}, `
    + `${share === 1 ? "as in the run" : `${share} times the run\u2019s`}.${others.join("")}`;
  for (const {key, set, values, element} of sliders) {
    set(knobs[key]);
    if (key !== "baumgarte" || !scene.limit) continue;
    const edge = scene.limit / knobs.dt;
    const k = values.findLastIndex(w => w <= edge);
    const at = k + (edge - values[k]) / (values[k + 1] - values[k]) || k; // or beyond the last one
    element.style.setProperty("--breaks", at / (values.length - 1));
  }
}

// --- questions: each sets the knobs, the view and a control, and says what to look at ---
const QUESTIONS = [
  {
    ask: "What does half the step buy?", control: "dt", halves: true,
    say: "Beside each copy goes another one, unseen, in half the step: the thin line of the plot."
      + " The two numbers there are of the same time. The second took twice the work: what for?",
  },
  {
    ask: "How stiff a spring?", needs: "baumgarte", control: "baumgarte",
    say: "A stiffer spring pulls wrong rods back faster, until one step pulls too far, the next one"
      + " farther, and all flies apart. Move it past its mark. Then take a shorter step.",
  },
  {
    ask: "Which keeps its energy?", control: "energy", view: "energy",
    say: "The energy counts all that acts on the scene, so it should stay: 0 % off. Watch the plot"
      + " for ten seconds. A method can hold the rods and still change the energy.",
    shows: () => scene.conserves && found.energy > CHANGES,
  },
  {
    ask: "Which is nearest the true motion?", needs: "project", control: "motion", view: "motion",
    say: "The grey scene behind each copy is the true motion, found by much smaller steps. Which"
      + " copy stays on it longest? Where chaos decides it fades, and nobody can tell.",
  },
  {
    ask: "As it was", control: "dt",
    say: "The knobs of the run again. Until you touch anything, each number is Python\u2019s.",
  },
];

function choose(question, button) {
  press(button);
  document.querySelector(".control")?.classList.remove("control");
  byId("say").textContent = question.say;
  byId("knobs").append(...sliders.map(({element}) => element));
  const control = byId(question.control);
  control.classList.add("control");
  if (control.closest("#knobs")) byId("asked").append(control); // beside what is said of it
  Object.assign(knobs, scene.knobs);
  showKnobs();
  run.goWith(question.halves);
  run.begin();
  clock.set(true);
  board.show(question.view ?? "rods");
}

function showAnswer(tolerance, button) {
  const answer = found.answers[tolerance];
  for (const id of ["says", "how", "holds"]) byId(id).innerHTML = answer[id];
  byId("within").textContent = tolerance;
  byId("ladder").tBodies[0].innerHTML = answer.rows;
  press(button);
}

function press(button) { // it alone of those beside it
  for (const each of button.parentElement.children) each.ariaPressed = each === button;
}

// --- the page ---
const clock = new Clock(byId("page"), () => knobs.dt, () => run.step(), () => drawing.draw());
byId("controls").prepend(clock.element, makeButton("Again", () => run.begin()));
for (const tolerance in found.answers) {
  const button = makeButton(tolerance, () => showAnswer(tolerance, button));
  button.ariaPressed = tolerance === byId("within").textContent;
  byId("tolerances").append(button);
}
for (const question of QUESTIONS) {
  const {ask, needs, shows} = question;
  if ((needs && !has(needs)) || (shows && !shows())) continue;
  const button = makeButton(ask, () => choose(question, button));
  button.ariaPressed = false;
  byId("questions").append(button);
}
byId("tiles").prepend(...run.copies.map(makeTile));
byId("tiles").style.setProperty("--columns", Math.max(2, Math.ceil((run.copies.length + 1) / 2)));
byId("tiles").classList.toggle("wide", home[2] - home[0] > 3 * (home[3] - home[1]));
byId("board").append(board.plot.element);
byId("knobs").append(...sliders.map(({element}) => element));
for (const id in VIEWS) {
  byId("views").append(Object.assign(makeButton(VIEWS[id].name, () => board.show(id)), {id}));
}
showKnobs();
board.show("rods");
run.begin();
