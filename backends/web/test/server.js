// A server for tests: the page, the kernels where the page looks for them, and files with ranges, or without, slowly, or damaged.
import { createReadStream, existsSync, readFileSync, statSync } from 'node:fs';
import { createServer } from 'node:http';
import { extname, join, normalize } from 'node:path';
import { fileURLToPath } from 'node:url';

const WEB = fileURLToPath(new URL('../', import.meta.url));
const KERNELS = fileURLToPath(new URL('../../core/kernels/', import.meta.url));
const TYPES = /** @type {Record<string, string>} */ ({ '.html': 'text/html', '.js': 'text/javascript', '.css': 'text/css', '.json': 'application/json', '.wgsl': 'text/wgsl' });

/**
 * @typedef {object} Served
 * @property {string} path
 * @property {boolean} [noRanges]
 * @property {number} [latency] Milliseconds before an answer.
 * @property {number} [rate] Bytes a second, of all answers together.
 * @property {(bytes: Buffer, offset: number) => void} [damage]
 * @property {number} [status]
 */

/**
 * @param {Record<string, Served>} files By their name in the address, below `/files/`.
 */
export async function serve(files) {
  const log = { requests: 0, bytes: 0, most: 0 };
  // When the line is free again, for those that share its rate.
  let free = 0;
  const server = createServer(async (request, response) => {
    const { pathname } = new URL(request.url ?? '/', 'http://localhost');
    const own = files[decodeURIComponent(pathname.replace(/^\/files\//, ''))];
    if (pathname.startsWith('/files/')) {
      if (!own || own.status) {
        response.writeHead(own?.status ?? 404).end();
        return;
      }
      log.requests++;
      const { size } = statSync(own.path);
      const range = own.noRanges ? null : /bytes=(\d+)-(\d*)/.exec(request.headers.range ?? '');
      const [from, to] = [Number(range?.[1] ?? 0), Math.min(Number(range?.[2] || Infinity), size - 1)];
      if (own.latency) await new Promise((resolve) => setTimeout(resolve, own.latency));
      response.writeHead(range ? 206 : 200, { 'Content-Length': to - from + 1, ETag: `"${size}"`, ...(range && { 'Content-Range': `bytes ${from}-${to}/${size}` }) });
      let at = from;
      for await (const chunk of createReadStream(own.path, { start: from, end: to, highWaterMark: 16384 })) {
        own.damage?.(chunk, at);
        at += chunk.length;
        log.bytes += chunk.length;
        if (own.rate) {
          const now = performance.now();
          free = Math.max(free, now) + (chunk.length / own.rate) * 1000;
          if (free > now + 2) await new Promise((resolve) => setTimeout(resolve, free - now));
        }
        if (response.destroyed) return;
        response.write(chunk);
      }
      response.end();
      return;
    }
    const path = pathname.startsWith('/kernels/') ? join(KERNELS, normalize(pathname.slice(9))) : join(WEB, normalize(pathname === '/' ? 'index.html' : pathname));
    if (!existsSync(path) || statSync(path).isDirectory()) {
      response.writeHead(404).end();
      return;
    }
    response.writeHead(200, { 'Content-Type': TYPES[extname(path)] ?? 'application/octet-stream' }).end(readFileSync(path));
  });
  await new Promise((resolve) => server.listen(0, '127.0.0.1', () => resolve(undefined)));
  const { port } = /** @type {import('node:net').AddressInfo} */ (server.address());
  return { origin: `http://127.0.0.1:${port}`, log, close: () => (server.closeAllConnections(), server.close()) };
}
