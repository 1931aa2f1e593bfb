//! Rays in, hits out: casts rays down from below a board to the floor, and from each hit a ray to a lamp above the board.
//!
//! `cargo run -p esvo-examples --example cast_rays -- [ENGINE]`

use std::error::Error;
use std::sync::Arc;

use esvo_builder::{BuildSettings, Mesh, build};
use esvo_core::glam::DVec3;
use esvo_core::{HitPoint, Object, Ray};
use esvo_engines::{EngineId, OpenOptions};

fn main() -> Result<(), Box<dyn Error>> {
    let engine: EngineId = std::env::args().nth(1).as_deref().unwrap_or("cpu").parse()?;
    let built = build(&floor_and_board()?, &BuildSettings { levels: 8, ..BuildSettings::default() }, &|_| {})?;
    let octree = Arc::new(built.octree);
    let mut caster = engine.open(&OpenOptions::default())?;
    caster.load(&octree)?;

    // Origins, directions and distances are in the units of the mesh.
    let object = Object::of(&octree, 0);
    let place = |i: u32| f64::from(i) / 50.0 - 0.99;
    let rays: Vec<Ray> = (0..100 * 100)
        .map(|i| DVec3::new(place(i % 100), 0.25, place(i / 100)))
        .map(|origin| object.ray(origin, DVec3::NEG_Y, 0.0..f64::INFINITY))
        .collect();
    let mut hits = Vec::new();
    caster.cast_rays(&object.rays(&rays), &mut hits)?;

    // A miss makes no point.
    let point = |(ray, hit)| HitPoint::new(&object, ray, hit);
    let points: Vec<HitPoint> = rays.iter().zip(&hits).filter_map(point).collect();
    let first = points.first().ok_or("all rays miss")?;
    println!("{} of {} rays hit; the first one after {:.3}:", points.len(), rays.len(), first.distance());
    println!("position {:.2}, normal {:.2}, colour {:.2?}", first.position(), first.normal(), first.color());
    println!("voxel {:?}", first.voxel());

    let lamp = DVec3::new(0.0, 2.0, 0.0);
    let to_lamp = |point: &HitPoint| {
        let way = lamp - point.position();
        point.shadow_ray(way, way.length())
    };
    // A point that faces away from the lamp has no such ray, and is dark.
    let shadow_rays: Vec<Ray> = points.iter().filter_map(to_lamp).collect();
    caster.cast_rays(&object.rays(&shadow_rays), &mut hits)?;
    let dark = points.len() - hits.iter().filter(|hit| hit.is_miss()).count();
    println!("{dark} of {} points are in the shadow of the board, cast by {engine}", points.len());
    Ok(())
}

/// Two squares: 2 wide at a height of 0, and 0.6 wide at 0.5.
fn floor_and_board() -> Result<Mesh, Box<dyn Error>> {
    let corners = [[-1.0, -1.0], [-1.0, 1.0], [1.0, 1.0], [1.0, -1.0]];
    let square = |(size, height)| corners.map(|[x, z]: [f64; 2]| [x * size, height, z * size]);
    let positions = [(1.0, 0.0), (0.3, 0.5)].into_iter().flat_map(square).collect();
    Ok(Mesh::from_triangles(positions, vec![[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]])?)
}
