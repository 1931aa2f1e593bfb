// Where bytes come from: memory, a file that a user picked, or a server (section 11.3).
import { EsvoError } from './errors.js';

/**
 * @typedef {object} Source
 * @property {(offset: number, length: number, signal?: AbortSignal) => Promise<Uint8Array>} read Exactly these bytes, or an error. Before the length
 *   is known, fewer where the file ends.
 * @property {number | undefined} length Of the file, once it is known.
 * @property {{ requests: number, bytes: number }} count What was asked for so far.
 * @property {boolean} [whole] Whether the whole file is in memory.
 */

/**
 * @param {string} message
 * @returns {never}
 */
function fail(message) {
  throw new EsvoError('source', 0, message);
}

/**
 * Bytes in memory.
 * @param {Uint8Array} bytes
 * @returns {Source}
 */
export function bytesSource(bytes) {
  const count = { requests: 0, bytes: 0 };
  return {
    length: bytes.length, count, whole: true,
    async read(offset, length) {
      count.requests++;
      count.bytes += length;
      return bytes.subarray(offset, offset + length);
    },
  };
}

/**
 * A `File` that a user picked or dropped, or another `Blob`.
 * @param {Blob} blob
 * @returns {Source}
 */
export function blobSource(blob) {
  const count = { requests: 0, bytes: 0 };
  return {
    length: blob.size, count,
    async read(offset, length) {
      count.requests++;
      count.bytes += length;
      return new Uint8Array(await blob.slice(offset, offset + length).arrayBuffer());
    },
  };
}

/**
 * @typedef {object} HttpOptions
 * @property {typeof fetch} [fetch]
 * @property {number} [maxWholeBytes] Most bytes of a file from a server that knows no ranges; 512 MiB.
 * @property {number} [retries] How often a request is repeated; 3.
 * @property {number} [timeout] Of a request without any answer, in milliseconds; 20,000.
 * @property {number} [pause] Before the first repetition, in milliseconds; it doubles; 300.
 */

/**
 * A file on a server that answers range requests. From one that does not, the whole file is read, once.
 * @param {string | URL} address
 * @param {HttpOptions} [options]
 * @returns {Source}
 */
export function httpSource(address, options = {}) {
  return new HttpSource(String(address), options);
}

class HttpSource {
  /** @type {number | undefined} */
  length = undefined;
  count = { requests: 0, bytes: 0 };
  /** @type {Uint8Array | undefined} */
  #all = undefined;
  /** @type {string | undefined} */
  #tag = undefined;

  /**
   * @param {string} address
   * @param {HttpOptions} options
   */
  constructor(address, { fetch: get = (...all) => fetch(...all), maxWholeBytes = 2 ** 29, retries = 3, timeout = 20000, pause = 300 }) {
    Object.assign(this, { address });
    this.address = address;
    this.get = get;
    this.limits = { maxWholeBytes, retries, timeout, pause };
    const here = globalThis.location?.origin;
    // `If-Range` is no header that other servers must allow; the tag of the answer is compared in any case.
    this.sameOrigin = here === undefined || new URL(address, globalThis.location?.href).origin === here;
  }

  get whole() {
    return this.#all !== undefined;
  }

  /**
   * @param {number} offset
   * @param {number} length
   * @param {AbortSignal} [signal]
   */
  async read(offset, length, signal) {
    for (let attempt = 0; ; attempt++) {
      if (this.#all) return this.#all.subarray(offset, offset + length);
      try {
        return await this.#once(offset, length, signal);
      } catch (error) {
        if (error instanceof EsvoError || signal?.aborted || attempt >= this.limits.retries) throw this.#explain(error);
        await new Promise((resolve) => setTimeout(resolve, this.limits.pause * 2 ** attempt));
      }
    }
  }

  /** @param {unknown} error */
  #explain(error) {
    if (error instanceof EsvoError || (error instanceof DOMException && error.name === 'AbortError')) return error;
    const reason = error instanceof Error ? error.message : String(error);
    return new EsvoError('source', 0, `${this.address} cannot be read: ${reason}. Is the address right, is the server up, and does it allow other sites to read it (Access-Control-Allow-Origin)?`);
  }

  /**
   * @param {number} offset
   * @param {number} length
   * @param {AbortSignal} [signal]
   */
  async #once(offset, length, signal) {
    const abort = new AbortController();
    const stop = () => abort.abort(signal?.reason);
    signal?.addEventListener('abort', stop);
    const timer = setTimeout(() => abort.abort(new Error(`no answer within ${this.limits.timeout / 1000} seconds`)), this.limits.timeout);
    try {
      /** @type {Record<string, string>} */
      const headers = { Range: `bytes=${offset}-${offset + length - 1}` };
      if (this.#tag && this.sameOrigin) headers['If-Range'] = this.#tag;
      this.count.requests++;
      const answer = await this.get(this.address, { headers, signal: abort.signal, cache: 'no-store' });
      clearTimeout(timer);
      if (answer.status === 200) return await this.#readWhole(answer, offset, length);
      if (answer.status === 206) return await this.#readRange(answer, offset, length);
      await answer.body?.cancel();
      if (answer.status === 429 || answer.status >= 500) throw new Error(`the server answered ${answer.status} ${answer.statusText}`);
      if (answer.status === 404) fail(`${this.address} is not there: the server answered 404. Check the address`);
      if (answer.status === 416) fail(`${this.address} is shorter than it was, or empty: the server has no bytes from ${offset} on. Load it anew`);
      return fail(`${this.address} cannot be read: the server answered ${answer.status} ${answer.statusText}`);
    } finally {
      clearTimeout(timer);
      signal?.removeEventListener('abort', stop);
    }
  }

  /**
   * @param {Response} answer
   * @param {number} offset
   * @param {number} length
   */
  async #readWhole(answer, offset, length) {
    const first = this.length === undefined;
    const total = Number(answer.headers.get('Content-Length') ?? NaN);
    const { maxWholeBytes } = this.limits;
    if (!first || total > maxWholeBytes) {
      await answer.body?.cancel();
      fail(first
        ? `the server of ${this.address} does not answer range requests, and the whole file has ${total} bytes, more than ${maxWholeBytes}: use a server with ranges, e.g. \`esvo view\` or nginx`
        : `${this.address} was replaced while it was read: load it anew`);
    }
    this.#all = await readBody(answer, Math.min(maxWholeBytes, Number.isNaN(total) ? Infinity : Math.max(total, 1)), (n) => (this.count.bytes += n), false);
    this.length = this.#all.length;
    return this.#all.subarray(offset, offset + length);
  }

  /**
   * @param {Response} answer
   * @param {number} offset
   * @param {number} length
   */
  async #readRange(answer, offset, length) {
    const refuse = async (/** @type {string} */ message) => {
      await answer.body?.cancel();
      return fail(message);
    };
    // Other servers may hide the header; then the checksums of parts and pages say whether these are the bytes.
    const range = /^bytes (\d+)-(\d+)\/(\d+|\*)$/.exec(answer.headers.get('Content-Range') ?? '');
    const tag = answer.headers.get('ETag') ?? undefined;
    let expected = length;
    if (range) {
      const [start, end, total] = [Number(range[1]), Number(range[2]), Number(range[3])];
      expected = Math.min(length, (Number.isNaN(total) ? Infinity : total) - offset);
      if (start !== offset || end !== offset + expected - 1) await refuse(`the server of ${this.address} answered bytes ${range[1]} to ${range[2]} where ${offset} to ${offset + length - 1} were asked for`);
      if (this.length !== undefined && total !== this.length && !Number.isNaN(total)) await refuse(`${this.address} was replaced while it was read: load it anew`);
      if (!Number.isNaN(total)) this.length = total;
    } else if (this.sameOrigin) {
      await refuse(`the server of ${this.address} answered a range request without saying which range`);
    }
    if (this.#tag && tag && tag !== this.#tag) await refuse(`${this.address} was replaced while it was read: load it anew`);
    if (tag && !tag.startsWith('W/')) this.#tag = tag;
    const bytes = await readBody(answer, expected, (n) => (this.count.bytes += n), true);
    if (range && bytes.length !== expected) throw new Error(`the answer ended after ${bytes.length} of ${expected} bytes`);
    return bytes;
  }
}

/**
 * The body of an answer, of at most so many bytes.
 * @param {Response} answer
 * @param {number} most
 * @param {(bytes: number) => void} count
 * @param {boolean} exact Whether there must not be more.
 */
async function readBody(answer, most, count, exact) {
  const reader = answer.body?.getReader();
  if (!reader) return new Uint8Array(0);
  /** @type {Uint8Array[]} */
  const chunks = [];
  let length = 0;
  for (;;) {
    const { done, value } = await reader.read();
    if (done) break;
    count(value.length);
    length += value.length;
    if (length > most) {
      await reader.cancel();
      fail(exact ? 'the server answered more bytes than were asked for' : `the file has more than the ${most} bytes that it may have`);
    }
    chunks.push(value);
  }
  if (chunks.length === 1) return chunks[0];
  const bytes = new Uint8Array(length);
  let at = 0;
  for (const chunk of chunks) {
    bytes.set(chunk, at);
    at += chunk.length;
  }
  return bytes;
}
