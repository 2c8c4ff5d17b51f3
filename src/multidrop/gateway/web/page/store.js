// All that the page knows: the plant, the newest values, how lines and devices are, and the last minutes.

import { Failure, get, listen } from "./link.js";

const KEPT = 900; // s of values that the page remembers by itself
const OLD = 3; // periods, and two seconds, after which a value is called old

export const store = {
  plant: { lines: [], parts: [] },
  devices: new Map(), // name -> device, as /api/plant has it
  points: new Map(), // "device/point" -> point, with its device
  values: new Map(), // the same -> value, as /api/values has it, with `at` in s of the server's clock
  past: new Map(), // the same -> {times, values, decimals}
  lines: new Map(), // name -> health
  health: new Map(), // device name -> health
  kept: {}, // part -> how it keeps or delivers what comes: history, mqtt
  troubles: [], // what is not recorded or not delivered, as /api/status has it
  readings: new Map(), // device name -> the last reading of all its points
  lost: null, // since when, ms of this clock
  why: null,
};

const offsets = []; // s by which this clock is ahead of the server's, the last ones measured
let watchers = new Set();
let asked = false;

/** Be told, at most once a frame, when something has changed: f({plant: bool}). */
export function watch(f) {
  watchers.add(f);
  return () => watchers.delete(f);
}

let news = { plant: false };

export function changed(plant = false) {
  news.plant ||= plant;
  if (asked) return;
  asked = true;
  const draw = () => {
    asked = false;
    const told = news;
    news = { plant: false };
    for (const f of [...watchers]) f(told);
  };
  if (document.hidden) setTimeout(draw, 500);
  else requestAnimationFrame(draw);
}

/** Now, in s of the server's clock: what is measured there must not be judged by a phone's clock. */
export function now() {
  return Date.now() / 1000 - (offsets.length ? Math.min(...offsets) : 0);
}

export const key = (device, point) => `${device}/${point}`;

export async function loadPlant() {
  const plant = await get("/api/plant");
  store.plant = plant;
  store.devices = new Map();
  store.points = new Map();
  for (const line of plant.lines) {
    for (const device of line.devices) {
      store.devices.set(device.name, device);
      for (const point of device.points) {
        store.points.set(key(device.name, point.name), { ...point, device: device.name });
      }
    }
  }
  for (const known of [...store.values.keys()]) if (!store.points.has(known)) store.values.delete(known);
  changed(true);
}

const REMEMBERED = 80; // points whose last minutes are asked for when the page is opened
let remembered = false;

/** What was before this page was opened, so that its small trends are whole at once. */
async function remember() {
  if (remembered || !store.plant.parts.includes("history")) return;
  remembered = true;
  for (const [name, point] of [...store.points].slice(0, REMEMBERED)) {
    const end = now();
    const path = `/api/history/${encodeURIComponent(point.device)}/${encodeURIComponent(point.name)}`;
    const kept = await get(`${path}?start=${(end - 300).toFixed(3)}&end=${end.toFixed(3)}&most=150`).catch(() => null);
    const past = store.past.get(name);
    if (!kept || !past) continue;
    const first = past.times[0] ?? end;
    const older = kept.time.map((time, at) => [Math.max(time, end - 300), kept.last[at]]).filter(([time, value]) => time < first && typeof value === "number");
    if (!older.length) continue;
    past.times.unshift(...older.map(([time]) => time), first - 0.001);
    past.values.unshift(...older.map(([, value]) => value), older[older.length - 1][1]);
    changed();
  }
}

function take(value) {
  const name = key(value.device, value.point);
  value.at = value.time === null ? null : Date.parse(value.time) / 1000;
  store.values.set(name, value);
  let past = store.past.get(name);
  if (!past) store.past.set(name, (past = { times: [], values: [], decimals: 0 }));
  const good = value.quality === "good" && value.at !== null;
  const number = typeof value.value === "boolean" ? Number(value.value) : value.value;
  const plain = good && typeof number === "number" ? number : null;
  const time = good ? value.at : Date.parse(value.checked) / 1000;
  const last = past.times[past.times.length - 1];
  if (last !== undefined && time <= last) return;
  past.times.push(time);
  past.values.push(plain);
  if (plain !== null && !Number.isInteger(plain)) {
    const decimals = Math.max(0, 3 - Math.floor(Math.log10(Math.max(1, Math.abs(plain)))));
    const fraction = String(Number(plain.toFixed(decimals))).split(".")[1] ?? "";
    past.decimals = Math.max(past.decimals, fraction.length);
  }
  if (past.times[0] < time - KEPT - 60) {
    const from = past.times.findIndex((at) => at >= time - KEPT);
    past.times.splice(0, from);
    past.values.splice(0, from);
  }
}

const EVENTS = {
  values(values) {
    values.forEach(take);
    changed();
  },
  status(status) {
    offsets.push(Date.now() / 1000 - Date.parse(status.now) / 1000);
    if (offsets.length > 30) offsets.shift();
    store.lines = new Map(status.lines.map((line) => [line.name, line]));
    store.health = new Map(status.devices.map((device) => [device.name, device]));
    store.kept = { history: status.history, mqtt: status.mqtt };
    store.troubles = status.troubles;
    store.readings = new Map(status.readings.map((one) => [one.device, one]));
    changed();
    remember();
  },
  plant() {
    loadPlant().catch(() => {});
  },
};

let stopping = null;

/** Listen to the server until this is called again. */
export function follow() {
  stopping?.abort();
  stopping = new AbortController();
  listen(
    "/api/events",
    {
      open() {
        store.lost = null;
        store.why = null;
        loadPlant().catch(() => {});
      },
      event(name, data) {
        EVENTS[name]?.(data);
      },
      lost(failure) {
        store.lost ??= Date.now();
        store.why = failure instanceof Failure ? failure : null;
        changed();
      },
    },
    stopping.signal,
  );
}

/** How far a value can be trusted now: {word, kind}; kind is "", "old" or "bad". */
export function trust(name) {
  const value = store.values.get(name);
  if (!value) return { word: "not read yet", kind: "old" };
  if (store.lost !== null) return { word: "server lost", kind: "old" };
  if (value.quality === "stale") return { word: "old", kind: "old" };
  if (value.quality !== "good") return { word: value.quality, kind: "bad" };
  const every = store.points.get(name)?.every ?? 1;
  if (now() - value.at > OLD * every + 2) return { word: "old", kind: "old" };
  return { word: "", kind: "" };
}

/** The state of a device in one word: {word, kind}; kind is "good", "warn" or "bad". */
export function state(device) {
  if (store.lost !== null) return { word: "not known", kind: "warn" };
  const line = store.lines.get(device.line);
  const health = store.health.get(device.name);
  if (!line || !health) return { word: "not known", kind: "warn" };
  if (line.lost !== null) return { word: "port lost", kind: "bad" };
  if (health.silent) return { word: "no reply", kind: "bad" };
  const names = device.points.map((point) => key(device.name, point.name));
  const fault = names.some((name) => store.values.get(name)?.fault === true);
  if (fault) return { word: "fault", kind: "bad" };
  const wrong = names.filter((name) => trust(name).kind === "bad").length;
  if (wrong) return { word: wrong === 1 ? "1 point not read" : `${wrong} points not read`, kind: "warn" };
  return { word: "answers", kind: "good" };
}
