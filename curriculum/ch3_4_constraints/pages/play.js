// The page of a scene: a copy of it under each method, a verdict, a hand, sliders and questions.
const SPAN = 20; // s that the plot shows
const BIN = 0.04; // s: one point of the plot
const TRAIL = 1.5; // s of the last bob's path
const [TRIED, MOST] = [30, 12000]; // s of a verdict, and its steps at most
const [RODS, ENERGY] = [0.01, 0.05]; // good enough: of the rods' mean length, and of m g L
// Steps of the true motion in one, at least, and how long they are at most, in s.
const [FINE, FINEST] = scene.pairs.length > 8 ? [10, 0.001] : [20, 0.00025];
const IDLE = {timeout: 50}; // ms
const [LONG, AHEAD] = [0.04, 15]; // s: a step that is seen large, after so many
const HAND = 15; // rad/s: the hand's spring has HAND^2 times the bob's mass
const DOES = {
  none: "corrects nothing",
  baumgarte: "a spring pulls wrong rods back",
  impulse: "aims each step at right rods",
  soft: "rods that give, on purpose",
  project: "puts each step back onto its rods",
};
const SUITS = {
  none: "To see what the others put right.",
  baumgarte: "For any integrator, in one line, if you tune its stiffness to the step.",
  impulse: "For games and real time, with semi_implicit: hardly more work than none.",
  soft: "For joints that should give under a jolt, by as much as you choose.",
  project: "For right rods under any integrator, if you can pay for the work.",
};
const DASHES = [[], [9, 5], [1, 5], [9, 5, 1, 5], [18, 5], [5, 5]]; // as many as colours
const colorOf = method => `m${scene.colors[method]}`;
const byId = id => document.getElementById(id);
const three = x => Number(x.toPrecision(3));
const ms = dt => `${three(1000 * dt)} ms`;
const mm = x => (x < 1e-9 ? "\u2248 0" : brief(1000 * x)); // the page's one unit of errors
const signed = x => (x > 0 ? "+" : "") + perCent(x);
const lengths = (least, most) => logarithmic(least, Math.max(0, Math.ceil(Math.log10(most) - 0.5)));
const VIEWS = { // of the plot: what it shows, its axis for values up to `most`, and one in words
  rods: {title: "Worst rod so far, in mm", axis: most => lengths(-6, most), words: mm},
  energy: {
    title: "Energy off, in % of weight \u00d7 length", words: signed,
    axis: most => linear(Math.max(0.01, roundUp(most)) / (run.zoomed ? 20 : 1)),
  },
  motion: {
    title: "Farthest from the true motion so far, in mm", words: mm,
    axis: most => lengths(-4, most),
  },
};
const knobs = Motion.knobs(scene);
const last = scene.masses.length - 1;
const held = {copy: null, particle: 0, paused: false}; // by the hand; and whether time stood still
const run = {taken: 0, time: 0, view: "rods", zoomed: false, arc: null}; // arc: a rod, seen large

function roundUp(x) { // to 1, 2 or 5 times a power of ten
  const power = 10 ** Math.floor(Math.log10(x));
  return power * [1, 2, 5, 10].find(k => k * power >= x);
}

// --- the copies, and the true motion ---
class Copy extends Motion {
  begin(state) {
    super.begin(state);
    this.curves = {rods: [], energy: [], motion: []};
    this.worst = {rods: 0, energy: 0, motion: 0};
    Object.assign(this, {lost: null, trail: [], was: null});
    [this.rods, this.level] = [this.errors, this.energy];
    this.box = [...this.scene.anchors, ...this.points].reduce(around, [1e99, 1e99, -1e99, -1e99]);
  }
  advance(truth) { // which it is compared with, if that is known
    if (run.arc !== null) this.was = {at: this.point(scene.pairs[run.arc][0]), rods: this.rods};
    const {time} = this;
    attempt(() => this.step(), why => { this.lost = why; });
    const rods = this.errors, energy = this.energy - this.level;
    if (!(largest(rods) < this.far && Number.isFinite(energy))) this.lost ??= "its rods flew apart";
    if (this.lost) this.time = time; // of its last state, as in the run's table
    if (this.lost) return;
    this.rods = rods;
    this.note("rods", largest(this.rods));
    if (!held.copy) this.note("energy", energy); // what a hand adds is no error
    if (truth?.known) this.note("motion", apart(this, truth.fine));
    this.box = this.points.reduce(around, this.box);
    this.trail.push([this.time, this.point(last)]);
    while (this.trail[0][0] < this.time - TRAIL) this.trail.shift();
  }
  note(view, value) {
    const points = this.curves[view], bin = ([time]) => Math.floor(time / BIN);
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

// `project` in much smaller steps, and in steps twice as long: where these part, chaos decides.
const best = scene.methods.includes("project") ? "project" : scene.methods.at(-1);
const truth = {
  motions: [1, 2].map(() => new Motion(scene, best, knobs)),
  get fine() { return this.motions[0]; },
  begin() {
    for (const motion of this.motions) motion.begin();
    Object.assign(this, {doubt: 0, known: best === "project"});
  },
  step() {
    if (!this.known) return;
    const parts = 2 * Math.ceil(Math.max(FINE, knobs.dt / FINEST) / 2);
    attempt(() => this.motions.forEach((motion, k) => {
      for (let part = 0; part < parts; part += k + 1) motion.step((k + 1) * knobs.dt / parts);
    }), () => { this.doubt = Infinity; });
    this.doubt = Math.max(this.doubt, apart(...this.motions));
    this.known = this.doubt < 0.1 * run.size;
  },
};
const copies = scene.methods.map(method => new Copy(scene, method, knobs));

function begin() {
  letGo();
  Object.assign(run, {taken: 0, time: 0, box: run.home});
  for (const copy of copies) copy.begin();
  truth.begin();
  draw();
}

function step() {
  run.time = ++run.taken * knobs.dt;
  truth.step();
  for (const copy of copies) if (!copy.lost) copy.advance(truth);
}

// --- the hand: time passes while it pulls ---
function drag(copy, particle, point) {
  if (!held.copy) held.paused = !clock.going;
  Object.assign(held, {copy, particle});
  knobs.hand = point;
  knobs.pulls[particle] = HAND * HAND * scene.masses[particle];
  if (!clock.going) clock.set(true);
}

function letGo() {
  if (!held.copy) return;
  held.copy = null;
  knobs.pulls.fill(0);
  for (const copy of copies) copy.level = copy.energy;
  if (held.paused) clock.set(false);
}

// --- what is seen ---
function makeTile(copy) {
  const {method} = copy, off = make("p"), lost = make("p", {className: "lost"});
  const name = make("b", {className: colorOf(method), textContent: method});
  copy.view = new Stage(`${method}: the scene`, [0, 0, 1, 1], () => paint(copy), [6, 22, 6, 6]);
  copy.tell = () => {
    const {rods, was} = copy, grown = was && rods[run.arc] - was.rods[run.arc];
    const worst = largest(was ? [grown] : rods);
    const side = (was ? grown : Math.max(...rods)) === worst ? "long" : "short";
    const words = was ? `${side === "long" ? "longer" : "shorter"} by this step` : `too ${side}`;
    off.textContent = worst < 1e-9 ? "rods are right" : `${mm(worst)} mm ${words}`;
    off.className = `off ${worst < 1e-6 ? "" : side}`;
    const help = method === "baumgarte" ? "a shorter step, or less stiffness" : "a shorter step";
    lost.textContent = `lost at ${fixed(copy.time, 2)} s: ${copy.lost}. Try ${help}.`;
    lost.hidden = !copy.lost;
    off.hidden = Boolean(copy.lost);
    copy.view.element.inert = Boolean(copy.lost || was); // there is nothing to pull
  };
  for (let i = 0; i <= last; i++) { // the last one on top
    const label = `${method}: pull bob ${i + 1} of ${last + 1} by the arrow keys; Escape lets go,`
      + " Page Up and Page Down change the bob";
    const move = point => drag(copy, i, point);
    copy.view.hand(label, () => copy.point(i), move, letGo).tabIndex = i === last ? 0 : -1;
  }
  const caption = make("figcaption", {}, name, ` ${DOES[method] ?? "a method of your own"}`);
  return make("figure", {className: "tile"}, caption, copy.view.element, off, lost);
}

function paint(copy) {
  if (run.arc !== null && copy.was) return paintStep(copy);
  const {view} = copy, faded = alpha => { view.pen.globalAlpha = alpha; };
  if (truth.known) {
    faded(0.8 * (1 - truth.doubt / (0.1 * run.size)));
    view.lines(scene.pairs.map(ends => ends.map(i => truth.fine.point(i))), "reference", 5);
  }
  faded(copy.lost ? 0.2 : 0.6);
  view.line(copy.trail.map(([, point]) => point), colorOf(copy.method), 1.2);
  faded(copy.lost ? 0.2 : 1);
  view.system(copy, "ink", colorOf(copy.method));
  faded(1);
  if (held.copy) view.line([copy.point(held.particle), knobs.hand], "quiet", 1.5, [2, 4]);
}

// The last step of one bob, large: straight on, where it should turn along the dotted circle.
function paintStep(copy) {
  const {view, was: {at}} = copy, [i, j] = scene.pairs[run.arc], now = copy.point(i);
  const anchor = copy.point(j), away = plus(now, anchor, -1), radius = size(plus(at, anchor, -1));
  const turned = plus(anchor, unit(away), radius), reach = 0.6 * size(plus(now, at, -1));
  view.box = [...plus(turned, [1, 1], -reach), ...plus(turned, [1, 1], reach)];
  view.aim();
  view.circle(anchor, radius, "quiet");
  view.arrow(at, plus(now, at, -1), colorOf(copy.method), 2);
  view.rod(anchor, now, radius, "pale", 4);
}

// All tiles show the same box: that of the true motion, and more where a copy goes a little beyond.
function widen() {
  const [left, bottom, right, top] = run.home, more = 0.5 * run.size;
  const near = ([x, y]) => Math.max(left - x, x - right, bottom - y, y - top) < more;
  for (const {points} of copies.filter(({lost}) => !lost)) {
    run.box = points.filter(near).reduce(around, run.box);
  }
}

function curves() {
  return copies.map(({method, lost, curves: {[run.view]: points}, worst}) => {
    const value = points.length ? VIEWS[run.view].words(worst[run.view]) : "";
    const words = `${method} ${lost ? "lost" : value}`;
    return {color: colorOf(method), points, words, dash: DASHES[scene.colors[method]]};
  });
}

let told = 0, frames = 0;
function draw() {
  widen();
  frames += 1;
  for (const {view} of copies) {
    view.box = run.box;
    view.draw(!clock.going || frames % 3 === 0);
  }
  if (clock.going && performance.now() - told < 100) return; // what changes faster cannot be read
  told = performance.now();
  const most = largest(copies.filter(({lost}) => !lost).map(({worst}) => worst[run.view]));
  plot.axis = VIEWS[run.view].axis(most);
  plot.draw();
  for (const copy of copies) copy.tell();
  plot.canvas.ariaLabel = `${byId("title").textContent}: ${curves().map(({words}) => words)}`;
  byId("time").textContent = `${fixed(run.time, 2)} s${clock.late ? ", in slow motion" : ""}`;
}

function showView(name) {
  run.view = name;
  byId("title").textContent = VIEWS[name].title;
  for (const key in VIEWS) byId(key).ariaPressed = key === name;
  byId("zoom").hidden = name !== "energy";
}

// --- the verdict: each method from the start, in this step and then in longer ones ---
const tried = new Map();
async function rehearse(method, settings, wanted = () => true) { // while the page has time for it
  const key = JSON.stringify([method, settings]);
  if (tried.has(key)) return tried.get(key);
  const copy = new Copy(scene, method, Motion.knobs(scene, settings)), {dt} = copy.knobs;
  let until = 0; // ms
  for (let k = 1; k <= MOST && (k - 0.5) * dt < TRIED && !copy.lost; k++) {
    if (performance.now() > until) {
      await new Promise(resume => { (window.requestIdleCallback ?? setTimeout)(resume, IDLE); });
      if (!wanted()) return null;
      until = performance.now() + 6;
    }
    copy.advance();
  }
  tried.set(key, copy);
  return copy;
}

const verdicts = new Map(scene.methods.map(method => {
  const cells = ["rods", "energy", "work", "breaks"].map(key => [key, make("td")]);
  const title = make("th", {scope: "row", className: colorOf(method), textContent: method});
  const suits = make("td", {className: "suits", textContent: SUITS[method] ?? ""});
  byId("verdict").tBodies[0].append(make("tr", {}, title, ...cells.map(([, cell]) => cell), suits));
  return [method, Object.fromEntries(cells)];
}));

let judging = 0;
async function judge() {
  const mine = ++judging, wanted = () => mine === judging;
  const {dt, baumgarte, time_constant} = knobs, settings = {baumgarte, time_constant};
  const what = `${three(Math.min(TRIED, MOST * dt))} s in steps of ${ms(dt)}`;
  byId("judged").textContent = `${what}, measuring \u2026`;
  byId("choice").textContent = "";
  let hold = scene.methods;
  for (const step of SLIDERS[0].values.filter(step => step >= dt)) {
    const found = [];
    for (const method of hold) {
      const copy = await rehearse(method, {...settings, dt: step}, wanted);
      if (!copy) return;
      if (step === dt) judged(copy);
      if (copy.lost) verdicts.get(method).breaks.textContent = ms(step);
      else found.push(copy);
    }
    if (step === dt) {
      byId("judged").textContent = what;
      byId("choice").textContent = choice(found);
    }
    hold = found.map(({method}) => method);
  }
  const words = `not up to ${ms(SLIDERS[0].values.at(-1))}`;
  for (const method of hold) verdicts.get(method).breaks.textContent = words;
}

function judged({method, lost, time, worst}) {
  const {rods, energy, work, breaks} = verdicts.get(method);
  rods.textContent = lost ? `lost at ${fixed(time, 1)} s` : mm(worst.rods);
  energy.textContent = lost || !scene.conserves ? "\u2013" : perCent(Math.abs(worst.energy));
  work.textContent = scene.operations[method];
  breaks.textContent = "\u2026";
}

function choice(hold) { // in a sentence or two, from what was found
  const mean = scene.lengths.reduce((sum, length) => sum + length) / scene.lengths.length;
  const good = ({worst}) => worst.rods < RODS * mean
    && (!scene.conserves || Math.abs(worst.energy) < ENERGY);
  const asked = `keeps rods within ${perCent(RODS)}`
    + (scene.conserves ? ` and energy within ${perCent(ENERGY)}` : "");
  const work = ({method}) => scene.operations[method];
  const better = hold.filter(good).sort((a, b) => a.worst.rods - b.worst.rods);
  if (hold.length === scene.methods.length && hold.every(({worst}) => worst.rods < 0.001 * mean)) {
    return "Here no rod is off by more than 0.1 %, whatever the method: the least work will do.";
  }
  if (!better.length) return `None ${asked} in steps as long as these.`;
  const [least] = better.toSorted((a, b) => work(a) - work(b));
  return `Least work that ${asked}: ${least.method}. Best rods: ${better[0].method}.`;
}

// --- sliders, over lists of exact values ---
const listed = values => [...new Set(values)].sort((a, b) => a - b);
const {dt, baumgarte, time_constant: softness} = scene.knobs;
const SLIDERS = [
  {
    key: "dt", label: "Step", begins: true,
    values: listed([0.000625, 0.00125, 0.0025, 0.005, 0.01, 0.02, 0.04, 0.05, dt, dt / 2]),
    words: dt => ms(dt) + (scene.methods.includes("soft") && knobs.time_constant < 2 * dt
      ? `; soft takes two of them, ${ms(2 * dt)}, for its softness` : ""),
  },
  {
    key: "baumgarte", label: "Stiffness of baumgarte", needs: "baumgarte",
    values: listed([0, 5, 10, 20, 40, 60, 80, 120, 160, 200, 320, baumgarte]),
    words: w => `${three(w)}/s; step \u00d7 stiffness = ${fixed(knobs.dt * w, 2)}`
      + (scene.limit ? `, breaks at ${fixed(scene.limit, 2)}` : ""),
  },
  {
    key: "time_constant", label: "Softness of soft", needs: "soft",
    values: listed([0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, softness]),
    words: T => ms(T) + (T < 2 * knobs.dt ? `, taken as two steps: ${ms(2 * knobs.dt)}` : ""),
  },
];
const fits = ({needs = scene.methods[0], shows = () => true}) =>
  scene.methods.includes(needs) && shows();
const sliders = SLIDERS.filter(fits).map(({key, label, values, words, begins}) => {
  const slider = makeSlider(label, values, values.indexOf(knobs[key]), words, value => {
    knobs[key] = value;
    showKnobs();
    if (begins) begin(); // an old error in a new step would be a blow
    judge();
  });
  slider.element.id = key;
  return Object.assign(slider, {key, values});
});

function showKnobs() { // and a mark where the stiffness breaks
  const share = three(knobs.dt / dt), words = {1: "the run\u2019s", 2: "twice the run\u2019s"};
  const others = Object.entries(scene.made_for).map(([method, integrator]) =>
    ` ${method} is left out: it is made for ${integrator}.`);
  byId("facts").textContent = `${scene.integrator}, steps of ${ms(knobs.dt)}, `
    + `${words[share] ?? `${share} times the run\u2019s`}.${others.join("")}`;
  for (const {key, set, values, element} of sliders) {
    set(knobs[key]);
    if (key !== "baumgarte" || !scene.limit) continue;
    const edge = scene.limit / knobs.dt, k = values.findLastIndex(w => w <= edge);
    const at = k + (edge - values[k]) / (values[k + 1] - values[k]) || k; // or beyond the last one
    element.style.setProperty("--breaks", at / (values.length - 1));
  }
}

// --- questions: each sets the knobs, the view and a control, and says what to look at ---
const QUESTIONS = [
  {
    ask: "Why do these rods grow?", needs: "none", control: "one",
    large: true, knobs: {dt: LONG},
    say: "Each tile shows one long step of one bob, large. Press One step, again and again. Where"
      + " the bob should turn along the dotted circle, a step goes straight on. So that of none"
      + " ends outside: red is what the rod has grown. It never looks back, so each step adds to"
      + " the last. Which methods take it back?",
    shows: () => growing() !== null,
  },
  {
    ask: "How stiff may the spring be?", needs: "baumgarte", control: "baumgarte",
    say: "A stiffer spring pulls wrong rods back faster, until one step pulls too far, the next one"
      + " farther, and all flies apart. Move the stiffness past its mark. Then take a smaller step:"
      + " only the product of the two counts.",
  },
  {
    ask: "Which keeps its energy?", control: "energy", view: "energy",
    say: "Nothing drives the scene and nothing brakes it, so its energy should stay at 0 %. Watch"
      + " the plot for ten seconds. Right rods are not enough: a method can hold them and still"
      + " change the energy.",
    shows: () => scene.conserves && largest(opened.map(({worst}) => worst.energy)) > 0.02,
  },
  {
    ask: "Which is nearest the true motion?", needs: "project", control: "motion", view: "motion",
    say: "The grey scene behind each copy is the true motion, found by much smaller steps. Which"
      + " copy stays on it longest? Where chaos decides it fades, and nobody can tell.",
  },
  {
    ask: "As it was", control: "dt", knobs: scene.knobs,
    say: "Step, stiffness and softness of the run that wrote this page. Until you touch anything,"
      + " each number is Python\u2019s.",
  },
];

// The first rod from an anchor, if it grows in a long step of none by what can be seen; or null.
function growing() {
  const copy = new Copy(scene, "none", Motion.knobs(scene, {dt: LONG}));
  const k = scene.pairs.findIndex(([i, j]) => i >= 0 && j < 0), [i] = scene.pairs[k] ?? [0];
  for (let taken = 0; taken < AHEAD; taken++) copy.advance();
  const at = copy.point(i), before = copy.rods[k];
  copy.advance();
  const way = size(plus(copy.point(i), at, -1)), grown = copy.rods[k] - before;
  return grown > 0.01 * way && way < 0.3 * scene.lengths[k] ? k : null;
}

function choose(question, button) {
  for (const each of byId("questions").children) each.ariaPressed = each === button;
  for (const element of document.querySelectorAll(".control")) element.classList.remove("control");
  byId("say").textContent = question.say;
  byId("knobs").append(...sliders.map(({element}) => element));
  const control = byId(question.control);
  control.classList.add("control");
  if (control.closest("#knobs")) byId("asked").append(control); // beside what is said of it
  Object.assign(knobs, scene.knobs, {dt: opening}, question.knobs);
  run.arc = null;
  showView(question.view ?? "rods");
  showKnobs();
  begin();
  clock.set(!question.large);
  if (question.large) {
    run.arc = growing();
    for (let k = 0; k <= AHEAD; k++) step();
  }
  draw();
  judge();
}

// --- the page ---
const plot = makePlot("", decades, curves);
const one = makeButton("One step", () => {
  clock.set(false);
  step();
  draw();
});
one.id = "one";
byId("tiles").prepend(...copies.map(makeTile));
byId("tiles").style.setProperty("--columns", Math.max(2, Math.ceil((copies.length + 1) / 2)));
byId("board").append(plot.element);
byId("knobs").append(...sliders.map(({element}) => element));
for (const key in VIEWS) {
  byId(key).onclick = () => {
    showView(key);
    draw();
  };
}
byId("zoom").onclick = () => {
  run.zoomed = !run.zoomed;
  byId("zoom").ariaPressed = run.zoomed;
  draw();
};

// It begins with the run's step, and goes on to the longest, up to 20 ms, in which no method is
// lost within 30 s and soft is as soft as in the run: there is more to be seen.
let opening = dt, opened;
async function open() {
  const longest = Math.min(0.02, 0.5 * (scene.limit ?? Infinity) / baumgarte, softness / 2);
  const longer = SLIDERS[0].values.filter(step => step > dt && step <= longest);
  for (opening of [...longer.reverse(), dt]) {
    opened = [];
    for (const method of scene.methods) {
      const settings = {baumgarte, time_constant: softness, dt: opening};
      const inTime = () => opening === dt || performance.now() < 5000; // ms since it was opened
      opened.push(await rehearse(method, settings, inTime) ?? {lost: "too late to begin again"});
      if (opened.at(-1).lost && opening > dt) break;
    }
    if (!opened.at(-1).lost) break;
  }
  for (const question of QUESTIONS.filter(fits)) {
    const button = makeButton(question.ask, () => choose(question, button));
    button.ariaPressed = false;
    byId("questions").append(button);
  }
  if (judging || held.copy) return; // somebody was quicker
  if (opening > dt) {
    knobs.dt = opening;
    showKnobs();
    begin();
  }
  judge();
}
const scout = new Copy(scene, best, Motion.knobs(scene));
for (let k = 0; k < 1000 && !scout.lost; k++) scout.advance();
run.home = scout.box;
run.size = Math.max(run.home[2] - run.home[0], run.home[3] - run.home[1]);
showView("rods");
showKnobs();
const clock = new Clock(byId("page"), () => knobs.dt, step, draw);
begin();
byId("controls").prepend(clock.element, one, makeButton("Again", begin));
open();
