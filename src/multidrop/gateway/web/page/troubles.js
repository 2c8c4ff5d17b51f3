// What is not recorded or not delivered now, in plain words; else how much waits, and for how long there is room.

import { age, h, mark, moment, number, say } from "./dom.js";
import { now, store } from "./store.js";

const HOUR = 3600; // s

function line() {
  const text = h("strong");
  const since = h("span");
  const node = h("p", { class: "note" }, text, " ", since);
  return {
    node,
    draw(trouble) {
      say(text, trouble.text);
      const ago = age(now() - Date.parse(trouble.since) / 1000);
      const room = trouble.hours === null ? "" : ` There is room for ${age(trouble.hours * HOUR)} more at the present rate.`;
      say(since, `Since ${moment(trouble.since)}, ${ago} ago.${room}`);
      mark(node, "bad", trouble.losing);
      mark(node, "warn", !trouble.losing);
    },
  };
}

const KEPT = [["history", "samples", "the database"], ["mqtt", "states", "the MQTT broker"]];

/** Of those that have an outbox: what waits, and how long whoever takes it may be away. */
function room() {
  return KEPT.filter(([part]) => typeof store.kept[part]?.hours === "number")
    .map(([part, what, who]) => `${number(store.kept[part].waiting)} ${what} wait for ${who}, which may be away for ${age(store.kept[part].hours * HOUR)}`)
    .join(" · ");
}

export function troublesNode() {
  const lines = [];
  const list = h("div", { class: "troubles", role: "region", "aria-label": "What is not recorded or not delivered" });
  const calm = h("p", { class: "dim small room" });
  return {
    node: h("div", {}, list, calm),
    draw() {
      while (lines.length < store.troubles.length) {
        lines.push(line());
        list.append(lines[lines.length - 1].node);
      }
      while (lines.length > store.troubles.length) lines.pop().node.remove();
      store.troubles.forEach((trouble, at) => lines[at].draw(trouble));
      const text = store.troubles.length ? "" : room();
      calm.hidden = !text;
      say(calm, text);
    },
  };
}
