
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
const togglePin = name => name && whenReady(() => {
  const pinned = !!now.pins[name], joints = withOther(name);
  speak(`${namesOf(joints)} ${pinned ? "free" : "pinned"}`);
  return act(pinned ? { do: "unpin", joints } : { do: "pin-here", joints, axes: "xyz" });
});
const whenReady = change => inOrder(() => { if (ready()) return change(); });
/** The joint, and its mirror image if both sides go together. */
function withOther(name) {
  const other = now.state.mirrors[name];
  return now.both && other && other !== name && now.pose[other] ? [name, other] : [name];
}

/** Pins one coordinate alone, or lets it go. */
const toggleAxis = (name, axis) => name && whenReady(() => {
  const pins = copyPins(now.pins), free = pins[name] && pins[name][axis] !== null, joints = withOther(name);
  for (const joint of joints) {
    const pin = pins[joint] || [null, null, null];
    pin[axis] = free ? null : now.pose[joint][axis];
    if (pin.every(v => v === null)) delete pins[joint];
    else pins[joint] = pin;
  }
  speak(`${namesOf(joints)}: ${"xyz"[axis]} ${free ? "free" : "pinned"}`);
  return setPins(pins);
});

/** Pins ankles, feet and toes where they are; if all are pinned, lets them go. */
const pinFeet = () => whenReady(() => {
  const joints = feet(), all = joints.every(name => now.pins[name]);
  if (!joints.length) { say("This skeleton has no joint that is named as a foot."); return; }
  speak(all ? "feet free" : "feet pinned");
  return act(all ? { do: "unpin", joints } : { do: "pin-here", joints, axes: "xyz" });
});

/** Whether the present pose can be changed now: the program is there, nothing is being moved. */
function ready() {
  endNudge();
  if (!now.state || link.way !== "fine" || now.gesture) return false;
  if (photo.on) { say("Use the pose of the photograph, or leave it, first."); return false; }
  leaveOthers();
  if (now.preview) adoptPreview();
  return true;
}
