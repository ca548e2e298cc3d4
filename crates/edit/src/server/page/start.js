
// Everything begins.

drawings.push(() => {
  if (photo.on) drawPicture(); else drawView(big);
  drawView(small);
  if (now.state) nameSmall();
});
readInk();
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { readInk(); tell(); });
addEventListener("resize", tell);
new ResizeObserver(() => ask()).observe($("big"));
startLink();
ask();

/** For tests: what the page knows, read only. */
window.posing = Object.freeze({
  state: () => parsed(JSON.stringify({
    way: link.way, pose: now.pose, shown: shown(), pins: now.pins, missed: now.missed, unlike: now.unlike, revision: now.revision,
    selected: now.selected, moving: now.gesture && now.gesture.targets, other: others.at, cursor: motion.cursor, playing: motion.playing,
    undo: now.state && now.state.undo, redo: now.state && now.state.redo, keys: now.state ? now.state.keys : [], key: now.state && now.state.key,
    joints: now.state ? now.state.joints : [], marks: photo.marks, picture: photo.picture, kept: link.kept,
  })),
  inFlight: () => link.flying,
  /** The most requests that were ever in flight at a time. */
  most: () => link.most,
  waiting: () => link.queue.length + (order.busy ? 1 : 0),
  frames: () => frames,
  /** Where a joint is drawn, in pixels of the window; `small`: in the second view. */
  place: (name, second = false) => {
    const view = second ? small : big, box = view.canvas.getBoundingClientRect(), hit = view.hits.find(h => h.joint === name);
    return hit ? [box.left + hit.x, box.top + hit.y] : null;
  },
  /** Where a place in space, or a pixel of the picture, is drawn. */
  project: place => {
    const box = big.canvas.getBoundingClientRect(), [x, y] = place.length === 2 ? ontoView(place) : big.project(...place);
    return [box.left + x, box.top + y];
  },
});
