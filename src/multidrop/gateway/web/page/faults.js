// Why did it trip: what was kept when a device went into fault.

import { h } from "./dom.js";

export function faultsView() {
  const node = h("div", {},
    h("div", { class: "head" }, h("h1", {}, "Faults")),
    h("p", { class: "empty" }, "No freeze-frames are kept: [faults] is not in the plant file."));
  return { title: "Faults", node, draw() {} };
}
