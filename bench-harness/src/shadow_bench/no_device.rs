//! A program without GPUs.

use esvo_shadow::trace::Ray;
use esvo_shadow::{Extent, Volume};

use glam::Vec3;

use super::picture_time::Scene;
use super::stage::failed;
use super::{PictureRow, RateRow};
use crate::BenchError;

/// No device.
pub(super) enum Device {}

impl Device {
    pub(super) fn open() -> Result<Self, BenchError> {
        Err(failed("device", "this program was built without the feature wgpu"))
    }

    pub(super) fn pictures(&self) -> u32 {
        match *self {}
    }

    pub(super) fn copy(&self, _: &Volume) -> Result<(), BenchError> {
        match *self {}
    }

    pub(super) fn send(&self, (): &mut (), _: &Volume, _: &[Extent]) -> Result<f64, BenchError> {
        match *self {}
    }

    pub(super) fn picture(&self, _: &Scene, _: u32, _: &[Vec3]) -> Result<PictureRow, BenchError> {
        match *self {}
    }

    pub(super) fn rates(&self, _: &str, _: &Volume, _: &[Ray], _: &[bool], _: u32) -> Result<Vec<RateRow>, BenchError> {
        match *self {}
    }
}
