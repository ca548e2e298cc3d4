
// The body of a player, shared by all: the clock, the slider, the buttons. Calls `draw()` and `tell()` of the player at hand.

/** Alone on its page, and not one of several figures in a report: it may have the wheel, the keys and the address. */
const alone = root.dataset.alone !== undefined;
const part = name => root.querySelector("." + name);
const keysHelp = document.querySelector("dialog.keys");
function make(tag, className, text) {
  const node = document.createElement(tag);
  if (className) node.className = className;
  if (text !== undefined) node.textContent = text;
  return node;
}

const SPEEDS = [.1, .25, .5, 1, 1.5, 2, 3, 4];
const USUAL = SPEEDS.indexOf(1);
const state = { frame: 0, clock: 0, playing: false, speed: USUAL, overlay: false, loop: true };
let asked = false, lastTick = 0;

// ---- drawing when asked, playing while time goes on ----

function ask() { if (!asked) { asked = true; requestAnimationFrame(tick); } }

function tick(now) {
  asked = false;
  if (state.playing) {
    // The first tick may carry an earlier time than the press of the button.
    const passed = Math.max(0, Math.min(now - lastTick, 250));
    state.clock += passed / 1000 * SPEEDS[state.speed] * rateAt(state.frame);
    if (state.clock >= frames) {
      if (state.loop) state.clock %= frames;
      else { state.clock = frames - 1; play(false); }
    }
    state.frame = Math.floor(state.clock);
  }
  lastTick = now;
  draw();
  tell();
  if (state.playing) ask();
}

function show(frame) {
  state.frame = Math.max(0, Math.min(frames - 1, Math.round(frame)));
  state.clock = state.frame;
  ask();
}

/** Moves the slider to the frame, and says it in words. */
function tellSlider(words) {
  const scrub = part("scrub");
  scrub.value = state.frame;
  scrub.style.setProperty("--done", `calc(8px + ${state.frame / Math.max(1, frames - 1)} * (100% - 16px))`);
  scrub.setAttribute("aria-valuetext", words);
}

function play(on) {
  if (on && !state.playing && state.frame >= frames - 1) show(0);
  state.playing = on;
  lastTick = performance.now();
  part("play").setAttribute("aria-label", on ? "Pause" : "Play");
  part("play").title = on ? "Pause (space)" : "Play (space)";
  ask();
}

function setSpeed(index) {
  state.speed = Math.max(0, Math.min(SPEEDS.length - 1, index));
  part("speed").textContent = SPEEDS[state.speed] + "×";
  part("speed").setAttribute("aria-label", `Speed ${SPEEDS[state.speed]}; press for the usual speed`);
}

function toggle(id, on) { part(id).setAttribute("aria-pressed", on); return on; }

/** A click by mouse gives the focus back, so that space goes on playing and pausing. */
function press(button, action) {
  button.addEventListener("click", event => { action(); if (event.detail) button.blur(); });
}

/** What the buttons do; a player adds its own. */
const actions = {
  play: () => play(!state.playing),
  back: () => { play(false); show(state.frame - 1); },
  next: () => { play(false); show(state.frame + 1); },
  slower: () => setSpeed(state.speed - 1),
  faster: () => setSpeed(state.speed + 1),
  speed: () => setSpeed(USUAL),
  overlay: () => { state.overlay = toggle("overlay", figures.length > 1 && !state.overlay); makePanels(); },
  follow: () => { camera.follow = toggle("follow", !camera.follow); ask(); },
  loop: () => { state.loop = toggle("loop", !state.loop); },
  reset: () => { resetCamera(); ask(); },
  help: () => { if (!keysHelp.open) keysHelp.showModal(); },
};

/** A section with the names of the figures in it and a canvas; the name of a single figure stands beside a note. */
function makeSection(list, canvas) {
  const section = make("section"), head = make("div", "head"), note = make("span", "missing");
  canvas.setAttribute("class", "view");
  if (list.length > 1) {
    const names = make("div", "names");
    for (const f of list) {
      const button = make("button"), dot = make("span", "swatch");
      dot.style.background = `var(--f${f % 6})`;
      button.append(dot, figures[f].name);
      button.setAttribute("aria-pressed", figures[f].shown);
      button.title = "Show or hide";
      press(button, () => {
        figures[f].shown = !figures[f].shown;
        button.setAttribute("aria-pressed", figures[f].shown);
        ask();
      });
      names.append(button);
    }
    head.append(names);
  } else head.append(make("div", "name", figures[list[0]].name.replaceAll("+", "\u200b+")), note);
  canvas.setAttribute("role", "img");
  if (!alone) canvas.setAttribute("tabindex", "0");
  section.append(head, canvas);
  return [section, note];
}

/** The figures of each panel, all in one when they are overlaid. */
function panelLists() {
  const all = figures.map((_, f) => f);
  // Of very many, the first few at first: the others are there to be switched on.
  const many = state.overlay && figures.length > 6;
  figures.forEach((figure, f) => { figure.shown = !many || f < 3; });
  return state.overlay ? [all] : all.map(f => [f]);
}

/** Makes the panels, and lets the buttons, the keys and the address act; `redraw` when sizes or colors have changed. */
function startPlayback(redraw) {
  part("stage").hidden = false;
  part("scrub").max = frames - 1;
  part("scrub").addEventListener("input", event => { play(false); show(+event.target.value); });
  part("overlay").hidden = figures.length < 2 || !!scene.pair;
  for (const id in actions) press(part(id), actions[id]);
  readInk();
  makePanels();
  new ResizeObserver(redraw).observe(part("stage"));
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
  if (scene.start) show(scene.start);
  if (alone) { addEventListener("hashchange", readLink); readLink(); }
}
