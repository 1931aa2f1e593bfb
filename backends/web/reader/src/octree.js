// A whole file in memory.
import { crc32 } from './crc32.js';
import { Block } from './block.js';
import { BITS, firstNonZero } from './bytes.js';
import { EsvoError, need } from './errors.js';
import { check } from './check.js';
import { decodeBlock } from './decode.js';
import { HEADER, readDirectory, readHeader } from './header.js';
import { readPage } from './index-pages.js';
import { readMetadata } from './json.js';
import { checkHash, readHash, readInstances } from './scene.js';
import { checkStored, partsByBlock, readBlocks, readObjects, readParts } from './tables.js';
import { attributesOf } from './values.js';
import { ready } from './zstd.js';

/** @typedef {import('./header.js').Section} Section */
/** @typedef {import('./tables.js').BlockEntry} BlockEntry */
/** @typedef {import('./tables.js').ObjectEntry} ObjectEntry */
/** @typedef {import('./tables.js').PartEntry} PartEntry */

/**
 * A child descriptor.
 * @typedef {object} Node
 * @property {Block} block
 * @property {number} slot In the block.
 * @property {number} level Of its cube: 0 is the root.
 * @property {number[]} position Of its cube, in units of 2^-23 of the root cube.
 * @property {string} path A digit for each child slot from the root.
 * @property {number} valid Valid mask.
 * @property {number} leaf Leaf mask.
 * @property {number} contourMask
 * @property {boolean} far Whether its children are behind a far pointer.
 */

/**
 * Sections whose entries in the directory are right.
 * @param {Section[]} sections
 */
export function sectionsByTag(sections) {
  const found = new Map(sections.map((section) => [section.tag, section]));
  const get = (/** @type {string} */ tag) => /** @type {Section} */ (found.get(tag));
  return { objects: get('OBJT'), blocks: get('BLKT'), data: get('BLKS'), meta: found.get('META'), instances: found.get('INST'), hash: found.get('HASH'), parts: found.get('PART'), root: found.get('INDX'), pages: found.get('PAGE') };
}

/**
 * Which sections go with which feature bits (S001, I001).
 * @param {ReturnType<typeof sectionsByTag>} by
 * @param {number} required
 */
export function checkSections(by, required) {
  need(!!by.parts === ((required & 2) !== 0), 'S001', by.parts?.at ?? 16, 'section PART and required feature bit 1 do not occur together');
  need((!by.root || required & 2) && (!by.pages || by.root), 'I001', (by.root ?? by.pages)?.at ?? 16, 'INDX without required feature bit 1, or PAGE without INDX');
}

/** An octree file in memory, every byte of it checked. Make one with `openBytes`. */
export class Octree {
  /** @type {{ rule: string, offset: number, message: string }[]} The rules of level *should* that the file breaks. */
  warnings = [];

  /**
   * @param {Uint8Array} bytes The whole file.
   * @param {{ stopBefore?: 'blocks' }} [options]
   */
  constructor(bytes, options = {}) {
    const read = (/** @type {number} */ offset, /** @type {number} */ length) => bytes.subarray(offset, offset + length);
    /** The file. */
    this.bytes = bytes;
    this.header = readHeader(bytes, bytes.length);
    const { directoryAt, directoryCount, required } = this.header;
    this.sections = readDirectory(this.header, read(directoryAt, 32 * directoryCount), (section) =>
      need(section.flags & 2 || crc32(read(section.offset, section.length)) === section.crc, 'D004', section.at, `section ${section.tag} is damaged: its checksum differs`));
    const by = sectionsByTag(this.sections);
    const of = (/** @type {Section} */ section) => read(section.offset, section.length);
    /** @type {ObjectEntry[]} */
    this.objects = readObjects(of(by.objects), by.objects.offset);
    /** @type {BlockEntry[]} */
    this.table = readBlocks(of(by.blocks), by.blocks.offset, this.objects);
    checkStored(this.table, by.blocks.offset, required, by.data);
    checkSections(by, required);
    /** @type {PartEntry[] | undefined} */
    this.parts = by.parts && readParts(of(by.parts), by.parts.offset, this.table, by.data);
    /** @type {PartEntry[][] | undefined} */
    this.partsOfBlock = this.parts && by.parts && partsByBlock(this.parts, by.parts.offset, this.table, by.blocks.offset);
    if (by.root) this.#checkIndex(by.root, by.pages, by.data);
    /** @type {Record<string, unknown> | undefined} Metadata: text from strangers. */
    this.meta = by.meta && readMetadata(of(by.meta), by.meta.offset);
    /** @type {import('./scene.js').Instance[] | undefined} The scene; without it, every object is there once. */
    this.instances = by.instances && readInstances(of(by.instances), by.instances.offset, this.objects.length);
    /** @type {{ sha256: string, id: string } | undefined} */
    this.hash = by.hash && readHash(of(by.hash), by.hash);
    this.#checkGaps(by);
    /** First slot of every block in the image. */
    this.starts = this.table.map((block) => block.imageAt / 8);
    /** @type {Block[]} */
    this.blocks = [];
    if (options.stopBefore !== 'blocks') this.table.forEach((_, index) => this.blocks.push(this.#open(index, read)));
  }

  /**
   * @param {number} index
   * @param {(offset: number, length: number) => Uint8Array} read
   */
  #open(index, read) {
    const entry = this.table[index];
    const { words, links } = decodeBlock(index, entry, this.partsOfBlock?.[index], read);
    for (const { child, slot, far, low } of links) {
      need(child < this.table.length, 'S006', entry.fileAt, `block ${index}: a link to block ${child} of ${this.table.length}`);
      words[2 * slot] = low;
      words[2 * far] = this.starts[child] + 2 - (this.starts[index] + slot);
    }
    return new Block(index, words, entry.fileAt);
  }

  /**
   * I001, I002 and I003.
   * @param {Section} root
   * @param {Section | undefined} pages
   * @param {Section} data
   */
  #checkIndex(root, pages, data) {
    const { table, parts = [] } = this;
    const covered = new Uint8Array(pages?.length ?? 0);
    const seen = new Uint8Array(table.length);
    const expected = new Map(parts.map((part) => [part.fileAt, part]));
    let partCount = 0;
    const visit = (/** @type {Uint8Array} */ bytes, /** @type {number} */ where, /** @type {number} */ depth) => {
      need(depth < 64, 'I002', where, 'pages of the index are linked more than 64 deep');
      const page = readPage(bytes, where, data);
      for (const block of page.blocks) {
        const own = table[block.index];
        const same = own && !seen[block.index] && own.object === block.object && own.parent === block.parent && own.scale === block.scale
          && own.codec === block.codec && own.size === block.size && own.position.every((x, k) => x === block.position[k]);
        need(same, 'I003', where, `a page of the index: block ${block.index} is there twice, or differs from the block table`);
        seen[block.index] = 1;
      }
      for (const part of page.parts) {
        const own = expected.get(part.fileAt);
        need(own && own.block === part.block && own.size === part.size && own.first === part.first && own.last === part.last, 'I003', where, `a page of the index: a part of block ${part.block} differs from the table of parts`);
        expected.delete(part.fileAt);
        partCount++;
      }
      for (const link of page.links) {
        const at = (pages?.offset ?? 0) + link.offset;
        need(pages && link.size > 0 && link.offset + link.size <= pages.length, 'I002', where, 'a link of the index leads to no page');
        need(firstNonZero(covered, link.offset, link.offset + link.size) < 0, 'I002', where, 'two links of the index lead to the same bytes');
        covered.fill(1, link.offset, link.offset + link.size);
        const bytes = this.bytes.subarray(at, at + link.size);
        need(crc32(bytes) === link.crc, 'I002', at, 'a page of the index is damaged: its checksum differs');
        visit(bytes, at, depth + 1);
      }
    };
    visit(this.bytes.subarray(root.offset, root.offset + root.length), root.offset, 0);
    need(covered.every((byte) => byte), 'I002', pages?.offset ?? root.offset, 'bytes of PAGE belong to no page');
    need(partCount === parts.length && seen.every((byte) => byte), 'I003', root.offset, `the index has ${partCount} parts, or lacks a block; the tables have ${parts.length}`);
  }

  /** @param {ReturnType<typeof sectionsByTag>} by */
  #checkGaps(by) {
    const { bytes, header, table, parts } = this;
    const gaps = (/** @type {{ start: number, end: number }[]} */ ranges, /** @type {number} */ from, /** @type {number} */ to) => {
      let at = from;
      for (const { start, end } of [...ranges.sort((a, b) => a.start - b.start || a.end - b.end), { start: to, end: to }]) {
        const found = firstNonZero(bytes, at, start);
        need(found < 0, 'D009', found, 'a byte outside all sections and blocks is not zero');
        at = Math.max(at, end);
      }
    };
    const ranges = this.sections.map(({ offset, length }) => ({ start: offset, end: offset + length }));
    gaps([{ start: 0, end: HEADER }, { start: header.directoryAt, end: header.directoryAt + 32 * header.directoryCount }, ...ranges], 0, bytes.length);
    const stored = parts ? parts.map((part) => ({ start: part.fileAt, end: part.fileAt + part.size })) : table.map((block) => ({ start: block.fileAt, end: block.fileAt + block.stored }));
    gaps(stored, by.data.offset, by.data.offset + by.data.length);
  }

  /**
   * The block that has a slot of the image; -1 if none has.
   * @param {number} slot
   */
  blockOfSlot(slot) {
    const { starts, table } = this;
    let [low, high] = [0, starts.length];
    while (low < high) {
      const middle = (low + high) >> 1;
      if (starts[middle] <= slot) low = middle + 1;
      else high = middle;
    }
    return low > 0 && slot < starts[low - 1] + table[low - 1].size / 8 ? low - 1 : -1;
  }

  /**
   * The first child's descriptor of a descriptor that has children with descriptors.
   * @param {Block} block
   * @param {number} slot
   * @returns {{ block: Block, slot: number }}
   */
  firstChild(block, slot) {
    const low = block.words[2 * slot];
    const pointer = low >>> 17;
    if (!(low & 0x10000)) return { block, slot: slot + pointer };
    const to = slot + block.words[2 * (slot + pointer)];
    if (to < block.slots) return { block, slot: to };
    const other = this.blockOfSlot(this.starts[block.index] + to);
    return { block: this.blocks[other], slot: this.starts[block.index] + to - this.starts[other] };
  }

  /**
   * The descriptors of an object, depth first, in the order of the child slots.
   * @param {number} object
   * @param {number} [below] Only those above this level.
   * @returns {Generator<Node>}
   */
  *nodes(object, below = 23) {
    const { rootBlock } = this.objects[object];
    /** @type {{ block: Block, slot: number, position: number[], path: string }[]} */
    const stack = [{ block: this.blocks[rootBlock], slot: 2, position: [0, 0, 0], path: '' }];
    for (let top = stack.pop(); top; top = stack.pop()) {
      const { block, slot, position, path } = top;
      const [low, high] = [block.words[2 * slot], block.words[2 * slot + 1]];
      const [valid, leaf, level] = [(low >> 8) & 255, low & 255, path.length];
      yield { block, slot, level, position, path, valid, leaf, contourMask: high & 255, far: (low & 0x10000) !== 0 };
      const inner = valid & ~leaf;
      if (!inner || level + 1 >= below) continue;
      const first = this.firstChild(block, slot);
      for (let child = 7, number = BITS[inner] - 1; child >= 0; child--) {
        if (!((inner >> child) & 1)) continue;
        stack.push({ block: first.block, slot: first.slot + number--, position: childPosition(position, level, child), path: path + child });
      }
    }
  }

  /**
   * The attributes of the voxel in a child slot of a descriptor.
   * @param {Node} node
   * @param {number} child
   * @param {number[]} [at] Where in the voxel, 0 to 1 on each axis; for attributes at corners.
   */
  voxel(node, child, at) {
    return attributesOf(node.block, node.slot, child, at);
  }

  /**
   * Checks all descriptors. A broken rule of level *must* throws, those of level *should* are returned.
   * @returns {{ rule: string, offset: number, message: string }[]}
   */
  check() {
    return check(this);
  }
}

/**
 * @param {number[]} position
 * @param {number} level Of the cube.
 * @param {number} child
 */
export function childPosition(position, level, child) {
  const half = 2 ** (22 - level);
  return position.map((x, axis) => x + half * ((child >> axis) & 1));
}

/**
 * Opens a file that is in memory and checks every rule of the specification.
 * @param {Uint8Array | ArrayBuffer} file
 * @param {{ maxImageBytes?: number }} [options] Files whose blocks take more memory are refused; 1 GiB.
 * @returns {Promise<Octree>} Its `warnings` have the rules of level *should* that it breaks.
 */
export async function openBytes(file, { maxImageBytes = 2 ** 30 } = {}) {
  await ready();
  const bytes = file instanceof Uint8Array ? file : new Uint8Array(file);
  const tables = new Octree(bytes, { stopBefore: 'blocks' });
  const image = tables.table.reduce((sum, block) => sum + block.size, 0);
  if (image > maxImageBytes) throw new EsvoError('limit', tables.table[0].fileAt, `the octree takes ${image} bytes, more than the limit of ${maxImageBytes}: stream it, or raise maxImageBytes`);
  const octree = new Octree(bytes);
  octree.warnings = octree.check();
  if (octree.hash) await checkHash(bytes, octree.hash, octree.sections.find(({ tag }) => tag === 'HASH')?.offset ?? 0);
  return octree;
}
