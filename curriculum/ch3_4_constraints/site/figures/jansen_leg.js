figures.jansen_leg = figure => {
  const scene = traced.jansen_leg;
  const stiff = 225; // 1/s^2: times the mass of a joint, it is the hand's spring
  const foot = scene.masses.length - 1;
  const leg = new Motion(scene, scene.methods[0], Motion.knobs(scene));
  const {knobs} = leg;
  let trail = [];
  let worst = 0; // m
  let held = null; // a joint
  const stage = makeStage("Jansen's leg", 26, [-1.12, -0.98, 0.22, 0.4], () => {
    stage.line(trail, "quiet", 1.5, [1, 4]);
    stage.system(leg, inkOf(leg.method), "ink");
    if (held !== null) stage.line([leg.point(held), knobs.hand], "quiet", 1.5, [2, 4]);
    stage.says.innerHTML = `<p>${scene.pairs.length} rods, ${scene.masses.length} joints</p>
      <p>${nameOf(leg.method).outerHTML} rods off by ${metric(worst)} at worst</p>`;
  });
  const clock = new Clock(figure, () => knobs.dt, () => {
    leg.step();
    worst = Math.max(worst, largest(leg.errors));
    trail = [...trail, leg.point(foot)].slice(-600);
  }, () => stage.draw());
  const again = () => {
    leg.begin();
    trail = [];
    worst = 0;
    stage.draw();
  };
  scene.masses.forEach((mass, k) => stage.hand(`Joint ${k}`, () => leg.point(k), point => {
    held = k;
    knobs.hand = point;
    knobs.pulls[k] = stiff * mass;
    clock.set(true);
  }, () => {
    held = null;
    knobs.pulls.fill(0);
  }));
  fill(figure, "Pull at any joint.", stage, controls(clock, makeButton("Again", again)));
};
