// Reads a file piece by piece: the head, pages of the index, single blocks and parts (sections 4.5 and 11.3).
import { BITS } from './bytes.js';
import { crc32 } from './crc32.js';
import { checkPart, decodeWhole } from './decode.js';
import { EsvoError, need } from './errors.js';
import { readFields } from './fields.js';
import { readDirectory, readHeader } from './header.js';
import { readPage } from './index-pages.js';
import { readMetadata } from './json.js';
import { layOut } from './layout.js';
import { checkSections, sectionsByTag } from './octree.js';
import { NO_PARENT, PART_HEADER, checkCodec, checkPlace, checkStored, firstLevel, partsByBlock, readBlocks, readObjects, readParts } from './tables.js';
import { walkBlock } from './walk-block.js';
import { ready } from './zstd.js';

/** @typedef {import('./source.js').Source} Source */
/** @typedef {import('./tables.js').PartEntry} PartEntry */
/** @typedef {import('./index-pages.js').PageLink} PageLink */

/** The first request. It brings the head of most files, and the coarse parts behind it. */
const FIRST = 1 << 15;
/** Gaps between ranges that are read along rather than asked around, and most bytes of a request. */
const MAX_GAP = 1 << 16;
const MAX_REQUEST = 1 << 22;
/** Most bytes of a table, of a page and of a block's image. */
const MAX_TABLE = 1 << 26;
const MAX_BLOCK = 1 << 28;

/**
 * What is known of a block.
 * @typedef {object} ServedBlock
 * @property {number} index
 * @property {number} object
 * @property {number} parent
 * @property {[number, number, number]} position
 * @property {number} scale
 * @property {number} codec
 * @property {number} size In the image in bytes.
 * @property {number} first Level of its first descriptors.
 * @property {PartEntry[]} parts By level. A block of a file without parts has one, without a header.
 * @property {number} crc Of the stored bytes, of a file without parts.
 */

/**
 * The image of a block, of some of its parts. Descriptors with links to other blocks have leaves in their place.
 * @typedef {object} Image
 * @property {Uint32Array} words
 * @property {number} slots Of the descriptor array.
 * @property {number} firstCount Number of its first descriptors, from slot 2 on.
 * @property {BlockLink[]} links
 */

/**
 * @typedef {object} BlockLink A descriptor whose children are in another block.
 * @property {number} [child] Index of that block; else it is the one with this cube.
 * @property {number[]} [position]
 * @property {number} [scale]
 * @property {number} slot Of the descriptor.
 * @property {number} far Slot of its far pointer.
 * @property {number} low The low word of the descriptor with the link.
 * @property {number} leaf The low word with leaves in place of the link.
 */

/** A file that is read piece by piece. Make one with `openSource`. */
export class Served {
  /** @type {Map<number, ServedBlock>} What is known so far. */
  blocks = new Map();
  /** @type {PageLink[]} Pages that were not read yet. */
  links = [];
  /** @type {Record<string, unknown> | undefined} */
  meta = undefined;
  /** @type {{ at: number, bytes: Uint8Array }} The first bytes of the file. */
  #start = { at: 0, bytes: new Uint8Array(0) };

  /**
   * @param {Source} source
   * @param {Uint8Array} start
   * @param {import('./header.js').Header} header
   */
  constructor(source, start, header) {
    this.source = source;
    this.header = header;
    this.#start.bytes = start;
    /** @type {import('./tables.js').ObjectEntry[]} */
    this.objects = [];
    /** @type {ReturnType<typeof sectionsByTag>} */
    this.by = sectionsByTag([]);
  }

  /** Whether the blocks are stored in parts. */
  get inParts() {
    return (this.header.required & 2) !== 0;
  }

  /**
   * Bytes of the file; those of the first request are there already.
   * @param {number} offset
   * @param {number} length
   * @param {AbortSignal} [signal]
   */
  async read(offset, length, signal) {
    const { bytes } = this.#start;
    if (offset + length <= bytes.length) return bytes.subarray(offset, offset + length);
    const found = await this.source.read(offset, length, signal);
    if (found.length !== length) throw new EsvoError('H004', offset, `the file ends before byte ${offset + length}: it was cut`);
    return found;
  }

  /** @param {import('./header.js').Section} section */
  async #section(section) {
    if (section.length > MAX_TABLE) throw new EsvoError('limit', section.offset, `section ${section.tag} has ${section.length} bytes, this reader takes ${MAX_TABLE} at most`);
    const bytes = await this.read(section.offset, section.length);
    need(section.flags & 2 || crc32(bytes) === section.crc, 'D004', section.at, `section ${section.tag} is damaged: its checksum differs`);
    return bytes;
  }

  /**
   * Reads directory, objects, and the root page of the index or the tables.
   * @param {boolean} tables
   */
  async open(tables) {
    const { header } = this;
    if (header.head > this.#start.bytes.length && header.head <= MAX_TABLE) {
      const rest = await this.read(this.#start.bytes.length, header.head - this.#start.bytes.length);
      const all = new Uint8Array(header.head);
      all.set(this.#start.bytes);
      all.set(rest, this.#start.bytes.length);
      this.#start.bytes = all;
    }
    const sections = readDirectory(header, await this.read(header.directoryAt, 32 * header.directoryCount));
    const by = sectionsByTag(sections);
    this.by = by;
    checkSections(by, header.required);
    this.objects = readObjects(await this.#section(by.objects), by.objects.offset);
    if (by.root && !tables) {
      this.#add(await this.#section(by.root), by.root.offset);
    } else {
      await this.#readTables(by);
    }
    for (const [number, object] of this.objects.entries()) {
      const root = this.blocks.get(object.rootBlock);
      need(root ? root.object === number && root.parent === NO_PARENT : this.links.length > 0, 'O002', by.objects.offset, `object ${number}: its root block ${object.rootBlock} is none of its own`);
    }
    return this;
  }

  /** @param {ReturnType<typeof sectionsByTag>} by */
  async #readTables(by) {
    const blocks = readBlocks(await this.#section(by.blocks), by.blocks.offset, this.objects);
    checkStored(blocks, by.blocks.offset, this.header.required, by.data);
    const parts = by.parts && readParts(await this.#section(by.parts), by.parts.offset, blocks, by.data);
    const own = parts && by.parts && partsByBlock(parts, by.parts.offset, blocks, by.blocks.offset);
    blocks.forEach(({ object, parent, position, scale, codec, size, fileAt, stored, crc }, index) => {
      const first = firstLevel({ parent, scale });
      const whole = [{ block: index, size: stored, first, last: 22, fileAt }];
      this.blocks.set(index, { index, object, parent, position, scale, codec, size, first, parts: own?.[index] ?? whole, crc });
    });
  }

  /**
   * Reads the metadata, if the file has any: text from strangers.
   */
  async readMetadata() {
    const { meta } = this.by;
    if (meta && !this.meta) this.meta = readMetadata(await this.#section(meta), meta.offset);
    return this.meta;
  }

  /**
   * Adds what a page of the index says.
   * @param {Uint8Array} bytes
   * @param {number} where
   */
  #add(bytes, where) {
    const { data, pages } = this.by;
    const page = readPage(bytes, where, data);
    /** @type {ServedBlock[]} */
    const found = [];
    for (const block of page.blocks) {
      need(!this.blocks.has(block.index), 'I003', where, `block ${block.index} is in two pages of the index`);
      const blocks = /** @type {any} */ (new Proxy(this.blocks, { get: (map, key) => map.get(Number(key)) }));
      checkPlace(block.index, block, blocks, this.objects, where);
      checkCodec(block.index, block.codec, this.header.required, where);
      const served = { ...block, first: firstLevel(block), parts: [], crc: 0 };
      this.blocks.set(block.index, served);
      found.push(served);
    }
    for (const part of page.parts) this.blocks.get(part.block)?.parts.push(part);
    for (const { index, parts, first, codec } of found) {
      parts.sort((a, b) => a.first - b.first);
      need(parts.length > 0 && (parts.length === 1 || codec === 2), 'S003', where, `block ${index} has ${parts.length} parts`);
      parts.forEach((part, k) => need(part.first === (k ? parts[k - 1].last + 1 : first), 'S003', where, `the parts of block ${index} do not follow each other by level`));
    }
    for (const link of page.links) {
      need(pages && link.size > 12 && link.size <= MAX_TABLE && link.offset + link.size <= pages.length, 'I002', where, 'a link of the index leads to no page');
      need(this.links.length < 1 << 20, 'I002', where, 'the index has too many pages');
      this.links.push(link);
    }
    return found;
  }

  /**
   * Reads a page of the index; it is no longer in `links` then.
   * @param {PageLink} link
   * @param {AbortSignal} [signal]
   * @returns {Promise<ServedBlock[]>} The blocks of the page.
   */
  async readPage(link, signal) {
    const at = (this.by.pages?.offset ?? 0) + link.offset;
    const bytes = await this.read(at, link.size, signal);
    need(crc32(bytes) === link.crc, 'I002', at, 'a page of the index is damaged: its checksum differs');
    this.links.splice(this.links.indexOf(link) >>> 0, 1);
    return this.#add(bytes, at);
  }

  /**
   * Reads parts. Those that lie close together come with one request.
   * @param {PartEntry[]} parts
   * @param {(part: PartEntry, bytes: Uint8Array) => void} take Called with each part once it is there and checked.
   * @param {AbortSignal} [signal]
   */
  async readParts(parts, take, signal) {
    const runs = coalesce(parts);
    await Promise.all(runs.map(async ({ start, end, parts: own }) => {
      const bytes = await this.read(start, end - start, signal);
      for (const part of own) {
        const stored = bytes.subarray(part.fileAt - start, part.fileAt - start + part.size);
        this.#checkStored(part, stored);
        take(part, stored);
      }
    }));
  }

  /**
   * @param {PartEntry} part
   * @param {Uint8Array} bytes
   */
  #checkStored(part, bytes) {
    const block = this.blocks.get(part.block);
    if (!block) throw new EsvoError('usage', 0, `block ${part.block} is not known`);
    if (this.inParts) checkPart(bytes, part, block.codec);
    else need(crc32(bytes) === block.crc, 'B006', part.fileAt, `block ${part.block} is damaged: its checksum differs`);
  }

  /**
   * The image of a block, of its first parts, whose bytes were read. Pointers are checked.
   * @param {number} index
   * @param {Uint8Array[]} stored One for each part, from the first on.
   * @param {number} [inner] The non-leaf mask of the descriptor that leads to it; none for a root block.
   * @returns {Image}
   */
  image(index, stored, inner) {
    const block = this.blocks.get(index);
    if (!block) throw new EsvoError('usage', 0, `block ${index} is not known`);
    const where = block.parts[0].fileAt;
    if (block.size > MAX_BLOCK) throw new EsvoError('limit', where, `block ${index} takes ${block.size} bytes, this reader takes ${MAX_BLOCK} at most`);
    if (block.codec !== 2) {
      const bytes = this.inParts ? stored[0].subarray(PART_HEADER) : stored[0];
      need(block.size <= bytes.length * (block.codec ? 32768 : 1), 'B005', where, `block ${index}: ${bytes.length} bytes cannot decompress to ${block.size}`);
      return walkBlock(block, decodeWhole(index, block.codec, block.size, bytes, where), inner);
    }
    /** @type {import('./layout.js').BlockFields | undefined} */
    let fields;
    stored.forEach((bytes, k) => (fields = readFields(fields, index, bytes.subarray(PART_HEADER), block.parts[k], block.parts[k].fileAt)));
    if (!fields) throw new EsvoError('usage', 0, `block ${index}: no parts`);
    const firstCount = inner === undefined ? 1 : BITS[inner];
    need(fields.levels[0].count === firstCount, 'S006', where, `block ${index} has ${fields.levels[0].count} first descriptors, expected ${firstCount}`);
    const layout = layOut(fields);
    if (typeof layout === 'string') throw new EsvoError('S006', where, `block ${index}: ${layout}`);
    return { ...layout, firstCount };
  }

  /**
   * The blocks that show the voxels of an object in a box of octree space down to a level (section 11.3), of those that are known.
   * @param {number[]} low
   * @param {number[]} high
   * @param {number} level
   * @param {number} object
   * @returns {number[]}
   */
  blocksFor(low, high, level, object) {
    const meets = meetsBox(low, high);
    const wanted = [...this.blocks.values()].filter((block) => block.object === object && (block.parent === NO_PARENT || (25 - block.scale <= level && meets(block))));
    return wanted.map(({ index }) => index).sort((a, b) => a - b);
  }

  /**
   * The parts for the same, in the order of their places.
   * @param {number[]} low
   * @param {number[]} high
   * @param {number} level
   * @param {number} object
   * @returns {PartEntry[]}
   */
  partsFor(low, high, level, object) {
    const all = this.blocksFor(low, high, level, object).flatMap((index) => this.blocks.get(index)?.parts ?? []);
    return all.filter((part) => part.first < level).sort((a, b) => a.fileAt - b.fileAt);
  }

  /**
   * The pages of the index that were not read and may have blocks for the same.
   * @param {number[]} low
   * @param {number[]} high
   * @param {number} level
   * @param {number} object
   * @returns {PageLink[]}
   */
  pagesFor(low, high, level, object) {
    const meets = meetsBox(low, high);
    return this.links.filter((link) => link.first < level && (link.object ?? object) === object && meets(link));
  }
}

/**
 * Whether a cube meets a box of octree space: faces belong to both.
 * @param {number[]} low
 * @param {number[]} high
 * @returns {(cube: { position: number[], scale: number }) => boolean}
 */
function meetsBox(low, high) {
  return ({ position, scale }) => position.every((x, axis) => low[axis] <= (x + 2 ** scale) * 2 ** -23 && x * 2 ** -23 <= high[axis]);
}

/**
 * Ranges that have all parts, those that lie close together in one.
 * @param {PartEntry[]} parts
 * @param {number} [maxGap] Bytes between two that are read along.
 * @param {number} [maxRequest] Bytes of a range of several.
 */
export function coalesce(parts, maxGap = MAX_GAP, maxRequest = MAX_REQUEST) {
  /** @type {{ start: number, end: number, parts: PartEntry[] }[]} */
  const runs = [];
  for (const part of [...parts].sort((a, b) => a.fileAt - b.fileAt)) {
    const run = runs.at(-1);
    const end = part.fileAt + part.size;
    if (run && part.fileAt - run.end <= maxGap && end - run.start <= maxRequest) {
      run.end = end;
      run.parts.push(part);
    } else {
      runs.push({ start: part.fileAt, end, parts: [part] });
    }
  }
  return runs;
}

/**
 * Opens a file to be read piece by piece: the header, the directory, the objects, and the root page of the index or the tables.
 * @param {Source} source
 * @param {{ tables?: boolean }} [options] `tables`: reads the tables although there is an index.
 */
export async function openSource(source, { tables = false } = {}) {
  await ready();
  const start = await source.read(0, FIRST);
  const header = readHeader(start, source.length);
  return new Served(source, start, header).open(tables);
}
