//! The table of the engines.

use std::fmt;

use esvo_core::reference::ReferenceCaster;
use esvo_core::testing::compare::Allowed;
use esvo_core::{CastError, Caster};
use esvo_cpu::CpuCaster;

use crate::options::OpenOptions;
use crate::own::OwnEngine;

engines! {
    // Id, name, description, what may differ from the reference, cargo feature, opener.
    Reference, "reference", "The definition of a correct hit: one thread", Allowed::EXACT, always, |_| Ok(ReferenceCaster::default());
    Cpu, "cpu", "All cores", Allowed::EXACT, always, cpu;
    Wgpu, "wgpu", "The GPU through wgpu", Allowed::GPU, "wgpu", |options| esvo_wgpu::WgpuCaster::new(&gpu(options));
    Ash, "ash", "The GPU through Vulkan", Allowed::GPU, "ash", |options| esvo_ash::AshCaster::new(&gpu(options));
}

#[cfg(any(feature = "wgpu", feature = "ash"))]
fn gpu(options: &OpenOptions) -> esvo_core::gpu::kernel::GpuOptions {
    esvo_core::gpu::kernel::GpuOptions { leave_out: options.leave_out, ..options.gpu.clone() }
}

fn cpu(options: &OpenOptions) -> Result<CpuCaster, CastError> {
    let mut caster = match options.instructions {
        None => CpuCaster::new(options.threads)?,
        Some(instructions) => CpuCaster::with_instructions(options.threads, instructions)?,
    };
    caster.leave_out(options.leave_out);
    Ok(caster)
}

/// Opens an engine.
pub(crate) type Opener = &'static (dyn Fn(&OpenOptions) -> Result<Box<dyn Caster>, CastError> + Send + Sync);

/// What is known of an engine without opening it.
pub struct Engine {
    /// Its id.
    pub id: EngineId,
    /// Its name: what is typed, and what stands in reports and matrices. Lower-case letters.
    pub name: &'static str,
    /// What it is, in a few words, without a full stop.
    pub description: &'static str,
    /// What may differ between its hits and those of the reference caster.
    pub allowed: Allowed,
    /// The cargo feature of this crate, of `esvo-bench` and of `esvo` that builds it in; `None` if it is always there.
    pub feature: Option<&'static str>,
    /// `None` if this program was built without it, or if only a record names it.
    pub(crate) opener: Option<Opener>,
}

impl Engine {
    /// Whether this program was built with it.
    pub fn is_built_in(&self) -> bool {
        self.opener.is_some()
    }
}

impl fmt::Debug for Engine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { id: _, name, description, allowed, feature, opener } = self;
        f.debug_struct("Engine")
            .field("name", name)
            .field("description", description)
            .field("allowed", allowed)
            .field("feature", feature)
            .field("is_built_in", &opener.is_some())
            .finish()
    }
}

/// Makes [`EngineId`] and the table from the lines above.
macro_rules! engines {
    ($($id:ident, $name:literal, $description:literal, $allowed:expr, $feature:tt, $open:expr;)+) => {
        /// An engine that casts rays at octrees, by name. Ordered as in the table of the engines.
        #[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, PartialOrd, Ord)]
        pub enum EngineId {
            $(#[doc = concat!("`", $name, "`: ", $description, ".")] $id,)+
            /// One that is not in the table: see [`EngineId::register`].
            Own(OwnEngine),
        }

        impl EngineId {
            /// Every engine of the table, whether this program was built with it or not.
            pub const ALL: &'static [Self] = &[$(Self::$id),+];

            /// What is known of it.
            pub fn engine(self) -> &'static Engine {
                match self {
                    $(Self::$id => {
                        static ENGINE: Engine = Engine {
                            id: EngineId::$id,
                            name: $name,
                            description: $description,
                            allowed: $allowed,
                            feature: feature_name!($feature),
                            opener: opener!($feature, $open),
                        };
                        &ENGINE
                    })+
                    Self::Own(own) => own.engine(),
                }
            }
        }
    };
}

/// The name of a cargo feature.
macro_rules! feature_name {
    (always) => {
        None
    };
    ($feature:literal) => {
        Some($feature)
    };
}

/// An [`Opener`] that boxes the caster, if the feature is on.
macro_rules! opener {
    (always, $open:expr) => {
        Some(&|options| {
            let open: fn(&OpenOptions) -> Result<_, CastError> = $open;
            Ok(Box::new(open(options)?))
        })
    };
    ($feature:literal, $open:expr) => {{
        #[cfg(feature = $feature)]
        let opener: Option<Opener> = opener!(always, $open);
        #[cfg(not(feature = $feature))]
        let opener: Option<Opener> = None;
        opener
    }};
}

use {engines, feature_name, opener};

#[cfg(all(test, any(feature = "wgpu", feature = "ash")))]
mod tests {
    use esvo_core::LeaveOut;

    use super::*;

    #[test]
    fn gpu_casters_are_told_what_to_leave_out() {
        for leave_out in [LeaveOut::ALL, LeaveOut::NOTHING] {
            assert_eq!(gpu(&OpenOptions { leave_out, ..OpenOptions::default() }).leave_out, leave_out);
        }
    }
}
