//! Opening an engine.

use esvo_core::gpu::triangles::TriangleCaster;
use esvo_core::{CastError, Caster};

use crate::options::OpenOptions;
use crate::table::EngineId;

/// An engine that could not be opened.
#[derive(Debug, thiserror::Error)]
#[error("engine {engine}: {reason}")]
pub struct OpenError {
    /// The engine.
    pub engine: EngineId,
    /// Why.
    #[source]
    pub reason: OpenFailure,
}

/// Why an engine could not be opened.
#[derive(Debug, thiserror::Error)]
pub enum OpenFailure {
    /// This program was built without it.
    #[error("this program was built without it; build it with `cargo build --features {feature}`")]
    NotBuiltIn {
        /// The cargo feature that builds it in.
        feature: &'static str,
    },
    /// Only a record names it.
    #[error("it is one of another program's own, which this program does not have; register it, or leave it out")]
    Foreign,
    /// The engine failed. The text says what to install.
    #[error(transparent)]
    Cast(#[from] CastError),
}

impl EngineId {
    /// Opens the engine.
    ///
    /// # Errors
    /// The program was built without it, or it finds no device.
    pub fn open(self, options: &OpenOptions) -> Result<Box<dyn Caster>, OpenError> {
        let engine = self.engine();
        let opened = match engine.opener {
            Some(open) => open(options).map_err(OpenFailure::Cast),
            None if !self.is_known() => Err(OpenFailure::Foreign),
            None => Err(OpenFailure::NotBuiltIn { feature: engine.feature.unwrap_or(engine.name) }),
        };
        opened.map_err(|reason| OpenError { engine: self, reason })
    }

    /// Opens the engine for triangles. `None` for the engines of the processor, where `esvo_cpu::triangles` casts triangles, and for
    /// engines of one's own.
    ///
    /// # Errors
    /// As [`open`](Self::open).
    pub fn open_triangles(self, options: &OpenOptions) -> Result<Option<Box<dyn TriangleCaster>>, OpenError> {
        let opened: Option<Result<Box<dyn TriangleCaster>, CastError>> = match (self, &options.gpu) {
            (Self::Reference | Self::Cpu | Self::Own(_), _) => return Ok(None),
            #[cfg(feature = "wgpu")]
            (Self::Wgpu, gpu) => Some(esvo_wgpu::WgpuTriangles::new(gpu).map(|caster| Box::new(caster) as _)),
            #[cfg(feature = "ash")]
            (Self::Ash, gpu) => Some(esvo_ash::AshTriangles::new(gpu).map(|caster| Box::new(caster) as _)),
            #[cfg(not(all(feature = "wgpu", feature = "ash")))]
            _ => None,
        };
        let reason = match opened {
            Some(Ok(caster)) => return Ok(Some(caster)),
            Some(Err(error)) => OpenFailure::Cast(error),
            None => OpenFailure::NotBuiltIn { feature: self.engine().feature.unwrap_or(self.name()) },
        };
        Err(OpenError { engine: self, reason })
    }
}
