//! Evaluates viewpoints: for each camera of a scene the share of rays that hit, their distances, and optionally a picture.
//!
//! `cargo run --release -p esvo-scenes --example probe -- SCENE [--stand-in] [--scenes-dir DIR] [--manifest FILE]
//! [--pictures DIR]`. Real meshes are read with a small OBJ and PLY reader (positions only).

mod bvh;

use std::error::Error;
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};

use bvh::Bvh;
use esvo_builder::mesh::{Material, Mesh};
use esvo_scenes::{CameraSpec, SceneManifest, SceneVariant, locate_scene};
use glam::DVec3;

const WIDTH: usize = 384;
const HEIGHT: usize = 288;

fn main() -> Result<(), Box<dyn Error>> {
    let (mut name, mut stand_in, mut dir, mut pictures, mut file) = (None, false, None, None, None);
    let mut args = std::env::args().skip(1);
    while let Some(arg) = args.next() {
        match arg.as_str() {
            "--stand-in" => stand_in = true,
            "--scenes-dir" => dir = args.next().map(PathBuf::from),
            "--pictures" => pictures = args.next().map(PathBuf::from),
            "--manifest" => file = args.next().map(PathBuf::from),
            _ => name = Some(arg),
        }
    }
    let name = name.ok_or("usage: probe SCENE [--stand-in] [--scenes-dir DIR] [--manifest FILE] [--pictures DIR]")?;
    let manifest = match file {
        Some(file) => SceneManifest::load(&file)?,
        None => SceneManifest::builtin()?,
    };
    let scene = manifest.scene(&name).ok_or("no such scene in the manifest")?;
    let (mesh, cameras) = if stand_in {
        let stand_in = scene.stand_in.as_ref().ok_or("the scene has no stand-in")?;
        (stand_in.generate().ok_or("unknown generator")?, scene.cameras(SceneVariant::StandIn))
    } else {
        let found = locate_scene(scene, dir.as_deref())?.ok_or("the real mesh was not found: see scenes/README.md")?;
        println!("{}: {}", found.path.display(), found.identity);
        (read_positions(&found.path)?, found.mesh.cameras.as_slice())
    };
    let bvh = Bvh::new(&mesh);
    let bounds = bvh.bounds();
    println!("{} triangles, {:.3} .. {:.3}", mesh.triangles.len(), bounds.min, bounds.max);
    println!(
        "{:<16} {:>7} {:>9} {:>9} {:>9} {:>9} {:>9}  eye",
        "camera", "hit %", "min", "5 %", "median", "95 %", "max"
    );
    for camera in cameras {
        probe(camera, &mesh, &bvh, pictures.as_deref(), &format!("{}-{stand_in}", scene.name))?;
    }
    Ok(())
}

fn probe(c: &CameraSpec, mesh: &Mesh, bvh: &Bvh, pictures: Option<&Path>, prefix: &str) -> std::io::Result<()> {
    let eye = DVec3::from_array(c.eye);
    let back = -DVec3::from_array(c.forward);
    let right = DVec3::from_array(c.up).cross(back).normalize();
    let up = back.cross(right);
    let scale = (c.fov_degrees.to_radians() / 2.0).tan() / (WIDTH.min(HEIGHT) as f64 / 2.0);
    let mut distances = Vec::new();
    let mut pixels = Vec::with_capacity(WIDTH * HEIGHT * 3);
    for y in 0..HEIGHT {
        for x in 0..WIDTH {
            let dx = (x as f64 + 0.5 - WIDTH as f64 / 2.0) * scale;
            let dy = (HEIGHT as f64 / 2.0 - y as f64 - 0.5) * scale;
            let direction = (right * dx + up * dy - back).normalize();
            let mut color = [0.55, 0.65, 0.8];
            if let Some((t, triangle)) = bvh.cast(eye, direction) {
                distances.push(t);
                let [a, b, c] = mesh.triangles[triangle].map(|v| DVec3::from_array(mesh.positions[v as usize]));
                let n = (b - a).cross(c - a).normalize_or(DVec3::Y);
                // Red: a surface seen from its back.
                let light = 0.35 + 0.65 * n.dot(DVec3::new(0.4, 0.8, 0.45)).abs();
                let base = mesh.materials[mesh.triangle_materials[triangle] as usize].base_color;
                color = [base[0], base[1], base[2]].map(|k| f64::from(k).sqrt() * light);
                if n.dot(direction) > 0.0 {
                    color[0] = (color[0] + 0.25).min(1.0);
                }
            }
            pixels.extend(color.map(|k| (k * 255.0) as u8));
        }
    }
    distances.sort_by(f64::total_cmp);
    let at = |q: f64| distances.get(((distances.len().max(1) - 1) as f64 * q) as usize).copied().unwrap_or(f64::NAN);
    println!(
        "{:<16} {:>7.2} {:>9.3} {:>9.3} {:>9.3} {:>9.3} {:>9.3}  {:.3}",
        c.name,
        100.0 * distances.len() as f64 / (WIDTH * HEIGHT) as f64,
        at(0.0),
        at(0.05),
        at(0.5),
        at(0.95),
        at(1.0),
        eye
    );
    if let Some(dir) = pictures {
        std::fs::create_dir_all(dir)?;
        let mut file = std::fs::File::create(dir.join(format!("{prefix}-{}.ppm", c.name)))?;
        write!(file, "P6\n{WIDTH} {HEIGHT}\n255\n")?;
        file.write_all(&pixels)?;
    }
    Ok(())
}

/// Positions and triangles of an OBJ or ASCII PLY file; everything else in it is skipped.
fn read_positions(path: &Path) -> Result<Mesh, Box<dyn Error>> {
    let mut mesh = Mesh { materials: vec![Material::default()], ..Mesh::default() };
    let mut lines = BufReader::new(std::fs::File::open(path)?).lines();
    let position = |words: &mut dyn Iterator<Item = &str>| -> Result<[f64; 3], Box<dyn Error>> {
        let mut p = [0.0; 3];
        for x in &mut p {
            *x = words.next().ok_or("a vertex has fewer than three numbers")?.parse()?;
        }
        Ok(p)
    };
    let polygon = |mesh: &mut Mesh, corners: &[u32]| {
        for k in 2..corners.len() {
            mesh.triangles.push([corners[0], corners[k - 1], corners[k]]);
            mesh.triangle_materials.push(0);
        }
    };
    match path.extension().and_then(|e| e.to_str()) {
        Some("obj") => {
            for line in lines {
                let line = line?;
                let mut words = line.split_ascii_whitespace();
                match words.next() {
                    Some("v") => mesh.positions.push(position(&mut words)?),
                    Some("f") => {
                        let mut corners = Vec::new();
                        for word in words {
                            let index: i64 = word.split('/').next().unwrap_or("").parse()?;
                            let index = if index < 0 { mesh.positions.len() as i64 + index } else { index - 1 };
                            if index < 0 || index as usize >= mesh.positions.len() {
                                return Err(format!("{line}: there is no such vertex").into());
                            }
                            corners.push(index as u32);
                        }
                        polygon(&mut mesh, &corners);
                    }
                    _ => {}
                }
            }
        }
        Some("ply") => {
            let mut vertices = 0;
            for line in lines.by_ref() {
                let line = line?;
                if let Some(n) = line.strip_prefix("element vertex ") {
                    vertices = n.trim().parse()?;
                }
                if line.trim() == "end_header" {
                    break;
                }
            }
            for line in lines {
                let line = line?;
                let mut words = line.split_ascii_whitespace();
                if mesh.positions.len() < vertices {
                    mesh.positions.push(position(&mut words)?);
                } else {
                    let corners = words.skip(1).map(str::parse).collect::<Result<Vec<u32>, _>>()?;
                    if corners.iter().any(|&v| v as usize >= vertices) {
                        return Err(format!("{line}: there is no such vertex").into());
                    }
                    polygon(&mut mesh, &corners);
                }
            }
        }
        _ => return Err("this example reads .obj and ASCII .ply only".into()),
    }
    Ok(mesh)
}
