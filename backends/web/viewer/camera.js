// Cameras, and the numbers that the kernel takes of them: as `esvo_core::Camera`, `View` and `viewpoint` have them.
import { add, cross, dot, inverse, length, scale, sub, transformPoint, transformVector, unit } from './vectors.js';

/**
 * A pinhole camera in mesh units.
 * @typedef {object} Camera
 * @property {number[]} eye
 * @property {number[]} forward
 * @property {number[]} up
 * @property {number} fov Over the shorter side of the picture, in degrees.
 * @property {number} near
 * @property {number} far
 */

/**
 * How a frame is cast.
 * @typedef {object} CastOptions
 * @property {boolean} contours
 * @property {boolean} beam
 * @property {number} maxVoxelPixels
 */

/** Bytes of a `View`. */
export const VIEW_BYTES = 96;
const COARSE_VOXEL_BLOCKS = 2 * Math.SQRT2;

/**
 * Unit vectors to the right, upwards and forwards.
 * @param {Camera} camera
 */
export function axes({ forward, up }) {
  const f = unit(forward);
  let right = cross(f, up);
  if (length(right) < 1e-9) right = cross(f, Math.abs(f[0]) < 0.9 ? [1, 0, 0] : [0, 0, 1]);
  right = unit(right);
  return { right, up: cross(right, f), forward: f };
}

/**
 * The view of an octree: what the uniform buffer has, and what shading needs, in double precision.
 * @param {Camera} camera
 * @param {number[]} octreeToMesh
 * @param {number} root
 * @param {number} width
 * @param {number} height
 * @param {CastOptions} options
 */
export function makeView(camera, octreeToMesh, root, width, height, options) {
  const { right, up, forward } = axes(camera);
  const toOctree = inverse(octreeToMesh);
  const half = Math.tan((camera.fov * Math.PI) / 360) * camera.far;
  const pixel = (2 * half) / Math.min(width, height);
  const dx = transformVector(toOctree, scale(right, pixel));
  const dy = transformVector(toOctree, scale(up, -pixel));
  const ahead = transformVector(toOctree, scale(forward, camera.far));
  const base = sub(sub(ahead, scale(dx, width / 2)), scale(dy, height / 2));
  const origin = add(transformPoint(toOctree, camera.eye), [1, 1, 1]);
  const view = {
    origin, base, dx, dy, tNear: camera.near / camera.far, pixelSize: Math.sqrt(length(cross(dx, dy))), maxVoxelPixels: options.maxVoxelPixels,
    tPerDepth: 1 / length(ahead), width, height, root, flags: (options.contours ? 1 : 0) | (options.beam && beamIsSafe(origin, base, dx, dy) ? 2 : 0), firstRow: 0,
  };
  return view;
}

/** @typedef {ReturnType<typeof makeView>} View */

/**
 * Writes a view as the kernel reads it.
 * @param {View} view
 * @param {DataView} to
 * @param {number} at
 */
export function writeView(view, to, at) {
  const vectors = /** @type {[number[], number][]} */ ([[view.origin, view.tNear], [view.base, view.pixelSize], [view.dx, view.maxVoxelPixels], [view.dy, view.tPerDepth]]);
  vectors.forEach(([vector, number], k) => [...vector, number].forEach((x, i) => to.setFloat32(at + 16 * k + 4 * i, x, true)));
  [view.width, view.height, view.root, view.flags, view.firstRow].forEach((x, k) => to.setUint32(at + 64 + 4 * k, x, true));
}

/**
 * Whether the beam changes no hit of a view.
 * @param {number[]} origin
 * @param {number[]} base
 * @param {number[]} dx
 * @param {number[]} dy
 */
function beamIsSafe(origin, base, dx, dy) {
  const [across, along] = [length(dx), length(dy)];
  const squares = Math.abs(across - along) <= 1e-3 * Math.max(across, along) && Math.abs(dot(dx, dy)) <= 1e-3 * across * along;
  const normal = cross(dx, dy);
  let farthest = 0;
  for (let i = 0; i < 8; i++) farthest = Math.max(farthest, dot(sub([1 + (i & 1), 1 + ((i >> 1) & 1), 1 + (i >> 2)], origin), normal) / dot(base, normal));
  return squares && farthest * 8 * COARSE_VOXEL_BLOCKS * Math.max(across, along) <= 1;
}

/** @param {number[]} m */
function corners(m, low = [0, 0, 0], high = [1, 1, 1]) {
  return Array.from({ length: 8 }, (_, i) => transformPoint(m, [0, 1, 2].map((axis) => ((i >> axis) & 1 ? high : low)[axis])));
}

/**
 * Near and far plane for an eye: the far plane lies beyond all objects.
 * @param {number[][]} transforms
 * @param {number[]} eye
 */
export function planes(transforms, eye) {
  const reach = 1.01 * Math.max(0, ...transforms.map((m) => Math.max(...corners(m).map((corner) => length(sub(corner, eye))))));
  return { near: reach * 1e-4, far: reach };
}

/**
 * A box of an object in octree space.
 * @typedef {object} Box
 * @property {number} object
 * @property {number[]} low
 * @property {number[]} high
 */

/**
 * The cubes of the voxels of a root block's image, at the level or above it.
 * @param {Uint32Array} words
 * @param {number} [below]
 */
export function coarseBoxes(words, below = 5) {
  /** @type {{ low: number[], high: number[] }[]} */
  const found = [];
  const visit = (/** @type {number} */ slot, /** @type {number} */ level, /** @type {number[]} */ low) => {
    const word = words[2 * slot];
    const [valid, leaf, edge] = [(word >> 8) & 255, word & 255, 2 ** -(level + 1)];
    const pointer = slot + (word >>> 17);
    let next = word & 0x10000 ? slot + words[2 * pointer] : pointer;
    for (let child = 0; child < 8; child++) {
      if (!((valid >> child) & 1)) continue;
      const at = low.map((x, axis) => x + edge * ((child >> axis) & 1));
      const inner = !((leaf >> child) & 1);
      if (inner && level + 1 < below && 2 * next < words.length) visit(next, level + 1, at);
      else found.push({ low: at, high: at.map((x) => x + edge) });
      if (inner) next++;
    }
  };
  visit(2, 0, [0, 0, 0]);
  return found;
}

/**
 * The middle of boxes in mesh space, and the radius of a sphere around them.
 * @param {number[][]} transforms
 * @param {Box[]} boxes
 */
export function extent(transforms, boxes) {
  const all = boxes.flatMap(({ object, low, high }) => corners(transforms[object], low, high));
  const low = [0, 1, 2].map((axis) => Math.min(...all.map((p) => p[axis])));
  const high = [0, 1, 2].map((axis) => Math.max(...all.map((p) => p[axis])));
  return { centre: scale(add(low, high), 0.5), radius: length(sub(high, low)) / 2, low, high };
}

/**
 * A camera that sees all boxes from outside: from the front, the right and above, as large as fits.
 * @param {number[][]} transforms
 * @param {Box[]} boxes
 * @param {number[]} upward
 * @param {number} fov
 * @param {number} aspect Width divided by height.
 * @returns {Camera}
 */
export function overview(transforms, boxes, upward, fov, aspect) {
  const { centre } = extent(transforms, boxes);
  const up = unit(upward);
  const front = up[1] === 1 ? [0, 0, 1] : unit(cross(up, Math.abs(up[0]) < 0.9 ? [1, 0, 0] : [0, 1, 0]));
  const outward = unit(add(add(front, scale(cross(up, front), 0.6)), scale(up, 0.5)));
  const right = unit(cross(up, outward));
  const top = cross(outward, right);
  const tangent = Math.tan((fov * Math.PI) / 360) / 1.05;
  const tangents = [tangent * Math.max(aspect, 1), tangent * Math.max(1 / aspect, 1)];
  const beyond = [[-Infinity, -Infinity], [-Infinity, -Infinity]];
  for (const { object, low, high } of boxes) {
    for (const corner of corners(transforms[object], low, high)) {
      const p = sub(corner, centre);
      const ahead = dot(p, outward);
      [right, top].forEach((direction, axis) => {
        const [aside, toward] = [dot(p, direction), ahead * tangents[axis]];
        beyond[axis] = [Math.max(beyond[axis][0], toward + aside), Math.max(beyond[axis][1], toward - aside)];
      });
    }
  }
  const distance = Math.max(...beyond.map(([a, b], axis) => (a + b) / (2 * tangents[axis])));
  const aside = beyond.map(([a, b]) => (a - b) / 2);
  const eye = add(add(add(centre, scale(outward, distance)), scale(right, aside[0])), scale(top, aside[1]));
  return { eye, forward: scale(outward, -1), up, fov, ...planes(transforms, eye) };
}

/**
 * The nodes of a pass over several objects, the nearest first: the rectangle of pixels of each and the least depth.
 * @param {View[]} views
 */
export function footprints(views) {
  const found = [];
  for (const [number, view] of views.entries()) {
    if (view.root === 0xffffffff) continue;
    const { origin, base, dx, dy, width, height } = view;
    const normal = cross(dx, dy);
    const forward = dot(base, normal);
    let [low, high] = [[0, 0], [width - 1, height - 1]];
    let t = Infinity;
    /** @type {number[][]} */
    const projected = [];
    for (let i = 0; i < 8; i++) {
      const p = sub([1 + (i & 1), 1 + ((i >> 1) & 1), 1 + (i >> 2)], origin);
      const depth = dot(p, normal) / forward;
      t = Math.min(t, depth);
      if (depth > 1e-6) {
        const off = sub(scale(p, 1 / depth), base);
        // Solves off = x dx + y dy.
        projected.push([dot(cross(off, dy), normal) / dot(normal, normal), dot(cross(dx, off), normal) / dot(normal, normal)]);
      }
    }
    if (projected.length === 8) {
      const side = (/** @type {number} */ axis) => projected.map((p) => p[axis]);
      low = [0, 1].map((axis) => Math.max(0, Math.floor(Math.min(...side(axis))) - 1));
      high = [0, 1].map((axis) => Math.min((axis ? height : width) - 1, Math.ceil(Math.max(...side(axis))) + 1));
      if (low[0] > high[0] || low[1] > high[1]) continue;
    }
    found.push({ number, view, low, high, t: Math.max(t * 0.9999, 0) });
  }
  return found.sort((a, b) => a.t - b.t);
}
