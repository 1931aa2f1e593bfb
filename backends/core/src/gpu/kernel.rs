//! The GPU kernel: one WGSL source, specialised by a generated prelude to what an octree needs and a frame asks for.
//!
//! wgpu takes the text as it is, ash takes it as SPIR-V. WGSL's pipeline overrides could switch the features, but could not
//! set the number of storage bindings or the size of the stack. Therefore everything comes from the prelude, and a variant
//! contains only what it uses.

use std::fmt::Write as _;

use bytemuck::{Pod, Zeroable};
use esvo_format::{Needs, Octree};

use super::arithmetic::Arithmetic;
use super::slots::{OCTREE, SlotKind, Slots, SlotsIn};
use crate::gpu::resident::SlotMap;
use crate::instances::{NO_INSTANCE, Node};
use crate::{BEAM_BLOCK, CastError, DeviceKind, Hit, Instances, LeaveOut, Nearest, Ray, View};

/// The kernel without its prelude.
pub const CAST_WGSL: &str = include_str!("../../kernels/cast.wgsl");
/// What comes behind it in variants for [`Pass::Instances`].
pub const INSTANCES_WGSL: &str = include_str!("../../kernels/instances.wgsl");

/// Entry point of the coarse pass. Bindings of group 0: the view and the values (one `f32` per corner).
pub const ENTRY_COARSE: &str = "coarse_pass";
/// Entry point of the main pass. Bindings of group 0: the view, the coarse values with [`Variant::beam`], the hits.
pub const ENTRY_CAST: &str = "main_pass";
/// Entry point of the main pass that stores one `f32` per pixel; bindings as for [`ENTRY_CAST`].
pub const ENTRY_TIME: &str = "timing_pass";
/// Entry point of the pass over a buffer of rays. Bindings of group 0: the view (see [`rays_view`]), the rays, the hits.
pub const ENTRY_RAYS: &str = "cast_rays";
/// Entry point of the pass over instances. Bindings of group 0: the view (see [`instances_view`]), the hierarchy (an array of
/// [`Node`]), the nearest hits (an array of [`NearestHit`]).
pub const ENTRY_INSTANCES: &str = "instances_pass";

/// Binding in group 0 of the uniform buffer with the view (see [`band_view`]).
pub const BINDING_VIEW: u32 = 0;
/// Binding in group 0 of the values of the coarse pass: written by it, read by the main pass.
pub const BINDING_COARSE: u32 = 1;
/// Binding in group 0 of the rays that [`ENTRY_RAYS`] casts.
pub const BINDING_RAYS: u32 = 1;
/// Binding in group 0 of the hierarchy of [`ENTRY_INSTANCES`].
pub const BINDING_NODES: u32 = 1;
/// Binding in group 0 of the output of the main pass, and of the hits of [`ENTRY_RAYS`] and [`ENTRY_INSTANCES`].
pub const BINDING_OUT: u32 = 2;
/// Group of the octree: bindings from 0, one for each part.
pub const GROUP_OCTREE: u32 = 1;

/// Width and height in pixels of the workgroups of the project's casters.
pub const WORKGROUP: (u32, u32) = (8, 8);
/// Deepest level of a voxel (spec section 4).
const MAX_LEVELS: u32 = 23;
/// Storage buffers that are not octree data: the coarse values, the rays or the hierarchy, and the output.
pub(super) const OTHER_STORAGE_BUFFERS: u32 = 2;

/// What a dispatch computes.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub enum Pass {
    /// Where the rays of a block of pixels may start.
    Coarse,
    /// The hits.
    Cast,
    /// One `f32` per pixel, which nobody reads: what [`Caster::time`](crate::Caster::time) measures.
    Time,
    /// The hits of a buffer of rays.
    Rays,
    /// The nearest hits of a picture of instances.
    Instances,
}

impl Pass {
    /// Entry point in the kernel.
    pub fn entry(self) -> &'static str {
        match self {
            Self::Coarse => ENTRY_COARSE,
            Self::Cast => ENTRY_CAST,
            Self::Time => ENTRY_TIME,
            Self::Rays => ENTRY_RAYS,
            Self::Instances => ENTRY_INSTANCES,
        }
    }

    /// Bytes that the pass writes per pixel or per ray; the coarse pass: per corner of a block.
    pub fn bytes_per_pixel(self) -> u64 {
        match self {
            Self::Cast | Self::Rays => size_of::<Hit>() as u64,
            Self::Instances => size_of::<NearestHit>() as u64,
            Self::Coarse | Self::Time => 4,
        }
    }
}

/// What [`Pass::Instances`] writes for a pixel: 20 bytes. A test compares it with the kernel's struct of the same name.
#[repr(C)]
#[derive(Clone, Copy, PartialEq, Debug, Pod, Zeroable)]
pub struct NearestHit {
    /// The nearest hit, with the iterations of all instances that were cast.
    pub hit: Hit,
    /// Number of the instance that has it; 0 for a miss.
    pub number: u32,
}

impl NearestHit {
    /// Stores those of a band, the rows from `first_row` on of a picture of this view. `to` has its size.
    pub fn store(band: &[Self], view: &View, first_row: u32, to: &mut Nearest) {
        let first = first_row as usize * view.width as usize;
        for (from, (hit, view)) in band.iter().zip(to.hits[first..].iter_mut().zip(&mut to.views[first..])) {
            (*hit, *view) = (from.hit, from.number);
        }
    }
}

/// The features of a kernel. A feature that is left out costs nothing.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub struct Variant {
    /// Clip voxels by their contours.
    pub contours: bool,
    /// Follow far pointers.
    pub far_pointers: bool,
    /// End rays at voxels that are small enough.
    pub lod: bool,
    /// Start rays where the coarse pass found that they may.
    pub beam: bool,
    /// Read the rays from a buffer: they have a size at their origin too. Only for [`Pass::Rays`].
    pub rays: bool,
    /// Contain the pass over instances. Only for [`Pass::Instances`].
    pub instances: bool,
    /// Level of the deepest voxel, 1 to 23: the number of frames of the stack.
    pub levels: u32,
    /// [Edge of a block](View::beam_block) of the coarse pass; 4 where there is none.
    pub beam_block: u32,
    /// Where the octree is.
    pub slots: Slots,
    /// Width and height of a workgroup in pixels: powers of two.
    pub workgroup: (u32, u32),
    /// What is not left to the driver.
    pub arithmetic: Arithmetic,
}

impl Variant {
    /// The kernel of the coarse pass for the same octree.
    ///
    /// Contours are off, since they would let a ray pass through voxels that other rays hit. Rays always end at small voxels.
    pub fn of_coarse_pass(self) -> Self {
        Self { contours: false, lod: true, beam: false, rays: false, instances: false, ..self }
    }

    /// The kernel's source for this variant.
    pub fn source(&self) -> String {
        self.source_with(CAST_WGSL, INSTANCES_WGSL)
    }

    /// The same with other texts than [`CAST_WGSL`] and [`INSTANCES_WGSL`], for experiments and for tests with a broken kernel.
    pub fn source_with(&self, body: &str, instances: &str) -> String {
        let mut text = String::new();
        let flags = [
            ("CONTOURS", self.contours),
            ("FAR_POINTERS", self.far_pointers),
            ("LOD", self.lod),
            ("BEAM", self.beam),
            ("RAYS", self.rays),
            ("ROUND_PRODUCTS", self.arithmetic.rounds_products),
            ("ROUND_QUOTIENTS", self.arithmetic.rounds_quotients),
        ];
        for (name, value) in flags {
            let _ = writeln!(text, "const {name}: bool = {value};");
        }
        let numbers = [
            ("LEVELS", self.levels.clamp(1, MAX_LEVELS)),
            ("BEAM_BLOCK", self.beam_block),
            ("WIDTH", self.workgroup.0),
            ("HEIGHT", self.workgroup.1),
        ];
        for (name, value) in numbers {
            let _ = writeln!(text, "const {name}: u32 = {value}u;");
        }
        self.slots.declare(&OCTREE, 0, &mut text);
        text += body;
        if self.instances {
            text += instances;
        }
        text
    }
}

/// What a device allows for the data of an octree.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct SlotLimits {
    /// Bytes in one binding of a storage buffer.
    pub binding_bytes: u64,
    /// Storage buffers that one shader may have.
    pub storage_buffers: u32,
    /// Width and height of a texture in texels; `None` if the octree must not be in a texture. See
    /// [`GpuOptions::texture_edge`].
    pub texture_edge: Option<u32>,
    /// Bytes of the device's memory; `None` if they are not known.
    pub memory_bytes: Option<u64>,
}

/// How the [resident](crate::gpu::resident::Resident) image of an octree lies in bindings.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Placement {
    /// Bytes of the image.
    pub bytes: u64,
    /// The bindings.
    pub slots: Slots,
    /// Width and height in pixels of the workgroups of pictures of one view.
    pub workgroup: (u32, u32),
    needs: Needs,
    leave_out: LeaveOut,
    arithmetic: Arithmetic,
}

impl Placement {
    /// Places the `slots` of the octree's resident image in a texture if there may be one and they fit, else in buffers.
    ///
    /// # Errors
    /// What to do about an octree that does not fit. The caster puts the device's name in front of the text.
    pub fn new(octree: &Octree, slots: &[u64], limits: &SlotLimits) -> Result<Self, String> {
        let SlotLimits { binding_bytes, storage_buffers, texture_edge, memory_bytes } = *limits;
        let max_parts = storage_buffers.saturating_sub(OTHER_STORAGE_BUFFERS).min(32);
        let bytes = size_of_val(slots) as u64;
        if let Some(memory) = memory_bytes.filter(|memory| *memory < bytes) {
            return Err(format!(
                "the octree takes {bytes} bytes without attachments, more than the device's memory of {memory} bytes: \
                 build it with fewer levels, or cast it on the processor"
            ));
        }
        let texture = texture_edge.and_then(|edge| Slots::texture(slots.len(), SlotKind::Pair, edge));
        let in_buffers = || Slots::split(slots.len(), SlotKind::Pair, binding_bytes, max_parts);
        let slots = texture.or_else(in_buffers).ok_or_else(|| {
            format!(
                "the octree takes {bytes} bytes without attachments, more than {max_parts} bindings of {binding_bytes} \
                 bytes: build it with fewer levels, or cast it on the processor"
            )
        })?;
        Ok(Self {
            bytes,
            slots,
            workgroup: WORKGROUP,
            needs: octree.needs(),
            leave_out: LeaveOut::ALL,
            arithmetic: Arithmetic::EXACT,
        })
    }

    /// With the [workgroups](GpuOptions::workgroup) and the [arithmetic](GpuOptions::arithmetic) of these options, where they say nothing
    /// with `arithmetic`, and leaving out [what they say](GpuOptions::leave_out).
    ///
    /// # Errors
    /// Workgroups of a size that is not of powers of two, or of more than 256 invocations.
    pub fn with(self, options: &GpuOptions, arithmetic: Arithmetic) -> Result<Self, String> {
        let arithmetic = options.arithmetic.unwrap_or(arithmetic);
        Ok(Self { workgroup: workgroup_of(options.workgroup)?, leave_out: options.leave_out, arithmetic, ..self })
    }

    /// The main pass's kernel for a view.
    pub fn variant(&self, view: &View) -> Variant {
        let needed = self.needed(view.contours(), view.max_voxel_pixels > 0.0);
        let beam_block = if view.beam() { view.beam_block() } else { BEAM_BLOCK };
        Variant { beam: view.beam(), beam_block, workgroup: self.workgroup, ..needed }
    }

    /// The kernel for instances whose views have the options of this one.
    pub fn instances_variant(&self, view: &View) -> Variant {
        Variant { instances: true, ..self.needed(view.contours(), view.max_voxel_pixels > 0.0) }
    }

    /// The kernel for a buffer of rays, with or without contours; `lod`: some [have a size](Ray::has_size).
    pub fn rays_variant(&self, contours: bool, lod: bool) -> Variant {
        Variant { rays: true, ..self.needed(contours, lod) }
    }

    /// A kernel with what is needed for rays that are clipped by contours or not, and that have a size or not.
    fn needed(&self, contours: bool, lod: bool) -> Variant {
        let (needs, left_out) = (&self.needs, self.leave_out);
        Variant {
            contours: contours && (needs.contours || !left_out.contours),
            far_pointers: needs.far_pointers || !left_out.far_pointers,
            lod: lod || !left_out.sizes,
            beam: false,
            rays: false,
            instances: false,
            levels: if left_out.frames { needs.levels } else { MAX_LEVELS },
            beam_block: BEAM_BLOCK,
            slots: self.slots,
            workgroup: WORKGROUP,
            arithmetic: self.arithmetic,
        }
    }
}

/// Workgroups of this size in pixels, or of [`WORKGROUP`].
///
/// # Errors
/// A size that is not of powers of two, or of more than 256 invocations.
pub(super) fn workgroup_of(wanted: Option<(u32, u32)>) -> Result<(u32, u32), String> {
    let (width, height) = wanted.unwrap_or(WORKGROUP);
    if !width.is_power_of_two() || !height.is_power_of_two() || width * height > 256 {
        return Err(format!("workgroups of {width} x {height}: expected powers of two, at most 256 in all"));
    }
    Ok((width, height))
}

/// Which GPU a caster opens, and how. The defaults are for users; The others are for tests and experiments.
#[derive(Clone, Debug, Default)]
pub struct GpuOptions {
    /// Takes the first device whose name contains this, whatever its case; `None`: the fastest kind of device. See
    /// [`choose`](super::choice::choose).
    pub adapter: Option<String>,
    /// Most bytes in one binding of octree data, of pixels to be filtered, or of nodes, triangles, their rays and their records.
    /// `None`: as many as the device allows.
    pub max_part_bytes: Option<u64>,
    /// Most rays in one dispatch of [`Pass::Rays`], at least 1. `None`: see [`rays_per_dispatch`].
    pub max_rays: Option<usize>,
    /// A kernel to use instead of [`CAST_WGSL`].
    pub kernel: Option<String>,
    /// A text to use instead of [`INSTANCES_WGSL`].
    pub instances_kernel: Option<String>,
    /// A text to use instead of [`TRIANGLES_WGSL`](super::triangles::TRIANGLES_WGSL).
    pub triangles_kernel: Option<String>,
    /// Bytes of the device's memory, if an octree is to be refused that takes more. `None`: as many as the driver tells, if it
    /// does.
    pub memory_bytes: Option<u64>,
    /// What kernels leave out if it is not needed; at first, all that can be.
    pub leave_out: LeaveOut,
    /// Where the octree, or a hierarchy of triangles, is put. `None`: in a texture on devices of the kind [`DeviceKind::SoftwareGpu`], in buffers on others.
    pub slots_in: Option<SlotsIn>,
    /// Width and height in pixels of the workgroups of pictures of one view, powers of two. `None`: [`WORKGROUP`].
    pub workgroup: Option<(u32, u32)>,
    /// Invocations of a subgroup, a power of two. `None`: as many as the driver chooses. Only ash can ask for it.
    pub subgroup_size: Option<u32>,
    /// What kernels that cast octrees do not leave to the driver. `None`: what the kind of the device needs.
    pub arithmetic: Option<Arithmetic>,
}

impl GpuOptions {
    /// [`SlotLimits::texture_edge`] for a device of this kind whose textures may have `max_edge` rows and columns. With
    /// [`max_part_bytes`](Self::max_part_bytes), octrees are in buffers unless a texture is demanded.
    pub fn texture_edge(&self, kind: DeviceKind, max_edge: u32) -> Option<u32> {
        let by_kind = kind == DeviceKind::SoftwareGpu && self.max_part_bytes.is_none();
        self.slots_in.map_or(by_kind, |slots_in| slots_in == SlotsIn::Texture).then_some(max_edge)
    }

    /// The source of a variant, of [`kernel`](Self::kernel) and [`instances_kernel`](Self::instances_kernel) if these are set.
    pub fn source(&self, variant: &Variant) -> String {
        let kernel = self.kernel.as_deref().unwrap_or(CAST_WGSL);
        variant.source_with(kernel, self.instances_kernel.as_deref().unwrap_or(INSTANCES_WGSL))
    }
}

/// Most rows of a picture that one dispatch casts on a device with these limits: bytes of a buffer, workgroups per
/// dimension.
///
/// # Errors
/// [`CastError::Device`]: a picture that is too wide, or that has too many corners of blocks for the coarse pass.
pub fn band_rows(
    view: &View,
    bytes_per_pixel: u64,
    max_bytes: u64,
    max_groups: u32,
    workgroup: (u32, u32),
) -> Result<u32, CastError> {
    let most =
        (max_bytes / (bytes_per_pixel * u64::from(view.width))).min(u64::from(max_groups) * u64::from(workgroup.1));
    let (columns, rows) = view.coarse_size();
    let coarse_fits = !view.beam()
        || (u64::from(columns) * u64::from(rows) * 4 <= max_bytes
            && rows.div_ceil(workgroup.1) <= max_groups
            && columns.div_ceil(workgroup.0) <= max_groups);
    let most = most.min(u64::from(view.height)) as u32;
    // Whole workgroups, if at least one fits.
    let most = if most < view.height && most >= workgroup.1 { most - most % workgroup.1 } else { most };
    if most == 0 || !coarse_fits || view.width.div_ceil(workgroup.0) > max_groups {
        return Err(CastError::Device(format!(
            "a picture of {} x {} pixels is more than this device can cast at once: make it smaller",
            view.width, view.height
        )));
    }
    Ok(most)
}

/// A picture in bands of rows, one dispatch each, and the sizes of the buffers for it.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Bands {
    /// Bytes of the coarse values; 4 without a coarse pass, since a binding cannot be empty.
    pub coarse_bytes: u64,
    /// Bytes that the pass writes for one band.
    pub out_bytes: u64,
    rows: u32,
    height: u32,
}

impl Bands {
    /// The bands of a view for a pass in workgroups of this size, on a device with these limits: bytes of a buffer, workgroups
    /// per dimension.
    ///
    /// # Errors
    /// As [`band_rows`].
    pub fn new(
        view: &View,
        pass: Pass,
        max_bytes: u64,
        max_groups: u32,
        workgroup: (u32, u32),
    ) -> Result<Self, CastError> {
        let rows = band_rows(view, pass.bytes_per_pixel(), max_bytes, max_groups, workgroup)?;
        let (columns, corners) = view.coarse_size();
        let beam = view.beam() && pass != Pass::Instances;
        Ok(Self {
            coarse_bytes: if beam { u64::from(columns) * u64::from(corners) * 4 } else { 4 },
            out_bytes: u64::from(rows) * u64::from(view.width) * pass.bytes_per_pixel(),
            rows,
            height: view.height,
        })
    }

    /// First row and number of rows of each band, the first on top.
    pub fn rows(self) -> impl Iterator<Item = (u32, u32)> {
        (0..self.height).step_by(self.rows as usize).map(move |first| (first, self.rows.min(self.height - first)))
    }
}

/// The uniform buffer for rows `first_row..` of the picture, with the octree's root at slot `root` of the
/// [resident](crate::gpu::resident::Resident) image.
pub fn band_view(view: &View, root: u32, first_row: u32) -> View {
    View { root, first_row, ..*view }
}

/// The uniform buffer for rows `first_row..` of a picture of instances, whose hierarchy has this many nodes. `view` is that of
/// one of them. The kernel reads no other number of it than the size of the picture and these two.
pub fn instances_view(view: &View, nodes: u32, first_row: u32) -> View {
    View { root: nodes, width: view.width, height: view.height, first_row, ..View::zeroed() }
}

/// The hierarchy to upload: with roots in the [resident](crate::gpu::resident::Resident) image.
pub fn resident_nodes(instances: &Instances, map: &SlotMap) -> Vec<Node> {
    let root = |node: &Node| if node.number == NO_INSTANCE { 0 } else { map.to_resident(node.view.root) };
    instances.nodes().iter().map(|node| Node { view: View { root: root(node), ..node.view }, ..*node }).collect()
}

/// Most rays that one dispatch casts on a device with these limits: bytes of a buffer, workgroups per dimension. At least 1.
pub fn rays_per_dispatch(max_bytes: u64, max_groups: u32) -> usize {
    let groups = u64::from(max_groups) * u64::from(WORKGROUP.0 * WORKGROUP.1);
    (max_bytes / size_of::<Ray>() as u64).min(groups).clamp(1, MAX_RAYS_PER_DISPATCH) as usize
}

/// Keeps the buffers for rays and hits below 240 MB, and a dispatch short enough for a driver that limits its time.
const MAX_RAYS_PER_DISPATCH: u64 = 1 << 22;

/// The uniform buffer for `count` rays of a buffer, with the octree's root at slot `root` of the
/// [resident](crate::gpu::resident::Resident) image. The kernel reads no other number of it.
pub fn rays_view(root: u32, count: u32) -> View {
    View { root, width: count, height: 1, ..View::zeroed() }
}

/// Workgroups for `count` rays.
pub fn ray_workgroups(count: u32, workgroup: (u32, u32)) -> u32 {
    count.div_ceil(workgroup.0 * workgroup.1)
}

/// Workgroups per row and column for a picture of `width` by `rows` invocations.
pub fn workgroups(width: u32, rows: u32, workgroup: (u32, u32)) -> (u32, u32) {
    (width.div_ceil(workgroup.0), rows.div_ceil(workgroup.1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::CastOptions;
    use crate::testing::sample::{Sample, cameras};

    #[test]
    fn large_pictures_are_cast_in_bands() {
        let view = |width, height, beam| {
            let options = CastOptions { beam, ..CastOptions::default() };
            View::new(&cameras()[0], glam::DMat4::IDENTITY, 2, (width, height), &options).expect("is valid")
        };
        let rows = |view: &View, max_bytes| band_rows(view, 16, max_bytes, 65535, (8, 8)).ok();
        assert_eq!(rows(&view(100, 50, true), 1 << 27), Some(50));
        assert_eq!(rows(&view(100, 50, true), 16 * 100 * 30), Some(24));
        assert_eq!(rows(&view(100, 50, false), 16 * 100 * 3), Some(3));
        assert_eq!(rows(&view(100, 50, false), 16 * 99), None);
        assert_eq!(rows(&view(65535 * 8 + 1, 2, false), 1 << 27), None);
        assert_eq!(rows(&view(2, 65535 * 8 + 1, false), 1 << 27), Some(65535 * 8));
        assert_eq!(rows(&view(2, 65535 * 8 + 1, true), 1 << 27), Some(65535 * 8));
        assert_eq!(rows(&view(64, 1, true), 300), None);

        let bands = Bands::new(&view(100, 50, false), Pass::Time, 4 * 100 * 20, 65535, WORKGROUP).expect("fits");
        assert_eq!((bands.coarse_bytes, bands.out_bytes), (4, 4 * 100 * 16));
        assert_eq!(bands.rows().collect::<Vec<_>>(), [(0, 16), (16, 16), (32, 16), (48, 2)]);
    }

    #[test]
    fn buffers_of_rays_fit_the_device() {
        assert_eq!(rays_per_dispatch(1 << 27, 65535), (1 << 27) / 40);
        assert_eq!(rays_per_dispatch(1 << 40, 65535), 65535 * 64);
        assert_eq!(rays_per_dispatch(1 << 40, u32::MAX), 1 << 22);
        assert_eq!(rays_per_dispatch(0, 65535), 1);
        assert_eq!([0, 1, 64, 65].map(|count| ray_workgroups(count, WORKGROUP)), [0, 1, 1, 2]);
    }

    #[test]
    fn software_drivers_get_a_texture_unless_told_otherwise() {
        let edge = |kind, options: GpuOptions| options.texture_edge(kind, 8192);
        let of = |slots_in| GpuOptions { slots_in, ..GpuOptions::default() };
        assert_eq!(edge(DeviceKind::SoftwareGpu, of(None)), Some(8192));
        assert_eq!(edge(DeviceKind::Gpu, of(None)), None);
        assert_eq!(edge(DeviceKind::SoftwareGpu, of(Some(SlotsIn::Buffers))), None);
        assert_eq!(edge(DeviceKind::Gpu, of(Some(SlotsIn::Texture))), Some(8192));
        let small_parts = GpuOptions { max_part_bytes: Some(64), ..GpuOptions::default() };
        assert_eq!(edge(DeviceKind::SoftwareGpu, small_parts), None);
    }

    #[test]
    fn what_is_not_needed_is_left_out_unless_it_is_to_stay() {
        let octree = Sample::plain(4, false).octree().expect("assembles");
        let limits =
            SlotLimits { binding_bytes: 1 << 27, storage_buffers: 8, texture_edge: None, memory_bytes: Some(1 << 27) };
        let placed = |leave_out| {
            let options = GpuOptions { leave_out, ..GpuOptions::default() };
            Placement::new(&octree, octree.slots(), &limits)
                .and_then(|placement| placement.with(&options, Arithmetic::PLAIN))
                .expect("fits")
        };
        let parts = |variant: Variant| (variant.contours, variant.far_pointers, variant.lod, variant.levels);
        let (all, nothing) = (placed(LeaveOut::ALL), placed(LeaveOut::NOTHING));
        assert_eq!(parts(all.rays_variant(true, false)), (false, false, false, octree.needs().levels));
        assert_eq!(parts(nothing.rays_variant(true, false)), (true, true, true, 23));
        assert_eq!(parts(nothing.rays_variant(false, true)), (false, true, true, 23), "cubes need no contours");
        let view = View { max_voxel_pixels: 0.0, flags: crate::FLAG_CONTOURS, ..bytemuck::Zeroable::zeroed() };
        assert_eq!(parts(all.variant(&view)), (false, false, false, octree.needs().levels));
        assert_eq!(parts(nothing.variant(&view)), (true, true, true, 23));
        for (keep, expected) in [
            (LeaveOut { contours: false, ..LeaveOut::ALL }, (true, false, false, octree.needs().levels)),
            (LeaveOut { far_pointers: false, ..LeaveOut::ALL }, (false, true, false, octree.needs().levels)),
            (LeaveOut { sizes: false, ..LeaveOut::ALL }, (false, false, true, octree.needs().levels)),
            (LeaveOut { frames: false, ..LeaveOut::ALL }, (false, false, false, 23)),
        ] {
            assert_eq!(parts(placed(keep).variant(&view)), expected, "{keep:?}");
        }

        let options = GpuOptions { workgroup: Some((7, 8)), ..GpuOptions::default() };
        assert!(all.with(&options, Arithmetic::PLAIN).expect_err("no power of two").contains("7 x 8"));
        let small = SlotLimits { memory_bytes: Some(8), ..limits };
        assert!(Placement::new(&octree, octree.slots(), &small).expect_err("too large").contains("memory of 8 bytes"));
    }

    #[test]
    fn every_part_is_bound_and_read() {
        let variant = Variant {
            contours: true,
            far_pointers: true,
            lod: true,
            beam: true,
            rays: false,
            instances: false,
            levels: 9,
            beam_block: 4,
            slots: Slots::Buffers { parts: 3, part_shift: 24 },
            workgroup: (8, 8),
            arithmetic: Arithmetic::EXACT,
        };
        let source = variant.source();
        for part in 0..3 {
            assert!(source.contains(&format!("@group(1) @binding({part}) ")), "{source}");
            assert!(source.contains(&format!("return part_{part}[within];")), "{source}");
        }
        assert!(source.contains("slot >> 24u") && source.contains("slot & 16777215u"));
        assert!(!Variant { slots: Slots::ONE_BUFFER, ..variant }.source().contains("switch"));
        let texture = Variant { slots: Slots::Texture { row_shift: 12 }, ..variant }.source();
        assert!(texture.contains("vec2<u32>(slot & 4095u, slot >> 12u)") && !texture.contains("part_0"), "{texture}");
    }

    #[test]
    fn the_kernel_shares_the_constants_of_the_reference() {
        let constant = |name: &str| {
            let from = CAST_WGSL.split(&format!("const {name}: ")).nth(1).expect("the constant is there");
            from.split(" = ").nth(1).and_then(|text| text.split(';').next()).expect("it has a value").to_owned()
        };
        let bits = |name| u32::from_str_radix(constant(name).trim_start_matches("0x").trim_end_matches('u'), 16);
        let number = |name| constant(name).parse::<f32>().expect("a number");
        assert_eq!(number("EPSILON"), crate::reference::EPSILON);
        assert_eq!(bits("EPSILON_BITS").map(f32::from_bits), Ok(crate::reference::EPSILON));
        assert_eq!(bits("MAX_COMPONENT_BITS").map(f32::from_bits), Ok(crate::reference::MAX_COMPONENT));
        assert_eq!(bits("MAX_ORIGIN_BITS").map(f32::from_bits), Ok(crate::ray::MAX_ORIGIN));
        assert_eq!(number("COARSE_VOXEL_BLOCKS"), crate::COARSE_VOXEL_BLOCKS);
        assert_eq!(number("MISS_T"), crate::Hit::MISS_T);
        assert_eq!(constant("MAX_ITERATIONS"), format!("1u << {}u", crate::reference::MAX_ITERATIONS.ilog2()));
    }
}
