// The way to the server: requests with the token, and event streams that come back by themselves.

const KEY = "multidrop token";

/** A token is kept by this tab, or by this browser where somebody asked for that. */
export const token = {
  get() {
    try {
      return sessionStorage.getItem(KEY) ?? localStorage.getItem(KEY);
    } catch {
      return null;
    }
  },
  set(text, stay) {
    this.forget();
    (stay ? localStorage : sessionStorage).setItem(KEY, text);
  },
  forget() {
    try {
      sessionStorage.removeItem(KEY);
      localStorage.removeItem(KEY);
    } catch {
      // nothing was kept
    }
  },
};

export class Failure extends Error {
  constructor(status, kind, text) {
    super(text);
    this.status = status;
    this.kind = kind;
  }
}

function headers(more = {}) {
  const known = token.get();
  return known ? { ...more, Authorization: `Bearer ${known}` } : more;
}

async function failed(answer) {
  let told = {};
  try {
    told = (await answer.json()).error ?? {};
  } catch {
    // not JSON: the status says it
  }
  return new Failure(answer.status, told.kind ?? "http", told.text ?? `status ${answer.status}`);
}

/** What a path answers, as JSON. Throws `Failure`, status 0 where the server is not there. */
export async function get(path, signal) {
  let answer;
  try {
    answer = await fetch(path, { headers: headers(), signal });
  } catch (error) {
    if (error.name === "AbortError") throw error;
    throw new Failure(0, "lost", "the server does not answer");
  }
  if (!answer.ok) throw await failed(answer);
  return answer.json();
}

export async function post(path, body) {
  let answer;
  try {
    answer = await fetch(path, {
      method: "POST",
      headers: headers({ "Content-Type": "application/json" }),
      body: JSON.stringify(body),
    });
  } catch {
    throw new Failure(0, "lost", "the connection was lost: whether it was done is not known");
  }
  if (!answer.ok) throw await failed(answer);
  return answer.json();
}

/** A file, with the token; the browser saves it. */
export async function save(path, name) {
  const answer = await fetch(path, { headers: headers() });
  if (!answer.ok) throw await failed(answer);
  const link = document.createElement("a");
  link.href = URL.createObjectURL(await answer.blob());
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

const SILENT = 4000; // ms without any event after which a stream counts as lost
const AGAIN = 1000; // ms before it is tried again

/**
 * Listen to a stream for as long as `signal` is not aborted.
 * `on.open()`, `on.event(name, data)`, `on.lost(failure)`.
 */
export async function listen(path, on, signal) {
  while (!signal.aborted) {
    const silent = new AbortController();
    const stop = () => silent.abort();
    signal.addEventListener("abort", stop);
    try {
      await once(path, on, silent);
      on.lost(new Failure(0, "lost", "the server ended the connection"));
    } catch (error) {
      if (signal.aborted) return;
      on.lost(error instanceof Failure ? error : new Failure(0, "lost", "the server does not answer"));
    } finally {
      signal.removeEventListener("abort", stop);
    }
    await new Promise((resolve) => setTimeout(resolve, AGAIN));
  }
}

async function once(path, on, silent) {
  let watch = setTimeout(() => silent.abort(), SILENT);
  try {
    const answer = await fetch(path, { headers: headers(), signal: silent.signal });
    if (!answer.ok) throw await failed(answer);
    on.open?.();
    const reader = answer.body.pipeThrough(new TextDecoderStream()).getReader();
    let rest = "";
    for (;;) {
      const { done, value } = await reader.read();
      if (done) return;
      clearTimeout(watch);
      watch = setTimeout(() => silent.abort(), SILENT);
      const events = (rest + value).split("\n\n");
      rest = events.pop();
      for (const event of events) tell(event, on);
    }
  } finally {
    clearTimeout(watch);
    silent.abort();
  }
}

function tell(event, on) {
  let name = "message";
  let data = "";
  for (const line of event.split("\n")) {
    if (line.startsWith("event: ")) name = line.slice(7);
    else if (line.startsWith("data: ")) data += line.slice(6);
  }
  if (data) on.event(name, JSON.parse(data));
}
