//! Mesh in, picture out: imports or makes a mesh, builds its octree, casts it, shades it, writes a PNG.
//!
//! `cargo run -p esvo-examples --example render_picture -- picture.png [MESH] [ENGINE]`; without a mesh, a torus.

use std::error::Error;
use std::f64::consts::TAU;
use std::path::Path;
use std::sync::Arc;

use esvo_builder::{BuildSettings, Mesh, build, import::load_mesh};
use esvo_core::camera::viewpoint::overview;
use esvo_core::picture::write_png;
use esvo_core::{CastOptions, View, shading};
use esvo_engines::{EngineId, OpenOptions};

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let output = arguments.next().ok_or("expected the PNG to write, e.g. picture.png")?;
    let mesh = match arguments.next() {
        Some(file) => load_mesh(Path::new(&file))?,
        None => torus()?,
    };
    let engine: EngineId = arguments.next().as_deref().unwrap_or("cpu").parse()?;

    let built = build(&mesh, &BuildSettings { levels: 8, ..BuildSettings::default() }, &|_| {})?;
    let octree = Arc::new(built.octree);

    let (width, height) = (640, 480);
    let camera = overview(&octree, [0.0, 1.0, 0.0], 50.0, f64::from(width) / f64::from(height));
    let root = octree.objects()[0].root_slot as u32;
    let view = View::new(&camera, octree.octree_to_mesh(0), root, (width, height), &CastOptions::default())?;

    let mut caster = engine.open(&OpenOptions::default())?;
    caster.load(&octree)?;
    let mut hits = Vec::new();
    caster.cast(&view, &mut hits)?;
    write_png(Path::new(&output), &shading::shade(&octree, &view, &hits))?;
    let hit = hits.iter().filter(|hit| !hit.is_miss()).count();
    println!("{output}: {hit} of {} rays hit, cast by {engine} on {}", hits.len(), caster.device().name);
    Ok(())
}

/// A torus of 64 x 32 quads around the y axis.
fn torus() -> Result<Mesh, Box<dyn Error>> {
    let (around, across) = (64u32, 32u32);
    let point = |i: u32| {
        let (u, v) = (TAU * f64::from(i / across) / f64::from(around), TAU * f64::from(i % across) / f64::from(across));
        let radius = 1.0 + 0.4 * v.cos();
        [radius * u.cos(), 0.4 * v.sin(), radius * u.sin()]
    };
    let quad = |i: u32| {
        let at = |u: u32, v: u32| (i / across + u) % around * across + (i % across + v) % across;
        [[at(0, 0), at(0, 1), at(1, 1)], [at(0, 0), at(1, 1), at(1, 0)]]
    };
    let positions = (0..around * across).map(point).collect();
    Ok(Mesh::from_triangles(positions, (0..around * across).flat_map(quad).collect())?)
}
