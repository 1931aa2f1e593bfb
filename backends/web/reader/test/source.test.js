// Servers and damage: every error is one sentence, and nothing hangs.
import assert from 'node:assert/strict';
import { readFileSync, readdirSync } from 'node:fs';
import { createServer } from 'node:http';
import { after, before, test } from 'node:test';
import { crc32 } from '../src/crc32.js';
import { EsvoError, bytesSource, httpSource, openBytes, openSource, subset } from '../src/index.js';

const VALID = new URL('../../../../spec/v1/vectors/valid/', import.meta.url);
const file = (/** @type {string} */ name) => new Uint8Array(readFileSync(new URL(name, VALID)));
const bytes = file('parts_levels.esvo');

/** @type {(range: [number, number], request: import('node:http').IncomingMessage, response: import('node:http').ServerResponse) => void} */
let behave;
let requests = 0;
const server = createServer((request, response) => {
  requests++;
  const range = /bytes=(\d+)-(\d+)/.exec(request.headers.range ?? '');
  behave([Number(range?.[1] ?? 0), Math.min(Number(range?.[2] ?? Infinity), bytes.length - 1)], request, response);
});
let address = '';
before(() => new Promise((resolve) => server.listen(0, '127.0.0.1', () => {
  const at = /** @type {import('node:net').AddressInfo} */ (server.address());
  address = `http://127.0.0.1:${at.port}/a.esvo`;
  resolve(undefined);
})));
after(() => {
  server.closeAllConnections();
  server.close();
});

/** @type {typeof behave} */
const ranges = ([from, to], _, response) =>
  response.writeHead(206, { 'Content-Range': `bytes ${from}-${to}/${bytes.length}`, ETag: '"one"' }).end(bytes.subarray(from, to + 1));
const source = () => httpSource(address, { retries: 2, pause: 1, timeout: 300 });
const readAll = async (/** @type {import('../src/source.js').Source} */ from) => {
  const served = await openSource(from);
  while (served.links.length) await served.readPage(served.links[0]);
  return subset(served, [...served.blocks.keys()]);
};
const fails = (/** @type {RegExp} */ message) => assert.rejects(readAll(source()), (/** @type {any} */ error) => {
  assert.ok(error instanceof EsvoError, error.stack);
  assert.match(error.message, message);
  return true;
});
/** The first request as it should be, the others not. */
const later = (/** @type {typeof behave} */ other) => {
  let first = true;
  /** @type {typeof behave} */
  const both = (range, request, response) => {
    if (first) ranges([range[0], Math.min(range[1], 199)], request, response);
    else other(range, request, response);
    first = false;
  };
  return both;
};

test('a server with ranges', async () => {
  behave = ranges;
  const octree = await openBytes(bytes);
  const from = source();
  const { image } = await readAll(from);
  assert.equal(image.length * 4, octree.table.reduce((sum, block) => sum + block.size, 0));
  assert.ok(from.count.requests >= 1 && from.count.bytes <= 1.2 * bytes.length);
});

test('a server without ranges: the file is read once, as a whole', async () => {
  behave = (_, __, response) => response.writeHead(200, { 'Content-Length': bytes.length }).end(bytes);
  requests = 0;
  const from = source();
  await readAll(from);
  assert.deepEqual([requests, from.whole], [1, true]);
  await assert.rejects(readAll(httpSource(address, { maxWholeBytes: 1000 })), /does not answer range requests/);
  behave = (_, __, response) => response.writeHead(200).end(bytes);
  await assert.rejects(readAll(httpSource(address, { maxWholeBytes: 1000 })), /may have/);
});

test('a server that fails for a while', async () => {
  let failures = 2;
  behave = (range, request, response) => (failures-- > 0 ? response.writeHead(503).end() : ranges(range, request, response));
  await readAll(source());
  failures = Infinity;
  await fails(/503/);
});

test('servers that do not do what they should', async () => {
  behave = (_, __, response) => response.writeHead(404).end();
  await fails(/is not there/);
  behave = (_, __, response) => response.writeHead(403).end();
  await fails(/403/);
  behave = () => {};
  await fails(/no answer within|cannot be read/);
  behave = (_, request) => request.socket.destroy();
  await fails(/cannot be read/);
  behave = ([from, to], _, response) => response.writeHead(206).end(bytes.subarray(from, to + 1));
  await fails(/without saying which range/);
  behave = ([from, to], _, response) => response.writeHead(206, { 'Content-Range': `bytes ${from + 1}-${to}/${bytes.length}` }).end(bytes.subarray(from + 1, to + 1));
  await fails(/where 0 to/);
  behave = ([from, to], _, response) => response.writeHead(206, { 'Content-Range': `bytes ${from}-${to}/${bytes.length}` }).end(bytes.subarray(from, to));
  await fails(/ended after/);
  behave = ([from, to], _, response) => response.writeHead(206, { 'Content-Range': `bytes ${from}-${to}/${bytes.length}` }).end(new Uint8Array(to - from + 2));
  await fails(/more bytes than/);
});

test('a file that is replaced while it is read', async () => {
  const headers = (/** @type {number} */ from, /** @type {number} */ to, length = bytes.length) => ({ 'Content-Range': `bytes ${from}-${to}/${length}` });
  behave = later(([from, to], request, response) => {
    assert.equal(request.headers['if-range'], '"one"');
    response.writeHead(200).end(bytes);
  });
  const short = async (/** @type {RegExp} */ message) => {
    const from = httpSource(address, { retries: 0 });
    const read = from.read.bind(from);
    // The head of this file fits the first request: a shorter one makes others necessary.
    from.read = (offset, length, signal) => read(offset, offset === 0 ? 200 : length, signal);
    await assert.rejects(readAll(from), message);
  };
  await short(/was replaced/);
  behave = later(([from, to], _, response) => response.writeHead(206, { ...headers(from, to), ETag: '"two"' }).end(bytes.subarray(from, to + 1)));
  await short(/was replaced/);
  behave = later(([from, to], _, response) => response.writeHead(206, headers(from, to, bytes.length + 8)).end(bytes.subarray(from, to + 1)));
  await short(/was replaced/);
});

test('damaged parts are found', async () => {
  const octree = await openBytes(bytes);
  for (const part of octree.parts ?? []) {
    behave = ([from, to], _, response) => {
      const own = bytes.slice(from, to + 1);
      const at = part.fileAt + part.size - 1 - from;
      if (at >= 0 && at < own.length) own[at] ^= 1;
      response.writeHead(206, { 'Content-Range': `bytes ${from}-${to}/${bytes.length}` }).end(own);
    };
    await fails(/S004/);
  }
});

// A generator of numbers that is the same on every machine.
function* numbers(/** @type {number} */ seed) {
  for (;;) {
    seed = (Math.imul(seed, 1664525) + 1013904223) >>> 0;
    yield seed >>> 8;
  }
}

test('damage with right checksums of tables is answered with one error, or none', async () => {
  const random = numbers(7);
  const next = (/** @type {number} */ below) => /** @type {number} */ (random.next().value) % below;
  const names = readdirSync(VALID).filter((name) => /^(written|parts|random|compressed).*esvo$/.test(name));
  for (let k = 0; k < 1500; k++) {
    const damaged = file(names[next(names.length)]).slice();
    for (let n = 1 + next(3); n > 0; n--) damaged[next(Math.min(damaged.length, k % 2 ? 2000 : damaged.length))] = next(256);
    await openBytes(damaged).catch((error) => assert.ok(error instanceof EsvoError, error.stack));
  }
});

test('damaged fields with right checksums are answered with one error, or none', async () => {
  const random = numbers(11);
  const next = (/** @type {number} */ below) => /** @type {number} */ (random.next().value) % below;
  let [read, refused] = [0, 0];
  for (const name of readdirSync(VALID).filter((name) => /^parts.*esvo$/.test(name))) {
    const octree = await openBytes(file(name));
    for (let k = 0; k < 150; k++) {
      const damaged = octree.bytes.slice();
      const parts = octree.parts ?? [];
      const part = parts[next(parts.length)];
      for (let n = 1 + next(3); n > 0; n--) damaged[part.fileAt + 16 + next(part.size - 16)] = next(256);
      new DataView(damaged.buffer).setUint32(part.fileAt, crc32(damaged.subarray(part.fileAt + 4, part.fileAt + part.size)), true);
      await readAll(bytesSource(damaged)).then(() => read++, (error) => {
        assert.ok(error instanceof EsvoError, error.stack);
        refused++;
      });
    }
  }
  assert.ok(read > 100 && refused > 100, `${read} were read, ${refused} refused`);
});
