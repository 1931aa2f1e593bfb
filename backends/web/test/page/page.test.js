// The page in Chromium with its software WebGPU: pictures against those of `esvo render`, servers, damage, devices, controls.
//
// ESVO_PROGRAM names the program that builds the scene and renders; without it, what needs it is skipped. ESVO_REQUIRE_CHROMIUM=1 makes a
// missing browser a failure.
import assert from 'node:assert/strict';
import { execFileSync } from 'node:child_process';
import { existsSync, mkdtempSync, readFileSync, readdirSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { after, before, test } from 'node:test';
import { fileURLToPath } from 'node:url';
import { message, missing, openBrowser, openPage, rest } from '../browser.js';
import { compare } from '../compare.js';
import { serve } from '../server.js';

const VALID = fileURLToPath(new URL('../../../../spec/v1/vectors/valid/', import.meta.url));
const program = process.env.ESVO_PROGRAM ?? '';
const noBrowser = missing();
const skip = noBrowser;
const skipScene = noBrowser || (existsSync(program) ? false : 'ESVO_PROGRAM does not name the program');
const [WIDTH, HEIGHT] = [160, 120];
/** The nave and two more, of the procedural stand-in of SIBENIK. */
const VIEWS = [['-17,1.8,0', '27,2.2,0'], ['3,1.6,-6.4', '-11,2.4,11.4'], ['-6,1.8,0.5', '12,14.2,-0.5']];
/** Another picture of the same octree differs in far more: the negative control below. A pixel whose channels are all within 2 of 255 counts as equal. */
const ALLOWED = { share: 0.001, mean: 0.1 };

const folder = mkdtempSync(join(tmpdir(), 'esvo-page-'));
const scene = join(folder, 'scene.esvo');
/** @type {Record<string, import('../server.js').Served>} */
const files = { 'scene.esvo': { path: scene } };
/** @type {Awaited<ReturnType<typeof serve>>} */
let server;
/** @type {import('puppeteer-core').Browser} */
let browser;

before(async () => {
  if (noBrowser) return;
  if (!skipScene) execFileSync(program, ['build', '--scene', 'SIBENIK', '--stand-in', '--parts', '--levels', '8', '-o', scene], { stdio: 'ignore' });
  server = await serve(files);
  browser = await openBrowser();
});
after(async () => {
  await browser?.close();
  server?.close();
  rmSync(folder, { recursive: true });
});

/**
 * @param {string} file
 * @param {string} [fragment]
 * @param {Parameters<typeof openPage>[2]} [options]
 */
const open = (file, fragment = '', options = {}) => openPage(browser, `${server.origin}/?file=/files/${file}${fragment && `#${fragment}`}`, { width: WIDTH, height: HEIGHT, ...options });

/** @param {import('puppeteer-core').Page} page */
const pixels = (page) => page.evaluate(async (width, height) => Array.from(await /** @type {any} */ (globalThis).esvo.viewer.pixels(width, height)), WIDTH, HEIGHT);

/**
 * The picture of the CPU caster, as the page decodes it.
 * @param {import('puppeteer-core').Page} page
 * @param {string} path
 * @param {string[]} args
 */
async function rendered(page, path, args) {
  const picture = join(folder, 'picture.png');
  execFileSync(program, ['render', path, '-o', picture, '--size', `${WIDTH}x${HEIGHT}`, ...args], { stdio: 'ignore' });
  files['picture.png'] = { path: picture };
  return page.evaluate(async (width, height) => {
    const bitmap = await createImageBitmap(await (await fetch('/files/picture.png')).blob());
    const context = new OffscreenCanvas(width, height).getContext('2d');
    context?.drawImage(bitmap, 0, 0);
    return Array.from(context?.getImageData(0, 0, width, height).data ?? []);
  }, WIDTH, HEIGHT);
}

/** @param {ReturnType<typeof compare>} found @param {string} what */
const isEqual = (found, what) => assert.ok(found.share <= ALLOWED.share && found.mean <= ALLOWED.mean, `${what}: ${JSON.stringify(found)}`);

test('three views equal the pictures of the CPU caster, and do not equal each other', { skip: skipScene }, async () => {
  const seen = [];
  for (const [eye, to] of VIEWS) {
    const { page, errors } = await open('scene.esvo', `eye=${eye}&to=${to}`);
    await rest(page);
    assert.equal(await message(page), '');
    const own = await pixels(page);
    isEqual(compare(own, await rendered(page, scene, [`--camera=${eye},${to}`])), eye);
    for (const [change, args] of /** @type {[object, string[]][]} */ ([
      [{ mode: 'normals' }, ['--view-mode', 'normals']], [{ mode: 'levels' }, ['--view-mode', 'levels']], [{ contours: false, filter: false }, ['--no-contours', '--filter', 'off']],
      [{ mode: 'voxel-size', maxVoxelPixels: 8 }, ['--view-mode', 'voxel-size', '--max-voxel-pixels', '8']],
    ])) {
      await page.evaluate((change) => {
        const { viewer } = /** @type {any} */ (globalThis).esvo;
        viewer.setLook({ mode: 'shaded', contours: true, filter: true, maxVoxelPixels: 1, ...change });
      }, change);
      isEqual(compare(await pixels(page), await rendered(page, scene, [`--camera=${eye},${to}`, ...args])), `${eye} ${args}`);
    }
    seen.push(own);
    assert.deepEqual(errors, []);
    await page.close();
  }
  assert.ok(compare(seen[0], seen[1]).share > 0.5, 'the comparison sees no difference');
});

test('kinds of attributes, transforms and several objects look as the CPU caster draws them', { skip: skipScene }, async () => {
  const names = ['two_objects', 'two_objects_three_blocks', 'corners', 'plain_shared', 'plain_normals_constant_color', 'ambient', 'parts_pages', 'parts_whole', 'transform_sheared'];
  const { page } = await open('nothing');
  for (const name of names) {
    const path = join(VALID, `${name}.esvo`);
    files[name] = { path };
    await page.evaluate((name) => /** @type {any} */ (globalThis).esvo.openFile({ address: `/files/${name}` }), name);
    await rest(page);
    assert.equal(await message(page), '', name);
    const { eye, forward } = await page.evaluate(() => /** @type {any} */ (globalThis).esvo.viewer.camera);
    const found = compare(await pixels(page), await rendered(page, path, [`--camera=${eye},${forward}`]));
    // The sides of cubes that are seen edge on are a matter of the last bit.
    assert.ok(found.share <= 0.004 && found.mean <= 0.3, `${name}: ${JSON.stringify(found)}`);
  }
  await page.close();
});

test('the browser reads every vector', { skip }, async () => {
  const names = readdirSync(VALID).filter((name) => name.endsWith('.esvo'));
  for (const name of names) files[name] = { path: join(VALID, name) };
  const { page } = await openPage(browser, `${server.origin}/viewer/style.css`);
  const failed = await page.evaluate(async (names) => {
    const { openBytes, openSource, httpSource } = await import(/** @type {any} */ ('/reader/src/index.js'));
    const failed = [];
    for (const name of names) {
      try {
        await openBytes(await (await fetch(`/files/${name}`)).arrayBuffer());
        await openSource(httpSource(`/files/${name}`));
      } catch (error) {
        failed.push(`${name}: ${error}`);
      }
    }
    return failed;
  }, names);
  assert.deepEqual(failed, []);
  await page.close();
});

test('a flight over a slow line stays within the budget and ends in the right picture', { skip: skipScene }, async () => {
  files.slow = { path: scene, latency: 50, rate: 200000 };
  const [eye, to] = VIEWS[0];
  const { page, errors } = await open('slow', `eye=${eye}&to=${to}&budget=64`);
  await page.waitForFunction(() => /** @type {any} */ (globalThis).esvo?.viewer.stats);
  const flown = await page.evaluate(async () => {
    const { viewer, controls } = /** @type {any} */ (globalThis).esvo;
    const budget = 6 << 20;
    viewer.budget = budget;
    viewer.open(viewer.from);
    const pause = () => new Promise((resolve) => setTimeout(resolve, 40));
    let [most, missing, frames] = [0, 0, viewer.frames];
    for (let k = 0; k < 120 || !viewer.atRest; k++) {
      await pause();
      if (viewer.firstPicture !== undefined && !missing) missing = viewer.stats.missing;
      if (missing && k < 120) controls.walk([0, 0, 1], 2, 0.04);
      most = Math.max(most, (viewer.stats?.used ?? 0) + (viewer.stats?.kept ?? 0));
    }
    return { most, missing, budget, frames: viewer.frames - frames, length: viewer.stats.bytes, eye: viewer.camera.eye };
  });
  assert.ok(flown.most <= flown.budget, JSON.stringify(flown));
  // There was a picture while parts were missing, and frames while they came.
  assert.ok(flown.missing > 0 && flown.frames > 5, JSON.stringify(flown));
  // The budget is less than the picture takes: it is coarser. With more, it is the right one.
  await page.evaluate(() => {
    const { viewer } = /** @type {any} */ (globalThis).esvo;
    viewer.budget = 256 << 20;
    viewer.open({ address: new URL('/files/scene.esvo', location.href).href });
  });
  await rest(page);
  isEqual(compare(await pixels(page), await rendered(page, scene, [`--camera=${flown.eye},${to}`])), 'after the flight');
  assert.deepEqual(errors, []);
  await page.close();
});

test('damage, cut files and other files are named', { skip }, async () => {
  const levels = join(VALID, 'parts_levels.esvo');
  const size = readFileSync(levels).length;
  files.damaged = { path: levels, damage: (bytes, offset) => void (offset <= 3000 && offset + bytes.length > 3000 && (bytes[3000 - offset] ^= 1)) };
  files['cut.esvo'] = { path: join(folder, 'cut.esvo') };
  writeFileSync(files['cut.esvo'].path, readFileSync(levels).subarray(0, size - 200));
  files['note.txt'] = { path: join(folder, 'note.txt') };
  writeFileSync(files['note.txt'].path, 'This is no octree. '.repeat(20));
  for (const [name, expected] of /** @type {[string, RegExp][]} */ ([
    ['damaged', /damaged: its checksum differs.*S004/], ['cut.esvo', /was cut.*H004/], ['note.txt', /not an esvo file/], ['nothing', /is not there: the server answered 404/],
  ])) {
    const { page } = await open(name);
    await rest(page);
    assert.match(await message(page), expected);
    await page.close();
  }
});

test('a server without ranges', { skip }, async () => {
  files.whole = { path: join(VALID, 'parts_levels.esvo'), noRanges: true };
  server.log.requests = 0;
  const { page } = await open('whole');
  await rest(page);
  assert.equal(await message(page), '');
  assert.match(String(await page.$eval('#about', (element) => element.textContent)), /no range requests/);
  assert.equal(server.log.requests, 1);
  await page.close();
});

test('a lost device: the page says so, and goes on with camera and settings', { skip }, async () => {
  files.levels = { path: join(VALID, 'parts_levels.esvo') };
  const { page } = await open('levels', 'mode=levels&pixels=2');
  await rest(page);
  const former = await pixels(page);
  await page.evaluate(() => /** @type {any} */ (globalThis).esvo.viewer.renderer.device.destroy());
  await page.waitForFunction(() => document.getElementById('message')?.hidden === false);
  assert.match(await message(page), /device was lost/);
  await page.click('#again');
  await page.waitForFunction(() => /** @type {any} */ (globalThis).esvo.viewer.renderer?.drawn);
  await rest(page);
  assert.equal(await message(page), '');
  assert.equal(compare(former, await pixels(page)).most, 0);
  await page.close();
});

test('a browser without WebGPU, and one without a device', { skip }, async () => {
  const { page } = await open('levels', '', { before: () => Object.defineProperty(navigator, 'gpu', { value: undefined }) });
  await rest(page);
  assert.match(await message(page), /This browser has no WebGPU/);
  await page.close();
  const { page: other } = await open('levels', '', { before: () => Object.defineProperty(navigator, 'gpu', { value: { requestAdapter: async () => null, getPreferredCanvasFormat: () => 'bgra8unorm' } }) });
  await rest(other);
  assert.match(await message(other), /no graphics device/);
  await other.close();
});

test('a link holds camera and settings', { skip }, async () => {
  files.levels = { path: join(VALID, 'parts_levels.esvo') };
  const { page } = await open('levels', '', { width: 340, height: 240 });
  await rest(page);
  await page.click('#settings');
  await page.click('input[name="contours"]');
  await page.select('select[name="mode"]', 'normals');
  await page.evaluate(() => /** @type {any} */ (globalThis).esvo.controls.turn(0.3, 0.2));
  await rest(page);
  const [link, here] = [await page.evaluate(() => /** @type {any} */ (globalThis).esvo.link()), await pixels(page)];
  assert.match(link, /file=\/files\/levels#eye=.*&mode=normals&contours=0/);
  await page.close();
  const { page: other } = await openPage(browser, link, { width: 340, height: 240 });
  await rest(other);
  const found = compare(here, await pixels(other));
  assert.ok(found.share < 0.001, JSON.stringify(found));
  await other.close();
});

test('keys, mouse and touch move the camera', { skip }, async () => {
  const { page } = await open('levels', '', { touch: true });
  await rest(page);
  const camera = () => page.evaluate(() => /** @type {any} */ (globalThis).esvo.viewer.camera);
  const moves = async (/** @type {string} */ what, /** @type {() => Promise<unknown>} */ act) => {
    const before = await camera();
    await act();
    let now = await camera();
    for (let k = 0; k < 100 && JSON.stringify(now) === JSON.stringify(before); k++) {
      await new Promise((resolve) => setTimeout(resolve, 50));
      now = await camera();
    }
    assert.notDeepEqual([before.eye, before.forward], [now.eye, now.forward], what);
  };
  await page.focus('#view');
  for (const key of /** @type {const} */ (['ArrowLeft', 'ArrowUp', 'w', 'd', '+'])) {
    await moves(key, async () => {
      await page.keyboard.down(key);
      await new Promise((resolve) => setTimeout(resolve, 120));
      await page.keyboard.up(key);
    });
  }
  await moves('wheel', () => page.mouse.wheel({ deltaY: 100 }));
  await moves('drag', async () => {
    await page.mouse.move(60, 50);
    await page.mouse.down();
    await page.mouse.move(100, 60, { steps: 3 });
    await page.mouse.up();
  });
  await moves('show all', () => page.keyboard.press('h'));
  await moves('two fingers', async () => {
    const [a, b] = [await page.touchscreen.touchStart(60, 50), await page.touchscreen.touchStart(90, 50)];
    await b.move(130, 50);
    await a.end();
    await b.end();
  });
  await page.keyboard.press('2');
  assert.equal(await page.$eval('#fly', (element) => element.getAttribute('aria-checked')), 'true');
  await moves('flight', () => page.mouse.wheel({ deltaY: -100 }));
  await page.close();
});

test('a picture is saved, and every control has a name', { skip }, async () => {
  const { page } = await open('levels', '', { width: 340, height: 240 });
  await rest(page);
  await page.evaluate(() => {
    HTMLAnchorElement.prototype.click = function () {
      /** @type {any} */ (globalThis).saved = [this.download, this.href];
    };
  });
  await page.click('#save');
  await page.waitForFunction(() => /** @type {any} */ (globalThis).saved);
  const [name, size] = await page.evaluate(async () => {
    const [name, href] = /** @type {any} */ (globalThis).saved;
    const bitmap = await createImageBitmap(await (await fetch(href)).blob());
    return [name, [bitmap.width, bitmap.height]];
  });
  assert.deepEqual([name, size], ['levels.png', [340, 240]]);
  await page.click('#settings');
  const tree = await page.accessibility.snapshot({ interestingOnly: true });
  /** @type {unknown[]} */
  const nameless = [];
  const visit = (/** @type {any} */ node) => {
    if (['button', 'radio', 'checkbox', 'slider', 'combobox', 'textbox', 'application', 'Canvas'].includes(node.role) && !node.name) nameless.push(node);
    node.children?.forEach(visit);
  };
  visit(tree);
  assert.deepEqual(nameless, []);
  assert.ok(JSON.stringify(tree).includes('Field of view'));
  await page.close();
});
