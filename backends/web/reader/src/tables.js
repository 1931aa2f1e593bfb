// The object table, the block table and the table of parts (sections 3, 4.1 and 4.3).
import { overlapping, u64, viewOf } from './bytes.js';
import { need } from './errors.js';

/** Bytes of an entry of each table, of a page, and of the header of a part. */
export const OBJECT_ENTRY = 192;
export const BLOCK_ENTRY = 72;
export const PART_ENTRY = 12;
export const PAGE = 8192;
export const PART_HEADER = 16;
/** The parent of a root block. */
export const NO_PARENT = 0xffffffff;

/**
 * @typedef {object} ObjectEntry
 * @property {number[]} octreeToMesh 16 numbers by columns.
 * @property {number} rootBlock
 * @property {number} levels
 * @property {number} rootSlot
 * @property {number} descriptors
 * @property {number} leafVoxels
 * @property {number} contours
 * @property {number} farPointers
 */

/**
 * @typedef {object} BlockEntry
 * @property {number} object
 * @property {number} parent
 * @property {[number, number, number]} position Of the cube, in units of 2^-23.
 * @property {number} scale
 * @property {number} imageAt Offset in the image in bytes.
 * @property {number} size In the image in bytes.
 * @property {number} fileAt
 * @property {number} stored Bytes in the file.
 * @property {number} codec
 * @property {number} crc
 */

/**
 * @typedef {object} PartEntry
 * @property {number} block
 * @property {number} size In bytes.
 * @property {number} first First level.
 * @property {number} last Last level.
 * @property {number} fileAt
 */

/**
 * Whether a matrix, by columns, is finite, affine and invertible.
 * @param {number[]} m
 */
export function usable(m) {
  const affine = m.every(Number.isFinite) && m[3] === 0 && m[7] === 0 && m[11] === 0 && m[15] === 1;
  const d = m[0] * (m[5] * m[10] - m[9] * m[6]) - m[4] * (m[1] * m[10] - m[9] * m[2]) + m[8] * (m[1] * m[6] - m[5] * m[2]);
  return affine && Number.isFinite(d) && Math.abs(d) >= 2 ** -1022;
}

/**
 * Reads and checks OBJT: O001, O004, O003 (the range), O006.
 * @param {Uint8Array} bytes
 * @param {number} offset In the file, for errors.
 * @returns {ObjectEntry[]}
 */
export function readObjects(bytes, offset) {
  need(bytes.length > 0 && bytes.length % OBJECT_ENTRY === 0, 'O001', offset, `the object table is empty or no multiple of ${OBJECT_ENTRY} bytes`);
  const view = viewOf(bytes);
  return Array.from({ length: bytes.length / OBJECT_ENTRY }, (_, number) => {
    const at = number * OBJECT_ENTRY;
    const m = Array.from({ length: 16 }, (_, k) => view.getFloat64(at + 8 * k, true));
    need(usable(m), 'O004', offset + at, `object ${number}: the transform is not finite, affine and invertible`);
    const levels = view.getUint32(at + 132, true);
    need(levels >= 1 && levels <= 23, 'O003', offset + at + 132, `object ${number}: it has ${levels} levels, expected 1 to 23`);
    need(bytes.subarray(at + 176, at + 192).every((byte) => byte === 0), 'O006', offset + at + 176, `object ${number}: reserved fields are not zero`);
    return {
      octreeToMesh: m, rootBlock: view.getUint32(at + 128, true), levels, rootSlot: u64(view, at + 136), descriptors: u64(view, at + 144),
      leafVoxels: u64(view, at + 152), contours: u64(view, at + 160), farPointers: u64(view, at + 168),
    };
  });
}

/**
 * Reads and checks BLKT: B001, B002, B003, B007, B008 (all but the voxel), B009, B011.
 * @param {Uint8Array} bytes
 * @param {number} offset In the file, for errors.
 * @param {ObjectEntry[]} objects
 * @returns {BlockEntry[]}
 */
export function readBlocks(bytes, offset, objects) {
  need(bytes.length > 0 && bytes.length % BLOCK_ENTRY === 0, 'B001', offset, `the block table is empty or no multiple of ${BLOCK_ENTRY} bytes`);
  const view = viewOf(bytes);
  /** @type {BlockEntry[]} */
  const blocks = [];
  let end = 0;
  for (let index = 0; index * BLOCK_ENTRY < bytes.length; index++) {
    const at = index * BLOCK_ENTRY;
    const u32 = (/** @type {number} */ k) => view.getUint32(at + k, true);
    /** @type {BlockEntry} */
    const block = {
      object: u32(0), parent: u32(4), position: [u32(8), u32(12), u32(16)], scale: u32(20), imageAt: u64(view, at + 24),
      size: u64(view, at + 32), fileAt: u64(view, at + 40), stored: u64(view, at + 48), codec: u32(56), crc: u32(60),
    };
    const where = offset + at;
    need(block.size > 0 && block.size % PAGE === 0, 'B002', where + 32, `block ${index}: image size ${block.size} is zero or no multiple of ${PAGE}`);
    need(block.imageAt % PAGE === 0, 'B002', where + 24, `block ${index}: image offset ${block.imageAt} is no multiple of ${PAGE}`);
    need(block.imageAt === end, 'B003', where + 24, `block ${index}: image offset ${block.imageAt}, expected ${end}, the end of the block before`);
    end += block.size;
    checkPlace(index, block, blocks, objects, where);
    need(u64(view, at + 64) === 0, 'B009', where + 64, `block ${index}: reserved fields are not zero`);
    blocks.push(block);
  }
  need(end <= 2 ** 35, 'B011', offset, `the image has ${end / 8} slots, expected at most 2^32`);
  return blocks;
}

/**
 * B007 and B008 (all but the voxel) of a block whose parent was read before.
 * @param {number} index
 * @param {Pick<BlockEntry, 'object' | 'parent' | 'position' | 'scale'>} block
 * @param {{ [index: number]: Pick<BlockEntry, 'object' | 'position' | 'scale'> }} blocks
 * @param {ObjectEntry[]} objects
 * @param {number} where
 */
export function checkPlace(index, block, blocks, objects, where) {
  const { object, parent, position, scale } = block;
  need(object < objects.length, 'B007', where, `block ${index}: there is no object ${object}`);
  const isRoot = objects[object].rootBlock === index;
  if (parent === NO_PARENT) need(isRoot, 'B007', where + 4, `block ${index}: it has no parent, but is not the root block of object ${object}`);
  else need(!isRoot && parent < index && blocks[parent]?.object === object, 'B007', where + 4, `block ${index}: parent ${parent} is not an earlier block of object ${object}`);
  const above = parent === NO_PARENT ? { position: [0, 0, 0], scale: 23 } : blocks[parent];
  const edge = 2 ** scale;
  const inside = (/** @type {number} */ x, /** @type {number} */ k) => x % edge === 0 && x >= above.position[k] && x + edge <= above.position[k] + 2 ** above.scale;
  need(scale >= 1 && scale <= 23 && (parent !== NO_PARENT || scale === 23) && position.every(inside), 'B008', where + 8,
    `block ${index}: the cube at ${position} of scale ${scale} is not aligned to its size, or not within the cube of its parent`);
}

/**
 * What the codec field may be (B005, the table).
 * @param {number} index
 * @param {number} codec
 * @param {number} required
 * @param {number} where
 */
export function checkCodec(index, codec, required, where) {
  need(codec <= 2, 'B005', where, `block ${index}: this reader does not know codec ${codec}`);
  need(codec === 0 || required & 1, 'B005', where, `block ${index}: codec ${codec} is used, but required feature bit 0 is clear`);
  need(codec !== 2 || required & 2, 'B005', where, `block ${index}: codec 2 is used, but required feature bit 1 is clear`);
}

/**
 * Sizes that a codec can make of the stored bytes (B005), before memory is taken for them.
 * @param {number} index
 * @param {BlockEntry} block
 * @param {number} headers Bytes of the stored ones that are headers of parts.
 * @param {number} where
 */
export function checkSizes(index, block, headers, where) {
  const bytes = block.stored - headers;
  if (block.codec === 0) need(bytes === block.size, 'B005', where, `block ${index}: the stored size is ${bytes} bytes, expected ${block.size} with codec 0`);
  else need(block.size <= bytes * (block.codec === 1 ? 32768 : 262144), 'B005', where, `block ${index}: ${bytes} compressed bytes cannot decompress to ${block.size} bytes`);
}

/**
 * B005 (the table), B003 (the size of BLKS), and B004 of files without parts.
 * @param {BlockEntry[]} blocks
 * @param {number} offset Of BLKT, for errors.
 * @param {number} required
 * @param {{ offset: number, length: number }} data The section BLKS.
 */
export function checkStored(blocks, offset, required, data) {
  const parts = (required & 2) !== 0;
  const plain = !parts && blocks.every((block) => block.codec === 0);
  const image = blocks.reduce((sum, block) => sum + block.size, 0);
  if (plain) need(image === data.length, 'B003', offset, `the blocks have ${image} bytes in total, the block data ${data.length}`);
  blocks.forEach((block, index) => {
    checkCodec(index, block.codec, required, offset + BLOCK_ENTRY * index + 56);
    checkSizes(index, block, parts ? PART_HEADER : 0, offset + BLOCK_ENTRY * index + 48);
  });
  if (parts) return;
  const places = blocks.map((block, index) => {
    const where = offset + BLOCK_ENTRY * index + 40;
    const end = block.fileAt + Math.ceil(block.stored / PAGE) * PAGE;
    need(block.fileAt % PAGE === 0 && block.fileAt >= data.offset && end <= data.offset + data.length, 'B004', where,
      `block ${index}: the ${block.stored} bytes at file offset ${block.fileAt} are not whole pages of the block data`);
    need(!plain || block.fileAt === data.offset + block.imageAt, 'B004', where, `block ${index}: file offset ${block.fileAt}, expected ${data.offset + block.imageAt}`);
    return { start: block.fileAt, end };
  });
  const twice = overlapping(places);
  need(!twice, 'B004', offset, () => `two stored blocks overlap at file offset ${twice?.start}`);
}

/**
 * Reads and checks PART: S001, S007, S002, S003.
 * @param {Uint8Array} bytes
 * @param {number} offset In the file, for errors.
 * @param {BlockEntry[]} blocks
 * @param {{ offset: number, length: number }} data The section BLKS.
 * @returns {PartEntry[]}
 */
export function readParts(bytes, offset, blocks, data) {
  need(bytes.length > 0 && bytes.length % PART_ENTRY === 0, 'S001', offset, `the table of parts is empty or no multiple of ${PART_ENTRY} bytes`);
  const view = viewOf(bytes);
  /** @type {PartEntry[]} */
  const parts = [];
  let end = data.offset;
  for (let number = 0; number * PART_ENTRY < bytes.length; number++) {
    const at = number * PART_ENTRY;
    const part = { block: view.getUint32(at, true), size: view.getUint32(at + 4, true), first: bytes[at + 8], last: bytes[at + 9], fileAt: end };
    const where = offset + at;
    need(view.getUint16(at + 10, true) === 0, 'S007', where + 10, `part ${number}: reserved fields are not zero`);
    need(part.size > PART_HEADER, 'S002', where + 4, `part ${number}: it has ${part.size} bytes, too few for a header`);
    need(part.block < blocks.length, 'S003', where, `part ${number}: there is no block ${part.block}`);
    checkLevels(`part ${number}`, part, blocks[part.block].codec, where + 8);
    end += Math.ceil(part.size / 8) * 8;
    parts.push(part);
  }
  need(end === data.offset + data.length, 'S002', offset, `the parts end at byte ${end}, the block data at ${data.offset + data.length}`);
  return parts;
}

/**
 * Levels that a part can have (S003).
 * @param {string} name
 * @param {{ first: number, last: number }} part
 * @param {number} codec
 * @param {number} where
 */
export function checkLevels(name, part, codec, where) {
  need(part.first <= part.last && part.last <= 22 && (codec === 2 || part.last === 22), 'S003', where, `${name}: levels ${part.first} to ${part.last} with codec ${codec}`);
}

/**
 * The level of a block's first descriptors.
 * @param {{ parent: number, scale: number }} block
 */
export function firstLevel(block) {
  return block.parent === NO_PARENT ? 0 : 24 - block.scale;
}

/**
 * The parts of each block by level, checked: S003 (the sequence), S008.
 * @param {PartEntry[]} parts
 * @param {number} offset Of PART, for errors.
 * @param {BlockEntry[]} blocks
 * @param {number} blocksAt Offset of BLKT, for errors.
 * @returns {PartEntry[][]}
 */
export function partsByBlock(parts, offset, blocks, blocksAt) {
  /** @type {PartEntry[][]} */
  const found = blocks.map(() => []);
  for (const part of parts) found[part.block].push(part);
  found.forEach((own, index) => {
    own.sort((a, b) => a.first - b.first);
    const where = blocksAt + BLOCK_ENTRY * index;
    need(own.length > 0 && (own.length === 1 || blocks[index].codec === 2), 'S003', offset, `block ${index} has ${own.length} parts`);
    let level = firstLevel(blocks[index]);
    for (const part of own) {
      need(part.first === level, 'S003', offset, `a part of block ${index} is from level ${part.first} on, expected ${level}`);
      level = part.last + 1;
    }
    const stored = own.reduce((sum, part) => sum + part.size, 0);
    need(blocks[index].fileAt === own[0].fileAt && blocks[index].stored === stored, 'S008', where + 40,
      `block ${index}: ${blocks[index].stored} bytes at file offset ${blocks[index].fileAt}, but its parts have ${stored} from ${own[0].fileAt} on`);
  });
  return found;
}
