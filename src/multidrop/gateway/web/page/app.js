// The page: which view is shown, whether the server is there, dark or light, who is asking.

import { age, h, moment, say } from "./dom.js";
import { deviceView } from "./device.js";
import { faultsView } from "./faults.js";
import { get, token } from "./link.js";
import { overview } from "./overview.js";
import { changed, follow, store, watch } from "./store.js";
import { trendsView } from "./trends.js";
import { wireView } from "./wire.js";
import { askToken } from "./write.js";

const main = document.getElementById("view");
const link = document.getElementById("link");
const lost = document.getElementById("lost");
const who = document.getElementById("who");
const printed = document.getElementById("printed");
const themes = document.getElementById("theme");

// -- views: #/NAME/ARGUMENT?QUERY ------------------------------------------------------------

const VIEWS = {
  "": () => overview(),
  device: (name) => deviceView(name),
  trends: (_, query) => trendsView(query),
  wire: (name, query) => wireView(name, query),
  faults: (name) => faultsView(name),
};

let view = null;

function go() {
  const [path, query = ""] = location.hash.replace(/^#\/?/, "").split("?");
  const [name, ...rest] = path.split("/");
  const make = Object.hasOwn(VIEWS, name) ? VIEWS[name] : VIEWS[""];
  view?.leave?.();
  view = make(decodeURIComponent(rest.join("/")), new URLSearchParams(query));
  main.replaceChildren(view.node);
  document.title = `${view.title} · multidrop`;
  for (const item of document.querySelectorAll("nav a")) {
    const here = item.dataset.view === name || (item.dataset.view === "" && name === "device");
    if (here) item.setAttribute("aria-current", "page");
    else item.removeAttribute("aria-current");
  }
  view.draw({ plant: false });
}

addEventListener("hashchange", () => {
  go();
  scrollTo(0, 0);
  main.focus({ preventScroll: true });
});

// -- whether the server is there -------------------------------------------------------------

let asking = false;

function drawLink() {
  if (store.lost === null) {
    lost.hidden = true;
    say(link, "live");
    link.className = "state good";
    return;
  }
  const refused = store.why?.status === 401 || store.why?.status === 403;
  say(link, refused ? "token needed" : "server lost");
  link.className = "state bad";
  lost.hidden = false;
  say(lost, refused
    ? store.why.message
    : `Server lost ${age((Date.now() - store.lost) / 1000)} ago: ${store.why?.message ?? ""}. What is shown is old. Trying again …`);
  if (refused && !asking) {
    asking = true;
    askToken(store.why.message).then(() => {
      asking = false;
      drawWho();
    });
  }
}

watch((news) => {
  drawLink();
  if (news.plant && view === null) go();
  view?.draw(news);
});
setInterval(() => changed(), 1000); // ages go on where nothing comes

// -- on paper, where no age goes on -----------------------------------------------------------

addEventListener("beforeprint", () => {
  const old = store.lost === null ? "" : "; the server was lost before, so the values are old";
  say(printed, `${location.host}, ${moment(Date.now())}${old}`);
});

// -- who is asking ---------------------------------------------------------------------------

async function drawWho() {
  if (!token.get()) {
    say(who, "no token");
    return;
  }
  try {
    const rights = await get("/api/rights");
    say(who, rights.name ? `${rights.name}: ${rights.rights.join(", ")}` : "no token");
  } catch (error) {
    say(who, error.status === 401 ? "token not known" : "token");
  }
}

who.addEventListener("click", async () => {
  if (token.get()) {
    token.forget();
    follow();
  } else {
    await askToken();
  }
  drawWho();
});

// -- dark and light --------------------------------------------------------------------------

const ORDER = ["auto", "dark", "light"];

function drawTheme() {
  say(themes, document.documentElement.dataset.theme ?? "auto");
}

themes.addEventListener("click", () => {
  const next = ORDER[(ORDER.indexOf(themes.textContent) + 1) % ORDER.length];
  if (next === "auto") delete document.documentElement.dataset.theme;
  else document.documentElement.dataset.theme = next;
  try {
    localStorage.setItem("theme", next);
  } catch {
    // until the page is loaded again
  }
  drawTheme();
  dispatchEvent(new Event("theme"));
});
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => dispatchEvent(new Event("theme")));

drawTheme();
drawWho();
if (location.hash) main.replaceChildren(h("p", { class: "empty" }, "Loading …"));
follow();
