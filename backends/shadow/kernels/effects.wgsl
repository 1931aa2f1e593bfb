// Effects through the volume, pass after pass: those of src/effects, with the same rays. Follows trace.wgsl.
//
// Every pass reads up to two pictures of values and writes one. What a value's components mean is said at each entry point.

/// Where a picture is seen from, and where voxels lie; src/gpu/effects.rs has the same structs.
struct Picture {
    eye: vec3<f32>,
    width: u32,
    right: vec3<f32>,
    height: u32,
    up: vec3<f32>,
    half_width: f32,
    forward: vec3<f32>,
    half_height: f32,
    origin: vec3<f32>,
    voxel: f32,
}

/// What a pass is told.
struct Job {
    /// Rays for each pixel, and the number that they are chosen by.
    rays: u32,
    seed: u32,
    lamps: u32,
    /// 1 where the offset is traced through the picture.
    in_picture: u32,
    /// Where rays end, in the world's unit.
    reach: f32,
    roughness: f32,
    tolerance: f32,
    density: f32,
    /// Of filters: from pixel to pixel, and what is the same surface.
    apart: i32,
    distance: f32,
    cosine: f32,
    /// Voxels from sample to sample; 0: every voxel.
    step: f32,
    sky: vec3<f32>,
    ambient: f32,
    /// A `Fidelity`.
    coarsest: u32,
    fine_until: u32,
    /// Of the offset at a surface.
    share: f32,
    longest: f32,
}

struct Lamp {
    position: vec3<f32>,
    radius: f32,
    color: vec3<f32>,
    reach: f32,
    axis: vec3<f32>,
    /// Cosines of a cone; without one, both are below -1, and so no cosine is outside.
    inner: f32,
    outer: f32,
}

@group(1) @binding(0) var<uniform> picture: Picture;
@group(1) @binding(1) var<uniform> job: Job;
@group(1) @binding(2) var<storage, read> lamps: array<Lamp>;
/// Of each pixel, row by row: place and depth, 0 where there is no surface.
@group(1) @binding(3) var<storage, read> places: array<vec4<f32>>;
@group(1) @binding(4) var<storage, read> normals: array<vec4<f32>>;
@group(1) @binding(5) var<storage, read> colors: array<vec4<f32>>;
@group(1) @binding(6) var<storage, read> first: array<vec4<f32>>;
@group(1) @binding(7) var<storage, read> second: array<vec4<f32>>;
@group(1) @binding(8) var<storage, read_write> made: array<vec4<f32>>;

const PI: f32 = 3.14159265358979;
/// Farther away, in voxels, nothing is looked for; see src/trace/ray.rs.
const FARTHEST: f32 = 2097152.0;
/// Most samples of a ray through the picture; see src/effects/screen.rs.
const MOST_SAMPLES: f32 = 48.0;
/// See src/effects/start.rs.
const MARGIN: f32 = 0.03;
/// See src/effects/compose.rs.
const MIRRORED: f32 = 0.15;
/// See src/effects/denoise.rs.
const ACROSS: f32 = 5.0;
const OWN: f32 = 3.0;
const MANY: f32 = 1.0;
const FEW: f32 = 1.5;

struct Surface {
    position: vec3<f32>,
    depth: f32,
    normal: vec3<f32>,
    is_some: bool,
}

fn surface_of(pixel: u32) -> Surface {
    let place = places[pixel];
    return Surface(place.xyz, place.w, normals[pixel].xyz, place.w > 0.0);
}

fn size() -> vec2<f32> {
    return vec2<f32>(f32(picture.width), f32(picture.height));
}

// Numbers that rays are chosen by: src/effects/random.rs.

fn hash(number: u32) -> u32 {
    var x = (number ^ (number >> 16u)) * 0x85ebca6bu;
    x = (x ^ (x >> 13u)) * 0xc2b2ae35u;
    return x ^ (x >> 16u);
}

fn unit(x: u32) -> f32 {
    return f32(x >> 8u) * (1.0 / 16777216.0);
}

fn square(pixel: u32, i: u32, seed: u32) -> vec2<f32> {
    let key = hash(pixel ^ hash(seed + 0x9e3779b9u));
    return vec2<f32>(unit(key + i * 3242174889u), unit(hash(key) + i * 2447445414u));
}

fn disk(point: vec2<f32>) -> vec2<f32> {
    let angle = 2.0 * PI * point.x;
    return vec2<f32>(cos(angle), sin(angle)) * sqrt(point.y);
}

/// Two directions at right angles to one and to each other, as glam's `any_orthonormal_pair` has them: another pair would be other rays.
struct Pair {
    x: vec3<f32>,
    y: vec3<f32>,
}

fn pair_of(n: vec3<f32>) -> Pair {
    let sign_z = select(1.0, -1.0, (bitcast<u32>(n.z) >> 31u) != 0u);
    let a = -1.0 / (sign_z + n.z);
    let b = n.x * n.y * a;
    return Pair(
        vec3<f32>(1.0 + sign_z * n.x * n.x * a, sign_z * b, -sign_z * n.x),
        vec3<f32>(b, sign_z + n.y * n.y * a, -n.y),
    );
}

fn hemisphere(normal: vec3<f32>, point: vec2<f32>) -> vec3<f32> {
    let on_disk = disk(point);
    let pair = pair_of(normal);
    let up = sqrt(max(1.0 - dot(on_disk, on_disk), 0.0));
    return normalize(pair.x * on_disk.x + pair.y * on_disk.y + normal * max(up, 1e-3));
}

// The picture: src/effects/frame.rs and src/effects/screen.rs.

/// Column, row and depth of a place; the depth is not above 0 behind the eye.
fn project(place: vec3<f32>) -> vec3<f32> {
    let to = place - picture.eye;
    let depth = dot(to, picture.forward);
    let half = vec2<f32>(picture.half_width, picture.half_height);
    let at = vec2<f32>(dot(to, picture.right), -dot(to, picture.up)) / (depth * half);
    return vec3<f32>((at * 0.5 + vec2<f32>(0.5)) * size(), depth);
}

fn is_within(at: vec2<f32>) -> bool {
    return all(at >= vec2<f32>(0.0)) && all(at < size());
}

fn pixel_at(at: vec2<f32>) -> u32 {
    return u32(at.y) * picture.width + u32(at.x);
}

/// Height of a pixel at depth 1.
fn pixel_height() -> f32 {
    return 2.0 * picture.half_height / f32(picture.height);
}

/// How far along a ray the picture has something in its way; negative if it has not.
fn first_in_picture(start_place: vec3<f32>, direction: vec3<f32>, reach: f32, thickness: f32) -> f32 {
    let start = project(start_place);
    if start.z <= 0.0 {
        return -1.0;
    }
    let falls = -dot(direction, picture.forward);
    let distance = select(reach, min(reach, 0.9 * start.z / falls), falls > 0.0);
    let end = project(start_place + direction * distance);
    if end.z <= 0.0 {
        return -1.0;
    }
    let way = end.xy - start.xy;
    let pixels = max(abs(way.x), abs(way.y));
    if pixels < 1.0 || !is_within(start.xy) {
        return -1.0;
    }
    let samples = min(ceil(pixels), MOST_SAMPLES);
    let own = pixel_at(start.xy);
    for (var sample = 1u; sample <= u32(samples); sample++) {
        let part = f32(sample) / samples;
        let at = start.xy + way * part;
        if !is_within(at) {
            return -1.0;
        }
        let pixel = pixel_at(at);
        let seen = surface_of(pixel);
        if !seen.is_some || pixel == own {
            continue;
        }
        let depth = 1.0 / ((1.0 - part) / start.z + part / end.z);
        let along = distance * part * depth / end.z;
        let below = dot(seen.position - (start_place + direction * along), seen.normal);
        let behind = depth - seen.depth;
        let footprint = seen.depth * pixel_height();
        if below > 0.5 * footprint && behind > 0.0 && behind < thickness + footprint {
            return along;
        }
    }
    return -1.0;
}

// Rays: src/effects/obstacles.rs and src/effects/start.rs.

struct Query {
    position: vec3<f32>,
    normal: vec3<f32>,
    direction: vec3<f32>,
    length: f32,
}

/// How many voxels along the direction, then along the normal, a ray goes before it looks at the volume.
fn offset_of(normal: vec3<f32>, direction: vec3<f32>) -> vec2<f32> {
    if all(normal == vec3<f32>(0.0)) || job.share == 0.0 {
        return vec2<f32>(0.0);
    }
    let above = dot(abs(normal), vec3<f32>(1.0)) * job.share + MARGIN;
    let slope = dot(normal, direction);
    if slope * job.longest >= above {
        return vec2<f32>(above / slope, 0.0);
    }
    let along = select(0.0, job.longest, slope > 0.0);
    return vec2<f32>(along, above - max(slope, 0.0) * along);
}

/// `Steps::new` in single precision.
fn new_steps(ray: Ray, step: f32) -> Steps {
    let direction = vec3<f32>(ray.direction);
    let size = length(direction);
    let reach = f32(abs(ray.end - ray.origin[ray.major])) / f32(UNIT);
    let voxels = reach * size / abs(direction[ray.major]);
    return Steps(round_away(direction * (step / size * 65536.0)), u32(floor(voxels / step)) + 1u);
}

/// How far away the first thing in the way is, in the world's unit; negative if there is none.
fn distance_to(query: Query) -> f32 {
    let offset = offset_of(query.normal, query.direction) * picture.voxel;
    if job.in_picture != 0u && any(query.normal != vec3<f32>(0.0)) {
        let skipped = min(offset.x + offset.y, query.length);
        let at = first_in_picture(query.position, query.direction, skipped, 2.0 * picture.voxel);
        if at >= 0.0 {
            return at;
        }
    }
    if offset.x >= query.length {
        return -1.0;
    }
    let start = query.position + query.direction * offset.x + query.normal * offset.y;
    let voxels = (start - picture.origin) / picture.voxel;
    // What is not a number is not near either.
    if !(max(max(abs(voxels.x), abs(voxels.y)), abs(voxels.z)) <= FARTHEST) || all(query.direction == vec3<f32>(0.0)) {
        return -1.0;
    }
    let ray = new_ray(voxels, query.direction, (query.length - offset.x) / picture.voxel);
    let size = length(vec3<f32>(ray.direction));
    if job.step > 0.0 {
        let hit = steps_first(ray, new_steps(ray, job.step), Fidelity(job.coarsest, job.fine_until));
        let away = f32(abs(hit.numerator)) / 65536.0 * size / abs(f32(ray.direction[ray.major]));
        return select(-1.0, offset.x + away * picture.voxel, hit.is_hit != 0u);
    }
    let hit = walk_first(ray, Fidelity(job.coarsest, job.fine_until));
    let away = f32(hit.numerator) / f32(hit.denominator) * size / f32(UNIT);
    return select(-1.0, offset.x + away * picture.voxel, hit.is_hit != 0u);
}

fn is_in_the_way(query: Query) -> bool {
    return distance_to(query) >= 0.0;
}

/// Ray `i` of a pixel to all around.
fn around(pixel: u32, surface: Surface, i: u32) -> Query {
    let direction = hemisphere(surface.normal, square(pixel, i, job.seed));
    return Query(surface.position, surface.normal, direction, job.reach);
}

// Lamps: src/effects/lamps.rs.

fn light_at(lamp: Lamp, place: vec3<f32>) -> vec3<f32> {
    let way = place - lamp.position;
    let distance = max(max(dot(way, way), lamp.radius * lamp.radius), 1e-12);
    let near = distance / (lamp.reach * lamp.reach);
    let left = max(1.0 - near * near, 0.0);
    let cosine = dot(way, lamp.axis) / sqrt(distance);
    let share = select(smoothstep(lamp.outer, lamp.inner, cosine), 1.0, lamp.inner < -1.0);
    return lamp.color * (share * left * left / distance);
}

fn point_of(lamp: Lamp, seen_from: vec3<f32>, at: vec2<f32>) -> vec3<f32> {
    let to = lamp.position - seen_from;
    let far = length(to);
    let pair = pair_of(select(vec3<f32>(0.0, 0.0, 1.0), to / far, far > 0.0));
    let on_disk = disk(at) * lamp.radius;
    return lamp.position + pair.x * on_disk.x + pair.y * on_disk.y;
}

/// The light that a surface gets from a lamp if nothing is in the way.
fn unblocked(lamp: Lamp, surface: Surface) -> vec3<f32> {
    let to = lamp.position - surface.position;
    let far = length(to);
    let slope = select(0.0, dot(to, surface.normal) / far, far > 0.0);
    return light_at(lamp, surface.position) * max(slope, 0.0);
}

/// The share of a lamp's rays that reach it.
fn free_of(lamp: Lamp, pixel: u32, surface: Surface, seed: u32) -> f32 {
    // All rays to a lamp without a radius are one.
    let count = select(job.rays, 1u, lamp.radius == 0.0);
    var free = 0u;
    for (var i = 0u; i < count; i++) {
        let way = point_of(lamp, surface.position, square(pixel, i, seed)) - surface.position;
        let far = length(way);
        let direction = way / far;
        if dot(direction, surface.normal) > 0.0 {
            free += select(1u, 0u, is_in_the_way(Query(surface.position, surface.normal, direction, far)));
        }
    }
    return f32(free) / f32(count);
}

/// The pixel of an invocation; `is_some` is false beyond the picture.
struct Pixel {
    at: vec2<u32>,
    index: u32,
    is_some: bool,
}

fn pixel_of(id: vec3<u32>) -> Pixel {
    return Pixel(id.xy, id.y * picture.width + id.x, id.x < picture.width && id.y < picture.height);
}

/// Made: the share of rays that nothing is in the way of.
@compute @workgroup_size(8, 8)
fn ambient_occlusion(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = pixel_of(id);
    if !pixel.is_some {
        return;
    }
    let surface = surface_of(pixel.index);
    var free = job.rays;
    if surface.is_some {
        for (var i = 0u; i < job.rays; i++) {
            free -= select(0u, 1u, is_in_the_way(around(pixel.index, surface, i)));
        }
    }
    made[pixel.index] = vec4<f32>(f32(free) / f32(job.rays));
}

/// Made: the share of all lamps' light that reaches the surface; red, green, blue.
@compute @workgroup_size(8, 8)
fn shadows(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = pixel_of(id);
    if !pixel.is_some {
        return;
    }
    let surface = surface_of(pixel.index);
    var sum = vec3<f32>(0.0);
    var everything = vec3<f32>(0.0);
    if surface.is_some {
        for (var i = 0u; i < job.lamps; i++) {
            let light = unblocked(lamps[i], surface);
            // Rays that change nothing are not traced.
            if any(light > vec3<f32>(0.0)) {
                everything += light;
                sum += light * free_of(lamps[i], pixel.index, surface, job.seed + i);
            }
        }
    }
    let shares = select(vec3<f32>(0.0), sum / everything, everything > vec3<f32>(0.0));
    made[pixel.index] = vec4<f32>(shares, 0.0);
}

/// The pixel that shows a place from the side that a ray in a direction sees.
struct Shown {
    at: vec2<f32>,
    pixel: u32,
    is_some: bool,
}

fn shown_at(place: vec3<f32>, direction: vec3<f32>, footprints: f32) -> Shown {
    let at = project(place);
    if at.z <= 0.0 || !is_within(at.xy) {
        return Shown(at.xy, 0u, false);
    }
    let pixel = pixel_at(at.xy);
    let surface = surface_of(pixel);
    let near = distance(surface.position, place) <= job.tolerance + footprints * surface.depth * pixel_height();
    return Shown(at.xy, pixel, surface.is_some && near && dot(surface.normal, direction) <= 0.0);
}

/// Made: the light that other surfaces send, of lamps that shine on them; red, green, blue.
@compute @workgroup_size(8, 8)
fn bounce(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = pixel_of(id);
    if !pixel.is_some {
        return;
    }
    let surface = surface_of(pixel.index);
    var sum = vec3<f32>(0.0);
    if surface.is_some {
        for (var i = 0u; i < job.rays; i++) {
            let query = around(pixel.index, surface, i);
            let distance = distance_to(query);
            if distance < 0.0 {
                continue;
            }
            let place = query.position + query.direction * distance;
            let shown = shown_at(place, query.direction, 0.0);
            let normal = normals[shown.pixel].xyz;
            if !shown.is_some || dot(normal, query.direction) == 0.0 {
                continue;
            }
            for (var k = 0u; k < job.lamps; k++) {
                let way = lamps[k].position - place;
                let far = length(way);
                let direction = way / far;
                let slope = dot(direction, normal);
                let light = light_at(lamps[k], place) * colors[shown.pixel].xyz * slope;
                if slope > 0.0 && any(light > vec3<f32>(0.0)) && !is_in_the_way(Query(place, normal, direction, far)) {
                    sum += light;
                }
            }
        }
    }
    made[pixel.index] = vec4<f32>(sum / f32(job.rays), 0.0);
}

/// First: ambient occlusion. Second: shares of lamps. Made before: bounced light. Made: the surface's light, or the sky's.
@compute @workgroup_size(8, 8)
fn shade(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = pixel_of(id);
    if !pixel.is_some {
        return;
    }
    let surface = surface_of(pixel.index);
    var light = job.sky;
    if surface.is_some {
        var lit = vec3<f32>(0.0);
        for (var i = 0u; i < job.lamps; i++) {
            lit += unblocked(lamps[i], surface);
        }
        let irradiance = vec3<f32>(job.ambient * first[pixel.index].x) + lit * second[pixel.index].xyz + made[pixel.index].xyz;
        light = colors[pixel.index].xyz * irradiance;
    }
    made[pixel.index] = vec4<f32>(light, 0.0);
}

/// First: the picture's light. Made: the light that is mirrored, and the share of rays that reach the sky.
@compute @workgroup_size(8, 8)
fn reflections(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = pixel_of(id);
    if !pixel.is_some {
        return;
    }
    let surface = surface_of(pixel.index);
    var sum = vec4<f32>(0.0);
    // Rays of a mirror are one.
    let count = select(job.rays, 1u, job.roughness == 0.0);
    if surface.is_some {
        let to = surface.position - picture.eye;
        let view = select(vec3<f32>(0.0), to / length(to), any(to != vec3<f32>(0.0)));
        let middle = view - surface.normal * (2.0 * dot(view, surface.normal));
        let pair = pair_of(middle);
        for (var i = 0u; i < count; i++) {
            let off = disk(square(pixel.index, i, job.seed)) * job.roughness;
            let direction = normalize(middle + pair.x * off.x + pair.y * off.y);
            // A ray below the surface meets it.
            if dot(direction, surface.normal) <= 0.0 {
                continue;
            }
            let distance = distance_to(Query(surface.position, surface.normal, direction, job.reach));
            if distance < 0.0 {
                sum += vec4<f32>(job.sky, 1.0);
                continue;
            }
            let shown = shown_at(surface.position + direction * distance, direction, 1.0);
            if shown.is_some {
                // The outer tenth fades.
                let to_edge = min(shown.at, size() - shown.at) / (0.1 * size());
                sum += vec4<f32>(first[shown.pixel].xyz * clamp(min(to_edge.x, to_edge.y), 0.0, 1.0), 0.0);
            }
        }
    }
    made[pixel.index] = sum / f32(count);
}

/// First: the picture's light. Second: what is mirrored. Made: both, as Schlick approximates it.
@compute @workgroup_size(8, 8)
fn mix_mirrored(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = pixel_of(id);
    if !pixel.is_some {
        return;
    }
    let surface = surface_of(pixel.index);
    var light = first[pixel.index].xyz;
    if surface.is_some {
        let to_eye = picture.eye - surface.position;
        let far = length(to_eye);
        let cosine = clamp(select(0.0, dot(to_eye, surface.normal) / far, far > 0.0), 0.0, 1.0);
        let off = 1.0 - cosine;
        let share = MIRRORED + (1.0 - MIRRORED) * (off * off) * (off * off) * off;
        light = light * (1.0 - share) + second[pixel.index].xyz * share;
    }
    made[pixel.index] = vec4<f32>(light, 0.0);
}

/// Made: light that the fog scatters to the eye, and the share of light that gets through.
@compute @workgroup_size(8, 8)
fn fog(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = pixel_of(id);
    if !pixel.is_some {
        return;
    }
    let surface = surface_of(pixel.index);
    let at = (vec2<f32>(pixel.at) + vec2<f32>(0.5)) / size() * 2.0 - vec2<f32>(1.0);
    let way = picture.forward + picture.right * (at.x * picture.half_width) - picture.up * (at.y * picture.half_height);
    let direction = normalize(way);
    let far = select(job.reach, min(distance(surface.position, picture.eye), job.reach), surface.is_some);
    let step = far / f32(job.rays);
    var sum = vec3<f32>(0.0);
    for (var ray = 0u; ray < job.rays; ray++) {
        let jitter = square(pixel.index, ray, job.seed);
        let away = (f32(ray) + jitter.x) * step;
        let place = picture.eye + direction * away;
        let scattered = job.density * exp(-job.density * away) * step / (4.0 * PI);
        for (var i = 0u; i < job.lamps; i++) {
            let light = light_at(lamps[i], place);
            if all(light == vec3<f32>(0.0)) {
                continue;
            }
            let to = point_of(lamps[i], place, jitter) - place;
            let length = length(to);
            if !is_in_the_way(Query(place, vec3<f32>(0.0), to / length, length)) {
                sum += light * (exp(-job.density * length) * scattered);
            }
        }
    }
    made[pixel.index] = vec4<f32>(sum, exp(-job.density * far));
}

/// First: the picture's light. Second: fog. Made: the picture behind it.
@compute @workgroup_size(8, 8)
fn veil(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = pixel_of(id);
    if pixel.is_some {
        let veil = second[pixel.index];
        // Lamps are given by what a surface sends to the eye, which is pi times less than what it gets.
        made[pixel.index] = vec4<f32>(first[pixel.index].xyz * veil.w + veil.xyz * PI, 0.0);
    }
}

// Filters: src/effects/denoise.rs.

fn row_weight(i: i32) -> f32 {
    return select(select(0.375, 0.25, abs(i) == 1), 0.0625, abs(i) == 2);
}

fn is_same(surface: Surface, other: Surface) -> bool {
    let off = abs(dot(other.position - surface.position, surface.normal));
    return surface.is_some && other.is_some && off <= job.distance && dot(other.normal, surface.normal) >= job.cosine;
}

/// A pixel beside another, and whether it lies in the picture.
fn beside(pixel: Pixel, i: i32, j: i32, apart: i32) -> Pixel {
    let at = vec2<i32>(pixel.at) + vec2<i32>(i, j) * apart;
    let is_some = all(at >= vec2<i32>(0)) && at.x < i32(picture.width) && at.y < i32(picture.height);
    return Pixel(vec2<u32>(at), u32(at.y) * picture.width + u32(at.x), is_some);
}

/// First: shares of rays. Made: the pixel's own, the mean around it, and one over what that may differ by.
@compute @workgroup_size(8, 8)
fn shares_around(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = pixel_of(id);
    if !pixel.is_some {
        return;
    }
    let surface = surface_of(pixel.index);
    var sum = 0.0;
    var count = 0.0;
    for (var j = -2; j <= 2; j++) {
        for (var i = -2; i <= 2; i++) {
            let other = beside(pixel, i, j, 1);
            if other.is_some && (other.index == pixel.index || is_same(surface, surface_of(other.index))) {
                sum += dot(first[other.index].xyz, vec3<f32>(1.0 / 3.0));
                count += 1.0;
            }
        }
    }
    let mean = sum / count;
    let rays = ACROSS * ACROSS * f32(job.rays);
    let chance = (mean * rays + 1.0) / (rays + 2.0);
    let own = dot(first[pixel.index].xyz, vec3<f32>(1.0 / 3.0));
    let strictness = sqrt(rays / (chance * (1.0 - chance))) / (MANY + FEW / f32(job.rays));
    made[pixel.index] = vec4<f32>(own, mean, strictness, 0.0);
}

/// First: values. Second: of shares, what is around. Made: the mean of values of near pixels that are alike. `kind` 0: whatever they show, 1: of the same surface,
/// 2: and with such a share around them. The fourth component stays.
fn filtered(pixel: Pixel, kind: u32) -> vec4<f32> {
    let surface = surface_of(pixel.index);
    let own = first[pixel.index];
    var here = vec3<f32>(0.0);
    if kind == 2u {
        here = second[pixel.index].xyz;
    }
    var sum = vec3<f32>(0.0);
    var weights = 0.0;
    for (var j = -2; j <= 2; j++) {
        for (var i = -2; i <= 2; i++) {
            let other = beside(pixel, i, j, job.apart);
            if !other.is_some {
                continue;
            }
            var weight = row_weight(i) * row_weight(j);
            if other.index != pixel.index && kind > 0u {
                if !is_same(surface, surface_of(other.index)) {
                    continue;
                }
                if kind == 2u {
                    let off = (second[other.index].xy - here.xy) * here.z / vec2<f32>(OWN * ACROSS, 1.0);
                    // Nearly the exponential of its negative.
                    let left = max(1.0 - dot(off, off) * 0.125, 0.0);
                    let fourth = (left * left) * (left * left);
                    weight *= fourth * fourth;
                }
            }
            sum += first[other.index].xyz * weight;
            weights += weight;
        }
    }
    return vec4<f32>(sum / weights, own.w);
}

@compute @workgroup_size(8, 8)
fn blur(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = pixel_of(id);
    if pixel.is_some {
        made[pixel.index] = filtered(pixel, 0u);
    }
}

@compute @workgroup_size(8, 8)
fn smooth_surfaces(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = pixel_of(id);
    if pixel.is_some {
        made[pixel.index] = filtered(pixel, 1u);
    }
}

@compute @workgroup_size(8, 8)
fn smooth_shares(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = pixel_of(id);
    if pixel.is_some {
        made[pixel.index] = filtered(pixel, 2u);
    }
}
