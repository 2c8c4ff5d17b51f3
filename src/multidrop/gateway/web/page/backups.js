// Backups of one device: make one, see the list, save one as a file, and what was changed since.

import { age, h, moment, say, shown } from "./dom.js";
import { Failure, get, post, save } from "./link.js";
import { now, store } from "./store.js";
import { mayWrite } from "./write.js";

const ENDED = new Set(["done", "failed", "stopped"]);
const FORGOTTEN = 5; // s after which the server would tell of a reading if it still knew of it
const NOW = ""; // in the list of what is compared: the device itself

const url = (device, name, more = "") => `/api/passports/${encodeURIComponent(device)}/${encodeURIComponent(name)}${more}`;

/** A side of a difference: a value with its unit, or why there is none. */
function side(item) {
  if (item === null) return h("span", { class: "dim" }, "not in it");
  if (item.reason !== null) return h("span", { class: "dim" }, `not read: ${item.reason}`);
  return h("span", {}, h("span", { class: "number" }, shown(item.value, 6, item.unit)), h("span", { class: "unit" }, item.unit ?? ""));
}

function table(found) {
  return h("div", { class: "card scroll" }, h("table", { class: "changes" },
    h("thead", {}, h("tr", {},
      h("th", { scope: "col" }, "point"), h("th", { scope: "col" }, "name"),
      h("th", { scope: "col", class: "end" }, "before"), h("th", { scope: "col", class: "end" }, "after"))),
    h("tbody", {}, found.differences.map((item) => h("tr", {},
      h("td", { class: "number" }, item.point),
      h("td", { class: "name" }, h("strong", {}, (item.name ?? "").replaceAll("_", " ")),
        item.role === "setting" ? null : h("span", { class: "dim small" }, ` ${item.role}`)),
      h("td", { class: "end before" }, side(item.before)),
      h("td", { class: "end after" }, side(item.after)))))));
}

/** What is being read of a device, with a bar; or what came of it. */
function progress(stop) {
  const bar = h("progress", { max: 1, value: 0, "aria-label": "How far it is read" });
  const text = h("span", { class: "number small" });
  const button = h("button", { type: "button", onclick: stop }, "Stop");
  const running = h("div", { class: "note reading", hidden: true }, bar, text, button);
  const told = h("p", { class: "note", role: "status", hidden: true });
  return {
    node: h("div", {}, running, told),
    tell(kind, words) {
      told.hidden = !words;
      told.className = `note ${kind}`;
      say(told, words);
    },
    draw(one) {
      running.hidden = one.state !== "reading" || store.lost !== null;
      if (running.hidden) return;
      bar.max = Math.max(1, one.points);
      bar.value = one.done;
      const took = now() - Date.parse(one.started) / 1000;
      const left = one.done > 10 && took > 1 ? `, about ${age((took / one.done) * (one.points - one.done))} left` : "";
      say(text, `${one.keep ? "backup" : "reading"}: ${one.done} of ${one.points} points${left}`);
    },
  };
}

/** How a passport comes back: never from here. */
function restoring(name) {
  const command = h("code");
  const node = h("details", { class: "restore" },
    h("summary", {}, "Put a backup back into the device"),
    h("p", {}, "That writes to the machine, so it is not done from here. On the gateway's own machine, in the folder of the plant file, with the gateway stopped and the device disabled:"),
    h("pre", {}, command),
    h("p", {}, "It shows what it would write, and writes nothing. The same without --dry-run asks, writes each point, reads it back, and leaves a passport that undoes it."));
  return {
    node,
    draw(path) {
      say(command, `multidrop restore "${path}" "${name}" --dry-run`);
    },
  };
}

/** The section of a device's view. */
export function backupsSection({ name }) {
  const rows = h("tbody");
  const list = h("div", { class: "card passports-list" }, h("table", { class: "passports" },
    h("thead", {}, h("tr", {}, ["made", "points", "file"].map((word) => h("th", { scope: "col" }, word)), h("th", { class: "do" }))), rows));
  const none = h("p", { class: "dim" }, "There is none of this device yet.");
  const make = h("button", { type: "button", class: "main", onclick: () => begin("/api/passports") }, "Make a backup");
  const before = h("select", { "aria-label": "Before", onchange: forget });
  const after = h("select", { "aria-label": "After", onchange: forget });
  const all = h("input", { type: "checkbox", onchange: forget });
  const show = h("button", { type: "button", onclick: compare }, "Show differences");
  const choose = h("form", { class: "row choose", onsubmit: (event) => event.preventDefault() },
    h("label", {}, "from ", before), h("label", {}, "to ", after),
    h("label", { class: "check" }, all, "setpoints and commands too"), show);
  const differences = h("div", { class: "differences", "aria-live": "polite" });
  const back = restoring(name);
  const reading = progress(() => act("/api/read-all/stop"));
  const title = h("h2", { tabindex: "-1" }, "Backups");
  const some = h("div", { hidden: true }, list, h("h3", {}, "What was changed"), choose, differences, back.node);
  const node = h("section", { class: "backups", "aria-label": "Backups" },
    h("header", { class: "row" }, title, h("span", { class: "push" }, make)),
    h("p", { class: "dim small" }, "A backup reads every point of the device, and writes nothing to it. The polls go on meanwhile."),
    reading.node, none, some);
  let passports = [];
  let state = { state: null, started: "" }; // the newest reading of all points
  let waiting = false; // for the device to be read, to compare with it
  const kept = store.plant.parts.includes("passports");

  function stamp(item) {
    return item.time === null ? "damaged" : moment(item.time);
  }
  function row(item) {
    const file = h("button", { type: "button", "aria-label": `Save ${item.name}`, onclick: async () => {
      try {
        await save(url(name, item.name), item.name);
      } catch (error) {
        reading.tell("bad", error.message);
      }
    } }, "Save");
    const since = h("button", { type: "button", "aria-label": `What was changed since ${stamp(item)}`, onclick: () => {
      before.value = item.name;
      after.value = NOW;
      compare();
    } }, "Changes since");
    const unread = item.unreadable ? ` (${item.unreadable} not read)` : "";
    return h("tr", { class: item.damage ? "is-bad" : null },
      h("td", {}, h("span", {}, item.time === null ? "–" : moment(item.time)), item.damage ? h("div", {}, h("span", { class: "tag bad" }, "damaged")) : null),
      h("td", { class: "number" }, item.made_as === null ? "–" : `${item.points}${unread}`),
      h("td", {}, h("div", { class: "file" }, item.name), item.damage ? h("div", { class: "meaning" }, item.damage) : null),
      h("td", { class: "do" }, item.damage ? null : since, " ", item.made_as === null ? null : file));
  }
  function options(select, items) {
    const chosen = select.value;
    select.replaceChildren(...items.map(([value, text]) => h("option", { value }, text)));
    if (items.some(([value]) => value === chosen)) select.value = chosen;
  }
  async function load() {
    if (!kept) return;
    try {
      passports = await get(`/api/passports?device=${encodeURIComponent(name)}`);
    } catch (error) {
      if (error.status !== 0) reading.tell("bad", error.message);
      return;
    }
    const usable = passports.filter((item) => !item.damage);
    rows.replaceChildren(...passports.map(row));
    none.hidden = passports.length > 0;
    some.hidden = passports.length === 0;
    options(before, usable.map((item) => [item.name, stamp(item)]));
    options(after, [[NOW, "the device as it is now"], ...usable.map((item) => [item.name, stamp(item)])]);
    drawCommand();
  }
  function drawCommand() {
    const chosen = passports.find((item) => item.name === before.value) ?? passports[0];
    back.draw(chosen?.path ?? "");
  }
  function forget() {
    differences.replaceChildren();
    waiting = false;
    drawCommand();
  }
  async function act(path) {
    try {
      take(await post(path, { device: name }));
      return true;
    } catch (error) {
      reading.tell("bad", error.message);
      return false;
    }
  }
  async function begin(path) {
    reading.tell("", "");
    try {
      if (await mayWrite("A backup leaves a file on the gateway's machine: that needs a token that may write.")) await act(path);
    } catch (error) {
      reading.tell("bad", error.message);
    }
  }
  async function compare() {
    reading.tell("", "");
    forget();
    if (after.value !== NOW) {
      await fetchDifferences();
      return;
    }
    waiting = await act("/api/read-all");
    if (waiting) differences.replaceChildren(h("p", { class: "dim" }, "Reading the device …"));
  }
  async function fetchDifferences() {
    const to = after.value === NOW ? "" : `&to=${encodeURIComponent(after.value)}`;
    try {
      const found = await get(url(name, before.value, `/differences?all=${all.checked}${to}`));
      const times = `${moment(found.before.time)} to ${moment(found.after.time)}`;
      const count = found.differences.length;
      const words = count === 0 ? "Nothing differs" : count === 1 ? "1 point differs" : `${count} points differ`;
      const unread = found.after.unreadable ? ` ${found.after.unreadable} points could not be read.` : "";
      differences.replaceChildren(
        h("p", { class: count ? "" : "good" }, h("strong", {}, words), h("span", { class: "dim" }, `, ${times}. Measured points are not compared.${unread}`)),
        count ? table(found) : "");
    } catch (error) {
      if (!(error instanceof Failure)) throw error;
      differences.replaceChildren(h("p", { class: "note bad" }, error.message));
    }
  }
  /** The reading of all points as the server tells it; some of it may have been seen already. */
  function take(one) {
    const known = state;
    if (!one && known.state === "reading" && now() - Date.parse(known.started) / 1000 > FORGOTTEN)
      one = { ...known, started: new Date().toISOString(), state: "failed", error: "the gateway was started anew" };
    const older = !one || one.started < known.started || (one.started === known.started && ENDED.has(known.state));
    one = state = older ? known : one; // what was told before is overtaken by what came of a request
    reading.draw(one);
    const busy = one.state === "reading" || store.lost !== null;
    make.disabled = busy;
    show.disabled = busy || !before.options.length;
    if (known.started === one.started && known.state === one.state) return;
    const begun = known.state === "reading" && one.state !== "reading"; // this page saw it under way
    if (one.state === "done" && one.keep) {
      load();
      if (begun) reading.tell("good", `Backup made: ${one.points - one.unreadable} points${one.unreadable ? `, ${one.unreadable} could not be read` : ""}.`);
    }
    if (begun && one.state === "failed") reading.tell("bad", `${one.keep ? "No backup was made" : "Not read"}: ${one.error}`);
    if (begun && one.state === "stopped") reading.tell("warn", "Stopped; nothing was kept.");
    if (!waiting || one.state === "reading") return;
    waiting = false;
    if (one.state === "done") fetchDifferences();
    else differences.replaceChildren();
  }
  if (!kept) {
    make.hidden = true;
    none.textContent = "No backups are kept: [passports] is not in the plant file.";
  }
  load();
  return {
    node, kept, load,
    focus() {
      title.scrollIntoView({ block: "start" });
      title.focus({ preventScroll: true });
    },
    draw() {
      take(store.readings.get(name));
    },
  };
}
