
// Moving joints: a gesture begins, aims at places, and ends as one step of undo, or is canceled.

/** Begins to move a joint (and its mirror image, if both sides go together). */
function beginGesture(name, sd = now.tolerance) {
  leaveOthers();
  if (now.preview) adoptPreview();
  const from = now.pose, names = [name], other = now.state.mirrors[name];
  const plane = now.both && other && other !== name && from[other] ? mirrorPlane(from) : null;
  if (plane) names.push(other);
  now.gesture = { joints: names, plane, from, sd, targets: byName(), pins: copyPins(now.pins), moved: false, asked: 0, answered: 0, steps: 0 };
  now.gesture.over = new Promise(done => { now.gesture.finished = done; });
  now.selected = name;
  for (const joint of names) now.gesture.targets[joint] = [...from[joint]];
  tell();
}

/** Moves the gesture's joint to a place; the other side follows as its mirror image. */
function aim(place) {
  const { joints: [name, other], plane } = now.gesture;
  now.gesture.moved = true;
  now.gesture.steps = 0;
  setTarget(name, place);
  if (other) setTarget(other, mirrorImage(place, plane));
  ask();
  solve();
}

/** A fully pinned joint takes its pin along, and a foot those of the whole foot; one that is pinned along some axes keeps those. */
function setTarget(name, place) {
  const pin = now.pins[name];
  let goal = onFloor(name, place);
  if (isPinned(name)) goal = movePins(name, goal);
  else if (pin) pin.forEach((v, c) => { if (v !== null) goal[c] = v; });
  now.gesture.targets[name] = goal;
}

/** Moves the pin of a joint to a place, and the other pins of its foot by as much: none of them below the floor. Where it is then. */
function movePins(name, goal) {
  const old = now.gesture.pins, along = footOf(name).filter(joint => isPinned(joint) && old[joint]), by = plus(goal, old[name], -1);
  if (along.length && now.state.floor) by[1] = Math.max(by[1], ...along.map(joint => -old[joint][1]));
  for (const joint of [name, ...along]) now.pins[joint] = plus(old[joint], by).map(rounded);
  return now.pins[name];
}
const rounded = v => Math.round(v * 1000) / 1000;

/** Nothing goes below the floor, and a foot close to it stands on it. */
function onFloor(name, place) {
  const goal = place.map(rounded);
  if (!now.state.floor) return goal;
  const near = isTip(name) ? 2 : 0;
  if (goal[1] < near) goal[1] = 0;
  return goal;
}

const isPinned = name => !!now.pins[name] && now.pins[name].every(v => v !== null);

/** By how much a joint misses its place: its pin, or the one it is dragged to, where two standard deviations are no miss. */
function missedBy(name) {
  const dragged = now.gesture && !now.gesture.ending && now.gesture.targets[name], away = now.missed[name] || 0;
  if (!now.pose[name] || !now.pins[name] && (!dragged || away < 2 * now.gesture.sd)) return 0;
  return away;
}

/** Where a joint is to be: its target, else its pin (free axes as they are). */
function placeWanted(name) {
  if (now.gesture && now.gesture.targets[name]) return now.gesture.targets[name];
  const pin = now.pins[name], at = now.pose[name];
  return pin && at ? pin.map((v, c) => v === null ? at[c] : v) : null;
}

async function solve() {
  const { gesture } = now, { targets, sd } = gesture, drags = byName();
  for (const [name, xyz] of Object.entries(targets)) if (!isPinned(name)) drags[name] = { xyz, sd };
  gesture.asked++;
  let moving = false;
  try {
    const answer = await request("/solve", { pins: copyPins(now.pins), drags, rest: now.rest }, { newest: true });
    gesture.answered++;
    // An answer to a gesture that was canceled meanwhile is of no use.
    if (!answer || gesture.canceled) return;
    takePose(answer);
    ({ moving } = answer);
    tell();
  } catch (error) {
    gesture.answered++;
    if (error.status) say(error.message);
  }
  if (now.gesture !== gesture || gesture.answered < gesture.asked) return;
  // A pose that is far away is approached in steps, also after the joint has been let go.
  if (moving && gesture.steps++ < MOST_STEPS) solve();
  else if (gesture.ending) finishGesture();
}
const MOST_STEPS = 400;

/** The joint is let go; the gesture ends as soon as the pose has arrived. */
function endGesture() {
  const { gesture } = now;
  if (!gesture || gesture.ending) return;
  gesture.ending = true;
  gesture.pointer = false;
  if (gesture.answered === gesture.asked) finishGesture();
}
/** The gesture ends with the pose as it is. */
function finishGesture() {
  const { gesture } = now;
  now.gesture = null;
  if (gesture.moved) { speakMove(gesture); order.settling = settle(); }
  gesture.finished();
  tell();
}
/** The gesture becomes a step of undo; pins that moved along with it stay where they are now. */
async function settle() {
  const pins = copyPins(now.pins), changes = pinChanges;
  pinning++;
  const released = await act({ do: "release" });
  pinning--;
  if (!released || now.gesture || changes !== pinChanges) return;
  if (samePins(pins, now.state.pins)) now.pins = copyPins(now.state.pins);
  else await setPins(pins);
}
function samePins(a, b) {
  const names = Object.keys(a);
  return names.length === Object.keys(b).length && names.every(name => b[name]
    && a[name].every((v, c) => v === null ? b[name][c] === null : b[name][c] !== null && Math.abs(v - b[name][c]) < .001));
}

function cancelGesture() {
  const gesture = now.gesture;
  if (!gesture) return;
  now.gesture = null;
  now.pins = gesture.pins;
  if (gesture.moved) {
    gesture.canceled = true;
    dropWaiting();
    now.pose = gesture.from;
    order.settling = act({ do: "cancel" });
  }
  gesture.finished();
  tell();
}

/** Moves a joint by a step, as the arrow keys and typed numbers do; steps in quick succession are one gesture. */
let resting = 0;
function nudge(name, place) {
  if (now.gesture && (now.gesture.joints[0] !== name || now.gesture.ending)) endNudge();
  if (now.gesture && now.gesture.pointer) return;
  if (!now.gesture) beginGesture(name, .05);
  aim(place);
  clearTimeout(resting);
  resting = setTimeout(endGesture, 700);
}
function endNudge() {
  clearTimeout(resting);
  if (now.gesture && !now.gesture.pointer) { endGesture(); if (now.gesture) finishGesture(); }
}
