// Vectors of three numbers, and affine transforms as 16 numbers by columns.

/** @typedef {number[]} Vector */

/** @type {(a: Vector, b: Vector) => Vector} */
export const add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
/** @type {(a: Vector, b: Vector) => Vector} */
export const sub = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
/** @type {(a: Vector, s: number) => Vector} */
export const scale = (a, s) => [a[0] * s, a[1] * s, a[2] * s];
/** @type {(a: Vector, b: Vector) => number} */
export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
/** @type {(a: Vector, b: Vector) => Vector} */
export const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
/** @type {(a: Vector) => number} */
export const length = (a) => Math.hypot(a[0], a[1], a[2]);
/** @type {(a: Vector) => Vector} A vector of length 1, or zero. */
export const unit = (a) => {
  const l = length(a);
  return l > 0 ? scale(a, 1 / l) : [0, 0, 0];
};

/** @type {(m: number[], v: Vector) => Vector} */
export const transformVector = (m, v) => [0, 1, 2].map((r) => m[r] * v[0] + m[4 + r] * v[1] + m[8 + r] * v[2]);
/** @type {(m: number[], p: Vector) => Vector} */
export const transformPoint = (m, p) => add(transformVector(m, p), [m[12], m[13], m[14]]);

/**
 * The inverse of an affine transform.
 * @param {number[]} m
 * @returns {number[]}
 */
export function inverse(m) {
  const [a, b, c] = [m.slice(0, 3), m.slice(4, 7), m.slice(8, 11)];
  const [r0, r1, r2] = [cross(b, c), cross(c, a), cross(a, b)];
  const d = dot(a, r0);
  const rows = [r0, r1, r2].map((r) => scale(r, 1 / d));
  const t = rows.map((r) => -dot(r, [m[12], m[13], m[14]]));
  return [rows[0][0], rows[1][0], rows[2][0], 0, rows[0][1], rows[1][1], rows[2][1], 0, rows[0][2], rows[1][2], rows[2][2], 0, t[0], t[1], t[2], 1];
}

/**
 * A vector turned around a unit axis.
 * @param {Vector} v
 * @param {Vector} axis
 * @param {number} angle In radians.
 */
export function turn(v, axis, angle) {
  const [s, c] = [Math.sin(angle), Math.cos(angle)];
  return add(add(scale(v, c), scale(cross(axis, v), s)), scale(axis, dot(axis, v) * (1 - c)));
}
