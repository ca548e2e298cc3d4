// The page of `posing plot` in a browser: curves of a joint, and the list of gaps.
import assert from 'node:assert/strict';
import { spawnSync } from 'node:child_process';
import { mkdtempSync, rmSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { after, afterEach, test } from 'node:test';
import { fileURLToPath, pathToFileURL } from 'node:url';
import { closeBrowser, closePages, openPage, until } from './browser.js';

const PROGRAM = process.env.POSING_PLOT || fileURLToPath(new URL('../../target/release/plot', import.meta.url));
const folder = mkdtempSync(join(tmpdir(), 'plot-page-'));
afterEach(closePages);
after(async () => { await closeBrowser(); rmSync(folder, { recursive: true }); });

/** The gaps of the take: point, first frame, frames, method, standard deviation. */
const GAPS = [['b', 40, 20, 'pchip', .5], ['a', 100, 50, 'regression', .2], ['c', 0, 10, '', NaN]];
const FRAMES = 1000;

/** A take of three points at 100 frames a second; without `told`, gaps are empty cells and there are no other columns. */
function table(told) {
  const names = ['a', 'b', 'c'], rows = [];
  for (let t = 0; t < FRAMES; t++) {
    const cells = [t / 100];
    for (const [p, name] of names.entries()) {
      const gap = GAPS.find(([point, first, long]) => point === name && t >= first && t < first + long);
      const filled = gap && gap[3], place = [p * 20 + t / 50, 50 + 10 * Math.sin(t / 20), p * 5];
      cells.push(...(gap && !(told && filled) ? ['', '', ''] : place));
      if (told) cells.push(...(!gap ? ['observed', .01, ''] : filled ? ['inferred', gap[4], filled] : ['unknown', '', '']));
    }
    rows.push(cells.join(','));
  }
  const columns = ['x', 'y', 'z', ...(told ? ['status', 'sd', 'method'] : [])];
  return [['time', ...names.flatMap(name => columns.map(column => `${name}.${column}`))].join(','), ...rows, ''].join('\n');
}

/** The page of a table. */
async function open(text, options) {
  const file = join(folder, `${Math.random()}.html`);
  const done = spawnSync(PROGRAM, ['-q', '--bones', 'a-b,b-c', '-o', file], { input: text, encoding: 'utf8' });
  assert.equal(done.status, 0, done.stderr);
  // The tests read the pixels, which the browser remarks on.
  const page = await openPage(String(pathToFileURL(file)), options, /willReadFrequently/);
  await until(page, () => !!document.querySelector('.clock').textContent);
  return page;
}
const clock = page => page.locator('.clock small').textContent();
const rows = page => page.locator('.gaps tbody tr').evaluateAll(list => list.map(row => [...row.cells].map(cell => cell.textContent)));
/** Waits until the frame of this number is shown. */
const shows = (page, frame) => until(page, wanted => document.querySelector('.clock small').textContent === `frame ${wanted}`, frame);
/** The pixels of the curves, as one number. */
const drawn = page => page.locator('.plot').evaluate(canvas => {
  const { data } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
  return data.reduce((sum, v) => (sum * 31 + v) % 1e9, 0);
});
async function redrawn(page, before) {
  for (let i = 0; i < 100 && await drawn(page) === before; i++) await page.waitForTimeout(20);
  assert.notEqual(await drawn(page), before);
}

test('gaps are listed, the longest first, and sorted by a click', async () => {
  const page = await open(table(true));
  assert.deepEqual(await rows(page), [
    ['a', '1.00 s', '100', '0.50 s', '50', 'regression', '0.20 cm'],
    ['b', '0.40 s', '40', '0.20 s', '20', 'pchip', '0.50 cm'],
    ['c', '0.00 s', '0', '0.10 s', '10', 'not filled', '–'],
  ]);
  const points = async () => (await rows(page)).map(row => row[0]).join('');
  await page.getByRole('button', { name: 'sd' }).click();
  assert.equal(await points(), 'bac', 'the least sure first');
  await page.getByRole('button', { name: 'sd' }).click();
  assert.equal(await points(), 'abc', 'what has no deviation stays last');
  await page.getByRole('button', { name: 'Start' }).click();
  assert.equal(await points(), 'cba');
  assert.deepEqual(page.faults, []);
});

test('a gap that is clicked shows its joint a little before it', async () => {
  const page = await open(table(true));
  assert.equal(await page.locator('select.joint').inputValue(), '0', 'at first, the joint of the longest gap');
  const before = await drawn(page);
  await page.locator('.gaps tbody tr').nth(1).click();
  await shows(page, 10);
  assert.equal(await page.locator('select.joint').inputValue(), '1');
  assert.equal(await page.locator('select.trail').inputValue(), '1');
  assert.equal(await page.locator('select.span').inputValue(), '2', 'a short gap is shown larger');
  await redrawn(page, before);
  await page.keyboard.press('ArrowRight');
  await shows(page, 11);
  await page.keyboard.press('End');
  await shows(page, FRAMES - 1);
  assert.deepEqual(page.faults, []);
});

test('the list and the choice of a joint work by keyboard', async () => {
  const page = await open(table(true));
  await page.locator('.gaps tbody button').first().focus();
  await page.keyboard.press('ArrowDown');
  await page.keyboard.press('Enter');
  await shows(page, 10);
  await page.keyboard.press('ArrowUp');
  await page.keyboard.press('Enter');
  await shows(page, 70);
  const before = await drawn(page);
  await page.locator('select.joint').focus();
  await page.keyboard.press('c');
  await redrawn(page, before);
  assert.equal(await page.locator('select.joint').inputValue(), '2');
  assert.equal(await clock(page), 'frame 70');
  assert.deepEqual(page.faults, []);
});

test('a click or drag in the curves moves the time', async () => {
  const page = await open(table(false)), box = await page.locator('.plot').boundingBox();
  const before = await drawn(page), middle = box.y + box.height / 2;
  await page.mouse.click(box.x + box.width / 2, middle);
  const frame = async () => parseInt((await clock(page)).slice(6), 10);
  await until(page, () => document.querySelector('.clock small').textContent !== 'frame 0');
  assert.ok(Math.abs(await frame() - 499.5) < 3);
  await page.mouse.down();
  await page.mouse.move(box.x + 2 * box.width, middle, { steps: 5 });
  await page.mouse.up();
  await shows(page, FRAMES - 1);
  assert.equal(await drawn(page), before, 'the curves are not drawn anew for that');
  assert.deepEqual(page.faults, []);
});

test('a part of the take goes on with the time', async () => {
  const page = await open(table(false));
  await page.locator('select.span').selectOption('2');
  await page.waitForTimeout(100);
  const before = await drawn(page);
  await page.keyboard.press('End');
  await redrawn(page, before);
  assert.deepEqual(page.faults, []);
});

test('empty cells alone are gaps, a take without any has no list', async () => {
  const page = await open(table(false));
  assert.deepEqual(await rows(page), [
    ['a', '1.00 s', '100', '0.50 s', '50'], ['b', '0.40 s', '40', '0.20 s', '20'], ['c', '0.00 s', '0', '0.10 s', '10'],
  ]);
  const whole = await open('time,a.x,a.y,a.z,b.x,b.y,b.z,c.x,c.y,c.z\n0,1,2,3,4,5,6,7,8,9\n0.1,2,3,4,5,6,7,8,9,1\n');
  assert.ok(!await whole.locator('.gaps').isVisible());
  assert.ok(await whole.locator('.plot').isVisible());
  const halted = await open('time,a.x,a.y,a.z,b.x,b.y,b.z,c.x,c.y,c.z\n0,1,2,3,4,5,6,7,8,9\n0.1,,,,,,,,,\n');
  assert.equal((await rows(halted)).length, 3);
  assert.deepEqual([...page.faults, ...whole.faults, ...halted.faults], []);
});

test('nothing is wider than a narrow screen', async () => {
  const page = await open(table(true), { viewport: { width: 400, height: 800 } });
  const wide = await page.evaluate(() => [document.documentElement, document.querySelector('.gaps .rows')].map(e => e.scrollWidth - e.clientWidth));
  assert.deepEqual(wide, [0, 0]);
});
