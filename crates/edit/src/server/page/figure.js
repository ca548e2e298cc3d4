
// Drawing of the body: bones, joints as handles, pins as squares, rings of uncertainty, what is out of reach, ghosts.

const SIDE = { l: "left", r: "right", m: "middle" };
const isHead = name => /^head$/i.test(name);

function bonesOf(pose) {
  const { joints, parents } = now.state;
  return joints.filter(name => parents[name] && pose[name] && pose[parents[name]]).map(name => [parents[name], name]);
}

/** A circle as a path of its own. */
function circle(ctx, x, y, radius) { ctx.beginPath(); ctx.arc(x, y, radius, 0, 7); }
function line(ctx, a, b) { ctx.beginPath(); ctx.moveTo(a[0], a[1]); ctx.lineTo(b[0], b[1]); }

const thickness = scale => clamp(2.1 * scale, 1.6, 9);

/** The shadow on the floor: broad and faint below, narrow and darker above, so that its edge is soft. */
function drawShadow(ctx, project, pose) {
  const bones = bonesOf(pose);
  ctx.strokeStyle = ink.shadow; ctx.lineCap = "round"; ctx.setLineDash([]);
  for (const [wide, alpha] of [[11, .035], [8, .045], [5, .06]]) {
    let scale = 1;
    ctx.globalAlpha = alpha;
    ctx.beginPath();
    for (const [a, b] of bones) {
      const p = project(pose[a][0], scene.ground, pose[a][2]), q = project(pose[b][0], scene.ground, pose[b][2]);
      ctx.moveTo(p[0], p[1]); ctx.lineTo(q[0], q[1]); scale = p[3];
    }
    ctx.lineWidth = Math.max(1.5, wide * scale);
    ctx.stroke();
  }
  ctx.globalAlpha = 1;
}

/** A pose as thin lines: what was, what is offered, what comes before and after. */
function drawGhost(ctx, project, pose, color, alpha, dashes = []) {
  ctx.strokeStyle = color; ctx.globalAlpha = alpha; ctx.lineCap = "round"; ctx.setLineDash(dashes);
  const at = name => project(...pose[name]);
  for (const [a, b] of bonesOf(pose)) {
    const p = at(a), q = at(b);
    ctx.lineWidth = Math.max(1.5, .62 * thickness((p[3] + q[3]) / 2));
    line(ctx, p, q); ctx.stroke();
    if (isHead(b)) { circle(ctx, q[0], q[1], .036 * scene.size * q[3]); ctx.lineWidth = 1.5; ctx.stroke(); }
  }
  ctx.globalAlpha = 1; ctx.setLineDash([]);
}

/** One standard deviation of each joint. */
function drawRings(ctx, at) {
  ctx.strokeStyle = ink.inferred; ctx.lineWidth = 1.2;
  for (const [name, sd] of Object.entries(now.sd)) {
    const p = at[name], radius = p && sd * p[3];
    if (!p || radius < 4) continue;
    circle(ctx, p[0], p[1], radius);
    ctx.globalAlpha = .05; ctx.fillStyle = ink.inferred; ctx.fill();
    ctx.globalAlpha = .5; ctx.stroke();
  }
  ctx.globalAlpha = 1;
}

/** Bones and joints, from the farthest to the nearest; `hits` are where joints can be caught. */
function drawBody(ctx, at, handles, hits) {
  const parts = [], front = byName(), pose = shown();
  for (const name of now.state.joints) {
    const p = at[name];
    if (!p) continue;
    front[name] = p[2];
    hits.push({ x: p[0], y: p[1], depth: p[2], joint: name });
  }
  for (const [a, b] of bonesOf(pose)) {
    const middle = (at[a][2] + at[b][2]) / 2;
    parts.push([middle, b, a]);
    for (const end of [a, b]) front[end] = Math.max(front[end], middle);
  }
  // A joint lies on the bones that meet in it, so that it can be seen and caught.
  for (const name in front) parts.push([front[name] + .005 * scene.size, name]);
  parts.sort((p, q) => p[0] - q[0]);
  ctx.setLineDash([]);
  for (const [, name, parent] of parts) {
    const p = at[name];
    if (!parent) { drawJoint(ctx, name, p, handles); continue; }
    const q = at[parent], thick = thickness((p[3] + q[3]) / 2);
    drawEdge(ctx, q, p, thick);
    line(ctx, q, p);
    ctx.lineCap = "round"; ctx.strokeStyle = ink[SIDE[sideOf(name)]]; ctx.lineWidth = thick; ctx.stroke();
  }
}

function drawJoint(ctx, name, [x, y, , scale], handles) {
  const color = ink[SIDE[sideOf(name)]], pin = now.preview || photo.on ? null : now.pins[name];
  if (isHead(name)) { circle(ctx, x, y, .038 * scene.size * scale); ctx.fillStyle = color; ctx.fill(); }
  const hot = handles && (name === now.hover || name === now.selected);
  const radius = clamp(1.15 * scale, 1.6, 4.6) + (handles && name === now.hover ? 1.5 : 0);
  if (pin) drawSquare(ctx, x, y, Math.max(radius, 3.4) + .6, pin.every(v => v !== null));
  else {
    circle(ctx, x, y, radius);
    ctx.fillStyle = handles && name === now.hover ? ink.accent : ink.panel; ctx.fill();
    ctx.strokeStyle = color; ctx.lineWidth = Math.min(2, .5 * radius); ctx.stroke();
  }
  if (hot && name === now.selected) {
    circle(ctx, x, y, radius + 6);
    ctx.strokeStyle = ink.panel; ctx.lineWidth = 5; ctx.stroke();
    ctx.strokeStyle = ink.accent; ctx.lineWidth = 2.4; ctx.stroke();
  }
}

/** A pin: a full square; with a free axis a half one. */
function drawSquare(ctx, x, y, half, full) {
  ctx.fillStyle = ink.panel; ctx.strokeStyle = ink.text; ctx.lineWidth = 2;
  ctx.fillRect(x - half - 2.5, y - half - 2.5, 2 * half + 5, 2 * half + 5);
  ctx.fillStyle = ink.text;
  if (full) ctx.fillRect(x - half, y - half, 2 * half, 2 * half);
  else { ctx.fillRect(x - half, y, 2 * half, half); ctx.strokeRect(x - half, y - half, 2 * half, 2 * half); }
}

/** From a joint to the place that it cannot reach, with the distance. */
function drawMissed(ctx, project, at, labeled) {
  for (const name of Object.keys(now.missed)) {
    const p = at[name], goal = placeWanted(name), away = missedBy(name);
    if (!p || !goal || away < .1) continue;
    const q = project(...goal);
    ctx.strokeStyle = ink.rejected; ctx.lineWidth = 2.4; ctx.setLineDash([]);
    line(ctx, p, q); ctx.stroke();
    const r = 5;
    ctx.beginPath();
    ctx.moveTo(q[0] - r, q[1] - r); ctx.lineTo(q[0] + r, q[1] + r);
    ctx.moveTo(q[0] - r, q[1] + r); ctx.lineTo(q[0] + r, q[1] - r);
    ctx.stroke();
    // To the right of the line: below one that rises, above one that falls.
    const below = (q[0] - p[0]) * (q[1] - p[1]) < 0;
    if (labeled && away >= .5) label(ctx, (p[0] + q[0]) / 2 + 9, (p[1] + q[1]) / 2 + (below ? 16 : -7), cm(away), ink.rejected);
  }
}

function label(ctx, x, y, text, color) {
  ctx.font = "600 12px system-ui, sans-serif";
  ctx.lineJoin = "round"; ctx.lineWidth = 4; ctx.strokeStyle = ink.panel;
  ctx.strokeText(text, x, y);
  ctx.fillStyle = color;
  ctx.fillText(text, x, y);
}

/** The places that joints are dragged to: there at once, whatever the body's answer. */
function drawTargets(ctx, project, at) {
  for (const [name, goal] of Object.entries(now.gesture.targets)) {
    const q = project(...goal), foot = project(goal[0], scene.ground, goal[2]), p = at[name];
    ctx.globalAlpha = .45; ctx.strokeStyle = ink.pale; ctx.lineWidth = 1; ctx.setLineDash([3, 4]);
    line(ctx, q, foot); ctx.stroke();
    ctx.setLineDash([]);
    ctx.beginPath(); ctx.ellipse(foot[0], foot[1], 6, 6 * Math.abs(Math.sin(big.look.camera.elevation)) + .5, 0, 0, 7); ctx.stroke();
    ctx.globalAlpha = 1;
    // A miss has a line already.
    if (p && !missedBy(name)) { ctx.strokeStyle = ink.accent; ctx.lineWidth = 1.4; line(ctx, p, q); ctx.stroke(); }
    if (!isPinned(name)) drawTolerance(ctx, q, now.gesture.sd);
    circle(ctx, q[0], q[1], 6.5);
    ctx.fillStyle = ink.accent; ctx.fill();
    ctx.strokeStyle = ink.panel; ctx.lineWidth = 2; ctx.stroke();
  }
}

/** How far from there a dragged joint may stay; a circle that the dot would hide is left out. */
function drawTolerance(ctx, [x, y, , scale], sd) {
  if (sd * scale < 9) return;
  circle(ctx, x, y, sd * scale);
  ctx.globalAlpha = .08; ctx.fillStyle = ink.accent; ctx.fill(); ctx.globalAlpha = 1;
  ctx.strokeStyle = ink.accent; ctx.lineWidth = 1.4; ctx.setLineDash([5, 4]); ctx.stroke(); ctx.setLineDash([]);
}

/** Everything in a view of the body. */
function drawView(view) {
  beginView(view);
  if (!now.state) return;
  const { ctx, project } = view, pose = shown(), handles = view === big || !!now.gesture;
  const at = byName();
  for (const name of now.state.joints) if (pose[name]) at[name] = project(...pose[name]);
  view.look.drawGrid(ctx, project, 0);
  drawShadow(ctx, project, pose);
  for (const ghost of ghosts()) drawGhost(ctx, project, ghost.pose, ink[ghost.color], ghost.alpha, ghost.dashes);
  if (now.rings && !now.preview && view === big) drawRings(ctx, at);
  drawBody(ctx, at, handles, view.hits);
  if (!now.preview && !photo.on) drawMissed(ctx, project, at, view === big);
  if (now.gesture) drawTargets(ctx, project, at);
  else if (at[now.selected] && document.activeElement === $("tolerance")) drawTolerance(ctx, at[now.selected], now.tolerance);
}

/** Faint poses around the present one. */
function ghosts() {
  const list = [];
  if (now.gesture) list.push({ pose: now.gesture.from, color: "pale", alpha: .3 });
  if (!now.gesture) list.push(...neighborGhosts());
  const other = otherGhost();
  if (other) list.push({ pose: other, color: "changed", alpha: .95, dashes: [6, 5] });
  return list;
}

/** A small picture of a pose, from the front and a little to the side. */
function drawThumbnail(canvas, pose) {
  const ctx = canvasPaper(canvas), [width, height] = ctx.begin(), { low, top, x, z } = extent(pose);
  const angle = .45, across = p => (p[0] - x) * Math.cos(angle) - (p[2] - z) * Math.sin(angle);
  const wide = Math.max(...Object.values(pose).map(p => Math.abs(across(p))));
  const scale = Math.min((height - 12) / Math.max(top - low, .5 * scene.size), (width - 8) / (2 * Math.max(wide, 1)));
  const at = p => [width / 2 + across(p) * scale, height - 6 - (p[1] - Math.min(low, top - .5 * scene.size)) * scale];
  ctx.lineCap = "round"; ctx.lineWidth = 2;
  for (const [a, b] of bonesOf(pose)) {
    line(ctx, at(pose[a]), at(pose[b]));
    ctx.strokeStyle = ink[SIDE[sideOf(b)]]; ctx.stroke();
    if (isHead(b)) { circle(ctx, ...at(pose[b]), 3); ctx.fillStyle = ctx.strokeStyle; ctx.fill(); }
  }
}
