// Camera and settings in the fragment of the page's address.
import { LOOK } from './viewer.js';

/** @typedef {import('./camera.js').Camera} Camera */
/** @typedef {import('./gpu.js').Look} Look */

/**
 * All that a link holds but the file.
 * @typedef {object} Settings
 * @property {Look['mode']} mode
 * @property {boolean} contours
 * @property {boolean} filter
 * @property {boolean} colors
 * @property {boolean} normals
 * @property {boolean} beam
 * @property {boolean} shadows
 * @property {'lamp' | 'sun' | 'none'} light
 * @property {number} azimuth Of the sun, in degrees.
 * @property {number} height Of the sun, in degrees.
 * @property {number} pixels Voxels are no smaller than so many pixels; 0.5 to 64.
 * @property {number} resolution In percent.
 * @property {number} fov In degrees.
 * @property {string} up `y`, `-y` and so on.
 * @property {number} budget In MB.
 * @property {'orbit' | 'fly'} movement
 */

/** @type {Settings} */
export const DEFAULTS = {
  mode: 'shaded', contours: true, filter: true, colors: true, normals: true, beam: true, shadows: true, light: 'lamp', azimuth: 40, height: 50, pixels: 1, resolution: 100, fov: 60,
  up: 'y', budget: 256, movement: 'orbit',
};

/** What words a setting can have, and between which numbers it lies. */
const WORDS = {
  mode: ['shaded', 'normals', 'levels', 'voxel-size', 'iterations', 'depth', 'ambient'], light: ['lamp', 'sun', 'none'], up: ['x', 'y', 'z', '-x', '-y', '-z'], movement: ['orbit', 'fly'],
};
const RANGES = { azimuth: [0, 360], height: [0, 90], pixels: [0.5, 64], resolution: [25, 100], fov: [15, 110], budget: [64, 2048] };

/**
 * @param {number} x
 * @param {number} unit What the number is large against.
 */
function short(x, unit) {
  return String(Number(x.toPrecision(unit > 1 ? 9 : 7)));
}

/**
 * @param {Camera | undefined} camera
 * @param {Settings} settings
 * @param {number[] | undefined} target Of an orbit.
 */
export function toFragment(camera, settings, target) {
  const parts = [];
  if (camera) {
    parts.push(`eye=${camera.eye.map((x) => short(x, 2)).join(',')}`, `to=${camera.forward.map((x) => short(x, 1)).join(',')}`);
    if (target && settings.movement === 'orbit') parts.push(`around=${target.map((x) => short(x, 2)).join(',')}`);
  }
  for (const [name, value] of Object.entries(settings)) {
    if (value !== /** @type {any} */ (DEFAULTS)[name]) parts.push(`${name}=${typeof value === 'boolean' ? Number(value) : value}`);
  }
  return parts.join('&');
}

/**
 * Reads a fragment. What it does not know, or what is out of range, is left out.
 * @param {string} fragment Without the number sign.
 */
export function fromFragment(fragment) {
  const from = new URLSearchParams(fragment);
  /** @type {any} */
  const settings = { ...DEFAULTS };
  for (const [name, normal] of Object.entries(DEFAULTS)) {
    const text = from.get(name);
    if (text === null) continue;
    if (typeof normal === 'boolean') settings[name] = text !== '0';
    else if (typeof normal === 'number') {
      const [low, high] = /** @type {any} */ (RANGES)[name];
      const number = Number(text);
      if (text !== '' && number >= low && number <= high) settings[name] = number;
    } else if (/** @type {any} */ (WORDS)[name].includes(text)) settings[name] = text;
  }
  const vector = (/** @type {string} */ name) => {
    const numbers = (from.get(name) ?? '').split(',').map(Number);
    return numbers.length === 3 && from.get(name) !== '' && numbers.every(Number.isFinite) ? numbers : undefined;
  };
  const [eye, forward, target] = [vector('eye'), vector('to'), vector('around')];
  const looks = eye && forward && Math.hypot(...forward) > 0;
  return { settings: /** @type {Settings} */ (settings), camera: looks ? { eye, forward } : undefined, target };
}

/**
 * @param {string} name `y`, `-y` and so on.
 * @returns {number[]}
 */
export function upOf(name) {
  const sign = name.startsWith('-') ? -1 : 1;
  return ['x', 'y', 'z'].map((axis) => (name.endsWith(axis) ? sign : 0));
}

/**
 * The direction to the sun.
 * @param {Settings} settings
 */
export function sunOf({ azimuth, height, up }) {
  const upward = upOf(up);
  const [a, b] = upward[1] !== 0 ? [[0, 0, 1], [1, 0, 0]] : upward[2] !== 0 ? [[1, 0, 0], [0, 1, 0]] : [[0, 1, 0], [0, 0, 1]];
  const [h, z] = [(azimuth * Math.PI) / 180, (height * Math.PI) / 180];
  return upward.map((x, k) => x * Math.sin(z) + Math.cos(z) * (a[k] * Math.cos(h) + b[k] * Math.sin(h)));
}

/**
 * @param {Settings} settings
 * @returns {Look}
 */
export function lookOf(settings) {
  const { mode, contours, filter, colors, normals, beam, light, pixels, shadows } = settings;
  return {
    ...LOOK, mode, contours, filter, colors, normals, beam, maxVoxelPixels: pixels, light: light !== 'none', sun: light === 'sun' ? sunOf(settings) : undefined, shadows: light === 'sun' && shadows,
  };
}
