// The device: a pool with the octree, and the passes of a frame.
import { VIEW_BYTES, axes, footprints, makeView, writeView } from './camera.js';
import { WORKGROUP, ofCoarsePass, prelude } from './kernel.js';
import { add, inverse, scale, unit } from './vectors.js';

/** @typedef {import('./camera.js').Camera} Camera */
/** @typedef {import('./streamer.js').Batch} Batch */

/**
 * How a picture looks.
 * @typedef {object} Look
 * @property {'shaded' | 'iterations' | 'normals' | 'levels' | 'voxel-size' | 'depth' | 'ambient'} mode
 * @property {boolean} contours
 * @property {boolean} beam
 * @property {boolean} filter
 * @property {number} maxVoxelPixels
 * @property {boolean} light
 * @property {boolean} normals
 * @property {boolean} colors
 * @property {number[] | undefined} sun Direction to the sun in mesh space; none: a lamp at the camera.
 * @property {boolean} shadows
 */

/**
 * An object as frames need it.
 * @typedef {object} Placed
 * @property {number[]} octreeToMesh
 * @property {number} levels
 */

const MODES = ['shaded', 'iterations', 'normals', 'levels', 'voxel-size', 'depth', 'ambient'];
const OBJECT_BYTES = 176;
const NODE_BYTES = 128;
const SHADING_BYTES = 64;
const FILTER_BYTES = 32 + 96 * 16 + 64 * 16;
const NO_ROOT = 0xffffffff;

/** Why there is no device, in a sentence that helps. */
export class GpuError extends Error {}

/**
 * @typedef {object} Texts The kernels and the table of the filter.
 * @property {string} cast
 * @property {string} instances
 * @property {string} filter
 * @property {string} shade
 * @property {string} present
 * @property {{ samples: number[][], radii: number[] }} table
 */

/** @returns {Promise<Texts>} */
export async function loadTexts() {
  const read = async (/** @type {string} */ name) => {
    const answer = await fetch(new URL(name, import.meta.url));
    if (!answer.ok) throw new GpuError(`the page is not whole: ${name} is missing (the server answered ${answer.status}). Export it anew with \`esvo view --export\``);
    return answer.text();
  };
  const names = ['../kernels/cast.wgsl', '../kernels/instances.wgsl', '../kernels/filter.wgsl', 'shade.wgsl', 'present.wgsl', 'filter.json'];
  const [cast, instances, filter, shade, present, table] = await Promise.all(names.map(read));
  return { cast, instances, filter, shade, present, table: JSON.parse(table) };
}

/** Opens the fastest device. */
export async function openDevice() {
  if (!navigator.gpu) {
    throw new GpuError(isSecureContext
      ? 'This browser has no WebGPU. Chrome and Edge have it from version 113 on, Safari from 26, Firefox from 141 (Windows) and 145 (macOS); on Linux it may have to be enabled.'
      : 'WebGPU needs a secure page: open this page by https, or from this machine by http://localhost or http://127.0.0.1.');
  }
  const adapter = await navigator.gpu.requestAdapter({ powerPreference: 'high-performance' });
  if (!adapter) throw new GpuError('WebGPU finds no graphics device here. Is hardware acceleration switched on in the settings of the browser, and the driver up to date?');
  const { limits } = adapter;
  const device = await adapter.requestDevice({
    requiredFeatures: adapter.features.has('timestamp-query') ? ['timestamp-query'] : [],
    requiredLimits: {
      maxStorageBufferBindingSize: limits.maxStorageBufferBindingSize, maxBufferSize: limits.maxBufferSize,
      maxStorageBuffersPerShaderStage: Math.min(limits.maxStorageBuffersPerShaderStage, 16),
    },
  });
  return { adapter, device };
}

/** Storage buffers of a pass that are not the octree. */
const OTHER_BUFFERS = 3;

export class Renderer {
  /**
   * @param {GPUAdapter} adapter
   * @param {GPUDevice} device
   * @param {Texts} texts
   * @param {HTMLCanvasElement} canvas
   */
  constructor(adapter, device, texts, canvas) {
    this.device = device;
    this.texts = texts;
    this.canvas = canvas;
    const { info } = adapter;
    this.software = Boolean(info?.isFallbackAdapter) || /swiftshader|llvmpipe|software|basic render/i.test(`${info?.vendor} ${info?.architecture} ${info?.device} ${info?.description}`);
    this.name = info?.description || info?.device || [info?.vendor, info?.architecture].filter(Boolean).join(' ') || 'unknown device';
    this.context = /** @type {GPUCanvasContext} */ (canvas.getContext('webgpu'));
    this.format = navigator.gpu.getPreferredCanvasFormat();
    this.context.configure({ device, format: this.format, alphaMode: 'opaque' });
    /** @type {Placed[]} */
    this.objects = [];
    /** @type {number[]} */
    this.roots = [];
    /** @type {(GPUBuffer | undefined)[]} */
    this.parts = [];
    this.partShift = 24;
    /** @type {Map<string, GPUComputePipeline>} */
    this.pipelines = new Map();
    this.poolBytes = 0;
    this.layouts = this.#makeLayouts();
    this.uniforms = {
      view: device.createBuffer({ label: 'view', size: VIEW_BYTES, usage: GPUBufferUsage.UNIFORM | GPUBufferUsage.COPY_DST }),
      shading: device.createBuffer({ label: 'shading', size: SHADING_BYTES, usage: GPUBufferUsage.UNIFORM | GPUBufferUsage.COPY_DST }),
      filter: device.createBuffer({ label: 'filter', size: FILTER_BYTES, usage: GPUBufferUsage.UNIFORM | GPUBufferUsage.COPY_DST }),
      sizes: device.createBuffer({ label: 'sizes', size: 16, usage: GPUBufferUsage.UNIFORM | GPUBufferUsage.COPY_DST }),
    };
    this.empty = device.createBuffer({ label: 'empty', size: 16, usage: GPUBufferUsage.STORAGE });
    /** @type {Record<string, GPUBuffer>} Grown as pictures need. */
    this.buffers = {};
    this.#makePresent();
    this.clock = device.features.has('timestamp-query') ? this.#makeClock() : undefined;
    /** Whether the last frame cast rays, and words of its hits. */
    this.drawn = false;
    this.stride = 4;
    this.levels = 23;
    /** @type {GPUBindGroup | undefined} */
    this.octreeGroup = undefined;
    /** Milliseconds that the device took for the last frame that was measured. */
    this.gpuTime = 0;
    this.setPool(0);
  }

  #makeClock() {
    return {
      queries: this.device.createQuerySet({ type: 'timestamp', count: 2 }),
      resolve: this.device.createBuffer({ size: 16, usage: GPUBufferUsage.QUERY_RESOLVE | GPUBufferUsage.COPY_SRC }),
      read: this.device.createBuffer({ size: 16, usage: GPUBufferUsage.MAP_READ | GPUBufferUsage.COPY_DST }),
      busy: false,
    };
  }

  #makeLayouts() {
    const buffer = (/** @type {number} */ binding, /** @type {GPUBufferBindingType} */ type) => ({ binding, visibility: GPUShaderStage.COMPUTE, buffer: { type } });
    const layout = (/** @type {GPUBindGroupLayoutEntry[]} */ entries) => this.device.createBindGroupLayout({ entries });
    return {
      view: layout([buffer(0, 'uniform')]),
      coarse: layout([buffer(0, 'uniform'), buffer(1, 'storage')]),
      main: layout([buffer(0, 'uniform'), buffer(1, 'read-only-storage'), buffer(2, 'storage')]),
      shade: layout([buffer(0, 'uniform'), buffer(1, 'read-only-storage'), buffer(2, 'read-only-storage'), buffer(3, 'storage')]),
      filter: layout([buffer(0, 'uniform'), buffer(1, 'read-only-storage'), buffer(2, 'storage')]),
    };
  }

  #makePresent() {
    const { device, texts, format } = this;
    const module = device.createShaderModule({ label: 'present.wgsl', code: texts.present });
    this.present = device.createRenderPipeline({
      layout: 'auto', vertex: { module, entryPoint: 'corner' }, fragment: { module, entryPoint: 'present', targets: [{ format }] },
    });
    const filter = device.createShaderModule({ label: 'filter.wgsl', code: texts.filter });
    this.filterPipeline = device.createComputePipeline({
      layout: device.createPipelineLayout({ bindGroupLayouts: [this.layouts.filter] }), compute: { module: filter, entryPoint: 'filter_band' },
    });
  }

  /** Most bytes that the pool can have here. */
  get maxPool() {
    const { maxStorageBufferBindingSize: binding, maxBufferSize, maxStorageBuffersPerShaderStage: buffers } = this.device.limits;
    return (buffers - OTHER_BUFFERS) * 2 ** Math.floor(Math.log2(Math.min(binding, maxBufferSize)));
  }

  /**
   * Throws the octree away and makes room for another one. Memory is taken when something is written there.
   * @param {number} bytes
   */
  setPool(bytes) {
    for (const part of this.parts) part?.destroy();
    const { maxStorageBufferBindingSize: binding, maxBufferSize } = this.device.limits;
    const most = Math.floor(Math.log2(Math.min(binding, maxBufferSize) / 8));
    // Pieces of 64 MiB, larger ones where they would be too many.
    this.partShift = Math.min(23, most);
    while (this.partShift < most && bytes / 8 > (this.device.limits.maxStorageBuffersPerShaderStage - OTHER_BUFFERS) * 2 ** this.partShift) this.partShift++;
    const poolBytes = Math.min(bytes, this.maxPool);
    this.poolBytes = poolBytes;
    this.parts = Array.from({ length: Math.max(1, Math.ceil(poolBytes / 8 / 2 ** this.partShift)) }, () => undefined);
    this.octreeLayout = this.device.createBindGroupLayout({
      entries: this.parts.map((_, binding) => ({ binding, visibility: GPUShaderStage.COMPUTE, buffer: { type: 'read-only-storage' } })),
    });
    this.octreeGroup = undefined;
    this.pipelines.clear();
    this.roots = [];
  }

  /** @param {Placed[]} objects */
  setObjects(objects) {
    this.objects = objects;
    this.roots = objects.map(() => NO_ROOT);
    this.levels = Math.max(1, ...objects.map(({ levels }) => levels));
  }

  /**
   * Makes a change of the pool: all of it, before the next frame.
   * @param {Batch} batch
   */
  apply({ writes, patches, roots }) {
    const shift = this.partShift + 1;
    const size = 2 ** shift;
    const part = (/** @type {number} */ number) => {
      let buffer = this.parts[number];
      if (!buffer) {
        const bytes = Math.min(size * 4, this.poolBytes - number * size * 4);
        buffer = this.device.createBuffer({ label: `pool ${number}`, size: Math.max(bytes, 16), usage: GPUBufferUsage.STORAGE | GPUBufferUsage.COPY_DST });
        this.parts[number] = buffer;
        this.octreeGroup = undefined;
      }
      return buffer;
    };
    for (const { at, words } of writes) {
      for (let done = 0; done < words.length; ) {
        const [number, within] = [Math.floor((at + done) / size), (at + done) % size];
        const count = Math.min(words.length - done, size - within);
        this.device.queue.writeBuffer(part(number), within * 4, /** @type {Uint32Array<ArrayBuffer>} */ (words), done, count);
        done += count;
      }
    }
    for (let k = 0; k < patches.length; k += 2) {
      this.device.queue.writeBuffer(part(Math.floor(patches[k] / size)), (patches[k] % size) * 4, Uint32Array.of(patches[k + 1]));
    }
    this.roots = roots;
  }

  /** Bytes that the pool has taken on the device. */
  get poolTaken() {
    return this.parts.reduce((sum, part) => sum + (part?.size ?? 0), 0);
  }

  #octree() {
    const group = this.octreeGroup ?? this.device.createBindGroup({
      layout: /** @type {GPUBindGroupLayout} */ (this.octreeLayout),
      entries: this.parts.map((part, binding) => ({ binding, resource: { buffer: part ?? this.empty } })),
    });
    this.octreeGroup = group;
    return group;
  }

  /**
   * @param {string} name
   * @param {number} size
   * @param {number} usage
   */
  #buffer(name, size, usage) {
    let buffer = this.buffers[name];
    if (!buffer || buffer.size < size) {
      buffer?.destroy();
      buffer = this.device.createBuffer({ label: name, size: Math.max(size, 16), usage });
      this.buffers[name] = buffer;
    }
    return buffer;
  }

  /**
   * @param {'coarse_pass' | 'main_pass' | 'instances_pass' | 'shade_pass'} entry
   * @param {import('./kernel.js').Variant} variant
   */
  #pipeline(entry, variant) {
    const head = prelude(entry === 'coarse_pass' ? ofCoarsePass(variant) : variant);
    const key = entry + head;
    let pipeline = this.pipelines.get(key);
    if (!pipeline) {
      const { texts, layouts } = this;
      const tail = entry === 'instances_pass' ? texts.instances : entry === 'shade_pass' ? texts.shade : '';
      const module = this.device.createShaderModule({ label: entry, code: head + texts.cast + tail });
      const frame = entry === 'coarse_pass' ? layouts.coarse : entry === 'shade_pass' ? layouts.view : layouts.main;
      const groups = [frame, /** @type {GPUBindGroupLayout} */ (this.octreeLayout), ...(entry === 'shade_pass' ? [layouts.shade] : [])];
      pipeline = this.device.createComputePipeline({ label: entry, layout: this.device.createPipelineLayout({ bindGroupLayouts: groups }), compute: { module, entryPoint: entry } });
      this.pipelines.set(key, pipeline);
    }
    return pipeline;
  }

  /**
   * Most pixels of a picture on this device.
   */
  get maxPixels() {
    const { maxStorageBufferBindingSize, maxBufferSize } = this.device.limits;
    return Math.floor(Math.min(maxStorageBufferBindingSize, maxBufferSize) / 20);
  }

  /**
   * Casts and shades a picture, into the buffer that it returns.
   * @param {GPUCommandEncoder} commands
   * @param {Camera} camera
   * @param {Look} look
   * @param {number} width
   * @param {number} height
   */
  #draw(commands, camera, look, width, height) {
    const { device, objects, roots } = this;
    const shadows = look.shadows && look.sun !== undefined && look.mode === 'shaded' && look.light;
    const views = objects.map((object, k) => makeView(camera, object.octreeToMesh, roots[k], width, height, look));
    const several = objects.length > 1;
    const view = views[0] ?? makeView(camera, [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1], NO_ROOT, width, height, look);
    const nodes = several ? footprints(views) : [];
    const nothing = several ? nodes.length === 0 : view.root === NO_ROOT;
    const beam = !several && (view.flags & 2) !== 0;
    const uniform = new ArrayBuffer(VIEW_BYTES);
    writeView(several ? { ...view, root: nodes.length, flags: view.flags & 1 } : view, new DataView(uniform), 0);
    device.queue.writeBuffer(this.uniforms.view, 0, uniform);
    this.#writeShading(camera, look, views, nothing ? 0 : several ? 5 : 4, width, height, shadows);

    const count = width * height;
    const storage = GPUBufferUsage.STORAGE;
    const hits = this.#buffer('hits', count * (several ? 20 : 16), storage | GPUBufferUsage.COPY_SRC);
    const pixels = this.#buffer('pixels', count * 4, storage | GPUBufferUsage.COPY_SRC);
    /** @type {import('./kernel.js').Variant} */
    const variant = {
      contours: look.contours, farPointers: true, lod: look.maxVoxelPixels > 0, beam, levels: this.levels, beamBlock: 4, parts: this.parts.length,
      partShift: this.partShift, roundQuotients: !this.software,
    };
    const group = (/** @type {GPUBindGroupLayout} */ layout, /** @type {GPUBuffer[]} */ ...buffers) =>
      device.createBindGroup({ layout, entries: buffers.map((buffer, binding) => ({ binding, resource: { buffer } })) });
    const groups = (/** @type {number} */ size) => Math.ceil(size / WORKGROUP);
    this.drawn = !nothing;
    this.stride = several ? 5 : 4;
    if (!nothing) {
      const pass = commands.beginComputePass({ label: 'cast', ...this.#stamp('beginningOfPassWriteIndex', 0) });
      pass.setBindGroup(1, this.#octree());
      const blocks = [Math.ceil(width / 4) + 3, Math.ceil(height / 4) + 3];
      const coarse = beam ? this.#buffer('coarse', blocks[0] * blocks[1] * 4, storage) : this.#buffer('no coarse', 16, storage);
      if (beam) {
        pass.setPipeline(this.#pipeline('coarse_pass', variant));
        pass.setBindGroup(0, group(this.layouts.coarse, this.uniforms.view, coarse));
        pass.dispatchWorkgroups(groups(blocks[0]), groups(blocks[1]));
      }
      const between = several ? this.#writeNodes(nodes) : coarse;
      pass.setPipeline(this.#pipeline(several ? 'instances_pass' : 'main_pass', { ...variant, beam }));
      pass.setBindGroup(0, group(this.layouts.main, this.uniforms.view, between, hits));
      pass.dispatchWorkgroups(groups(width), groups(height));
      pass.end();
    }
    const filtered = look.filter && look.mode === 'shaded';
    const pass = commands.beginComputePass({ label: 'shade', ...this.#stamp('endOfPassWriteIndex', 1) });
    // Shadow rays end at leaves and at voxels of the picture's own level alike: they are cast down to what is there.
    pass.setPipeline(this.#pipeline('shade_pass', { ...variant, beam: false, lod: false }));
    pass.setBindGroup(0, group(this.layouts.view, this.uniforms.view));
    pass.setBindGroup(1, this.#octree());
    pass.setBindGroup(2, group(this.layouts.shade, this.uniforms.shading, this.buffers.objects, hits, pixels));
    pass.dispatchWorkgroups(groups(width), groups(height));
    if (filtered) {
      const target = this.#buffer('filtered', count * 4, storage | GPUBufferUsage.COPY_SRC);
      this.#writeFilter(width, height);
      pass.setPipeline(/** @type {GPUComputePipeline} */ (this.filterPipeline));
      pass.setBindGroup(0, group(this.layouts.filter, this.uniforms.filter, pixels, target));
      pass.dispatchWorkgroups(groups(width), groups(height));
    }
    pass.end();
    return filtered ? this.buffers.filtered : pixels;
  }

  /**
   * @param {'beginningOfPassWriteIndex' | 'endOfPassWriteIndex'} which
   * @param {number} index
   */
  #stamp(which, index) {
    return this.clock && !this.clock.busy ? { timestampWrites: { querySet: this.clock.queries, [which]: index } } : {};
  }

  /** @param {ReturnType<typeof footprints>} nodes */
  #writeNodes(nodes) {
    const bytes = new ArrayBuffer(NODE_BYTES * nodes.length);
    const to = new DataView(bytes);
    nodes.forEach(({ low, high, t, number, view }, k) => {
      const at = NODE_BYTES * k;
      [...low, ...high].forEach((x, i) => to.setUint32(at + 4 * i, x, true));
      to.setFloat32(at + 16, t, true);
      [k + 1, number, 0].forEach((x, i) => to.setUint32(at + 20 + 4 * i, x, true));
      writeView(view, to, at + 32);
    });
    const buffer = this.#buffer('nodes', bytes.byteLength, GPUBufferUsage.STORAGE | GPUBufferUsage.COPY_DST);
    this.device.queue.writeBuffer(buffer, 0, bytes);
    return buffer;
  }

  /**
   * @param {Camera} camera
   * @param {Look} look
   * @param {import('./camera.js').View[]} views
   * @param {number} stride Words of a hit; 0 if nothing was cast.
   * @param {number} width
   * @param {number} height
   * @param {boolean} shadows
   */
  #writeShading(camera, look, views, stride, width, height, shadows) {
    const { right, up, forward } = axes(camera);
    const toLight = look.sun ? unit(look.sun) : unit(add(add(scale(forward, -1), scale(right, -0.35)), scale(up, 0.5)));
    const flags = (look.light ? 1 : 0) | (look.normals ? 2 : 0) | (look.colors ? 4 : 0) | (look.sun ? 8 : 0) | (shadows ? 16 : 0);
    const bytes = new ArrayBuffer(SHADING_BYTES);
    new Float32Array(bytes, 0, 8).set([...toLight, 0, ...camera.eye, 0]);
    new Uint32Array(bytes, 32, 6).set([width, height, stride, MODES.indexOf(look.mode), flags, views.length]);
    new Float32Array(bytes, 56, 1).set([2]);
    this.device.queue.writeBuffer(this.uniforms.shading, 0, bytes);

    const objects = new ArrayBuffer(OBJECT_BYTES * Math.max(views.length, 1));
    views.forEach((view, k) => {
      const m = this.objects[k].octreeToMesh;
      const i = inverse(m);
      const floats = new Float32Array(objects, OBJECT_BYTES * k, 40);
      for (let c = 0; c < 3; c++) {
        floats.set([m[4 * c], m[4 * c + 1], m[4 * c + 2], 0], 4 * c);
        // Column c of the transposed inverse is row c of the inverse.
        floats.set([i[c], i[4 + c], i[8 + c], 0], 12 + 4 * c);
      }
      [view.origin, view.base, view.dx, view.dy].forEach((vector, n) => floats.set([...vector, 0], 24 + 4 * n));
      new Uint32Array(objects, OBJECT_BYTES * k + 160, 4).set([view.root, 0, this.objects[k].levels, 0]);
      new Float32Array(objects, OBJECT_BYTES * k + 164, 1).set([view.pixelSize]);
    });
    const buffer = this.#buffer('objects', objects.byteLength, GPUBufferUsage.STORAGE | GPUBufferUsage.COPY_DST);
    this.device.queue.writeBuffer(buffer, 0, objects);
  }

  /**
   * @param {number} width
   * @param {number} height
   */
  #writeFilter(width, height) {
    const { samples, radii } = this.texts.table;
    const bytes = new ArrayBuffer(FILTER_BYTES);
    new Uint32Array(bytes, 0, 5).set([width, height, 0, height, 1]);
    new Float32Array(bytes, 32, 96 * 4).set(samples.flat());
    new Float32Array(bytes, 32 + 96 * 16, 256).set(radii);
    this.device.queue.writeBuffer(this.uniforms.filter, 0, bytes);
  }

  /**
   * Draws a frame on the canvas. The picture has the given size; it is enlarged to that of the canvas.
   * @param {Camera} camera
   * @param {Look} look
   * @param {number} width
   * @param {number} height
   */
  frame(camera, look, width, height) {
    const { device, canvas } = this;
    const commands = device.createCommandEncoder();
    const picture = this.#draw(commands, camera, look, width, height);
    device.queue.writeBuffer(this.uniforms.sizes, 0, Uint32Array.of(width, height, canvas.width, canvas.height));
    const present = /** @type {GPURenderPipeline} */ (this.present);
    const pass = commands.beginRenderPass({ colorAttachments: [{ view: this.context.getCurrentTexture().createView(), loadOp: 'clear', storeOp: 'store' }] });
    pass.setPipeline(present);
    pass.setBindGroup(0, device.createBindGroup({ layout: present.getBindGroupLayout(0), entries: [{ binding: 0, resource: { buffer: this.uniforms.sizes } }, { binding: 1, resource: { buffer: picture } }] }));
    pass.draw(3);
    pass.end();
    const { clock } = this;
    const measured = clock && !clock.busy && this.drawn;
    if (clock && measured) {
      clock.busy = true;
      commands.resolveQuerySet(clock.queries, 0, 2, clock.resolve, 0);
      commands.copyBufferToBuffer(clock.resolve, 0, clock.read, 0, 16);
    }
    device.queue.submit([commands.finish()]);
    if (clock && measured) {
      clock.read.mapAsync(GPUMapMode.READ).then(() => {
        const [start, end] = new BigUint64Array(clock.read.getMappedRange());
        this.gpuTime = Number(end - start) / 1e6;
        clock.read.unmap();
        clock.busy = false;
      }).catch(() => {});
    }
    const begun = performance.now();
    return device.queue.onSubmittedWorkDone().then(() => performance.now() - begun);
  }

  /**
   * The pixels of a picture: red, green, blue, 255.
   * @param {Camera} camera
   * @param {Look} look
   * @param {number} width
   * @param {number} height
   */
  async pixels(camera, look, width, height) {
    const { device } = this;
    const commands = device.createCommandEncoder();
    const picture = this.#draw(commands, camera, look, width, height);
    const read = device.createBuffer({ size: width * height * 4, usage: GPUBufferUsage.MAP_READ | GPUBufferUsage.COPY_DST });
    commands.copyBufferToBuffer(picture, 0, read, 0, width * height * 4);
    device.queue.submit([commands.finish()]);
    await read.mapAsync(GPUMapMode.READ);
    const words = new Uint32Array(read.getMappedRange().slice(0));
    read.destroy();
    for (let k = 0; k < words.length; k++) words[k] |= 0xff000000;
    return new Uint8ClampedArray(words.buffer);
  }

  /**
   * The depth of the last frame's hit in a pixel, over the far depth; nothing where it hit nothing.
   * @param {number} x
   * @param {number} y
   * @param {number} width Of that frame.
   */
  async depthAt(x, y, width) {
    const { device } = this;
    const { hits } = this.buffers;
    const at = (y * width + x) * this.stride * 4;
    if (!this.drawn || !hits || at + 12 > hits.size) return undefined;
    const read = device.createBuffer({ size: 16, usage: GPUBufferUsage.MAP_READ | GPUBufferUsage.COPY_DST });
    const commands = device.createCommandEncoder();
    commands.copyBufferToBuffer(hits, at, read, 0, 12);
    device.queue.submit([commands.finish()]);
    await read.mapAsync(GPUMapMode.READ);
    const view = new DataView(read.getMappedRange());
    const [t, voxel] = [view.getFloat32(0, true), view.getUint32(8, true)];
    read.destroy();
    return voxel === 0xffffffff ? undefined : t;
  }

  destroy() {
    this.device.destroy();
  }
}

