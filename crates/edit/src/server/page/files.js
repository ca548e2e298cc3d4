
// Files: what is saved is fetched and handed to the browser as a download; a session is opened from a file.

const FILES = { bvh: "BVH", amc: "AMC", csv: "CSV" };
let drawnFormats = "";

function showFiles() {
  const { formats, keys, session } = now.state, key = formats.join();
  if (key !== drawnFormats) {
    drawnFormats = key;
    for (const [id, whole] of [["save-pose", false], ["save-motion", true]])
      $(id).replaceChildren($(id).firstElementChild, ...formats.filter(format => format !== "json").map(format => {
        const button = make("button", "", FILES[format] || format.toUpperCase());
        button.title = `Save ${whole ? "the motion" : "this pose"} as ${button.textContent}`;
        button.dataset.format = format;
        button.addEventListener("click", () => save(format, whole));
        return button;
      }));
  }
  for (const button of $("save-motion").querySelectorAll("button")) button.disabled = keys.length < 2;
  $("save-motion").title = keys.length < 2 ? "Two keys make a motion" : "";
  $("session").textContent = session ? `The program keeps the session in ${session}.` : "";
}

const save = (format, whole) => whenReady(async () => {
  try {
    const bytes = await request("/export", { format, keys: whole }, { as: "blob", ...LARGE });
    const link = make("a"), address = URL.createObjectURL(bytes);
    link.href = address;
    link.download = fileName() + (whole ? "-motion" : "") + "." + format;
    link.click();
    setTimeout(() => URL.revokeObjectURL(address), 10000);
    $("files").hidePopover();
    say(`Saved ${link.download}.`);
  } catch (error) {
    if (error.status) say(error.message);
  }
});
function fileName() {
  // "the model's own figure" names no file.
  if (/^the /.test(now.state.name || "")) return "pose";
  const name = (now.state.name || "").split(/[/\\]/).pop().replace(/\.[a-z0-9]+$/i, "");
  return name.replace(/[^\p{L}\p{N}._-]+/gu, "-").replace(/^-+|-+$/g, "") || "pose";
}

const openSession = file => file && whenReady(async () => {
  try {
    takeState(await request("/open", await file.text(), LARGE));
    keepSession();
    frameBody();
    if ($("files").matches(":popover-open")) $("files").hidePopover();
    say(`Opened ${file.name}.`);
  } catch (error) {
    if (error.status) say(`${file.name}: ${error.message}`);
  }
});

$("save-session").addEventListener("click", () => save("json", false));
$("open-session").addEventListener("click", () => $("session-file").click());
$("session-file").addEventListener("change", event => { openSession(event.target.files[0]); event.target.value = ""; });

whenChanged(showFiles);
