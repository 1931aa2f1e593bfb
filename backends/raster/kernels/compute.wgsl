// Voxelization by compute: the separating axis test for each column of voxels in a triangle's bounding box.
//
// A workgroup takes as many items as it has invocations. An item is a rectangle of columns of one triangle. The columns of
// all its items together are dealt out one by one, so that invocations with small triangles do not wait for one with a large triangle.

struct Item {
    record: u32,
    // The first column, from the tile's corner: 16 bits of u, 16 of v.
    corner: u32,
    // Columns along u, 16 bits, and along v.
    size: u32,
}

// Items, 3 words each; or pairs of a record and a voxel's code, 2 words each.
@group(2) @binding(0) var<storage, read> items: array<u32>;
// What single precision cannot decide: its length, then pairs of record and code.
@group(2) @binding(1) var<storage, read_write> undecided: array<atomic<u32>>;

const GROUP: u32 = 64u;
var<workgroup> ends: array<u32, 64>;
var<workgroup> group_items: array<Item, 64>;

fn item_at(index: u32) -> Item {
    let at = 3u * index;
    return Item(items[at], items[at + 1u], items[at + 2u]);
}

fn test_column(record: u32, pixel: vec2<i32>) {
    let t = triangle_of(records[record]);
    let column = pixel - t.origin.xy;
    let uv = vec2<f32>(column) + 0.5;
    let of_column = column_verdict(t, column);
    if of_column == APART { return; }
    let end = i32(params.tile) - 1 - t.origin.z;
    let range = depth_range(t, uv);
    for (var w = max(range.x, -t.origin.z); w <= min(range.y, end); w++) {
        let found = min(of_column, voxel_verdict(t, vec3(column, w)));
        if found == APART { continue; }
        let cell = plain_cell(t.origin + vec3(column, w), t.axis);
        if found == MEET {
            emit(record, cell);
        } else if params.capacity != 0u {
            let place = atomicAdd(&undecided[0], 1u);
            if place < params.capacity {
                atomicStore(&undecided[2u * place + 2u], record);
                atomicStore(&undecided[2u * place + 3u], code_of(cell));
            }
        }
    }
}

@compute @workgroup_size(64)
fn voxelize(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let index = (group.y * params.groups_x + group.x) * GROUP + local;
    var columns = 0u;
    if index < params.count {
        let item = item_at(params.first + index);
        group_items[local] = item;
        columns = (item.size & 0xffffu) * (item.size >> 16u);
    }
    ends[local] = columns;
    workgroupBarrier();
    for (var step = 1u; step < GROUP; step *= 2u) {
        var add = 0u;
        if local >= step { add = ends[local - step]; }
        workgroupBarrier();
        ends[local] += add;
        workgroupBarrier();
    }
    let total = ends[GROUP - 1u];
    for (var k = local; k < total; k += GROUP) {
        // The first item whose end lies beyond k.
        var low = 0u;
        var high = GROUP - 1u;
        while low < high {
            let middle = (low + high) / 2u;
            if ends[middle] > k { high = middle; } else { low = middle + 1u; }
        }
        let item = group_items[low];
        let width = item.size & 0xffffu;
        let column = k - (ends[low] - width * (item.size >> 16u));
        let pixel = vec2(item.corner & 0xffffu, item.corner >> 16u) + vec2(column % width, column / width);
        test_column(item.record, vec2<i32>(pixel));
    }
}

fn squeezed(code: u32) -> u32 {
    var s = code & 0x09249249u;
    s = (s | (s >> 2u)) & 0x030c30c3u;
    s = (s | (s >> 4u)) & 0x0300f00fu;
    s = (s | (s >> 8u)) & 0x030000ffu;
    return (s | (s >> 16u)) & 0x3ffu;
}

// Pairs that were decided elsewhere.
@compute @workgroup_size(64)
fn apply(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let index = (group.y * params.groups_x + group.x) * GROUP + local;
    if index < params.count {
        let at = 2u * (params.first + index);
        let code = items[at + 1u];
        emit(items[at], vec3<i32>(vec3(squeezed(code), squeezed(code >> 1u), squeezed(code >> 2u))));
    }
}
