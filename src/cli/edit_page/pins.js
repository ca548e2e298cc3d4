
// Pins: joints, or some of their coordinates, that stay exactly where they are.

/** Pins that the program has not answered yet: its earlier answers do not undo them. */
let pinning = 0, pinChanges = 0;
async function setPins(pins) {
  now.pins = pins;
  pinning++;
  pinChanges++;
  tell();
  const done = request("/act", { do: "pin", pins });
  try {
    const state = await done;
    pinning--;
    takeState(state);
    keepSession();
  } catch (error) {
    pinning--;
    if (error.status) { say(error.message); refresh(); } else tell();
  }
}

/** Pins a joint where it is; if it is pinned, removes the pin. */
function togglePin(name) {
  if (!name || !ready()) return;
  const pins = copyPins(now.pins), pinned = !!pins[name];
  if (pinned) delete pins[name];
  else pins[name] = [...now.pose[name]];
  setPins(pins);
  speak(`${inWords(name)} ${pinned ? "free" : "pinned"}`);
}

/** Pins one coordinate alone, or lets it go. */
function toggleAxis(name, axis) {
  if (!name || !ready()) return;
  const pins = copyPins(now.pins), pin = pins[name] || [null, null, null];
  pin[axis] = pin[axis] === null ? now.pose[name][axis] : null;
  if (pin.every(v => v === null)) delete pins[name];
  else pins[name] = pin;
  setPins(pins);
  speak(`${inWords(name)}: ${"xyz"[axis]} ${pin[axis] === null ? "free" : "pinned"}`);
}

/** Pins the feet where they are; a foot within 2 cm of the floor onto it. */
function pinFeet() {
  if (!ready()) return;
  const names = feet();
  if (!names.length) { say("This skeleton has no joint that is named as a foot."); return; }
  const pins = copyPins(now.pins), all = names.every(name => pins[name]);
  for (const name of names) if (all) delete pins[name]; else pins[name] = onFloor(name, now.pose[name]);
  setPins(pins);
  speak(all ? "feet free" : "feet pinned");
}

/** Whether the present pose can be changed now: the program is there, nothing is being moved. */
function ready() {
  endNudge();
  if (!now.state || link.way !== "fine" || now.gesture) return false;
  if (photo.on) { say("Use the pose of the photograph, or leave it, first."); return false; }
  leaveOthers();
  if (now.preview) adoptPreview();
  return true;
}
