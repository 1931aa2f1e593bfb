// The text of a kernel variant: the prelude that `esvo_core::gpu::kernel::Variant::source` makes, in front of the same WGSL. A test
// compares both.

/**
 * @typedef {object} Variant
 * @property {boolean} contours
 * @property {boolean} farPointers
 * @property {boolean} lod
 * @property {boolean} beam
 * @property {number} levels
 * @property {number} beamBlock
 * @property {number} parts Storage buffers with the octree.
 * @property {number} partShift With several, each but the last holds 2^partShift slots.
 * @property {boolean} roundQuotients False on devices that run on the processor, which divide as it does.
 */

/** Width and height of a workgroup in pixels. */
export const WORKGROUP = 8;

/**
 * @param {Variant} variant
 * @returns {string}
 */
export function prelude(variant) {
  const { contours, farPointers, lod, beam, levels, beamBlock, roundQuotients } = variant;
  const flags = { CONTOURS: contours, FAR_POINTERS: farPointers, LOD: lod, BEAM: beam, RAYS: false, ROUND_PRODUCTS: true, ROUND_QUOTIENTS: roundQuotients };
  const numbers = { LEVELS: Math.min(Math.max(levels, 1), 23), BEAM_BLOCK: beamBlock, WIDTH: WORKGROUP, HEIGHT: WORKGROUP };
  let text = '';
  for (const [name, value] of Object.entries(flags)) text += `const ${name}: bool = ${value};\n`;
  for (const [name, value] of Object.entries(numbers)) text += `const ${name}: u32 = ${value}u;\n`;
  return text + slots(variant);
}

/** @param {Variant} variant */
function slots({ parts, partShift }) {
  let text = '';
  for (let part = 0; part < parts; part++) text += `@group(1) @binding(${part}) var<storage, read> part_${part}: array<vec2<u32>>;\n`;
  text += 'fn slot_at(slot: u32) -> vec2<u32> {\n';
  if (parts === 1) return `${text}    return part_0[slot];\n}\n`;
  text += `    let within = slot & ${2 ** partShift - 1}u;\n    switch slot >> ${partShift}u {\n`;
  for (let part = 0; part < parts - 1; part++) text += `        case ${part}u: { return part_${part}[within]; }\n`;
  return `${text}        default: { return part_${parts - 1}[within]; }\n    }\n}\n`;
}

/**
 * The kernel of the coarse pass for the same octree: rays end at small voxels, whatever their contours.
 * @param {Variant} variant
 * @returns {Variant}
 */
export function ofCoarsePass(variant) {
  return { ...variant, contours: false, lod: true, beam: false };
}
