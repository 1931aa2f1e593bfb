//! A picture with several effects.

use glam::Vec3;

use super::denoise::{Edges, blur, smooth};
use super::fog::{Fog, fog};
use super::frame::{Frame, Surface};
use super::lamps::{Lamp, lit, shadow};
use super::obstacles::{How, Obstacles, Through};
use super::occlusion::ambient_occlusion;
use super::reflections::{Mirror, reflections};
use super::start::Offset;
use super::{Rays, bounce};
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
    /// One bounce of the lamps' light, from what the picture shows.
    pub bounce: bool,
}

/// How a picture is made.
#[derive(Clone, Debug)]
pub struct Settings {
    /// The effects.
    pub wanted: Wanted,
    /// Rays for each pixel and effect.
    pub rays: Rays,
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
    /// Passes of the filter against noise; 0 for none.
    pub smoothing: u32,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            wanted: Wanted::default(),
            rays: Rays { count: 16, seed: 1 },
            metre: 1.0,
            ambient: 0.55,
            sky: Vec3::new(0.62, 0.74, 0.9),
            roughness: 0.35,
            fog: 0.06,
            smoothing: 3,
        }
    }
}

/// The reach of rays of ambient occlusion and of bounced light, then of those that mirror, then of fog before the sky, in metres.
const REACHES: [f32; 3] = [5.0, 40.0, 25.0];

/// The light of each pixel, linear, with the effects that are wanted, through a volume in which `grid` says where voxels lie.
pub fn compose<O: Occupancy + Sync + ?Sized>(
    frame: &Frame,
    volume: &O,
    grid: Grid,
    lamps: &[Lamp],
    settings: &Settings,
) -> Vec<Vec3> {
    let Settings { wanted, rays, metre, .. } = *settings;
    let edges = Edges { passes: settings.smoothing, distance: grid.voxel as f32, cosine: 0.9 };
    let smoothed = |values: Vec<f32>| {
        let noisy: Vec<[f32; 1]> = values.into_iter().map(|value| [value]).collect();
        smooth(frame, &noisy, &edges).into_iter().map(|[value]| value).collect::<Vec<_>>()
    };
    let exact = How::Walk(Fidelity::EXACT);
    let through = Through { volume, grid, how: exact, offset: Offset::SAFE, screen: Some(frame) };
    let mut irradiance = vec![Vec3::splat(settings.ambient); frame.surfaces.len()];
    if wanted.occlusion {
        let open = smoothed(ambient_occlusion(frame, &through, REACHES[0] * metre, rays));
        irradiance.iter_mut().zip(open).for_each(|(light, open)| *light *= open);
    }
    for lamp in lamps {
        let seen = if wanted.shadows {
            smoothed(shadow(frame, &through, lamp, rays))
        } else {
            vec![1.0; frame.surfaces.len()]
        };
        irradiance.iter_mut().zip(lit(frame, lamp, &seen)).for_each(|(light, more)| *light += more);
    }
    if wanted.bounce {
        bounced(frame, &through, lamps, rays, metre, &edges, &mut irradiance);
    }
    let color = |(surface, light): (&Option<Surface>, &Vec3)| {
        surface.as_ref().map_or(settings.sky, |surface| surface.color * *light)
    };
    let mut light: Vec<Vec3> = frame.surfaces.iter().zip(&irradiance).map(color).collect();
    if wanted.reflections {
        mirror(frame, &through, settings, &edges, &mut light);
    }
    if wanted.fog {
        // Fog is blurred anyway: samples in steps do.
        let how = How::Steps { length: 1.0, fidelity: Fidelity::EXACT };
        veil(frame, &Through { how, screen: None, ..through }, lamps, settings, &mut light);
    }
    light
}

/// Adds the light of surfaces that the picture shows.
fn bounced(
    frame: &Frame,
    obstacles: &impl Obstacles,
    lamps: &[Lamp],
    rays: Rays,
    metre: f32,
    edges: &Edges,
    irradiance: &mut [Vec3],
) {
    let tolerance = 3.0 * edges.distance;
    let look = |place: Vec3, direction: Vec3| {
        let (at, _) = frame.eye.project(place)?;
        let (_, surface) = frame.at(at)?;
        let shown = surface.position.distance(place) <= tolerance && surface.normal.dot(direction) < 0.0;
        shown.then_some((surface.normal, surface.color))
    };
    let light = bounce::bounce(frame, obstacles, lamps, REACHES[0] * metre, rays, &look);
    let noisy: Vec<[f32; 3]> = light.iter().map(Vec3::to_array).collect();
    let smooth = smooth(frame, &noisy, edges);
    irradiance.iter_mut().zip(smooth).for_each(|(light, more)| *light += Vec3::from(more));
}

/// Mixes in what surfaces mirror: more at grazing angles.
fn mirror(frame: &Frame, obstacles: &impl Obstacles, settings: &Settings, edges: &Edges, light: &mut [Vec3]) {
    let mirror =
        Mirror { roughness: settings.roughness, reach: REACHES[1] * settings.metre, tolerance: 3.0 * edges.distance };
    let mirrored = reflections(frame, obstacles, mirror, settings.rays, light, &|_| settings.sky);
    let noisy: Vec<[f32; 3]> = mirrored.iter().map(|mirrored| mirrored.color.to_array()).collect();
    let smooth = if settings.roughness > 0.0 { smooth(frame, &noisy, edges) } else { noisy };
    for ((light, color), surface) in light.iter_mut().zip(smooth).zip(&frame.surfaces) {
        let Some(surface) = surface else { continue };
        let to_eye = (frame.eye.position - surface.position).normalize_or_zero();
        let cosine = to_eye.dot(surface.normal).clamp(0.0, 1.0);
        // Schlick's approximation, of a surface that mirrors 15 % of what comes straight.
        let share = 0.15 + 0.85 * (1.0 - cosine).powi(5);
        *light = *light * (1.0 - share) + Vec3::from(color) * share;
    }
}

/// Puts fog before the picture.
fn veil(frame: &Frame, obstacles: &impl Obstacles, lamps: &[Lamp], settings: &Settings, light: &mut [Vec3]) {
    let mist = Fog { density: settings.fog / settings.metre, reach: REACHES[2] * settings.metre };
    let veils = fog(frame, obstacles, mist, lamps, settings.rays);
    let noisy: Vec<[f32; 3]> = veils.iter().map(|veil| veil.color.to_array()).collect();
    for ((light, veil), color) in light.iter_mut().zip(&veils).zip(blur(frame, &noisy, settings.smoothing)) {
        // Lamps are given by what a surface sends to the eye, which is pi times less than what it gets.
        *light = *light * veil.clear + Vec3::from(color) * std::f32::consts::PI;
    }
}
