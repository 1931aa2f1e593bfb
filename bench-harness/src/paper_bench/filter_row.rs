//! Timing the post-process filter on every engine.

use esvo_core::View;
use esvo_core::filter::{Frame, Radius};
use esvo_core::shading::shade;

use crate::paper_bench::matrix::{Matrix, Variant};
use crate::paper_bench::pair::{EnginePair, OctreePair};
use crate::paper_bench::report::FilterCell;
use crate::system::clock::Clock;
use crate::{BenchError, Progress};

/// The pictures of one size that are filtered.
pub(crate) struct FilterRow<'a> {
    pub(crate) pair: &'a OctreePair,
    /// Indices of the engines whose hits are right.
    pub(crate) sound: &'a [usize],
    pub(crate) views: &'a [View],
    pub(crate) matrix: &'a Matrix,
    pub(crate) clock: &'a Clock,
    pub(crate) progress: &'a Progress,
}

impl FilterRow<'_> {
    /// Filters the pictures of the octree with contours, round by round. When the clock runs out, the round that has begun is the last.
    pub(crate) fn time(&self, engines: &mut [EnginePair], what: &str) -> Result<Vec<FilterCell>, BenchError> {
        let Self { pair, sound, views, matrix, clock, progress } = self;
        let (Some(octree), Some(&first)) = (pair.of(Variant::Beam), sound.first()) else { return Ok(Vec::new()) };
        let mut frames = Vec::new();
        let (mut hits, mut large, mut pixels) = (Vec::new(), 0, 0);
        for view in views.iter() {
            let id = engines[first].backend;
            let failed = |source| BenchError::Cast { engine: id, source };
            engines[first].caster(Variant::Beam).cast(view, &mut hits).map_err(failed)?;
            let frame = Frame::new(&shade(octree, view, &hits), view, &hits).map_err(failed)?;
            large += hits.iter().filter(|hit| esvo_core::filter::code_at(view, hit) > 0).count();
            pixels += hits.len();
            frames.push(frame);
        }
        let Some(view) = views.first() else { return Ok(Vec::new()) };
        let cell = |index: &usize| FilterCell {
            backend: engines[*index].backend,
            levels: pair.levels,
            size: [view.width, view.height],
            blurred: large as f64 / pixels.max(1) as f64,
            seconds: Vec::new(),
        };
        let mut cells: Vec<FilterCell> = sound.iter().map(cell).collect();
        for round in 0..matrix.warm_up + matrix.rounds {
            if clock.left() <= 0.0 && round > matrix.warm_up {
                break;
            }
            progress.say(format!("{what}, round {}", round + 1));
            for (index, cell) in sound.iter().zip(&mut cells) {
                let mut seconds = Vec::new();
                for frame in &frames {
                    let failed = |source| BenchError::Cast { engine: cell.backend, source };
                    let filtered =
                        engines[*index].caster(Variant::Beam).filter(frame, Radius::Adapted).map_err(failed)?;
                    seconds.push(filtered.time.as_secs_f64());
                }
                if round >= matrix.warm_up {
                    cell.seconds.push(seconds);
                }
            }
        }
        Ok(cells)
    }
}
