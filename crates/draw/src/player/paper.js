
"use strict";
// What figures are drawn on: a canvas where they move, SVG where they stand still. Both know the same few strokes.

/** An empty SVG element. */
function emptySvg() {
  const holder = document.createElement("div");
  holder.innerHTML = "<svg/>";
  return holder.firstChild;
}

/** A canvas as sharp as the screen. `begin` clears it and tells its size in pixels of the page. */
function canvasPaper(canvas) {
  const ctx = canvas.getContext("2d");
  ctx.begin = () => {
    const dots = window.devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
    const w = Math.round(width * dots), h = Math.round(height * dots);
    if (canvas.width !== w || canvas.height !== h) { canvas.width = w; canvas.height = h; }
    ctx.setTransform(dots, 0, 0, dots, 0, 0);
    ctx.clearRect(0, 0, width, height);
    return [width, height];
  };
  ctx.end = () => {};
  return ctx;
}

/** The strokes of a canvas as the paths of an SVG: sharp at any size, and in print. Colors are the page's own. */
function svgPaper(node) {
  let parts = [], d = "", dashes = "";
  const at = (x, y) => x.toFixed(1) + " " + y.toFixed(1);
  const alpha = () => paper.globalAlpha < 1 ? ` opacity="${paper.globalAlpha.toFixed(2)}"` : "";
  const paper = {
    strokeStyle: "", fillStyle: "", lineWidth: 1, lineCap: "butt", globalAlpha: 1,
    begin() {
      const { width, height } = node.getBoundingClientRect();
      parts = [];
      node.setAttribute("viewBox", `0 0 ${width} ${height}`);
      return [width, height];
    },
    end() { node.innerHTML = parts.join(""); },
    beginPath() { d = ""; },
    moveTo(x, y) { d += "M" + at(x, y); },
    lineTo(x, y) { d += "L" + at(x, y); },
    /** A whole circle: nothing else is drawn with it. */
    arc(x, y, r) { d += `M${at(x - r, y)}a${at(r, r)} 0 1 0 ${at(2 * r, 0)}a${at(r, r)} 0 1 0 ${at(-2 * r, 0)}`; },
    setLineDash(list) { dashes = list.length ? ` stroke-dasharray="${list.map(v => v.toFixed(1)).join(" ")}"` : ""; },
    stroke() {
      if (!d) return;
      parts.push(`<path d="${d}" fill="none" stroke="${paper.strokeStyle}" stroke-width="${paper.lineWidth.toFixed(2)}" stroke-linecap="${paper.lineCap}"${dashes}${alpha()}/>`);
    },
    fill() { if (d) parts.push(`<path d="${d}" fill="${paper.fillStyle}"${alpha()}/>`); },
  };
  return paper;
}
