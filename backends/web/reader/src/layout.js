// From fields to the image of a block: the layout that codec 2 leaves no choice for (section 4.4).
import { BITS, bits } from './bytes.js';

/** Links of a descriptor to its children: in the block by child pointer, in it by far pointer, in another block. */
export const NEAR = 0;
export const FAR = 1;
export const OTHER = 2;
/** The link of a descriptor without children that are not leaves. */
export const NONE = 255;

/**
 * The descriptors of a level of a block, and everything that belongs to them, in the order of their slots.
 * @typedef {object} Level
 * @property {number} count
 * @property {Uint8Array} valid
 * @property {Uint8Array} nonleaf
 * @property {Uint8Array} link NEAR, FAR, OTHER or NONE.
 * @property {Uint32Array} child For OTHER: the index of the block.
 * @property {Uint8Array} contourMask
 * @property {Uint32Array} contourFirst The first contour of each descriptor in `contours`.
 * @property {Uint32Array} contours
 * @property {Uint32Array} firstPair The first pair of the descriptor's group, of the level's pairs; see `groupAt`.
 * @property {Uint32Array[]} attachments One for each attachment of the block. Types 1 and 4: two words a pair, type 2: four, type 3: none; types 5 to
 *   7: the values.
 * @property {Uint32Array[]} entries One for each attachment: of types 5 to 7 the mask of each descriptor, else empty.
 * @property {Uint32Array[]} valueFirst One for each attachment: of types 5 to 7 the first value of each descriptor, in values.
 */

/**
 * @typedef {object} BlockFields
 * @property {number} block Index in the file.
 * @property {number} slots Of the descriptor array of the whole block.
 * @property {{ type: number, constant?: Uint32Array }[]} attachments
 * @property {Level[]} levels
 */

/**
 * @typedef {object} Link A descriptor whose children are in another block.
 * @property {number} child Index of that block in the file.
 * @property {number} slot Of the descriptor.
 * @property {number} far Slot of its far pointer.
 * @property {number} low The low word of the descriptor with the link.
 * @property {number} leaf The low word of the descriptor with leaves in place of the link.
 */

/**
 * @typedef {object} Layout
 * @property {Uint32Array} words Of the image. All descriptors with links to other blocks have leaves instead.
 * @property {number} slots Of the descriptor array.
 * @property {Link[]} links
 */

/** Bytes of a pair of types 1, 2 and 4, and words of a value of types 5 to 7. */
export const PAIR_BYTES = /** @type {Record<number, number>} */ ({ 1: 8, 2: 16, 4: 8 });
export const VALUE_WORDS = /** @type {Record<number, number>} */ ({ 5: 1, 6: 1, 7: 2 });

/**
 * Number of values of an entry of types 5 and 6, or of type 7 (sections 8.5 and 8.6).
 * @param {number} type
 * @param {number} entry
 * @param {number} valid
 */
export function valuesOf(type, entry, valid) {
  if (type === 7) return bits(entry & 0x7ffffff) + (entry & 0x8000000 ? 8 : 0);
  return BITS[entry & 255] + (valid & ~entry & 255 ? 1 : 0);
}

/**
 * The first child of every descriptor in the next level.
 * @param {Level} level
 */
function firstChildren(level) {
  const first = new Uint32Array(level.count + 1);
  let sum = 0;
  for (let i = 0; i < level.count; i++) {
    first[i] = sum;
    if (level.link[i] < OTHER) sum += BITS[level.nonleaf[i]];
  }
  first[level.count] = sum;
  return first;
}

/**
 * Lays a block out. Levels that are missing at the end make leaves of the voxels above them. A link to another block keeps the slot of its
 * far pointer: whoever has that block writes `low` and the distance, and has the image of the file where all are there.
 * @param {BlockFields} fields
 * @returns {Layout | string} What is wrong, where no layout gives the block.
 */
export function layOut(fields) {
  const { levels } = fields;
  const depth = levels.length;
  const children = levels.map(firstChildren);
  const slotOf = levels.map((level) => new Uint32Array(level.count));
  const farOf = levels.map((level) => new Uint32Array(level.count));
  let cursor = 2;
  /** @type {(k: number, first: number, n: number) => void} */
  const place = (k, first, n) => {
    const { link } = levels[k];
    const last = k + 1 === depth;
    let fars = 0;
    for (let i = first; i < first + n; i++) if (link[i] === OTHER || (link[i] === FAR && !last)) fars++;
    const within = cursor & 1023;
    if (within === 0 || within + n + fars > 1024) cursor = Math.ceil(cursor / 1024) * 1024 + 2;
    let far = cursor + n;
    for (let i = first; i < first + n; i++) {
      slotOf[k][i] = cursor + i - first;
      if (link[i] === OTHER || (link[i] === FAR && !last)) farOf[k][i] = far++;
    }
    cursor = far + (far & 1);
    if (last) return;
    for (let i = first; i < first + n; i++) {
      if (link[i] < OTHER) place(k + 1, children[k][i], children[k][i + 1] - children[k][i]);
    }
  };
  place(0, 0, levels[0].count);
  return fill(fields, cursor, slotOf, farOf, children);
}

/**
 * @param {BlockFields} fields
 * @param {number} slots
 * @param {Uint32Array[]} slotOf
 * @param {Uint32Array[]} farOf
 * @param {Uint32Array[]} children
 * @returns {Layout | string}
 */
function fill(fields, slots, slotOf, farOf, children) {
  const { levels, attachments } = fields;
  const depth = levels.length;
  // Contours and values are in the order of the slots: how many each slot has, then where they begin.
  const ofSlot = new Uint32Array(slots + 1);
  let contourCount = 0;
  levels.forEach((level, k) => {
    contourCount += level.contours.length;
    for (let i = 0; i < level.count; i++) ofSlot[slotOf[k][i]] = BITS[level.contourMask[i]];
  });
  starts(ofSlot);

  const pairs = (slots + 1) >> 1;
  const infoWord = slots * 2;
  const directory = infoWord + 8;
  const pool = directory + 4 * attachments.length;
  let end = pool + contourCount;
  const places = attachments.map(({ type }, number) => {
    end += end & 1;
    const at = end;
    let words = 2;
    if (PAIR_BYTES[type]) words = (pairs * PAIR_BYTES[type]) / 4;
    if (VALUE_WORDS[type]) {
      const values = levels.reduce((sum, level) => sum + level.attachments[number].length, 0);
      words = slots * (type === 7 ? 2 : 1) + values;
    }
    end += words;
    return { at, words };
  });
  const words = new Uint32Array(Math.ceil((end * 4) / 8192) * 2048);
  for (let page = 0; page < slots; page += 1024) words[2 * page] = slots - page;

  /** @type {Link[]} */
  const links = [];
  for (let k = 0; k < depth; k++) {
    const level = levels[k];
    const last = k + 1 === depth;
    for (let i = 0; i < level.count; i++) {
      const slot = slotOf[k][i];
      const [valid, nonleaf, link, mask] = [level.valid[i], level.nonleaf[i], level.link[i], level.contourMask[i]];
      const leaf = (valid << 8) | valid;
      let low = (valid << 8) | (valid & ~nonleaf);
      if (link === OTHER) {
        const far = farOf[k][i];
        const linked = (low | 0x10000 | ((far - slot) << 17)) >>> 0;
        links.push({ child: level.child[i], slot, far, low: linked, leaf });
        low = leaf;
      } else if (link !== NONE && last) {
        low = leaf;
      } else if (link !== NONE) {
        const to = slotOf[k + 1][children[k][i]];
        const far = farOf[k][i];
        const pointer = (far || to) - slot;
        if (pointer > 32767) return 'a child pointer does not reach';
        low |= (pointer << 17) | (far ? 0x10000 : 0);
        if (far) words[2 * far] = to - slot;
      }
      words[2 * slot] = low;
      if (mask) {
        const to = pool + ofSlot[slot];
        if (to - 2 * slot > 0xffffff) return 'a contour pointer does not reach';
        words[2 * slot + 1] = mask | ((to - 2 * slot) << 8);
        words.set(level.contours.subarray(level.contourFirst[i], level.contourFirst[i] + BITS[mask]), to);
      }
    }
  }
  words.set([fields.block, slots, slots - 2, pool - infoWord, contourCount, attachments.length], infoWord);
  attachments.forEach(({ type, constant }, number) => {
    const { at, words: size } = places[number];
    words.set([type, (at - infoWord) * 4, size * 4, 0], directory + 4 * number);
    if (constant) words.set(constant, at);
    else if (PAIR_BYTES[type]) fillPairs(levels, slotOf, number, PAIR_BYTES[type] / 4, words, at);
    else fillValues(levels, slotOf, slots, number, type, words, at);
  });
  return { words, slots, links };
}

/**
 * Numbers of things become where they begin.
 * @param {Uint32Array} counts
 */
function starts(counts) {
  let sum = 0;
  for (let k = 0; k < counts.length; k++) {
    const own = counts[k];
    counts[k] = sum;
    sum += own;
  }
}

/**
 * @param {Level[]} levels
 * @param {Uint32Array[]} slotOf
 * @param {number} number
 * @param {number} size Words of a pair.
 * @param {Uint32Array} words
 * @param {number} at
 */
function fillPairs(levels, slotOf, number, size, words, at) {
  levels.forEach((level, k) => {
    const from = level.attachments[number];
    for (let i = 0; i < level.count; i++) {
      const slot = slotOf[k][i];
      // A pair is copied with its first slot, which is the even one: groups start there.
      if (slot & 1) continue;
      const pair = level.firstPair[i];
      const to = at + (slot >> 1) * size;
      for (let w = 0; w < size; w++) words[to + w] = from[pair * size + w];
    }
  });
}

/**
 * @param {Level[]} levels
 * @param {Uint32Array[]} slotOf
 * @param {number} slots
 * @param {number} number
 * @param {number} type
 * @param {Uint32Array} words
 * @param {number} at
 */
function fillValues(levels, slotOf, slots, number, type, words, at) {
  const size = VALUE_WORDS[type];
  const entryWords = type === 7 ? 2 : 1;
  const ofSlot = new Uint32Array(slots + 1);
  levels.forEach((level, k) => {
    for (let i = 0; i < level.count; i++) ofSlot[slotOf[k][i]] = valuesOf(type, level.entries[number][i], level.valid[i]);
  });
  starts(ofSlot);
  levels.forEach((level, k) => {
    const values = level.attachments[number];
    for (let i = 0; i < level.count; i++) {
      const entry = level.entries[number][i];
      const count = valuesOf(type, entry, level.valid[i]) * size;
      const slot = slotOf[k][i];
      const first = slots * entryWords + ofSlot[slot] * size;
      const from = level.valueFirst[number][i] * size;
      words.set(values.subarray(from, from + count), at + first);
      if (type === 7) {
        words[at + 2 * slot] = entry;
        words[at + 2 * slot + 1] = count ? first : 0;
      } else {
        words[at + slot] = count ? (entry & 255) | (first << 8) : 0;
      }
    }
  });
}
