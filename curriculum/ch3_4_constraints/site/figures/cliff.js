figures.cliff = figure => {
  const steps = 60;
  const mm = 1e-3;
  const color = inkOf("baumgarte");
  const {limit} = pendulum;
  const bob = new Motion(pendulum, "baumgarte", Motion.knobs(pendulum));
  const ticks = [[1, "1 mm"], [0, "0"], [-1, "−1 mm"]];
  const below = [[20, "20"], [40, "40"], [58, "60 steps"]];
  const chart = makeChart("The error of the rod after each step", 15, [-1, -1.3, steps + 1, 1.3],
    ticks, below, () => {
      bob.knobs.baumgarte = z.value() / STEP;
      bob.begin([0, -1 - mm, 0, 0, 0, 0]);
      let rings = false;
      let error;
      for (let k = 0; k <= steps; k++) {
        if (k) bob.step();
        [error] = bob.errors;
        rings ||= error < -0.01 * mm;
        const at = [k, Math.max(-1.3, Math.min(1.3, error / mm))];
        chart.line([[k, 0], at], color, 2);
        if (at[1] === error / mm) chart.disc(at, 3, color);
      }
      const end = Math.abs(error) < 1 ? metric(Math.abs(error)) : "over a metre";
      const kind = z.value() > limit ? "explodes" : rings ? "rings" : "decays";
      chart.says.textContent = `It ${kind}: after ${steps} steps it is ${end}.`;
    });
  const eigenvalues = () => { // of a step of the spring alone, whose error is q
    const {spring} = traced;
    const w = z.value() / STEP;
    const knobs = Motion.knobs(spring, {dt: STEP, damping: 2 * w, stiffness: w * w});
    const [[a, b], [c, d]] = [[1, 0], [0, 1]].map(([q, v]) => {
      const error = new Motion(spring, "semi_implicit", knobs);
      error.begin([q, 0, 0, v, 0, 0]);
      error.step();
      return [error.state[0], error.state[3]];
    });
    const half = (a + d) / 2;
    const apart = Math.sqrt(half * half - (a * d - b * c));
    return [half + apart, half - apart];
  };
  const line = makeChart("The eigenvalues of a step", 15, [-1.9, -1, 1.3, 1], [],
    [[-1, "−1"], [0, "0"], [1, "1"]], () => {
      const found = eigenvalues();
      line.line([[-1.9, 0], [1.3, 0]], "quiet", 1);
      line.line([[-1, 0], [1, 0]], "ink", 2.5);
      for (const x of [-1, 1]) line.line([[x, -1], [x, 1]], "quiet", 1, [2, 4]);
      for (const x of found) line.disc([x, 0], 9, Math.abs(x) > 1 ? "long" : color);
      line.says.textContent = `Eigenvalues: ${found.map(x => fixed(x, 3)).join(" and ")}`;
    });
  const values = Array.from({length: 96}, (_, k) => (k + 5) / 100);
  const z = makeSlider("dt w", values, 5, x => fixed(x, 2), x => {
    const told = `it dies sooner, then later again, and past ${fixed(limit, 3)} it explodes.`;
    if (x > limit) prediction.reveal(told);
    drawAll(chart, line);
  });
  z.input.disabled = true;
  const question = "Make the spring stiffer and stiffer: what happens to the error?";
  const right = "at some point it explodes";
  const answers = ["it dies ever sooner", "a small error stays", right];
  const prediction = makePrediction(question, answers, right, () => {
    z.input.disabled = false;
  }, document.querySelector("[data-figure=cliff] ~ .text"));
  fill(figure, "Guess, and make the spring stiffer.",
    panels(chart, line), prediction, controls(z));
};
