// Shades hits, as `esvo_core::shading` does on the processor. Stands behind the prelude and `cast.wgsl`: it reads attributes through
// `slot_at`, where they lie in the image (specification, sections 6 to 8), and casts shadow rays.

struct Object {
    // Columns of octree space to mesh space, and of its transposed inverse.
    to_mesh: array<vec4<f32>, 3>,
    normals: array<vec4<f32>, 3>,
    // Those of its View.
    origin: vec4<f32>,
    base: vec4<f32>,
    dx: vec4<f32>,
    dy: vec4<f32>,
    // Slot of the root, size of a pixel (bits), deepest level, zero.
    numbers: vec4<u32>,
}

struct Shading {
    to_light: vec4<f32>,
    eye: vec4<f32>,
    width: u32,
    height: u32,
    // Words of a hit: 4, or 5 with the number of its object; 0 where nothing was cast.
    stride: u32,
    mode: u32,
    flags: u32,
    objects: u32,
    far: f32,
    padding: u32,
}

@group(2) @binding(0) var<uniform> shading: Shading;
@group(2) @binding(1) var<storage, read> objects: array<Object>;
@group(2) @binding(2) var<storage, read> hit_words: array<u32>;
@group(2) @binding(3) var<storage, read_write> pixels: array<u32>;

const AMBIENT: f32 = 0.18;
const DIFFUSE: f32 = 0.78;
const SPECULAR: f32 = 0.12;
const SHININESS: f32 = 24.0;
const PLAIN_COLOR: vec3<f32> = vec3<f32>(0.75);
const SKY_TOP: vec3<f32> = vec3<f32>(0.45, 0.62, 0.87);
const SKY_BOTTOM: vec3<f32> = vec3<f32>(0.90, 0.93, 0.96);

const MODE_SHADED: u32 = 0u;
const MODE_ITERATIONS: u32 = 1u;
const MODE_NORMALS: u32 = 2u;
const MODE_LEVELS: u32 = 3u;
const MODE_SIZE: u32 = 4u;
const MODE_DEPTH: u32 = 5u;
const MODE_AMBIENT: u32 = 6u;

const FLAG_LIGHT: u32 = 1u;
const FLAG_NORMALS: u32 = 2u;
const FLAG_COLORS: u32 = 4u;
const FLAG_SUN: u32 = 8u;
const FLAG_SHADOWS: u32 = 16u;

fn word_at(word: u32) -> u32 {
    let pair = slot_at(word >> 1u);
    return select(pair.x, pair.y, (word & 1u) != 0u);
}

// An attachment: its first slot, or 0 if the block has none of this type.
struct Attributes {
    color: u32,
    color_type: u32,
    normal: u32,
    normal_type: u32,
    ambient: u32,
}

// Where the attributes of a block are. `info` is the slot of its info section.
fn attributes_of(info: u32) -> Attributes {
    var found = Attributes(0u, 0u, 0u, 0u, 0u);
    let count = min(slot_at(info + 2u).y, 64u);
    for (var k = 0u; k < count; k++) {
        let entry = slot_at(info + 4u + 2u * k);
        let at = info + (entry.y >> 3u);
        let kind = entry.x;
        if kind == 1u || kind == 3u || kind == 5u || kind == 7u {
            found.color = at;
            found.color_type = kind;
        }
        if kind == 2u || kind == 6u || kind == 7u {
            found.normal = at;
            found.normal_type = kind;
        }
        if kind == 4u {
            found.ambient = at;
        }
    }
    return found;
}

fn fraction(word: u32) -> f32 {
    return f32(word) * 2.3283064365386963e-10;
}

fn raw_normal(w: u32) -> vec3<f32> {
    let t = select(1.0, -1.0, (w >> 31u) != 0u);
    let u = f32(bitcast<i32>(w << 3u)) * 4.656612873077393e-10;
    let v = f32(bitcast<i32>(w << 18u)) * 4.656612873077393e-10;
    let axis = (w >> 29u) & 3u;
    if axis == 0u {
        return vec3<f32>(t, u, v);
    }
    if axis == 1u {
        return vec3<f32>(v, t, u);
    }
    return vec3<f32>(u, v, t);
}

fn normalized(v: vec3<f32>) -> vec3<f32> {
    let size = length(v);
    return select(vec3<f32>(0.0, 0.0, 1.0), v / max(size, 1e-30), size > 0.0);
}

fn bytes_of(w: u32) -> vec4<f32> {
    return vec4<f32>(f32(w & 255u), f32((w >> 8u) & 255u), f32((w >> 16u) & 255u), f32(w >> 24u)) / 255.0;
}

fn color_block(at: u32, slot: u32, texel: u32) -> vec3<f32> {
    let block = slot_at(at + (slot >> 1u));
    let w = block.x;
    let a = vec3<f32>(fraction(w << 16u), fraction(w << 21u), fraction(w << 27u));
    let b = vec3<f32>(fraction(w), fraction(w << 5u), fraction(w << 11u));
    let index = (block.y >> (2u * texel)) & 3u;
    let share = select(select(f32(index & 1u), 0.33333334, index == 2u), 0.6666667, index == 3u);
    return mix(a, b, share);
}

fn grid_axis(h: u32) -> vec3<f32> {
    let e = (h >> 16u) & 15u;
    // 2^(e - 41)
    let scale = bitcast<f32>((e + 86u) << 23u);
    return vec3<f32>(f32(bitcast<i32>(h)), f32(bitcast<i32>(h << 4u)), f32(bitcast<i32>(h << 8u))) * scale;
}

fn normal_block(at: u32, slot: u32, texel: u32) -> vec3<f32> {
    let first = slot_at(at + (slot & ~1u));
    let second = slot_at(at + (slot & ~1u) + 1u);
    let cu = f32((first.y >> (2u * texel)) & 3u) * 0.6666667 - 1.0;
    let cv = f32((second.y >> (2u * texel)) & 3u) * 0.6666667 - 1.0;
    return normalized(raw_normal(first.x) + cu * grid_axis(second.x << 16u) + cv * grid_axis(second.x));
}

// A value of plain colours or normals; 0 without one is no normal, and black with alpha 0.
fn plain_value(at: u32, slot: u32, child: u32, valid: u32) -> vec2<u32> {
    let entry = word_at(2u * at + slot);
    let mask = entry & 255u;
    if entry == 0u || (mask == 0u && valid == 0u) {
        return vec2<u32>(0u);
    }
    let own = ((mask >> child) & 1u) != 0u;
    let before = select(countOneBits(mask), countOneBits(mask & ((1u << child) - 1u)), own);
    return vec2<u32>(word_at(2u * at + (entry >> 8u) + before), 1u);
}

struct Corners {
    color: vec4<f32>,
    normal: vec3<f32>,
    found: bool,
}

fn corners_at(at: u32, slot: u32, child: u32, place: vec3<f32>) -> Corners {
    let entry = slot_at(at + slot);
    let mask = entry.x & 0x7ffffffu;
    let own = vec3<u32>(child & 1u, (child >> 1u) & 1u, child >> 2u);
    var cell = true;
    for (var k = 0u; k < 8u; k++) {
        let point = own.x + (k & 1u) + 3u * (own.y + ((k >> 1u) & 1u)) + 9u * (own.z + (k >> 2u));
        cell = cell && ((mask >> point) & 1u) != 0u;
    }
    var found = Corners(vec4<f32>(0.0), vec3<f32>(0.0), false);
    if !cell && (entry.x & 0x8000000u) == 0u {
        return found;
    }
    let q = select((vec3<f32>(own) + place) * 0.5, place, cell);
    var sum = 0.0;
    for (var k = 0u; k < 8u; k++) {
        let bit = vec3<u32>(k & 1u, (k >> 1u) & 1u, k >> 2u);
        let point = own.x + bit.x + 3u * (own.y + bit.y) + 9u * (own.z + bit.z);
        let number = select(countOneBits(mask) + k, countOneBits(mask & ((1u << point) - 1u)), cell);
        let value = slot_at(at + (entry.y >> 1u) + number);
        if (value.x >> 24u) == 0u {
            continue;
        }
        let along = select(vec3<f32>(1.0) - q, q, bit == vec3<u32>(1u));
        let weight = along.x * along.y * along.z;
        sum += weight;
        found.color += bytes_of(value.x) * weight;
        found.normal += normalize(raw_normal(value.y)) * weight;
    }
    if sum > 0.0 {
        found.color /= sum;
        found.normal = normalized(found.normal);
        found.found = true;
    }
    return found;
}

fn decode_srgb(c: vec3<f32>) -> vec3<f32> {
    return select(pow((c + 0.055) / 1.055, vec3<f32>(2.4)), c / 12.92, c <= vec3<f32>(0.04045));
}

fn encode_srgb(linear: vec3<f32>) -> vec3<f32> {
    let c = clamp(linear, vec3<f32>(0.0), vec3<f32>(1.0));
    return select(1.055 * pow(c, vec3<f32>(1.0 / 2.4)) - 0.055, c * 12.92, c <= vec3<f32>(0.0031308));
}

fn heat(value: f32) -> vec3<f32> {
    let stops = array<vec3<f32>, 5>(
        vec3<f32>(0.0), vec3<f32>(0.2, 0.1, 0.45), vec3<f32>(0.85, 0.2, 0.2), vec3<f32>(1.0, 0.8, 0.1), vec3<f32>(1.0),
    );
    let at = clamp(value, 0.0, 1.0) * 4.0;
    let stop = min(u32(at), 3u);
    return mix(stops[stop], stops[stop + 1u], at - f32(stop));
}

fn to_mesh(object: u32, v: vec3<f32>) -> vec3<f32> {
    return objects[object].to_mesh[0].xyz * v.x + objects[object].to_mesh[1].xyz * v.y + objects[object].to_mesh[2].xyz * v.z;
}

fn to_octree(object: u32, v: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(dot(objects[object].normals[0].xyz, v), dot(objects[object].normals[1].xyz, v), dot(objects[object].normals[2].xyz, v));
}

fn facing(normal: vec3<f32>, direction: vec3<f32>) -> vec3<f32> {
    return select(normal, -normal, dot(normal, direction) > 0.0);
}

// Whether something is between a point of mesh space, relative to the eye, and the sun. `size` is the edge of the voxel there.
fn in_shadow(start: vec3<f32>, way: vec3<f32>, size: f32) -> bool {
    for (var k = 0u; k < shading.objects; k++) {
        if objects[k].numbers.x == 0xffffffffu {
            continue;
        }
        var ray: Ray;
        ray.root = objects[k].numbers.x;
        ray.origin = objects[k].origin.xyz + to_octree(k, start);
        let direction = to_octree(k, way);
        let stretch = length(direction);
        ray.direction = direction / stretch;
        ray.t_min = (size * 1.75) * stretch + 1e-6;
        ray.t_max = 64.0;
        if cast_ray(ray).voxel != MISS_VOXEL {
            return true;
        }
    }
    return false;
}

fn packed(color: vec3<f32>, code: u32) -> u32 {
    let bytes = vec3<u32>(clamp(color, vec3<f32>(0.0), vec3<f32>(1.0)) * 255.0 + 0.5);
    return bytes.x | (bytes.y << 8u) | (bytes.z << 16u) | (code << 24u);
}

@compute @workgroup_size(8, 8)
fn shade_pass(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= shading.width || id.y >= shading.height {
        return;
    }
    let pixel = id.y * shading.width + id.x;
    let word = pixel * shading.stride;
    var voxel = MISS_VOXEL;
    var iterations = 0u;
    if shading.stride != 0u {
        voxel = hit_words[word + 2u];
        iterations = hit_words[word + 3u];
    }
    if voxel == MISS_VOXEL {
        var color = vec3<f32>(0.0);
        if shading.mode == MODE_SHADED {
            color = mix(SKY_TOP, SKY_BOTTOM, (f32(id.y) + 0.5) / f32(shading.height));
        }
        if shading.mode == MODE_ITERATIONS {
            color = heat(f32(iterations) / 64.0);
        }
        pixels[pixel] = packed(color, 0u);
        return;
    }
    let t = bitcast<f32>(hit_words[word]);
    let slot = hit_words[word + 1u];
    var object = 0u;
    if shading.stride == 5u {
        object = hit_words[word + 4u];
    }
    let child = voxel & 7u;
    let size = bitcast<f32>(((voxel >> 8u) + 104u) << 23u);
    let pixel_size = bitcast<f32>(objects[object].numbers.y);
    let footprint = size / (pixel_size * t);
    let code = u32(log2(max(footprint, 1.0)) * 32.0 + 0.5);
    let at = vec2<f32>(id.xy) + 0.5;
    let ray = objects[object].base.xyz + objects[object].dx.xyz * at.x + objects[object].dy.xyz * at.y;
    let direction = to_mesh(object, ray);

    let page = slot & ~1023u;
    let info = page + slot_at(page).x;
    let own = slot - (info - slot_at(info).y);
    let texel = child + 8u * (slot & 1u);
    let descriptor = slot_at(slot);
    let valid = (descriptor.x >> 8u) & 255u;
    let attributes = attributes_of(info);
    // Moved a little along the ray: on the face itself, rounding could select the voxel before it.
    let point = objects[object].origin.xyz + ray * t;
    let cells = (point + normalize(ray) * (size * 1e-3)) / size;
    let place = cells - floor(cells);

    var color = PLAIN_COLOR;
    var normal = vec3<f32>(0.0);
    if attributes.color_type == 7u {
        let corners = corners_at(attributes.color, own, child, place);
        if corners.found {
            color = corners.color.xyz;
            normal = corners.normal;
        }
    } else if attributes.color_type == 1u {
        color = color_block(attributes.color, own, texel);
    } else if attributes.color_type == 3u {
        color = bytes_of(slot_at(attributes.color).x).xyz;
    } else if attributes.color_type == 5u {
        let value = plain_value(attributes.color, own, child, valid);
        color = select(color, bytes_of(value.x).xyz, value.y != 0u);
    }
    if attributes.normal_type == 2u {
        normal = normal_block(attributes.normal, own, texel);
    } else if attributes.normal_type == 6u {
        let value = plain_value(attributes.normal, own, child, valid);
        if value.y != 0u {
            normal = normalized(raw_normal(value.x));
        }
    }
    if (shading.flags & FLAG_COLORS) == 0u {
        color = PLAIN_COLOR;
    }
    if (shading.flags & FLAG_NORMALS) == 0u {
        normal = vec3<f32>(0.0);
    }
    if all(normal == vec3<f32>(0.0)) {
        // That of the contour, or of the face of the cube by which the ray entered.
        var side = vec3<f32>(0.0);
        if (shading.flags & FLAG_NORMALS) != 0u && ((descriptor.y >> child) & 1u) != 0u {
            let w = word_at(2u * slot + (descriptor.y >> 8u) + countOneBits(descriptor.y & ((1u << child) - 1u)));
            side = vec3<f32>(f32(bitcast<i32>(w << 14u)), f32(bitcast<i32>(w << 20u)), f32(bitcast<i32>(w << 26u))) * 1.4901161193847656e-8;
        } else {
            let grid = point / size;
            let off = abs(grid - round(grid));
            if off.x <= off.y && off.x <= off.z {
                side.x = 1.0;
            } else if off.y <= off.z {
                side.y = 1.0;
            } else {
                side.z = 1.0;
            }
        }
        let turned = objects[object].normals[0].xyz * side.x + objects[object].normals[1].xyz * side.y + objects[object].normals[2].xyz * side.z;
        normal = normalize(facing(turned, direction));
    }
    var open = 1.0;
    if attributes.ambient != 0u {
        let block = slot_at(attributes.ambient + (own >> 1u));
        let bit = 3u * texel + 16u;
        var weight = block.x >> min(bit, 31u);
        if bit >= 32u {
            weight = block.y >> (bit - 32u);
        } else if bit > 29u {
            weight |= block.y << (32u - bit);
        }
        weight &= 7u;
        let w = block.x & 0xffffu;
        open = min((f32(weight) * (f32(w) / 256.0) + f32(7u - weight) * f32(w & 255u)) / 1785.0, 1.0);
    }

    var shown = color;
    if shading.mode == MODE_SHADED {
        if (shading.flags & FLAG_LIGHT) != 0u {
            let to_eye = -normalize(direction);
            let away = dot(normal, direction);
            var seen = normal;
            if away > 0.0 {
                seen = normal - direction * (2.0 * away / dot(direction, direction));
            }
            seen = normalize(seen);
            let to_light = shading.to_light.xyz;
            let toward = dot(seen, to_light);
            let mirrored = seen * (2.0 * toward) - to_light;
            var diffuse = DIFFUSE * max(toward, 0.0);
            var specular = 0.0;
            if toward > 0.0 {
                specular = SPECULAR * pow(max(dot(mirrored, to_eye), 0.0), SHININESS);
            }
            if (shading.flags & FLAG_SHADOWS) != 0u && toward > 0.0 {
                let edge = size * length(objects[object].to_mesh[0].xyz);
                if in_shadow(direction * t - direction * (1e-5 * t), to_light, edge) {
                    diffuse = 0.0;
                    specular = 0.0;
                }
            }
            shown = encode_srgb(decode_srgb(color) * (open * (AMBIENT + diffuse)) + specular);
        }
    } else if shading.mode == MODE_ITERATIONS {
        shown = heat(f32(iterations) / 64.0);
    } else if shading.mode == MODE_NORMALS {
        shown = facing(normal, direction) * 0.5 + 0.5;
    } else if shading.mode == MODE_LEVELS {
        shown = heat(f32(23u - (voxel >> 8u)) / f32(max(objects[object].numbers.z, 1u)));
    } else if shading.mode == MODE_SIZE {
        shown = heat(f32(code) / 192.0);
    } else if shading.mode == MODE_DEPTH {
        shown = vec3<f32>(1.0 - 0.85 * sqrt(clamp(t * shading.far, 0.0, 1.0)));
    } else {
        shown = vec3<f32>(open);
    }
    pixels[pixel] = packed(shown, select(0u, min(code, 255u), shading.mode == MODE_SHADED));
}
