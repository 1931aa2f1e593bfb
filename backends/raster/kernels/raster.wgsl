// Voxelization by rasterization: one pixel is one column of voxels along the axis that a triangle is projected along.

// Whether edges are moved outwards so that every pixel that the triangle touches is shaded.
override EXPAND: bool = false;
// How far, in pixels, a corner may move when they are.
override REACH: f32 = 16.0;
// Whether pixels outside of the triangle's bounding box are dropped.
override CLIP: bool = false;
// Whether all voxels of the column that the triangle's plane meets are tested, instead of one being written.
override TESTS: bool = false;
// Whether the depth stays within the triangle's. The middle of a pixel that is shaded without moved edges or further samples lies in
// the triangle, so that this takes away rounding alone.
override CLAMP: bool = false;

// Edges are moved by half a pixel, and by what the rasterizer may move them back: it snaps corners to at least 1/256 of a
// pixel, and the shader rounds.
const HALF_PIXEL: f32 = 0.5 + 1.0 / 64.0;

struct Corner {
    @builtin(position) position: vec4<f32>,
    @location(0) @interpolate(flat) record: u32,
}

// Where a corner goes if both edges at it are moved outwards: `next` and `before` are the vectors to the two other corners. The
// result is relative to the corner; z is 0 if there is no such place within reach.
fn moved_corner(next: vec2<f32>, before: vec2<f32>, area_sign: f32) -> vec3<f32> {
    // Outward normals of the edge that starts here and of the edge that ends here.
    let n0 = vec2(next.y, -next.x) * area_sign;
    let n1 = vec2(-before.y, before.x) * area_sign;
    let d0 = HALF_PIXEL * (abs(n0.x) + abs(n0.y));
    let d1 = HALF_PIXEL * (abs(n1.x) + abs(n1.y));
    let determinant = n0.x * n1.y - n0.y * n1.x;
    let p = vec2(d0 * n1.y - d1 * n0.y, d1 * n0.x - d0 * n1.x);
    let allowed = REACH * abs(determinant);
    if determinant == 0.0 || abs(p.x) > allowed || abs(p.y) > allowed { return vec3(0.0); }
    return vec3(p / determinant, 1.0);
}

fn corner_of(t: Triangle, corner: u32) -> vec2<f32> {
    let a = t.a.xy;
    let b = t.b.xy;
    let c = t.c.xy;
    var own = a;
    if corner == 1u { own = b; }
    if corner == 2u { own = c; }
    if !EXPAND { return own; }
    let area = (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
    let side = select(-1.0, 1.0, area > 0.0);
    let m0 = moved_corner(b - a, c - a, side);
    let m1 = moved_corner(c - b, a - b, side);
    let m2 = moved_corner(a - c, b - c, side);
    if m0.z * m1.z * m2.z == 0.0 || abs(area) <= 16.0 * t.edge_error {
        // A needle, whose edges are almost parallel: a triangle around its bounding box.
        let low = t.low.xy - HALF_PIXEL;
        let legs = 2.0 * (t.high.xy + HALF_PIXEL - low) + 0.5;
        return low + legs * select(vec2(0.0), vec2(1.0, 0.0), corner == 1u) + legs * select(vec2(0.0), vec2(0.0, 1.0), corner == 2u);
    }
    var moved = m0.xy;
    if corner == 1u { moved = m1.xy; }
    if corner == 2u { moved = m2.xy; }
    return own + moved;
}

@vertex
fn project(@builtin(vertex_index) index: u32) -> Corner {
    let record = index / 3u;
    let t = triangle_of(records[record]);
    let pixel = vec2<f32>(t.origin.xy) + corner_of(t, index % 3u);
    let scale = 2.0 / f32(params.tile);
    return Corner(vec4(pixel.x * scale - 1.0, 1.0 - pixel.y * scale, 0.5, 1.0), record);
}

@fragment
fn shade(at: Corner) {
    let t = triangle_of(records[at.record]);
    let column = vec2<i32>(floor(at.position.xy)) - t.origin.xy;
    let uv = vec2<f32>(column) + 0.5;
    if CLIP || TESTS {
        let outside = max(t.low.xy - uv, uv - t.high.xy);
        if max(outside.x, outside.y) > 0.5 + t.box_error { return; }
    }
    if TESTS {
        if column_verdict(t, column) == APART { return; }
        let range = depth_range(t, uv);
        for (var w = range.x; w <= range.y; w++) {
            if voxel_verdict(t, vec3(column, w)) != APART {
                emit(at.record, plain_cell(t.origin + vec3(column, w), t.axis));
            }
        }
    } else {
        var depth = depth_at(t, uv);
        if CLAMP { depth = clamp(depth, t.low.z, t.high.z); }
        // A surface at the far end of the grid belongs to the last voxel.
        let end = permuted_cell(vec3(params.end_x, params.end_y, params.end_z), t.axis).z - t.origin.z;
        var w = i32(floor(clamp(depth, -1.0e6, 1.0e6)));
        if w == end && depth == f32(end) { w = end - 1; }
        emit(at.record, plain_cell(t.origin + vec3(column, w), t.axis));
    }
}
