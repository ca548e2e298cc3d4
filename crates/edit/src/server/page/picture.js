
// The photograph in the large view: the picture, the fitted body over it, the marks.

/** `at` is where the pointer would set a mark. */
const sheet = { zoom: 1, shift: [0, 0], hover: null, at: null };
function beginPicture() { sheet.zoom = 1; sheet.shift = [0, 0]; sheet.hover = null; }

/** Pixels of the page a pixel of the picture, and where the picture's corner is. */
function layPicture() {
  const { width, height } = big, { naturalWidth: w, naturalHeight: h } = photo.image;
  // Beside or above the small view, and on a wide page below the line of guidance.
  const below = innerWidth > 760 ? 52 : 0, inset = small.canvas.parentNode;
  const beside = [width - inset.offsetWidth - (below ? 28 : 14), height - below - (below ? 12 : 4)], above = [width, height - inset.offsetHeight - 16];
  const fits = ([a, b]) => Math.min(a / w, b / h), [free, high] = below || fits(beside) > fits(above) ? beside : above;
  const scale = fits([free, high]) * .97 * sheet.zoom;
  return { scale, left: (free - w * scale) / 2 + sheet.shift[0], top: below + (high - h * scale) / 2 + sheet.shift[1] };
}
const ontoView = ([x, y]) => { const { scale, left, top } = layPicture(); return [left + x * scale, top + y * scale]; };
const ontoPicture = (x, y) => { const { scale, left, top } = layPicture(); return [(x - left) / scale, (y - top) / scale]; };

function panPicture(dx, dy) { sheet.shift[0] += dx; sheet.shift[1] += dy; ask(); }
function zoomPicture(by, x, y) {
  const before = ontoPicture(x, y);
  sheet.zoom = clamp(sheet.zoom * by, .3, 20);
  const [u, v] = ontoView(before);
  panPicture(x - u, y - v);
}

function drawPicture() {
  const view = big, { ctx } = view;
  [view.width, view.height] = ctx.begin();
  view.hits = [];
  const { scale, left, top } = layPicture(), { image } = photo;
  ctx.globalAlpha = +$("opacity").value;
  ctx.drawImage(image, left, top, image.naturalWidth * scale, image.naturalHeight * scale);
  ctx.globalAlpha = 1;
  if (photo.picture) drawFitted(ctx);
  for (const [name, place] of Object.entries(photo.marks)) drawMark(ctx, name, ontoView(place));
  if (sheet.at && askedFor()) label(ctx, sheet.at[0] + 14, sheet.at[1] + 18, "+ " + inWords(askedFor()), ink.text);
}

/** The fitted body: bones with a pale edge, so that they are seen on any picture. */
function drawFitted(ctx) {
  const at = byName();
  for (const [name, place] of Object.entries(photo.picture)) {
    at[name] = ontoView(place);
    big.hits.push({ x: at[name][0], y: at[name][1], depth: 0, joint: name });
  }
  const bones = bonesOf(photo.picture);
  ctx.lineCap = "round"; ctx.setLineDash([]);
  for (const [wide, color] of [[7, () => ink.panel], [3.5, name => ink[SIDE[sideOf(name)]]]]) for (const [a, b] of bones) {
    line(ctx, at[a], at[b]);
    ctx.lineWidth = wide; ctx.strokeStyle = color(b); ctx.stroke();
  }
  for (const name of Object.keys(at)) {
    circle(ctx, ...at[name], name === sheet.hover ? 6 : 4);
    ctx.fillStyle = ink.panel; ctx.fill();
    ctx.strokeStyle = ink[SIDE[sideOf(name)]]; ctx.lineWidth = 2; ctx.stroke();
    if (name === sheet.hover && !photo.marks[name]) label(ctx, at[name][0] + 11, at[name][1] - 9, inWords(name), ink.text);
  }
}

/** A mark is a diamond; a line joins it to the fitted joint. */
function drawMark(ctx, name, [x, y]) {
  const fitted = photo.picture && photo.picture[name] && ontoView(photo.picture[name]);
  if (fitted) { ctx.strokeStyle = ink.text; ctx.lineWidth = 1.2; line(ctx, [x, y], fitted); ctx.stroke(); }
  const large = name === sheet.hover || name === now.selected, half = large ? 8.5 : 6.5;
  ctx.beginPath();
  ctx.moveTo(x, y - half); ctx.lineTo(x + half, y); ctx.lineTo(x, y + half); ctx.lineTo(x - half, y); ctx.closePath();
  ctx.lineJoin = "miter";
  ctx.strokeStyle = ink.panel; ctx.lineWidth = 4; ctx.stroke();
  ctx.fillStyle = ink[SIDE[sideOf(name)]]; ctx.fill();
  ctx.strokeStyle = ink.text; ctx.lineWidth = name === now.selected ? 2.5 : 1; ctx.stroke();
  if (large) label(ctx, x + 12, y - 9, inWords(name), ink.text);
}

// ---- the pointer on it ----

const apartOnView = (place, x, y) => { const [u, v] = ontoView(place); return Math.hypot(u - x, v - y); };
function markAt(x, y, within) {
  let best = null, least = within;
  for (const [name, place] of Object.entries(photo.marks)) {
    const away = apartOnView(place, x, y);
    if (away < least) { least = away; best = name; }
  }
  return best;
}

/** What a press begins: "mark" moves a mark, "fitted" makes a mark of a joint of the body, "place" puts the asked one. */
function pressPicture(x, y, event) {
  sheet.at = null;
  const within = CATCH[event.pointerType] || 14, name = event.button === 0 && markAt(x, y, within);
  // A tap beside a mark, near enough to catch it, may be meant for the next one.
  grip = { name, begun: false, beside: !!name && apartOnView(photo.marks[name], x, y) > 9 };
  if (name) { select(name); return "mark"; }
  if (event.button !== 0 || event.shiftKey) return "pan";
  const hit = jointAt(big, x, y, 10);
  if (hit && !photo.marks[hit.joint]) { grip.name = hit.joint; return "fitted"; }
  return "place";
}
function movePicture(did, dx, dy, [x, y]) {
  if ((did === "mark" || did === "fitted") && moved > 3) {
    if (!grip.begun) { grip.begun = true; remember(); }
    mark(grip.name, ontoPicture(x, y));
  } else if (did === "pan" || (did === "place" && moved > 4)) panPicture(dx, dy);
}
function releasePicture(did, moved, event, [x, y]) {
  if (moved > 4 || event.type !== "pointerup" || !(did === "place" || did === "fitted" || (did === "mark" && grip.beside))) return;
  const name = askedFor(), place = ontoPicture(x, y);
  if (!name) { if (did === "place") say("Choose a joint in the list first."); return; }
  remember();
  mark(name, place);
  speak(`${inWords(name)} marked`);
}
/** A second finger moves the picture: the mark under the first stays where it was. */
function dropMark() { if (grip && grip.begun) undoMark(); }

function hoverPicture(x, y) {
  const hit = jointAt(big, x, y, 10), name = markAt(x, y, 14) || (hit && hit.joint) || null;
  big.canvas.style.cursor = name ? "move" : "crosshair";
  sheet.hover = name;
  sheet.at = markAt(x, y, 14) ? null : [x, y];
  ask();
}

/** By keys: Enter puts the asked joint's mark in the middle of the view, arrows move the selected one. */
function keyOnPicture(event) {
  const step = (event.shiftKey ? 20 : 2) / layPicture().scale, name = now.selected, place = photo.marks[name];
  const way = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
  if (way && place) mark(name, place.map((v, c) => v + step * way[c]));
  else if (event.key === "Enter" && askedFor()) { remember(); mark(askedFor(), ontoPicture(big.width / 2, big.height / 2)); }
  else if (event.key === "Delete" || event.key === "Backspace") removeMark(name);
  else return false;
  return true;
}
