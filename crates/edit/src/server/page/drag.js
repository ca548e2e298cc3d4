
// Mouse, pen and touch on the two views: drag a joint, click it, turn, move and zoom the view.

const CATCH = { mouse: 14, pen: 14, touch: 24 }, HOLD = 500;
const held = new Map();
/** What the pointer does: "joint", "turn", "pinch" or null. */
let doing = null, grip = null, moved = 0, apart = 0, holding = 0;

const inside = (view, event) => {
  const box = view.canvas.getBoundingClientRect();
  return [event.clientX - box.left, event.clientY - box.top];
};

function handlePointers(view) {
  const { canvas } = view;
  canvas.addEventListener("pointerdown", event => press(view, event));
  canvas.addEventListener("pointermove", event => { if (held.has(event.pointerId)) moveHeld(view, event); else hoverOver(view, event); });
  canvas.addEventListener("pointerup", event => letGo(view, event));
  canvas.addEventListener("pointercancel", event => { if (doing === "joint") cancelGesture(); letGo(view, event); });
  canvas.addEventListener("pointerleave", () => { if (!held.size) { hover(null); sheet.at = null; ask(); } });
  canvas.addEventListener("contextmenu", event => event.preventDefault());
  canvas.addEventListener("wheel", event => {
    event.preventDefault();
    const steps = event.deltaY * (event.deltaMode ? .05 : .0015);
    if (doing === "joint" && now.gesture) { grip.depth += steps * 13; follow(); }
    else if (view === big && pictureShown()) zoomPicture(Math.exp(-steps), ...inside(view, event));
    else zoom(Math.exp(-steps));
  }, { passive: false });
  canvas.addEventListener("dblclick", event => {
    if (!(view === big && pictureShown()) && !jointAt(view, ...inside(view, event), CATCH.mouse)) resetView();
  });
}

function press(view, event) {
  // A second finger does not disturb the first, which moves a joint.
  if (doing === "joint" && now.gesture && now.gesture.pointer) return;
  endNudge();
  view.canvas.setPointerCapture(event.pointerId);
  held.set(event.pointerId, { x: event.clientX, y: event.clientY });
  clearTimeout(holding);
  if (held.size === 2) { if (doing === "mark") dropMark(); doing = "pinch"; [apart] = spread(); return; }
  moved = 0;
  const [x, y] = inside(view, event);
  if (view === big && pictureShown()) { doing = pressPicture(x, y, event); return; }
  const hit = event.button === 0 && now.state && jointAt(view, x, y, CATCH[event.pointerType] || 14);
  if (!hit) { doing = "turn"; return; }
  // While the program is away, a joint stays, and so does the view.
  if (!canMove()) { doing = "none"; return; }
  doing = "joint";
  grip = { view, joint: hit.joint, x, y, off: [hit.x - x, hit.y - y], from: shown()[hit.joint], depth: 0, last: [event.clientX, event.clientY] };
  now.hover = hit.joint;
  if (event.pointerType === "touch") holding = setTimeout(() => {
    if (doing !== "joint" || now.gesture) return;
    doing = "held";
    now.selected = hit.joint;
    togglePin(hit.joint);
    if (navigator.vibrate) navigator.vibrate(20);
  }, HOLD);
  ask();
}
const canMove = () => now.state && link.way === "fine" && !pictureShown();

function spread() {
  const [a, b] = [...held.values()];
  return [Math.hypot(a.x - b.x, a.y - b.y), (a.x + b.x) / 2, (a.y + b.y) / 2];
}

function moveHeld(view, event) {
  const before = held.get(event.pointerId), dx = event.clientX - before.x, dy = event.clientY - before.y;
  if (doing === "pinch") {
    const [, x, y] = spread();
    held.set(event.pointerId, { x: event.clientX, y: event.clientY });
    if (held.size < 2) return;
    const [wide, across, down] = spread();
    if (view === big && pictureShown()) { zoomPicture(wide / (apart || 1), ...inside(view, event)); panPicture(across - x, down - y); }
    else { if (apart > 0) zoom(wide / apart); pan(across - x, down - y); }
    apart = wide;
    return;
  }
  held.set(event.pointerId, { x: event.clientX, y: event.clientY });
  moved += Math.abs(dx) + Math.abs(dy);
  if (view === big && pictureShown()) { movePicture(doing, dx, dy, inside(view, event)); return; }
  if (doing === "joint") dragJoint(view, event);
  else if (doing === "turn" && (event.shiftKey || event.buttons > 1)) pan(dx, dy);
  else if (doing === "turn") orbit(-dx * .009, dy * .007);
}

/** A pointer that moves less has not moved. */
const slack = event => event.pointerType === "touch" ? 7 : 3;

/** The joint goes with the pointer; shift moves it in depth, ctrl (or cmd) moves it a fifth of the way. */
function dragJoint(view, event) {
  const [x, y] = grip.last, fine = event.ctrlKey || event.metaKey ? .2 : 1;
  if (!now.gesture) {
    if (!canMove()) return;
    if (moved < slack(event)) return;
    clearTimeout(holding);
    // What was asked for before comes first.
    if (order.busy) return;
    beginGesture(grip.joint);
    now.gesture.pointer = true;
    hover(null);
  }
  const dx = (event.clientX - x) * fine, dy = (event.clientY - y) * fine;
  grip.last = [event.clientX, event.clientY];
  if (event.shiftKey) {
    grip.depth += dy / view.project(...now.gesture.targets[grip.joint])[3];
  } else {
    grip.x += dx; grip.y += dy;
    // The joint was caught a few pixels away: over the first of the way it comes under the pointer.
    const share = Math.max(0, 1 - (Math.abs(dx) + Math.abs(dy)) / 20);
    grip.off = grip.off.map(v => Math.abs(v * share) < .1 ? 0 : v * share);
  }
  follow();
}
/** The joint goes to where the line of sight meets the plane through its old place, moved by the depth. */
function follow() {
  const { view, from, depth } = grip, { toward } = axesOfMove(view.look.camera);
  const [a, b] = [0, 1].map(far => unproject(view, grip.x + grip.off[0], grip.y + grip.off[1], far)), sight = plus(b, a, -1);
  aim(plus(a, sight, (depth + dot(plus(from, a, -1), toward)) / dot(sight, toward)));
}

function letGo(view, event) {
  if (!held.delete(event.pointerId)) return;
  clearTimeout(holding);
  if (held.size) return;
  const did = doing;
  doing = null;
  if (view === big && pictureShown()) { releasePicture(did, moved, event, inside(view, event)); return; }
  if (did === "joint" && now.gesture) endGesture();
  else if (did === "joint" && event.type === "pointerup" && moved < slack(event)) {
    select(grip.joint);
    if (event.pointerType !== "touch") togglePin(grip.joint);
    else speakJoint(grip.joint);
  }
  ask();
}

function hoverOver(view, event) {
  if (event.pointerType === "touch" || !now.state || now.gesture) return;
  const [x, y] = inside(view, event);
  if (view === big && pictureShown()) { hoverPicture(x, y); return; }
  const hit = jointAt(view, x, y, 14);
  hover(hit && hit.joint, event);
  view.canvas.style.cursor = hit ? "pointer" : "";
}

function hover(name, event) {
  const tip = $("tip"), changed = now.hover !== name;
  now.hover = name;
  tip.hidden = !name;
  if (name) {
    if (changed) {
      const sd = now.sd[name], lines = [make("b", "", capital(inWords(name)))];
      if (inWords(name) !== name) lines.push(make("span", "raw", name));
      lines.push(make("div", "", shown()[name].map(fixed).join("  ") + " cm" + (sd > .05 && !isPinned(name) ? `  ± ${sd.toFixed(1)}` : "")));
      tip.replaceChildren(...lines);
    }
    const { width, height } = tip.getBoundingClientRect();
    tip.style.left = clamp(event.clientX + 16, 4, innerWidth - width - 6) + "px";
    tip.style.top = (event.clientY + 18 + height > innerHeight ? event.clientY - height - 12 : event.clientY + 18) + "px";
  }
  if (changed) { guide(); ask(); }
}

handlePointers(big);
handlePointers(small);
