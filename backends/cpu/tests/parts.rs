//! Octrees of only the parts that a camera needs are cast exactly like the whole (spec section 11.3).

use std::sync::Arc;

use esvo_core::reference::ReferenceCaster;
use esvo_core::testing::sample::Sample;
use esvo_core::{Caster, Hit, Ray, Rays};
use esvo_cpu::CpuCaster;
use esvo_format::{AssembleOptions, Octree, StreamReader, Tree, Voxel, WriteOptions, assemble};
use glam::{DMat4, DVec3, Vec3};

/// A rough surface of one side of the cube, in many blocks, and the file with parts.
fn surface() -> (Arc<Octree>, Vec<u8>) {
    fn grow(tree: &mut Tree, level: u32, low: DVec3, edge: f64) {
        let half = edge / 2.0;
        let corner =
            |slot: usize| low + half * DVec3::new((slot & 1) as f64, (slot >> 1 & 1) as f64, (slot >> 2) as f64);
        let height = |x: f64, y: f64| 0.45 + 0.2 * (7.0 * x).sin() * (5.0 * y).cos();
        let meets = |slot: usize| {
            let at = corner(slot);
            let heights = [(0.0, 0.0), (half, 0.0), (0.0, half), (half, half)].map(|(x, y)| height(at.x + x, at.y + y));
            let least = heights.iter().copied().fold(f64::MAX, f64::min);
            let most = heights.iter().copied().fold(f64::MIN, f64::max);
            at.z <= most && at.z + half >= least
        };
        let children: [Option<Voxel>; 8] =
            std::array::from_fn(|slot| meets(slot).then(|| Voxel { leaf: level == 8, ..Voxel::default() }));
        let index = tree.open(&children);
        for slot in (0..8).filter(|slot| children[*slot].is_some_and(|voxel| !voxel.leaf)) {
            grow(tree, level + 1, corner(slot), half);
        }
        tree.close(index);
    }
    let mut tree = Tree::default();
    grow(&mut tree, 1, DVec3::ZERO, 1.0);
    let octree = assemble(&tree, DMat4::IDENTITY, &AssembleOptions { block_slots: 1500, near_limit: 200 });
    in_parts(octree.expect("a surface"))
}

fn in_parts(octree: Octree) -> (Arc<Octree>, Vec<u8>) {
    let mut bytes = Vec::new();
    octree.write_to_with(&mut bytes, &WriteOptions { parts: true, ..WriteOptions::default() }).expect("memory");
    (Arc::new(octree), bytes)
}

/// The parts that rays from `eye` need that voxels end with an edge of at most `size` times the distance. A descriptor is only
/// looked at if its voxel does not end the ray, and its voxel is at least as far away as the cube of its block.
fn needed<S: esvo_format::RangeRead>(reader: &StreamReader<S>, eye: DVec3, size: f64) -> Vec<u32> {
    let wanted = |part: &esvo_format::file::PartEntry| {
        let block = &reader.blocks()[part.block as usize];
        let low = DVec3::from(block.cube_position.map(f64::from)) / f64::from(1 << 23);
        let high = low + f64::from(1 << block.cube_scale) / f64::from(1 << 23);
        let distance = (eye.clamp(low, high) - eye).length();
        // A little more, for rounding.
        (-f64::from(part.first_level)).exp2() * 1.001 > size * distance
    };
    (0..).zip(reader.parts()).filter(|(_, part)| wanted(part)).map(|(index, _)| index).collect()
}

fn cast(caster: &mut dyn Caster, octree: &Arc<Octree>, rays: &[Ray]) -> Vec<Hit> {
    caster.load(octree).expect("a sound octree");
    let mut hits = Vec::new();
    let rays = Rays { root: octree.objects()[0].root_slot as u32, contours: true, rays };
    caster.cast_rays(&rays, &mut hits).expect("rays");
    hits
}

#[test]
fn the_parts_that_a_camera_needs_are_cast_like_the_whole() {
    let scattered = Arc::into_inner(Sample::scattered(6, true).octree().expect("a sample")).expect("the only one");
    let (mut fewer, mut differ, mut hit) = (0, 0, 0);
    for (octree, bytes) in [surface(), in_parts(scattered)] {
        let reader = StreamReader::open(&bytes).expect("our own file");
        for (eye, size) in [
            (DVec3::new(0.5, 0.5, 0.9), 0.004),
            (DVec3::new(0.1, 0.1, 1.5), 0.01),
            (DVec3::new(-0.3, 0.4, 0.7), 0.03),
            (DVec3::new(1.9, 1.2, 2.0), 0.06),
            (DVec3::new(0.3, 0.7, 0.8), 0.2),
        ] {
            let origin = (eye + 1.0).as_vec3();
            let rays: Vec<Ray> = (0..64 * 64)
                .map(|i| {
                    let target = Vec3::new((i % 64) as f32 / 63.0, (i / 64) as f32 / 63.0, 0.45) + 1.0;
                    let size_per_t = size as f32;
                    Ray { size_per_t, ..Ray::new(origin, (target - origin).normalize()) }
                })
                .collect();
            let parts = needed(&reader, eye, size);
            fewer += usize::from(parts.len() < reader.parts().len());
            let part = Arc::new(reader.partial_parts(&parts).expect("closed"));
            let coarse = Arc::new(reader.partial_parts(&needed(&reader, eye, 4.0 * size)).expect("closed"));
            let casters: [Box<dyn Caster>; 2] =
                [Box::new(ReferenceCaster::default()), Box::new(CpuCaster::new(Some(1)).expect("threads"))];
            for mut caster in casters {
                let whole = cast(&mut *caster, &octree, &rays);
                let same = |other: &[Hit]| {
                    let equal = |(a, b): (&Hit, &Hit)| (a.raw_t.to_bits(), a.voxel) == (b.raw_t.to_bits(), b.voxel);
                    whole.iter().zip(other).filter(|pair| equal(*pair)).count()
                };
                let found = cast(&mut *caster, &part, &rays);
                assert_eq!(same(&found), rays.len(), "eye {eye}, size {size}");
                hit += whole.iter().filter(|hit| !hit.is_miss()).count();
                // With less than what the camera needs, pictures differ.
                differ += rays.len() - same(&cast(&mut *caster, &coarse, &rays));
            }
        }
    }
    assert!(fewer >= 6 && hit > 10_000 && differ > 100, "{fewer} of 10 with fewer parts, {hit} hits, {differ} differ");
}
