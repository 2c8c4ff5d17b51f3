// One device: how it is, and all its points, live.

import { backupsSection } from "./backups.js";
import { age, h, mark, number, say, sparkline } from "./dom.js";
import { post } from "./link.js";
import { valueNode } from "./overview.js";
import { key, now, state, store, trust } from "./store.js";
import { writePoint } from "./write.js";

const COUNTERS = [
  ["requests", "asked"],
  ["answers", "answered"],
  ["refusals", "refused"],
  ["no_reply", "no reply"],
  ["damaged", "damaged"],
];

function row(device, point) {
  const name = key(device.name, point.name);
  const value = valueNode();
  const spark = sparkline();
  const old = h("span", { class: "number small dim" });
  const tag = h("span", { class: "tag", hidden: true });
  const bits = h("div", { class: "meaning" });
  const read = h("button", { type: "button", class: "quiet", title: `Read ${point.name} from the device now` }, "Read");
  read.addEventListener("click", async () => {
    read.disabled = true;
    try {
      const found = await post("/api/read", { device: device.name, point: point.name });
      read.title = `${found.ms.toFixed(1)} ms`;
      say(read, "Read ✓");
    } catch (error) {
      read.title = error.message;
      say(read, "Failed");
    }
    read.disabled = false;
    setTimeout(() => say(read, "Read"), 2000);
  });
  const trend = `#/trends?p=${encodeURIComponent(name)}&span=900`;
  const node = h("tr", { "data-point": name },
    h("td", {},
      h("a", { href: trend }, h("strong", {}, point.name.replaceAll("_", " "))),
      h("div", { class: "meaning" }, [point.meaning, point.at].filter(Boolean).join(" · ")), bits),
    h("td", { class: "value" }, value.node),
    h("td", { class: "trend" }, spark.node),
    h("td", { class: "age end" }, tag, " ", old),
    h("td", { class: "do" }, read,
      point.write
        ? h("button", { type: "button", class: "write-it", onclick: () => writePoint(device, point) }, "Write …")
        : null));
  return {
    node,
    draw() {
      const known = store.values.get(name);
      const past = store.past.get(name);
      const how = trust(name);
      value.draw(point, known, past);
      if (past) spark.draw(past.times, past.values, 300);
      mark(node, "is-old", how.kind === "old");
      mark(node, "is-bad", how.kind === "bad");
      tag.hidden = !how.word;
      tag.className = `tag ${how.kind}`;
      say(tag, how.word);
      tag.title = known?.error ?? "";
      say(old, known?.at ? age(now() - known.at) : "");
      say(bits, point.bits.length && known?.meaning ? known.meaning : "");
    },
  };
}

function facts(device) {
  const node = h("div", { class: "facts card" });
  const cells = new Map();
  const cell = (name) => {
    if (!cells.has(name)) {
      const text = h("strong", { class: "number" });
      cells.set(name, text);
      node.append(h("div", {}, h("span", {}, name), text));
    }
    return cells.get(name);
  };
  return {
    node,
    draw() {
      const health = store.health.get(device.name);
      if (!health) return;
      say(cell("line"), device.line);
      say(cell("profile"), device.profile);
      say(cell("address"), String(device.address));
      say(cell("answers after"), health.delay === null ? "–" : `${(health.delay * 1000).toFixed(1)} ms`);
      for (const [counter, name] of COUNTERS) {
        if (counter in health.counters) say(cell(name), number(health.counters[counter]));
      }
    },
  };
}

const WELL = new Set(["answers", "fault"]);
const ASK_AGAIN = 5000; // ms after which a device may be asked for its state by itself again

/** Lines as a terminal has them, `name   text` and what goes on below it, as names and texts. */
function named(lines) {
  const rows = [];
  for (const line of lines) {
    const [, name, text] = /^(\S.*?)\s{2,}(.*)$/.exec(line) ?? [null, "", line.trim()];
    if (name || !rows.length) rows.push([name, text]);
    else rows[rows.length - 1][1] += ` · ${text}`;
  }
  return rows.flatMap(([name, text]) => [h("dt", {}, name), h("dd", {}, text)]);
}

/** What the device says of its state and its fault, by name; asked anew when its fault comes or goes. */
function says(name) {
  const lines = h("dl");
  const when = h("span", { class: "small dim" });
  const button = h("button", { type: "button", class: "quiet", onclick: () => ask() }, "Ask again");
  const node = h("div", { class: "card says", hidden: true }, lines, h("div", { class: "row" }, when, button));
  let asked = -Infinity;
  let time = null; // of the answer, in s of the server's clock
  let word = null;
  async function ask() {
    asked = Date.now();
    button.disabled = true;
    try {
      const found = await post("/api/status", { device: name });
      time = Date.parse(found.time) / 1000;
      node.hidden = found.lines.length === 0;
      lines.replaceChildren(...named(found.lines));
      mark(node, "is-old", false);
    } catch (error) {
      if (error.kind === "usage") return; // its protocol has no such question
      node.hidden = false;
      if (time === null) lines.replaceChildren(h("dd", {}, error.message));
      mark(node, "is-old", time !== null);
    }
    button.disabled = false;
  }
  return {
    node,
    draw(how) {
      say(when, time === null ? "" : `said ${age(now() - time)} ago`);
      if (!WELL.has(how.word)) { // nobody is there to ask
        word = null;
        mark(node, "is-old", time !== null);
      } else if (how.word !== word && Date.now() - asked >= ASK_AGAIN) {
        word = how.word;
        ask();
      }
    },
  };
}

export function deviceView(name) {
  const node = h("div");
  const word = h("span", { class: "state" });
  let parts = [];
  let device = null;
  const told = says(name); // this and the backups stay when the plant is read again, with what they show
  let backups = null;
  function build() {
    device = store.devices.get(name);
    if (!device) {
      node.replaceChildren(h("p", { class: "empty" }, `This plant has no device ${name}.`));
      parts = [];
      return;
    }
    const rows = device.points.map((point) => row(device, point));
    const counted = facts(device);
    if (backups?.kept === store.plant.parts.includes("passports")) backups.load();
    else backups = backupsSection(device);
    parts = [counted, ...rows, backups];
    const all = device.points.slice(0, 6).map((point) => `p=${encodeURIComponent(key(name, point.name))}`);
    node.replaceChildren(
      h("div", { class: "head" },
        h("div", {}, h("h1", {}, device.name), h("div", { class: "dim" }, device.title || device.profile)),
        word,
        h("span", { class: "push row" },
          h("a", { class: "button", href: `#/trends?${all.join("&")}&span=900` }, "Trends"),
          h("a", { class: "button", href: `#/wire/${encodeURIComponent(device.line)}?device=${encodeURIComponent(name)}` }, "Wire"),
          h("button", { type: "button", onclick: () => backups.focus() }, "Backups"))),
      counted.node,
      told.node,
      h("div", { class: "card scroll" },
        h("table", { class: "points" },
          h("thead", {}, h("tr", {},
            h("th", {}, "point"), h("th", { class: "end" }, "value"), h("th", {}, "last 5 min"),
            h("th", { class: "end" }, "age"), h("th", { class: "do" }))),
          h("tbody", {}, rows.map((one) => one.node)))),
      backups.node);
  }
  build();
  return {
    title: name,
    node,
    draw({ plant }) {
      if (plant) build();
      if (!device) return;
      const how = state(device);
      say(word, how.word);
      word.className = `state ${how.kind}`;
      told.draw(how);
      for (const part of parts) part.draw();
    },
  };
}

