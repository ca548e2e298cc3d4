
// The panel: the selected joint's numbers and pins, what moves along, switches, the table of all joints, undo.

const AXES = ["x", "y", "z"];

// ---- the selected joint ----

function fillJoints() {
  const list = $("joint"), none = make("option", "", "none selected");
  none.value = "";
  list.replaceChildren(none, ...now.state.joints.map(name => {
    const words = inWords(name), option = make("option", "", words === name ? name : `${words} (${name})`);
    option.value = name;
    return option;
  }));
}

function showJoint() {
  const name = now.selected, at = name && shown()[name], pin = name && now.pins[name];
  if ($("joint").options.length !== now.state.joints.length + 1) fillJoints();
  $("joint").value = name || "";
  AXES.forEach((axis, c) => {
    const field = $("at-" + axis), square = $("pin-" + axis);
    field.disabled = square.disabled = !at;
    if (document.activeElement !== field || !field.dirty) field.value = at ? fixed(at[c]) : "";
    square.setAttribute("aria-pressed", !!pin && pin[c] !== null);
  });
  $("pin").disabled = $("reset-limb").disabled = !at;
  $("pin").setAttribute("aria-pressed", !!pin);
  $("pin").lastChild.textContent = pin ? "Pinned" : "Pin";
  const facts = [];
  if (at && missedBy(name) >= .05) facts.push(`${cm(missedBy(name))} from its place: out of reach`);
  else if (pin) facts.push(isPinned(name) ? "exactly in its place" : `pinned along ${AXES.filter((_, c) => pin[c] !== null).join(" and ")}`);
  else if (at && now.sd[name] >= .05) facts.push(`± ${cm(now.sd[name])}`);
  $("facts").textContent = facts.join(", ");
  $("facts").title = at && !pin ? "Standard deviation of a coordinate, by the model" : "";
  $("facts").classList.toggle("bad", !!(at && missedBy(name) >= .05));
}

/** A typed number moves the joint there. */
const typed = axis => soon(() => typedNow(axis));
function typedNow(axis) {
  const field = $("at-" + AXES[axis]), value = parseFloat(field.value), name = now.selected;
  field.dirty = false;
  if (!name || !Number.isFinite(value) || !now.state || link.way !== "fine") { tell(); return; }
  if (now.preview) adoptPreview();
  const place = [...now.pose[name]];
  if (Math.abs(place[axis] - value) < .05) return;
  place[axis] = value;
  const pin = now.pins[name];
  // A whole pin is moved as by a drag.
  if (pin && !isPinned(name) && pin[axis] !== null) pin[axis] = value;
  nudge(name, place);
}

AXES.forEach((axis, c) => {
  const field = $("at-" + axis);
  field.addEventListener("input", event => {
    field.dirty = true;
    // Steps of the arrows move at once; what is being typed waits for Enter.
    if (!(event instanceof InputEvent)) typed(c);
  });
  field.addEventListener("change", () => typed(c));
  field.addEventListener("blur", () => { field.dirty = false; endNudge(); tell(); });
  $("pin-" + axis).addEventListener("click", () => toggleAxis(now.selected, c));
});
$("joint").addEventListener("change", event => select(event.target.value || null));
$("pin").addEventListener("click", () => togglePin(now.selected));
$("reset-limb").addEventListener("click", () => { const name = now.selected; whenReady(() => act({ do: "reset", joints: withBelow(name) })); });
$("pin-feet").addEventListener("click", pinFeet);
$("complete").addEventListener("click", () => whenReady(() => act({ do: "reset", joints: now.state.joints.filter(name => !now.pins[name]) })));
$("unpin").addEventListener("click", () => whenReady(() => act({ do: "unpin", joints: Object.keys(now.pins) })));

// ---- how far the rest follows ----

function restInWords(within) {
  if (within < 1.5) return "others stay where they are";
  if (within < 40) return `others within some ${within.toFixed(0)} cm`;
  return within < 150 ? "others follow" : "others follow the model";
}
function showRest() {
  const words = restInWords(now.rest);
  $("rest").value = Math.log10(now.rest);
  $("rest").style.setProperty("--done", Math.log10(clamp(now.rest, 1, 1000)) / 3 * 100 + "%");
  $("rest-words").textContent = words;
  $("rest").setAttribute("aria-valuetext", words);
  $("rest").title = `Standard deviation of the other joints about where they were: ${cm(now.rest)}`;
}
$("rest").addEventListener("input", event => {
  now.rest = Math.round(10 ** event.target.value * 10) / 10;
  showRest();
});
$("rest").addEventListener("change", () => { const cm = now.rest; doInOrder({ do: "rest", cm }); });

// ---- how exactly a dragged joint follows ----

function showTolerance() {
  const at = Math.log10(now.tolerance), { min, max } = $("tolerance");
  $("tolerance").value = at;
  $("tolerance").style.setProperty("--done", clamp((at - min) / (max - min), 0, 1) * 100 + "%");
  $("tolerance").setAttribute("aria-valuetext", $("tolerance-words").textContent = cm(now.tolerance));
}
$("tolerance").addEventListener("input", event => {
  now.tolerance = Math.round(10 ** event.target.value * 10) / 10;
  showTolerance();
  ask();
});
for (const way of ["focus", "blur"]) $("tolerance").addEventListener(way, ask);

// ---- switches and whole-pose actions ----

function showSwitches() {
  const { state } = now;
  $("floor").checked = state.floor;
  $("limits").checked = state.limits;
  $("limits-row").hidden = !state.can_limit;
  $("both").checked = now.both;
  $("rings").checked = now.rings;
  const name = (state.name || "").split(/[/\\]/).pop();
  $("what").textContent = name;
  $("what").title = state.name;
  document.title = name ? `${name}, posing` : "Posing";
  for (const way of ["undo", "redo"]) {
    $(way).disabled = !state[way];
    const words = state[way] ? `${capital(way)}: ${inSentence(state[way])}` : `Nothing to ${way}`;
    $(way).title = `${words} (${way === "undo" ? "ctrl-Z" : "shift-ctrl-Z"})`;
    $(way).setAttribute("aria-label", words);
    $(way).lastChild.textContent = inShort(state[way] || "");
  }
  const pins = Object.keys(now.pins).length, all = feet();
  $("unpin").disabled = !pins;
  $("complete").disabled = pins < 3;
  $("unpin").textContent = pins > 1 ? `Unpin all (${pins})` : "Unpin all";
  $("pin-feet").disabled = !all.length;
  $("others").disabled = $("mirror").disabled = false;
  $("pin-feet").setAttribute("aria-pressed", all.length > 0 && all.every(name => now.pins[name]));
}
/** Undo and redo leave in-betweens and offers first: they are about the pose itself. */
function back(way) {
  if (photo.on) { if (way === "undo") undoMark(); return; }
  inOrder(() => {
    if (now.gesture || !now.state[way]) return;
    leaveOthers();
    leavePreview();
    speak(`${way}: ${inSentence(now.state[way])}`);
    return act({ do: way });
  });
}
function setBoth(on) {
  now.both = on;
  speak(on ? "both sides move together" : "each side moves alone");
  tell();
}
function setRings(on) { now.rings = on; tell(); }

$("undo").addEventListener("click", () => back("undo"));
$("redo").addEventListener("click", () => back("redo"));
$("mirror").addEventListener("click", doWhenReady({ do: "mirror", side: "both" }));
$("copy-left").addEventListener("click", doWhenReady({ do: "mirror", side: "left" }));
$("copy-right").addEventListener("click", doWhenReady({ do: "mirror", side: "right" }));
$("both").addEventListener("change", event => setBoth(event.target.checked));
$("rings").addEventListener("change", event => setRings(event.target.checked));
$("floor").addEventListener("change", event => doInOrder({ do: "floor", on: event.target.checked }));
$("limits").addEventListener("change", event => doInOrder({ do: "limits", on: event.target.checked }));
$("view-reset").addEventListener("click", resetView);
$("turn").addEventListener("click", turn);

// ---- all joints ----

function showTable() {
  if (!$("table-part").open) return;
  const pose = shown(), body = $("table");
  while (body.rows.length > now.state.joints.length) body.deleteRow(-1);
  now.state.joints.forEach((name, i) => {
    const row = body.rows[i] || newRow(body), at = pose[name], pin = now.pins[name], sd = now.sd[name];
    row.dataset.joint = name;
    row.classList.toggle("on", name === now.selected);
    const button = row.cells[0].firstChild;
    button.textContent = inWords(name);
    button.title = name;
    AXES.forEach((_, c) => {
      row.cells[c + 1].textContent = at ? fixed(at[c]) : "";
      row.cells[c + 1].classList.toggle("pinned", !!pin && pin[c] !== null);
    });
    row.cells[4].textContent = isPinned(name) ? "pin" : sd === undefined ? "" : sd.toFixed(1);
  });
}
function newRow(body) {
  const row = body.insertRow();
  row.insertCell().append(make("button", "plain"));
  for (let c = 0; c < 4; c++) row.insertCell().className = "number";
  row.addEventListener("click", () => select(row.dataset.joint));
  return row;
}
$("table-part").addEventListener("toggle", () => tell());

whenChanged(() => { showJoint(); showRest(); showTolerance(); showSwitches(); showTable(); });
