// Codec 2: the streams of fields of a part (section 4.4).
import { BITS, viewOf } from './bytes.js';
import { EsvoError } from './errors.js';
import { FAR, NEAR, NONE, OTHER, PAIR_BYTES, VALUE_WORDS, valuesOf } from './layout.js';
import { decodeFrame } from './zstd.js';

/** @typedef {import('./layout.js').Level} Level */
/** @typedef {import('./layout.js').BlockFields} BlockFields */

/** First bit and width of the fields of a word. */
const BYTES = [[0, 8], [8, 8], [16, 8], [24, 8]];
const COLOR_LOW = [[0, 5], [5, 6], [11, 5], [16, 5], [21, 6], [27, 5]];
const BASE = [[0, 6], [6, 8], [14, 7], [21, 8], [29, 3]];
const NORMAL = [[0, 6], [6, 6], [12, 6]];
const CONTOUR = [[18, 7], [25, 7]];

/** Streams of each attachment, and of what every part has. */
const STREAMS = /** @type {Record<number, number>} */ ({ 1: 10, 2: 18, 3: 0, 4: 8, 5: 5, 6: 6, 7: 13 });
const COMMON = 14;
/** Most bytes of all streams of a part: a block has at most 2^32 slots, but no reader takes that much at once. */
const MAX_STREAM_BYTES = 1 << 30;

/** Reads numbers and bytes from a part, and says what is wrong by the rule S006. */
class Cursor {
  /**
   * @param {Uint8Array} bytes
   * @param {(what: string) => never} fail
   */
  constructor(bytes, fail) {
    this.bytes = bytes;
    this.view = viewOf(bytes);
    this.at = 0;
    this.fail = fail;
  }

  /** @param {number} count */
  take(count) {
    if (count > this.bytes.length - this.at) this.fail('it ends too early');
    this.at += count;
    return this.bytes.subarray(this.at - count, this.at);
  }

  u8() {
    return this.take(1)[0];
  }

  u16() {
    this.take(2);
    return this.view.getUint16(this.at - 2, true);
  }

  u32() {
    this.take(4);
    return this.view.getUint32(this.at - 4, true);
  }

  /** Seven bits in each byte. */
  number() {
    let value = 0;
    for (let k = 0; k < 5; k++) {
      const byte = this.u8();
      value += (byte & 127) * 2 ** (7 * k);
      if (byte < 128) return value < 2 ** 32 ? value : this.fail('a number is too large');
    }
    return this.fail('a number has more than five bytes');
  }
}

/** The streams of a part, one after the other, each of a size that those before give. */
class Streams {
  /**
   * @param {Cursor} from Behind the byte with the form.
   * @param {number} form
   * @param {number} count
   */
  constructor(from, form, count) {
    this.from = from;
    this.left = 0;
    /** @type {number[] | undefined} */
    this.stored = undefined;
    if (form === 0) {
      this.stored = Array.from({ length: count }, () => from.number()).reverse();
    } else if (form <= 2) {
      const size = from.number();
      const bytes = from.take(from.bytes.length - from.at);
      if (size > MAX_STREAM_BYTES || size > bytes.length * 32768) from.fail(`${bytes.length} bytes cannot decompress to ${size}`);
      const all = form === 2 ? bytes : decodeFrame(bytes, size);
      if (typeof all === 'string') from.fail(all);
      else if (all.length !== size) from.fail(`it has ${all.length} bytes of streams, not ${size}`);
      else this.from = new Cursor(all, from.fail);
    } else {
      from.fail(`streams are stored in form ${form}, this reader knows 0 to 2`);
    }
  }

  /** @param {number} size */
  next(size) {
    const { from, stored } = this;
    if (!stored) return from.take(size);
    const number = stored.pop() ?? from.fail('it has too few streams');
    const bytes = from.take(Math.floor(number / 2));
    if (number % 2 === 0) return bytes.length === size ? bytes : from.fail(`a stream has ${bytes.length} bytes, expected ${size}`);
    if (size > bytes.length * 32768) from.fail(`${bytes.length} bytes cannot decompress to ${size}`);
    const decoded = decodeFrame(bytes, size);
    return typeof decoded === 'string' ? from.fail(decoded) : decoded;
  }

  /**
   * Reads words from a stream for each field and sets the fields.
   * @param {Uint32Array} words
   * @param {number[][]} fields
   */
  words(words, fields) {
    for (const [shift, width] of fields) {
      const bytes = this.next(words.length);
      const above = 256 - 2 ** width;
      let wrong = 0;
      for (let k = 0; k < words.length; k++) {
        wrong |= bytes[k] & above;
        words[k] |= bytes[k] << shift;
      }
      if (wrong) this.from.fail('a bit above a field is not zero');
    }
    return words;
  }

  end() {
    if (this.from.at !== this.from.bytes.length || this.stored?.length) this.from.fail('bytes follow the streams');
  }
}

/**
 * Reads numbers of two bits.
 * @param {Streams} streams
 * @param {number} count
 */
function readTokens(streams, count) {
  const bytes = streams.next((count + 3) >> 2);
  const tokens = new Uint8Array(count);
  for (let k = 0; k < count; k++) tokens[k] = (bytes[k >> 2] >> (2 * (k & 3))) & 3;
  if (count & 3 && bytes[bytes.length - 1] >> (2 * (count & 3))) streams.from.fail('an unused bit of tokens is not zero');
  return tokens;
}

/**
 * @param {Streams} streams
 * @param {number} count
 */
function readContours(streams, count) {
  const tokens = readTokens(streams, count);
  let fresh = 0;
  for (const token of tokens) if (token === 3) fresh++;
  const normals = streams.words(new Uint32Array(fresh), NORMAL);
  const contours = new Uint32Array(count);
  let [a, b, c, next] = [0, 0, 0, 0];
  for (let k = 0; k < count; k++) {
    const token = tokens[k];
    if (token === 1) [a, b] = [b, a];
    else if (token === 2) [a, b, c] = [c, a, b];
    else if (token === 3) [a, b, c] = [normals[next++], a, b];
    contours[k] = a;
  }
  return streams.words(contours, CONTOUR);
}

/**
 * @param {Streams} streams
 * @param {number} pairs
 */
function readNormalBlocks(streams, pairs) {
  const tokens = readTokens(streams, pairs);
  let [fresh, whole] = [0, 0];
  for (const token of tokens) {
    if (token >= 2) fresh++;
    if (token === 3) whole++;
  }
  const first = streams.words(new Uint32Array(fresh), BASE);
  const others = [0, 1, 2].map(() => streams.words(new Uint32Array(whole), BYTES));
  const words = new Uint32Array(4 * pairs);
  const empty = [0, 0, 0, 0];
  let [a, b, nextFirst, nextOther] = [empty, empty, 0, 0];
  for (let k = 0; k < pairs; k++) {
    const token = tokens[k];
    if (token === 1) {
      [a, b] = [b, a];
    } else if (token >= 2) {
      b = a;
      a = [first[nextFirst++], 0, 0, 0];
      if (token === 3) {
        for (let w = 0; w < 3; w++) a[w + 1] = others[w][nextOther];
        nextOther++;
      }
    }
    words.set(a, 4 * k);
  }
  return words;
}

/**
 * Words of two fields streams each, alternating.
 * @param {Streams} streams
 * @param {number} count
 * @param {number[][]} low
 * @param {number[][]} high
 */
function readDouble(streams, count, low, high) {
  const [lows, highs] = [streams.words(new Uint32Array(count), low), streams.words(new Uint32Array(count), high)];
  const words = new Uint32Array(2 * count);
  for (let k = 0; k < count; k++) {
    words[2 * k] = lows[k];
    words[2 * k + 1] = highs[k];
  }
  return words;
}

/**
 * What the first part of a block says of the whole block.
 * @param {Cursor} from
 * @returns {Pick<BlockFields, 'slots' | 'attachments'>}
 */
function readBlockHeader(from) {
  const slots = from.u32();
  const count = from.u8();
  if (count > 3) from.fail(`the block has ${count} attachments, expected at most 3`);
  const attachments = Array.from({ length: count }, () => {
    const type = from.u16();
    if (type < 1 || type > 7) from.fail(`the block has an attachment of type ${type}`);
    return type === 3 ? { type, constant: Uint32Array.of(from.u32(), from.u32()) } : { type };
  });
  return { slots, attachments };
}

/**
 * Adds the levels of a part of codec 2 to the fields of its block.
 * @param {BlockFields | undefined} block What the parts before it gave; `undefined` for the first part of a block.
 * @param {number} index Of the block.
 * @param {Uint8Array} bytes The part without its header.
 * @param {{ first: number, last: number }} part
 * @param {number} where Offset in the file, for errors.
 * @returns {BlockFields}
 */
export function readFields(block, index, bytes, part, where) {
  /** @type {(what: string) => never} */
  const fail = (what) => {
    throw new EsvoError('S006', where, `block ${index}, the part from level ${part.first} on: ${what}`);
  };
  const from = new Cursor(bytes, fail);
  const fields = block ?? { block: index, ...readBlockHeader(from), levels: [] };
  const counts = Array.from({ length: part.last - part.first + 1 }, () => from.u32());
  const form = from.u8();
  const { attachments } = fields;
  const streams = new Streams(from, form, attachments.reduce((sum, { type }) => sum + STREAMS[type], COMMON));
  const total = counts.reduce((sum, count) => sum + count, 0);
  if (counts.some((count) => count === 0)) fail('a level has no descriptors');

  const valid = streams.next(total);
  const nonleaf = streams.next(total);
  let inner = 0;
  let wrong = 0;
  for (let k = 0; k < total; k++) {
    wrong |= nonleaf[k] & ~valid[k];
    if (nonleaf[k]) inner++;
  }
  if (wrong) fail('a voxel that is empty has children');
  const links = streams.next(inner);
  const link = new Uint8Array(total).fill(NONE);
  let others = 0;
  for (let k = 0, next = 0; k < total; k++) {
    if (!nonleaf[k]) continue;
    link[k] = links[next++];
    if (link[k] > OTHER) fail(`a link is of kind ${link[k]}`);
    if (link[k] === OTHER) others++;
  }
  const differences = streams.words(new Uint32Array(others), BYTES);
  const child = new Uint32Array(total);
  for (let k = 0, next = 0, before = 0; k < total; k++) {
    if (link[k] !== OTHER) continue;
    before = (before + differences[next++]) >>> 0;
    child[k] = before;
  }
  const contourMask = streams.next(total);
  const contourFirst = new Uint32Array(total + 1);
  for (let k = 0; k < total; k++) contourFirst[k + 1] = contourFirst[k] + BITS[contourMask[k]];
  const contours = readContours(streams, contourFirst[total]);

  const { firstPair, pairStarts } = readGroups(fields, counts, nonleaf, link, fail);
  const pairs = pairStarts[counts.length];
  const found = attachments.map(({ type }) => readAttachment(streams, type, pairs, valid, total));
  streams.end();

  let at = 0;
  counts.forEach((count, k) => {
    const end = at + count;
    const [c0, c1] = [contourFirst[at], contourFirst[end]];
    fields.levels.push({
      count, valid: valid.slice(at, end), nonleaf: nonleaf.slice(at, end), link: link.slice(at, end), child: child.slice(at, end),
      contourMask: contourMask.slice(at, end), contourFirst: contourFirst.slice(at, end).map((first) => first - c0),
      contours: contours.slice(c0, c1), firstPair: firstPair.slice(at, end).map((pair) => pair - pairStarts[k]),
      attachments: found.map(({ words, valueFirst }, number) => {
        const { type } = attachments[number];
        if (PAIR_BYTES[type]) return words.slice((pairStarts[k] * PAIR_BYTES[type]) / 4, (pairStarts[k + 1] * PAIR_BYTES[type]) / 4);
        return VALUE_WORDS[type] ? words.slice(valueFirst[at] * VALUE_WORDS[type], valueFirst[end] * VALUE_WORDS[type]) : words;
      }),
      entries: found.map(({ entries }) => entries.slice(at, end)),
      valueFirst: found.map(({ valueFirst }) => valueFirst.slice(at, end).map((first) => first - valueFirst[at])),
    });
    at = end;
  });
  return fields;
}

/**
 * The groups of siblings of the levels of a part: how many descriptors each level must have, and where the pairs of each begin.
 * @param {BlockFields} fields
 * @param {number[]} counts
 * @param {Uint8Array} nonleaf
 * @param {Uint8Array} link
 * @param {(what: string) => never} fail
 */
function readGroups(fields, counts, nonleaf, link, fail) {
  const firstPair = new Uint32Array(nonleaf.length);
  const pairStarts = [0];
  let pairs = 0;
  let at = 0;
  let above = fields.levels.at(-1);
  /** @type {{ nonleaf: Uint8Array, link: Uint8Array } | undefined} */
  let parents = above && { nonleaf: above.nonleaf, link: above.link };
  for (const count of counts) {
    let filled = 0;
    const group = (/** @type {number} */ n) => {
      if (filled + n > count) fail(`a level has ${count} descriptors, expected more`);
      for (let k = 0; k < n; k++) firstPair[at + filled + k] = pairs + (k >> 1);
      pairs += (n + 1) >> 1;
      filled += n;
    };
    if (parents) {
      for (let k = 0; k < parents.link.length; k++) if (parents.link[k] === NEAR || parents.link[k] === FAR) group(BITS[parents.nonleaf[k]]);
    } else {
      if (count > 8) fail(`the first level has ${count} descriptors`);
      group(count);
    }
    if (filled !== count) fail(`a level has ${count} descriptors, expected ${filled}`);
    parents = { nonleaf: nonleaf.subarray(at, at + count), link: link.subarray(at, at + count) };
    at += count;
    pairStarts.push(pairs);
  }
  return { firstPair, pairStarts };
}

/**
 * @param {Streams} streams
 * @param {number} type
 * @param {number} pairs
 * @param {Uint8Array} valid
 * @param {number} total
 */
function readAttachment(streams, type, pairs, valid, total) {
  const none = new Uint32Array(0);
  if (type === 1) return { words: readDouble(streams, pairs, COLOR_LOW, BYTES), entries: none, valueFirst: none };
  if (type === 2) return { words: readNormalBlocks(streams, pairs), entries: none, valueFirst: none };
  if (type === 3) return { words: none, entries: none, valueFirst: none };
  if (type === 4) return { words: readDouble(streams, pairs, BYTES, BYTES), entries: none, valueFirst: none };
  const entries = type === 7 ? streams.words(new Uint32Array(total), BYTES) : Uint32Array.from(streams.next(total));
  const valueFirst = new Uint32Array(total + 1);
  for (let k = 0; k < total; k++) valueFirst[k + 1] = valueFirst[k] + valuesOf(type, entries[k], valid[k]);
  const count = valueFirst[total];
  const words = type === 7 ? readDouble(streams, count, BYTES, BASE) : streams.words(new Uint32Array(count), type === 5 ? BYTES : BASE);
  return { words, entries, valueFirst };
}

/**
 * What all parts of a block must have together: a last level without children in the block (S006).
 * @param {BlockFields} fields
 * @param {number} where
 */
export function checkComplete(fields, where) {
  const last = fields.levels[fields.levels.length - 1];
  if (last.link.some((link) => link === NEAR || link === FAR)) {
    throw new EsvoError('S006', where, `block ${fields.block}: voxels of its last level have children in the block`);
  }
}
