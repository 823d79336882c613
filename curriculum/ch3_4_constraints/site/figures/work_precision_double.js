figures.work_precision_double = figure => {
  const {schemes, seconds, whole} = traced.ladders;
  const dashes = {euler: [2, 5], semi_implicit: [10, 5], rk4: []};
  const across = error => -Math.log10(error);
  const coarsest = 0.3; // m, and the finest, at the edges
  const finest = 2e-7;
  const lines = schemes.map(scheme => ({...scheme, rungs: scheme.rungs.map(
    ([dt, work, error, short, long, cost]) => ({dt, work, error, short, long, cost}))}));
  const right = (least, goal) => least !== null && least <= goal;
  // What choose() advises: of each integrator the cheapest scheme and step of which all is right,
  // as are all shorter steps, one of them at least, and rods and energy for the whole run.
  const advised = integrator => {
    const found = lines.filter(line => line.integrator === integrator).flatMap(line => {
      const wrong = line.rungs.findLastIndex(({short}) => !right(short, goal.value()));
      return line.rungs.slice(wrong + 1, -1).map(rung => ({...line, ...rung}));
    }).filter(({long}) => right(long, goal.value()));
    return found.toSorted((a, b) => a.work - b.work)[0];
  };
  const ticks = [[3, "1000"], [4, "10⁴"], [5, "10⁵"], [6, "10⁶"], [7, "10⁷"]];
  const errors = [1e-1, 1e-3, 1e-5].map(x => [across(x), metric(x)]);
  const box = [across(coarsest), 2.2, across(finest), 7.3];
  const chart = makeChart("Work against error", 25, box, ticks, errors, () => {
    const best = Object.keys(dashes).map(advised).filter(Boolean)
      .toSorted((a, b) => a.work - b.work);
    const names = [];
    chart.pad[2] = chart.width > 600 ? 150 : 14; // where names have room
    chart.aim();
    for (const {name, integrator, method, rungs} of lines) {
      const seen = rungs.filter(({error}) => error > finest && error < coarsest);
      const points = seen.map(({error, work}) => [across(error), Math.log10(work)]);
      const chosen = best.some(each => each.name === name);
      const color = chosen ? inkOf(method) : "quiet";
      chart.line(points, color, chosen ? 3 : 1, dashes[integrator]);
      const words = name.replace(" with ", " ");
      if (points.length > 1 && chart.pad[2] > 99) names.push({words, color, at: points.at(-1)});
    }
    chart.line([[across(goal.value()), box[1]], [across(goal.value()), box[3]]], "ink", 2);
    for (const {method, error, work} of best) {
      chart.disc([across(error), Math.log10(work)], 7, inkOf(method));
    }
    placeNames(chart, names);
    const rows = best.map(({name, method, dt, cost}) => `<tr><td><b class="${inkOf(method)}">${name}
      </b><td>${Number(dt.toPrecision(3))} ms<td>${Math.round(cost).toLocaleString("en")}`);
    const none = Object.keys(dashes).filter(name => !best.some(x => x.integrator === name));
    if (none.length) rows.push(`<tr><td>${none.join(", ")}<td>none for ${whole} s<td>`);
    chart.says.innerHTML = `<p class="whole">Right to ${metric(goal.value())} at all times to
      ${seconds} s, rods and energy to ${whole} s:</p><table>
      <tr><th><th>step<th>operations for a second of motion${rows.join("")}</table>`;
  });
  const goals = [3e-2, 1e-2, 3e-3, 1e-3, 3e-4, 1e-4, 3e-5, 1e-5, 3e-6, 1e-6]; // m
  const goal = makeSlider("tolerance", goals, 3, metric, () => chart.draw());
  chart.hand("The tolerance", () => [across(goal.value()), 2.6], ([x]) => {
    const far = each => Math.abs(across(each) - x);
    goal.set(goals.reduce((a, b) => (far(b) < far(a) ? b : a)));
    chart.draw();
  });
  fill(figure, "Drag the line, or the slider: the cheapest of each integrator is in colour.",
    panels(chart), controls(goal));
};
