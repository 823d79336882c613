figures.tangent = figure => {
  const bob = new Motion(pendulum, "none", Motion.knobs(pendulum)), perSpeed = 0.6; // m for 1 m/s
  let d = [0.66, -0.88], v = [0.9, 0.3];
  const stage = makeStage("A bob and its velocity", 20, [-1.3, -1.65, 1.7, 0.3], () => {
    bob.begin([...d, 0, ...v, 0]);
    const [[g], [gdot], [error]] = ["g", "gdot", "errors"].map(name => bob.measure(name));
    const along = unit(d), aside = across(along), tip = plus(d, v, perSpeed);
    const grows = times(along, perSpeed * dot(v, along)); // what v has along the rod
    circle(stage, 1);
    stage.line([plus(d, aside), plus(d, aside, -1)], "pale", 1); // where gdot is 0
    stage.system(bob, "d", "ink");
    stage.line([tip, plus(d, grows)], "quiet", 1, [3, 4]);
    stage.line([d, plus(d, grows)], "v", 3, [5, 6]);
    stage.arrow(d, times(v, perSpeed), "v");
    drawSymbol(stage, "v", tip, "v", times(unit(v), 16));
    drawSymbol(stage, "d", times(d, 0.5), "d", times(aside, 16));
    const then = Math.abs(gdot) < 5e-4 ? "stays so" : gdot > 0 ? "grows" : "shrinks";
    stage.says.innerHTML = `<p class="whole">The rod is ${offBy(error)}, and ${then}.</p>
      <p>${symbol("d")} = ${pair(d)} m<br>${symbol("g")} = ${fixed(g, 3)} m²</p>
      <p>${symbol("v")} = ${pair(v)} m/s<br>${symbol("g", "ġ")} = ${fixed(gdot, 3)} m²/s</p>`;
  });
  stage.hand("The bob", () => d, point => {
    const near = Math.abs(size(point) - 1) < 0.03 ? unit(point) : point; // so that zero is zero
    if (size(near) > 0.05) d = near;
    stage.draw();
  });
  stage.hand("The tip of the velocity", () => plus(d, v, perSpeed), point => {
    v = times(plus(point, d, -1), 1 / perSpeed);
    const tangent = across(unit(d)), slides = dot(v, tangent);
    if (Math.abs(dot(v, unit(d))) < 0.06 * Math.abs(slides)) v = times(tangent, slides);
    stage.draw();
  });
  fill(figure, "Drag the bob, and the tip of its velocity.", stage);
};
