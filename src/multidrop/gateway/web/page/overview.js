// The plant at a glance: what goes wrong with records, lines with how full they are, devices with their first points.

import { h, hex, mark, number, percent, say, shown, sparkline } from "./dom.js";
import { key, state, store, trust } from "./store.js";
import { troublesNode } from "./troubles.js";

const FIRST = 4; // points of a device that its card shows

/** A value with its unit and its name, drawn into two nodes that stay. */
export function valueNode() {
  const text = h("span", { class: "number" });
  const unit = h("span", { class: "unit" });
  const name = h("span", { class: "name" });
  const node = h("span", {}, text, unit, name);
  return {
    node,
    draw(point, value, past) {
      const known = value?.value;
      const named = value?.meaning && Object.keys(point.names).length > 0;
      const code = point.hexadecimal && Number.isInteger(known);
      say(text, named ? "" : code ? hex(known) : shown(known, past?.decimals ?? 3, point.unit));
      say(unit, !named && known !== null && known !== undefined ? point.unit ?? "" : "");
      say(name, named ? value.meaning : "");
    },
  };
}

function fill() {
  const used = h("i");
  const planned = h("b");
  const text = h("span", { class: "number small" });
  const bar = h("span", { class: "bar" }, used, planned);
  const node = h("div", { class: "fill", title: "How full the line was in the last minute; the mark is what its polls take" }, bar, text);
  return {
    node,
    draw(health) {
      if (!health) return;
      used.style.width = `${100 * Math.min(1, health.load)}%`;
      planned.style.left = `${100 * Math.min(0.99, health.planned)}%`;
      mark(node, "warn", health.load > 0.9 && health.load <= 0.97);
      mark(node, "bad", health.load > 0.97);
      say(text, `${percent(health.load)} full`);
    },
  };
}

function card(device) {
  const word = h("span", { class: "state" });
  const rows = device.points.slice(0, FIRST).map((point) => {
    const name = key(device.name, point.name);
    const value = valueNode();
    const spark = sparkline();
    const node = h("div", { "data-point": name },
      h("dt", { title: point.meaning || point.at }, point.name.replaceAll("_", " ")),
      h("dd", {}, spark.node),
      h("dd", { class: "value" }, value.node));
    return { name, point, value, spark, node };
  });
  const more = device.points.length - rows.length;
  const node = h("a", { class: "device card", href: `#/device/${encodeURIComponent(device.name)}` },
    h("div", { class: "row" }, h("h3", {}, device.name), word),
    h("div", { class: "dim small" }, `${device.title || device.profile}, address ${device.address}`),
    h("dl", {}, rows.map((row) => row.node)),
    more > 0 ? h("div", { class: "more" }, `and ${more} more`) : null);
  return {
    node,
    draw() {
      const now = state(device);
      say(word, now.word);
      word.className = `state ${now.kind}`;
      mark(node, "bad", now.kind === "bad");
      mark(node, "warn", now.kind === "warn");
      for (const row of rows) {
        const past = store.past.get(row.name);
        const kind = trust(row.name).kind;
        row.value.draw(row.point, store.values.get(row.name), past);
        if (past) row.spark.draw(past.times, past.values);
        mark(row.node, "is-old", kind === "old");
        mark(row.node, "is-bad", kind === "bad");
      }
    },
  };
}

const TROUBLES = [["no_reply", "no reply"], ["damaged", "damaged"], ["foreign", "foreign"]];

/** What went wrong on a line since the gateway started; empty where nothing did. */
function troubles(health) {
  const words = TROUBLES.filter(([name]) => health.counters[name]).map(([name, word]) => `${number(health.counters[name])} ${word}`);
  if (health.missed) words.push(`${number(health.missed)} polls left out`);
  return words.join(" · ");
}

function section(line) {
  const bar = fill();
  const settings = h("span", { class: "dim small" });
  const lost = h("span", { class: "state bad", hidden: true });
  const trouble = h("span", { class: "small dim" });
  const cards = line.devices.map(card);
  const node = h("section", { class: "line" },
    h("header", {}, h("h2", {}, line.name), settings, lost, trouble, h("span", { class: "push" }, bar.node)),
    h("div", { class: "cards" }, cards.map((one) => one.node)));
  return {
    node,
    draw() {
      const health = store.lines.get(line.name);
      say(settings, health ? `${health.protocol}, ${health.settings}, ${line.port}` : line.port);
      lost.hidden = !health?.lost;
      say(lost, health?.lost ?? "");
      say(trouble, health ? troubles(health) : "");
      bar.draw(health);
      for (const one of cards) one.draw();
    },
  };
}

export function overview() {
  const node = h("div");
  let sections = [];
  const summary = h("p", { class: "dim" });
  const troubles = troublesNode();
  function build() {
    sections = store.plant.lines.map(section);
    node.replaceChildren(
      h("div", { class: "head" }, h("h1", {}, "Plant"), summary),
      troubles.node,
      ...sections.map((one) => one.node));
    if (!sections.length) node.append(h("p", { class: "empty" }, "This plant has no lines."));
  }
  build();
  return {
    title: "Plant",
    node,
    draw({ plant }) {
      if (plant) build();
      troubles.draw();
      for (const one of sections) one.draw();
      const states = [...store.devices.values()].map((device) => state(device).kind);
      const well = states.filter((kind) => kind === "good").length;
      say(summary, states.length ? `${number(well)} of ${number(states.length)} devices are well` : "");
    },
  };
}
