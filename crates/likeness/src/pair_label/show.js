
// How a pair is shown: four panels, one clock and one camera.

const root = document.querySelector(".player"), part = name => document.querySelector("." + name);
const data = JSON.parse(root.querySelector("script").textContent);
const pairs = data.pairs, frames = data.frames, middle = (frames - 1) / 2;
const AZIMUTH = 55, ELEVATION = 10;
let camera = {};
const NAMES = ["a", "b", "a and b", "cut from a to b"];

function make(tag, className, text) {
  const node = document.createElement(tag);
  if (className) node.className = className;
  if (text !== undefined) node.textContent = text;
  return node;
}

/** Centimeters of a figure, from integers in millimeters; the smallest one is a missing point. */
function decode(text) {
  const bytes = Uint8Array.from(atob(text), c => c.charCodeAt(0)), read = new DataView(bytes.buffer);
  return Float32Array.from({ length: bytes.length / 2 }, (_, i) => {
    const mm = read.getInt16(2 * i, true);
    return mm === -32768 ? NaN : mm / 10;
  });
}

const panels = NAMES.map((name, i) => {
  const section = make("section"), head = make("div", "head"), canvas = make("canvas", "view"), note = make("span", "missing");
  canvas.setAttribute("role", "img");
  canvas.setAttribute("aria-label", "Moving figure: " + name);
  const title = make("div", "name", i === 2 ? "" : name);
  if (i === 2) title.append(make("span", "swatch is-a"), "a ", make("span", "swatch is-b"), "b");
  head.append(title, note);
  section.append(head, canvas);
  part("panels").append(section);
  turnBy(canvas);
  return { section, note, canvas, ctx: canvasPaper(canvas), figures: i === 2 ? [0, 1] : [0], hits: [], view: null };
});

/** Makes the drawings of a pair. The camera follows each figure; over both it follows their mean. */
function load(pair) {
  const [a, b, cut] = pair.motion.map(decode), mean = a.map((v, i) => (v + b[i]) / 2);
  const scene = (...figures) => ({
    points: data.points, bones: data.bones, sides: data.sides, head: data.head, rate: data.rate, frames,
    ground: 0, size: data.size, azimuth: 0, runs: [], behind: null,
    reference: figures.length - 1, figures: figures.map(xyz => ({ name: "", xyz })),
  });
  [scene(a), scene(b), scene(a, b, mean), scene(cut)].forEach((scene, i) => { panels[i].view = view(scene); });
  // One scale in all panels.
  const paths = panels.map(panel => panel.view.path);
  for (const key of ["height", "radius"]) {
    const most = Math.max(...paths.map(path => path[key]));
    for (const path of paths) path[key] = most;
  }
  panels.forEach(panel => panel.view.readInk());
  [pair.a, pair.b].forEach((pose, i) => {
    panels[i].note.textContent = `frame ${pose[1]} (${pose[2].toFixed(2)} s)${pose[0] && " of "}${pose[0]}`;
    panels[i].note.title = pose[0];
  });
  panels[2].note.textContent = `${pair.distance.toFixed(1)} cm apart`;
}

// ---- the clock ----

const SPEEDS = [.1, .25, .5, .75, 1, 1.5, 2], USUAL = SPEEDS.indexOf(1);
const show = { clock: 0, playing: false, speed: USUAL, asked: false, lastTick: 0 };
const frame = () => Math.min(frames - 1, Math.floor(show.clock));

function ask() { if (!show.asked) { show.asked = true; requestAnimationFrame(tick); } }

function tick(now) {
  show.asked = false;
  if (show.playing) {
    show.clock += Math.min(now - show.lastTick, 250) / 1000 * SPEEDS[show.speed] * data.rate;
    if (show.clock >= frames) show.clock %= frames;
    ask();
  }
  show.lastTick = now;
  draw();
}

function draw() {
  const at = frame(), seconds = (at - middle) / data.rate, isNow = Math.abs(seconds) < 1.5 / data.rate;
  for (const panel of panels) {
    Object.assign(panel.view.camera, camera);
    panel.view.drawPanel(panel, at, -1, null);
    panel.section.classList.toggle("now", isNow);
  }
  const phase = Math.abs(seconds) < data.fade / 2 ? "a fades into b" : seconds < 0 ? "a" : "b";
  panels[3].note.textContent = "now " + phase;
  const scrub = part("scrub");
  scrub.value = at;
  scrub.style.setProperty("--done", `calc(8px + ${at / (frames - 1)} * (100% - 16px))`);
  const text = (seconds < 0 ? "−" : "+") + Math.abs(seconds).toFixed(2) + " s";
  part("clock").textContent = isNow ? "marked instant" : text;
  scrub.setAttribute("aria-valuetext", isNow ? "marked instant" : text);
}

function seek(to) {
  play(false);
  show.clock = Math.max(0, Math.min(frames - 1, to));
  ask();
}

function play(on) {
  show.playing = on;
  show.lastTick = performance.now();
  part("play").setAttribute("aria-label", on ? "Pause" : "Play");
  part("play").title = on ? "Pause (space)" : "Play (space)";
  ask();
}

function setSpeed(index) {
  show.speed = Math.max(0, Math.min(SPEEDS.length - 1, index));
  part("speed").textContent = SPEEDS[show.speed] + "×";
  part("speed").setAttribute("aria-label", `Speed ${SPEEDS[show.speed]}; press for the usual speed`);
}

// ---- the camera, one for all panels ----

function resetCamera() {
  camera = { azimuth: AZIMUTH * Math.PI / 180, elevation: ELEVATION * Math.PI / 180, zoom: 1, shift: [0, 0], follow: true };
  ask();
}
function orbit(azimuth, elevation) {
  camera.azimuth += azimuth;
  camera.elevation = Math.max(-.3, Math.min(1.57, camera.elevation + elevation));
  ask();
}
function zoom(by) { camera.zoom = Math.max(.2, Math.min(12, camera.zoom * by)); ask(); }

function turnBy(canvas) {
  let held = null;
  canvas.addEventListener("pointerdown", event => { canvas.setPointerCapture(event.pointerId); held = [event.clientX, event.clientY]; });
  canvas.addEventListener("pointermove", event => {
    if (!held) return;
    orbit((held[0] - event.clientX) * .009, (event.clientY - held[1]) * .007);
    held = [event.clientX, event.clientY];
  });
  for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => { held = null; });
  canvas.addEventListener("dblclick", resetCamera);
  canvas.addEventListener("wheel", event => {
    if (!event.ctrlKey) return;
    event.preventDefault();
    zoom(Math.exp(-event.deltaY * (event.deltaMode ? .05 : .0015)));
  }, { passive: false });
}
