// node run_page.cjs PAGE STEPS MODE ...: what the modes of a page do, as JSON on stdout; and of each
// all its states, the start's first, as the bytes of doubles in the file PAGE.MODE.
const fs = require("fs");
const vm = require("vm");
const [page, steps, ...modes] = process.argv.slice(2);
const [, script] = fs.readFileSync(page, "utf8").match(/<script>([^]*?)<\/script>/);
vm.runInThisContext(script + "; globalThis.scene = scene;");
const found = {};
for (const mode of modes) {
  const state = scene.start.slice(), rows = [...state];
  let done = 0, halved = 0, why = null;
  try {
    for (; done < Number(steps); done++) {
      halved += scene.modes[mode](state, scene.knobs);
      for (const x of state) rows.push(x);
    }
  } catch (error) {
    why = error.message;
  }
  fs.writeFileSync(`${page}.${mode}`, Buffer.from(Float64Array.from(rows).buffer));
  found[mode] = {done, halved, why, whole: state.every((x, k) => x === rows.at(k - state.length))};
}
console.log(JSON.stringify(found));
