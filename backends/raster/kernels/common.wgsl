// What every kernel of the voxelizer shares: a triangle as a tile sees it, the separating axis test, and the grid of bits.
//
// Lengths are in voxels. A triangle's coordinates are relative to its own whole-numbered origin, so that they are small and
// their rounding is too. "Permuted" coordinates (u, v, w) are those in which w is the axis that the triangle is projected along.

// esvo_raster::records::Record
struct Record {
    origin_x: i32,
    origin_y: i32,
    origin_z: i32,
    // Bits 0 and 1: the axis of projection. The others are those of Triangle::flags.
    flags: u32,
    ax: f32, ay: f32, az: f32,
    bx: f32, by: f32, bz: f32,
    cx: f32, cy: f32, cz: f32,
    // The plane: how w grows with u and with v.
    slope_u: f32,
    slope_v: f32,
    // Largest coordinate of a corner.
    extent: f32,
    // The last voxel of the bounding box along u, v and w, from the origin.
    last_u: i32,
    last_v: i32,
    last_w: i32,
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> records: array<Record>;
@group(0) @binding(2) var<storage, read_write> grid: array<atomic<u32>>;

// esvo_raster::records::flags
const NEEDLE: u32 = 4u;
const FLAT: u32 = 0x40000u;

struct Triangle {
    a: vec3<f32>,
    b: vec3<f32>,
    c: vec3<f32>,
    origin: vec3<i32>,
    axis: u32,
    // What the processor knows in double precision, see esvo_raster::records::flags.
    flags: u32,
    // The first and the last voxel of the bounding box, from the origin.
    first: vec3<i32>,
    last: vec3<i32>,
    slope: vec2<f32>,
    low: vec3<f32>,
    high: vec3<f32>,
    // Bounds of the rounding errors of the tests: esvo_raster::bounds derives them.
    edge_error: f32,
    plane_error: f32,
    box_error: f32,
}

fn permuted(p: vec3<f32>, axis: u32) -> vec3<f32> {
    if axis == 0u { return p.yzx; }
    if axis == 1u { return p.zxy; }
    return p;
}

fn permuted_cell(p: vec3<i32>, axis: u32) -> vec3<i32> {
    if axis == 0u { return p.yzx; }
    if axis == 1u { return p.zxy; }
    return p;
}

// The inverse of permuted_cell.
fn plain_cell(p: vec3<i32>, axis: u32) -> vec3<i32> {
    if axis == 0u { return p.zxy; }
    if axis == 1u { return p.yzx; }
    return p;
}

// A triangle in permuted coordinates.
fn triangle_of(r: Record) -> Triangle {
    var t: Triangle;
    t.axis = r.flags & 3u;
    t.flags = r.flags;
    // The first is the origin's, or the one before it.
    t.first = -vec3(i32((r.flags >> 6u) & 1u), i32((r.flags >> 7u) & 1u), i32((r.flags >> 8u) & 1u));
    t.last = vec3(r.last_u, r.last_v, r.last_w);
    t.a = permuted(vec3(r.ax, r.ay, r.az), t.axis);
    t.b = permuted(vec3(r.bx, r.by, r.bz), t.axis);
    t.c = permuted(vec3(r.cx, r.cy, r.cz), t.axis);
    t.origin = permuted_cell(vec3(r.origin_x, r.origin_y, r.origin_z), t.axis);
    t.slope = vec2(r.slope_u, r.slope_v);
    t.low = min(min(t.a, t.b), t.c);
    t.high = max(max(t.a, t.b), t.c);
    let reach = r.extent + 2.0;
    t.edge_error = EDGE_ERROR * reach * reach;
    // One fixed projection has slopes above 1.
    t.plane_error = PLANE_ERROR * reach * max(1.0, max(abs(r.slope_u), abs(r.slope_v)));
    t.box_error = BOX_ERROR * reach;
    return t;
}

// w on the triangle's plane.
fn depth_at(t: Triangle, uv: vec2<f32>) -> f32 {
    return t.a.z + t.slope.x * (uv.x - t.a.x) + t.slope.y * (uv.y - t.a.y);
}

// 0: apart. 1: too close to say in single precision. 2: they meet.
const APART: u32 = 0u;
const UNDECIDED: u32 = 1u;
const MEET: u32 = 2u;

// What a test says whose value is at least zero where box and triangle are not apart.
fn verdict(value: f32, error: f32) -> u32 {
    if value < -error { return APART; }
    if value > error { return MEET; }
    return UNDECIDED;
}

// The axis of the separating axis test that is perpendicular to an edge and to one coordinate axis, in the plane of the other
// two: the edge, its start and the triangle's third corner, both relative to the middle of the voxel.
fn edge_value(edge: vec2<f32>, start: vec2<f32>, third: vec2<f32>) -> f32 {
    let p = edge.x * start.y - edge.y * start.x;
    let q = edge.x * third.y - edge.y * third.x;
    let radius = 0.5 * (abs(edge.x) + abs(edge.y));
    return radius - max(min(p, q), -max(p, q));
}

// The three edges in the plane of coordinates i and j, 0 to 2 for u, v, w. An edge along one of the two makes the axis of the test
// one of the box's, which is tested already.
fn edges_verdict(t: Triangle, i: u32, j: u32, a: vec2<f32>, b: vec2<f32>, c: vec2<f32>) -> u32 {
    let along = (t.flags >> (9u + i)) | (t.flags >> (9u + j));
    var least = 1.0e30;
    if (along & 1u) == 0u { least = edge_value(b - a, a, c); }
    if (along & 8u) == 0u { least = min(least, edge_value(c - b, b, a)); }
    if (along & 64u) == 0u { least = min(least, edge_value(a - c, c, b)); }
    return verdict(least, t.edge_error);
}

// Whether the bounding box meets a voxel along u, v or w. The processor has decided it, unless a border is too close.
fn box_verdict(t: Triangle, k: u32, cell: i32, low: f32, high: f32, first: i32, last: i32) -> u32 {
    if (t.flags & (8u << k)) != 0u {
        let centre = f32(cell) + 0.5;
        return verdict(0.5 - max(low - centre, centre - high), t.box_error);
    }
    return select(APART, MEET, cell >= first && cell <= last);
}

// Whether the triangle meets a column of voxels, seen along w.
fn column_verdict(t: Triangle, column: vec2<i32>) -> u32 {
    let in_u = box_verdict(t, 0u, column.x, t.low.x, t.high.x, t.first.x, t.last.x);
    let in_v = box_verdict(t, 1u, column.y, t.low.y, t.high.y, t.first.y, t.last.y);
    let in_box = min(in_u, in_v);
    if in_box == APART { return APART; }
    let uv = vec2<f32>(column) + 0.5;
    return min(in_box, edges_verdict(t, 0u, 1u, t.a.xy - uv, t.b.xy - uv, t.c.xy - uv));
}

// Whether it meets a voxel, given that it meets the voxel's column.
fn voxel_verdict(t: Triangle, cell: vec3<i32>) -> u32 {
    var found = box_verdict(t, 2u, cell.z, t.low.z, t.high.z, t.first.z, t.last.z);
    // All axes that are left are w, if the triangle is perpendicular to it.
    if found == APART || (t.flags & FLAT) != 0u { return found; }
    let centre = vec3<f32>(cell) + 0.5;
    if (t.flags & NEEDLE) != 0u {
        found = min(found, UNDECIDED);
    } else {
        let reach = 0.5 * (abs(t.slope.x) + abs(t.slope.y) + 1.0);
        found = min(found, verdict(reach - abs(depth_at(t, centre.xy) - centre.z), t.plane_error));
    }
    if found == APART { return APART; }
    let a = t.a - centre;
    let b = t.b - centre;
    let c = t.c - centre;
    found = min(found, edges_verdict(t, 1u, 2u, a.yz, b.yz, c.yz));
    return min(found, edges_verdict(t, 2u, 0u, a.zx, b.zx, c.zx));
}

// The first and the last voxel of the column around uv that the triangle may meet, along w.
fn depth_range(t: Triangle, uv: vec2<f32>) -> vec2<i32> {
    // More than the error of the depth; the tests decide.
    let margin = 0.0625 + t.plane_error;
    var low = t.low.z;
    var high = t.high.z;
    if (t.flags & NEEDLE) == 0u {
        let depth = depth_at(t, uv);
        let half = 0.5 * (abs(t.slope.x) + abs(t.slope.y));
        low = max(low, depth - half);
        high = min(high, depth + half);
    }
    return vec2(i32(floor(low - margin)), i32(floor(high + margin)));
}

fn spread(x: u32) -> u32 {
    var s = x & 0x3ffu;
    s = (s | (s << 16u)) & 0x030000ffu;
    s = (s | (s << 8u)) & 0x0300f00fu;
    s = (s | (s << 4u)) & 0x030c30c3u;
    return (s | (s << 2u)) & 0x09249249u;
}

// The Morton code of a voxel in the tile: the place of its bit.
fn code_of(cell: vec3<i32>) -> u32 {
    let c = vec3<u32>(cell);
    return spread(c.x) | (spread(c.y) << 1u) | (spread(c.z) << 2u);
}

fn in_tile(cell: vec3<i32>) -> bool {
    return all(cell >= vec3(0)) && all(cell < vec3(i32(params.tile)));
}

fn is_set(code: u32) -> bool {
    return ((atomicLoad(&grid[code >> 5u]) >> (code & 31u)) & 1u) != 0u;
}

// A bit that is set already is not written again: reading is cheaper where many triangles meet one voxel.
fn set_bit(code: u32) {
    if !is_set(code) {
        atomicOr(&grid[code >> 5u], 1u << (code & 31u));
    }
}
