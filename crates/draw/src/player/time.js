
// The body of a player, shared by all: frames and their times, the way of the figure. Reads `scene`.

const frames = scene.frames;

/** The index in scene.runs of the run that a frame belongs to; -1 without runs. */
function runOf(frame) {
  let run = scene.runs.length - 1;
  while (run > 0 && scene.runs[run][1] > frame) run--;
  return run;
}
function moment(frame) {
  const run = runOf(frame);
  if (run < 0) return ["", frame / scene.rate];
  const [name, first, time, rate] = scene.runs[run];
  return [name, time + (frame - first) / rate];
}
/** Frames a second, where that frame is. */
function rateAt(frame) {
  const run = runOf(frame);
  return run < 0 ? scene.rate : scene.runs[run][3];
}

function quantile(values, share) {
  const sorted = Float64Array.from(values).sort();
  return sorted.length ? sorted[Math.round((sorted.length - 1) * share)] : 0;
}

/** Holds a path over gaps and averages it twice over half a second, within each run. */
function smooth(path) {
  let last = path.find(v => !Number.isNaN(v)) || 0;
  for (let t = 0; t < frames; t++) { if (Number.isNaN(path[t])) path[t] = last; last = path[t]; }
  const starts = scene.runs.length ? scene.runs.map(run => run[1]) : [0];
  starts.forEach((start, i) => {
    const end = i + 1 < starts.length ? starts[i + 1] : frames, half = Math.round(rateAt(start) / 4);
    for (let pass = 0; pass < 2; pass++) {
      const sums = new Float64Array(end - start + 1);
      for (let t = start; t < end; t++) sums[t - start + 1] = sums[t - start] + path[t];
      for (let t = start; t < end; t++) {
        const a = Math.max(start, t - half), b = Math.min(end, t + half + 1);
        path[t] = (sums[b - start] - sums[a - start]) / (b - a);
      }
    }
  });
}

/** The way of the figure through all frames, smoothed: `spread` says where it is in each. */
function journey(spread) {
  const x = new Float64Array(frames), z = new Float64Array(frames), seen = [];
  const tops = [], radii = [];
  for (let t = 0; t < frames; t++) {
    const at = spread(t);
    if (!at) { x[t] = z[t] = NaN; continue; }
    x[t] = at.x; z[t] = at.z;
    seen.push(t); tops.push(at.top - scene.ground); radii.push(at.radius);
  }
  const box = axis => seen.reduce(([a, b], t) => [Math.min(a, axis[t]), Math.max(b, axis[t])], [Infinity, -Infinity]);
  const [x0, x1] = seen.length ? box(x) : [0, 0], [z0, z1] = seen.length ? box(z) : [0, 0];
  const height = Math.max(quantile(tops, .98), .3 * scene.size);
  const radius = Math.max(quantile(radii, .98), .2 * scene.size);
  smooth(x); smooth(z);
  return {
    x, z, height, radius,
    middle: [(x0 + x1) / 2, (z0 + z1) / 2], reach: Math.hypot(x1 - x0, z1 - z0) / 2 + radius,
  };
}
