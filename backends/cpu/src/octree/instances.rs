//! Pictures of many placed objects, tile by tile.

use esvo_core::instances::Batch;
use esvo_core::{CastError, Hit, Instances, LeaveOut, Nearest};
use esvo_format::Octree;
use rayon::prelude::*;

use super::instructions::InstructionSet;
use super::scene::Scene;
use super::task::Task;

/// Edge of a tile in pixels. The rays of one instance in a tile are a list of their own: fewer lists cost less, smaller tiles
/// let more rays end at nearer hits.
const TILE: usize = 32;

/// Casts on the threads of the pool in which it is called.
pub(super) fn cast(
    instructions: InstructionSet,
    octree: &Octree,
    leave_out: LeaveOut,
    instances: &Instances,
    nearest: &mut Nearest,
) -> Result<(), CastError> {
    let view = &instances.views()[0];
    nearest.resize(view);
    let band = view.width as usize * TILE;
    let bands = nearest.hits.par_chunks_mut(band).zip(nearest.views.par_chunks_mut(band)).enumerate();
    bands.try_for_each_init(Batch::default, |batch, (number, (hits, views))| {
        let first_row = (number * TILE) as u32;
        for left in (0..view.width).step_by(TILE) {
            let columns = left..view.width.min(left + TILE as u32);
            instances.cast_band(columns, first_row, (&mut *hits, &mut *views), batch, |view, rays, hits| {
                hits.resize(rays.len(), Hit::miss(0));
                let scene = Scene::new(octree, view.root, leave_out);
                instructions.run(&scene, Task::Rays { rays, contours: view.contours(), hits });
                Ok::<_, CastError>(())
            })?;
        }
        Ok(())
    })
}
