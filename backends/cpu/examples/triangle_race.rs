//! Races triangles against octrees of the same scene on one thread, in one interleaved run: Embree's single rays and packets,
//! this crate's triangle packets, and octrees with the fastest instructions of the processor.
//!
//! ```text
//! cargo run --release -p esvo-cpu --features embree --example triangle_race -- [OPTIONS] SCENE[=OCTREE] ...
//! ```
//!
//! - `SCENE` is the name of a scene of the built-in manifest. Its real mesh is cast if it is found in `$ESVO_SCENES` or
//!   `../shared/scenes`, otherwise its stand-in. Give a scene several times to race several octrees.
//! - `OCTREE` is an octree of that mesh: `esvo build --scene SCENE -l LEVELS -o OCTREE`.
//! - A scene that is displaced (sibenik-d) is diced and displaced as `esvo build` does it, for the levels of its first
//!   octree, and the triangles that result are cast. The hierarchy of this crate takes minutes over millions of triangles.
//! - `--rounds N`: rounds of measuring [default: 5]. Every round casts every viewpoint by every caster.
//!
//! Without the feature `embree` the rest is measured. Every viewpoint of the manifest is cast at 1024 x 768. All casters
//! cast a view in turn, in every round; printed is the median of the rounds in million rays per second of processor time, over all
//! viewpoints. Rays of octrees end at voxels of one pixel, and of two. Then follow differences from the exact triangles, on every eighth ray
//! in both directions: median and 99th percentile of the depth difference along the ray where both hit, in pixels (the edge of
//! a pixel at the hit), and the share of rays of which only one hits.

mod measuring;

use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use esvo_builder::{DisplaceOptions, Mesh, displace, import::load_mesh};
use esvo_core::exact::{CameraRays, TriangleHit};
use esvo_core::{Camera, CastOptions, Caster, Hit, View};
use esvo_cpu::CpuCaster;
use esvo_cpu::triangles::TriangleScene;
#[cfg(feature = "embree")]
use esvo_cpu::triangles::{EmbreeRays, EmbreeScene};
use esvo_format::Octree;
use esvo_scenes::{CameraSpec, SceneManifest, SceneVariant, StandIn, locate_scene};
use glam::{DMat4, DVec3, DVec4};
use rayon::{ThreadPool, ThreadPoolBuilder};

use self::measuring::{Error, SIZE, camera, processor_time, title};

/// Distance in pixels of the rays whose depth is compared.
const STRIDE: u32 = 8;

fn main() -> Result<(), Error> {
    let mut rounds = 5;
    let mut scenes: Vec<(String, Vec<String>)> = Vec::new();
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--rounds" => {
                let number = arguments.next().and_then(|number| number.parse().ok()).filter(|number| *number > 0);
                rounds = number.ok_or("--rounds: expected a number above 0")?;
            }
            option if option.starts_with('-') => return Err(format!("unknown option {option}").into()),
            scene => {
                let (name, octree) = scene.split_once('=').map_or((scene, None), |(name, path)| (name, Some(path)));
                if !scenes.iter().any(|(known, _)| known == name) {
                    scenes.push((name.to_owned(), Vec::new()));
                }
                let octrees = scenes.iter_mut().find(|(known, _)| known == name).map(|(_, octrees)| octrees);
                octrees.into_iter().for_each(|octrees| octrees.extend(octree.map(str::to_owned)));
            }
        }
    }
    if scenes.is_empty() {
        return Err("expected at least one SCENE=OCTREE, e.g. sibenik=sibenik.esvo".into());
    }
    let feature = if cfg!(feature = "embree") { " --features embree" } else { "" };
    title("Triangles and octrees", "triangle_race", feature);
    println!(
        "Million rays per second of processor time on one thread, median of {rounds} interleaved rounds over all viewpoints;"
    );
    println!(
        "rays of octrees end at voxels of one pixel, or of two. Differences are those from the exact triangles: of depth along the ray, in"
    );
    println!(
        "pixels, where both hit; and the share of rays of which only one hits. Times of building hierarchies are wall time.\n"
    );
    scenes.iter().try_for_each(|(name, octrees)| race(name, octrees, rounds))
}

/// One caster of the race.
struct Racer<'a> {
    name: String,
    kind: Kind<'a>,
    /// Processor time of each round over all viewpoints, in seconds.
    seconds: Vec<f64>,
    differences: Differences,
}

enum Kind<'a> {
    Packets(&'a TriangleScene),
    #[cfg(feature = "embree")]
    Embree(&'a EmbreeScene, EmbreeRays),
    Octree {
        caster: CpuCaster,
        octree: Arc<Octree>,
        options: CastOptions,
    },
}

/// What a racer found compared with the exact triangles.
#[derive(Default)]
struct Differences {
    pixels: Vec<f64>,
    one_hits: usize,
    rays: usize,
}

/// Hits of one picture, kept between pictures so that no racer pays for memory.
#[derive(Default)]
struct Hits {
    triangles: Vec<TriangleHit>,
    voxels: Vec<Hit>,
}

fn race(name: &str, octrees: &[String], rounds: usize) -> Result<(), Error> {
    let octrees: Vec<(&str, Arc<Octree>)> = octrees
        .iter()
        .map(|path| Ok((path.as_str(), Arc::new(Octree::open(Path::new(path)).map_err(|e| format!("{path}: {e}"))?))))
        .collect::<Result<_, Error>>()?;
    let (mesh, cameras) = scene(name, octrees.first().map_or(10, |(_, octree)| octree.objects()[0].levels))?;
    println!("## {name}\n\n{} triangles, {} viewpoints.", mesh.triangles.len(), cameras.len());
    let corners = mesh.triangles.iter().map(|t| t.map(|v| mesh.positions[v as usize])).collect();
    drop(mesh);
    let start = Instant::now();
    let triangles = TriangleScene::new(corners)?;
    let megabytes = |bytes: u64| bytes as f64 / 1e6;
    let seconds = start.elapsed().as_secs_f64();
    println!("Hierarchy of this crate: {seconds:.1} s, {:.0} MB.", megabytes(triangles.resident_bytes()));

    let mut racers = Vec::new();
    #[cfg(feature = "embree")]
    let embree = {
        let start = Instant::now();
        let embree = EmbreeScene::new(&triangles)?;
        let seconds = start.elapsed().as_secs_f64();
        println!("Hierarchy of Embree: {seconds:.1} s, {:.0} MB.", megabytes(embree.resident_bytes()));
        embree
    };
    #[cfg(feature = "embree")]
    for rays in EmbreeRays::ALL {
        let native = if embree.is_native(rays) { "" } else { " (split by Embree on this processor)" };
        racers.push(Racer::new(format!("Embree, {}{native}", rays.name()), Kind::Embree(&embree, rays)));
    }
    racers.push(Racer::new("packets of 16 over obvhs".into(), Kind::Packets(&triangles)));
    for (path, octree) in &octrees {
        println!("Octree {path}: {:.0} MB.", megabytes(size_of_val(octree.words()) as u64));
        for (mode, beam, max_voxel_pixels) in
            [("contours", false, 1.0), ("contours and beam", true, 1.0), ("contours, voxels of two pixels", false, 2.0)]
        {
            let mut caster = CpuCaster::new(Some(1))?;
            caster.load(octree)?;
            let name = format!("octree, {} levels, {mode} ({path})", octree.objects()[0].levels);
            let options = CastOptions { contours: true, beam, max_voxel_pixels };
            racers.push(Racer::new(name, Kind::Octree { caster, octree: octree.clone(), options }));
        }
    }

    let one = ThreadPoolBuilder::new().num_threads(1).build()?;
    let mut hits = Hits::default();
    for round in 0..rounds {
        for racer in &mut racers {
            racer.seconds.push(0.0);
        }
        for camera in &cameras {
            let rays = CameraRays::new(camera, SIZE)?;
            for racer in &mut racers {
                let start = processor_time();
                racer.cast(&one, camera, &rays, &mut hits)?;
                racer.seconds[round] += processor_time() - start;
            }
        }
    }
    for camera in &cameras {
        let rays = CameraRays::new(camera, SIZE)?;
        let pixels = (0..SIZE.1)
            .step_by(STRIDE as usize)
            .flat_map(|y| (0..SIZE.0).step_by(STRIDE as usize).map(move |x| (x, y)));
        let exact: Vec<_> = pixels.map(|(x, y)| (x, y, triangles.cast_exact_ray(&rays.ray(x, y)))).collect();
        for racer in &mut racers {
            racer.cast(&one, camera, &rays, &mut hits)?;
            racer.compare(&rays, &hits, &exact);
        }
    }
    println!("\n| caster | Mrays/s | difference in pixels: median | 99th percentile | only one hits |");
    println!("|---|--:|--:|--:|--:|");
    for racer in &mut racers {
        racer.print(cameras.len());
    }
    println!();
    Ok(())
}

impl<'a> Racer<'a> {
    fn new(name: String, kind: Kind<'a>) -> Self {
        Self { name, kind, seconds: Vec::new(), differences: Differences::default() }
    }

    /// Casts a picture: triangles on the thread of `one`, octrees on the thread of their caster.
    fn cast(&mut self, one: &ThreadPool, camera: &Camera, rays: &CameraRays, hits: &mut Hits) -> Result<(), Error> {
        match &mut self.kind {
            Kind::Packets(scene) => one.install(|| scene.cast(rays, &mut hits.triangles)),
            #[cfg(feature = "embree")]
            Kind::Embree(scene, at_once) => one.install(|| scene.cast(*at_once, rays, &mut hits.triangles)),
            Kind::Octree { caster, octree, options } => {
                let root = octree.objects()[0].root_slot as u32;
                let view = View::new(camera, octree.octree_to_mesh(0), root, SIZE, options)?;
                caster.cast(&view, &mut hits.voxels)?;
            }
        }
        Ok(())
    }

    /// Compares the hits of the last cast with exact ones.
    fn compare(&mut self, rays: &CameraRays, hits: &Hits, exact: &[(u32, u32, TriangleHit)]) {
        let found = |index: usize| match &self.kind {
            Kind::Octree { .. } => hits.voxels[index].t().map(f64::from),
            _ => Some(hits.triangles[index]).filter(|hit| !hit.is_miss()).map(|hit| hit.t),
        };
        for &(x, y, exact) in exact {
            let t = found((y * SIZE.0 + x) as usize);
            self.differences.rays += 1;
            match (t, exact.is_miss()) {
                (Some(t), false) => {
                    let along = (t - exact.t).abs() * rays.ray(x, y).direction.length();
                    self.differences.pixels.push(along / (exact.t * rays.pixel_size()));
                }
                (None, true) => {}
                _ => self.differences.one_hits += 1,
            }
        }
    }

    fn print(&mut self, views: usize) {
        self.seconds.sort_by(f64::total_cmp);
        let Differences { pixels, one_hits, rays } = &mut self.differences;
        pixels.sort_by(f64::total_cmp);
        let at = |part: f64| pixels.get((pixels.len() as f64 * part) as usize).copied().unwrap_or(f64::NAN);
        let cast = views as f64 * f64::from(SIZE.0 * SIZE.1);
        println!(
            "| {} | {:.2} | {:.4} | {:.4} | {:.4} % |",
            self.name,
            cast / self.seconds[self.seconds.len() / 2] / 1e6,
            at(0.5),
            at(0.99),
            *one_hits as f64 / *rays as f64 * 100.0
        );
    }
}

/// Mesh and viewpoints of a scene; if it is displaced, diced for an octree of `levels`.
fn scene(name: &str, levels: u32) -> Result<(Mesh, Vec<Camera>), Error> {
    let manifest = SceneManifest::builtin()?;
    let entry = manifest.scene(name).ok_or_else(|| format!("{name}: the manifest has no such scene"))?;
    let (mesh, specs): (_, &[CameraSpec]) = match locate_scene(entry, None)? {
        Some(found) => {
            let mut mesh = load_mesh(&found.path)?;
            if let Some(rows) = found.mesh.transform {
                let row = |i: usize| DVec4::from_array(rows[i]);
                mesh.transform(&DMat4::from_cols(row(0), row(1), row(2), DVec4::W).transpose());
            }
            (mesh, &found.mesh.cameras)
        }
        None => {
            let mesh = entry.stand_in.as_ref().and_then(StandIn::generate);
            let mesh = mesh.ok_or_else(|| format!("{name}: its mesh was not found, and it has no stand-in"))?;
            println!("The mesh of {name} was not found: this is its stand-in.\n");
            (mesh, entry.cameras(SceneVariant::StandIn))
        }
    };
    let cameras = specs.iter().map(camera).collect();
    if !entry.displaced {
        return Ok((mesh, cameras));
    }
    let (low, high) = mesh.bounds().ok_or("the mesh has no triangles")?;
    let extent = (DVec3::from(high) - DVec3::from(low)).max_element();
    // The displacement of `esvo build --scene`: white is 1/500 of the largest extent.
    Ok((displace(&mesh, &DisplaceOptions::for_levels(&mesh, levels, extent / 500.0))?, cameras))
}
