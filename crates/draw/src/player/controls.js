
// The body of `player(root, scene)`, of poses: panels, what is under the mouse, trails.

const still = frames < 2;
let panels = [], strips = [];
Object.assign(state, { trail: -1, hover: null });

// ---- panels and legend, made anew when the overlay is switched ----

function makePanel(list) {
  const canvas = still ? emptySvg() : make("canvas");
  const [section, missing] = makeSection(list, canvas);
  canvas.setAttribute("aria-label", (still ? "Figure: " : "Moving figure: ") + list.map(f => figures[f].name).join(", "));
  const panel = { section, canvas, missing, ctx: still ? svgPaper(canvas) : canvasPaper(canvas), figures: list, hits: [] };
  handle(canvas, {
    hover: event => hover(nearest(panel, event, 14), panel, event),
    leave: () => hover(null),
    tap: event => {
      const hit = nearest(panel, event, event.pointerType === "touch" ? 24 : 14);
      if (hit) { setTrail(hit.point === state.trail ? -1 : hit.point); hover(hit, panel, event); }
    },
  });
  return panel;
}

function makePanels() {
  panels = panelLists().map(makePanel);
  part("panels").replaceChildren(...panels.map(panel => panel.section));
  hover(null);
  makeLegend();
  ask();
}

function makeLegend() {
  const items = [], some = status => figures.some(figure => figure.has[status]);
  const item = (kind, color, text) => {
    const node = make("li"), sign = make("span", "swatch " + kind);
    sign.style.color = `var(--${color})`;
    sign.style.background = kind === "cross" ? "" : `var(--${color})`;
    node.append(sign, text);
    items.push(node);
  };
  const sided = /[lr]/.test(scene.sides);
  if (sided && !state.overlay) { item("", "left", "left"); item("", "right", "right"); }
  if (sided && state.overlay) items.push(make("li", "", "right limbs fainter"));
  if (some(1)) item("", "changed", "changed");
  if (some(2)) item("ring", "inferred", "inferred");
  if (some(3)) item("cross", "rejected", "rejected");
  if (some(4)) item("ring", "unknown", "unknown");
  if (scene.behind !== null && !state.overlay) item("", "behind", figures[scene.behind].name + ", behind each answer");
  if (some(MISSING) && alone) item("block", "missing", "missing (in the strip)");
  part("legend").replaceChildren(...items);
}

function makeStrips() {
  strips = [];
  figures.forEach((figure, f) => {
    if (!figure.has.slice(1).some(Boolean)) return;
    const row = make("div", "strip"), canvas = make("canvas"), lane = make("div", "lane");
    lane.append(canvas);
    row.append(make("span", "", figure.name), lane);
    seek(canvas, share => share * (frames - 1));
    part("strips").append(row);
    strips.push([canvas, f]);
  });
}

/** Lets a click or drag in a canvas go to the frame that is this share of its width away. */
function seek(canvas, frame) {
  const jump = event => {
    const box = canvas.getBoundingClientRect();
    show(frame((event.clientX - box.left) / box.width));
  };
  canvas.addEventListener("pointerdown", event => { canvas.setPointerCapture(event.pointerId); jump(event); });
  canvas.addEventListener("pointermove", event => { if (event.buttons) jump(event); });
}

// ---- what is drawn and told of a frame ----

function draw() { for (const panel of panels) drawPanel(panel, state.frame, state.trail, state.hover); }

function tell() {
  const [take, time] = moment(state.frame), number = state.frame * scene.every;
  tellSlider(`frame ${number}, ${time.toFixed(2)} seconds${take ? ", " + take : ""}`);
  part("strips").style.setProperty("--at", state.frame / Math.max(1, frames - 1));
  const several = scene.runs.length > 1 && take;
  part("clock").replaceChildren(
    time.toFixed(3) + " s ", make("small", "", ownFrames(state.frame) || `frame ${number}${several ? " · " + take : ""}`));
  part("clock").title = several ? take : "";
  for (const panel of panels) {
    const { counts, count, note } = figures[panel.figures[0]], gone = counts[state.frame * 6 + MISSING];
    panel.missing.textContent = gone ? `${gone} of ${count} missing` : note;
  }
  tellPair();
  tellCurves();
  keepHover();
}

/** A point with a trail is also the one whose curves are shown. */
function setTrail(point) {
  state.trail = point;
  part("trail").value = point;
  if (point >= 0) chooseJoint(point);
  ask();
}

// ---- what is under the mouse ----

function nearest(panel, mouse, within) {
  const box = panel.canvas.getBoundingClientRect(), x = mouse.clientX - box.left, y = mouse.clientY - box.top;
  let best = null, least = within;
  for (const hit of panel.hits) {
    const far = Math.hypot(hit.x - x, hit.y - y);
    if (far < least) { least = far; best = hit; }
  }
  return best;
}

function hover(hit, panel, event) {
  const changed = (state.hover && state.hover.point) !== (hit && hit.point);
  state.hover = hit && { figure: hit.figure, point: hit.point, panel, clientX: event.clientX, clientY: event.clientY };
  if (hit) tip(); else part("tip").hidden = true;
  if (changed) ask();
}

/** After the figure or the camera has moved: what is under the mouse now. */
function keepHover() {
  if (state.hover) hover(nearest(state.hover.panel, state.hover, 18), state.hover.panel, state.hover);
}

function tip() {
  const { figure, point, clientX: x, clientY: y } = state.hover, box = part("tip"), i = state.frame * points + point;
  const status = figures[figure].status[i], place = figures[figure].xyz.subarray(3 * i, 3 * i + 3);
  const where = status === MISSING ? "" : "x y z  " + [...place].map(v => v.toFixed(1)).join("  ") + " cm";
  const said = figures[figure].has.some((has, s) => has && s > 0) ? account(figure, i) : "";
  const name = scene.points[point] + (state.overlay ? " · " + figures[figure].name : "");
  const lines = [make("b", "", name)];
  for (const text of [said, where]) if (text) lines.push(make("div", "", text));
  box.replaceChildren(...lines);
  box.hidden = false;
  const { width, height } = box.getBoundingClientRect();
  box.style.left = Math.max(4, Math.min(x + 14, innerWidth - width - 6)) + "px";
  box.style.top = (y + 16 + height > innerHeight ? y - height - 10 : y + 16) + "px";
}

function readOwnLink(link) {
  if (link.has("beside") && scene.pair && state.overlay) actions.overlay();
  if (scene.points.includes(link.get("trail"))) setTrail(scene.points.indexOf(link.get("trail")));
}

function start() {
  if (!frames || !figures.length) { part("empty").hidden = false; return; }
  root.classList.toggle("still", still);
  scene.points.forEach((name, p) => {
    const option = make("option", "", name);
    option.value = p;
    part("trail").append(option);
  });
  part("trail").addEventListener("change", event => setTrail(+event.target.value));
  makeStrips();
  makePair();
  makeCurves();
  startPlayback(() => { readInk(); strips.forEach(([canvas, f]) => drawStrip(canvas, f)); drawApart(); staleCurves(); ask(); });
}
start();
