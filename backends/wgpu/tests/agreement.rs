//! The kernel against the reference caster, on whatever device there is.

use esvo_core::testing::conformance::{self, Fault};
use esvo_core::{CastError, Caster};
use esvo_wgpu::{GpuOptions, WgpuCaster};

fn make(options: &GpuOptions) -> Result<Box<dyn Caster>, CastError> {
    Ok(Box::new(WgpuCaster::new(options)?))
}

#[test]
fn finds_what_the_reference_finds() -> Result<(), Fault> {
    conformance::on_device(&make, conformance::agrees)
}

#[test]
fn finds_the_same_along_strange_rays() -> Result<(), Fault> {
    conformance::on_device(&make, conformance::takes_strange_rays)
}

#[test]
fn finds_the_same_in_an_octree_split_over_bindings() -> Result<(), Fault> {
    conformance::on_device(&make, conformance::agrees_over_bindings)
}

#[test]
fn broken_kernels_are_caught() -> Result<(), Fault> {
    conformance::on_device(&make, conformance::broken_kernels_are_caught)
}

#[test]
fn errors_are_values() -> Result<(), Fault> {
    conformance::on_device(&make, conformance::errors_are_values)
}

#[test]
fn times_are_plausible() -> Result<(), Fault> {
    conformance::on_device(&make, conformance::times_are_plausible)
}

#[test]
fn nothing_is_left_of_the_frame_before() -> Result<(), Fault> {
    conformance::on_device(&make, conformance::nothing_is_left_of_the_frame_before)
}
