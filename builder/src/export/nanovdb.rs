//! NanoVDB files, version 32: grids that are read without being unpacked. The layout is that of `NanoVDB.h` of OpenVDB 10, for values of
//! four bytes: a grid header of 672 bytes, a tree header of 64, the root with a tile of 32 bytes for each child, then all upper
//! nodes (32³ children), all lower nodes (16³) and all leaves (8³ values), each kind without gaps. All of it is little-endian.

use std::io::{self, Write};

use glam::{DMat3, DMat4, DVec3};

use super::cubes::{Cube, Cubes};

const MAGIC: u64 = u64::from_le_bytes(*b"NanoVDB0");
/// 32.4.2: 11, 11 and 10 bits.
const VERSION: u32 = 32 << 21 | 4 << 10 | 2;
/// No checksum was computed.
const NO_CHECKSUM: u64 = u64::MAX;
/// Nodes have bounds, and lie in breadth-first order. They have no statistics.
const FLAGS: u32 = 2 | 32;

const FILE_HEADER: usize = 16;
const META: usize = 176;
const GRID: usize = 672;
const TREE: usize = 64;
const ROOT: usize = 64;
const TILE: usize = 32;
const UPPER: usize = 270_400;
const LOWER: usize = 33_856;
const LEAF: usize = 2144;

/// What the values of a grid are.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    /// One in every cube. A fog volume of `float`.
    Density,
    /// Red, green, blue and 255. A voxel volume of `Rgba8`.
    Color,
}

impl Kind {
    fn name(self) -> &'static str {
        match self {
            Self::Density => "density",
            Self::Color => "color",
        }
    }

    /// Numbers of the type and of the class.
    fn numbers(self) -> (u32, u32) {
        match self {
            Self::Density => (1, 2),
            Self::Color => (12, 7),
        }
    }

    fn value(self, cube: &Cube) -> [u8; 4] {
        match self {
            Self::Density => 1.0f32.to_le_bytes(),
            Self::Color => {
                let [r, g, b] = cube.color;
                [r, g, b, 255]
            }
        }
    }
}

/// Cubes in the order of nodes: first by upper node, then by lower node, leaf and place in it. Each key is unique.
struct Sorted(Vec<(u64, Cube)>);

impl Sorted {
    fn new(cubes: &Cubes) -> Self {
        let mut keys: Vec<(u64, Cube)> = cubes.list.iter().map(|&cube| (key(cube.position), cube)).collect();
        keys.sort_unstable_by_key(|&(key, _)| key);
        Self(keys)
    }

    /// The runs of cubes whose keys agree but for the low `bits`.
    fn runs(&self, bits: u32) -> impl Iterator<Item = &[(u64, Cube)]> {
        self.0.chunk_by(move |a, b| a.0 >> bits == b.0 >> bits)
    }
}

/// Bits of a key below a leaf, a lower and an upper node.
const IN_LEAF: u32 = 9;
const IN_LOWER: u32 = 9 + 12;
const IN_UPPER: u32 = 9 + 12 + 15;

/// 9 bits for each axis in a root tile's number, then 5, 4 and 3 bits of each for its place in the nodes; x first.
fn key([x, y, z]: [u32; 3]) -> u64 {
    let part = |shift: u32, bits: u32| {
        let of = |k: u32| u64::from(k >> shift) & ((1 << bits) - 1);
        (of(x) << bits | of(y)) << bits | of(z)
    };
    ((part(12, 9) << 15 | part(7, 5)) << 12 | part(3, 4)) << 9 | part(0, 3)
}

/// Bounds of cubes, both ends included.
fn bounds(cubes: &[(u64, Cube)]) -> [[i32; 3]; 2] {
    let mut all = [[i32::MAX; 3], [i32::MIN; 3]];
    for (_, cube) in cubes {
        for axis in 0..3 {
            let at = cube.position[axis] as i32;
            all[0][axis] = all[0][axis].min(at);
            all[1][axis] = all[1][axis].max(at);
        }
    }
    all
}

/// Numbers of leaves, lower nodes, upper nodes.
type Counts = [usize; 3];

fn bytes_of([leaves, lower, upper]: Counts) -> usize {
    GRID + TREE + ROOT + upper * (TILE + UPPER) + lower * LOWER + leaves * LEAF
}

/// Writes the cubes as grids.
pub(super) fn write(out: &mut dyn Write, cubes: &Cubes) -> io::Result<()> {
    let sorted = Sorted::new(cubes);
    let counts = [IN_LEAF, IN_LOWER, IN_UPPER].map(|bits| sorted.runs(bits).count());
    // From the index of a cube to mesh space; the corner of cube 0 is that of the root cube.
    let scale = (-f64::from(cubes.level)).exp2();
    let map = cubes.octree_to_mesh * DMat4::from_scale(DVec3::splat(scale));
    let kinds: &[Kind] = if cubes.has_colors { &[Kind::Density, Kind::Color] } else { &[Kind::Density] };
    let box_of_all = bounds(&sorted.0);
    let mut header = Bytes::new(FILE_HEADER);
    header.put(0, &MAGIC.to_le_bytes());
    header.put(8, &VERSION.to_le_bytes());
    header.put(12, &(kinds.len() as u16).to_le_bytes());
    out.write_all(&header.0)?;
    for &kind in kinds {
        out.write_all(&meta(kind, &sorted, counts, box_of_all, &map).0)?;
        out.write_all(kind.name().as_bytes())?;
        out.write_all(&[0])?;
    }
    for &kind in kinds {
        let mut grid = grid_header(kind, counts, box_of_all, &map);
        // Readers load each grid of a file into a buffer of its own: it is the first of one.
        grid.put(28, &1u32.to_le_bytes());
        out.write_all(&grid.0)?;
        write_nodes(out, kind, &sorted, counts, box_of_all)?;
    }
    Ok(())
}

/// A piece of the file, all zeros but for what is put into it.
struct Bytes(Vec<u8>);

impl Bytes {
    fn new(length: usize) -> Self {
        Self(vec![0; length])
    }

    fn put(&mut self, at: usize, bytes: &[u8]) {
        self.0[at..at + bytes.len()].copy_from_slice(bytes);
    }

    fn put_all<T>(&mut self, at: usize, values: &[T], bytes: impl Fn(&T) -> Vec<u8>) {
        let all: Vec<u8> = values.iter().flat_map(bytes).collect();
        self.put(at, &all);
    }

    fn doubles(&mut self, at: usize, values: &[f64]) {
        self.put_all(at, values, |x| x.to_le_bytes().to_vec());
    }

    fn floats(&mut self, at: usize, values: &[f64]) {
        self.put_all(at, values, |x| (*x as f32).to_le_bytes().to_vec());
    }

    fn ints(&mut self, at: usize, values: &[i32]) {
        self.put_all(at, values, |x| x.to_le_bytes().to_vec());
    }

    fn set_bit(&mut self, at: usize, bit: usize) {
        self.0[at + bit / 8] |= 1 << (bit % 8);
    }
}

/// Bounds in mesh space of the cubes of an index box.
fn world_box(map: &DMat4, index: [[i32; 3]; 2]) -> [f64; 6] {
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for corner in 0..8 {
        // The far corner of the last cube, one beyond its index.
        let at = |axis: usize| match corner >> axis & 1 {
            0 => f64::from(index[0][axis]),
            _ => f64::from(index[1][axis]) + 1.0,
        };
        let p = map.transform_point3(DVec3::new(at(0), at(1), at(2)));
        (low, high) = (low.min(p), high.max(p));
    }
    [low.x, low.y, low.z, high.x, high.y, high.z]
}

fn voxel_size(map: &DMat4) -> [f64; 3] {
    [map.x_axis, map.y_axis, map.z_axis].map(|axis| axis.truncate().length())
}

/// Describes a grid in front of all grids.
fn meta(kind: Kind, sorted: &Sorted, counts: Counts, index_box: [[i32; 3]; 2], map: &DMat4) -> Bytes {
    let mut meta = Bytes::new(META);
    let (kind_number, class) = kind.numbers();
    let size = bytes_of(counts) as u64;
    // The hash of the name that readers look grids up by: base 67, with carries from the top byte.
    let hash = kind.name().bytes().fold(0u64, |hash, byte| {
        let carry = hash >> 56;
        hash.wrapping_mul(67).wrapping_add(u64::from(byte) + carry)
    });
    for (place, value) in [size, size, hash, sorted.0.len() as u64].into_iter().enumerate() {
        meta.put(place * 8, &value.to_le_bytes());
    }
    meta.put(32, &kind_number.to_le_bytes());
    meta.put(36, &class.to_le_bytes());
    meta.doubles(40, &world_box(map, index_box));
    meta.ints(88, index_box.as_flattened());
    meta.doubles(112, &voxel_size(map));
    meta.put(136, &(kind.name().len() as u32 + 1).to_le_bytes());
    meta.ints(140, &[counts[0] as i32, counts[1] as i32, counts[2] as i32, 1]);
    meta.put(172, &VERSION.to_le_bytes());
    meta
}

fn grid_header(kind: Kind, counts: Counts, index_box: [[i32; 3]; 2], map: &DMat4) -> Bytes {
    let mut grid = Bytes::new(GRID);
    grid.put(0, &MAGIC.to_le_bytes());
    grid.put(8, &NO_CHECKSUM.to_le_bytes());
    grid.put(16, &VERSION.to_le_bytes());
    grid.put(20, &FLAGS.to_le_bytes());
    grid.put(32, &(bytes_of(counts) as u64).to_le_bytes());
    grid.put(40, kind.name().as_bytes());
    // The map: matrix and inverse row by row, and translation, in single and in double precision.
    let matrix = DMat3::from_mat4(*map);
    let rows = |matrix: &DMat3| matrix.transpose().to_cols_array();
    let (forward, inverse) = (rows(&matrix), rows(&matrix.inverse()));
    let moved = map.w_axis.truncate().to_array();
    grid.floats(296, &forward);
    grid.floats(296 + 36, &inverse);
    grid.floats(296 + 72, &moved);
    grid.floats(296 + 84, &[1.0]);
    grid.doubles(296 + 88, &forward);
    grid.doubles(296 + 160, &inverse);
    grid.doubles(296 + 232, &moved);
    grid.doubles(296 + 256, &[1.0]);
    grid.doubles(560, &world_box(map, index_box));
    grid.doubles(608, &voxel_size(map));
    let (kind_number, class) = kind.numbers();
    grid.put(632, &class.to_le_bytes());
    grid.put(636, &kind_number.to_le_bytes());
    grid
}

/// Writes tree, root and nodes.
fn write_nodes(
    out: &mut dyn Write,
    kind: Kind,
    sorted: &Sorted,
    counts: Counts,
    index_box: [[i32; 3]; 2],
) -> io::Result<()> {
    let [leaves, lower, upper] = counts;
    // Places of the first node of each kind, from the start of the tree.
    let root_at = TREE;
    let upper_at = root_at + ROOT + upper * TILE;
    let lower_at = upper_at + upper * UPPER;
    let leaf_at = lower_at + lower * LOWER;
    let mut tree = Bytes::new(TREE);
    for (place, at) in [leaf_at, lower_at, upper_at, root_at].into_iter().enumerate() {
        tree.put(place * 8, &(at as u64).to_le_bytes());
    }
    tree.ints(32, &[leaves as i32, lower as i32, upper as i32]);
    tree.put(56, &(sorted.0.len() as u64).to_le_bytes());
    out.write_all(&tree.0)?;

    let mut root = Bytes::new(ROOT + upper * TILE);
    root.ints(0, index_box.as_flattened());
    root.put(24, &(upper as u32).to_le_bytes());
    for (number, run) in sorted.runs(IN_UPPER).enumerate() {
        let [x, y, z] = run[0].1.position.map(|k| u64::from(k >> 12));
        let tile = ROOT + number * TILE;
        root.put(tile, &(z | y << 21 | x << 42).to_le_bytes());
        root.put(tile + 8, &((upper_at + number * UPPER - root_at) as u64).to_le_bytes());
    }
    out.write_all(&root.0)?;

    // An inner node: bounds, flags, masks of values and children, statistics, and for each child its distance in bytes.
    let mut children = 0;
    for (number, run) in sorted.runs(IN_UPPER).enumerate() {
        let own = upper_at + number * UPPER;
        let node = Inner { bytes: UPPER, child_mask: 4128, table: 8256, below: IN_LOWER, own };
        out.write_all(&node.make(run, |child| lower_at + child * LOWER, &mut children).0)?;
    }
    let mut children = 0;
    for (number, run) in sorted.runs(IN_LOWER).enumerate() {
        let own = lower_at + number * LOWER;
        let node = Inner { bytes: LOWER, child_mask: 544, table: 1088, below: IN_LEAF, own };
        out.write_all(&node.make(run, |child| leaf_at + child * LEAF, &mut children).0)?;
    }
    for run in sorted.runs(IN_LEAF) {
        let mut leaf = Bytes::new(LEAF);
        let [low, high] = bounds(run);
        leaf.ints(0, &low);
        leaf.put(12, &[0, 1, 2].map(|k| (high[k] - low[k]) as u8));
        leaf.put(15, &[2]);
        for &(key, cube) in run {
            let place = (key & ((1 << IN_LEAF) - 1)) as usize;
            leaf.set_bit(16, place);
            leaf.put(96 + place * 4, &kind.value(&cube));
        }
        out.write_all(&leaf.0)?;
    }
    Ok(())
}

/// The layout of upper or lower nodes, and the place of one of them.
struct Inner {
    bytes: usize,
    child_mask: usize,
    table: usize,
    /// Bits of a key below a child.
    below: u32,
    /// From the start of the tree.
    own: usize,
}

impl Inner {
    fn make(&self, run: &[(u64, Cube)], place_of: impl Fn(usize) -> usize, children: &mut usize) -> Bytes {
        let mut node = Bytes::new(self.bytes);
        node.ints(0, bounds(run).as_flattened());
        let bits = if self.below == IN_LOWER { 15 } else { 12 };
        for child in run.chunk_by(|a, b| a.0 >> self.below == b.0 >> self.below) {
            let place = (child[0].0 >> self.below) as usize & ((1 << bits) - 1);
            node.set_bit(self.child_mask, place);
            let distance = place_of(*children) - self.own;
            node.put(self.table + place * 8, &(distance as i64).to_le_bytes());
            *children += 1;
        }
        node
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Reads a value as `NanoVDB.h` does: by the tile of the root, then by the tables of the nodes.
    fn read(file: &[u8], grid: usize, [x, y, z]: [u32; 3]) -> Option<[u8; 4]> {
        let number = |at: usize| u64::from_le_bytes(file[at..at + 8].try_into().unwrap()) as usize;
        let bit = |at: usize, bit: usize| file[at + bit / 8] >> (bit % 8) & 1 != 0;
        let root = grid + GRID + TREE;
        let tiles = u32::from_le_bytes(file[root + 24..root + 28].try_into().unwrap()) as usize;
        let wanted = (z >> 12) as usize | (y as usize >> 12) << 21 | (x as usize >> 12) << 42;
        let tile = (0..tiles).map(|k| root + ROOT + k * TILE).find(|&tile| number(tile) == wanted)?;
        let place = |shift: u32, bits: u32| {
            [x, y, z].iter().fold(0, |all, k| all << bits | (k >> shift) as usize & ((1 << bits) - 1))
        };
        let upper = root + number(tile + 8);
        let at = place(7, 5);
        let lower = bit(upper + 4128, at).then(|| upper + number(upper + 8256 + at * 8))?;
        let at = place(3, 4);
        let leaf = bit(lower + 544, at).then(|| lower + number(lower + 1088 + at * 8))?;
        let at = place(0, 3);
        bit(leaf + 16, at).then(|| file[leaf + 96 + at * 4..][..4].try_into().unwrap())
    }

    #[test]
    fn values_are_found_where_they_were_put() {
        let mut list: Vec<Cube> = (0..3000u32)
            .map(|i| Cube {
                position: [i * 7 % 8191, i * i % 8192, i * 131 % 300],
                color: [i as u8, (i >> 8) as u8, 9],
            })
            .collect();
        list.sort_unstable_by_key(|cube| key(cube.position));
        list.dedup_by_key(|cube| cube.position);
        let octree_to_mesh = DMat4::from_scale(DVec3::splat(4.0));
        let cubes = Cubes { level: 13, list, has_colors: true, octree_to_mesh };
        let mut file = Vec::new();
        write(&mut file, &cubes).unwrap();
        let first = FILE_HEADER + 2 * META + "density".len() + "color".len() + 2;
        let size = u64::from_le_bytes(file[FILE_HEADER..FILE_HEADER + 8].try_into().unwrap()) as usize;
        assert_eq!(file.len(), first + 2 * size);
        let short = |at: usize| u32::from_le_bytes(file[at..at + 4].try_into().unwrap());
        for grid in [first, first + size] {
            assert_eq!((short(grid + 24), short(grid + 28)), (0, 1), "each grid is the first of one");
            assert_eq!(short(grid + GRID + 56) as usize, cubes.list.len());
        }
        for cube in &cubes.list {
            let [r, g, b] = cube.color;
            assert_eq!(read(&file, first + size, cube.position), Some([r, g, b, 255]));
            assert_eq!(read(&file, first, cube.position), Some(1.0f32.to_le_bytes()));
        }
        assert_eq!(read(&file, first, [1, 0, 299]), None);
    }
}
