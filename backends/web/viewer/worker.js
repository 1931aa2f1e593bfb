// The worker: reads the file and lays out its blocks, so that no frame waits for that.
import { EsvoError } from '../reader/src/errors.js';
import { blobSource, httpSource } from '../reader/src/source.js';
import { Streamer } from './streamer.js';

/** @typedef {import('./priority.js').Eye} Eye */

/**
 * @typedef {{ type: 'open', address?: string, file?: Blob, budget: number } | { type: 'look', eye: Eye }} ToWorker
 */

/**
 * @typedef {{ type: 'opened', objects: { octreeToMesh: number[], levels: number, leafVoxels: number }[], inParts: boolean, length: number, whole: boolean, meta?: Record<string, unknown> }
 *   | { type: 'batch', batch: import('./streamer.js').Batch }
 *   | { type: 'root', object: number, boxes: { low: number[], high: number[] }[] }
 *   | { type: 'stats', stats: import('./streamer.js').Stats, settled: boolean }
 *   | { type: 'meta', meta: Record<string, unknown> }
 *   | { type: 'error', message: string, rule: string }} FromWorker
 */

/** @type {Streamer | undefined} */
let streamer;

/** @type {(message: FromWorker, transfer?: Transferable[]) => void} */
const post = (message, transfer = []) => self.postMessage(message, { transfer });

/** @param {unknown} error */
function fail(error) {
  if (error instanceof DOMException && error.name === 'AbortError') return;
  if (!(error instanceof EsvoError)) console.error(error);
  post({ type: 'error', message: error instanceof Error ? error.message : String(error), rule: error instanceof EsvoError ? error.rule : '' });
}

/** @param {{ address?: string, file?: Blob, budget: number }} message */
async function open({ address, file, budget }) {
  const source = file ? blobSource(file) : httpSource(String(address));
  const own = new Streamer(source, {
    budget, fail,
    batch: (batch) => post({ type: 'batch', batch }, batch.writes.map(({ words }) => /** @type {ArrayBuffer} */ (words.buffer))),
    root: (object, boxes) => post({ type: 'root', object, boxes }),
    stats: (stats) => post({ type: 'stats', stats, settled: own.settled }),
  });
  streamer = own;
  const { objects, inParts, length } = await own.open();
  post({ type: 'opened', objects: objects.map(({ octreeToMesh, levels, leafVoxels }) => ({ octreeToMesh, levels, leafVoxels })), inParts, length, whole: source.whole ?? false });
  if (pending) own.look(pending);
  // Names and credits; nothing waits for them.
  const meta = await own.served?.readMetadata().catch(() => undefined);
  if (meta) post({ type: 'meta', meta: { ...meta } });
}

/** @type {Eye | undefined} The last one that came before the file was open. */
let pending;

self.onmessage = (/** @type {MessageEvent<ToWorker>} */ { data }) => {
  if (data.type === 'open') open(data).catch(fail);
  else if (streamer?.pool) streamer.look(data.eye);
  else pending = data.eye;
};
