//! FAIRY: a clearing in a forest with a small figure.

use std::f64::consts::PI;

use esvo_builder::mesh::Mesh;
use glam::{DAffine3, DMat3, DVec2, DVec3, dvec2, dvec3};

use super::numeric::{Rng, sin_cos, tangents, turn};
use super::shape::Shapes;
use super::small::icosphere;

/// Triangles of [`fairy`].
pub const FAIRY_TRIANGLES: usize = 174_000;

/// Half the side of the ground.
const GROUND: f64 = 6.0;
/// Triangles reserved for the ground.
const RESERVE: usize = 45_000;

struct Palette {
    ground: [u32; 3],
    bark: u32,
    leaf: [u32; 3],
    grass: u32,
    stone: u32,
    cap: u32,
    stem: u32,
    skin: u32,
    dress: u32,
    hair: u32,
    wing: u32,
}

/// Stands in for the fairy forest of the Utah 3D Animation Repository: 174,000 triangles (the paper counts 93K in its copy).
///
/// Units: the figure is one unit tall, y is up. Extents: x and z about -6.5..6.5, y about -0.5..5.5. Rolling ground, ten trees
/// with trunks, roots, branches and two-triangle leaf cards, grass blades, mushrooms, stones, and a winged figure with
/// fingers on a stone in the middle. Open to the sky: rays that go up miss.
pub fn fairy(seed: u64) -> Mesh {
    let mut rng = Rng::new(seed);
    let mut s = Shapes::with_capacity(FAIRY_TRIANGLES);
    let p = Palette {
        ground: [[0.13, 0.16, 0.05], [0.17, 0.14, 0.07], [0.10, 0.13, 0.04]].map(|rgb| s.add_material("ground", rgb)),
        bark: s.add_material("bark", [0.16, 0.10, 0.06]),
        leaf: [[0.12, 0.30, 0.05], [0.20, 0.36, 0.07], [0.08, 0.22, 0.06]].map(|rgb| s.add_material("leaf", rgb)),
        grass: s.add_material("grass", [0.18, 0.34, 0.07]),
        stone: s.add_material("stone", [0.32, 0.31, 0.29]),
        cap: s.add_material("mushroom cap", [0.55, 0.06, 0.04]),
        stem: s.add_material("mushroom stem", [0.70, 0.64, 0.52]),
        skin: s.add_material("skin", [0.66, 0.44, 0.34]),
        dress: s.add_material("dress", [0.24, 0.42, 0.20]),
        hair: s.add_material("hair", [0.40, 0.22, 0.08]),
        wing: s.add_material("wing", [0.55, 0.62, 0.72]),
    };
    figure(&mut s, &p);
    for k in 0..10 {
        let (sin, cos) = sin_cos(2.0 * PI * (k as f64 + rng.range(-0.25, 0.25)) / 10.0);
        let distance = rng.range(3.0, 5.0);
        tree(&mut s, &mut rng, &p, dvec2(cos, sin) * distance);
    }
    for k in 0..30 {
        let at = scattered(&mut rng);
        if k % 2 == 0 {
            mushroom(&mut s, &mut rng, &p, at);
        } else {
            stone(&mut s, &mut rng, &p, at, 0.1);
        }
    }
    s.paint(p.grass);
    while s.count() + 14 + RESERVE <= FAIRY_TRIANGLES {
        let at = scattered(&mut rng);
        blade(&mut s, &mut rng, at);
    }
    s.fill_grid(
        FAIRY_TRIANGLES,
        |u, v| {
            let at = dvec2((2.0 * u - 1.0) * GROUND, (1.0 - 2.0 * v) * GROUND);
            let e = 1e-3;
            let slope = |d: DVec2| (height(at + d) - height(at - d)) / (2.0 * e);
            (on_ground(at), dvec3(-slope(dvec2(e, 0.0)), 1.0, -slope(dvec2(0.0, e))))
        },
        |i, j| p.ground[(i / 5 * 7 + j / 4 * 3 + (i / 5) * (j / 4)) % 3],
    );
    s.finish()
}

/// Height of the ground: a bowl with hills, flat in the middle.
fn height(at: DVec2) -> f64 {
    let waves = sin_cos(1.3 * at.x + 0.4).0 * sin_cos(1.1 * at.y + 1.9).0 * 0.25
        + sin_cos(2.9 * at.x + 1.1 * at.y).0 * 0.06
        + sin_cos(9.0 * at.x - 7.0 * at.y).0 * 0.012
        + sin_cos(11.0 * at.y + 5.0 * at.x).0 * 0.010;
    let rim = at.length_squared() / (GROUND * GROUND);
    waves * rim.min(1.0) + 0.25 * rim * rim
}

fn on_ground(at: DVec2) -> DVec3 {
    dvec3(at.x, height(at), at.y)
}

/// A place on the ground, more often near the middle.
fn scattered(rng: &mut Rng) -> DVec2 {
    let direction = rng.direction();
    let flat = dvec2(direction.x, direction.z).normalize_or(DVec2::X);
    let farthest = 0.6 + 5.2 * rng.unit();
    flat * rng.range(0.45, farthest)
}

/// A trunk with roots, eight branches and 480 leaf cards.
fn tree(s: &mut Shapes, rng: &mut Rng, p: &Palette, at: DVec2) {
    let foot = on_ground(at) - DVec3::Y * 0.15;
    let tall = rng.range(3.6, 4.8);
    let lean = dvec3(rng.range(-0.3, 0.3), 0.0, rng.range(-0.3, 0.3));
    let thick = rng.range(0.16, 0.26);
    s.paint(p.bark);
    let trunk: Vec<DVec3> = (0..22)
        .map(|i| {
            let t = i as f64 / 21.0;
            foot + DVec3::Y * (tall * t)
                + lean * t * t
                + dvec3(sin_cos(7.0 * t).0, 0.0, sin_cos(5.0 * t + 1.0).0) * 0.05
        })
        .collect();
    s.tube(&trunk, 16, |i| {
        let t = i as f64 / 21.0;
        thick * (1.0 - 0.75 * t) + 0.12 * (1.0 - t) * (1.0 - t) * (1.0 - t) * (1.0 - t)
    });
    for k in 0..5 {
        let (sin, cos) = turn(k, 5);
        let out = dvec3(cos, 0.0, sin);
        let root: Vec<DVec3> = (0..9)
            .map(|i| {
                let t = i as f64 / 8.0;
                let q = foot + out * (0.1 + 0.75 * t);
                dvec3(q.x, height(dvec2(q.x, q.z)) + 0.10 * (1.0 - t) * (1.0 - t) - 0.06 * t, q.z)
            })
            .collect();
        s.tube(&root, 8, |i| 0.09 * (1.0 - 0.1 * i as f64));
    }
    for k in 0..8 {
        let start = trunk[9 + k + k / 3];
        let (sin, cos) = sin_cos(2.4 * k as f64 + rng.range(-0.3, 0.3));
        let out = dvec3(cos, rng.range(0.2, 0.7), sin).normalize();
        let reach = rng.range(0.8, 1.35);
        let branch: Vec<DVec3> = (0..10)
            .map(|i| {
                let t = i as f64 / 9.0;
                start
                    + out * (reach * t)
                    + DVec3::Y * (0.3 * t * t)
                    + dvec3(sin_cos(6.0 * t + k as f64).0, 0.0, 0.0) * 0.05
            })
            .collect();
        s.paint(p.bark);
        s.tube(&branch, 8, |i| 0.055 * (1.0 - 0.09 * i as f64));
        for _ in 0..60 {
            let on = branch[4 + rng.below(6)];
            s.paint(p.leaf[rng.below(3)]);
            let size = rng.range(0.05, 0.13);
            let n = (rng.direction() + DVec3::Y).normalize_or(DVec3::Y);
            let (a, b) = tangents(n);
            let (sin, cos) = sin_cos(rng.range(0.0, 2.0 * PI));
            let (a, b) = ((a * cos + b * sin) * size, (b * cos - a * sin) * size * 0.6);
            let c = on + rng.direction() * rng.range(0.0, 0.42);
            s.quad(c - a, c - b, c + a, c + b);
        }
    }
}

/// A bent blade of grass: a strip that ends in a point, eight triangles.
fn blade(s: &mut Shapes, rng: &mut Rng, at: DVec2) {
    let foot = on_ground(at) - DVec3::Y * 0.01;
    let (sin, cos) = sin_cos(rng.range(0.0, 2.0 * PI));
    let side = dvec3(cos, 0.0, sin);
    let bend = dvec3(-sin, 0.0, cos) * rng.range(0.02, 0.1);
    let (tall, wide) = (rng.range(0.08, 0.24), rng.range(0.004, 0.009));
    let at = |t: f64, w: f64| foot + DVec3::Y * (tall * t) + bend * (t * t) + side * (w * wide);
    for k in 0..3 {
        let (t, u) = (k as f64 * 0.25, (k + 1) as f64 * 0.25);
        s.quad(at(t, -1.0 + t), at(t, 1.0 - t), at(u, 1.0 - u), at(u, -1.0 + u));
    }
    // The point is split down the middle, which keeps the scene's count of triangles even.
    s.triangle(at(0.75, -0.25), at(0.75, 0.0), at(1.0, 0.0));
    s.triangle(at(0.75, 0.0), at(0.75, 0.25), at(1.0, 0.0));
}

fn mushroom(s: &mut Shapes, rng: &mut Rng, p: &Palette, at: DVec2) {
    let size = rng.range(0.12, 0.4);
    let foot = on_ground(at) - DVec3::Y * 0.02;
    s.paint(p.stem);
    let stem: Vec<DVec2> = (0..8)
        .map(|k| {
            let t = k as f64 / 7.0;
            dvec2(size * (0.16 + 0.08 * (1.0 - t) * (1.0 - t)), size * t)
        })
        .collect();
    s.lathe(foot, &stem, 20);
    s.paint(p.cap);
    let cap: Vec<DVec2> = (0..12)
        .map(|k| {
            let (sin, cos) = sin_cos(PI / 2.0 * k as f64 / 11.0);
            dvec2(if k == 11 { 0.0 } else { size * 0.55 * cos }, size * (0.85 + 0.45 * sin))
        })
        .collect();
    s.lathe(foot, &cap, 28);
    s.paint(p.stem);
    s.lathe(foot, &[dvec2(0.0, size * 0.95), dvec2(size * 0.3, size * 0.93), dvec2(size * 0.55, size * 0.85)], 28);
}

fn stone(s: &mut Shapes, rng: &mut Rng, p: &Palette, at: DVec2, size: f64) {
    let centre = on_ground(at);
    let radii = dvec3(rng.range(0.8, 2.0), rng.range(0.5, 1.2), rng.range(0.8, 2.0)) * size;
    let phase = rng.range(0.0, 6.0);
    s.paint(p.stone);
    icosphere(s, 3, |d| {
        let bump = sin_cos(4.0 * d.x + phase).0 + sin_cos(5.0 * d.y - phase).0 + sin_cos(4.5 * d.z + 2.0 * phase).0;
        centre + d * radii * (1.0 + 0.07 * bump)
    });
}

/// A winged figure sitting in the middle, one unit tall, facing +z, its right hand stretched out.
fn figure(s: &mut Shapes, p: &Palette) {
    s.paint(p.stone);
    icosphere(s, 4, |d| {
        let bump = sin_cos(5.0 * d.x).0 * sin_cos(4.0 * d.z + 1.0).0;
        dvec3(0.0, 0.1, 0.0) + d * dvec3(0.42, 0.22, 0.36) * (1.0 + 0.06 * bump)
    });
    s.frame = DAffine3::from_mat3_translation(DMat3::IDENTITY, dvec3(0.0, 0.28, 0.0));
    s.paint(p.dress);
    let dress: Vec<DVec2> = (0..24)
        .map(|k| {
            let t = k as f64 / 23.0;
            dvec2(0.06 + 0.20 * (1.0 - t) * (1.0 - t) + 0.03 * sin_cos(PI * t).0, 0.5 * t)
        })
        .collect();
    s.lathe(DVec3::ZERO, &dress, 40);
    s.paint(p.skin);
    s.ellipsoid(dvec3(0.0, 0.63, 0.0), dvec3(0.085, 0.105, 0.09), 20, 32);
    s.rod(dvec3(0.0, 0.47, 0.0), dvec3(0.0, 0.56, 0.0), 0.035, 16, 4);
    for side in [-1.0, 1.0] {
        let shoulder = dvec3(0.07 * side, 0.46, 0.0);
        let elbow = dvec3(0.20 * side, 0.34, 0.06);
        let wrist = if side < 0.0 { dvec3(-0.22, 0.40, 0.26) } else { dvec3(0.12, 0.20, 0.18) };
        limb(s, &[shoulder, elbow, wrist], 0.030, 0.016);
        hand(s, wrist, (wrist - elbow).normalize());
        limb(
            s,
            &[dvec3(0.06 * side, 0.05, 0.1), dvec3(0.09 * side, 0.08, 0.34), dvec3(0.09 * side, -0.22, 0.40)],
            0.045,
            0.02,
        );
        s.ellipsoid(dvec3(0.09 * side, -0.23, 0.44), dvec3(0.025, 0.02, 0.06), 8, 14);
    }
    s.paint(p.hair);
    for k in 0..90 {
        let (sin, cos) = sin_cos(PI * (1.0 + k as f64 / 89.0) + 0.02 * (k % 7) as f64);
        let lock: Vec<DVec3> = (0..10)
            .map(|i| {
                let t = i as f64 / 9.0;
                let r = 0.09 + 0.05 * t;
                dvec3(
                    cos * r * (0.3 + 0.9 * t.sqrt()),
                    0.74 - 0.42 * t * t - 0.002 * (k % 5) as f64,
                    sin * r * t.sqrt(),
                )
            })
            .collect();
        s.tube(&lock, 4, |i| 0.007 * (1.0 - 0.08 * i as f64));
    }
    // Wings: two sheets each, so thin that a voxel holds both sides.
    s.paint(p.wing);
    for side in [-1.0, 1.0] {
        for face in [1.0, -1.0] {
            s.patch(24, 16, |u, v| {
                let w = if face * side > 0.0 { v } else { 1.0 - v };
                let (sin, cos) = sin_cos(PI * (w - 0.35));
                let r = u * (0.45 + 0.12 * sin_cos(3.0 * PI * w).0);
                let q = dvec3(
                    side * (0.03 + r * cos.abs()),
                    0.42 + r * sin,
                    -0.06 - 0.25 * r + 0.02 * sin_cos(9.0 * w).0 * u,
                );
                (q + DVec3::Z * (0.0008 * face), DVec3::Z * face)
            });
        }
    }
    s.frame = DAffine3::IDENTITY;
}

/// A tapering limb through joints, rounded by a quadratic curve at the middle one.
fn limb(s: &mut Shapes, [a, b, c]: &[DVec3; 3], thick: f64, thin: f64) {
    let points: Vec<DVec3> = (0..18)
        .map(|i| {
            let t = i as f64 / 17.0;
            // Half way between the bent line and its smooth curve.
            let curve = *a * ((1.0 - t) * (1.0 - t)) + *b * (2.0 * t * (1.0 - t)) + *c * (t * t);
            let line = if t < 0.5 { a.lerp(*b, 2.0 * t) } else { b.lerp(*c, 2.0 * t - 1.0) };
            (curve + line) * 0.5
        })
        .collect();
    s.tube(&points, 14, |i| thick + (thin - thick) * i as f64 / 17.0);
}

/// A palm and five curved fingers: the paper shows its contours on a close view of the fairy's hand.
fn hand(s: &mut Shapes, wrist: DVec3, ahead: DVec3) {
    let (across, up) = tangents(ahead);
    s.ellipsoid(wrist + ahead * 0.028, dvec3(0.020, 0.014, 0.026), 12, 18);
    for k in 0..5 {
        let spread = k as f64 - 2.0;
        let root = wrist + ahead * (if k == 0 { 0.012 } else { 0.042 }) + across * (0.0075 * spread);
        let aim = (ahead + across * (0.14 * spread)).normalize();
        let length = [0.034, 0.046, 0.052, 0.048, 0.036][k];
        let finger: Vec<DVec3> = (0..14)
            .map(|i| {
                let t = i as f64 / 13.0;
                root + aim * (length * t) - up * (0.014 * t * t)
            })
            .collect();
        s.tube(&finger, 10, |i| 0.0048 * (1.0 - 0.02 * i as f64));
    }
}
