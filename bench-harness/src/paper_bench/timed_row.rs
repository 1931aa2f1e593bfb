//! One row of Table 2: timing everything that is cast at one picture size.

use std::time::Duration;

use esvo_core::exact::CameraRays;
use esvo_core::{CastError, View};
use esvo_cpu::triangles::TriangleScene;
use esvo_engines::EngineId;

use crate::calibration::{Calibrator, GuardRound};
use crate::paper_bench::matrix::{Matrix, Variant};
use crate::paper_bench::pair::EnginePair;
use crate::paper_bench::report::TimeCell;
use crate::paper_bench::slowed::Slowed;
use crate::system::clock::Clock;
use crate::timing::{Samples, Spread, wake};
use crate::{BenchError, Progress};

/// What is timed, and with what.
pub(crate) struct Subjects<'a> {
    pub(crate) engines: &'a mut [EnginePair],
    /// For cells of triangles; `None` if there are no such.
    pub(crate) triangles: Option<&'a TriangleScene>,
    pub(crate) calibrator: &'a Calibrator,
    pub(crate) slowed: &'a [Slowed],
}

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
    /// round goes backwards. Before each view and after a cell's last one, the calibrator casts. When the clock runs out, the round
    /// that has begun is the last.
    pub(crate) fn time(
        mut self,
        subjects: &mut Subjects,
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
                cell.round(subjects, round >= matrix.warm_up)?;
            }
        }
        let pixels = u64::from(self.size[0]) * u64::from(self.size[1]);
        let size = self.size;
        let Subjects { engines, triangles, .. } = subjects;
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
                None => triangles.map_or(0, TriangleScene::resident_bytes),
            },
            mrays: Spread::of(&cell.samples.mrays(pixels)),
            samples: cell.samples,
        };
        Ok(self.cells.into_iter().map(finish).collect())
    }
}

impl TimedCell {
    fn round(&mut self, subjects: &mut Subjects, keep: bool) -> Result<(), BenchError> {
        let (mut total, mut coarse) = (Vec::new(), Vec::new());
        let mut guard = GuardRound::start(subjects.calibrator);
        for index in 0..self.rays.len().max(self.views.len()) {
            let (seconds, coarse_seconds) = guard.frame(|| self.frame(subjects, index))?;
            guard.calibrate(subjects.calibrator);
            total.push(seconds);
            coarse.push(coarse_seconds);
        }
        if keep {
            self.samples.seconds.push(total);
            self.samples.guard.push(guard);
            if self.variant == Variant::Beam {
                self.samples.coarse_seconds.push(coarse);
            }
        }
        Ok(())
    }

    /// Seconds of the frame of a view, and of its coarse pass.
    fn frame(&self, subjects: &mut Subjects, index: usize) -> Result<(f64, f64), BenchError> {
        if let Some(engine) = self.engine {
            let pair = &mut subjects.engines[engine];
            let (id, kind) = (pair.backend, pair.caster(Variant::Cubical).device().kind);
            let woken = match (&mut pair.triangles, self.variant) {
                (Some(caster), Variant::Triangles) => wake(kind, || caster.time(&self.rays[index]).map(drop)),
                (None, Variant::Triangles) => Ok(()),
                _ => wake(kind, || pair.caster(self.variant).time(&self.views[index]).map(drop)),
            };
            woken.map_err(|source| BenchError::Cast { engine: id, source })?;
        }
        let id = self.engine.map_or(EngineId::Cpu, |engine| subjects.engines[engine].backend);
        let percent = Slowed::percent_of(subjects.slowed, id);
        let mut coarse = Duration::ZERO;
        let total = Slowed::time(percent, subjects.calibrator.pool(), || match self.engine {
            // On as many threads as the octrees' caster.
            None => match subjects.triangles {
                Some(triangles) => Ok(subjects.calibrator.pool().install(|| triangles.time(&self.rays[index]))),
                None => Err(CastError::Device("there are no triangles to cast".into())),
            },
            Some(engine) if self.variant == Variant::Triangles => match &mut subjects.engines[engine].triangles {
                Some(caster) => caster.time(&self.rays[index]),
                None => Err(CastError::Device("its triangles were not loaded".into())),
            },
            Some(engine) => {
                let time = subjects.engines[engine].caster(self.variant).time(&self.views[index])?;
                coarse = time.coarse;
                Ok(time.total)
            }
        });
        let total = total.map_err(|source| BenchError::Cast { engine: id, source })?;
        Ok((total.as_secs_f64(), coarse.as_secs_f64()))
    }
}
