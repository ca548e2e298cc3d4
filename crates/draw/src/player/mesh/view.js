
// The body of `player(root, scene, figures)`, of meshes: what is drawn and told of a frame. Returns whether it can be drawn.

let panels = [];
const solid = figures.length ? solidPaper(figures, () => ask()) : null;
state.wires = false;
actions.wires = () => { state.wires = toggle("wires", !state.wires); ask(); };

/** The frame of a figure: one that has a single frame stands still. */
const frameOf = (figure, frame) => Math.min(frame, figure.frames - 1);

/** Where the first figure is in a frame: the middle of its box; and the height and the radius of the largest. */
function spread(t) {
  const boxes = figures.map(f => box(f, frameOf(f, t)));
  const most = of => Math.max(...boxes.map(of));
  return { x: boxes[0].x, z: boxes[0].z, top: most(b => b.top), radius: most(b => b.radius) };
}

/** The middle, the height and the radius of a figure's box. */
function box({ places, origins, vertices, step }, frame) {
  const high = [0, 0, 0], size = 3 * vertices, from = frame * size;
  for (let i = 0; i < size; i++) high[i % 3] = Math.max(high[i % 3], places[from + i]);
  const [x, y, z] = origins[frame].map((steps, axis) => [steps * step, (steps + high[axis]) * step]);
  return {
    x: (x[0] + x[1]) / 2, z: (z[0] + z[1]) / 2, top: y[1],
    radius: Math.hypot(x[1] - x[0], z[1] - z[0]) / 2,
  };
}
const path = journey(figures.length ? spread : () => null);

let inks = {};
function readInk() {
  readColors(["wires"]);
  inks = { wires: rgb(ink.wires), shadow: rgb(ink.shadow), figures: ink.figures.map(rgb) };
}

function makePanel(list) {
  const canvas = make("canvas"), [section, note] = makeSection(list, canvas), nothing = () => {};
  canvas.setAttribute("aria-label", (frames < 2 ? "Mesh: " : "Moving mesh: ") + list.map(f => figures[f].name).join(", "));
  handle(canvas, { hover: nothing, tap: nothing, leave: nothing });
  return { section, note, ctx: canvasPaper(canvas), figures: list };
}

function makePanels() {
  panels = panelLists().map(makePanel);
  part("panels").replaceChildren(...panels.map(panel => panel.section));
  ask();
}

function drawPanel(panel) {
  const { ctx } = panel, [width, height] = ctx.begin();
  if (!width || !height) return;
  const frame = state.frame, several = panel.figures.length > 1;
  const shown = panel.figures.filter(f => figures[f].shown), at = lens(width, height, frame);
  const far = 4 * path.reach + 10 * scene.size;
  const paint = draw => {
    solid.begin(width, height, camera, at, far);
    for (const f of shown) draw(f, figures[f], frameOf(figures[f], frame));
    ctx.drawImage(solid.canvas, 0, 0, width, height);
  };
  drawGrid(ctx, projection(width, height, frame), frame);
  ctx.globalAlpha = .18;
  paint((f, figure, t) => solid.draw(figure, t, at, inks.shadow, null, scene.ground));
  ctx.globalAlpha = 1;
  paint((f, figure, t) => solid.draw(figure, t, at, inks.figures[several ? f % 6 : 0], state.wires ? inks.wires : null, null));
  ctx.end();
}

function draw() { for (const panel of panels) drawPanel(panel); }

function tell() {
  const number = state.frame * scene.every, time = moment(state.frame)[1].toFixed(3) + " s";
  const of = scene.timed ? "" : ` of ${scene.of}`;
  tellSlider(scene.timed ? `frame ${number}, ${time}` : `frame ${number}`);
  if (scene.timed) part("clock").replaceChildren(time + " ", make("small", "", `frame ${number}`));
  else part("clock").replaceChildren(`frame ${number}`, make("small", "", of));
  for (const panel of panels) {
    const figure = figures[panel.figures[0]];
    const label = figure.labels[frameOf(figure, state.frame)] || "";
    panel.note.textContent = label === figure.name ? "" : label;
  }
  const step = grid()[0], length = step < 100 ? step + " cm" : step / 100 + " m";
  part("legend").textContent = scene.inCm ? `Squares of the ground: ${length}` : "";
}

function readOwnLink(link) { if (link.has("wires") && !state.wires) actions.wires(); }

if (!figures.length) {
  part("empty").textContent = "There are no meshes to show.";
  part("empty").hidden = false;
  return true;
}
if (!solid) return false;
root.classList.toggle("single", frames < 2);
startPlayback(() => { readInk(); ask(); });
return true;
