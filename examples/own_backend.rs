//! A caster of one's own: every voxel's cube against every ray, checked against the reference caster.
//! Slow, without contours and beam. `cargo run -p esvo-examples --example own_backend`

use std::sync::Arc;

use esvo_core::reference::{self, EPSILON, MAX_SCALE};
use esvo_core::testing::{compare::Allowed, compare::Comparison, rays, sample};
use esvo_core::{CastError, CastOptions, Caster, Checked, Device, DeviceKind, Hit, Ray, Rays, Roots, View, exp2};
use esvo_format::Octree;
use glam::Vec3;

/// The device, and the octree that is loaded with its roots.
struct BruteForce(Device, Option<(Arc<Octree>, Roots)>);

impl Caster for BruteForce {
    fn name(&self) -> &'static str {
        "brute-force"
    }
    fn device(&self) -> &Device {
        &self.0
    }
    fn resident_bytes(&self) -> u64 {
        self.1.as_ref().map_or(0, |(octree, _)| size_of_val(octree.slots()) as u64)
    }
    fn roots(&self) -> Option<&Roots> {
        self.1.as_ref().map(|(_, roots)| roots)
    }
    fn load_checked(&mut self, octree: &Arc<Octree>, roots: Roots) -> Result<(), CastError> {
        self.1 = Some((octree.clone(), roots));
        Ok(())
    }
    fn cast_rays_checked(&mut self, rays: Checked<Rays<'_>>, hits: &mut Vec<Hit>) -> Result<(), CastError> {
        let (octree, roots) = self.1.as_ref().ok_or(CastError::NotLoaded)?;
        let (rays, mut voxels) = (roots.open(&rays)?, Vec::new());
        collect(octree, rays.root, Vec3::ONE, MAX_SCALE, &mut voxels);
        *hits = rays.rays.iter().map(|ray| nearest(&voxels, ray)).collect();
        Ok(())
    }
}

/// A voxel.
struct Cube {
    /// Lower corner; the root cube is `[1, 2]³`.
    low: Vec3,
    leaf: bool,
    /// The hit that names the voxel.
    hit: Hit,
}

/// The voxels below a descriptor, each before its children.
fn collect(octree: &Octree, slot: u32, low: Vec3, scale: u32, voxels: &mut Vec<Cube>) {
    let edge = exp2(scale as i32 - 1 - MAX_SCALE as i32);
    for child in (0..8u8).filter(|child| octree.descriptor(slot).valid_mask() >> child & 1 != 0) {
        let low = low + edge * Vec3::new((child & 1).into(), (child >> 1 & 1).into(), (child >> 2).into());
        let below = octree.child(slot, child);
        voxels.push(Cube { low, leaf: below.is_none(), hit: Hit::new(0.0, slot, child.into(), scale - 1, 1) });
        if let Some(below) = below {
            collect(octree, below, low, scale - 1, voxels);
        }
    }
}

/// The first voxel on the ray that is a leaf or small enough to end it. Of equally near ones the first, which is the largest.
fn nearest(voxels: &[Cube], ray: &Ray) -> Hit {
    if !ray.is_cast() {
        return Hit::miss(1);
    }
    // As all casters do, so that nothing divides by zero.
    let direction = ray.direction.map(|d| if d.abs() < EPSILON { EPSILON.copysign(d) } else { d });
    voxels.iter().fold(Hit::miss(1), |best, Cube { low, leaf, hit }| {
        let (a, b) = ((low - ray.origin) / direction, (low + hit.size() - ray.origin) / direction);
        let (enter, leave) = (a.min(b).max_element().max(ray.t_min), a.max(b).min_element());
        let ends = *leaf || ray.size_at_origin + leave * ray.size_per_t >= hit.size();
        let nearer = best.t().is_none_or(|t| enter < t);
        if ends && nearer && enter <= leave.min(ray.t_max) { Hit { raw_t: enter, ..*hit } } else { best }
    })
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let octree = sample::Sample::plain(4, false).octree()?;
    let device = Device { name: "processor".into(), kind: DeviceKind::Cpu, detail: "1 thread".into() };
    let options = CastOptions { contours: false, beam: false, max_voxel_pixels: 0.0 };
    let (camera, root) = (sample::cameras()[0], octree.objects()[0].root_slot as u32);
    let view = View::new(&camera, octree.octree_to_mesh(0), root, (160, 120), &options)?;
    let (mut own, mut hits, mut expected) = (BruteForce(device, None), Vec::new(), Vec::new());
    own.load(&octree)?;
    own.cast(&view, &mut hits)?;
    reference::cast_fine(&octree, &view, &[], &mut expected);
    let mut all = vec![Comparison::of(&hits, &expected)];
    // Rays of many kinds, and one that hits farther away than any ray of the picture.
    let far = Ray::new(Vec3::new(-2.0, 1.4, 1.3), Vec3::X);
    for rays in [rays::incoherent(2000, 1), vec![far]] {
        let (hits, expected) = rays::both(&mut own, &octree, &rays, false)?;
        all.push(Comparison::of(&hits, &expected));
    }
    let (wrong, rays) = all.iter().fold((0, 0), |(wrong, rays), one| (wrong + one.mismatches(), rays + one.rays));
    println!("{wrong} of {rays} rays end at another voxel");
    // Sums are rounded in another order. Rays of a list start farther away, some almost along an axis: t is less exact.
    let allowed = [1e-6, 1e-5, 1e-5].map(|t| Allowed { share: 1e-3, t });
    if all.iter().zip(allowed).all(|(one, allowed)| allowed.admits(one)) {
        Ok(())
    } else {
        Err("the casters disagree".into())
    }
}
