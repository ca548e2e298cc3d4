
// Names of joints in words, and the sides they are on.

/** What is where CMU's bones end: a joint has the name of the bone that ends in it. */
const PLACES = byName(Object.entries({
  root: "pelvis", hipjoint: "hip", femur: "knee", tibia: "ankle", foot: "foot",
  lowerback: "lower back", upperback: "upper back", thorax: "chest", lowerneck: "lower neck", upperneck: "upper neck",
  head: "head", clavicle: "shoulder", humerus: "elbow", radius: "wrist", wrist: "hand",
  hand: "knuckles", fingers: "fingers", thumb: "thumb", toes: "toes",
}));

/** A joint's name in words: lradius is the left wrist; other skeletons' names are parted where words begin. */
function inWords(name) {
  if (now.state && now.state.joints.includes("lhumerus")) {
    if (PLACES[name]) return PLACES[name];
    const place = PLACES[name.slice(1)];
    if (place && /^[lr]/.test(name)) return (name[0] === "l" ? "left " : "right ") + place;
  }
  const words = name.replace(/([a-z0-9])([A-Z])/g, "$1 $2").replace(/[_.:-]+/g, " ").trim().toLowerCase();
  return words.replace(/^l (.*)$/, "left $1").replace(/^r (.*)$/, "right $1")
    .replace(/^(.*) l$/, "left $1").replace(/^(.*) r$/, "right $1") || name;
}
/** A sentence with the names of joints in words. */
const inSentence = text => text.replace(/[\w:.-]+/g, word => now.state.joints.includes(word) ? "the " + inWords(word) : word);
/** The name of a step for a button: "drag: left hand". */
function inShort(text) {
  const dragged = text.match(/^the drag of (.*)$/);
  if (dragged) return "drag: " + dragged[1].split(" and ").map(inWords).map((words, i, { length }) => length > 2 && i === 1 ? `${length - 1} more` : words)
    .filter((_, i, { length }) => length < 3 || i < 2).join(", ");
  const short = { "the way to another key": "open key", "the move of a key": "move key", "the removal of a key": "remove key" }[text];
  return short || inSentence(text.replace(/^the /, "")).replace(/\bthe /g, "");
}
const capital = text => text.charAt(0).toUpperCase() + text.slice(1);

/** "l", "r" or "m": only what has a mirror image has a side. */
function sideOf(name) {
  const other = now.state.mirrors[name];
  if (!other || other === name) return "m";
  const words = inWords(name);
  if (words.startsWith("left")) return "l";
  if (words.startsWith("right")) return "r";
  return /^l/i.test(name) ? "l" : /^r/i.test(name) ? "r" : "m";
}

/** The joint and all that hang on it. */
function withBelow(name) {
  const { joints, parents } = now.state;
  return joints.filter(joint => { for (let j = joint; j; j = parents[j]) if (j === name) return true; return false; });
}
/** Ankles, feet and toes. */
const feet = () => now.state.joints.filter(name => isTip(name) || /ankle|^[lr]tibia$/i.test(name));
const isTip = name => /foot|toe/i.test(name);
/** The other joints of the foot that a joint is of. */
function footOf(name) {
  const all = feet(), { parents } = now.state, top = joint => { while (all.includes(parents[joint])) joint = parents[joint]; return joint; };
  return all.includes(name) ? all.filter(joint => joint !== name && top(joint) === top(name)) : [];
}
/** "left hand", "left hand and right hand", "left hand, head and 3 more". */
function namesOf(joints, words = inWords) {
  const most = joints.length === 2 ? 2 : Math.min(2, joints.length), list = joints.slice(0, most).map(words), more = joints.length - most;
  if (more) return `${list.join(", ")} and ${more} more`;
  return list.join(" and ");
}
