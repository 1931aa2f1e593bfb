//! Files of rays and hits, so that other casters can be checked against those of esvo.
//!
//! Two forms, by the extension: `.bin`, a header and records of equal length, all little-endian; `.json`, the same as text.
//!
//! # Header of a `.bin`, 192 bytes
//!
//! | offset | type | what |
//! |---|---|---|
//! | 0 | 8 bytes | `ESVORAYS` or `ESVOHITS` |
//! | 8 | `u32` | version, 1 |
//! | 12 | `u32` | bytes of the header, 192 |
//! | 16 | `u32` | bytes of a record: 40 for rays, 48 for hits |
//! | 20 | `u32` | index of the object in the octree |
//! | 24 | `u64` | number of records |
//! | 32 | `u32` | flags: 1, voxels are clipped by their contours |
//! | 36 | 2 × `u32` | width and height if the rays are those of a picture, row by row, the first row on top; otherwise 0 |
//! | 44 | 20 bytes | 0 |
//! | 64 | 16 × `f64` | matrix from octree space, the cube 0 to 1, to mesh units, column by column |
//!
//! # A ray, 40 bytes
//!
//! | offset | type | what |
//! |---|---|---|
//! | 0 | 3 × `f32` | origin in the cube 1 to 2: octree space plus 1 |
//! | 12 | 3 × `f32` | direction in the same units, of any length above 0 |
//! | 24 | `f32` | start of the ray, in lengths of the direction |
//! | 28 | `f32` | end of the ray, in lengths of the direction; infinite: without end |
//! | 32 | `f32` | size at the origin: a voxel ends the ray if its edge is at most this size plus `t` times the next number, the edge of the root cube being 1; both 0: only leaves end it |
//! | 36 | `f32` | growth of that size for a `t` of 1 |
//!
//! # A hit, 48 bytes
//!
//! | offset | type | what |
//! |---|---|---|
//! | 0 | `f32` | `t`: where the ray enters the voxel or its contour, in lengths of the direction; 2 for a miss, but see `hit` |
//! | 4 | `f32` | edge of the voxel, that of the root cube being 1; 0: a miss, or a caster without voxels |
//! | 8 | `u32` | slot of the descriptor of the voxel's parent |
//! | 12 | `u8` | child slot of the voxel, 0 to 7 |
//! | 13 | `u8` | scale of the voxel: its edge is 2^(scale - 23) |
//! | 14 | `u16` | 1: a hit, 0: a miss. All other fields of a miss but `t` and the iterations are 0 |
//! | 16 | 3 × `f64` | position of the hit in mesh units |
//! | 40 | `u32` | iterations of the caster's loop |
//! | 44 | `u32` | 0 |

mod compare;
mod hits;
mod rays;
mod table;

pub use compare::{Comparison, compare};
pub use hits::{HitFile, HitRecord, HitWriter, cast_file};
pub use rays::{RayFile, write_rays};
pub use table::{FileHeader, RayFileError};
