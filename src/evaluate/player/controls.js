
// The body of `player(root, scene)`, second part.
// What the reader does: panels, playback, mouse, keys.

/** Alone on its page, and not one of several figures in a report: it may have the wheel, the keys and the address. */
const alone = root.dataset.alone !== undefined;
const still = frames < 2;
const part = name => root.querySelector("." + name);
const keysHelp = document.querySelector("dialog.keys");
function make(tag, className, text) {
  const node = document.createElement(tag);
  if (className) node.className = className;
  if (text !== undefined) node.textContent = text;
  return node;
}

const SPEEDS = [.1, .25, .5, 1, 1.5, 2, 3, 4];
const USUAL = SPEEDS.indexOf(1);
const state = { frame: 0, clock: 0, playing: false, speed: USUAL, overlay: false, loop: true, trail: -1, hover: null };
let panels = [], strips = [], asked = false, lastTick = 0;

// ---- panels and legend, made anew when the overlay is switched ----

function makePanel(list) {
  const section = make("section"), head = make("div", "head");
  const canvas = still ? emptySvg() : make("canvas");
  canvas.setAttribute("class", "view");
  const missing = make("span", "missing");
  if (list.length > 1) {
    const names = make("div", "names");
    for (const f of list) {
      const button = make("button"), dot = make("span", "swatch");
      dot.style.background = `var(--f${f % 6})`;
      button.append(dot, figures[f].name);
      button.setAttribute("aria-pressed", figures[f].shown);
      button.title = "Show or hide";
      press(button, () => {
        figures[f].shown = !figures[f].shown;
        button.setAttribute("aria-pressed", figures[f].shown);
        ask();
      });
      names.append(button);
    }
    head.append(names);
  } else head.append(make("div", "name", figures[list[0]].name.replaceAll("+", "\u200b+")), missing);
  canvas.setAttribute("role", "img");
  if (!alone) canvas.setAttribute("tabindex", "0");
  canvas.setAttribute("aria-label", (still ? "Figure: " : "Moving figure: ") + list.map(f => figures[f].name).join(", "));
  section.append(head, canvas);
  const panel = { section, canvas, missing, ctx: still ? svgPaper(canvas) : canvasPaper(canvas), figures: list, hits: [] };
  handle(panel);
  return panel;
}

function makePanels() {
  const all = figures.map((_, f) => f);
  // Of very many, the first few at first: the others are there to be switched on.
  const many = state.overlay && figures.length > 6;
  figures.forEach((figure, f) => { figure.shown = !many || f < 3; });
  panels = (state.overlay ? [all] : all.map(f => [f])).map(makePanel);
  part("panels").replaceChildren(...panels.map(panel => panel.section));
  hover(null);
  makeLegend();
  ask();
}

function makeLegend() {
  const items = [], some = status => figures.some(figure => figure.has[status]);
  const item = (kind, color, text) => {
    const node = make("li"), sign = make("span", "swatch " + kind);
    sign.style.color = `var(--${color})`;
    sign.style.background = kind === "cross" ? "" : `var(--${color})`;
    node.append(sign, text);
    items.push(node);
  };
  const sided = /[lr]/.test(scene.sides);
  if (sided && !state.overlay) { item("", "left", "left"); item("", "right", "right"); }
  if (sided && state.overlay) items.push(make("li", "", "right limbs fainter"));
  if (some(1)) item("", "changed", "changed");
  if (some(2)) item("ring", "inferred", "inferred");
  if (some(3)) item("cross", "rejected", "rejected");
  if (some(4)) item("ring", "unknown", "unknown");
  if (scene.behind !== null && !state.overlay) item("", "behind", figures[scene.behind].name + ", behind each answer");
  if (some(MISSING) && alone) item("block", "missing", "missing (in the strip)");
  part("legend").replaceChildren(...items);
}

function makeStrips() {
  strips = [];
  figures.forEach((figure, f) => {
    if (!figure.has.slice(1).some(Boolean)) return;
    const row = make("div", "strip"), canvas = make("canvas"), lane = make("div", "lane");
    lane.append(canvas);
    row.append(make("span", "", figure.name), lane);
    const jump = event => {
      const box = canvas.getBoundingClientRect();
      show((event.clientX - box.left) / box.width * (frames - 1));
    };
    canvas.addEventListener("pointerdown", event => { canvas.setPointerCapture(event.pointerId); jump(event); });
    canvas.addEventListener("pointermove", event => { if (event.buttons) jump(event); });
    part("strips").append(row);
    strips.push([canvas, f]);
  });
}

// ---- drawing when asked, playing while time goes on ----

function ask() { if (!asked) { asked = true; requestAnimationFrame(tick); } }

function tick(now) {
  asked = false;
  if (state.playing) {
    state.clock += Math.min(now - lastTick, 250) / 1000 * SPEEDS[state.speed] * rateAt(state.frame);
    if (state.clock >= frames) {
      if (state.loop) state.clock %= frames;
      else { state.clock = frames - 1; play(false); }
    }
    state.frame = Math.floor(state.clock);
  }
  lastTick = now;
  for (const panel of panels) drawPanel(panel, state.frame, state.trail, state.hover);
  tell();
  if (state.playing) ask();
}

function show(frame) {
  state.frame = Math.max(0, Math.min(frames - 1, Math.round(frame)));
  state.clock = state.frame;
  ask();
}

function tell() {
  const [take, time] = moment(state.frame), scrub = part("scrub"), number = state.frame * scene.every;
  scrub.value = state.frame;
  scrub.style.setProperty("--done", `calc(8px + ${state.frame / Math.max(1, frames - 1)} * (100% - 16px))`);
  part("strips").style.setProperty("--at", state.frame / Math.max(1, frames - 1));
  scrub.setAttribute("aria-valuetext", `frame ${number}, ${time.toFixed(2)} seconds${take ? ", " + take : ""}`);
  const several = scene.runs.length > 1 && take;
  part("clock").replaceChildren(
    time.toFixed(3) + " s ", make("small", "", `frame ${number}${several ? " · " + take : ""}`));
  part("clock").title = several ? take : "";
  for (const panel of panels) {
    const gone = figures[panel.figures[0]].counts[state.frame * 6 + MISSING];
    panel.missing.textContent = gone ? `${gone} of ${points} missing` : figures[panel.figures[0]].note;
  }
  keepHover();
}

function play(on) {
  if (on && !state.playing && state.frame >= frames - 1) show(0);
  state.playing = on;
  lastTick = performance.now();
  part("play").setAttribute("aria-label", on ? "Pause" : "Play");
  part("play").title = on ? "Pause (space)" : "Play (space)";
  ask();
}

function setSpeed(index) {
  state.speed = Math.max(0, Math.min(SPEEDS.length - 1, index));
  part("speed").textContent = SPEEDS[state.speed] + "×";
  part("speed").setAttribute("aria-label", `Speed ${SPEEDS[state.speed]}; press for the usual speed`);
}

function setTrail(point) { state.trail = point; part("trail").value = point; ask(); }
function toggle(id, on) { part(id).setAttribute("aria-pressed", on); return on; }
const actions = {
  play: () => play(!state.playing),
  back: () => { play(false); show(state.frame - 1); },
  next: () => { play(false); show(state.frame + 1); },
  slower: () => setSpeed(state.speed - 1),
  faster: () => setSpeed(state.speed + 1),
  speed: () => setSpeed(USUAL),
  overlay: () => { state.overlay = toggle("overlay", figures.length > 1 && !state.overlay); makePanels(); },
  follow: () => { camera.follow = toggle("follow", !camera.follow); ask(); },
  loop: () => { state.loop = toggle("loop", !state.loop); },
  reset: () => { resetCamera(); ask(); },
  help: () => { if (!keysHelp.open) keysHelp.showModal(); },
};

/** A click by mouse gives the focus back, so that space goes on playing and pausing. */
function press(button, action) {
  button.addEventListener("click", event => { action(); if (event.detail) button.blur(); });
}

// ---- mouse and touch on a panel ----

function handle(panel) {
  const { canvas } = panel, held = new Map();
  let moved = 0, apart = 0;
  const spread = () => { const [a, b] = [...held.values()]; return Math.hypot(a.x - b.x, a.y - b.y); };
  canvas.addEventListener("pointerdown", event => {
    canvas.setPointerCapture(event.pointerId);
    held.set(event.pointerId, { x: event.clientX, y: event.clientY });
    if (held.size === 1) moved = 0;
    if (held.size === 2) apart = spread();
  });
  canvas.addEventListener("pointermove", event => {
    const before = held.get(event.pointerId);
    if (!before) { hover(nearest(panel, event, 14), panel, event); return; }
    const dx = event.clientX - before.x, dy = event.clientY - before.y;
    held.set(event.pointerId, { x: event.clientX, y: event.clientY });
    moved += Math.abs(dx) + Math.abs(dy);
    if (held.size === 2) { const now = spread(); if (apart > 0) zoom(now / apart); apart = now; }
    else if (event.shiftKey) { camera.shift[0] += dx; camera.shift[1] += dy; ask(); }
    else orbit(-dx * .009, dy * .007);
  });
  const release = event => {
    const tapped = held.delete(event.pointerId) && !held.size && moved < 5 && event.type === "pointerup";
    const hit = tapped ? nearest(panel, event, event.pointerType === "touch" ? 24 : 14) : null;
    if (hit) { setTrail(hit.point === state.trail ? -1 : hit.point); hover(hit, panel, event); }
  };
  canvas.addEventListener("pointerup", release);
  canvas.addEventListener("pointercancel", release);
  canvas.addEventListener("pointerleave", () => hover(null));
  canvas.addEventListener("dblclick", actions.reset);
  canvas.addEventListener("wheel", event => {
    // In a report the wheel scrolls the page.
    if (!alone && !event.ctrlKey) return;
    event.preventDefault();
    zoom(Math.exp(-event.deltaY * (event.deltaMode ? .05 : .0015)));
  }, { passive: false });
}

function orbit(azimuth, elevation) {
  camera.azimuth += azimuth;
  camera.elevation = Math.max(-.3, Math.min(1.57, camera.elevation + elevation));
  ask();
}
function zoom(by) { camera.zoom = Math.max(.2, Math.min(12, camera.zoom * by)); ask(); }

function nearest(panel, mouse, within) {
  const box = panel.canvas.getBoundingClientRect(), x = mouse.clientX - box.left, y = mouse.clientY - box.top;
  let best = null, least = within;
  for (const hit of panel.hits) {
    const far = Math.hypot(hit.x - x, hit.y - y);
    if (far < least) { least = far; best = hit; }
  }
  return best;
}

function hover(hit, panel, event) {
  const changed = (state.hover && state.hover.point) !== (hit && hit.point);
  state.hover = hit && { figure: hit.figure, point: hit.point, panel, clientX: event.clientX, clientY: event.clientY };
  if (hit) tip(); else part("tip").hidden = true;
  if (changed) ask();
}

/** After the figure or the camera has moved: what is under the mouse now. */
function keepHover() {
  if (state.hover) hover(nearest(state.hover.panel, state.hover, 18), state.hover.panel, state.hover);
}

function tip() {
  const { figure, point, clientX: x, clientY: y } = state.hover, box = part("tip"), i = state.frame * points + point;
  const status = figures[figure].status[i], place = figures[figure].xyz.subarray(3 * i, 3 * i + 3);
  const where = status === MISSING ? "" : "x y z  " + [...place].map(v => v.toFixed(1)).join("  ") + " cm";
  const said = figures[figure].has.some((has, s) => has && s > 0) ? STATUS[status] : "";
  const name = scene.points[point] + (state.overlay ? " · " + figures[figure].name : "");
  const lines = [make("b", "", name)];
  for (const text of [said, where]) if (text) lines.push(make("div", "", text));
  box.replaceChildren(...lines);
  box.hidden = false;
  const { width, height } = box.getBoundingClientRect();
  box.style.left = Math.max(4, Math.min(x + 14, innerWidth - width - 6)) + "px";
  box.style.top = (y + 16 + height > innerHeight ? y - height - 10 : y + 16) + "px";
}

// ---- keys ----

const KEYS = {
  " ": "play", "-": "slower", "_": "slower", "+": "faster", "=": "faster", "0": "speed",
  o: "overlay", f: "follow", l: "loop", r: "reset", "?": "help",
};
const MOVES = {
  a: () => orbit(-.12, 0), d: () => orbit(.12, 0), w: () => orbit(0, .1), s: () => orbit(0, -.1),
  z: () => zoom(1.15), x: () => zoom(1 / 1.15),
  Home: () => { play(false); show(0); }, End: () => { play(false); show(frames - 1); },
};
(alone ? window : root).addEventListener("keydown", event => {
  if (event.ctrlKey || event.metaKey || event.altKey || keysHelp.open) return;
  const tag = event.target.tagName;
  if (tag === "SELECT" || (tag === "BUTTON" && (event.key === " " || event.key === "Enter"))) return;
  const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
  const second = event.shiftKey ? Math.max(1, Math.round(rateAt(state.frame))) : 1;
  if (key === "ArrowLeft" || key === "ArrowRight") {
    play(false);
    show(state.frame + (key === "ArrowLeft" ? -second : second));
  } else if (KEYS[key]) actions[KEYS[key]]();
  else if (MOVES[key]) MOVES[key]();
  else return;
  event.preventDefault();
});

// ---- links such as #frame=120&overlay ----

function readLink() {
  const link = new URLSearchParams(location.hash.slice(1)), number = name => parseFloat(link.get(name));
  if (Number.isFinite(number("frame"))) { play(false); show(number("frame") / scene.every); }
  if (Number.isFinite(number("az"))) camera.azimuth = number("az") * Math.PI / 180;
  if (Number.isFinite(number("el"))) camera.elevation = Math.max(-.3, Math.min(1.57, number("el") * Math.PI / 180));
  if (number("speed") > 0) {
    const far = SPEEDS.map(speed => Math.abs(Math.log(speed / number("speed"))));
    setSpeed(far.indexOf(Math.min(...far)));
  }
  if (scene.points.includes(link.get("trail"))) setTrail(scene.points.indexOf(link.get("trail")));
  if (link.has("overlay") && !state.overlay) actions.overlay();
  if (link.has("play")) play(true);
  ask();
}

function start() {
  if (!frames || !figures.length) { part("empty").hidden = false; return; }
  part("stage").hidden = false;
  root.classList.toggle("still", still);
  part("scrub").max = frames - 1;
  part("scrub").addEventListener("input", event => { play(false); show(+event.target.value); });
  scene.points.forEach((name, p) => {
    const option = make("option", "", name);
    option.value = p;
    part("trail").append(option);
  });
  part("trail").addEventListener("change", event => setTrail(+event.target.value));
  part("overlay").hidden = figures.length < 2;
  for (const id in actions) press(part(id), actions[id]);
  readInk();
  makePanels();
  makeStrips();
  const redraw = () => { readInk(); strips.forEach(([canvas, f]) => drawStrip(canvas, f)); ask(); };
  new ResizeObserver(redraw).observe(part("stage"));
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
  if (scene.start) show(scene.start);
  if (alone) { addEventListener("hashchange", readLink); readLink(); }
}
start();
