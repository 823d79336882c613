figures.drift = figure => {
  const seconds = 0.7;
  const first = 0.3; // s: a step so long that its wedge is seen
  const ends = new Map(); // {a length of step in s: what g was in the end}
  const bob = new Motion(pendulum, "none", Motion.knobs(pendulum));
  const parts = [ // of the first step: what is seen, and what comes next
    ["A long step first: the bob moves by dt v.", "Then the circle"],
    ["The circle that would keep the rod's length bends away.", "Then the wedge"],
    ["The wedge between the two is what the step adds to the rod.", "Now shorter steps"],
    ["Each step adds its wedge, and nothing takes it back.", "Next step"],
  ];
  let places;
  let part; // of the first step, 0 to 2; or 3: it has been seen
  const length = () => (part < 3 ? first : dt.value());
  const stage = makeStage("A pendulum", 24, [-1.1, -1.4, 1.5, 0.2], () => {
    const [was, now] = places.slice(-2);
    const step = plus(now, was, -1);
    const turn = angle(was, now);
    const g = part < 2 ? "?" : fixed(bob.measure("g")[0], 6);
    const before = part < 2 ? places.slice(0, -1) : places;
    if (part > 0) circle(stage, 1);
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
    drawSymbol(stage, "dt v", plus(was, step, 0.5), "v", times(unit(was), 26));
    stage.disc([0, 0], 5, "quiet");
    stage.disc(before.at(-1), 7);
    stage.says.innerHTML = `<p class="whole">${parts[part][0]}</p>
      <p>After step ${places.length - 1} ${symbol("g")} = ${g} m²</p>`;
  });
  const take = () => { // a step; whether it was the last one
    bob.step(length());
    places.push(bob.point(0));
    if (part < 3) return true;
    if (bob.time < seconds - 1e-9) return false;
    ends.set(length(), bob.measure("g")[0]);
    const found = [...ends].sort(([a], [b]) => b - a)
      .map(([step, g]) => `${fixed(g, 3)} m² in steps of ${step} s`);
    if (found.length > 1) prediction.reveal(`it halves. In the end g is ${found.join(", ")}.`);
    return true;
  };
  const show = over => {
    next.textContent = parts[part][1];
    next.disabled = all.disabled = over;
    stage.draw();
  };
  const begin = seen => {
    part = seen;
    bob.begin([1, 0, 0, 0, 0, 0]);
    places = [[1, 0]];
    take();
    show(false);
  };
  const next = makeButton("", () => {
    if (part > 2) return show(take());
    if (part === 2) return begin(3);
    part += 1;
    show(false);
  });
  const finish = () => {
    begin(3);
    while (!take());
    show(true);
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
  begin(0);
  fill(figure, "Take a step in its parts, and then all of them. Guess, and halve the step.",
    stage, controls(next, all, makeButton("Again", () => begin(0))), prediction, controls(dt));
};
