figures.flat_pose = figure => {
  const {peaucellier} = traced;
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
  });
  const tiles = row("panels many", ...elements(stages));
  fill(figure, "Guess, and let it fall.", prediction, tiles, buttons);
};
