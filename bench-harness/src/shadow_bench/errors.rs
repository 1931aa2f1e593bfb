//! How wrong each effect is with each shortcut, and how long it takes.

use std::time::Instant;

use esvo_core::Picture;
use esvo_shadow::World;
use esvo_shadow::effects::bounce::bounce;
use esvo_shadow::effects::compose::shown;
use esvo_shadow::effects::denoise::{Edges, blur, smooth, smooth_shares};
use esvo_shadow::effects::fog::{Fog, fog};
use esvo_shadow::effects::lamps::shadow;
use esvo_shadow::effects::occlusion::ambient_occlusion;
use esvo_shadow::effects::reflections::{Mirror, reflections};
use esvo_shadow::effects::{Frame, How, Lamp, Obstacles, Offset, Rays, Through};
use esvo_shadow::octree::look;
use esvo_shadow::trace::Fidelity;
use glam::Vec3;

use super::rates::REACH;
use super::stage::{Stage, failed};
use super::{ErrorRow, ShadowOptions};
use crate::error::image::image_error;
use crate::{BenchError, Progress};

/// Steps in the place of every voxel.
const STEPS: [f64; 2] = [1.0, 2.0];

/// What is measured; each gives a number from 0 to 1 for each pixel.
#[derive(Clone, Copy, PartialEq)]
enum Effect {
    Ambient,
    HardShadow,
    SoftShadow,
    Specular,
    Fog,
    Indirect,
    IndirectOfPicture,
}

impl Effect {
    const ALL: [Self; 7] = [
        Self::Ambient,
        Self::HardShadow,
        Self::SoftShadow,
        Self::Specular,
        Self::Fog,
        Self::Indirect,
        Self::IndirectOfPicture,
    ];

    fn name(self) -> &'static str {
        match self {
            Self::Ambient => "ambient occlusion",
            Self::HardShadow => "hard shadow",
            Self::SoftShadow => "shadow of a lamp of 30 cm",
            Self::Specular => "specular occlusion",
            Self::Fog => "fog",
            Self::Indirect => "indirect light",
            Self::IndirectOfPicture => "indirect light, colours of the picture",
        }
    }
}

/// What all effects of a scene have in common.
struct Run<'a> {
    stage: &'a Stage,
    frame: &'a Frame,
    lamp: Lamp,
    options: &'a ShadowOptions,
}

impl Run<'_> {
    /// `voxel`: how far from a surface rays may end, in the mesh's units.
    fn values(&self, effect: Effect, obstacles: &impl Obstacles, voxel: f32, rays: Rays) -> Vec<f32> {
        let (frame, unit) = (self.frame, self.stage.unit as f32);
        let reach = REACH as f32 * unit;
        let point = [Lamp { radius: 0.0, ..self.lamp }];
        match effect {
            Effect::Ambient => ambient_occlusion(frame, obstacles, reach, rays),
            Effect::HardShadow => shadow(frame, obstacles, &point[0], rays),
            Effect::SoftShadow => shadow(frame, obstacles, &self.lamp, rays),
            Effect::Specular => {
                let mirror = Mirror { roughness: 0.3, reach: 40.0 * unit, tolerance: 0.1 * unit };
                let black = vec![Vec3::ZERO; frame.surfaces.len()];
                let mirrored = reflections(frame, obstacles, mirror, rays, &black, &|_| Vec3::ZERO);
                mirrored.iter().map(|mirrored| mirrored.open).collect()
            }
            Effect::Fog => {
                let mist = Fog { density: 0.1 / unit, reach: 40.0 * unit };
                let veils = fog(frame, obstacles, mist, &point, rays);
                // Light of the lamp at one metre, through a tenth of it.
                veils.iter().map(|veil| (veil.color.x * 10.0 / (30.0 * unit)).min(1.0)).collect()
            }
            Effect::Indirect => {
                let objects = [self.stage.object()];
                let look = |place: Vec3, direction: Vec3| look(&objects, place, direction, 2.0 * voxel);
                grey_of(bounce(frame, obstacles, &point, reach, rays, &look))
            }
            Effect::IndirectOfPicture => {
                let look = |place: Vec3, direction: Vec3| shown(frame, place, direction, 3.0 * voxel);
                grey_of(bounce(frame, obstacles, &point, reach, rays, &look))
            }
        }
    }

    /// Measures one set of shortcuts.
    fn row(&self, effect: Effect, obstacles: &impl Obstacles, row: ErrorRow, exact: &Exact) -> ErrorRow {
        let edges = Edges { passes: 3, distance: (0.05 * self.stage.unit) as f32, cosine: 0.9 };
        let voxel = match row.voxel_cm {
            0.0 => self.stage.leaf(self.options.levels) as f32,
            edge => (edge * 0.01 * self.stage.unit) as f32,
        };
        let mut values = Vec::new();
        let ms = (0..self.options.rounds).map(|_| {
            let start = Instant::now();
            values = self.values(effect, obstacles, voxel, Rays { count: row.rays, seed: 5 });
            if row.smoothed {
                let noisy: Vec<[f32; 1]> = values.iter().map(|&value| [value]).collect();
                // Fog knows no surfaces.
                let smoothed = match effect {
                    Effect::Fog => blur(self.frame, &noisy, edges.passes),
                    // Light is no share of rays.
                    Effect::Indirect | Effect::IndirectOfPicture => smooth(self.frame, &noisy, &edges),
                    _ => smooth_shares(self.frame, &noisy, row.rays, &edges),
                };
                values = smoothed.iter().map(|value| value[0]).collect();
            }
            start.elapsed().as_secs_f64() * 1e3
        });
        let ms = ms.collect();
        let flip =
            image_error(&grey(&exact.octree, self.frame), &grey(&values, self.frame)).map_or(0.0, |error| error.flip);
        ErrorRow {
            ms,
            rmse: rmse(&values, &exact.octree),
            rmse_triangles: rmse(&values, &exact.triangles),
            flip,
            ..row
        }
    }
}

/// Light without its colour, up to white.
fn grey_of(light: Vec<Vec3>) -> Vec<f32> {
    light.into_iter().map(|light| (light.element_sum() / 3.0).min(1.0)).collect()
}

/// Converged answers.
struct Exact {
    octree: Vec<f32>,
    triangles: Vec<f32>,
}

/// All effects of a scene.
pub(super) fn errors(
    stage: &Stage,
    frame: &Frame,
    worlds: &[(f64, World)],
    options: &ShadowOptions,
    progress: &Progress,
) -> Result<Vec<ErrorRow>, BenchError> {
    let octree = stage.in_octree(options.levels);
    let run = Run { stage, frame, lamp: stage.lamp(frame, &octree, 0.3), options };
    let base = worlds.iter().find(|(voxel, _)| *voxel == options.base());
    let Some((base_voxel, base_world)) = base else { return Err(failed("shadow", "no voxel's edge was given")) };
    let mut rows = Vec::new();
    let mut of_light = None;
    for effect in Effect::ALL {
        let say = |what: &str| progress.say(format!("{}: {}, {what}", stage.scene.name, effect.name()));
        let converged = Rays { count: options.converged, seed: 77 };
        // The picture's colours are a shortcut to those of the octree.
        let exact = match (effect, of_light.take()) {
            (Effect::IndirectOfPicture, Some(exact)) => exact,
            _ => {
                say("the converged answer");
                let leaf = stage.leaf(options.levels) as f32;
                Exact {
                    octree: run.values(effect, &octree, leaf, converged),
                    triangles: run.values(effect, &stage.in_triangles(options.levels), leaf, converged),
                }
            }
        };
        // All rays to a point are one.
        let counts = if effect == Effect::HardShadow { &[1][..] } else { &options.rays[..] };
        let plain = |rays: u32, smoothed: bool| ErrorRow {
            effect: effect.name().into(),
            voxel_cm: 0.0,
            step: None,
            rays,
            screen: false,
            smoothed,
            ms: Vec::new(),
            rmse: 0.0,
            rmse_triangles: 0.0,
            flip: 0.0,
        };
        let mut measure = |world: Option<(f64, &World)>, step: Option<f64>, screen: bool| {
            for (&rays, smoothed) in counts.iter().flat_map(|rays| [(rays, false), (rays, true)]) {
                let row = ErrorRow { step, screen, ..plain(rays, smoothed) };
                rows.push(match world {
                    None => run.row(effect, &octree, row, &exact),
                    Some((voxel_cm, world)) => {
                        let fidelity = Fidelity::EXACT;
                        let how = step.map_or(How::Walk(fidelity), |length| How::Steps { length, fidelity });
                        let volume = world.volume();
                        let screen = screen.then_some(frame);
                        let obstacles = Through { volume, grid: *world.grid(), how, offset: Offset::SAFE, screen };
                        run.row(effect, &obstacles, ErrorRow { voxel_cm, ..row }, &exact)
                    }
                });
            }
        };
        if effect == Effect::IndirectOfPicture {
            measure(Some((*base_voxel, base_world)), None, true);
            continue;
        }
        say("through the octree");
        measure(None, None, false);
        // Fog has no surface that a ray begins at.
        let screen = effect != Effect::Fog;
        for (voxel, world) in worlds {
            say(&format!("voxels of {voxel} cm"));
            measure(Some((*voxel, world)), None, screen);
        }
        say("in steps, and without the picture");
        for step in STEPS {
            measure(Some((*base_voxel, base_world)), Some(step), screen);
        }
        if screen {
            measure(Some((*base_voxel, base_world)), None, false);
        }
        of_light = (effect == Effect::Indirect).then_some(exact);
    }
    Ok(rows)
}

/// Root of the mean squared difference, over all pixels.
fn rmse(a: &[f32], b: &[f32]) -> f64 {
    let sum: f64 = a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum();
    (sum / a.len().max(1) as f64).sqrt()
}

/// Numbers as a picture.
pub(super) fn grey(values: &[f32], frame: &Frame) -> Picture {
    let width = frame.eye.size.0;
    Picture::from_fn(frame.eye.size, |x, y| [values[(y * width + x) as usize].clamp(0.0, 1.0); 3])
}
