//! What casts rays at triangles on a GPU, whatever the interface to the device.

use std::time::Duration;

use super::{
    HierarchySpace, Question, TrianglePass, TrianglePlacement, TriangleRay, TriangleRecord, TriangleView, WideTriangles,
};
use crate::exact::{CameraRays, ExactRay};
use crate::gpu::kernel::{SlotLimits, ray_workgroups, workgroups};
use crate::{CastError, Device};

/// A GPU that casts rays at triangles. `esvo_cpu::triangles::TriangleScene` makes the triangles and decides the rays that are left.
pub trait TriangleCaster {
    /// Name of the engine.
    fn name(&self) -> &'static str;

    /// The device.
    fn device(&self) -> &Device;

    /// Bytes on the device: nodes and triangles.
    fn resident_bytes(&self) -> u64;

    /// Copies triangles to the device, in place of those before.
    ///
    /// # Errors
    /// Before anything is copied: more than bindings hold, or a hierarchy too deep for the kernel. The device's errors.
    fn load(&mut self, triangles: &WideTriangles) -> Result<(), CastError>;

    /// Casts a picture: `records[y * width + x]`, the first row on top. Resizes `records`.
    ///
    /// # Errors
    /// [`CastError::NotLoaded`]; the device's errors.
    fn cast(&mut self, rays: &CameraRays, records: &mut Vec<TriangleRecord>) -> Result<(), CastError>;

    /// Casts rays in mesh units, in their order. Resizes `records`.
    ///
    /// # Errors
    /// As [`cast`](Self::cast).
    fn cast_rays(
        &mut self,
        rays: &[ExactRay],
        question: Question,
        records: &mut Vec<TriangleRecord>,
    ) -> Result<(), CastError>;

    /// Casts a picture and returns how long the device took, without copying and without rays that are undecided.
    ///
    /// # Errors
    /// As [`cast`](Self::cast); a camera that single precision does not suffice for.
    fn time(&mut self, rays: &CameraRays) -> Result<Duration, CastError>;
}

/// A device with triangles on it: what an engine implements to be a [`TriangleCaster`].
pub trait TriangleDevice {
    /// [`TriangleCaster::name`].
    fn name(&self) -> &'static str;

    /// [`TriangleCaster::device`].
    fn device(&self) -> &Device;

    /// What the device and the options allow.
    fn limits(&self) -> TriangleLimits;

    /// What was uploaded; `None` before.
    fn loaded(&self) -> Option<LoadedTriangles>;

    /// Copies triangles to the device, in place of those before, in the bindings that the placement names.
    ///
    /// # Errors
    /// The device's errors.
    fn upload(&mut self, triangles: &WideTriangles, placement: &TrianglePlacement) -> Result<(), CastError>;

    /// Runs a pass and waits. Fills `records`, which are as many as the pass writes, or none for [`TrianglePass::Time`]. Returns
    /// the time of the pass.
    ///
    /// # Errors
    /// [`CastError::NotLoaded`]; the device's errors.
    fn dispatch(&mut self, work: &Dispatch<'_>, records: &mut [TriangleRecord]) -> Result<Duration, CastError>;
}

/// What a device and the options allow.
#[derive(Clone, Copy, Debug)]
pub struct TriangleLimits {
    /// For nodes and triangles. Rays and records have as many bytes in a binding.
    pub slots: SlotLimits,
    /// Most workgroups per dimension.
    pub groups: u32,
    /// Most rays of a dispatch; `None`: as many as the others allow.
    pub rays: Option<usize>,
    /// [`GpuOptions::workgroup`](crate::gpu::kernel::GpuOptions::workgroup).
    pub workgroup: Option<(u32, u32)>,
}

/// What is known of the triangles on a device.
#[derive(Clone, Copy, Debug)]
pub struct LoadedTriangles {
    /// The space of their hierarchy.
    pub space: HierarchySpace,
    /// Bytes of nodes and triangles.
    pub bytes: u64,
    /// Without triangles every ray misses.
    pub empty: bool,
    /// Width and height of a workgroup in pixels.
    pub workgroup: (u32, u32),
}

impl LoadedTriangles {
    /// Those of these triangles.
    pub fn of(triangles: &WideTriangles, placement: &TrianglePlacement) -> Self {
        let workgroup = placement.workgroup;
        Self { space: triangles.space, bytes: triangles.bytes(), empty: triangles.nodes.is_empty(), workgroup }
    }

    /// The answer without a dispatch: a miss without triangles, otherwise none.
    fn untouched(&self) -> TriangleRecord {
        if self.empty { TriangleRecord::MISS } else { TriangleRecord::UNDECIDED }
    }
}

/// A pass to be run.
#[derive(Clone, Copy, Debug)]
pub struct Dispatch<'a> {
    /// What is computed.
    pub pass: TrianglePass,
    /// The uniform buffer.
    pub view: &'a TriangleView,
    /// The rays; none for a picture.
    pub rays: &'a [TriangleRay],
    /// Workgroups per dimension.
    pub groups: (u32, u32),
    /// Records that the pass writes.
    pub count: usize,
}

impl Dispatch<'_> {
    /// Bytes of the buffer of rays, which cannot be empty.
    pub fn ray_bytes(&self) -> u64 {
        size_of_val(self.rays).max(size_of::<TriangleRay>()) as u64
    }

    /// Bytes of the records.
    pub fn record_bytes(&self) -> u64 {
        (self.count * size_of::<TriangleRecord>()) as u64
    }
}

impl<D: TriangleDevice> TriangleCaster for D {
    fn name(&self) -> &'static str {
        TriangleDevice::name(self)
    }

    fn device(&self) -> &Device {
        TriangleDevice::device(self)
    }

    fn resident_bytes(&self) -> u64 {
        self.loaded().map_or(0, |loaded| loaded.bytes)
    }

    fn load(&mut self, triangles: &WideTriangles) -> Result<(), CastError> {
        let refused = |error| CastError::Device(format!("{}: {error}", TriangleDevice::device(self).name));
        let placement = TrianglePlacement::new(triangles, &self.limits()).map_err(refused)?;
        self.upload(triangles, &placement)
    }

    fn cast(&mut self, rays: &CameraRays, records: &mut Vec<TriangleRecord>) -> Result<(), CastError> {
        let loaded = self.loaded().ok_or(CastError::NotLoaded)?;
        let view = loaded.space.view(rays).filter(|_| !loaded.empty);
        records.clear();
        records.resize(rays.pixels(), loaded.untouched());
        let Some(mut view) = view else { return Ok(()) };
        let rows = band_rows(rays.width, &self.limits(), loaded.workgroup)? as usize;
        let width = rays.width as usize;
        for (band, first_row) in records.chunks_mut(rows * width).zip((0..).step_by(rows)) {
            view.first_row = first_row;
            let groups = workgroups(rays.width, (band.len() / width) as u32, loaded.workgroup);
            let pass = TrianglePass::Picture;
            self.dispatch(&Dispatch { pass, view: &view, rays: &[], groups, count: band.len() }, band)?;
        }
        Ok(())
    }

    fn cast_rays(
        &mut self,
        rays: &[ExactRay],
        question: Question,
        records: &mut Vec<TriangleRecord>,
    ) -> Result<(), CastError> {
        let loaded = self.loaded().ok_or(CastError::NotLoaded)?;
        records.clear();
        records.resize(rays.len(), loaded.untouched());
        if loaded.empty {
            return Ok(());
        }
        let most = rays_per_dispatch(&self.limits(), loaded.workgroup);
        for (some, records) in rays.chunks(most).zip(records.chunks_mut(most)) {
            let placed: Vec<TriangleRay> = some.iter().map(|ray| loaded.space.ray(ray)).collect();
            let count = some.len() as u32;
            let groups = (ray_workgroups(count, loaded.workgroup), 1);
            let (pass, view) = (question.pass(), &TriangleView::of_rays(count));
            self.dispatch(&Dispatch { pass, view, rays: &placed, groups, count: some.len() }, records)?;
        }
        Ok(())
    }

    fn time(&mut self, rays: &CameraRays) -> Result<Duration, CastError> {
        let loaded = self.loaded().ok_or(CastError::NotLoaded)?;
        if loaded.empty {
            return Ok(Duration::ZERO);
        }
        let mut view = loaded.space.view(rays).ok_or_else(too_far)?;
        let most = band_rows(rays.width, &self.limits(), loaded.workgroup)?;
        let mut time = Duration::ZERO;
        for first_row in (0..rays.height).step_by(most as usize) {
            view.first_row = first_row;
            let rows = most.min(rays.height - first_row);
            let groups = workgroups(rays.width, rows, loaded.workgroup);
            let count = rows as usize * rays.width as usize;
            time +=
                self.dispatch(&Dispatch { pass: TrianglePass::Time, view: &view, rays: &[], groups, count }, &mut [])?;
        }
        Ok(time)
    }
}

/// Most rows of a picture of this width that one dispatch casts.
///
/// # Errors
/// [`CastError::Device`]: not even one row.
fn band_rows(width: u32, limits: &TriangleLimits, workgroup: (u32, u32)) -> Result<u32, CastError> {
    let row = u64::from(width) * size_of::<TriangleRecord>() as u64;
    let rows = (limits.slots.binding_bytes / row.max(1)).min(u64::from(limits.groups) * u64::from(workgroup.1));
    let fits = u64::from(width) <= u64::from(limits.groups) * u64::from(workgroup.0) && rows > 0;
    if !fits {
        return Err(CastError::Device(format!(
            "a picture {width} pixels wide is too wide for the device; cast a narrower one"
        )));
    }
    Ok(u32::try_from(rows).unwrap_or(u32::MAX))
}

/// Most rays of a buffer that one dispatch casts.
fn rays_per_dispatch(limits: &TriangleLimits, workgroup: (u32, u32)) -> usize {
    let groups = u64::from(limits.groups) * u64::from(workgroup.0 * workgroup.1);
    let most = (limits.slots.binding_bytes / size_of::<TriangleRay>() as u64).min(groups).clamp(1, 1 << 22) as usize;
    limits.rays.map_or(most, |rays| rays.clamp(1, most))
}

/// The error of [`TriangleCaster::time`] for a camera that [`HierarchySpace::view`] does not take.
fn too_far() -> CastError {
    CastError::Device(
        "the camera's eye or far plane is more than a million mesh sizes away: single precision decides no ray; cast it on the \
         processor"
            .into(),
    )
}
