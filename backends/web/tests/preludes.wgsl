// variant
const CONTOURS: bool = true;
const FAR_POINTERS: bool = true;
const LOD: bool = true;
const BEAM: bool = false;
const RAYS: bool = false;
const ROUND_PRODUCTS: bool = true;
const ROUND_QUOTIENTS: bool = true;
const LEVELS: u32 = 11u;
const BEAM_BLOCK: u32 = 4u;
const WIDTH: u32 = 8u;
const HEIGHT: u32 = 8u;
@group(1) @binding(0) var<storage, read> part_0: array<vec2<u32>>;
fn slot_at(slot: u32) -> vec2<u32> {
    return part_0[slot];
}
// variant
const CONTOURS: bool = true;
const FAR_POINTERS: bool = true;
const LOD: bool = true;
const BEAM: bool = true;
const RAYS: bool = false;
const ROUND_PRODUCTS: bool = true;
const ROUND_QUOTIENTS: bool = true;
const LEVELS: u32 = 11u;
const BEAM_BLOCK: u32 = 4u;
const WIDTH: u32 = 8u;
const HEIGHT: u32 = 8u;
@group(1) @binding(0) var<storage, read> part_0: array<vec2<u32>>;
fn slot_at(slot: u32) -> vec2<u32> {
    return part_0[slot];
}
// variant
const CONTOURS: bool = false;
const FAR_POINTERS: bool = true;
const LOD: bool = true;
const BEAM: bool = false;
const RAYS: bool = false;
const ROUND_PRODUCTS: bool = true;
const ROUND_QUOTIENTS: bool = true;
const LEVELS: u32 = 11u;
const BEAM_BLOCK: u32 = 4u;
const WIDTH: u32 = 8u;
const HEIGHT: u32 = 8u;
@group(1) @binding(0) var<storage, read> part_0: array<vec2<u32>>;
fn slot_at(slot: u32) -> vec2<u32> {
    return part_0[slot];
}
// variant
const CONTOURS: bool = false;
const FAR_POINTERS: bool = true;
const LOD: bool = false;
const BEAM: bool = false;
const RAYS: bool = false;
const ROUND_PRODUCTS: bool = true;
const ROUND_QUOTIENTS: bool = false;
const LEVELS: u32 = 23u;
const BEAM_BLOCK: u32 = 4u;
const WIDTH: u32 = 8u;
const HEIGHT: u32 = 8u;
@group(1) @binding(0) var<storage, read> part_0: array<vec2<u32>>;
fn slot_at(slot: u32) -> vec2<u32> {
    return part_0[slot];
}
// variant
const CONTOURS: bool = true;
const FAR_POINTERS: bool = false;
const LOD: bool = true;
const BEAM: bool = false;
const RAYS: bool = false;
const ROUND_PRODUCTS: bool = true;
const ROUND_QUOTIENTS: bool = true;
const LEVELS: u32 = 11u;
const BEAM_BLOCK: u32 = 4u;
const WIDTH: u32 = 8u;
const HEIGHT: u32 = 8u;
@group(1) @binding(0) var<storage, read> part_0: array<vec2<u32>>;
@group(1) @binding(1) var<storage, read> part_1: array<vec2<u32>>;
fn slot_at(slot: u32) -> vec2<u32> {
    let within = slot & 8388607u;
    switch slot >> 23u {
        case 0u: { return part_0[within]; }
        default: { return part_1[within]; }
    }
}
// variant
const CONTOURS: bool = true;
const FAR_POINTERS: bool = true;
const LOD: bool = true;
const BEAM: bool = false;
const RAYS: bool = false;
const ROUND_PRODUCTS: bool = true;
const ROUND_QUOTIENTS: bool = true;
const LEVELS: u32 = 11u;
const BEAM_BLOCK: u32 = 4u;
const WIDTH: u32 = 8u;
const HEIGHT: u32 = 8u;
@group(1) @binding(0) var<storage, read> part_0: array<vec2<u32>>;
@group(1) @binding(1) var<storage, read> part_1: array<vec2<u32>>;
@group(1) @binding(2) var<storage, read> part_2: array<vec2<u32>>;
@group(1) @binding(3) var<storage, read> part_3: array<vec2<u32>>;
@group(1) @binding(4) var<storage, read> part_4: array<vec2<u32>>;
fn slot_at(slot: u32) -> vec2<u32> {
    let within = slot & 16777215u;
    switch slot >> 24u {
        case 0u: { return part_0[within]; }
        case 1u: { return part_1[within]; }
        case 2u: { return part_2[within]; }
        case 3u: { return part_3[within]; }
        default: { return part_4[within]; }
    }
}
