//! HAIRBALL: thousands of thin curly strands that fill a ball.

use esvo_builder::mesh::Mesh;
use glam::DVec3;

use super::numeric::{Rng, sin_cos, tangents};
use super::shape::Shapes;

/// Strands in the ball.
const STRANDS: usize = 6_000;
/// Rings of three vertices along a strand. With its two tips a strand has `6 * RINGS` triangles.
const RINGS: usize = 80;
/// Maximum distance of a vertex from the origin. The paper's authors set their near plane to a thousandth and their far plane
/// to three times the half extent of a scene; their hairball cameras imply this half extent.
const BALL_RADIUS: f64 = 4.6141;
/// Half the thickness of a hair.
const HAIR_RADIUS: f64 = 0.0105;

/// Triangles of [`hairball`].
pub const HAIRBALL_TRIANGLES: usize = 6 * STRANDS * RINGS;

/// Stands in for the hairball of the McGuire archive: 2,880,000 triangles in 6,000 closed tubes with three sides, wound
/// around the centre at all depths and curled on the way.
///
/// Extents: a ball of radius 4.6141 around the origin, which suits the paper authors' hairball cameras. Six brown materials.
/// The worst case for an octree: voxels are mostly partly filled, neighbours unrelated, and rays graze many hairs.
pub fn hairball(seed: u64) -> Mesh {
    let mut rng = Rng::new(seed);
    let mut shapes = Shapes::with_capacity(HAIRBALL_TRIANGLES);
    let browns = [
        [0.19, 0.09, 0.04],
        [0.26, 0.13, 0.06],
        [0.34, 0.19, 0.09],
        [0.42, 0.26, 0.13],
        [0.13, 0.06, 0.03],
        [0.30, 0.13, 0.05],
    ]
    .map(|rgb| shapes.add_material("hair", rgb));
    let mut points = Vec::with_capacity(RINGS + 2);
    for _ in 0..STRANDS {
        shapes.paint(browns[rng.below(browns.len())]);
        strand(&mut rng, &mut points);
        shapes.tube(&points, 3, |_| HAIR_RADIUS);
    }
    shapes.finish()
}

/// One strand: a walk around the centre whose heading and height drift, with a helix on top of it.
fn strand(rng: &mut Rng, points: &mut Vec<DVec3>) {
    points.clear();
    let curl_radius = rng.range(0.02, 0.16);
    let curl_step = rng.range(0.25, 0.65) * if rng.chance(0.5) { 1.0 } else { -1.0 };
    let mut curl = rng.range(0.0, 6.0);
    let highest = BALL_RADIUS - curl_radius - 1.01 * HAIR_RADIUS;
    let lowest = 0.08 * BALL_RADIUS;
    // The largest of three uniform numbers is distributed as the radius in a filled ball.
    let mut height = (BALL_RADIUS * rng.unit().max(rng.unit()).max(rng.unit())).clamp(lowest, highest);
    let mut climb = rng.range(-0.04, 0.04);
    let step = rng.range(0.07, 0.133);
    let mut up = rng.direction();
    let mut ahead = tangents(up).0;
    let mut bend = 0.0;
    for _ in 0..RINGS + 2 {
        let side = up.cross(ahead);
        let (s, c) = sin_cos(curl);
        points.push(up * (height + curl_radius * c) + side * (curl_radius * s));
        curl += curl_step;

        bend = 0.9 * bend + rng.range(-0.05, 0.05);
        climb = 0.95 * climb + rng.range(-0.02, 0.02);
        height += climb;
        if height < lowest || height > highest {
            height = height.clamp(lowest, highest);
            climb = -climb;
        }
        // Move straight ahead along the sphere. Near the centre the angle is limited, so that hairs do not kink.
        ahead = (ahead + side * bend).normalize();
        let angle = (step / height).min(0.35);
        let (s, c) = sin_cos(angle);
        (up, ahead) = (up * c + ahead * s, ahead * c - up * s);
        up = up.normalize();
        ahead = (ahead - up * ahead.dot(up)).normalize();
    }
}
