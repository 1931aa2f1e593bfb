// Zstandard (RFC 8878) by libzstd, as the npm package zstddec compiles it to WebAssembly. What libzstd lets pass and the
// specification does not is checked here: a frame must be whole and alone.
import { ZSTDDecoder } from '../vendor/zstddec.js';
import { viewOf, u64 } from './bytes.js';

const decoder = new ZSTDDecoder();

/** Compiles the decoder. Everything that reads files waits for it. */
export function ready() {
  return decoder.init();
}

const MAGIC = 0xfd2fb528;

/**
 * What is wrong with a frame before it is decoded, or `undefined`.
 * @param {Uint8Array} frame
 * @param {number} size Bytes that it must decode to.
 */
function wrong(frame, size) {
  const cut = 'the stored bytes are not one Zstandard frame';
  if (frame.length < 6) return cut;
  const view = viewOf(frame);
  if (view.getUint32(0, true) !== MAGIC) return cut;
  const descriptor = frame[4];
  if (descriptor & 8) return cut;
  const single = (descriptor >> 5) & 1;
  let at = 5 + (single ? 0 : 1);
  const dictionary = [0, 1, 2, 4][descriptor & 3];
  for (let k = 0; k < dictionary; k++) if (frame[at + k]) return 'the frame needs a dictionary';
  at += dictionary;
  const contentBytes = [single, 2, 4, 8][descriptor >> 6];
  if (frame.length < at + contentBytes) return cut;
  if (contentBytes) {
    const content = contentBytes === 1 ? frame[at]
      : contentBytes === 2 ? view.getUint16(at, true) + 256
      : contentBytes === 4 ? view.getUint32(at, true) : u64(view, at);
    if (content !== size) return `the frame says that it has ${content} bytes, expected ${size}`;
  }
  at += contentBytes;
  for (let last = false; !last; ) {
    if (frame.length < at + 3) return cut;
    const header = frame[at] | (frame[at + 1] << 8) | (frame[at + 2] << 16);
    last = (header & 1) === 1;
    const kind = (header >> 1) & 3;
    if (kind === 3) return cut;
    at += 3 + (kind === 1 ? 1 : header >> 3);
  }
  if (descriptor & 4) at += 4;
  return at === frame.length ? undefined : cut;
}

/**
 * Decodes one frame.
 * @param {Uint8Array} frame
 * @param {number} size Bytes that it must decode to; the caller has bounded it.
 * @returns {Uint8Array | string} The bytes, or what is wrong.
 */
export function decodeFrame(frame, size) {
  const found = wrong(frame, size);
  if (found) return found;
  // An error is a length that is not `size`: the package turns libzstd's codes into empty results. A frame of no bytes has no other way
  // to be told from an error than a capacity that is larger.
  const bytes = decoder.decode(frame, size || 1);
  return bytes.length === size ? bytes : `the stored bytes cannot be decompressed to ${size} bytes`;
}
