figures.spring = figure => {
  const {spring} = traced;
  const seconds = 12.8;
  let start = [1, 0]; // m, m/s
  const follow = integrator => { // its states, and the energy of each
    const knobs = Motion.knobs(spring, {dt: dt.value()});
    const bob = new Motion(spring, integrator, knobs);
    bob.begin([start[0], 0, 0, start[1], 0, 0]);
    const states = [];
    for (let k = 0; k <= Math.round(seconds / knobs.dt); k++) {
      if (k) bob.step();
      states.push([bob.state[0], bob.state[3]]);
    }
    return {states, energy: bob.energy};
  };
  const chart = makeStage("Velocity over place", 21, [-1.9, -1.9, 1.9, 1.9], () => {
    chart.line([[-1.9, 0], [1.9, 0]], "pale", 1);
    chart.line([[0, -1.9], [0, 1.9]], "pale", 1);
    chart.words("place", [1.9, 0], "quiet", [0, 10], "right", PLAIN);
    chart.words("velocity", [0, 1.8], "quiet", [6, 0], "left", PLAIN);
    circle(chart, size(start));
    const rows = spring.methods.map(name => {
      const {states, energy} = follow(name);
      chart.line(states.filter(state => largest(state) < 9), "ink", 2, DASHES[name]);
      const ratio = energy / (0.5 * dot(start, start));
      const dash = `<svg width="40" height="6"><path d="M0 3H40" stroke-width="2"
        stroke="currentColor" stroke-dasharray="${DASHES[name]}"/></svg>`;
      const much = ratio < 1000 ? `${fixed(ratio, 2)} times` : "over 1000 times";
      return `<p>${dash} <b>${name}</b> has ${much} its energy</p>`;
    });
    chart.disc(start, 8);
    chart.says.innerHTML = `<p class="whole">After ${seconds} s:</p>
      <div class="rows">${rows.join("")}</div>`;
  });
  const dt = makeSlider("step", [0.05, 0.1, 0.2, 0.4, 0.8, 1.6], 3, x => `${x} s`,
    () => chart.draw());
  chart.hand("Where it starts: place and velocity", () => start, point => {
    if (size(point) > 0.1) start = point;
    chart.draw();
  });
  fill(figure, "Make the step longer. Drag the disc: there it starts.", chart, controls(dt));
};
