//! A caster of one's own: every leaf cube against every ray, checked against the reference caster.
//! Slow, without contours and beam. `cargo run -p esvo-examples --example own_backend`

use std::sync::Arc;
use std::time::{Duration, Instant};

use esvo_core::reference::{self, MAX_SCALE};
use esvo_core::testing::{compare::Allowed, compare::Comparison, sample};
use esvo_core::{
    CastError, CastOptions, Caster, Checked, Device, DeviceKind, FrameTime, Hit, Ray, Rays, Roots, View, exp2,
};
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
    fn cast_checked(&mut self, view: Checked<View>, hits: &mut Vec<Hit>) -> Result<(), CastError> {
        let view = self.roots().ok_or(CastError::NotLoaded)?.open(&view)?;
        let ray = |pixel: usize| view.ray(pixel as u32 % view.width, pixel as u32 / view.width);
        let rays: Vec<Ray> = (0..view.pixels()).map(ray).collect();
        self.cast_rays(&Rays { root: view.root, contours: false, rays: &rays }, hits)
    }
    fn cast_rays_checked(&mut self, rays: Checked<Rays<'_>>, hits: &mut Vec<Hit>) -> Result<(), CastError> {
        let (octree, roots) = self.1.as_ref().ok_or(CastError::NotLoaded)?;
        let (rays, mut leaves) = (roots.open(&rays)?, Vec::new());
        collect(octree, rays.root, Vec3::ONE, MAX_SCALE, &mut leaves);
        *hits = rays.rays.iter().map(|ray| nearest(&leaves, ray)).collect();
        Ok(())
    }
    fn time_checked(&mut self, view: Checked<View>) -> Result<FrameTime, CastError> {
        let start = Instant::now();
        self.cast_checked(view, &mut Vec::new()).map(|()| FrameTime { total: start.elapsed(), coarse: Duration::ZERO })
    }
}

/// The leaf voxels below a descriptor: lower corner, the root cube being `[1, 2]³`, and the hit that names the voxel.
fn collect(octree: &Octree, slot: u32, low: Vec3, scale: u32, leaves: &mut Vec<(Vec3, Hit)>) {
    let edge = exp2(scale as i32 - 1 - MAX_SCALE as i32);
    for child in (0..8u8).filter(|child| octree.descriptor(slot).valid_mask() >> child & 1 != 0) {
        let corner = low + edge * Vec3::new((child & 1).into(), (child >> 1 & 1).into(), (child >> 2).into());
        match octree.child(slot, child) {
            Some(below) => collect(octree, below, corner, scale - 1, leaves),
            None => leaves.push((corner, Hit::new(0.0, slot, child.into(), scale - 1, 1))),
        }
    }
}

fn nearest(leaves: &[(Vec3, Hit)], ray: &Ray) -> Hit {
    leaves.iter().fold(Hit::miss(1), |best, (low, hit)| {
        let (a, b) = ((low - ray.origin) / ray.direction, (low + hit.size() - ray.origin) / ray.direction);
        let (enter, leave) = (a.min(b).max_element().max(ray.t_min), a.max(b).min_element().min(ray.t_max));
        if enter <= leave && enter < best.raw_t { Hit { raw_t: enter, ..*hit } } else { best }
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
    let comparison = Comparison::of(&hits, &expected);
    println!("{} of {} rays end at another voxel", comparison.mismatches(), comparison.rays);
    let allowed = Allowed { share: 1e-3, t: 1e-6 };
    if allowed.admits(&comparison) { Ok(()) } else { Err("the casters disagree".into()) }
}
