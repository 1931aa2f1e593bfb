//! Rays, cameras, the Caster trait, the reference caster and the kernel sources of esvo.

pub mod ambient;
pub mod camera;
mod caster;
mod checked;
mod error;
pub mod exact;
mod fan;
mod frame;
pub mod gpu;
mod hit;
pub mod picture;
pub mod reference;
pub mod shading;
pub mod testing;

pub use camera::Camera;
pub use caster::{Caster, Device, DeviceKind, FrameTime};
pub use checked::{Checked, Roots};
pub use error::CastError;
pub use fan::{Fan, Fans};
pub use frame::{BEAM_BLOCK, COARSE_VOXEL_PIXELS, CastOptions, FLAG_BEAM, FLAG_CONTOURS, MAX_PIXELS, Ray, View};
pub use hit::{Hit, exp2};
pub use picture::Picture;
