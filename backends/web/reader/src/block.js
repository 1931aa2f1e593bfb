// The image of a block (section 4.2, 6 and 8): where things are in it, and the checks of that.
import { hasComponents, headOf } from './components.js';
import { need } from './errors.js';
import { PAIR_BYTES } from './layout.js';

/**
 * @typedef {object} Attachment
 * @property {number} type
 * @property {number} at First word in the image of the block.
 * @property {number} bytes
 * @property {import('./components.js').Head} [head] Of component attachments.
 */

/** The image of a block. */
export class Block {
  /**
   * Checks what step 5 of section 11.2 checks: P001 (the first page header), P002, P003, P004, A004, P006 (the reserved field), P005, A003, A001,
   * A002, A009.
   * @param {number} index
   * @param {Uint32Array} words
   * @param {number} where Offset in the file, for errors.
   */
  constructor(index, words, where) {
    this.index = index;
    this.words = words;
    this.where = where;
    const slots = words[0];
    const total = words.length / 2;
    need(words[1] === 0 && slots >= 4 && slots <= total, 'P001', where, `block ${index}: the first page header says that the array has ${slots} slots`);
    const info = 2 * slots;
    need(info + 8 <= words.length && words[info + 1] === slots, 'P002', where, `block ${index}: the info section is not directly after an array of ${slots} slots`);
    need(words[info] === index, 'P003', where + 4 * info, `block ${index}: its info section names block ${words[info]}`);
    need(words[info + 2] === slots - 2, 'P004', where + 4 * info + 8, `block ${index}: the first descriptor is ${words[info + 2]} slots before the info section, expected ${slots - 2}`);
    const count = words[info + 5];
    need(count <= 64, 'A004', where + 4 * info + 20, `block ${index}: it has ${count} attachments, expected at most 64`);
    need(words[info + 6] === 0 && words[info + 7] === 0, 'P006', where + 4 * info + 24, `block ${index}: the reserved field of the info section is not zero`);
    const directoryEnd = info + 8 + 4 * count;
    need(directoryEnd <= words.length, 'P002', where + 4 * info, `block ${index}: the attachment directory is not within the block`);
    /** Slots of the descriptor array. */
    this.slots = slots;
    /** First word of the info section. */
    this.info = info;
    /** First word of the contour pool, and number of contours. */
    this.pool = info + words[info + 3];
    this.contours = words[info + 4];
    need(this.pool >= directoryEnd && this.pool + this.contours <= words.length, 'P005', where + 4 * info + 12, `block ${index}: the contour pool is not within the block, after the attachment directory`);
    /** @type {Attachment[]} */
    this.attachments = [];
    for (let k = 0; k < count; k++) this.attachments.push(this.#attachment(info + 8 + 4 * k));
    this.#checkAttachments();
  }

  /** @param {number} entry Word of the entry of the directory. */
  #attachment(entry) {
    const { words, index, info, slots } = this;
    const where = this.where + 4 * entry;
    const [type, offset] = [words[entry], words[entry + 1]];
    const bytes = words[entry + 2] + words[entry + 3] * 4294967296;
    const pairs = (slots + 1) >> 1;
    const right =
      PAIR_BYTES[type] ? bytes === pairs * PAIR_BYTES[type]
      : type === 3 ? bytes === 8
      : type === 5 || type === 6 ? bytes >= 4 * slots && bytes % 4 === 0
      : type === 7 ? bytes >= 8 * slots && bytes % 8 === 0 : true;
    need(right, 'A003', where + 8, `block ${index}: an attachment of type ${type} has ${bytes} bytes`);
    const start = 4 * info + offset;
    need(start % 8 === 0 && start >= 4 * (this.pool + this.contours) && start + bytes <= 4 * words.length, 'A001', where + 4,
      `block ${index}: an attachment of type ${type} is not within the block after the contours, or not aligned to 8 bytes`);
    return { type, at: start / 4, bytes };
  }

  #checkAttachments() {
    const { attachments, index } = this;
    const where = this.where + 4 * this.info + 32;
    for (let k = 0; k < attachments.length; k++) {
      const a = attachments[k];
      for (let i = 0; i < k; i++) {
        const b = attachments[i];
        need(!(4 * a.at < 4 * b.at + b.bytes && 4 * b.at < 4 * a.at + a.bytes), 'A001', where + 16 * k, `block ${index}: attachments ${i} and ${k} overlap`);
      }
      const { type } = a;
      need((type >= 1 && type <= 7) || hasComponents(type) || (type >= 0x8000 && type <= 0xffff), 'A002', where + 16 * k, `block ${index}: there is no attachment type ${type}`);
      need(attachments.findIndex((other) => other.type === type) === k, 'A002', where + 16 * k, `block ${index}: attachment type ${type} occurs twice`);
    }
    for (const [name, types] of /** @type {[string, number[]][]} */ ([['colours', COLORS], ['normals', NORMALS]])) {
      need(attachments.filter(({ type }) => types.includes(type)).length <= 1, 'A002', where, `block ${index}: it has ${name} of two types`);
    }
    attachments.forEach((attachment, k) => {
      if (hasComponents(attachment.type)) attachment.head = headOf(this, attachment, where + 16 * k);
    });
  }

  /**
   * The attachment of a type, or `undefined`.
   * @param {number} type
   */
  attachment(type) {
    return this.attachments.find((attachment) => attachment.type === type);
  }

  /** @param {number[]} types */
  hasAny(types) {
    return this.attachments.some(({ type }) => types.includes(type));
  }
}

/** Types with colours, with normals, with ambient occlusion (section 8). */
export const COLORS = [1, 3, 5, 7];
export const NORMALS = [2, 6, 7];
export const AMBIENT = [4];
