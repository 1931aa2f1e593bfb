//! Triangles and rays to test casters with, and the comparison of a GPU's hits with the exact caster's.

use esvo_core::exact::{CameraRays, ExactRay, TriangleHit};
use esvo_core::gpu::triangles::{Question, TriangleCaster};
use esvo_core::{Camera, CastError};
use glam::DVec3;

use super::TriangleScene;

/// Numbers in 0..1 from a seed (xorshift).
pub struct Random(pub u64);

impl Random {
    /// The next number.
    pub fn number(&mut self) -> f64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    /// A point of the cube `[-1, 1]³`.
    pub fn vector(&mut self) -> DVec3 {
        DVec3::new(self.number(), self.number(), self.number()) * 2.0 - 1.0
    }
}

/// Triangles of all shapes in a cube: regular ones, needles, slivers, triangles without area, and some twice.
pub fn mixed(random: &mut Random, count: usize) -> Vec<[[f64; 3]; 3]> {
    let mut triangles: Vec<[[f64; 3]; 3]> = Vec::new();
    for k in 0..count {
        let a = random.vector();
        let (long, short) = (random.vector() * 0.4, random.vector() * 0.3);
        let [b, c] = match k % 6 {
            0 | 1 => [a + long, a + short],
            2 => [a + long, a + long + short * 1e-7],
            3 => [a + long, a + long * 0.4 + short * 1e-9],
            4 => [a + long, a + long * 0.5],
            _ => {
                triangles.push(triangles[k / 2]);
                continue;
            }
        };
        triangles.push([a, b, c].map(Into::into));
    }
    triangles
}

/// An icosahedron, subdivided; closed.
pub fn sphere(subdivisions: u32) -> Vec<[[f64; 3]; 3]> {
    let g = (1.0 + 5f64.sqrt()) / 2.0;
    let mut corners = Vec::new();
    for (a, b) in [(-1.0, g), (1.0, g), (-1.0, -g), (1.0, -g)] {
        corners.push(DVec3::new(a, b, 0.0));
        corners.push(DVec3::new(0.0, a, b));
        corners.push(DVec3::new(b, 0.0, a));
    }
    let mut triangles = Vec::new();
    for i in 0..12 {
        for j in i + 1..12 {
            for k in j + 1..12 {
                let near = |a: usize, b: usize| (corners[a].distance(corners[b]) - 2.0).abs() < 1e-9;
                if near(i, j) && near(j, k) && near(k, i) {
                    triangles.push([corners[i], corners[j], corners[k]].map(DVec3::normalize));
                }
            }
        }
    }
    assert_eq!(triangles.len(), 20);
    for _ in 0..subdivisions {
        let parts = |[a, b, c]: [DVec3; 3]| {
            // The same bits from both sides of an edge.
            let middle = |p: DVec3, q: DVec3| (p + q).normalize();
            let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
            [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
        };
        triangles = triangles.into_iter().flat_map(parts).collect();
    }
    triangles.into_iter().map(|t| t.map(Into::into)).collect()
}

/// One that sees all of a unit sphere at the origin.
pub fn camera() -> Camera {
    Camera {
        eye: [0.1, -0.2, 3.0],
        forward: [0.02, 0.03, -1.0],
        up: [0.0, 1.0, 0.0],
        fov_degrees: 45.0,
        near: 0.01,
        far: 10.0,
    }
}

/// Rays of all kinds: through the cube, along axes, from far away.
pub fn ray(random: &mut Random, k: usize) -> ExactRay {
    let origin = random.vector() * if k.is_multiple_of(7) { 1e4 } else { 1.5 };
    let mut direction = if k.is_multiple_of(3) { random.vector() } else { random.vector() * 0.5 - origin };
    if k.is_multiple_of(5) {
        direction[k % 3] = 0.0;
    }
    if k.is_multiple_of(10) {
        direction[(k + 1) % 3] = -0.0;
    }
    ExactRay { origin, direction, t_min: 0.0, t_max: 4.0 }
}

/// A scene with what is cast at it.
pub struct Case {
    /// What it is.
    pub name: &'static str,
    /// The triangles.
    pub scene: TriangleScene,
    /// Pictures.
    pub pictures: Vec<CameraRays>,
    /// Single rays.
    pub rays: Vec<ExactRay>,
}

/// Rays from a point outside and one inside to corners, to points of edges, and to points beside them by almost nothing.
fn rays_to_edges(triangles: &[[[f64; 3]; 3]], from: [DVec3; 2], random: &mut Random) -> Vec<ExactRay> {
    let mut rays = Vec::new();
    for triangle in triangles.iter().step_by(triangles.len() / 150 + 1) {
        for (k, origin) in [0, 1, 2].into_iter().zip(from.into_iter().cycle()) {
            let (a, b) = (DVec3::from(triangle[k]), DVec3::from(triangle[(k + 1) % 3]));
            for at in [0.0, 0.5, random.number(), random.number() * 1e-9] {
                let direction = (a + (b - a) * at - origin) * (1.0 + random.number());
                rays.push(ExactRay { origin, direction, t_min: 0.0, t_max: 2.0 });
            }
        }
    }
    rays
}

/// Rays that end before, at and behind what others hit, as shadow rays do; and rays that start there.
fn shortened(scene: &TriangleScene, rays: &[ExactRay]) -> Vec<ExactRay> {
    let mut all = Vec::new();
    for ray in rays.iter().step_by(3) {
        let hit = scene.cast_exact_ray(ray);
        if !hit.is_miss() {
            all.extend([0.5, 0.9999999, 1.0, 1.0000001, 1.5].map(|part| ExactRay { t_max: hit.t * part, ..*ray }));
            all.extend([0.9999999, 1.0, 1.001].map(|part| ExactRay { t_min: hit.t * part, ..*ray }));
        }
    }
    all
}

/// A square of `2 n²` triangles at `z` = 0, whose corners lie at whole numbers.
fn grid(n: u32) -> Vec<[[f64; 3]; 3]> {
    let squares = (0..n * n).map(|i| (f64::from(i % n), f64::from(i / n)));
    let halves = squares.flat_map(|(x, y)| {
        let p = |dx: f64, dy: f64| [x + dx, y + dy, 0.0];
        [[p(0.0, 0.0), p(1.0, 0.0), p(1.0, 1.0)], [p(0.0, 0.0), p(1.0, 1.0), p(0.0, 1.0)]]
    });
    halves.collect()
}

/// Triangle soups, closed and flat meshes, triangles without area, in one place, far away, tiny and huge; each with several cameras
/// and rays, many of them along edges and through corners.
///
/// # Errors
/// None: the cameras and triangles are sound.
pub fn cases() -> Result<Vec<Case>, CastError> {
    let mut random = Random(5);
    let mut cases = Vec::new();
    let mut add = |name, triangles: Vec<[[f64; 3]; 3]>, size: f64, offset: DVec3| -> Result<(), CastError> {
        let moved = |p: [f64; 3]| (DVec3::from(p) * size + offset).into();
        let moved: Vec<[[f64; 3]; 3]> = triangles.iter().map(|t| t.map(moved)).collect();
        let placed =
            |ray: ExactRay| ExactRay { origin: ray.origin * size + offset, direction: ray.direction * size, ..ray };
        let scene = TriangleScene::new(moved)?;
        let from = [DVec3::new(0.1, -0.2, 3.0), DVec3::new(0.2, 0.1, -0.05)];
        let mut rays: Vec<ExactRay> = (0..1500).map(|k| ray(&mut random, k)).collect();
        rays.extend(rays_to_edges(&triangles, from, &mut random));
        let mut rays: Vec<ExactRay> = rays.into_iter().map(placed).collect();
        rays.extend(shortened(&scene, &rays));
        let camera = |eye: [f64; 3], forward: [f64; 3], fov_degrees: f64| Camera {
            eye: (DVec3::from(eye) * size + offset).into(),
            forward,
            up: [0.0, 1.0, 0.0],
            fov_degrees,
            near: 0.01 * size,
            far: 10.0 * size,
        };
        let cameras = [
            (camera([0.1, -0.2, 3.0], [0.02, 0.03, -1.0], 45.0), (97, 61)),
            (camera([0.2, 0.1, -0.05], [1.0, 0.3, 0.1], 90.0), (64, 48)),
            // Pixels of an even picture have rays to whole and half numbers of the grid.
            (camera([8.0, 8.0, 8.0], [0.0, 0.0, -1.0], 90.0), (64, 64)),
            (camera([0.0, 40.0, 0.0], [0.1, -1.0, 0.0], 10.0), (31, 70)),
        ];
        let pictures = cameras.iter().map(|(camera, size)| CameraRays::new(camera, *size)).collect::<Result<_, _>>()?;
        cases.push(Case { name, scene, pictures, rays });
        Ok(())
    };
    add("sphere", sphere(4), 1.0, DVec3::ZERO)?;
    add("mixed", mixed(&mut Random(7), 900), 1.0, DVec3::ZERO)?;
    add("mixed, far away", mixed(&mut Random(8), 400), 1.0, DVec3::new(1e6, -3e5, 7e4))?;
    add("mixed, tiny", mixed(&mut Random(9), 400), 1e-30, DVec3::ZERO)?;
    add("mixed, huge", mixed(&mut Random(10), 400), 1e30, DVec3::ZERO)?;
    add("grid", grid(16), 1.0, DVec3::ZERO)?;
    add("pile", vec![[[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, 0.0]]; 80], 1.0, DVec3::ZERO)?;
    add("one", vec![[[-1.0, -1.0, 0.1], [1.0, -1.0, -0.3], [0.0, 1.0, 0.2]]], 1.0, DVec3::ZERO)?;
    add(
        "without area",
        vec![[[0.5; 3]; 3], [[0.0; 3], [1.0; 3], [2.0; 3]], [[0.0; 3], [1.0; 3], [0.0; 3]]],
        1.0,
        DVec3::ZERO,
    )?;
    add("no triangles", Vec::new(), 1.0, DVec3::ZERO)?;
    Ok(cases)
}

/// How a GPU's hits compare with the exact caster's.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct Comparison {
    /// Rays of pictures and lists, closest and any.
    pub rays: usize,
    /// Of these, hits.
    pub hits: usize,
    /// Those that the processor decided.
    pub undecided: usize,
    /// Rays of pictures.
    pub pixels: usize,
    /// Of these, those that the processor decided.
    pub undecided_pixels: usize,
    /// Those with another triangle, another `t` or another answer.
    pub different: usize,
}

impl std::ops::AddAssign for Comparison {
    fn add_assign(&mut self, other: Self) {
        self.rays += other.rays;
        self.hits += other.hits;
        self.undecided += other.undecided;
        self.pixels += other.pixels;
        self.undecided_pixels += other.undecided_pixels;
        self.different += other.different;
    }
}

/// Casts everything of a case, and compares every bit.
///
/// # Errors
/// Those of the caster.
pub fn compare(caster: &mut dyn TriangleCaster, case: &Case) -> Result<Comparison, CastError> {
    let Case { scene, pictures, rays, .. } = case;
    caster.load(&scene.wide())?;
    let mut records = Vec::new();
    let mut all = Comparison::default();
    let same = |a: &TriangleHit, b: &TriangleHit| a.triangle == b.triangle && a.t.to_bits() == b.t.to_bits();
    let mut add = |found: &[TriangleHit], undecided: usize, exact: &[TriangleHit]| {
        all += Comparison {
            rays: exact.len(),
            hits: exact.iter().filter(|hit| !hit.is_miss()).count(),
            undecided,
            pixels: 0,
            undecided_pixels: 0,
            different: found.iter().zip(exact).filter(|(a, b)| !same(a, b)).count(),
        };
    };
    let mut undecided_pixels = 0;
    for picture in pictures {
        caster.cast(picture, &mut records)?;
        let found = scene.decide(picture, &records);
        undecided_pixels += found.undecided;
        add(&found.hits, found.undecided, &scene.cast_exact(picture));
    }
    caster.cast_rays(rays, Question::Closest, &mut records)?;
    let found = scene.decide_rays(rays, &records);
    let exact: Vec<TriangleHit> = rays.iter().map(|ray| scene.cast_exact_ray(ray)).collect();
    add(&found.hits, found.undecided, &exact);
    caster.cast_rays(rays, Question::Any, &mut records)?;
    let (any, undecided) = scene.decide_any(rays, &records);
    all.undecided_pixels = undecided_pixels;
    all.pixels = pictures.iter().map(CameraRays::pixels).sum();
    let different = any.iter().zip(&exact).filter(|(any, exact)| **any == exact.is_miss()).count();
    let hits = exact.iter().filter(|hit| !hit.is_miss()).count();
    all += Comparison { rays: rays.len(), hits, undecided, different, ..Comparison::default() };
    Ok(all)
}

/// Errors that a kernel may have: what each is, the kernel's text, and the wrong text. [`compare`] over [`cases`] finds every one.
pub const MISTAKES: [(&str, &str, &str); 5] = [
    ("boxes that are too small", "it.margin = reach", "it.margin = -0.0005 * reach"),
    ("the first hit instead of the closest", "} else if any_hit {", "} else if any_hit || found.triangle == MISS {"),
    ("whichever of two hits in the same place comes first", "if found.rival <= found.high {", "if false {"),
    ("edges as sharp as single precision has them", "let edge_error =", "let edge_error = 0.0 *"),
    (
        "hits beyond the ends of rays",
        "!meeting.certain || meeting.low < start_high || meeting.high > end_low",
        "!meeting.certain",
    ),
];
