// Writing a point: choose, see old and new, confirm, see what came of it. And the token that it needs.

import { h, say } from "./dom.js";
import { get, post, token } from "./link.js";
import { valueNode } from "./overview.js";
import { follow, key, store, trust, watch } from "./store.js";

function dialog(title, ...children) {
  const node = h("dialog", { "aria-label": title }, ...children);
  node.addEventListener("close", () => node.remove());
  document.body.append(node);
  node.showModal();
  return node;
}

/** Ask for a token; resolves to whether one was given that the server knows. */
export function askToken(why) {
  return new Promise((resolve) => {
    const text = h("input", { type: "password", autocomplete: "off", required: true, "aria-label": "Token" });
    const stay = h("input", { type: "checkbox" });
    const note = h("p", { class: "note bad", role: "alert", hidden: true });
    const form = h("form", { method: "dialog" },
      h("h2", {}, "Token"),
      h("p", { class: "dim" }, why ?? "Writing needs a token. It is made on the machine of the gateway: multidrop token NAME --write"),
      h("label", {}, "Token", text),
      h("label", { class: "check" }, stay, "Keep it in this browser, also after this tab is closed"),
      note,
      h("div", { class: "buttons" },
        h("button", { type: "button", onclick: () => node.close() }, "Cancel"),
        h("button", { class: "main" }, "Use it")));
    let good = false;
    form.addEventListener("submit", async (event) => {
      event.preventDefault();
      const before = token.get();
      token.set(text.value.trim(), stay.checked);
      try {
        await get("/api/rights");
        good = true;
        node.close();
        follow();
      } catch (error) {
        token.forget();
        if (before) token.set(before, false);
        note.hidden = false;
        say(note, error.message);
      }
    });
    const node = dialog("Token", form);
    node.addEventListener("close", () => resolve(good));
  });
}

/** Whether the caller may write; asks for a token where none is known, and says why. */
export async function mayWrite(why) {
  for (;;) {
    const rights = await get("/api/rights").catch((error) => (error.status === 401 ? { rights: [] } : Promise.reject(error)));
    if (rights.rights.includes("write")) return true;
    if (!(await askToken(rights.name ? `Token ${rights.name} may not write. Another one is needed.` : why))) return false;
  }
}

/** As many digits behind the point as a number has. */
function digits(value) {
  return { decimals: Math.min(6, (String(value).split(".")[1] ?? "").length) };
}

const OUTCOMES = {
  confirmed: "Written, and read back as wanted.",
  unverified: "Written; the device does not let it be read back.",
};

export async function writePoint(device, point) {
  try {
    if (!(await mayWrite())) return;
  } catch (error) {
    dialog("Not possible", h("form", { method: "dialog" }, h("p", { class: "note bad" }, error.message), h("div", { class: "buttons" }, h("button", {}, "Close"))));
    return;
  }
  choose(device, point);
}

function choose(device, point) {
  const name = key(device.name, point.name);
  const { min, max } = point.write;
  const old = valueNode();
  const age = h("span");
  const fresh = valueNode();
  const names = Object.entries(point.names).filter(([raw]) => Number(raw) >= min && Number(raw) <= max);
  const input = names.length
    ? h("select", { name: "value" }, names.map(([raw, word]) => h("option", { value: raw }, `${word} (${raw})`)))
    : h("input", { type: "number", name: "value", min, max, step: "any", required: true, autocomplete: "off", inputmode: "decimal" });
  if (names.length) input.value = String(store.values.get(name)?.value ?? names[0][0]);
  const limits = `${min} to ${max}${point.unit ? ` ${point.unit}` : ""}${point.write.rate ? `, once in ${point.write.rate} s` : ""}`;
  const note = h("p", { class: "note", role: "status", hidden: true });
  const ask = h("label", {}, `New value, ${limits}`, input);
  const after = h("div", {}, h("span", {}, "new"), h("strong", {}, fresh.node));
  const change = h("div", { class: "change" },
    h("div", {}, h("span", {}, age), h("strong", {}, old.node)),
    h("div", { "aria-hidden": "true" }, "→"), after);
  const back = h("button", { type: "button", hidden: true, onclick: () => ready(false) }, "Back");
  const close = h("button", { type: "button", onclick: () => node.close() }, "Cancel");
  const go = h("button", { class: "main" }, "Continue");
  const form = h("form", { method: "dialog", novalidate: true },
    h("div", {}, h("h2", {}, `Write ${device.name} ${point.name.replaceAll("_", " ")}`), h("p", { class: "dim small" }, point.meaning)),
    point.write.motion ? h("p", { class: "note warn" }, "This is a command: it may move something.") : null,
    ask, change, note, h("div", { class: "buttons" }, close, back, go));
  let confirming = false;
  let done = false;

  function draw() {
    const value = store.values.get(name);
    const how = trust(name);
    if (!done) {
      old.draw(point, value, store.past.get(name));
      say(age, how.word ? `now (${how.word})` : "now");
    }
    const chosen = input.value === "" ? null : Number(input.value);
    if (!done) fresh.draw(point, { value: chosen, meaning: point.names[input.value] }, digits(chosen));
  }
  function tell(kind, text) {
    note.hidden = !text;
    note.className = `note ${kind}`;
    say(note, text);
  }
  function ready(yes) {
    confirming = yes;
    ask.hidden = yes;
    back.hidden = !yes;
    say(go, yes ? `Write ${names.length ? point.names[input.value] : input.value}${point.unit ? ` ${point.unit}` : ""}` : "Continue");
    go.className = yes && point.write.motion ? "danger" : "main";
    tell("", "");
    (yes ? go : input).focus();
  }
  async function write() {
    go.disabled = back.disabled = true;
    tell("", "Writing …");
    done = true;
    try {
      const result = await post("/api/write", { device: device.name, point: point.name, value: Number(input.value) });
      old.draw(point, { value: result.old }, digits(result.old));
      fresh.draw(point, { value: result.found ?? result.asked }, digits(result.found ?? result.asked));
      tell("good", OUTCOMES[result.outcome] ?? result.outcome);
    } catch (error) {
      tell("bad", error.message);
    }
    go.hidden = back.hidden = true;
    say(close, "Close");
    close.focus();
  }
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    if (confirming) {
      write();
      return;
    }
    const value = Number(input.value);
    if (input.value === "" || !Number.isFinite(value) || value < min || value > max) {
      tell("bad", `A number from ${limits} is needed.`);
      return;
    }
    ready(true);
  });
  input.addEventListener("input", draw);
  const stop = watch(draw);
  const node = dialog(`Write ${device.name} ${point.name}`, form);
  node.addEventListener("close", stop);
  draw();
  input.focus();
}
