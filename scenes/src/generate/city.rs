//! CITY: blocks of buildings with windows and ledges, between straight streets.

use esvo_builder::mesh::Mesh;
use glam::{DAffine3, DMat3, DVec2, DVec3, dvec2, dvec3};

use super::numeric::Rng;
use super::shape::{Shapes, plane};

/// Triangles of [`city`].
pub const CITY_TRIANGLES: usize = 879_000;

/// Blocks along each side of the city.
const BLOCKS: usize = 11;
/// Metres from one street's middle to the next.
const PITCH: f64 = 64.0;
/// Width of a street between pavements.
const STREET: f64 = 13.0;
/// Triangles reserved for the ground.
const GROUND: usize = 60_000;
/// Upper bound on the triangles of a plain building with its roof.
const PLAIN_BUILDING: usize = 150;
/// Height of a storey.
const STOREY: f64 = 3.4;

struct Palette {
    asphalt: u32,
    line: u32,
    pavement: u32,
    glass: u32,
    frame: u32,
    metal: u32,
    leaf: u32,
    bark: u32,
    walls: [u32; 7],
    cars: [u32; 4],
}

/// Stands in for the paper's CITY, which was never published: 879,000 triangles, 11 x 11 blocks with about 400 buildings.
///
/// Units are metres, y is up. Extents: x and z -352..352 (a road marking goes 8 cm further), y from -0.2
/// (streets are 0) to at most 120. Walls with recessed windows
/// and sills, ribbon windows and belt courses, parapets, roof machinery, antennas, lamp posts, trees, cars; the ground is a
/// raised-curb street grid. Large flat faces with fine relief, and thin vertical structures far away.
pub fn city(seed: u64) -> Mesh {
    let mut rng = Rng::new(seed);
    let mut s = Shapes::with_capacity(CITY_TRIANGLES);
    let palette = Palette {
        asphalt: s.add_material("asphalt", [0.07, 0.07, 0.08]),
        line: s.add_material("road marking", [0.6, 0.6, 0.55]),
        pavement: s.add_material("pavement", [0.35, 0.34, 0.32]),
        glass: s.add_material("glass", [0.10, 0.16, 0.22]),
        frame: s.add_material("frame", [0.55, 0.53, 0.5]),
        metal: s.add_material("metal", [0.25, 0.26, 0.28]),
        leaf: s.add_material("leaf", [0.10, 0.24, 0.06]),
        bark: s.add_material("bark", [0.12, 0.08, 0.05]),
        walls: [
            ("brick", [0.34, 0.14, 0.10]),
            ("sandstone", [0.52, 0.43, 0.30]),
            ("concrete", [0.42, 0.42, 0.41]),
            ("white plaster", [0.68, 0.66, 0.62]),
            ("dark brick", [0.20, 0.10, 0.08]),
            ("ochre plaster", [0.55, 0.38, 0.16]),
            ("grey stone", [0.30, 0.31, 0.33]),
        ]
        .map(|(name, rgb)| s.add_material(name, rgb)),
        cars: [[0.5, 0.05, 0.04], [0.06, 0.10, 0.35], [0.6, 0.6, 0.6], [0.04, 0.04, 0.05]]
            .map(|rgb| s.add_material("car", rgb)),
    };
    // Blocks get details until the budget of triangles is used up. A random order of the blocks favours no side of the city.
    let mut blocks: Vec<(usize, usize)> = (0..BLOCKS * BLOCKS).map(|k| (k % BLOCKS, k / BLOCKS)).collect();
    rng.shuffle(&mut blocks);
    let centre = |(i, j)| dvec2(i as f64 - (BLOCKS / 2) as f64, j as f64 - (BLOCKS / 2) as f64) * PITCH;
    for &at in &blocks {
        furniture(&mut s, &mut rng, &palette, centre(at));
    }
    for (k, &at) in blocks.iter().enumerate() {
        let budget = CITY_TRIANGLES - GROUND - (blocks.len() - k) * (4 * PLAIN_BUILDING + 10);
        block(&mut s, &mut rng, &palette, centre(at), budget);
    }
    let half = PITCH * BLOCKS as f64 / 2.0;
    s.fill_grid(
        CITY_TRIANGLES,
        plane(dvec3(-half, 0.0, half), DVec3::X * 2.0 * half, DVec3::Z * -2.0 * half),
        |_, _| palette.asphalt,
    );
    s.finish()
}

/// A raised pavement with one to four buildings, or a small park.
///
/// `budget` is the number of triangles that the whole mesh may have after its details are added.
fn block(s: &mut Shapes, rng: &mut Rng, p: &Palette, centre: DVec2, budget: usize) {
    let half = (PITCH - STREET) / 2.0;
    s.paint(p.pavement);
    s.cuboid_without(
        dvec3(centre.x - half, -0.2, centre.y - half),
        dvec3(centre.x + half, 0.15, centre.y + half),
        Some(DVec3::NEG_Y),
    );
    if rng.chance(0.06) && s.count() + 24 * 250 <= budget {
        for _ in 0..24 {
            let at = centre + dvec2(rng.range(-20.0, 20.0), rng.range(-20.0, 20.0));
            tree(s, rng, p, at);
        }
        return;
    }
    // Towers stand near the middle of the city.
    let nearness = 1.0 - (centre.length() / (PITCH * BLOCKS as f64 * 0.6)).min(1.0);
    let (nx, nz) = [(1, 2), (2, 1), (2, 2), (2, 2), (2, 2), (1, 1)][rng.below(6)];
    let lot = dvec2(2.0 * half / nx as f64, 2.0 * half / nz as f64);
    for k in 0..nx * nz {
        let middle = centre - DVec2::splat(half) + lot * dvec2((k % nx) as f64 + 0.5, (k / nx) as f64 + 0.5);
        let size = lot - dvec2(rng.range(3.5, 7.0), rng.range(3.5, 7.0));
        let storeys = if rng.chance(0.1 + 0.35 * nearness) { 10 + rng.below(18) } else { 3 + rng.below(6) };
        building(s, rng, p, middle, size, storeys, budget);
    }
}

#[derive(Clone, Copy, PartialEq)]
enum Facade {
    Windows,
    Ribbons,
    Plain,
}

fn building(s: &mut Shapes, rng: &mut Rng, p: &Palette, middle: DVec2, size: DVec2, storeys: usize, budget: usize) {
    let wall = p.walls[rng.below(p.walls.len())];
    let height = 1.0 + storeys as f64 * STOREY;
    let columns = |width: f64| (width / 3.6).floor().max(1.0) as usize;
    let windows = 2 * (columns(size.x) + columns(size.y)) * storeys * 28;
    let ribbons = 4 * storeys * 20;
    let left = budget.saturating_sub(s.count());
    // A large building with a window in every cell would need the triangles of ten small ones.
    let facade = if windows + 400 <= left && windows < 6_000 && rng.chance(0.8) {
        Facade::Windows
    } else if ribbons + 400 <= left {
        Facade::Ribbons
    } else {
        Facade::Plain
    };
    let ground = 0.15;
    let h = size * 0.5;
    // Each side of the house as (left corner, direction to the right), seen from outside.
    let sides = [
        (dvec2(middle.x - h.x, middle.y + h.y), dvec2(1.0, 0.0), size.x),
        (dvec2(middle.x + h.x, middle.y + h.y), dvec2(0.0, -1.0), size.y),
        (dvec2(middle.x + h.x, middle.y - h.y), dvec2(-1.0, 0.0), size.x),
        (dvec2(middle.x - h.x, middle.y - h.y), dvec2(0.0, 1.0), size.y),
    ];
    for (corner, right, width) in sides {
        let x = dvec3(right.x, 0.0, right.y);
        s.frame = DAffine3::from_mat3_translation(
            DMat3::from_cols(x, DVec3::Y, x.cross(DVec3::Y)),
            dvec3(corner.x, ground, corner.y),
        );
        s.paint(wall);
        match facade {
            Facade::Windows => {
                wall_rect(s, 0.0, width, 0.0, 1.0, 0.0);
                let n = columns(width);
                let cell = width / n as f64;
                for storey in 0..storeys {
                    for column in 0..n {
                        let origin = dvec2(column as f64 * cell, 1.0 + storey as f64 * STOREY);
                        window(s, p, wall, origin, dvec2(cell, STOREY), 0.22);
                    }
                }
            }
            Facade::Ribbons => {
                wall_rect(s, 0.0, width, 0.0, 1.0, 0.0);
                for storey in 0..storeys {
                    let y = 1.0 + storey as f64 * STOREY;
                    ribbon(s, p, wall, y, width);
                }
            }
            Facade::Plain => wall_rect(s, 0.0, width, 0.0, height, 0.0),
        }
    }
    s.frame = DAffine3::from_translation(dvec3(middle.x, ground + height, middle.y));
    roof(s, rng, p, wall, h, storeys);
    s.frame = DAffine3::IDENTITY;
}

/// A rectangle of wall in the plane at depth `z` of the facade's frame (x right, y up, z outwards).
fn wall_rect(s: &mut Shapes, x0: f64, x1: f64, y0: f64, y1: f64, z: f64) {
    s.quad(dvec3(x0, y0, z), dvec3(x1, y0, z), dvec3(x1, y1, z), dvec3(x0, y1, z));
}

/// A cell of wall with a recessed pane and a sill: 28 triangles.
fn window(s: &mut Shapes, p: &Palette, wall: u32, origin: DVec2, cell: DVec2, depth: f64) {
    let (x0, x1) = (origin.x, origin.x + cell.x);
    let (y0, y1) = (origin.y, origin.y + cell.y);
    let (a0, a1) = (x0 + cell.x * 0.28, x1 - cell.x * 0.28);
    let (b0, b1) = (y0 + 0.9, y1 - 0.6);
    s.paint(wall);
    wall_rect(s, x0, x1, y0, b0, 0.0);
    wall_rect(s, x0, x1, b1, y1, 0.0);
    wall_rect(s, x0, a0, b0, b1, 0.0);
    wall_rect(s, a1, x1, b0, b1, 0.0);
    s.paint(p.frame);
    let at = |x: f64, y: f64, z: f64| dvec3(x, y, z);
    s.quad(at(a0, b0, 0.0), at(a1, b0, 0.0), at(a1, b0, -depth), at(a0, b0, -depth));
    s.quad(at(a0, b1, -depth), at(a1, b1, -depth), at(a1, b1, 0.0), at(a0, b1, 0.0));
    s.quad(at(a0, b0, 0.0), at(a0, b0, -depth), at(a0, b1, -depth), at(a0, b1, 0.0));
    s.quad(at(a1, b0, -depth), at(a1, b0, 0.0), at(a1, b1, 0.0), at(a1, b1, -depth));
    s.cuboid_without(dvec3(a0 - 0.12, b0 - 0.12, 0.0), dvec3(a1 + 0.12, b0, 0.2), Some(DVec3::NEG_Z));
    s.paint(p.glass);
    wall_rect(s, a0, a1, b0, b1, -depth);
}

/// A storey with one window from corner to corner and a belt course above it: 20 triangles.
fn ribbon(s: &mut Shapes, p: &Palette, wall: u32, y: f64, width: f64) {
    let (b0, b1, depth) = (y + 1.0, y + STOREY - 0.5, 0.15);
    s.paint(wall);
    wall_rect(s, 0.0, width, y, b0, 0.0);
    wall_rect(s, 0.0, width, b1, y + STOREY, 0.0);
    s.cuboid_without(dvec3(0.0, b1 + 0.1, 0.0), dvec3(width, b1 + 0.3, 0.25), Some(DVec3::NEG_Z));
    s.paint(p.frame);
    s.quad(dvec3(0.0, b0, 0.0), dvec3(width, b0, 0.0), dvec3(width, b0, -depth), dvec3(0.0, b0, -depth));
    s.quad(dvec3(0.0, b1, -depth), dvec3(width, b1, -depth), dvec3(width, b1, 0.0), dvec3(0.0, b1, 0.0));
    s.paint(p.glass);
    wall_rect(s, 0.0, width, b0, b1, -depth);
}

/// Roof slab, parapet, machinery and antennas, in a frame whose origin is the middle of the roof.
fn roof(s: &mut Shapes, rng: &mut Rng, p: &Palette, wall: u32, h: DVec2, storeys: usize) {
    s.paint(p.pavement);
    s.quad(dvec3(-h.x, 0.0, h.y), dvec3(h.x, 0.0, h.y), dvec3(h.x, 0.0, -h.y), dvec3(-h.x, 0.0, -h.y));
    s.paint(wall);
    let (t, o, top) = (0.3, 0.25, 0.9);
    s.cuboid(dvec3(-h.x - o, -0.3, h.y - t), dvec3(h.x + o, top, h.y + o));
    s.cuboid(dvec3(-h.x - o, -0.3, -h.y - o), dvec3(h.x + o, top, -h.y + t));
    s.cuboid(dvec3(-h.x - o, -0.3, -h.y + t), dvec3(-h.x + t, top, h.y - t));
    s.cuboid(dvec3(h.x - t, -0.3, -h.y + t), dvec3(h.x + o, top, h.y - t));
    s.paint(p.metal);
    for _ in 0..2 + rng.below(3) {
        let at = dvec3(rng.range(-0.6, 0.6) * h.x, 0.0, rng.range(-0.6, 0.6) * h.y);
        let size = dvec3(rng.range(1.0, 2.5), rng.range(0.8, 2.2), rng.range(1.0, 2.5));
        s.cuboid_without(
            at - dvec3(size.x, 0.0, size.z) / 2.0,
            at + dvec3(size.x / 2.0, size.y, size.z / 2.0),
            Some(DVec3::NEG_Y),
        );
    }
    if storeys > 9 {
        let at = dvec3(rng.range(-0.4, 0.4) * h.x, 0.0, rng.range(-0.4, 0.4) * h.y);
        s.rod(at, at + DVec3::Y * rng.range(6.0, 18.0), 0.09, 5, 1);
    } else if rng.chance(0.25) {
        let at = dvec3(rng.range(-0.4, 0.4) * h.x, 0.0, rng.range(-0.4, 0.4) * h.y);
        s.lathe(at, &[dvec2(1.3, 1.0), dvec2(1.4, 3.6), dvec2(0.0, 4.6)], 12);
    }
}

/// Lamp posts, trees and parked cars along the block's curb, and the dashes of the street next to it.
fn furniture(s: &mut Shapes, rng: &mut Rng, p: &Palette, centre: DVec2) {
    let half = (PITCH - STREET) / 2.0;
    for k in 0..4 {
        let along = -half + (k as f64 + 0.5) * half / 2.0;
        let post = dvec3(centre.x + half - 0.6, 0.15, centre.y + along);
        s.paint(p.metal);
        s.rod(post, post + DVec3::Y * 7.5, 0.07, 5, 1);
        s.rod(post + DVec3::Y * 7.4, post + dvec3(2.0, 7.7, 0.0), 0.05, 4, 1);
        s.block(post + dvec3(2.0, 7.65, 0.0), dvec3(0.7, 0.12, 0.25));
        if rng.chance(0.4) {
            tree(s, rng, p, dvec2(centre.x + along + 3.0, centre.y + half - 1.0));
        }
        if rng.chance(0.7) {
            let at = dvec3(centre.x + half + 1.2, 0.0, centre.y + along + 4.0);
            s.paint(p.cars[rng.below(p.cars.len())]);
            s.block(at + DVec3::Y * 0.6, dvec3(1.75, 0.6, 4.2));
            s.paint(p.glass);
            s.block(at + DVec3::Y * 1.15, dvec3(1.5, 0.5, 2.2));
        }
    }
    s.paint(p.line);
    for k in 0..8 {
        let along = -half + (k as f64 + 0.5) * half / 4.0;
        let x = centre.x + PITCH / 2.0;
        s.cuboid_without(
            dvec3(x - 0.08, -0.05, centre.y + along - 1.2),
            dvec3(x + 0.08, 0.01, centre.y + along + 1.2),
            Some(DVec3::NEG_Y),
        );
    }
}

/// A street tree: a trunk and three rough balls of leaves.
fn tree(s: &mut Shapes, rng: &mut Rng, p: &Palette, at: DVec2) {
    let foot = dvec3(at.x, 0.1, at.y);
    let height = rng.range(2.5, 4.5);
    s.paint(p.bark);
    s.rod(foot, foot + DVec3::Y * height, 0.14, 6, 1);
    s.paint(p.leaf);
    for k in 0..3 {
        let offset = dvec3(rng.range(-0.7, 0.7), height + 0.5 * k as f64, rng.range(-0.7, 0.7));
        s.ellipsoid(foot + offset, dvec3(1.5, 1.1, 1.4) * rng.range(0.7, 1.1), 5, 8);
    }
}
