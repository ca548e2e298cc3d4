
// The strip of keys: a ruler with the time, a card for each key, play and its settings.

const strip = { from: 0, to: 2, drag: null, pad: 34 };

function showStrip() {
  const { keys, rate, key: open } = now.state;
  if (!strip.pressed && !strip.scrubbing) {
    const needed = Math.max(2, Math.ceil((lastTime() + .75) * 4) / 4, motion.playing ? 0 : motion.cursor + .25);
    // The scale grows with the keys; it shrinks only when most of it is empty.
    if (needed > strip.to || needed < .6 * strip.to) strip.to = needed;
  }
  $("no-keys").hidden = keys.length > 0;
  if (document.activeElement !== $("time")) $("time").value = +motion.cursor.toFixed(2);
  if (document.activeElement !== $("rate")) $("rate").value = rate;
  const at = keyAtTime(motion.cursor);
  $("set-key").firstChild.textContent = at >= 0 ? "Replace key " : "Set key ";
  $("remove-key").disabled = at < 0 && open === null;
  $("play").disabled = keys.length < 2;
  $("play").setAttribute("aria-label", motion.playing ? "Pause" : "Play");
  $("play").title = keys.length < 2 ? "Two keys make a motion" : motion.playing ? "Pause (space)" : "Play (space)";
  showCards();
}

const toX = time => strip.pad + (time - strip.from) / (strip.to - strip.from) * ($("ruler").clientWidth - 2 * strip.pad);
const toTime = x => strip.from + (x - strip.pad) / ($("ruler").clientWidth - 2 * strip.pad) * (strip.to - strip.from);
const onFrame = time => Math.max(0, Math.round(time * now.state.rate) / now.state.rate);

function showCards() {
  const { keys, key: open } = now.state, box = $("cards");
  while (box.children.length > keys.length) box.lastChild.remove();
  keys.forEach((key, i) => {
    const card = box.children[i] || newCard(box), time = strip.drag && strip.drag.key === i ? strip.drag.time : key.time;
    card.dataset.key = i;
    card.style.left = toX(time) + "px";
    card.classList.toggle("on", open === i);
    card.setAttribute("aria-pressed", open === i);
    card.setAttribute("aria-label", `Key at ${+time.toFixed(2)} seconds`);
    card.lastChild.textContent = `${+time.toFixed(2)} s`;
    if (card.pose !== key.pose || card.panel !== ink.panel) { card.pose = key.pose; card.panel = ink.panel; drawThumbnail(card.firstChild, key.pose); }
  });
}

function newCard(box) {
  const card = box.appendChild(make("button", "card"));
  card.append(make("canvas"), make("span"));
  card.title = "Click: open this key. Drag: move it in time.";
  let begun = null;
  card.addEventListener("pointerdown", event => {
    card.setPointerCapture(event.pointerId);
    strip.pressed = true;
    begun = { x: event.clientX, time: now.state.keys[+card.dataset.key].time };
  });
  card.addEventListener("pointermove", event => {
    if (!begun || Math.abs(event.clientX - begun.x) < 4 && !strip.drag) return;
    const time = onFrame(begun.time + toTime(event.clientX) - toTime(begun.x));
    strip.drag = { key: +card.dataset.key, time };
    tell();
  });
  const drop = event => {
    const { drag } = strip;
    begun = null;
    strip.drag = null;
    strip.pressed = false;
    if (!drag) return;
    card.moved = true;
    if (event.type === "pointerup") moveKey(drag.key, drag.time);
    tell();
  };
  card.addEventListener("pointerup", drop);
  card.addEventListener("pointercancel", drop);
  card.addEventListener("click", () => { if (card.moved) card.moved = false; else openKey(+card.dataset.key); });
  card.addEventListener("keydown", event => {
    const key = +card.dataset.key;
    if (event.key === "Delete" || event.key === "Backspace") removeKey(key);
    else if (event.key === "ArrowLeft" || event.key === "ArrowRight") {
      moveKey(key, onFrame(Math.max(0, now.state.keys[key].time + (event.key === "ArrowLeft" ? -.1 : .1))));
    } else return;
    event.preventDefault();
    event.stopPropagation();
  });
  return card;
}

// ---- the ruler ----

const rulerPaper = canvasPaper($("ruler"));
function drawRuler() {
  const ctx = rulerPaper, [width, height] = ctx.begin(), { keys } = now.state, top = 20;
  ctx.fillStyle = ink.soft;
  ctx.fillRect(0, 0, width, top);
  if (keys.length > 1) {
    ctx.fillStyle = ink.accent; ctx.globalAlpha = .25;
    ctx.fillRect(toX(firstTime()), top - 4, toX(lastTime()) - toX(firstTime()), 4);
    ctx.globalAlpha = 1;
  }
  const pixels = (width - 2 * strip.pad) / (strip.to - strip.from);
  const step = [.1, .25, .5, 1, 2, 5, 10, 30, 60].find(s => s * pixels > 56) || 120;
  ctx.font = "11px system-ui, sans-serif"; ctx.textAlign = "left"; ctx.fillStyle = ink.pale; ctx.strokeStyle = ink.grid; ctx.lineWidth = 1;
  for (let t = 0; t <= strip.to + 1e-6; t += step) {
    const x = Math.round(toX(t)) + .5;
    ctx.beginPath(); ctx.moveTo(x, 0); ctx.lineTo(x, top); ctx.stroke();
    ctx.fillText(+t.toFixed(2) + " s", x + 4, 13);
  }
  for (const key of keys) {
    const x = toX(key.time);
    ctx.beginPath(); ctx.moveTo(x, top - 9); ctx.lineTo(x + 5, top - 4); ctx.lineTo(x, top + 1); ctx.lineTo(x - 5, top - 4); ctx.closePath();
    ctx.fillStyle = ink.text; ctx.fill();
  }
  const x = toX(motion.cursor);
  ctx.fillStyle = ink.accent;
  ctx.fillRect(x - 1, 0, 2, height);
  ctx.beginPath(); ctx.moveTo(x - 6, 0); ctx.lineTo(x + 6, 0); ctx.lineTo(x, 8); ctx.closePath(); ctx.fill();
  $("ruler").setAttribute("aria-valuenow", motion.cursor.toFixed(2));
  $("ruler").setAttribute("aria-valuemax", strip.to);
  $("ruler").setAttribute("aria-valuetext", motion.cursor.toFixed(2) + " seconds");
}
drawings.push(() => { if (now.state) drawRuler(); });

function scrub(event) {
  if (!now.state || now.gesture || photo.on) return;
  const box = $("ruler").getBoundingClientRect(), x = event.clientX - box.left;
  const close = now.state.keys.find(key => Math.abs(toX(key.time) - x) < 6);
  motion.playing = false;
  leaveOthers();
  goTo(close ? close.time : onFrame(clamp(toTime(x), 0, strip.to)));
}
$("ruler").addEventListener("pointerdown", event => { endNudge(); strip.scrubbing = true; $("ruler").setPointerCapture(event.pointerId); scrub(event); });
for (const end of ["pointerup", "pointercancel"]) $("ruler").addEventListener(end, () => { strip.scrubbing = false; tell(); });
$("ruler").addEventListener("pointermove", event => { if (event.buttons) scrub(event); });
$("ruler").addEventListener("keydown", event => {
  const way = { ArrowLeft: -1, ArrowRight: 1, ArrowDown: -1, ArrowUp: 1 }[event.key];
  if (event.key === "Home") goTo(firstTime());
  else if (event.key === "End") goTo(lastTime());
  else if (way) goTo(onFrame(motion.cursor + way * (event.shiftKey ? .5 : 1 / now.state.rate)));
  else return;
  motion.playing = false;
  event.preventDefault();
  event.stopPropagation();
});

$("play").addEventListener("click", () => play(!motion.playing));
$("set-key").addEventListener("click", setKey);
$("remove-key").addEventListener("click", () => removeKey(keyInHand()));
$("time").addEventListener("change", event => { motion.playing = false; goTo(+event.target.value || 0); });
$("time").addEventListener("keydown", event => { if (event.key === "Enter") { motion.cursor = Math.max(0, +event.target.value || 0); setKey(); event.preventDefault(); } });
$("rate").addEventListener("change", event => { if (+event.target.value > 0) doInOrder({ do: "rate", fps: +event.target.value }); });
$("onion").addEventListener("change", event => { motion.onion = event.target.checked; ask(); });
$("loop").addEventListener("change", event => { motion.loop = event.target.checked; });

whenChanged(showStrip);
