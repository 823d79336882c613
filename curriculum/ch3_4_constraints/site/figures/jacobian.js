figures.jacobian = figure => {
  const chain = new Motion(double, "none", Motion.knobs(double));
  const colors = ["d", "rod1"]; // of the rods and their rows
  const names = ["x₀ y₀ 0 0", "x₀−x₁ y₀−y₁ x₁−x₀ y₁−y₀"].map(row => row.split(" "));
  const places = [[0.6, -0.8], [1.4, -1.4]];
  let chosen = [1, 2]; // a row and a column
  const stage = makeStage("A double pendulum", 20, [-1.9, -2.2, 2.1, 0.9], () => {
    const [k, column] = chosen;
    const bob = Math.floor(column / 2);
    const axis = column % 2 ? [0, 1] : [1, 0];
    chain.begin([...places[0], 0, ...places[1], 0, 0, 0, 0, 0, 0, 0]);
    const jac = chain.measure("J", 12); // in rows of x, y, z
    const entry = (row, column) => jac[6 * row + column + Math.floor(column / 2)];
    stage.disc([0, 0], 5, "quiet");
    [[[0, 0], places[0]], places].forEach((ends, row) =>
      stage.line(ends, colors[row], row === k ? 8 : 2.5));
    places.forEach(point => stage.disc(point, 8));
    stage.arrow(places[bob], times(axis, 0.5), "v");
    cells.forEach((row, i) => row.forEach((cell, j) => {
      cell.lastChild.textContent = fixed(entry(i, j), 2);
      cell.ariaPressed = i === k && j === column;
    }));
    const letter = "xy"[column % 2];
    const value = `<b>${fixed(entry(k, column), 2)} m²</b>`;
    words.innerHTML = names[k][column] === "0"
      ? `Rod ${k} does not end at bob ${bob}: where that is does not matter to it.`
      : `Bob ${bob} along ${letter}: g of rod ${k} changes by ${value} for each metre.`;
  });
  const choose = (row, column) => () => {
    chosen = [row, column];
    stage.draw();
  };
  const cells = names.map((row, i) => row.map((name, j) => make("button", {
    type: "button",
    className: `cell ${colors[i]}`,
    onclick: choose(i, j),
    onfocus: choose(i, j),
    onpointerenter: choose(i, j),
  }, make("small", {textContent: name}), make("span"))));
  const words = make("p", {className: "whole"});
  stage.says.append(row("matrix", ...cells.flat()), words);
  places.forEach((_, k) => stage.hand(`Bob ${k}`, () => places[k], point => {
    places[k] = point;
    stage.draw();
  }));
  fill(figure, "Touch an entry: its rod lights up. Drag a bob: the entries follow.", stage);
};
