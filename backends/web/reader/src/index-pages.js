// The index: pages that say of every block and every part what a reader needs to fetch them (section 4.5).
import { viewOf } from './bytes.js';
import { need } from './errors.js';
import { checkLevels, PART_HEADER } from './tables.js';
import { decodeFrame } from './zstd.js';

const NOTHING = 0xffffffff;

/**
 * @typedef {object} IndexBlock
 * @property {number} index Of the block in the file.
 * @property {number} object
 * @property {number} parent
 * @property {[number, number, number]} position
 * @property {number} scale
 * @property {number} codec
 * @property {number} size In the image in bytes.
 */

/**
 * @typedef {object} PageLink
 * @property {number} offset In PAGE.
 * @property {number} size
 * @property {number} crc
 * @property {number | undefined} object Undefined if there are several.
 * @property {number} first The least level of the parts below.
 * @property {[number, number, number]} position
 * @property {number} scale
 */

/**
 * @typedef {object} IndexPage
 * @property {IndexBlock[]} blocks
 * @property {import('./tables.js').PartEntry[]} parts By offset.
 * @property {PageLink[]} links
 */

/**
 * Decodes a page (I001).
 * @param {Uint8Array} bytes
 * @param {number} where Offset in the file, for errors.
 * @param {{ offset: number, length: number }} data The section BLKS.
 * @returns {IndexPage}
 */
export function readPage(bytes, where, data) {
  need(bytes.length > 12, 'I001', where, `a page of the index has ${bytes.length} bytes`);
  const view = viewOf(bytes);
  const [blockCount, partCount, linkCount] = [0, 4, 8].map((at) => view.getUint32(at, true));
  const size = 4 * (9 * blockCount + 6 * partCount + 9 * linkCount);
  need(size <= (bytes.length - 12) * 32768, 'I001', where, `${bytes.length - 12} bytes cannot decompress to a page of ${size}`);
  const decoded = decodeFrame(bytes.subarray(12), size);
  need(typeof decoded !== 'string' && decoded.length === size, 'I001', where, `a page of the index: ${decoded}`);
  let at = 0;
  const columns = (/** @type {number} */ number, /** @type {number} */ count) =>
    Array.from({ length: number }, () => {
      const words = new Uint32Array(count);
      for (let plane = 0; plane < 4; plane++) for (let k = 0; k < count; k++) words[k] |= decoded[at++] << (8 * plane);
      return words;
    });
  const b = columns(9, blockCount);
  const p = columns(6, partCount);
  const l = columns(9, linkCount);

  /** @type {IndexBlock[]} */
  const blocks = [];
  for (let k = 0, index = 0; k < blockCount; k++) {
    index = (index + b[0][k]) >>> 0;
    need(k === 0 || index > blocks[k - 1].index, 'I001', where, 'the blocks of a page are not in their order');
    blocks.push({ index, object: b[1][k], parent: (index - b[2][k]) >>> 0, position: [b[3][k], b[4][k], b[5][k]], scale: b[6][k], codec: b[7][k], size: b[8][k] * 8192 });
  }
  const parts = [];
  for (let k = 0, number = 0, end = 0; k < partCount; k++) {
    number = (number + p[0][k]) >>> 0;
    need(number < blockCount, 'I001', where, `part ${k} of a page is of block ${number} of ${blockCount}`);
    const offset = end + 8 * (p[4][k] + p[5][k] * 4294967296);
    const part = { block: blocks[number].index, size: p[1][k], first: p[2][k], last: p[3][k], fileAt: data.offset + offset };
    need(part.size > PART_HEADER && offset + part.size <= data.length, 'I001', where, `part ${k} of a page is not within the block data`);
    checkLevels(`part ${k} of a page`, part, blocks[number].codec, where);
    end = Math.ceil((offset + part.size) / 8) * 8;
    parts.push(part);
  }
  const links = Array.from(l[0], (offset, k) => ({
    offset, size: l[1][k], crc: l[2][k], object: l[3][k] === NOTHING ? undefined : l[3][k], first: l[4][k],
    position: /** @type {[number, number, number]} */ ([l[5][k], l[6][k], l[7][k]]), scale: l[8][k],
  }));
  return { blocks, parts, links };
}
