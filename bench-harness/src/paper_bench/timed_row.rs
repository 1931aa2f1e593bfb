//! One row of Table 2: timing everything that is cast at one picture size.

use esvo_core::View;
use esvo_core::exact::CameraRays;
use esvo_cpu::triangles::TriangleScene;
use esvo_engines::EngineId;

use crate::paper_bench::matrix::{Matrix, Variant};
use crate::paper_bench::pair::EnginePair;
use crate::paper_bench::report::TimeCell;
use crate::system::clock::Clock;
use crate::timing::{Samples, Spread};
use crate::{BenchError, Progress};

/// One row of Table 2: a picture size, and everything that is cast at it.
pub(crate) struct TimedRow {
    size: [u32; 2],
    cells: Vec<TimedCell>,
}

struct TimedCell {
    /// Index of the engine; `None` for the processor's triangle caster.
    engine: Option<usize>,
    variant: Variant,
    levels: u32,
    rays: Vec<CameraRays>,
    views: Vec<View>,
    samples: Samples,
}

impl TimedRow {
    pub(crate) fn new(size: [u32; 2]) -> Self {
        Self { size, cells: Vec::new() }
    }

    /// Adds a triangle caster: the processor's, or that of the engine of this index, which has loaded the triangles.
    pub(crate) fn add_triangles(&mut self, engine: Option<usize>, rays: Vec<CameraRays>) {
        let variant = Variant::Triangles;
        self.cells.push(TimedCell { engine, variant, levels: 0, rays, views: Vec::new(), samples: Samples::default() });
    }

    /// Adds an engine, given by its index, for a variant that it has loaded.
    pub(crate) fn add(&mut self, engine: usize, variant: Variant, levels: u32, views: Vec<View>) {
        let samples = Samples::default();
        self.cells.push(TimedCell { engine: Some(engine), variant, levels, rays: Vec::new(), views, samples });
    }

    /// Times the row round by round: every cell casts every view once a round, so that drift hits all alike; every second
    /// round goes backwards. When the clock runs out, the round that has begun is the last.
    pub(crate) fn time(
        mut self,
        engines: &mut [EnginePair],
        triangles: &TriangleScene,
        matrix: &Matrix,
        clock: &Clock,
        progress: &Progress,
        what: &str,
    ) -> Result<Vec<TimeCell>, BenchError> {
        let rounds = matrix.warm_up + matrix.rounds;
        for round in 0..rounds {
            let late = clock.left() <= 0.0;
            if late && self.cells.iter().all(|cell| !cell.samples.seconds.is_empty()) {
                break;
            }
            if late && round < matrix.warm_up {
                continue;
            }
            progress.fraction(what, round as f64 / rounds as f64, "");
            let order: Box<dyn Iterator<Item = &mut TimedCell>> =
                if round % 2 == 0 { Box::new(self.cells.iter_mut()) } else { Box::new(self.cells.iter_mut().rev()) };
            for cell in order {
                cell.round(engines, triangles, round >= matrix.warm_up)?;
            }
        }
        let pixels = u64::from(self.size[0]) * u64::from(self.size[1]);
        let size = self.size;
        let finish = |cell: TimedCell| TimeCell {
            backend: cell.engine.map_or(EngineId::Cpu, |e| engines[e].backend),
            variant: cell.variant,
            levels: cell.levels,
            size,
            resident_bytes: match cell.engine {
                Some(e) if cell.variant == Variant::Triangles => {
                    engines[e].triangles.as_ref().map_or(0, |caster| caster.resident_bytes())
                }
                Some(e) => engines[e].caster(cell.variant).resident_bytes(),
                None => triangles.resident_bytes(),
            },
            mrays: Spread::of(&cell.samples.mrays(pixels)),
            samples: cell.samples,
        };
        Ok(self.cells.into_iter().map(finish).collect())
    }
}

impl TimedCell {
    fn round(&mut self, engines: &mut [EnginePair], triangles: &TriangleScene, keep: bool) -> Result<(), BenchError> {
        let (mut total, mut coarse) = (Vec::new(), Vec::new());
        match self.engine {
            None => total.extend(self.rays.iter().map(|r| triangles.time(r).as_secs_f64())),
            Some(engine) if self.variant == Variant::Triangles => {
                let id = engines[engine].backend;
                for rays in &self.rays {
                    let Some(caster) = &mut engines[engine].triangles else { continue };
                    let time = caster.time(rays).map_err(|source| BenchError::Cast { engine: id, source })?;
                    total.push(time.as_secs_f64());
                }
            }
            Some(engine) => {
                let id = engines[engine].backend;
                let caster = engines[engine].caster(self.variant);
                for view in &self.views {
                    let time = caster.time(view).map_err(|source| BenchError::Cast { engine: id, source })?;
                    total.push(time.total.as_secs_f64());
                    coarse.push(time.coarse.as_secs_f64());
                }
            }
        }
        if keep {
            self.samples.seconds.push(total);
            if self.variant == Variant::Beam {
                self.samples.coarse_seconds.push(coarse);
            }
        }
        Ok(())
    }
}
