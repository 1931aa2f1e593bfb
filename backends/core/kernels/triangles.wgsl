// Triangles in an eight-wide hierarchy with quantized boxes: closest and any hits that are certain in single precision.
//
// What a hit is, the exact caster of `esvo_cpu::triangles` defines, in double precision. The test here has its operations in its order,
// in single precision, and bounds its own errors. An answer that the errors could change is UNDECIDED, and the processor gives it.
//
// `esvo_core::gpu::triangles` puts a prelude in front:
//   const STACK: u32                             frames of the stack
//   const WIDTH, HEIGHT: u32                     size of a workgroup in pixels
//   fn node_at(slot: u32) -> vec4<u32>           a fifth of a node, from the bindings of group 1
//   fn triangle_at(slot: u32) -> vec4<u32>       a third of a triangle, from the bindings behind them
// Its structs are View, Ray, Node, Triangle and Hit of that module: a test compares every member.

struct View {
    eye: vec3<f32>,
    t_min: f32,
    // Direction through the middle of the picture.
    middle: vec3<f32>,
    t_max: f32,
    dx: vec3<f32>,
    // Of a component of a direction, at most.
    direction_error: f32,
    dy: vec3<f32>,
    width: u32,
    height: u32,
    first_row: u32,
    // Of a buffer of rays.
    count: u32,
    padding: u32,
}

struct Ray {
    origin: vec3<f32>,
    t_min: f32,
    direction: vec3<f32>,
    t_max: f32,
}

// A node: 80 bytes.
struct Node {
    origin: vec3<f32>,
    // Of the quanta of each axis, as stored in a float, in the bytes from the lowest; in the highest, which children are nodes.
    exponents: u32,
    first_child: u32,
    first_triangle: u32,
    // A byte per child. Node: 24 + its place, and bit 5. Triangles: their place from `first_triangle`, and bits 5 to 7 as many as they are.
    kinds: vec2<u32>,
    // Sides of the boxes in quanta, a byte per child.
    min_x: vec2<u32>,
    max_x: vec2<u32>,
    min_y: vec2<u32>,
    max_y: vec2<u32>,
    min_z: vec2<u32>,
    max_z: vec2<u32>,
}

struct Triangle {
    a: vec3<f32>,
    index: u32,
    b: vec3<f32>,
    unused: u32,
    c: vec3<f32>,
    unused_too: u32,
}

struct Hit {
    t: f32,
    triangle: u32,
}

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> rays: array<Ray>;
@group(0) @binding(2) var<storage, read_write> hits: array<Hit>;
@group(0) @binding(2) var<storage, read_write> depths: array<f32>;

const MISS_T: f32 = 2.0;
const MISS: u32 = 0xffffffffu;
const UNDECIDED: u32 = 0xfffffffeu;
// 2^-24: a rounded number is off by at most this factor. A division by five times as much.
const U: f32 = 5.9604644775390625e-8;
const FARTHEST: f32 = 3.0e38;
// A direction's component over its greatest is at least this, so that no product of its inverse overflows.
const LEAST: f32 = 1.0e-30;

// A ray as boxes and triangles see it. `s` is the way along the longest axis: t times the direction's component there.
struct Traveller {
    origin: vec3<f32>,
    axis: u32,
    // Of the longest axis.
    sign: f32,
    shear: vec2<f32>,
    // Error of the shear.
    shear_error: f32,
    // Error of a corner: a part for all, and a factor on the distance.
    corner_error: f32,
    inverse: vec3<f32>,
    // How far boxes are widened.
    margin: f32,
    octant: u32,
}

// What was found so far.
struct Found {
    // The closest certain hit: where at least and at most.
    low: f32,
    high: f32,
    triangle: u32,
    // The least `s` at which something else may be hit.
    rival: f32,
}

fn node(at: u32) -> Node {
    let place = node_at(5u * at);
    let children = node_at(5u * at + 1u);
    let x = node_at(5u * at + 2u);
    let y = node_at(5u * at + 3u);
    let z = node_at(5u * at + 4u);
    let origin = bitcast<vec3<f32>>(place.xyz);
    return Node(origin, place.w, children.x, children.y, children.zw, x.xy, x.zw, y.xy, y.zw, z.xy, z.zw);
}

fn triangle(at: u32) -> Triangle {
    let a = triangle_at(3u * at);
    let b = triangle_at(3u * at + 1u);
    let c = triangle_at(3u * at + 2u);
    return Triangle(bitcast<vec3<f32>>(a.xyz), a.w, bitcast<vec3<f32>>(b.xyz), b.w, bitcast<vec3<f32>>(c.xyz), c.w);
}

// The component of an axis behind the two others, in cyclic order.
fn turned(v: vec3<f32>, axis: u32) -> vec3<f32> {
    return select(select(v.xyz, v.zxy, axis == 1u), v.yzx, axis == 0u);
}

fn least_of(v: vec3<f32>) -> f32 {
    return min(min(v.x, v.y), v.z);
}

fn greatest_of(v: vec3<f32>) -> f32 {
    return max(max(v.x, v.y), v.z);
}

// The children of four whose boxes the ray enters before `limit`, as bits of the node's hits.
fn enter_four(kinds: u32, near: vec3<u32>, far: vec3<u32>, start: vec3<f32>, slack: vec3<f32>, step: vec3<f32>, from_s: f32, limit: f32, octant: u32) -> u32 {
    let bytes = vec4<u32>(0u, 8u, 16u, 24u);
    let low = vec4<u32>(255u);
    let near_x = vec4<f32>((vec4<u32>(near[0]) >> bytes) & low) * step.x + (start.x - slack.x);
    let near_y = vec4<f32>((vec4<u32>(near[1]) >> bytes) & low) * step.y + (start.y - slack.y);
    let near_z = vec4<f32>((vec4<u32>(near[2]) >> bytes) & low) * step.z + (start.z - slack.z);
    let far_x = vec4<f32>((vec4<u32>(far[0]) >> bytes) & low) * step.x + (start.x + slack.x);
    let far_y = vec4<f32>((vec4<u32>(far[1]) >> bytes) & low) * step.y + (start.y + slack.y);
    let far_z = vec4<f32>((vec4<u32>(far[2]) >> bytes) & low) * step.z + (start.z + slack.z);
    let enter = max(max(near_x, near_y), max(near_z, vec4<f32>(from_s)));
    let leave = min(min(far_x, far_y), min(far_z, vec4<f32>(limit)));
    // Of a byte per child: bits 3 and 4 are both 1 for nodes. These come in the order in which a ray of this octant meets them, the
    // first at the highest bit.
    let inner = ((kinds & (kinds << 1u)) >> 4u) & 0x01010101u;
    let places = kinds ^ (inner * octant);
    let place = (vec4<u32>(places) >> bytes) & vec4<u32>(31u);
    let ones = (vec4<u32>(kinds) >> (bytes + vec4<u32>(5u))) & vec4<u32>(7u);
    let bits = select(vec4<u32>(0u), ones << place, enter <= leave);
    return bits.x | bits.y | bits.z | bits.w;
}

// Children of a node as bits: the upper eight are nodes, the others triangles.
fn enter(node: Node, ray: Traveller, from_s: f32, limit: f32) -> u32 {
    let exponents = node.exponents;
    let quanta = bitcast<vec3<f32>>(((vec3<u32>(exponents) >> vec3<u32>(0u, 8u, 16u)) & vec3<u32>(255u)) << vec3<u32>(23u));
    let step = quanta * ray.inverse;
    let start = (node.origin - ray.origin) * ray.inverse;
    let slack = abs(ray.inverse) * ray.margin;
    let against = ray.inverse < vec3<f32>(0.0);
    let near_x = select(node.min_x, node.max_x, against.x);
    let near_y = select(node.min_y, node.max_y, against.y);
    let near_z = select(node.min_z, node.max_z, against.z);
    let far_x = select(node.max_x, node.min_x, against.x);
    let far_y = select(node.max_y, node.min_y, against.y);
    let far_z = select(node.max_z, node.min_z, against.z);
    let kinds = node.kinds;
    return enter_four(kinds.x, vec3<u32>(near_x.x, near_y.x, near_z.x), vec3<u32>(far_x.x, far_y.x, far_z.x), start, slack, step, from_s, limit, ray.octant)
        | enter_four(kinds.y, vec3<u32>(near_x.y, near_y.y, near_z.y), vec3<u32>(far_x.y, far_y.y, far_z.y), start, slack, step, from_s, limit, ray.octant);
}

// Where a triangle may be hit.
struct Meeting {
    low: f32,
    high: f32,
    // Not hit; hit for certain.
    missed: bool,
    certain: bool,
}

fn meet(triangle: Triangle, ray: Traveller) -> Meeting {
    let a = turned(triangle.a - ray.origin, ray.axis);
    let b = turned(triangle.b - ray.origin, ray.axis);
    let c = turned(triangle.c - ray.origin, ray.axis);
    let a_xy = a.xy - ray.shear * a.z;
    let b_xy = b.xy - ray.shear * b.z;
    let c_xy = c.xy - ray.shear * c.z;
    let u = c_xy.x * b_xy.y - c_xy.y * b_xy.x;
    let v = a_xy.x * c_xy.y - a_xy.y * c_xy.x;
    let w = b_xy.x * a_xy.y - b_xy.y * a_xy.x;

    // Bounds of the errors: of corners, of sheared corners, of u, v and w. `esvo_core::gpu::triangles` derives them.
    let distance = greatest_of(max(max(abs(a), abs(b)), abs(c)));
    let beside = max(max(abs(a_xy), abs(b_xy)), abs(c_xy));
    let width = max(beside.x, beside.y);
    let corner_error = ray.corner_error + U * distance;
    let sheared_error = 2.0 * corner_error + distance * (ray.shear_error + 4.0 * U);
    let edge_error = width * (4.25 * sheared_error + 6.0 * U * width) + 3.0 * sheared_error * sheared_error;

    let least = min(min(u, v), w);
    let greatest = max(max(u, v), w);
    var meeting: Meeting;
    meeting.missed = least < -edge_error && greatest > edge_error;
    meeting.certain = least > edge_error || greatest < -edge_error;
    if meeting.missed {
        return meeting;
    }
    let z = vec3<f32>(a.z, b.z, c.z) * ray.sign;
    let first = least_of(z);
    let last = greatest_of(z);
    let depth_error = 2.0 * corner_error + 16.0 * U * distance;
    meeting.low = first - depth_error;
    meeting.high = last + depth_error;
    let determinant = u + v + w;
    if abs(determinant) > 8.0 * edge_error {
        let s = (u * z.x + v * z.y + w * z.z) / determinant;
        let error = 7.0 * edge_error * (last - first) / abs(determinant) + depth_error;
        meeting.low = max(meeting.low, s - error);
        meeting.high = min(meeting.high, s + error);
    }
    return meeting;
}

// The closest hit, or with `any` whether there is one: then the triangle is one that is hit.
fn cast_ray(ray: Ray, direction_error: f32, any_hit: bool) -> Hit {
    let size = greatest_of(abs(ray.direction));
    let undecided = Hit(MISS_T, UNDECIDED);
    // The processor sends rays that single precision does not suffice for as rays without a direction.
    if !(size > 4.0 * direction_error && size > 0.0) {
        return undecided;
    }
    let error = direction_error / size;
    let reach = 2.0 + greatest_of(abs(ray.origin));
    var it: Traveller;
    it.origin = ray.origin;
    it.axis = select(select(2u, 1u, abs(ray.direction.y) == size), 0u, abs(ray.direction.x) == size);
    let along = turned(ray.direction, it.axis);
    it.sign = select(1.0, -1.0, along.z < 0.0);
    it.shear = along.xy / along.z;
    it.shear_error = 3.0 * error + 8.0 * U;
    it.corner_error = reach * U;
    let scaled = ray.direction / size;
    let direction = select(scaled, select(vec3<f32>(LEAST), vec3<f32>(-LEAST), scaled < vec3<f32>(0.0)), abs(scaled) < vec3<f32>(LEAST));
    it.inverse = vec3<f32>(1.0) / direction;
    it.margin = reach * (40.0 * U + 3.0 * error);
    it.octant = select(4u, 0u, direction.x < 0.0) | select(2u, 0u, direction.y < 0.0) | select(1u, 0u, direction.z < 0.0);

    // Where the ray starts and ends, at least and at most.
    let scale = 2.0 * error + 8.0 * U;
    let start = ray.t_min * size;
    let end = min(ray.t_max * size, FARTHEST);
    let start_low = start * (1.0 - scale);
    let start_high = start * (1.0 + scale);
    let end_low = end * (1.0 - scale);
    let end_high = min(end * (1.0 + scale), FARTHEST);

    var found = Found(FARTHEST, FARTHEST, MISS, FARTHEST);
    var limit = end_high;
    var stack: array<vec2<u32>, STACK>;
    var waiting = 0u;
    // Nodes with the same parent: the first of them, and as bits those that are entered and those that are nodes.
    var group = vec2<u32>(0u, 0x80000000u);
    loop {
        if (group.y & 0xff000000u) == 0u {
            if waiting == 0u {
                break;
            }
            waiting -= 1u;
            group = stack[waiting];
        }
        let bit = firstLeadingBit(group.y);
        group.y &= ~(1u << bit);
        let place = (bit - 24u) ^ it.octant;
        let at = group.x + countOneBits(group.y & ((1u << place) - 1u));
        if (group.y & 0xff000000u) != 0u {
            stack[waiting] = group;
            waiting += 1u;
        }
        let node = node(at);
        let entered = enter(node, it, start_low, limit);
        group = vec2<u32>(node.first_child, (entered & 0xff000000u) | (node.exponents >> 24u));
        var these = entered & 0xffffffu;
        let first = node.first_triangle;
        while these != 0u {
            let one = firstLeadingBit(these);
            these &= ~(1u << one);
            let triangle = triangle(first + one);
            let meeting = meet(triangle, it);
            // A triangle may be in several leaves.
            let index = triangle.index;
            if meeting.missed || meeting.high < start_low || meeting.low > limit || index == found.triangle {
                continue;
            }
            if !meeting.certain || meeting.low < start_high || meeting.high > end_low {
                found.rival = min(found.rival, meeting.low);
            } else if any_hit {
                return Hit(meeting.low / size, index);
            } else if meeting.high < found.high {
                found = Found(meeting.low, meeting.high, index, min(found.rival, found.low));
                limit = min(limit, meeting.high);
            } else {
                found.rival = min(found.rival, meeting.low);
            }
        }
    }
    if found.triangle == MISS {
        return Hit(MISS_T, select(MISS, UNDECIDED, found.rival < FARTHEST));
    }
    if found.rival <= found.high {
        return undecided;
    }
    return Hit((found.low + found.high) * 0.5 / size, found.triangle);
}

fn cast_pixel(x: u32, y: u32) -> Hit {
    let right = f32(x) + 0.5 - f32(view.width) * 0.5;
    let down = f32(y) + 0.5 - f32(view.height) * 0.5;
    let direction = view.dy * down + (view.dx * right + view.middle);
    return cast_ray(Ray(view.eye, view.t_min, direction, view.t_max), view.direction_error, false);
}

// The pixel of an invocation. A workgroup follows a Z-order curve, as in `cast.wgsl`.
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

@compute @workgroup_size(WIDTH * HEIGHT)
fn triangles_pass(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let id = place(group, local);
    let y = id.y + view.first_row;
    if id.x < view.width && y < view.height {
        hits[id.y * view.width + id.x] = cast_pixel(id.x, y);
    }
}

// The same for timing: stores one number per pixel.
@compute @workgroup_size(WIDTH * HEIGHT)
fn triangles_timing(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let id = place(group, local);
    let y = id.y + view.first_row;
    if id.x < view.width && y < view.height {
        depths[id.y * view.width + id.x] = cast_pixel(id.x, y).t;
    }
}

// The error of a direction of a buffer: that of its rounding.
fn rounding(ray: Ray) -> f32 {
    return 2.0 * U * greatest_of(abs(ray.direction));
}

// The closest hits of a buffer of rays.
@compute @workgroup_size(WIDTH * HEIGHT)
fn triangles_rays(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < view.count {
        hits[id.x] = cast_ray(rays[id.x], rounding(rays[id.x]), false);
    }
}

// Some hit of each ray of a buffer.
@compute @workgroup_size(WIDTH * HEIGHT)
fn triangles_any(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < view.count {
        hits[id.x] = cast_ray(rays[id.x], rounding(rays[id.x]), true);
    }
}
