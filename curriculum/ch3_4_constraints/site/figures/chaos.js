figures.chaos = figure => {
  const {seed1} = traced;
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
