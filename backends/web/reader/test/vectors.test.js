// Every vector of the specification: the valid ones to every value of their JSON, the invalid ones to the rule in their name.
import assert from 'node:assert/strict';
import { readdirSync, readFileSync } from 'node:fs';
import { test } from 'node:test';
import { bytesSource, openBytes, openSource, subset, voxels, writeFile } from '../src/index.js';
import { difference, facts } from './facts.js';

const VECTORS = new URL('../../../../spec/v1/vectors/', import.meta.url);
const json = (/** @type {string} */ name) => JSON.parse(readFileSync(new URL(name, VECTORS), 'utf8'));
const file = (/** @type {string} */ name) => new Uint8Array(readFileSync(new URL(name, VECTORS)));

for (const folder of ['valid', 'streaming', 'streaming_parts']) {
  const names = readdirSync(new URL(folder, VECTORS)).filter((name) => name.endsWith('.esvo'));
  assert.ok(names.length >= 17, `${folder} has ${names.length} vectors`);
  for (const name of names) {
    test(`${folder}/${name}`, async () => {
      const octree = await openBytes(file(`${folder}/${name}`));
      if (folder !== 'streaming_parts') {
        const expected = json(`${folder}/${name.replace('.esvo', '.json')}`);
        delete expected.about;
        delete expected.file;
        assert.equal(difference(facts(octree), expected, name), undefined);
      }
      assert.deepEqual(octree.warnings, []);
    });
  }
}

const invalid = json('invalid/index.json');
assert.ok(invalid.length >= 190);
for (const { file: name, rule, level } of invalid) {
  test(`invalid/${name}`, async () => {
    const bytes = file(`invalid/${name}`);
    if (level === 'must') {
      await assert.rejects(openBytes(bytes), (/** @type {any} */ error) => {
        assert.equal(error.rule, rule, error.stack);
        assert.ok(error.offset >= 0 && error.offset <= bytes.length);
        return true;
      });
    } else {
      const { warnings } = await openBytes(bytes);
      assert.deepEqual([...new Set(warnings.map((warning) => warning.rule))], [rule]);
    }
  });
}

test('the comparison finds differences', async () => {
  const octree = await openBytes(file('valid/written_everything.esvo'));
  const expected = json('valid/written_everything.json');
  expected.objects[0].nodes[1].voxels[0].color[2] += 1e-9;
  delete expected.about;
  delete expected.file;
  assert.match(String(difference(facts(octree), expected, 'it')), /voxels\[0\]\.color\[2\]/);
});

const sectionOf = (/** @type {import('../src/octree.js').Octree} */ octree, /** @type {string} */ tag) => {
  const section = octree.sections.find((section) => section.tag === tag);
  return octree.bytes.subarray(section?.offset, (section?.offset ?? 0) + (section?.length ?? 0));
};

for (const { file: name, blocks, ranges, part, low, high, level, object } of json('streaming/index.json')) {
  test(`streaming: ${part}`, async () => {
    const bytes = file(`valid/${name}`);
    const places = (await openBytes(bytes)).table;
    // What is in other blocks must not matter.
    places.forEach(({ fileAt, stored }, index) => {
      if (!blocks.includes(index)) bytes.fill(0xa5, fileAt, fileAt + stored);
    });
    const source = bytesSource(bytes);
    const served = await openSource(source);
    assert.deepEqual(blocks.map((/** @type {number} */ index) => [places[index].fileAt, places[index].stored]), ranges);
    if (level !== undefined) assert.deepEqual(served.blocksFor(low, high, level, object), blocks);
    const found = await subset(served, blocks);
    const expected = await openBytes(file(`streaming/${part}`));
    assert.deepEqual(found.objects, sectionOf(expected, 'OBJT'));
    // File offset, stored size, codec and checksum are those of the file that is written.
    const cut = (/** @type {Uint8Array} */ table) => table.map((byte, k) => (k % 72 >= 40 && k % 72 < 64 ? 0 : byte));
    assert.deepEqual(found.blocks, cut(sectionOf(expected, 'BLKT')));
    const image = new Uint8Array(found.image.buffer);
    const expectedImage = new Uint8Array(image.length);
    expected.blocks.forEach((block, index) => expectedImage.set(new Uint8Array(block.words.buffer, block.words.byteOffset, block.words.byteLength), expected.table[index].imageAt));
    assert.deepEqual(image, expectedImage);
  });
}

// A set of all blocks of a file in parts has the image of the file, read by its index or by its tables.
for (const name of readdirSync(new URL('valid', VECTORS)).filter((name) => /^(parts|three_blocks|compressed|random).*\.esvo$/.test(name))) {
  test(`piece by piece: ${name}`, async () => {
    const octree = await openBytes(file(`valid/${name}`));
    const served = await openSource(bytesSource(octree.bytes));
    while (served.links.length) await served.readPage(served.links[0]);
    const { image, objects } = await subset(served, octree.table.map((_, index) => index));
    assert.deepEqual(objects, sectionOf(octree, 'OBJT'));
    // Parts down to each level are an octree that keeps every rule, with the voxels of the whole one down to there.
    const { levels } = octree.objects[0];
    for (let level = 1; level < levels; level++) {
      const within = [...served.blocks.values()].filter(({ first, object }) => first < level || object > 0);
      const part = await openBytes(writeFile(await subset(served, within.map(({ index }) => index), (index) => served.blocks.get(index)?.parts.filter(({ first }) => first < level).length || 1)));
      const some = [...part.nodes(0, level)].map(({ path, valid, contourMask }) => [path, valid, contourMask]);
      assert.deepEqual(some, [...octree.nodes(0, level)].map(({ path, valid, contourMask }) => [path, valid, contourMask]));
    }
    octree.blocks.forEach((block, index) => assert.deepEqual(image.subarray(2 * octree.starts[index], 2 * octree.starts[index] + block.words.length), block.words));
    for (let level = 1; level <= octree.objects[0].levels; level++) {
      const some = await voxels(served, { level });
      let count = 0;
      for (const node of octree.nodes(0, level)) {
        for (let slot = 0; slot < 8; slot++) if ((node.valid >> slot) & 1 && (node.level + 1 === level || (node.leaf >> slot) & 1)) count++;
      }
      assert.equal(some.count, count, `level ${level}`);
    }
  });
}

for (const entry of json('streaming_parts/index.json')) {
  for (const by of entry.pages ? ['tables', 'index'] : ['tables']) {
    test(`streaming parts by ${by}: ${entry.part}`, async () => {
      const bytes = file(entry.file);
      const whole = await openBytes(bytes);
      const { offset, length } = whole.sections.find(({ tag }) => tag === 'BLKS') ?? { offset: 0, length: 0 };
      const pages = whole.sections.find(({ tag }) => tag === 'PAGE');
      const ranges = [...entry.ranges, ...(by === 'index' ? entry.pages : [])];
      const inside = (/** @type {number} */ at) => ranges.some(([start, size]) => at >= start && at < start + size);
      // What is in other parts must not matter, nor in other pages, nor in the tables for a reader of the index.
      const hide = (/** @type {number} */ start, /** @type {number} */ size) => {
        for (let at = start; at < start + size; at++) if (!inside(at)) bytes[at] = 0xa5;
      };
      hide(offset, length);
      if (by === 'index') {
        if (pages) hide(pages.offset, pages.length);
        for (const { tag, offset, length } of whole.sections) if (tag === 'PART' || tag === 'BLKT') hide(offset, length);
      }
      const served = await openSource(bytesSource(bytes), { tables: by === 'tables' });
      const read = [];
      if (by === 'index') {
        for (let links = served.pagesFor(entry.low, entry.high, entry.level, entry.object); links.length; links = served.pagesFor(entry.low, entry.high, entry.level, entry.object)) {
          for (const link of links) {
            read.push([(pages?.offset ?? 0) + link.offset, link.size]);
            await served.readPage(link);
          }
        }
        assert.deepEqual(read.sort((a, b) => a[0] - b[0]), entry.pages);
      }
      if (entry.level !== undefined) {
        const parts = served.partsFor(entry.low, entry.high, entry.level, entry.object);
        assert.deepEqual(parts.map(({ block, first }) => [block, first]), entry.parts);
        assert.deepEqual(parts.map(({ fileAt, size }) => [fileAt, size]), entry.ranges);
      }
      const numbers = entry.parts.map((/** @type {[number, number]} */ [block]) => block);
      const found = writeFile(await subset(served, numbers, (index) => numbers.filter((/** @type {number} */ block) => block === index).length));
      assert.deepEqual((await openBytes(found)).warnings, []);
      assert.deepEqual(found, file(`streaming_parts/${entry.part}`));
    });
  }
}
