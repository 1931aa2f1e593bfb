//! What every caster that runs the GPU kernel must do, as checks for their tests.
//!
//! ```
//! # use esvo_core::testing::conformance::{self, Fault};
//! # use esvo_core::gpu::kernel::GpuOptions;
//! # use esvo_core::reference::ReferenceCaster;
//! # use esvo_core::{CastError, Caster};
//! fn make(_: &GpuOptions) -> Result<Box<dyn Caster>, CastError> {
//!     Ok(Box::new(ReferenceCaster::default()))
//! }
//!
//! // In a test that returns the result:
//! conformance::on_device(&make, conformance::nothing_is_left_of_the_frame_before)
//! # ?; Ok::<(), Fault>(())
//! ```

use std::fmt::Debug;
use std::sync::Arc;
use std::time::Instant;

use esvo_format::{FormatError, Octree};

use crate::gpu::kernel::{CAST_WGSL, GpuOptions};
use crate::testing::compare::Comparison;
use crate::testing::sample::{Sample, against_reference, cameras, strange_against_reference};
use crate::{CastError, CastOptions, Caster, DeviceKind, Hit, View};

/// Opens a caster.
pub type Make<'a> = &'a dyn Fn(&GpuOptions) -> Result<Box<dyn Caster>, CastError>;

/// Why a caster does not conform.
#[derive(thiserror::Error)]
pub enum Fault {
    /// It does not do what it must.
    #[error("{0}")]
    Wrong(String),
    /// It failed where it must not.
    #[error(transparent)]
    Cast(#[from] CastError),
    /// A sample could not be assembled.
    #[error(transparent)]
    Sample(#[from] FormatError),
}

/// As it is displayed: this is what a test that returns it prints.
impl Debug for Fault {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{self}")
    }
}

/// [`Fault::Wrong`] with what was found, unless `right`.
fn demand(right: bool, found: impl FnOnce() -> String) -> Result<(), Fault> {
    if right { Ok(()) } else { Err(Fault::Wrong(found())) }
}

/// Runs a check, but says that it was skipped where there is no device and the environment variable `ESVO_REQUIRE_GPU`
/// does not demand one.
///
/// # Errors
/// As the check; no device although one is demanded.
pub fn on_device(make: Make<'_>, check: fn(Make<'_>) -> Result<(), Fault>) -> Result<(), Fault> {
    match make(&GpuOptions::default()) {
        Err(error) if std::env::var_os("ESVO_REQUIRE_GPU").is_none() => {
            println!("skipped: {error}");
            Ok(())
        }
        opened => {
            drop(opened?);
            check(make)
        }
    }
}

/// A software driver rounds as the reference does and must agree in every ray and every bit. A GPU's compiler may fuse
/// multiplications with additions and its division need not be exact: 1 ray in 100,000 may end elsewhere.
fn demand_agreement(caster: &dyn Caster, comparison: Comparison) -> Result<(), Fault> {
    let (share, ulps) = if caster.device().kind == DeviceKind::SoftwareGpu { (0.0, 0) } else { (1e-5, 1 << 12) };
    let agrees = comparison.rays > 0 && comparison.within(share, ulps);
    demand(agrees, || format!("{}: {comparison:?}", caster.device().name))
}

/// It finds what the reference finds: with and without contours, in one block and in many.
///
/// # Errors
/// Rays that end elsewhere; what the caster said.
pub fn agrees(make: Make<'_>) -> Result<(), Fault> {
    let mut caster = make(&GpuOptions::default())?;
    for sample in [Sample::plain(7, true), Sample::plain(6, false), Sample::scattered(7, true)] {
        let comparison = against_reference(&mut *caster, &sample.octree()?, (131, 75))?;
        demand_agreement(&*caster, comparison)?;
    }
    Ok(())
}

/// It takes rays that no camera makes; on a software driver it finds the same along them as the reference. A GPU that
/// rounds in its own way sends rays that touch planes between voxels either way.
///
/// # Errors
/// Rays that end elsewhere; what the caster said.
pub fn takes_strange_rays(make: Make<'_>) -> Result<(), Fault> {
    let mut caster = make(&GpuOptions::default())?;
    for sample in [Sample::plain(7, true), Sample::scattered(6, true)] {
        let comparison = strange_against_reference(&mut *caster, &sample.octree()?, (32, 24))?;
        if caster.device().kind == DeviceKind::SoftwareGpu {
            demand_agreement(&*caster, comparison)?;
        }
    }
    Ok(())
}

/// It finds what the reference finds in an octree that takes several bindings.
///
/// # Errors
/// Rays that end elsewhere; what the caster said.
pub fn agrees_over_bindings(make: Make<'_>) -> Result<(), Fault> {
    let octree = Sample::scattered(6, true).octree()?;
    let part = (octree.slots().len() * 8 / 3) as u64;
    let mut caster = make(&GpuOptions { max_part_bytes: Some(part), ..GpuOptions::default() })?;
    let comparison = against_reference(&mut *caster, &octree, (64, 48))?;
    demand_agreement(&*caster, comparison)
}

/// The comparison has teeth: a kernel with any of several mistakes in it does not pass.
///
/// # Errors
/// A mistake that was not noticed, or is no longer one of the kernel's lines; what the caster said.
pub fn broken_kernels_are_caught(make: Make<'_>) -> Result<(), Fault> {
    let octree = Sample::scattered(6, true).octree()?;
    for (right, wrong) in [
        ("if tc_max < h {", "if tc_max > h {"),
        (
            "let crossed = t_corner <= vec3<f32>(tc_max);",
            "let crossed = t_corner < vec3<f32>(tc_max) + vec3<f32>(1e-3);",
        ),
        ("if CONTOURS {", "if CONTOURS && false {"),
        ("if FAR_POINTERS {", "if FAR_POINTERS && scale < 20u {"),
        ("if tc_max * ray.size_per_t >= size {", "if tc_max * ray.size_per_t > size * 1.5 {"),
        ("t_max = stack_t_max[scale - LOWEST_SCALE];", "t_max = 1.0;"),
    ] {
        demand(CAST_WGSL.contains(right), || format!("the kernel has no {right:?}"))?;
        let kernel = Some(CAST_WGSL.replace(right, wrong));
        let mut caster = make(&GpuOptions { kernel, ..GpuOptions::default() })?;
        let comparison = against_reference(&mut *caster, &octree, (64, 48))?;
        demand(!comparison.within(1e-5, 1 << 12), || format!("not noticed: {wrong}: {comparison:?}"))?;
    }
    Ok(())
}

/// The first camera's view of a sample.
fn view_of(octree: &Octree, size: (u32, u32), options: &CastOptions) -> Result<View, CastError> {
    let root = octree.objects()[0].root_slot as u32;
    View::new(&cameras()[0], octree.octree_to_mesh(0), root, size, options)
}

/// [`CastError::Device`] with `says` in its text, or a [`Fault`].
fn demand_refusal<T>(what: &str, result: Result<T, CastError>, says: &str) -> Result<(), Fault> {
    match result {
        Err(CastError::Device(text)) if text.contains(says) => Ok(()),
        Err(other) => Err(Fault::Wrong(format!("{what}: {other:?}"))),
        Ok(_) => Err(Fault::Wrong(format!("{what}: no error"))),
    }
}

/// What cannot be done is an error that says so, and the caster goes on to work.
///
/// # Errors
/// Something that is not refused, or not in these words; what the caster said elsewhere.
pub fn errors_are_values(make: Make<'_>) -> Result<(), Fault> {
    let mut caster = make(&GpuOptions::default())?;
    let octree = Sample::plain(3, false).octree()?;
    let view = |size| view_of(&octree, size, &CastOptions::default());
    let mut hits = Vec::new();
    let early = caster.cast(&view((8, 8))?, &mut hits);
    demand(matches!(early, Err(CastError::NotLoaded)), || format!("cast before an octree is loaded: {early:?}"))?;
    demand(caster.resident_bytes() == 0, || "bytes of no octree".into())?;
    caster.load(&octree)?;
    demand(caster.resident_bytes() > 0, || "no bytes of an octree".into())?;
    demand_refusal("a wide picture", caster.cast(&view((1 << 20, 1))?, &mut hits), "smaller")?;
    caster.cast(&view((8, 8))?, &mut hits)?;

    let nobodys = GpuOptions { adapter: Some("nobody's".into()), ..GpuOptions::default() };
    demand_refusal("a device that there is not", make(&nobodys), "nobody's")?;
    let mut tiny = make(&GpuOptions { max_part_bytes: Some(64), ..GpuOptions::default() })?;
    demand_refusal("a large octree", tiny.load(&Sample::plain(6, false).octree()?), "fewer levels")?;
    let mut broken = make(&GpuOptions { kernel: Some("fn cast( {".into()), ..GpuOptions::default() })?;
    broken.load(&octree)?;
    demand_refusal("a kernel that is no WGSL", broken.cast(&view((8, 8))?, &mut hits), "")
}

/// Times are of work done: not zero, no more than passed, and on a software driver not much less either.
///
/// # Errors
/// Times that cannot be; what the caster said.
pub fn times_are_plausible(make: Make<'_>) -> Result<(), Fault> {
    let mut caster = make(&GpuOptions::default())?;
    let octree = Sample::plain(7, true).octree()?;
    caster.load(&octree)?;
    for beam in [false, true] {
        let view = view_of(&octree, (256, 192), &CastOptions { beam, ..CastOptions::default() })?;
        // Compiles and warms up.
        caster.time(&view)?;
        let mut mostly_work = caster.device().kind != DeviceKind::SoftwareGpu;
        for _ in 0..10 {
            let start = Instant::now();
            let time = caster.time(&view)?;
            let wall = start.elapsed();
            demand(time.total <= wall && !time.total.is_zero(), || format!("{time:?} of {wall:?}"))?;
            demand(time.coarse <= time.total && time.coarse.is_zero() != beam, || format!("beam {beam}: {time:?}"))?;
            mostly_work |= time.total * 4 >= wall;
        }
        // On a busy machine a run may wait longer than it works, but not every time.
        demand(mostly_work, || "the software driver's own times leave most of the time unexplained".into())?;
    }
    Ok(())
}

/// Pictures of changing sizes: each has its own hits and nothing of the one before.
///
/// # Errors
/// A picture of a wrong size, or a second one that differs; what the caster said.
pub fn nothing_is_left_of_the_frame_before(make: Make<'_>) -> Result<(), Fault> {
    let mut caster = make(&GpuOptions::default())?;
    let octree: Arc<Octree> = Sample::plain(5, true).octree()?;
    caster.load(&octree)?;
    let mut cast = |size| {
        let mut hits = vec![Hit::miss(7); 3];
        caster.cast(&view_of(&octree, size, &CastOptions::default())?, &mut hits)?;
        Ok::<_, Fault>(hits)
    };
    let small = cast((20, 10))?;
    let large = cast((90, 70))?;
    demand((small.len(), large.len()) == (200, 6300), || format!("{} and {} hits", small.len(), large.len()))?;
    demand(cast((20, 10))? == small, || "the same view gives other hits".into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reference::ReferenceCaster;
    use crate::{Device, FrameTime};

    /// The reference, but of every third frame a few hits are lost, and it exaggerates its times.
    struct Forgetful(ReferenceCaster, u32);

    impl Caster for Forgetful {
        fn name(&self) -> &'static str {
            "forgetful"
        }
        fn device(&self) -> &Device {
            self.0.device()
        }
        fn load(&mut self, octree: &Arc<Octree>) -> Result<(), CastError> {
            self.0.load(octree)
        }
        fn cast(&mut self, view: &View, hits: &mut Vec<Hit>) -> Result<(), CastError> {
            self.0.cast(view, hits)?;
            self.1 += 1;
            if self.1.is_multiple_of(3) {
                hits.iter_mut().filter(|hit| !hit.is_miss()).take(9).for_each(|hit| *hit = Hit::miss(0));
            }
            Ok(())
        }
        fn time(&mut self, view: &View) -> Result<FrameTime, CastError> {
            self.0.time(view).map(|time| FrameTime { total: time.total * 1000, ..time })
        }
        fn resident_bytes(&self) -> u64 {
            1
        }
    }

    fn reference(_: &GpuOptions) -> Result<Box<dyn Caster>, CastError> {
        Ok(Box::new(ReferenceCaster::default()))
    }

    fn forgetful(_: &GpuOptions) -> Result<Box<dyn Caster>, CastError> {
        Ok(Box::new(Forgetful(ReferenceCaster::default(), 0)))
    }

    #[test]
    fn checks_tell_right_from_wrong() {
        for check in [agrees_over_bindings, nothing_is_left_of_the_frame_before] {
            assert!(check(&reference).is_ok());
            assert!(matches!(check(&forgetful), Err(Fault::Wrong(_))));
        }
        assert!(matches!(times_are_plausible(&forgetful), Err(Fault::Wrong(_))));
        assert!(matches!(errors_are_values(&forgetful), Err(Fault::Wrong(what)) if what.contains("no octree")));
        // The reference runs no kernel, so that it cannot break.
        assert!(matches!(broken_kernels_are_caught(&reference), Err(Fault::Wrong(_))));
    }
}
