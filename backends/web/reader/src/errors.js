/**
 * A file that breaks a rule of the specification, or that this reader cannot read.
 */
export class EsvoError extends Error {
  /**
   * @param {string} rule Id of the rule (appendix C), or `limit`, `source` or `usage` where the file breaks none.
   * @param {number} offset Byte of the file where it was found.
   * @param {string} message What was found.
   */
  constructor(rule, offset, message) {
    super(/^[A-Z]\d/.test(rule) ? `${message} (rule ${rule}, at byte ${offset})` : message);
    this.name = 'EsvoError';
    this.rule = rule;
    this.offset = offset;
  }
}

/**
 * Throws unless the condition holds.
 * @param {unknown} condition
 * @param {string} rule
 * @param {number} offset
 * @param {string | (() => string)} message
 * @returns {asserts condition}
 */
export function need(condition, rule, offset, message) {
  if (!condition) throw new EsvoError(rule, offset, typeof message === 'function' ? message() : message);
}
