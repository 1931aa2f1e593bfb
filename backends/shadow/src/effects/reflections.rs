//! Reflections, sharp and blurred.

use glam::Vec3;

use super::frame::{Frame, Surface};
use super::obstacles::{Obstacles, Query};
use super::{Rays, each_surface, random};

/// What a pixel's surface mirrors.
#[derive(Clone, Copy, PartialEq, Debug, Default)]
pub struct Reflection {
    /// Its light, linear red, green and blue.
    pub color: Vec3,
    /// The share of rays that reach the sky: the specular occlusion.
    pub open: f32,
}

/// How surfaces mirror.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Mirror {
    /// 0 is a mirror; with 1 rays go up to 45 degrees off.
    pub roughness: f32,
    /// Where rays end that meet nothing.
    pub reach: f32,
    /// How far what is met may be from the surface that the picture shows there, for its colour to be taken.
    pub tolerance: f32,
}

/// What each pixel's surface mirrors. `lit`: the light of each pixel of the picture. A ray that meets something gets the picture's colour there if the picture
/// shows it, fading towards the picture's edge, and black if not: a volume knows of no colours. A ray that meets nothing gets the
/// colour of `sky` in its direction.
pub fn reflections(
    frame: &Frame,
    obstacles: &impl Obstacles,
    mirror: Mirror,
    rays: Rays,
    lit: &[Vec3],
    sky: &(impl Fn(Vec3) -> Vec3 + Sync),
) -> Vec<Reflection> {
    // Rays of a mirror are one.
    let count = if mirror.roughness == 0.0 { 1 } else { rays.count };
    each_surface(
        frame,
        Reflection::default(),
        |pixel, surface, queries| {
            let view = (surface.position - frame.eye.position).normalize_or_zero();
            let middle = view - surface.normal * (2.0 * view.dot(surface.normal));
            let (x, y) = middle.any_orthonormal_pair();
            queries.extend((0..count).map(|i| {
                let off = random::disk(random::square(pixel, i, rays.seed)) * mirror.roughness;
                let direction = (middle + x * off.x + y * off.y).normalize_or(middle);
                Query { from: surface.position, normal: surface.normal, direction, length: mirror.reach }
            }));
        },
        |queries| obstacles.first(queries),
        |_, _, queries, met| {
            let mut sum = Reflection::default();
            for (query, met) in queries.iter().zip(met) {
                match met {
                    // A ray below the surface meets it.
                    _ if query.direction.dot(query.normal) <= 0.0 => {}
                    None => {
                        sum.color += sky(query.direction);
                        sum.open += 1.0;
                    }
                    Some(distance) => {
                        sum.color += seen(
                            frame,
                            query.from + query.direction * *distance,
                            query.direction,
                            mirror.tolerance,
                            lit,
                        );
                    }
                }
            }
            let share = 1.0 / queries.len().max(1) as f32;
            Reflection { color: sum.color * share, open: sum.open * share }
        },
    )
}

/// The picture's light at a place, or black if the picture does not show it from the side that a ray in `direction` sees.
fn seen(frame: &Frame, place: Vec3, direction: Vec3, tolerance: f32, lit: &[Vec3]) -> Vec3 {
    let Some((at, _)) = frame.eye.project(place) else { return Vec3::ZERO };
    let Some((pixel, Surface { position, normal, depth, .. })) = frame.at(at) else { return Vec3::ZERO };
    if position.distance(place) > tolerance + depth * frame.eye.pixel() || normal.dot(direction) > 0.0 {
        return Vec3::ZERO;
    }
    let size = glam::Vec2::new(frame.eye.size.0 as f32, frame.eye.size.1 as f32);
    // The outer tenth fades.
    let to_edge = at.min(size - at) / (0.1 * size);
    lit[pixel] * to_edge.min_element().clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use glam::Vec2;

    use super::*;
    use crate::effects::Eye;

    /// A wall across the picture is seen from its front, near its place, and nowhere else.
    #[test]
    fn the_picture_shows_fronts_alone() {
        let eye = Eye {
            position: Vec3::ZERO,
            right: Vec3::X,
            up: Vec3::Z,
            forward: Vec3::Y,
            half: Vec2::ONE,
            size: (40, 40),
        };
        let wall = |x: u32, y: u32| {
            let position = eye.direction(Vec2::new(x as f32 + 0.5, y as f32 + 0.5)) * 4.0;
            Some(Surface { position, normal: -Vec3::Y, color: Vec3::ONE, depth: 4.0, moved: Vec3::ZERO })
        };
        let frame = Frame::from_fn(eye, wall);
        let lit = vec![Vec3::ONE; 1600];
        let at = |place: Vec3, direction: Vec3| seen(&frame, place, direction, 0.1, &lit);
        let place = Vec3::new(0.1, 4.0, 0.1);
        assert_eq!(at(place, Vec3::new(0.6, 0.8, 0.0)), Vec3::ONE);
        assert_eq!(at(place, Vec3::new(0.6, -0.8, 0.0)), Vec3::ZERO, "its back");
        assert_eq!(at(place + Vec3::Y, Vec3::Y), Vec3::ZERO, "behind it");
        assert_eq!(at(-place, Vec3::Y), Vec3::ZERO, "behind the eye");
        assert_eq!(at(place + Vec3::X * 9.0, Vec3::Y), Vec3::ZERO, "beside the picture");
        // At half a tenth of the picture from its edge half of it is left.
        let near_edge = at(Vec3::new(3.6, 4.0, 0.1), Vec3::Y).x;
        assert!((near_edge - 0.5).abs() < 0.01, "{near_edge}");
    }
}
