//! Effects through a volume of one bit a voxel.

use clap::{Args, ValueEnum};
use esvo_core::camera::viewpoint;
use esvo_core::lights::Light;
use esvo_core::{Camera, Nearest, Object, Picture, View};
use esvo_engines::EngineId;
use esvo_format::srgb;
use esvo_shadow::effects::{Cone, Counts, Eye, Frame, Lamp, Settings, Wanted, compose_with};
use esvo_shadow::octree::{bounds, look, world_of};
use esvo_shadow::{MAX_VOXELS, World};
use glam::{DVec3, Vec3};

use super::effects_gpu::OnGpu;
use crate::fail::Failure;
use crate::memory::check_memory;

/// Voxels along the longest edge of what is shown, without `--effect-voxel`.
const VOXELS: f64 = 800.0;
/// What is shown is taken to be so many metres long.
const METRES: f64 = 40.0;

/// An effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Effect {
    /// Ambient occlusion: less light from all around where something is near
    Ao,
    /// Shadows of the lights, soft with --light-radius
    Shadows,
    /// Surfaces mirror what the picture shows
    Reflections,
    /// Fog in the light of the lights
    Fog,
    /// One bounce of light from surface to surface
    Bounce,
}

/// Arguments of effects.
#[derive(Debug, Args)]
pub(crate) struct EffectArguments {
    /// Effects of a shaded picture, traced through a volume of one bit a voxel: see below
    #[arg(long, value_name = "NAMES", value_enum, value_delimiter = ',', conflicts_with = "compare")]
    pub(crate) effects: Vec<Effect>,
    /// Edge of the volume's voxels in the units of the mesh [default: 1/800 of the longest edge of what is shown]
    #[arg(long, value_name = "EDGE", requires = "effects", value_parser = parse_positive)]
    effect_voxel: Option<f64>,
    /// Rays for each pixel and effect
    #[arg(long, value_name = "N", requires = "effects", default_value_t = 16, value_parser = clap::value_parser!(u32).range(1..=4096))]
    effect_rays: u32,
    /// Radius of the lights in the units of the mesh, for soft shadows
    #[arg(long, value_name = "RADIUS", requires = "effects", value_parser = parse_radius, default_value = "0")]
    light_radius: f64,
}

fn parse_positive(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|x: &f64| *x > 0.0 && x.is_finite()).ok_or_else(|| "expected a number above 0".into())
}

fn parse_radius(text: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|x: &f64| *x >= 0.0 && x.is_finite())
        .ok_or_else(|| "expected 0 or a number above it".into())
}

/// The volume of what is shown, and how effects are made.
pub(crate) struct Effects {
    world: World,
    lamps: Vec<Lamp>,
    settings: Settings,
    device: Option<OnGpu>,
}

impl EffectArguments {
    /// Refuses effects of lamps without a lamp. The sky is none: it is there anyway.
    pub(crate) fn check(&self, lights: &[Light]) -> Result<(), Failure> {
        let of_lamps = [Effect::Shadows, Effect::Fog, Effect::Bounce];
        let no_lamp = lights.iter().all(|light| matches!(light, Light::Sky));
        if no_lamp && self.effects.iter().any(|effect| of_lamps.contains(effect)) {
            let what = "--effects: shadows, fog and bounce need a light; give one, e.g. --light sun:1,2,0.5";
            return Err(what.to_owned().into());
        }
        Ok(())
    }

    /// The volume of the objects; `None` if no effect is wanted. With engine `wgpu` its device makes the effects, with others the processor.
    pub(crate) fn prepare(
        &self,
        objects: &[Object],
        lights: &[Light],
        engine: EngineId,
    ) -> Result<Option<Effects>, Failure> {
        if self.effects.is_empty() {
            return Ok(None);
        }
        let (low, high) = viewpoint::bounds_of(objects);
        let longest = (high - low).max_element();
        let voxel = self.effect_voxel.unwrap_or(longest / VOXELS);
        let has = |effect| self.effects.contains(&effect);
        let wanted = Wanted {
            occlusion: has(Effect::Ao),
            shadows: has(Effect::Shadows),
            reflections: has(Effect::Reflections),
            fog: has(Effect::Fog),
            bounce: has(Effect::Bounce),
        };
        let lamp = |light: &Light| lamp(light, (low + high) / 2.0, longest, self.light_radius);
        let lamps: Vec<Lamp> = lights.iter().filter_map(lamp).collect();
        check_volume(objects, voxel)?;
        let world = world_of(objects, voxel, 2).map_err(|e| format!("--effects: {e}"))?;
        let settings = Settings {
            wanted,
            counts: Counts::all(self.effect_rays),
            metre: (longest / METRES) as f32,
            ..Settings::default()
        };
        let device = (engine == EngineId::Wgpu).then(|| OnGpu::new(&world)).transpose()?;
        Ok(Some(Effects { world, lamps, settings, device }))
    }
}

/// Refuses a volume that the system has no memory for. Too many voxels along an axis are the volume's own error.
fn check_volume(objects: &[Object], voxel: f64) -> Result<(), Failure> {
    let Some((low, high)) = bounds(objects) else { return Ok(()) };
    let voxels = (high - low) / voxel + 4.0;
    if voxels.max_element() > f64::from(MAX_VOXELS) {
        return Ok(());
    }
    // A bit for each voxel, and all mips: a seventh more.
    check_memory((voxels.element_product() / 7.0) as usize, &format!("--effect-voxel {voxel}"))
}

/// A light as a lamp that is as bright as the others at a quarter of the scene's length. The sky is no lamp: it is there anyway.
fn lamp(light: &Light, middle: DVec3, longest: f64, radius: f64) -> Option<Lamp> {
    let far = 20.0 * longest;
    let (position, bright_at, cone) = match *light {
        Light::Sky => return None,
        Light::Directional { to_light } => (middle + to_light.normalize_or_zero() * far, far, None),
        Light::Point { position } => (position, longest / 4.0, None),
        Light::Spot { position, direction, angle_degrees } => {
            let half = angle_degrees.to_radians() / 2.0;
            let axis = direction.normalize_or_zero().as_vec3();
            let cone = Cone { axis, inner: (half * 0.8).cos() as f32, outer: half.cos() as f32 };
            (position, longest / 4.0, Some(cone))
        }
    };
    // The sun is as wide as a lamp of this radius at a quarter of the scene's length.
    let radius = radius * if matches!(light, Light::Directional { .. }) { far / (longest / 4.0) } else { 1.0 };
    let color = Vec3::splat((bright_at * bright_at) as f32);
    Some(Lamp { position: position.as_vec3(), radius: radius as f32, color, reach: f32::INFINITY, cone })
}

impl Effects {
    /// The picture of these hits, with the effects.
    pub(crate) fn draw(
        &self,
        camera: &Camera,
        objects: &[Object],
        views: &[View],
        nearest: &Nearest,
    ) -> Result<Picture, Failure> {
        let size = (views[0].width, views[0].height);
        let frame = Frame::of_hits(Eye::of(camera, size)?, objects, views, nearest);
        let encode = |x: f32| srgb::encode(x.clamp(0.0, 1.0));
        let picture =
            |light: Vec<Vec3>| Picture::from_fn(size, |x, y| light[(y * size.0 + x) as usize].to_array().map(encode));
        if let Some(device) = &self.device {
            return Ok(picture(device.light(&self.world, &frame, &self.lamps, &self.settings)?));
        }
        let (volume, grid) = (self.world.volume(), *self.world.grid());
        // A ray ends up to a voxel before the surface that the voxel is of, or behind it.
        let distance = 2.0 * grid.voxel as f32;
        let look = |place: Vec3, direction: Vec3| look(objects, place, direction, distance);
        Ok(picture(compose_with(&frame, volume, grid, &self.lamps, &self.settings, &look).light))
    }

    /// What there is to say about the volume.
    pub(crate) fn about(&self) -> String {
        let ([x, y, z], bytes) = (self.world.volume().voxels(), self.world.volume().bytes());
        let voxel = self.world.grid().voxel;
        let on = self.device.as_ref().map_or_else(String::new, |device| format!(", effects on {}", device.name()));
        format!("volume of {x} x {y} x {z} voxels of {voxel:.4}, {:.1} MB{on}\n", bytes as f64 / 1e6)
    }
}
