// A voxel that a method misses although it has shaded a pixel of its column for a triangle that meets it.
@group(1) @binding(0) var<storage, read> missing: array<u32>;

fn emit(record: u32, cell: vec3<i32>) {
    if in_tile(cell) {
        let code = code_of(cell);
        if ((missing[code >> 5u] >> (code & 31u)) & 1u) != 0u {
            set_bit(code);
        }
    }
}
