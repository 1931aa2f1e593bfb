//! The checks of [`Caster::cast_rays`](crate::Caster::cast_rays).

use std::sync::Arc;

use esvo_format::Octree;

use super::broken::{Broken, RAY_WAYS};
use super::checks::demand_agreement;
use super::{Fault, Subject, demand};
use crate::gpu::kernel::{CAST_WGSL, GpuOptions};
use crate::testing::compare::{Allowed, Comparison};
use crate::testing::directed::{Kind, Target, data_sets, ray};
use crate::testing::oracle::Oracle;
use crate::testing::rays::{against_reference, both, incoherent, strange};
use crate::testing::sample::{Sample, two_objects};
use crate::{CastError, Caster, Device, DeviceKind, Hit, Ray, Rays};

/// Mistakes in what the kernel does with a buffer of rays alone.
const RAY_MISTAKES: [(&str, &str); 4] = [
    ("footprint = mad(tc_max, ray.size_per_t, ray.size_at_origin);", ""),
    ("ray.t_max = rays[at].t_max;", "ray.t_max = 1.0;"),
    ("if at >= view.width {", "if at >= view.width - 1u {"),
    ("rays[at].origin[2]);", "rays[0].origin[2]);"),
];

/// What the kernel does as the paper does not, undone.
const ASTRAY: [&[(&str, &str)]; 2] = [
    &[("t_min = max(t_min, tc_max);", "t_min = tc_max;")],
    &[
        ("    var scale = MAX_SCALE - 1u;\n", "    var scale = MAX_SCALE - 1u;\n    var h = t_max;\n"),
        (
            "stack_parent[scale - LOWEST_SCALE] = parent;",
            // What is in a frame that was not written depends on the driver; here it is what leads farthest astray.
            "stack_parent[scale - LOWEST_SCALE] = select(ray.root, parent, tc_max < h);",
        ),
        (
            "stack_t_max[scale - LOWEST_SCALE] = t_max;",
            "stack_t_max[scale - LOWEST_SCALE] = select(0.0, t_max, tc_max < h);\n h = tc_max;",
        ),
        (
            "    idx = axes((path & vec3<u32>(1u)) != vec3<u32>(0u));",
            "    idx = axes((path & vec3<u32>(1u)) != vec3<u32>(0u)); h = 0.0;",
        ),
    ],
];

/// Rays to compare on this device: many where that takes no long time.
fn count(device: &Device) -> usize {
    if device.kind == DeviceKind::Cpu { 100_000 } else { 1000 }
}

fn agrees_on(caster: &mut dyn Caster, octree: &Arc<Octree>, rays: &[Ray]) -> Result<(), Fault> {
    let comparison = against_reference(caster, octree, rays)?;
    demand_agreement(caster, &comparison)
}

/// Incoherent rays of every span and size give the reference's hits: 1,000, on a processor 100,000, and numbers around
/// those of packets and workgroups.
///
/// # Errors
/// Rays that end elsewhere; what the caster said.
pub fn rays_agree(subject: &Subject) -> Result<(), Fault> {
    let mut caster = subject.open()?;
    let rays = incoherent(count(caster.device()), 1);
    agrees_on(&mut *caster, &Sample::plain(7, true).octree()?, &rays)?;
    let scattered = Sample::scattered(6, true).octree()?;
    agrees_on(&mut *caster, &scattered, &incoherent(1000, 2))?;
    agrees_on(&mut *caster, &Sample::plain(6, false).octree()?, &incoherent(1000, 3))?;
    for count in [1, 2, 15, 16, 17, 63, 64, 65, 129] {
        agrees_on(&mut *caster, &scattered, &incoherent(count, 4))?;
    }
    // Without sizes, engines may take other code.
    let without: Vec<Ray> =
        incoherent(500, 5).iter().map(|ray| Ray { size_at_origin: 0.0, size_per_t: 0.0, ..*ray }).collect();
    agrees_on(&mut *caster, &scattered, &without)
}

/// Hard rays through hard octrees give the reference's hits; where a device may round otherwise, what the
/// [oracle](crate::testing::oracle) allows. Among them are rays that rounding led astray in the paper's traversal.
///
/// # Errors
/// Rays that end elsewhere; what the caster said.
pub fn hard_rays_agree(subject: &Subject) -> Result<(), Fault> {
    hard_rays(&mut *subject.open()?)
}

/// The paper's traversal, which rounding can lead astray, does not pass: `t` that goes back, and frames that are not written.
///
/// # Errors
/// A kernel that passes, or that no longer has the lines; what the caster said elsewhere.
pub fn kernels_led_astray_are_caught(subject: &Subject) -> Result<(), Fault> {
    for changes in ASTRAY {
        let mut kernel = CAST_WGSL.to_owned();
        for (right, wrong) in changes {
            demand(kernel.contains(right), || format!("the kernel has no {right:?}"))?;
            kernel = kernel.replace(right, wrong);
        }
        let kernel = Some(kernel);
        let mut caster = subject.open_with(&GpuOptions { kernel, ..GpuOptions::default() })??;
        match hard_rays(&mut *caster) {
            Err(Fault::Wrong(_)) => {}
            Err(other) => return Err(other),
            Ok(()) => return Err(Fault::Wrong(format!("not noticed: {changes:?}"))),
        }
    }
    Ok(())
}

fn hard_rays(caster: &mut dyn Caster) -> Result<(), Fault> {
    for set in data_sets()? {
        let oracle = Oracle::new(&set.octree, 0);
        let target = Target::of(&set.octree, 10_000);
        let kinds = Kind::ALL.into_iter().flat_map(|kind| (0..400).map(move |number| (kind, number)));
        let rays: Vec<Ray> = kinds.map(|(kind, number)| ray(kind, &target, number)).collect();
        for contours in [false, true] {
            let (ours, theirs) = both(caster, &set.octree, &rays, contours)?;
            let exact = Allowed::on(caster.device().kind) == Allowed::EXACT;
            for (ray, (hit, expected)) in rays.iter().zip(ours.iter().zip(&theirs)) {
                let same = hit.same_voxel(expected) && hit.raw_t == expected.raw_t;
                let right = same || (!exact && oracle.judge_hit(ray, contours, hit).is_ok());
                demand(right, || format!("{}, {ray:?}: {hit:?} instead of {expected:?}", set.name))?;
            }
        }
    }
    Ok(())
}

/// No rays give no hits, each object's rays its own hits, and more rays after fewer, and fewer after more, theirs.
///
/// # Errors
/// Hits that are too many, too few or of other rays; what the caster said.
pub fn lists_of_rays_stand_alone(subject: &Subject) -> Result<(), Fault> {
    let octree = two_objects()?;
    let mut caster = subject.open()?;
    caster.load(&octree)?;
    let all = incoherent(300, 6);
    let mut found = Vec::new();
    for (object, count) in [(0, 100), (1, 300), (0, 0), (1, 300), (0, 100), (1, 1)] {
        let rays = Rays::new(&octree, object, &all[..count]);
        let mut hits = vec![Hit::miss(7); 150];
        caster.cast_rays(&rays, &mut hits)?;
        demand(hits.len() == count, || format!("{} hits of {count} rays", hits.len()))?;
        let theirs: Vec<Hit> =
            rays.rays.iter().map(|ray| crate::reference::cast_ray(&octree, rays.root, ray, true)).collect();
        if count > 0 {
            demand_agreement(&*caster, &Comparison::of(&hits, &theirs))?;
        }
        found.push(hits);
    }
    demand(found[0] == found[4] && found[1] == found[3], || "the same rays give other hits".into())?;
    demand(found[0][..] != found[1][..100], || "both objects look the same: the test tests nothing".into())
}

/// Rays that are not finite, NaN, too long, along faces, or of strange spans and sizes end; where rounding is the
/// reference's, they end where the reference's do. Those that [are not cast](Ray::is_cast) miss everywhere.
///
/// # Errors
/// Rays that end elsewhere; what the caster said.
pub fn strange_lists_of_rays_agree(subject: &Subject) -> Result<(), Fault> {
    let mut caster = subject.open()?;
    let rays = strange();
    for octree in [Sample::plain(7, true).octree()?, Sample::scattered(6, true).octree()?] {
        if caster.device().kind != DeviceKind::Gpu {
            agrees_on(&mut *caster, &octree, &rays)?;
        }
        let (hits, _) = crate::testing::rays::both(&mut *caster, &octree, &rays, true)?;
        for (ray, hit) in rays.iter().zip(&hits) {
            demand(ray.is_cast() || hit.is_miss(), || format!("{ray:?} hits: {hit:?}"))?;
        }
    }
    Ok(())
}

/// The comparison of rays has teeth: the engine with any of several mistakes added does not pass.
///
/// # Errors
/// A mistake that is not noticed; what the caster said.
pub fn broken_casters_of_rays_are_caught(subject: &Subject) -> Result<(), Fault> {
    broken_casters_of_rays_are_caught_by(subject, &against_reference)
}

/// Compares an engine with the reference on rays.
pub(super) type CompareRays = dyn Fn(&mut dyn Caster, &Arc<Octree>, &[Ray]) -> Result<Comparison, CastError>;

pub(super) fn broken_casters_of_rays_are_caught_by(subject: &Subject, compare: &CompareRays) -> Result<(), Fault> {
    let octree = Sample::scattered(6, true).octree()?;
    for way in &RAY_WAYS {
        let mut broken = Broken { caster: subject.open()?, way };
        let allowed = Allowed::on(broken.device().kind);
        if way.only_exact && allowed != Allowed::EXACT {
            continue;
        }
        let comparison = compare(&mut broken, &octree, &incoherent(1000, 7))?;
        demand(!allowed.admits(&comparison), || format!("not noticed: {}: {comparison:?}", way.what))?;
    }
    Ok(())
}

/// Rays that exceed what one dispatch takes are cast in several: hits are the reference's.
///
/// # Errors
/// Rays that end elsewhere; what the caster said.
pub fn batches_of_rays_agree(subject: &Subject) -> Result<(), Fault> {
    let octree = Sample::scattered(6, true).octree()?;
    let mut caster = subject.open_with(&GpuOptions { max_rays: Some(100), ..GpuOptions::default() })??;
    for count in [99, 100, 101, 250, 300] {
        agrees_on(&mut *caster, &octree, &incoherent(count, 8))?;
    }
    Ok(())
}

/// The comparison of rays has teeth: a kernel with any of several mistakes in it does not pass.
///
/// # Errors
/// A mistake that is not noticed, or that replaces a line that the kernel no longer has; what the caster said.
pub fn kernels_that_break_rays_are_caught(subject: &Subject) -> Result<(), Fault> {
    let octree = Sample::scattered(6, true).octree()?;
    for (right, wrong) in RAY_MISTAKES {
        demand(CAST_WGSL.contains(right), || format!("the kernel has no {right:?}"))?;
        let kernel = Some(CAST_WGSL.replace(right, wrong));
        let mut caster = subject.open_with(&GpuOptions { kernel, ..GpuOptions::default() })??;
        let comparison = against_reference(&mut *caster, &octree, &incoherent(1000, 9))?;
        demand(!Allowed::GPU.admits(&comparison), || format!("not noticed: {wrong}: {comparison:?}"))?;
    }
    Ok(())
}
