// Draws the report's tables and charts from the JSON in the page. Nothing is fetched.

const SPLITS = {
  frames: ["Random frames", "Lai et al.'s split: a test frame has its neighbors in time in the training half. Frames are alike, so these intervals are too narrow."],
  takes: ["Takes held out", "No model was trained on a tested take."],
  subjects: ["Subjects held out", "No model was trained on a tested subject."],
};

const SVG = emptySvg().namespaceURI;
const svg = (tag, attributes = {}, ...children) => fill(document.createElementNS(SVG, tag), attributes, children);

// ---- axes and charts ----

/** A logarithmic axis from pixel `from` to pixel `to`, over at most five decades; null without a positive value. */
function logAxis(values, from, to) {
  const positive = values.filter(v => Number.isFinite(v) && v > 0);
  if (!positive.length) return null;
  const most = Math.max(...positive), least = Math.max(Math.min(...positive), most * 1e-5);
  // At least a factor of 2 is shown.
  const margin = Math.sqrt(Math.max(1, 2 * least / most)) * 1.08;
  const low = least / margin, high = most * margin;
  const at = v => from + Math.min(1, Math.log(Math.max(v, low) / low) / Math.log(high / low)) * (to - from);
  const ticksOf = digits => {
    const ticks = [];
    for (let power = Math.floor(Math.log10(low)); power <= Math.ceil(Math.log10(high)); power++)
      for (const digit of digits) ticks.push(+`${digit}e${power}`);
    return ticks.filter(v => v >= low && v <= high);
  };
  const sets = [[1, 1.2, 1.4, 1.6, 1.8, 2, 2.5, 3, 3.5, 4, 5, 6, 7, 8, 9], [1, 2, 3, 4, 5, 6, 7, 8, 9], [1, 2, 3, 5], [1, 2, 5], [1]];
  return { at, ticks: sets.map(ticksOf).find(ticks => ticks.length <= 6) || [] };
}

/** An axis from 0 to `most`, with round ticks. */
function linearAxis(most, from, to) {
  const power = 10 ** Math.floor(Math.log10(most));
  const step = [.2, .5, 1, 2].map(s => s * power).find(s => most / s <= 5) || 5 * power;
  const ticks = [];
  for (let i = 0; i * step <= most; i++) ticks.push(+(i * step).toPrecision(6));
  return { at: v => from + v / most * (to - from), ticks };
}

/** An SVG of so many units, scaled to the width of its column. */
class Chart {
  constructor(title, label, width, height) {
    this.title = title;
    this.svg = svg("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": `${title}: ${label}` });
  }
  add(tag, attributes, ...children) {
    for (const name in attributes) if (typeof attributes[name] === "number") attributes[name] = +attributes[name].toFixed(1);
    this.svg.append(svg(tag, attributes, ...children));
  }
  line(style, x1, y1, x2, y2) { this.add("line", { class: style, x1, y1, x2, y2 }); }
  text(x, y, text, anchor = "middle") { this.add("text", { x, y, "text-anchor": anchor }, String(text)); }
  dot(style, cx, cy, r, title) { this.add("circle", { class: style, cx, cy, r }, ...(title ? [svg("title", {}, title)] : [])); }
  path(style, points) { this.add("polyline", { class: style, points: points.map(p => p.map(v => v.toFixed(1)).join()).join(" ") }); }
  name(x, y, name) { this.text(x, y + 3.5, name.length > 19 ? name.slice(0, 18) + "…" : name, "end"); }
  /** Vertical grid lines; labels stand above the chart, or below where `below` is given. */
  gridX(axis, top, bottom, below, label = v => v) {
    for (const tick of axis.ticks) {
      this.line("grid", axis.at(tick), top, axis.at(tick), bottom);
      this.text(axis.at(tick), below || 10, label(tick));
    }
  }
  gridY(axis, left, right, label = v => v) {
    for (const tick of axis.ticks) {
      this.line("grid", left, axis.at(tick), right, axis.at(tick));
      this.text(left - 5, axis.at(tick) + 3.5, label(tick), "end");
    }
  }
  figure(...below) { return html("figure", {}, html("figcaption", {}, this.title), this.svg, ...below); }
}

/** A legend: [style, text] pairs. */
const legend = entries => html("p", { class: "legend" },
  ...entries.flatMap(([style, text]) => [html("span", {}, html("i", { class: style }), text), " "]));

// ---- models: colors and names of dictionaries ----

/** What a name such as `ksvd:n=500:k=7+treated` says; null for another model. */
function dictionary(name) {
  const match = /^(sparse|ksvd-omp|ksvd)((?::[nk]=\d+)*)(\+treated)?$/.exec(name);
  if (!match) return null;
  const setting = key => (new RegExp(`:${key}=(\\d+)`).exec(match[2]) || [])[1];
  // The published models take Lai et al.'s 3 atoms a pose; `sparse` chooses by itself.
  const sparsity = setting("k") || (match[1] === "sparse" ? null : 3);
  return { kind: match[1] + (match[3] || ""), atoms: setting("n"), sparsity };
}

/** The six models with the lowest geometric mean error have colors, the same in all charts. */
const colors = (() => {
  const logs = new Map();
  for (const row of results.summary) logs.set(row.model, [...(logs.get(row.model) || []), Math.log(Math.max(row.mse, 1e-12))]);
  const mean = list => list.reduce((a, b) => a + b) / list.length;
  let models = [...logs.keys()];
  if (models.some(m => !m.includes(":"))) models = models.filter(m => !m.includes(":"));
  return models.sort((a, b) => mean(logs.get(a)) - mean(logs.get(b))).slice(0, 6);
})();
const color = model => colors.includes(model) ? "k" + colors.indexOf(model) : "kx";
const colored = rows => colors.map(m => rows.find(r => r.model === m)).filter(Boolean);

// ---- charts of one task ----

function errorChart(task, rows) {
  rows = [...rows].sort((a, b) => a.mse - b.mse);
  const left = 112, top = 20, step = 17, height = top + step * rows.length + 4;
  const axis = logAxis(rows.flatMap(r => [r.mse, r.training_mse, r.interval[1]]), left, 410);
  if (!axis) return null;
  const chart = new Chart(TASKS[task], "errors on test poses and on training poses", 420, height);
  chart.gridX(axis, 14, height);
  rows.forEach((row, i) => {
    const y = top + step * (i + .5), x = axis.at(row.mse), style = color(row.model);
    chart.name(left - 8, y, row.model);
    if (row.training_mse !== null) {
      const learned = axis.at(row.training_mse);
      chart.line("between", learned, y, x, y);
      chart.dot("hollow " + style, learned, y, 3.4);
    }
    chart.line("spread " + style, axis.at(row.interval[0]), y, axis.at(row.interval[1]), y);
    chart.dot(style, x, y, 4, `${row.model}: ${short(row.mse)} (${range(row.interval)})`);
  });
  return chart.figure();
}

function jointChart(task, rows) {
  rows = colored(rows);
  const rms = mse => Math.sqrt(Math.max(mse, 0)) * results.asf_cm, left = 112, step = 15;
  const most = Math.max(.1, ...rows.flatMap(r => r.by_joint.filter(Number.isFinite).map(rms)));
  const axis = linearAxis(most, left, 410), height = 20 + step * results.points.length;
  const chart = new Chart(TASKS[task], "RMS error of a coordinate by joint, cm", 420, height);
  chart.gridX(axis, 14, height);
  results.points.forEach((point, j) => {
    const y = 20 + step * (j + .4);
    chart.name(left - 8, y, point);
    // The best model is drawn last, on top.
    for (const row of [...rows].reverse())
      if (Number.isFinite(row.by_joint[j])) chart.dot(color(row.model), axis.at(rms(row.by_joint[j])), y, 3.2, `${row.model}: ${short(rms(row.by_joint[j]))} cm`);
  });
  return chart.figure(legend(rows.map(r => [color(r.model), r.model])));
}

function calibrationChart(task, rows) {
  rows = colored(rows).filter(r => r.within.length);
  if (!rows.length) return null;
  const x = { at: v => 48 + 300 * v, ticks: [0, .25, .5, .75, 1] }, y = { at: v => 310 - 300 * v, ticks: x.ticks };
  const percent = v => `${Math.round(100 * v)}%`, levels = results.gaussian_within;
  const chart = new Chart(TASKS[task], "calibration", 420, 336);
  chart.gridX(x, 10, 310, 326, percent);
  chart.gridY(y, 48, 348, percent);
  chart.line("ideal", x.at(0), y.at(0), x.at(1), y.at(1));
  for (const row of [...rows].reverse())
    chart.path(color(row.model), [[0, 0], ...levels.map(([, share], i) => [share, row.within[i]])].map(([a, b]) => [x.at(a), y.at(b)]));
  const shares = row => [1, 2].map(sd => percent(row.within[levels.findIndex(l => l[0] === sd)])).join(" / ");
  return chart.figure(legend(rows.map(r => [color(r.model), `${r.model} ${shares(r)}`])),
    html("p", { class: "legend" }, "Within one and two standard deviations; expected: 68% and 95%."));
}

/** Error against a property of dictionaries, a line a group: `place` gives [group, x] or null. */
function sweepChart(task, rows, what, place) {
  const groups = new Map();
  for (const row of rows) {
    const named = dictionary(row.model), [group, at] = named ? place(named) : [];
    if (at) groups.set(group, [...(groups.get(group) || []), { at: +at, row }]);
  }
  const lines = [...groups].sort((a, b) => a[0] < b[0] ? -1 : 1)
    .map(([name, points]) => [name, points.sort((a, b) => a.at - b.at)])
    .filter(([, points]) => points.length > 1);
  const all = lines.flatMap(([, points]) => points), left = 52, right = 408, top = 12, bottom = 240;
  const x = logAxis(all.map(p => p.at), left, right);
  const y = logAxis(all.flatMap(p => [p.row.mse, p.row.interval[1], p.row.training_mse]), bottom, top);
  if (!x || !y) return null;
  const chart = new Chart(TASKS[task], what, 420, 262);
  chart.gridY(y, left, right);
  let last = -Infinity;
  for (const at of unique(all.map(p => p.at)).sort((a, b) => a - b)) {
    chart.line("grid", x.at(at), top, x.at(at), bottom);
    if (x.at(at) - last > 28) { last = x.at(at); chart.text(last, bottom + 15, at); }
  }
  lines.forEach(([, points], i) => {
    const style = "k" + i % 6, along = of => points.filter(p => of(p.row) !== null).map(p => [x.at(p.at), y.at(of(p.row))]);
    chart.path("dashed " + style, along(r => r.training_mse));
    chart.path(style, along(r => r.mse));
    for (const { at, row } of points) {
      chart.line("spread " + style, x.at(at), y.at(row.interval[0]), x.at(at), y.at(row.interval[1]));
      chart.dot(style, x.at(at), y.at(row.mse), 3.4, `${row.model}: ${short(row.mse)} (${range(row.interval)})`);
    }
  });
  return chart.figure(legend(lines.map(([name], i) => ["k" + i % 6, name])));
}

/** How one model was tuned: error of held-back training poses against the inflation, a line per task. */
function tuningChart(model, cells) {
  const curves = cells.map(({ task, tuning }) => {
    const best = new Map();
    for (const { inflation, mse } of tuning.curve || [])
      if (Number.isFinite(mse)) best.set(inflation, Math.min(mse / results.asf_cm ** 2, best.get(inflation) ?? Infinity));
    return { task, chosen: tuning.chosen, best: [...best].sort((a, b) => a[0] - b[0]) };
  }).filter(curve => curve.best.length);
  const points = curves.flatMap(curve => curve.best), left = 44, right = 232, top = 8, bottom = 132;
  const x = logAxis(points.map(p => p[0]), left, right), y = logAxis(points.map(p => p[1]), bottom, top);
  if (!x || !y) return null;
  const chart = new Chart(model, "tuning", 240, 152), chosen = [];
  chart.gridY(y, left, right);
  chart.gridX(x, top, bottom, bottom + 14);
  for (const curve of curves) {
    const style = "k" + Object.keys(TASKS).indexOf(curve.task);
    chart.path(style, curve.best.map(([inflation, mse]) => [x.at(inflation), y.at(mse)]));
    for (const [inflation, mse] of curve.best) {
      const ring = curve.chosen && curve.chosen.inflation === inflation;
      chart.dot((ring ? "hollow " : "") + style, x.at(inflation), y.at(mse), ring ? 5 : 2.2);
    }
    if (!curve.chosen) continue;
    const noise = curve.chosen.noise > 0 ? `, noise ${short(curve.chosen.noise / results.asf_cm ** 2)} asf²` : "";
    chosen.push(`${curve.task} ${curve.chosen.inflation}${noise}`);
  }
  return chart.figure(html("p", { class: "legend" }, chosen.join(" · ")));
}

// ---- the page ----

/** A heading, a sentence and the charts; nothing where there is no chart. */
function chartGroup(heading, sentence, charts) {
  const drawn = charts.filter(Boolean);
  return drawn.length ? [html("h3", {}, heading), html("p", {}, sentence), html("div", { class: "charts" }, ...drawn)] : [];
}

const heading = row => SPLITS[row.split][0] + (row.base_asf ? `, ${row.base_asf.toFixed(3)} asf of noise on clean coordinates` : "");

function lowestErrors() {
  let before = "";
  const rows = results.summary.filter(r => r.best).map(row => {
    const name = heading(row), shown = name === before ? "" : name;
    before = name;
    const [ratio, interval] = row.to_best_other
      ? [`× ${row.to_best_other[0].toFixed(2)}`, row.to_best_other[1].map(v => v.toFixed(2)).join(" to ")] : ["–", "–"];
    return [html("th", {}, shown), named("td", row.task), named("td", row.model), short(row.mse), pale(range(row.interval)), short(row.rms_cm), ratio, pale(interval)];
  });
  const head = ["split", named("th", "task"), named("th", "model"), "MSE, asf²", "95% interval", "RMS, cm", "ratio to the next best", "95% interval"];
  return html("section", { id: "lowest" }, html("h2", {}, "Lowest errors"), table([head], rows),
    html("p", {}, "The ratio is the model's error divided by that of the best other model, on the same bootstrap draws. Below 1 is better; an interval that contains 1 decides nothing."));
}

function errorTable(rows, tasks) {
  const head = [["model", ...tasks.map(t => html("th", { colspan: 3, class: "task" }, TASKS[t]))],
    ["", ...tasks.flatMap(() => ["MSE, asf²", "RMS, cm", "training MSE"])]];
  return table(head, unique(rows.map(r => r.model)).map(model => [html("th", {}, model), ...tasks.flatMap(task => {
    const row = rows.find(r => r.model === model && r.task === task);
    if (!row) return ["–", "–", "–"];
    const error = html("td", row.best ? { class: "best" } : {}, short(row.mse), html("br"), html("small", {}, range(row.interval)));
    return [error, short(row.rms_cm), pale(short(row.training_mse))];
  })]));
}

function splitSection(id, rows) {
  const { split, base_asf } = rows[0], tasks = Object.keys(TASKS).filter(t => rows.some(r => r.task === t));
  const each = draw => tasks.map(task => draw(task, rows.filter(r => r.task === task)));
  const most = key => Math.max(...rows.map(r => key(r)));
  const bySize = n => [`${n.kind}${n.sparsity ? `, ${n.sparsity} a pose` : ""}`, n.atoms];
  const bySparsity = n => [`${n.kind}${n.atoms ? `, ${n.atoms} atoms` : ""}`, n.sparsity];
  const sweepNote = "MSE in asf², both axes logarithmic. Solid: test poses with 95% intervals; dashed: training poses.";
  const tuned = results.tuning.filter(c => c.split === split && c.base_asf === base_asf);
  const tuning = unique(tuned.map(c => c.model)).map(m => tuningChart(m, tuned.filter(c => c.model === m))).filter(Boolean);
  return html("section", { id }, html("h2", {}, heading(rows[0])), html("p", {}, SPLITS[split][1]), errorTable(rows, tasks),
    html("p", {}, `${plural(most(r => r.seeds.length), "seed")}, ${most(r => r.frames)} test poses from ${most(r => r.units)} different ${split === "frames" ? "frames" : "takes"}, over which the 95% intervals are drawn. Training MSE: the same error on poses of the training part. The lowest error of each task is marked.`),
    ...chartGroup("Training and test error", "MSE in asf², logarithmic. Full: test poses with the 95% interval; hollow: training poses. The two lie far apart where a model overfits.", each(errorChart)),
    ...chartGroup("Error against sparsity (atoms a pose)", sweepNote, each((t, own) => sweepChart(t, own, "error against sparsity", bySparsity))),
    ...chartGroup("Error against the size of the dictionary (atoms)", sweepNote, each((t, own) => sweepChart(t, own, "error against size", bySize))),
    ...chartGroup("Error by joint", "RMS error of a coordinate on test poses, cm.", each(jointChart)),
    ...chartGroup("Calibration", "Vertical: the share of coordinates within 0.25 to 3 of the standard deviations that the model states. Horizontal: the share of a Gaussian. On the dashed line the stated deviations are right; below it they are too small, above it too large. Exact and constant coordinates do not count.", each(calibrationChart)),
    ...(tuning.length ? [html("details", {}, html("summary", {}, "How the models were tuned"),
      html("p", {}, `Each model's covariance is multiplied by an inflation (1 / λ, or the width of the model's own kernel), and where the noise is unknown an equal noise is assumed for each coordinate. Both are chosen by task on training poses that are held back; test poses are never used. Vertical: MSE of the held-back poses in asf² with the best noise; horizontal: inflation; both logarithmic. The ring marks the choice. Seed ${results.tuning[0].seed}; results.json holds the other seeds and each noise.`),
      legend(Object.keys(TASKS).map((t, i) => ["k" + i, t])), html("div", { class: "charts small" }, ...tuning))] : []));
}

document.getElementById("facts").textContent = `${plural(results.takes, "take")} of ${plural(results.subjects, "subject")}, ${plural(results.frames, "frame")}; ${plural(results.seeds, "seed")}, at most ${results.test_frames} test frames each.`;
if (results.duplicates.length) document.getElementById("duplicates").append(
  html("p", {}, "Takes that share poses stay on one side of every split by takes or subjects:"),
  html("ul", {}, ...results.duplicates.map(text => html("li", {}, text))));

const groups = [];
for (const row of results.summary) {
  const last = groups.at(-1);
  if (last && last[0].split === row.split && last[0].base_asf === row.base_asf) last.push(row); else groups.push([row]);
}
document.getElementById("before").replaceWith(...(groups.length ? [lowestErrors()] : [html("p", {}, "Nothing was run.")]));
document.getElementById("after").replaceWith(...groups.map((rows, i) => splitSection("split" + i, rows)));
document.querySelector("nav").append(...[...document.querySelectorAll("main section[id]")].flatMap(section =>
  [html("a", { href: "#" + section.id }, section.querySelector("h2").textContent), " "]));
