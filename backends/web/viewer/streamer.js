// Keeps the parts of a file in memory that the camera needs most (specification, sections 4.3 to 4.5 and 11.3).
//
// A part is worth as many pixels as the voxels have that it splits. The parts that are worth most are wanted, as many as the budget
// holds. A block that gets a part is laid out anew beside its former image; then one descriptor of its parent is changed, so that
// the picture changes at once and never shows half of it. What is least worth goes first, and only when its room is needed.
import { EsvoError } from '../reader/src/errors.js';
import { coalesce, openSource } from '../reader/src/served.js';
import { NO_PARENT } from '../reader/src/tables.js';
import { coarseBoxes } from './camera.js';
import { PageAllocator } from './pages.js';
import { Place } from './priority.js';

/** @typedef {import('../reader/src/served.js').Served} Served */
/** @typedef {import('../reader/src/served.js').ServedBlock} ServedBlock */
/** @typedef {import('../reader/src/served.js').BlockLink} BlockLink */
/** @typedef {import('../reader/src/index-pages.js').PageLink} PageLink */
/** @typedef {import('../reader/src/tables.js').PartEntry} PartEntry */
/** @typedef {import('./priority.js').Eye} Eye */

/** Bytes and words of a page. */
const PAGE = 8192;
const PAGE_WORDS = 2048;
/** Requests at a time, most bytes of one, and bytes that are worth reading along. */
const REQUESTS = 6;
const REQUEST_BYTES = 1 << 18;
const GAP = 1 << 13;
/** How much better a part must be to drive out another. */
const BETTER = 1.3;
/** Milliseconds between two plans, where none is urgent. */
const PLAN_EVERY = 80;
/** Milliseconds between two reports, while there is more to come. */
const REPORT_EVERY = 50;
/** Milliseconds of work between two looks at the queue of messages. */
const SLICE = 12;
/** What of the budget is for parts that are kept, in case their blocks are laid out anew; the rest is for images. */
const KEPT = 0.25;
/** What of either is planned with: the rest is for what goes while something comes, and for gaps. */
const ROOM = 0.92;

/**
 * What is in memory of a block.
 * @typedef {object} Resident
 * @property {ServedBlock} block
 * @property {Place} place
 * @property {number} depth
 * @property {number} sight
 * @property {number} bytes Of all its parts.
 * @property {number} shownBytes Of those in the image.
 * @property {(Uint8Array | undefined)[]} stored Bytes of the parts that are there.
 * @property {boolean[]} loading
 * @property {number} shown Number of parts in the image in the pool; 0 if it is in none.
 * @property {number} wanted Number of parts that should be there.
 * @property {number} page
 * @property {number} pages
 * @property {BlockLink[]} links Of the image that is shown.
 * @property {number} inner Non-leaf mask of the descriptor that leads here.
 * @property {Resident[]} children Those that are known.
 */

/**
 * A change of the pool that is made at once.
 * @typedef {object} Batch
 * @property {{ at: number, words: Uint32Array }[]} writes Word in the pool, and what comes there.
 * @property {number[]} patches Pairs of a word in the pool and its value.
 * @property {number[]} roots Slot of the root of each object.
 */

/**
 * @typedef {object} Stats
 * @property {number} requests
 * @property {number} bytes Read from the source.
 * @property {number} parts In the picture.
 * @property {number} known Parts that are known.
 * @property {number} missing Parts that are wanted and not there.
 * @property {number} used Bytes of the pool in use.
 * @property {number} kept Bytes of parts that are kept.
 * @property {number} limit Voxels of so many pixels are split as far as the budget lets it; the threshold if it does not matter.
 */

export class Streamer {
  /**
   * @param {import('../reader/src/source.js').Source} source
   * @param {{ budget: number, batch: (batch: Batch) => void, stats?: (stats: Stats) => void, root?: (object: number, boxes: { low: number[], high: number[] }[]) => void, fail?: (error: unknown) => void, now?: () => number }} options
   *   `budget`: bytes of the pool and of parts that are kept.
   */
  constructor(source, { budget, batch, stats = () => {}, fail = () => {}, root = () => {}, now = () => performance.now() }) {
    this.source = source;
    this.budget = budget;
    this.send = batch;
    this.report = stats;
    this.fail = fail;
    this.sawRoot = root;
    this.now = now;
    /** @type {Map<number, Resident>} */
    this.residents = new Map();
    /** @type {Map<PageLink, Place>} Pages of the index that were not read. */
    this.pageLinks = new Map();
    /** @type {Eye | undefined} */
    this.eye = undefined;
    /** @type {number[]} */
    this.roots = [];
    this.inFlight = 0;
    this.kept = 0;
    this.missing = 0;
    this.known = 0;
    this.partsShown = 0;
    this.working = false;
    this.plannedAt = -Infinity;
    this.reportedAt = -Infinity;
    /** @type {{ pixels: number, parts: PartEntry[], link: PageLink | undefined }[]} */
    this.wishes = [];
    /** @type {ReturnType<typeof setTimeout> | undefined} */
    this.planTimer = undefined;
    this.limit = 0;
    this.failed = false;
    /** How far the budget is used: less where estimates were too low. */
    this.trust = 1;
    this.abort = new AbortController();
    /** @type {Set<Resident>} Blocks with parts that are not in their image. */
    this.ready = new Set();
  }

  /** Reads the head. Returns what the page shows of the file. */
  async open() {
    const served = await openSource(this.source);
    this.served = served;
    this.pool = new PageAllocator(Math.max(16, Math.floor((this.budget * (1 - KEPT)) / PAGE)));
    this.#learn([...served.blocks.values()], served.links);
    this.roots = served.objects.map(() => 0xffffffff);
    return { objects: served.objects, inParts: served.inParts, length: served.header.length };
  }

  /**
   * @param {ServedBlock[]} blocks
   * @param {PageLink[]} links
   */
  #learn(blocks, links) {
    const { served } = this;
    if (!served) return;
    for (const block of blocks) {
      const place = new Place(served.objects[block.object].octreeToMesh, block.position, block.scale);
      this.residents.set(block.index, {
        block, place, depth: 0, sight: 1, bytes: block.parts.reduce((sum, part) => sum + part.size, 0), shownBytes: 0, stored: block.parts.map(() => undefined), loading: block.parts.map(() => false), shown: 0, wanted: 0,
        page: -1, pages: 0, links: [], inner: 0, children: [],
      });
      this.known += block.parts.length;
    }
    for (const { index, parent } of blocks) {
      const own = this.residents.get(index);
      if (own && parent !== NO_PARENT) this.residents.get(parent)?.children.push(own);
    }
    for (const link of links) {
      if (this.pageLinks.has(link)) continue;
      const object = served.objects[link.object ?? 0];
      const all = link.object === undefined && served.objects.length > 1;
      this.pageLinks.set(link, all ? new Place(object.octreeToMesh, [0, 0, 0], 23) : new Place(object.octreeToMesh, link.position, link.scale));
    }
  }

  /**
   * The camera moved, or a setting changed.
   * @param {Eye} eye
   */
  look(eye) {
    if (this.eye && eye.eye.some((x, k) => x !== this.eye?.eye[k])) this.trust = Math.min(this.trust * 1.01, 1);
    this.eye = eye;
    if (this.now() - this.plannedAt >= PLAN_EVERY) this.plan();
    else this.#planSoon();
  }

  /** Ends everything. */
  close() {
    this.failed = true;
    clearTimeout(this.planTimer);
    this.abort.abort();
  }

  /** Whether all that is wanted is there. */
  get settled() {
    return this.inFlight === 0 && this.wishes.length === 0 && this.missing <= 0 && this.ready.size === 0 && !this.working && this.planTimer === undefined;
  }

  /** Decides what is wanted, and asks for what is missing. */
  plan() {
    const { eye, pool, served } = this;
    clearTimeout(this.planTimer);
    this.planTimer = undefined;
    if (!eye || !pool || !served || this.failed) return;
    this.plannedAt = this.now();
    /** @type {{ pixels: number, own: Resident, number: number }[]} */
    const candidates = [];
    for (const own of this.residents.values()) {
      const { depth, sight } = own.place.worth(eye);
      own.depth = depth;
      own.sight = sight;
      own.wanted = 0;
      const isRoot = own.block.parent === NO_PARENT;
      const { parts } = own.block;
      for (let number = 0; number < parts.length; number++) {
        const pixels = isRoot && number === 0 ? Infinity : own.place.pixels(own, parts[number].first, eye.pixel);
        // Those after it are worth less.
        if (pixels <= eye.threshold) break;
        candidates.push({ pixels, own, number });
      }
    }
    candidates.sort((a, b) => b.pixels - a.pixels || a.own.block.first - b.own.block.first || a.number - b.number);
    let images = pool.total * PAGE * ROOM * this.trust;
    let stored = this.budget * KEPT * ROOM;
    this.limit = eye.threshold;
    this.missing = 0;
    /** @type {Map<PartEntry, number>} */
    const worth = new Map();
    for (const { pixels, own, number } of candidates) {
      const parent = own.block.parent === NO_PARENT ? undefined : this.residents.get(own.block.parent);
      // In this order a part comes after all that it needs; where one of those had no room, it has none.
      if (own.wanted !== number || (parent && parent.wanted === 0)) continue;
      const part = own.block.parts[number];
      const cost = this.#cost(own, number);
      if (cost > images || part.size > stored) {
        // Smaller ones may have room.
        this.limit = Math.max(this.limit, Math.min(pixels, 1e6));
        continue;
      }
      images -= cost;
      stored -= part.size;
      own.wanted = number + 1;
      if (own.stored[number]) continue;
      this.missing++;
      if (!own.loading[number]) worth.set(part, pixels);
    }
    this.#wish(worth, eye);
    this.#ask();
    this.#report();
  }

  /** Plans anew, soon. */
  #planSoon() {
    if (this.planTimer !== undefined) return;
    this.planTimer = setTimeout(() => this.plan(), Math.max(PLAN_EVERY - (this.now() - this.plannedAt), 0));
  }

  /**
   * Bytes of the pool that a part takes.
   * @param {Resident} own
   * @param {number} number
   */
  #cost(own, number) {
    const { size } = own.block.parts[number];
    if (number < own.shown) return (own.pages * PAGE * size) / own.shownBytes;
    // An image has whole pages: half of one is left over.
    return (own.block.size * size) / own.bytes + (number === 0 ? PAGE / 2 : 0);
  }

  /**
   * What is to be asked for, the most needed last: parts that lie close together, and pages of the index.
   * @param {Map<PartEntry, number>} worth
   * @param {Eye} eye
   */
  #wish(worth, eye) {
    const least = Math.max(eye.threshold, this.limit);
    this.wishes = coalesce([...worth.keys()], GAP, REQUEST_BYTES).map(({ parts }) => ({
      pixels: parts.reduce((most, part) => Math.max(most, worth.get(part) ?? 0), 0), parts, link: /** @type {PageLink | undefined} */ (undefined),
    }));
    for (const [link, place] of this.pageLinks) {
      const pixels = place.pixels(place.worth(eye), link.first, eye.pixel);
      if (pixels > least) this.wishes.push({ pixels, parts: [], link });
    }
    this.wishes.sort((a, b) => a.pixels - b.pixels);
  }

  /** Asks for the most needed, as much as may be on its way. */
  #ask() {
    while (this.inFlight < REQUESTS && !this.failed) {
      const wish = this.wishes.pop();
      if (!wish) return;
      this.inFlight++;
      (wish.link ? this.#loadPage(wish.link) : this.#loadParts(wish.parts)).catch((error) => this.#stop(error)).finally(() => {
        this.inFlight--;
        this.#ask();
        if (this.inFlight === 0 && this.wishes.length === 0) this.#planSoon();
        this.#report();
      });
    }
  }

  /** @param {unknown} error */
  #stop(error) {
    if (this.failed) return;
    this.failed = true;
    this.abort.abort();
    this.fail(error);
  }

  /** @param {PageLink} link */
  async #loadPage(link) {
    const { served } = this;
    this.pageLinks.delete(link);
    const before = new Set(served?.links);
    const blocks = await served?.readPage(link, this.abort.signal) ?? [];
    this.#learn(blocks, served?.links.filter((other) => !before.has(other)) ?? []);
    this.#planSoon();
  }

  /** @param {PartEntry[]} parts */
  async #loadParts(parts) {
    const places = parts.map((part) => {
      const own = /** @type {Resident} */ (this.residents.get(part.block));
      const number = own.block.parts.indexOf(part);
      own.loading[number] = true;
      return { own, number };
    });
    try {
      await this.served?.readParts(parts, (part, bytes) => {
        const own = /** @type {Resident} */ (this.residents.get(part.block));
        const number = own.block.parts.indexOf(part);
        if (!this.#roomToKeep(own, number)) return;
        if (number < own.wanted) this.missing--;
        // A copy: the answer of the server has other parts too, which may go.
        own.stored[number] = bytes.slice();
        this.kept += part.size;
        this.ready.add(own);
      }, this.abort.signal);
    } finally {
      for (const { own, number } of places) own.loading[number] = false;
    }
    await this.work();
  }

  /**
   * Whether a part that has arrived can be kept. What is no longer wanted goes for it.
   * @param {Resident} own
   * @param {number} number
   */
  #roomToKeep(own, number) {
    const most = this.budget * KEPT - own.block.parts[number].size;
    if (this.kept <= most) return true;
    if (own.wanted <= number) return false;
    for (const other of this.residents.values()) if (other.shown < other.stored.length && other !== own) this.#forget(other, Math.max(other.shown, other.wanted));
    if (this.kept <= most) return true;
    for (const { own: victim } of this.#victims(own)) {
      if (this.kept <= most || victim.wanted >= victim.shown) break;
      if (victim.wanted > 0) this.#shrink(victim, victim.wanted);
      else this.#hide(victim);
    }
    if (this.kept <= most) return true;
    this.trust = Math.max(this.trust * 0.95, 0.2);
    this.#planSoon();
    return false;
  }

  /** Makes images of the parts that are there, for a while at a time. */
  async work() {
    if (this.working) return;
    this.working = true;
    try {
      let start = this.now();
      while (this.ready.size && !this.failed) {
        // Parents before children, the nearest first.
        const all = [...this.ready].sort((a, b) => a.block.first - b.block.first || a.depth - b.depth);
        this.ready.clear();
        for (const own of all) {
          if (this.failed) break;
          this.#make(own);
          if (this.now() - start > SLICE) {
            await new Promise((resolve) => setTimeout(resolve));
            start = this.now();
          }
        }
      }
    } catch (error) {
      this.#stop(error);
    } finally {
      this.working = false;
    }
    this.#report();
  }

  /**
   * A block gets the image of the parts that are there. It waits where its parent has none that leads to it.
   * @param {Resident} own
   */
  #make(own) {
    const there = own.stored.findIndex((bytes) => !bytes);
    const count = there < 0 ? own.stored.length : there;
    if (count <= own.shown) return;
    const link = this.#linkTo(own);
    // Comes again once the parent's image has the descriptor that leads here.
    if (link === undefined) return;
    this.#show(own, count, link);
  }

  /**
   * The link of the parent's image to a block; `null` for a root block, `undefined` where there is none yet.
   * @param {Resident} own
   */
  #linkTo(own) {
    const { parent, index, position, scale } = own.block;
    if (parent === NO_PARENT) return null;
    const above = this.residents.get(parent);
    if (!above?.shown) return undefined;
    const leads = (/** @type {BlockLink} */ link) => (link.child === undefined ? link.scale === scale && position.every((x, axis) => x === link.position?.[axis]) : link.child === index);
    return above.links.find(leads);
  }

  /**
   * Lays a block out with so many of its parts, and puts it in the place of its former image.
   * @param {Resident} own
   * @param {number} count
   * @param {BlockLink | null} link
   */
  #show(own, count, link) {
    const image = this.#image(own, count, link);
    const pages = image.words.length / PAGE_WORDS;
    const page = this.#takePages(pages, own, own.block.parts[count - 1].first);
    if (page < 0) {
      // The estimates were too low. The next plan wants less.
      this.trust = Math.max(this.trust * 0.95, 0.2);
      this.#forget(own, own.shown);
      this.#planSoon();
      return;
    }
    this.#put(own, count, image, page, link);
  }

  /**
   * Lays a block out with fewer parts. Its room is free at once, as a batch is a single change.
   * @param {Resident} own
   * @param {number} count
   */
  #shrink(own, count) {
    const link = this.#linkTo(own);
    if (link === undefined || !this.pool) return;
    const image = this.#image(own, count, link);
    const left = new Set(image.links.map((other) => this.#childOf(own, other)));
    for (const child of own.children) if (!left.has(child)) this.#hide(child);
    this.pool.give(own.page, own.pages);
    this.#put(own, count, image, this.pool.take(image.words.length / PAGE_WORDS), link);
    this.#forget(own, count);
  }

  /**
   * @param {Resident} own
   * @param {number} count
   * @param {BlockLink | null} link
   */
  #image(own, count, link) {
    own.inner = link ? (link.low >> 8) & ~link.low & 255 : 0;
    return /** @type {Served} */ (this.served).image(own.block.index, /** @type {Uint8Array[]} */ (own.stored.slice(0, count)), link ? own.inner : undefined);
  }

  /**
   * The child that a link leads to, if it is known.
   * @param {Resident} own
   * @param {BlockLink} link
   */
  #childOf(own, link) {
    if (link.child === undefined) return own.children.find(({ block: { position, scale } }) => scale === link.scale && position.every((x, axis) => x === link.position?.[axis]));
    const child = this.residents.get(link.child);
    if (child && child.block.parent !== own.block.index) throw new EsvoError('C008', own.block.parts[0].fileAt, `block ${own.block.index}: a link leads to block ${link.child}, which is no child of it`);
    return child;
  }

  /**
   * Sends an image, with the links to the children that are shown, and leads its parent there.
   * @param {Resident} own
   * @param {number} count
   * @param {import('../reader/src/served.js').Image} image
   * @param {number} page
   * @param {BlockLink | null} link
   */
  #put(own, count, image, page, link) {
    const { block } = own;
    this.partsShown += count - own.shown;
    const shownBytes = block.parts.slice(0, count).reduce((sum, part) => sum + part.size, 0);
    Object.assign(own, { page, pages: image.words.length / PAGE_WORDS, shown: count, shownBytes, links: image.links });
    const base = page * 1024;
    for (const below of image.links) {
      const child = this.#childOf(own, below);
      if (child?.shown) {
        image.words[2 * below.slot] = below.low;
        image.words[2 * below.far] = child.page * 1024 + 2 - (base + below.slot);
      } else if (child?.stored[0]) {
        this.ready.add(child);
      }
    }
    const patches = [];
    if (link) {
      const above = /** @type {Resident} */ (this.residents.get(block.parent)).page * 1024;
      patches.push(2 * (above + link.far), (base + 2 - (above + link.slot)) >>> 0, 2 * (above + link.slot), link.low);
    } else {
      this.roots = [...this.roots];
      this.roots[block.object] = base + 2;
      this.sawRoot(block.object, coarseBoxes(image.words));
    }
    this.send({ writes: [{ at: page * PAGE_WORDS, words: image.words }], patches, roots: this.roots });
  }

  /**
   * Room for an image; what is worth less goes. The room of the block's former image is free at once: a batch is a single change. Without
   * room, that image stays.
   * @param {number} pages
   * @param {Resident} own
   * @param {number} level Of the part that needs it.
   */
  #takePages(pages, own, level) {
    const { pool, eye } = this;
    if (!pool) return -1;
    const take = () => {
      if (own.pages) pool.give(own.page, own.pages);
      const found = pool.take(pages);
      if (found < 0 && own.pages) pool.takeAt(own.page, own.pages);
      return found;
    };
    let page = take();
    if (page >= 0) return page;
    const pixels = eye && own.block.parent !== NO_PARENT ? own.place.pixels(own, level, eye.pixel) : Infinity;
    for (const { own: victim, pixels: worth } of this.#victims(own)) {
      // Nothing may take the room of the former image before this one is in its place.
      if (page >= 0) break;
      if (victim.wanted > 0 && victim.wanted < victim.shown) this.#shrink(victim, victim.wanted);
      else if (victim.wanted === 0 || worth * BETTER < pixels) this.#hide(victim);
      page = take();
    }
    if (page < 0 && pool.free + own.pages >= pages && this.#makeGap(pages)) page = take();
    return page;
  }

  /**
   * Moves images aside until so many pages are free in one piece, where the fewest must move.
   * @param {number} pages
   */
  #makeGap(pages) {
    const pool = /** @type {PageAllocator} */ (this.pool);
    if (pool.free < pages) return false;
    const occupied = new Uint8Array(pool.total).fill(1);
    for (const { start, count } of pool.ranges) occupied.fill(0, start, start + count);
    let [sum, first, least] = [0, -1, Infinity];
    for (let k = 0; k < pool.total; k++) {
      sum += occupied[k] - (k >= pages ? occupied[k - pages] : 0);
      if (k >= pages - 1 && sum < least) [least, first] = [sum, k - pages + 1];
    }
    if (first < 0) return false;
    const end = first + pages;
    /** @type {{ start: number, count: number }[]} Pieces of the gap that nothing may take. */
    const held = [];
    const hold = (/** @type {number} */ start, /** @type {number} */ count) => {
      const [from, to] = [Math.max(start, first), Math.min(start + count, end)];
      if (from >= to) return;
      pool.takeAt(from, to - from);
      held.push({ start: from, count: to - from });
    };
    for (const { start, count } of pool.ranges.slice()) hold(start, count);
    const inside = [...this.residents.values()].filter(({ page, pages: own }) => own > 0 && page < end && page + own > first).sort((a, b) => b.pages - a.pages);
    let done = true;
    for (const own of inside) {
      const link = this.#linkTo(own);
      const before = { page: own.page, pages: own.pages };
      const page = link === undefined ? -1 : pool.take(own.pages);
      done = page >= 0 && link !== undefined;
      if (page < 0 || link === undefined) break;
      this.#put(own, own.shown, this.#image(own, own.shown, link), page, link);
      pool.give(before.page, before.pages);
      hold(before.page, before.pages);
    }
    for (const { start, count } of held) pool.give(start, count);
    return done;
  }

  /**
   * Blocks that can go or shrink, the least needed first. A block comes after those below it.
   * @param {Resident} keep
   */
  #victims(keep) {
    const { eye } = this;
    const above = new Set();
    for (let at = /** @type {Resident | undefined} */ (keep); at; at = this.residents.get(at.block.parent)) above.add(at);
    const found = [];
    for (const own of this.residents.values()) {
      if (!own.shown || above.has(own) || own.block.parent === NO_PARENT) continue;
      found.push({ own, pixels: eye ? own.place.pixels(own, own.block.first, eye.pixel) : 0 });
    }
    const unwanted = (/** @type {Resident} */ { wanted, shown }) => (wanted === 0 ? 0 : wanted < shown ? 1 : 2);
    return found.sort((a, b) => unwanted(a.own) - unwanted(b.own) || a.pixels - b.pixels || b.own.block.first - a.own.block.first);
  }

  /**
   * Takes a block out of the picture and all below it: its parent shows its own voxels again.
   * @param {Resident} own
   */
  #hide(own) {
    if (!own.shown) return;
    for (const child of own.children) this.#hide(child);
    const link = this.#linkTo(own);
    const above = this.residents.get(own.block.parent);
    if (link && above) {
      const base = above.page * 1024;
      this.send({ writes: [], patches: [2 * (base + link.slot), link.leaf], roots: this.roots });
    }
    this.pool?.give(own.page, own.pages);
    this.partsShown -= own.shown;
    Object.assign(own, { page: -1, pages: 0, shown: 0, shownBytes: 0, links: [] });
    this.#forget(own, 0);
  }

  /**
   * Lets go of the parts of a block from a number on.
   * @param {Resident} own
   * @param {number} from
   */
  #forget(own, from) {
    for (let number = from; number < own.stored.length; number++) {
      if (!own.stored[number]) continue;
      this.kept -= own.block.parts[number].size;
      own.stored[number] = undefined;
    }
    if (own.stored.findIndex((bytes) => !bytes) <= own.shown && !own.stored[own.shown]) this.ready.delete(own);
  }

  #report() {
    const { pool, source } = this;
    if (!pool || (!this.settled && this.now() - this.reportedAt < REPORT_EVERY)) return;
    this.reportedAt = this.now();
    this.report({
      requests: source.count.requests, bytes: source.count.bytes, parts: this.partsShown, known: this.known, missing: Math.max(this.missing, 0),
      used: (pool.total - pool.free) * PAGE, kept: this.kept, limit: this.limit,
    });
  }
}
