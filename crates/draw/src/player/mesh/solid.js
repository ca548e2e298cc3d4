
// Surfaces drawn with WebGL 2, on a canvas of their own that panels copy from.

const VERTEX = `#version 300 es
uniform vec3 base;        // from what the camera looks at to the origin of the frame
uniform float step;
uniform vec4 turn;        // sine and cosine of azimuth and elevation
uniform vec4 lens;        // pixels a unit, distance of the eye, nearest and farthest distance seen
uniform vec4 paper;       // half the width and height, shift; pixels
uniform vec2 ground;      // height of the ground; 1: flattened onto it
uniform float closer;     // share by which depths are lessened: edges lie before their surfaces
in vec3 place;
in vec3 normal;
centroid out vec3 facing;
out vec3 here;
vec3 turned(vec3 p) {
  float right = p.x * turn.y - p.z * turn.x, toward = p.x * turn.x + p.z * turn.y;
  return vec3(right, p.y * turn.w - toward * turn.z, toward * turn.w + p.y * turn.z);
}
void main() {
  vec3 p = base + place * step;
  p.y = mix(p.y, ground.x, ground.y);
  p = turned(p);
  here = p;
  facing = turned(normal);
  float away = lens.y - p.z, near = lens.z, far = lens.w;
  vec2 at = p.xy * lens.x * lens.y + paper.zw * away;
  float deep = away * (1. - closer);
  float z = (deep * (far + near) - 2. * far * near) / (far - near);
  gl_Position = vec4(at / paper.xy, z * away / deep, away);
}`;

const FRAGMENT = `#version 300 es
precision highp float;
uniform vec4 color;
uniform float lit;
uniform float faceted;    // 1: triangles have normals of their own
centroid in vec3 facing;
in vec3 here;
out vec4 seen;
const vec3 KEY = normalize(vec3(-.45, .62, .75)), FILL = normalize(vec3(.8, .05, .45));
void main() {
  vec3 own = cross(dFdx(here), dFdy(here));
  vec3 n = normalize((faceted < .5 ? facing : gl_FrontFacing ? own : -own) + vec3(0., 0., 1e-9));
  // The inside, seen through a hole; on the outline triangles turn away whose surface does not yet.
  bool inside = !gl_FrontFacing && n.z < -.3;
  if (inside) n = -n;
  float light = .36 + .12 * n.y + .62 * max(dot(n, KEY), 0.) + .16 * max(dot(n, FILL), 0.);
  // Surfaces that turn away from the eye are darker, so that the outline is seen on a light panel too.
  light *= .8 + .2 * smoothstep(0., .45, n.z);
  light += .10 * pow(max(dot(n, normalize(KEY + vec3(0., 0., 1.))), 0.), 24.);
  if (inside) light *= .6;
  seen = vec4(color.rgb * mix(1., light * 1.28, lit), 1.) * color.a;
}`;

/** Red, green and blue from 0 to 1 of a color such as #1f6fb4. */
function rgb(hex) {
  const long = hex.length < 6 ? hex.replace(/[^#]/g, "$&$&") : hex;
  return [1, 3, 5].map(i => parseInt(long.slice(i, i + 2), 16) / 255);
}

/** The normals of the vertices of a frame: sums over their triangles, not of unit length. */
function normalsOf(places, faces, normals) {
  normals.fill(0);
  for (let i = 0; i < faces.length; i += 3) {
    const a = 3 * faces[i], b = 3 * faces[i + 1], c = 3 * faces[i + 2];
    const ux = places[b] - places[a], uy = places[b + 1] - places[a + 1], uz = places[b + 2] - places[a + 2];
    const vx = places[c] - places[a], vy = places[c + 1] - places[a + 1], vz = places[c + 2] - places[a + 2];
    const x = uy * vz - uz * vy, y = uz * vx - ux * vz, z = ux * vy - uy * vx;
    for (const at of [a, b, c]) { normals[at] += x; normals[at + 1] += y; normals[at + 2] += z; }
  }
}

/** Whether the triangles are so coarse, as a box's, that their own normals are far from those of their vertices. */
function isFaceted(places, faces, normals) {
  let sum = 0;
  for (let i = 0; i < faces.length; i += 3) {
    const own = new Float32Array(9), corner = [0, 1, 2].map(k => places.subarray(3 * faces[i + k], 3 * faces[i + k] + 3));
    normalsOf([...corner[0], ...corner[1], ...corner[2]], [0, 1, 2], own);
    for (let k = 0; k < 3; k++) {
      const [x, y, z] = normals.subarray(3 * faces[i + k]), [u, v, w] = own;
      sum += (x * u + y * v + z * w) / (Math.hypot(x, y, z) * Math.hypot(u, v, w) || 1);
    }
  }
  return sum / faces.length < .85;
}

/** The edges of triangles, each once, as pairs of vertices. */
function edgesOf(faces, count) {
  const seen = new Set(), edges = [];
  for (let i = 0; i < faces.length; i++) {
    const a = faces[i], b = faces[i % 3 === 2 ? i - 2 : i + 1], key = Math.min(a, b) * count + Math.max(a, b);
    if (!seen.has(key)) { seen.add(key); edges.push(a, b); }
  }
  return Uint32Array.from(edges);
}

/** What draws surfaces; null where WebGL 2 is missing. `lost` is called when all has to be drawn again. */
function solidPaper(figures, lost) {
  const canvas = document.createElement("canvas");
  const gl = canvas.getContext("webgl2", { alpha: true, antialias: true });
  if (!gl) return null;
  let at = {};

  function shader(type, source) {
    const made = gl.createShader(type);
    gl.shaderSource(made, source);
    gl.compileShader(made);
    return made;
  }

  function setUp() {
    const program = gl.createProgram();
    gl.attachShader(program, shader(gl.VERTEX_SHADER, VERTEX));
    gl.attachShader(program, shader(gl.FRAGMENT_SHADER, FRAGMENT));
    gl.bindAttribLocation(program, 0, "place");
    gl.bindAttribLocation(program, 1, "normal");
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) return false;
    gl.useProgram(program);
    for (const name of ["base", "step", "turn", "lens", "paper", "ground", "closer", "color", "lit", "faceted"]) at[name] = gl.getUniformLocation(program, name);
    gl.enable(gl.DEPTH_TEST);
    figures.forEach(load);
    return true;
  }

  function load(figure) {
    figure.loaded = -1;
    figure.edges = 0;
    figure.array = gl.createVertexArray();
    gl.bindVertexArray(figure.array);
    figure.buffers = [0, 1].map(index => {
      const buffer = gl.createBuffer();
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.enableVertexAttribArray(index);
      gl.vertexAttribPointer(index, 3, index ? gl.FLOAT : gl.UNSIGNED_SHORT, false, 0, 0);
      return buffer;
    });
    figure.corners = gl.createBuffer();
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, figure.corners);
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, figure.faces, gl.STATIC_DRAW);
    figure.normals = new Float32Array(3 * figure.vertices);
  }

  /** Puts a frame where the shader reads it. */
  function bring(figure, frame) {
    gl.bindVertexArray(figure.array);
    if (figure.loaded === frame) return;
    figure.loaded = frame;
    const size = 3 * figure.vertices, places = figure.places.subarray(frame * size, (frame + 1) * size);
    normalsOf(places, figure.faces, figure.normals);
    if (figure.faceted === undefined) figure.faceted = isFaceted(places, figure.faces, figure.normals);
    [places, figure.normals].forEach((values, index) => {
      gl.bindBuffer(gl.ARRAY_BUFFER, figure.buffers[index]);
      gl.bufferData(gl.ARRAY_BUFFER, values, gl.DYNAMIC_DRAW);
    });
  }

  function wires(figure) {
    if (!figure.edges) {
      const edges = edgesOf(figure.faces, figure.vertices);
      figure.edges = edges.length;
      figure.wires = gl.createBuffer();
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, figure.wires);
      gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, edges, gl.STATIC_DRAW);
    }
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, figure.wires);
    gl.drawElements(gl.LINES, figure.edges, gl.UNSIGNED_INT, 0);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, figure.corners);
  }

  /** Empties the canvas and sets the camera; the arguments are those of the panel and of `lens`. */
  function begin(width, height, camera, lens, far) {
    const dots = window.devicePixelRatio || 1, w = Math.round(width * dots), h = Math.round(height * dots);
    if (canvas.width !== w || canvas.height !== h) { canvas.width = w; canvas.height = h; }
    gl.viewport(0, 0, w, h);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const { azimuth, elevation, shift } = camera;
    gl.uniform4f(at.turn, Math.sin(azimuth), Math.cos(azimuth), Math.sin(elevation), Math.cos(elevation));
    gl.uniform4f(at.lens, lens.fit, lens.eye, lens.near, lens.eye + far);
    gl.uniform4f(at.paper, width / 2, height / 2, shift[0], -shift[1]);
  }

  /** Draws a frame of a figure: its surface in a color, its edges in another (unless it is null), or its shadow. */
  function draw(figure, frame, lens, color, edges, ground) {
    bring(figure, frame);
    const origin = figure.origins[frame];
    // In double precision: far from the origin, single precision has no step left.
    gl.uniform3f(at.base, ...origin.map((steps, axis) => steps * figure.step - lens.at[axis]));
    gl.uniform1f(at.step, figure.step);
    gl.uniform2f(at.ground, ground === null ? 0 : ground - lens.at[1], ground === null ? 0 : 1);
    gl.uniform1f(at.lit, ground === null ? 1 : 0);
    gl.uniform1f(at.faceted, figure.faceted ? 1 : 0);
    gl.uniform4f(at.color, ...color, 1);
    gl.drawElements(gl.TRIANGLES, figure.faces.length, gl.UNSIGNED_INT, 0);
    if (!edges) return;
    gl.uniform1f(at.lit, 0);
    gl.uniform1f(at.closer, .0012);
    gl.uniform4f(at.color, ...edges, .36);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    wires(figure);
    gl.uniform1f(at.closer, 0);
    gl.disable(gl.BLEND);
  }

  if (!setUp()) return null;
  canvas.addEventListener("webglcontextlost", event => event.preventDefault());
  canvas.addEventListener("webglcontextrestored", () => { setUp(); lost(); });
  return { canvas, begin, draw };
}
