// The chapter's figures, by the names of the pictures whose places they take. Each fills its own
// with parts; its caption stays, and a hint that says what to do is added to it.
const figures = {};
const {pendulum, double, peaucellier, seed1, impedance} = traced;
const METHODS = double.methods, STEP = double.knobs.dt;
const CIRCLING = [-2.6, -2.5, 2.6, 2.1]; // m: all that a double pendulum reaches

const inkOf = method => `m${METHODS.indexOf(method)}`;
const elements = parts => parts.map(part => part.element ?? part);
const controls = (...parts) => row("controls", ...elements(parts));
const panels = (...stages) => row("panels", ...elements(stages));
const tiles = stages => row("panels many", ...elements(stages));
const drawAll = (...stages) => stages.forEach(stage => stage.draw());
const pageOf = scene => make("a", {href: `pictures/${scene}.html`, textContent: "Its own page"});
const symbol = (name, text = name) => `<var class="${name}">${text}</var>`;
const worst = run => largest(run.errors); // m

function fill(figure, hint, ...parts) {
  const caption = figure.querySelector("figcaption");
  caption.append(" ", make("b", {textContent: hint}));
  figure.replaceChildren(...elements(parts), caption);
}

function makeStage(label, height, box, paint, ...more) { // so many rem high, above what it `says`
  const stage = new Stage(label, box, paint, ...more);
  stage.canvas.style.height = `${height}rem`;
  stage.says = row("says");
  stage.element.append(stage.says);
  return stage;
}

// The stage of which(), one of several runs: its method, and why it is lost or else words(run).
function makeTile(label, height, box, which, words, also = () => {}) {
  return makeStage(label, height, box, tile => {
    const run = which(), name = make("b", {textContent: run.method, className: inkOf(run.method)});
    if (!run.lost) tile.system(run);
    also(tile, run);
    tile.says.replaceChildren(name, " ", run.lost ?? words(run));
  });
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
  }, [52, 24, 14, 12], true);
}

// The reader picks an answer before begin() lets the figure run; reveal() says which it was.
function makePrediction(question, answers, right, begin) {
  const verdict = make("p", {className: "verdict"});
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
  };
  const asked = make("p", {textContent: question});
  return {element: row("prediction", asked, row("controls", ...buttons), verdict), reveal};
}

class Runs { // a scene under several methods, side by side, and of each a curve of what is noted
  constructor(scene, methods, seconds, noted) {
    Object.assign(this, {scene, methods, seconds, noted}).begin();
  }
  begin(settings = {}, starts = []) {
    this.knobs = Motion.knobs(this.scene, settings);
    this.time = 0;
    this.each = this.methods.map((method, k) => {
      const motion = new Motion(this.scene, method, this.knobs);
      motion.begin(starts[k]);
      return Object.assign(motion, {curve: [], most: 0});
    });
    this.note();
  }
  get going() { return this.each.filter(({lost}) => !lost); }
  step() {
    this.time += this.knobs.dt;
    for (const run of this.going) {
      try {
        run.step();
        if (!(worst(run) < run.far)) throw new Error("diverged");
      } catch ({message}) {
        run.lost = `lost at ${fixed(this.time, 1)} s: ${message}`;
      }
    }
    this.note();
  }
  note() {
    for (const run of this.going) {
      run.now = this.noted(run, this.each);
      run.most = Math.max(run.most, Math.abs(run.now));
      if (this.time >= 0.02 * run.curve.length) run.curve.push([this.time, run.now]);
    }
  }
  get over() { return this.time > this.seconds - this.knobs.dt / 2; }
}

// The clock of runs; again(), which begins anew; and buttons for both, and to go to the end.
function makeRunner(figure, runs, begin, draw) {
  const clock = new Clock(figure, () => runs.knobs.dt, () => {
    if (runs.over) begin();
    runs.step();
    if (runs.over) clock.set(false);
  }, draw);
  const again = () => {
    begin();
    clock.set(true);
    draw();
  };
  const end = makeButton(`All ${runs.seconds} s`, () => {
    while (!runs.over) runs.step();
    clock.set(false);
    draw();
  });
  return {clock, again, buttons: [clock.element, makeButton("Again", again), end]};
}

figures.question = figure => {
  const bob = new Motion(pendulum, "project", Motion.knobs(pendulum, {dt: 0.0005}));
  const perNewton = 0.03; // m
  let start, most, held = false;
  const stage = makeStage("A bob on its rod", 25, [-1.3, -1.45, 1.3, 1.1], () => {
    const d = bob.point(0), [pull] = bob.measure("tensions"), [x, y] = across(unit(d));
    stage.circle([0, 0], 1, "quiet");
    if (rod.checked) {
      stage.system(bob);
      stage.arrow(d, times(unit(d), -pull * perNewton), "lambda");
      stage.words(`${fixed(pull, 1)} N`, times(d, 0.5), "lambda", [38 * x, 18 * y]);
    } else {
      stage.disc([0, 0], 5, "quiet");
      stage.disc(d, 8);
    }
    stage.arrow(d, [0, -9.81 * perNewton], "quiet");
    stage.words("9.8 N", plus(d, [0, -9.81], perNewton), "quiet", [0, -14]);
    const hangs = held ? "Now let it go." : `The hardest pull so far: ${fixed(most, 2)} N.`;
    stage.says.textContent = rod.checked ? hangs : "Nothing holds it: it falls.";
  });
  const put = point => {
    start = rod.checked ? unit(point) : point;
    bob.begin([...start, 0, 0, 0, 0]);
    most = 0;
  };
  const fall = () => {
    const {state, knobs: {dt}} = bob, [, weight] = bob.measure("weight", 2); // of 1 kg
    state[4] += dt * weight;
    state[0] += dt * state[3];
    state[1] += dt * state[4];
    if (state[1] < -4) put(start); // it fell out of sight, and falls once more
  };
  const clock = new Clock(figure, () => bob.knobs.dt, () => {
    if (held) return;
    if (rod.checked) bob.step();
    else fall();
    most = Math.max(most, bob.measure("tensions")[0]);
  }, () => stage.draw());
  const from = point => {
    put(point);
    clock.set(true);
  };
  const onchange = () => from(rod.checked ? start : bob.point(0));
  const rod = make("input", {type: "checkbox", checked: true, onchange});
  stage.hand("The bob: drag it, or use the arrow keys and Enter", () => bob.point(0), point => {
    if (size(point) < 0.05) return; // the rod would have no direction
    held = true;
    put(point);
    stage.draw();
  }, () => {
    held = false;
    clock.set(true);
  });
  put([1, 0]);
  const level = makeButton("Let go level", () => from([1, 0]));
  fill(figure, "Drag the bob and let it go. Then take the rod away.",
    stage, controls(clock, level, make("label", {}, rod, "with the rod")));
};

figures.tangent = figure => {
  const bob = new Motion(pendulum, "none", Motion.knobs(pendulum)), perSpeed = 0.6; // m for 1 m/s
  let d = [0.66, -0.88], v = [0.9, 0.3];
  const stage = makeStage("A bob and its velocity", 22, [-1.3, -1.65, 1.7, 0.4], () => {
    bob.begin([...d, 0, ...v, 0]);
    const [[g], [gdot], [error]] = ["g", "gdot", "errors"].map(name => bob.measure(name));
    const along = unit(d), aside = across(along), tip = plus(d, v, perSpeed);
    const grows = times(along, perSpeed * dot(v, along)); // what v has along the rod
    stage.circle([0, 0], 1, "quiet");
    stage.line([plus(d, aside), plus(d, aside, -1)], "pale", 1); // where gdot is 0
    stage.system(bob, "d", "ink");
    stage.line([tip, plus(d, grows)], "quiet", 1, [3, 4]);
    if (Math.abs(gdot) > 1e-9) stage.arrow(d, grows, gdot > 0 ? "long" : "short");
    stage.arrow(d, times(v, perSpeed), "v");
    stage.symbol("v", tip, "v", times(unit(v), 16));
    stage.symbol("d", times(along, 0.5), "d", times(aside, 16));
    const off = `${metric(Math.abs(error))} too ${error > 0 ? "long" : "short"}`;
    const now = Math.abs(error) < 5e-5 ? "right" : off;
    const then = Math.abs(gdot) < 5e-4 ? "stays so" : gdot > 0 ? "grows" : "shrinks";
    const [x, y, vx, vy] = [...d, ...v].map(each => fixed(each, 2)), rate = fixed(gdot, 3);
    stage.says.innerHTML = `<p class="whole">The rod is ${now}, and ${then}.</p>
      <p>${symbol("d")} = (${x}, ${y}) m<br>${symbol("g")} = ${fixed(g, 3)} m²</p>
      <p>${symbol("v")} = (${vx}, ${vy}) m/s<br>${symbol("gdot", "ġ")} = ${rate} m²/s</p>`;
  });
  stage.hand("The bob", () => d, point => {
    const near = Math.abs(size(point) - 1) < 0.03 ? unit(point) : point; // so that zero is zero
    if (size(near) > 0.05) d = near;
    stage.draw();
  });
  stage.hand("The tip of the velocity", () => plus(d, v, perSpeed), point => {
    v = times(plus(point, d, -1), 1 / perSpeed);
    const tangent = across(unit(d)), slides = dot(v, tangent);
    if (Math.abs(dot(v, unit(d))) < 0.06 * Math.abs(slides)) v = times(tangent, slides);
    stage.draw();
  });
  fill(figure, "Drag the bob, and the tip of its velocity.", stage);
};

figures.jacobian = figure => {
  const rods = new Motion(double, "project", Motion.knobs(double)), colors = ["rod0", "rod1"];
  let held = false;
  const head = ["x0", "y0", "x1", "y1"].map(([x, k]) => `<th><var>${x}</var><sub>${k}</sub></th>`);
  const cell = x => `<td style="--share: ${Math.round(40 * Math.abs(x))}%">${fixed(x, 2)}</td>`;
  const stage = makeStage("A double pendulum", 19, [-2.15, -2.15, 2.15, 0.6], () => {
    const points = [[0, 0], ...rods.points], jacobian = rods.measure("jacobian", 12);
    const lines = colors.map((color, k) => {
      const [from, to] = points.slice(k), along = plus(to, from, -1);
      stage.arrow(from, times(along, 0.94), color, 5);
      stage.words(`rod ${k}`, times(plus(from, to), 0.5), color, times(across(unit(along)), 30));
      const entries = [0, 1, 3, 4].map(j => cell(jacobian[6 * k + j])); // without the z axis
      return `<tr class="${color}"><th>rod ${k}</th>${entries.join("")}</tr>`;
    });
    stage.disc([0, 0], 5, "quiet");
    rods.points.forEach((point, k) => {
      stage.disc(point, 10);
      stage.words(k, point, "paper");
    });
    stage.says.innerHTML = `<table class="jacobian">
      <tr><th><var>J</var></th>${head.join("")}</tr>${lines.join("")}</table>`;
  });
  const clock = new Clock(figure, () => STEP, () => held || rods.step(), () => stage.draw());
  clock.set(false);
  [0, 1].forEach(k => stage.hand(`Bob ${k}`, () => rods.point(k), point => {
    held = true; // rods keep their lengths: bob 0 turns about the anchor, bob 1 about bob 0
    const [a, b] = rods.points, turned = unit(plus(point, k ? a : [0, 0], -1));
    if (size(turned) < 0.5) return; // it has no direction there
    const first = k ? a : turned, second = plus(first, k ? turned : plus(b, a, -1));
    rods.begin([...first, 0, ...second, 0, 0, 0, 0, 0, 0, 0]);
    stage.draw();
  }, () => { held = false; }));
  rods.begin([0.6, -0.8, 0, 1.56, -1.08, 0, 0, 0, 0, 0, 0, 0]);
  fill(figure, "Drag the bobs, or let them swing.", stage, controls(clock));
};

figures.drift = figure => {
  const seconds = 0.7, ends = new Map(); // of each step that was taken to the end: where, and g
  const bob = new Motion(pendulum, "none", Motion.knobs(pendulum));
  let places, squares, ready = false;
  const stage = makeStage("Steps of a bob", 23, [-1.55, -1.42, 1.55, 0.15], () => {
    const n = places.length - 1, [was, now] = places.slice(-2);
    stage.circle([0, 0], 1, "quiet");
    for (const [step, {end}] of ends) {
      if (step === dt.value()) continue;
      stage.rod([0, 0], end, 1, "pale", 3);
      stage.words(`${step} s`, end, "quiet", [-14, 0], "right");
    }
    for (const place of places) stage.line([[0, 0], place], "pale", 1);
    stage.line(places, "v");
    if (n) {
      const inward = times(unit(was), -0.09), onward = times(unit(plus(now, was, -1)), 0.09);
      const corner = [plus(was, inward), plus(plus(was, inward), onward), plus(was, onward)];
      stage.line(corner, "quiet", 1); // it is right: that is all there is to drift
      stage.line([[0, 0], was], "d", 2.5);
      stage.line([was, now], "v", 4);
      const middle = times(plus(was, now), 0.5);
      if (dt.value() > 0.03) stage.symbol("dt v", middle, "v", times(unit(middle), 22));
    }
    stage.system(bob);
    const [g] = bob.measure("g");
    stage.says.innerHTML = `<p>after ${n} steps ${symbol("g")} = ${fixed(g, 6)} m²</p>
      <p>½ Σ (<var>dt</var> ${symbol("v")})² = ${fixed(0.5 * squares, 6)} m²</p>`;
  });
  const allow = allowed => [one, all].forEach(button => { button.disabled = !allowed; });
  const begin = () => {
    bob.begin([1, 0, 0, 0, 0, 0]);
    [places, squares] = [[[1, 0]], 0];
    allow(ready);
    stage.draw();
  };
  const take = () => { // a step; whether it was the last one
    bob.step(dt.value());
    places.push(bob.point(0));
    squares += (dt.value() * size(bob.state.slice(3))) ** 2;
    if (bob.time < seconds - 1e-9) return false;
    allow(false);
    ends.set(dt.value(), {end: bob.point(0), g: bob.measure("g")[0]});
    const found = [...ends].sort(([a], [b]) => b - a).map(
      ([step, {g}]) => `${fixed(g, 3)} m² in steps of ${step} s`);
    if (found.length > 1) prediction.reveal(`it halves. In the end g is ${found.join(", ")}.`);
    return true;
  };
  const one = makeButton("One step", () => {
    take();
    stage.draw();
  });
  const all = makeButton(`All ${seconds} s`, () => {
    while (!take());
    stage.draw();
  });
  const dt = makeSlider("step", [0.1, 0.05, 0.025], 0, x => `${x} s`, begin);
  const answers = ["it stays", "it halves", "it falls to a quarter"];
  const question = "If you halve the step, what happens to the error?";
  const prediction = makePrediction(question, answers, "it halves", () => {
    ready = true;
    begin();
  });
  fill(figure, "Take one step at a time to the end, then halve the step.",
    prediction, stage, controls(one, all, makeButton("Again", begin), dt));
  begin();
};

figures.two_methods = figure => {
  const runs = new Runs(double, ["none", "baumgarte"], 20, worst);
  const words = ({now, most}) => `worst rod off by ${metric(now)}, at most ${metric(most)}`;
  const stages = runs.methods.map((method, k) =>
    makeTile(`A double pendulum, ${method}`, 13, CIRCLING, () => runs.each[k], words));
  const plot = makePlot("The worst rod error over 20 s", distances, () => runs.each.map(
    ({method, curve}) => ({color: inkOf(method), points: curve, words: method})));
  const choices = [0.0025, 0.005, 0.01, 0.02, 0.04, 0.05];
  const dt = makeSlider("step", choices, 1, x => `${1000 * x} ms`, () => runner.again());
  const runner = makeRunner(figure, runs, () => runs.begin({dt: dt.value()}),
    () => drawAll(...stages, plot));
  fill(figure, "Make the step longer.", tiles(stages), plot, controls(...runner.buttons, dt));
};

figures.cliff = figure => {
  const steps = 30, mm = 1e-3, color = inkOf("baumgarte"), {limit} = pendulum;
  const bob = new Motion(pendulum, "baumgarte", Motion.knobs(pendulum));
  const errors = () => { // in m, after each step of a bob at rest on a rod that is 1 mm too long
    bob.knobs.baumgarte = z.value() / STEP;
    bob.begin([0, -1 - mm, 0, 0, 0, 0]);
    return Array.from({length: steps + 1}, (_, k) => {
      if (k) bob.step();
      return bob.errors[0];
    });
  };
  const last = found => Math.abs(found.at(-1));
  const tried = new Map(); // the last error, of each z
  const chart = makeChart("The error of the rod after each step", 15, [-1, -1.3, steps + 1, 1.3],
    [[1, "1 mm"], [0, "0"], [-1, "−1 mm"]], [[10, "10"], [20, "20"], [29.4, "30 steps"]], () => {
      const found = errors(), end = last(found) < 1 ? metric(last(found)) : "over a metre";
      found.forEach((error, k) => {
        const at = [k, Math.max(-1.3, Math.min(1.3, error / mm))];
        chart.line([[k, 0], at], color, 2.5);
        if (at[1] === error / mm) chart.disc(at, 3.5, color);
      });
      const rings = found.some(error => error < -0.01 * mm);
      const kind = z.value() > limit ? "explodes" : rings ? "rings" : "decays";
      chart.says.textContent = `It ${kind}: after ${steps} steps it is ${end}.`;
    });
  const height = error => Math.max(-9, Math.min(1, Math.log10(error)));
  const cliff = makeChart(`The error after ${steps} steps, over dt w`, 15, [0, -9.5, 1, 1.3],
    [[0, "1 m"], [-3, "1 mm"], [-6, "1 µm"], [-9, "1 nm"]],
    [[0.2, "0.2"], [0.4, "0.4"], [0.6, "0.6"], [0.96, "dt w"]], () => {
      cliff.line([[limit, -9.5], [limit, 1.3]], "long", 1.5, [4, 5]);
      cliff.words(fixed(limit, 3), [limit, -9.5], "long", [0, -12]);
      for (const [x, error] of tried) cliff.disc([x, height(error)], 2.5, color);
      cliff.disc([z.value(), height(last(errors()))], 6, color);
      cliff.says.textContent = "The same last error, for every spring tried.";
    });
  const values = Array.from({length: 96}, (_, k) => (k + 5) / 100);
  const z = makeSlider("dt w", values, 5, x => fixed(x, 2), x => {
    tried.set(x, last(errors()));
    const told = `it dies sooner, then later again, and past ${fixed(limit, 3)} it explodes.`;
    if (x > limit) prediction.reveal(told);
    drawAll(chart, cliff);
  });
  z.input.disabled = true;
  const question = "A rod is 1 mm too long. Make the spring stiffer and stiffer: what happens?";
  const right = "at some point it explodes";
  const answers = ["the error dies ever sooner", "a small error stays", right];
  const prediction = makePrediction(question, answers, right, () => z.input.disabled = false);
  fill(figure, "Make the spring stiffer.", prediction, panels(chart, cliff), controls(z));
};

figures.energy = figure => {
  const first = new Motion(double, "none", Motion.knobs(double)).energy;
  const runs = new Runs(double, METHODS, 20, run => run.energy - first);
  let chosen = 0;
  const words = ({now, most}) => (
    `energy changed by ${now > 0 ? "+" : ""}${perCent(now)}, at most by ${perCent(most)} of m g L`);
  const stage = makeTile("A double pendulum", 13, CIRCLING, () => runs.each[chosen], words);
  const curve = ({method, curve}, k) => (
    {color: inkOf(method), points: curve, words: method, dash: k === chosen ? undefined : [2, 4]});
  const plot = makePlot("Energy over 20 s", shares, () => runs.each.map(curve));
  const draw = () => {
    buttons.forEach((button, k) => { button.ariaPressed = k === chosen; });
    drawAll(stage, plot);
  };
  const buttons = METHODS.map((method, k) => makeButton(method, () => {
    chosen = k;
    draw();
  }));
  const runner = makeRunner(figure, runs, () => runs.begin(), draw);
  runner.clock.speed = 4;
  fill(figure, "Choose a method.", controls(...buttons), stage, plot, controls(...runner.buttons));
  draw();
};

figures.soft = figure => {
  const grown = 5, color = inkOf("soft");
  const bobs = new Motion(double, "soft", Motion.knobs(double, {time_constant: 0.1}));
  bobs.begin([0, -1, 0, 0, -2, 0, 0, 0, 0, 0, 0, 0]);
  const rule = T => (1 - impedance) * T * T * 9.81 * (1 + load.value());
  const tried = new Map(); // the stretch at rest, of each time constant
  const stage = makeStage("Two bobs at rest on soft rods", 17, [-1.6, -3.1, 1.6, 0.15], () => {
    const errors = bobs.errors, bottom = -2 - grown * (errors[0] + errors[1]);
    const at = [[0, 0], [0, -1 - grown * errors[0]], [0, bottom]];
    errors.forEach((error, k) => {
      const [from, to] = at.slice(k), kilos = k ? load.value() : 1, radius = 6 + 3 * kilos;
      stage.rod(from, to, 1, "ink", 4);
      stage.disc(to, radius);
      stage.words(`+${metric(error)}`, times(plus(from, to), 0.5), "long", [16, 0], "left");
      stage.words(`${kilos} kg`, to, "quiet", [radius + 10, 0], "left");
    });
    stage.disc([0, 0], 5, "quiet");
    stage.says.textContent = `Each is ${metric(errors[0])} too long, drawn ${grown} times as much.`;
  });
  const chart = makeChart("The stretch over the time constant", 17, [0, 0, 0.22, 0.085],
    [0, 2, 4, 6, 8].map(cm => [cm / 100, `${cm} cm`]),
    [50, 100, 150, 200].map(ms => [ms / 1000, `${ms} ms`]), () => {
      const Ts = Array.from({length: 41}, (_, k) => k * 0.005);
      chart.line(Ts.map(T => [T, rule(T)]), "quiet", 1.5, [2, 5]);
      for (const at of tried) chart.disc(at, 3.5, color);
      chart.disc([T.value(), bobs.errors[0]], 6, color);
      const factor = `9.81 · ${1 + load.value()}`;
      chart.says.innerHTML = `<p>Dashed: (1 − <var>p</var>) <var>T</var>² ${factor}</p>`;
    });
  const changed = () => {
    if (bobs.knobs.mass !== load.value()) tried.clear();
    Object.assign(bobs.knobs, {time_constant: T.value(), mass: load.value()});
    clock.set(true);
  };
  const choices = [0.02, 0.05, 0.1, 0.15, 0.2];
  const T = makeSlider("time constant", choices, 2, x => `${1000 * x} ms`, changed);
  const load = makeSlider("lower bob", [1, 2, 3], 0, x => `${x} kg`, changed);
  const clock = new Clock(figure, () => STEP, () => {
    bobs.step();
    if (largest(bobs.state.slice(6)) > 1e-6) return;
    tried.set(T.value(), bobs.errors[0]); // it is at rest
    clock.set(false);
  }, () => drawAll(stage, chart));
  fill(figure, "Double the time constant, then the load.", panels(stage, chart), controls(T, load));
};

figures.flat_pose = figure => {
  const right = peaucellier.start[9]; // m: the last joint stays at this x
  const off = run => run.point(3)[0] - right, isOff = run => run.most > 0.05;
  const runs = new Runs(peaucellier, peaucellier.methods, 5, off);
  const words = run => (isOff(run) ? `${metric(Math.abs(run.now))} off its line` : "on its line");
  const lines = (tile, run) => {
    const joint = run.point(3);
    tile.line([[right, -4.3], [right, 2.6]], "quiet", 1, [2, 5]);
    if (isOff(run)) tile.line([joint, [right, joint[1]]], "lambda", 3, [1, 6]);
  };
  const stages = runs.methods.map((method, k) => makeTile(`Peaucellier's linkage, ${method}`, 11,
    [-0.3, -4.3, 4.9, 2.6], () => runs.each[k], words, lines));
  const runner = makeRunner(figure, runs, () => runs.begin(), () => drawAll(...stages));
  fill(figure, "The last joint of this linkage should stay on the dashed line.",
    tiles(stages), controls(...runner.buttons, pageOf("peaucellier")));
};

figures.chaos = figure => {
  const turned = angle => double.start.map((x, k, all) => { // x, y and z in turn
    const [cosine, sine] = [Math.cos(angle), Math.sin(angle)];
    return [cosine * x - sine * all[k + 1], sine * all[k - 1] + cosine * x, x][k % 3];
  });
  const starts = new Map([["none", double.start], ["10⁻¹² rad", turned(1e-12)],
    ["10⁻⁹ rad", turned(1e-9)], ["10⁻⁶ rad", turned(1e-6)], ["0.001 rad", turned(0.001)],
    ["seeds 0, 1", seed1]]);
  let numbers = 0, same = 0;
  const runs = new Runs(double, ["baumgarte", "baumgarte"], 20, (run, [first]) => {
    const seen = [...run.state.keys()].filter(k => run !== first && k % 3 < 2); // without z
    numbers += seen.length;
    same += seen.filter(k => Object.is(run.state[k], first.state[k])).length;
    return size(plus(run.point(1), first.point(1), -1));
  });
  const stage = makeStage("Two double pendulums", 15, CIRCLING, () => {
    const [first, second] = runs.each;
    const [few, all] = [same, numbers].map(count => count.toLocaleString("en"));
    stage.system(second, "m1");
    stage.system(first);
    stage.says.innerHTML = `<p class="whole">The tips are ${metric(second.now)} apart.</p>
      <p>${few} of ${all} numbers have the same 64 bits.</p>`;
  });
  const plot = makePlot("How far apart the tips are, over 20 s", decades,
    () => [{color: "m1", points: runs.each[1].curve}]);
  const difference = makeSlider("difference", [...starts.keys()], 4, x => x, () => runner.again());
  const begin = () => {
    numbers = same = 0;
    runs.begin({}, [double.start, starts.get(difference.value())]);
  };
  const runner = makeRunner(figure, runs, begin, () => drawAll(stage, plot));
  begin();
  fill(figure, "Make the difference smaller, and then none.",
    stage, plot, controls(...runner.buttons, difference));
};

figures.tiles = figure => {
  const runs = new Runs(double, METHODS, Infinity, worst);
  const string = (tile, run) => {
    const {hand, pulls} = runs.knobs;
    if (pulls[1]) tile.line([run.point(1), hand], "quiet", 1.5, [2, 4]);
  };
  const stages = METHODS.map((method, k) => makeTile(`A double pendulum, ${method}`, 11, CIRCLING,
    () => runs.each[k], ({now}) => `off by ${metric(now)}`, string));
  stages.forEach((tile, k) => tile.hand(`The lower bob of ${METHODS[k]}: pull it`,
    () => (runs.knobs.pulls[1] ? runs.knobs.hand : runs.each[k].point(1)), point => {
      Object.assign(runs.knobs, {hand: point, pulls: [0, 60]}); // N/m
      runner.clock.set(true);
    }, () => { runs.knobs.pulls = [0, 0]; }));
  const choices = [0.0025, 0.005, 0.01, 0.02, 0.04];
  const dt = makeSlider("step", choices, 1, x => `${1000 * x} ms`, () => runner.again());
  const runner = makeRunner(figure, runs, () => runs.begin({dt: dt.value()}),
    () => drawAll(...stages));
  const [play, again] = runner.buttons;
  fill(figure, "Pull at a bob: all five feel it.",
    tiles(stages), controls(play, again, dt, pageOf("double")));
};

for (const figure of document.querySelectorAll("[data-figure]")) {
  figures[figure.dataset.figure](figure);
}
