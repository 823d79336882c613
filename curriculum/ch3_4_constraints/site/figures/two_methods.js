figures.two_methods = figure => {
  const every = 4; // steps, of the 20 s
  const runs = ["none", "baumgarte"].map(method => {
    const motion = new Motion(double, method, Motion.knobs(double));
    const states = [motion.state.slice()];
    const curve = [[0, largest(motion.errors)]];
    for (let k = 1; k <= 4000; k++) {
      motion.step();
      if (k % every) continue;
      states.push(motion.state.slice());
      curve.push([k * STEP, largest(motion.errors)]);
    }
    return {motion, method, states, curve};
  });
  const stage = makeStage("Both double pendulums", 18, CIRCLING, () => {
    const told = runs.map(({motion, method, states, curve}) => {
      motion.begin(states[time.input.value]);
      stage.system(motion, inkOf(method));
      return `<p>${nameOf(method).outerHTML} ${metric(curve[time.input.value][1])}</p>`;
    });
    stage.says.innerHTML = `<p class="whole">The worst rod at ${fixed(time.value(), 2)} s:</p>
      ${told.join("")}`;
  });
  const plot = makePlot("The worst rod over 20 s", logarithmic(-6, 0), () => [
    ...runs.map(({method, curve}) => ({words: method, points: curve, color: inkOf(method)})),
    {points: [[time.value(), 1e-6], [time.value(), 3]], color: "ink", width: 1.5},
  ]);
  const draw = () => drawAll(stage, plot);
  const moments = runs[0].curve.map(([s]) => s);
  const time = makeSlider("time", moments, moments.length - 1, s => `${fixed(s, 2)} s`, draw);
  plot.reach = Infinity;
  plot.hand("The time", () => [time.value(), 0.2], ([s]) => {
    time.input.value = Math.round(s / (every * STEP)); // which stays within its range
    time.say();
    draw();
  });
  fill(figure, "Drag the line in time: the pendulums are as they were then.",
    panels(stage, plot), controls(time));
};
