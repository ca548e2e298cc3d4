
// Keys. In fields and lists they do what they do there.

const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
const ORBITS = { a: [-.12, 0], d: [.12, 0], w: [0, .1], s: [0, -.1] };

const SHORTCUTS = {
  p: event => event.shiftKey ? pinFeet() : togglePin(now.selected),
  n: event => nextOther(event.shiftKey ? -1 : 1),
  m: event => doWhenReady({ do: "mirror", side: event.shiftKey ? "left" : "both" })(),
  b: () => setBoth(!now.both),
  u: () => setRings(!now.rings),
  k: () => setKey(),
  f: () => { if (photo.on) flip(now.selected); },
  r: () => photo.on ? (beginPicture(), ask()) : resetView(),
  v: () => turn(),
  z: () => zoom(1.15),
  x: () => zoom(1 / 1.15),
  " ": () => play(!motion.playing),
  "?": () => showHelp(),
  "]": () => nextJoint(1),
  "[": () => nextJoint(-1),
};

/** Selects the next joint; false at the end of the list. */
function nextJoint(by) {
  const { joints } = now.state, at = now.selected ? joints.indexOf(now.selected) : by > 0 ? -1 : joints.length;
  const next = joints[at + by];
  if (!next) return false;
  endNudge();
  select(next);
  speakJoint(next);
  return true;
}

/** An arrow moves the selected joint up, down or sideways, with alt in depth. */
function moveByArrow(event) {
  const name = now.selected, [across, rise] = ARROWS[event.key], step = event.shiftKey ? 10 : 1;
  if (!name || !canMove()) return;
  if (now.preview) adoptPreview();
  const { right, up, toward } = axesOfMove(big.look.camera);
  const from = placeWanted(name) || now.pose[name];
  nudge(name, event.altKey ? plus(from, toward, -rise * step) : plus(plus(from, right, across * step), up, rise * step));
}

function escape() {
  if (now.gesture) { clearTimeout(resting); cancelGesture(); if (doing === "joint") doing = null; }
  else if (others.at >= 0) leaveOthers();
  else if (now.preview || motion.playing) leavePreview();
  else select(null);
}

function showHelp() {
  $("keys-help").showModal();
  $("keys-help").scrollTop = 0;
}

addEventListener("keydown", event => {
  if (!now.state || $("keys-help").open || event.key === "Escape" && $("files").matches(":popover-open")) return;
  const { target } = event, tag = target.tagName, typing = tag === "SELECT" || (tag === "INPUT" && target.type === "number");
  const key = event.key.length === 1 ? event.key.toLowerCase() : event.key, command = event.ctrlKey || event.metaKey;
  if (command && (key === "z" || key === "y") && !(typing && target.type === "number")) {
    back(key === "y" || event.shiftKey ? "redo" : "undo");
    event.preventDefault();
    return;
  }
  // A slider has the keys that move it.
  if (target.type === "range" && /^(Arrow|Home|End|Page)/.test(key)) return;
  // Wherever the focus is, Enter takes and Esc leaves the other pose that is shown.
  if (others.at >= 0 && !command && !inField() && (key === "Enter" || key === "Escape")) {
    if (key === "Enter") takeOther(); else leaveOthers();
    event.preventDefault();
    return;
  }
  if (key === "Escape") {
    if (typing) { target.dirty = false; tell(); target.blur(); } else escape();
    return;
  }
  if (command || typing) return;
  const onView = target === big.canvas || target === document.body;
  if (photo.on && onView && keyOnPicture(event)) { event.preventDefault(); return; }
  if (key === "Tab" && target === big.canvas) { if (nextJoint(event.shiftKey ? -1 : 1)) event.preventDefault(); return; }
  if (ARROWS[key] && onView) { soon(() => moveByArrow(event)); event.preventDefault(); return; }
  if (key === "Delete" && onView) { removeKey(keyInHand()); return; }
  if (event.altKey) return;
  if (tag === "BUTTON" && key === " " || tag === "SUMMARY" || (tag === "INPUT" && key === " ")) return;
  if (SHORTCUTS[key]) SHORTCUTS[key](event);
  else if (ORBITS[key]) orbit(...ORBITS[key]);
  else return;
  event.preventDefault();
});
// The joint that Tab comes to first is the first one, or from behind the last.
big.canvas.addEventListener("focus", () => { if (now.selected) speakJoint(now.selected); });
$("help").addEventListener("click", showHelp);
