// What tests do in the page, and a hand cannot.
globalThis.hands = {
  // Move a slider to a value that its list has.
  pick([key, value]) {
    const {input} = sliders[key];
    if (!data.lists[key].includes(value)) throw new Error(`${key} cannot be ${value}`);
    input.value = data.lists[key].indexOf(value);
    input.dispatchEvent(new Event("input"));
  },

  // Take so many steps at once, and draw the last.
  go(count) {
    for (let k = 0; k < count; k++) step();
    wake();
  },

  copy(mode) {
    return copies.find((copy) => copy.mode === mode);
  },

  // Where a particle of a mode's tile is on the screen.
  spot([mode, particle]) {
    const copy = hands.copy(mode);
    const box = copy.canvas.getBoundingClientRect();
    const [x, y] = seen(place(copy.state, particle));
    const scale = box.width / (2 * view.wide);
    return [box.left + box.width / 2 + scale * x, box.top + box.height / 2 - scale * y];
  },

  // How far a particle of a mode's tile is from the hand, in m.
  reach([mode, particle]) {
    const point = place(hands.copy(mode).state, particle);
    return Math.hypot(...point.map((x, k) => x - knobs.hand[k]));
  },

  // The height of the tallest number or label of the tiles.
  tallest() {
    return Math.max(...[...document.querySelectorAll("dt, dd")].map((each) => each.clientHeight));
  },

  // The least time in ms that 12 frames take; it is looked for until it is enough, or for 10 s.
  frames(enough) {
    return new Promise((resolve) => {
      const seen = [], end = performance.now() + 10000;
      let least = Infinity;
      const look = (now) => {
        seen.push(now);
        if (seen.length > 12) least = Math.min(least, now - seen[seen.length - 13]);
        if (least < enough || now > end) resolve(least);
        else requestAnimationFrame(look);
      };
      requestAnimationFrame(look);
    });
  },
};
