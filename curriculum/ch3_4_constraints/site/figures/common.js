// What the chapter's figures share. Each has the name of the picture whose place it takes, and
// fills it with parts; its caption stays, and a hint that says what to do is added to it. The
// picture stays for the printer.
const figures = {};
const {pendulum, double} = traced;
const STEP = double.knobs.dt;
const CIRCLING = [-2.6, -2.5, 2.6, 2.1]; // m: all that a double pendulum reaches
const DASHES = {euler: [5, 5], semi_implicit: [16, 6], rk4: []};
const STILL = matchMedia("(prefers-reduced-motion: reduce)").matches;

const inkOf = method => `m${double.colors[method]}`;
const nameOf = method => make("b", {textContent: method, className: inkOf(method)});
const elements = parts => parts.map(part => part.element ?? part);
const controls = (...parts) => row("controls", ...elements(parts));
const panels = (...stages) => row("panels", ...elements(stages));
const drawAll = (...stages) => stages.forEach(stage => stage.draw());
const symbol = (name, text = name) => `<var class="${name}">${text}</var>`;
const pair = ([x, y]) => `(${fixed(x, 2)}, ${fixed(y, 2)})`;
const dot = ([a, b], [c, d]) => a * c + b * d;
const angle = (a, b) => Math.atan2(dot(across(a), b), dot(a, b)); // from a to b
const turned = ([x, y], by) => plus(times([x, y], Math.cos(by)), [-y, x], Math.sin(by));
function offBy(error) { // of a rod in m, in words
  if (Math.abs(error) < 5e-7) return "right";
  return `${metric(Math.abs(error))} too ${error > 0 ? "long" : "short"}`;
}
const arc = (at, d, from, to) => Array.from({length: 41}, // d from `at`, turned from angle to angle
  (_, k) => plus(at, turned(d, from + (to - from) * k / 40)));

function circle(stage, radius) { // of so many metres about the origin
  stage.line(arc([0, 0], [radius, 0], 0, 2 * Math.PI), "quiet", 1, [1, 5]);
}
function drawSymbol(stage, text, at, color, aside) { // as formulas have it
  stage.words(text, at, color, aside, "center", "italic 20px Georgia, serif");
}

function fill(figure, hint, ...parts) {
  const caption = figure.querySelector("figcaption");
  const picture = figure.querySelector("img");
  const href = `#figure=${figure.dataset.figure}`;
  const alone = make("a", {className: "lone", textContent: "Alone", href});
  caption.append(" ", make("b", {textContent: hint}), " ", alone);
  figure.replaceChildren(picture, ...elements(parts), caption);
}

function makeStage(label, height, box, paint, ...more) { // so many rem high, above what it `says`
  const stage = new Stage(label, box, paint, ...more);
  stage.canvas.style.height = `${height}rem`;
  stage.says = row("says");
  stage.element.append(stage.says);
  const {hand} = stage; // what is dragged off the canvas waits at its edge
  const inside = (x, k) => Math.max(10, Math.min([stage.width, stage.height][k] - 10, x));
  stage.hand = (name, where, move, ...letGo) => hand.call(stage, name, where,
    point => move(stage.metresAt(stage.pixels(point).map(inside))), ...letGo);
  return stage;
}

// A stage for what is no place: ticks, [[value, words], ...], on its left and below.
function makeChart(label, height, box, left, below, paint) {
  return makeStage(label, height, box, chart => {
    for (const [y, words] of left) {
      chart.line([[box[0], y], [box[2], y]], "pale", 1);
      chart.words(words, [box[0], y], "quiet", [-6, 0], "right", PLAIN);
    }
    for (const [x, words] of below) {
      chart.words(words, [x, box[1]], "quiet", [0, -12], "center", PLAIN);
    }
    paint(chart);
  }, [58, 24, 14, 12], true);
}

// The reader picks an answer before begin() lets the figure run; reveal() says which it was, and
// shows what gave it away.
function makePrediction(question, answers, right, begin, spoiler) {
  const verdict = make("p");
  let chosen;
  const buttons = answers.map(answer => makeButton(answer, () => {
    chosen = answer;
    for (const button of buttons) {
      Object.assign(button, {disabled: true, ariaPressed: button.textContent === answer});
    }
    verdict.textContent = "Now try it.";
    begin();
  }));
  const reveal = why => {
    verdict.textContent = `${chosen === right ? "As you said" : "No"}: ${why}`;
    spoiler?.classList.remove("answer");
  };
  spoiler?.classList.add("answer");
  const asked = make("p", {textContent: question});
  return {element: row("prediction", asked, row("controls", ...buttons), verdict), reveal};
}

class Runs { // a scene under several methods, side by side, and of each a curve of what is noted
  constructor(scene, methods, seconds, noted) {
    Object.assign(this, {scene, methods, seconds, noted, knobs: Motion.knobs(scene)}).begin();
  }
  begin(starts = []) {
    this.time = 0;
    this.each = this.methods.map((method, k) => {
      const motion = new Motion(this.scene, method, this.knobs);
      motion.begin(starts[k]);
      return Object.assign(motion, {curve: []});
    });
    this.note();
  }
  get going() { return this.each.filter(({lost}) => !lost); }
  step() {
    this.time += this.knobs.dt;
    for (const run of this.going) {
      try {
        run.step();
        if (!(largest(run.errors) < run.far)) throw new Error("diverged");
      } catch ({message}) {
        run.lost = `lost at ${fixed(this.time, 1)} s: ${message}`;
      }
    }
    this.note();
  }
  note() {
    for (const run of this.going) {
      run.now = this.noted(run, this.each);
      if (this.time >= 0.02 * run.curve.length) run.curve.push([this.time, run.now]);
    }
  }
  get over() { return this.time > this.seconds - this.knobs.dt / 2; }
}

// The clock of runs; again(), which begins anew; end(); and buttons for these.
function makeRunner(figure, runs, begin, draw) {
  const clock = new Clock(figure, () => runs.knobs.dt, () => {
    if (runs.held) return; // by a hand
    if (runs.over) begin();
    runs.step();
    if (runs.over) clock.set(false);
  }, draw);
  const again = () => {
    begin();
    clock.set(true);
    draw();
  };
  const end = () => {
    while (!runs.over) runs.step();
    clock.set(false);
    draw();
  };
  const buttons = [makeButton("Again", again), makeButton(`All ${runs.seconds} s`, end)];
  return {clock, again, end, buttons: [clock.element, ...buttons]};
}

// Lets both bobs of chain(), a Motion of two rods of 1 m, be turned about what they hang on, and
// thrown: put(state) on each move, and before go() once more, with the speed of the hand.
function makeThrowable(stage, chain, put, go) {
  const path = []; // of the hand: when it was where in s, and the direction of the rod it turns
  const stateOf = (k, along, spin) => { // rod k lies along d and turns by so many rad/s
    const [a, b] = chain().points;
    const rods = [unit(a), unit(plus(b, a, -1))];
    rods[k] = along;
    const v = times(across(along), spin);
    const first = k ? [0, 0] : v;
    return [...rods[0], 0, ...plus(...rods), 0, ...first, 0, ...v, 0];
  };
  const turn = k => point => {
    const d = plus(point, k ? chain().point(0) : [0, 0], -1);
    if (size(d) < 0.3 && path[0]) return; // it has no direction there
    path.push([performance.now() / 1000, unit(d)]);
    put(stateOf(k, unit(d), 0));
  };
  const letGo = k => () => {
    const now = performance.now() / 1000;
    const [, d] = path.at(-1);
    const [then, from] = path.find(([when]) => when > now - 0.1) ?? [0, d]; // or it was held still
    const spin = angle(from, d) / Math.max(0.02, now - then);
    path.length = 0;
    put(stateOf(k, d, Math.max(-12, Math.min(12, spin))));
    go();
  };
  for (const k of [0, 1]) stage.hand(`Bob ${k}`, () => chain().point(k), turn(k), letGo(k));
}

// Shows the figure of an address that ends in #figure=NAME, as large as the window; or else all.
function showAlone() {
  const before = document.querySelector(".alone");
  const figure = document.querySelector(`[data-figure="${location.hash.split("figure=")[1]}"]`);
  if (before) turnAlone(before, false);
  if (figure && figure !== before) figure.clock?.set(false); // until somebody has been asked
  if (figure) turnAlone(figure, true);
  else before?.scrollIntoView({block: "center"});
}
function turnAlone(figure, alone) {
  figure.removeAttribute("style");
  figure.classList.toggle("alone", alone);
  document.documentElement.classList.toggle("single", alone);
  const link = figure.querySelector(".lone");
  link.textContent = alone ? "Back to the chapter" : "Alone";
  link.href = alone ? "#" : `#figure=${figure.dataset.figure}`;
  if (!alone) return grown.unobserve(figure);
  const fitsAt = wide => { // how much of the window it then fills
    figure.style.width = `${wide}rem`;
    return scaleOf(figure) ** 2 * figure.offsetWidth * figure.offsetHeight;
  };
  const [wide] = (innerWidth < 700 ? [24] : [46, 56, 66, 76])
    .toSorted((a, b) => fitsAt(b) - fitsAt(a));
  figure.style.width = `${wide}rem`;
  grown.observe(figure);
}
const scaleOf = ({offsetWidth, offsetHeight}) =>
  Math.min(innerWidth / offsetWidth, innerHeight / offsetHeight);
const grown = new ResizeObserver(([{target}]) => { // also when it says more than before
  const scale = target.classList.contains("alone") ? scaleOf(target) : 1;
  const aside = (innerWidth - scale * target.offsetWidth) / 2;
  Object.assign(target.style, {scale, translate: `${aside}px`});
});

function begin() {
  for (const figure of document.querySelectorAll("[data-figure]")) {
    figures[figure.dataset.figure](figure);
  }
  addEventListener("hashchange", showAlone);
  addEventListener("resize", showAlone);
  showAlone();
}
