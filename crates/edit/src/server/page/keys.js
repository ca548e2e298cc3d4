
// Key poses and the motion between them.

const motion = { keys: null, stamp: "", cursor: 0, between: null, waiting: null, playing: false, last: 0, loop: true, onion: true };

/** Forgets the in-betweens when keys have changed. */
function noticeKeys() {
  const { keys, rate, key } = now.state;
  if (keys === motion.keys) return;
  // At first the cursor is at the key that is open, or behind the last one.
  if (!motion.keys && keys.length) motion.cursor = key === null ? Math.round((lastTime() + .5) * 100) / 100 : keys[key].time;
  motion.keys = keys;
  const stamp = JSON.stringify([rate, keys.map(({ time, pose, pins }) => [time, pose, pins])]);
  if (stamp === motion.stamp) return;
  motion.stamp = stamp;
  motion.between = null;
  if (keys.length < 2) leavePreview();
}

/** The frames between the keys; fetched when they are first wanted. */
async function needBetween() {
  if (motion.between || now.state.keys.length < 2) return motion.between;
  if (!motion.waiting) motion.waiting = fetchBetween().finally(() => { motion.waiting = null; });
  return motion.waiting;
}
async function fetchBetween() {
  const { stamp } = motion;
  try {
    const answer = await request("/between", {});
    if (stamp === motion.stamp) motion.between = answer;
    return motion.between;
  } catch (error) {
    if (error.status) say(error.message);
    return null;
  }
}

const firstTime = () => now.state.keys.length ? now.state.keys[0].time : 0;
const lastTime = () => now.state.keys.length ? now.state.keys.at(-1).time : 0;
const keyAtTime = time => now.state.keys.findIndex(key => Math.abs(key.time - time) < 5e-4);

function frameAt(time) {
  const { frames, first, rate } = motion.between;
  const values = frames[clamp(Math.round((time - first) * rate), 0, frames.length - 1)];
  return byName(now.state.joints.map((name, j) => [name, values.slice(3 * j, 3 * j + 3)]));
}

/** Moves to a time; between the keys the motion is shown, elsewhere the present pose. */
async function goTo(time) {
  motion.cursor = Math.round(Math.max(0, time) * 1000) / 1000;
  const { keys, key } = now.state, within = keys.length > 1 && motion.cursor >= firstTime() && motion.cursor <= lastTime();
  const own = key !== null && keys[key] && Math.abs(keys[key].time - motion.cursor) < 5e-4;
  if (!within || own) { if (!motion.playing) now.preview = null; tell(); return; }
  const asked = motion.cursor;
  tell();
  if (await needBetween() && motion.cursor === asked) showFrame();
}
function showFrame() {
  now.preview = frameAt(motion.cursor);
  tell();
}
function leavePreview() {
  motion.playing = false;
  if (!now.preview) return;
  now.preview = null;
  const { keys, key } = now.state;
  if (key !== null && keys[key]) motion.cursor = keys[key].time;
  tell();
}

/** The in-between that is shown becomes the present pose, with the pins that hold in it. */
function adoptPreview() {
  const pose = now.preview, drags = byName(), pins = byName();
  motion.playing = false;
  now.preview = null;
  now.pose = pose;
  for (const [name, pin] of Object.entries(now.pins))
    if (pin.every((v, c) => v === null || Math.abs(v - pose[name][c]) < .05)) pins[name] = pin;
  for (const name of now.state.joints) if (!pins[name]) drags[name] = { xyz: pose[name], sd: .05 };
  now.pins = pins;
  request("/solve", { pins: copyPins(pins), drags, rest: now.rest }).then(answer => {
    if (!now.gesture) takePose(answer);
  }, error => { if (error.status) say(error.message); });
  order.settling = settle();
}

// ---- setting, opening, moving, removing ----

function setKey() { inOrder(setKeyHere); }
async function setKeyHere() {
  if (photo.on || now.gesture) return;
  leaveOthers();
  const time = motion.cursor;
  if (now.preview) adoptPreview();
  if (!await act({ do: "key", time })) return;
  const { keys, key } = now.state;
  if (key !== null && keys[key]) motion.cursor = keys[key].time;
  speak(`key set at ${+motion.cursor.toFixed(2)} seconds`);
  // The next key comes later: the cursor goes on, so that K does not replace this one.
  if (motion.cursor >= lastTime() - 5e-4) goTo(motion.cursor + .5); else tell();
}
/** Does something to a key, which is found again by its time: keys before it may have gone meanwhile. */
function withKey(key, change) {
  if (key === null || !now.state.keys[key]) return;
  const { time } = now.state.keys[key];
  inOrder(() => { const at = keyAtTime(time); if (at >= 0 && ready()) return change(at, time); });
}
const openKey = key => withKey(key, async (key, time) => {
  now.preview = null;
  motion.playing = false;
  if (await act({ do: "key-open", key })) { motion.cursor = time; tell(); followBody(1); }
});
const moveKey = (key, time) => withKey(key, async key => {
  const step = 1 / now.state.rate, others = now.state.keys.filter((_, i) => i !== key).map(other => other.time);
  while (others.some(other => Math.abs(other - time) < step / 2)) time += step;
  time = Math.round(time * 1000) / 1000;
  if (Math.abs(time - now.state.keys[key].time) < 5e-4) { tell(); return; }
  if (await act({ do: "key-move", key, time })) goTo(time);
});
const removeKey = key => {
  // The cards move up: none of them takes the place of the removed one under the next Delete.
  if (document.activeElement.closest(".card, #remove-key")) $("ruler").focus();
  withKey(key, (key, time) => {
    speak(`key at ${+time.toFixed(2)} seconds removed`);
    return act({ do: "key-remove", key });
  });
};
/** The key that Remove is about: the one at the cursor, else the open one. */
function keyInHand() {
  const at = keyAtTime(motion.cursor);
  return at >= 0 ? at : now.state.key;
}

// ---- playing ----

function play(on) { if (on) inOrder(beginPlay); else { motion.playing = false; tell(); } }
async function beginPlay() {
  if (now.state.keys.length < 2 || photo.on || now.gesture) return;
  leaveOthers();
  if (!await needBetween()) return;
  motion.playing = true;
  motion.last = 0;
  if (motion.cursor >= lastTime() - 1e-6 || motion.cursor < firstTime()) motion.cursor = firstTime();
  tell();
}

drawings.push(time => {
  if (!motion.playing) return;
  if (!motion.between) { motion.playing = false; play(true); return; }
  const passed = motion.last ? Math.min(time - motion.last, 250) / 1000 : 0, first = firstTime(), last = lastTime();
  motion.last = time;
  let at = motion.cursor + passed;
  if (at > last) {
    if (motion.loop) at = first + (at - first) % Math.max(last - first, 1e-3);
    else { at = last; motion.playing = false; }
  }
  motion.cursor = at;
  now.preview = frameAt(at);
  followBody(.12);
  tell();
});

/** The camera goes with the body where that leaves its place. */
function followBody(share) {
  const { x, z } = extent(shown());
  if (share === 1 && Math.hypot(x - path.x[0], z - path.z[0]) < .35 * path.radius) return;
  path.x[0] += share * (x - path.x[0]); path.z[0] += share * (z - path.z[0]);
  path.middle = [path.x[0], path.z[0]];
  ask();
}

/** The keys before and after, as ghosts. */
function neighborGhosts() {
  const { keys } = now.state;
  if (!motion.onion || others.at >= 0 || !keys.length || motion.playing || photo.on) return [];
  const before = keys.filter(key => key.time < motion.cursor - 5e-4).at(-1), after = keys.find(key => key.time > motion.cursor + 5e-4);
  return [[before, "missing"], [after, "changed"]].filter(([key]) => key)
    .map(([key, color]) => ({ pose: key.pose, color, alpha: .4 }));
}

whenChanged(noticeKeys);
