//! One bounce of light from surface to surface.

use glam::Vec3;

use super::frame::Frame;
use super::lamps::Lamp;
use super::obstacles::{Obstacles, Query};
use super::{Rays, ask_around, each_surface};

/// What the scene has at a place that a ray met: normal, on the side of the ray, and the share of light that it reflects.
pub type Look = (Vec3, Vec3);

/// The light that each pixel's surface gets from other surfaces which lamps shine on. `look`: what is at a place, for a ray of this direction; `None` is black.
/// Rays leave as for ambient occlusion and end after `reach`; from what they meet one ray goes to each lamp.
pub fn bounce(
    frame: &Frame,
    obstacles: &impl Obstacles,
    lamps: &[Lamp],
    reach: f32,
    rays: Rays,
    look: &(impl Fn(Vec3, Vec3) -> Option<Look> + Sync),
) -> Vec<Vec3> {
    each_surface(
        frame,
        Vec3::ZERO,
        |pixel, surface, queries| ask_around(pixel, surface, reach, rays, queries),
        |queries| {
            let mut light = vec![Vec3::ZERO; queries.len()];
            let mut to_lamps = Vec::new();
            let mut shares = Vec::new();
            for (ray, (query, met)) in queries.iter().zip(obstacles.first(queries)).enumerate() {
                let Some(distance) = met else { continue };
                let place = query.from + query.direction * distance;
                let Some((normal, color)) = look(place, query.direction) else { continue };
                for lamp in lamps {
                    let way = lamp.position - place;
                    let length = way.length();
                    let direction = way / length;
                    let slope = direction.dot(normal);
                    let share = lamp.light(place) * color * slope;
                    if slope > 0.0 && share != Vec3::ZERO {
                        to_lamps.push(Query { from: place, normal, direction, length });
                        shares.push((ray, share));
                    }
                }
            }
            for ((ray, share), blocked) in shares.into_iter().zip(obstacles.blocked(&to_lamps)) {
                if !blocked {
                    light[ray] += share;
                }
            }
            light
        },
        // Rays are as frequent as their cosine: their mean is the light that a surface gets, over pi. A surface with color c sends out c / pi of
        // what it gets, and gets pi times the mean.
        |_, _, _, light| light.iter().sum::<Vec3>() / light.len().max(1) as f32,
    )
}
