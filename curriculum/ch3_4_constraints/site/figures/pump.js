figures.pump = figure => {
  const larger = 20; // times the rod's error as it is drawn
  const curves = new Map(); // of the energy, for each w that was tried
  const seen = run => times(unit(run.point(0)), 1 + larger * run.errors[0]);
  const runs = new Runs(pendulum, ["baumgarte"], 20, run => {
    run.trail = [...run.trail ?? [], seen(run)].slice(-400);
    return run.energy - (run.level ??= run.energy);
  });
  const stage = makeStage("A pendulum, its rod's error twenty times too large", 18,
    [-1.5, -1.6, 1.5, 0.5], () => {
      const [run] = runs.each;
      const bob = seen(run);
      circle(stage, 1);
      stage.line(run.trail, "quiet", 1.5);
      stage.disc([0, 0], 5, "quiet");
      stage.disc(bob, 8);
      stage.rods([[[0, 0], bob, 1]], inkOf("baumgarte"), 3);
      const gained = run.now < 0 ? "lost" : "gained";
      stage.says.innerHTML = `<p class="whole">The rod is ${offBy(run.errors[0])}.</p>
        <p>It has ${gained} ${perCent(Math.abs(run.now))} of <var>m g L</var>.</p>`;
    });
  const plot = makePlot("The energy gained, of m g L", linear(0.4), () => [...curves].map(
    ([words, points]) => (words === name() ? {words, points, color: inkOf("baumgarte")}
      : {words, points, color: "quiet", dash: [2, 4]})));
  const w = makeSlider("w", [10, 20, 40, 80, 160], 1, x => `${x} rad/s`, x => {
    runs.knobs.baumgarte = x;
    runner.again();
  });
  const name = () => `w ${w.value()}`;
  const begin = () => {
    runs.begin([[1, 0, 0, 0, 0, 0]]);
    curves.set(name(), runs.each[0].curve);
  };
  const runner = makeRunner(figure, runs, begin, () => drawAll(stage, plot));
  begin();
  fill(figure, "Watch when the rod is short, and when not. Then make w larger.",
    panels(stage, plot), controls(...runner.buttons, w));
};
