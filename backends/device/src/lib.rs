//! What every wgpu program of esvo shares: an open device, its buffers, pipelines, timestamps and errors.
//!
//! A program that doubles three numbers:
//!
//! ```
//! use esvo_device::{Gpu, Usage, storage};
//!
//! # fn main() -> Result<(), esvo_device::DeviceError> {
//! # if let (Err(error), None) = (Gpu::open(None), std::env::var_os("ESVO_REQUIRE_GPU")) {
//! #     println!("skipped: {error}");
//! #     return Ok(());
//! # }
//! let gpu = Gpu::open(None)?;
//! let layout = gpu.bind_group_layout("numbers", &[storage(0, false)])?;
//! let module = gpu.shader("double", "
//!     @group(0) @binding(0) var<storage, read_write> numbers: array<u32>;
//!     @compute @workgroup_size(64) fn double(@builtin(global_invocation_id) id: vec3<u32>) {
//!         if id.x < arrayLength(&numbers) { numbers[id.x] *= 2u; }
//!     }")?;
//! let pipeline = gpu.compute_pipeline(&module, "double", &[&layout])?;
//! let numbers = gpu.upload("numbers", &[1u32, 2, 3], Usage::STORAGE | Usage::COPY_SRC)?;
//! let group = gpu.bind_group(&layout, &[&numbers])?;
//! gpu.run(|commands| {
//!     let mut pass = commands.begin_compute_pass(&Default::default());
//!     pass.set_pipeline(&pipeline);
//!     pass.set_bind_group(0, &group, &[]);
//!     pass.dispatch_workgroups(1, 1, 1);
//! })?;
//! assert_eq!(gpu.read::<u32>(&numbers, 3)?, [2, 4, 6]);
//! # Ok(()) }
//! ```
//!
//! # What is where
//! - `adapter`: [`adapters`], and which of them [`Gpu::open`] takes; [`Gpu::from_device`] takes a device that is open already.
//! - `gpu`: [`Gpu`], an open device: submitting, waiting, limits, and turning what wgpu reports into errors.
//! - `buffers`: making, filling and reading buffers.
//! - `pipelines`: shaders, bind groups and compute pipelines. [`Gpu::checked`] makes everything else.
//! - `textures`: textures that shaders read by texel.
//! - `timestamps`: [`Timestamps`], how long passes take by the device's own clock.
//! - `error`: [`DeviceError`].
//!
//! # Errors
//! wgpu reports errors through callbacks and panics where there are none. Here each is the result of the call that caused
//! it. The exceptions are errors that the device reports later, e.g. of a pass that was submitted: the next call that
//! submits, waits or checks returns those. After the device is lost, every call returns [`DeviceError::Lost`].

mod adapter;
mod buffers;
mod error;
mod gpu;
mod pipelines;
mod textures;
mod timestamps;

pub use adapter::adapters;
pub use buffers::Reading;
pub use error::DeviceError;
pub use gpu::Gpu;
pub use pipelines::{storage, uniform};
pub use textures::read_texture;
pub use timestamps::{PassTimes, Timestamps};
pub use wgpu;
pub use wgpu::BufferUsages as Usage;
