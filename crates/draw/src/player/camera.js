
// The body of a player, shared by all: the camera, colors, the ground. Reads `scene`, and `path`, where the figure goes.

// ---- the camera, one for all panels ----

const camera = { azimuth: 0, elevation: 0, zoom: 1, shift: [0, 0], follow: true };
function resetCamera() {
  camera.azimuth = scene.azimuth * Math.PI / 180;
  camera.elevation = 12 * Math.PI / 180;
  camera.zoom = 1;
  camera.shift = [0, 0];
}
resetCamera();

/** What the camera looks at, and how: the place in the middle, pixels a centimeter there, the distance of the eye. */
function lens(width, height, frame) {
  const [x, z] = camera.follow ? [path.x[frame], path.z[frame]] : path.middle;
  const radius = camera.follow ? path.radius : path.reach;
  const tall = path.height * Math.cos(camera.elevation) + 2 * radius * Math.abs(Math.sin(camera.elevation));
  const fit = Math.min(height * .84 / tall, width * .9 / (2 * radius)) * camera.zoom;
  const eye = 5 * Math.max(radius, path.height / 2);
  return { at: [x, scene.ground + path.height / 2, z], fit, eye, near: eye * .12 };
}

/** A function from centimeters to [x, y, depth, pixels a centimeter] in a panel of this size. */
function projection(width, height, frame) {
  const { at, fit, eye, near } = lens(width, height, frame);
  const se = Math.sin(camera.elevation), ce = Math.cos(camera.elevation);
  const sa = Math.sin(camera.azimuth), ca = Math.cos(camera.azimuth);
  return (x, y, z) => {
    x -= at[0]; y -= at[1]; z -= at[2];
    const right = x * ca - z * sa, toward = x * sa + z * ca;
    const depth = toward * ce + y * se, rise = y * ce - toward * se;
    const scale = fit * eye / Math.max(eye - depth, near);
    return [width / 2 + camera.shift[0] + right * scale, height / 2 + camera.shift[1] - rise * scale, depth, scale];
  };
}

// ---- what all draw ----

let ink = {};
/** Reads the page's colors of these names, and those of the figures. */
function readColors(names) {
  const style = getComputedStyle(document.documentElement), get = name => style.getPropertyValue("--" + name).trim();
  for (const name of ["panel", "text", "grid", "shadow", "accent"].concat(names)) ink[name] = get(name);
  ink.figures = [0, 1, 2, 3, 4, 5].map(i => get("f" + i));
}

/** The side of a square of the ground, and how far the ground reaches. */
function grid() {
  let step = scene.step || 50;
  const reach = Math.max(camera.follow ? 2.2 * scene.size : 1.3 * path.reach, 2 * step);
  while (reach / step > 24) step *= 2;
  return [step, reach];
}

function drawGrid(ctx, project, frame) {
  const at = camera.follow ? [path.x[frame], path.z[frame]] : path.middle, [step, reach] = grid();
  const [x0, z0] = at.map(v => Math.round(v / step) * step), lines = Math.ceil(reach / step);
  ctx.strokeStyle = ink.grid;
  ctx.lineWidth = 1;
  // Pieces of like faintness go into one stroke.
  const shades = [[], [], [], [], []];
  const piece = (a, b) => {
    const far = Math.hypot((a[0] + b[0]) / 2 - at[0], (a[1] + b[1]) / 2 - at[1]) / reach;
    if (far < 1) shades[Math.floor(5 * far)].push([a, b]);
  };
  for (let i = -lines; i <= lines; i++) for (let j = -lines; j < lines; j++) {
    const u = i * step, v = j * step;
    piece([x0 + u, z0 + v], [x0 + u, z0 + v + step]);
    piece([x0 + v, z0 + u], [x0 + v + step, z0 + u]);
  }
  shades.forEach((pieces, i) => {
    ctx.globalAlpha = .75 * (1 - ((i + .5) / 5) ** 2);
    ctx.beginPath();
    for (const [a, b] of pieces) {
      const p = project(a[0], scene.ground, a[1]), q = project(b[0], scene.ground, b[1]);
      ctx.moveTo(p[0], p[1]); ctx.lineTo(q[0], q[1]);
    }
    ctx.stroke();
  });
  ctx.globalAlpha = 1;
}
