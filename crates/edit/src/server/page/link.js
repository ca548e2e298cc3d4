
// Requests to the program: one at a time, in order. A waiting request that a newer one replaces is dropped.

const link = { token: "", way: "starting", flying: 0, most: 0, queue: [], kept: null };

function readToken() { link.token = new URLSearchParams(location.hash.slice(1)).get("token") || ""; }

/** Asks the program. Answers JSON (or `as`: "text", "blob"), null if a newer request took the place of this one. */
function request(path, body, options = {}) {
  if (link.way !== "fine" && !options.first) return Promise.reject(new Refusal(0, "The program has stopped."));
  return new Promise((done, failed) => {
    const entry = { path, body, done, failed, ...options };
    const last = link.queue.at(-1);
    if (entry.newest && last && last.newest && last.path === path) {
      link.queue.pop();
      last.done(null);
    }
    link.queue.push(entry);
    pump();
  });
}

/** A session of many keys may take a while over a slow line. */
const LARGE = { patience: 120 };

/** What the program refused, or (status 0) did not hear. */
class Refusal extends Error {
  constructor(status, message) { super(message); this.status = status; }
}

async function pump() {
  if (link.flying || !link.queue.length) return;
  const entry = link.queue.shift();
  link.flying++;
  link.most = Math.max(link.most, link.flying);
  try {
    const answer = await answerTo(entry);
    setWay("fine");
    entry.done(answer);
  } catch (error) {
    if (error.status === 0) setWay("gone");
    if (error.status === 401 || error.status === 403) setWay("refused");
    entry.failed(error);
  } finally {
    link.flying--;
    pump();
  }
}

async function answerTo({ path, body, as, patience = 20 }) {
  const head = { "X-Posing-Token": link.token };
  const options = { headers: head, cache: "no-store", signal: AbortSignal.timeout(1000 * patience) };
  if (body !== undefined) {
    options.method = "POST";
    head["Content-Type"] = "application/json";
    options.body = typeof body === "string" ? body : JSON.stringify(body);
  }
  let answer;
  try {
    answer = await fetch(path, options);
    if (answer.ok) return as ? await answer[as]() : parsed(await answer.text());
  } catch {
    throw new Refusal(0, "The program has stopped.");
  }
  const said = await answer.json().catch(() => ({}));
  throw new Refusal(answer.status, said.error || `The program answered ${answer.status}.`);
}

/** Whether the program answers: "fine", "gone" or "refused". What waits is dropped when it does not. */
function setWay(way) {
  if (way === link.way) return;
  link.way = way;
  if (way !== "fine") for (const entry of link.queue.splice(0)) entry.failed(new Refusal(0, "The program has stopped."));
  tellLink();
}

/** Drops requests that wait to be sent and that a newer one would replace: what they ask for is no longer wanted. */
function dropWaiting() {
  link.queue = link.queue.filter(entry => { if (entry.newest) entry.done(null); return !entry.newest; });
}

// ---- the program's state, and its return ----

/** An action. The state that comes back becomes the page's; a refusal is shown. */
async function act(action) {
  try {
    takeState(await request("/act", action));
    keepSession();
    return true;
  } catch (error) {
    if (error.status) { say(error.message); await refresh(); } else tell();
    return false;
  }
}

async function refresh() {
  try { takeState(await request("/state")); } catch { /* the banner says it */ }
}

let keeping = 0;
/** Fetches the session a moment after the last change: a new run of the program gets it. */
function keepSession() {
  clearTimeout(keeping);
  keeping = setTimeout(async () => {
    if (!idle()) return keepSession();
    try { link.kept = await request("/export", { format: "json", keys: false }, { as: "text", ...LARGE }); } catch { /* later */ }
  }, 400);
}
const idle = () => !link.flying && !link.queue.length && !order.busy && !now.gesture && !photo.fitted;

/** Asks whether the program is there, and takes what another tab has changed. */
async function beat() {
  if (link.flying || link.queue.length || order.busy || now.gesture || document.hidden || link.way === "refused" || !link.token) return;
  const lost = link.way !== "fine";
  try {
    const state = await request("/state", undefined, { first: true });
    if (lost) await welcome(state);
    else if (idle() && state.revision !== now.revision) { leaveOthers(); takeState(state); keepSession(); }
  } catch { /* the banner says it */ }
}

/** After the program was away: a new run opens what this page has, unless it has that or something newer itself. */
async function welcome(state) {
  const newer = now.state && state.session && state.session === now.state.session && state.revision > now.revision;
  if (!now.state || !link.kept || newer || isSame(state, now.state)) { takeState(state); keepSession(); return; }
  try {
    takeState(await request("/open", link.kept, LARGE));
    say("The program runs again, with the pose of before.");
  } catch (error) {
    if (!error.status) return;
    takeState(state);
    say("The program runs again, but could not open the pose of before: " + error.message);
  }
}

function isSame(a, b) {
  const near = (p, q) => Object.keys(p).length === Object.keys(q).length
    && Object.keys(p).every(j => q[j] && p[j].every((v, c) => Math.abs(v - q[j][c]) < .05));
  return near(a.pose, b.pose) && a.keys.length === b.keys.length
    && a.keys.every((key, i) => key.time === b.keys[i].time && near(key.pose, b.keys[i].pose));
}

function startLink() {
  readToken();
  setInterval(beat, 2000);
  addEventListener("focus", beat);
  document.addEventListener("visibilitychange", beat);
  addEventListener("hashchange", () => {
    readToken();
    // Asked at once, whatever the answer to the token before was.
    link.way = "gone";
    beat();
  });
  if (!link.token) { setWay("unaddressed"); return; }
  request("/state", undefined, { first: true }).then(state => { takeState(state); keepSession(); }, () => {});
}
