//! The further checks of engines that run the kernel of [`gpu`](crate::gpu).

use super::checks::{demand_agreement, view_of};
use super::{Fault, Subject, demand};
use crate::gpu::kernel::{CAST_WGSL, GpuOptions};
use crate::gpu::slots::SlotsIn;
use crate::reference::ReferenceCaster;
use crate::testing::compare::Allowed;
use crate::testing::sample::{Sample, against_reference};
use crate::{CastError, Caster};

/// Lines of the kernel, and mistakes to put in their place.
const MISTAKES: [(&str, &str); 6] = [
    ("t_min = max(t_min, tc_max);", "t_min = max(t_min, ray.t_min);"),
    ("let crossed = t_corner <= vec3<f32>(tc_max);", "let crossed = t_corner < vec3<f32>(tc_max) + vec3<f32>(1e-3);"),
    ("if CONTOURS {", "if CONTOURS && false {"),
    ("if FAR_POINTERS {", "if FAR_POINTERS && scale < 20u {"),
    ("if footprint >= size {", "if footprint > size * 1.5 {"),
    ("t_max = stack_t_max[scale - LOWEST_SCALE];", "t_max = 1.0;"),
];

/// An octree that is split over several bindings gives the reference's hits.
///
/// # Errors
/// Rays that end elsewhere; what the caster said.
pub fn several_bindings_agree(subject: &Subject) -> Result<(), Fault> {
    let octree = Sample::scattered(6, true).octree()?;
    let part = (octree.slots().len() * 8 / 3) as u64;
    let mut caster = subject.open_with(&GpuOptions { max_part_bytes: Some(part), ..GpuOptions::default() })??;
    let comparison = against_reference(&mut *caster, &octree, (64, 48))?;
    demand_agreement(&*caster, &comparison)
}

/// An octree in buffers and one in a texture give the reference's hits, wherever the device's kind would have it.
///
/// # Errors
/// Rays that end elsewhere; what the caster said.
pub fn octrees_in_buffers_and_in_textures_agree(subject: &Subject) -> Result<(), Fault> {
    let octree = Sample::scattered(6, true).octree()?;
    for slots_in in [SlotsIn::Buffers, SlotsIn::Texture] {
        let mut caster = subject.open_with(&GpuOptions { slots_in: Some(slots_in), ..GpuOptions::default() })??;
        let comparison = against_reference(&mut *caster, &octree, (64, 48))?;
        demand_agreement(&*caster, &comparison)?;
    }
    Ok(())
}

/// Workgroups of other sizes give the reference's hits.
///
/// # Errors
/// Rays that end elsewhere; what the caster said.
pub fn other_workgroups_agree(subject: &Subject) -> Result<(), Fault> {
    let octree = Sample::scattered(6, true).octree()?;
    for workgroup in [(16, 4), (2, 8), (16, 16)] {
        let mut caster = subject.open_with(&GpuOptions { workgroup: Some(workgroup), ..GpuOptions::default() })??;
        let comparison = against_reference(&mut *caster, &octree, (61, 47))?;
        demand_agreement(&*caster, &comparison)?;
    }
    Ok(())
}

/// Subgroups of every size either give the reference's hits or are refused; one of 3 invocations is refused.
///
/// # Errors
/// Rays that end elsewhere; a size that is neither; what the caster said.
pub fn subgroups_agree_or_are_refused(subject: &Subject) -> Result<(), Fault> {
    let octree = Sample::scattered(6, true).octree()?;
    for size in [3, 4, 8, 16, 32, 64, 128] {
        let opened = subject.open_with(&GpuOptions { subgroup_size: Some(size), ..GpuOptions::default() })?;
        match opened {
            Ok(mut caster) if size != 3 => {
                let comparison = against_reference(&mut *caster, &octree, (61, 47))?;
                demand_agreement(&*caster, &comparison)?;
            }
            opened => demand_refusal("a size of subgroups", opened, &format!("subgroups of {size}: "))?,
        }
    }
    Ok(())
}

/// The coarse pass of blocks of 4 and of 8 pixels saves as many iterations as the reference's, in every pixel.
///
/// Hits do not tell which block a kernel has: the beam changes none.
///
/// # Errors
/// More than one pixel in 1000 that takes another number of iterations; what the caster said.
pub fn beams_of_both_blocks_save_the_same(subject: &Subject) -> Result<(), Fault> {
    let octree = Sample::scattered(6, true).octree()?;
    let (mut caster, mut reference) = (subject.open_with(&GpuOptions::default())??, ReferenceCaster::default());
    caster.load(&octree)?;
    reference.load(&octree)?;
    let (mut ours, mut theirs) = (Vec::new(), Vec::new());
    let mut sums = Vec::new();
    for wide in [false, true] {
        let view = view_of(&octree, 0, (131, 75), true)?.with_wide_beam(wide);
        caster.cast(&view, &mut ours)?;
        reference.cast(&view, &mut theirs)?;
        let differ = ours.iter().zip(&theirs).filter(|(a, b)| a.iterations != b.iterations).count();
        demand(differ <= ours.len() / 1000, || format!("blocks of {}: {differ} pixels", view.beam_block()))?;
        sums.push(ours.iter().map(|hit| u64::from(hit.iterations)).sum::<u64>());
    }
    demand(sums[0] != sums[1], || "both blocks take the same iterations: the test tests nothing".into())
}

/// The comparison has teeth: a kernel with any of several mistakes in it does not pass.
///
/// # Errors
/// A mistake that is not noticed, or that replaces a line that the kernel no longer has; what the caster said.
pub fn broken_kernels_are_caught(subject: &Subject) -> Result<(), Fault> {
    let octree = Sample::scattered(6, true).octree()?;
    for (right, wrong) in MISTAKES {
        demand(CAST_WGSL.contains(right), || format!("the kernel has no {right:?}"))?;
        let kernel = Some(CAST_WGSL.replace(right, wrong));
        let mut caster = subject.open_with(&GpuOptions { kernel, ..GpuOptions::default() })??;
        let comparison = against_reference(&mut *caster, &octree, (64, 48))?;
        demand(!Allowed::GPU.admits(&comparison), || format!("not noticed: {wrong}: {comparison:?}"))?;
    }
    Ok(())
}

/// [`CastError::Device`] with `says` in its text, or a [`Fault`].
fn demand_refusal<T>(what: &str, result: Result<T, CastError>, says: &str) -> Result<(), Fault> {
    match result {
        Err(CastError::Device(text)) if text.contains(says) => Ok(()),
        Err(other) => Err(Fault::Wrong(format!("{what}: {other:?}"))),
        Ok(_) => Err(Fault::Wrong(format!("{what}: no error"))),
    }
}

/// What a device cannot do is an error that says so, and the caster works afterwards.
///
/// # Errors
/// Something that is not refused, or not in these words; what the caster said elsewhere.
pub fn what_a_device_cannot_do_is_an_error(subject: &Subject) -> Result<(), Fault> {
    let mut caster = subject.open()?;
    let octree = Sample::plain(3, false).octree()?;
    let view = |size| view_of(&octree, 0, size, false);
    let mut hits = Vec::new();
    caster.load(&octree)?;
    demand_refusal("a wide picture", caster.cast(&view((1 << 20, 1))?, &mut hits), "smaller")?;
    caster.cast(&view((8, 8))?, &mut hits)?;

    let nobodys = GpuOptions { adapter: Some("nobody's".into()), ..GpuOptions::default() };
    demand_refusal("a device that does not exist", subject.open_with(&nobodys)?, "nobody's")?;
    let mut tiny = subject.open_with(&GpuOptions { max_part_bytes: Some(64), ..GpuOptions::default() })??;
    demand_refusal("a large octree", tiny.load(&Sample::plain(6, false).octree()?), "fewer levels")?;
    let small = subject.open_with(&GpuOptions { memory_bytes: Some(64), ..GpuOptions::default() })?;
    demand_refusal("a device without memory", small?.load(&Sample::plain(6, false).octree()?), "64 bytes")?;
    let mut broken =
        subject.open_with(&GpuOptions { kernel: Some("fn cast( {".into()), ..GpuOptions::default() })??;
    broken.load(&octree)?;
    demand_refusal("a kernel that is no WGSL", broken.cast(&view((8, 8))?, &mut hits), "")
}
