// Which pages of the pool are free. A page is 8 KiB, as blocks are made of.

/** Free pages as ranges, in order, none next to another. First fit. */
export class PageAllocator {
  /** @param {number} pages */
  constructor(pages) {
    this.total = pages;
    this.free = pages;
    /** @type {{ start: number, count: number }[]} */
    this.ranges = pages > 0 ? [{ start: 0, count: pages }] : [];
  }

  /**
   * @param {number} count
   * @returns {number} The first page, or -1 if there is no room in one piece.
   */
  take(count) {
    const at = this.ranges.findIndex((range) => range.count >= count);
    if (at < 0) return -1;
    const range = this.ranges[at];
    const { start } = range;
    range.start += count;
    range.count -= count;
    if (range.count === 0) this.ranges.splice(at, 1);
    this.free -= count;
    return start;
  }

  /**
   * Takes certain pages, which are free.
   * @param {number} start
   * @param {number} count
   */
  takeAt(start, count) {
    const at = this.ranges.findIndex((range) => range.start <= start && start + count <= range.start + range.count);
    if (at < 0) throw new RangeError(`pages ${start} to ${start + count} are not free`);
    const range = this.ranges[at];
    const rest = [{ start: range.start, count: start - range.start }, { start: start + count, count: range.start + range.count - start - count }];
    this.ranges.splice(at, 1, ...rest.filter((piece) => piece.count > 0));
    this.free -= count;
  }

  /**
   * @param {number} start
   * @param {number} count
   */
  give(start, count) {
    let [low, high] = [0, this.ranges.length];
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.ranges[middle].start < start) low = middle + 1;
      else high = middle;
    }
    this.ranges.splice(low, 0, { start, count });
    this.free += count;
    for (const k of [low, low - 1]) {
      const [a, b] = [this.ranges[k], this.ranges[k + 1]];
      if (a && b && a.start + a.count === b.start) {
        a.count += b.count;
        this.ranges.splice(k + 1, 1);
      }
    }
  }
}
