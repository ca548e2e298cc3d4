
// The body of `player(root, scene)`, of poses: lists of rows to click, and that of the gaps of the figure whose curves are shown.

/** A list: its items, what it is sorted by, the section that it stands in, its columns, and where a row leads. */
const gaps = { list: [], by: "Length", down: true, section: "gaps", columns: gapColumns, go: goToGap };
/** More rows than anyone reads make the page slow. */
const LISTED = 300;
/** How long before a gap its row leads to, seconds. */
const LEAD = .3;

/** The columns: name, value to sort by, text, class. Those that tell nothing here are left out. */
function gapColumns() {
  const number = "number", spare = "number spare", seconds = v => v.toFixed(2) + " s";
  return [
    ["Point", gap => scene.points[gap.point]],
    scene.runs.length > 1 && scene.runs.some(run => run[0]) && ["Take", gap => moment(gap.first)[0]],
    ["Start", gap => moment(gap.first)[1], seconds, number],
    ["Frame", gap => gap.first * scene.every, String, spare],
    ["Length", gap => gap.seconds, seconds, number],
    ["Frames", gap => gap.frames * scene.every, String, spare],
    figures[curves.figure].has[INFERRED] && ["Method", gap => gap.how],
    gaps.list.some(gap => gap.sd) && ["sd", gap => gap.sd, v => Number.isNaN(v) ? "–" : v.toFixed(2) + " cm", number],
  ].filter(Boolean);
}

function sortRows({ list, by, down, columns }) {
  const value = columns().find(([name]) => name === by)?.[1] || (item => item.seconds), sign = down ? -1 : 1;
  // What has no number comes last either way; equals are in the order of time.
  const compare = (a, b) => {
    const [u, v] = [value(a), value(b)];
    if (typeof u === "string") return sign * u.localeCompare(v, undefined, { numeric: true });
    return Number.isNaN(u) || Number.isNaN(v) ? Number.isNaN(u) - Number.isNaN(v) : sign * (u - v);
  };
  list.sort((a, b) => compare(a, b) || a.first - b.first || a.point - b.point);
}

function makeGaps() {
  gaps.list = findGaps(curves.figure);
  part("gaps").hidden = !gaps.list.length;
  const count = gaps.list.length;
  part("gaps").querySelector("h2").textContent =
    `${count} ${count === 1 ? "gap" : "gaps"}` + (figures.length > 1 ? " in " + figures[curves.figure].name : "");
  fillRows(gaps);
}

function fillRows(listed) {
  sortRows(listed);
  const columns = listed.columns(), section = part(listed.section), table = section.querySelector("table"), head = make("tr");
  for (const [name, , , kind] of columns) {
    const cell = make("th", kind), button = make("button", "", name), chosen = listed.by === name;
    cell.scope = "col";
    if (chosen) cell.setAttribute("aria-sort", listed.down ? "descending" : "ascending");
    button.title = "Sort";
    press(button, () => {
      // What is long, unsure or far apart comes first, names and times in their order.
      listed.down = chosen ? !listed.down : /^(Length|Frames|sd|Largest|RMS)/.test(name);
      listed.by = name;
      fillRows(listed);
      const again = [...table.tHead.querySelectorAll("button")].find(b => b.textContent === name);
      again.focus();
    });
    cell.append(button);
    head.append(cell);
  }
  table.tHead.replaceChildren(head);
  table.tBodies[0].replaceChildren(...listed.list.slice(0, LISTED).map((item, i) => rowOf(item, columns, i, listed.go)));
  const more = listed.list.length - LISTED;
  section.querySelector(".rest").textContent = more > 0 ? `${more} more are not listed; sort by another column to see others.` : "";
}

/** A row: one of its buttons can be reached with tab, the others with the arrows from there. */
function rowOf(item, columns, i, go) {
  const row = make("tr");
  columns.forEach(([, value, text = String, kind], c) => {
    const cell = make("td", kind);
    if (c) cell.textContent = text(value(item));
    else {
      const button = make("button", "", text(value(item)));
      button.tabIndex = i ? -1 : 0;
      cell.append(button);
    }
    row.append(cell);
  });
  press(row, () => { mark(row); go(item); });
  row.addEventListener("keydown", event => {
    const next = { ArrowDown: row.nextSibling, ArrowUp: row.previousSibling }[event.key];
    if (!(event.key === "ArrowDown" || event.key === "ArrowUp")) return;
    event.preventDefault();
    if (next) { mark(next, false); next.querySelector("button").focus(); }
  });
  return row;
}

/** The row that tab leads to, and, once chosen, that is shown. */
function mark(row, chosen = true) {
  for (const other of row.parentNode.children) {
    other.querySelector("button").tabIndex = other === row ? 0 : -1;
    if (chosen) other.toggleAttribute("aria-current", other === row);
  }
}

/** Goes to a little before a gap, and near enough to see it. */
function goToGap(gap) {
  const run = runOf(gap.first), start = run < 0 ? 0 : scene.runs[run][1];
  play(false);
  show(Math.max(start, gap.first - Math.round(LEAD * rateAt(gap.first))));
  setTrail(gap.point);
  const fits = seconds => gap.frames <= .5 * spanFrames(seconds), long = spanFrames(curves.seconds);
  if (gap.frames < long / 20 || gap.frames > .6 * long) setSpan(SPANS.find(s => fits(s) && spanFrames(s) < frames - 1) || 0);
  showFrom(gap.first + gap.frames / 2 - spanFrames(curves.seconds) / 2);
  part("plot").scrollIntoView({ block: "nearest" });
}
