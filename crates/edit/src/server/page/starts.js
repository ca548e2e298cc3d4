
// Poses to start from: thumbnails of typical ones, and the rows of a table.

let drawnStarts = "";

function showStarts() {
  const { starts, rows } = now.state, key = starts.map(start => start.name).join("\n") + ink.panel;
  $("rows-row").hidden = !rows;
  if (rows) { $("row").max = rows; $("rows").textContent = `of ${rows}`; }
  if (key === drawnStarts) return;
  drawnStarts = key;
  const seen = byName(), buttons = starts.map((start, i) => {
    const button = make("button", "start"), canvas = make("canvas");
    button.append(canvas);
    // Of several poses with one name, each has its number.
    seen[start.name] = (seen[start.name] || 0) + 1;
    const several = starts.filter(other => other.name === start.name).length > 1, name = several ? `${start.name} ${seen[start.name]}` : start.name;
    button.append(make("span", "", name));
    button.title = `Start from: ${name}`;
    button.setAttribute("aria-label", button.title);
    button.addEventListener("click", () => takeStart({ do: "start", start: i }));
    return { button, pose: start.pose, round: several ? seen[start.name] : starts.length };
  });
  // The first of each name, then the second of each, and last those that are alone.
  buttons.sort((a, b) => a.round - b.round);
  $("starts").replaceChildren(...buttons.map(({ button }) => button));
  for (const { button, pose } of buttons) drawThumbnail(button.firstChild, pose);
}

function takeStart(action) {
  inOrder(async () => { if (ready() && await act(action)) frameBody(); });
}
$("take-row").addEventListener("click", () => {
  const row = Math.round(clamp(+$("row").value || 1, 1, now.state.rows));
  $("row").value = row;
  takeStart({ do: "row", row: row - 1 });
});
$("row").addEventListener("keydown", event => { if (event.key === "Enter") $("take-row").click(); });

whenChanged(showStarts);
