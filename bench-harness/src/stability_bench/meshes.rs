//! Meshes that are hard to build and to cast.

use esvo_builder::{BuildSettings, Mesh, build};
use esvo_core::exact::ExactRay;
use esvo_core::reference::{EPSILON, cast_ray};
use esvo_core::testing::directed::noise;
use esvo_core::testing::sample::Noise;
use esvo_core::{Object, Ray};
use esvo_cpu::triangles::TriangleScene;
use esvo_format::Octree;
use glam::{DMat3, DVec3, Vec3};
use rayon::prelude::*;

use super::MeshRow;
use crate::{BenchError, Progress};

/// Levels of the octrees.
const LEVELS: u32 = 7;

/// A mesh of the suite.
struct Hard {
    name: &'static str,
    about: &'static str,
    triangles: Vec<[DVec3; 3]>,
}

/// Builds each mesh with and without contours, and casts rays at it.
pub(super) fn run(count: u64, seed: u64, progress: &Progress) -> Result<Vec<MeshRow>, BenchError> {
    let mut rows = Vec::new();
    for hard in meshes() {
        let failed = |what: String| BenchError::scene(hard.name, what);
        let positions: Vec<[f64; 3]> = hard.triangles.iter().flatten().map(|corner| corner.to_array()).collect();
        let corners = (0..positions.len() as u32 / 3).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect();
        let mesh = Mesh::from_triangles(positions, corners).map_err(|error| failed(error.to_string()))?;
        for contours in [false, true] {
            progress.say(format!("meshes: {}", hard.name));
            let settings = BuildSettings { levels: LEVELS, contours, ..BuildSettings::default() };
            let built = build(&mesh, &settings, &|_| ()).map_err(|error| failed(error.to_string()))?;
            rows.push(cast(&hard, &built.octree, contours, count, seed).map_err(failed)?);
        }
    }
    Ok(rows)
}

/// What one ray showed.
enum Seen {
    /// The ray misses triangles and octree, or passes at the border of the root cube.
    Nothing,
    Hole,
    /// Distance of the octree's hit from the triangles, in diagonals of its voxel.
    At(f64),
}

fn cast(hard: &Hard, octree: &Octree, contours: bool, count: u64, seed: u64) -> Result<MeshRow, String> {
    let object = Object::of(octree, 0);
    // In cast space, where numbers are of the size of 1 whatever the mesh is.
    let triangles: Vec<[DVec3; 3]> =
        hard.triangles.iter().map(|triangle| triangle.map(|corner| object.to_cast(corner))).collect();
    let scene = TriangleScene::new(triangles.iter().map(|triangle| triangle.map(Into::into)).collect())
        .map_err(|error| error.to_string())?;
    let seen: Vec<Seen> = (0..count)
        .into_par_iter()
        .map(|k| {
            let ray = ray(&triangles, seed + k);
            // The ray that casters cast: it is never quite parallel to an axis.
            let direction = ray.direction.map(|d| if d.abs() < EPSILON { EPSILON.copysign(d) } else { d });
            let exact = ExactRay {
                origin: ray.origin.as_dvec3(),
                direction: direction.as_dvec3(),
                t_min: 0.0,
                t_max: f64::INFINITY,
            };
            let expected = scene.cast_exact_ray(&exact);
            let hit = cast_ray(octree, object.root(), &ray, contours);
            let length = exact.direction.length();
            let voxel = 0.5f64.powi(LEVELS as i32);
            // A hundredth of a voxel, and the rounding of positions on the ray.
            let rounding = (exact.origin.length() + 3.0) * 1e-6;
            let slack = 0.01 * voxel + rounding;
            if !expected.is_miss() && (hit.is_miss() || f64::from(hit.raw_t) * length > expected.t * length + slack) {
                // Where a mesh ends at the border of the root cube, rounding may lead a ray past both.
                let at = exact.origin + exact.direction * expected.t;
                let from_border = (0.5 - (at - 1.5).abs()).min_element();
                return if from_border.abs() < rounding { Seen::Nothing } else { Seen::Hole };
            }
            match hit.t() {
                Some(t) => {
                    let point = exact.origin + exact.direction * f64::from(t);
                    let distance = triangles.iter().map(|triangle| distance(point, triangle)).fold(f64::MAX, f64::min);
                    let diagonal = f64::from(hit.size()) * 3f64.sqrt();
                    Seen::At((distance - slack).max(0.0) / diagonal)
                }
                None => Seen::Nothing,
            }
        })
        .collect();
    let mut row = MeshRow {
        name: hard.name.into(),
        about: hard.about.into(),
        levels: octree.needs().levels,
        contours,
        rays: count,
        holes: 0,
        beside: 0,
        worst: 0.0,
    };
    for seen in seen {
        match seen {
            Seen::Nothing => {}
            Seen::Hole => row.holes += 1,
            Seen::At(distance) => {
                row.beside += u64::from(distance > 1.0);
                row.worst = row.worst.max(distance);
            }
        }
    }
    Ok(row)
}

/// A ray towards a point of a triangle, or beside it.
fn ray(triangles: &[[DVec3; 3]], number: u64) -> Ray {
    let noise = &mut noise(number ^ 0x3e5);
    let [a, b, c] = triangles[(noise.number() * triangles.len() as f64) as usize % triangles.len()];
    let (mut u, mut v) = (noise.number(), noise.number());
    if u + v > 1.0 {
        (u, v) = (1.0 - u, 1.0 - v);
    }
    let beside = if noise.number() < 0.2 { vector(noise) * 0.01 } else { DVec3::ZERO };
    let to = a + (b - a) * u + (c - a) * v + beside;
    let from = DVec3::splat(1.5) + vector(noise) * if noise.number() < 0.3 { 20.0 } else { 2.0 };
    let mut ray = Ray::new(from.as_vec3(), (to - from).as_vec3());
    if noise.number() < 0.2 {
        let axis = (noise.number() * 3.0) as usize % 3;
        let mut origin = to;
        origin[axis] = 0.0;
        ray = Ray::new(origin.as_vec3(), Vec3::from(std::array::from_fn(|k| if k == axis { 1.0 } else { 0.0 })));
    }
    ray
}

fn vector(noise: &mut Noise) -> DVec3 {
    DVec3::new(noise.number() - 0.5, noise.number() - 0.5, noise.number() - 0.5) * 2.0
}

/// Distance of a point from a triangle: from its plane if the point is above it, else from the nearest edge.
fn distance(point: DVec3, &[a, b, c]: &[DVec3; 3]) -> f64 {
    let to_edge = |from: DVec3, to: DVec3| {
        let along = to - from;
        let part = if along == DVec3::ZERO { 0.0 } else { (point - from).dot(along) / along.length_squared() };
        point.distance(from + along * part.clamp(0.0, 1.0))
    };
    let edges = to_edge(a, b).min(to_edge(b, c)).min(to_edge(c, a));
    let normal = (b - a).cross(c - a);
    let inside = [(a, b), (b, c), (c, a)].iter().all(|&(from, to)| (to - from).cross(point - from).dot(normal) >= 0.0);
    if inside && normal != DVec3::ZERO { edges.min((point - a).dot(normal).abs() / normal.length()) } else { edges }
}

/// Two triangles of a parallelogram.
fn quad(corner: DVec3, u: DVec3, v: DVec3) -> [[DVec3; 3]; 2] {
    [[corner, corner + u, corner + v], [corner + u, corner + u + v, corner + v]]
}

/// The six sides of a box.
fn cuboid(low: DVec3, size: DVec3) -> Vec<[DVec3; 3]> {
    let [x, y, z] = [DVec3::X * size.x, DVec3::Y * size.y, DVec3::Z * size.z];
    let sides = [(x, y, z), (y, z, x), (z, x, y)];
    sides.iter().flat_map(|&(u, v, w)| [quad(low, u, v), quad(low + w, v, u)]).flatten().collect()
}

/// A sphere of 320 triangles with radius 1 around the origin.
fn ball() -> Vec<[DVec3; 3]> {
    let (mut triangles, corners) = (Vec::new(), [DVec3::X, DVec3::Y, DVec3::NEG_X, DVec3::NEG_Y]);
    for k in 0..4 {
        let (a, b) = (corners[k], corners[(k + 1) % 4]);
        triangles.extend([[a, b, DVec3::Z], [b, a, DVec3::NEG_Z]]);
    }
    for _ in 0..3 {
        triangles = triangles
            .into_iter()
            .flat_map(|[a, b, c]| {
                let [ab, bc, ca] = [a + b, b + c, c + a].map(DVec3::normalize);
                [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
            })
            .collect();
    }
    triangles
}

/// All meshes. The same every time.
fn meshes() -> Vec<Hard> {
    let noise = &mut noise(77);
    let needles = (0..150)
        .map(|_| {
            let (at, along) = (vector(noise), vector(noise).normalize());
            let across = along.any_orthonormal_vector() * 1e-6;
            [at, at + along, at + along * 0.5 + across]
        })
        .collect();
    let turn = DMat3::from_axis_angle(DVec3::new(1.0, 2.0, 3.0).normalize(), 0.7);
    let flat = |noise: &mut Noise| turn * DVec3::new(noise.number(), noise.number(), 0.25);
    let overlaps = (0..80).map(|_| [flat(noise), flat(noise), flat(noise)]).collect();
    let moved = |scale: f64, offset: f64| {
        ball().into_iter().map(|triangle| triangle.map(|corner| corner * scale + DVec3::splat(offset))).collect()
    };
    // Its root cube has an edge of 1, so that a voxel of the deepest level has 2^-7.
    let voxel = 0.5f64.powi(LEVELS as i32);
    let sheet = |z: f64| quad(DVec3::new(0.0, 0.0, z), DVec3::X, DVec3::Y);
    let sheets = [sheet(0.25), sheet(0.25 + voxel)].concat();
    let plates = (0..3)
        .flat_map(|axis| {
            let mut size = DVec3::ONE;
            size[axis] = 1e-7;
            cuboid(DVec3::ZERO.map(|x| x + 0.3 * axis as f64), size)
        })
        .collect();
    let all: [(&str, &str, Vec<[DVec3; 3]>); 8] = [
        ("needles", "triangles a million times as long as wide", needles),
        ("overlaps", "triangles on each other in one plane", overlaps),
        ("away", "a sphere of radius 1 at an offset of a million", moved(1.0, 1e6)),
        ("small", "a sphere of radius a millionth", moved(1e-6, 0.0)),
        ("large", "a sphere of radius a million", moved(1e6, 0.0)),
        ("sheets", "two parallel sheets one voxel apart, in faces of voxels", sheets),
        ("plates", "a plate per axis, thin as a ten-millionth", plates),
        ("box", "a box whose sides are in faces of voxels", cuboid(DVec3::ZERO, DVec3::ONE)),
    ];
    all.into_iter().map(|(name, about, triangles)| Hard { name, about, triangles }).collect()
}
