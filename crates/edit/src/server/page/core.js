
// What all parts of the page share: elements, and drawing when asked.

const $ = id => document.getElementById(id);
function make(tag, className, text) {
  const node = document.createElement(tag);
  if (className) node.className = className;
  if (text !== undefined) node.textContent = text;
  return node;
}

/** What is known by the names of joints: any name may be one, `constructor` and `__proto__` among them. */
function byName(entries = []) {
  const all = Object.create(null);
  for (const [name, value] of entries) all[name] = value;
  return all;
}
/** JSON whose objects are by name. */
const parsed = text => JSON.parse(text, (_, value) => value && typeof value === "object" && !Array.isArray(value) ? byName(Object.entries(value)) : value);

let asked = false, frames = 0;
/** What is drawn in each frame that was asked for. */
const drawings = [];
function ask() { if (!asked) { asked = true; requestAnimationFrame(drawAll); } }
function drawAll(time) {
  asked = false;
  frames++;
  for (const draw of drawings) draw(time);
}

const clamp = (value, low, high) => Math.max(low, Math.min(high, value));
/** Centimeters as text: one digit while they are few. */
const cm = value => (Math.abs(value) < 9.95 ? value.toFixed(1) : value.toFixed(0)) + " cm";
/** A coordinate as text, without a minus before nothing. */
const fixed = value => (Math.round(10 * value) / 10 || 0).toFixed(1);
const count = (n, one, many = one + "s") => `${n} ${n === 1 ? one : many}`;
