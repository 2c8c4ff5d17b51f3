// What passes on a line, decoded, as it passes.

import { h, say } from "./dom.js";
import { listen } from "./link.js";
import { store } from "./store.js";

const MOST = 400; // rows that stay
const KINDS = [["", "everything"], ["write", "writes"], ["wrong", "what went wrong"]];

function isWrong(one) {
  return one.kind === "damage" || one.kind === "stray" || one.answered === false || one.refusal !== null;
}

function clock(time) {
  const at = new Date(time);
  const two = (value) => String(value).padStart(2, "0");
  return `${two(at.getHours())}:${two(at.getMinutes())}:${two(at.getSeconds())}.${String(at.getMilliseconds()).padStart(3, "0")}`;
}

function bytes(frames) {
  return frames.flatMap((frame, at) => [
    at ? " " : null,
    h("b", {}, frame.sent === true ? "> " : frame.sent === false ? "< " : "· "),
    frame.shown,
  ]);
}

function row(one) {
  const wrong = isWrong(one);
  const text = one.answered === false ? `${one.text}: no reply` : one.text;
  return h("tr", { class: [one.kind === "write" ? "write" : "", wrong ? "wrong" : ""].join(" ").trim() || null },
    h("td", { class: "number" }, clock(one.time)),
    h("td", { class: "who" }, one.device ?? (one.address === null ? "" : `address ${one.address}`)),
    h("td", {}, h("div", { class: "text" }, text), h("div", { class: "raw number" }, bytes(one.frames))),
    h("td", { class: "number end delay" }, one.answer_ms === null ? "" : `${one.answer_ms.toFixed(1)} ms`));
}

export function wireView(name, query) {
  const lines = store.plant.lines.map((line) => line.name);
  const line = lines.includes(name) ? name : lines[0];
  let device = query.get("device") ?? "";
  let kind = "";
  let paused = false;
  let waiting = [];
  let left = 0;
  const stop = new AbortController();
  const body = h("tbody");
  const note = h("p", { class: "dim small", role: "status" }, "listening …");
  const pause = h("button", { type: "button", "aria-pressed": "false", onclick: () => {
    paused = !paused;
    pause.setAttribute("aria-pressed", String(paused));
    if (!paused) flush();
    told();
  } }, "Pause");
  const choice = (word, items, value, f) => {
    const select = h("select", { "aria-label": word, onchange: () => f(select.value) }, items.map(([item, text]) => h("option", { value: item }, text)));
    select.value = value;
    return select;
  };
  const devices = [...store.devices.values()].filter((one) => one.line === line).map((one) => [one.name, one.name]);
  const node = h("div", {},
    h("div", { class: "head" }, h("h1", {}, "Wire"),
      choice("Line", lines.map((one) => [one, `line ${one}`]), line, (one) => { location.hash = `#/wire/${encodeURIComponent(one)}`; }),
      choice("Device", [["", "all devices"], ...devices], device, (one) => { device = one; clear(); }),
      choice("Kind", KINDS, kind, (one) => { kind = one; clear(); }),
      h("span", { class: "push row" }, pause, h("button", { type: "button", onclick: clear }, "Clear"))),
    note,
    h("div", { class: "card scroll" }, h("table", { class: "frames" },
      h("thead", {}, h("tr", {}, h("th", {}, "time"), h("th", { class: "who" }, "device"), h("th", {}, "meaning and bytes"), h("th", { class: "end delay" }, "answer after"))),
      body)));

  function clear() {
    waiting = [];
    body.replaceChildren();
  }
  function wanted(one) {
    if (device && one.device !== device && one.device !== null) return false;
    if (kind === "write") return one.kind === "write";
    return kind !== "wrong" || isWrong(one);
  }
  function flush() {
    body.prepend(...waiting.splice(0).reverse().map(row));
    while (body.childElementCount > MOST) body.lastElementChild.remove();
  }
  function told() {
    if (paused) say(note, `paused; ${waiting.length} more`);
    else say(note, left ? `${left} were left out: this browser is too slow for them` : "live, newest first");
  }
  if (line !== undefined) {
    listen(`/api/lines/${encodeURIComponent(line)}/frames`, {
      event(_, data) {
        left = data.left_out;
        waiting.push(...data.transactions.filter(wanted));
        if (waiting.length > MOST) waiting.splice(0, waiting.length - MOST);
        if (!paused) flush();
        told();
      },
      lost(failure) {
        say(note, `${failure.message}; trying again …`);
      },
    }, stop.signal);
  }
  return {
    title: "Wire",
    node,
    draw() {},
    leave() {
      stop.abort();
    },
  };
}
