// The chapter's figures, by the names of the pictures whose places they take. Each fills its own
// with parts; its caption stays, and a hint that says what to do is added to it. The picture stays
// for the printer.
const figures = {};
const {pendulum, double, peaucellier, seed1} = traced;
const STEP = double.knobs.dt;
const CIRCLING = [-2.6, -2.5, 2.6, 2.1]; // m: all that a double pendulum reaches
const STILL = matchMedia("(prefers-reduced-motion: reduce)").matches;

const inkOf = method => `m${double.colors[method]}`;
const nameOf = method => make("b", {textContent: method, className: inkOf(method)});
const elements = parts => parts.map(part => part.element ?? part);
const controls = (...parts) => row("controls", ...elements(parts));
const panels = (...stages) => row("panels", ...elements(stages));
const tiles = stages => row("panels many", ...elements(stages));
const drawAll = (...stages) => stages.forEach(stage => stage.draw());
const symbol = (name, text = name) => `<var class="${name}">${text}</var>`;
const pair = ([x, y]) => `(${fixed(x, 2)}, ${fixed(y, 2)})`;
const angle = (a, b) => Math.atan2(dot(across(a), b), dot(a, b)); // from a to b
const turned = ([x, y], by) => plus(times([x, y], Math.cos(by)), [-y, x], Math.sin(by));
function offBy(error) { // of a rod in m, in words
  if (Math.abs(error) < 5e-7) return "right";
  return `${metric(Math.abs(error))} too ${error > 0 ? "long" : "short"}`;
}
const arc = (at, d, from, to) => Array.from({length: 41}, // d from `at`, turned from angle to angle
  (_, k) => plus(at, turned(d, from + (to - from) * k / 40)));

function fill(figure, hint, ...parts) {
  const caption = figure.querySelector("figcaption"), picture = figure.querySelector("img");
  caption.append(" ", make("b", {textContent: hint}));
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

figures.double = figure => {
  const runs = new Runs(double, double.methods, 20, run => {
    run.worst = Math.max(run.worst ?? 0, largest(run.errors));
    return run.worst;
  });
  const stages = runs.methods.map((method, k) =>
    makeStage(`A double pendulum, ${method}`, 11, CIRCLING, tile => {
      const run = runs.each[k], far = `off by ${metric(run.worst)}`;
      if (!run.lost) tile.system(run, inkOf(method));
      tile.says.replaceChildren(nameOf(method), run.lost ?? far);
    }));
  stages[0].canvas.style.height = "min(27rem, 80vw)";
  const time = make("output");
  const runner = makeRunner(figure, runs, () => runs.begin(), () => {
    drawAll(...stages);
    time.value = `${fixed(runs.time, 1)} s`;
  });
  while (!STILL && runs.time < 10) runs.step(); // so that the first frame shows what is to see
  if (STILL) runner.end();
  const lead = row("lead", ...elements(stages)); // the first is as large as four of the others
  lead.style.setProperty("--columns", 2 + Math.ceil((stages.length - 1) / 2));
  fill(figure, "Red: too long. Below each: its worst rod so far. Again lets them go once more.",
    lead, controls(...runner.buttons, time));
};

figures.question = figure => {
  const bob = new Motion(pendulum, "project", Motion.knobs(pendulum, {dt: 0.0005}));
  const perNewton = 0.03; // m
  let most, held = false;
  const stage = makeStage("A bob on its rod", 19, [-1.2, -1.45, 1.2, 1.1], () => {
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
    bob.begin([...(rod.checked ? unit(point) : point), 0, 0, 0, 0]);
    most = 0;
  };
  const fall = () => {
    const {state, knobs: {dt}} = bob, [, weight] = bob.measure("weight", 2); // of 1 kg
    state[4] += dt * weight;
    state[1] += dt * state[4];
    if (state[1] < -4) put([1, 0]); // it fell out of sight, and falls once more
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
  const rod = make("input",
    {type: "checkbox", checked: true, onchange: () => from(bob.point(0))});
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
  const stage = makeStage("A bob and its velocity", 20, [-1.3, -1.65, 1.7, 0.3], () => {
    bob.begin([...d, 0, ...v, 0]);
    const [[g], [gdot], [error]] = ["g", "gdot", "errors"].map(name => bob.measure(name));
    const along = unit(d), aside = across(along), tip = plus(d, v, perSpeed);
    const grows = times(along, perSpeed * dot(v, along)); // what v has along the rod
    stage.circle([0, 0], 1, "quiet");
    stage.line([plus(d, aside), plus(d, aside, -1)], "pale", 1); // where gdot is 0
    stage.system(bob, "d", "ink");
    stage.line([tip, plus(d, grows)], "quiet", 1, [3, 4]);
    stage.line([d, plus(d, grows)], "v", 3, [5, 6]);
    stage.arrow(d, times(v, perSpeed), "v");
    stage.symbol("v", tip, "v", times(unit(v), 16));
    stage.symbol("d", times(along, 0.5), "d", times(aside, 16));
    const then = Math.abs(gdot) < 5e-4 ? "stays so" : gdot > 0 ? "grows" : "shrinks";
    stage.says.innerHTML = `<p class="whole">The rod is ${offBy(error)}, and ${then}.</p>
      <p>${symbol("d")} = ${pair(d)} m<br>${symbol("g")} = ${fixed(g, 3)} m²</p>
      <p>${symbol("v")} = ${pair(v)} m/s<br>${symbol("g", "ġ")} = ${fixed(gdot, 3)} m²/s</p>`;
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

figures.solve = figure => {
  const rods = new Motion(double, "project", Motion.knobs(double)), perNewton = 0.025; // m
  const hangs = [0, -1, 0, 0, -2, 0], level = [1, 0, 0, 2, 0, 0], rest = [0, 0, 0, 0, 0, 0];
  const name = (letter, k) => symbol(letter, letter + "₀₁"[k]);
  const cells = numbers => numbers.map(x => `<mtd><mn>${fixed(x, 2)}</mn></mtd>`).join("");
  const matrix = (letter, ...rows) => `<munder class="${letter}"><mrow><mo>(</mo><mtable>
    ${rows.map(row => `<mtr>${cells(row)}</mtr>`).join("")}</mtable><mo>)</mo></mrow>
    <mi>${letter}</mi></munder>`;
  let drawn = 0, told; // the numbers: those that change at each frame cannot be read
  const stage = makeStage("Two bobs on their rods", 26, [-2.1, -2.3, 2.1, 1.3], () => {
    const [a, b] = rods.points, d = [a, plus(b, a, -1)], bend = angle(...d);
    const v = [6, 9].map(k => Array.from(rods.state.slice(k, k + 2)));
    const lambda = rods.measure("lambda", 2);
    if (!clock.going || drawn % 6 === 0) told = tell(v, lambda);
    drawn += 1;
    const away = unit(plus(plus(d[0], d[1], -1), across(d[0]), 0.1)); // from rods at bob 0
    stage.system(rods, "quiet", "ink");
    stage.line([a, plus(a, d[0], 0.6)], "A", 1.5, [3, 5]);
    stage.line(arc(a, times(d[0], 0.45), 0, bend), "A");
    stage.words(told, a, "A", times(away, 34));
    for (const [k, from, sign] of [[0, a, 1], [1, a, -1], [1, b, 1]]) {
      stage.arrow(from, times(d[k], sign * lambda[k] * perNewton), "lambda");
    }
    d.forEach((along, k) => {
      const aside = times(across(along), dot(across(along), away) > 0 ? -20 : 20);
      const place = plus(rods.point(k - 1), along, 0.7); // apart, even if the rods are folded
      stage.symbol("λ" + "₀₁"[k], place, "lambda", aside);
    });
    rods.points.forEach((point, k) => stage.arrow(point, times(v[k], 0.15), "v", 2));
  });
  const tell = (v, lambda) => { // and returns what stands beside the bob
    const [jac, A, right] = ["J", "A", "b"].map(x => rods.measure(x, 12));
    const felt = Math.abs(A[1]) < 0.02 ? "At a right angle neither rod feels the other."
      : `Rod 0 feels so much of ${name("λ", 1)}, and rod 1 of ${name("λ", 0)}.`;
    const rows = [0, 6].map(row => [0, 1, 3, 4].map(k => jac[row + k])); // without the z axis
    stage.says.innerHTML = `<math display="block"><mrow>${matrix("J", ...rows)}</mrow></math>
      <math display="block"><mrow>
      ${matrix("A", A.slice(0, 2), A.slice(2, 4))}${matrix("λ", ...lambda.map(x => [x]))}
      <mo>=</mo>${matrix("b", ...right.slice(0, 2).map(x => [x]))}</mrow></math>
      <p class="whole"><b class="A">${fixed(A[1], 2)}</b> = −${name("d", 0)} · ${name("d", 1)} /
      <var>m</var>₀. ${felt}</p>
      <p>${name("v", 0)} = ${pair(v[0])}, ${name("v", 1)} = ${pair(v[1])} m/s</p>`;
    return fixed(A[1], 2);
  };
  const path = []; // of the hand: when it was where in s, and the direction of the rod it turns
  const clock = new Clock(figure, () => STEP, () => path[0] || rods.step(), () => stage.draw());
  clock.set(false);
  const put = (k, d, spin) => { // rod k lies along d and turns by so many rad/s
    const [a, b] = rods.points, [first, last] = k ? [a, plus(a, d)] : [d, plus(d, plus(b, a, -1))];
    const v = times(across(d), spin), still = [0, 0];
    rods.begin([...first, 0, ...last, 0, ...(k ? still : v), 0, ...v, 0]);
    stage.draw();
  };
  [0, 1].forEach(k => stage.hand(`Bob ${k}`, () => rods.point(k), point => {
    const d = plus(point, k ? rods.point(0) : [0, 0], -1);
    if (size(d) < 0.3 && path[0]) return; // it has no direction there
    path.push([performance.now() / 1000, unit(d)]);
    put(k, unit(d), 0);
  }, () => {
    const now = performance.now() / 1000, [, d] = path.at(-1);
    const [then, from] = path.find(([when]) => when > now - 0.1) ?? [0, d]; // or it was held still
    const spin = angle(from, d) / Math.max(0.02, now - then);
    put(k, d, Math.max(-12, Math.min(12, spin)));
    path.length = 0;
    clock.set(true);
  }));
  const begin = (start, going) => () => {
    rods.begin([...start, ...rest]);
    clock.set(going);
    stage.draw();
  };
  begin(hangs, false)();
  fill(figure, "Drag a bob, and throw it.", stage, controls(clock,
    makeButton("Hang", begin(hangs, false)), makeButton("Let go level", begin(level, true))));
};

figures.drift = figure => {
  const seconds = 0.7, loupe = 0.32, curves = new Map(); // s; m each way; [s, g] of each step tried
  const bob = new Motion(pendulum, "none", Motion.knobs(pendulum));
  const parts = [ // of a step, then of all: what is seen, and what comes next
    ["The step goes dt v along the tangent, at a right angle to the rod.", "Then the circle"],
    ["The circle on which the rod would keep its length bends away.", "Then the wedge"],
    ["So the rod grows: its square by that of dt v, and g by half of it.", "Next step"],
    ["Each step adds its wedge, and nothing takes it back.", "Next step"],
  ];
  let places, squares, part;
  const paint = stage => {
    const [was, now] = places.slice(-2), step = plus(now, was, -1), turn = angle(was, now);
    const before = part < 2 ? places.slice(0, -1) : places;
    stage.circle([0, 0], 1, "quiet");
    for (const place of before.slice(0, -1)) stage.line([[0, 0], place], "pale", 1);
    stage.line(places, "v", 1.5);
    if (part > 1) {
      for (let share = 0; share <= 1; share += 1 / 64) { // what the step adds
        const outside = plus(was, step, share);
        stage.line([times(unit(outside), size(was)), outside], "long", 3);
      }
    }
    for (const place of before) stage.line([unit(place), place], "long", 2); // in all
    if (part > 0) stage.line(arc([0, 0], was, -turn, 2 * turn), "ink", 1.5, [1, 5]);
    stage.line([[0, 0], before.at(-1)], "d", 3);
    stage.arrow(was, step, "v", 4);
  };
  const middle = () => times(plus(...places.slice(-2)), 0.5);
  const whole = makeStage("A pendulum", 19, [-1.2, -1.4, 1.5, 0.25], stage => {
    const [x, y] = middle(), corners = [[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]];
    paint(stage);
    stage.line(corners.map(([a, b]) => [x + a * loupe, y + b * loupe]), "quiet", 1);
    stage.disc([0, 0], 5, "quiet");
    stage.disc(part < 2 ? places.at(-2) : places.at(-1), 7);
    stage.says.innerHTML = `<p class="whole">${parts[part][0]}</p>`;
  });
  const near = makeStage("The same step, larger", 19, [0, 0, 1, 1], stage => {
    const [x, y] = middle(), was = places.at(-2);
    stage.box = [x - loupe, y - loupe, x + loupe, y + loupe];
    stage.aim();
    paint(stage);
    stage.disc(part < 2 ? was : places.at(-1), 7);
    stage.symbol("dt v", [x, y], "v", times(unit(was), -22));
    stage.says.innerHTML = `<p>step ${places.length - 1} ${part > 1 ? "left" : "would leave"}
      ${symbol("g")} = ${fixed(bob.measure("g")[0], 6)} m²</p>
      <p>½ Σ (<var>dt</var> ${symbol("v")})² = ${fixed(0.5 * squares, 6)} m²</p>`;
  });
  const ticks = [[0, "0"], [0.1, "0.1 m²"], [0.2, "0.2 m²"], [0.3, "0.3 m²"]];
  const total = makeChart("g after each step", 10, [0, 0, seconds + 0.15, 0.4], ticks,
    [[0.02, "0 s"], [0.35, "0.35 s"], [seconds, `${seconds} s`]], chart => {
      for (const [step, curve] of curves) {
        const now = step === dt.value(), color = now ? "long" : "quiet";
        for (const [s, g] of now ? curve : []) chart.line([[s, 0], [s, g]], "long", 4);
        chart.line(curve, color, now ? 2 : 1.5, now ? [] : [2, 4]);
        chart.words(`${step} s`, curve.at(-1), color, [6, 8], "left");
      }
      chart.says.textContent = "g after each step, in all: a line for each length of step tried.";
    });
  const take = () => { // a step; whether it was the last one
    bob.step(dt.value());
    places.push(bob.point(0));
    squares += (dt.value() * size(bob.state.slice(3))) ** 2;
    curves.get(dt.value()).push([bob.time, bob.measure("g")[0]]);
    if (bob.time < seconds - 1e-9) return false;
    const done = [...curves].filter(([, curve]) => curve.at(-1)[0] > seconds - 1e-9);
    const found = done.sort(([a], [b]) => b - a).map(
      ([step, curve]) => `${fixed(curve.at(-1)[1], 3)} m² in steps of ${step} s`);
    if (found.length > 1) prediction.reveal(`it halves. In the end g is ${found.join(", ")}.`);
    return true;
  };
  const show = shown => {
    part = shown;
    next.textContent = parts[part][1];
    next.disabled = all.disabled = part > 2;
    drawAll(whole, near, total);
  };
  const begin = () => {
    bob.begin([1, 0, 0, 0, 0, 0]);
    [places, squares] = [[[1, 0]], 0];
    curves.set(dt.value(), [[0, 0]]);
    take();
    show(0);
  };
  const next = makeButton("", () => {
    if (part < 2) show(part + 1);
    else show(take() ? 3 : 0);
  });
  const finish = () => {
    begin();
    while (!take());
    show(3);
  };
  const all = makeButton(`All ${seconds} s`, finish);
  const dt = makeSlider("step", [0.1, 0.05, 0.025], 0, x => `${x} s`, finish);
  dt.input.disabled = true;
  const answers = ["it stays", "it halves", "it falls to a quarter"];
  const question = "If you halve the step, what happens to the error in the end?";
  const prediction = makePrediction(question, answers, "it halves", () => {
    dt.input.disabled = false;
    finish(); // so that each other step has one to be compared with
  });
  begin();
  fill(figure, "Take a step in its parts, and all of them. Guess, then halve the step.",
    panels(whole, near), total, controls(next, all, makeButton("Again", begin)),
    prediction, controls(dt));
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
      if (largest([...tried.keys()]) > limit) { // it was found
        cliff.line([[limit, -9.5], [limit, 1.3]], "long", 1.5, [4, 5]);
        cliff.words(fixed(limit, 3), [limit, -9.5], "long", [0, -12]);
      }
      for (const [x, error] of tried) cliff.disc([x, height(error)], 2.5, color);
      cliff.disc([z.value(), height(last(errors()))], 6, color);
      cliff.says.textContent = `Error after ${steps} steps: a dot for each spring you tried`;
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
  const prediction = makePrediction(question, answers, right, () => {
    z.input.disabled = false;
  }, document.querySelector("[data-figure=cliff] ~ .text"));
  fill(figure, "Make the spring stiffer.", prediction, panels(chart, cliff), controls(z));
};

figures.one_step = figure => {
  const knobs = Motion.knobs(pendulum, {dt: 0.2, baumgarte: 2}), {dt} = knobs;
  const {methods, posts} = pendulum;
  const box = [-0.6, -1.6, 1.5, 0.1], color = k => inkOf(methods[k]);
  let d, v;
  const tip = () => plus(d, size(v) < 0.5 ? [0.1, 0] : times(v, dt)); // apart, to take hold of it
  const begun = (scene, method) => {
    const bob = new Motion(scene, method, knobs);
    bob.begin([...d, 0, ...v, 0]);
    return bob;
  };
  const stage = makeStage("A bob, and where each method puts it", 24, box, () => {
    const ends = methods.map(method => { // a step of each
      const bob = begun(pendulum, method);
      try {
        bob.step();
        return {at: bob.point(0), words: offBy(bob.errors[0])};
      } catch ({message}) {
        return {words: message};
      }
    });
    stage.circle([0, 0], 1, "quiet");
    stage.system(begun(pendulum, methods[0]), "quiet", "ink");
    stage.arrow(d, times(v, dt), "v", 2.5);
    stage.symbol("dt v", tip(), "v", [0, -18]);
    const seen = ends.map((end, k) => ({...end, k})).filter(({at}) => at);
    for (const {at, k} of seen) {
      stage.line([[0, 0], at], color(k), 1, [2, 5]);
      stage.disc(at, 6, color(k));
    }
    for (const {at, k} of seen.filter(({k}) => posts[methods[k]])) { // what it does after its step
      const bare = begun({...pendulum, posts: {}}, methods[k]);
      bare.step();
      const move = plus(at, bare.point(0), -1);
      stage.arrow(bare.point(0), move, "lambda", 3);
      ends[k].words += `, moved by ${metric(size(move))}`;
      if (methods[k] === "project") ends[k].words += `: ${symbol("λ", "−M⁻¹ J₀ᵀ μ")}`;
    }
    let low = 0; // pixels: the last name, since they stand one below the other, in sight
    for (const [place, {at, k}] of seen.toSorted((a, b) => b.at[1] - a.at[1]).entries()) {
      const most = stage.height - 18 * (seen.length - place);
      low = Math.max(low + 18, Math.min(most, stage.pixels(at)[1]));
      const beside = stage.metresAt([stage.width, low]);
      stage.line([at, plus(beside, [-100 / stage.scale[0], 0])], color(k), 1);
      stage.words(methods[k], beside, color(k), [-8, 0], "right");
    }
    const rows = ends.map(({words}, k) => `<p>${nameOf(methods[k]).outerHTML} ${words}</p>`);
    stage.says.innerHTML = `<p class="whole">Before the step the rod is ${offBy(size(d) - 1)}.
      After it:</p><div class="rows">${rows.join("")}</div>`;
  });
  const put = (...state) => {
    [d, v] = state;
    stage.draw();
  };
  const near = point => Math.abs(size(point) - 1) < 0.02; // so that right is right
  stage.hand("The bob", () => d,
    point => size(point) > 0.3 && put(near(point) ? unit(point) : point, v));
  stage.hand("The end of dt v", tip, point => put(d, times(plus(point, d, -1), 1 / dt)));
  const starts = {"Off its rod, at rest": [[0, -1.15], [0, 0]],
    "On its circle, in mid-swing": [[0, -1], [2, 0]], "Off, and thrown": [[0, -1.12], [2, -1]]};
  const buttons = Object.keys(starts).map(name => makeButton(name, () => put(...starts[name])));
  [d, v] = starts["Off its rod, at rest"];
  fill(figure, "Drag the bob, and throw it by the tip of dt v.", stage, controls(...buttons));
};

figures.flat_pose = figure => {
  const right = peaucellier.start[9]; // m: the last joint stays at this x
  const runs = new Runs(peaucellier, peaucellier.methods, 5, run => {
    const off = run.point(3)[0] - right;
    if (Math.abs(off) > 0.05) run.left ??= `left its line at ${fixed(run.time, 1)}\u00a0s`;
    run.gap = Math.max(run.gap ?? 0, Math.abs(off));
    return off;
  });
  const box = [-0.5, -4.3, 5.3, 2.6];
  const stages = runs.methods.map((method, k) =>
    makeStage(`Peaucellier's linkage, ${method}`, 12, box, tile => {
      const run = runs.each[k], joint = run.point(3);
      tile.line([[right, box[1]], [right, box[3]]], "quiet", 1.5, [2, 5]);
      if (!run.lost) tile.system(run, inkOf(method));
      if (run.left && !run.lost) tile.line([joint, [right, joint[1]]], "long", 3);
      const told = `${run.left ?? "on its line"}, gap up to ${metric(run.gap)}`;
      tile.says.replaceChildren(nameOf(method), run.lost ?? told);
    }));
  const runner = makeRunner(figure, runs, () => runs.begin(), () => {
    drawAll(...stages);
    if (!runs.over) return;
    const kept = runs.going.filter(({left}) => !left).map(({method}) => method);
    prediction.reveal(`${kept.join(" and ")} kept it there. The gap of each other one is red.`);
  });
  runner.clock.set(false);
  const buttons = controls(...runner.buttons);
  buttons.hidden = true;
  const question = "Its rods will lie in line. Which methods keep its joint on the dashed line?";
  const answers = ["all of them", "some of them", "not one"];
  const prediction = makePrediction(question, answers, answers[1], () => {
    buttons.hidden = false;
    runner.clock.set(!STILL);
  }, figure.nextElementSibling);
  fill(figure, "Guess, and let it fall.", prediction, tiles(stages), buttons);
};

figures.chaos = figure => {
  const tilted = by => [0, 3, 6, 9].flatMap(k => [...turned(double.start.slice(k, k + 2), by), 0]);
  const starts = new Map([["none", double.start], ["10⁻¹² rad", tilted(1e-12)],
    ["10⁻⁹ rad", tilted(1e-9)], ["10⁻⁶ rad", tilted(1e-6)], ["0.001 rad", tilted(0.001)],
    ["seeds 0, 1", seed1]]);
  const curves = new Map(); // of every start that was tried
  const runs = new Runs(double, ["baumgarte", "baumgarte"], 20,
    (run, [first]) => size(plus(run.point(1), first.point(1), -1)));
  const stage = makeStage("Two double pendulums", 18, CIRCLING, () => {
    const [first, second] = runs.each;
    const same = [0, 1, 3, 4, 6, 7, 9, 10].filter(k => Object.is(second.state[k], first.state[k]));
    stage.system(second, "m1");
    stage.system(first);
    stage.says.innerHTML = `<p class="whole">The tips are ${metric(second.now)} apart.</p>
      <p>Of the 8 numbers in their places and velocities ${same.length} are equal to the bit.</p>`;
  });
  const plot = makePlot("How far apart the tips are, over 20 s", decades, () =>
    [...curves].map(([words, points]) => (words === difference.value()
      ? {words, points, color: "m1"} : {words, points, color: "quiet", dash: [2, 4]})));
  plot.canvas.style.height = "18rem";
  const difference = makeSlider("difference", [...starts.keys()], 4, x => x, () => runner.again());
  const begin = () => {
    runs.begin([double.start, starts.get(difference.value())]);
    curves.set(difference.value(), runs.each[1].curve);
  };
  const runner = makeRunner(figure, runs, begin, () => drawAll(stage, plot));
  begin();
  if (STILL) runner.end();
  fill(figure, "Make the difference smaller, and then none.",
    panels(stage, plot), controls(...runner.buttons, difference));
};

for (const figure of document.querySelectorAll("[data-figure]")) {
  figures[figure.dataset.figure](figure);
}
