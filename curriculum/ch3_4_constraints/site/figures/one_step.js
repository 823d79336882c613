// A step of a bob under some methods, at first from one of the starts below.
function makeOneStep(figure, methods, first) {
  const knobs = Motion.knobs(pendulum, {dt: 0.2, baumgarte: 2});
  const {dt} = knobs;
  const {posts} = pendulum;
  const color = k => inkOf(methods[k]);
  let d, v;
  const tip = () => plus(d, size(v) < 0.75 ? [0.15, 0] : times(v, dt)); // apart, to take hold of it
  const begun = (scene, method) => {
    const bob = new Motion(scene, method, knobs);
    bob.begin([...d, 0, ...v, 0]);
    return bob;
  };
  const box = [-0.6, -1.6, 1.5, 0.1];
  const stage = makeStage("A bob, and where each method puts it", 22, box, () => {
    const ends = methods.map(method => { // a step of each
      const bob = begun(pendulum, method);
      try {
        bob.step();
        return {at: bob.point(0), words: offBy(bob.errors[0])};
      } catch ({message}) {
        return {words: message};
      }
    });
    circle(stage, 1);
    stage.system(begun(pendulum, methods[0]), "quiet", "ink");
    stage.disc(tip(), 9, "v"); // a ring, to take it by
    stage.disc(tip(), 7, "paper");
    stage.arrow(d, times(v, dt), "v", 2.5);
    drawSymbol(stage, size(v) ? "dt v" : "dt v = 0", tip(), "v", [size(v) ? 0 : 24, -20]);
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
  [d, v] = Object.values(starts)[first];
  fill(figure, "Drag the bob, and throw it by the tip of dt v.", stage, controls(...buttons));
}
figures.step_baumgarte = figure => makeOneStep(figure, ["none", "baumgarte"], 0);
figures.step_impulse = figure => makeOneStep(figure, ["none", "impulse"], 0);
figures.step_project = figure => makeOneStep(figure, ["none", "project"], 2);
figures.one_step = figure => makeOneStep(figure, pendulum.methods, 2);
