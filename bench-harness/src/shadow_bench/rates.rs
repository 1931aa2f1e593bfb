//! Rays a second, of one kind and in one way.

use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use esvo_core::{Caster, Ray as OctreeRay};
use esvo_cpu::CpuCaster;
use esvo_shadow::effects::lamps::shadow;
use esvo_shadow::effects::occlusion::ambient_occlusion;
use esvo_shadow::effects::{Frame, How, Obstacles, Offset, Query, Rays, Through};
use esvo_shadow::trace::{Fidelity, MAX_LEVEL, Ray, Steps, batch, first_hit, is_blocked};
use esvo_shadow::{MAX_MIPS, Volume, World};
use rayon::prelude::*;

use super::device::Device;
use super::stage::{Stage, failed};
use super::{RateRow, ShadowOptions, WALK};
use crate::{BenchError, Progress};

/// Levels that tracing begins at: without mips, with bytes, with two mips as the document has them, with five.
const COARSEST: [u32; 4] = [0, 1, 3, MAX_LEVEL];
/// How far rays of ambient occlusion reach, in metres.
pub(super) const REACH: f64 = 5.0;

/// Keeps all queries.
struct Recorder(Mutex<Vec<Query>>);

impl Obstacles for Recorder {
    fn blocked(&self, queries: &[Query]) -> Vec<bool> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).extend_from_slice(queries);
        vec![false; queries.len()]
    }

    fn first(&self, queries: &[Query]) -> Vec<Option<f32>> {
        self.blocked(queries).iter().map(|_| None).collect()
    }
}

/// How rays are traced through a volume.
#[derive(Clone, Copy)]
enum Tracer {
    Walk,
    /// The same in lists, many rays at once where the processor can.
    Lists,
    Steps(f64),
}

pub(super) fn rates(
    stage: &Stage,
    frame: &Frame,
    device: Option<&Device>,
    options: &ShadowOptions,
    progress: &Progress,
) -> Result<Vec<RateRow>, BenchError> {
    let world = stage.world(options.base(), MAX_MIPS)?;
    let exact = stage.in_octree(options.levels);
    let lamp = stage.lamp(frame, &exact, 0.0);
    let reach = (REACH * stage.unit) as f32;
    let mut rows = Vec::new();
    for kind in ["ambient occlusion", "shadow"] {
        progress.say(format!("{}: rays of {kind}", stage.scene.name));
        let recorder = Recorder(Mutex::new(Vec::new()));
        match kind {
            "shadow" => drop(shadow(frame, &recorder, &lamp, Rays { count: 1, seed: 1 })),
            _ => drop(ambient_occlusion(frame, &recorder, reach, Rays { count: 4, seed: 1 })),
        }
        let mut queries = recorder.0.into_inner().unwrap_or_else(PoisonError::into_inner);
        // Rows of pixels were done at once: put them back in order, as a picture's rays are.
        queries.sort_by_key(|query| key(frame, query));
        rows.extend(through_volume(kind, &world, &queries, device, options)?);
        rows.push(through_octree(kind, stage, &exact.rays(&queries), options)?);
    }
    Ok(rows)
}

fn key(frame: &Frame, query: &Query) -> (i64, i64) {
    frame.eye.project(query.from).map_or((0, 0), |(at, _)| (at.y as i64, at.x as i64))
}

impl super::stage::InOctree<'_> {
    fn rays(&self, queries: &[Query]) -> Vec<OctreeRay> {
        queries.iter().map(|query| self.ray(query)).collect()
    }
}

/// Answers of one way of tracing.
struct Answers {
    blocked: Vec<bool>,
    steps: u64,
    seconds: f64,
}

fn through_volume(
    kind: &str,
    world: &World,
    queries: &[Query],
    device: Option<&Device>,
    options: &ShadowOptions,
) -> Result<Vec<RateRow>, BenchError> {
    let obstacles = Through {
        volume: world.volume(),
        grid: *world.grid(),
        how: How::Walk(Fidelity::EXACT),
        offset: Offset::SAFE,
        screen: None,
    };
    let rays: Vec<Ray> = queries.iter().filter_map(|query| obstacles.ray(query)).collect();
    let mut ways = Vec::new();
    for coarsest in COARSEST {
        ways.extend(
            [Tracer::Walk, Tracer::Lists]
                .into_iter()
                .flat_map(|tracer| [false, true].map(|first| (tracer, coarsest, first))),
        );
    }
    for length in [0.5, 1.0, 2.0] {
        ways.extend([0, 3, MAX_LEVEL].map(|coarsest| (Tracer::Steps(length), coarsest, false)));
    }
    let mut rows: Vec<RateRow> = Vec::new();
    let mut walked: Vec<bool> = Vec::new();
    for round in 0..options.rounds {
        for (index, &(tracer, coarsest, first)) in ways.iter().enumerate() {
            let answers = trace(world.volume(), &rays, tracer, Fidelity { coarsest, fine_until: 0 }, first);
            if round == 0 {
                if index == 0 {
                    walked.clone_from(&answers.blocked);
                }
                let name = match tracer {
                    Tracer::Walk => WALK.to_owned(),
                    Tracer::Lists => format!("{WALK}, in lists"),
                    Tracer::Steps(length) => format!("steps of {length}"),
                };
                rows.push(RateRow {
                    kind: kind.into(),
                    tracer: name,
                    coarsest: 1 << coarsest,
                    first,
                    rays: rays.len() as u64,
                    seconds: Vec::new(),
                    steps: answers.steps as f64 / rays.len().max(1) as f64,
                    different: walked.iter().zip(&answers.blocked).filter(|(a, b)| a != b).count() as u64,
                });
            }
            rows[index].seconds.push(answers.seconds);
        }
    }
    if let Some(device) = device {
        rows.extend(device.rates(kind, world.volume(), &rays, &walked, options.rounds)?);
    }
    Ok(rows)
}

fn trace(volume: &Volume, rays: &[Ray], tracer: Tracer, fidelity: Fidelity, first: bool) -> Answers {
    if let Tracer::Lists = tracer {
        return trace_lists(volume, rays, fidelity, first);
    }
    let one = |ray: &Ray| match (tracer, first) {
        (Tracer::Lists, _) => (false, 0),
        (Tracer::Walk, false) => is_blocked(volume, ray, fidelity),
        (Tracer::Walk, true) => {
            let traced = first_hit(volume, ray, fidelity);
            (traced.hit.is_some(), traced.steps)
        }
        (Tracer::Steps(length), _) => Steps::new(ray, length).map_or((false, 0), |steps| {
            let traced = steps.first_hit(volume, ray, fidelity);
            (traced.hit.is_some(), traced.steps)
        }),
    };
    let start = Instant::now();
    let answers: Vec<(bool, u32)> = rays.par_iter().with_min_len(1024).map(one).collect();
    let seconds = start.elapsed().as_secs_f64();
    let steps = answers.iter().map(|(_, steps)| u64::from(*steps)).sum();
    Answers { blocked: answers.into_iter().map(|(blocked, _)| blocked).collect(), steps, seconds }
}

/// As [`trace`], in lists; nothing counts their cells.
fn trace_lists(volume: &Volume, rays: &[Ray], fidelity: Fidelity, first: bool) -> Answers {
    let start = Instant::now();
    let blocked = rays.par_chunks(2048).flat_map_iter(|rays| {
        if first {
            batch::first_hits(volume, rays, fidelity).iter().map(Option::is_some).collect()
        } else {
            batch::blocked(volume, rays, fidelity)
        }
    });
    let blocked = blocked.collect();
    Answers { blocked, steps: 0, seconds: start.elapsed().as_secs_f64() }
}

/// The CPU's octree caster, with the same rays, on all cores.
fn through_octree(
    kind: &str,
    stage: &Stage,
    rays: &[OctreeRay],
    options: &ShadowOptions,
) -> Result<RateRow, BenchError> {
    let error = |e: esvo_core::CastError| failed(&stage.scene.name, e);
    let mut caster = CpuCaster::new(None).map_err(error)?;
    caster.load(&stage.octree).map_err(error)?;
    let object = stage.object();
    let mut hits = Vec::new();
    let mut seconds = Vec::new();
    for _ in 0..options.rounds {
        let start = Instant::now();
        caster.cast_rays(&object.rays(rays), &mut hits).map_err(error)?;
        seconds.push(start.elapsed().as_secs_f64());
    }
    Ok(RateRow {
        kind: kind.into(),
        tracer: format!("octree of {} levels, first hit, engine {}", options.levels, caster.name()),
        coarsest: 0,
        first: true,
        rays: rays.len() as u64,
        seconds,
        steps: 0.0,
        different: 0,
    })
}
