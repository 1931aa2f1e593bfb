//! What every engine must do, as tests: one list of checks, expanded for each engine by a macro.
//!
//! In a file of the engine's `tests/` folder:
//!
//! ```
//! use esvo_core::Caster;
//! use esvo_core::reference::ReferenceCaster;
//! use esvo_core::testing::conformance::Subject;
//!
//! const REFERENCE: Subject = Subject::native(|| Ok(Box::new(ReferenceCaster::default())));
//!
//! esvo_core::conformance_suite!(reference, super::REFERENCE);
//! # fn main() {}
//! ```
//!
//! That makes a module `reference` with one test for each of [`CHECKS`]. Engines that run the kernel of [`gpu`](crate::gpu)
//! use [`kernel_suite!`](crate::kernel_suite), which adds [`KERNEL_CHECKS`]. A check has a negative control: a broken
//! caster that does not pass it.
//!
//! Where an engine cannot be opened, because a device or an instruction set is missing, a test prints the reason and what
//! was not tested on standard error, and passes; see [`Subject::required_by`].

mod broken;
mod checks;
mod filter;
mod instances;
mod kernel;
mod rays;

use std::fmt::Debug;

use esvo_format::FormatError;

pub use checks::*;
pub use filter::*;
pub use instances::*;
pub use kernel::*;
pub use rays::*;

use crate::gpu::kernel::GpuOptions;
use crate::{CastError, Caster};

/// Environment variable that is set where a GPU must be there: a GPU engine that cannot be opened then fails its tests.
pub const REQUIRE_GPU: &str = "ESVO_REQUIRE_GPU";

/// A caster, opened.
pub type Opened = Result<Box<dyn Caster>, CastError>;

/// One of the checks.
pub type Check = fn(&Subject) -> Result<(), Fault>;

/// An engine that is to be tested.
#[derive(Clone, Copy)]
pub struct Subject {
    open: Open,
    required_by: Option<&'static str>,
}

#[derive(Clone, Copy)]
enum Open {
    Native(fn() -> Opened),
    Kernel(fn(&GpuOptions) -> Opened),
}

impl Subject {
    /// An engine that can be opened everywhere.
    pub const fn native(open: fn() -> Opened) -> Self {
        Self { open: Open::Native(open), required_by: None }
    }

    /// An engine that runs the kernel of [`gpu`](crate::gpu) as the options say. It may be missing unless [`REQUIRE_GPU`]
    /// is set.
    pub const fn kernel(open: fn(&GpuOptions) -> Opened) -> Self {
        Self { open: Open::Kernel(open), required_by: Some(REQUIRE_GPU) }
    }

    /// The same engine, which may be missing unless this environment variable is set.
    pub const fn required_by(self, variable: &'static str) -> Self {
        Self { required_by: Some(variable), ..self }
    }

    /// Opens the engine.
    ///
    /// # Errors
    /// What it says.
    pub fn open(&self) -> Opened {
        match self.open {
            Open::Native(open) => open(),
            Open::Kernel(open) => open(&GpuOptions::default()),
        }
    }

    /// Opens it with these options.
    ///
    /// # Errors
    /// What it says; [`Fault::Wrong`] for an engine that runs no kernel.
    fn open_with(&self, options: &GpuOptions) -> Result<Opened, Fault> {
        match self.open {
            Open::Native(_) => Err(Fault::Wrong("this engine runs no kernel: test it with conformance_suite!".into())),
            Open::Kernel(open) => Ok(open(options)),
        }
    }
}

/// Why an engine does not conform.
#[derive(thiserror::Error)]
pub enum Fault {
    /// It does not do what it must.
    #[error("{0}")]
    Wrong(String),
    /// It failed where it must not.
    #[error(transparent)]
    Cast(#[from] CastError),
    /// A sample could not be assembled.
    #[error(transparent)]
    Sample(#[from] FormatError),
}

/// As it is displayed: this is what a test that returns it prints.
impl Debug for Fault {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{self}")
    }
}

/// [`Fault::Wrong`] with what was found, unless `right`.
fn demand(right: bool, found: impl FnOnce() -> String) -> Result<(), Fault> {
    if right { Ok(()) } else { Err(Fault::Wrong(found())) }
}

/// Runs a check: what a test of the suites does.
///
/// # Errors
/// As the check; an engine that cannot be opened although it must.
pub fn run(subject: &Subject, name: &str, check: Check) -> Result<(), Fault> {
    match subject.open() {
        Ok(_) => check(subject),
        Err(error) => may_be_missing(subject.required_by, error, name),
    }
}

/// Says on standard error that something was not tested.
///
/// # Errors
/// The reason, if nothing allows it to be missing or the environment variable that forbids it is set.
fn may_be_missing(required_by: Option<&str>, reason: CastError, what: &str) -> Result<(), Fault> {
    match required_by {
        Some(variable) if matches!(reason, CastError::Device(_)) && std::env::var_os(variable).is_none() => {
            eprintln!("skipped: {reason}: not tested: {what} (set {variable} to make this a failure)");
            Ok(())
        }
        _ => Err(reason.into()),
    }
}

/// Prints on standard error which of these engines are tested here and which are not, one a line.
///
/// # Errors
/// An engine that cannot be opened although it must.
pub fn tell_what_is_tested(subjects: &[(&str, Subject)]) -> Result<(), Fault> {
    for (name, subject) in subjects {
        match subject.open() {
            Ok(caster) => eprintln!("tested: {name}: {} ({})", caster.device().name, caster.device().detail),
            Err(error) => may_be_missing(subject.required_by, error, name)?,
        }
    }
    Ok(())
}

/// Makes the tests of an engine: a module of this name with one test for each of
/// [`CHECKS`](crate::testing::conformance::CHECKS). The subject is an expression, as seen from within that module.
#[macro_export]
macro_rules! conformance_suite {
    // The list of checks, handed to another arm.
    (@each $then:ident $given:tt) => {
        $crate::conformance_suite! { @$then $given
            cubes_agree
            contours_agree
            blocks_and_far_pointers_agree
            odd_sizes_agree
            all_objects_agree
            fans_agree
            strange_rays_agree
            rays_agree
            hard_rays_agree
            lists_of_rays_stand_alone
            strange_lists_of_rays_agree
            bad_views_are_refused
            roots_of_no_object_are_refused
            unsound_octrees_are_refused
            damaged_octrees_are_refused
            checks_against_another_octree_do_not_count
            nothing_loaded_is_an_error
            nothing_is_left_of_the_frame_before
            times_are_plausible
            broken_casters_are_caught
            broken_casters_of_rays_are_caught
            filters_agree
            broken_filters_are_caught
            instances_agree
            instances_of_odd_sizes_agree
            strange_instances_agree
            broken_casters_of_instances_are_caught
        }
    };
    (@table () $($check:ident)*) => {
        &[$((stringify!($check), $check)),*]
    };
    (@tests ($name:ident, $subject:expr) $($check:ident)*) => {
        mod $name {
            $(
                #[test]
                fn $check() -> Result<(), $crate::testing::conformance::Fault> {
                    use $crate::testing::conformance;
                    let name = concat!(stringify!($name), ", ", stringify!($check));
                    conformance::run(&$subject, name, conformance::$check)
                }
            )*
        }
    };
    ($name:ident, $subject:expr) => {
        $crate::conformance_suite! { @each tests ($name, $subject) }
    };
}

/// Makes the tests of an engine that runs the kernel of [`gpu`](crate::gpu): a module of this name, and in it the modules
/// `all` with the tests of [`conformance_suite!`](crate::conformance_suite) and `kernel` with one test for each of
/// [`KERNEL_CHECKS`](crate::testing::conformance::KERNEL_CHECKS). The subject is the path of a constant, as seen from those
/// two modules.
#[macro_export]
macro_rules! kernel_suite {
    (@each $then:ident $given:tt) => {
        $crate::conformance_suite! { @$then $given
            several_bindings_agree
            octrees_in_buffers_and_in_textures_agree
            other_workgroups_agree
            kernels_need_no_exact_driver
            subgroups_agree_or_are_refused
            beams_of_both_blocks_save_the_same
            broken_kernels_are_caught
            batches_of_rays_agree
            kernels_led_astray_are_caught
            kernels_that_break_rays_are_caught
            what_a_device_cannot_do_is_an_error
            filters_in_bands_agree
            kernels_that_break_instances_are_caught
        }
    };
    ($name:ident, $subject:expr) => {
        mod $name {
            $crate::conformance_suite! { @each tests (all, $subject) }
            $crate::kernel_suite! { @each tests (kernel, $subject) }
        }
    };
}

/// The checks that every engine must pass, by name.
pub const CHECKS: &[(&str, Check)] = conformance_suite!(@each table ());

/// The further checks of engines that run the kernel, by name.
pub const KERNEL_CHECKS: &[(&str, Check)] = kernel_suite!(@each table ());

#[cfg(test)]
mod tests;
