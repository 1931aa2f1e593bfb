//! Prints what the importer reads from mesh files: `cargo run --release -p esvo-builder --example mesh_info -- FILE...`
//!
//! The exit code is the number of files that could not be read (at most 100).

use std::path::Path;
use std::process::ExitCode;
use std::time::Instant;

use esvo_builder::import::load_mesh;

fn main() -> ExitCode {
    let mut failures = 0u8;
    for argument in std::env::args_os().skip(1) {
        let path = Path::new(&argument);
        let start = Instant::now();
        match load_mesh(path) {
            Ok(mesh) => {
                println!("{}: {} triangles, {} vertices", path.display(), mesh.triangle_count(), mesh.positions.len());
                if let Some((low, high)) = mesh.bounds() {
                    println!("  bounds {low:?} to {high:?}");
                }
                let has = |present: bool| if present { "yes" } else { "no" };
                println!(
                    "  normals {}, texture coordinates {}, vertex colours {}; read in {:.3} s",
                    has(!mesh.normals.is_empty()),
                    has(!mesh.uvs.is_empty()),
                    has(!mesh.colors.is_empty()),
                    start.elapsed().as_secs_f64()
                );
                for m in &mesh.materials {
                    let texture = m
                        .texture
                        .as_ref()
                        .map_or("no texture".into(), |t| format!("{} x {}", t.mips[0].width, t.mips[0].height));
                    println!(
                        "  material {}: colour {:?}, {texture}, cutoff {:?}",
                        m.name, m.base_color, m.alpha_cutoff
                    );
                }
                for warning in &mesh.warnings {
                    println!("  warning: {warning}");
                }
            }
            Err(error) => {
                println!("error: {error}");
                failures = failures.saturating_add(1).min(100);
            }
        }
    }
    ExitCode::from(failures)
}
