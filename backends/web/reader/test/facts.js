// What the JSON next to a valid vector says, of a file that was read.

/** @typedef {import('../src/octree.js').Octree} Octree */

/**
 * The planes of a contour in mesh space (section 7).
 * @param {number[]} m
 * @param {import('../src/values.js').Contour} contour
 * @param {number[]} centre
 * @param {number} edge
 */
function slabInMesh(m, contour, centre, edge) {
  const column = (/** @type {number} */ c) => [m[4 * c], m[4 * c + 1], m[4 * c + 2]];
  const cross = (/** @type {number[]} */ a, /** @type {number[]} */ b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const dot = (/** @type {number[]} */ a, /** @type {number[]} */ b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const [a, b, c, t] = [0, 1, 2, 3].map(column);
  const n = contour.normal;
  const determinant = dot(a, cross(b, c));
  // The transposed inverse: its columns are the cross products of the others over the determinant.
  const columns = [cross(b, c), cross(c, a), cross(a, b)].map((v) => v.map((x) => x / determinant));
  const normal = [0, 1, 2].map((k) => columns[0][k] * n[0] + columns[1][k] * n[1] + columns[2][k] * n[2]);
  const length = Math.hypot(...normal);
  const middle = dot(n, centre) + edge * contour.position + dot(normal, t);
  const side = (/** @type {number} */ s) => (middle + s * edge * contour.thickness) / length;
  return { normal: normal.map((x) => x / length), low: side(-0.5), high: side(0.5) };
}

/**
 * @param {Octree} octree
 * @param {number} number
 */
function objectFacts(octree, number) {
  const object = octree.objects[number];
  const nodes = [];
  for (const node of octree.nodes(number)) {
    const voxels = [];
    const edge = 2 ** -(node.level + 1);
    for (let slot = 0; slot < 8; slot++) {
      if (!((node.valid >> slot) & 1)) continue;
      const { contour, corners, ownCorners, ...rest } = octree.voxel(node, slot);
      const centre = node.position.map((x, axis) => x * 2 ** -23 + edge * (((slot >> axis) & 1) + 0.5));
      const { word, ...slab } = contour ?? {};
      voxels.push({
        slot, leaf: ((node.leaf >> slot) & 1) === 1, ...rest, ...(corners && { corners, own_corners: ownCorners }),
        ...(contour && { contour: { word, ...slab, mesh: slabInMesh(object.octreeToMesh, contour, centre, edge) } }),
      });
    }
    nodes.push({
      path: node.path, level: node.level, position: node.position, block: node.block.index, slot: node.slot, valid: node.valid, leaf: node.leaf,
      contours: node.contourMask, far: node.far, voxels,
    });
  }
  return {
    octree_to_mesh: object.octreeToMesh, levels: object.levels, descriptors: object.descriptors, leaf_voxels: object.leafVoxels, contours: object.contours,
    far_pointers: object.farPointers, nodes,
  };
}

/** @param {Octree} octree */
export function facts(octree) {
  const { header } = octree;
  return {
    version: [header.major, header.minor], required_features: header.required, optional_features: Number(header.optional),
    sections: octree.sections.map(({ tag, flags, length }) => ({ tag, flags, bytes: length })),
    blocks: octree.blocks.map((block, index) => {
      const { object, parent, position, scale, codec } = octree.table[index];
      return { object, parent, position, scale, codec, slots: block.slots, contours: block.contours, attachments: block.attachments.map(({ type, bytes }) => ({ type, bytes })) };
    }),
    ...(octree.instances && { instances: octree.instances.map(({ object, meshToScene }) => ({ object, mesh_to_scene: meshToScene })) }),
    ...(octree.hash && { hash: octree.hash }),
    objects: octree.objects.map((_, number) => objectFacts(octree, number)),
  };
}

/**
 * The first difference of two JSON values, or undefined. Numbers may differ by rounding.
 * @param {any} found
 * @param {any} expected
 * @param {string} where
 * @returns {string | undefined}
 */
export function difference(found, expected, where) {
  const show = () => `${where}: ${JSON.stringify(found)} instead of ${JSON.stringify(expected)}`.slice(0, 1000);
  if (expected === 'any') return Array.isArray(found) && Math.abs(Math.hypot(...found) - 1) <= 1e-12 ? undefined : `${where}: not of unit length`;
  if (typeof expected === 'object' && expected !== null) {
    if (typeof found !== 'object' || found === null) return show();
    const keys = Object.keys(expected);
    if (Object.keys(found).length !== keys.length || keys.some((key) => !(key in found))) return show();
    for (const key of keys) {
      const inner = difference(found[key], expected[key], Array.isArray(expected) ? `${where}[${key}]` : `${where}.${key}`);
      if (inner) return inner;
    }
    return undefined;
  }
  if (typeof expected === 'number' && typeof found === 'number') return Math.abs(found - expected) <= 1e-12 * Math.max(1, Math.abs(expected)) ? undefined : show();
  return found === expected ? undefined : show();
}
