// Draws a picture of packed pixels on the canvas, enlarged where it is smaller.

struct Sizes {
    width: u32,
    height: u32,
    canvas_width: u32,
    canvas_height: u32,
}

@group(0) @binding(0) var<uniform> sizes: Sizes;
@group(0) @binding(1) var<storage, read> pixels: array<u32>;

@vertex
fn corner(@builtin(vertex_index) index: u32) -> @builtin(position) vec4<f32> {
    return vec4<f32>(f32((index << 1u) & 2u) * 2.0 - 1.0, f32(index & 2u) * 2.0 - 1.0, 0.0, 1.0);
}

fn color(x: i32, y: i32) -> vec3<f32> {
    let at = vec2<u32>(clamp(vec2<i32>(x, y), vec2<i32>(0), vec2<i32>(i32(sizes.width) - 1, i32(sizes.height) - 1)));
    return unpack4x8unorm(pixels[at.y * sizes.width + at.x]).xyz;
}

@fragment
fn present(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    if sizes.width == sizes.canvas_width && sizes.height == sizes.canvas_height {
        return vec4<f32>(color(i32(position.x), i32(position.y)), 1.0);
    }
    let at = position.xy * vec2<f32>(f32(sizes.width) / f32(sizes.canvas_width), f32(sizes.height) / f32(sizes.canvas_height)) - 0.5;
    let low = floor(at);
    let part = at - low;
    let x = i32(low.x);
    let y = i32(low.y);
    let top = mix(color(x, y), color(x + 1, y), part.x);
    let bottom = mix(color(x, y + 1), color(x + 1, y + 1), part.x);
    return vec4<f32>(mix(top, bottom, part.y), 1.0);
}
