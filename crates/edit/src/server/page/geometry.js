
// Vectors, the camera's axes, the body's own mirror plane.

const plus = (a, b, by = 1) => [a[0] + by * b[0], a[1] + by * b[1], a[2] + by * b[2]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const far = (a, b) => Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);

/** The directions of a camera: to the right, up, and toward the eye. */
function axesOf({ azimuth, elevation }) {
  const sa = Math.sin(azimuth), ca = Math.cos(azimuth), se = Math.sin(elevation), ce = Math.cos(elevation);
  return { right: [ca, 0, -sa], up: [-se * sa, ce, -se * ca], toward: [sa * ce, se, ca * ce] };
}

/** The directions in which a joint is moved: upright, or along the floor when it is seen from above. */
const axesOfMove = ({ azimuth, elevation }) => axesOf({ azimuth, elevation: elevation < Math.PI / 4 ? 0 : Math.PI / 2 });

/** Where a pixel of a view is in space, at a depth as the view's projection tells it. */
function unproject({ look, width, height }, x, y, depth) {
  const { at, fit, eye, near } = look.lens(width, height, 0), { shift } = look.camera;
  const scale = fit * eye / Math.max(eye - depth, near), { right, up, toward } = axesOf(look.camera);
  const across = (x - width / 2 - shift[0]) / scale, rise = (height / 2 + shift[1] - y) / scale;
  return plus(plus(plus(at, right, across), up, rise), toward, depth);
}

/** The body's mirror plane: through the root, square to the line of the hips. */
function mirrorPlane(pose) {
  const { joints, parents, mirrors } = now.state;
  const depth = name => { let n = 0; for (let j = parents[name]; j; j = parents[j]) n++; return n; };
  const pairs = joints.filter(name => sideOf(name) === "l" && pose[mirrors[name]]).sort((a, b) => depth(a) - depth(b));
  const hips = pairs.find(name => /hip|upleg|thigh|femur/i.test(name)) || pairs[0];
  if (!hips) return null;
  const line = plus(pose[hips], pose[mirrors[hips]], -1), long = Math.hypot(...line);
  if (long < 1e-6) return null;
  const root = joints.find(name => !parents[name]);
  return { at: pose[root], normal: line.map(v => v / long) };
}
const mirrorImage = (place, { at, normal }) => plus(place, normal, -2 * dot(plus(place, at, -1), normal));

/** Lowest, highest and middle of a pose. */
function extent(pose) {
  const places = Object.values(pose), axis = c => places.map(p => p[c]);
  const middle = c => (Math.min(...axis(c)) + Math.max(...axis(c))) / 2;
  return { low: Math.min(...axis(1)), top: Math.max(...axis(1)), x: middle(0), z: middle(2) };
}
