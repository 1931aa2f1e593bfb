// From stored bytes to the image of a block (sections 4.1, 4.3 and 4.4).
import { viewOf, wordsOf } from './bytes.js';
import { crc32 } from './crc32.js';
import { EsvoError, need } from './errors.js';
import { checkComplete, readFields } from './fields.js';
import { layOut } from './layout.js';
import { PART_HEADER } from './tables.js';
import { decodeFrame } from './zstd.js';

/** @typedef {import('./tables.js').BlockEntry} BlockEntry */
/** @typedef {import('./tables.js').PartEntry} PartEntry */

/**
 * Checks a part: S004, S005.
 * @param {Uint8Array} bytes The part.
 * @param {PartEntry} part
 * @param {number} codec
 * @returns {number} Its checksum.
 */
export function checkPart(bytes, part, codec) {
  const view = viewOf(bytes);
  const what = `the part of block ${part.block} from level ${part.first} on`;
  const crc = view.getUint32(0, true);
  need(crc32(bytes.subarray(4)) === crc, 'S004', part.fileAt, `${what} is damaged: its checksum differs`);
  const same = view.getUint32(4, true) === part.size && view.getUint32(8, true) === part.block && bytes[12] === part.first && bytes[13] === part.last && bytes[14] === codec && bytes[15] === 0;
  need(same, 'S005', part.fileAt, `the header of ${what} differs from the table`);
  return crc;
}

/**
 * Decodes the stored bytes of codecs 0 and 1 (B005).
 * @param {number} index
 * @param {number} codec
 * @param {number} size Of the image.
 * @param {Uint8Array} bytes
 * @param {number} where
 */
export function decodeWhole(index, codec, size, bytes, where) {
  if (codec === 0) {
    need(bytes.length === size, 'B005', where, `block ${index}: it has ${bytes.length} bytes, expected ${size} with codec 0`);
    return wordsOf(bytes).slice();
  }
  const decoded = decodeFrame(bytes, size);
  if (typeof decoded === 'string') throw new EsvoError('B005', where, `block ${index}: ${decoded}`);
  return wordsOf(decoded);
}

/**
 * The image of a block from all of its stored bytes: B006, B005 (the frame), S004, S005, S006.
 * @param {number} index
 * @param {BlockEntry} block
 * @param {PartEntry[] | undefined} parts Its parts by level, of a file that is stored in parts.
 * @param {(offset: number, length: number) => Uint8Array} read Bytes of the file.
 * @returns {{ words: Uint32Array, links: import('./layout.js').Link[] }} With links of codec 2, which are leaves in the words.
 */
export function decodeBlock(index, block, parts, read) {
  if (!parts) {
    const bytes = read(block.fileAt, block.stored);
    need(crc32(bytes) === block.crc, 'B006', block.fileAt, `block ${index} is damaged: its checksum differs`);
    return { words: decodeWhole(index, block.codec, block.size, bytes, block.fileAt), links: [] };
  }
  const stored = parts.map((part) => read(part.fileAt, part.size));
  const crcs = Uint32Array.from(parts, (part, k) => checkPart(stored[k], part, block.codec));
  need(crc32(new Uint8Array(crcs.buffer)) === block.crc, 'B006', block.fileAt, `block ${index}: its checksum is not that of its parts`);
  if (block.codec !== 2) return { words: decodeWhole(index, block.codec, block.size, stored[0].subarray(PART_HEADER), block.fileAt), links: [] };
  /** @type {import('./layout.js').BlockFields | undefined} */
  let fields;
  parts.forEach((part, k) => (fields = readFields(fields, index, stored[k].subarray(PART_HEADER), part, part.fileAt)));
  if (!fields) throw new EsvoError('S003', block.fileAt, `block ${index} has no parts`);
  checkComplete(fields, block.fileAt);
  return layOutBlock(fields, block);
}

/**
 * @param {import('./layout.js').BlockFields} fields
 * @param {BlockEntry} block
 */
function layOutBlock(fields, block) {
  /** @type {(what: string) => never} */
  const fail = (what) => {
    throw new EsvoError('S006', block.fileAt, `block ${fields.block}: ${what}`);
  };
  const layout = layOut(fields);
  if (typeof layout === 'string') return fail(layout);
  if (layout.slots !== fields.slots) fail(`the array has ${layout.slots} slots, not ${fields.slots}`);
  if (layout.words.length * 4 !== block.size) fail(`the image has ${layout.words.length * 4} bytes, not ${block.size}`);
  return layout;
}
