
// The body of `player(root, scene)`, of poses: how points were filled, how sure that is, and where the gaps are.

const METHODS = ["", "regression", "pchip", "model", "contact", "motion"];
const INFERRED = 2;
/** Steps of a standard deviation in a centimeter. */
const SD_STEPS = 1000;

/** The methods and the standard deviations (cm; 0: none is stated) of every point in every frame; null where none are known. */
function fills(source) {
  return { method: source.method && unrolled(source.method), sd: source.sd && deviations(source.sd) };
}

function deviations({ runs, data }) {
  const sd = new Float32Array(frames * points), read = reader(data);
  let at = 0;
  runs.forEach((lengths, p) => {
    let frame = 0;
    lengths.forEach((length, i) => {
      if (i % 2) for (let t = frame; t < frame + length; t++, at += 2) sd[t * points + p] = read.getUint16(at, true) / SD_STEPS;
      frame += length;
    });
  });
  return sd;
}

/** What is known of a point in a frame, such as "inferred, pchip, sd 0.41 cm". */
function account(figure, i) {
  const { status, method, sd } = figures[figure];
  const words = [STATUS[status[i]], method && METHODS[method[i]], sd && sd[i] && `sd ${sd[i].toFixed(2)} cm`];
  return words.filter(Boolean).join(", ");
}

// ---- gaps ----

/** The gaps of a figure: frames on end, within a run, in which a point was not measured. */
function findGaps(figure) {
  const { status } = figures[figure], starts = new Set(scene.runs.map(run => run[1])), gaps = [];
  for (let p = 0; p < points; p++) {
    let first = -1;
    for (let t = 0; t <= frames; t++) {
      const kind = t < frames ? status[t * points + p] : 0, open = kind === MISSING || kind === INFERRED;
      if (first >= 0 && (!open || starts.has(t))) { gaps.push(gapOf(figure, p, first, t)); first = -1; }
      if (open && first < 0) first = t;
    }
  }
  return gaps;
}

/** How most of a gap was filled, and the root mean square of its deviations: as `complete --report` has it. */
function gapOf(figure, point, first, end) {
  const { status, method, sd } = figures[figure], counts = METHODS.map(() => 0);
  let filled = 0, squares = 0, stated = 0;
  for (let i = first * points + point; i < end * points; i += points) {
    if (status[i] === INFERRED) filled++;
    if (method && method[i]) counts[method[i]]++;
    if (sd && sd[i]) { squares += sd[i] ** 2; stated++; }
  }
  const most = Math.max(...counts), how = most ? METHODS[counts.indexOf(most)] : filled ? "inferred" : "not filled";
  return {
    point, first, how, frames: end - first, seconds: (end - first) / rateAt(first),
    sd: stated ? Math.sqrt(squares / stated) : NaN,
  };
}
