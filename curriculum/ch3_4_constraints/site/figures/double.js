figures.double = figure => {
  const runs = new Runs(double, double.methods, 20, run => {
    run.worst = Math.max(run.worst ?? 0, largest(run.errors));
    return run.worst;
  });
  const time = make("output");
  let start = double.start;
  const begin = () => runs.begin(runs.methods.map(() => start));
  const draw = () => {
    drawAll(...stages);
    time.value = `${fixed(runs.time, 1)} s`;
  };
  const from = state => {
    start = state;
    begin();
    draw();
  };
  const stages = runs.methods.map((method, k) => {
    const tile = makeStage(`A double pendulum, ${method}`, 18, [-2.3, -2.45, 2.3, 1.75], () => {
      const run = runs.each[k];
      if (!run.lost) tile.system(run, inkOf(method));
      tile.says.replaceChildren(nameOf(method), run.lost ?? `rods off by ${metric(run.worst)}`);
    });
    const hold = state => {
      runs.held = true;
      from(state);
    };
    makeThrowable(tile, () => runs.each[k], hold, () => {
      runs.held = false;
      runner.clock.set(true);
    });
    return tile;
  });
  const runner = makeRunner(figure, runs, begin, draw);
  const steps = [0.00125, 0.0025, 0.005, 0.01, 0.02]; // s
  const step = makeSlider("step", steps, steps.indexOf(STEP), x => `${1000 * x} ms`, dt => {
    runs.knobs.dt = dt;
    runner.again();
  });
  const level = makeButton("Let go level", () => {
    start = double.start;
    runner.again();
  });
  const turned = controls(...runner.buttons, level, time, step);
  draw();
  fill(figure, "Take a bob of any of them and throw it: all are thrown. Or make the step longer.",
    row("five", ...elements(stages), turned));
};
