//! The volume on a GPU, and rays through it there.
//!
//! ```
//! use esvo_device::Gpu;
//! use esvo_shadow::gpu::{GpuVolume, Tracer};
//! use esvo_shadow::trace::{Fidelity, Ray, first_hit};
//! use esvo_shadow::{Extent, Volume};
//! use glam::DVec3;
//!
//! # fn main() -> Result<(), esvo_shadow::ShadowError> {
//! # if let (Err(error), None) = (Gpu::open(None), std::env::var_os("ESVO_REQUIRE_GPU")) {
//! #     println!("skipped: {error}");
//! #     return Ok(());
//! # }
//! let gpu = Gpu::open(None)?;
//! let mut volume = Volume::new([100, 100, 50], 2)?;
//! volume.set([[50, 50, 25]]);
//! let mut copy = GpuVolume::new(&gpu, &volume)?;
//! let tracer = Tracer::new(&gpu)?;
//! let rays = [Ray::new(DVec3::new(50.2, 3.0, 25.8), DVec3::Y, 90.0)?];
//! assert_eq!(tracer.trace(&gpu, &copy, &rays, Fidelity::EXACT)?.rays, [first_hit(&volume, &rays[0], Fidelity::EXACT)]);
//!
//! // One more voxel, nearer: the copy gets the byte that it is in, and those of the mips above.
//! volume.set([[50, 20, 25]]);
//! let sent = copy.update(&gpu, &volume, &[Extent::of_voxels([50, 20, 25], [50, 20, 25])])?;
//! assert_eq!((sent.bytes, sent.writes), (3, 3));
//! assert_eq!(tracer.trace(&gpu, &copy, &rays, Fidelity::EXACT)?.rays, [first_hit(&volume, &rays[0], Fidelity::EXACT)]);
//! # Ok(()) }
//! ```
//!
//! # Layout
//! One 3D texture of format `R8Uint`, with as many levels as the volume has: the base, then the mips. A texel is a byte of the volume at the same place, so that rows
//! go to the device as they lie in [`Volume::level`](crate::Volume::level). A level of a texture has half the texels of the one below,
//! rounded down, where a mip has half the bytes, rounded up. So the base of the texture is rounded up to a multiple of `2^mips` texels along each
//! axis: [`texture_size`]. The texels that this adds are zero and stay so.
//!
//! # Kernels
//! [`TRACE_WGSL`] is the text that other kernels follow. It has group 0, whose layout [`volume_layout`] makes and whose bind group is [`GpuVolume::bind_group`]:
//!
//! | binding | what |
//! |---|---|
//! | 0 | uniform `ShadowVolume`, 16 bytes: voxels along each axis, coarsest level |
//! | 1 | the texture, all its levels |
//!
//! `new_ray(origin, direction, length)` is [`Ray::new`](crate::trace::Ray::new) in single precision, `walk_first(ray, fidelity)` is [`first_hit`](crate::trace::first_hit), `is_blocked(ray, fidelity)` its answer alone, `steps_first(ray, steps, fidelity)` is
//! [`Steps::first_hit`](crate::trace::Steps::first_hit), `is_full(level, cell)` is [`Occupancy::occupied`](crate::Occupancy::occupied), and the private
//! variable `looks` counts cells that the volume was asked for.
//! [`Ray`](crate::trace::Ray) has the struct of 32 bytes that kernels read, [`Steps`](crate::trace::Steps) that of 16.
//!
//! # Effects
//! [`Effects`] makes whole pictures with the passes of [`effects`](crate::effects), each a kernel of [`EFFECTS_WGSL`] over the picture's pixels, and says how long each took.
//! It is also an example of kernels that follow [`TRACE_WGSL`].
//!
//! # Exactness
//! Kernels have the numbers of the processor's tracer, and all of them are whole: cells, levels, steps and times are equal in every bit. A time comes back as
//! a fraction, and both make a distance of it by the same function. Effects choose rays by sines and roots, which devices round a little otherwise: `tests/gpu_effects.rs` holds
//! pictures against those of the processor. `tests/gpu.rs` holds it, and that mistakes put into the kernels are caught; `tests/gpu_moving.rs`
//! that the bytes are those of the processor while objects move, and that a region or a mip that was not sent is noticed.
//!
//! # Limits and errors
//! A texture has at most [`max_texture_dimension_3d`](esvo_device::wgpu::Limits::max_texture_dimension_3d) texels along an axis, twice as many voxels; 2048 texels is what every
//! device has. What does not fit is an error of the device, and nothing is made. Lists of rays have no limit: they are traced in parts
//! that fit a binding and a dispatch.

mod effects;
mod tracer;
mod volume;

pub use effects::{EFFECTS_WGSL, Effects};
pub use tracer::{Tracer, Traces};
pub use volume::{GpuVolume, Sent, texture_size, volume_layout};

/// What kernels that trace rays begin with; the module's page says what it has.
pub const TRACE_WGSL: &str = include_str!("../../kernels/trace.wgsl");
