// Many placed objects in one pass: each ray goes through a hierarchy over them once. The same as
// `esvo_core::instances::Instances::cast_band`, which explains it.
//
// `esvo_core::gpu::kernel` puts the prelude and `cast.wgsl` in front. The struct Node is `esvo_core::instances::Node`: a test
// compares every member.

struct Node {
    // First and last column and row.
    low: vec2<u32>,
    high: vec2<u32>,
    t: f32,
    skip: u32,
    number: u32,
    padding: u32,
    view: View,
}

// The nearest hit, and the number of the instance that has it; 0 for a miss.
struct NearestHit {
    hit: Hit,
    number: u32,
}

@group(0) @binding(1) var<storage, read> nodes: array<Node>;
@group(0) @binding(2) var<storage, read_write> nearest_hits: array<NearestHit>;

const NO_INSTANCE: u32 = 0xffffffffu;
// 2^-16: see `ROUNDING` in `esvo_core::instances`.
const STEP_BACK: f32 = 0.0000152587890625;

// The number of nodes is in `view.root`.
fn nearest_of_pixel(x: u32, y: u32) -> NearestHit {
    var nearest = NearestHit(miss(0u), 0u);
    var at = 0u;
    while at < view.root {
        if x < nodes[at].low.x || x > nodes[at].high.x || y < nodes[at].low.y || y > nodes[at].high.y || nodes[at].t > nearest.hit.raw_t {
            at = nodes[at].skip;
            continue;
        }
        let number = nodes[at].number;
        if number != NO_INSTANCE {
            var ray: Ray;
            ray.root = nodes[at].view.root;
            ray.origin = nodes[at].view.origin;
            let along_x = mad3(nodes[at].view.dx, vec3<f32>(f32(x) + 0.5), nodes[at].view.base);
            ray.direction = mad3(nodes[at].view.dy, vec3<f32>(f32(y) + 0.5), along_x);
            let margin = greatest((abs(ray.origin) + 5.0) / max(abs(ray.direction), vec3<f32>(EPSILON))) * STEP_BACK;
            ray.t_min = nodes[at].view.t_near;
            ray.t_max = min(nearest.hit.raw_t + margin, 1.0);
            ray.size_per_t = nodes[at].view.pixel_size * nodes[at].view.max_voxel_pixels;
            let hit = cast_ray(ray);
            let iterations = nearest.hit.iterations + hit.iterations;
            if hit.voxel != MISS_VOXEL && (hit.raw_t < nearest.hit.raw_t || (hit.raw_t == nearest.hit.raw_t && number < nearest.number)) {
                nearest = NearestHit(hit, number);
            }
            nearest.hit.iterations = iterations;
        }
        at += 1u;
    }
    return nearest;
}

// The nearest hits of a band of rows.
@compute @workgroup_size(WIDTH * HEIGHT)
fn instances_pass(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let at = place(group, local);
    let y = at.y + view.first_row;
    if at.x < view.width && y < view.height {
        nearest_hits[at.y * view.width + at.x] = nearest_of_pixel(at.x, y);
    }
}
