// From the grid of bits to a list of voxels, by prefix sums. A block is 4096 words of the grid.
//
// 1. `sum_blocks`: how many bits each block has.
// 2. `scan_blocks`: where in the list each block starts. One workgroup.
// 3. `list_voxels`: the codes of the voxels, in ascending order; and, where attributes are wanted, each word's place.

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> grid: array<u32>;
// The start of each block, then the number of voxels. Before scan_blocks: the bits of each block.
@group(0) @binding(2) var<storage, read_write> blocks: array<u32>;
@group(0) @binding(3) var<storage, read_write> list: array<u32>;
@group(0) @binding(4) var<storage, read_write> ranks: array<u32>;

const THREADS: u32 = 256u;
const WORDS_PER_THREAD: u32 = 16u;
var<workgroup> sums: array<u32, 256>;

fn word(index: u32) -> u32 {
    if index < params.words { return grid[index]; }
    return 0u;
}

// The sum of the values of all invocations before this one. Every invocation must call it.
fn exclusive_sum(value: u32, local: u32) -> u32 {
    sums[local] = value;
    workgroupBarrier();
    for (var step = 1u; step < THREADS; step *= 2u) {
        var add = 0u;
        if local >= step { add = sums[local - step]; }
        workgroupBarrier();
        sums[local] += add;
        workgroupBarrier();
    }
    return sums[local] - value;
}

fn bits_of_thread(first: u32) -> u32 {
    var bits = 0u;
    for (var i = 0u; i < WORDS_PER_THREAD; i++) { bits += countOneBits(word(first + i)); }
    return bits;
}

@compute @workgroup_size(256)
fn sum_blocks(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let bits = bits_of_thread((group.x * THREADS + local) * WORDS_PER_THREAD);
    let before = exclusive_sum(bits, local);
    if local == THREADS - 1u { blocks[group.x] = before + bits; }
}

@compute @workgroup_size(256)
fn scan_blocks(@builtin(local_invocation_index) local: u32) {
    let each = (params.count + THREADS - 1u) / THREADS;
    let first = min(local * each, params.count);
    let end = min(first + each, params.count);
    var bits = 0u;
    for (var i = first; i < end; i++) { bits += blocks[i]; }
    var start = exclusive_sum(bits, local);
    if local == THREADS - 1u { blocks[params.count] = start + bits; }
    for (var i = first; i < end; i++) {
        let own = blocks[i];
        blocks[i] = start;
        start += own;
    }
}

@compute @workgroup_size(256)
fn list_voxels(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let first = (group.x * THREADS + local) * WORDS_PER_THREAD;
    var place = blocks[group.x] + exclusive_sum(bits_of_thread(first), local);
    for (var i = 0u; i < WORDS_PER_THREAD && first + i < params.words; i++) {
        if params.wanted != 0u { ranks[first + i] = place; }
        var rest = grid[first + i];
        while rest != 0u {
            let bit = countTrailingZeros(rest);
            // The list has room for a part of the voxels.
            if place >= params.first && place - params.first < params.capacity {
                list[place - params.first] = (first + i) * 32u + bit;
            }
            place++;
            rest &= rest - 1u;
        }
    }
}
