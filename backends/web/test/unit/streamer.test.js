// The pool after every batch: whole octrees, within the budget, and in the end what the camera asked for.
import assert from 'node:assert/strict';
import { existsSync, readFileSync, readdirSync } from 'node:fs';
import { test } from 'node:test';
import { BITS } from '../../reader/src/bytes.js';
import { bytesSource, openBytes } from '../../reader/src/index.js';
import { PageAllocator } from '../../viewer/pages.js';
import { Streamer } from '../../viewer/streamer.js';

const VALID = new URL('../../../../spec/v1/vectors/valid/', import.meta.url);
const file = (/** @type {string} */ name) => new Uint8Array(readFileSync(new URL(name, VALID)));

/** A pool as the GPU has it, and a walk over it. */
class Pool {
  /** @param {number} bytes */
  constructor(bytes) {
    this.words = new Uint32Array(bytes / 4).fill(0xdeadbeef);
    /** @type {number[]} */
    this.roots = [];
    this.batches = 0;
  }

  /** @param {import('../../viewer/streamer.js').Batch} batch */
  apply({ writes, patches, roots }) {
    for (const { at, words } of writes) {
      assert.ok(at + words.length <= this.words.length, 'a write outside of the pool');
      this.words.set(words, at);
    }
    for (let k = 0; k < patches.length; k += 2) this.words[patches[k]] = patches[k + 1];
    this.roots = roots;
    this.batches++;
  }

  /**
   * The voxels of an object: paths of leaves, with colour words to tell blocks apart.
   * @param {number} object
   */
  leaves(object) {
    const { words } = this;
    /** @type {string[]} */
    const found = [];
    const visit = (/** @type {number} */ slot, /** @type {string} */ path) => {
      assert.ok(path.length < 23 && 2 * slot + 1 < words.length, `a pointer leads to slot ${slot}`);
      const [low, high] = [words[2 * slot], words[2 * slot + 1]];
      const [valid, leaf] = [(low >> 8) & 255, low & 255];
      assert.ok(valid !== 0 && (leaf & ~valid) === 0 && (high & 255 & ~valid) === 0, `no descriptor at slot ${slot}, ${path}`);
      const page = slot & ~1023;
      const info = 2 * (page + words[2 * page]);
      assert.ok(words[info + 1] >= 4 && info / 2 - words[info + 1] <= slot, 'the info section is not where the page header says');
      const inner = valid & ~leaf;
      let first = slot + (low >>> 17);
      if (low & 0x10000) first = (slot + words[2 * first]) >>> 0;
      for (let child = 0; child < 8; child++) {
        if ((leaf >> child) & 1) found.push(path + child);
        else if ((inner >> child) & 1) visit(first + BITS[inner & ((1 << child) - 1)], path + child);
      }
    };
    if (this.roots[object] !== 0xffffffff) visit(this.roots[object], '');
    return found;
  }
}

const eye = (threshold = 0) => ({ eye: [0.3, 0.4, -2], forward: [0, 0, 1], right: [1, 0, 0], up: [0, 1, 0], tangent: [1, 1], pixel: 0.001, velocity: [0, 0, 0], threshold });

/**
 * @param {Uint8Array} bytes
 * @param {number} budget
 * @param {import('../../viewer/priority.js').Eye[]} eyes
 * @param {number} [every] The pool is walked after every batch of so many.
 */
async function stream(bytes, budget, eyes, every = 1) {
  const pool = new Pool(Math.max(16 * 8192, budget));
  /** @type {unknown} */
  let failure;
  let most = 0;
  const streamer = new Streamer(bytesSource(bytes), {
    budget, fail: (error) => (failure = error),
    batch: (batch) => {
      pool.apply(batch);
      if (pool.batches % every === 0) batch.roots.forEach((_, object) => pool.leaves(object));
    },
    stats: ({ used, kept }) => (most = Math.max(most, used + kept)),
  });
  await streamer.open();
  for (const one of eyes) {
    streamer.look(one);
    for (let k = 0; k < 20000 && !streamer.settled && !failure; k++) await new Promise((resolve) => setTimeout(resolve));
    assert.equal(failure, undefined);
    assert.ok(streamer.settled, 'it does not come to rest');
  }
  return { pool, streamer, most };
}

const names = readdirSync(VALID).filter((name) => /^(parts_|random_[0-3]|three_blocks|two_blocks|two_objects|levels_23_blocks|compressed_(mixed|reversed)|written_(blocks|corners|far)).*\.esvo$/.test(name));
assert.ok(names.length > 20);
for (const name of names) {
  test(`all of ${name}`, async () => {
    const octree = await openBytes(file(name));
    const { pool } = await stream(octree.bytes, 1 << 24, [eye()]);
    octree.objects.forEach((_, object) => {
      const expected = [];
      for (const node of octree.nodes(object)) for (let child = 0; child < 8; child++) if ((node.leaf >> child) & 1) expected.push(node.path + child);
      assert.deepEqual(pool.leaves(object).sort(), expected.sort());
    });
  });
}

test('far away, less is taken, and nearer voxels are added', async () => {
  const octree = await openBytes(file('parts_levels.esvo'));
  const far = { ...eye(1), eye: [0.5, 0.5, -200] };
  const { pool: coarse } = await stream(octree.bytes, 1 << 24, [far]);
  const { pool: fine } = await stream(octree.bytes, 1 << 24, [far, eye(1)]);
  assert.ok(coarse.leaves(0).length < fine.leaves(0).length, `${coarse.leaves(0).length} and ${fine.leaves(0).length}`);
});

// A real scene, where there is one: set ESVO_WEB_FILE to a file in parts.
const real = process.env.ESVO_WEB_FILE;
test('a flight keeps within the budget', { skip: real && existsSync(real) ? false : 'no ESVO_WEB_FILE' }, async () => {
  const bytes = new Uint8Array(readFileSync(String(real)));
  const budget = 24 << 20;
  const eyes = Array.from({ length: 12 }, (_, k) => ({ ...eye(1), eye: [-17 + 2.5 * k, -13.5, 0], forward: [1, 0, 0], right: [0, 0, 1], pixel: 0.0012 }));
  const { most, streamer, pool } = await stream(bytes, budget, eyes, 400);
  pool.leaves(0);
  assert.ok(most <= budget * 1.02, `${most} bytes of ${budget}`);
  console.log(`${most} bytes at most, ${streamer.source.count.requests} requests, ${streamer.source.count.bytes} bytes, trust ${streamer.trust}, limit ${streamer.limit}`);
});

test('pages are given and taken', () => {
  const pages = new PageAllocator(100);
  const taken = [10, 20, 30, 40].map((count) => pages.take(count));
  assert.deepEqual(taken, [0, 10, 30, 60]);
  assert.equal(pages.take(1), -1);
  pages.give(10, 20);
  pages.give(60, 40);
  assert.deepEqual([pages.take(21), pages.take(20), pages.free], [60, 10, 19]);
  pages.give(30, 30);
  pages.give(10, 20);
  pages.give(0, 10);
  pages.give(60, 21);
  assert.deepEqual(pages.ranges, [{ start: 0, count: 100 }]);
});
