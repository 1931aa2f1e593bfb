// The preludes of the kernel's variants: those that the Rust crates make, which their test writes.
import assert from 'node:assert/strict';
import { readFileSync } from 'node:fs';
import { test } from 'node:test';
import { ofCoarsePass, prelude } from '../../viewer/kernel.js';

test('preludes are those of the engines', () => {
  /** @type {import('../../viewer/kernel.js').Variant} */
  const base = { contours: true, farPointers: true, lod: true, beam: false, levels: 11, beamBlock: 4, parts: 1, partShift: 31, roundQuotients: true };
  const variants = [
    base, { ...base, beam: true }, ofCoarsePass({ ...base, beam: true }), { ...base, contours: false, lod: false, levels: 23, roundQuotients: false },
    { ...base, farPointers: false, parts: 2, partShift: 23 }, { ...base, parts: 5, partShift: 24 },
  ];
  const text = variants.map((variant) => `// variant\n${prelude(variant).trimEnd()}\n`).join('');
  assert.equal(text, readFileSync(new URL('../../tests/preludes.wgsl', import.meta.url), 'utf8'));
});
