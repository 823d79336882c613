figures.question = figure => {
  const bob = new Motion(pendulum, "project", Motion.knobs(pendulum, {dt: 0.0005}));
  const perNewton = 0.03; // m
  let most, held = false;
  const stage = makeStage("A bob on its rod", 19, [-1.2, -1.45, 1.2, 1.1], () => {
    const d = bob.point(0), [pull] = bob.measure("tensions"), [x, y] = across(unit(d));
    circle(stage, 1);
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
  clock.set(false);
  stage.reach = Infinity; // wherever it is touched, the bob comes
  put([1, 0]);
  const level = makeButton("Let go level", () => from([1, 0]));
  fill(figure, "Press anywhere, and the bob comes. Let it go. Then take the rod away.",
    stage, controls(clock, level, make("label", {}, rod, "with the rod")));
};
