figures.solve = figure => {
  const rods = new Motion(double, "project", Motion.knobs(double)), perNewton = 0.025; // m
  const hangs = [0, -1, 0, 0, -2, 0], level = [1, 0, 0, 2, 0, 0], rest = [0, 0, 0, 0, 0, 0];
  const name = (letter, k) => symbol(letter, letter + "₀₁"[k]);
  const cells = numbers => numbers.map(x => `<mtd><mn>${fixed(x, 2)}</mn></mtd>`).join("");
  const matrix = (letter, ...rows) => `<munder class="${letter}"><mrow><mo>(</mo><mtable>
    ${rows.map(row => `<mtr>${cells(row)}</mtr>`).join("")}</mtable><mo>)</mo></mrow>
    <mi>${letter}</mi></munder>`;
  let drawn = 0, told; // the numbers: those that change at each frame cannot be read
  const stage = makeStage("Two bobs on their rods", 26, [-2.1, -2.3, 2.1, 1.3], () => {
    const [a, b] = rods.points, d = [a, plus(b, a, -1)], bend = angle(...d);
    const v = [6, 9].map(k => Array.from(rods.state.slice(k, k + 2)));
    const lambda = rods.measure("lambda", 2);
    if (!clock.going || drawn % 6 === 0) told = tell(v, lambda);
    drawn += 1;
    const away = unit(plus(plus(d[0], d[1], -1), across(d[0]), 0.1)); // from rods at bob 0
    stage.system(rods, "quiet", "ink");
    stage.line([a, plus(a, d[0], 0.6)], "A", 1.5, [3, 5]);
    stage.line(arc(a, times(d[0], 0.45), 0, bend), "A");
    stage.words(told, a, "A", times(away, 34));
    for (const [k, from, sign] of [[0, a, 1], [1, a, -1], [1, b, 1]]) {
      stage.arrow(from, times(d[k], sign * lambda[k] * perNewton), "lambda");
    }
    d.forEach((along, k) => {
      const aside = times(across(along), dot(across(along), away) > 0 ? -20 : 20);
      const place = plus(rods.point(k - 1), along, 0.7); // apart, even if the rods are folded
      drawSymbol(stage, "λ" + "₀₁"[k], place, "lambda", aside);
    });
    rods.points.forEach((point, k) => stage.arrow(point, times(v[k], 0.15), "v", 2));
  });
  const tell = (v, lambda) => { // and returns what stands beside the bob
    const [jac, A, right] = ["J", "A", "b"].map(x => rods.measure(x, 12));
    const felt = Math.abs(A[1]) < 0.02 ? "At a right angle neither rod feels the other."
      : `Rod 0 feels this much of ${name("λ", 1)}, and rod 1 of ${name("λ", 0)}.`;
    const rows = [0, 6].map(row => [0, 1, 3, 4].map(k => jac[row + k])); // without the z axis
    stage.says.innerHTML = `<math display="block"><mrow>${matrix("J", ...rows)}</mrow></math>
      <math display="block"><mrow>
      ${matrix("A", A.slice(0, 2), A.slice(2, 4))}${matrix("λ", ...lambda.map(x => [x]))}
      <mo>=</mo>${matrix("b", ...right.slice(0, 2).map(x => [x]))}</mrow></math>
      <p class="whole"><b class="A">${fixed(A[1], 2)}</b> = −${name("d", 0)} · ${name("d", 1)} /
      <var>m</var>₀. ${felt}</p>
      <p>${name("v", 0)} = ${pair(v[0])}, ${name("v", 1)} = ${pair(v[1])} m/s</p>`;
    return fixed(A[1], 2);
  };
  let held = false;
  const clock = new Clock(figure, () => STEP, () => held || rods.step(), () => stage.draw());
  clock.set(false);
  const put = state => {
    held = true;
    rods.begin(state);
    stage.draw();
  };
  makeThrowable(stage, () => rods, put, () => {
    held = false;
    clock.set(true);
  });
  const begin = (start, going) => () => {
    rods.begin([...start, ...rest]);
    clock.set(going);
    stage.draw();
  };
  begin(hangs, false)();
  fill(figure, "Drag a bob, and throw it.", stage, controls(clock,
    makeButton("Hang", begin(hangs, false)), makeButton("Let go level", begin(level, true))));
};
