//! The parallel octree caster: the reference's operations in the reference's order, on all cores.

mod packet;
mod single;

use std::sync::Arc;
use std::time::{Duration, Instant};

use esvo_core::{CastError, Caster, Device, DeviceKind, Fan, Fans, FrameTime, Hit, View};
use esvo_format::Octree;
use rayon::prelude::*;

use self::single::Scene;
use crate::machine;

/// Rows of pixels per task; also the edge of the tiles that a task goes through.
const TILE: usize = 8;
/// Rays of fans per task, roughly.
const RAYS_PER_TASK: usize = 4096;

/// Casts against octrees on all cores.
///
/// Its hits are bit for bit those of the reference caster.
pub struct CpuCaster {
    device: Device,
    pool: rayon::ThreadPool,
    engine: Engine,
    octree: Option<Arc<Octree>>,
}

/// The code that casts.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Engine {
    /// One ray at a time.
    Scalar,
    /// Sixteen rays in lockstep with AVX-512.
    Wide,
}

impl Engine {
    /// The fastest that the processor has.
    pub fn best() -> Self {
        #[cfg(target_arch = "x86_64")]
        if packet::is_available() {
            return Self::Wide;
        }
        Self::Scalar
    }

    /// Its instruction set.
    pub fn instruction_set(self) -> &'static str {
        match self {
            Self::Scalar => single::instruction_set(),
            Self::Wide => "AVX-512, 16 lanes",
        }
    }

    fn band(self, scene: &Scene, view: &View, coarse: &[f32], first_row: u32, hits: &mut [Hit]) {
        #[cfg(target_arch = "x86_64")]
        if self == Self::Wide && packet::can_cast(scene) {
            // SAFETY: that it can has just been asked, and `load` has checked that the octree is sound.
            return unsafe { packet::band(scene, view, coarse, first_row, hits) };
        }
        single::band(scene, view, coarse, first_row, hits);
    }

    fn fans(self, scene: &Scene, all: &Fans, some: &[Fan], hits: &mut [Hit]) {
        #[cfg(target_arch = "x86_64")]
        if self == Self::Wide && packet::can_cast(scene) {
            // SAFETY: that it can has just been asked, and `load` has checked that the octree is sound.
            return unsafe { packet::fans(scene, all, some, hits) };
        }
        single::fans(scene, all, some, hits);
    }

    fn coarse_row(self, scene: &Scene, view: &View, j: u32, row: &mut [f32]) {
        #[cfg(target_arch = "x86_64")]
        if self == Self::Wide && packet::can_cast(scene) {
            // SAFETY: that it can has just been asked, and `load` has checked that the octree is sound.
            return unsafe { packet::coarse_row(scene, view, j, row) };
        }
        single::coarse_row(scene, view, j, row);
    }
}

impl CpuCaster {
    /// A caster on this many threads, or on one per core.
    ///
    /// # Errors
    /// The system refuses the threads.
    pub fn new(threads: Option<usize>) -> Result<Self, CastError> {
        Self::with_engine(threads, Engine::best())
    }

    /// The same with a given engine; one that the processor does not have falls back to [`Engine::Scalar`].
    ///
    /// # Errors
    /// The system refuses the threads.
    pub fn with_engine(threads: Option<usize>, engine: Engine) -> Result<Self, CastError> {
        let engine = if Engine::best() == Engine::Scalar { Engine::Scalar } else { engine };
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads.unwrap_or(0))
            .build()
            .map_err(|e| CastError::Device(format!("no threads to cast with: {e}")))?;
        let detail = format!("{}, {} threads", engine.instruction_set(), pool.current_num_threads());
        Ok(Self {
            device: Device { name: machine::cpu_name(), kind: DeviceKind::Cpu, detail },
            pool,
            engine,
            octree: None,
        })
    }

    fn coarse(&self, octree: &Octree, view: &View) -> Vec<f32> {
        if !view.beam() {
            return Vec::new();
        }
        let scene = Scene::new(octree, view.root);
        let (columns, rows) = view.coarse_size();
        let mut values = vec![0.0; columns as usize * rows as usize];
        self.pool.install(|| {
            values.par_chunks_mut(columns as usize).enumerate().for_each(|(j, row)| {
                self.engine.coarse_row(&scene, view, j as u32, row);
            });
        });
        values
    }

    fn fine(&self, octree: &Octree, view: &View, coarse: &[f32], hits: &mut Vec<Hit>) {
        let scene = Scene::new(octree, view.root);
        hits.resize(view.pixels(), Hit::miss(0));
        self.pool.install(|| {
            hits.par_chunks_mut(view.width as usize * TILE).enumerate().for_each(|(band, rows)| {
                self.engine.band(&scene, view, coarse, (band * TILE) as u32, rows);
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

    fn load(&mut self, octree: &Arc<Octree>) -> Result<(), CastError> {
        octree.sound()?;
        self.octree = Some(octree.clone());
        Ok(())
    }

    fn cast(&mut self, view: &View, hits: &mut Vec<Hit>) -> Result<(), CastError> {
        let octree = self.octree.as_deref().ok_or(CastError::NotLoaded)?;
        let coarse = self.coarse(octree, view);
        self.fine(octree, view, &coarse, hits);
        Ok(())
    }

    fn time(&mut self, view: &View) -> Result<FrameTime, CastError> {
        let octree = self.octree.as_deref().ok_or(CastError::NotLoaded)?;
        let mut hits = vec![Hit::miss(0); view.pixels()];
        let start = Instant::now();
        let values = self.coarse(octree, view);
        let coarse = if view.beam() { start.elapsed() } else { Duration::ZERO };
        self.fine(octree, view, &values, &mut hits);
        let total = start.elapsed();
        std::hint::black_box(&hits);
        Ok(FrameTime { total, coarse })
    }

    fn cast_fans(&mut self, fans: &Fans, hits: &mut Vec<Hit>) -> Result<(), CastError> {
        let octree = self.octree.as_deref().ok_or(CastError::NotLoaded)?;
        let scene = Scene::new(octree, fans.root);
        hits.resize(fans.len(), Hit::miss(0));
        if fans.is_empty() {
            return Ok(());
        }
        let per_task = RAYS_PER_TASK.div_ceil(fans.directions.len());
        self.pool.install(|| {
            let tasks = hits.par_chunks_mut(per_task * fans.directions.len()).zip(fans.fans.par_chunks(per_task));
            tasks.for_each(|(hits, some)| self.engine.fans(&scene, fans, some, hits));
        });
        Ok(())
    }

    fn resident_bytes(&self) -> u64 {
        self.octree.as_ref().map_or(0, |octree| std::mem::size_of_val(octree.slots()) as u64)
    }
}
