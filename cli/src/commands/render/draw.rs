//! One picture: casting, shading, filtering.

use std::time::{Duration, Instant};

use esvo_core::filter::{Frame, code_at};
use esvo_core::lights::{self, Light};
use esvo_core::{Caster, Nearest, Picture, View, shading};
use esvo_format::Octree;

use super::look::{Look, ViewMode};
use crate::fail::Failure;

/// Iterations that are shown as white, as in the paper's Figure 9.
const MOST_ITERATIONS: u32 = 64;

/// What lights a shaded picture.
#[derive(Debug)]
pub(crate) struct Lighting<'a> {
    /// None: a lamp at the camera.
    pub(crate) lights: &'a [Light],
    pub(crate) shadows: bool,
}

/// A picture, and what there is to say about it.
#[derive(Debug)]
pub(crate) struct Drawn {
    pub(crate) picture: Picture,
    /// Pixels whose ray hits something.
    pub(crate) hit: usize,
    pub(crate) casting: Duration,
    pub(crate) shading: Duration,
    pub(crate) filtering: Duration,
}

/// Draws the objects of the octree that the caster has loaded. With `twice`, it casts and filters twice and measures the second
/// time: the first time, kernels are compiled and memory is touched.
pub(crate) fn draw(
    caster: &mut dyn Caster,
    octree: &Octree,
    views: &[View],
    look: &Look,
    lighting: &Lighting<'_>,
    twice: bool,
) -> Result<Drawn, Failure> {
    if twice {
        Nearest::cast(caster, views)?;
    }
    let start = Instant::now();
    let nearest = Nearest::cast(caster, views)?;
    let casting = start.elapsed();
    let (view, hits) = (&views[0], &nearest.hits);
    let start = Instant::now();
    let mut picture = match look.mode {
        ViewMode::Shaded if !lighting.lights.is_empty() => {
            lights::shade_lit(caster, octree, views, &nearest, lighting.lights, lighting.shadows)?
        }
        ViewMode::Shaded => shading::shade_nearest(octree, views, &nearest),
        ViewMode::Iterations => shading::iteration_map(view, hits, MOST_ITERATIONS),
        ViewMode::Normals => shading::normal_map(octree, views, &nearest),
        ViewMode::Depth => shading::depth_map(view, hits),
        ViewMode::Levels => shading::level_map(view, hits, octree.needs().levels),
        ViewMode::VoxelSize => shading::size_map(views, &nearest),
        ViewMode::Ambient => shading::ambient_map(octree, view, hits),
    };
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
    let hit = hits.iter().filter(|hit| !hit.is_miss()).count();
    Ok(Drawn { picture, hit, casting, shading, filtering })
}
