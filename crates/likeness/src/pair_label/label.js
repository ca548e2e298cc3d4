
// What the person does: answers, keys, files.

const COLUMNS = ["a_take", "a_frame", "b_take", "b_frame", "label"];
const STORE = "posing-pair-label-" + data.digest;
/** The label of each pair, 1 or 0; undefined where it is open. What each answer replaced, the last one last. */
const answers = new Array(pairs.length).fill(undefined), past = [];
let current = 0, isKept = true, isSaved = true;

// ---- the browser's store ----

function keep() {
  try { localStorage.setItem(STORE, JSON.stringify(answers.map(label => label ?? null))); isKept = true; }
  catch { isKept = false; }
}
function recall() {
  let kept = null;
  try { kept = JSON.parse(localStorage.getItem(STORE)); isKept = true; } catch { isKept = false; }
  if (Array.isArray(kept)) kept.slice(0, pairs.length).forEach((label, i) => { if (label === 0 || label === 1) answers[i] = label; });
}

// ---- going through the pairs ----

function go(to) {
  current = Math.max(0, Math.min(pairs.length - 1, to));
  load(pairs[current]);
  show.clock = 0;
  show.lastTick = performance.now();
  tell();
  ask();
}

/** The next open pair after the current one, from the beginning again after the last; the next one where none is open. */
function goOn() {
  for (let step = 1; step <= pairs.length; step++) {
    const next = (current + step) % pairs.length;
    if (answers[next] === undefined) return go(next);
  }
  go(current + 1);
}

function set(pair, label) {
  answers[pair] = label;
  isSaved = false;
  keep();
}
function answer(label) {
  past.push([current, answers[current]]);
  set(current, label);
  goOn();
  if (!answers.includes(undefined)) notice("All pairs are answered: save them.");
  else notice(isKept ? "" : "This browser keeps nothing for this page: save before you close it.");
}
function undo() {
  const last = past.pop();
  if (!last) return;
  set(...last);
  notice("");
  go(last[0]);
}

function tell() {
  const count = label => answers.filter(a => a === label).length, alike = count(1), not = count(0);
  part("where").textContent = `Pair ${current + 1} of ${pairs.length}`;
  part("tally").textContent = `${alike + not} of ${pairs.length}, ${alike} alike`;
  part("bar .is-alike").style.width = 100 * alike / pairs.length + "%";
  part("bar .is-not").style.width = 100 * not / pairs.length + "%";
  part("alike").setAttribute("aria-pressed", answers[current] === 1);
  part("not").setAttribute("aria-pressed", answers[current] === 0);
  part("undo").disabled = !past.length;
  part("save").disabled = !(alike + not);
  part("previous").disabled = current === 0;
  part("following").disabled = current === pairs.length - 1;
}
function notice(text) { part("notice").textContent = text; }

// ---- CSV ----

const cell = value => /[",\r\n]/.test(value) ? `"${String(value).replaceAll('"', '""')}"` : String(value);
const id = (a, i, b, j) => JSON.stringify([a, +i, b, +j]);

/** Rows of cells, after RFC 4180. */
function parse(text) {
  const rows = [[]], cells = /("(?:[^"]|"")*"|[^",\r\n]*)(,|\r\n|\r|\n|$)/y;
  for (let match; cells.lastIndex < text.length && (match = cells.exec(text));) {
    rows[rows.length - 1].push(match[1].startsWith('"') ? match[1].slice(1, -1).replaceAll('""', '"') : match[1]);
    if (match[2] !== ",") rows.push([]);
  }
  return rows.filter(row => row.length > 1);
}

function save() {
  const rows = pairs.map((pair, i) => [pair.a[0], pair.a[1], pair.b[0], pair.b[1], answers[i]]).filter(row => row[4] !== undefined);
  if (!rows.length) return notice("No pair is answered yet.");
  const text = [COLUMNS, ...rows].map(row => row.map(cell).join(",") + "\n").join("");
  const link = make("a");
  link.href = URL.createObjectURL(new Blob([text], { type: "text/csv" }));
  link.download = "labels.csv";
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  isSaved = true;
  notice(`Saved ${rows.length} of ${pairs.length} pairs.`);
}

function read(text) {
  const [head = [], ...rows] = parse(text.replace(/^\ufeff/, "")), at = COLUMNS.map(name => head.indexOf(name));
  if (at.includes(-1)) return notice("This file lacks a column of " + COLUMNS.join(", ") + ".");
  const places = new Map(pairs.flatMap(({ a, b }, i) => [[id(a[0], a[1], b[0], b[1]), i], [id(b[0], b[1], a[0], a[1]), i]]));
  let known = 0, others = 0;
  for (const row of rows) {
    const [a, i, b, j, label] = at.map(column => row[column]);
    if (label !== "0" && label !== "1") continue;
    const pair = places.get(id(a, i, b, j));
    if (pair === undefined) { others++; continue; }
    answers[pair] = +label;
    known++;
  }
  past.length = 0;
  keep();
  go(Math.max(0, answers.findIndex(label => label === undefined)));
  notice(`Loaded ${known} answers.` + (others ? ` ${others} are of other pairs.` : ""));
}

// ---- buttons and keys ----

const actions = {
  alike: () => answer(1),
  not: () => answer(0),
  skip: () => { notice(""); goOn(); },
  undo,
  previous: () => go(current - 1),
  following: () => go(current + 1),
  play: () => play(!show.playing),
  back: () => seek(frame() - 1),
  step: () => seek(frame() + 1),
  mark: () => seek(middle),
  slower: () => setSpeed(show.speed - 1),
  faster: () => setSpeed(show.speed + 1),
  speed: () => setSpeed(USUAL),
  reset: resetCamera,
  help: () => { if (!part("keys").open) part("keys").showModal(); },
  save,
  load: () => part("file").click(),
};
const KEYS = {
  a: "alike", n: "not", s: "skip", u: "undo", ArrowLeft: "previous", ArrowRight: "following", " ": "play", ",": "back", ".": "step",
  m: "mark", "-": "slower", _: "slower", "+": "faster", "=": "faster", 0: "speed", r: "reset", "?": "help",
};
const VIEW = {
  ArrowLeft: () => orbit(-.12, 0), ArrowRight: () => orbit(.12, 0), ArrowUp: () => orbit(0, .1), ArrowDown: () => orbit(0, -.1),
};

addEventListener("keydown", event => {
  const key = event.key.length === 1 ? event.key.toLowerCase() : event.key, { target } = event;
  if (part("keys").open || event.altKey) return;
  if (event.ctrlKey || event.metaKey) {
    if (key === "s") { save(); event.preventDefault(); }
    return;
  }
  // The slider keeps its arrows, a button its space.
  const isSlider = target.type === "range";
  if (isSlider && /^(Arrow|Home|End|Page)/.test(key) && !event.shiftKey) return;
  if (target.tagName === "BUTTON" && (key === " " || key === "Enter")) return;
  if (event.shiftKey && VIEW[key]) VIEW[key]();
  else if (key === "z") zoom(1.15);
  else if (key === "x") zoom(1 / 1.15);
  else if (Object.hasOwn(KEYS, key) && !(event.repeat && "ansu".includes(key))) actions[KEYS[key]]();
  else return;
  event.preventDefault();
});

addEventListener("beforeunload", event => { if (!isKept && !isSaved) event.preventDefault(); });

function start() {
  root.hidden = false;
  part("scrub").max = frames - 1;
  part("scrub").addEventListener("input", event => seek(+event.target.value));
  part("track").style.setProperty("--fade", Math.min(1, data.fade / ((frames - 1) / data.rate)) * 100 + "%");
  // A click by mouse gives the focus back, so that space goes on playing and pausing.
  for (const name in actions) part(name).addEventListener("click", event => { actions[name](); if (event.detail) part(name).blur(); });
  part("file").addEventListener("change", async event => {
    const [file] = event.target.files;
    if (file) read(await file.text());
    event.target.value = "";
  });
  const redraw = () => { panels.forEach(panel => panel.view.readInk()); ask(); };
  recall();
  resetCamera();
  go(Math.max(0, answers.findIndex(label => label === undefined)));
  if (!isKept) notice("This browser keeps nothing for this page: save before you close it.");
  new ResizeObserver(redraw).observe(root);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
  play(!matchMedia("(prefers-reduced-motion: reduce)").matches);
}
start();
