// A voxel that was found: its bit is set.
fn emit(record: u32, cell: vec3<i32>) {
    if in_tile(cell) {
        set_bit(code_of(cell));
    }
}
