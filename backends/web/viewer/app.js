// The page: controls, settings, links and messages around a viewer.
import { extent } from './camera.js';
import { Controls } from './controls.js';
import { GpuError } from './gpu.js';
import { DEFAULTS, fromFragment, lookOf, toFragment, upOf } from './link.js';
import { Viewer } from './viewer.js';

/** @typedef {import('./link.js').Settings} Settings */

/** @template {HTMLElement} T @param {string} id @returns {T} */
const find = (id) => /** @type {T} */ (/** @type {unknown} */ (document.getElementById(id)));
const canvas = /** @type {HTMLCanvasElement} */ (find('view'));
const form = /** @type {HTMLFormElement} */ (find('form'));
const [name, loading, line, numbers, about, panel] = ['name', 'loading', 'line', 'numbers', 'about', 'panel'].map((id) => find(id));
const start = /** @type {HTMLDialogElement} */ (find('start'));
const keys = /** @type {HTMLDialogElement} */ (find('keys'));

const parsed = fromFragment(location.hash.slice(1));
let settings = parsed.settings;
/** @type {string | undefined} */
let address = new URLSearchParams(location.search).get('file') ?? document.documentElement.dataset.file ?? undefined;
/** @type {{ address?: string, file?: Blob } | undefined} */
let from;

const viewer = new Viewer(canvas, {
  opened({ objects, whole, inParts, length }) {
    const voxels = objects.reduce((sum, { leafVoxels }) => sum + leafVoxels, 0);
    const levels = Math.max(...objects.map((object) => object.levels));
    facts = [`${objects.length > 1 ? `${objects.length} objects, ` : ''}${levels} levels, ${count(voxels)} voxels, ${megabytes(length)}`];
    if (whole) facts.push('The server answers no range requests: the whole file was read at once.');
    else if (!inParts) facts.push('The file is not stored in parts by level, so whole blocks are read. `esvo convert --parts` makes one that streams well.');
    about.textContent = facts.join('\n');
    if (viewer.hasCamera) placed();
  },
  placed,
  meta(meta) {
    const text = (/** @type {string} */ key) => (typeof meta[key] === 'string' ? String(meta[key]).slice(0, 300) : undefined);
    const title = text('title');
    if (title) setName(title);
    const credit = [text('author'), text('license')].filter(Boolean).join(', ');
    about.textContent = [...facts, ...(credit ? [credit] : [])].join('\n');
  },
  error: (message) => complain(message, true),
  lost(message) {
    complain(`The graphics device was lost${message ? ` (${message.slice(0, 200)})` : ''}: its driver was reset, or another program took it. Camera and settings are kept.`, true, 'Start again');
  },
  frame: () => showNumbers(),
});
/** @type {string[]} */
let facts = [];
const controls = new Controls(viewer, { moved: () => remember() });
controls.movement = settings.movement;

/** @param {number} bytes */
function megabytes(bytes) {
  return bytes < 999500 ? `${Math.round(bytes / 1000)} kB` : bytes < 999.5e6 ? `${(bytes / 1e6).toPrecision(3)} MB` : `${(bytes / 1e9).toPrecision(3)} GB`;
}

/** @param {number} number */
function count(number) {
  return number < 1e4 ? String(number) : number < 999500 ? `${Math.round(number / 1000)} thousand` : number < 999.5e6 ? `${(number / 1e6).toPrecision(3)} million` : `${(number / 1e9).toPrecision(3)} billion`;
}

/** @param {string} text */
function setName(text) {
  name.textContent = text;
  document.title = `${text} - esvo viewer`;
}

/** The first camera of a file is there. */
function placed() {
  const boxes = viewer.allBoxes;
  const { transforms } = viewer;
  const all = boxes.length ? boxes : transforms.map((_, object) => ({ object, low: [0, 0, 0], high: [1, 1, 1] }));
  if (!all.length) return;
  const { centre, radius } = extent(transforms, all);
  controls.placed(parsed.target ?? (boxes.length ? centre : undefined), radius);
  parsed.target = undefined;
}

/** @type {ReturnType<typeof setTimeout> | undefined} */
let rememberTimer;

/** Puts camera and settings into the address of the page, a little later. */
function remember() {
  clearTimeout(rememberTimer);
  rememberTimer = setTimeout(() => history.replaceState(null, '', link()), 250);
}

function link() {
  const fragment = toFragment(viewer.hasCamera ? viewer.camera : undefined, settings, controls.target);
  const query = address === undefined ? '' : `?file=${encodeURIComponent(address).replaceAll('%2F', '/').replaceAll('%3A', ':')}`;
  return `${location.origin}${location.pathname}${query}${fragment ? `#${fragment}` : ''}`;
}

/**
 * @param {string} message
 * @param {boolean} again Whether it may help to try again.
 * @param {string} [word] On the button for that.
 */
function complain(message, again, word = 'Try again') {
  const box = find('message');
  const text = box.querySelector('p');
  if (text) text.textContent = /[.?!)]$/.test(message) ? message : `${message}.`;
  find('again').textContent = word;
  find('again').hidden = !again;
  box.hidden = false;
  loading.textContent = '';
}

/** @type {ReturnType<typeof setTimeout> | undefined} */
let toastTimer;

/** @param {string} text */
function toast(text) {
  const box = find('toast');
  box.textContent = text;
  box.classList.add('on');
  clearTimeout(toastTimer);
  toastTimer = setTimeout(() => box.classList.remove('on'), 2200);
}

let numbersAt = 0;
/** @type {ReturnType<typeof setTimeout> | undefined} */
let numbersTimer;

function showNumbers() {
  const now = performance.now();
  clearTimeout(numbersTimer);
  if (now - numbersAt < 200) {
    numbersTimer = setTimeout(showNumbers, 200);
    return;
  }
  numbersAt = now;
  const { stats, renderer, size, frameTime } = viewer;
  if (!stats || !renderer) return;
  const missing = stats.missing + viewer.batches.length;
  // Without numbers: screen readers say it once.
  const status = missing && !viewer.settled ? 'loading' : '';
  if (loading.textContent !== status) loading.textContent = status;
  const time = `${frameTime < 10 ? frameTime.toFixed(1) : Math.round(frameTime)} ms`;
  line.innerHTML = '';
  const parts = [[time, ' a frame'], [megabytes(stats.bytes), ''], [String(stats.parts), ` of ${stats.known} parts`], [String(stats.requests), ' requests']];
  parts.forEach(([strong, soft], k) => {
    const b = document.createElement('b');
    b.textContent = strong;
    line.append(k ? ' \u00b7 ' : '', b, soft);
  });
  if (panel.hidden) return;
  const rows = {
    'Frame': time, 'Picture': `${size[0]} x ${size[1]}`, 'Read': megabytes(stats.bytes), 'Requests': String(stats.requests), 'Parts shown': `${stats.parts} of ${stats.known} known`,
    'Parts on the way': String(stats.missing), 'Memory': `${megabytes(stats.used + stats.kept)} of ${megabytes(viewer.budget)}`,
    'Finest voxels': `${Math.max(stats.limit, 0.5).toPrecision(2)} pixels`, 'Device': renderer.name,
  };
  numbers.replaceChildren(...Object.entries(rows).flatMap(([term, value]) => {
    const [dt, dd] = [document.createElement('dt'), document.createElement('dd')];
    dt.textContent = term;
    dd.textContent = value;
    return [dt, dd];
  }));
}

/** Shows the settings in the form. */
function fillForm() {
  const field = (/** @type {string} */ key) => /** @type {HTMLInputElement} */ (form.elements.namedItem(key));
  for (const [key, value] of Object.entries(settings)) {
    const element = field(key);
    if (!element) continue;
    if (element.type === 'checkbox') element.checked = Boolean(value);
    else element.value = key === 'pixels' ? String(Math.log2(Number(value))) : String(value);
  }
  const out = { pixels: `${Number(settings.pixels.toPrecision(2))} px`, resolution: `${settings.resolution} %`, fov: `${settings.fov}\u00b0`, azimuth: `${settings.azimuth}\u00b0`, height: `${settings.height}\u00b0` };
  for (const [key, text] of Object.entries(out)) find(`${key}-out`).textContent = text;
  find('sun-rows').hidden = settings.light !== 'sun';
  for (const movement of ['orbit', 'fly']) find(movement).setAttribute('aria-checked', String(settings.movement === movement));
}

/** Makes the settings those of the viewer. */
function applySettings() {
  controls.up = upOf(settings.up);
  controls.setMovement(settings.movement);
  viewer.resolution = settings.resolution / 100;
  viewer.setLook(lookOf(settings));
  if (viewer.camera.fov !== settings.fov || viewer.camera.up.some((x, k) => x !== controls.up[k])) {
    const change = { fov: settings.fov, up: controls.up };
    if (viewer.hasCamera) viewer.setCamera(change);
    else Object.assign(viewer.camera, change);
  }
  fillForm();
  remember();
}

form.addEventListener('input', () => {
  const before = settings;
  const data = new FormData(form);
  /** @type {any} */
  const next = { ...settings };
  for (const [key, normal] of Object.entries(DEFAULTS)) {
    if (!form.elements.namedItem(key)) continue;
    const value = data.get(key);
    next[key] = typeof normal === 'boolean' ? value !== null : typeof normal === 'number' ? (key === 'pixels' ? 2 ** Number(value) : Number(value)) : value;
  }
  settings = next;
  applySettings();
  if (settings.up !== before.up) viewer.showAll();
  if (settings.budget !== before.budget && from) openFile(from);
});

/** @param {Settings['movement']} movement */
function setMovement(movement) {
  settings = { ...settings, movement };
  applySettings();
  toast(movement === 'fly' ? 'Fly: drag to look, W A S D to move' : 'Orbit: drag to turn, double click to go to a point');
}

/** @param {{ address?: string, file?: Blob }} what */
function openFile(what) {
  from = what;
  address = what.address;
  find('message').hidden = true;
  const path = what.file instanceof File ? what.file.name : decodeURIComponent(String(what.address).split(/[?#]/)[0].split('/').pop() ?? '') || 'esvo viewer';
  setName(path.replace(/\.esvo$/, ''));
  loading.textContent = 'opening';
  about.textContent = '';
  viewer.budget = settings.budget * 1e6;
  const full = what.address === undefined ? what : { address: new URL(what.address, location.href).href };
  viewer.open(full);
  canvas.focus({ preventScroll: true });
}

/** @param {{ address?: string, file?: Blob }} what */
function openOther(what) {
  viewer.hasCamera = false;
  openFile(what);
  remember();
}

function toggleSettings(shown = panel.hidden) {
  panel.hidden = !shown;
  find('settings').setAttribute('aria-expanded', String(shown));
  numbersAt = 0;
  showNumbers();
}

async function share() {
  history.replaceState(null, '', link());
  if (from?.file) {
    toast('The file is on this device only: a link cannot hold it');
    return;
  }
  try {
    await navigator.clipboard.writeText(link());
    toast('Link copied: it holds the file, the camera and the settings');
  } catch {
    toast('The link is in the address line');
  }
}

async function savePicture() {
  try {
    const [width, height] = [canvas.width, canvas.height];
    const pixels = await viewer.pixels(width, height);
    const own = document.createElement('canvas');
    [own.width, own.height] = [width, height];
    own.getContext('2d')?.putImageData(new ImageData(pixels, width, height), 0, 0);
    const blob = await new Promise((resolve) => own.toBlob(resolve, 'image/png'));
    if (!blob) throw new Error('the browser made no picture');
    const a = document.createElement('a');
    a.href = URL.createObjectURL(blob);
    a.download = `${name.textContent || 'esvo'}.png`;
    a.click();
    setTimeout(() => URL.revokeObjectURL(a.href), 10000);
    toast(`Saved: ${width} x ${height} pixels`);
  } catch (error) {
    complain(`The picture cannot be saved: ${error instanceof Error ? error.message : error}`, false);
  }
}

/** @type {Record<string, () => void>} */
const actions = {
  orbit: () => setMovement('orbit'), fly: () => setMovement('fly'), home: () => { viewer.showAll(); remember(); }, share, save: savePicture,
  full: () => (document.fullscreenElement ? document.exitFullscreen() : document.documentElement.requestFullscreen()), help: () => keys.showModal(),
  settings: () => toggleSettings(), open: () => start.showModal(), dismiss: () => (find('message').hidden = true), again: () => restart(),
};
for (const [id, action] of Object.entries(actions)) find(id).addEventListener('click', action);

/** @type {Record<string, string>} */
const shortcuts = { 1: 'orbit', 2: 'fly', h: 'home', l: 'share', p: 'save', f: 'full', '?': 'help', ',': 'settings', o: 'open' };
addEventListener('keydown', (event) => {
  const typing = event.target instanceof HTMLInputElement || event.target instanceof HTMLSelectElement;
  if (event.ctrlKey || event.metaKey || event.altKey || typing || start.open || keys.open) return;
  const key = event.key.toLowerCase();
  if (key === 'escape' && !panel.hidden) toggleSettings(false);
  if (key === 'n') document.body.classList.toggle('bare');
  if (shortcuts[key]) {
    event.preventDefault();
    actions[shortcuts[key]]();
  }
});

find('start-form').addEventListener('submit', () => {
  const text = /** @type {HTMLInputElement} */ (find('address')).value.trim();
  if (text) openOther({ address: text });
});
find('file').addEventListener('change', (event) => {
  const file = /** @type {HTMLInputElement} */ (event.target).files?.[0];
  if (file) openOther({ file });
  start.close();
});
addEventListener('dragover', (event) => {
  event.preventDefault();
  document.body.classList.add('drop');
});
addEventListener('dragleave', () => document.body.classList.remove('drop'));
addEventListener('drop', (event) => {
  event.preventDefault();
  document.body.classList.remove('drop');
  const file = event.dataTransfer?.files[0];
  start.close();
  if (file) openOther({ file });
});
addEventListener('hashchange', () => {
  const next = fromFragment(location.hash.slice(1));
  settings = next.settings;
  applySettings();
  if (next.camera) viewer.setCamera(next.camera);
  if (next.target) controls.target = next.target;
});

/** The canvas has the pixels of the screen. */
function resize() {
  const ratio = devicePixelRatio || 1;
  const most = viewer.renderer?.device.limits.maxTextureDimension2D ?? 8192;
  const [width, height] = [canvas.clientWidth, canvas.clientHeight].map((x) => Math.min(Math.max(Math.round(x * ratio), 1), most));
  if (canvas.width !== width || canvas.height !== height) {
    canvas.width = width;
    canvas.height = height;
    viewer.resized();
  }
}
new ResizeObserver(resize).observe(canvas);

/** Opens the device, and the file anew if there was one. */
async function restart() {
  find('message').hidden = true;
  try {
    if (!viewer.renderer) await viewer.start();
  } catch (error) {
    complain(error instanceof GpuError ? error.message : `The page cannot start: ${error instanceof Error ? error.message : error}`, true);
    return;
  }
  resize();
  if (from) openFile(from);
}

async function main() {
  if (parsed.camera) {
    Object.assign(viewer.camera, parsed.camera, { fov: settings.fov, up: upOf(settings.up) });
    viewer.hasCamera = true;
  }
  resize();
  applySettings();
  if (address !== undefined) from = { address };
  await restart();
  if (address === undefined && viewer.renderer) start.showModal();
}

// What tests drive.
Object.assign(globalThis, { esvo: { viewer, controls, openFile: openOther, link } });
await main();
