// One view of one file: the device, the worker and the camera, without any control of the page.
import { axes, overview, planes } from './camera.js';
import { Renderer, loadTexts, openDevice } from './gpu.js';

/** @typedef {import('./camera.js').Camera} Camera */
/** @typedef {import('./gpu.js').Look} Look */
/** @typedef {import('./worker.js').FromWorker} FromWorker */
/** @typedef {import('./streamer.js').Stats} Stats */

/** @type {Look} */
export const LOOK = { mode: 'shaded', contours: true, beam: true, filter: true, maxVoxelPixels: 1, light: true, normals: true, colors: true, sun: undefined, shadows: false };

/** Bytes of changes that are made before one frame, and milliseconds between two looks of the worker at the camera. */
const BYTES_A_FRAME = 1 << 23;
const LOOK_EVERY = 60;
/** A moving picture should take no longer than this, in milliseconds; it is made coarser until it does. */
const FRAME_TIME = 28;
/** Milliseconds after the last movement until the picture is made fine. */
const REST = 160;

/**
 * @typedef {object} Events
 * @property {(about: Extract<FromWorker, { type: 'opened' }>) => void} [opened]
 * @property {(meta: Record<string, unknown>) => void} [meta]
 * @property {(camera: Camera) => void} [placed] The first camera of a file without one.
 * @property {(message: string) => void} [error]
 * @property {(message: string) => void} [lost] The device was lost.
 * @property {() => void} [frame] A frame was drawn.
 */

export class Viewer {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {Events} events
   */
  constructor(canvas, events) {
    this.canvas = canvas;
    this.events = events;
    /** @type {Look} */
    this.look = { ...LOOK };
    /** @type {Camera} */
    this.camera = { eye: [0.5, 0.5, 3], forward: [0, 0, -1], up: [0, 1, 0], fov: 60, near: 1e-3, far: 10 };
    this.hasCamera = false;
    /** Whether the camera is still the one that shows all of a file: it follows what becomes known. */
    this.auto = false;
    this.budget = 256e6;
    /** Pixels of the picture for a pixel of the canvas, along an axis: as set, and as it is while the camera moves. */
    this.resolution = 1;
    this.adaptive = 1;
    /** @type {Stats | undefined} */
    this.stats = undefined;
    this.settled = false;
    /** @type {{ octreeToMesh: number[], levels: number, leafVoxels: number }[]} */
    this.objects = [];
    /** @type {Map<number, { low: number[], high: number[] }[]>} */
    this.boxes = new Map();
    /** @type {import('./streamer.js').Batch[]} */
    this.batches = [];
    this.frameTime = 0;
    this.velocity = [0, 0, 0];
    this.movedAt = -Infinity;
    this.lookedAt = -Infinity;
    this.dirty = true;
    this.busy = false;
    this.frames = 0;
    /** Pixels of the last picture. */
    this.size = [0, 0];
  }

  /** Opens the device. */
  async start() {
    const [{ adapter, device }, texts] = await Promise.all([openDevice(), loadTexts()]);
    this.renderer = new Renderer(adapter, device, texts, this.canvas);
    if (this.renderer.software) this.adaptive = 0.3;
    device.lost.then(({ message, reason }) => {
      if (this.renderer?.device !== device || reason === 'destroyed' && this.closed) return;
      this.renderer = undefined;
      this.events.lost?.(message);
    });
    // Others follow from the first.
    device.addEventListener('uncapturederror', (event) => {
      console.error(event.error.message);
      this.events.error?.(`The graphics device reports: ${event.error.message.slice(0, 500)}`);
    }, { once: true });
    return this.renderer;
  }

  /**
   * Opens a file: by its address, or one that the user picked.
   * @param {{ address?: string, file?: Blob }} from
   */
  open(from) {
    const { renderer } = this;
    if (!renderer) return;
    this.closeFile();
    this.from = from;
    renderer.setPool(0);
    renderer.setObjects([]);
    const budget = Math.min(this.budget, (renderer.maxPool * 4) / 3);
    renderer.setPool(Math.ceil(budget * 0.75 / 8192) * 8192);
    const worker = new Worker(new URL('worker.js', import.meta.url), { type: 'module' });
    this.worker = worker;
    worker.onmessage = ({ data }) => this.worker === worker && this.#take(data);
    worker.onerror = (event) => this.events.error?.(`The page cannot run its worker: ${event.message || 'a file of the page is missing'}.`);
    worker.postMessage({ type: 'open', ...from, budget });
    this.openedAt = performance.now();
    this.firstPicture = undefined;
    this.redraw();
  }

  /** Forgets the file. */
  closeFile() {
    this.worker?.terminate();
    this.worker = undefined;
    this.batches = [];
    this.objects = [];
    this.boxes.clear();
    this.stats = undefined;
    this.settled = false;
    this.hasCamera ||= false;
  }

  /** @param {FromWorker} message */
  #take(message) {
    const { renderer, events } = this;
    if (message.type === 'opened') {
      this.objects = message.objects;
      renderer?.setObjects(message.objects);
      if (this.hasCamera) this.setCamera(this.camera);
      else this.#tellWorker(true);
      events.opened?.(message);
    } else if (message.type === 'root') {
      this.boxes.set(message.object, message.boxes);
      if ((!this.hasCamera || this.auto) && this.boxes.size === this.objects.length) this.showAll();
    } else if (message.type === 'batch') {
      this.batches.push(message.batch);
      this.redraw();
    } else if (message.type === 'stats') {
      this.stats = message.stats;
      if (message.settled && !this.settled) this.redraw();
      this.settled = message.settled;
      events.frame?.();
    } else if (message.type === 'meta') {
      events.meta?.(message.meta);
    } else {
      events.error?.(message.message);
    }
  }

  get transforms() {
    return this.objects.map(({ octreeToMesh }) => octreeToMesh);
  }

  /** All that is known of where the objects are, as boxes. */
  get allBoxes() {
    return [...this.boxes].flatMap(([object, boxes]) => boxes.map((box) => ({ object, ...box })));
  }

  /** A camera that sees all objects. */
  showAll() {
    if (!this.boxes.size) return;
    this.setCamera(overview(this.transforms, this.allBoxes, this.camera.up, this.camera.fov, this.canvas.width / Math.max(this.canvas.height, 1)));
    this.events.placed?.(this.camera);
    this.auto = true;
  }

  /**
   * Moves the camera; near and far plane follow.
   * @param {Partial<Camera>} change
   * @param {number[]} [velocity] In mesh units a second.
   */
  setCamera(change, velocity = [0, 0, 0]) {
    this.camera = { ...this.camera, ...change };
    if (this.objects.length) Object.assign(this.camera, planes(this.transforms, this.camera.eye));
    this.hasCamera = true;
    this.auto = false;
    this.velocity = velocity;
    this.movedAt = performance.now();
    this.redraw();
    this.#tellWorker(false);
  }

  /** @param {Partial<Look>} change */
  setLook(change) {
    this.look = { ...this.look, ...change };
    this.redraw();
    this.#tellWorker(true);
  }

  /** @param {boolean} now */
  #tellWorker(now) {
    const time = performance.now();
    clearTimeout(this.lookTimer);
    if (!now && time - this.lookedAt < LOOK_EVERY) {
      this.lookTimer = setTimeout(() => this.#tellWorker(true), LOOK_EVERY);
      return;
    }
    this.lookedAt = time;
    const { width, height } = this.canvas;
    const { right, up, forward } = axes(this.camera);
    const half = Math.tan((this.camera.fov * Math.PI) / 360);
    const shorter = Math.max(Math.min(width, height) * this.resolution, 1);
    const threshold = Math.max(this.look.maxVoxelPixels, 0.25);
    const moving = time - this.movedAt < REST;
    this.worker?.postMessage({
      type: 'look',
      eye: {
        eye: this.camera.eye, forward, right, up, tangent: [(half * width) / Math.min(width, height), (half * height) / Math.min(width, height)], pixel: (2 * half) / shorter,
        velocity: moving ? this.velocity : [0, 0, 0], threshold,
      },
    });
    if (moving && this.velocity.some((x) => x !== 0)) this.lookTimer = setTimeout(() => this.#tellWorker(true), REST + 20);
  }

  /** The size of the canvas or a setting changed. */
  resized() {
    this.redraw();
    this.#tellWorker(false);
  }

  redraw() {
    this.dirty = true;
    if (!this.busy) this.#schedule();
  }

  #schedule() {
    if (this.scheduled) return;
    this.scheduled = true;
    requestAnimationFrame(() => {
      this.scheduled = false;
      this.#frame();
    });
  }

  #frame() {
    const { renderer, canvas } = this;
    if (!renderer || this.busy || !this.dirty) return;
    this.dirty = false;
    let bytes = 0;
    while (this.batches.length && bytes < BYTES_A_FRAME) {
      const batch = /** @type {import('./streamer.js').Batch} */ (this.batches.shift());
      bytes += batch.writes.reduce((sum, { words }) => sum + words.byteLength, 0);
      renderer.apply(batch);
    }
    // While the camera moves, or parts come, no frame may take long; a still picture may.
    const moving = performance.now() - this.movedAt < REST || !this.settled || this.batches.length > 0;
    const most = Math.sqrt(renderer.maxPixels / Math.max(canvas.width * canvas.height, 1));
    const factor = Math.min(this.resolution * (moving ? this.adaptive : 1), most, 1);
    const [width, height] = [Math.max(1, Math.round(canvas.width * factor)), Math.max(1, Math.round(canvas.height * factor))];
    this.busy = true;
    this.size = [width, height];
    renderer.frame(this.camera, this.look, width, height).then((waited) => {
      this.busy = false;
      this.frames++;
      this.frameTime = renderer.gpuTime || waited;
      if (moving) this.adaptive = Math.min(1, Math.max(0.2, this.adaptive * Math.min(Math.max(Math.sqrt(FRAME_TIME / Math.max(waited, 1)), 0.6), 1.1)));
      if (renderer.drawn && this.firstPicture === undefined && this.openedAt !== undefined) this.firstPicture = performance.now() - this.openedAt;
      this.events.frame?.();
      if (factor < this.resolution && moving && this.settled) {
        clearTimeout(this.restTimer);
        this.restTimer = setTimeout(() => this.redraw(), REST);
      }
      if (this.dirty || this.batches.length) this.redraw();
    }, () => {
      this.busy = false;
    });
  }

  /** Whether the picture shows all that it should. */
  get atRest() {
    return this.settled && this.batches.length === 0 && !this.busy && !this.dirty && !this.scheduled;
  }

  /**
   * The pixels of the picture at a size.
   * @param {number} width
   * @param {number} height
   */
  async pixels(width, height) {
    const { renderer } = this;
    if (!renderer) throw new Error('there is no device');
    while (this.batches.length) renderer.apply(/** @type {import('./streamer.js').Batch} */ (this.batches.shift()));
    return renderer.pixels(this.camera, this.look, width, height);
  }

  /** Ends everything. */
  close() {
    this.closed = true;
    this.closeFile();
    this.renderer?.destroy();
  }
}
