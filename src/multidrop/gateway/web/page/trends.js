// Charts of any points over any time: one chart for each unit, all with the same time.

import { h, number, say } from "./dom.js";
import { get, save } from "./link.js";
import { key, now, store, trust } from "./store.js";

const SPANS = [
  [300, "5 min"], [900, "15 min"], [3600, "1 h"], [8 * 3600, "8 h"], [86400, "1 d"], [7 * 86400, "7 d"], [30 * 86400, "30 d"],
];
const MOST = 12; // points that can be told apart
const FIRST = 4; // points of a device that it begins with
const FRESH = 60; // s after which what was kept is asked for again
const COLOURS = {
  light: ["#0a6c60", "#b4520a", "#2f5bb7", "#9a2b6e", "#5c7a12", "#7a4fc0", "#1590a8", "#8c6b00", "#c23b3b", "#3c6e47", "#5a5a5a", "#a85f9c"],
  dark: ["#5fcdb6", "#f2a65a", "#8fb2ff", "#ef8fc0", "#b5d46a", "#c3a6ff", "#6fd3ea", "#e6cc5c", "#ff8b7e", "#8fd19e", "#c4c4c4", "#e0a8da"],
};

const PAPER = { "--ink": "#000", "--dim": "#333", "--line": "#bbb" };
const WIDTH_OF_PAPER = 680; // px: what a canvas may have so that no printer cuts its end off
let printing = false;
addEventListener("beforeprint", () => paper(true));
addEventListener("afterprint", () => paper(false));

/** What is drawn is no style, so it is drawn anew: dark on white, and as wide as a page. */
function paper(on) {
  printing = on;
  dispatchEvent(new Event("theme"));
}

const css = (name) => (printing ? PAPER[name] : undefined) ?? getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const isDark = () => css("--ink").startsWith("#e");
const colour = (place) => COLOURS[isDark() ? "dark" : "light"][place % MOST];

const two = (value) => String(value).padStart(2, "0");
const DAY = new Intl.DateTimeFormat("en-GB", { day: "numeric", month: "short" });

/** Ticks of the time: the clock of 24 hours, and the day where it is another. */
function ticks(_, times, __, ___, step) {
  let before = "";
  return times.map((time) => {
    const at = new Date(time * 1000);
    const day = DAY.format(at);
    const clock = step >= 86400 ? "" : `${two(at.getHours())}:${two(at.getMinutes())}${step < 60 ? `:${two(at.getSeconds())}` : ""}`;
    const shown = day === before && clock ? clock : `${clock}\n${day}`.trim();
    before = day;
    return shown;
  });
}

function moment(_, time) {
  if (time === null || time === undefined) return "–";
  const at = new Date(time * 1000);
  return `${DAY.format(at)} ${at.toLocaleTimeString("en-GB")}`;
}

function faint(hex) {
  return `${hex}2e`;
}

/** What is drawn of one point: columns of s, and values with the least and most between two of them. */
async function load(name, start, end, signal) {
  if (!store.plant.parts.includes("history")) return { time: [], minimum: [], maximum: [], last: [] };
  const [device, point] = split(name);
  const query = `start=${start.toFixed(3)}&end=${end.toFixed(3)}&most=1000`;
  return broken(await get(`/api/history/${encodeURIComponent(device)}/${encodeURIComponent(point)}?${query}`, signal));
}

/** The line ends where nothing was known: behind a bucket with a gap there is a null. */
function broken(columns) {
  const kept = { time: [], minimum: [], maximum: [], last: [] };
  const names = ["minimum", "maximum", "last"];
  columns.time.forEach((time, at) => {
    kept.time.push(time);
    for (const name of names) {
      const value = columns[name][at];
      kept[name].push(typeof value === "number" ? value : null);
    }
    if (columns.gap[at] && columns.last[at] !== null) {
      const next = columns.time[at + 1] ?? time + 2;
      kept.time.push((time + next) / 2);
      for (const name of names) kept[name].push(null);
    }
  });
  return kept;
}

function split(name) {
  const point = store.points.get(name);
  return point ? [point.device, point.name] : name.split("/");
}

/** The same with the values that came since, and those before it where nothing is kept. */
function withLive(columns, name, start, end) {
  const past = store.past.get(name);
  if (!past) return columns;
  const known = columns.time.length ? columns.time[columns.time.length - 1] : -Infinity;
  const joined = { time: [...columns.time], minimum: [...columns.minimum], maximum: [...columns.maximum], last: [...columns.last] };
  past.times.forEach((time, at) => {
    if (time <= known || time < start || time > end) return;
    joined.time.push(time);
    for (const column of ["minimum", "maximum", "last"]) joined[column].push(past.values[at]);
  });
  const last = joined.time.length - 1;
  if (last >= 0 && end - joined.time[last] > 0 && end - now() > -1 && joined.last[last] !== null && trust(name).kind === "") {
    joined.time.push(end);
    for (const column of ["minimum", "maximum", "last"]) joined[column].push(joined.last[last]);
  }
  return joined;
}

function chart(unit, names, places, onZoom) {
  const holder = h("div");
  const node = h("section", { class: "chart card" }, h("h2", {}, unit || "no unit"), holder);
  let plot = null;
  function options(width) {
    const axis = { stroke: css("--dim"), grid: { stroke: css("--line"), width: 1 }, ticks: { stroke: css("--line"), width: 1 }, font: "13px sans-serif" };
    const series = [{ label: "time", value: moment }];
    const bands = [];
    names.forEach((name, at) => {
      const shade = colour(places.get(name));
      const [device, point] = split(name);
      const decimals = Math.max(1, store.past.get(name)?.decimals ?? 3);
      const value = (_, raw) => (raw === null || raw === undefined ? "–" : number(raw, decimals));
      const paths = window.uPlot.paths.stepped({ align: 1 }); // a value holds until the next one came
      const limit = { paths, stroke: "transparent", points: { show: false }, show: true, label: "" };
      series.push({ label: `${device} ${point.replaceAll("_", " ")}`, stroke: shade, width: 2, paths, points: { show: false }, value });
      series.push(limit, limit);
      bands.push({ series: [3 * at + 3, 3 * at + 2], fill: faint(shade) });
    });
    return {
      width, height: Math.max(240, Math.min(420, innerHeight / 2.6)), series, bands,
      axes: [{ ...axis, values: ticks, space: 90 }, { ...axis, size: 72, values: (_, ticks) => ticks.map((tick) => number(tick, 2)) }],
      cursor: { sync: { key: "trends" }, drag: { x: true, y: false, setScale: false } },
      legend: { live: true },
      scales: { x: { time: true }, y: { range: (_, low, high) => padded(low, high) } },
      hooks: {
        setSelect: [(u) => {
          if (u.select.width < 6) return;
          onZoom(u.posToVal(u.select.left, "x"), u.posToVal(u.select.left + u.select.width, "x"));
          u.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
        }],
        ready: [(u) => {
          u.root.querySelectorAll(".u-legend .u-series").forEach((row, at) => { row.hidden = at > 0 && at % 3 !== 1; });
        }],
      },
    };
  }
  return {
    node, names,
    draw(columns, start, end) {
      const width = printing ? Math.min(WIDTH_OF_PAPER, holder.clientWidth) : holder.clientWidth;
      if (!width) return;
      const tables = names.map((name) => {
        const known = columns.get(name);
        return known.time.length ? [known.time, known.last, known.maximum, known.minimum] : [[start], [null], [null], [null]];
      });
      const data = window.uPlot.join(tables);
      if (!plot) plot = new window.uPlot(options(width), data, holder);
      else {
        if (plot.width !== width) plot.setSize({ width, height: plot.height });
        plot.setData(data, false);
      }
      plot.setScale("x", { min: start, max: end });
    },
    forget() {
      plot?.destroy();
      plot = null;
    },
  };
}

function padded(low, high) {
  if (low === null || high === null) return [0, 1];
  if (low === high) return [low - Math.max(1, Math.abs(low) * 0.05), high + Math.max(1, Math.abs(high) * 0.05)];
  const room = (high - low) * 0.08;
  return [low - room, high + room];
}

function local(seconds) {
  const at = new Date(seconds * 1000 - new Date().getTimezoneOffset() * 60000);
  return at.toISOString().slice(0, 19);
}

export function trendsView(query) {
  let names = [...new Set(query.getAll("p"))].slice(0, MOST);
  let span = Number(query.get("span")) || (query.get("from") ? 0 : 900);
  let from = Number(query.get("from")) || 0;
  let to = Number(query.get("to")) || 0;
  const kept = new Map(); // name -> columns as the server had them
  let charts = [];
  let asked = -Infinity;
  let loading = null;
  let failed = "";
  let places = new Map();

  const chips = h("div", { class: "picker" });
  const search = h("input", { type: "search", list: "all-points", placeholder: "Add a point …", "aria-label": "Add a point", autocomplete: "off" });
  const known = h("datalist", { id: "all-points" });
  const spans = h("div", { class: "row", role: "group", "aria-label": "Time" });
  const begin = h("input", { type: "datetime-local", step: 1, "aria-label": "From" });
  const finish = h("input", { type: "datetime-local", step: 1, "aria-label": "To" });
  const show = h("button", { type: "button" }, "Show");
  const note = h("p", { class: "dim small" });
  const area = h("div");
  const node = h("div", {},
    h("div", { class: "head" }, h("h1", {}, "Trends"), spans,
      h("details", { class: "push" }, h("summary", {}, "Another time"), h("span", { class: "row" }, begin, "to", finish, show))),
    chips, note, area);

  function window_() {
    return span ? [now() - span, now()] : [from, to];
  }
  function remember() {
    const parts = names.map((name) => `p=${encodeURIComponent(name)}`);
    if (span) parts.push(`span=${span}`);
    else parts.push(`from=${from.toFixed(0)}`, `to=${to.toFixed(0)}`);
    history.replaceState(null, "", `#/trends?${parts.join("&")}`);
  }
  function choose(newSpan, newFrom = 0, newTo = 0) {
    [span, from, to] = [newSpan, newFrom, newTo];
    kept.clear();
    rebuild();
  }
  function rebuild() {
    remember();
    places = new Map(names.map((name, at) => [name, at]));
    spans.replaceChildren(...SPANS.map(([seconds, word]) =>
      h("button", { type: "button", "aria-pressed": String(span === seconds), onclick: () => choose(seconds) }, word)));
    const [start, end] = window_();
    begin.value = local(start);
    finish.value = local(end);
    known.replaceChildren(...[...store.points].filter(([name]) => !places.has(name)).map(([name, point]) =>
      h("option", { value: name }, `${point.meaning || point.at}${point.unit ? `, ${point.unit}` : ""}`)));
    chips.replaceChildren(...names.map((name) => {
      const chip = h("span", { class: "chip" }, name.replace("/", " ").replaceAll("_", " "),
        h("button", { type: "button", class: "quiet", "aria-label": `Remove ${name}`, onclick: () => { names = names.filter((other) => other !== name); rebuild(); } }, "✕"));
      chip.style.setProperty("--ink-of", colour(places.get(name)));
      return chip;
    }), search, known, csv);
    csv.hidden = !names.length || !store.plant.parts.includes("history");
    for (const one of charts) one.forget();
    const groups = new Map();
    for (const name of names) {
      const unit = store.points.get(name)?.unit ?? "";
      groups.set(unit, [...(groups.get(unit) ?? []), name]);
    }
    charts = [...groups].map(([unit, group]) => chart(unit, group, places, (a, b) => choose(0, a, b)));
    area.replaceChildren(...charts.map((one) => one.node));
    if (!names.length) area.append(beginning());
    fetchAll();
  }
  /** What is there to begin with: the first points of each device. */
  function beginning() {
    const devices = [...store.devices.values()].map((device) => h("button", {
      type: "button",
      onclick: () => {
        names = device.points.slice(0, FIRST).map((point) => key(device.name, point.name));
        rebuild();
      },
    }, device.name));
    return h("div", { class: "empty" }, h("p", {}, "No point is chosen. Add one above, or begin with those of"), h("div", { class: "row" }, devices));
  }
  async function fetchAll() {
    loading?.abort();
    const mine = (loading = new AbortController());
    asked = now();
    const [start, end] = window_();
    try {
      await Promise.all(names.map(async (name) => {
        kept.set(name, await load(name, start, end, mine.signal));
      }));
      failed = "";
    } catch (error) {
      if (error.name === "AbortError") return;
      failed = error.message;
    }
    drawCharts();
  }
  function drawCharts() {
    const [start, end] = window_();
    const nothing = { time: [], minimum: [], maximum: [], last: [] };
    const columns = new Map(names.map((name) => [name, withLive(kept.get(name) ?? nothing, name, start, end)]));
    for (const one of charts) one.draw(columns, start, end);
    const memory = store.plant.parts.includes("history") ? "" : "No history is kept ([history] is not in the plant file): this page shows what it has seen itself.";
    say(note, failed ? `History: ${failed}` : memory);
  }
  const csv = h("button", { type: "button", onclick: async () => {
    const [start, end] = window_();
    const points = names.map((name) => `point=${encodeURIComponent(name)}`).join("&");
    try {
      await save(`/api/history.csv?${points}&start=${start.toFixed(3)}&end=${end.toFixed(3)}`, "multidrop.csv");
    } catch (error) {
      failed = error.message;
      drawCharts();
    }
  } }, "Save as CSV");
  search.addEventListener("change", () => {
    if (store.points.has(search.value) && names.length < MOST) {
      names = [...names, search.value];
      search.value = "";
      rebuild();
    }
  });
  show.addEventListener("click", () => {
    const [a, b] = [Date.parse(begin.value) / 1000, Date.parse(finish.value) / 1000];
    if (b > a) choose(0, a, b);
  });
  const again = () => {
    for (const one of charts) one.forget();
    rebuild();
    drawCharts(); // with what is known: a printer does not wait
  };
  addEventListener("theme", again);
  addEventListener("resize", drawCharts);
  let drawn = 0;
  rebuild();
  return {
    title: "Trends",
    node,
    draw({ plant }) {
      if (plant) rebuild();
      if (span && now() - asked > FRESH) fetchAll();
      if (Date.now() - drawn < 400) return;
      drawn = Date.now();
      if (span || drawn - asked < 1) drawCharts();
    },
    leave() {
      loading?.abort();
      removeEventListener("theme", again);
      removeEventListener("resize", drawCharts);
      for (const one of charts) one.forget();
    },
  };
}

