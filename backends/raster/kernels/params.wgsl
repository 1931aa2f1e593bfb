// esvo_raster::passes::Params
struct Params {
    // Edge of the tile in voxels, a power of two of at most 1024.
    tile: u32,
    // Number of items in a list: of work, or of pairs.
    count: u32,
    // The first item of a list.
    first: u32,
    // Places in a list that is written.
    capacity: u32,
    // Words of the grid.
    words: u32,
    // Workgroups along x, where a dispatch has rows of them.
    groups_x: u32,
    // Kinds of attributes that are summed: bit 0 colours, bit 1 normals.
    wanted: u32,
    // The first voxel that has sums, and how many have.
    sum_first: u32,
    // Where the grid ends, from the corner of the tile.
    end_x: i32,
    end_y: i32,
    end_z: i32,
    sum_count: u32,
}
