// Rays through a shadow volume: the walk of src/trace/walk.rs and the samples of src/trace/steps.rs, number for number.
//
// Other kernels follow this text. They get group 0, `walk_first`, `steps_first`, `is_blocked`, and `looks`. Integers wrap around in WGSL, which the
// walk relies on; where and why is said in walk.rs.

/// A shadow volume on the device.
struct ShadowVolume {
    /// Voxels along each axis.
    voxels: vec3<i32>,
    /// Level of the cells that are one byte of the last mip.
    coarsest: u32,
}

/// How finely a ray is traced; see `Fidelity` in src/trace/mod.rs.
struct Fidelity {
    coarsest: u32,
    fine_until: u32,
}

/// A ray in whole numbers; see src/trace/ray.rs. The third component of `direction` and `end` lie as the processor has them.
struct Ray {
    origin: vec3<i32>,
    major: u32,
    direction: vec3<i32>,
    end: i32,
}

/// Samples in fixed steps; see src/trace/steps.rs.
struct Steps {
    step: vec3<i32>,
    samples: u32,
}

/// The first full cell on a ray.
struct Hit {
    cell: vec3<i32>,
    level: u32,
    /// The time is `numerator / denominator`. Of the walk: 1/256 of a voxel along an axis, and the direction's component on that axis. Of
    /// samples: 2^-16 of a voxel along the ray's major axis, and the number of the sample among those of its step length.
    numerator: i32,
    denominator: i32,
    /// 1 if there is a cell, else 0, and all else is 0.
    is_hit: u32,
}

@group(0) @binding(0) var<uniform> shadow: ShadowVolume;
@group(0) @binding(1) var shadow_bytes: texture_3d<u32>;

const FRACTION_BITS: u32 = 8u;
const UNIT: i32 = 256;
const LONGEST: f32 = 65535.0;
const MOST_VOXELS: i32 = 8191;
const SAMPLE_BITS: u32 = 16u;
const MAX_LEVEL: u32 = 6u;
const NO_AXIS: vec3<bool> = vec3<bool>(false);
const NO_HIT: Hit = Hit(vec3<i32>(0), 0u, 0, 0, 0u);

/// How many cells the volume was asked for since the invocation began.
var<private> looks: u32 = 0u;

/// To the next whole number, halves away from zero.
fn round_away(x: vec3<f32>) -> vec3<i32> {
    return vec3<i32>(sign(x) * floor(abs(x) + vec3<f32>(0.5)));
}

/// `Ray::new` in single precision: the ray from `origin` that is `length` long, both in voxels. The direction may have any length but 0; a ray ends after 8191 voxels
/// along its major axis. Each number is that of the processor, or next to it where single precision rounds otherwise.
fn new_ray(origin: vec3<f32>, direction: vec3<f32>, length_in_voxels: f32) -> Ray {
    let size = abs(direction);
    var major = select(0u, 1u, size.y > size.x);
    major = select(major, 2u, size.z > size[major]);
    let along = direction / size[major];
    let reach = min(length_in_voxels * f32(UNIT) / length(along), f32(MOST_VOXELS * UNIT));
    let start = round_away(origin * f32(UNIT));
    let end = start[major] + round_away(vec3<f32>(reach * sign(along[major]))).x;
    return Ray(start, major, round_away(along * LONGEST), end);
}

/// Whether a cell of a level has a voxel. Cells outside of the volume have none.
fn is_full(level: u32, cell: vec3<i32>) -> bool {
    looks += 1u;
    // A byte is a cell of level 1; voxels are its bits.
    let of_bit = level == 0u;
    let mip = select(level - 1u, 0u, of_bit);
    let byte = select(cell, cell >> vec3<u32>(1u), of_bit);
    // Negative places are large as unsigned ones.
    if any(vec3<u32>(cell) > vec3<u32>((shadow.voxels - vec3<i32>(1)) >> vec3<u32>(level))) {
        return false;
    }
    let odd = vec3<u32>(cell) & vec3<u32>(1u);
    let mask = select(0xffu, 1u << (odd.x | (odd.y << 1u) | (odd.z << 2u)), of_bit);
    return (textureLoad(shadow_bytes, byte, mip).x & mask) != 0u;
}

/// The level that is full resolution at so many voxels from the origin.
fn finest_level(fidelity: Fidelity, voxels: u32, coarsest: u32) -> u32 {
    if fidelity.fine_until == 0u {
        return 0u;
    }
    return min(firstLeadingBit(voxels / fidelity.fine_until + 1u), coarsest);
}

fn coarsest_level(fidelity: Fidelity) -> u32 {
    return min(min(fidelity.coarsest, shadow.coarsest), MAX_LEVEL);
}

/// A ray that goes up on all axes: those on which it goes down are mirrored.
struct Walk {
    origin: vec3<i32>,
    direction: vec3<i32>,
    /// -1 on mirrored axes, else 0: `cell ^ flip` is the cell in the volume.
    flip: vec3<i32>,
    major: u32,
    end: i32,
    /// The voxel of the origin, the upper one where it lies between two.
    start: vec3<i32>,
    /// Axes on which the ray lies between two voxels all the way.
    between: vec3<bool>,
    /// Axes on which it does not advance.
    still: vec3<bool>,
    /// The greatest voxel on each axis.
    last: vec3<i32>,
    coarsest: u32,
    fidelity: Fidelity,
}

/// A time on the ray.
struct Time {
    numerator: i32,
    denominator: i32,
}

fn new_walk(ray: Ray, fidelity: Fidelity) -> Walk {
    var walk: Walk;
    let flip = ray.direction >> vec3<u32>(31u);
    walk.flip = flip;
    walk.origin = (ray.origin ^ flip) - flip;
    walk.direction = abs(ray.direction);
    walk.major = ray.major;
    walk.end = (ray.end ^ flip[ray.major]) - flip[ray.major];
    walk.start = walk.origin >> vec3<u32>(FRACTION_BITS);
    walk.still = walk.direction == vec3<i32>(0);
    walk.between = walk.still & ((walk.origin & vec3<i32>(UNIT - 1)) == vec3<i32>(0));
    // The first voxel of a mirrored axis is its last: ~0.
    walk.last = select(shadow.voxels - vec3<i32>(1), vec3<i32>(-1), flip != vec3<i32>(0));
    walk.coarsest = coarsest_level(fidelity);
    walk.fidelity = fidelity;
    return walk;
}

/// Whether planes, one of each axis, lie ahead of the ray at a time (positive), on it (0), or behind.
fn ahead(walk: Walk, plane: vec3<i32>, time: Time) -> vec3<i32> {
    return (plane - walk.origin) * time.denominator - time.numerator * walk.direction;
}

/// A cell and whether there is one.
struct Found {
    cell: vec3<i32>,
    is_found: bool,
}

/// A full cell of those that are `cell` on each axis, or `beside` on those axes where both are possible.
fn any_full(walk: Walk, level: u32, cell: vec3<i32>, beside: vec3<i32>, both: vec3<bool>) -> Found {
    let all = dot(select(vec3<u32>(0u), vec3<u32>(1u, 2u, 4u), both), vec3<u32>(1u));
    var choice = 0u;
    loop {
        let other = (vec3<u32>(choice) & vec3<u32>(1u, 2u, 4u)) != vec3<u32>(0u);
        let place = select(cell, beside, other);
        if is_full(level, place ^ walk.flip) {
            return Found(place, true);
        }
        if choice == all {
            break;
        }
        // The next greater number that has no bit which `all` has not.
        choice = (choice - all) & all;
    }
    return Found(cell, false);
}

/// A full voxel that touches the ray at a time. `cell`: the cell of a level that the ray is in at that time.
fn touched(walk: Walk, cell: vec3<i32>, level: u32, time: Time) -> Found {
    var voxel = cell << vec3<u32>(level);
    for (var below = level; below > 0u; below--) {
        let half = voxel + vec3<i32>(1 << (below - 1u));
        voxel = select(voxel, half, ahead(walk, half << vec3<u32>(FRACTION_BITS), time) <= vec3<i32>(0));
    }
    voxel = select(voxel, walk.start, walk.still);
    let on_plane = ahead(walk, voxel << vec3<u32>(FRACTION_BITS), time) == vec3<i32>(0);
    return any_full(walk, 0u, voxel, voxel - vec3<i32>(1), select(on_plane, walk.between, walk.still));
}

/// The cell, or the one beside it where the ray lies between two, if it is full.
fn full(walk: Walk, level: u32, cell: vec3<i32>) -> Found {
    let beside = (walk.start - vec3<i32>(1)) >> vec3<u32>(level);
    return any_full(walk, level, cell, beside, walk.between);
}

fn hit_of(walk: Walk, cell: vec3<i32>, level: u32, time: Time) -> Hit {
    return Hit(cell ^ walk.flip, level, time.numerator, time.denominator, 1u);
}

/// The first full cell that a ray touches, edges and corners of cells included.
fn walk_first(ray: Ray, fidelity: Fidelity) -> Hit {
    let walk = new_walk(ray, fidelity);
    var level = walk.coarsest;
    var cell = walk.start >> vec3<u32>(level);
    var time = Time(0, walk.direction[walk.major]);
    // At a point in planes of several axes, or at the origin, voxels are touched that the ray does not enter.
    var touches_others = any((walk.origin & vec3<i32>(UNIT - 1)) == vec3<i32>(0));
    var leaves_parent = false;
    var leaves_volume = false;
    loop {
        if touches_others {
            let found = touched(walk, cell, level, time);
            if found.is_found {
                return hit_of(walk, found.cell, 0u, time);
            }
        }
        if leaves_volume {
            break;
        }
        if leaves_parent && level < walk.coarsest {
            level += 1u;
            cell = cell >> vec3<u32>(1u);
        }
        let here = full(walk, level, cell);
        if here.is_found {
            let voxels = max((cell[walk.major] << level) - walk.start[walk.major], 0);
            if level <= finest_level(fidelity, u32(voxels), walk.coarsest) {
                return hit_of(walk, here.cell, level, time);
            }
            level -= 1u;
            let middle = ((2 * cell + vec3<i32>(1)) << vec3<u32>(level)) << vec3<u32>(FRACTION_BITS);
            let distance = ahead(walk, middle, time);
            let child = 2 * cell + select(vec3<i32>(0), vec3<i32>(1), distance <= vec3<i32>(0));
            cell = select(child, walk.start >> vec3<u32>(level), walk.still);
            touches_others = any((distance == vec3<i32>(0)) & !walk.still);
            leaves_parent = false;
            continue;
        }
        // Which axes are crossed next.
        let upper = ((cell + vec3<i32>(1)) << vec3<u32>(level)) << vec3<u32>(FRACTION_BITS);
        let reach = upper - walk.origin;
        let axes = vec3<u32>(0u, 1u, 2u);
        time = Time(reach[walk.major], walk.direction[walk.major]);
        var together = axes == vec3<u32>(walk.major);
        for (var axis = 0u; axis < 3u; axis++) {
            if axis == walk.major || walk.still[axis] {
                continue;
            }
            let distance = reach[axis] * time.denominator - time.numerator * walk.direction[axis];
            if distance < 0 {
                time = Time(reach[axis], walk.direction[axis]);
                together = NO_AXIS;
            }
            together = together | ((axes == vec3<u32>(axis)) & vec3<bool>(distance <= 0));
        }
        let to_end = walk.end - walk.origin[walk.major];
        if upper[walk.major] > walk.end
            && to_end * time.denominator - time.numerator * walk.direction[walk.major] < 0 {
            break;
        }
        cell += select(vec3<i32>(0), vec3<i32>(1), together);
        leaves_parent = any(together & ((cell & vec3<i32>(1)) == vec3<i32>(0)));
        leaves_volume = any(together & (cell > (walk.last >> vec3<u32>(level))));
        touches_others = dot(select(vec3<u32>(0u), vec3<u32>(1u), together), vec3<u32>(1u)) > 1u;
    }
    return NO_HIT;
}

/// Whether a ray touches a full cell.
fn is_blocked(ray: Ray, fidelity: Fidelity) -> bool {
    return walk_first(ray, fidelity).is_hit != 0u;
}

/// Samples of one step length. Places are in 2^-16 of a voxel, from `base`, which is in voxels.
struct Part {
    base: vec3<i32>,
    at: vec3<i32>,
    step: vec3<i32>,
    samples: u32,
    finest: u32,
    coarsest: u32,
}

fn sample_place(part: Part, sample: u32) -> vec3<i32> {
    return part.at + part.step * i32(sample);
}

/// The first sample behind a cell, which is counted from the base.
fn behind(part: Part, cell: vec3<i32>, level: u32) -> u32 {
    var first = 0xffffffffu;
    for (var axis = 0u; axis < 3u; axis++) {
        let at = part.at[axis];
        let step = part.step[axis];
        if step == 0 {
            continue;
        }
        let is_up = step > 0;
        let end = ((cell[axis] + select(0, 1, is_up)) << level) << SAMPLE_BITS;
        let way = select(at - end, end - at + step - 1, is_up);
        first = min(first, u32(way / abs(step) + select(1, 0, is_up)));
    }
    return first;
}

/// The first sample of a part in a full cell. `numerator` is where it lies, from the base along axis `major`.
fn part_first(part: Part, major: u32) -> Hit {
    var sample = 0u;
    var level = part.coarsest;
    while sample < part.samples {
        let place = sample_place(part, sample);
        let at = place >> vec3<u32>(SAMPLE_BITS);
        let voxel = part.base + at;
        let cell = voxel >> vec3<u32>(level);
        if is_full(level, cell) {
            if level <= part.finest {
                return Hit(cell, level, place[major], i32(sample), 1u);
            }
            level -= 1u;
            continue;
        }
        let above = (part.step >= vec3<i32>(0)) & (voxel >= shadow.voxels);
        let below = (part.step <= vec3<i32>(0)) & (voxel < vec3<i32>(0));
        if any(above | below) {
            break;
        }
        let next = behind(part, at >> vec3<u32>(level), level);
        if level < part.coarsest {
            let bits = vec3<u32>(SAMPLE_BITS + level + 1u);
            let after = sample_place(part, min(next, part.samples));
            level += select(0u, 1u, any((place >> bits) != (after >> bits)));
        }
        sample = next;
    }
    return NO_HIT;
}

/// `(fine_until << 16) / step + 1`, or 2^32 - 1 if that is greater. `step` is from 1 to 2^22.
fn samples_until(fine_until: u32, step: u32) -> u32 {
    let whole = fine_until / step;
    if whole >= 0x10000u {
        return 0xffffffffu;
    }
    // Eight bits at a time: the rest stays below 2^30.
    let first = (fine_until % step) << 8u;
    let second = (first % step) << 8u;
    let quotient = (whole << 16u) + ((first / step) << 8u) + second / step;
    return quotient + select(1u, 0u, quotient == 0xffffffffu);
}

/// The first sample of a ray in a full cell. Where the fidelity is coarse, steps are twice as long for each level.
fn steps_first(ray: Ray, steps: Steps, fidelity: Fidelity) -> Hit {
    var part: Part;
    part.base = (ray.origin >> vec3<u32>(FRACTION_BITS)) & vec3<i32>(~((1 << MAX_LEVEL) - 1));
    let start = (ray.origin - (part.base << vec3<u32>(FRACTION_BITS))) << vec3<u32>(SAMPLE_BITS - FRACTION_BITS);
    part.at = start;
    part.step = steps.step;
    part.finest = 0u;
    part.coarsest = coarsest_level(fidelity);
    let each = samples_until(fidelity.fine_until, u32(abs(steps.step[ray.major])));
    var left = steps.samples;
    loop {
        let is_last = fidelity.fine_until == 0u || part.finest == part.coarsest;
        part.samples = select(min(left, each), left, is_last);
        var hit = part_first(part, ray.major);
        if hit.is_hit != 0u {
            hit.numerator = abs(hit.numerator - start[ray.major]);
            return hit;
        }
        if part.samples == left {
            break;
        }
        left -= part.samples;
        left = left / 2u + (left & 1u);
        part.at = sample_place(part, part.samples);
        part.step = part.step * 2;
        part.finest += 1u;
    }
    return NO_HIT;
}
