//! The engines by name.

use esvo_core::Caster;
use esvo_core::reference::ReferenceCaster;
use esvo_cpu::CpuCaster;
use serde::{Deserialize, Serialize};

use crate::BenchError;
use crate::paper_bench::check::Allowed;

/// An engine that casts rays against octrees.
#[derive(Clone, Copy, PartialEq, Eq, Debug, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Backend {
    /// The definition of a correct hit: one thread, scalar.
    Reference,
    /// All cores.
    Cpu,
    /// The WGSL kernel through wgpu.
    Wgpu,
    /// The same kernel as SPIR-V on Vulkan.
    Ash,
}

impl Backend {
    /// Every engine.
    pub const ALL: [Self; 4] = [Self::Reference, Self::Cpu, Self::Wgpu, Self::Ash];

    /// Its name, as in a matrix and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Reference => "reference",
            Self::Cpu => "cpu",
            Self::Wgpu => "wgpu",
            Self::Ash => "ash",
        }
    }

    /// Opens it. `threads` is the number of threads of the CPU caster; `None`: all.
    ///
    /// # Errors
    /// No device for it, or this program was built without it; the text says what to install.
    pub fn open(self, threads: Option<usize>) -> Result<Box<dyn Caster>, BenchError> {
        let failed = |what: String| BenchError::Backend { backend: self.name(), what };
        match self {
            Self::Reference => Ok(Box::new(ReferenceCaster::default())),
            Self::Cpu => Ok(Box::new(CpuCaster::new(threads).map_err(|e| failed(e.to_string()))?)),
            #[cfg(feature = "wgpu")]
            Self::Wgpu => Ok(Box::new(
                esvo_wgpu::WgpuCaster::new(&esvo_wgpu::GpuOptions::default()).map_err(|e| failed(e.to_string()))?,
            )),
            #[cfg(feature = "ash")]
            Self::Ash => Ok(Box::new(
                esvo_ash::AshCaster::new(&esvo_ash::GpuOptions::default()).map_err(|e| failed(e.to_string()))?,
            )),
            #[allow(unreachable_patterns)]
            _ => Err(failed(format!("this program was built without it; build with `--features {}`", self.name()))),
        }
    }

    /// What may differ from the reference caster.
    ///
    /// The CPU computes in the same order with the same roundings: nothing. A GPU may fuse or reorder operations within
    /// the rules of its shading language, so that a ray through an edge can fall to the other side: one pixel in 100,000,
    /// and 1/8192 of the far plane's distance (2^11 units in the last place of `t` = 1) where the voxel is the same.
    pub fn allowed(self) -> Allowed {
        match self {
            Self::Reference | Self::Cpu => Allowed { share: 0.0, t: 0.0 },
            Self::Wgpu | Self::Ash => Allowed { share: 1e-5, t: 1.0 / 8192.0 },
        }
    }
}
