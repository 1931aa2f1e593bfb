// A part of an octree as an octree of its own (section 11.3).
import { BITS, u64, viewOf } from './bytes.js';
import { crc32 } from './crc32.js';
import { need } from './errors.js';
import { HEADER, IDENTIFIER } from './header.js';
import { BLOCK_ENTRY, NO_PARENT, OBJECT_ENTRY, PAGE } from './tables.js';

/** @typedef {import('./served.js').Served} Served */

/**
 * @typedef {object} Subset
 * @property {Uint8Array} objects The object table.
 * @property {Uint8Array} blocks The block table; file offset, stored size and checksum are 0, the codec is 0.
 * @property {Uint32Array} image
 */

/**
 * Reads a set of blocks and nothing else, and makes an octree of them. Blocks to which nothing refers that is taken are left out.
 * @param {Served} served
 * @param {number[]} indices With the parent of each, and at least one root block.
 * @param {(index: number) => number} [count] How many parts of a block are taken, by level; all. The set must be closed.
 * @returns {Promise<Subset>}
 */
export async function subset(served, indices, count = () => Infinity) {
  const sorted = [...new Set(indices)].sort((a, b) => a - b);
  const parts = sorted.flatMap((index) => served.blocks.get(index)?.parts.slice(0, count(index)) ?? []);
  /** @type {Map<number, Uint8Array[]>} */
  const stored = new Map(sorted.map((index) => [index, []]));
  /** @type {Map<import('./tables.js').PartEntry, Uint8Array>} */
  const bytes = new Map();
  await served.readParts(parts, (part, own) => bytes.set(part, own));
  for (const part of parts) stored.get(part.block)?.push(/** @type {Uint8Array} */ (bytes.get(part)));

  const starts = new Map();
  const images = new Map();
  /** @type {Map<string, number>} */
  const leads = new Map();
  let start = 0;
  for (const index of sorted) {
    const block = served.blocks.get(index);
    need(block && (block.parent === NO_PARENT || indices.includes(block.parent)), 'usage', 0, `block ${index} is not known, or its parent is not in the set`);
    const inner = block.parent === NO_PARENT ? undefined : leads.get(`${block.parent} ${index} ${block.position}`) ?? leads.get(`${block.parent} - ${block.position}`);
    // No part that is taken refers to it.
    if (block.parent !== NO_PARENT && inner === undefined) continue;
    const image = served.image(index, stored.get(index) ?? [], inner);
    for (const link of image.links) {
      const key = link.child === undefined ? `${index} - ${link.position}` : `${index} ${link.child} ${served.blocks.get(link.child)?.position}`;
      leads.set(key, (link.low >> 8) & ~link.low & 255);
    }
    starts.set(index, start);
    images.set(index, image);
    start += image.words.length / 2;
  }
  return assemble(served, sorted.filter((index) => images.has(index)), starts, images, start);
}

/**
 * @param {Served} served
 * @param {number[]} sorted
 * @param {Map<number, number>} starts
 * @param {Map<number, import('./served.js').Image>} images
 * @param {number} slots
 * @returns {Subset}
 */
function assemble(served, sorted, starts, images, slots) {
  const image = new Uint32Array(2 * slots);
  const objectNumbers = sorted.filter((index) => served.blocks.get(index)?.parent === NO_PARENT).map((index) => served.blocks.get(index)?.object ?? 0).sort((a, b) => a - b);
  const objects = new Uint8Array(OBJECT_ENTRY * objectNumbers.length);
  const blocks = new Uint8Array(BLOCK_ENTRY * sorted.length);
  const [objectView, blockView] = [viewOf(objects), viewOf(blocks)];
  const counts = objectNumbers.map(() => ({ levels: 0, descriptors: 0, leaves: 0, contours: 0, fars: 0 }));
  /** @type {Map<number, number>} */
  const numbers = new Map(sorted.map((index, k) => [index, k]));

  sorted.forEach((index, k) => {
    const block = served.blocks.get(index);
    const own = images.get(index);
    if (!block || !own) return;
    const start = starts.get(index) ?? 0;
    for (const link of own.links) {
      const child = link.child ?? sorted.find((other) => {
        const it = served.blocks.get(other);
        return it?.parent === index && it.scale === link.scale && it.position.every((x, axis) => x === link.position?.[axis]);
      });
      const to = child === undefined ? undefined : starts.get(child);
      if (to === undefined) continue;
      own.words[2 * link.slot] = link.low;
      own.words[2 * link.far] = to + 2 - (start + link.slot);
    }
    own.words[2 * own.slots] = k;
    image.set(own.words, 2 * start);
    const at = BLOCK_ENTRY * k;
    const object = objectNumbers.indexOf(block.object);
    [object, block.parent === NO_PARENT ? NO_PARENT : numbers.get(block.parent) ?? 0, ...block.position, block.scale].forEach((x, field) => blockView.setUint32(at + 4 * field, x, true));
    blockView.setBigUint64(at + 24, BigInt(8 * start), true);
    blockView.setBigUint64(at + 32, BigInt(4 * own.words.length), true);
    addCounts(own, block, counts[object]);
  });
  objectNumbers.forEach((number, k) => {
    const object = served.objects[number];
    const at = OBJECT_ENTRY * k;
    object.octreeToMesh.forEach((x, field) => objectView.setFloat64(at + 8 * field, x, true));
    objectView.setUint32(at + 128, numbers.get(object.rootBlock) ?? 0, true);
    const { levels, descriptors, leaves, contours, fars } = counts[k];
    objectView.setUint32(at + 132, levels, true);
    [(starts.get(object.rootBlock) ?? 0) + 2, descriptors, leaves, contours, fars].forEach((x, field) => objectView.setBigUint64(at + 136 + 8 * field, BigInt(x), true));
  });
  return { objects, blocks, image };
}

/**
 * Counts the descriptors of a block.
 * @param {import('./served.js').Image} image
 * @param {import('./served.js').ServedBlock} entry
 * @param {{ levels: number, descriptors: number, leaves: number, contours: number, fars: number }} counts
 */
function addCounts({ words, links, firstCount }, entry, counts) {
  const other = new Set(links.map(({ slot }) => slot));
  /** @type {{ slot: number, level: number }[]} */
  const stack = [];
  for (let k = 0; k < firstCount; k++) stack.push({ slot: 2 + k, level: entry.first });
  for (let top = stack.pop(); top; top = stack.pop()) {
    const { slot, level } = top;
    const low = words[2 * slot];
    counts.descriptors++;
    counts.levels = Math.max(counts.levels, level + 1);
    counts.leaves += BITS[low & 255];
    counts.contours += BITS[words[2 * slot + 1] & 255];
    const inner = (low >> 8) & ~low & 255;
    if (!inner) continue;
    let target = slot + (low >>> 17);
    if (low & 0x10000) {
      counts.fars++;
      if (other.has(slot)) continue;
      target = slot + words[2 * target];
    }
    for (let k = 0; k < BITS[inner]; k++) stack.push({ slot: target + k, level: level + 1 });
  }
}

/**
 * A file with the octrees of a subset, uncompressed.
 * @param {Subset} from
 * @returns {Uint8Array}
 */
export function writeFile({ objects, blocks, image }) {
  const data = new Uint8Array(image.buffer, image.byteOffset, image.byteLength);
  const places = [160, 160 + objects.length];
  const start = Math.ceil((places[1] + blocks.length) / PAGE) * PAGE;
  const file = new Uint8Array(start + data.length);
  const view = viewOf(file);
  const table = blocks.slice();
  const tableView = viewOf(table);
  for (let at = 0; at < table.length; at += BLOCK_ENTRY) {
    const [from, size] = [u64(tableView, at + 24), u64(tableView, at + 32)];
    tableView.setBigUint64(at + 40, BigInt(start + from), true);
    tableView.setBigUint64(at + 48, BigInt(size), true);
    tableView.setUint32(at + 56, 0, true);
    tableView.setUint32(at + 60, crc32(data.subarray(from, from + size)), true);
  }
  file.set(objects, places[0]);
  file.set(table, places[1]);
  file.set(data, start);
  const sections = /** @type {[string, number, number, number, number][]} */ ([['OBJT', 1, places[0], objects.length, crc32(objects)], ['BLKT', 1, places[1], table.length, crc32(table)], ['BLKS', 3, start, data.length, 0]]);
  sections.forEach(([tag, flags, offset, length, crc], k) => {
    const at = HEADER + 32 * k;
    for (let c = 0; c < 4; c++) file[at + c] = tag.charCodeAt(c);
    view.setUint32(at + 4, flags, true);
    view.setBigUint64(at + 8, BigInt(offset), true);
    view.setBigUint64(at + 16, BigInt(length), true);
    view.setUint32(at + 24, crc, true);
  });
  file.set(IDENTIFIER);
  view.setUint16(12, 1, true);
  view.setBigUint64(32, BigInt(file.length), true);
  view.setBigUint64(40, BigInt(HEADER), true);
  view.setUint32(48, sections.length, true);
  view.setUint32(52, crc32(file.subarray(HEADER, HEADER + 32 * sections.length)), true);
  view.setUint32(60, crc32(file.subarray(0, 60)), true);
  return file;
}
