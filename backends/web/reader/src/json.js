import { EsvoError } from './errors.js';

const MAX_DEPTH = 64;

/**
 * Reads META: one JSON object, by the rules of section 2.3 (M001), which `JSON.parse` does not check: names that occur twice,
 * halves of surrogate pairs, numbers beyond binary64, depth.
 * @param {Uint8Array} bytes
 * @param {number} offset Of the section in the file, for errors.
 * @returns {Record<string, unknown>}
 */
export function readMetadata(bytes, offset) {
  /** @type {(at: number, what: string) => never} */
  const fail = (at, what) => {
    throw new EsvoError('M001', offset + at, `the metadata: ${what}`);
  };
  if (bytes[0] === 0xef && bytes[1] === 0xbb && bytes[2] === 0xbf) fail(0, 'it starts with a byte order mark');
  let text = '';
  try {
    text = new TextDecoder('utf-8', { fatal: true, ignoreBOM: true }).decode(bytes);
  } catch {
    fail(0, 'it is not UTF-8');
  }
  let at = 0;
  const space = () => {
    while (at < text.length && ' \t\n\r'.includes(text[at])) at++;
  };
  const string = () => {
    if (text[at] !== '"') fail(at, 'expected a string');
    const start = at++;
    while (at < text.length && text[at] !== '"') {
      if (text.charCodeAt(at) < 0x20) fail(at, 'a string contains a control character');
      at += text[at] === '\\' ? 2 : 1;
    }
    if (at >= text.length) fail(start, 'a string has no end');
    at++;
    let value = '';
    try {
      value = JSON.parse(text.slice(start, at));
    } catch {
      fail(start, 'a string has an unknown escape');
    }
    for (let k = 0; k < value.length; k++) {
      const code = value.charCodeAt(k);
      const next = value.charCodeAt(k + 1);
      if (code >= 0xd800 && code < 0xdc00 && next >= 0xdc00 && next < 0xe000) k++;
      else if (code >= 0xd800 && code < 0xe000) fail(start, 'a string contains half of a surrogate pair');
    }
    return value;
  };
  /** @type {(depth: number) => unknown} */
  const value = (depth) => {
    space();
    const start = at;
    if (text[at] === '"') return string();
    if (text[at] === '{' || text[at] === '[') {
      if (depth > MAX_DEPTH) fail(at, `arrays and objects are nested more than ${MAX_DEPTH} deep`);
      return text[at] === '{' ? object(depth) : array(depth);
    }
    for (const [word, meaning] of /** @type {[string, unknown][]} */ ([['true', true], ['false', false], ['null', null]])) {
      if (text.startsWith(word, at)) {
        at += word.length;
        return meaning;
      }
    }
    const number = /^-?(0|[1-9][0-9]*)(\.[0-9]+)?([eE][+-]?[0-9]+)?/.exec(text.slice(at, at + 4096));
    if (!number) return fail(at, 'expected a value');
    at += number[0].length;
    if (!Number.isFinite(Number(number[0]))) fail(start, 'a number is out of the range of binary64');
    return Number(number[0]);
  };
  /** @type {(end: string) => boolean} Whether the end was reached; else a comma was. */
  const next = (end) => {
    space();
    if (text[at] !== end && text[at] !== ',') fail(at, 'expected a comma or the end of an array or object');
    return text[at++] === end;
  };
  /** @type {(depth: number) => Record<string, unknown>} */
  const object = (depth) => {
    /** @type {Record<string, unknown>} */
    const found = Object.create(null);
    at++;
    space();
    if (text[at] === '}') {
      at++;
      return found;
    }
    do {
      space();
      const start = at;
      const name = string();
      if (Object.hasOwn(found, name)) fail(start, `the name ${JSON.stringify(name)} occurs twice in one object`);
      space();
      if (text[at++] !== ':') fail(at - 1, 'expected a colon after a name');
      found[name] = value(depth + 1);
    } while (!next('}'));
    return found;
  };
  /** @type {(depth: number) => unknown[]} */
  const array = (depth) => {
    /** @type {unknown[]} */
    const found = [];
    at++;
    space();
    if (text[at] === ']') {
      at++;
      return found;
    }
    do found.push(value(depth + 1));
    while (!next(']'));
    return found;
  };
  space();
  if (text[at] !== '{') fail(at, 'expected an object');
  const found = object(1);
  space();
  if (at < text.length) fail(at, 'there is text after the object');
  return found;
}
