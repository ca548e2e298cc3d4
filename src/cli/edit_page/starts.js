
// Poses to start from: thumbnails of typical ones, and the rows of a table.

let drawnStarts = "";

function showStarts() {
  const { starts, rows } = now.state, key = starts.map(start => start.name).join("\n") + ink.panel;
  $("rows-row").hidden = !rows;
  if (rows) { $("row").max = rows; $("rows").textContent = `of ${rows}`; }
  if (key === drawnStarts) return;
  drawnStarts = key;
  const seen = {};
  $("starts").replaceChildren(...starts.map((start, i) => {
    const button = make("button", "start"), canvas = make("canvas");
    button.append(canvas);
    // Of several poses with one name, each has its number.
    seen[start.name] = (seen[start.name] || 0) + 1;
    const name = starts.filter(other => other.name === start.name).length > 1 ? `${start.name} ${seen[start.name]}` : start.name;
    button.append(make("span", "", name));
    button.title = `Start from: ${name}`;
    button.setAttribute("aria-label", button.title);
    button.addEventListener("click", () => takeStart({ do: "start", start: i }));
    return button;
  }));
  [...$("starts").children].forEach((button, i) => drawThumbnail(button.firstChild, starts[i].pose));
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
