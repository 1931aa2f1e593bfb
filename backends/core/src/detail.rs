//! Which parts of an octree the rays of a view can read, so that the others need not be there (spec section 11.3).

use esvo_format::Region;
use glam::DVec3;

use crate::View;
use crate::frame::COARSE_VOXEL_BLOCKS;
use crate::reference::MAX_SCALE;

/// How deep the rays of a view go in a cube of an octree.
///
/// A ray reads the descriptor of a voxel only if it meets the voxel, and the voxel is larger where the ray leaves it than
/// the voxels at which rays end. So for a cube that holds the voxel, the view pyramid and the least `t` within the cube bound the
/// level. Octrees without the levels below that are hit at the same `t`, in voxels of the same size, as the whole one.
///
/// That is for the rays of the picture, the coarse pass of its beam included; not for those that go on from its hits.
#[derive(Clone, Copy, Debug)]
pub struct Detail {
    origin: DVec3,
    /// Normals of the sides of the view pyramid, outwards.
    sides: [DVec3; 4],
    /// `t` of a point is its offset from the origin times this.
    t_by_offset: DVec3,
    t_near: f64,
    t_far: f64,
    /// Edge of the voxels at which rays end, at `t = 1`.
    size_per_t: f64,
    /// How far rounding may lead rays astray, in octree units.
    slack: f64,
    /// The view has no pyramid that tells anything: all is needed.
    everything: bool,
}

impl Detail {
    /// Of the rays of a view.
    pub fn of(view: &View) -> Self {
        let vector = |v: [f32; 3]| DVec3::from(v.map(f64::from));
        let (base, dx, dy) = (vector(view.base), vector(view.dx), vector(view.dy));
        let (width, height) = (f64::from(view.width), f64::from(view.height));
        // The coarse pass has rays around the picture: one block above and left, and up to two below and right.
        let block = if view.beam() { f64::from(view.beam_block()) } else { 0.0 };
        let (left, right, top, bottom) = (-block, width + 2.0 * block, -block, height + 2.0 * block);
        let middle = base + dx * (width / 2.0) + dy * (height / 2.0);
        let outwards = |normal: DVec3| if normal.dot(middle) > 0.0 { -normal } else { normal };
        let sides = [
            outwards((base + dx * left).cross(dy)),
            outwards((base + dx * right).cross(dy)),
            outwards((base + dy * top).cross(dx)),
            outwards((base + dy * bottom).cross(dx)),
        ];
        let depth = dx.cross(dy);
        let t_by_offset = depth / base.dot(depth);
        let fine = f64::from(view.max_voxel_pixels);
        let coarse = f64::from(view.beam_block()) * f64::from(COARSE_VOXEL_BLOCKS);
        let pixels = if view.beam() { fine.min(coarse) } else { fine };
        let origin = vector(view.origin);
        let far = [base, base + dx * width, base + dy * height, base + dx * width + dy * height];
        let reach = far.iter().map(|corner| corner.abs().max_element()).fold(origin.abs().max_element(), f64::max);
        let usable = sides.iter().all(|side| side.length() > 0.0 && side.dot(middle) < 0.0) && t_by_offset.is_finite();
        Self {
            origin,
            sides,
            t_by_offset,
            t_near: view.t_near.into(),
            // Coarse rays go on behind the far plane.
            t_far: if view.beam() { f64::INFINITY } else { 1.0 },
            size_per_t: f64::from(view.pixel_size) * pixels,
            slack: 16.0 * f64::from(f32::EPSILON) * (2.0 + reach),
            everything: !usable,
        }
    }

    /// The deepest level of voxels that rays can tell apart in a closed box of octree space; 0 if no ray comes there. A box within
    /// another has no deeper one.
    pub fn level(&self, cube: &Region) -> u32 {
        if self.everything {
            return MAX_SCALE;
        }
        // The octree is the cube from 1 to 2.
        let low = cube.low + 1.0 - self.slack - self.origin;
        let high = cube.high + 1.0 + self.slack - self.origin;
        // Least and greatest of a linear function.
        let least = |normal: DVec3| (normal * low).min(normal * high).element_sum();
        let greatest = |normal: DVec3| (normal * low).max(normal * high).element_sum();
        let (first, last) = (least(self.t_by_offset), greatest(self.t_by_offset));
        if last < self.t_near || first > self.t_far || self.sides.iter().any(|side| least(*side) > 0.0) {
            return 0;
        }
        // Voxels of level L, of edge 2^-L, are entered if they are larger than this.
        let ends = first.max(self.t_near).max(0.0) * self.size_per_t * (1.0 - 16.0 * f64::from(f32::EPSILON));
        (1..MAX_SCALE).find(|level| (-f64::from(*level)).exp2() <= ends).unwrap_or(MAX_SCALE)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use esvo_format::{IndexReader, Octree, StreamReader, WriteOptions};

    use super::*;
    use crate::reference::ReferenceCaster;
    use crate::testing::sample::two_objects_apart;
    use crate::{Camera, CastOptions, Caster, Hit, Object};

    fn cast(octree: &Arc<Octree>, view: &View) -> Vec<Hit> {
        let mut caster = ReferenceCaster::default();
        caster.load(octree).unwrap();
        let mut hits = Vec::new();
        caster.cast(view, &mut hits).unwrap();
        hits
    }

    /// Pixels of which `t` or the size of the voxel differs.
    fn differences(a: &[Hit], b: &[Hit]) -> usize {
        a.iter().zip(b).filter(|(a, b)| a.t() != b.t() || !a.is_miss() && a.size() != b.size()).count()
    }

    #[test]
    fn rays_find_the_same_in_what_they_need() {
        let whole = two_objects_apart(1.0).unwrap();
        let mut file = Vec::new();
        whole.write_to_with(&mut file, &WriteOptions { parts: true, ..WriteOptions::default() }).unwrap();
        let whole = Arc::new(whole);
        let tables = StreamReader::open(&file).unwrap();
        let (mut fewer, mut wrong, mut cases) = (0, 0, 0);
        for (eye, forward) in [
            ([0.3, 0.4, 3.0], [0.1, 0.0, -1.0]),
            ([0.5, 0.5, 0.9], [1.0, 0.2, -0.3]),
            ([-2.0, 1.5, 0.2], [1.0, -0.4, 0.1]),
            ([0.1, 0.2, 0.3], [0.0, -1.0, 0.1]),
            ([40.0, 30.0, 20.0], [-40.0, -29.5, -19.5]),
        ] {
            let objects = Object::all(&whole);
            let (near, far) = crate::camera::viewpoint::planes_of(&objects, eye);
            let camera = Camera { eye, forward, up: [0.0, 1.0, 0.1], fov_degrees: 50.0, near, far };
            for max_voxel_pixels in [0.0, 1.0, 4.0, 30.0] {
                for beam in [None, Some(false), Some(true)] {
                    let options = CastOptions { beam: beam.is_some(), max_voxel_pixels, ..CastOptions::default() };
                    let views = |objects: &[Object]| -> Vec<View> {
                        let view = |o: &Object| o.view(&camera, (48, 36), &options).unwrap();
                        objects.iter().map(view).map(|v| v.with_wide_beam(beam == Some(true))).collect()
                    };
                    let details: Vec<Detail> = views(&objects).iter().map(Detail::of).collect();
                    let level = |object: usize, cube: &Region| details[object].level(cube);
                    let part = Arc::new(IndexReader::open(&file).unwrap().octree_by(level).unwrap());
                    fewer += usize::from(part.slots().len() < whole.slots().len());
                    // One level less is noticed.
                    let less = |object: usize, cube: &Region| level(object, cube).saturating_sub(1);
                    let worse = Arc::new(tables.partial_parts(&tables.parts_by(less)).unwrap());
                    let on = |octree: &Arc<Octree>| -> Vec<Hit> {
                        views(&Object::all(octree)).iter().flat_map(|view| cast(octree, view)).collect()
                    };
                    let expected = on(&whole);
                    assert_eq!(differences(&expected, &on(&part)), 0, "{eye:?}, {max_voxel_pixels} px, {beam:?}");
                    wrong += usize::from(differences(&expected, &on(&worse)) > 0);
                    cases += 1;
                }
            }
        }
        assert!(fewer > cases / 4, "{fewer} of {cases} octrees are smaller");
        assert!(wrong > 0, "the negative control: one level less gives the same everywhere");
    }

    #[test]
    fn what_is_within_needs_no_more() {
        let octree = two_objects_apart(1.0).unwrap();
        let object = Object::of(&octree, 0);
        let camera = Camera {
            eye: [0.5, 0.4, 1.5],
            forward: [0.2, 0.1, -1.0],
            up: [0.0, 1.0, 0.0],
            fov_degrees: 40.0,
            near: 0.01,
            far: 9.0,
        };
        let detail = Detail::of(&object.view(&camera, (64, 64), &CastOptions::default()).unwrap());
        let (mut none, mut found) = (0, 0);
        for scale in [22u32, 21, 20] {
            let edge = 1u32 << scale;
            for index in 0..1u32 << (3 * (23 - scale)) {
                let bits = 23 - scale;
                let at = [0, 1, 2].map(|axis| (index >> (axis * bits) & ((1 << bits) - 1)) * edge);
                let level = detail.level(&Region::cube(at, scale));
                let above = detail.level(&Region::cube(at.map(|x| x >> (scale + 1) << (scale + 1)), scale + 1));
                assert!(level <= above);
                none += u32::from(level == 0);
                found += u32::from(level > 0);
            }
        }
        assert!(none > 20 && found > 20, "{none} outside, {found} inside");
    }
}
