// Why did it trip: what was kept when a device went into fault.

import { h, moment, shown } from "./dom.js";
import { get } from "./link.js";
import { store } from "./store.js";

function when(time) {
  return time === null ? "still there" : moment(time);
}

function lasted(trip) {
  if (trip.cleared === null) return "still there";
  const seconds = (Date.parse(trip.cleared) - Date.parse(trip.time)) / 1000;
  return seconds < 120 ? `${seconds.toFixed(1)} s` : `${Math.round(seconds / 60)} min`;
}

const code = (trip) => (trip.code === null || trip.code === undefined ? "" : `${trip.code.toString(16).toUpperCase().padStart(4, "0")}h`);

function list(trips) {
  if (!trips.length) return h("p", { class: "empty" }, "Nothing has tripped since freeze-frames are kept.");
  return h("div", { class: "card scroll" }, h("table", {},
    h("thead", {}, h("tr", {}, ["when", "device", "code", "state", "lasted"].map((word) => h("th", {}, word)))),
    h("tbody", {}, trips.map((trip) => h("tr", {},
      h("td", {}, h("a", { href: `#/faults/${encodeURIComponent(trip.device)}/${encodeURIComponent(trip.name)}` }, when(trip.time))),
      h("td", {}, trip.device),
      h("td", { class: "number" }, code(trip)),
      h("td", {}, trip.status ?? ""),
      h("td", { class: trip.cleared === null ? "state bad" : "number" }, lasted(trip)))))));
}

function section(title, node) {
  return h("section", { class: "line" }, h("header", {}, h("h2", {}, title)), node);
}

function value(item) {
  if (item.error) return h("span", { class: "tag bad" }, item.error);
  return h("span", {}, h("span", { class: "number" }, shown(item.value, 4, item.unit)),
    item.unit ? ` ${item.unit}` : "", item.meaning ? ` ${item.meaning}` : "");
}

/** Values before the trip: a row for each point, oldest left, newest right. */
function before(frame) {
  const points = new Map();
  for (const past of frame.before) points.set(past.point, [...(points.get(past.point) ?? []), past]);
  return h("div", { class: "card scroll" }, h("table", {},
    h("thead", {}, h("tr", {}, h("th", {}, "point"), h("th", {}, "s before: value"))),
    h("tbody", {}, [...points].map(([point, values]) => h("tr", {},
      h("td", {}, h("strong", {}, point.replaceAll("_", " "))),
      h("td", { class: "past" }, values.slice(-24).map((past) => h("span", { class: past.quality === "good" ? "step" : "step is-bad" },
        h("span", { class: "small dim number" }, past.s.toFixed(1)), value(past)))))))));
}

function frames(frame) {
  return h("div", { class: "card scroll" }, h("table", { class: "frames" }, h("tbody", {},
    [...frame.frames].reverse().map((one) => h("tr", { class: one.damaged ? "wrong" : null },
      h("td", { class: "number" }, when(one.time).split(", ").pop()),
      h("td", {}, h("div", { class: "text" }, one.text), h("div", { class: "raw number" }, h("b", {}, one.sent ? "> " : "< "), one.shown)))))));
}

function detail(frame) {
  return h("div", {},
    h("div", { class: "head" },
      h("div", {}, h("h1", {}, `${frame.device} tripped`), h("div", { class: "dim" }, `${when(frame.time)}, said by ${frame.said_by}`)),
      h("span", { class: frame.cleared === null ? "state bad" : "state good" }, frame.cleared === null ? "not cleared" : `cleared ${when(frame.cleared)}`),
      h("a", { class: "button push", href: trend(frame) }, "Trends around it")),
    frame.found ? h("p", { class: "note" }, "It was in fault already when it was first heard.") : null,
    section("Status then", h("div", { class: "card facts" }, h("pre", {}, frame.status_lines.join("\n") || frame.status_error || "none"))),
    frame.read.length ? section("Read then", h("div", { class: "card facts" }, frame.read.map((item) => h("div", {}, h("span", {}, item.point), value(item))))) : null,
    section("Before", before(frame)),
    section("On the line, newest first", frames(frame)));
}

function trend(frame) {
  const at = Date.parse(frame.time) / 1000;
  const points = [...new Set(frame.before.map((past) => past.point))].slice(0, 6);
  return `#/trends?${points.map((point) => `p=${encodeURIComponent(`${frame.device}/${point}`)}`).join("&")}&from=${(at - 120).toFixed(0)}&to=${(at + 60).toFixed(0)}`;
}

export function faultsView(path) {
  const node = h("div");
  let asked = 0;
  const one = path.includes("/");
  async function load() {
    asked = Date.now();
    try {
      const [device, name] = [path.slice(0, path.indexOf("/")), path.slice(path.indexOf("/") + 1)];
      if (one) node.replaceChildren(detail(await get(`/api/faults/${encodeURIComponent(device)}/${encodeURIComponent(name)}`)));
      else node.replaceChildren(h("div", { class: "head" }, h("h1", {}, "Faults"), h("p", { class: "dim" }, "when a device tripped, newest first")), list(await get("/api/faults")));
    } catch (error) {
      node.replaceChildren(h("div", { class: "head" }, h("h1", {}, "Faults")), h("p", { class: "empty" }, error.message));
    }
  }
  node.append(h("p", { class: "empty" }, "Loading …"));
  load();
  return {
    title: "Faults",
    node,
    draw() {
      if (!one && store.lost === null && Date.now() - asked > 5000) load();
    },
  };
}

