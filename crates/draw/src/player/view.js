
// The body of `player(root, scene)`, of poses.
// The scene as the page carries it: points decoded, what is missing counted, the drawing.

const STATUS = ["observed", "changed", "inferred", "rejected", "unknown", "missing"];
const MISSING = 5;
const points = scene.points.length;

function reader(text) {
  const coded = atob(text), bytes = new Uint8Array(coded.length);
  for (let i = 0; i < coded.length; i++) bytes[i] = coded.charCodeAt(i);
  return new DataView(bytes.buffer);
}

function decode(figure) {
  if (figure.xyz) return figure.xyz;
  const xyz = new Float32Array(3 * frames * points), read = reader(figure.data);
  for (let i = 0; i < xyz.length; i++) xyz[i] = read.getFloat32(4 * i, true);
  return xyz;
}

/** The codes of every point in every frame, from the run lengths of each point. */
function unrolled(lists) {
  const codes = new Uint8Array(frames * points);
  lists.forEach((runs, p) => {
    let frame = 0;
    for (let i = 0; i < runs.length; i += 2)
      for (const end = frame + runs[i + 1]; frame < end; frame++) codes[frame * points + p] = runs[i];
  });
  return codes;
}

/** Whether one of two takes has no such point at all, or has ended: nothing is missing then. */
function isAbsent(f, i) {
  const take = scene.pair && scene.pair.takes[f];
  return take && (!take.has[i % points] || take.frames && take.frames[Math.floor(i / points)] === null);
}

/** The status of every point in every frame; what has no coordinates is missing. */
function statuses(figure, f, xyz) {
  const status = unrolled(figure.status || []);
  for (let i = 0; i < status.length; i++) if (Number.isNaN(xyz[3 * i]) && !isAbsent(f, i)) status[i] = MISSING;
  return status;
}

const figures = scene.figures.map((source, f) => {
  const xyz = decode(source), status = statuses(source, f, xyz), take = scene.pair && scene.pair.takes[f];
  const counts = new Uint16Array(frames * 6);
  for (let i = 0; i < status.length; i++) counts[Math.floor(i / points) * 6 + status[i]]++;
  const has = STATUS.map((_, s) => status.includes(s));
  const bones = take ? take.bones : scene.bones, count = take ? take.has.filter(Boolean).length : points;
  return { name: source.name, note: source.note || "", xyz, status, ...fills(source), counts, has, bones, count, shown: true };
});

// ---- where the figure goes, smoothed, for the camera to go with it ----

/** Where figures are in a frame: their middle, height and radius; null where nothing is seen. */
function spread(list, t) {
  const xs = [], zs = [];
  let top = -Infinity;
  for (const { xyz } of list)
    for (let i = t * points * 3; i < (t + 1) * points * 3; i += 3) {
      if (Number.isNaN(xyz[i])) continue;
      xs.push(xyz[i]); zs.push(xyz[i + 2]);
      top = Math.max(top, xyz[i + 1]);
    }
  if (!xs.length) return null;
  // Medians, and not the farthest point: a stray one must not carry the camera away.
  const x = quantile(xs, .5), z = quantile(zs, .5);
  return { x, z, top, radius: 1.2 * quantile(xs.map((_, i) => Math.hypot(xs[i] - x, zs[i] - z)), .95) };
}

const around = list => journey(list.length ? t => spread(list, t) : () => null);
let path = around(scene.pair ? figures : figures.slice(scene.reference, scene.reference + 1));

/** Two takes side by side are followed each by itself, at one scale. */
const ways = scene.pair && [...figures.map(figure => around([figure])), path];
if (ways) for (const size of ["height", "radius"]) ways[0][size] = ways[1][size] = Math.max(ways[0][size], ways[1][size]);

// ---- drawing ----

function readInk() { readColors(["middle", "left", "right", "behind", "pale", "f5"].concat(STATUS.slice(1))); }

const LIMB = { l: "left", r: "right", m: "middle" };
/** A limb's color: its side, or (overlaid) its figure, paler on the right; what stands behind has one of its own. */
function limbColor(figure, side, overlaid, behind) {
  if (behind) return ink.behind;
  if (!overlaid) return ink[LIMB[side]];
  const color = ink.figures[figure % 6];
  return side === "r" ? `color-mix(in srgb, ${color} 50%, ${ink.panel})` : color;
}
const isMarker = point => scene.markers !== null && point >= scene.markers;
const boneSide = ([a, b]) => scene.sides[b] !== "m" ? scene.sides[b] : scene.sides[a];

function drawShadow(ctx, project, figure, frame) {
  const { xyz, bones } = figures[figure], base = frame * points * 3;
  ctx.strokeStyle = ink.shadow; ctx.globalAlpha = .16; ctx.lineCap = "round"; ctx.beginPath();
  let scale = 1;
  for (const [a, b] of bones) {
    const i = base + 3 * a, j = base + 3 * b;
    if (isMarker(b) || Number.isNaN(xyz[i]) || Number.isNaN(xyz[j])) continue;
    const p = project(xyz[i], scene.ground, xyz[i + 2]), q = project(xyz[j], scene.ground, xyz[j + 2]);
    ctx.moveTo(p[0], p[1]); ctx.lineTo(q[0], q[1]); scale = p[3];
  }
  ctx.lineWidth = Math.max(1.5, 4 * scale); ctx.stroke(); ctx.globalAlpha = 1;
}

/** Where a point was in the last second and a half: fading, dashed where it was inferred. */
function drawTrail(ctx, project, figure, frame, point, color) {
  const { xyz, status } = figures[figure], long = Math.max(1, Math.round(1.5 * rateAt(frame))), run = runOf(frame);
  const first = Math.max(0, run >= 0 ? scene.runs[run][1] : 0, frame - long);
  ctx.strokeStyle = color; ctx.lineWidth = 2.2; ctx.lineCap = "round";
  let before = null;
  for (let t = first; t <= frame; t++) {
    const i = 3 * (t * points + point);
    const here = Number.isNaN(xyz[i]) ? null : project(xyz[i], xyz[i + 1], xyz[i + 2]);
    if (here && before) {
      ctx.globalAlpha = .08 + .8 * (t - frame + long) / long;
      ctx.strokeStyle = status[t * points + point] === 2 ? ink.inferred : color;
      ctx.beginPath(); ctx.moveTo(before[0], before[1]); ctx.lineTo(here[0], here[1]); ctx.stroke();
    }
    before = here;
  }
  ctx.globalAlpha = 1;
}

function drawDot(ctx, x, y, radius, color, status) {
  ctx.beginPath();
  ctx.setLineDash([]);
  if (status === 3) {
    const r = Math.min(radius, 5) * 1.3;
    ctx.moveTo(x - r, y - r); ctx.lineTo(x + r, y + r); ctx.moveTo(x - r, y + r); ctx.lineTo(x + r, y - r);
    ctx.strokeStyle = ink.rejected; ctx.lineWidth = 2; ctx.stroke();
    return;
  }
  const hollow = status === 2 || status === 4;
  ctx.arc(x, y, status ? Math.max(radius, 3.4) : radius, 0, 7);
  ctx.fillStyle = hollow ? ink.panel : status === 1 ? ink.changed : color;
  ctx.fill();
  if (hollow) { ctx.strokeStyle = status === 2 ? ink.inferred : ink.unknown; ctx.lineWidth = 2; ctx.stroke(); }
}

/** One figure, from the farthest part to the nearest; what can be hovered over goes into `hits`. */
function drawBody(ctx, project, figure, frame, above, overlaid, hits, marked, behind = false) {
  // Overlaid figures are drawn thinner and thinner, so that the first still frames the last.
  const thickness = scale => Math.min(9, Math.max(1.6, 2.4 * scale)) * (1 + .5 * Math.min(above, 3));
  const { xyz, status, bones } = figures[figure], at = new Array(points), parts = [];
  for (let p = 0; p < points; p++) {
    const i = 3 * (frame * points + p);
    if (Number.isNaN(xyz[i])) continue;
    at[p] = project(xyz[i], xyz[i + 1], xyz[i + 2]);
    parts.push([at[p][2] + .03 * scene.size, p, null]);
    hits.push({ x: at[p][0], y: at[p][1], figure, point: p });
  }
  for (const bone of bones) {
    const a = at[bone[0]], b = at[bone[1]];
    if (a && b) parts.push([(a[2] + b[2]) / 2, -1, bone]);
  }
  parts.sort((a, b) => a[0] - b[0]);
  for (const [, p, bone] of parts) {
    if (bone) {
      const a = at[bone[0]], b = at[bone[1]], isLine = isMarker(bone[1]);
      const thick = isLine ? 1 : thickness((a[3] + b[3]) / 2);
      const guessed = status[frame * points + bone[0]] === 2 || status[frame * points + bone[1]] === 2;
      if (!overlaid && !behind && !isLine) drawEdge(ctx, a, b, thick);
      ctx.beginPath(); ctx.moveTo(a[0], a[1]); ctx.lineTo(b[0], b[1]);
      ctx.setLineDash(guessed ? [thick * 1.6, thick * 1.1] : []);
      ctx.lineCap = guessed ? "butt" : "round";
      ctx.strokeStyle = limbColor(figure, boneSide(bone), overlaid, behind); ctx.lineWidth = thick; ctx.stroke();
      continue;
    }
    const [x, y, , scale] = at[p], thick = thickness(scale);
    const radius = p === scene.head ? .039 * scene.size * scale + 2 * Math.min(above, 3) : isMarker(p) ? Math.max(1.5, thick * .4) : bones.length ? thick * .72 : Math.max(3, thick);
    drawDot(ctx, x, y, radius, limbColor(figure, scene.sides[p], overlaid, behind), status[frame * points + p]);
    if (p === marked) {
      ctx.beginPath(); ctx.arc(x, y, Math.max(radius, 4) + 4, 0, 7);
      ctx.strokeStyle = ink.accent; ctx.lineWidth = 2; ctx.stroke();
    }
  }
  ctx.setLineDash([]);
}

function drawPanel(panel, frame, trail, hover) {
  const { ctx } = panel, [width, height] = ctx.begin();
  if (ways) path = ways[panel.figures.length > 1 ? 2 : panel.figures[0]];
  const project = projection(width, height, frame), overlaid = panel.figures.length > 1;
  const shown = panel.figures.filter(f => figures[f].shown);
  panel.hits = [];
  drawGrid(ctx, project, frame);
  for (const f of shown) drawShadow(ctx, project, f, frame);
  const behind = scene.behind;
  if (behind !== null && !overlaid && !shown.includes(behind)) drawBody(ctx, project, behind, frame, 0, true, [], -1, true);
  if (trail >= 0) for (const f of shown)
    drawTrail(ctx, project, f, frame, trail, overlaid ? ink.figures[f % 6] : ink.accent);
  shown.forEach((f, i) => {
    const above = overlaid ? shown.length - 1 - i : 0;
    const hovered = hover && hover.figure === f ? hover.point : -1;
    drawBody(ctx, project, f, frame, above, overlaid, panel.hits, hovered >= 0 ? hovered : above ? -1 : trail);
  });
  ctx.end();
}

/** The strip below the slider: at each place, the share of points that were not simply observed. */
const MARKS = [MISSING, 4, 3, 2, 1];
function drawStrip(canvas, figure) {
  const dots = window.devicePixelRatio || 1, ctx = canvas.getContext("2d"), { counts } = figures[figure];
  const width = canvas.width = Math.round(canvas.clientWidth * dots), height = canvas.height = Math.round(canvas.clientHeight * dots);
  const last = Math.max(1, frames - 1);
  for (let x = 0; x < width; x++) {
    const a = Math.min(frames - 1, Math.round(x / width * last)), b = Math.max(a + 1, Math.round((x + 1) / width * last));
    let y = height;
    for (const mark of MARKS) {
      let most = 0;
      for (let t = a; t < b; t++) most = Math.max(most, counts[t * 6 + mark]);
      if (!most) continue;
      // A single point of many must still be seen, so the share's square root is drawn.
      const tall = Math.max(3 * dots, Math.sqrt(most / figures[figure].count) * height);
      ctx.fillStyle = ink[STATUS[mark]];
      ctx.fillRect(x, y - tall, 1, tall);
      y -= tall;
    }
  }
  ctx.fillStyle = ink.text;
  scene.runs.slice(1).forEach(run => ctx.fillRect(Math.round(run[1] / last * width), 0, dots, height));
}
