// Counts how often each pixel of each of the three projections is shaded.
@group(1) @binding(0) var<storage, read_write> pixels: array<atomic<u32>>;

fn emit(record: u32, cell: vec3<i32>) {}

@fragment
fn count(at: Corner) {
    let pixel = vec2<u32>(floor(at.position.xy));
    let axis = records[at.record].flags & 3u;
    atomicAdd(&pixels[(axis * params.tile + pixel.y) * params.tile + pixel.x], 1u);
}
