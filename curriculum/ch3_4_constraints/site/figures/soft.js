figures.soft = figure => {
  const {soft} = traced;
  const larger = 150; // times the rod's error as it is drawn
  const stage = makeStage("A bob on a soft rod, its stretch drawn larger", 20,
    [-0.9, -1.85, 0.9, 0.1], () => {
      const [time_constant, impedance, mass] = sliders.map(slider => slider.value());
      const bob = new Motion(soft, "soft", {...Motion.knobs(soft), time_constant, impedance, mass});
      while (bob.time < 1.5) bob.step(); // until it rests
      const [error] = bob.errors;
      const seen = [0, -1 - larger * error];
      const formula = (1 - impedance) * time_constant * time_constant * 9.81;
      circle(stage, 1);
      stage.disc([0, 0], 5, "quiet");
      stage.disc(seen, 5 + 4 * Math.cbrt(mass));
      stage.rods([[[0, 0], seen, 1]], inkOf("soft"), 4);
      stage.says.innerHTML = `<p class="whole">At rest the rod is ${offBy(error)}.</p>
        <p>(1 − <var>p</var>) <var>τ</var>² 9.81 m/s² = ${metric(formula)}</p>`;
    });
  const draw = () => stage.draw();
  const sliders = [
    makeSlider("τ", [0.01, 0.02, 0.03, 0.04, 0.05], 1, x => `${x} s`, draw),
    makeSlider("p", [0.8, 0.9, 0.95, 0.98, 0.99, 1], 2, String, draw),
    makeSlider("mass", [0.1, 0.3, 1, 3, 10, 30], 2, x => `${x} kg`, draw),
  ];
  fill(figure, "Turn the time constant, the impedance and the mass.", stage, controls(...sliders));
};
