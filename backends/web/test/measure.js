// What is streamed how fast: node test/measure.js FILE PROGRAM [WHOLE] reads FILE over 50 Mbit/s and 50 ms, as the page does, and prints what is
// there after some seconds, and FLIP of its picture against that of WHOLE (or FILE), both cast by PROGRAM.
import { execFileSync } from 'node:child_process';
import { mkdtempSync, readFileSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { inflateSync } from 'node:zlib';
import { httpSource, subset, writeFile } from '../reader/src/index.js';
import { axes, planes } from '../viewer/camera.js';
import { Streamer } from '../viewer/streamer.js';
import { flip } from './flip.js';
import { serve } from './server.js';

const [, , file, program, whole = file] = process.argv;
const [WIDTH, HEIGHT] = [1024, 768];
const BUDGET = 256 << 20;
const TIMES = [0.5, 1, 2, 3, 5, 8];
const camera = { eye: [-17, -13.5, 0], forward: [27, 3.5, 0], up: [0, 1, 0], fov: 60, near: 1, far: 2 };
const folder = mkdtempSync(join(tmpdir(), 'esvo-measure-'));

/** The pixels of a PNG as the program writes it: 8 bits, RGB. */
function readPng(/** @type {string} */ path) {
  const bytes = readFileSync(path);
  const parts = [];
  for (let at = 8; at < bytes.length; at += 12 + bytes.readUInt32BE(at)) if (bytes.toString('latin1', at + 4, at + 8) === 'IDAT') parts.push(bytes.subarray(at + 8, at + 8 + bytes.readUInt32BE(at)));
  const raw = inflateSync(Buffer.concat(parts));
  const stride = 3 * WIDTH;
  const rows = new Uint8Array(stride * HEIGHT);
  for (let y = 0; y < HEIGHT; y++) {
    const filter = raw[y * (stride + 1)];
    for (let x = 0; x < stride; x++) {
      const left = x >= 3 ? rows[y * stride + x - 3] : 0;
      const above = y ? rows[(y - 1) * stride + x] : 0;
      const corner = y && x >= 3 ? rows[(y - 1) * stride + x - 3] : 0;
      const p = left + above - corner;
      const [a, b, c] = [Math.abs(p - left), Math.abs(p - above), Math.abs(p - corner)];
      const guess = [0, left, above, (left + above) >> 1, a <= b && a <= c ? left : b <= c ? above : corner][filter];
      rows[y * stride + x] = raw[y * (stride + 1) + 1 + x] + guess;
    }
  }
  return Uint8Array.from({ length: 4 * WIDTH * HEIGHT }, (_, k) => (k % 4 === 3 ? 255 : rows[Math.floor(k / 4) * 3 + (k % 4)]));
}

/** @param {string} path */
function picture(path) {
  const to = join(folder, 'picture.png');
  execFileSync(program, ['render', path, '-o', to, '--size', `${WIDTH}x${HEIGHT}`, `--camera=${camera.eye},${camera.forward}`, '--no-verify'], { stdio: 'ignore' });
  return readPng(to);
}

const server = await serve({ f: { path: file, latency: 50, rate: 50e6 / 8 } });
/** @type {{ used: number, kept: number, requests: number, bytes: number, parts: number } | undefined} */
let stats;
let [most, first] = [0, 0];
const start = performance.now();
const seconds = () => (performance.now() - start) / 1000;
const streamer = new Streamer(httpSource(`${server.origin}/files/f`), {
  budget: BUDGET, batch: () => (first ||= seconds()), fail: (error) => console.error(error),
  stats: (now) => {
    stats = now;
    most = Math.max(most, now.used + now.kept);
  },
});
await streamer.open();
const half = Math.tan((camera.fov * Math.PI) / 360);
const { right, up, forward } = axes({ ...camera, ...planes([], camera.eye) });
streamer.look({ eye: camera.eye, forward, right, up, tangent: [(half * WIDTH) / HEIGHT, half], pixel: (2 * half) / HEIGHT, velocity: [0, 0, 0], threshold: 1 });
/** @type {{ time: number, shown: Map<number, number>, stats: any }[]} */
const seen = [];
let done = 0;
for (const time of TIMES) {
  while (seconds() < time) await new Promise((resolve) => setTimeout(resolve, 5));
  if (streamer.settled) done ||= seconds();
  seen.push({ time, shown: new Map([...streamer.residents].filter(([, own]) => own.shown).map(([index, own]) => [index, own.shown])), stats: { ...stats } });
}
while (!streamer.settled && seconds() < 60) await new Promise((resolve) => setTimeout(resolve, 5));
done ||= seconds();
seen.push({ time: done, shown: new Map([...streamer.residents].filter(([, own]) => own.shown).map(([index, own]) => [index, own.shown])), stats: { ...stats } });
console.log(`first change of the picture after ${first.toFixed(2)} s; all after ${done.toFixed(2)} s; at most ${(most / 1e6).toFixed(1)} MB of ${(BUDGET / 1e6).toFixed(0)}; ${(process.cpuUsage().user / 1e6).toFixed(1)} s of CPU`);
const exact = picture(whole);
for (const { time, shown, stats } of seen) {
  const path = join(folder, 'part.esvo');
  if (!streamer.served || shown.size === 0) continue;
  streamer.served.source = { length: undefined, count: { requests: 0, bytes: 0 }, read: async (offset, length) => readAt(offset, length) };
  writeFileSync(path, writeFile(await subset(streamer.served, [...shown.keys()], (index) => shown.get(index) ?? 0)));
  const found = flip(exact, picture(path), WIDTH, HEIGHT);
  console.log(`${time.toFixed(1)} s: ${(stats.bytes / 1e6).toFixed(2)} MB, ${stats.requests} requests, ${stats.parts} parts, FLIP ${found.toFixed(4)}`);
}
server.close();
rmSync(folder, { recursive: true });

/** Bytes of the file itself, without the slow line. */
async function readAt(/** @type {number} */ offset, /** @type {number} */ length) {
  const { open } = await import('node:fs/promises');
  const handle = await open(file);
  const { buffer } = await handle.read(Buffer.alloc(length), 0, length, offset);
  await handle.close();
  return new Uint8Array(buffer);
}
