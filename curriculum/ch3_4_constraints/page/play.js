// The page of a scene: a copy of it under each method, a hand, sliders, a plot and questions.
const SPAN = 20; // s that the plot shows
const BIN = 0.04; // s: one point of the plot
const TRAIL = 1.5; // s of the last particle's path
const FINE = 20; // steps of the true motion in one, at least,
const FINEST = 0.00025; // and how long these are at most, in s
const HAND = 15; // rad/s: the hand's spring has HAND^2 times the particle's mass
const signed = x => (x > 0 ? "+" : "") + perCent(x);
const VIEWS = { // of the plot: what it shows, and a value in words
  rods: {title: "Worst rod so far", axis: decades, words: metric},
  energy: {title: "Energy, in % of weight \u00d7 length; the worst", axis: shares, words: signed},
  motion: {title: "Farthest from the true motion so far", axis: distances, words: metric},
};
const DESCRIBED = {
  none: "corrects nothing",
  baumgarte: "a spring pulls wrong rods back",
  impulse: "aims each step at right rods",
  soft: "rods that give, on purpose",
  project: "puts each step back onto its rods",
};
const byId = id => document.getElementById(id);
const colorOf = k => `m${k % 6}`; // as many as the palette has
const three = x => Number(x.toPrecision(3));
const knobs = Motion.knobs(scene);
const name = document.querySelector("h1").textContent;
const last = scene.masses.length - 1;
const held = {copy: null, particle: 0}; // by the hand
const run = {start: scene.start, taken: 0, time: 0, view: "rods", circles: false, before: []};

// --- the copies, and the true motion ---
class Copy extends Motion {
  begin(state) {
    super.begin(state);
    this.curves = {rods: [], energy: [], motion: []};
    this.worst = {rods: 0, energy: 0, motion: 0};
    Object.assign(this, {lost: null, alone: false, trail: []});
    [this.rods, this.level] = [this.errors, this.energy];
  }
  advance() {
    attempt(() => this.step(), why => this.lose(why));
    if (this.lost) return;
    this.rods = this.errors;
    const energy = this.energy - this.level;
    const holds = largest(this.rods) < this.far && Number.isFinite(energy);
    if (!holds) return this.lose("its rods flew apart");
    this.note("rods", largest(this.rods));
    if (!held.copy) this.note("energy", energy); // what a hand adds is no error
    if (truth.known && !this.alone) this.note("motion", apart(this, truth.fine));
    this.trail.push([run.time, this.point(last)]);
    while (this.trail[0][0] < run.time - TRAIL) this.trail.shift();
  }
  note(view, value) {
    const points = this.curves[view], bin = ([time]) => Math.floor(time / BIN);
    if (Math.abs(value) > Math.abs(this.worst[view])) this.worst[view] = value;
    if (points.length && bin(points.at(-1)) === bin([run.time])) points.pop();
    points.push([run.time, view === "energy" ? value : this.worst[view]]);
    if (points.length > 1.1 * SPAN / BIN) points.shift();
  }
  lose(why) { this.lost = `lost at ${fixed(run.time, 2)} s: ${why}`; }
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

// `project` in much smaller steps, and in steps twice as long: where these part, chaos decides.
const best = scene.methods.includes("project") ? "project" : scene.methods.at(-1);
const truth = {
  motions: [1, 2].map(() => new Motion(scene, best, knobs)),
  get fine() { return this.motions[0]; },
  begin(state) {
    for (const motion of this.motions) motion.begin(state);
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

function begin(start = run.start) {
  knobs.pulls.fill(0);
  held.copy = null;
  Object.assign(run, {start, taken: 0, time: 0, box: run.home});
  for (const copy of copies) copy.begin(start);
  truth.begin(start);
  draw();
}

function step() {
  run.time = ++run.taken * knobs.dt;
  truth.step();
  for (const copy of copies) if (!copy.lost) copy.advance();
}

// A method for so many seconds, unseen: its worst rod, Infinity if it is lost; its curves; its box.
function rehearse(method, settings, seconds) {
  const copy = new Copy(scene, method, Motion.knobs(scene, settings)), now = run.time;
  let box = [...scene.anchors, ...copy.points].reduce(around, [1e99, 1e99, -1e99, -1e99]);
  copy.alone = true;
  for (let k = 1; k < 2000 && k * copy.knobs.dt < seconds && !copy.lost; k++) {
    run.time = k * copy.knobs.dt;
    copy.advance();
    if (!copy.lost) box = copy.points.reduce(around, box);
  }
  run.time = now;
  return {worst: copy.lost ? Infinity : copy.worst.rods, rods: copy.rods, curves: copy.curves, box};
}

function around([left, bottom, right, top], [x, y]) {
  return [Math.min(left, x), Math.min(bottom, y), Math.max(right, x), Math.max(top, y)];
}

// --- the hand pulls what moves, and poses what stands still ---
function drag(copy, particle, point) {
  Object.assign(held, {copy, particle});
  knobs.hand = point;
  if (clock.going) {
    const mass = scene.masses[particle] * (particle === last ? knobs.mass : 1);
    knobs.pulls[particle] = HAND * HAND * mass;
    return;
  }
  const state = posed(copy.state, particle, point);
  for (const each of copies) each.begin(state);
  draw();
}

function letGo() {
  if (!held.copy) return;
  const {copy} = held;
  held.copy = null;
  if (!knobs.pulls.some(Boolean)) return begin(ontoRods(posed(copy.state)));
  knobs.pulls.fill(0);
  for (const each of copies) each.level = each.energy;
}

// A state at rest, with a particle at a point: rods are put right in turn, again and again.
function posed(before, particle = null, point = null) {
  const state = Float64Array.from(before).fill(0, before.length / 2);
  if (point) state.set(point, 3 * particle);
  const place = i => (i < 0 ? scene.anchors[-1 - i] : Array.from(state.subarray(3 * i, 3 * i + 2)));
  const moves = i => Number(i >= 0 && i !== particle);
  for (let round = 0; round < 300; round++) {
    scene.pairs.forEach(([i, j], k) => {
      const apart = plus(place(i), place(j), -1), ends = moves(i) + moves(j);
      const d = size(apart) ? apart : [0, -1e-9]; // dragged onto the other end
      const by = times(d, (scene.lengths[k] / size(d) - 1) / (ends || 1));
      if (moves(i)) state.set(plus(place(i), by), 3 * i);
      if (moves(j)) state.set(plus(place(j), by, -1), 3 * j);
    });
  }
  return state;
}

function ontoRods(state) { // to the last digits, by the chapter's own project, if that can be
  const motion = new Motion(scene, best, knobs);
  motion.begin(state);
  attempt(() => motion.step(1e-6), () => motion.begin(run.start)); // back where it was
  return motion.state.fill(0, state.length / 2);
}

// --- what is seen ---
function makeTile(copy, k) {
  const name = make("b", {className: colorOf(k), textContent: copy.method});
  const about = make("span", {textContent: DESCRIBED[copy.method] ?? "a row of your own"});
  const off = make("p"), why = make("p");
  const lost = row("lost", why, makeButton("Start it again", () => {
    copy.begin(run.start);
    copy.alone = run.taken > 0; // the others are elsewhere by now
    draw();
  }));
  copy.view = new Stage(`${copy.method}: the scene`, [0, 0, 1, 1], () => paint(copy, k));
  copy.gauge = makeGauge(`${copy.method}: each rod, too short or too long`, () => copy.rods);
  copy.tell = () => {
    const worst = largest(copy.rods), side = Math.max(...copy.rods) === worst ? "long" : "short";
    off.textContent = worst < 1e-12 ? "rods are right" : `${metric(worst)} too ${side}`;
    off.className = `off ${worst < 1e-6 ? "" : side}`;
    [lost.hidden, why.textContent] = [!copy.lost, copy.lost ?? ""];
    off.hidden = copy.view.element.inert = Boolean(copy.lost); // nothing to read, nothing to pull
  };
  for (let i = 0; i <= last; i++) { // the last particle on top
    const label = `${copy.method}: pull particle ${i + 1} by the arrow keys, let go with Escape`;
    const move = point => drag(copy, i, point);
    copy.view.hand(label, () => copy.point(i), move, letGo).tabIndex = i === last ? 0 : -1;
  }
  const seen = [copy.view, copy.gauge].map(({element}) => element);
  const caption = make("figcaption", {}, name, " ", about);
  return make("figure", {className: "tile"}, caption, ...seen, off, lost);
}

function paint(copy, k) {
  const {view} = copy, faded = alpha => { view.pen.globalAlpha = alpha; };
  if (truth.known) {
    faded(0.35 * (1 - truth.doubt / (0.1 * run.size)));
    for (const ends of scene.pairs) view.line(ends.map(i => truth.fine.point(i)), "reference", 8);
  }
  faded(1);
  for (const [rod, [, j]] of scene.pairs.entries()) {
    if (run.circles && j < 0) view.circle(copy.point(j), scene.lengths[rod], "quiet");
  }
  faded(copy.lost ? 0.2 : 0.6);
  view.line(copy.trail.map(([, point]) => point), colorOf(k), 1.2);
  faded(copy.lost ? 0.2 : 1);
  view.system(copy, "ink", colorOf(k));
  faded(1);
  if (!held.copy || !clock.going) return;
  view.line([copy.point(held.particle), knobs.hand], "quiet", 1.5, [2, 4]);
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
  const {view} = run, dash = [3, 3];
  const before = run.before.map((curves, k) => ({color: colorOf(k), points: curves[view], dash}));
  const now = copies.map(({method, lost, curves, worst}, k) => {
    const points = curves[view], value = points.length ? VIEWS[view].words(worst[view]) : "";
    return {color: colorOf(k), points, words: `${method} ${lost ? "lost" : value}`};
  });
  return [...before, ...now];
}

let told = 0;
function draw() {
  widen();
  for (const {view, gauge} of copies) {
    view.box = run.box;
    view.draw();
    gauge.draw();
  }
  plot.axis = VIEWS[run.view].axis;
  plot.draw();
  if (clock.going && performance.now() - told < 150) return; // what changes faster cannot be read
  told = performance.now();
  for (const copy of copies) copy.tell();
  const ends = curves().map(({words}) => words).filter(Boolean);
  plot.canvas.ariaLabel = `${byId("title").textContent}: ${ends}`;
  byId("time").textContent = `${fixed(run.time, 2)} s${clock.late ? ", in slow motion" : ""}`;
}

function showView(name) {
  run.view = name;
  byId("title").textContent = VIEWS[name].title + (run.before.length ? "; dashed: whole" : "");
  for (const key in VIEWS) byId(key).ariaPressed = key === name;
}

// --- sliders, over lists of exact values ---
const listed = values => [...new Set(values)].sort((a, b) => a - b);
const {dt, baumgarte, time_constant: softness} = scene.knobs;
const SLIDERS = [
  {
    key: "dt", label: "Step", begins: true,
    values: listed([0.000625, 0.00125, 0.0025, 0.005, 0.01, 0.02, 0.04, 0.05, dt, dt / 2]),
    words: dt => `${three(1000 * dt)} ms`,
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
    words: T => `${three(1000 * T)} ms`
      + (T < 2 * knobs.dt ? `, taken as two steps: ${three(2000 * knobs.dt)} ms` : ""),
  },
  {
    key: "mass", label: "Mass of the last particle", begins: true,
    values: [0.01, 0.03, 0.1, 0.3, 1, 3, 10, 30, 100],
    words: factor => `\u00d7 ${three(factor)} = ${three(factor * scene.masses[last])} kg`,
  },
];
const fits = ({needs = scene.methods[0], scene: only = name, shows = () => true}) =>
  scene.methods.includes(needs) && only === name && shows();
const sliders = SLIDERS.filter(fits).map(({key, label, values, words, begins}) => {
  const slider = makeSlider(label, values, values.indexOf(knobs[key]), words, value => {
    knobs[key] = value;
    showKnobs();
    if (begins) begin(); // an old error in a new step would be a blow
  });
  slider.element.id = key;
  return Object.assign(slider, {key, values});
});

const ticks = wanted => sliders.find(({key}) => key === wanted)?.values ?? [scene.knobs[wanted]];

function showKnobs() { // and a mark where the stiffness breaks
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
    ask: "Why do these rods grow?", needs: "none", control: "one", circles: true, paused: true,
    say: "In full swing. Press One step, again and again. A step goes straight on where the"
      + " bob should turn along the dotted circle: it ends a little outside, and the rod of"
      + " none is longer (red). none never looks back, so each step adds to the last. The"
      + " others correct it, each in its way.",
    ahead: 0.6, // s
    shows: () => Math.max(...rehearse("none", {dt: opening}, 0.6).rods) > 0.005 * run.size,
  },
  {
    ask: "What does half the step buy?", control: "dt", compares: true,
    say: "Dashed is the same scene with the whole step; half the step is twice the work. Which"
      + " errors come down, and by how much? Those of soft hardly move, because its rods are"
      + " meant to give. Those of project are as good as zero either way.",
    knobs: () => ({
      dt: opening / 2, time_constant: ticks("time_constant").find(T => T >= 2 * opening),
    }),
  },
  {
    ask: "How stiff may the spring be?", needs: "baumgarte", control: "baumgarte",
    say: "A stiffer spring pulls wrong rods back faster, until one step pulls too far, the"
      + " next one farther, and all flies apart. Move the stiffness past its mark. Then take a"
      + " smaller step: only the product of the two counts.",
    knobs: () => ({baumgarte: ticks("baumgarte").findLast(w => w * opening < (scene.limit ?? 1))}),
  },
  {
    ask: "Which keeps its energy?", control: "energy", view: "energy",
    say: "Watch the plot for ten seconds. Nothing drives the scene and nothing brakes it, so"
      + " its energy should stay at 0 %. Right rods are not enough: a method can hold them and"
      + " still lose energy.",
  },
  {
    ask: "How soft is soft?", needs: "soft", control: "time_constant",
    say: "The rods of soft stretch under load, on purpose, as in MuJoCo: jolts become gentle."
      + " Drag a bob down, and look at the red. Twice the softness stretches four times as"
      + " far, and a smaller step does not help.",
    knobs: () => ({time_constant: 0.1}),
  },
  {
    ask: "Which way through the flat pose?", scene: "peaucellier",
    control: "motion", view: "motion",
    say: "After 1 s all bars lie in one line, and can fold on in two ways. There the smallest"
      + " error decides. See which copies fold as the pale one does, and which do not. Then"
      + " halve the step.",
  },
  {
    ask: "Which is nearest the true motion?", needs: "project", control: "motion", view: "motion",
    say: "The pale scene behind each copy is the true motion, found by much smaller steps."
      + " Which copy stays on it longest? Where chaos decides it fades, and nobody can tell.",
  },
  {
    ask: "As it was", control: "dt", knobs: () => scene.knobs,
    say: "Step, stiffness and softness of the run that wrote this page. Until you touch anything,"
      + " each number is Python's.",
  },
];

function choose(question, button) {
  for (const each of byId("questions").children) each.ariaPressed = each === button;
  for (const element of document.querySelectorAll(".control")) element.classList.remove("control");
  const control = byId(question.control);
  control.classList.add("control");
  control.closest("section, label, #controls").scrollIntoView({block: "nearest"});
  byId("say").textContent = question.say;
  Object.assign(knobs, scene.knobs, {mass: 1, dt: opening}, question.knobs?.());
  run.circles = Boolean(question.circles);
  const whole = {...knobs, dt: opening}, compared = question.compares ? scene.methods : [];
  run.before = compared.map(method => rehearse(method, whole, SPAN / 2).curves);
  showView(question.view ?? "rods");
  showKnobs();
  begin(scene.start);
  for (let k = 0; k < 100 && run.time < (question.ahead ?? 0); k++) step();
  clock.set(!question.paused);
  draw();
}

// --- the page ---
const plot = makePlot("", decades, curves);
const clock = new Clock(byId("page"), () => knobs.dt, step, draw);
const one = makeButton("One step", () => {
  clock.set(false);
  step();
  draw();
});
one.id = "one";
const slow = makeButton("Slow", () => {
  clock.speed = clock.speed === 1 ? 0.1 : 1;
  slow.ariaPressed = clock.speed !== 1;
});
slow.ariaPressed = false;
byId("controls").prepend(clock.element, one, makeButton("Again", () => begin()), slow);
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
// It begins with the longest step, up to 20 ms, that loses no method: there is much to be seen.
const longest = Math.min(0.02, 0.5 * (scene.limit ?? Infinity) / baumgarte);
const visible = 0.2 * scene.lengths.reduce((sum, length) => sum + length);
const opening = ticks("dt").findLast(step => step > dt && step <= longest
  && scene.methods.every(method => rehearse(method, {dt: step}, 3).worst < visible)) ?? dt;
run.home = rehearse(best, {dt: opening}, 10).box;
run.size = Math.max(run.home[2] - run.home[0], run.home[3] - run.home[1]);
for (const question of QUESTIONS.filter(fits)) {
  const button = makeButton(question.ask, () => choose(question, button));
  button.ariaPressed = false;
  byId("questions").append(button);
}
knobs.dt = opening;
showView("rods");
showKnobs();
begin();
