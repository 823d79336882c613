figures.work_precision_double = figure => {
  const {schemes, integrators, seconds, whole} = traced.ladders;
  const across = error => -Math.log10(error);
  const coarsest = 0.3, finest = 2e-7; // m: at the edges
  const lines = schemes.map(scheme => {
    const rungs = scheme.rungs.map(
      ([dt, work, error, short, long, cost]) => ({dt, work, error, short, long, cost}));
    const points = rungs.filter(({error}) => error > finest && error < coarsest)
      .map(({error, work}) => [across(error), Math.log10(work)]);
    return {...scheme, rungs, points};
  });
  let touched; // the name of a line
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
    const best = integrators.map(advised).filter(Boolean)
      .toSorted((a, b) => a.work - b.work);
    const names = [];
    chart.pad[2] = chart.width > 600 ? 150 : 14; // where names have room
    chart.aim();
    for (const {name, integrator, method, points} of lines) {
      const chosen = best.some(each => each.name === name);
      const color = chosen ? inkOf(method) : "quiet";
      const wide = chosen || name === touched ? 3 : 1;
      chart.line(points, name === touched ? "ink" : color, wide, DASHES[integrator]);
      const words = name.replace(" with ", " ");
      if (points.length > 1 && chart.pad[2] > 99) names.push({words, color, at: points.at(-1)});
    }
    chart.line([[across(goal.value()), box[1]], [across(goal.value()), box[3]]], "ink", 2);
    for (const {method, error, work} of best) {
      chart.disc([across(error), Math.log10(work)], 7, inkOf(method));
    }
    placeNames(chart, names);
    chart.words("operations for a second of motion", [box[0], box[3]], "quiet", [100, 14]);
    chart.words("error: smaller to the right", [3.6, box[1]], "quiet", [0, -32]);
    const rows = best.map(({name, method, dt, cost}) => `<tr><td><b class="${inkOf(method)}">${name}
      </b><td>${Number(dt.toPrecision(3))} ms<td>${Math.round(cost).toLocaleString("en")}`);
    const none = integrators.filter(name => !best.some(x => x.integrator === name));
    if (none.length) rows.push(`<tr><td>${none.join(", ")}<td>none for ${whole} s<td>`);
    chart.says.innerHTML = `<p class="whole">${touched ?? "Touch a line: what is it?"}</p>
      <p class="whole">Right to ${metric(goal.value())} at all times to
      ${seconds} s, rods and energy to ${whole} s:</p><table>
      <tr><th><th>step<th>operations for a second of motion${rows.join("")}</table>`;
  });
  Object.assign(chart.pad, {1: 44, 3: 28});
  chart.canvas.onpointerdown = chart.canvas.onpointermove = event => {
    const at = chart.pixels(chart.metres(event));
    const far = ({points}) => Math.min(...points.flatMap((b, k) => [0, 1, 2, 3, 4, 5, 6, 7].map(
      part => plus(b, plus(points[Math.max(0, k - 1)], b, -1), part / 8))) // along the line
      .map(place => size(plus(chart.pixels(place), at, -1))));
    const near = lines.toSorted((a, b) => far(a) - far(b))[0];
    if (far(near) > 30 || near.name === touched) return;
    touched = near.name;
    chart.draw();
  };
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
