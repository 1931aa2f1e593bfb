//! Pictures of hard octrees from random places: casters cast them otherwise than lists of rays.

use esvo_core::reference::{cast_coarse, cast_fine};
use esvo_core::testing::directed::{DataSet, noise};
use esvo_core::testing::oracle::Oracle;
use esvo_core::testing::sample::Noise;
use esvo_core::{Camera, CastOptions, Ray, View};
use glam::DVec3;
use rayon::prelude::*;

use super::Cell;
use super::data::{Counts, judge};
use super::engines::Running;

/// Pixels of a picture, for whole tiles, blocks and packets and for parts of them.
const SIZE: (u32, u32) = (37, 22);
/// Rays of pictures for each ray of a kind.
pub(super) const SHARE: u64 = 2;

/// The picture of a number; `None` for numbers whose camera cannot be used.
pub(super) fn view(set: &DataSet, contours: bool, number: u64) -> Option<View> {
    // Other cameras for other octrees.
    let of_name = set.name.bytes().fold(0u64, |hash, byte| hash.wrapping_mul(257).wrapping_add(byte.into()));
    let noise = &mut noise(number ^ of_name << 20);
    let vector = |noise: &mut Noise, half: f64| {
        DVec3::new(noise.number() - 0.5, noise.number() - 0.5, noise.number() - 0.5) * 2.0 * half
    };
    // From within the root cube to far away, often along an axis or at the middle exactly.
    let reach = [0.3, 0.5, 1.0, 3.0, 100.0, 1e4][(noise.number() * 6.0) as usize];
    let eye = DVec3::splat(0.5) + vector(noise, reach);
    let to = DVec3::splat(0.5) + vector(noise, 0.4);
    let snapped = noise.number() < 0.3;
    let (eye, to) = if snapped { ((eye * 16.0).round() / 16.0, (to * 16.0).round() / 16.0) } else { (eye, to) };
    let mut forward = to - eye;
    if noise.number() < 0.2 {
        let size = forward.abs().max_element();
        forward = forward.map(|x| if x.abs() == size { x } else { 0.0 });
    }
    let distance = forward.length();
    // So that the octree fills the picture, or nearly, or a part of it.
    let around = 2.0 * (0.7 / distance.max(1e-3)).atan().to_degrees();
    let fov_degrees = if noise.number() < 0.2 { 90.0 } else { around * (0.1 + 1.2 * noise.number()) };
    let far = (distance + 1.0) * [1.0, 3.0][(noise.number() * 2.0) as usize];
    let camera = Camera {
        eye: eye.into(),
        forward: forward.into(),
        up: [0.0, 1.0, 0.0],
        fov_degrees: fov_degrees.min(170.0),
        near: far * [1e-4, 1e-6, 0.3][(noise.number() * 3.0) as usize],
        far,
    };
    let max_voxel_pixels = [0.0, 0.5, 1.0, 4.0][(noise.number() * 4.0) as usize];
    let beam = noise.number() < 0.3;
    let object = &set.octree.objects()[0];
    let options = CastOptions { contours, beam, max_voxel_pixels };
    View::new(&camera, set.octree.octree_to_mesh(0), object.root_slot as u32, SIZE, &options).ok()
}

/// The name of a picture.
pub(super) fn case(set: &DataSet, contours: bool, number: u64) -> String {
    format!("{}/pictures/{}#{number}", set.name, if contours { "contours" } else { "cubes" })
}

/// Casts pictures until there are enough rays.
pub(super) fn run(
    set: &DataSet,
    contours: bool,
    oracle: &Oracle<'_>,
    seed: u64,
    counts: Counts,
    engines: &mut [Running],
) -> Cell {
    let mut cell = Cell { set: set.name.into(), kind: "pictures".into(), contours, ..Cell::default() };
    let pixels = u64::from(SIZE.0 * SIZE.1);
    let pictures = (SHARE * counts.rays).div_ceil(pixels);
    let gpu_pictures = (SHARE * counts.gpu_rays).div_ceil(pixels);
    let numbers: Vec<u64> = (seed..seed + pictures).collect();
    for some in numbers.chunks(64) {
        let cast: Vec<_> = some
            .par_iter()
            .filter_map(|&number| {
                let view = view(set, contours, number)?;
                let coarse = if view.beam() { cast_coarse(&set.octree, &view) } else { Vec::new() };
                let mut hits = Vec::new();
                cast_fine(&set.octree, &view, &coarse, &mut hits);
                let places = (0..view.height).flat_map(|y| (0..view.width).map(move |x| (x, y)));
                // The beam starts a ray later, where it hits nothing before.
                let rays: Vec<Ray> = places
                    .map(|(x, y)| {
                        let ray = view.ray(x, y);
                        let t_min = if view.beam() { view.beam_start(&coarse, x, y) } else { ray.t_min };
                        Ray { t_min, ..ray }
                    })
                    .collect();
                Some((number, view, rays, hits))
            })
            .collect();
        for (number, view, rays, hits) in &cast {
            judge(&mut cell, oracle, rays, hits, |k| format!("{}, pixel {k}", case(set, contours, *number)));
            for engine in &mut *engines {
                if !engine.is_gpu || number - seed < gpu_pictures {
                    engine.picture(oracle, view, rays, hits, &case(set, contours, *number));
                }
            }
        }
    }
    cell
}
