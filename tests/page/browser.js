// What the tests share: the program, started anew, and a browser on its page.
import assert from 'node:assert/strict';
import { spawn } from 'node:child_process';
import { createInterface } from 'node:readline';
import { fileURLToPath } from 'node:url';
import { chromium } from 'playwright-core';

const HERE = fileURLToPath(new URL('../../target/release/edit', import.meta.url));
const [PROGRAM, ...BEFORE] = (process.env.POSING_EDIT || HERE).split(' ');
const BROWSER = process.env.CHROMIUM || '/usr/bin/chromium';
const FLAGS = ['--no-sandbox', '--disable-background-networking', '--disable-component-update', '--disable-sync'];

/** Starts the program; `address` is what it prints, `stop` ends it and waits for that. */
export async function program(port = 0) {
  const child = spawn(PROGRAM, [...BEFORE, '--no-open', '--port', String(port)], { stdio: ['ignore', 'pipe', 'inherit'] });
  const ended = new Promise(done => child.once('exit', done));
  const failed = new Promise((_, fail) => {
    child.once('error', fail);
    child.once('exit', code => fail(new Error(`the program ended with ${code} before it printed an address`)));
  });
  failed.catch(() => {});
  const lines = createInterface({ input: child.stdout });
  const address = await Promise.race([new Promise(done => lines.once('line', done)), failed]);
  assert.match(address, /^http:\/\/127\.0\.0\.1:\d+\/#token=\S+$/);
  return { address, port: Number(new URL(address).port), stop: () => { child.kill(); return ended; } };
}

let browser = null;
/** Closes all pages. */
export async function closePages() { for (const context of browser ? browser.contexts() : []) await context.close(); }
export async function closeBrowser() { if (browser) await browser.close(); browser = null; }

/** A page at an address. `faults` collects console errors and exceptions; `expected` is a pattern of those that may be. */
export async function openPage(address, options = {}, expected = null) {
  browser ??= await chromium.launch({ executablePath: BROWSER, args: FLAGS });
  const context = await browser.newContext({ viewport: { width: 1400, height: 900 }, acceptDownloads: true, ...options });
  const page = await context.newPage();
  page.faults = [];
  const note = text => { if (!expected || !expected.test(text)) page.faults.push(text); };
  page.on('console', message => { if (['error', 'warning'].includes(message.type())) note(message.text()); });
  page.on('pageerror', error => note(String(error.stack || error)));
  await page.goto(address);
  return page;
}

/** A page of the program. */
export async function open(address, options, expected) {
  const page = await openPage(address, options, expected);
  await until(page, () => { const { joints } = posing.state(); return joints.length > 0 && !!posing.place(joints[0]); });
  return page;
}

/** Waits until a function is true in the page. (Playwright's own waiting needs eval, which the page forbids.) */
export async function until(page, truth, argument, seconds = 10) {
  for (const end = Date.now() + 1000 * seconds; ;) {
    if (await page.evaluate(truth, argument)) return;
    assert.ok(Date.now() < end, `still false after ${seconds} s: ${truth}`);
    await page.waitForTimeout(25);
  }
}
/** Waits until everything that was asked for is answered. */
export const settled = async page => {
  await page.waitForTimeout(30);
  await until(page, () => posing.inFlight() + posing.waiting() === 0);
  await page.waitForTimeout(30);
};
export const state = page => page.evaluate(() => posing.state());
export async function place(page, joint, second = false) {
  const at = await page.evaluate(([name, small]) => posing.place(name, small), [joint, second]);
  assert.ok(at, `${joint} is drawn`);
  return at;
}
export const apart = (a, b) => Math.hypot(...a.map((v, c) => v - b[c]));
export const farthest = (p, q) => Math.max(...Object.keys(p).map(name => apart(p[name], q[name])));

/** Drags a joint by pixels; `held` is called before the button is released. */
export async function drag(page, joint, dx, dy, held) {
  const [x, y] = await place(page, joint);
  await page.mouse.move(x, y);
  await page.mouse.down();
  await page.mouse.move(x + dx, y + dy, { steps: 30 });
  if (held) { await settled(page); await held(x + dx, y + dy); }
  await page.mouse.up();
  await settled(page);
}
export async function click(page, joint) {
  const [x, y] = await place(page, joint);
  await page.mouse.click(x, y);
  await settled(page);
}
/** No console error, and never more than one request at a time. */
export async function sound(page) {
  assert.deepEqual(page.faults, []);
  assert.equal(await page.evaluate(() => posing.most()), 1);
}
