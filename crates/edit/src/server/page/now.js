
// What the page knows: the program's last state, and what is selected, moved and shown.

const now = {
  state: null, revision: -1,
  pose: byName(), sd: byName(), missed: byName(), unlike: 0, pins: byName(), rest: 10,
  /** The standard deviation of a dragged joint about the pointer, cm. */
  tolerance: .5,
  selected: null, hover: null,
  /** What is being moved (gesture.js). */
  gesture: null,
  /** Another pose that is shown instead of the present one: an in-between. */
  preview: null,
  rings: true, both: false,
};

const listeners = [];
/** Calls a function whenever the state or the pose has changed. */
function whenChanged(f) { listeners.push(f); }
function tell() {
  if (now.state) for (const f of listeners) f();
  ask();
}

const copyPins = pins => byName(Object.entries(pins).map(([name, at]) => [name, [...at]]));

function takePose(answer) {
  now.pose = answer.pose;
  now.sd = answer.sd || byName();
  // What is still on its way may yet arrive.
  now.missed = (!answer.moving && answer.missed) || byName();
  now.unlike = answer.unlike || 0;
  now.revision = answer.revision;
}

function takeState(state) {
  const before = now.state;
  // Start poses come with the first state only.
  now.state = { ...state, starts: state.starts || before.starts };
  // What is moved now is newer than this state.
  if (now.gesture) now.revision = state.revision;
  else { takePose(state); if (!pinning) now.pins = copyPins(state.pins); now.rest = state.rest; }
  if (!before || before.joints.join() !== state.joints.join()) beginBody();
  tell();
}

/** The pose that is drawn. */
const shown = () => now.preview || now.pose;

function select(name) {
  if (now.selected === name) return;
  now.selected = name;
  tell();
}
