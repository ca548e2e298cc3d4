
// A pose from a photograph: marks on the picture say where joints are seen, the program fits a pose to them.

const photo = {
  image: null, on: false, fitted: false,
  /** Fits that are asked for and not answered. */
  waiting: 0,
  /** A limb that was flipped just now. */
  flipped: null,
  marks: byName(), flips: new Set(), focal: null, picture: null, next: null, chosen: null, past: [],
};
const pictureShown = () => photo.on;
/** Fewer marks than that leave the pose open; as many as that make it sure enough. */
const FEWEST = 4, ENOUGH = 8;

// ---- which joint is asked for ----

const FIRST = [..."hipjoint clavicle femur humerus tibia radius".split(" ").flatMap(place => ["l" + place, "r" + place]), "head"];
/** Other skeletons' names of the same, by preference. */
const FIRST_WORDS = [["hip", "up leg", "upper leg", "thigh"], ["upper arm", "arm", "shoulder"], ["knee", "leg", "lower leg", "calf", "shin"],
  ["elbow", "fore arm", "forearm", "lower arm"], ["ankle", "foot"], ["wrist", "hand"], ["head"]];
function firstJoints() {
  const { joints } = now.state;
  if (FIRST.every(name => joints.includes(name))) return FIRST;
  return FIRST_WORDS.flatMap(words => words.map(place => joints.filter(name => inWords(name).replace(/^(left|right) /, "") === place))
    .find(found => found.length) || []);
}
/** The joint that the next click in the picture marks: the chosen one, the first of the list, the least certain. */
function askedFor() {
  if (photo.chosen) return photo.chosen;
  const open = name => name && !photo.marks[name];
  return firstJoints().find(open) || (open(photo.next) ? photo.next : null);
}
function choose(name) {
  photo.chosen = photo.marks[name] ? null : name;
  select(name);
  tell();
}

// ---- marks ----

const marked = () => Object.keys(photo.marks).length;
function remember() { photo.past.push({ marks: byName(Object.entries(photo.marks)), flips: new Set(photo.flips) }); }
function mark(name, place) {
  photo.marks[name] = place.map(v => Math.round(v * 10) / 10);
  if (photo.chosen === name) photo.chosen = null;
  now.selected = name;
  fit();
}
function removeMark(name) {
  if (!photo.marks[name]) return;
  remember();
  delete photo.marks[name];
  fit();
}
function flip(name) {
  if (!name) return;
  remember();
  // A limb is named by the joint where it begins: the nearest one above that has a side, or the joint itself.
  let limb = name;
  while (now.state.parents[limb] && sideOf(now.state.parents[limb]) === sideOf(name) && sideOf(name) !== "m") limb = now.state.parents[limb];
  if (!photo.flips.delete(limb)) photo.flips.add(limb);
  photo.flipped = limb;
  fit();
}
/** Says which limb bends the other way now, and whether that is toward the camera (which looks along -z). */
function tellFlip(limb, before) {
  const below = withBelow(limb).filter(name => before[name] && name !== limb);
  const nearer = below.reduce((sum, name) => sum + (now.pose[name][2] - now.pose[limb][2]) - (before[name][2] - before[limb][2]), 0);
  const side = { l: "left ", r: "right " }[sideOf(limb)] || "", words = inWords(limb).replace(/^(left|right) /, "");
  const what = /hip|leg|thigh|knee|ankle|foot/.test(words) ? "leg" : /shoulder|clavicle|collar|arm|elbow|wrist|hand/.test(words) ? "arm" : null;
  const text = `The ${what ? `person's ${side}${what}` : inWords(limb)} now bends ${nearer > 0 ? "toward" : "away from"} the camera.`;
  say(text);
  speak(text);
}
function undoMark() {
  const before = photo.past.pop();
  if (!before) return;
  Object.assign(photo, before);
  fit();
}

// ---- the fit ----

async function fit() {
  if (marked() < FEWEST) photo.picture = null;
  if (marked() < FEWEST || link.way !== "fine") { tell(); return; }
  const { naturalWidth, naturalHeight } = photo.image;
  const body = { marks: photo.marks, size: [naturalWidth, naturalHeight], focal: photo.focal, flips: [...photo.flips] };
  photo.fitted = true;
  photo.waiting++;
  tell();
  try {
    const answer = await request("/photograph", body, { newest: true });
    if (answer && photo.on && marked() >= FEWEST) {
      const before = now.pose, limb = photo.flipped;
      takePose(answer);
      photo.flipped = null;
      if (limb) tellFlip(limb, before);
      photo.picture = answer.picture;
      photo.next = answer.next;
    }
  } catch (error) {
    if (error.status) say(error.message);
  }
  photo.waiting--;
  tell();
}

/** How far the fitted joints are from their marks, in pixels of the picture, at the root of the mean square. */
function misfit() {
  const names = Object.keys(photo.marks).filter(name => photo.picture && photo.picture[name]);
  if (!names.length) return null;
  const squares = names.map(name => photo.marks[name].reduce((sum, v, c) => sum + (v - photo.picture[name][c]) ** 2, 0));
  return Math.sqrt(squares.reduce((a, b) => a + b) / names.length);
}

/** The same in words, measured against how much of the picture the marks take. */
function misfitInWords(off) {
  const places = Object.values(photo.marks), wide = c => Math.max(...places.map(p => p[c])) - Math.min(...places.map(p => p[c]));
  const share = off / Math.max(1, Math.hypot(wide(0), wide(1)));
  return `${share < .015 ? "good" : share < .04 ? "rough" : "poor"} (${off.toFixed(off < 9.95 ? 1 : 0)} px off)`;
}

// ---- opening and closing ----

function openPicture(file) {
  if (!file || !file.type.startsWith("image/")) { say("Only a picture can be dropped here."); return; }
  const image = new Image(), address = URL.createObjectURL(file);
  image.onload = () => {
    URL.revokeObjectURL(address);
    if (!now.state) return;
    endNudge();
    leaveOthers();
    leavePreview();
    if (photo.fitted) order.settling = act({ do: "cancel" });
    Object.assign(photo, { image, on: true, fitted: false, marks: byName(), flips: new Set(), picture: null, next: null, chosen: null, flipped: null, past: [] });
    now.selected = null;
    beginPicture();
    $("photo-part").scrollIntoView({ block: "nearest" });
    tell();
  };
  image.onerror = () => { URL.revokeObjectURL(address); say("This file is no picture that the browser can show."); };
  image.src = address;
}
/** The picture again, with its marks: to add some, and to fit again. */
const reopenPicture = () => whenReady(() => {
  leavePreview();
  photo.on = true;
  fit();
});
const closePicture = action => inOrder(async () => {
  if (!photo.on) return;
  photo.on = false;
  dropWaiting();
  if (photo.fitted) {
    photo.fitted = false;
    if (await act({ do: action })) frameBody();
  }
  tell();
});

function showPhoto() {
  const { on } = photo, n = marked(), asked = on && askedFor();
  document.body.classList.toggle("in-picture", on);
  $("drop").hidden = on;
  $("photo-tools").hidden = !on;
  $("photo-back").hidden = !photo.image;
  for (const id of ["pin-feet", "others", "mirror"]) if (on) $(id).disabled = true;
  if (!on) return;
  $("undo").disabled = !photo.past.length;
  $("redo").disabled = true;
  $("undo").lastChild.textContent = "";
  for (const way of ["aria-label", "title"]) $("undo").setAttribute(way, "Undo: the last mark");
  const off = misfit(), words = [];
  if (n < FEWEST) words.push(`${count(n, "mark")}, at least ${FEWEST} are needed.`);
  else if (n < ENOUGH) words.push(`${count(n, "mark")}; ${ENOUGH} or more make the pose sure.`);
  else words.push(`${count(n, "mark")}.`);
  if (photo.waiting) words.push("Fitting…");
  else if (off !== null) words.push(`The fit is ${misfitInWords(off)}.`);
  $("photo-state").textContent = words.join(" ");
  $("photo-use").disabled = !photo.picture;
  $("photo-again").disabled = n < FEWEST;
  $("photo-remove").disabled = !photo.marks[now.selected];
  $("photo-flip").disabled = !now.selected || !photo.picture;
  const first = firstJoints(), names = [...first, ...now.state.joints.filter(name => !first.includes(name))], box = $("marks");
  names.forEach((name, i) => {
    const button = box.children[i] || box.appendChild(make("button", "mark"));
    button.dataset.joint = name;
    button.title = name;
    button.textContent = inWords(name);
    button.classList.toggle("done", !!photo.marks[name]);
    button.setAttribute("aria-pressed", name === asked);
    button.classList.toggle("on", name === now.selected);
    button.setAttribute("aria-label", inWords(name) + (photo.marks[name] ? ", marked" : ""));
  });
  while (box.children.length > names.length) box.lastChild.remove();
  $("opacity").style.setProperty("--done", ($("opacity").value - .1) / .9 * 100 + "%");
  $("opacity-words").textContent = Math.round($("opacity").value * 100) + "%";
  $("focal").style.setProperty("--done", ($("focal").value - 23) / 77 * 100 + "%");
  $("focal-words").textContent = photo.focal ? photo.focal + " mm" : "unknown";
  $("focal").setAttribute("aria-valuetext", photo.focal ? photo.focal + " millimeters" : "unknown: weak perspective");
}

$("marks").addEventListener("click", event => {
  const name = event.target.dataset.joint;
  if (name) choose(name);
});
$("photo-choose").addEventListener("click", () => $("photo-file").click());
$("photo-other").addEventListener("click", () => $("photo-file").click());
$("photo-file").addEventListener("change", event => { openPicture(event.target.files[0]); event.target.value = ""; });
$("photo-use").addEventListener("click", () => closePicture("release"));
$("photo-back").addEventListener("click", reopenPicture);
$("photo-leave").addEventListener("click", () => closePicture("cancel"));
$("photo-remove").addEventListener("click", () => removeMark(now.selected));
$("photo-flip").addEventListener("click", () => flip(now.selected));
$("photo-again").addEventListener("click", fit);
$("opacity").addEventListener("input", tell);
$("focal").addEventListener("input", event => {
  photo.focal = +event.target.value < 24 ? null : +event.target.value;
  fit();
});
addEventListener("dragover", event => { event.preventDefault(); document.body.classList.add("dropping"); });
addEventListener("dragleave", event => { if (!event.relatedTarget) document.body.classList.remove("dropping"); });
addEventListener("drop", event => {
  event.preventDefault();
  document.body.classList.remove("dropping");
  const file = event.dataTransfer.files[0];
  if (!file) return;
  if (file.type.startsWith("image/")) openPicture(file); else openSession(file);
});
addEventListener("paste", event => {
  const file = event.clipboardData && event.clipboardData.files[0];
  if (file) openPicture(file);
});

whenChanged(showPhoto);
