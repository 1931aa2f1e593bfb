import { overlapping, u64, viewOf } from './bytes.js';
import { crc32 } from './crc32.js';
import { need } from './errors.js';

/** What a file starts with. */
export const IDENTIFIER = [0xab, 0x45, 0x53, 0x56, 0x4f, 0x20, 0x31, 0xbb, 0x0d, 0x0a, 0x1a, 0x0a];
const KNOWN = new Set(['OBJT', 'BLKT', 'BLKS', 'PART', 'INDX', 'PAGE', 'META', 'INST', 'HASH']);

/** Bytes of the header. */
export const HEADER = 64;

/**
 * @typedef {object} Header
 * @property {number} major
 * @property {number} minor
 * @property {number} required Required feature bits 0 to 31; all above are zero.
 * @property {bigint} optional
 * @property {number} length Of the file.
 * @property {number} directoryAt
 * @property {number} directoryCount
 * @property {number} directoryCrc
 * @property {number} head Length of the head, or 0.
 */

/**
 * @typedef {object} Section
 * @property {string} tag Four characters, each a byte.
 * @property {number} flags
 * @property {number} offset
 * @property {number} length
 * @property {number} crc
 * @property {number} at Offset of the entry in the file.
 */

/**
 * Reads and checks a header: H001, H002, H005, H003; H004 if the length of the file is known; D001, D008.
 * @param {Uint8Array} bytes The start of the file: 64 bytes or more.
 * @param {number} [length] Of the file.
 * @returns {Header}
 */
export function readHeader(bytes, length) {
  need(bytes.length >= HEADER && IDENTIFIER.every((byte, k) => bytes[k] === byte), 'H001', 0, 'this is not an esvo file: the identifier is missing');
  const view = viewOf(bytes);
  const [major, minor] = [view.getUint16(12, true), view.getUint16(14, true)];
  need(major === 1, 'H002', 12, `the file has version ${major}.${minor}, this reader knows major version 1`);
  need(crc32(bytes.subarray(0, 60)) === view.getUint32(60, true), 'H005', 60, 'the header is damaged: its checksum differs');
  const required = view.getBigUint64(16, true);
  need((required & ~3n) === 0n, 'H003', 16, `this reader does not know the required feature bits 0x${(required & ~3n).toString(16)}`);
  const own = u64(view, 32);
  need(length === undefined || own === length, 'H004', 32, `the file has ${length} bytes, its header says ${own}: it was cut or appended to`);
  const header = {
    major, minor, required: Number(required), optional: view.getBigUint64(24, true), length: own,
    directoryAt: u64(view, 40), directoryCount: view.getUint32(48, true), directoryCrc: view.getUint32(52, true),
    head: view.getUint32(56, true),
  };
  const { directoryAt: at, directoryCount: count } = header;
  need(at % 8 === 0 && at >= HEADER && at + 32 * count <= own, 'D001', 40, `the directory at offset ${at} is not within the file, or not aligned to 8 bytes`);
  need(count <= 1024, 'D008', 48, `the directory has ${count} entries, expected at most 1024`);
  return header;
}

/**
 * Reads and checks the directory: D002, D007, D003, H006, D006, D005, S001 and I001 (which sections there are). Not D004.
 * @param {Header} header
 * @param {Uint8Array} bytes The directory.
 * @param {(section: Section) => void} [check] Looks at each section before overlaps do, for D004.
 * @returns {Section[]}
 */
export function readDirectory(header, bytes, check) {
  const { directoryAt, directoryCount, length } = header;
  need(crc32(bytes) === header.directoryCrc, 'D002', directoryAt, 'the directory is damaged: its checksum differs');
  const view = viewOf(bytes);
  /** @type {Section[]} */
  const sections = [];
  for (let k = 0; k < directoryCount; k++) {
    const at = 32 * k;
    const section = {
      tag: String.fromCharCode(...bytes.subarray(at, at + 4)), flags: view.getUint32(at + 4, true), offset: u64(view, at + 8),
      length: u64(view, at + 16), crc: view.getUint32(at + 24, true), at: directoryAt + at,
    };
    need(section.flags < 4 && view.getUint32(at + 28, true) === 0, 'D007', section.at, `reserved flags or fields of section ${section.tag} are not zero`);
    need(section.offset % 8 === 0 && section.offset + section.length <= length, 'D003', section.at,
      `section ${section.tag} at offset ${section.offset} with ${section.length} bytes is not within the file, or not aligned to 8 bytes`);
    sections.push(section);
  }
  for (const section of sections) {
    need(!(section.flags & 2) || section.crc === 0, 'D004', section.at, `section ${section.tag} has checksums of its own and one in the directory`);
    check?.(section);
  }
  const ranges = sections.map((section) => ({ start: section.offset, end: section.offset + section.length }));
  const twice = overlapping([{ start: 0, end: HEADER }, { start: directoryAt, end: directoryAt + 32 * directoryCount }, ...ranges]);
  need(!twice, 'D003', twice?.start ?? 0, () => `header, directory or sections overlap at offset ${twice?.start}`);
  const find = (/** @type {string} */ tag) => sections.filter((section) => section.tag === tag);
  const [objects, root] = [find('OBJT')[0], find('INDX')[0]];
  const end = (/** @type {Section | undefined} */ section) => (section ? section.offset + section.length : 0);
  const head = root ? Math.max(HEADER, directoryAt + 32 * directoryCount, end(objects), end(root)) : 0;
  need(header.head === head, 'H006', 56, `the header says that the head has ${header.head} bytes, expected ${head}`);
  for (const section of sections) {
    need(find(section.tag).length === 1, 'D006', section.at, `section ${section.tag} occurs more than once`);
  }
  for (const tag of ['OBJT', 'BLKT', 'BLKS']) need(find(tag).length === 1, 'D006', directoryAt, `section ${tag} does not occur exactly once`);
  for (const section of sections) {
    need(KNOWN.has(section.tag) || !(section.flags & 1), 'D005', section.at, `section ${JSON.stringify(section.tag)} is required, but this reader does not know it`);
  }
  return sections;
}
