//! The voxels of a level, and the cubes of the level that they fill.

use std::io;

use esvo_format::{Octree, Slab};
use glam::{DMat4, DVec3, Vec3};

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
}

/// What a contour leaves of octree space: a slab between two planes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Between {
    normal: DVec3,
    low: f64,
    high: f64,
}

impl Between {
    /// `slab` is in units of a voxel of this level, from its centre on.
    fn new(slab: &Slab, position: [u32; 3], level: u32) -> Self {
        let per_unit = f64::from(level).exp2();
        let normal = DVec3::from(slab.normal) * per_unit;
        let centre = (DVec3::from(position.map(f64::from)) + 0.5) / per_unit;
        let at = normal.dot(centre);
        Self { normal, low: at + slab.lo(), high: at + slab.hi() }
    }

    /// Whether a cube with this centre and edge meets it.
    fn meets(&self, centre: DVec3, edge: f64) -> bool {
        let at = self.normal.dot(centre);
        let reach = self.normal.abs().element_sum() * edge * 0.5;
        at + reach >= self.low && at - reach <= self.high
    }
}

/// Called with a voxel, and with what its contours and those above it leave.
pub(super) type With<'w> = dyn FnMut(&Voxel, &[Between]) -> io::Result<()> + 'w;

/// A walk through an octree down to a level.
struct Walk<'w> {
    octree: &'w Octree,
    level: u32,
    /// Contours of the voxels that are being walked through, from the root on.
    contours: Vec<Between>,
    with: &'w mut With<'w>,
}

impl Walk<'_> {
    /// The children of a descriptor, which are at level `at`.
    fn children(&mut self, slot: u32, parent: [u32; 3], at: u32) -> io::Result<()> {
        let descriptor = self.octree.descriptor(slot);
        for child in (0..8u8).filter(|child| descriptor.valid_mask() >> child & 1 != 0) {
            let position = std::array::from_fn(|axis| parent[axis] * 2 + u32::from(child >> axis & 1));
            let above = self.contours.len();
            let contour = self.octree.contour(slot, child);
            self.contours.extend(contour.map(|contour| Between::new(&contour.decode(), position, at)));
            match self.octree.child(slot, child) {
                Some(below) if at < self.level => self.children(below, position, at + 1)?,
                _ => {
                    let color = self.octree.color(slot, child);
                    let voxel = Voxel {
                        level: at,
                        position,
                        color: color.map(|c| c.map(|x| (x * 255.0).round().clamp(0.0, 255.0) as u8)),
                        normal: self.octree.normal(slot, child),
                    };
                    (self.with)(&voxel, &self.contours)?;
                }
            }
            self.contours.truncate(above);
        }
        Ok(())
    }
}

/// Calls `with` for each voxel of `level` and each leaf above it, in the order of the octree. Ends at the first error.
pub(super) fn visit(octree: &Octree, object: usize, level: u32, with: &mut With<'_>) -> io::Result<()> {
    let root = octree.objects()[object].root_slot as u32;
    Walk { octree, level, contours: Vec::new(), with: &mut |voxel, contours| with(voxel, contours) }
        .children(root, [0; 3], 1)
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
        let _ = visit(octree, object, level, &mut |voxel, _| {
            cubes = cubes.saturating_add(1 << (3 * (level - voxel.level)));
            Ok(())
        });
        cubes
    }

    /// The cubes that voxels of an object fill. Of a leaf above the level, those that its contour and those above it meet.
    ///
    /// # Panics
    /// If there is no such object, or if `level` is above [`MAX_LEVEL`](super::MAX_LEVEL).
    #[must_use]
    pub fn new(octree: &Octree, object: usize, level: u32) -> Self {
        assert!(level <= super::MAX_LEVEL, "level {level}, expected 1 to {}", super::MAX_LEVEL);
        let edge = (-f64::from(level)).exp2();
        let (mut list, mut has_colors) = (Vec::new(), false);
        let _ = visit(octree, object, level, &mut |voxel, contours| {
            has_colors |= voxel.color.is_some();
            let color = voxel.color.unwrap_or([255; 3]);
            let side = 1u32 << (level - voxel.level);
            let first = voxel.position.map(|x| x * side);
            for index in 0..u64::from(side).pow(3) {
                let bits = u64::from(side).trailing_zeros();
                let inside = [0, 1, 2].map(|axis| (index >> (axis * bits)) as u32 & (side - 1));
                let position: [u32; 3] = std::array::from_fn(|k| first[k] + inside[k]);
                let centre = (DVec3::from(position.map(f64::from)) + 0.5) * edge;
                // A voxel that is not divided keeps its cube.
                if side == 1 || contours.iter().all(|contour| contour.meets(centre, edge)) {
                    list.push(Cube { position, color });
                }
            }
            Ok(())
        });
        Self { level, list, has_colors, octree_to_mesh: octree.octree_to_mesh(object) }
    }
}
