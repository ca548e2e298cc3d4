
// The body of `player(root, scene)`, of poses: two takes over each other or side by side, and how far apart they are.

const told = scene.pair && scene.pair.differences;
const apart = { by: "Largest", down: true, section: "differences", columns: apartColumns, go: goToLargest, list: [], paper: null };
const cm = v => v.toFixed(2) + " cm";

function apartColumns() {
  return [
    ["Point", item => scene.points[item.point]],
    ["Largest", item => item.largest, cm, "number"],
    ["At", item => moment(item.first)[1], v => v.toFixed(2) + " s", "number"],
    ["RMS", item => item.rms, cm, "number"],
  ];
}

/** One of two buttons is pressed: over each other, or side by side. */
function makeWays() {
  const way = (name, text, over) => {
    const button = make("button", name, text);
    button.title = text + " (o)";
    press(button, () => { if (state.overlay !== over) actions.overlay(); });
    return button;
  };
  part("overlay").before(way("over", "Over each other", true), way("beside", "Side by side", false));
}

/** The differences over time, below the slider, with those of the current frame beside them. */
function makeApart() {
  const row = make("div", "strip apart"), lane = make("div", "lane"), canvas = make("canvas");
  lane.append(canvas);
  row.append(make("output"), lane);
  canvas.setAttribute("role", "img");
  canvas.setAttribute("aria-label", "Differences over time: root mean square and largest");
  seek(canvas, share => share * (frames - 1));
  part("strips").before(row);
  apart.paper = canvasPaper(canvas);
  apart.list = told.points.map(([point, rms, largest, first]) => ({ point, rms, largest, first }));
  if (!part("differences")) return;
  part("differences").hidden = false;
  part("differences").querySelector("h2").textContent = "Differences by point";
  fillRows(apart);
}

function makePair() {
  if (!scene.pair) return;
  state.overlay = true;
  makeWays();
  if (told) makeApart();
}

/** Goes to the frame in which a point differs most. */
function goToLargest(item) {
  play(false);
  show(item.first);
  setTrail(item.point);
}

/** Frames on end that have differences, `step` pixels apart: x, root mean square, largest. A pixel has the largest of its frames. */
function apartPieces(step) {
  const pieces = [];
  let piece = null;
  told.frames.forEach((of, t) => {
    if (!of) { piece = null; return; }
    if (!piece) pieces.push(piece = []);
    const x = t * step, before = piece.at(-1);
    if (before && x - before[0] < 1) { before[1] = Math.max(before[1], of[0]); before[2] = Math.max(before[2], of[1]); }
    else piece.push([x, of[0], of[1]]);
  });
  return pieces;
}

/** The largest difference as a line, the root mean square as an area; what cannot be told is left out. */
function drawApart() {
  if (!apart.paper) return;
  const ctx = apart.paper, [width, height] = ctx.begin(), last = Math.max(1, frames - 1);
  const most = Math.max(...apart.list.map(item => item.largest), 1e-3), top = 13;
  const y = v => height - 1 - (height - 1 - top) * v / most;
  for (const piece of apartPieces(width / last)) {
    // A frame alone is seen too.
    if (piece.length === 1) piece.push([piece[0][0] + 1.5, ...piece[0].slice(1)]);
    ctx.beginPath();
    piece.forEach(([x, rms]) => ctx.lineTo(x, y(rms)));
    ctx.lineTo(piece.at(-1)[0], height); ctx.lineTo(piece[0][0], height);
    ctx.fillStyle = ink.accent; ctx.globalAlpha = .5; ctx.fill(); ctx.globalAlpha = 1;
    ctx.beginPath();
    piece.forEach(([x, , largest]) => ctx.lineTo(x, y(largest)));
    ctx.setLineDash([]); ctx.strokeStyle = ink.text; ctx.lineWidth = 1.5; ctx.lineJoin = "round"; ctx.stroke();
  }
  ctx.font = "11px system-ui, sans-serif";
  write(ctx, cm(most), 4, 11);
}

/** After each frame: which way the takes are shown, and how far apart they are. */
function tellPair() {
  if (!scene.pair) return;
  part("over").setAttribute("aria-pressed", state.overlay);
  part("beside").setAttribute("aria-pressed", !state.overlay);
  if (!told) return;
  const row = part("apart"), of = told.frames[state.frame];
  row.style.setProperty("--at", state.frame / Math.max(1, frames - 1));
  const line = (kind, name, text) => {
    const node = make("div"), sign = make("span", "swatch " + kind);
    node.append(sign, name + " ", make("b", "", text));
    return node;
  };
  row.querySelector("output").replaceChildren(
    line("block rms", "RMS", of ? cm(of[0]) : "–"),
    line("line largest", "largest", of ? `${cm(of[1])}, ${scene.points[of[2]]}` : "–"));
}

/** The frames of both takes, where these are not those of the page. */
function ownFrames(t) {
  const own = scene.pair && scene.pair.takes[0].frames && scene.pair.takes.map(take => take.frames[t] ?? "–");
  return own && "frames " + own.join(" and ");
}
