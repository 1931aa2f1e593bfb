// FLIP of two pictures (Andersson and others, HPG 2020), as `esvo_bench::error::image` has it: for records, not for the page.

/** Pixels for each degree of the field of view. */
const PIXELS_PER_DEGREE = 67.0206;

/** @param {number} c */
const linear = (c) => (c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4);
const WHITE = [0.950428545, 1, 1.088900371];
/** @type {(rgb: number[]) => number[]} */
const toXyz = ([r, g, b]) => [
  (10135552 / 24577794) * r + (8788810 / 24577794) * g + (4435075 / 24577794) * b,
  (2613072 / 12288897) * r + (8788810 / 12288897) * g + (887015 / 12288897) * b,
  (1425312 / 73733382) * r + (8788810 / 73733382) * g + (70074185 / 73733382) * b,
];
/** @type {(xyz: number[]) => number[]} */
const toYcc = (xyz) => {
  const [x, y, z] = xyz.map((v, k) => v / WHITE[k]);
  return [116 * y - 16, 500 * (x - y), 200 * (y - z)];
};
/** @type {(ycc: number[]) => number[]} */
const fromYcc = ([l, c1, c2]) => {
  const y = (l + 16) / 116;
  const [X, Y, Z] = [y + c1 / 500, y, y - c2 / 200].map((v, k) => v * WHITE[k]);
  return [3.241003275 * X - 1.537398934 * Y - 0.498615861 * Z, -0.969224334 * X + 1.875930071 * Y + 0.041554224 * Z, 0.055639423 * X - 0.204011202 * Y + 1.057148933 * Z].map((v) => Math.min(Math.max(v, 0), 1));
};
/** @type {(rgb: number[]) => number[]} */
const toLab = (rgb) => {
  const d = 6 / 29;
  const [x, y, z] = toXyz(rgb).map((v, k) => v / WHITE[k]).map((t) => (t > d ** 3 ? Math.cbrt(t) : t / (3 * d * d) + 4 / 29));
  const l = 116 * y - 16;
  return [l, 0.01 * l * 500 * (x - y), 0.01 * l * 200 * (y - z)];
};
/** @type {(a: number[], b: number[]) => number} */
const hyab = (a, b) => Math.abs(a[0] - b[0]) + Math.hypot(a[1] - b[1], a[2] - b[2]);

/**
 * @param {Float64Array[]} planes
 * @param {number} width
 * @param {number} height
 * @param {(channel: number) => number[][]} kernels Sums of separable kernels for a channel: one-dimensional, already normalised as products.
 */
function filtered(planes, width, height, kernels) {
  return planes.map((plane, channel) => {
    const out = new Float64Array(width * height);
    for (const kernel of kernels(channel)) {
      const radius = (kernel.length - 1) / 2;
      const middle = new Float64Array(width * height);
      for (let y = 0; y < height; y++) {
        for (let x = 0; x < width; x++) {
          let sum = 0;
          for (let k = -radius; k <= radius; k++) sum += kernel[k + radius] * plane[y * width + Math.min(Math.max(x + k, 0), width - 1)];
          middle[y * width + x] = sum;
        }
      }
      for (let y = 0; y < height; y++) {
        for (let x = 0; x < width; x++) {
          let sum = 0;
          for (let k = -radius; k <= radius; k++) sum += kernel[k + radius] * middle[Math.min(Math.max(y + k, 0), height - 1) * width + x];
          out[y * width + x] += sum;
        }
      }
    }
    return out;
  });
}

const CSF = [[1, 0.0047, 0, 1e-5], [1, 0.0053, 0, 1e-5], [34.1, 0.04, 13.5, 0.025]];

/** Kernels of the contrast sensitivity of a channel: Gaussians whose sum has weight 1. */
function sensitivity(/** @type {number} */ channel) {
  const radius = Math.ceil(3 * Math.sqrt(0.04 / (2 * Math.PI ** 2)) * PIXELS_PER_DEGREE);
  const [a1, b1, a2, b2] = CSF[channel];
  const one = (/** @type {number} */ a, /** @type {number} */ b) => Array.from({ length: 2 * radius + 1 }, (_, k) => Math.sqrt(a * (Math.PI / b)) * Math.exp((-(Math.PI ** 2) / b) * ((k - radius) / PIXELS_PER_DEGREE) ** 2));
  const found = [one(a1, b1), ...(a2 ? [one(a2, b2)] : [])];
  const sum = found.reduce((all, kernel) => all + kernel.reduce((s, x) => s + x, 0) ** 2, 0);
  return found.map((kernel) => kernel.map((x) => x / Math.sqrt(sum)));
}

/** Edges and points of a plane of luminance: how strong they are. */
function features(/** @type {Float64Array} */ plane, /** @type {number} */ width, /** @type {number} */ height) {
  const sigma = 0.5 * 0.082 * PIXELS_PER_DEGREE;
  const radius = Math.ceil(3 * sigma);
  const at = Array.from({ length: 2 * radius + 1 }, (_, k) => k - radius);
  const g = at.map((x) => Math.exp(-(x * x) / (2 * sigma * sigma)));
  const total = g.reduce((s, x) => s + x, 0);
  const smooth = g.map((x) => x / total);
  const edge = at.map((x, k) => -x * g[k]);
  const point = at.map((x, k) => ((x * x) / (sigma * sigma) - 1) * g[k]);
  const balanced = (/** @type {number[]} */ kernel) => {
    const [plus, minus] = [1, -1].map((sign) => kernel.reduce((s, x) => s + Math.max(sign * x, 0), 0));
    return kernel.map((x) => (x > 0 ? x / plus : x / minus));
  };
  const apply = (/** @type {number[]} */ across, /** @type {number[]} */ down) => {
    const [middle, out] = [new Float64Array(plane.length), new Float64Array(plane.length)];
    for (let y = 0; y < height; y++) for (let x = 0; x < width; x++) {
      let sum = 0;
      for (let k = -radius; k <= radius; k++) sum += across[k + radius] * plane[y * width + Math.min(Math.max(x + k, 0), width - 1)];
      middle[y * width + x] = sum;
    }
    for (let y = 0; y < height; y++) for (let x = 0; x < width; x++) {
      let sum = 0;
      for (let k = -radius; k <= radius; k++) sum += down[k + radius] * middle[Math.min(Math.max(y + k, 0), height - 1) * width + x];
      out[y * width + x] = sum;
    }
    return out;
  };
  const length = (/** @type {number[]} */ kernel) => {
    const [a, b] = [apply(balanced(kernel), smooth), apply(smooth, balanced(kernel))];
    return a.map((x, k) => Math.hypot(x, b[k]));
  };
  return [length(edge), length(point)];
}

/**
 * The mean of FLIP: 0 for equal pictures, 1 for black beside white.
 * @param {ArrayLike<number>} a Red, green, blue, alpha.
 * @param {ArrayLike<number>} b
 * @param {number} width
 * @param {number} height
 */
export function flip(a, b, width, height) {
  const planes = (/** @type {ArrayLike<number>} */ picture) => {
    const found = [0, 1, 2].map(() => new Float64Array(width * height));
    for (let k = 0; k < width * height; k++) {
      toYcc(toXyz([0, 1, 2].map((c) => linear(picture[4 * k + c] / 255)))).forEach((x, c) => (found[c][k] = x));
    }
    return found;
  };
  const [pa, pb] = [planes(a), planes(b)];
  const [fa, fb] = [pa, pb].map((own) => filtered(own, width, height, sensitivity));
  const [ea, eb] = [pa, pb].map((own) => features(own[0].map((x) => (x + 16) / 116), width, height));
  const most = hyab(toLab([0, 1, 0]), toLab([0, 0, 1])) ** 0.7;
  let sum = 0;
  for (let k = 0; k < width * height; k++) {
    const [la, lb] = [fa, fb].map((own) => toLab(fromYcc([own[0][k], own[1][k], own[2][k]])));
    const power = hyab(la, lb) ** 0.7;
    const color = power < 0.4 * most ? (power / (0.4 * most)) * 0.95 : 0.95 + ((power - 0.4 * most) / (0.6 * most)) * 0.05;
    const feature = Math.max(Math.abs(ea[0][k] - eb[0][k]), Math.abs(ea[1][k] - eb[1][k]));
    sum += color ** (1 - Math.min(feature / Math.SQRT2, 1) ** 0.5);
  }
  return sum / (width * height);
}
