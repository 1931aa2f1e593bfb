// The paper's post-process filter (Figure 11) on a GPU: the same operations in the same order as `esvo_core::filter`.
//
// The struct Params is `esvo_core::filter::kernel::Params`.

struct Params {
    width: u32,
    rows: u32,
    // Rows of the input above the first that is filtered.
    margin: u32,
    input_rows: u32,
    adapted: u32,
    // Of each sample: offset to the right and downwards, distance, weight.
    samples: array<vec4<f32>, 96>,
    // Radius of each code, four to a row.
    radii: array<vec4<f32>, 64>,
}

@group(0) @binding(0) var<uniform> params: Params;
// Red, green and blue in the bytes from the lowest; in the highest, the code of the radius.
@group(0) @binding(1) var<storage, read> pixels: array<u32>;
@group(0) @binding(2) var<storage, read_write> filtered: array<u32>;

fn radius_of(pixel: u32) -> f32 {
    let code = pixel >> 24u;
    return params.radii[code >> 2u][code & 3u];
}

fn color_of(pixel: u32) -> vec3<f32> {
    return vec3<f32>(f32(pixel & 255u), f32((pixel >> 8u) & 255u), f32((pixel >> 16u) & 255u));
}

@compute @workgroup_size(8, 8)
fn filter_band(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= params.width || id.y >= params.rows {
        return;
    }
    let at = vec2<i32>(i32(id.x), i32(id.y + params.margin));
    let own = pixels[u32(at.y) * params.width + id.x];
    let out = id.y * params.width + id.x;
    var r = radius_of(own);
    if r <= 1.0 {
        filtered[out] = own & 0xffffffu;
        return;
    }
    var sum = vec3<f32>(0.0);
    var weights = 0.0;
    for (var i = 0u; i < 96u; i++) {
        let sample = params.samples[i];
        if sample.z >= r {
            break;
        }
        let place = at + vec2<i32>(sample.xy);
        if place.x < 0 || place.y < 0 || u32(place.x) >= params.width || u32(place.y) >= params.input_rows {
            continue;
        }
        let pixel = pixels[u32(place.y) * params.width + u32(place.x)];
        if params.adapted != 0u {
            r = min(r, radius_of(pixel));
            if sample.z >= r {
                break;
            }
        }
        let weight = sample.w * min(r - sample.z, 1.0);
        sum += color_of(pixel) * weight;
        weights += weight;
    }
    let color = vec3<u32>(sum / weights + 0.5);
    filtered[out] = color.x | (color.y << 8u) | (color.z << 16u);
}
