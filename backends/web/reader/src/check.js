// Steps 6 and 7 of section 11.2: the walk over all descriptors, and what takes all of them.
import { AMBIENT, COLORS, NORMALS } from './block.js';
import { BITS } from './bytes.js';
import { checkComponents } from './components.js';
import { need } from './errors.js';
import { REGISTERED } from './json.js';
import { PAIR_BYTES, VALUE_WORDS, valuesOf } from './layout.js';
import { BLOCK_ENTRY, NO_PARENT } from './tables.js';

/** @typedef {import('./octree.js').Octree} Octree */
/** @typedef {import('./block.js').Block} Block */

/** What a slot of a descriptor array is. */
const UNUSED = 0;
const DESCRIPTOR = 1;
const FAR_POINTER = 2;

/**
 * What the walk finds out about a block.
 * @typedef {object} Use
 * @property {Uint8Array} slots UNUSED, DESCRIPTOR or FAR_POINTER.
 * @property {Uint8Array} contours How many voxels a value belongs to.
 * @property {boolean} reached
 */

/**
 * Checks all descriptors of a file whose tables and blocks are right. Throws at the first rule of level *must* that is broken.
 * @param {Octree} octree
 * @returns {{ rule: string, offset: number, message: string }[]} The rules of level *should* that are broken.
 */
export function check(octree) {
  const uses = octree.blocks.map((block) => ({ slots: new Uint8Array(block.slots), contours: new Uint8Array(block.contours), reached: false }));
  const found = octree.objects.map((_, object) => walk(octree, object, uses));
  uses.forEach((use, index) => need(use.reached, 'B010', octree.table[index].fileAt, `no pointer leads to block ${index}`));
  octree.objects.forEach((object, number) => {
    const counts = found[number];
    const where = octree.sections.find(({ tag }) => tag === 'OBJT')?.offset ?? 0;
    need(counts.deepest === object.levels, 'O003', where + 192 * number + 132, `object ${number} has ${object.levels} levels, its deepest voxel is at level ${counts.deepest}`);
    for (const name of /** @type {const} */ (['descriptors', 'leafVoxels', 'contours', 'farPointers'])) {
      need(object[name] === counts[name], 'O005', where + 192 * number + 144, `object ${number}: ${name} is ${object[name]}, there are ${counts[name]}`);
    }
  });
  octree.blocks.forEach((block, index) => checkBlock(block, uses[index]));
  return warnings(octree);
}

/**
 * @param {Octree} octree
 * @param {number} number
 * @param {Use[]} uses
 */
function walk(octree, number, uses) {
  const { objects, table, starts, blocks } = octree;
  const object = objects[number];
  const objectsAt = (octree.sections.find(({ tag }) => tag === 'OBJT')?.offset ?? 0) + 192 * number;
  const root = table[object.rootBlock];
  need(root && root.object === number && root.parent === NO_PARENT, 'O002', objectsAt + 128, `object ${number}: its root block ${object.rootBlock} is none of its own`);
  need(object.rootSlot === starts[object.rootBlock] + 2, 'O002', objectsAt + 136, `object ${number}: its root is at slot ${object.rootSlot}, not in slot 2 of its root block`);
  const counts = { deepest: 0, descriptors: 0, leafVoxels: 0, contours: 0, farPointers: 0 };

  /** @type {(block: Block, first: number, count: number, kind: number) => void} */
  const claim = (block, first, count, kind) => {
    const where = block.where + 8 * first;
    const within = first & 1023;
    need(within > 0 && within + count <= 1024, 'C003', where, `block ${block.index}: a pointer leads to a page header, or siblings include one`);
    const page = first - within;
    need(block.words[2 * page] === block.slots - page && block.words[2 * page + 1] === 0, 'P001', block.where + 8 * page, `block ${block.index}: the page header at slot ${page} is not the distance to the info section`);
    const { slots } = uses[block.index];
    for (let slot = first; slot < first + count; slot++) {
      need(slots[slot] === UNUSED, 'C005', block.where + 8 * slot, `block ${block.index}: slot ${slot} is referred to twice`);
      slots[slot] = kind;
    }
  };
  claim(blocks[object.rootBlock], 2, 1, DESCRIPTOR);
  uses[object.rootBlock].reached = true;
  /** @type {{ block: Block, slot: number, level: number, x: number, y: number, z: number }[]} */
  const stack = [{ block: blocks[object.rootBlock], slot: 2, level: 0, x: 0, y: 0, z: 0 }];
  for (let top = stack.pop(); top; top = stack.pop()) {
    const { block, slot, level, x, y, z } = top;
    const { words, slots, index } = block;
    const where = block.where + 8 * slot;
    const [low, high] = [words[2 * slot], words[2 * slot + 1]];
    const [valid, leaf, mask] = [(low >> 8) & 255, low & 255, high & 255];
    need(valid !== 0 && (leaf & ~valid) === 0, 'C001', where, `block ${index}: the descriptor at slot ${slot} has valid mask ${valid}, leaf mask ${leaf}`);
    need(level + 1 <= object.levels, 'C007', where, `object ${number}: a voxel is deeper than level ${object.levels}`);
    counts.deepest = Math.max(counts.deepest, level + 1);
    counts.descriptors++;
    counts.leafVoxels += BITS[leaf];
    counts.contours += BITS[mask];
    need((mask & ~valid) === 0, 'K001', where + 4, `block ${index}: the contour mask ${mask} is no subset of the valid mask ${valid}`);
    if (mask) {
      const first = 2 * slot + (high >>> 8) - block.pool;
      need(first >= 0 && first + BITS[mask] <= block.contours, 'K002', where + 4, `block ${index}: a contour pointer leads out of the contour pool`);
      for (let k = first; k < first + BITS[mask]; k++) {
        const { contours } = uses[index];
        contours[k] = Math.min(contours[k] + 1, 2);
      }
    } else {
      need(high >>> 8 === 0, 'K003', where + 4, `block ${index}: a contour pointer without contours`);
    }
    const inner = valid & ~leaf;
    const n = BITS[inner];
    const pointer = low >>> 17;
    const far = (low & 0x10000) !== 0;
    if (n === 0) {
      need(pointer === 0 && !far, 'C006', where, `block ${index}: a child pointer without children`);
      continue;
    }
    let [to, target] = [block, slot + pointer];
    if (far) {
      counts.farPointers++;
      need(pointer !== 0 && target < slots, 'C004', where, `block ${index}: a far pointer is not in the descriptor array after its descriptor`);
      claim(block, target, 1, FAR_POINTER);
      const distance = words[2 * target];
      need(distance !== 0 && words[2 * target + 1] === 0, 'C004', block.where + 8 * target, `block ${index}: the far pointer at slot ${target} is zero, or its high word is not`);
      target = slot + distance;
      if (target >= slots) {
        const other = octree.blockOfSlot(starts[index] + target);
        need(other >= 0 && other !== index, 'C002', block.where + 8 * (slot + pointer), `block ${index}: a far pointer leads to no descriptor`);
        target = starts[index] + target - starts[other];
        need(target === 2 && table[other].parent === index, 'C008', block.where + 8 * (slot + pointer), `block ${index}: a far pointer into block ${other} does not lead to slot 2 of a child`);
        to = blocks[other];
        uses[other].reached = true;
        const { position, scale } = table[other];
        need(position[0] === x && position[1] === y && position[2] === z && scale === 23 - level, 'B008', table[other].fileAt,
          `block ${other} has the cube at ${position} of scale ${scale}, its descriptors the cube at ${x},${y},${z} of scale ${23 - level}`);
      }
    } else {
      need(pointer !== 0, 'C002', where, `block ${index}: a child pointer of 0`);
    }
    need(target + n <= to.slots, 'C002', where, `block ${index}: a pointer leads out of the descriptor array`);
    need(target % 2 === 0, 'C003', where, `block ${index}: siblings start at an odd slot`);
    claim(to, target, n, DESCRIPTOR);
    const half = 2 ** (22 - level);
    for (let child = 7, k = n - 1; child >= 0; child--) {
      if (!((inner >> child) & 1)) continue;
      stack.push({ block: to, slot: target + k--, level: level + 1, x: x + half * (child & 1), y: y + half * ((child >> 1) & 1), z: z + half * (child >> 2) });
    }
  }
  return counts;
}

/**
 * @param {Block} block
 * @param {Use} use
 */
function checkBlock(block, use) {
  const { words, index, slots, pool, contours, attachments } = block;
  const at = (/** @type {number} */ word) => block.where + 4 * word;
  for (let k = 0; k < contours; k++) {
    need(use.contours[k] === 0 || (words[pool + k] & 0x3ffff) !== 0, 'K004', at(pool + k), `block ${index}: the normal of a contour is zero`);
  }
  for (let k = 0; k < contours; k++) need(use.contours[k] === 1, 'K005', at(pool + k), `block ${index}: a contour belongs to ${use.contours[k] ? 'several voxels' : 'no voxel'}`);
  const inUse = (/** @type {number} */ slot) => slot < slots && use.slots[slot] === DESCRIPTOR;
  for (const { type, at: first } of attachments) {
    if (PAIR_BYTES[type]) {
      const size = PAIR_BYTES[type] / 4;
      for (let pair = 0; 2 * pair < slots; pair++) {
        if (inUse(2 * pair) || inUse(2 * pair + 1)) continue;
        for (let w = 0; w < size; w++) need(words[first + pair * size + w] === 0, 'A005', at(first + pair * size), `block ${index}: attributes of slots without descriptors are not zero`);
      }
    } else if (type === 3) {
      need(words[first] >>> 24 === 0 && words[first + 1] === 0, 'A005', at(first), `block ${index}: unused bytes of a constant colour are not zero`);
    }
  }
  for (const attachment of attachments) {
    if (VALUE_WORDS[attachment.type]) checkEntries(block, use, attachment);
    if (attachment.head) checkComponents(block, attachment, inUse);
  }
  for (let slot = 0; slot < slots; slot++) {
    if (slot % 1024 === 0) need(words[2 * slot] === slots - slot && words[2 * slot + 1] === 0, 'P001', at(2 * slot), `block ${index}: the page header at slot ${slot} is not the distance to the info section`);
    else if (use.slots[slot] === UNUSED) need(words[2 * slot] === 0 && words[2 * slot + 1] === 0, 'P006', at(2 * slot), `block ${index}: the unused slot ${slot} is not zero`);
  }
  const parts = [{ start: 4 * pool, end: 4 * (pool + contours) }, ...attachments.map((attachment) => ({ start: 4 * attachment.at, end: 4 * attachment.at + attachment.bytes }))];
  parts.sort((a, b) => a.start - b.start || a.end - b.end);
  const bytes = new Uint8Array(words.buffer, words.byteOffset, words.byteLength);
  let end = 4 * (block.info + 8 + 4 * attachments.length);
  for (const part of [...parts, { start: bytes.length, end: bytes.length }]) {
    for (; end < part.start; end++) need(bytes[end] === 0, 'P006', block.where + end, `block ${index}: a byte between or after the parts of the block is not zero`);
    end = Math.max(end, part.end);
  }
}

/**
 * A005, A007 and A008 of plain values and corners.
 * @param {Block} block
 * @param {Use} use
 * @param {import('./block.js').Attachment} attachment
 */
function checkEntries(block, use, { type, at: first, bytes }) {
  const { words, index, slots } = block;
  const at = (/** @type {number} */ word) => block.where + 4 * word;
  const entryWords = type === 7 ? 2 : 1;
  const size = VALUE_WORDS[type];
  const total = bytes / 4 - slots * entryWords;
  const used = new Uint8Array(total);
  for (let slot = 0; slot < slots; slot++) {
    const place = first + slot * entryWords;
    const [entry, second] = [words[place], type === 7 ? words[place + 1] : 0];
    if (use.slots[slot] !== DESCRIPTOR) {
      need(entry === 0 && second === 0, 'A005', at(place), `block ${index}: the entry of slot ${slot}, which has no descriptor, is not zero`);
    }
  }
  for (let slot = 0; slot < slots; slot++) {
    if (use.slots[slot] !== DESCRIPTOR) continue;
    const place = first + slot * entryWords;
    const entry = words[place];
    const valid = (words[2 * slot] >> 8) & 255;
    const distance = type === 7 ? words[place + 1] : entry >>> 8;
    const right = type === 7 ? entry >>> 28 === 0 && distance % 2 === 0 : (entry & 255 & ~valid) === 0;
    const count = valuesOf(type, entry, valid) * size;
    const from = distance - slots * entryWords;
    const inside = count === 0 ? entry === 0 && distance === 0 : from >= 0 && from + count <= total;
    need(right && inside, 'A007', at(place), `block ${index}: the entry of slot ${slot} has undefined bits, or its values are not within the attachment`);
    for (let k = from; k < from + count; k++) used[k] = Math.min(used[k] + 1, 2);
  }
  for (let k = 0; k < total; k++) need(used[k] === 1, 'A008', at(first + slots * entryWords + k), `block ${index}: a value belongs to ${used[k] ? 'several descriptors' : 'no descriptor'}`);
}

/** @param {Octree} octree */
function warnings(octree) {
  const { table, blocks, parts, meta, sections } = octree;
  /** @type {{ rule: string, offset: number, message: string }[]} */
  const found = [];
  const offset = (/** @type {string} */ tag) => sections.find((section) => section.tag === tag)?.offset ?? 0;
  for (const name of REGISTERED) {
    if (meta && Object.hasOwn(meta, name) && typeof meta[name] !== 'string') found.push({ rule: 'M002', offset: offset('META'), message: `the value of "${name}" is not a string` });
  }
  /** @type {Map<number, number>} */
  const before = new Map();
  table.forEach(({ object, parent }, index) => {
    const last = before.get(object);
    if (parent !== NO_PARENT && last !== undefined && parent < last) found.push({ rule: 'B012', offset: offset('BLKT') + BLOCK_ENTRY * index, message: `block ${index} of parent ${parent} comes after a block of parent ${last}` });
    if (parent !== NO_PARENT) before.set(object, Math.max(parent, last ?? 0));
  });
  parts?.forEach((part, k) => {
    const last = parts[k - 1];
    if (last && (part.first < last.first || (part.first === last.first && part.block < last.block))) found.push({ rule: 'S009', offset: offset('PART') + 12 * k, message: `part ${k} is not in the order of first level, then block` });
  });
  for (const [name, types] of /** @type {[string, number[]][]} */ ([['colours', COLORS], ['normals', NORMALS], ['ambient occlusion', AMBIENT]])) {
    /** @type {Map<number, number>} */
    const first = new Map();
    blocks.forEach((block, index) => {
      const other = first.get(table[index].object);
      if (other === undefined) first.set(table[index].object, index);
      else if (blocks[other].hasAny(types) !== block.hasAny(types)) found.push({ rule: 'A006', offset: block.where, message: `only one of blocks ${other} and ${index}, which belong to the same object, has ${name}` });
    });
  }
  return found;
}
