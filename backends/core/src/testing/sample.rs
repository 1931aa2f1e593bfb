//! Small octrees and cameras for tests and examples of casters, and a run of one caster against the reference.

use std::sync::Arc;

use esvo_format::file::{BlockEntry, NO_PARENT, ObjectEntry};
use esvo_format::{AssembleOptions, Contour, FormatError, Octree, Tree, Voxel, assemble};
use glam::{DMat4, DVec3};

use crate::testing::compare::Comparison;
use crate::{Camera, CastError, CastOptions, Caster, View, reference};

/// How a sample octree is made.
#[derive(Clone, Copy, Debug)]
pub struct Sample {
    /// Level of the deepest voxels, 1 to 12.
    pub levels: u32,
    /// Whether voxels have contours.
    pub contours: bool,
    /// Largest descriptor array of a block, and reach of near pointers. Small values make many blocks and far pointers.
    pub layout: AssembleOptions,
}

impl Sample {
    /// One block, near pointers only.
    pub fn plain(levels: u32, contours: bool) -> Self {
        Self { levels, contours, layout: AssembleOptions::default() }
    }

    /// Many blocks and far pointers.
    pub fn scattered(levels: u32, contours: bool) -> Self {
        Self { levels, contours, layout: AssembleOptions { block_slots: 512, near_limit: 40 } }
    }

    /// A dented sphere in the unit cube, with holes and with leaves of several sizes. The same settings always give the same.
    ///
    /// # Errors
    /// Options that [`assemble`] refuses.
    pub fn octree(&self) -> Result<Arc<Octree>, FormatError> {
        let mut tree = Tree::default();
        let mut noise = Noise(1);
        self.open(&mut tree, &mut noise, DVec3::ZERO, 0);
        Ok(Arc::new(assemble(&tree, DMat4::IDENTITY, &self.layout)?))
    }

    /// Opens the node of the cube at `corner` whose edge is `2^-level`, and everything below it.
    fn open(&self, tree: &mut Tree, noise: &mut Noise, corner: DVec3, level: u32) {
        let edge = 0.5f64.powi(level as i32 + 1);
        let mut children = [None; 8];
        let corners: [DVec3; 8] = std::array::from_fn(|slot| {
            corner + edge * DVec3::from(std::array::from_fn(|axis| (slot >> axis & 1) as f64))
        });
        for (child, &at) in children.iter_mut().zip(&corners) {
            let centre = at + edge * 0.5;
            let (value, gradient) = surface(centre);
            // Keeps every voxel that the surface may reach, except a few that become holes.
            if value.abs() > edge * 0.9 * gradient.length() || (level >= 2 && noise.number() < 0.02) {
                continue;
            }
            let leaf = level + 1 == self.levels || (level >= 3 && noise.number() < 0.05);
            let contour = if self.contours && level >= 1 && noise.number() < 0.9 {
                let bits = Contour::encode_normal(gradient.into());
                bits.and_then(|bits| {
                    let normal = DVec3::from(Contour::decode_normal(bits));
                    let middle = -value / gradient.length() / edge * normal.length();
                    let half = 0.2 * normal.length();
                    Contour::encode_bounds(bits, middle - half, middle + half)
                })
            } else {
                None
            };
            *child = Some(Voxel { leaf, contour, ..Voxel::default() });
        }
        // A node has at least one child.
        if children.iter().all(Option::is_none) {
            children[0] = Some(Voxel { leaf: true, ..Voxel::default() });
        }
        let index = tree.open(&children);
        for (child, &at) in children.iter().zip(&corners) {
            if child.is_some_and(|voxel| !voxel.leaf) {
                self.open(tree, noise, at, level + 1);
            }
        }
        tree.close(index);
    }
}

/// Approximate distance to a dented sphere, and its gradient.
fn surface(p: DVec3) -> (f64, DVec3) {
    let from_centre = p - 0.5;
    let radius = from_centre.length().max(1e-9);
    let wave = p * 17.0;
    let value = radius - 0.38 + 0.02 * (wave.x.sin() + wave.y.sin() + wave.z.sin());
    let gradient = from_centre / radius + 0.02 * 17.0 * DVec3::new(wave.x.cos(), wave.y.cos(), wave.z.cos());
    (value, gradient)
}

/// Numbers in `0.0..1.0` from the high bits of a 64-bit linear congruential generator.
pub struct Noise(pub u64);

impl Noise {
    /// The next number.
    pub fn number(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(0x5851_f42d_4c95_7f2d).wrapping_add(0x1405_7b7e_f767_814f);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// Cameras around and in the unit cube: from far away, close to the surface, from inside, along an axis.
pub fn cameras() -> Vec<Camera> {
    let camera = |eye: [f64; 3], forward: [f64; 3], fov_degrees: f64, far: f64| Camera {
        eye,
        forward,
        up: [0.0, 1.0, 0.0],
        fov_degrees,
        near: far * 1e-4,
        far,
    };
    vec![
        camera([1.6, 1.1, 1.9], [-1.1, -0.6, -1.4], 45.0, 4.0),
        camera([0.93, 0.55, 0.52], [-1.0, -0.4, 0.3], 70.0, 2.0),
        camera([0.5, 0.51, 0.49], [0.3, 0.2, -1.0], 90.0, 2.0),
        camera([0.5, 0.5, 2.0], [0.0, 0.0, -1.0], 40.0, 3.0),
        // The far plane cuts the octree, and the ray along the axis runs between voxels.
        camera([-0.5, 0.5, 0.5], [1.0, 0.0, 0.0], 60.0, 0.75),
    ]
}

/// Every combination of the settings that select kernels: contours, beam optimization and level-of-detail termination.
pub fn options() -> Vec<CastOptions> {
    (0..8)
        .map(|bits| CastOptions {
            contours: bits & 1 != 0,
            beam: bits & 2 != 0,
            max_voxel_pixels: if bits & 4 != 0 { 3.0 } else { 0.0 },
        })
        .collect()
}

/// Views that no camera makes and that casters take: rays that overflow, are too long, have no length, run along axes or
/// faces of voxels, come from far away, or lie on planes between voxels. Each caster must find in them what the reference
/// finds, which often is nothing.
pub fn strange_views(view: &View) -> Vec<View> {
    let with = |change: &dyn Fn(&mut View)| {
        let mut view = *view;
        change(&mut view);
        view
    };
    let along = |origin: [f32; 3], base: [f32; 3]| {
        with(&|view| {
            (view.origin, view.base) = (origin, base);
            (view.dx, view.dy) = ([0.0, 1e-3, 0.0], [0.0, 0.0, 1e-3]);
        })
    };
    vec![
        // Directions that overflow to infinity, and to NaN.
        with(&|view| view.dy = [1e38; 3]),
        with(&|view| (view.dx, view.dy) = ([1e38; 3], [-1e38; 3])),
        with(&|view| view.base[0] = f32::MAX),
        with(&|view| view.dx[0] = f32::MIN),
        with(&|view| view.origin[1] = f32::MAX),
        with(&|view| view.origin = [f32::MIN_POSITIVE, -1e-45, 1e30]),
        with(&|view| (view.base, view.dx, view.dy) = ([0.0; 3], [0.0; 3], [-0.0; 3])),
        with(&|view| view.base = [-(1 << 20) as f32, 0.0, 0.0]),
        with(&|view| view.dx = [3e4, 2e4, -1e4]),
        with(&|view| view.t_near = 2.0),
        with(&|view| view.t_near = 0.0),
        with(&|view| view.t_near = f32::MAX),
        with(&|view| view.origin = [1.5; 3]),
        with(&|view| view.origin = view.origin.map(|x| x * 1e4)),
        with(&|view| view.pixel_size = f32::MAX),
        with(&|view| view.t_per_depth = f32::MAX),
        along([0.0, 1.5, 1.5], [4.0, 0.0, 0.0]),
        along([3.0, 1.5, 1.5], [-4.0, -0.0, -0.0]),
        along([0.0, 1.25, 1.75], [4.0, 0.0, 0.0]),
        along([0.0, 1.0, 2.0], [4.0, 0.0, 0.0]),
        along([-1e6, 1.5, 1.5], [1e6, 0.5, 0.5]),
        along([-1e5, -1e5, -1e5], [1e5, 1e5, 1e5]),
        along([0.0, 0.0, 0.0], [3.0, 3.0, 3.0]),
    ]
}

/// Views that every caster must refuse, and what is wrong with each: the field that the error must name.
pub fn bad_views(view: &View) -> Vec<(&'static str, View)> {
    let mut views = Vec::new();
    for (width, height) in [(0, 16), (16, 0), (0, 0), (1 << 14, (1 << 14) + 1), (u32::MAX, u32::MAX)] {
        views.push(("pixels", View { width, height, ..*view }));
    }
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        for axis in 0..3 {
            let with = |mut vector: [f32; 3]| {
                vector[axis] = bad;
                vector
            };
            views.push(("origin", View { origin: with(view.origin), ..*view }));
            views.push(("base", View { base: with(view.base), ..*view }));
            views.push(("dx", View { dx: with(view.dx), ..*view }));
            views.push(("dy", View { dy: with(view.dy), ..*view }));
        }
    }
    for bad in [f32::NAN, f32::INFINITY, -1.0, -f32::MIN_POSITIVE] {
        views.push(("t_near", View { t_near: bad, ..*view }));
        views.push(("pixel_size", View { pixel_size: bad, ..*view }));
        views.push(("max_voxel_pixels", View { max_voxel_pixels: bad, ..*view }));
        views.push(("t_per_depth", View { t_per_depth: bad, ..*view }));
    }
    views.push(("flags", View { flags: view.flags | 8, ..*view }));
    views.push(("first_row", View { first_row: 1, ..*view }));
    views
}

/// An octree of two objects: [`Sample::plain`] with 4 levels and [`Sample::scattered`] with 5.
///
/// # Errors
/// Samples that cannot be assembled.
pub fn two_objects() -> Result<Arc<Octree>, FormatError> {
    let (first, second) = (Sample::plain(4, true).octree()?, Sample::scattered(5, true).octree()?);
    let (slots, blocks) = (first.slots().len() as u64, first.blocks().len() as u32);
    let mut image = first.slots().to_vec();
    image.extend_from_slice(second.slots());
    // The pointers of the second image are distances within it, so that they stay as they are. An info section names its
    // block, in the low word of its first slot.
    for parts in second.parts() {
        image[slots as usize + (parts.start + parts.array_slots) as usize] += u64::from(blocks);
    }
    let second_objects = second.objects().iter().map(|object| ObjectEntry {
        root_block: object.root_block + blocks,
        root_slot: object.root_slot + slots,
        ..*object
    });
    let second_blocks = second.blocks().iter().map(|block| BlockEntry {
        object: 1,
        parent: if block.parent == NO_PARENT { NO_PARENT } else { block.parent + blocks },
        image_offset: block.image_offset + slots * 8,
        ..*block
    });
    let objects = first.objects().iter().cloned().chain(second_objects).collect();
    let blocks = first.blocks().iter().copied().chain(second_blocks).collect();
    Ok(Arc::new(Octree::from_parts(objects, blocks, image)?))
}

/// [`two_objects`], the second with its axes x and z exchanged, and moved in mesh space by `edges` edges of its root cube along y.
///
/// # Errors
/// A sample that cannot be assembled.
pub fn two_objects_apart(edges: f64) -> Result<Arc<Octree>, FormatError> {
    let octree = two_objects()?;
    let mut objects = octree.objects().to_vec();
    let place = &mut objects[1].octree_to_mesh;
    for axis in 0..3 {
        place.swap(axis, 8 + axis);
        place[12 + axis] += edges * place[4 + axis];
    }
    Ok(Arc::new(Octree::from_parts(objects, octree.blocks().to_vec(), octree.slots().to_vec())?))
}

/// An octree that is not [sound](Octree::sound): the child pointer of its root leads out of the image.
///
/// # Errors
/// A sample that cannot be assembled.
pub fn unsound() -> Result<Arc<Octree>, FormatError> {
    let octree = Sample::plain(3, false).octree()?;
    let mut image = octree.slots().to_vec();
    // The child pointer is in bits 17 to 31.
    image[octree.objects()[0].root_slot as usize] |= 0x7fff << 17;
    Ok(Arc::new(Octree::from_parts(octree.objects().to_vec(), octree.blocks().to_vec(), image)?))
}

/// Casts pictures of this size from all [`cameras`] with all [`options`], those with the beam in blocks of both sizes, by `caster` and by the
/// reference.
///
/// # Errors
/// What the caster said.
pub fn against_reference(
    caster: &mut dyn Caster,
    octree: &Arc<Octree>,
    size: (u32, u32),
) -> Result<Comparison, CastError> {
    caster.load(octree)?;
    let mut reference = reference::ReferenceCaster::default();
    reference.load(octree)?;
    let (mut ours, mut theirs) = (Vec::new(), Vec::new());
    let mut all = Comparison::default();
    for camera in cameras() {
        for options in options() {
            let root = octree.objects()[0].root_slot as u32;
            let view = View::new(&camera, octree.octree_to_mesh(0), root, size, &options)?;
            let wide = options.beam.then(|| view.with_wide_beam(true));
            for view in [Some(view), wide].into_iter().flatten() {
                caster.cast(&view, &mut ours)?;
                reference.cast(&view, &mut theirs)?;
                all = all.and(Comparison::of(&ours, &theirs));
            }
        }
    }
    Ok(all)
}

/// Casts the [`strange_views`] of this size with all [`options`], by `caster` and by the reference.
///
/// # Errors
/// What the caster said.
pub fn strange_against_reference(
    caster: &mut dyn Caster,
    octree: &Arc<Octree>,
    size: (u32, u32),
) -> Result<Comparison, CastError> {
    caster.load(octree)?;
    let mut reference = reference::ReferenceCaster::default();
    reference.load(octree)?;
    let (mut ours, mut theirs) = (Vec::new(), Vec::new());
    let mut all = Comparison::default();
    for options in options() {
        let root = octree.objects()[0].root_slot as u32;
        for view in strange_views(&View::new(&cameras()[0], octree.octree_to_mesh(0), root, size, &options)?) {
            caster.cast(&view, &mut ours)?;
            reference.cast(&view, &mut theirs)?;
            all = all.and(Comparison::of(&ours, &theirs));
        }
    }
    Ok(all)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_have_what_they_promise() {
        let plain = Sample::plain(6, true).octree().expect("assembles");
        assert!(plain.sound().is_ok() && plain.blocks().len() == 1 && plain.needs().contours);
        assert!(!plain.needs().far_pointers && plain.needs().levels == 6);
        let scattered = Sample::scattered(6, false).octree().expect("assembles");
        assert!(scattered.sound().is_ok() && scattered.blocks().len() > 10 && !scattered.needs().contours);
        assert!(scattered.objects()[0].far_pointers > 100);
        assert_eq!(
            plain.objects()[0].leaf_voxels,
            Sample::scattered(6, true).octree().expect("assembles").objects()[0].leaf_voxels
        );
    }

    #[test]
    fn two_objects_are_sound_and_the_unsound_is_not() {
        let two = two_objects().expect("assembles");
        two.sound().expect("is sound");
        assert!(two.objects().len() == 2 && two.objects()[1].root_slot > 2 && two.needs().levels == 5);
        assert!(unsound().expect("its tables are in order").sound().is_err());
    }

    #[test]
    fn strange_views_are_taken_and_bad_ones_refused() {
        let view = View::new(&cameras()[0], DMat4::IDENTITY, 2, (32, 24), &CastOptions::default()).expect("is valid");
        for view in strange_views(&view) {
            view.check().expect("is taken");
        }
        for (field, view) in bad_views(&view) {
            let error = view.check().expect_err(field).to_string();
            assert!(error.contains(field), "{field}: {error}");
        }
    }

    #[test]
    fn the_cameras_see_the_sample() {
        let octree = Sample::plain(5, true).octree().expect("assembles");
        let mut reference = reference::ReferenceCaster::default();
        reference.load(&octree).expect("is sound");
        let mut hits = Vec::new();
        for camera in cameras() {
            let root = octree.objects()[0].root_slot as u32;
            let view = View::new(&camera, DMat4::IDENTITY, root, (32, 24), &CastOptions::default()).expect("is valid");
            reference.cast(&view, &mut hits).expect("casts");
            let found = hits.iter().filter(|hit| !hit.is_miss()).count();
            assert!(found > 32 * 24 / 20, "{found} hits from {camera:?}");
        }
    }
}
