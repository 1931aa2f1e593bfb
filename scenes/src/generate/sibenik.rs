//! SIBENIK: the nave of a church.

use std::f64::consts::PI;

use esvo_builder::mesh::Mesh;
use glam::{DVec2, DVec3, dvec2, dvec3};

use super::numeric::{Rng, sin_cos};
use super::shape::{Shapes, plane};

/// Triangles of [`sibenik`].
pub const SIBENIK_TRIANGLES: usize = 77_000;

/// Half the length of the nave, inside.
const LENGTH: f64 = 20.0;
/// Half the width over nave and aisles, inside.
const WIDTH: f64 = 8.5;
/// z of the middle of the arcades.
const ARCADE: f64 = 4.2;
/// Half the thickness of the arcade walls.
const THICK: f64 = 0.35;
/// Bays along the nave.
const BAYS: usize = 8;
/// Length of a bay.
const BAY: f64 = 2.0 * LENGTH / BAYS as f64;
/// Where arches spring, and the radius of the arcade's arches.
const SPRING: f64 = 4.4;
const ARCH: f64 = 1.95;
/// Where the nave's vault springs, and the height over it of its crown.
const VAULT: f64 = 11.0;
/// Where the aisles' vaults begin.
const AISLE: f64 = 7.2;

/// Stands in for the Sibenik cathedral: 77,000 triangles, a barrel-vaulted nave with two aisles.
///
/// Units are metres, y is up. Extents: x -20.8..20.8 (along the nave), y -0.5..16, z -9..9; the floor is y = 0. Two
/// arcades of moulded columns and round arches, coffered vault with ribs, windows in niches, an apse behind five steps, an
/// altar, pews and candlesticks. An outer shell closes it: from inside, every ray meets a surface.
pub fn sibenik(seed: u64) -> Mesh {
    let mut rng = Rng::new(seed);
    let mut s = Shapes::with_capacity(SIBENIK_TRIANGLES);
    let stone = s.add_material("stone", [0.50, 0.46, 0.38]);
    let pale = s.add_material("pale stone", [0.62, 0.58, 0.50]);
    let marble = s.add_material("red marble", [0.38, 0.20, 0.16]);
    let glass = s.add_material("glass", [0.20, 0.30, 0.48]);
    let wood = s.add_material("wood", [0.20, 0.11, 0.05]);
    let gold = s.add_material("gold", [0.60, 0.44, 0.12]);
    let dark = s.add_material("dark tile", [0.20, 0.18, 0.17]);

    // The shell, seen from outside and from inside.
    s.paint(stone);
    let (low, high) = (dvec3(-LENGTH - 0.8, -0.5, -WIDTH - 0.5), dvec3(LENGTH + 0.8, 16.0, WIDTH + 0.5));
    s.cuboid(low, high);
    s.room(low + DVec3::splat(0.05), high - DVec3::splat(0.05));

    for side in [-1.0, 1.0] {
        arcade(&mut s, side, stone, pale, marble);
        aisle(&mut s, side, stone, pale, glass);
        clerestory(&mut s, side, stone, pale, glass);
    }
    vault(&mut s, stone, pale);
    for end in [-1.0, 1.0] {
        // End walls from the floor to above the vault. Above the vault they lie inside the shell and are not visible.
        s.paint(stone);
        let x = LENGTH * end;
        let wall = plane(dvec3(x, 0.0, -WIDTH * end), dvec3(0.0, 0.0, 2.0 * WIDTH * end), DVec3::Y * 15.5);
        s.patch(16, 16, wall);
    }
    rose(&mut s, glass, pale);
    choir(&mut s, pale, marble, gold, stone);
    pews(&mut s, &mut rng, wood);
    s.paint(wood);
    s.block(dvec3(-LENGTH + 0.15, 1.9, 0.0), dvec3(0.3, 3.8, 2.6));

    // Two colours of tiles, five to a metre or so.
    s.fill_grid(
        SIBENIK_TRIANGLES,
        plane(dvec3(-LENGTH, 0.0, WIDTH), DVec3::X * 2.0 * LENGTH, DVec3::Z * -2.0 * WIDTH),
        |i, j| if (i + j) % 2 == 0 { dark } else { marble },
    );
    s.finish()
}

/// A moulded column as a profile of (radius, height): plinth, base rolls, shaft with a slight swell, capital.
fn column_profile(height: f64) -> Vec<DVec2> {
    let mut profile = vec![dvec2(0.62, 0.0), dvec2(0.62, 0.22)];
    let mut roll = |y: f64, r: f64, size: f64| {
        for k in 0..=4 {
            let (sin, cos) = sin_cos(PI * (k as f64 / 4.0 - 0.5));
            profile.push(dvec2(r + size * cos, y + size * (1.0 + sin)));
        }
    };
    roll(0.22, 0.50, 0.10);
    roll(0.44, 0.46, 0.06);
    for k in 0..=8 {
        let t = k as f64 / 8.0;
        profile.push(dvec2(0.44 - 0.06 * t * t, 0.6 + (height - 1.5) * t));
    }
    for k in 1..=5 {
        let t = k as f64 / 5.0;
        profile.push(dvec2(0.38 + 0.26 * t * t, height - 0.9 + 0.7 * t));
    }
    profile.extend([dvec2(0.68, height - 0.2), dvec2(0.68, height), dvec2(0.0, height)]);
    profile
}

/// Columns, arches and the wall above them on one side of the nave.
fn arcade(s: &mut Shapes, side: f64, stone: u32, pale: u32, marble: u32) {
    let z = ARCADE * side;
    let profile = column_profile(SPRING);
    for k in 0..=BAYS {
        s.paint(if k % 2 == 0 { pale } else { marble });
        s.lathe(dvec3(-LENGTH + k as f64 * BAY, 0.0, z), &profile, 20);
    }
    const PIECES: usize = 16;
    for k in 0..BAYS {
        let middle = -LENGTH + (k as f64 + 0.5) * BAY;
        let arch = |i: usize, extra: f64| {
            let (sin, cos) = sin_cos(PI * (1.0 - i as f64 / PIECES as f64));
            dvec2(middle + (ARCH + extra) * cos, SPRING + (ARCH + extra) * sin)
        };
        let at = |p: DVec2, z: f64| dvec3(p.x, p.y, z);
        for i in 0..PIECES {
            let (p, q) = (arch(i, 0.0), arch(i + 1, 0.0));
            // The underside of the arch.
            s.paint(pale);
            s.quad(at(p, z + THICK), at(p, z - THICK), at(q, z - THICK), at(q, z + THICK));
            for face in [-1.0, 1.0] {
                let zf = z + THICK * face;
                // The wall over the arch, up to the aisle's vault and a little more.
                let (top_p, top_q) = (dvec2(p.x, AISLE + 1.3), dvec2(q.x, AISLE + 1.3));
                s.paint(stone);
                let corners = [at(p, zf), at(q, zf), at(top_q, zf), at(top_p, zf)];
                one_side(s, corners, face);
                // A projecting band that follows the arch.
                s.paint(pale);
                let (po, qo) = (arch(i, 0.22), arch(i + 1, 0.22));
                let zo = zf + 0.06 * face;
                one_side(s, [at(p, zo), at(q, zo), at(qo, zo), at(po, zo)], face);
                one_side(s, [at(po, zo), at(qo, zo), at(qo, zf), at(po, zf)], face);
            }
        }
        for face in [-1.0, 1.0] {
            let zf = z + THICK * face;
            s.paint(stone);
            // The piers between neighbouring arches, half a pier to each side of the bay.
            for (x0, x1) in [(middle - BAY / 2.0, middle - ARCH), (middle + ARCH, middle + BAY / 2.0)] {
                let corners = [
                    dvec3(x0, SPRING, zf),
                    dvec3(x1, SPRING, zf),
                    dvec3(x1, AISLE + 1.3, zf),
                    dvec3(x0, AISLE + 1.3, zf),
                ];
                one_side(s, corners, face);
            }
        }
        s.paint(pale);
        for (x0, x1) in [(middle - BAY / 2.0, middle - ARCH), (middle + ARCH, middle + BAY / 2.0)] {
            s.quad(
                dvec3(x0, SPRING, z - THICK),
                dvec3(x1, SPRING, z - THICK),
                dvec3(x1, SPRING, z + THICK),
                dvec3(x0, SPRING, z + THICK),
            );
        }
    }
}

/// A quad given counter-clockwise as seen from +z; `face` = -1 turns it to be seen from -z.
fn one_side(s: &mut Shapes, [a, b, c, d]: [DVec3; 4], face: f64) {
    if face > 0.0 { s.quad(a, b, c, d) } else { s.quad(d, c, b, a) }
}

/// Outer wall with niched windows and the vault of one aisle.
fn aisle(s: &mut Shapes, side: f64, stone: u32, pale: u32, glass: u32) {
    // The vault: a quarter turn from the wall up to the arcade, rippled by ribs at the bays.
    let (z0, z1) = (WIDTH * side, (ARCADE + THICK) * side);
    s.paint(stone);
    let surface = |u: f64, v: f64| {
        let x = -LENGTH + 2.0 * LENGTH * u;
        let (sin, cos) = sin_cos(PI * v);
        let z = z0 + (z1 - z0) * v;
        let rise = 1.4 * sin + 0.05 * sin_cos(2.0 * PI * u * BAYS as f64).1 * sin;
        (dvec3(x, AISLE - 0.6 + rise, z), dvec3(0.0, -sin - 0.2, -side * cos * 0.8))
    };
    // Both aisles look down into the church; the parameters run so that the front is the underside.
    if side > 0.0 {
        s.patch(64, 12, |u, v| surface(1.0 - u, v));
    } else {
        s.patch(64, 12, surface);
    }
    for k in 0..BAYS {
        niche(s, -LENGTH + (k as f64 + 0.5) * BAY, 1.6, 5.4, BAY, (0.0, AISLE), z0, side, [stone, pale, glass]);
    }
}

/// The wall between the aisle roofs and the vault, with windows.
fn clerestory(s: &mut Shapes, side: f64, stone: u32, pale: u32, glass: u32) {
    let z = (ARCADE - THICK) * side;
    for k in 0..BAYS {
        let x = -LENGTH + (k as f64 + 0.5) * BAY;
        niche(s, x, AISLE + 1.9, VAULT - 0.5, BAY, (AISLE + 1.3, VAULT), z, side, [stone, pale, glass]);
    }
    // A cornice along the whole nave where the vault springs.
    s.paint(pale);
    for k in 0..3 {
        let (y, out) = (VAULT - 0.12 + 0.09 * k as f64, 0.12 + 0.07 * k as f64);
        s.block(dvec3(0.0, y, z - side * out / 2.0), dvec3(2.0 * LENGTH, 0.09, out));
    }
}

/// One bay of wall with a round-headed window in a sloping niche. The wall is at `z`, the church on the side of zero.
#[allow(clippy::too_many_arguments, reason = "measures of one window")]
fn niche(
    s: &mut Shapes,
    x: f64,
    sill: f64,
    top: f64,
    width: f64,
    (bottom, up_to): (f64, f64),
    z: f64,
    side: f64,
    [stone, pale, glass]: [u32; 3],
) {
    const PIECES: usize = 12;
    let (outer, inner) = (1.0, 0.62);
    let spring = top - outer;
    // Outline of the opening, from the left foot over the arch to the right foot.
    let outline = |r: f64, i: usize, low: f64| {
        if i == 0 {
            return dvec2(x - r, low);
        }
        if i == PIECES + 2 {
            return dvec2(x + r, low);
        }
        let (sin, cos) = sin_cos(PI * (1.0 - (i - 1) as f64 / PIECES as f64));
        dvec2(x + r * cos, spring + r * sin)
    };
    let at = |p: DVec2, z: f64| dvec3(p.x, p.y, z);
    let deep = z + 0.4 * side;
    let flat = |s: &mut Shapes, q: [DVec3; 4]| one_side(s, q, -side);
    s.paint(stone);
    let (l, r) = (x - width / 2.0, x + width / 2.0);
    flat(s, [dvec3(l, bottom, z), dvec3(r, bottom, z), dvec3(r, sill, z), dvec3(l, sill, z)]);
    flat(s, [dvec3(l, sill, z), dvec3(x - outer, sill, z), dvec3(x - outer, up_to, z), dvec3(l, up_to, z)]);
    flat(s, [dvec3(x + outer, sill, z), dvec3(r, sill, z), dvec3(r, up_to, z), dvec3(x + outer, up_to, z)]);
    for i in 1..PIECES + 1 {
        let (p, q) = (outline(outer, i, sill), outline(outer, i + 1, sill));
        flat(s, [at(p, z), at(q, z), dvec3(q.x, up_to, z), dvec3(p.x, up_to, z)]);
    }
    for i in 0..PIECES + 2 {
        let (p, q) = (outline(outer, i, sill), outline(outer, i + 1, sill));
        let (pi, qi) = (outline(inner, i, sill + 0.3), outline(inner, i + 1, sill + 0.3));
        s.paint(pale);
        flat(s, [at(pi, deep), at(qi, deep), at(q, z), at(p, z)]);
        s.paint(glass);
        let (a, b, c) = (at(pi, deep), at(qi, deep), dvec3(x, spring, deep));
        if side < 0.0 { s.triangle(c, b, a) } else { s.triangle(a, b, c) }
    }
    s.paint(pale);
    flat(
        s,
        [
            dvec3(x - outer, sill, z),
            dvec3(x + outer, sill, z),
            dvec3(x + inner, sill + 0.3, deep),
            dvec3(x - inner, sill + 0.3, deep),
        ],
    );
    s.paint(glass);
    let (a, b, c) = (dvec3(x - inner, sill + 0.3, deep), dvec3(x + inner, sill + 0.3, deep), dvec3(x, spring, deep));
    if side < 0.0 { s.triangle(a, b, c) } else { s.triangle(b, a, c) }
}

/// The barrel vault of the nave: coffers between transverse ribs.
fn vault(s: &mut Shapes, stone: u32, pale: u32) {
    let radius = ARCADE - THICK;
    let at = |x: f64, angle: f64, inset: f64| {
        let (sin, cos) = sin_cos(angle);
        dvec3(x, VAULT + (radius + inset) * sin, (radius + inset) * cos)
    };
    const ACROSS: usize = 14;
    const ALONG: usize = 4 * BAYS;
    for j in 0..ACROSS {
        for i in 0..ALONG {
            let (x0, x1) = (-LENGTH + i as f64 * BAY / 4.0, -LENGTH + (i + 1) as f64 * BAY / 4.0);
            let (a0, a1) = (PI * j as f64 / ACROSS as f64, PI * (j + 1) as f64 / ACROSS as f64);
            let (dx, da) = ((x1 - x0) * 0.18, (a1 - a0) * 0.18);
            let ring = |k: f64, inset: f64| {
                [
                    at(x0 + dx * k, a0 + da * k, inset),
                    at(x0 + dx * k, a1 - da * k, inset),
                    at(x1 - dx * k, a1 - da * k, inset),
                    at(x1 - dx * k, a0 + da * k, inset),
                ]
            };
            let rings = [ring(0.0, 0.0), ring(1.0, 0.0), ring(1.0, 0.18), ring(1.6, 0.18), ring(1.6, 0.26)];
            for (level, pair) in rings.windows(2).enumerate() {
                s.paint(if level == 1 { pale } else { stone });
                for k in 0..4 {
                    let l = (k + 1) % 4;
                    s.quad(pair[0][k], pair[0][l], pair[1][l], pair[1][k]);
                }
            }
            s.paint(pale);
            let [a, b, c, d] = rings[4];
            s.quad(a, b, c, d);
        }
    }
    // Ribs: half rings with a round underside.
    s.paint(pale);
    for k in 0..=BAYS {
        let x = (-LENGTH + k as f64 * BAY).clamp(-LENGTH + 0.2, LENGTH - 0.2);
        s.patch(10, 40, |u, v| {
            let (sin, cos) = sin_cos(PI * u);
            let (up, out) = sin_cos(PI * v);
            let r = radius + 0.05 - 0.3 * sin;
            (dvec3(x + 0.24 * cos, VAULT + r * up, r * out), dvec3(cos, -sin * up, -sin * out))
        });
    }
}

/// A round window with spokes in the west wall.
fn rose(s: &mut Shapes, glass: u32, pale: u32) {
    let centre = dvec3(-LENGTH + 0.1, 9.5, 0.0);
    s.paint(glass);
    s.block(centre - DVec3::X * 0.08, dvec3(0.02, 4.0, 4.0));
    s.paint(pale);
    let circle = |radius: f64, i: usize, n: usize| {
        let (sin, cos) = sin_cos(2.0 * PI * i as f64 / n as f64);
        centre + dvec3(0.0, radius * sin, radius * cos)
    };
    for (radius, thick) in [(2.1, 0.22), (0.6, 0.10)] {
        s.patch(8, 40, |u, v| {
            let (sin, cos) = sin_cos(2.0 * PI * u);
            let (up, out) = sin_cos(2.0 * PI * v);
            let n = dvec3(-cos, sin * up, sin * out);
            (centre + dvec3(0.0, radius * up, radius * out) + n * thick, n)
        });
    }
    for i in 0..12 {
        s.rod(circle(0.6, i, 12), circle(2.1, i, 12), 0.06, 6, 2);
    }
}

/// Five steps, the altar, the apse behind it and six candlesticks at the east end.
fn choir(s: &mut Shapes, pale: u32, marble: u32, gold: u32, stone: u32) {
    let first_step = LENGTH - 9.0;
    for k in 0..5 {
        s.paint(if k % 2 == 0 { pale } else { marble });
        let x = first_step + 0.4 * k as f64;
        s.cuboid(dvec3(x, -0.1, -3.6), dvec3(LENGTH, 0.16 * (k + 1) as f64, 3.6));
    }
    let floor = 0.8;
    s.paint(marble);
    s.cuboid(dvec3(LENGTH - 5.2, floor, -1.3), dvec3(LENGTH - 4.2, floor + 0.95, 1.3));
    s.paint(pale);
    s.cuboid(dvec3(LENGTH - 5.3, floor + 0.95, -1.45), dvec3(LENGTH - 4.1, floor + 1.07, 1.45));
    // The apse: half a drum and a quarter of a ball, hollow towards the nave.
    let (radius, top) = (3.3, 7.0);
    let front = LENGTH - 0.2 - radius;
    s.paint(stone);
    // The wall around its opening, up into the vault.
    let high = 15.0;
    for i in 0..32 {
        let arch = |i: usize| {
            let (sin, cos) = sin_cos(PI * i as f64 / 32.0);
            dvec3(front, top + radius * sin, radius * cos)
        };
        let (p, q) = (arch(i), arch(i + 1));
        s.quad(p, dvec3(front, high, p.z), dvec3(front, high, q.z), q);
    }
    let side = ARCADE - THICK;
    for (z0, z1) in [(-side, -radius), (radius, side)] {
        s.quad(dvec3(front, 0.0, z0), dvec3(front, 0.0, z1), dvec3(front, high, z1), dvec3(front, high, z0));
    }
    s.patch(32, 8, |u, v| {
        let (sin, cos) = sin_cos(PI * (0.5 - u));
        (dvec3(front + radius * cos, floor + (top - floor) * v, -radius * sin), dvec3(-cos, 0.0, sin))
    });
    s.paint(pale);
    s.patch(32, 12, |u, v| {
        let (sin, cos) = sin_cos(PI * (0.5 - u));
        let (up, out) = sin_cos(PI / 2.0 * v);
        let n = dvec3(cos * out, up, -sin * out);
        (dvec3(front, top, 0.0) + n * radius, -n)
    });
    s.paint(gold);
    let stick =
        [(0.22, 0.0), (0.22, 0.05), (0.05, 0.14), (0.04, 0.8), (0.09, 0.9), (0.04, 1.0), (0.03, 1.7), (0.0, 1.75)]
            .map(|(r, y)| dvec2(r, y));
    for k in 0..6 {
        let z = [-2.8, -2.2, -1.8, 1.8, 2.2, 2.8][k];
        s.lathe(dvec3(LENGTH - 4.7, floor, z), &stick, 12);
    }
}

/// Two rows of benches.
fn pews(s: &mut Shapes, rng: &mut Rng, wood: u32) {
    s.paint(wood);
    for row in 0..14 {
        for side in [-1.0_f64, 1.0] {
            // Benches are slightly displaced.
            let x = -13.5 + row as f64 * 1.5 + rng.range(-0.03, 0.03);
            let (z0, z1) = (0.9 * side, 3.3 * side);
            let (low, high) = (z0.min(z1), z0.max(z1));
            s.cuboid(dvec3(x, 0.42, low), dvec3(x + 0.4, 0.46, high));
            s.cuboid(dvec3(x - 0.06, 0.46, low), dvec3(x - 0.02, 0.95, high));
            s.cuboid(dvec3(x - 0.1, 0.95, low), dvec3(x + 0.02, 1.0, high));
            s.cuboid(dvec3(x - 0.3, 0.12, low), dvec3(x - 0.18, 0.17, high));
            for z in [low, (low + high) / 2.0 - 0.03, high - 0.06] {
                s.cuboid(dvec3(x - 0.08, 0.0, z), dvec3(x + 0.38, 0.46, z + 0.06));
            }
        }
    }
}
