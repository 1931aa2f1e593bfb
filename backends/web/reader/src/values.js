// What words of attachments and contours mean (sections 7 and 8), in binary64.
import { BITS, bits } from './bytes.js';
import { componentsOf, hasComponents } from './components.js';
import { valuesOf } from './layout.js';

/** @typedef {import('./block.js').Block} Block */
/** @typedef {number[]} Vector Three numbers. */

/**
 * @typedef {object} Contour
 * @property {number} word
 * @property {Vector} normal In octree space, not of unit length.
 * @property {number} position
 * @property {number} thickness
 */

/**
 * A contour (section 7): the slab of all `p` with `|normal · p - position| <= thickness / 2`, from the centre of the voxel, in edges.
 * @param {number} w
 * @returns {Contour}
 */
export function decodeContour(w) {
  return {
    word: w,
    normal: [(w << 14) * 2 ** -26, (w << 20) * 2 ** -26, (w << 26) * 2 ** -26],
    position: (w << 7) * 2 ** -25 * 0.75,
    thickness: (w >>> 0) * 2 ** -25 * 0.75,
  };
}

/**
 * @param {Vector} v
 * @returns {Vector}
 */
export function normalized(v) {
  const length = Math.hypot(...v);
  return length === 0 ? [0, 0, 1] : v.map((x) => x / length);
}

/**
 * A raw normal (section 8.2): a point on the surface of the cube [-1, 1]^3.
 * @param {number} w
 * @returns {Vector}
 */
export function decodeRawNormal(w) {
  const t = w & 0x80000000 ? -1 : 1;
  const u = (w << 3) * 2 ** -31;
  const v = (w << 18) * 2 ** -31;
  const axis = (w >>> 29) & 3;
  return axis === 0 ? [t, u, v] : axis === 1 ? [v, t, u] : [u, v, t];
}

/**
 * A colour of a colour block (section 8.1), sRGB-encoded, 0 to 1.
 * @param {number} low
 * @param {number} high
 * @param {number} texel
 * @returns {Vector}
 */
export function decodeColorBlock(low, high, texel) {
  const channel = (/** @type {number[]} */ shifts) => shifts.map((shift) => ((low << shift) >>> 0) * 2 ** -32);
  const [a, b] = [channel([16, 21, 27]), channel([0, 5, 11])];
  const index = (high >>> (2 * texel)) & 3;
  if (index < 2) return index ? b : a;
  const [p, q] = index === 2 ? [a, b] : [b, a];
  return p.map((x, k) => (2 * x + q[k]) / 3);
}

const STEPS = [-1, -1 / 3, 1 / 3, 1];

/**
 * A normal of a normal block (section 8.2), in mesh space, of unit length.
 * @param {ArrayLike<number>} words
 * @param {number} at Of the first of its four words.
 * @param {number} texel
 * @returns {Vector}
 */
export function decodeNormalBlock(words, at, texel) {
  const axis = (/** @type {number} */ h) => {
    const scale = 2 ** (((h >>> 16) & 15) - 41);
    return [h * scale, (h << 4) * scale, (h << 8) * scale];
  };
  const [base, axes] = [decodeRawNormal(words[at]), words[at + 2]];
  const [u, v] = [axis(axes << 16), axis(axes | 0)];
  const cu = STEPS[(words[at + 1] >>> (2 * texel)) & 3];
  const cv = STEPS[(words[at + 3] >>> (2 * texel)) & 3];
  return normalized(base.map((x, k) => x + cu * u[k] + cv * v[k]));
}

/**
 * Ambient occlusion (section 8.4), 0 to 1.
 * @param {number} low
 * @param {number} high
 * @param {number} texel
 */
export function decodeAmbient(low, high, texel) {
  const w = low & 0xffff;
  const shift = 3 * texel + 16;
  const k = (shift >= 32 ? high >>> (shift - 32) : shift > 29 ? (low >>> shift) | (high << (32 - shift)) : low >>> shift) & 7;
  return Math.min((k * (w / 256) + (7 - k) * (w % 256)) / (7 * 255), 1);
}

/**
 * Attributes of a voxel. What the file does not have is left out.
 * @typedef {object} Attributes
 * @property {Contour} [contour]
 * @property {Vector} [color] Red, green, blue, sRGB-encoded, 0 to 1.
 * @property {number} [alpha]
 * @property {Vector} [normal] In mesh space, of unit length.
 * @property {number} [ambient]
 * @property {number[][]} [corners] Eight of red, green, blue, alpha, raw normal.
 * @property {Record<number, number[]>} [components] By attachment type: 8 emission, 9 roughness and metalness, 10 opacity, 11 material. Where
 *   a type is missing, the voxel has the default.
 * @property {boolean} [ownCorners] Whether the corners are those of the voxel, not of its parent.
 */

/**
 * The attributes of the voxel in a child slot of a descriptor.
 * @param {Block} block
 * @param {number} slot Of the descriptor in the block.
 * @param {number} child
 * @param {Vector} [at] Where in the voxel, 0 to 1 on each axis, for corners.
 * @returns {Attributes}
 */
export function attributesOf(block, slot, child, at = [0.5, 0.5, 0.5]) {
  const { words } = block;
  /** @type {Attributes} */
  const found = {};
  const [low, high] = [words[2 * slot], words[2 * slot + 1]];
  const mask = high & 255;
  if ((mask >> child) & 1) found.contour = decodeContour(words[2 * slot + (high >>> 8) + BITS[mask & ((1 << child) - 1)]]);
  const texel = child + 8 * (slot & 1);
  const pair = slot >> 1;
  for (const attachment of block.attachments) {
    const { type, at: first } = attachment;
    if (type === 1) found.color = decodeColorBlock(words[first + 2 * pair], words[first + 2 * pair + 1], texel);
    else if (type === 2) found.normal = decodeNormalBlock(words, first + 4 * pair, texel);
    else if (type === 3) found.color = [0, 8, 16].map((shift) => ((words[first] >> shift) & 255) / 255);
    else if (type === 4) found.ambient = decodeAmbient(words[first + 2 * pair], words[first + 2 * pair + 1], texel);
    else if (type === 5 || type === 6) {
      const entry = words[first + slot];
      if (valuesOf(type, entry, (low >> 8) & 255) === 0) continue;
      const m = entry & 255;
      const value = words[first + (entry >>> 8) + BITS[(m >> child) & 1 ? m & ((1 << child) - 1) : m]];
      if (type === 6) found.normal = normalized(decodeRawNormal(value));
      else [found.color, found.alpha] = [[0, 8, 16].map((shift) => ((value >> shift) & 255) / 255), (value >>> 24) / 255];
    } else if (type === 7) {
      Object.assign(found, cornersOf(words, first, slot, child, at));
    } else if (hasComponents(type)) {
      const numbers = componentsOf(block, attachment, slot, child);
      if (numbers) (found.components ??= {})[type] = numbers;
    }
  }
  return found;
}

/**
 * Attributes from corners (section 8.6).
 * @param {Uint32Array} words
 * @param {number} first
 * @param {number} slot
 * @param {number} child
 * @param {Vector} at
 * @returns {Attributes}
 */
function cornersOf(words, first, slot, child, at) {
  const entry = words[first + 2 * slot];
  const values = first + words[first + 2 * slot + 1];
  const mask = entry & 0x7ffffff;
  const own = [child & 1, (child >> 1) & 1, child >> 2];
  const points = Array.from({ length: 8 }, (_, k) => own[0] + (k & 1) + 3 * (own[1] + ((k >> 1) & 1)) + 9 * (own[2] + (k >> 2)));
  const ownCorners = points.every((point) => (mask >> point) & 1);
  if (!ownCorners && !(entry & 0x8000000)) return {};
  const numbers = ownCorners ? points.map((point) => bits(mask & ((1 << point) - 1))) : points.map((_, k) => bits(mask) + k);
  const q = ownCorners ? at : at.map((x, k) => (own[k] + x) / 2);
  const corners = numbers.map((number) => {
    const [color, normal] = [words[values + 2 * number], words[values + 2 * number + 1]];
    return [color & 255, (color >> 8) & 255, (color >> 16) & 255, color >>> 24, normal];
  });
  const [color, normal] = [[0, 0, 0, 0], [0, 0, 0]];
  let sum = 0;
  corners.forEach(([r, g, b, a, raw], k) => {
    if (a === 0) return;
    const weight = q.reduce((product, x, axis) => product * ((k >> axis) & 1 ? x : 1 - x), 1);
    sum += weight;
    [r, g, b, a].forEach((x, c) => (color[c] += (weight * x) / 255));
    normalized(decodeRawNormal(raw)).forEach((x, c) => (normal[c] += weight * x));
  });
  if (sum === 0) return { corners, ownCorners };
  const [r, g, b, alpha] = color.map((x) => x / sum);
  return { corners, ownCorners, color: [r, g, b], alpha, normal: normalized(normal) };
}
