//! The further checks of engines that run the kernel of [`gpu`](crate::gpu).

use super::checks::{demand_agreement, view_of};
use super::{Fault, Subject, demand};
use crate::gpu::arithmetic::Arithmetic;
use crate::gpu::kernel::{CAST_WGSL, GpuOptions};
use crate::gpu::slots::SlotsIn;
use crate::reference::ReferenceCaster;
use crate::testing::compare::{Allowed, Comparison};
use crate::testing::sample::{Sample, against_reference};
use crate::{CastError, Caster, DeviceKind};

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

/// The kernel's approximate quotient.
const QUOTIENT: &str = "16777216.0 / bitcast<f32>((bits & 0x7fffffu) | 0x3f800000u)";

/// Kernels that leave nothing to the driver give the reference's hits in every bit, with quotients that are off, too; on the processor,
/// also those that leave quotients to it. Products and quotients that are off by a unit in the last place are noticed.
///
/// # Errors
/// Another bit, or none where one must be; a kernel that no longer has the lines; what the caster said.
pub fn kernels_need_no_exact_driver(subject: &Subject) -> Result<(), Fault> {
    let octree = Sample::scattered(6, true).octree()?;
    let cast = |arithmetic, kernel: Option<String>| {
        let options = GpuOptions { arithmetic: Some(arithmetic), kernel, ..GpuOptions::default() };
        let mut caster = subject.open_with(&options)??;
        let found = against_reference(&mut *caster, &octree, (64, 48))?;
        Ok::<_, Fault>((found, caster.device().kind))
    };
    let same = |found: &Comparison| found.mismatches() == 0 && found.max_t_difference == 0.0 && found.other_size == 0;
    for rounds_quotients in [true, false] {
        let arithmetic = Arithmetic { rounds_quotients, ..Arithmetic::EXACT };
        let (found, kind) = cast(arithmetic, None)?;
        let right = same(&found) || (kind != DeviceKind::SoftwareGpu && !rounds_quotients);
        demand(right, || format!("{arithmetic:?}: {found:?}"))?;
    }
    let replaced = |right: &str, wrong: &str| {
        demand(CAST_WGSL.contains(right), || format!("the kernel has no {right:?}"))?;
        Ok::<_, Fault>(Some(CAST_WGSL.replace(right, wrong)))
    };
    // A driver may be off by 2.5 units in the last place.
    for off in ["+ 3u", "- 3u"] {
        let kernel = replaced(QUOTIENT, &format!("bitcast<f32>(bitcast<u32>({QUOTIENT}) {off})"))?;
        let (found, _) = cast(Arithmetic::EXACT, kernel)?;
        demand(same(&found), || format!("quotients {off}: {found:?}"))?;
    }
    for (right, wrong) in [
        ("return 1.0 / x;", "return bitcast<f32>(bitcast<u32>(1.0 / x) + 1u);"),
        ("return product3(a, b) + c;", "return bitcast<vec3<f32>>(bitcast<vec3<u32>>(product3(a, b)) + 1u) + c;"),
        ("quotient += bitcast<u32>(off);", "quotient += bitcast<u32>(off) + 1u;"),
        ("quotient += select(0u, 1u, twice > i32(digits)) - select(0u, 1u, twice < -i32(digits));", "quotient += 1u;"),
    ] {
        let rounds_quotients = !right.contains("1.0 / x");
        let (found, _) = cast(Arithmetic { rounds_quotients, ..Arithmetic::EXACT }, replaced(right, wrong)?)?;
        // One more than the nearest is corrected again.
        let corrected = right.contains("(off)");
        demand(same(&found) == corrected, || format!("{wrong}: {found:?}"))?;
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
