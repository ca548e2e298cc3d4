
// The body of a player, shared by all: mouse, touch, keys, and links such as #frame=120&overlay.

/** Lets drags turn and move the view, pinches and the wheel zoom. `hover`, `tap` and `leave` are told the rest. */
function handle(canvas, { hover, tap, leave }) {
  const held = new Map();
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
    if (!before) { hover(event); return; }
    const dx = event.clientX - before.x, dy = event.clientY - before.y;
    held.set(event.pointerId, { x: event.clientX, y: event.clientY });
    moved += Math.abs(dx) + Math.abs(dy);
    if (held.size === 2) { const now = spread(); if (apart > 0) zoom(now / apart); apart = now; }
    else if (event.shiftKey) { camera.shift[0] += dx; camera.shift[1] += dy; ask(); }
    else orbit(-dx * .009, dy * .007);
  });
  const release = event => {
    if (held.delete(event.pointerId) && !held.size && moved < 5 && event.type === "pointerup") tap(event);
  };
  canvas.addEventListener("pointerup", release);
  canvas.addEventListener("pointercancel", release);
  canvas.addEventListener("pointerleave", leave);
  canvas.addEventListener("dblclick", () => actions.reset());
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

// ---- keys ----

const KEYS = {
  " ": "play", "-": "slower", "_": "slower", "+": "faster", "=": "faster", "0": "speed",
  o: "overlay", f: "follow", l: "loop", r: "reset", m: "wires", "?": "help",
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
  } else if (actions[KEYS[key]]) actions[KEYS[key]]();
  else if (MOVES[key]) MOVES[key]();
  else return;
  event.preventDefault();
});

// ---- links ----

function readLink() {
  const link = new URLSearchParams(location.hash.slice(1)), number = name => parseFloat(link.get(name));
  if (Number.isFinite(number("frame"))) { play(false); show(number("frame") / scene.every); }
  if (Number.isFinite(number("az"))) camera.azimuth = number("az") * Math.PI / 180;
  if (Number.isFinite(number("el"))) camera.elevation = Math.max(-.3, Math.min(1.57, number("el") * Math.PI / 180));
  if (number("speed") > 0) {
    const far = SPEEDS.map(speed => Math.abs(Math.log(speed / number("speed"))));
    setSpeed(far.indexOf(Math.min(...far)));
  }
  readOwnLink(link);
  if (link.has("overlay") && !state.overlay) actions.overlay();
  if (link.has("play")) play(true);
  ask();
}
