
// The body of `player(root, scene)`, of poses: x, y and z of one joint over time, drawn anew only when they change.

/** What is drawn: frames `from` to `to` of a joint of a figure; all of them, or those of so many `seconds`. */
const curves = { joint: 0, figure: 0, seconds: 0, from: 0, to: frames - 1, stale: true, paper: null };
const SPANS = [2, 5, 15, 60];
/** The kinds of stretches; a filled one's number is FILLED and that of its method. */
const SEEN = 0, MOVED = 1, FILLED = 2;
const LOOKS = [
  ["middle", [], "measured"], ["changed", [], "changed"], ["inferred", [7, 3], "inferred"],
  ["inferred", [7, 3], "filled by regression"], ["f5", [2, 3], "filled by PCHIP"], ["left", [9, 3, 2, 3], "filled by the model"],
  ["right", [12, 2], "held where a foot stands"], ["f3", [14, 3], "filled from motion"],
];
const ROOM = 8;
/** Of very many figures only so many stand behind the curves. */
const OTHERS = 6;

function staleCurves() { curves.stale = true; }

function kindAt(figure, i) {
  const { status, method } = figures[figure];
  return status[i] === INFERRED ? FILLED + (method ? method[i] : 0) : status[i] === 1 ? MOVED : SEEN;
}

// ---- curves as pieces ----

/**
 * A piece under way: `add` keeps of a column of pixels at most four places, the first, lowest, highest and last, and `end`
 * the last column's. `sure` is the band around it.
 */
function newPiece(kind) {
  const piece = { kind, xs: [], ys: [], sure: [] }, { xs, ys, sure } = piece;
  let column = null;
  piece.end = () => {
    if (!column) return;
    const { x, first, low, high, last, bottom, top } = column;
    for (const v of [first, low, high, last]) if (ys.at(-1) !== v || xs.at(-1) !== x) { xs.push(x); ys.push(v); }
    if (top > bottom) sure.push([x, bottom, top]);
    column = null;
  };
  piece.add = (x, v, wide) => {
    if (column && Math.floor(x) !== Math.floor(column.x)) piece.end();
    column ??= { x, first: v, low: v, high: v, bottom: v, top: v };
    column.low = Math.min(column.low, v); column.high = Math.max(column.high, v); column.last = v;
    column.bottom = Math.min(column.bottom, v - wide); column.top = Math.max(column.top, v + wide);
  };
  return piece;
}

/** A coordinate's pieces, of one kind each. One that was filled reaches to the measured frames at its ends. */
function piecesOf(figure, axis, x) {
  const { xyz, sd } = figures[figure], starts = new Set(scene.runs.map(run => run[1])), pieces = [];
  let piece = null;
  const add = t => {
    const i = t * points + curves.joint;
    piece.add(x(t), xyz[3 * i + axis], sd ? 2 * sd[i] : 0);
  };
  for (let t = Math.max(0, curves.from - 1); t <= Math.min(frames - 1, curves.to + 1); t++) {
    const i = t * points + curves.joint, kind = Number.isNaN(xyz[3 * i]) ? -1 : kindAt(figure, i);
    if (!piece || kind !== piece.kind || starts.has(t)) {
      const joins = piece && kind >= 0 && !starts.has(t);
      if (joins && piece.kind >= FILLED && kind < FILLED) add(t);
      if (piece) piece.end();
      piece = kind < 0 ? null : newPiece(kind);
      if (!piece) continue;
      pieces.push(piece);
      if (joins && kind >= FILLED) add(t - 1);
    }
    add(t);
  }
  if (piece) piece.end();
  return pieces;
}

/** The lowest and highest of what is drawn; a band may widen it by half. A still joint's noise does not fill the row. */
function reach(pieces) {
  let low = Infinity, high = -Infinity, bottom = Infinity, top = -Infinity;
  for (const piece of pieces) {
    for (const v of piece.ys) { low = Math.min(low, v); high = Math.max(high, v); }
    for (const [, a, b] of piece.sure) { bottom = Math.min(bottom, a); top = Math.max(top, b); }
  }
  if (low > high) return [0, 1];
  const half = Math.max(.5 * (high - low), .5);
  [low, high] = [Math.min(low, Math.max(bottom, low - half)), Math.max(high, Math.min(top, high + half))];
  const more = Math.max(0, 1 - (high - low) / 2);
  return [low - more, high + more];
}

// ---- drawing ----

function trace(ctx, { xs, ys }, y) {
  ctx.beginPath();
  // A frame alone between gaps is a dot.
  if (xs.length === 1) { ctx.moveTo(xs[0] - .8, y(ys[0])); ctx.lineTo(xs[0] + .8, y(ys[0])); }
  xs.forEach((x, i) => ctx.lineTo(x, y(ys[i])));
  ctx.stroke();
}

function fillBand(ctx, { sure, kind }, y) {
  ctx.beginPath();
  for (const [x, , top] of sure) ctx.lineTo(x, y(top));
  for (const [x, bottom] of [...sure].reverse()) ctx.lineTo(x, y(bottom));
  ctx.fillStyle = ink[LOOKS[kind][0]]; ctx.globalAlpha = .22;
  ctx.fill();
  ctx.globalAlpha = 1;
}

/** Shades what was not measured: what is missing more than what was filled. */
function shadeGaps(ctx, x, height) {
  const { status } = figures[curves.figure], shade = (kind, color, alpha) => {
    ctx.fillStyle = color; ctx.globalAlpha = alpha;
    for (let t = curves.from; t <= curves.to; t++) {
      if (status[t * points + curves.joint] !== kind) continue;
      const first = t;
      while (t < curves.to && status[(t + 1) * points + curves.joint] === kind) t++;
      ctx.fillRect(x(first - .5), 0, Math.max(1.5, x(t + .5) - x(first - .5)), height);
    }
    ctx.globalAlpha = 1;
  };
  shade(INFERRED, ink.inferred, .08);
  shade(MISSING, ink.missing, .2);
}

/** Crosses where a measurement is rejected, dots where it was changed if they have room. */
function drawMarks(ctx, axis, x, y) {
  const { status, xyz } = figures[curves.figure], dots = x(1) - x(0) > 5;
  let last = -Infinity;
  for (let t = curves.from; t <= curves.to; t++) {
    const i = t * points + curves.joint, at = x(t);
    if (status[i] === 3 && at - last > 3) { drawDot(ctx, at, y(xyz[3 * i + axis]), 3, ink.rejected, 3); last = at; }
    if (status[i] === 1 && dots) {
      ctx.beginPath(); ctx.arc(at, y(xyz[3 * i + axis]), 2, 0, 7); ctx.fillStyle = ink.changed; ctx.fill();
    }
  }
}

/** Writes over the curves, so that both can be read. */
function write(ctx, text, x, y) {
  ctx.setLineDash([]);
  ctx.strokeStyle = ink.panel; ctx.lineWidth = 4; ctx.lineJoin = "round"; ctx.strokeText(text, x, y);
  ctx.fillStyle = ink.pale; ctx.fillText(text, x, y);
}

function drawAxis(ctx, axis, x, top, height) {
  const own = piecesOf(curves.figure, axis, x), others = [];
  figures.forEach((_, f) => { if (f !== curves.figure && f < OTHERS) others.push(...piecesOf(f, axis, x)); });
  for (const piece of others) piece.sure = [];
  const [low, high] = reach(own.concat(others));
  const y = v => top + ROOM + (height - 2 * ROOM) * (high - v) / (high - low);
  ctx.lineCap = "butt"; ctx.lineJoin = "round";
  ctx.save();
  ctx.beginPath(); ctx.rect(0, top, x(curves.to), height); ctx.clip();
  ctx.strokeStyle = ink.behind; ctx.lineWidth = 1.2; ctx.setLineDash([]);
  for (const piece of others) trace(ctx, piece, y);
  for (const piece of own) if (piece.sure.length) fillBand(ctx, piece, y);
  for (const piece of own) {
    const [color, dash] = LOOKS[piece.kind];
    ctx.strokeStyle = ink[color]; ctx.lineWidth = piece.kind < FILLED ? 1.4 : 2; ctx.setLineDash(dash);
    trace(ctx, piece, y);
  }
  drawMarks(ctx, axis, x, y);
  ctx.restore();
  const digits = high - low < 10 ? 1 : 0;
  write(ctx, `${"xyz"[axis]}  ${high.toFixed(digits)}`, 5, top + 13);
  write(ctx, low.toFixed(digits) + " cm", 5, top + height - 5);
}

function drawCurves() {
  const { paper: ctx, from, to } = curves, [width, height] = ctx.begin(), tall = height / 3;
  const x = t => (t - from) / Math.max(1, to - from) * width;
  ctx.font = "11px system-ui, sans-serif";
  shadeGaps(ctx, x, height);
  ctx.fillStyle = ink.grid;
  for (const run of scene.runs.slice(1)) if (run[1] > from && run[1] <= to) ctx.fillRect(x(run[1] - .5), 0, 1, height);
  for (const axis of [1, 2]) ctx.fillRect(0, Math.round(axis * tall), width, 1);
  for (const axis of [0, 1, 2]) drawAxis(ctx, axis, x, axis * tall, tall);
  curves.stale = false;
}

// ---- what part of the time is shown ----

/** Frames of the part that is shown, less one. */
function spanFrames(seconds) {
  return seconds ? Math.min(frames - 1, Math.round(seconds * rateAt(state.frame))) : frames - 1;
}

function showFrom(frame) {
  const long = spanFrames(curves.seconds), from = Math.max(0, Math.min(frames - 1 - long, Math.round(frame)));
  if (from === curves.from && from + long === curves.to) return;
  Object.assign(curves, { from, to: from + long, stale: true });
}

function setSpan(seconds) {
  curves.seconds = seconds;
  part("span").value = seconds;
  showFrom(state.frame - spanFrames(seconds) / 2);
  ask();
}

/** Turns the page when the current frame has left it. */
function keepShown() {
  const long = curves.to - curves.from;
  if (state.frame > curves.to) showFrom(state.frame - .1 * long);
  if (state.frame < curves.from) showFrom(state.frame - .9 * long);
}

// ---- what is chosen and told ----

function chooseJoint(point) {
  if (!curves.paper) return;
  curves.joint = point;
  part("joint").value = point;
  part("plot").setAttribute("aria-label", `x, y and z of ${scene.points[point]} over time`);
  staleCurves();
}

function chooseFigure(figure) {
  curves.figure = figure;
  part("figure").value = figure;
  makeSigns();
  makeGaps();
  staleCurves();
}

/** The legend of the curves that are there. */
function makeSigns() {
  const { has, method, sd } = figures[curves.figure], signs = [];
  const sign = (kind, color, text) => {
    const node = make("li"), look = make("span", "swatch " + kind);
    look.style.color = `var(--${color})`;
    node.append(look, text);
    signs.push(node);
  };
  const lines = ["solid", "solid", "dashed", "dashed", "dotted", "dashed", "dashed", "dashed"];
  const used = kind => kind < FILLED ? has[kind] || kind === SEEN && !has[1] : has[INFERRED] && (method ? method.includes(kind - FILLED) : kind === FILLED);
  LOOKS.forEach(([color, , text], kind) => {
    // Without a method a point is merely inferred; measured points have none either.
    if (kind === FILLED && method && METHODS.some((_, m) => m && method.includes(m))) return;
    if (used(kind)) sign("line " + lines[kind], color, text);
  });
  if (sd && (has[INFERRED] || has[1])) sign("block faint", has[INFERRED] ? "inferred" : "changed", "± 2 sd");
  if (has[3]) sign("cross", "rejected", "rejected");
  if (has[MISSING]) sign("block faint", "missing", "missing");
  if (figures.length > 1) sign("line solid", "behind", scene.pair ? figures[1 - curves.figure].name : "the others");
  part("signs").replaceChildren(...signs);
}

function options(select, names) {
  select.append(...names.map(([value, name]) => { const option = make("option", "", name); option.value = value; return option; }));
}

function makeCurves() {
  if (!part("curves") || still || !points) return;
  part("curves").hidden = false;
  curves.paper = canvasPaper(part("plot"));
  options(part("joint"), scene.points.map((name, p) => [p, name]));
  options(part("figure"), figures.map((figure, f) => [f, figure.name]));
  part("figure").parentNode.hidden = figures.length < 2;
  options(part("span"), SPANS.filter(s => spanFrames(s) < frames - 1).map(s => [s, s + " s"]));
  part("joint").addEventListener("change", event => setTrail(+event.target.value));
  part("figure").addEventListener("change", event => { chooseFigure(+event.target.value); ask(); });
  part("span").addEventListener("change", event => setSpan(+event.target.value));
  seek(part("plot"), share => curves.from + share * (curves.to - curves.from));
  const first = test => figures.findIndex(figure => test(figure.has));
  chooseFigure([first(has => has[INFERRED] || has[1]), first(has => has[MISSING]), 0].find(f => f >= 0));
  chooseJoint((apart.list[0] || gaps.list.find(gap => gap.frames < frames) || { point: 0 }).point);
}

/** After each frame: the line at the time, and what is there. */
function tellCurves() {
  if (!curves.paper) return;
  keepShown();
  if (curves.stale) drawCurves();
  const i = state.frame * points + curves.joint, { xyz, status, has } = figures[curves.figure];
  part("curves").style.setProperty("--at", (state.frame - curves.from) / Math.max(1, curves.to - curves.from));
  const place = [...xyz.subarray(3 * i, 3 * i + 3)].map((v, c) => "xyz"[c] + " " + v.toFixed(1)).join("  ");
  const said = has.slice(1).some(Boolean) ? account(curves.figure, i) : "";
  part("reading").replaceChildren(make("div", "", Number.isNaN(xyz[3 * i]) ? "–" : place + " cm"), make("div", "", said));
}
