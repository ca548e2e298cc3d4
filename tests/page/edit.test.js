// The page of `posing edit` in a browser, with real mouse, touch and key events.
import assert from 'node:assert/strict';
import { readFile } from 'node:fs/promises';
import { after, afterEach, before, test } from 'node:test';
import { apart, click, closeBrowser, closePages, drag, farthest, open, place, program, settled, sound, state, until } from './browser.js';

let server;
before(async () => { server = await program(); });
afterEach(closePages);
after(async () => { await closeBrowser(); await server.stop(); });
/** Each test has a page of its own, on the first start pose. */
async function fresh(options, expected) {
  const page = await open(server.address, options, expected);
  await page.locator('#starts button').first().click();
  await settled(page);
  if (await page.locator('#unpin').isEnabled()) { await page.locator('#unpin').click(); await settled(page); }
  for (let keys = (await state(page)).keys.length; keys > 0; keys--) {
    await page.locator('#cards button').first().focus();
    await page.keyboard.press('Delete');
    await settled(page);
  }
  await page.keyboard.press('r');
  await page.waitForTimeout(60);
  return page;
}

test('a dragged joint is under the pointer, pins stay exactly', async () => {
  const page = await fresh();
  for (const foot of ['lfoot', 'rfoot']) await click(page, foot);
  const { pins, pose: start } = await state(page);
  assert.deepEqual(Object.keys(pins).sort(), ['lfoot', 'rfoot']);
  await drag(page, 'lwrist', 50, -90, async (x, y) => {
    const { moving, pose } = await state(page), dot = await page.evaluate(at => posing.project(at), moving.lwrist);
    assert.ok(apart(dot, [x, y]) < 1, `the dot is ${apart(dot, [x, y])} pixels from the pointer`);
    assert.ok(apart(pose.lwrist, moving.lwrist) < 3, `the joint is ${apart(pose.lwrist, moving.lwrist)} cm from the dot`);
    for (const foot in pins) assert.ok(apart(pose[foot], pins[foot]) < .05);
  });
  const { pose, undo } = await state(page);
  assert.ok(apart(pose.lwrist, start.lwrist) > 10 && undo);
  for (const foot in pins) assert.ok(apart(pose[foot], pins[foot]) < .05);
  await sound(page);
});

test('the dot does not wait for the program', async () => {
  const page = await fresh(), [x, y] = await place(page, 'rwrist');
  // No request is answered for a while.
  await page.route('**/solve', async route => { await new Promise(done => setTimeout(done, 400)); await route.continue(); });
  await page.mouse.move(x, y);
  await page.mouse.down();
  await page.mouse.move(x - 40, y - 60, { steps: 12 });
  await page.waitForTimeout(50);
  const { moving } = await state(page), dot = await page.evaluate(at => posing.project(at), moving.rwrist);
  assert.ok(apart(dot, [x - 40, y - 60]) < 1);
  assert.ok(await page.evaluate(() => posing.waiting()) <= 1, 'the newest waiting request takes the place of the others');
  await page.mouse.up();
  await settled(page);
  await page.unroute('**/solve');
  const { pose } = await state(page);
  assert.ok(apart(pose.rwrist, moving.rwrist) < 3, 'the last place counts');
  await sound(page);
});

test('the dot is drawn in the next frame, the body in one soon after', async t => {
  const page = await fresh(), [x, y] = await place(page, 'lwrist'), moves = 60;
  await page.evaluate(watchFrames, 'lwrist');
  await page.mouse.move(x, y);
  await page.mouse.down();
  // On an arc that never comes back; sent by the clock, whether or not the one before is handled.
  const sent = [], start = Date.now();
  for (let i = 1; i <= moves; i++) {
    await page.waitForTimeout(Math.max(0, start + 16 * i - Date.now()));
    sent.push(page.mouse.move(x + 70 * Math.sin(i / moves * 2), y - 70 * (1 - Math.cos(i / moves * 2))));
  }
  await Promise.all(sent);
  await settled(page);
  const { events, draws, answers } = await page.evaluate(() => watched);
  await page.mouse.up();
  await settled(page);
  assert.ok(events.length > 0);
  const dot = [], body = [];
  events.forEach((event, i) => {
    const next = draws.find(draw => draw.events > i), pointer = events[next.events - 1];
    dot.push(next.frame - event.frame);
    assert.ok(apart(next.dot, pointer.at) < 1, `event ${i}: the dot is drawn ${apart(next.dot, pointer.at)} pixels from the pointer`);
    // The first body that knows this place or a newer one.
    const drawn = draws.find(draw => answers[draw.revision] >= i);
    assert.ok(drawn, `event ${i} of ${events.length} has an answer that is drawn`);
    body.push({ frames: drawn.frame - event.frame, ms: drawn.time - event.time });
  });
  assert.deepEqual(dot.filter(frames => frames !== 1), [], 'the dot is drawn in the next frame');
  const quantile = (values, share) => values.sort((a, b) => a - b)[Math.ceil(share * values.length) - 1].toFixed(0);
  for (const unit of ['frames', 'ms']) {
    const values = body.map(one => one[unit]);
    t.diagnostic(`from a move to the body that answers it: median ${quantile(values, .5)}, 95% within ${quantile(values, .95)} ${unit}`);
  }
  await sound(page);
});
/** In the page: notes each move of the pointer, each answer, and what each frame draws. `frame` counts frames that have begun. */
function watchFrames(joint) {
  const events = [], draws = [], answers = {}, next = requestAnimationFrame.bind(window), send = fetch.bind(window);
  let frame = 0, last = -1;
  const begin = time => { if (time !== last) { last = time; frame++; } };
  const tick = time => { begin(time); next(tick); };
  next(tick);
  window.watched = { events, draws, answers };
  // After the page has dealt with it.
  addEventListener('pointermove', ({ clientX, clientY, timeStamp }) => {
    const { moving } = posing.state();
    if (moving) events.push({ frame, time: timeStamp, at: [clientX, clientY], target: moving[joint].join() });
  });
  window.requestAnimationFrame = draw => next(time => {
    begin(time);
    draw(time);
    const { moving, revision } = posing.state();
    if (moving) draws.push({ frame, time: performance.now(), events: events.length, revision, dot: posing.project(moving[joint]) });
  });
  window.fetch = async (path, options) => {
    const answer = await send(path, options), drag = path === '/solve' && JSON.parse(options.body).drags[joint];
    if (!drag) return answer;
    const event = events.findLastIndex(one => one.target === drag.xyz.join());
    return { ok: answer.ok, json: async () => { const pose = await answer.json(); answers[pose.revision] = event; return pose; } };
  };
}

test('depth by shift and by the wheel, fine by ctrl, escape cancels', async () => {
  const page = await fresh(), before = await state(page), [x, y] = await place(page, 'rwrist');
  await page.mouse.move(x, y);
  await page.mouse.down();
  await page.keyboard.down('Shift');
  await page.mouse.move(x, y + 60, { steps: 6 });
  let { moving } = await state(page);
  let dot = await page.evaluate(at => posing.project(at), moving.rwrist);
  assert.ok(apart(dot, [x, y]) < 1, 'in depth, the dot stays where it is in the view');
  assert.ok(apart(moving.rwrist, before.pose.rwrist) > 5);
  await page.keyboard.up('Shift');
  const still = moving.rwrist;
  await page.mouse.wheel(0, 300);
  await until(page, from => Math.hypot(...posing.state().moving.rwrist.map((v, c) => v - from[c])) > 2, still);
  await page.keyboard.down('Control');
  const a = (await state(page)).moving.rwrist, from = await page.evaluate(at => posing.project(at), a);
  await page.mouse.move(x + 50, y + 60, { steps: 5 });
  dot = await page.evaluate(at => posing.project(at), (await state(page)).moving.rwrist);
  assert.ok(Math.abs(apart(dot, from) - 10) < 1, `a fifth of 50 pixels, and not ${apart(dot, from)}`);
  await page.keyboard.up('Control');
  await page.keyboard.press('Escape');
  await settled(page);
  await page.mouse.up();
  await settled(page);
  const now = await state(page);
  assert.equal(now.moving, null);
  assert.ok(farthest(before.pose, now.pose) < .01);
  assert.equal(now.undo, before.undo);
  await sound(page);
});

test('the second view: its joints are dragged in its own plane', async () => {
  const page = await fresh(), { pose } = await state(page), [x, y] = await place(page, 'rwrist', true), [u, v] = await place(page, 'rwrist');
  await page.mouse.move(x, y);
  await page.mouse.down();
  await page.mouse.move(x + 12, y, { steps: 6 });
  await settled(page);
  const { moving } = await state(page), [w, z] = await page.evaluate(at => posing.project(at), moving.rwrist);
  assert.ok(apart(moving.rwrist, pose.rwrist) > 3);
  assert.ok(apart([w, z], [u, v]) < 12, 'in the large view, that is depth');
  await page.mouse.up();
  await settled(page);
  await sound(page);
});

test('a joint goes straight up, and level when it is seen from above', async () => {
  const page = await fresh(), before = (await state(page)).pose.lwrist;
  // The view looks from 25 degrees to the left of the front.
  const toward = at => (at[0] - before[0]) * Math.sin(25 * Math.PI / 180) + (at[2] - before[2]) * Math.cos(25 * Math.PI / 180);
  await drag(page, 'lwrist', 0, -120, async () => {
    const { moving: { lwrist } } = await state(page);
    assert.ok(lwrist[1] - before[1] > 20);
    assert.ok(Math.abs(toward(lwrist)) < .01, 'not in depth');
  });
  await page.keyboard.press('Control+z');
  await settled(page);
  for (let i = 0; i < 12; i++) await page.keyboard.press('w');
  // The view is there when it stands still.
  for (let was = null, at = await place(page, 'lwrist'); String(was) !== String(at); at = await place(page, 'lwrist')) {
    was = at;
    await page.waitForTimeout(100);
  }
  await drag(page, 'lwrist', 20, 40, async () => {
    const { moving: { lwrist } } = await state(page);
    assert.ok(Math.abs(lwrist[1] - before[1]) < .01 && apart(lwrist, before) > 5);
  });
  await sound(page);
});

test('pins: click, axes, both feet, a pinned joint takes its pin along', async () => {
  const page = await fresh();
  await click(page, 'rwrist');
  assert.ok((await state(page)).pins.rwrist);
  await drag(page, 'rwrist', -30, -30);
  const moved = await state(page);
  assert.ok(apart(moved.pins.rwrist, moved.pose.rwrist) < .05, 'the pin is where the joint is');
  await click(page, 'rwrist');
  assert.ok(!(await state(page)).pins.rwrist);
  await page.locator('#pin-y').click();
  await settled(page);
  const [px, py, pz] = (await state(page)).pins.rwrist;
  assert.ok(px === null && py !== null && pz === null);
  await drag(page, 'rwrist', -30, -30);
  assert.ok(Math.abs((await state(page)).pose.rwrist[1] - py) < .05, 'a pinned height stays');
  await page.locator('#unpin').click();
  await settled(page);
  await page.locator('#pin-feet').click();
  await settled(page);
  const { pins: feet } = await state(page);
  for (const name of ['lfoot', 'ltibia', 'rfoot', 'rtibia']) assert.ok(feet[name], 'ankles, too');
  assert.equal(await page.locator('#unpin').textContent(), `Unpin all (${Object.keys(feet).length})`);
  // Both sides together.
  await page.keyboard.press('b');
  await click(page, 'lradius');
  assert.ok((await state(page)).pins.lradius && (await state(page)).pins.rradius);
  await click(page, 'rradius');
  assert.deepEqual(Object.keys((await state(page)).pins).sort(), Object.keys(feet).sort());
  await sound(page);
});

test('commands in quick succession are done in order', async () => {
  const page = await fresh(), first = await state(page);
  await drag(page, 'root', 0, 60);
  assert.ok(apart((await state(page)).pose.lfoot, first.pose.lfoot) > .5 || apart((await state(page)).pose.root, first.pose.root) > 5);
  // As slow as a program on a busy machine.
  await page.route('**/act', async route => { await new Promise(done => setTimeout(done, 150)); await route.continue(); });
  await page.keyboard.press('Control+z');
  await page.keyboard.press('Shift+P');
  await page.keyboard.press('Control+z');
  await page.keyboard.press('Shift+P');
  await settled(page);
  const { pose, pins } = await state(page);
  assert.ok(farthest(pose, first.pose) < .01);
  assert.ok(pins.lfoot && pins.rtibia);
  for (const name in pins) assert.ok(apart(pins[name], first.pose[name]) < .01, `${name} is pinned where it is after the step back`);
  // A joint that is caught meanwhile follows when the answer is there, with the pins of then.
  await page.keyboard.press('Shift+P');
  await drag(page, 'lwrist', 40, -40);
  const after = await state(page);
  assert.deepEqual(after.pins, {});
  assert.ok(apart(after.pose.lwrist, first.pose.lwrist) > 5);
  await page.unroute('**/act');
  await sound(page);
});

test('what is out of reach says by how much', async () => {
  const page = await fresh();
  await page.locator('#pin-feet').click();
  await settled(page);
  await drag(page, 'rwrist', -600, -300, async () => {
    const { missed } = await state(page);
    assert.ok(missed.rwrist > 5, `missed: ${JSON.stringify(missed)}`);
    assert.match(await page.locator('#warning').textContent(), /right hand cannot reach its place \(\S+ cm away\)/);
    const box = await page.locator('#warning').boundingBox();
    for (const joint of ['rwrist', 'rradius', 'head', 'lfoot', 'rfoot']) {
      const [x, y] = await place(page, joint);
      assert.ok(x < box.x || x > box.x + box.width || y < box.y || y > box.y + box.height, `${joint} is not under the warning`);
    }
  });
  await page.waitForTimeout(100);
  assert.doesNotMatch(await page.locator('#warning').textContent(), /right hand/, 'after the drag, there is no place to reach');
  await sound(page);
});

test('a wide tolerance lets a dragged joint stay away from the pointer', async () => {
  const page = await fresh(), asked = [];
  page.on('request', request => { if (request.url().endsWith('/solve')) asked.push(request.postDataJSON().drags.lwrist.sd); });
  const away = async () => {
    let by;
    await drag(page, 'lwrist', 60, -120, async () => {
      const { moving, pose } = await state(page);
      by = apart(pose.lwrist, moving.lwrist);
      assert.doesNotMatch(await page.locator('#warning').textContent(), /reach/);
    });
    await page.keyboard.press('Control+z');
    await settled(page);
    return by;
  };
  const near = await away();
  await page.locator('#tolerance').fill('1.3');
  assert.equal(await page.locator('#tolerance-words').textContent(), '20 cm');
  const far = await away();
  assert.ok(near < 3 && far > near + 3, `${near} and ${far} cm`);
  assert.deepEqual([...new Set(asked)], [.5, 20]);
  await page.locator('#tolerance').fill('-0.3');
  assert.equal(await page.locator('#tolerance-words').textContent(), '0.5 cm');
  assert.equal(await page.locator('#tolerance').evaluate(slider => slider.style.getPropertyValue('--done')), '0%');
  await sound(page);
});

test('undo and redo of whole gestures', async () => {
  const page = await fresh(), first = await state(page);
  await drag(page, 'lwrist', 60, -60);
  const second = await state(page);
  await drag(page, 'head', 25, 10);
  const third = await state(page);
  const at = async pose => assert.ok(farthest((await state(page)).pose, pose) < .01);
  await page.keyboard.press('Control+z');
  await settled(page);
  await at(second.pose);
  await page.locator('#undo').click();
  await settled(page);
  await at(first.pose);
  await page.keyboard.press('Shift+Control+z');
  await settled(page);
  await at(second.pose);
  await page.locator('#redo').click();
  await settled(page);
  await at(third.pose);
  assert.equal((await state(page)).redo, null);
  await sound(page);
});

test('other poses are shown first, then taken or left', async () => {
  const page = await fresh();
  await page.locator('#pin-feet').click();
  await settled(page);
  await drag(page, 'lwrist', 40, -70);
  const { pose } = await state(page);
  await page.keyboard.press('n');
  await settled(page);
  if (await page.locator('#notice').isVisible()) {
    assert.match(await page.locator('#notice').textContent(), /No other pose/);
    return;
  }
  assert.equal((await state(page)).other, 0);
  assert.ok(farthest((await state(page)).pose, pose) < .01, 'shown only');
  await page.keyboard.press('Escape');
  assert.equal((await state(page)).other, -1);
  await page.keyboard.press('n');
  await settled(page);
  await page.keyboard.press('Enter');
  await settled(page);
  const taken = await state(page);
  assert.ok(farthest(taken.pose, pose) > 4.9);
  // By the button, which has the focus then.
  await page.locator('#others').click();
  await settled(page);
  if ((await state(page)).other === 0) {
    await page.keyboard.press('Escape');
    assert.equal((await state(page)).other, -1);
    await page.locator('#others').click();
    await settled(page);
    await page.keyboard.press('Enter');
    await settled(page);
    assert.equal((await state(page)).other, -1);
    assert.ok(farthest((await state(page)).pose, taken.pose) > 4.9);
  }
  await sound(page);
});

test('mirror, both sides together, a limb that is reset', async () => {
  const page = await fresh();
  await page.keyboard.press('b');
  const before = (await state(page)).pose;
  await drag(page, 'lwrist', 40, -60);
  const { pose } = await state(page);
  assert.ok(apart(pose.rwrist, before.rwrist) > 5 && apart(pose.lwrist, before.lwrist) > 5);
  await page.keyboard.press('b');
  await drag(page, 'lwrist', 30, -30);
  const lopsided = (await state(page)).pose;
  await page.keyboard.press('m');
  await settled(page);
  const mirrored = (await state(page)).pose;
  const high = mirrored.rwrist[1] - mirrored.root[1], was = lopsided.lwrist[1] - lopsided.root[1];
  assert.ok(Math.abs(high - was) < 2, `${high} ${was}`);
  await page.locator('#joint').selectOption('rhumerus');
  await page.locator('#reset-limb').click();
  await settled(page);
  assert.ok((await state(page)).undo);
  await sound(page);
});

test('a pose from a photograph', async () => {
  const page = await fresh(), { pose } = await state(page);
  // A photograph of the present pose from the front, 3 pixels a centimetre; only its marks matter.
  const joints = ['lhipjoint', 'rhipjoint', 'lclavicle', 'rclavicle', 'lfemur', 'rfemur', 'lhumerus', 'rhumerus', 'ltibia', 'rtibia', 'lradius', 'rradius', 'head'];
  const pixel = name => [300 + 3 * (pose[name][0] - pose.root[0]), 400 - 3 * (pose[name][1] - pose.root[1])];
  const picture = await page.evaluate(() => {
    const canvas = document.createElement('canvas');
    [canvas.width, canvas.height] = [600, 800];
    canvas.getContext('2d').fillRect(0, 0, 600, 800);
    return canvas.toDataURL('image/png').split(',')[1];
  });
  await page.setInputFiles('#photo-file', { name: 'person.png', mimeType: 'image/png', buffer: Buffer.from(picture, 'base64') });
  await until(page, () => document.body.classList.contains('in-picture'));
  await page.waitForTimeout(60);
  assert.match(await page.locator('#photo-state').textContent(), /at least 4/);
  for (const name of joints) {
    assert.equal(await page.locator('#marks [aria-pressed=true]').getAttribute('title'), name, 'asked for in turn');
    const [x, y] = await page.evaluate(at => posing.project(at), pixel(name));
    await page.mouse.click(x, y);
    await settled(page);
  }
  const fitted = await state(page);
  assert.equal(Object.keys(fitted.marks).length, joints.length);
  assert.match(await page.locator('#photo-state').textContent(), /The fit is (good|rough|poor) \(\S+ px off\)/);
  for (const name of joints) assert.ok(apart(fitted.picture[name], fitted.marks[name]) < 25, `${name}: ${fitted.picture[name]} ${fitted.marks[name]}`);
  // Another mark by dragging a joint of the fitted body; then it is removed.
  const [x, y] = await page.evaluate(at => posing.project(at), fitted.picture.upperback);
  await page.mouse.move(x, y);
  await page.mouse.down();
  await page.mouse.move(x + 12, y, { steps: 6 });
  await page.mouse.up();
  await settled(page);
  assert.ok((await state(page)).marks.upperback);
  await page.keyboard.press('Delete');
  await settled(page);
  assert.ok(!(await state(page)).marks.upperback);
  await page.locator('#marks [data-joint=lradius]').click();
  await page.locator('#photo-flip').click();
  await settled(page);
  assert.match(await page.locator('#notice').textContent(), /The person's left arm now bends (towards|away from) the camera/);
  await page.locator('#focal').fill('50');
  await settled(page);
  await page.locator('#photo-use').click();
  await settled(page);
  const used = await state(page);
  assert.ok(used.undo);
  await page.locator('#photo-back').click();
  await settled(page);
  await page.locator('#photo-leave').click();
  await settled(page);
  assert.ok(farthest((await state(page)).pose, used.pose) < .01, 'left as it was');
  await sound(page);
});

test('a photograph without enough marks gives no pose; the start poses begin with one of each kind', async () => {
  const page = await fresh();
  const names = await page.locator('#starts button').allTextContents(), kinds = new Set(names.map(name => name.replace(/ \d+$/, '')));
  assert.ok(new Set(names.slice(0, 4).map(name => name.replace(/ 1$/, ''))).size === 4 && kinds.size > 4, names.join());
  const picture = await page.evaluate(() => document.createElement('canvas').toDataURL('image/png').split(',')[1]);
  await page.setInputFiles('#photo-file', { name: 'person.png', mimeType: 'image/png', buffer: Buffer.from(picture, 'base64') });
  await until(page, () => document.body.classList.contains('in-picture'));
  assert.match(await page.locator('#guide').textContent(), /left hip in the picture: on your right/);
  for (const pixel of [[170, 80], [130, 80], [175, 30], [125, 30]]) {
    await page.mouse.click(...await page.evaluate(at => posing.project(at), pixel));
    await settled(page);
  }
  assert.ok(await page.locator('#photo-use').isEnabled());
  await page.keyboard.press('Control+z');
  await settled(page);
  assert.ok(await page.locator('#photo-use').isDisabled());
  assert.equal((await state(page)).picture, null);
  await page.locator('#photo-leave').click();
  await settled(page);
  await sound(page);
});

test('keys, the motion between them, play', async () => {
  const page = await fresh(), high = () => page.locator('.timeline').evaluate(node => node.clientHeight), empty = await high();
  await page.keyboard.press('k');
  await settled(page);
  await drag(page, 'lwrist', 50, -80);
  await page.keyboard.press('k');
  await settled(page);
  let now = await state(page);
  assert.deepEqual(now.keys.map(key => key.time), [0, .5], 'the second key comes after the first');
  const keys = now.keys;
  // In between, the hand is in between.
  await page.locator('#time').fill('0.25');
  await page.locator('#time').press('Tab');
  await until(page, () => posing.state().shown.lwrist[1] !== posing.state().pose.lwrist[1]);
  const [low, top] = keys.map(key => key.pose.lwrist[1]).sort((a, b) => a - b), { shown } = await state(page);
  assert.ok(shown.lwrist[1] > low && shown.lwrist[1] < top, `${low} ${shown.lwrist[1]} ${top}`);
  await page.locator('#play').click();
  const frames = await page.evaluate(() => posing.frames());
  await page.waitForTimeout(500);
  now = await state(page);
  assert.ok(now.playing && await page.evaluate(() => posing.frames()) > frames + 8);
  await page.locator('#play').click();
  await page.keyboard.press('Escape');
  // A card is dragged in time, opened, removed.
  const card = page.locator('#cards button').nth(1), box = await card.boundingBox();
  await page.mouse.move(box.x + 30, box.y + 30);
  await page.mouse.down();
  await page.mouse.move(box.x + 180, box.y + 30, { steps: 10 });
  await page.mouse.up();
  await settled(page);
  now = await state(page);
  assert.ok(now.keys[1].time > .6, `moved to ${now.keys[1].time}`);
  await page.locator('#cards button').first().click();
  await settled(page);
  now = await state(page);
  assert.equal(now.key, 0);
  assert.ok(farthest(now.pose, keys[0].pose) < .01);
  assert.equal(await high(), empty, 'the first key moves nothing');
  // A second Delete does not take the next key.
  await page.locator('#cards button').first().focus();
  await page.keyboard.press('Delete');
  await page.keyboard.press('Delete');
  await settled(page);
  await page.keyboard.press('Delete');
  await settled(page);
  assert.equal((await state(page)).keys.length, 1);
  await sound(page);
});

test('what is saved can be read, a session opens again', async () => {
  const page = await fresh();
  await page.keyboard.press('k');
  await settled(page);
  await drag(page, 'rwrist', -50, -80);
  await page.keyboard.press('k');
  await settled(page);
  const { pose, joints } = await state(page);
  const saved = async button => {
    const [download] = await Promise.all([page.waitForEvent('download'), page.locator('#save').click().then(() => button.click())]);
    assert.ok(await page.locator('#files').isHidden());
    return [download.suggestedFilename(), await readFile(await download.path(), 'utf8')];
  };
  const formats = await page.locator('#save-pose button').evaluateAll(list => list.map(button => button.dataset.format));
  assert.ok(formats.includes('bvh') && formats.includes('csv'));
  for (const [where, several] of [['#save-pose', false], ['#save-motion', true]]) for (const format of formats) {
    const [name, text] = await saved(page.locator(`${where} [data-format=${format}]`));
    assert.equal(name, `pose${several ? '-motion' : ''}.${format}`);
    if (format === 'bvh') {
      assert.match(text, /^HIERARCHY[\s\S]*ROOT \S+[\s\S]*MOTION\s+Frames:\s*\d+/);
      if (several) assert.ok(Number(text.match(/Frames:\s*(\d+)/)[1]) > 10);
    }
    if (format === 'csv') {
      const lines = text.trim().split('\n').filter(line => !line.startsWith('#')), head = lines[0].split(',');
      assert.ok(lines.length > (several ? 10 : 1));
      const column = head.findIndex(cell => /^rwrist[._ ]?x$/i.test(cell));
      assert.ok(column >= 0 && head.length >= 3 * joints.length, lines[0]);
      const cells = lines.at(-1).split(',');
      if (!several) assert.ok(Math.abs(Number(cells[column]) - pose.rwrist[0]) < .1);
    }
  }
  const [name, text] = await saved(page.locator('#save-session'));
  assert.ok(name.endsWith('.json') && JSON.parse(text));
  await page.locator('#starts button').nth(1).click();
  await settled(page);
  await page.setInputFiles('#session-file', { name: 'session.json', mimeType: 'application/json', buffer: Buffer.from(text) });
  await until(page, () => !document.querySelector('#notice').hidden && /Opened/.test(document.querySelector('#notice').textContent));
  const back = await state(page);
  assert.ok(farthest(back.pose, pose) < .01);
  assert.equal(back.keys.length, 2);
  await sound(page);
});

test('by keys alone', async () => {
  const page = await fresh();
  await page.locator('#big').focus();
  await page.keyboard.press('Tab');
  assert.equal((await state(page)).selected, (await state(page)).joints[0]);
  for (let i = 0; i < 30 && (await state(page)).selected !== 'lwrist'; i++) await page.keyboard.press('Tab');
  const before = await state(page);
  assert.equal(before.selected, 'lwrist');
  for (let i = 0; i < 3; i++) await page.keyboard.press('ArrowUp');
  await page.keyboard.press('Shift+ArrowUp');
  await until(page, () => posing.state().moving === null && posing.inFlight() + posing.waiting() === 0);
  await settled(page);
  const up = await state(page);
  assert.ok(Math.abs(up.pose.lwrist[1] - before.pose.lwrist[1] - 13) < .5, `${up.pose.lwrist[1] - before.pose.lwrist[1]} cm up`);
  assert.match(await page.locator('#spoken').textContent(), /left hand 1\d cm up/);
  await page.keyboard.press('p');
  await settled(page);
  assert.ok((await state(page)).pins.lwrist);
  assert.match(await page.locator('#spoken').textContent(), /left hand pinned/);
  await page.keyboard.press('Alt+ArrowUp');
  await until(page, () => posing.state().moving === null && posing.inFlight() + posing.waiting() === 0);
  await page.keyboard.press('Control+z');
  await settled(page);
  await page.keyboard.press('?');
  assert.ok(await page.locator('#keys-help').isVisible());
  await page.keyboard.press('Escape');
  // A typed number.
  await page.locator('#at-y').fill('100');
  await page.locator('#at-y').press('Enter');
  await page.waitForTimeout(900);
  await settled(page);
  assert.ok(Math.abs((await state(page)).pose.lwrist[1] - 100) < 2);
  // The first joint again, and out of the view.
  await page.locator('#big').focus();
  for (let i = 0; i < 40; i++) await page.keyboard.press('Tab');
  assert.notEqual(await page.evaluate(() => document.activeElement.id), 'big', 'Tab is no trap');
  await sound(page);
});

test('touch: one finger drags, a long press pins, two fingers zoom', async () => {
  const page = await fresh({ viewport: { width: 400, height: 850 }, hasTouch: true, isMobile: true });
  const touch = await page.context().newCDPSession(page);
  const send = (type, ...points) => touch.send('Input.dispatchTouchEvent', { type, touchPoints: points.map(([x, y], id) => ({ x, y, id })) });
  const before = await state(page), [x, y] = await place(page, 'lwrist');
  await send('touchStart', [x + 8, y]);
  for (let i = 1; i <= 10; i++) await send('touchMove', [x + 8 + 3 * i, y - 5 * i]);
  await settled(page);
  const { moving } = await state(page), dot = await page.evaluate(at => posing.project(at), moving.lwrist);
  assert.ok(apart(dot, [x + 38, y - 50]) < 1.5, `${dot}`);
  await send('touchEnd');
  await settled(page);
  const dragged = await state(page);
  assert.ok(apart(dragged.pose.lwrist, before.pose.lwrist) > 5);
  const [u, v] = await place(page, 'rwrist');
  await send('touchStart', [u, v]);
  await page.waitForTimeout(700);
  await send('touchEnd');
  await settled(page);
  assert.ok((await state(page)).pins.rwrist, 'a long press pins');
  const wide = async () => apart(await place(page, 'head'), await place(page, 'lfoot'));
  const was = await wide();
  await send('touchStart', [60, 200], [120, 200]);
  for (let i = 1; i <= 8; i++) await send('touchMove', [60 - 2 * i, 200], [120 + 4 * i, 200]);
  await send('touchEnd');
  await page.waitForTimeout(100);
  assert.ok(await wide() > 1.3 * was, 'two fingers zoom');
  await sound(page);
});

test('two tabs: each takes what the other has changed', async () => {
  const one = await fresh(), two = await open(server.address);
  await drag(one, 'lwrist', 40, -60);
  const { pose } = await state(one);
  await until(two, from => Math.hypot(...posing.state().pose.lwrist.map((v, c) => v - from[c])) < .01, pose.lwrist);
  await two.bringToFront();
  await drag(two, 'rwrist', -40, -60);
  const other = await state(two);
  await until(one, from => Math.hypot(...posing.state().pose.rwrist.map((v, c) => v - from[c])) < .01, other.pose.rwrist);
  await sound(one);
  await sound(two);
});

test('the program stops and is started again: the page says so and goes on', async () => {
  const first = await program(), page = await open(first.address, {}, /ERR_CONNECTION_REFUSED|ERR_EMPTY_RESPONSE|ERR_CONNECTION_RESET|401|403/);
  await drag(page, 'lwrist', 40, -70);
  await click(page, 'lfoot');
  await until(page, () => posing.state().kept);
  await page.waitForTimeout(700);
  const { pose } = await state(page);
  await first.stop();
  await until(page, () => /has stopped/.test(document.querySelector('#banner').textContent) && !document.querySelector('#banner').hidden);
  // The view still turns.
  const [x, y] = await place(page, 'lwrist');
  await page.mouse.move(200, 300);
  await page.mouse.down();
  await page.mouse.move(300, 300, { steps: 5 });
  await page.mouse.up();
  await page.waitForTimeout(60);
  assert.ok(apart(await place(page, 'lwrist'), [x, y]) > 3);
  // A joint does not, and nothing else of it.
  const still = await place(page, 'lwrist');
  await page.mouse.move(...still);
  await page.mouse.down();
  await page.mouse.move(still[0] + 80, still[1], { steps: 5 });
  await page.mouse.up();
  await page.waitForTimeout(60);
  assert.ok(apart(await place(page, 'lwrist'), still) < .1);
  await page.locator('#save').click();
  await page.locator('#save-session').click();
  assert.match(await page.locator('#notice').textContent(), /has stopped/);
  await page.keyboard.press('Escape');
  const second = await program(first.port);
  try {
    await page.evaluate(hash => { location.hash = hash; }, new URL(second.address).hash);
    await until(page, () => posing.state().way === 'fine' && document.querySelector('#banner').hidden);
    await settled(page);
    assert.ok(farthest((await state(page)).pose, pose) < .05, 'the pose of before');
    assert.ok((await state(page)).pins.lfoot);
    await drag(page, 'rwrist', -30, -40);
    assert.ok(apart((await state(page)).pose.rwrist, pose.rwrist) > 2, 'and it goes on');
    await sound(page);
  } finally {
    await page.close();
    await second.stop();
  }
});

test('an address without its token says so', async () => {
  const page = await open(server.address);
  await page.goto('about:blank');
  await page.goto(server.address.split('#')[0]);
  await until(page, () => /not complete/.test(document.querySelector('#banner').textContent));
  assert.deepEqual(page.faults, []);
});

for (const [width, height] of [[1400, 900], [400, 850]]) for (const colorScheme of ['light', 'dark'])
  test(`${width} pixels wide, ${colorScheme}`, async () => {
    const page = await fresh({ viewport: { width, height }, colorScheme });
    const measure = () => page.evaluate(() => [document.documentElement.scrollWidth, document.documentElement.clientWidth]);
    let [wide, view] = await measure();
    assert.ok(wide <= view, `${wide} in ${view}`);
    await page.locator('#table-part summary').click();
    [wide, view] = await measure();
    assert.ok(wide <= view, `${wide} in ${view}, with the table`);
    await page.evaluate(() => scrollTo(0, 0));
    if (width < 500) {
      const low = await page.locator('button:visible, select:visible, input[type=number]:visible').evaluateAll(list =>
        list.map(node => [node.id || node.textContent, node.getBoundingClientRect().height]).filter(([, h]) => h < 37.5));
      assert.deepEqual(low, [], 'all is large enough for a finger');
    }
    if (width < 500) {
      await page.evaluate(() => scrollTo(0, 600));
      await page.waitForTimeout(60);
      const undo = await page.locator('#undo').boundingBox();
      assert.ok(undo.y >= 0 && undo.y < 60, 'undo stays in reach');
      await page.evaluate(() => scrollTo(0, 0));
    }
    if (process.env.SHOTS) await page.screenshot({ path: `${process.env.SHOTS}/${width}-${colorScheme}.png` });
    await sound(page);
  });
