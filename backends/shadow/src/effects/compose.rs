//! A picture with several effects.

use std::time::{Duration, Instant};

use glam::Vec3;
use rayon::prelude::*;

use super::Rays;
use super::bounce::{Look, bounce};
use super::denoise::{Edges, blur, smooth, smooth_shares};
use super::fog::{Fog, fog};
use super::frame::{Frame, Surface};
use super::lamps::{Lamp, lit, shadows};
use super::obstacles::{How, Obstacles, Through};
use super::occlusion::ambient_occlusion;
use super::reflections::{Mirror, reflections};
use super::start::Offset;
use crate::grid::Grid;
use crate::trace::Fidelity;
use crate::volume::Occupancy;

/// Which effects a picture has. What is not wanted costs nothing.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct Wanted {
    /// Ambient occlusion: without it, all surfaces get the light from all around.
    pub occlusion: bool,
    /// Shadows of lamps: without them, lamps shine through everything.
    pub shadows: bool,
    /// Surfaces mirror what the picture shows, and the sky.
    pub reflections: bool,
    /// Fog in the light of lamps.
    pub fog: bool,
    /// One bounce of the lamps' light.
    pub bounce: bool,
}

/// Rays for each pixel, of each effect; each at least 1.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Counts {
    /// Of ambient occlusion.
    pub occlusion: u32,
    /// To each lamp that has a radius.
    pub shadows: u32,
    /// That rough surfaces mirror.
    pub reflections: u32,
    /// Places in fog; from each, one to each lamp.
    pub fog: u32,
    /// Of bounced light; from what each meets, one to each lamp.
    pub bounce: u32,
}

impl Counts {
    /// As many of each.
    pub const fn all(count: u32) -> Self {
        Self { occlusion: count, shadows: count, reflections: count, fog: count, bounce: count }
    }
}

/// How a picture is made.
#[derive(Clone, Debug)]
pub struct Settings {
    /// The effects.
    pub wanted: Wanted,
    /// Rays for each pixel.
    pub counts: Counts,
    /// Chooses directions, as [`Rays::seed`].
    pub seed: u32,
    /// Units of the world in a metre: reaches of rays and the thickness of fog are in metres.
    pub metre: f32,
    /// Light from all around, and what the sky sends to the eye.
    pub ambient: f32,
    /// The sky's colour, linear.
    pub sky: Vec3,
    /// As [`Mirror::roughness`].
    pub roughness: f32,
    /// What part of light fog scatters in a metre.
    pub fog: f32,
    /// Voxels from sample to sample of rays in fog, up to 64; 0: every voxel is looked at. Samples are cheaper where rays are traced one by one, as a GPU
    /// does, and dearer than [lists](crate::trace::batch) of rays through every voxel.
    pub fog_step: f64,
    /// Passes of the filter against noise; 0 for none.
    pub smoothing: u32,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            wanted: Wanted::default(),
            counts: Counts::all(16),
            seed: 1,
            metre: 1.0,
            ambient: 0.55,
            sky: Vec3::new(0.62, 0.74, 0.9),
            roughness: 0.35,
            fog: 0.06,
            fog_step: 0.0,
            smoothing: 3,
        }
    }
}

/// The reach of rays of ambient occlusion and of bounced light, then of those that mirror, then of fog before the sky, in metres.
pub(crate) const REACHES: [f32; 3] = [5.0, 40.0, 25.0];
/// What a surface mirrors of what comes straight; more at grazing angles.
pub(crate) const MIRRORED: f32 = 0.15;

/// A part of the work on a picture.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub enum Pass {
    /// Rays of ambient occlusion.
    Occlusion,
    /// Its filter.
    SmoothOcclusion,
    /// Rays to lamps.
    Shadows,
    /// The filter of their shadows.
    SmoothShadows,
    /// Rays to what sends light on, and from there to lamps.
    Bounce,
    /// The filter of that light.
    SmoothBounce,
    /// The light of each surface from what was found.
    Shade,
    /// Rays that surfaces mirror.
    Reflections,
    /// Their filter.
    SmoothReflections,
    /// Mixing them in.
    Mirror,
    /// Rays in fog.
    Fog,
    /// Its filter.
    BlurFog,
    /// Putting it before the picture.
    Veil,
}

impl Pass {
    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Occlusion => "ambient occlusion",
            Self::SmoothOcclusion => "ambient occlusion, filter",
            Self::Shadows => "shadows",
            Self::SmoothShadows => "shadows, filter",
            Self::Bounce => "bounced light",
            Self::SmoothBounce => "bounced light, filter",
            Self::Shade => "light of surfaces",
            Self::Reflections => "reflections",
            Self::SmoothReflections => "reflections, filter",
            Self::Mirror => "reflections, mixed in",
            Self::Fog => "fog",
            Self::BlurFog => "fog, filter",
            Self::Veil => "fog, mixed in",
        }
    }
}

/// A picture and what it took.
#[derive(Clone, PartialEq, Debug, Default)]
pub struct Composed {
    /// The light of each pixel, linear red, green and blue.
    pub light: Vec<Vec3>,
    /// How long each pass took, in the order in which they ran. Passes of effects that are not wanted did not run.
    pub passes: Vec<(Pass, Duration)>,
}

impl Composed {
    /// How long all passes took.
    pub fn time(&self) -> Duration {
        self.passes.iter().map(|(_, time)| *time).sum()
    }

    fn run<T>(&mut self, pass: Pass, make: impl FnOnce() -> T) -> T {
        let start = Instant::now();
        let made = make();
        self.passes.push((pass, start.elapsed()));
        made
    }
}

/// The picture with the effects that are wanted, through a volume in which `grid` says where voxels lie. Light bounces from what the picture shows.
pub fn compose<O: Occupancy + Sync + ?Sized>(
    frame: &Frame,
    volume: &O,
    grid: Grid,
    lamps: &[Lamp],
    settings: &Settings,
) -> Composed {
    let tolerance = Settings::tolerance(&settings.edges(&grid));
    compose_with(frame, volume, grid, lamps, settings, &|place, direction| shown(frame, place, direction, tolerance))
}

/// The same with light that bounces from whatever `look` knows: what is at a place, for a ray of this direction, e.g. [`look`](crate::octree::look) in octrees.
pub fn compose_with<O: Occupancy + Sync + ?Sized>(
    frame: &Frame,
    volume: &O,
    grid: Grid,
    lamps: &[Lamp],
    settings: &Settings,
    look: &(impl Fn(Vec3, Vec3) -> Option<Look> + Sync),
) -> Composed {
    let Settings { wanted, counts, metre, .. } = *settings;
    let edges = settings.edges(&grid);
    let how = How::Walk(Fidelity::EXACT);
    let through = Through { volume, grid, how, offset: Offset::SAFE, screen: Some(frame) };
    let mut made = Composed::default();
    let smooths = settings.smoothing > 0;
    let pixels = frame.surfaces.len();
    let mut open = vec![1.0; pixels];
    if wanted.occlusion {
        let reach = REACHES[0] * metre;
        open = made.run(Pass::Occlusion, || ambient_occlusion(frame, &through, reach, settings.rays(counts.occlusion)));
        if smooths {
            let noisy: Vec<[f32; 1]> = open.into_iter().map(|value| [value]).collect();
            let smooth = made.run(Pass::SmoothOcclusion, || smooth_shares(frame, &noisy, counts.occlusion, &edges));
            open = smooth.into_iter().map(|[value]| value).collect();
        }
    }
    let mut shares = vec![Vec3::ONE; pixels];
    if wanted.shadows && !lamps.is_empty() {
        shares = made.run(Pass::Shadows, || shadows(frame, &through, lamps, settings.rays(counts.shadows)));
        // Shadows of points have no noise.
        if smooths && lamps.iter().any(|lamp| lamp.radius > 0.0) {
            let noisy = arrays(&shares);
            let smooth = made.run(Pass::SmoothShadows, || smooth_shares(frame, &noisy, counts.shadows, &edges));
            shares = vectors(smooth);
        }
    }
    let mut bounced = vec![Vec3::ZERO; pixels];
    if wanted.bounce {
        let reach = REACHES[0] * metre;
        bounced = made.run(Pass::Bounce, || bounce(frame, &through, lamps, reach, settings.rays(counts.bounce), look));
        if smooths {
            let noisy = arrays(&bounced);
            bounced = vectors(made.run(Pass::SmoothBounce, || smooth(frame, &noisy, &edges)));
        }
    }
    let mut light = made.run(Pass::Shade, || {
        let lit = lit(frame, lamps, &shares);
        let of_pixel = |(i, surface): (usize, &Option<Surface>)| {
            surface.as_ref().map_or(settings.sky, |surface| {
                surface.color * (Vec3::splat(settings.ambient * open[i]) + lit[i] + bounced[i])
            })
        };
        frame.surfaces.par_iter().enumerate().map(of_pixel).collect::<Vec<Vec3>>()
    });
    if wanted.reflections {
        mirror(frame, &through, settings, &edges, &mut light, &mut made);
    }
    if wanted.fog {
        let fidelity = Fidelity::EXACT;
        let how = if settings.fog_step > 0.0 { How::Steps { length: settings.fog_step, fidelity } } else { how };
        veil(frame, &Through { how, screen: None, ..through }, lamps, settings, &mut light, &mut made);
    }
    made.light = light;
    made
}

impl Settings {
    fn rays(&self, count: u32) -> Rays {
        Rays { count, seed: self.seed }
    }

    /// How filters tell surfaces apart, by voxels of this size.
    pub(crate) fn edges(&self, grid: &Grid) -> Edges {
        Edges { passes: self.smoothing, distance: grid.voxel as f32, cosine: 0.9 }
    }

    /// How far from what is met the picture may show a surface, for its light to be taken.
    pub(crate) fn tolerance(edges: &Edges) -> f32 {
        3.0 * edges.distance
    }
}

fn arrays(values: &[Vec3]) -> Vec<[f32; 3]> {
    values.iter().map(Vec3::to_array).collect()
}

fn vectors(values: Vec<[f32; 3]>) -> Vec<Vec3> {
    values.into_iter().map(Vec3::from).collect()
}

/// What the picture shows at a place, within a tolerance, from the side that a ray in a direction sees.
pub fn shown(frame: &Frame, place: Vec3, direction: Vec3, tolerance: f32) -> Option<Look> {
    let (at, _) = frame.eye.project(place)?;
    let (_, surface) = frame.at(at)?;
    let shown = surface.position.distance(place) <= tolerance && surface.normal.dot(direction) < 0.0;
    shown.then_some((surface.normal, surface.color))
}

/// Mixes in what surfaces mirror: more at grazing angles.
fn mirror(
    frame: &Frame,
    obstacles: &impl Obstacles,
    settings: &Settings,
    edges: &Edges,
    light: &mut [Vec3],
    made: &mut Composed,
) {
    let mirror = Mirror {
        roughness: settings.roughness,
        reach: REACHES[1] * settings.metre,
        tolerance: Settings::tolerance(edges),
    };
    let (sky, rays) = (|_: Vec3| settings.sky, settings.rays(settings.counts.reflections));
    let mirrored = made.run(Pass::Reflections, || reflections(frame, obstacles, mirror, rays, light, &sky));
    let mut colors: Vec<[f32; 3]> = mirrored.iter().map(|mirrored| mirrored.color.to_array()).collect();
    if settings.smoothing > 0 && settings.roughness > 0.0 {
        colors = made.run(Pass::SmoothReflections, || smooth(frame, &colors, edges));
    }
    made.run(Pass::Mirror, || {
        light.par_iter_mut().zip(colors).zip(&frame.surfaces).for_each(|((light, color), surface)| {
            let Some(surface) = surface else { return };
            let to_eye = (frame.eye.position - surface.position).normalize_or_zero();
            let cosine = to_eye.dot(surface.normal).clamp(0.0, 1.0);
            // Schlick's approximation.
            let share = MIRRORED + (1.0 - MIRRORED) * (1.0 - cosine).powi(5);
            *light = *light * (1.0 - share) + Vec3::from(color) * share;
        });
    });
}

/// Puts fog before the picture.
fn veil(
    frame: &Frame,
    obstacles: &impl Obstacles,
    lamps: &[Lamp],
    settings: &Settings,
    light: &mut [Vec3],
    made: &mut Composed,
) {
    let mist = Fog { density: settings.fog / settings.metre, reach: REACHES[2] * settings.metre };
    let veils = made.run(Pass::Fog, || fog(frame, obstacles, mist, lamps, settings.rays(settings.counts.fog)));
    let mut colors: Vec<[f32; 3]> = veils.iter().map(|veil| veil.color.to_array()).collect();
    if settings.smoothing > 0 {
        colors = made.run(Pass::BlurFog, || blur(frame, &colors, settings.smoothing));
    }
    made.run(Pass::Veil, || {
        light.par_iter_mut().zip(veils).zip(colors).for_each(|((light, veil), color)| {
            // Lamps are given by what a surface sends to the eye, which is pi times less than what it gets.
            *light = *light * veil.clear + Vec3::from(color) * std::f32::consts::PI;
        });
    });
}
