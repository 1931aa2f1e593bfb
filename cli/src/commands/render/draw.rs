//! One picture: casting, shading, filtering.

use std::time::{Duration, Instant};

use esvo_core::filter::{Frame, code_at};
use esvo_core::lights::{self, Light};
use esvo_core::shading::Component;
use esvo_core::sky::Sky;
use esvo_core::{Camera, Caster, Instances, Nearest, Object, Picture, View, shading};

use super::effects::Effects;
use super::look::{Look, ViewMode};
use crate::fail::Failure;

/// Iterations that are shown as white, as in the paper's Figure 9.
const MOST_ITERATIONS: u32 = 64;

/// What lights a shaded picture.
pub(crate) struct Lighting<'a> {
    /// None: a lamp at the camera.
    pub(crate) lights: &'a [Light],
    pub(crate) shadows: bool,
    /// Effects in the place of other light, and the camera.
    pub(crate) effects: Option<(&'a Effects, &'a Camera)>,
    /// None: the background of [`shading::shade_nearest`].
    pub(crate) sky: Option<Sky>,
}

/// A picture, and what there is to say about it.
#[derive(Debug)]
pub(crate) struct Drawn {
    pub(crate) picture: Picture,
    pub(crate) nearest: Nearest,
    pub(crate) casting: Duration,
    pub(crate) shading: Duration,
    pub(crate) filtering: Duration,
}

impl Drawn {
    /// Pixels whose ray hits something.
    pub(crate) fn hit(&self) -> usize {
        self.nearest.hits.iter().filter(|hit| !hit.is_miss()).count()
    }
}

/// What there is to say about several pictures of one kind.
#[derive(Clone, Copy, Default, Debug)]
pub(crate) struct Total {
    pictures: u32,
    pixels: usize,
    hit: usize,
    /// Of casting, shading and filtering.
    times: [Duration; 3],
}

impl Total {
    /// Adds a picture.
    pub(crate) fn add(&mut self, drawn: &Drawn) {
        self.pictures += 1;
        self.pixels += drawn.nearest.hits.len();
        self.hit += drawn.hit();
        for (sum, time) in self.times.iter_mut().zip([drawn.casting, drawn.shading, drawn.filtering]) {
            *sum += time;
        }
    }

    /// How much of the pictures is hit.
    pub(crate) fn hits(&self) -> String {
        format!("{:.1} % of the pixels hit", 100.0 * self.hit as f64 / self.pixels as f64)
    }

    /// A line with the times of a picture.
    pub(crate) fn times(&self) -> String {
        let [casting, shading, filtering] =
            self.times.map(|time| time.as_secs_f64() * 1e3 / f64::from(self.pictures.max(1)));
        let each = if self.pictures > 1 { ", mean of all frames" } else { "" };
        format!("casting {casting:.1} ms, shading {shading:.1} ms, filter {filtering:.1} ms{each}\n")
    }
}

/// Draws objects of the octree that the caster has loaded: one for each view. With `twice`, it casts and filters twice and measures the second
/// time: the first time, kernels are compiled and memory is touched.
pub(crate) fn draw(
    caster: &mut dyn Caster,
    objects: &[Object<'_>],
    views: &[View],
    look: &Look,
    lighting: &Lighting<'_>,
    twice: bool,
) -> Result<Drawn, Failure> {
    let octree = objects[0].octree();
    let mut objects = objects.to_vec();
    if !look.contours {
        objects.iter_mut().for_each(|object| *object = object.without_contours());
    }
    if twice {
        cast(caster, views)?;
    }
    let start = Instant::now();
    let nearest = cast(caster, views)?;
    let casting = start.elapsed();
    let (view, hits) = (&views[0], &nearest.hits);
    let start = Instant::now();
    let component = |shown| shading::component_map_placed(&objects, views, &nearest, shown);
    let mut picture = match (look.mode, lighting.effects) {
        (ViewMode::Shaded, Some((effects, camera))) => effects.draw(camera, &objects, views, &nearest)?,
        (ViewMode::Shaded, None) if !lighting.lights.is_empty() => {
            lights::shade_placed_lit(caster, &objects, views, &nearest, lighting.lights, lighting.shadows)?
        }
        (ViewMode::Shaded, None) => shading::shade_placed(&objects, views, &nearest),
        (ViewMode::Iterations, _) => shading::iteration_map(view, hits, MOST_ITERATIONS),
        (ViewMode::Normals, _) => shading::normal_map_placed(&objects, views, &nearest),
        (ViewMode::Depth, _) => shading::depth_map(view, hits),
        (ViewMode::Levels, _) => shading::level_map(view, hits, octree.needs().levels),
        (ViewMode::VoxelSize, _) => shading::size_map(views, &nearest),
        (ViewMode::Ambient, _) => shading::ambient_map(octree, view, hits),
        (ViewMode::Emission, _) => component(Component::Emission),
        (ViewMode::Roughness, _) => component(Component::Roughness),
        (ViewMode::Metalness, _) => component(Component::Metalness),
        (ViewMode::Opacity, _) => component(Component::Opacity),
        (ViewMode::Material, _) => component(Component::Material),
    };
    if let Some(sky) = lighting.sky.filter(|_| look.mode == ViewMode::Shaded) {
        sky.paint(&mut picture, view, *objects[0].octree_to_mesh(), &nearest);
    }
    let shading = start.elapsed();
    let mut filtering = Duration::ZERO;
    if let Some(radius) = look.radius() {
        let codes = nearest.views.iter().zip(hits).map(|(view, hit)| code_at(&views[*view as usize], hit));
        let frame = Frame::from_codes(&picture, codes)?;
        // Where no voxel is larger than a pixel, nothing changes.
        if frame.is_filtered() {
            if twice {
                caster.filter(&frame, radius)?;
            }
            let filtered = caster.filter(&frame, radius)?;
            (picture, filtering) = (filtered.picture, filtered.time);
        }
    }
    Ok(Drawn { picture, nearest, casting, shading, filtering })
}

/// The nearest hits. One object alone is cast whole, with the beam if that is wanted; instances do without.
fn cast(caster: &mut dyn Caster, views: &[View]) -> Result<Nearest, Failure> {
    if views.len() == 1 {
        return Ok(Nearest::cast(caster, views)?);
    }
    let mut nearest = Nearest::default();
    caster.cast_instances(&Instances::new(views.to_vec())?, &mut nearest)?;
    Ok(nearest)
}
