// Draws Tables 1 to 4 of Lai et al. (the paper) from the JSON in the page: what is printed beside what was measured.

/** The bound that the caption of Table 4 states, asf². */
const BOUND = 0.1;
const subjects = run => unique(run.data.takes.map(t => t.subject));

/** Printed and measured errors of a column as [source, errors by method]; a printed one that lost a digit is no number. */
function sources(column) {
  const printed = column.errors.map((text, i) => [results.models[i][1], { text, mse: text === "" ? NaN : +text }]);
  const all = printed.length ? [["paper", new Map(printed)]] : [];
  for (const split of unique(column.measured.map(r => r.split)))
    all.push([split, new Map(column.measured.filter(r => r.split === split).map(r => [r.model, r]))]);
  return all;
}
const lowest = errors => Math.min(...[...errors.values()].map(e => e.mse).filter(Number.isFinite));

/** Columns side by side, a row a model: the error, its interval, and its ratio to the printed error. */
function grid(columns) {
  const shown = columns.flatMap(column => sources(column).map(([source, errors]) => ({ column, source, errors })));
  const head = [
    ["model", ...columns.map(c => html("th", { class: "task", colspan: sources(c).length }, c.table === 1 ? TASKS[c.task] : `subject ${c.subject}`))],
    ["", ...shown.map(s => s.source)]];
  const rows = results.models.filter(([, method]) => shown.some(s => s.errors.has(method))).map(([name, method], i) =>
    [html("th", {}, name, " ", html("small", {}, method)), ...shown.map(({ column, source, errors }) => {
      const error = errors.get(method);
      if (!error || error.text === "") return "–";
      const ratio = source === "frames" ? error.mse / +column.errors[i] : NaN;
      const below = error.interval ? [html("br"), html("small", {}, range(error.interval), Number.isFinite(ratio) ? `, × ${short(ratio)}` : "")] : [];
      return html("td", error.mse <= lowest(errors) ? { class: "best" } : {}, error.text || short(error.mse), ...below);
    })]);
  return table(head, rows);
}

/** For each source of errors, what `names(errors)` gives in the columns that have it, counted: "MFA 3 of 4". */
function counted(columns, names) {
  const found = new Map();
  for (const [source, errors] of columns.flatMap(sources)) found.set(source, [...(found.get(source) || []), names(errors)]);
  return [...found].map(([source, lists]) => {
    const count = method => lists.filter(list => list.includes(method)).length;
    const models = results.models.filter(([, method]) => count(method)).sort((a, b) => count(b[1]) - count(a[1]));
    return html("li", {}, `${source}: ${models.map(([name, method]) => `${name} ${count(method)} of ${lists.length}`).join(", ") || "none"}`);
  });
}

function section(number) {
  const columns = results.columns.filter(c => c.table === number);
  const printed = columns.filter(c => c.errors.length), others = columns.filter(c => !c.errors.length);
  if (number === 1 && !columns.some(c => c.measured.length)) return [];
  const methods = (errors, keep) => [...errors].filter(([, e]) => keep(e.mse)).map(([method]) => method);
  return [html("section", {}, html("h2", {}, `Table ${number}: ${number === 1 ? "all subjects" : `${TASKS[columns[0].task].toLowerCase()}, single subjects`}`),
    ...(number === 1 ? [html("p", {}, "The paper: all of CMU's database, 2,075,280 test poses. Here: the run of most subjects.")] : []),
    grid(printed), ...(others.length ? [html("p", {}, "Subjects that the paper does not have:"), grid(others)] : []),
    html("h3", {}, "Lowest error"), html("ul", {}, ...counted(columns, errors => methods(errors, mse => mse <= lowest(errors)))),
    ...(number === 4 ? [html("h3", {}, `Below ${BOUND} asf², as the caption says of the paper's model alone`),
      html("ul", {}, ...counted(columns, errors => methods(errors, mse => mse < BOUND)))] : []))];
}

function description({ settings, data }) {
  const rates = unique(data.takes.map(t => t.rate).filter(Boolean).map(Math.round)).sort((a, b) => a - b);
  return `${plural(subjects({ data }).length, "subject")}, ${plural(data.takes.length, "take")}, ${data.frames} frames${rates.length ? ` at ${rates.join(" and ")} a second` : ""}; ${plural(settings.seeds.length, "seed")}, at most ${settings.frames} test poses each`;
}

document.getElementById("tables").replaceWith(...[1, 2, 3, 4].flatMap(section));
document.getElementById("runs").append(...results.runs.map(run =>
  html("li", {}, html("a", { href: `${encodeURIComponent(run.name)}/report.html` }, run.name), `: ${description(run)}`)));
