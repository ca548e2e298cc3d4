
// The body of a player, and the editor: bones that cross. Reads `ink`.

/** The background's edge along a bone, by which the nearer of two that cross is seen; clear of the joints. */
function drawEdge(ctx, a, b, thick) {
  const long = Math.hypot(b[0] - a[0], b[1] - a[1]), free = 2.4 * thick;
  if (long < 2.5 * free) return;
  const dx = (b[0] - a[0]) * free / long, dy = (b[1] - a[1]) * free / long;
  ctx.beginPath(); ctx.moveTo(a[0] + dx, a[1] + dy); ctx.lineTo(b[0] - dx, b[1] - dy);
  ctx.setLineDash([]); ctx.lineCap = "butt"; ctx.strokeStyle = ink.panel; ctx.lineWidth = thick * 1.9; ctx.stroke();
}
