// What a file says beside its octrees: registered metadata (section 2.3), SHA-256 and id (2.5), instances (3.1).
import { viewOf } from './bytes.js';
import { need } from './errors.js';
import { usable } from './tables.js';

/** @typedef {import('./header.js').Section} Section */

/**
 * An object at a place of the scene.
 * @typedef {object} Instance
 * @property {number} object
 * @property {number[]} meshToScene The upper three rows of a 4 x 4 matrix, by columns.
 */

const INSTANCE = 104;
const HASH = 48;

/**
 * Reads and checks INST: N001 to N004.
 * @param {Uint8Array} bytes
 * @param {number} offset In the file, for errors.
 * @param {number} objects How many the file has.
 * @returns {Instance[]}
 */
export function readInstances(bytes, offset, objects) {
  const count = bytes.length / INSTANCE;
  need(count > 0 && Number.isInteger(count) && count <= 2 ** 23, 'N001', offset, `the table of instances has ${bytes.length} bytes, expected 1 to 2^23 entries of ${INSTANCE}`);
  const view = viewOf(bytes);
  return Array.from({ length: count }, (_, number) => {
    const at = number * INSTANCE;
    const object = view.getUint32(at, true);
    need(object < objects, 'N002', offset + at, `instance ${number}: there is no object ${object}`);
    need(view.getUint32(at + 4, true) === 0, 'N004', offset + at + 4, `instance ${number}: the reserved field is not zero`);
    const meshToScene = Array.from({ length: 12 }, (_, k) => view.getFloat64(at + 8 + 8 * k, true));
    const [a, b, c, d] = [0, 3, 6, 9].map((k) => meshToScene.slice(k, k + 3));
    need(usable([...a, 0, ...b, 0, ...c, 0, ...d, 1]), 'N003', offset + at + 8, `instance ${number}: the matrix is not finite and invertible`);
    return { object, meshToScene };
  });
}

/**
 * Reads HASH: F001.
 * @param {Uint8Array} bytes
 * @param {Section} section
 * @returns {{ sha256: string, id: string }} In hexadecimal digits.
 */
export function readHash(bytes, section) {
  need(bytes.length === HASH && section.flags & 2, 'F001', section.offset, `section HASH has ${bytes.length} bytes and flags ${section.flags}, expected 48 and flag bit 1`);
  return { sha256: hex(bytes.subarray(0, 32)), id: hex(bytes.subarray(32)) };
}

/**
 * Compares the SHA-256 of a file with that in its section HASH: F002.
 * @param {Uint8Array} file
 * @param {{ sha256: string }} hash
 * @param {number} offset Of the section.
 */
export async function checkHash(file, hash, offset) {
  const copy = file.slice();
  copy.fill(0, offset, offset + 32);
  const digest = new Uint8Array(await crypto.subtle.digest('SHA-256', copy));
  need(hex(digest) === hash.sha256, 'F002', offset, 'the SHA-256 of the file differs from that in section HASH');
}

/** @param {Uint8Array} bytes */
const hex = (bytes) => Array.from(bytes, (byte) => byte.toString(16).padStart(2, '0')).join('');

/** @typedef {Record<string, unknown>} Members */
const STRINGS = ['title', 'author', 'license', 'source', 'generator', 'created'];

const isObject = (/** @type {unknown} */ value) => typeof value === 'object' && value !== null && !Array.isArray(value);
const isWhole = (/** @type {unknown} */ value) => Number.isSafeInteger(value) && Number(value) >= 0;
const isPoint = (/** @type {unknown} */ value) => Array.isArray(value) && value.length === 3 && value.every((x) => typeof x === 'number');

/** What the values of members that are neither strings nor lists should be (M003). */
const VALUES = /** @type {Record<string, (value: unknown) => boolean>} */ ({
  unit: (value) => typeof value === 'number' && value > 0,
  up: (value) => typeof value === 'string' && /^[+-][xyz]$/.test(value),
  handedness: (value) => value === 'right' || value === 'left',
  triangles: isWhole,
  cells: isWhole,
  model_voxels: isWhole,
  settings: isObject,
  displacement: isObject,
  attachments: isObject,
});

/** @param {unknown} bounds */
function isBox(bounds) {
  if (!isObject(bounds)) return false;
  const { low, high } = /** @type {{ low: number[], high: number[] }} */ (bounds);
  return isPoint(low) && isPoint(high) && low.every((x, axis) => x <= high[axis]);
}

/**
 * Whether a list has at most so many entries, and all are as section 2.3 lays down (M004).
 * @param {unknown} list
 * @param {number} count
 * @param {boolean} bounds Whether entries may have bounds.
 */
function isList(list, count, bounds) {
  if (!Array.isArray(list) || list.length > count) return false;
  return list.every((entry) => isObject(entry) && (!('name' in entry) || typeof entry.name === 'string')
    && (!('metadata' in entry) || isObject(entry.metadata)) && (!bounds || !('bounds' in entry) || isBox(entry.bounds)));
}

/**
 * The rules of level *should* that metadata break: M002 to M004.
 * @param {Members} meta
 * @param {number} offset Of the section.
 * @param {number} objects How many the file has.
 * @param {number} instances
 * @returns {{ rule: string, offset: number, message: string }[]}
 */
export function checkMembers(meta, offset, objects, instances) {
  /** @type {{ rule: string, offset: number, message: string }[]} */
  const found = [];
  for (const [name, value] of Object.entries(meta)) {
    const add = (/** @type {string} */ rule, /** @type {string} */ what) => found.push({ rule, offset, message: `the value of "${name}" ${what}` });
    if (STRINGS.includes(name)) {
      if (typeof value !== 'string') add('M002', 'is not a string');
    } else if (name === 'objects' || name === 'instances') {
      const of = name === 'objects';
      if (!isList(value, of ? objects : instances, of)) add('M004', 'is not as section 2.3 lays down');
    } else if (Object.hasOwn(VALUES, name) && !VALUES[name](value)) add('M003', 'is not as section 2.3 lays down');
  }
  return found;
}
