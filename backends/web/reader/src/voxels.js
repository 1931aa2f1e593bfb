// Voxels of a level as arrays, for programs that draw cubes.
import { openSource } from './served.js';
import { httpSource } from './source.js';
import { childPosition } from './octree.js';
import { Block } from './block.js';
import { BITS } from './bytes.js';
import { EsvoError } from './errors.js';
import { attributesOf } from './values.js';
import { NO_PARENT } from './tables.js';

/** @typedef {import('./served.js').Served} Served */
/** @typedef {import('./served.js').ServedBlock} ServedBlock */
/** @typedef {import('./source.js').Source} Source */

/**
 * @typedef {object} Voxels
 * @property {number} count
 * @property {Float32Array} positions Centres in octree space, three numbers a voxel.
 * @property {Float32Array} sizes Edges in octree space: those of leaves above the level are larger.
 * @property {Float32Array} colors Red, green, blue, sRGB-encoded, 0 to 1.
 * @property {Float32Array} normals In mesh space, of unit length; 0 0 0 for voxels without one.
 * @property {number[]} octreeToMesh The transform of the object: 16 numbers by columns.
 */

/**
 * The voxels of a level of an object: those at the level, and leaves above it. Only what that takes is read.
 * @param {string | URL | Source | Served} from An address, or a source.
 * @param {{ level?: number, object?: number, maxVoxels?: number }} [options]
 * @returns {Promise<Voxels>}
 */
export async function voxels(from, { level = 6, object = 0, maxVoxels = 4e6 } = {}) {
  const source = typeof from === 'string' || from instanceof URL ? httpSource(from) : from;
  const served = 'blocks' in source ? source : await openSource(source);
  const about = served.objects[object];
  if (!about) throw new EsvoError('usage', 0, `there is no object ${object}; the file has ${served.objects.length}`);
  for (const link of [...served.links]) if (link.first < level && (link.object ?? object) === object) await readPages(served, link, level, object);
  const wanted = [...served.blocks.values()].filter((block) => block.object === object && block.first < level);
  const parts = wanted.flatMap((block) => block.parts.filter((part) => part.first < level));
  /** @type {Map<number, Uint8Array[]>} */
  const stored = new Map(wanted.map(({ index }) => [index, []]));
  await served.readParts(parts, (part, bytes) => {
    const own = stored.get(part.block);
    const block = served.blocks.get(part.block);
    if (own && block) own[block.parts.indexOf(part)] = bytes;
  });

  /** @type {number[]} */
  const positions = [];
  /** @type {number[]} */
  const sizes = [];
  /** @type {number[]} */
  const colors = [];
  /** @type {number[]} */
  const normals = [];
  /** @type {{ block: ServedBlock, inner: number | undefined }[]} */
  const queue = [];
  const root = served.blocks.get(about.rootBlock);
  if (root) queue.push({ block: root, inner: undefined });
  for (let next = queue.pop(); next; next = queue.pop()) {
    const image = served.image(next.block.index, stored.get(next.block.index) ?? [], next.inner);
    const block = new Block(next.block.index, image.words, 0);
    const links = new Map(image.links.map((link) => [link.slot, link]));
    for (const node of nodesOf(next.block, image, next.inner, level)) {
      const link = links.get(node.slot);
      const child = link && childOf(served, next.block, link);
      if (link && child && stored.has(child.index)) {
        queue.push({ block: child, inner: (link.low >> 8) & ~link.low & 255 });
        node.leaf = link.low & 255;
      }
      const edge = 2 ** -(node.level + 1);
      for (let slot = 0; slot < 8; slot++) {
        if (!((node.valid >> slot) & 1) || (!((node.leaf >> slot) & 1) && node.level + 1 < level)) continue;
        const { color = [0.75, 0.75, 0.75], normal = [0, 0, 0] } = attributesOf(block, node.slot, slot);
        sizes.push(edge);
        for (let axis = 0; axis < 3; axis++) {
          positions.push(node.position[axis] * 2 ** -23 + edge * (((slot >> axis) & 1) + 0.5));
          colors.push(color[axis]);
          normals.push(normal[axis]);
        }
      }
      if (sizes.length > maxVoxels) throw new EsvoError('limit', 0, `level ${level} has more than ${maxVoxels} voxels: take a lower level, or raise maxVoxels`);
    }
  }
  return { count: sizes.length, positions: Float32Array.from(positions), sizes: Float32Array.from(sizes), colors: Float32Array.from(colors), normals: Float32Array.from(normals), octreeToMesh: about.octreeToMesh };
}

/**
 * @param {Served} served
 * @param {import('./index-pages.js').PageLink} link
 * @param {number} level
 * @param {number} object
 */
async function readPages(served, link, level, object) {
  const before = new Set(served.links);
  await served.readPage(link);
  for (const next of served.links.filter((other) => !before.has(other))) {
    if (next.first < level && (next.object ?? object) === object) await readPages(served, next, level, object);
  }
}

/**
 * The block that a link leads to, if it is known.
 * @param {Served} served
 * @param {ServedBlock} block
 * @param {import('./served.js').BlockLink} link
 */
export function childOf(served, block, link) {
  if (link.child !== undefined) {
    const child = served.blocks.get(link.child);
    if (child && child.parent !== block.index) throw new EsvoError('C008', block.parts[0].fileAt, `block ${block.index}: a link leads to block ${link.child}, which is no child of it`);
    return child;
  }
  for (const child of served.blocks.values()) {
    if (child.parent === block.index && child.scale === link.scale && child.position.every((x, axis) => x === link.position?.[axis])) return child;
  }
  return undefined;
}

/**
 * The descriptors of a block above a level, with their cubes.
 * @param {ServedBlock} entry
 * @param {import('./served.js').Image} image
 * @param {number | undefined} inner
 * @param {number} below
 */
function* nodesOf(entry, { words }, inner, below) {
  /** @type {{ slot: number, level: number, position: number[] }[]} */
  const stack = [];
  if (entry.parent === NO_PARENT) stack.push({ slot: 2, level: 0, position: [0, 0, 0] });
  else if (inner !== undefined) pushChildren(stack, 2, inner, entry.first - 1, entry.position);
  for (let top = stack.pop(); top; top = stack.pop()) {
    const { slot, level, position } = top;
    const low = words[2 * slot];
    const node = { slot, level, position, valid: (low >> 8) & 255, leaf: low & 255 };
    yield node;
    const own = node.valid & ~(low & 255);
    if (!own || level + 1 >= below) continue;
    const pointer = slot + (low >>> 17);
    pushChildren(stack, low & 0x10000 ? slot + words[2 * pointer] : pointer, own, level, position);
  }
}

/**
 * @param {{ slot: number, level: number, position: number[] }[]} stack
 * @param {number} first
 * @param {number} inner
 * @param {number} level
 * @param {number[]} position
 */
function pushChildren(stack, first, inner, level, position) {
  for (let child = 7, number = BITS[inner] - 1; child >= 0; child--) {
    if ((inner >> child) & 1) stack.push({ slot: first + number--, level: level + 1, position: childPosition(position, level, child) });
  }
}
