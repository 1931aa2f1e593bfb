/**
 * A view of bytes for numbers, little-endian.
 * @param {Uint8Array} bytes
 */
export function viewOf(bytes) {
  return new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
}

/**
 * A u64. Those above 2^53 are rounded: they are larger than any length that there can be.
 * @param {DataView} view
 * @param {number} at
 */
export function u64(view, at) {
  return view.getUint32(at, true) + view.getUint32(at + 4, true) * 4294967296;
}

/**
 * Number of bits that are set.
 * @param {number} x
 */
export function bits(x) {
  x -= (x >>> 1) & 0x55555555;
  x = (x & 0x33333333) + ((x >>> 2) & 0x33333333);
  return (((x + (x >>> 4)) & 0x0f0f0f0f) * 0x01010101) >>> 24;
}

/** `BITS[x]` is the number of bits of the byte `x`. */
export const BITS = Uint8Array.from({ length: 256 }, (_, x) => bits(x));

/**
 * The words of bytes, copied where they are not aligned. Lengths that are no multiple of four lose their end.
 * @param {Uint8Array} bytes
 */
export function wordsOf(bytes) {
  const count = bytes.byteLength >>> 2;
  if (bytes.byteOffset % 4 === 0) return new Uint32Array(bytes.buffer, bytes.byteOffset, count);
  return new Uint32Array(bytes.slice(0, count * 4).buffer);
}

/**
 * @param {Uint8Array} bytes
 * @param {number} from
 * @param {number} to
 * @returns {number} Offset of the first byte that is not zero, or -1.
 */
export function firstNonZero(bytes, from, to) {
  for (let at = from; at < to; at++) if (bytes[at] !== 0) return at;
  return -1;
}

/**
 * `{ start, end }` that overlap, by the definition of section 1.2.
 * @param {{ start: number, end: number }[]} ranges
 * @returns {{ start: number, end: number } | undefined} One that overlaps another.
 */
export function overlapping(ranges) {
  const sorted = [...ranges].sort((a, b) => a.start - b.start || a.end - b.end);
  let end = -1;
  for (const range of sorted) {
    if (range.start < end) return range;
    end = Math.max(end, range.end);
  }
  return undefined;
}
