//! A program without the engine `wgpu`, which is refused before effects are made.

use esvo_shadow::World;
use esvo_shadow::effects::{Frame, Lamp, Settings};
use glam::Vec3;

use crate::fail::Failure;

/// No device.
pub(crate) enum OnGpu {}

impl OnGpu {
    pub(crate) fn new(_: &World) -> Result<Self, Failure> {
        Err("--effects: this program was built without the feature wgpu".to_owned().into())
    }

    pub(crate) fn name(&self) -> &str {
        match *self {}
    }

    pub(crate) fn light(&self, _: &World, _: &Frame, _: &[Lamp], _: &Settings) -> Result<Vec<Vec3>, Failure> {
        match *self {}
    }
}
