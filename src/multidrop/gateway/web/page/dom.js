// Nodes, numbers and times. Text from the server only ever becomes text, never markup.

/** h("p", {class: "x", onclick: f}, child, ...): an element; a child is a node, a text or null. */
export function h(name, attributes = {}, ...children) {
  const node = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (value === null || value === undefined || value === false) continue;
    if (key.startsWith("on")) node.addEventListener(key.slice(2), value);
    else if (key === "value" || key === "checked") node[key] = value;
    else node.setAttribute(key, value === true ? "" : value);
  }
  node.append(...children.flat().filter((child) => child !== null && child !== undefined));
  return node;
}

/** Change a text only where it is another: a node that is left alone costs nothing and keeps its selection. */
export function say(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

export function mark(node, name, on) {
  if (node.classList.contains(name) !== on) node.classList.toggle(name, on);
}

const GROUPED = new Intl.NumberFormat("en", { maximumFractionDigits: 0, useGrouping: true });

/** A code as manuals print it: 2310h. */
export const hex = (code) => `${code.toString(16).toUpperCase().padStart(4, "0")}h`;

/** A number with at most `decimals` digits behind the point, thousands set apart. */
export function number(value, decimals = 4) {
  if (!Number.isFinite(value)) return "–";
  const size = Math.abs(value);
  if (size !== 0 && (size >= 1e9 || size < 1e-4)) return value.toExponential(3);
  const [whole, fraction] = size.toFixed(Number.isInteger(value) ? Math.min(decimals, 0) : decimals).split(".");
  const sign = value < 0 ? "−" : "";
  const grouped = GROUPED.format(Number(whole)).replaceAll(",", "\u202f");
  return sign + grouped + (fraction ? "." + fraction : "");
}

/** A value as people read it; without a unit it may be a code or a word, whose digits stay together. */
export function shown(value, decimals, unit = null) {
  if (value === null || value === undefined) return "–";
  if (typeof value === "number") return unit || !Number.isInteger(value) ? number(value, decimals) : String(value).replace("-", "−");
  if (typeof value === "boolean") return value ? "on" : "off";
  return String(value);
}

/** Seconds as an age: 0.4 s, 12 s, 3 min, 2 h, 5 d. */
export function age(seconds) {
  if (!Number.isFinite(seconds)) return "";
  const s = Math.max(0, seconds);
  if (s < 10) return `${s.toFixed(1)} s`;
  if (s < 100) return `${Math.round(s)} s`;
  if (s < 6000) return `${Math.round(s / 60)} min`;
  if (s < 2 * 86400) return `${Math.round(s / 3600)} h`;
  return `${Math.round(s / 86400)} d`;
}

/** A time as the server gives it, on this clock. */
export function moment(time) {
  return new Date(time).toLocaleString("en-GB", { dateStyle: "medium", timeStyle: "medium" });
}

export function percent(share) {
  return `${Math.round(share * 100)} %`;
}

const SVG = "http://www.w3.org/2000/svg";

/** A small trend without axes; `draw(times, values)` with the newest last. */
export function sparkline() {
  const svg = document.createElementNS(SVG, "svg");
  svg.setAttribute("viewBox", "0 0 100 24");
  svg.setAttribute("preserveAspectRatio", "none");
  svg.setAttribute("class", "spark");
  svg.setAttribute("aria-hidden", "true");
  const path = document.createElementNS(SVG, "path");
  svg.append(path);
  function draw(times, values, most = 120) {
    const end = times[times.length - 1];
    const seconds = Math.min(most, Math.max(20, end - times[0]));
    let first = times.length - 1;
    while (first > 0 && times[first] > end - seconds) first -= 1; // and the one that holds at its begin
    let low = Infinity;
    let high = -Infinity;
    for (let at = first; at < values.length; at += 1) {
      const value = values[at];
      if (value === null) continue;
      if (value < low) low = value;
      if (value > high) high = value;
    }
    if (low > high) {
      path.setAttribute("d", "");
      return;
    }
    const span = high - low || 1;
    const flat = high === low;
    let text = "";
    let pen = "M";
    for (let at = first; at < values.length; at += 1) {
      if (values[at] === null) {
        pen = "M";
        continue;
      }
      const x = Math.max(0, 100 - ((end - times[at]) / seconds) * 100);
      const y = flat ? 12 : 22 - ((values[at] - low) / span) * 20;
      text += pen === "M" ? `M${x.toFixed(2)} ${y.toFixed(2)}` : `H${x.toFixed(2)}V${y.toFixed(2)}`; // it holds until the next
      pen = "H";
    }
    path.setAttribute("d", text);
  }
  return { node: svg, draw };
}
