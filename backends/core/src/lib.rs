//! Rays, cameras, the Caster trait, the reference caster and the kernel sources of esvo.

pub mod ambient;
mod caster;
pub mod compare;
pub mod conformance;
pub mod exact;
mod fan;
mod frame;
mod hit;
pub mod kernel;
pub mod reference;
pub mod resident;
pub mod sample;
pub mod shading;
pub mod speed;

pub use caster::{CastError, Caster, Device, DeviceKind, FrameTime};
pub use fan::{Fan, Fans};
pub use frame::{BEAM_BLOCK, COARSE_VOXEL_PIXELS, Camera, CastOptions, FLAG_BEAM, FLAG_CONTOURS, Ray, View};
pub use hit::{Hit, exp2};
