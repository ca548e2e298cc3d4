
// The two views: the large one, and a small one from 90 degrees to the right of it.

const scene = { azimuth: 25, ground: 0, step: 50, size: 170 };
const path = { x: [0], z: [0], middle: [0, 0], radius: 85, reach: 85, height: 170 };
const QUARTER = Math.PI / 2;

function makeView(canvas) {
  return { canvas, ctx: canvasPaper(canvas), look: lookAt(scene, path), hits: [], width: 1, height: 1, project: null };
}
const big = makeView($("big")), small = makeView($("small"));
const viewOf = canvas => canvas === big.canvas ? big : small;
const ink = big.look.ink;

function readInk() {
  big.look.readColors(["page", "pale", "line", "soft", "middle", "left", "right", "behind", "changed", "inferred", "rejected", "missing"]);
  ask();
}
/** The small view's grid is drawn in the colors of the large one. */
function shareInk() { Object.assign(small.look.ink, ink); }

/** Sizes of the body, for the cameras; all that is drawn is measured against them. */
function beginBody() {
  const poses = [now.state.pose, ...now.state.starts.map(start => start.pose)];
  scene.size = Math.max(20, ...poses.map(pose => { const { low, top } = extent(pose); return top - low; }));
  resetView();
}

/** The whole body in the middle of both views. */
function resetView() {
  big.look.resetCamera();
  frameBody();
}
function frameBody() {
  const pose = shown(), { top, x, z } = extent(pose);
  path.x = [x]; path.z = [z]; path.middle = [x, z];
  path.height = 1.04 * Math.max(top, .75 * scene.size);
  path.radius = path.reach = Math.max(.46 * scene.size, ...Object.values(pose).map(p => 1.05 * Math.hypot(p[0] - x, p[2] - z)));
  big.look.camera.zoom = 1;
  big.look.camera.shift = [0, 0];
  ask();
}

function orbit(azimuth, elevation) {
  const { camera } = big.look;
  camera.azimuth += azimuth;
  camera.elevation = clamp(camera.elevation + elevation, -.3, 1.57);
  ask();
}
function zoom(by) { big.look.camera.zoom = clamp(big.look.camera.zoom * by, .2, 12); ask(); }
function pan(dx, dy) { big.look.camera.shift[0] += dx; big.look.camera.shift[1] += dy; ask(); }

/** The side of the body that the small view shows. */
function sideShown() {
  const plane = mirrorPlane(shown());
  if (!plane) return "from the right";
  const [lx, , lz] = plane.normal, { toward } = axesOf({ ...small.look.camera, elevation: 0 });
  const left = toward[0] * lx + toward[2] * lz, front = toward[2] * lx - toward[0] * lz;
  if (Math.abs(left) > Math.abs(front)) return left > 0 ? "left side" : "right side";
  return front > 0 ? "front" : "back";
}
function nameSmall() {
  const side = sideShown(), name = $("small-name"), text = pictureShown() || small.width < 180 ? side : side + ": drag here, too";
  if (name.textContent === text) return;
  name.textContent = text;
  small.canvas.setAttribute("aria-label", `The ${/side/.test(side) ? side : side + " side"} of the body. Joints can be dragged here, too.`);
}

/** Clears a view and sets its projection. */
function beginView(view) {
  const { camera } = big.look;
  if (view === small) {
    shareInk();
    Object.assign(small.look.camera, { azimuth: camera.azimuth + QUARTER, elevation: camera.elevation, zoom: 1, shift: [0, 0] });
  }
  [view.width, view.height] = view.ctx.begin();
  view.project = view.look.projection(view.width, view.height, 0);
  view.hits = [];
}

/** The joint under the pointer; of several, the nearer one to the eye if it is about as close. */
function jointAt(view, x, y, within) {
  let best = null, least = within;
  for (const hit of view.hits) {
    const away = Math.hypot(hit.x - x, hit.y - y);
    if (away >= within) continue;
    const value = away - clamp(hit.depth * .03, -2, 2);
    if (value < least) { least = value; best = hit; }
  }
  return best;
}

/** Turns the large view to where the small one looks from. */
function turn() {
  const goal = big.look.camera.azimuth + QUARTER;
  if (matchMedia("(prefers-reduced-motion: reduce)").matches) { orbit(QUARTER, 0); return; }
  const begun = performance.now(), from = big.look.camera.azimuth;
  const step = time => {
    const done = clamp((time - begun) / 250, 0, 1), eased = done * done * (3 - 2 * done);
    big.look.camera.azimuth = from + (goal - from) * eased;
    ask();
    if (done < 1) requestAnimationFrame(step);
  };
  requestAnimationFrame(step);
}
