// A block of codec 0 or 1 that was read alone: its pointers are checked, and its links to other blocks found.
import { Block } from './block.js';
import { BITS } from './bytes.js';
import { need } from './errors.js';
import { childPosition } from './octree.js';

/**
 * Checks all that a caster follows (section 12), and makes leaves of links to other blocks.
 * @param {import('./served.js').ServedBlock} entry
 * @param {Uint32Array} words Of the image; changed.
 * @param {number} [inner] The non-leaf mask of the descriptor that leads to it; none for a root block.
 * @returns {import('./served.js').Image}
 */
export function walkBlock(entry, words, inner) {
  const { index, position, first } = entry;
  const firstCount = inner === undefined ? 1 : BITS[inner];
  const block = new Block(index, words, entry.parts[0].fileAt);
  const { slots, where } = block;
  const used = new Uint8Array(slots);
  /** @type {import('./served.js').BlockLink[]} */
  const links = [];
  const claim = (/** @type {number} */ slot, /** @type {number} */ count) => {
    const within = slot & 1023;
    need(within > 0 && within + count <= 1024, 'C003', where + 8 * slot, `block ${index}: a pointer leads to a page header`);
    for (let k = slot; k < slot + count; k++) {
      need(k < slots && !used[k], 'C005', where + 8 * k, `block ${index}: slot ${k} is referred to twice`);
      used[k] = 1;
    }
  };
  for (let page = 0; page < slots; page += 1024) need(words[2 * page] === slots - page, 'P001', where + 8 * page, `block ${index}: a page header is not the distance to the info section`);
  need(firstCount >= 1 && 2 + firstCount <= slots, 'C002', where, `block ${index}: it has no ${firstCount} first descriptors`);
  claim(2, firstCount);
  /** @type {{ slot: number, level: number, position: number[] }[]} */
  const stack = [];
  if (inner === undefined) {
    stack.push({ slot: 2, level: 0, position: [0, 0, 0] });
  } else {
    for (let child = 0, slot = 2; child < 8; child++) {
      if ((inner >> child) & 1) stack.push({ slot: slot++, level: first, position: childPosition(position, first - 1, child) });
    }
  }
  for (let top = stack.pop(); top; top = stack.pop()) {
    const { slot, level, position: at } = top;
    const [low, high] = [words[2 * slot], words[2 * slot + 1]];
    const [valid, leaf, mask] = [(low >> 8) & 255, low & 255, high & 255];
    need(valid !== 0 && (leaf & ~valid) === 0, 'C001', where + 8 * slot, `block ${index}: a descriptor has valid mask ${valid}, leaf mask ${leaf}`);
    need(level <= 22, 'C007', where + 8 * slot, `block ${index}: a voxel is deeper than level 23`);
    need((mask & ~valid) === 0, 'K001', where + 8 * slot, `block ${index}: a contour mask is no subset of the valid mask`);
    const contour = 2 * slot + (high >>> 8);
    need(mask === 0 || (contour >= block.pool && contour + BITS[mask] <= block.pool + block.contours), 'K002', where + 8 * slot, `block ${index}: a contour pointer leads out of the contour pool`);
    const below = valid & ~leaf;
    if (!below) continue;
    const n = BITS[below];
    let target = slot + (low >>> 17);
    need(target > slot && target < slots, 'C002', where + 8 * slot, `block ${index}: a pointer leads out of the descriptor array`);
    if (low & 0x10000) {
      const far = target;
      claim(far, 1);
      target = slot + words[2 * far];
      need(target > slot, 'C004', where + 8 * far, `block ${index}: a far pointer is zero`);
      if (target >= slots) {
        links.push({ position: at, scale: 23 - level, slot, far, low, leaf: (valid << 8) | valid });
        words[2 * slot] = (valid << 8) | valid;
        words[2 * far] = 0;
        continue;
      }
    }
    need(target % 2 === 0 && target + n <= slots, 'C002', where + 8 * slot, `block ${index}: a pointer leads out of the descriptor array`);
    claim(target, n);
    for (let child = 0, k = 0; child < 8; child++) {
      if ((below >> child) & 1) stack.push({ slot: target + k++, level: level + 1, position: childPosition(at, level, child) });
    }
  }
  return { words, slots, firstCount, links };
}
