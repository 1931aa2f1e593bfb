// Components of voxels: emission, roughness and metalness, opacity, material, and named ones (section 8.7).
import { BITS } from './bytes.js';
import { need } from './errors.js';

/** @typedef {import('./block.js').Block} Block */
/** @typedef {import('./block.js').Attachment} Attachment */

/**
 * What the head of an attachment says.
 * @typedef {object} Head
 * @property {number} count Components of a value.
 * @property {number} number Format of each, 1 to 8.
 * @property {boolean} constant Whether all voxels of the block have one value.
 * @property {number} unit Words of a value.
 */

/** Words of the head. */
export const HEAD = 2;
/** Bytes of a number by format; three numbers of the last format take one word. */
const WIDTH = [0, 1, 1, 2, 2, 2, 4, 4];
const RGB9E5 = 8;
/** Number of components and formats that the types of the registry can have. @type {Record<number, [number, number[]]>} */
const REGISTERED = { 8: [3, [RGB9E5, 5, 7]], 9: [2, [2, 4]], 10: [1, [2, 4]], 11: [1, [1, 3, 6]] };

/** @param {number} type */
export const hasComponents = (type) => (type >= 8 && type <= 11) || (type >= 16 && type <= 31);

/**
 * Checks A009 and the size (A003) of a component attachment.
 * @param {Block} block
 * @param {Attachment} attachment
 * @param {number} entry Offset in the file of its entry in the directory, for errors.
 * @returns {Head}
 */
export function headOf(block, { type, at, bytes }, entry) {
  const what = `block ${block.index}: an attachment of type ${type}`;
  const size = () => need(false, 'A003', entry + 8, `${what} has ${bytes} bytes`);
  if (bytes < 4 * HEAD || bytes % 4) size();
  const [word, zero] = [block.words[at], block.words[at + 1]];
  const [count, number, form] = [word & 255, (word >> 8) & 255, (word >> 16) & 255];
  const known = number === RGB9E5 ? count === 3 : number >= 1 && number < RGB9E5 && count >= 1 && count <= 4;
  const [expected, formats] = REGISTERED[type] ?? [count, [number]];
  const right = known && form <= 1 && word >>> 24 === 0 && zero === 0 && count === expected && formats.includes(number);
  need(right, 'A009', block.where + 4 * at, `${what} has a head that is none of this type`);
  const unit = number === RGB9E5 ? 1 : Math.ceil((count * WIDTH[number]) / 4);
  const values = bytes / 4 - HEAD - (form ? 0 : block.slots);
  if (form ? values !== unit : values < 0 || values % unit) size();
  return { count, number, constant: form === 1, unit };
}

/**
 * The numbers of a value.
 * @param {Uint32Array} words
 * @param {number} at Of its first word.
 * @param {Head} head
 */
export function decodeComponents(words, at, { count, number }) {
  if (number === RGB9E5) {
    const unit = 2 ** ((words[at] >>> 27) - 24);
    return [0, 9, 18].map((shift) => ((words[at] >>> shift) & 511) * unit);
  }
  const data = new DataView(words.buffer, words.byteOffset + 4 * at);
  return Array.from({ length: count }, (_, k) => {
    if (number === 1) return data.getUint8(k);
    if (number === 2) return data.getUint8(k) / 255;
    if (number === 3) return data.getUint16(2 * k, true);
    if (number === 4) return data.getUint16(2 * k, true) / 65535;
    if (number === 5) return half(data.getUint16(2 * k, true));
    return number === 6 ? data.getUint32(4 * k, true) : data.getFloat32(4 * k, true);
  });
}

/** @param {number} bits A number of IEEE 754 binary16. */
function half(bits) {
  const [exponent, mantissa] = [(bits >> 10) & 31, bits & 1023];
  const size = exponent === 31 ? (mantissa ? NaN : Infinity) : (exponent ? 1024 + mantissa : mantissa) * 2 ** (Math.max(exponent, 1) - 25);
  return bits >> 15 ? -size : size;
}

/**
 * The components of the voxel in a child slot of a descriptor, or `undefined` if the file says nothing: then it has the default.
 * @param {Block} block
 * @param {Attachment} attachment
 * @param {number} slot Of the descriptor in the block.
 * @param {number} child
 */
export function componentsOf(block, attachment, slot, child) {
  const { words } = block;
  const head = /** @type {Head} */ (attachment.head);
  if (head.constant) return decodeComponents(words, attachment.at + HEAD, head);
  const entry = words[attachment.at + HEAD + slot];
  if (entry === 0) return undefined;
  const mask = entry & 255;
  const rank = BITS[(mask >> child) & 1 ? mask & ((1 << child) - 1) : mask];
  return decodeComponents(words, attachment.at + (entry >>> 8) + rank * head.unit, head);
}

/**
 * A005, A007, A008 and A010 of a component attachment.
 * @param {Block} block
 * @param {Attachment} attachment
 * @param {(slot: number) => boolean} isDescriptor
 */
export function checkComponents(block, { type, at: first, bytes, head: found }, isDescriptor) {
  const { words, index, slots } = block;
  const head = /** @type {Head} */ (found);
  const at = (/** @type {number} */ word) => block.where + 4 * (first + word);
  const valuesAt = head.constant ? HEAD : HEAD + slots;
  const total = bytes / 4;
  const bits = head.number === RGB9E5 ? 0 : (8 * WIDTH[head.number] * head.count) % 32;
  for (let word = valuesAt; word < total; word += head.unit) {
    const numbers = decodeComponents(words, first + word, head);
    const good = numbers.every((x) => Number.isFinite(x) && (type !== 8 || x >= 0)) && (bits === 0 || words[first + word + head.unit - 1] >>> bits === 0);
    need(good, 'A010', at(word), `block ${index}: a value of attachment type ${type} is not finite, is negative, or has unused bits`);
  }
  if (head.constant) return;
  const used = new Uint8Array(total);
  for (let slot = 0; slot < slots; slot++) {
    const entry = words[first + HEAD + slot];
    if (entry === 0) continue;
    need(isDescriptor(slot), 'A005', at(HEAD + slot), `block ${index}: the entry of slot ${slot}, which has no descriptor, is not zero`);
    const [mask, valid, from] = [entry & 255, (words[2 * slot] >> 8) & 255, entry >>> 8];
    const count = (BITS[mask] + (valid & ~mask ? 1 : 0)) * head.unit;
    need((mask & ~valid) === 0 && from >= valuesAt && from + count <= total, 'A007', at(HEAD + slot), `block ${index}: the values of slot ${slot} are not within the attachment of type ${type}`);
    for (let word = from; word < from + count; word++) used[word] = Math.min(used[word] + 1, 2);
  }
  for (let word = valuesAt; word < total; word++) need(used[word] === 1, 'A008', at(word), `block ${index}: a value belongs to ${used[word] ? 'several descriptors' : 'no descriptor'}`);
}
