// The traversal of the paper's Figure 8 on a GPU: the same operations in the same order as `esvo_core::reference`, whose
// comments name the lines of the figure.
//
// `esvo_core::gpu::kernel` puts a prelude in front, which declares what depends on the octree and on the frame:
//   const CONTOURS, FAR_POINTERS, LOD, BEAM, RAYS: bool   the features of this variant
//   const LEVELS: u32                               level of the deepest voxel: the number of frames of the stack
//   const ROUND_PRODUCTS, ROUND_QUOTIENTS: bool     what the driver need not do as the processor does: see `gpu::arithmetic`
//   const BEAM_BLOCK: u32                           edge of a block of the coarse pass in pixels
//   const WIDTH, HEIGHT: u32                        size of a workgroup in pixels, powers of two
//   fn slot_at(slot: u32) -> vec2<u32>              a slot of the octree, from the bindings of group 1
//
// The structs View, Hit and RayRecord are `esvo_core::View`, `esvo_core::Hit` and `esvo_core::Ray`: a test compares every
// member.

struct View {
    origin: vec3<f32>,
    t_near: f32,
    base: vec3<f32>,
    pixel_size: f32,
    dx: vec3<f32>,
    max_voxel_pixels: f32,
    dy: vec3<f32>,
    t_per_depth: f32,
    width: u32,
    height: u32,
    root: u32,
    flags: u32,
    // First row of the band that this dispatch casts.
    first_row: u32,
}

// A ray of a buffer of rays. Arrays, since a vec3 would have to lie at a multiple of 16 bytes.
struct RayRecord {
    origin: array<f32, 3>,
    direction: array<f32, 3>,
    t_min: f32,
    t_max: f32,
    size_at_origin: f32,
    size_per_t: f32,
}

struct Ray {
    origin: vec3<f32>,
    direction: vec3<f32>,
    t_min: f32,
    t_max: f32,
    // Slot of the root's descriptor.
    root: u32,
    // Read with RAYS; 0 without.
    size_at_origin: f32,
    size_per_t: f32,
}

struct Hit {
    raw_t: f32,
    slot: u32,
    voxel: u32,
    iterations: u32,
}

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read_write> coarse_out: array<f32>;
@group(0) @binding(1) var<storage, read> coarse_in: array<f32>;
@group(0) @binding(1) var<storage, read> rays: array<RayRecord>;
@group(0) @binding(2) var<storage, read_write> hits: array<Hit>;
@group(0) @binding(2) var<storage, read_write> depths: array<f32>;

const MAX_SCALE: u32 = 23u;
const MAX_ITERATIONS: u32 = 1u << 20u;
const EPSILON_BITS: u32 = 0x34000000u; // 2^-23
const EPSILON: f32 = 1.1920928955078125e-7;
const MAX_COMPONENT_BITS: u32 = 0x49800000u; // 2^20
const MAX_ORIGIN_BITS: u32 = 0x53800000u; // 2^40
const INFINITY_BITS: u32 = 0x7f800000u;
const MAGNITUDE: u32 = 0x7fffffffu;
const MISS_T: f32 = 2.0;
const MISS_VOXEL: u32 = 0xffffffffu;
const COARSE_VOXEL_BLOCKS: f32 = 2.8284271247461903;
const SQRT_3: f32 = 1.7320508;
const FAR_BIT: u32 = 1u << 16u;
// Scale of the first frame of the stack; the last frame is that of the root's children.
const LOWEST_SCALE: u32 = MAX_SCALE - LEVELS;

// A product that is added to something, rounded on its own. A driver may fuse the two operations, or change the order of products, but not
// across an operation on the bits whose result it cannot know: the topmost flag is never set.
fn product(a: f32, b: f32) -> f32 {
    if ROUND_PRODUCTS {
        return bitcast<f32>(bitcast<u32>(a * b) ^ (view.flags & ~MAGNITUDE));
    }
    return a * b;
}

fn product3(a: vec3<f32>, b: vec3<f32>) -> vec3<f32> {
    if ROUND_PRODUCTS {
        return bitcast<vec3<f32>>(bitcast<vec3<u32>>(a * b) ^ vec3<u32>(view.flags & ~MAGNITUDE));
    }
    return a * b;
}

// `a * b + c`, each operation rounded. A change to a fused operation would be made here and in `mad3`.
fn mad(a: f32, b: f32, c: f32) -> f32 {
    return product(a, b) + c;
}

fn mad3(a: vec3<f32>, b: vec3<f32>, c: vec3<f32>) -> vec3<f32> {
    return product3(a, b) + c;
}

// `1 / x`, rounded to the nearest number, for `x` from 2^-23 to 2^100 and below zero.
fn inverse_of(x: f32) -> f32 {
    if !ROUND_QUOTIENTS {
        return 1.0 / x;
    }
    let bits = bitcast<u32>(x);
    let digits = (bits & 0x7fffffu) | 0x800000u;
    // 2^47 / digits, off by a few. The remainder is so small that its low 32 bits are all of it, and those of 2^47 are 0.
    let near = 16777216.0 / bitcast<f32>((bits & 0x7fffffu) | 0x3f800000u);
    var quotient = u32(near);
    let off = i32(round(f32(bitcast<i32>(0u - quotient * digits)) * (near * 7.105427357601002e-15)));
    quotient += bitcast<u32>(off);
    // Off by one at most. It never lies halfway: 2^48 has no odd divisor.
    let twice = 2 * bitcast<i32>(0u - quotient * digits);
    quotient += select(0u, 1u, twice > i32(digits)) - select(0u, 1u, twice < -i32(digits));
    return f32(quotient) * bitcast<f32>((bits & ~MAGNITUDE) | ((230u - ((bits >> 23u) & 0xffu)) << 23u));
}

fn away_from_zero(x: f32) -> f32 {
    return select(x, bitcast<f32>((bitcast<u32>(x) & ~MAGNITUDE) | EPSILON_BITS), abs(x) < EPSILON);
}

fn least(v: vec3<f32>) -> f32 {
    return min(min(v.x, v.y), v.z);
}

fn greatest(v: vec3<f32>) -> f32 {
    return max(max(v.x, v.y), v.z);
}

// The mask of child slot bits: x = 1, y = 2, z = 4.
fn axes(b: vec3<bool>) -> u32 {
    return select(0u, 1u, b.x) | select(0u, 2u, b.y) | select(0u, 4u, b.z);
}

fn miss(iterations: u32) -> Hit {
    return Hit(MISS_T, 0u, MISS_VOXEL, iterations);
}

// The span of `t` between the planes of a child's contour.
fn project_contour(parent: u32, descriptor: vec2<u32>, child: u32, direction: vec3<f32>, t_centre: vec3<f32>, size: f32) -> vec2<f32> {
    let distance = (descriptor.y >> 8u) + countOneBits(descriptor.y & ((1u << child) - 1u));
    let pair = slot_at(parent + (distance >> 1u));
    let word = select(pair.x, pair.y, (distance & 1u) != 0u);
    let a = product(f32(bitcast<i32>(word << 14u)), direction.x);
    let b = product(f32(bitcast<i32>(word << 20u)), direction.y);
    let c = product(f32(bitcast<i32>(word << 26u)), direction.z);
    let inverse = inverse_of(away_from_zero(a + b + c));
    let position = product(f32(bitcast<i32>(word << 7u)) * size, 1.5);
    let middle = product(product(t_centre.x, a) + product(t_centre.y, b) + product(t_centre.z, c) + position, inverse);
    let half = abs(product(product(f32(word) * size, 0.75), inverse));
    return vec2<f32>(middle - half, middle + half);
}

fn cast_ray(ray: Ray) -> Hit {
    // Compares bits, since a shader compiler may assume that no number is NaN.
    let direction_bits = bitcast<vec3<u32>>(ray.direction) & vec3<u32>(MAGNITUDE);
    let origin_bits = bitcast<vec3<u32>>(ray.origin) & vec3<u32>(MAGNITUDE);
    if any(direction_bits > vec3<u32>(MAX_COMPONENT_BITS)) || any(origin_bits > vec3<u32>(MAX_ORIGIN_BITS)) {
        return miss(0u);
    }
    let direction = vec3<f32>(
        away_from_zero(ray.direction.x),
        away_from_zero(ray.direction.y),
        away_from_zero(ray.direction.z),
    );
    let coef = -vec3<f32>(inverse_of(abs(direction.x)), inverse_of(abs(direction.y)), inverse_of(abs(direction.z)));
    let mirrored = direction > vec3<f32>(0.0);
    let straight = product3(coef, ray.origin);
    let bias = select(straight, mad3(vec3<f32>(3.0), coef, -straight), mirrored);
    let mirror = axes(mirrored);

    // 1-3
    var t_min = greatest(2.0 * coef - bias);
    var t_max = least(coef - bias);
    t_min = max(t_min, ray.t_min);
    t_max = min(t_max, ray.t_max);

    // 5-7
    var parent = ray.root;
    var descriptor = vec2<u32>(0u);
    // Whether `descriptor` is not that of `parent`. It is read in one place, since devices that run both branches of an `if`
    // would read it twice from PUSH and POP.
    var stale = true;
    var stack_parent: array<u32, LEVELS>;
    var stack_t_max: array<f32, LEVELS>;
    var scale = MAX_SCALE - 1u;
    var size = 0.5;
    var upper = mad3(vec3<f32>(1.5), coef, -bias) > vec3<f32>(t_min);
    var idx = axes(upper);
    var pos = vec3<f32>(1.0) + select(vec3<f32>(0.0), vec3<f32>(0.5), upper);

    for (var iteration = 1u; iteration <= MAX_ITERATIONS; iteration++) {
        if stale {
            descriptor = slot_at(parent);
            stale = false;
        }
        // 9
        let t_corner = mad3(pos, coef, -bias);
        let tc_max = least(t_corner);
        let child = idx ^ mirror;

        // 10: the valid bit of the child, then the leaf bit.
        let masks = descriptor.x >> child;
        if (masks & 0x100u) != 0u && t_min <= t_max {
            // 11
            if LOD {
                var footprint = tc_max * ray.size_per_t;
                if RAYS {
                    footprint = mad(tc_max, ray.size_per_t, ray.size_at_origin);
                }
                if footprint >= size {
                    return Hit(t_min, parent, child | (scale << 8u), iteration);
                }
            }
            // 12-16
            var tv_min = t_min;
            var tv_max = min(t_max, tc_max);
            let half = size * 0.5;
            // The product is exact: `half` is a power of two.
            let t_centre = half * coef + t_corner;
            if CONTOURS {
                if ((descriptor.y >> child) & 1u) != 0u {
                    let span = project_contour(parent, descriptor, child, direction, t_centre, size);
                    tv_min = max(tv_min, span.x);
                    tv_max = min(tv_max, span.y);
                }
            }
            // 17
            if tv_min <= tv_max {
                // 18
                if (masks & 1u) != 0u {
                    return Hit(tv_min, parent, child | (scale << 8u), iteration);
                }
                // 19-25: PUSH
                stack_parent[scale - LOWEST_SCALE] = parent;
                stack_t_max[scale - LOWEST_SCALE] = t_max;
                var first = descriptor.x >> 17u;
                if FAR_POINTERS {
                    if (descriptor.x & FAR_BIT) != 0u {
                        first = slot_at(parent + first).x;
                    }
                }
                let nonleaf = (descriptor.x >> 8u) & ~descriptor.x;
                parent += first + countOneBits(nonleaf & ((1u << child) - 1u));
                stale = true;
                scale -= 1u;
                size = half;
                upper = t_centre > vec3<f32>(tv_min);
                idx = axes(upper);
                pos += select(vec3<f32>(0.0), vec3<f32>(size), upper);
                t_min = tv_min;
                t_max = tv_max;
                continue;
            }
        }
        // 28-30: ADVANCE
        let crossed = t_corner <= vec3<f32>(tc_max);
        let step = axes(crossed);
        let next = pos - select(vec3<f32>(0.0), vec3<f32>(size), crossed);
        let changed = bitcast<vec3<u32>>(pos) ^ bitcast<vec3<u32>>(next);
        pos = next;
        t_min = max(t_min, tc_max);
        idx ^= step;

        // 31
        if (idx & step) != 0u {
            // 32-37: POP
            scale = firstLeadingBit(changed.x | changed.y | changed.z);
            if scale >= MAX_SCALE {
                return miss(iteration);
            }
            size = bitcast<f32>((scale + 104u) << 23u);
            parent = stack_parent[scale - LOWEST_SCALE];
            t_max = stack_t_max[scale - LOWEST_SCALE];
            stale = true;
            let path = bitcast<vec3<u32>>(pos) >> vec3<u32>(scale);
            pos = bitcast<vec3<f32>>(path << vec3<u32>(scale));
            idx = axes((path & vec3<u32>(1u)) != vec3<u32>(0u));
        }
    }
    return miss(MAX_ITERATIONS);
}

fn direction_through(x: f32, y: f32) -> vec3<f32> {
    return mad3(view.dy, vec3<f32>(y), mad3(view.dx, vec3<f32>(x), view.base));
}

fn coarse_columns() -> u32 {
    return (view.width + BEAM_BLOCK - 1u) / BEAM_BLOCK + 3u;
}

fn coarse_rows() -> u32 {
    return (view.height + BEAM_BLOCK - 1u) / BEAM_BLOCK + 3u;
}

// The coarse pass: one start value per corner. Its variant has LOD and neither CONTOURS nor BEAM.
@compute @workgroup_size(WIDTH * HEIGHT)
fn coarse_pass(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let at = place(group, local);
    if at.x >= coarse_columns() || at.y >= coarse_rows() {
        return;
    }
    let corner = (vec2<f32>(at) - vec2<f32>(1.0)) * f32(BEAM_BLOCK);
    var ray: Ray;
    ray.root = view.root;
    ray.origin = view.origin;
    ray.direction = direction_through(corner.x, corner.y);
    ray.t_min = view.t_near;
    ray.t_max = bitcast<f32>(0x7f7fffffu);
    ray.size_per_t = view.pixel_size * (f32(BEAM_BLOCK) * COARSE_VOXEL_BLOCKS);
    let hit = cast_ray(ray);
    var start = 1.0;
    if hit.voxel != MISS_VOXEL {
        let size = bitcast<f32>(((hit.voxel >> 8u) + 104u) << 23u);
        start = max(mad(size * -SQRT_3, view.t_per_depth, hit.raw_t), view.t_near);
    }
    coarse_out[at.y * coarse_columns() + at.x] = start;
}

// Where the ray of a pixel may start: the least value of the 4 x 4 corners around its block.
fn beam_start(x: u32, y: u32) -> f32 {
    let columns = coarse_columns();
    var start = 1.0;
    var at = (y / BEAM_BLOCK) * columns + x / BEAM_BLOCK;
    for (var row = 0u; row < 4u; row++) {
        start = min(start, min(min(coarse_in[at], coarse_in[at + 1u]), min(coarse_in[at + 2u], coarse_in[at + 3u])));
        at += columns;
    }
    return start;
}

fn cast_pixel(x: u32, y: u32) -> Hit {
    var ray: Ray;
    ray.root = view.root;
    ray.origin = view.origin;
    ray.direction = direction_through(f32(x) + 0.5, f32(y) + 0.5);
    ray.t_min = view.t_near;
    ray.t_max = 1.0;
    ray.size_per_t = view.pixel_size * view.max_voxel_pixels;
    if BEAM {
        ray.t_min = beam_start(x, y);
    }
    return cast_ray(ray);
}

// The pixel of an invocation. A workgroup follows a Z-order curve, so that neighbours in a subgroup are neighbours in the
// picture.
fn place(group: vec3<u32>, local: u32) -> vec2<u32> {
    var x = 0u;
    var y = 0u;
    var rest = local;
    var bit = 1u;
    while bit < WIDTH || bit < HEIGHT {
        if bit < WIDTH {
            x |= (rest & 1u) * bit;
            rest >>= 1u;
        }
        if bit < HEIGHT {
            y |= (rest & 1u) * bit;
            rest >>= 1u;
        }
        bit <<= 1u;
    }
    return group.xy * vec2<u32>(WIDTH, HEIGHT) + vec2<u32>(x, y);
}

// The main pass.
@compute @workgroup_size(WIDTH * HEIGHT)
fn main_pass(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let at = place(group, local);
    let y = at.y + view.first_row;
    if at.x < view.width && y < view.height {
        hits[at.y * view.width + at.x] = cast_pixel(at.x, y);
    }
}

// The main pass for timing: stores one number per pixel, so that the time is that of the traversal and not of the memory.
@compute @workgroup_size(WIDTH * HEIGHT)
fn timing_pass(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let at = place(group, local);
    let y = at.y + view.first_row;
    if at.x < view.width && y < view.height {
        depths[at.y * view.width + at.x] = cast_pixel(at.x, y).raw_t;
    }
}

fn is_nan(x: f32) -> bool {
    return (bitcast<u32>(x) & MAGNITUDE) > INFINITY_BITS;
}

// The rays of a buffer, in any order: `view.width` of them, against the object at `view.root`. Its variant has RAYS and not
// BEAM.
@compute @workgroup_size(WIDTH * HEIGHT)
fn cast_rays(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let at = group.x * (WIDTH * HEIGHT) + local;
    if at >= view.width {
        return;
    }
    var ray: Ray;
    ray.root = view.root;
    ray.origin = vec3<f32>(rays[at].origin[0], rays[at].origin[1], rays[at].origin[2]);
    ray.direction = vec3<f32>(rays[at].direction[0], rays[at].direction[1], rays[at].direction[2]);
    ray.t_min = rays[at].t_min;
    ray.t_max = rays[at].t_max;
    ray.size_at_origin = rays[at].size_at_origin;
    ray.size_per_t = rays[at].size_per_t;
    // `cast_ray` looks at origin and direction; those of pictures have no other number that can be NaN.
    if is_nan(ray.t_min) || is_nan(ray.t_max) || is_nan(ray.size_at_origin) || is_nan(ray.size_per_t) {
        hits[at] = miss(0u);
    } else {
        hits[at] = cast_ray(ray);
    }
}
