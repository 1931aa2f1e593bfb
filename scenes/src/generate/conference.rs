//! CONFERENCE: a meeting room with a long table.

use std::f64::consts::PI;

use esvo_builder::mesh::Mesh;
use glam::{DAffine3, DVec2, DVec3, dvec2, dvec3};

use super::numeric::{Rng, sin_cos, turn};
use super::shape::{Shapes, plane};

/// Triangles of [`conference`].
pub const CONFERENCE_TRIANGLES: usize = 283_000;

/// The room inside: x, y and z from zero to these.
const ROOM: DVec3 = DVec3::new(11.0, 2.8, 7.0);
/// Middle of the table.
const TABLE: DVec2 = DVec2::new(5.5, 3.5);

struct Palette {
    wall: u32,
    panel: u32,
    wood: u32,
    fabric: u32,
    plastic: u32,
    chrome: u32,
    white: u32,
    light: u32,
    paper: u32,
    carpet: [u32; 2],
}

/// Stands in for the conference room of Greg Ward and Anat Grynberg: 283,000 triangles, 30 chairs around a long table.
///
/// Units are metres, y is up. Extents: x -0.1..11.1, y -0.1..2.9, z -0.1..7.1; the floor is y = 0. Chairs of thin bars and
/// rounded cushions, ceiling lamps behind louvres, window blinds and ribbed panels of long slivers, papers and cups. A closed
/// room with a shell around it: from inside, every ray meets a surface.
pub fn conference(seed: u64) -> Mesh {
    let mut rng = Rng::new(seed);
    let mut s = Shapes::with_capacity(CONFERENCE_TRIANGLES);
    let p = Palette {
        wall: s.add_material("wall", [0.62, 0.60, 0.55]),
        panel: s.add_material("panel", [0.40, 0.33, 0.24]),
        wood: s.add_material("wood", [0.28, 0.15, 0.07]),
        fabric: s.add_material("fabric", [0.16, 0.18, 0.30]),
        plastic: s.add_material("plastic", [0.05, 0.05, 0.05]),
        chrome: s.add_material("chrome", [0.55, 0.56, 0.58]),
        white: s.add_material("white", [0.78, 0.78, 0.76]),
        light: s.add_material("light", [0.95, 0.93, 0.85]),
        paper: s.add_material("paper", [0.80, 0.79, 0.74]),
        carpet: [[0.20, 0.22, 0.25], [0.24, 0.25, 0.28]].map(|rgb| s.add_material("carpet", rgb)),
    };
    s.paint(p.wall);
    s.cuboid(DVec3::splat(-0.1), ROOM + DVec3::splat(0.1));
    s.room(DVec3::splat(-0.05), ROOM + DVec3::splat(0.05));
    walls(&mut s, &p);
    ceiling(&mut s, &p);
    table(&mut s, &mut rng, &p);
    for k in 0..30 {
        // Twelve along each side, one at each end, four by the wall.
        let (at, heading) = match k {
            0..12 => (dvec2(1.75 + 0.68 * k as f64, TABLE.y + 1.45), PI),
            12..24 => (dvec2(1.75 + 0.68 * (k - 12) as f64, TABLE.y - 1.45), 0.0),
            24 => (dvec2(0.85, TABLE.y), PI / 2.0),
            25 => (dvec2(10.15, TABLE.y), -PI / 2.0),
            _ => (dvec2(2.5 + 2.0 * (k - 26) as f64, 0.6), 0.0),
        };
        let heading = heading + rng.range(-0.35, 0.35);
        let (sin, cos) = sin_cos(heading);
        let x = dvec3(cos, 0.0, -sin);
        let z = dvec3(sin, 0.0, cos);
        s.frame = DAffine3::from_cols(x, DVec3::Y, z, dvec3(at.x + rng.range(-0.04, 0.04), 0.0, at.y));
        chair(&mut s, &p);
    }
    s.frame = DAffine3::IDENTITY;
    s.fill_grid(CONFERENCE_TRIANGLES, plane(dvec3(0.0, 0.0, ROOM.z), DVec3::X * ROOM.x, DVec3::Z * -ROOM.z), |i, j| {
        p.carpet[(i / 8 + j / 8) % 2]
    });
    s.finish()
}

/// Walls with ribbed panels, blinds before the windows, a door, a whiteboard and skirting.
fn walls(s: &mut Shapes, p: &Palette) {
    let up = DVec3::Y * ROOM.y;
    s.paint(p.wall);
    s.patch(22, 8, plane(DVec3::ZERO, DVec3::X * ROOM.x, up));
    s.patch(22, 8, plane(dvec3(ROOM.x, 0.0, ROOM.z), DVec3::X * -ROOM.x, up));
    s.patch(14, 8, plane(dvec3(0.0, 0.0, ROOM.z), DVec3::Z * -ROOM.z, up));
    s.patch(14, 8, plane(dvec3(ROOM.x, 0.0, 0.0), DVec3::Z * ROOM.z, up));
    s.paint(p.wood);
    for z in [0.012, ROOM.z - 0.012] {
        s.block(dvec3(ROOM.x / 2.0, 0.05, z), dvec3(ROOM.x, 0.1, 0.024));
    }
    for x in [0.012, ROOM.x - 0.012] {
        s.block(dvec3(x, 0.05, ROOM.z / 2.0), dvec3(0.024, 0.1, ROOM.z));
    }
    // Ribs on the wall x = 0: rods from floor to ceiling, two triangles per side over the whole height.
    s.paint(p.panel);
    for k in 0..110 {
        let z = 0.25 + k as f64 * 0.059;
        s.rod(dvec3(0.02, 0.1, z), dvec3(0.02, ROOM.y - 0.05, z), 0.018, 8, 1);
    }
    // Blinds at z = ROOM.z: curved slats, one cell long.
    for window in 0..4 {
        let x0 = 0.9 + window as f64 * 2.5;
        s.paint(p.light);
        s.block(dvec3(x0 + 0.95, 1.65, ROOM.z - 0.005), dvec3(1.9, 1.6, 0.01));
        s.paint(p.white);
        for k in 0..52 {
            let y = 0.9 + k as f64 * 0.029;
            let middle = dvec3(x0, y, ROOM.z - 0.06);
            // Two sheets, 0.8 mm apart: coincident ones would have no defined front.
            for face in [1.0, -1.0] {
                s.patch(1, 6, |u, v| {
                    let (sin, cos) = sin_cos(0.9 * (if face > 0.0 { v } else { 1.0 - v } - 0.5) + 0.4);
                    let n = dvec3(0.0, cos, -sin) * face;
                    (
                        middle
                            + dvec3(1.9 * u, 0.0, 0.0)
                            + dvec3(0.0, cos - 1.0, sin - 0.4) * 0.03 * dvec3(1.0, 1.0, -1.0)
                            + n * 0.0004,
                        n,
                    )
                });
            }
        }
        for cord in [0.2, 1.7] {
            s.rod(dvec3(x0 + cord, 0.85, ROOM.z - 0.06), dvec3(x0 + cord, 2.45, ROOM.z - 0.06), 0.002, 4, 1);
        }
        s.block(dvec3(x0 + 0.95, 2.47, ROOM.z - 0.06), dvec3(1.95, 0.05, 0.07));
    }
    // Door and whiteboard at x = ROOM.x, pictures at z = 0.
    s.paint(p.wood);
    s.block(dvec3(ROOM.x - 0.03, 1.05, 6.0), dvec3(0.06, 2.1, 0.95));
    s.paint(p.chrome);
    s.rod(dvec3(ROOM.x - 0.1, 1.02, 5.65), dvec3(ROOM.x - 0.1, 1.02, 5.78), 0.011, 10, 3);
    s.rod(dvec3(ROOM.x - 0.06, 1.02, 5.66), dvec3(ROOM.x - 0.1, 1.02, 5.66), 0.008, 8, 1);
    s.block(dvec3(ROOM.x - 0.02, 1.5, 2.6), dvec3(0.04, 1.3, 3.0));
    s.paint(p.white);
    s.block(dvec3(ROOM.x - 0.035, 1.5, 2.6), dvec3(0.03, 1.22, 2.92));
    for k in 0..5 {
        let x = 1.5 + 2.0 * k as f64;
        s.paint(p.wood);
        for (dy, dx, w, h) in
            [(0.36, 0.0, 1.06, 0.04), (-0.36, 0.0, 1.06, 0.04), (0.0, 0.51, 0.04, 0.7), (0.0, -0.51, 0.04, 0.7)]
        {
            s.block(dvec3(x + dx, 1.55 + dy, 0.02), dvec3(w, h, 0.04));
        }
        s.paint(p.paper);
        s.block(dvec3(x, 1.55, 0.008), dvec3(0.98, 0.68, 0.012));
    }
}

/// Ceiling tiles on a rail grid, and lamps behind louvres.
fn ceiling(s: &mut Shapes, p: &Palette) {
    s.paint(p.white);
    s.patch(44, 28, plane(dvec3(0.0, ROOM.y, 0.0), DVec3::X * ROOM.x, DVec3::Z * ROOM.z));
    s.paint(p.chrome);
    for k in 1..18 {
        let x = k as f64 * 0.61;
        s.block(dvec3(x, ROOM.y - 0.004, ROOM.z / 2.0), dvec3(0.02, 0.008, ROOM.z));
    }
    for k in 1..12 {
        let z = k as f64 * 0.59;
        s.block(dvec3(ROOM.x / 2.0, ROOM.y - 0.004, z), dvec3(ROOM.x, 0.007, 0.02));
    }
    for i in 0..4 {
        for j in 0..3 {
            let centre = dvec3(1.55 + 2.63 * i as f64, ROOM.y - 0.04, 1.3 + 2.2 * j as f64);
            s.paint(p.white);
            for (dx, dz, w, d) in
                [(0.0, 0.3, 1.24, 0.02), (0.0, -0.3, 1.24, 0.02), (0.61, 0.0, 0.02, 0.6), (-0.61, 0.0, 0.02, 0.6)]
            {
                s.block(centre + dvec3(dx, 0.0, dz), dvec3(w, 0.08, d));
            }
            s.paint(p.chrome);
            for k in 0..23 {
                s.block(centre + dvec3(-0.55 + 0.05 * k as f64, -0.015, 0.0), dvec3(0.002, 0.05, 0.58));
            }
            for k in 0..3 {
                s.block(centre + dvec3(0.0, -0.015, -0.15 + 0.15 * k as f64), dvec3(1.2, 0.045, 0.002));
            }
            s.paint(p.light);
            for dz in [-0.22, -0.075, 0.075, 0.22] {
                let end = dvec3(0.58, 0.025, 0.0);
                let middle = centre + dvec3(0.0, 0.0, dz);
                s.rod(middle + end * dvec3(-1.0, 1.0, 1.0), middle + end, 0.013, 12, 4);
            }
        }
    }
}

/// The table with its foot, and what lies on it.
fn table(s: &mut Shapes, rng: &mut Rng, p: &Palette) {
    const HEIGHT: f64 = 0.74;
    let middle = dvec3(TABLE.x, 0.0, TABLE.y);
    // A superellipse stretched to 8.6 x 2 metres; concentric rings over the top, round the edge and under it.
    let rings = [
        (0.0, HEIGHT),
        (0.35, HEIGHT),
        (0.7, HEIGHT),
        (0.965, HEIGHT),
        (0.985, HEIGHT - 0.003),
        (0.997, HEIGHT - 0.010),
        (1.0, HEIGHT - 0.02),
        (0.997, HEIGHT - 0.030),
        (0.985, HEIGHT - 0.037),
        (0.965, HEIGHT - 0.04),
        (0.0, HEIGHT - 0.04),
    ];
    const AROUND: usize = 160;
    let outline = |i: usize, k: f64| {
        let (sin, cos) = turn(i, AROUND);
        // |cos|^(1/2) rounds the corners of the rectangle; square roots are exact, powers are not.
        let round = |t: f64| t.signum() * t.abs().sqrt();
        dvec2(4.3 * round(cos), 1.0 * round(sin)) * k
    };
    s.paint(p.wood);
    for pair in rings.windows(2) {
        let ((k0, y0), (k1, y1)) = (pair[0], pair[1]);
        for i in 0..AROUND {
            let at = |i: usize, k: f64, y: f64| {
                let q = outline(i, k);
                middle + dvec3(q.x, y, q.y)
            };
            let (a, b) = (at(i, k0, y0), at(i + 1, k0, y0));
            let (c, d) = (at(i + 1, k1, y1), at(i, k1, y1));
            if k0 == 0.0 {
                s.triangle(a, c, d);
            } else if k1 == 0.0 {
                s.triangle(a, b, c);
            } else {
                s.quad(a, b, c, d);
            }
        }
    }
    for x in [-3.0, 0.0, 3.0] {
        s.cuboid(middle + dvec3(x - 0.06, 0.06, -0.5), middle + dvec3(x + 0.06, HEIGHT - 0.04, 0.5));
        s.cuboid(middle + dvec3(x - 0.15, 0.0, -0.7), middle + dvec3(x + 0.15, 0.06, 0.7));
    }
    s.block(middle + dvec3(0.0, 0.4, 0.0), dvec3(6.0, 0.3, 0.05));
    let cup = [
        (0.025, 0.0),
        (0.03, 0.005),
        (0.038, 0.05),
        (0.04, 0.09),
        (0.037, 0.09),
        (0.035, 0.05),
        (0.027, 0.008),
        (0.0, 0.008),
    ]
    .map(|(r, y)| dvec2(r, y));
    for k in 0..24 {
        let (x, side) = (-3.74 + 0.68 * (k % 12) as f64, if k < 12 { 1.0 } else { -1.0 });
        let at = middle + dvec3(x + rng.range(-0.1, 0.1), HEIGHT, side * rng.range(0.55, 0.7));
        let (sin, cos) = sin_cos(rng.range(-0.4, 0.4));
        s.frame = DAffine3::from_cols(dvec3(cos, 0.0, -sin), DVec3::Y, dvec3(sin, 0.0, cos), at);
        s.paint(p.paper);
        for sheet in 0..3 {
            let y = 0.0008 + 0.0012 * sheet as f64;
            s.block(dvec3(0.01 * sheet as f64, y, -0.008 * sheet as f64), dvec3(0.21, 0.0008, 0.297));
        }
        s.paint(p.plastic);
        s.rod(dvec3(0.14, 0.005, -0.07), dvec3(0.15, 0.005, 0.07), 0.004, 8, 3);
        s.paint(p.white);
        if rng.chance(0.7) {
            s.lathe(dvec3(-0.17, 0.0, -0.1), &cup, 24);
        }
    }
    s.frame = DAffine3::IDENTITY;
}

/// An office chair at the origin, facing +z: five-footed base, cushions, a back of thin bars, bent armrests.
fn chair(s: &mut Shapes, p: &Palette) {
    s.paint(p.chrome);
    for k in 0..5 {
        let (sin, cos) = turn(k, 5);
        let foot = dvec3(0.30 * cos, 0.075, 0.30 * sin);
        s.rod(dvec3(0.0, 0.12, 0.0), foot, 0.016, 8, 4);
        s.paint(p.plastic);
        s.ellipsoid(foot - DVec3::Y * 0.042, dvec3(0.033, 0.033, 0.033), 6, 10);
        s.paint(p.chrome);
    }
    let post = [(0.045, 0.08), (0.045, 0.16), (0.028, 0.17), (0.028, 0.38), (0.06, 0.40), (0.10, 0.42)]
        .map(|(r, y)| dvec2(r, y));
    s.lathe(DVec3::ZERO, &post, 16);
    s.paint(p.fabric);
    cushion(s, dvec3(0.0, 0.46, 0.02), dvec3(0.25, 0.045, 0.24));
    cushion(s, dvec3(0.0, 0.93, -0.27), dvec3(0.22, 0.07, 0.03));
    s.paint(p.chrome);
    // The back: a curved fan of bars from seat to headrest.
    for k in 0..11 {
        let t = k as f64 / 10.0 - 0.5;
        let points: Vec<DVec3> = (0..16)
            .map(|i| {
                let h = i as f64 / 15.0;
                dvec3(
                    0.40 * t * (0.8 + 0.2 * h),
                    0.45 + 0.46 * h,
                    -0.23 - 0.06 * h * h - 0.05 * (1.0 - 4.0 * t * t) * h,
                )
            })
            .collect();
        s.tube(&points, 6, |_| 0.0045);
    }
    for h in [0.3, 0.6] {
        let points: Vec<DVec3> = (0..16)
            .map(|i| {
                let t = i as f64 / 15.0 - 0.5;
                dvec3(
                    0.44 * t * (0.8 + 0.2 * h),
                    0.45 + 0.46 * h,
                    -0.235 - 0.06 * h * h - 0.05 * (1.0 - 4.0 * t * t) * h,
                )
            })
            .collect();
        s.tube(&points, 6, |_| 0.006);
    }
    for side in [-1.0, 1.0] {
        // Armrest: up from the seat, bent over half a turn's worth of corners, back to the chair's back.
        let points: Vec<DVec3> = (0..24)
            .map(|i| {
                let (sin, cos) = sin_cos(PI * i as f64 / 23.0);
                dvec3(side * (0.25 + 0.04 * sin), 0.45 + 0.22 * sin.sqrt(), 0.17 * cos)
            })
            .collect();
        s.paint(p.plastic);
        s.tube(&points, 8, |_| 0.013);
        s.paint(p.chrome);
    }
}

/// A pillow-shaped cushion with the given half sizes: an ellipsoid pushed towards a box.
fn cushion(s: &mut Shapes, centre: DVec3, half: DVec3) {
    const AROUND: usize = 24;
    const UP: usize = 12;
    // Below and above are closed by the patch running to a pole at either end.
    s.patch(AROUND, UP, |u, v| {
        let (sa, ca) = sin_cos(-2.0 * PI * u);
        let (sb, cb) = sin_cos(PI * (v - 0.5));
        let round = |t: f64| t.signum() * t.abs().sqrt();
        let flat = if v == 0.0 || v == 1.0 { 0.0 } else { round(cb) };
        let p = dvec3(round(ca) * flat, round(sb), round(sa) * flat);
        // The normal of a superellipsoid of exponent four is the cube of its position.
        (centre + p * half, p * p * p / half)
    });
}
