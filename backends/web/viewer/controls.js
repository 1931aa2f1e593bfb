// Mouse, touch and keys move the camera: in an orbit around a point, or in free flight.
import { axes } from './camera.js';
import { add, cross, dot, length, scale, sub, turn, unit } from './vectors.js';

/** Radians for a drag over the shorter side of the picture. */
const TURN = 2.4;
/** Radians and shares of a step of the keyboard, a second. */
const KEY_TURN = 1.3;
/** How near the camera may look along the axis that is up, as the cosine. */
const POLE = 0.999;

export class Controls {
  /**
   * @param {import('./viewer.js').Viewer} viewer
   * @param {{ moved: () => void }} events
   */
  constructor(viewer, { moved }) {
    this.viewer = viewer;
    this.moved = moved;
    /** @type {'orbit' | 'fly'} */
    this.movement = 'orbit';
    this.target = [0, 0, 0];
    /** Radius of all objects in mesh units: what speed is measured in. */
    this.extent = 1;
    this.speed = 0.12;
    this.up = [0, 1, 0];
    /** @type {Map<number, { x: number, y: number }>} */
    this.pointers = new Map();
    /** @type {Set<string>} */
    this.keys = new Set();
    this.button = 0;
    const { canvas } = viewer;
    canvas.addEventListener('pointerdown', (event) => this.#down(event));
    canvas.addEventListener('pointermove', (event) => this.#move(event));
    for (const name of /** @type {const} */ (['pointerup', 'pointercancel', 'lostpointercapture'])) canvas.addEventListener(name, (event) => this.pointers.delete(event.pointerId));
    canvas.addEventListener('wheel', (event) => this.#wheel(event), { passive: false });
    canvas.addEventListener('contextmenu', (event) => event.preventDefault());
    canvas.addEventListener('dblclick', (event) => this.goTo(event.clientX, event.clientY));
    canvas.addEventListener('keydown', (event) => this.#key(event));
    canvas.addEventListener('keyup', (event) => this.keys.delete(event.key.toLowerCase()));
    canvas.addEventListener('blur', () => this.keys.clear());
  }

  get camera() {
    return this.viewer.camera;
  }

  get distance() {
    return Math.max(length(sub(this.target, this.camera.eye)), this.extent * 1e-6);
  }

  /** @param {'orbit' | 'fly'} movement */
  setMovement(movement) {
    // The point ahead, as far away as the last one was.
    if (movement === 'orbit' && this.movement === 'fly') {
      this.target = add(this.camera.eye, scale(unit(this.camera.forward), this.extent * 0.25));
      this.depth(0.5, 0.5).then((point) => {
        if (point && this.movement === 'orbit') this.target = point;
      });
    }
    this.movement = movement;
  }

  /**
   * The camera was placed by others.
   * @param {number[] | undefined} target
   * @param {number} extent
   */
  placed(target, extent) {
    this.extent = extent;
    this.target = target ?? add(this.camera.eye, scale(unit(this.camera.forward), extent));
  }

  /** @param {PointerEvent} event */
  #down(event) {
    this.viewer.canvas.focus({ preventScroll: true });
    this.viewer.canvas.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    this.button = event.button;
    if (event.pointerType === 'touch' && this.pointers.size === 1) {
      const now = performance.now();
      if (this.tap && now - this.tap.time < 320 && Math.hypot(event.clientX - this.tap.x, event.clientY - this.tap.y) < 30) this.goTo(event.clientX, event.clientY);
      this.tap = { time: now, x: event.clientX, y: event.clientY };
    }
  }

  /** @param {PointerEvent} event */
  #move(event) {
    const before = this.pointers.get(event.pointerId);
    if (!before) return;
    const { clientWidth, clientHeight } = this.viewer.canvas;
    const shorter = Math.min(clientWidth, clientHeight);
    const now = { x: event.clientX, y: event.clientY };
    const [dx, dy] = [(now.x - before.x) / shorter, (now.y - before.y) / shorter];
    if (this.pointers.size === 2) {
      const other = [...this.pointers].find(([id]) => id !== event.pointerId)?.[1];
      if (other) {
        const apart = (/** @type {{ x: number, y: number }} */ p) => Math.max(Math.hypot(p.x - other.x, p.y - other.y), 1);
        this.zoom(apart(before) / apart(now));
        this.shift(dx / 2, dy / 2);
      }
    } else if (this.button !== 0 || event.ctrlKey) {
      this.shift(dx, dy);
    } else {
      this.turn(dx * TURN, dy * TURN);
    }
    this.pointers.set(event.pointerId, now);
  }

  /** @param {WheelEvent} event */
  #wheel(event) {
    event.preventDefault();
    const lines = event.deltaMode === 1 ? event.deltaY * 20 : event.deltaY;
    this.zoom(Math.exp(Math.min(Math.max(lines, -240), 240) * 0.0016));
  }

  /** @param {KeyboardEvent} event */
  #key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const key = event.key.toLowerCase();
    if (!['w', 'a', 's', 'd', 'q', 'e', 'arrowleft', 'arrowright', 'arrowup', 'arrowdown', '+', '=', '-', 'shift', 'pageup', 'pagedown'].includes(key)) return;
    event.preventDefault();
    const first = !this.keys.size;
    this.keys.add(key);
    if (first) this.#run();
  }

  /** Moves as long as keys are down. */
  #run() {
    // A key that is only touched moves by a step, too.
    let before = performance.now() - 33;
    const step = (/** @type {number} */ time) => {
      if (!this.keys.size) {
        this.viewer.velocity = [0, 0, 0];
        return;
      }
      const seconds = Math.min(Math.max(time - before, 0) / 1000, 0.1);
      before = time;
      const down = (/** @type {string[]} */ ...keys) => (keys.some((key) => this.keys.has(key)) ? 1 : 0);
      const [turning, nodding] = [down('arrowleft') - down('arrowright'), down('arrowup') - down('arrowdown')];
      if (turning || nodding) this.turn(turning * KEY_TURN * seconds * (this.movement === 'orbit' ? -1 : 1), nodding * KEY_TURN * seconds * (this.movement === 'orbit' ? -1 : 1));
      const closer = down('+', '=') - down('-');
      if (closer && this.movement === 'orbit') this.zoom(Math.exp(-closer * 1.2 * seconds));
      else if (closer) this.speed = Math.min(Math.max(this.speed * Math.exp(closer * 1.5 * seconds), 1e-4), 3);
      const fast = down('shift') ? 4 : 1;
      const way = [down('d') - down('a'), down('e', 'pageup') - down('q', 'pagedown'), down('w') - down('s')];
      if (way.some((x) => x)) this.walk(way, this.extent * this.speed * fast, seconds);
      requestAnimationFrame(step);
    };
    step(performance.now());
  }

  /**
   * @param {number[]} way To the right, upwards, forwards.
   * @param {number} speed In mesh units a second.
   * @param {number} seconds
   */
  walk(way, speed, seconds) {
    const { right, forward } = axes(this.camera);
    const velocity = scale(unit(add(add(scale(right, way[0]), scale(this.up, way[1])), scale(forward, way[2]))), speed);
    const by = scale(velocity, seconds);
    this.target = add(this.target, by);
    this.viewer.setCamera({ eye: add(this.camera.eye, by) }, velocity);
    this.moved();
  }

  /**
   * Turns: positive numbers follow a drag to the right and downwards.
   * @param {number} around
   * @param {number} over
   */
  turn(around, over) {
    const orbit = this.movement === 'orbit';
    const { up } = this;
    const forward = unit(this.camera.forward);
    // In an orbit the object follows the pointer, in flight the picture does.
    const sign = orbit ? -1 : 1;
    let next = turn(forward, up, sign * around);
    const side = unit(cross(next, up));
    const tilted = turn(next, side, sign * over);
    if (Math.abs(dot(tilted, up)) < POLE || Math.abs(dot(tilted, up)) < Math.abs(dot(next, up))) next = tilted;
    next = unit(next);
    if (!orbit) {
      this.viewer.setCamera({ forward: next, up });
    } else {
      // The eye keeps its place beside the target, too: it need not be in the middle of the picture.
      const { right, up: top } = axes(this.camera);
      const off = sub(this.target, this.camera.eye);
      const parts = [dot(off, right), dot(off, top), dot(off, forward)];
      const now = axes({ ...this.camera, forward: next, up });
      const turned = add(add(scale(now.right, parts[0]), scale(now.up, parts[1])), scale(next, parts[2]));
      this.viewer.setCamera({ eye: sub(this.target, turned), forward: next, up });
    }
    this.moved();
  }

  /** @param {number} factor Of the distance; in flight, below 1 is forwards. */
  zoom(factor) {
    if (this.movement === 'orbit') {
      const off = scale(sub(this.camera.eye, this.target), factor);
      if (length(off) > this.extent * 40) return;
      this.viewer.setCamera({ eye: add(this.target, off) });
    } else {
      this.viewer.setCamera({ eye: add(this.camera.eye, scale(unit(this.camera.forward), -Math.log(factor) * this.extent * this.speed * 1.5)) });
    }
    this.moved();
  }

  /**
   * Shifts by shares of the shorter side of the picture.
   * @param {number} dx
   * @param {number} dy
   */
  shift(dx, dy) {
    const { right, up } = axes(this.camera);
    const reach = (this.movement === 'orbit' ? this.distance : this.extent * 0.4) * 2 * Math.tan((this.camera.fov * Math.PI) / 360);
    const by = add(scale(right, -dx * reach), scale(up, dy * reach));
    this.target = add(this.target, by);
    this.viewer.setCamera({ eye: add(this.camera.eye, by) });
    this.moved();
  }

  /**
   * The point of mesh space that is seen at a place of the canvas, from 0 to 1.
   * @param {number} x
   * @param {number} y
   */
  async depth(x, y) {
    const { renderer, size, camera } = this.viewer;
    const [width, height] = size;
    const t = await renderer?.depthAt(Math.floor(x * width), Math.floor(y * height), width);
    if (t === undefined) return undefined;
    const { right, up, forward } = axes(camera);
    const half = Math.tan((camera.fov * Math.PI) / 360);
    const shorter = Math.min(width, height);
    const [across, down] = [((2 * x - 1) * half * width) / shorter, ((2 * y - 1) * half * height) / shorter];
    return add(camera.eye, scale(add(add(forward, scale(right, across)), scale(up, -down)), t * camera.far));
  }

  /**
   * Goes halfway to what is seen at a point of the window, and turns around it from then on.
   * @param {number} clientX
   * @param {number} clientY
   */
  async goTo(clientX, clientY) {
    const { left, top, width, height } = this.viewer.canvas.getBoundingClientRect();
    const point = await this.depth((clientX - left) / width, (clientY - top) / height);
    if (!point) return;
    const start = this.camera.eye;
    const way = scale(sub(point, start), 0.6);
    const from = unit(this.camera.forward);
    const to = unit(sub(point, start));
    this.target = point;
    const still = matchMedia('(prefers-reduced-motion: reduce)').matches;
    const begun = performance.now();
    const step = () => {
      const share = still ? 1 : Math.min((performance.now() - begun) / 450, 1);
      const eased = share * share * (3 - 2 * share);
      const forward = unit(add(scale(from, 1 - eased), scale(to, eased)));
      if (Math.abs(dot(forward, this.up)) < POLE) this.viewer.setCamera({ eye: add(start, scale(way, eased)), forward }, share < 1 ? scale(way, 2) : [0, 0, 0]);
      if (share < 1 && !this.pointers.size) requestAnimationFrame(step);
      else this.moved();
    };
    step();
  }
}
