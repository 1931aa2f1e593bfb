// How much a part is needed: how large the voxels are that it splits, as the camera sees them.

/**
 * What the streaming needs to know of a camera, in mesh space.
 * @typedef {object} Eye
 * @property {number[]} eye
 * @property {number[]} forward Of unit length, as the two below.
 * @property {number[]} right
 * @property {number[]} up
 * @property {number[]} tangent Slopes of the view's sides, to the right and upwards.
 * @property {number} pixel Slope of a pixel.
 * @property {number[]} velocity In mesh units a second.
 * @property {number} threshold Voxels of this many pixels need not be split.
 */

/** Seconds that the eye is followed ahead, and what a part outside of the view counts, against one inside. */
const AHEAD = 0.7;
const OUTSIDE = 0.15;
/** Nearer than this many edges of its voxels, a part counts no more. */
const NEAREST = 0.25;

/** A cube of an object as a sphere in mesh space. */
export class Place {
  /**
   * @param {number[]} m Octree space to mesh space.
   * @param {number[]} position Of the cube, in units of 2^-23.
   * @param {number} scale
   */
  constructor(m, position, scale) {
    const edge = 2 ** (scale - 23);
    const centre = position.map((x) => x * 2 ** -23 + edge / 2);
    this.m = m;
    this.low = position.map((x) => x * 2 ** -23);
    this.edge = edge;
    /** The centre in mesh space. */
    this.centre = [0, 1, 2].map((r) => m[r] * centre[0] + m[4 + r] * centre[1] + m[8 + r] * centre[2] + m[12 + r]);
    const column = (/** @type {number} */ c) => Math.hypot(m[4 * c], m[4 * c + 1], m[4 * c + 2]);
    /** The longest edge of the root cube in mesh units. */
    this.unit = Math.max(column(0), column(1), column(2));
    this.radius = (this.unit * edge * Math.sqrt(3)) / 2;
  }

  /**
   * Distance from a point of mesh space to the cube; for a cube that is turned or sheared, to the sphere around it.
   * @param {number[]} p
   */
  distance(p) {
    const { m, low, edge } = this;
    if (m[1] === 0 && m[2] === 0 && m[4] === 0 && m[6] === 0 && m[8] === 0 && m[9] === 0) {
      let sum = 0;
      for (let k = 0; k < 3; k++) {
        const [a, b] = [m[5 * k] * low[k] + m[12 + k], m[5 * k] * (low[k] + edge) + m[12 + k]];
        const out = Math.max(Math.min(a, b) - p[k], p[k] - Math.max(a, b), 0);
        sum += out * out;
      }
      return Math.sqrt(sum);
    }
    return Math.max(Math.hypot(...this.centre.map((x, k) => x - p[k])) - this.radius, 0);
  }

  /**
   * Whether the sphere around the cube meets the view.
   * @param {Eye} eye
   */
  inView(eye) {
    const to = this.centre.map((x, k) => x - eye.eye[k]);
    const along = (/** @type {number[]} */ v) => to[0] * v[0] + to[1] * v[1] + to[2] * v[2];
    const ahead = along(eye.forward);
    const inside = (/** @type {number} */ aside, /** @type {number} */ tangent) => (Math.abs(aside) - ahead * tangent) / Math.hypot(1, tangent) <= this.radius;
    return ahead >= -this.radius && inside(along(eye.right), eye.tangent[0]) && inside(along(eye.up), eye.tangent[1]);
  }

  /**
   * Pixels of the voxels of level 0 here, were the octree as coarse: a part from level `L` on is worth `2^-L` times as much. It never grows
   * from a cube to one inside it.
   * @param {Eye} eye
   */
  worth(eye) {
    const { velocity } = eye;
    const later = velocity.some((x) => x !== 0) ? eye.eye.map((x, k) => x + velocity[k] * AHEAD) : eye.eye;
    const depth = later === eye.eye ? this.#depth(eye, eye.eye) : Math.min(this.#depth(eye, eye.eye), this.#depth(eye, later));
    const sight = this.inView(eye) || (later !== eye.eye && this.inView({ ...eye, eye: later })) ? 1 : OUTSIDE;
    return { depth, sight };
  }

  /**
   * No point of the cube that can be seen has a smaller depth: what voxels look like depends on it, not on the distance.
   * @param {Eye} eye
   * @param {number[]} from
   */
  #depth({ forward, tangent }, from) {
    const ahead = this.centre.reduce((sum, x, k) => sum + (x - from[k]) * forward[k], 0);
    return Math.max(this.distance(from) / Math.hypot(1, ...tangent), ahead - this.radius);
  }

  /**
   * Pixels of a voxel of a level at this worth.
   * @param {{ depth: number, sight: number }} worth
   * @param {number} level
   * @param {number} pixel
   */
  pixels({ depth, sight }, level, pixel) {
    const edge = this.unit * 2 ** -level;
    return (sight * edge) / (Math.max(depth, NEAREST * edge) * pixel);
  }
}
