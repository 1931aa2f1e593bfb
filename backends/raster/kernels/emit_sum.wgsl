// A triangle that meets a voxel: its colour and normal there are added to the voxel's sums. Sums are whole numbers, so that their
// order does not matter.

// esvo_raster::attributes::LookRecord
struct Look {
    normals: array<f32, 9>,
    uvs: array<f32, 6>,
    colors: array<f32, 9>,
    material: u32,
    // Texels of the finest mip level across the edge of a voxel.
    texels: f32,
}

// esvo_raster::attributes::MaterialRecord
struct Material {
    red: f32,
    green: f32,
    blue: f32,
    // The first texel, the size of the finest level, and how many levels there are; 0: no texture.
    start: u32,
    width: u32,
    height: u32,
    levels: u32,
    // Bits 0 and 1: how u goes on outside of 0 to 1; bits 2 and 3: v. 0 repeats, 1 mirrors, 2 stays at the edge.
    wrap: u32,
}

@group(1) @binding(0) var<storage, read> ranks: array<u32>;
@group(1) @binding(1) var<storage, read> looks: array<Look>;
@group(1) @binding(2) var<storage, read> materials: array<Material>;
@group(1) @binding(3) var<storage, read> texels: array<u32>;
// Per voxel: how many triangles, three colour channels, three components of normals, and of normals turned to one side.
@group(1) @binding(4) var<storage, read_write> sums: array<atomic<u32>>;

const SUM_WORDS: u32 = 10u;
// esvo_raster::attributes::STEPS
const STEPS: f32 = 16383.0;

fn linear(channel: u32) -> f32 {
    let c = f32(channel) / 255.0;
    if c <= 0.04045 { return c / 12.92; }
    return pow((c + 0.055) / 1.055, 2.4);
}

fn wrapped(x: i32, size: i32, how: u32) -> i32 {
    if how == 2u { return clamp(x, 0, size - 1); }
    let turns = i32(floor(f32(x) / f32(size)));
    let rest = clamp(x - turns * size, 0, size - 1);
    if how == 1u && (turns & 1) != 0 { return size - 1 - rest; }
    return rest;
}

fn texel(m: Material, start: u32, size: vec2<i32>, at: vec2<i32>) -> vec3<f32> {
    let x = wrapped(at.x, size.x, m.wrap & 3u);
    let y = wrapped(at.y, size.y, (m.wrap >> 2u) & 3u);
    let word = texels[start + u32(y) * u32(size.x) + u32(x)];
    return vec3(linear(word & 255u), linear((word >> 8u) & 255u), linear((word >> 16u) & 255u));
}

// The texture at uv, from the finest level whose texels are at least as large as a voxel, between four texels.
fn texture_at(m: Material, uv: vec2<f32>, across: f32) -> vec3<f32> {
    let wanted = u32(clamp(ceil(log2(max(across, 1.0))), 0.0, f32(m.levels - 1u)));
    var start = m.start;
    var size = vec2(m.width, m.height);
    for (var level = 0u; level < wanted; level++) {
        start += size.x * size.y;
        size = max(size / 2u, vec2(1u));
    }
    let place = uv * vec2<f32>(size) - 0.5;
    let low = floor(place);
    let share = place - low;
    let at = vec2<i32>(clamp(low, vec2(-1.0e9), vec2(1.0e9)));
    let s = vec2<i32>(size);
    let upper = mix(texel(m, start, s, at), texel(m, start, s, at + vec2(1, 0)), share.x);
    let lower = mix(texel(m, start, s, at + vec2(0, 1)), texel(m, start, s, at + vec2(1, 1)), share.x);
    return mix(upper, lower, share.y);
}

// Barycentric coordinates of the point of the triangle's plane above the middle of the voxel, moved into the triangle.
fn weights(t: Triangle, uv: vec2<f32>) -> vec3<f32> {
    let ab = t.b.xy - t.a.xy;
    let ac = t.c.xy - t.a.xy;
    let area = ab.x * ac.y - ab.y * ac.x;
    if area == 0.0 { return vec3(1.0, 0.0, 0.0); }
    let p = uv - t.a.xy;
    let v = clamp((p.x * ac.y - p.y * ac.x) / area, 0.0, 1.0);
    let w = clamp((ab.x * p.y - ab.y * p.x) / area, 0.0, 1.0 - v);
    return vec3(1.0 - v - w, v, w);
}

fn add(place: u32, value: f32) {
    atomicAdd(&sums[place], bitcast<u32>(i32(round(value * STEPS))));
}

fn emit(record: u32, cell: vec3<i32>) {
    if !in_tile(cell) { return; }
    let code = code_of(cell);
    let word = atomicLoad(&grid[code >> 5u]);
    let rank = ranks[code >> 5u] + countOneBits(word & ((1u << (code & 31u)) - 1u));
    if rank < params.sum_first || rank - params.sum_first >= params.sum_count { return; }
    let at = SUM_WORDS * (rank - params.sum_first);
    let t = triangle_of(records[record]);
    let k = weights(t, vec2<f32>(permuted_cell(cell, t.axis).xy - t.origin.xy) + 0.5);
    let look = looks[record];
    atomicAdd(&sums[at], 1u);
    if (params.wanted & 1u) != 0u {
        let m = materials[look.material];
        var color = vec3(m.red, m.green, m.blue);
        color *= k.x * vec3(look.colors[0], look.colors[1], look.colors[2])
            + k.y * vec3(look.colors[3], look.colors[4], look.colors[5])
            + k.z * vec3(look.colors[6], look.colors[7], look.colors[8]);
        if m.levels != 0u {
            let uv = k.x * vec2(look.uvs[0], look.uvs[1]) + k.y * vec2(look.uvs[2], look.uvs[3]) + k.z * vec2(look.uvs[4], look.uvs[5]);
            color *= texture_at(m, uv, look.texels);
        }
        color = clamp(color, vec3(0.0), vec3(1.0));
        for (var i = 0u; i < 3u; i++) { add(at + 1u + i, color[i]); }
    }
    if (params.wanted & 2u) != 0u {
        var normal = k.x * vec3(look.normals[0], look.normals[1], look.normals[2])
            + k.y * vec3(look.normals[3], look.normals[4], look.normals[5])
            + k.z * vec3(look.normals[6], look.normals[7], look.normals[8]);
        let size = length(normal);
        normal = select(vec3(0.0, 0.0, 1.0), normal / size, size > 0.0);
        // Opposite sides of a thin sheet cancel out; turned to one side they do not.
        let side = select(-1.0, 1.0, normal.x + 0.5 * normal.y + 0.25 * normal.z >= 0.0);
        for (var i = 0u; i < 3u; i++) {
            add(at + 4u + i, normal[i]);
            add(at + 7u + i, normal[i] * side);
        }
    }
}
