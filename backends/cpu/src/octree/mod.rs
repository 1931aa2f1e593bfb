//! The octree caster on all cores.
//!
//! `shared` casts pictures in tiles of 16 x 16 pixels, and pictures, fans and lists in packets of sixteen rays that share a stack:
//! one source for all vectors of `fearless_simd`.
//! `lockstep` casts rays of fans and lists that do not stay together, on the same vectors. `single` casts rays one by one: those of
//! [`InstructionSet::Scalar`], and fans and lists where vectors are too short for packets. `task` is what they are asked to do.
//! `instances` casts pictures of many objects, as lists of rays for each tile and object.

pub mod counters;
mod instances;
mod instructions;
mod lockstep;
mod scene;
mod shared;
mod single;
mod task;

use std::sync::Arc;
use std::time::{Duration, Instant};

use esvo_core::filter::{Frame, Radius};
use esvo_core::{
    CastError, Caster, Checked, Device, DeviceKind, Fans, Filtered, FrameTime, Hit, Instances, LeaveOut, Nearest, Ray,
    Rays, Roots, View,
};
use esvo_format::Octree;
use rayon::prelude::*;

pub use self::instructions::InstructionSet;
use self::scene::Scene;
use self::task::{BAND_ROWS, Task};
use crate::{filter, machine};

/// Rays of a list per task; rays of fans per task, roughly.
const RAYS_PER_TASK: usize = 4096;

/// Casts against octrees on all cores.
///
/// Its hits are bit for bit those of the reference caster.
pub struct CpuCaster {
    device: Device,
    pool: rayon::ThreadPool,
    instructions: InstructionSet,
    leave_out: LeaveOut,
    loaded: Option<(Arc<Octree>, Roots)>,
}

impl CpuCaster {
    /// A caster on this many threads, or on one per core, with the fastest instructions that the processor has;
    /// [`Caster::device`] says which.
    ///
    /// # Errors
    /// [`CastError::Device`]: the system refuses the threads.
    pub fn new(threads: Option<usize>) -> Result<Self, CastError> {
        Self::with_instructions(threads, InstructionSet::best())
    }

    /// The same with these instructions and no others.
    ///
    /// # Errors
    /// [`CastError::Device`]: the processor does not have them, or the system refuses the threads.
    pub fn with_instructions(threads: Option<usize>, instructions: InstructionSet) -> Result<Self, CastError> {
        if !instructions.is_available() {
            return Err(CastError::Device(format!("this processor has no {instructions}")));
        }
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads.unwrap_or(0))
            .build()
            .map_err(|e| CastError::Device(format!("the system starts no threads to cast with: {e}")))?;
        let detail = format!("{}, {} threads", instructions.detail(), pool.current_num_threads());
        let device = Device { name: machine::cpu_name(), kind: DeviceKind::Cpu, detail };
        Ok(Self { device, pool, instructions, leave_out: LeaveOut::ALL, loaded: None })
    }

    /// Sets what is left out where nothing needs it: at first, all that can be.
    pub fn leave_out(&mut self, what: LeaveOut) {
        self.leave_out = what;
    }

    /// The octree, and what was checked against it.
    fn open<'a, T>(&'a self, checked: &'a Checked<T>) -> Result<(&'a Octree, &'a T), CastError> {
        let (octree, roots) = self.loaded.as_ref().ok_or(CastError::NotLoaded)?;
        Ok((octree, roots.open(checked)?))
    }

    fn coarse(&self, octree: &Octree, view: &View) -> Vec<f32> {
        if !view.beam() {
            return Vec::new();
        }
        let scene = Scene::new(octree, view.root, self.leave_out);
        let (columns, rows) = view.coarse_size();
        let mut values = vec![0.0; columns as usize * rows as usize];
        self.pool.install(|| {
            values.par_chunks_mut(columns as usize).enumerate().for_each(|(row, starts)| {
                self.instructions.run(&scene, Task::CoarseRow { view, row: row as u32, starts });
            });
        });
        values
    }

    fn fine(&self, octree: &Octree, view: &View, coarse: &[f32], hits: &mut Vec<Hit>) {
        let scene = Scene::new(octree, view.root, self.leave_out);
        hits.resize(view.pixels(), Hit::miss(0));
        self.pool.install(|| {
            hits.par_chunks_mut(view.width as usize * BAND_ROWS).enumerate().for_each(|(band, hits)| {
                let first_row = (band * BAND_ROWS) as u32;
                self.instructions.run(&scene, Task::Band { view, coarse, first_row, hits });
            });
        });
    }
}

impl Caster for CpuCaster {
    fn name(&self) -> &'static str {
        "cpu"
    }

    fn device(&self) -> &Device {
        &self.device
    }

    fn resident_bytes(&self) -> u64 {
        self.loaded.as_ref().map_or(0, |(octree, _)| size_of_val(octree.slots()) as u64)
    }

    fn roots(&self) -> Option<&Roots> {
        self.loaded.as_ref().map(|(_, roots)| roots)
    }

    fn load_checked(&mut self, octree: &Arc<Octree>, roots: Roots) -> Result<(), CastError> {
        roots.belong_to(octree)?;
        self.loaded = Some((octree.clone(), roots));
        Ok(())
    }

    fn cast_checked(&mut self, view: Checked<View>, hits: &mut Vec<Hit>) -> Result<(), CastError> {
        let (octree, view) = self.open(&view)?;
        let coarse = self.coarse(octree, view);
        self.fine(octree, view, &coarse, hits);
        Ok(())
    }

    fn time_checked(&mut self, view: Checked<View>) -> Result<FrameTime, CastError> {
        let (octree, view) = self.open(&view)?;
        let mut hits = vec![Hit::miss(0); view.pixels()];
        let start = Instant::now();
        let values = self.coarse(octree, view);
        let coarse = if view.beam() { start.elapsed() } else { Duration::ZERO };
        self.fine(octree, view, &values, &mut hits);
        let total = start.elapsed();
        std::hint::black_box(&hits);
        Ok(FrameTime { total, coarse })
    }

    fn cast_rays_checked(&mut self, rays: Checked<Rays<'_>>, hits: &mut Vec<Hit>) -> Result<(), CastError> {
        let (octree, rays) = self.open(&rays)?;
        let scene = Scene::new(octree, rays.root, self.leave_out);
        hits.resize(rays.rays.len(), Hit::miss(0));
        let run = |(hits, some): (&mut [Hit], &[Ray])| {
            self.instructions.run(&scene, Task::Rays { rays: some, contours: rays.contours, hits });
        };
        // The rays are cast in their order. Sorting a million incoherent rays of SIBENIK by direction and origin first took 4 % of
        // the time and saved no more than that (10 levels, one ray at a time).
        if rays.rays.len() <= RAYS_PER_TASK {
            // On this thread: waking another one takes as long as casting thirty rays.
            run((hits, rays.rays));
        } else {
            let tasks = hits.par_chunks_mut(RAYS_PER_TASK).zip(rays.rays.par_chunks(RAYS_PER_TASK));
            self.pool.install(|| tasks.for_each(run));
        }
        Ok(())
    }

    fn cast_instances_checked(
        &mut self,
        instances: Checked<&Instances>,
        nearest: &mut Nearest,
    ) -> Result<(), CastError> {
        let (octree, instances) = self.open(&instances)?;
        let cast = || instances::cast(self.instructions, octree, self.leave_out, instances, nearest);
        self.pool.install(cast)
    }

    fn filter(&mut self, frame: &Frame, radius: Radius) -> Result<Filtered, CastError> {
        let start = Instant::now();
        let picture = self.pool.install(|| filter::filter(frame, radius));
        Ok(Filtered { picture, time: start.elapsed() })
    }

    fn cast_fans_checked(&mut self, fans: Checked<Fans<'_>>, hits: &mut Vec<Hit>) -> Result<(), CastError> {
        let (octree, fans) = self.open(&fans)?;
        let scene = Scene::new(octree, fans.root, self.leave_out);
        hits.resize(fans.len(), Hit::miss(0));
        if fans.is_empty() {
            return Ok(());
        }
        let per_task = RAYS_PER_TASK.div_ceil(fans.directions.len());
        self.pool.install(|| {
            let tasks = hits.par_chunks_mut(per_task * fans.directions.len()).zip(fans.fans.par_chunks(per_task));
            tasks.for_each(|(hits, some)| self.instructions.run(&scene, Task::Fans { all: fans, some, hits }));
        });
        Ok(())
    }
}
