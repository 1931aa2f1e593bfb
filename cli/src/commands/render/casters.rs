//! The engines of a picture, each with the octree loaded once.

use std::path::Path;
use std::sync::Arc;

use esvo_core::Caster;
use esvo_engines::{EngineId, InstructionSet, OpenOptions};
use esvo_format::Octree;

use super::look::{Look, ViewMode};
use crate::fail::Failure;
use crate::files::name_file;

/// What decides which caster a picture takes.
type Kind = (EngineId, Option<InstructionSet>);

/// Casters that have loaded the octree: one for each way of casting that is needed.
#[derive(Default)]
pub(crate) struct Casters {
    loaded: Vec<(Kind, Box<dyn Caster>)>,
}

/// Packets of rays have one number of iterations: pictures of them take single rays.
fn kind(look: &Look) -> Kind {
    (look.engine, (look.mode == ViewMode::Iterations).then_some(InstructionSet::Scalar))
}

impl Casters {
    /// Opens the engine of a picture and loads the octree, unless that was done. `file`: where it comes from.
    pub(crate) fn load(&mut self, look: &Look, octree: &Arc<Octree>, file: &Path) -> Result<(), Failure> {
        let kind = kind(look);
        if self.loaded.iter().all(|(other, _)| *other != kind) {
            let mut caster = kind.0.open(&OpenOptions { instructions: kind.1, ..OpenOptions::default() })?;
            caster.load(octree).map_err(|error| name_file(file, error))?;
            self.loaded.push((kind, caster));
        }
        Ok(())
    }

    /// The caster of a picture.
    pub(crate) fn of(&mut self, look: &Look) -> Result<&mut dyn Caster, Failure> {
        let kind = kind(look);
        match self.loaded.iter_mut().find(|(other, _)| *other == kind) {
            Some((_, caster)) => Ok(&mut **caster),
            None => Err(format!("{} is not loaded", look.engine.engine().name).into()),
        }
    }

    /// Engine and device of a picture.
    pub(crate) fn name(&self, look: &Look) -> String {
        let kind = kind(look);
        let caster = self.loaded.iter().find(|(other, _)| *other == kind);
        caster.map_or(String::new(), |(_, caster)| format!("{} on {}", caster.name(), caster.device().name))
    }
}
