// The page of a scene: a copy of it under each method, or one for each row of the answer; a hand,
// sliders and questions. What Python found stands on it already.
const SPAN = 20; // s that the plot shows
const BIN = 0.04; // s: one point of the plot
const TRAIL = 1.5; // s of the last bob's path
// Of the true motion, without an answer: steps in one, at least, and how long at most, in s.
const [FINE, FINEST] = scene.pairs.length > 8 ? [10, 0.001] : [20, 0.00025];
const UNSURE = 0.1; // of the scene's size: the true motion is known to so much, or not at all
const HAND = 15; // rad/s: the hand's spring has HAND^2 times the bob's mass, in steps that bear it
const CHANGES = 0.02; // of the energy's scale: what changes by as much can be seen to
const [RIGHT, SLIGHT] = [1e-9, 1e-6]; // of the shortest rod: errors that are rounding, and unseen
const DASHES = [ // as many as colours
  [], [9, 5], [1, 5], [9, 5, 1, 5], [18, 5], [5, 5], [18, 5, 1, 5], [9, 5, 1, 5, 1, 5],
];
const shortest = Math.min(...scene.lengths); // m
const decade = Math.ceil(Math.log10(shortest));
const decadesTo = (least, most) =>
  logarithmic(least + decade, Math.max(decade, Math.ceil(Math.log10(most) - 0.5)));
const change = x => (Math.abs(x) < 1e-6 ? "0 %" : (x > 0 ? "+" : "") + perCent(x));
const VIEWS = { // of the plot: what it shows, its axis for values up to `most`, and one in words
  rods: {name: "Rods", title: "Worst rod so far", axis: most => decadesTo(-6, most), words: metric},
  energy: {
    name: "Energy", title: `Energy ${scene.conserves ? "off" : "change"}`,
    axis: most => linear(roundUp(most)), words: change,
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
const three = x => inDigits(x, 3);
const ms = dt => `${three(1000 * dt)} ms`;
const farther = (a, b) => (Math.abs(b) > Math.abs(a) ? b : a); // from 0

function roundUp(x) { // to 1, 2 or 5 times a power of ten, at least 1 %
  const power = 10 ** Math.floor(Math.log10(Math.max(0.01, x)));
  return power * [1, 2, 5, 10].find(k => k * power >= x);
}

// --- the hand: time passes while it pulls ---
const hand = {
  copy: null, particle: 0, waits: false, pulled: false, // waits: time stood still before it pulled
  drag(copy, particle, point) {
    if (!this.copy) this.waits = !clock.going;
    Object.assign(this, {copy, particle, pulled: true});
    const longest = Math.max(...run.alive.map(({dt}) => dt()));
    knobs.hand = point;
    knobs.pulls[particle] = Math.min(HAND, 1 / longest) ** 2 * scene.masses[particle];
    if (!clock.going) clock.set(true);
  },
  letGo() {
    if (!this.copy) return;
    this.copy = null;
    knobs.pulls.fill(0);
    for (const copy of run.all) copy.level = copy.energy;
    if (this.waits) clock.set(false);
  },
};

// --- the copies, and the true motion ---
class Copy extends Motion {
  constructor(scheme, dt, own) { // in steps of dt() s
    super(scene, scheme, knobs);
    const method = scene.method_of[scheme];
    const place = scene.colors[method];
    Object.assign(this, {dt, name: method, label: method, words: scene.words[method]});
    Object.assign(this, {color: `m${place}`, dash: DASHES[place], ...own});
  }
  begin(state) {
    super.begin(state);
    this.taken = 0;
    this.curves = {rods: [], energy: [], motion: []};
    this.worst = {rods: 0, energy: 0, motion: 0};
    this.trail = [];
    this.lost = null; // why it ended
    this.off = 0; // m: the rod that is off most; above 0: too long
    this.places = null; // m: the worst so far, while the answer has compared them
    this.level = this.energy;
    this.true = null; // places of the true motion at the same time, if that is known
    this.away = 0; // m: the farthest that a particle is from it
  }
  see() {
    this.true = truth.known && truth.fine.points;
    this.away = this.true && Math.max(apart(this.points, this.true), truth.doubt);
  }
  follow(time) { // takes the steps that end by then; what is compared is so after the last one
    const {taken} = this;
    while (!this.lost && (this.taken + 1) * this.dt() <= time) this.advance();
    if (this.lost || this.taken === taken) return;
    if (this.time === time) this.see();
    this.note("rods", this.worst.rods);
    if (!hand.copy) this.note("energy", this.energy - this.level); // what a hand adds is no error
    if (this.true) this.note("motion", this.away);
    if (this.true && time <= found.seconds) this.places = this.worst.motion;
    this.trail.push([this.time, this.point(last)]);
    while (this.trail[0][0] < this.time - TRAIL) this.trail.shift();
  }
  advance() {
    attempt(() => this.step(this.dt()), why => { this.lost = why; });
    const off = this.errors.reduce(farther, 0);
    if (!(Math.abs(off) < scene.far && Number.isFinite(this.energy))) this.lost ??= "diverged";
    if (!this.lost) {
      this.taken += 1;
      this.off = off;
      this.worst.rods = farther(this.worst.rods, off);
    }
    this.time = this.taken * this.dt(); // of its last state that is good, as in the run's table
  }
  note(view, value) {
    const points = this.curves[view];
    const bin = ([time]) => Math.floor(time / BIN);
    this.worst[view] = farther(this.worst[view], value);
    if (points.length && bin(points.at(-1)) === bin([this.time])) points.pop();
    points.push([this.time, view === "energy" ? value : Math.abs(this.worst[view])]);
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

function apart(some, others) { // m: the farthest that a particle is from where it is in others
  return Math.max(...some.map((point, k) => size(plus(point, others[k], -1))));
}

function around([left, bottom, right, top], [x, y]) {
  return [Math.min(left, x), Math.min(bottom, y), Math.max(right, x), Math.max(top, y)];
}

// The true motion: the answer's scheme or `project` in much smaller steps, and in steps twice as
// long: where these part, chaos decides.
const best = has("project") ? "project" : scene.methods.at(-1);
const exact = found.truth ?? {scheme: best, dt: FINEST};
const home = reach(5); // what all tiles show, at least
const extent = Math.max(home[2] - home[0], home[3] - home[1]); // m
function reach(seconds) { // the box in which the scene moves for so long
  const scout = new Motion(scene, exact.scheme, knobs);
  let box = [...scene.anchors, ...scout.points].reduce(around, [1e99, 1e99, -1e99, -1e99]);
  attempt(() => {
    while (scout.time < seconds && largest(scout.errors) < scene.far) {
      box = scout.points.reduce(around, box);
      scout.step(4 * Math.max(exact.dt, FINEST)); // a drawing need not be finer
    }
  }, () => {});
  return box;
}
const truth = {
  fine: new Motion(scene, exact.scheme, knobs),
  coarse: new Motion(scene, exact.scheme, knobs),
  doubt: 0, // m
  begin() {
    this.fine.begin();
    this.coarse.begin();
    this.doubt = found.truth || best === "project" ? 0 : Infinity;
  },
  step(time) { // of so many s
    if (!this.known) return;
    const parts = 2 * Math.ceil(Math.max(found.truth ? 2 : FINE, time / exact.dt) / 2);
    attempt(() => {
      for (let part = 0; part < parts; part++) this.fine.step(time / parts);
      for (let part = 0; part < parts; part += 2) this.coarse.step(2 * (time / parts));
      this.doubt = Math.max(this.doubt, apart(this.fine.points, this.coarse.points));
    }, () => { this.doubt = Infinity; });
  },
  get known() { return this.doubt < UNSURE * extent; },
};
// The copies, which follow one time tick by tick: those of the methods or, while a row of the
// answer is marked, those of its rows. If a question asks for it, `halves` go along, in half the
// step.
const inStep = divided => scene.methods.map(name => new Copy(name, () => knobs.dt / divided));
const run = {
  methods: inStep(1), halves: [], marked: null, taken: 0, box: home,
  rows: found.answer.map(({scheme, name, what, dt, span}) => new Copy(scheme, () => dt, {
    name, span, words: `in steps of ${ms(dt)}${what && `, ${what}`}`, label: ms(dt),
    dash: what ? DASHES[1] : DASHES[0],
  })),
  get copies() { return this.marked ? this.rows : this.methods; },
  get all() { return [...this.copies, ...this.halves]; },
  get alive() { return this.copies.filter(({lost}) => !lost); },
  get tick() { return this.marked ? found.tick : knobs.dt; }, // s
  get time() { return this.taken * this.tick; },
  begin() {
    hand.letGo();
    hand.pulled = false;
    this.taken = 0;
    this.box = home;
    truth.begin();
    for (const copy of this.all) {
      copy.begin();
      copy.see();
    }
    drawing.draw();
  },
  step() {
    this.taken += 1;
    truth.step(this.tick);
    for (const copy of this.all) copy.follow(this.time);
    const span = this.marked?.span; // s: for so long the row was tried
    if (this.time >= span && this.time < span + this.tick) clock.set(false);
  },
  widen() { // the box, where copies go a little beyond it
    const [left, bottom, right, top] = home;
    const near = ([x, y]) => Math.max(left - x, x - right, bottom - y, y - top) < 0.5 * extent;
    for (const {points} of this.alive) this.box = points.filter(near).reduce(around, this.box);
  },
};

// --- what is seen ---
function makeTile(copy) {
  const {name, color, words} = copy;
  const off = make("b");
  const away = make("div");
  const now = make("div", {className: "now"}, off, away);
  const lost = make("p", {className: "lost", ariaLive: "polite"});
  const title = make("b", {className: color, textContent: name});
  copy.view = new Stage(`${name}: the scene`, [0, 0, 1, 1], () => paint(copy), [12, 44, 12, 8]);
  copy.tell = () => {
    const asked = run.marked && !hand.pulled; // of the answer, which says what is worst
    const worst = asked ? copy.worst.rods : copy.off;
    const side = worst > 0 ? "long" : "short";
    const right = Math.abs(worst) < RIGHT * shortest;
    off.textContent = right ? "rods are right" : `${metric(Math.abs(worst))} too ${side}`;
    off.className = Math.abs(worst) < SLIGHT * shortest ? "" : side;
    const places = copy.places !== null && `places ${metric(copy.places)} off`;
    const here = copy.true && `${metric(copy.away)} from true motion`;
    away.textContent = (asked ? places : here) || "";
    now.hidden = Boolean(copy.lost);
    const advice = run.marked ? "" : " Try a shorter step.";
    const why = copy.lost ? `lost at ${three(copy.time)} s: ${copy.lost}.${advice}` : "";
    if (lost.textContent !== why) lost.textContent = why; // so it is announced once
    copy.view.element.inert = Boolean(copy.lost); // there is nothing to pull
  };
  for (let i = 0; i <= last; i++) { // the last one on top
    const label = `${name}: pull bob ${i + 1} of ${last + 1} by the arrow keys; Escape lets go,`
      + " Page Up and Page Down change the bob";
    const move = point => hand.drag(copy, i, point);
    const button = copy.view.hand(label, () => copy.point(i), move, () => hand.letGo());
    button.tabIndex = i === last ? 0 : -1;
  }
  const caption = make("figcaption", {}, title, ` ${words}`);
  copy.tile = make("figure", {className: "tile"}, caption, copy.view.element, now, lost);
  return copy.tile;
}

function paint(copy) {
  const {view, color} = copy;
  const faded = alpha => { view.pen.globalAlpha = alpha; };
  if (copy.true) {
    const at = i => (i < 0 ? scene.anchors[-1 - i] : copy.true[i]);
    faded(0.8 * (1 - Math.min(1, truth.doubt / (UNSURE * extent))));
    view.lines(scene.pairs.map(ends => ends.map(at)), "reference", 5);
  }
  faded(copy.lost ? 0.2 : 0.6);
  view.line(copy.trail.map(([, point]) => point), color, 1.2);
  faded(copy.lost ? 0.2 : 1);
  view.system(copy, "ink", color);
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
  lines() {
    const words = copy => {
      const worst = copy.worst[this.view];
      if (copy.lost) return "lost";
      if (!copy.curves[this.view].length) return ""; // there is nothing yet
      return VIEWS[this.view].words(this.view === "energy" ? worst : Math.abs(worst));
    };
    const line = ({color, curves, dash}) => ({color, dash, points: curves[this.view]});
    const lines = run.copies.map((copy, k) => {
      const half = run.halves[k] ? `, ${words(run.halves[k])}` : "";
      const width = copy === run.marked ? 4 : 2;
      return {...line(copy), width, words: `${copy.label} ${words(copy)}${half}`};
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
const share = x => (x === 1 ? "as in the run" : `${x} times the run\u2019s`);
const SLIDERS = [
  {
    key: "dt", label: "Step", begins: true,
    words: dt => `${ms(dt)}, ${share(three(dt / scene.knobs.dt))}`,
    values: [0.000625, 0.00125, 0.0025, 0.005, 0.01, 0.02, 0.04, 0.05, scene.knobs.dt / 2],
  },
  {
    key: "baumgarte", label: "Stiffness of baumgarte", needs: "baumgarte",
    values: [0, 5, 10, 20, 40, 60, 80, 120, 160, 200, 320],
    words: w => `${three(w)}/s \u00d7 ${ms(knobs.dt)} = ${fixed(knobs.dt * w, 2)}`
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
  for (const {key, set, values, element, input} of sliders) {
    set(knobs[key]);
    input.disabled = run.marked !== null; // the answer is of the knobs and steps that it says
    if (key !== "baumgarte" || !scene.limit) continue;
    const edge = scene.limit / knobs.dt;
    const k = values.findLastIndex(w => w <= edge);
    const at = k + (edge - values[k]) / (values[k + 1] - values[k]); // NaN beyond the last one
    element.style.setProperty("--breaks", at / (values.length - 1) || "");
  }
}

// --- questions: each sets the knobs, the view and a control, and says what to look at ---
const AS_IT_WAS = {
  ask: "As it was",
  say: "The knobs of the run again. Until you touch anything, each number of a rod is Python\u2019s.",
};
const QUESTIONS = [
  {
    ask: "What does half the step buy?", control: "dt", halves: true,
    say: "Beside each copy goes another one, unseen, in half the step: the thin line of the plot."
      + " The two numbers there are of the same time. The second took twice the work: what for?",
  },
  {
    ask: "Which keeps its energy?", control: "energy", view: "energy",
    say: "The energy counts all that acts on the scene, so it should stay: 0 % off. Watch the plot"
      + " for ten seconds. A method can hold the rods and still change the energy.",
    shows: () => scene.conserves && found.energy > CHANGES,
  },
  {
    ask: "How stiff a spring?", needs: "baumgarte", control: "baumgarte",
    say: "A stiffer spring pulls wrong rods back faster, until one step pulls too far, the next one"
      + " farther, and the copy is lost. Move it past its mark. Then take a shorter step.",
  },
  {
    ask: "Which is nearest the true motion?", control: "motion", view: "motion",
    say: "The grey scene behind each copy is the true motion, found by much smaller steps. Which"
      + " copy stays on it longest? Where chaos decides it fades, and nobody can tell.",
    shows: () => found.truth || has("project"),
  },
  AS_IT_WAS,
];
const PLAYED = { // what a row of the answer asks
  view: "motion",
  say: "Each row of the answer in steps of its own, for as long as the one you touched was tried."
    + " Numbers are the worst so far, as in the table. Touch it again, and the run is back.",
};
const choices = []; // the buttons of questions and rows: one of them is pressed

function choose({say, control = "dt", view = "rods", halves = false}, button, row = null) {
  for (const each of choices) each.ariaPressed = each === button;
  document.querySelector(".control")?.classList.remove("control");
  byId("say").textContent = say;
  run.marked = row;
  run.halves = halves ? inStep(2) : [];
  Object.assign(knobs, scene.knobs);
  placeSliders(control);
  if (!row) byId(control).classList.add("control");
  showKnobs();
  showTiles();
  run.begin();
  board.show(view);
  clock.set(true);
}

function placeSliders(control) { // that of a question, or the step's, beside what is said
  byId("knobs").append(...sliders.map(({element}) => element));
  byId("asked").append(sliders.find(({key}) => key === control)?.element ?? byId("dt"));
}

function showTiles() {
  for (const copy of [...run.methods, ...run.rows]) {
    copy.tile.hidden = !run.copies.includes(copy);
    copy.tile.classList.toggle("marked", copy === run.marked);
  }
  const many = run.copies.length;
  const left = columns - many % columns; // of the last line
  byId("board").style.setProperty("--span", left > 1 ? left : columns);
  byId("key").style.setProperty("--span", 2 - many % 2);
}

// --- the page ---
const clock = new Clock(byId("page"), () => run.tick, () => run.step(), () => drawing.draw());
byId("controls").prepend(clock.element, makeButton("Again", () => run.begin()));
const buttons = new Map(); // of questions
for (const question of QUESTIONS) {
  const {ask, needs, shows} = question;
  if ((needs && !has(needs)) || (shows && !shows())) continue;
  const button = makeButton(ask, () => choose(question, button));
  buttons.set(question, button);
  byId("questions").append(button);
}
const heads = document.querySelectorAll("#ladder th[scope=row]");
run.rows.forEach((row, k) => {
  const toggle = () => {
    if (run.marked === row) return choose(AS_IT_WAS, buttons.get(AS_IT_WAS));
    choose(PLAYED, button, row);
    const {top} = byId("tiles").getBoundingClientRect();
    if (top + 200 > innerHeight) byId("asked").scrollIntoView(); // they are below the screen
  };
  const button = makeButton(heads[k].textContent, toggle);
  heads[k].replaceChildren(button);
  choices.push(button);
});
choices.push(...buttons.values());
for (const button of choices) button.ariaPressed = false;
// Room for the longest of all texts, so that none moves the tiles.
for (const {say} of [{say: byId("say").textContent}, ...QUESTIONS, PLAYED]) {
  byId("words").append(make("p", {className: "room", ariaHidden: true, textContent: say}));
}
const tiles = [...run.methods, ...run.rows].map(makeTile);
const columns = Math.max(2, Math.ceil((Math.max(run.methods.length, run.rows.length) + 1) / 2));
byId("tiles").prepend(...tiles);
byId("tiles").style.setProperty("--columns", columns);
byId("tiles").classList.toggle("wide", home[2] - home[0] > 3 * (home[3] - home[1]));
byId("board").append(board.plot.element);
for (const id in VIEWS) {
  byId("views").append(Object.assign(makeButton(VIEWS[id].name, () => board.show(id)), {id}));
}
placeSliders("dt");
showKnobs();
showTiles();
board.show("rods");
run.begin();
