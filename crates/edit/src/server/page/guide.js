
// What the page says: one line of guidance, warnings, notices, the banner when the program is away, and speech.

/** The next thing to do, in one line. */
function guidance() {
  const name = now.selected && capital(inWords(now.selected));
  const touch = matchMedia("(pointer: coarse)").matches;
  if (!now.state) return "";
  if (link.way !== "fine") return "The view can be turned. The body can be moved and saved when the program runs again.";
  if (photo.on) {
    const asked = askedFor();
    if (asked && !marked() && sideOf(asked) === "l") return `Click ${ofPerson(asked)} in the picture: on your right if the person faces you.`;
    return asked ? `Click ${ofPerson(asked)} in the picture.` + (photo.picture ? " Joints of the body can be dragged to their places, too." : "") : "Drag the marks until the body fits, then use the pose.";
  }
  if (now.gesture && now.gesture.pointer) return touch ? "For depth, drag the joint in the small view." : "For depth, hold shift or turn the wheel. Ctrl: fine. Esc: back.";
  if (now.gesture) return `${name} moves.` + (inField() ? "" : " P pins it.");
  if (others.asked) return "Looking for other poses…";
  if (others.at >= 0) return "Dashed: another pose with the same pins." + (touch ? "" : " Enter takes it, N shows the next, Esc keeps yours.");
  if (motion.playing) return "The motion between the keys.";
  if (now.preview) return `The motion at ${motion.cursor.toFixed(2)} s. Drag a joint to change it here.` + (touch ? "" : " K makes it a key, Esc goes back.");
  if (now.hover) return `${capital(inWords(now.hover))}: drag to move it, click to ${now.pins[now.hover] ? "remove its pin" : "pin it"}.`;
  if (now.state.keys.length === 1) return "One key is set. Change the pose, then set the next key with K.";
  const press = touch ? "Hold" : "Click";
  if (now.state.undo && !Object.keys(now.pins).length) return `${press} a joint to pin it: it stays while you drag others.`;
  return `Drag a joint: the body follows. ${press} a joint to pin it.`;
}
/** Whether keys go into a field of numbers. */
const inField = () => document.activeElement.type === "number";
/** "the person's left hip" of a photograph: its left is not the picture's. */
const ofPerson = name => /^(left|right) /.test(inWords(name)) ? `the person's ${inWords(name)}` : `the ${inWords(name)}`;
function guide() { $("guide").textContent = guidance(); }

function warn() {
  const lines = [], away = Object.keys(now.missed).filter(name => missedBy(name) >= .5).sort((a, b) => missedBy(b) - missedBy(a));
  if (away.length === 1) lines.push(`The ${inWords(away[0])} cannot reach its place (${cm(missedBy(away[0]))} away).`);
  if (away.length > 1) lines.push(`The ${namesOf(away, name => `${inWords(name)} (${cm(missedBy(name))})`)} cannot reach their places.`);
  // Before there are enough marks, the pose is not the photograph's.
  if (now.unlike > 0 && !(photo.on && !photo.picture)) lines.push("The model has seen no pose like this.");
  $("warning").textContent = lines.join(" ");
  $("warning").hidden = !lines.length || !!now.preview;
  ask();
}

/** The warning goes where the body is not: below on the left, or above. */
drawings.push(() => {
  const box = $("warning");
  if (box.hidden || photo.on) return;
  const hidden = () => {
    const { left, top, right, bottom } = box.getBoundingClientRect(), stage = big.canvas.getBoundingClientRect();
    const spots = [...big.hits, ...Object.values(now.gesture ? now.gesture.targets : {}).map(goal => { const [x, y] = big.project(...goal); return { x, y }; })];
    return spots.filter(({ x, y }) => x > left - stage.left - 30 && x < right - stage.left + 30 && y > top - stage.top - 30 && y < bottom - stage.top + 30).length;
  };
  const here = hidden();
  if (!here) return;
  box.classList.toggle("high");
  if (hidden() >= here) box.classList.toggle("high");
});

let fading = 0;
/** A notice that goes away by itself. */
function say(text) {
  $("notice").textContent = text;
  $("notice").hidden = false;
  clearTimeout(fading);
  fading = setTimeout(() => { $("notice").hidden = true; }, 6000);
}

function tellLink() {
  const banner = $("banner");
  banner.textContent = {
    gone: `The program has stopped. Start it again with --port ${location.port} and open its new address in this tab: the pose is kept here. A page cannot follow to another port.`,
    refused: "This page's address is of an earlier run of the program. Open the address that it printed last in this tab: the pose is kept here.",
    unaddressed: "This address is not complete. Open the whole address that the program printed, with what stands behind the #.",
  }[link.way] || "";
  banner.hidden = !banner.textContent;
  document.body.classList.toggle("away", !banner.hidden);
  if (link.way === "gone") {
    if (now.gesture) { const { from, finished } = now.gesture; now.gesture = null; finished(); now.pose = from; doing = null; }
    motion.playing = motion.playing && !!motion.between;
    tell();
  }
}

// ---- for those who listen ----

function speak(text) { $("spoken").textContent = text; }

/** Where a joint is, in words. */
function speakJoint(name) {
  if (!name) return;
  const at = now.pose[name], words = [inWords(name), `height ${at[1].toFixed(0)} centimeters`];
  if (isPinned(name)) words.push("pinned");
  else if (now.pins[name]) words.push("partly pinned");
  speak(words.join(", "));
}

/** How far a gesture took its joint, seen from the front of the body: "left hand 12 cm up, pinned". */
function speakMove(gesture) {
  const [name] = gesture.joints, to = now.pose[name], from = gesture.from[name], { right, toward } = axesOf({ ...big.look.camera, elevation: 0 });
  const by = to.map((v, c) => v - from[c]), words = [];
  for (const [value, more, less] of [[by[1], "up", "down"], [dot(by, right), "to the right", "to the left"], [dot(by, toward), "nearer", "farther"]])
    if (Math.abs(value) >= .5) words.push(`${Math.abs(value).toFixed(0)} cm ${value > 0 ? more : less}`);
  const text = [`${inWords(name)} ${words.join(" and ") || "where it was"}`];
  if (isPinned(name)) text.push("pinned");
  if (now.missed[name] >= .5) text.push(`${cm(now.missed[name])} short of its place`);
  speak(text.join(", "));
}

whenChanged(() => { guide(); warn(); });
for (const way of ["focusin", "focusout"]) addEventListener(way, () => { if (now.state) setTimeout(guide); });
