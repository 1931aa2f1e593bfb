//! The voxels of a level, and the cubes of the level that they fill.

use std::io;

use esvo_format::{Octree, Slab};
use glam::{DMat4, Vec3};

/// A voxel of the level, or a leaf above it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Voxel {
    /// Its level.
    pub(super) level: u32,
    /// Lower corner, in edges of voxels of its level.
    pub(super) position: [u32; 3],
    /// Red, green and blue, sRGB-encoded; `None` if the octree has no colours.
    pub(super) color: Option<[u8; 3]>,
    /// Unit normal in mesh orientation; `None` if the octree has no normals.
    pub(super) normal: Option<Vec3>,
    /// What its contour leaves of it; `None` without one.
    slab: Option<Slab>,
}

/// Calls `with` for each voxel of `level` and each leaf above it, in the order of the octree. Ends at the first error.
pub(super) fn visit(
    octree: &Octree,
    object: usize,
    level: u32,
    with: &mut dyn FnMut(&Voxel) -> io::Result<()>,
) -> io::Result<()> {
    let mut stack = vec![(octree.objects()[object].root_slot as u32, [0u32; 3], 1u32)];
    while let Some((slot, parent, at)) = stack.pop() {
        let descriptor = octree.descriptor(slot);
        for child in (0..8u8).filter(|child| descriptor.valid_mask() >> child & 1 != 0) {
            let position = std::array::from_fn(|axis| parent[axis] * 2 + u32::from(child >> axis & 1));
            match octree.child(slot, child) {
                Some(below) if at < level => stack.push((below, position, at + 1)),
                _ => with(&Voxel {
                    level: at,
                    position,
                    color: octree.color(slot, child).map(|c| c.map(|x| (x * 255.0).round().clamp(0.0, 255.0) as u8)),
                    normal: octree.normal(slot, child),
                    slab: octree.contour(slot, child).map(esvo_format::Contour::decode),
                })?,
            }
        }
    }
    Ok(())
}

/// A cube of the level.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cube {
    /// Lower corner in octree space, in edges of cubes of the level.
    pub position: [u32; 3],
    /// Red, green, blue, sRGB-encoded; white if the octree has no colours.
    pub color: [u8; 3],
}

/// The cubes of a level that the voxels of an object fill, in the order of the octree.
#[derive(Clone, Debug)]
pub struct Cubes {
    /// The level, 1 to [`MAX_LEVEL`](super::MAX_LEVEL): there are `2^level` cubes along each axis of the root cube.
    pub level: u32,
    /// The cubes.
    pub list: Vec<Cube>,
    /// Whether the octree has colours.
    pub has_colors: bool,
    /// From octree space to mesh space.
    pub octree_to_mesh: DMat4,
}

impl Cubes {
    /// Bytes of memory for each cube, with what writing it takes.
    pub const BYTES: usize = 3 * size_of::<Cube>();

    /// Most cubes that [`new`](Self::new) may find: those of all leaves above the level, contours or not.
    ///
    /// # Panics
    /// If there is no such object.
    #[must_use]
    pub fn count(octree: &Octree, object: usize, level: u32) -> u64 {
        let mut cubes = 0u64;
        // Nothing here fails.
        let _ = visit(octree, object, level, &mut |voxel| {
            cubes = cubes.saturating_add(1 << (3 * (level - voxel.level)));
            Ok(())
        });
        cubes
    }

    /// The cubes that voxels of an object fill. Of a leaf above the level, those that its contour meets.
    ///
    /// # Panics
    /// If there is no such object, or if `level` is above [`MAX_LEVEL`](super::MAX_LEVEL).
    #[must_use]
    pub fn new(octree: &Octree, object: usize, level: u32) -> Self {
        assert!(level <= super::MAX_LEVEL, "level {level}, expected 1 to {}", super::MAX_LEVEL);
        let (mut list, mut has_colors) = (Vec::new(), false);
        let _ = visit(octree, object, level, &mut |voxel| {
            has_colors |= voxel.color.is_some();
            let color = voxel.color.unwrap_or([255; 3]);
            let side = 1u32 << (level - voxel.level);
            let first = voxel.position.map(|x| x * side);
            for index in 0..u64::from(side).pow(3) {
                let bits = u64::from(side).trailing_zeros();
                let inside = [0, 1, 2].map(|axis| (index >> (axis * bits)) as u32 & (side - 1));
                if voxel.slab.is_none_or(|slab| meets(&slab, inside, side)) {
                    list.push(Cube { position: std::array::from_fn(|k| first[k] + inside[k]), color });
                }
            }
            Ok(())
        });
        Self { level, list, has_colors, octree_to_mesh: octree.octree_to_mesh(object) }
    }
}

/// Whether a slab meets one of the `side`³ equal cubes of its voxel. A voxel that is not divided keeps its cube.
fn meets(slab: &Slab, inside: [u32; 3], side: u32) -> bool {
    if side == 1 {
        return true;
    }
    let edge = 1.0 / f64::from(side);
    let (mut at, mut reach) = (0.0, 0.0);
    for axis in 0..3 {
        at += slab.normal[axis] * ((f64::from(inside[axis]) + 0.5) * edge - 0.5);
        reach += slab.normal[axis].abs() * 0.5 * edge;
    }
    at + reach >= slab.lo() && at - reach <= slab.hi()
}
