//! Prints how many rays a second the device casts: `cargo run --release -p esvo-ash --example speed [file.esvo]`.

use std::sync::Arc;

use esvo_ash::{AshCaster, GpuOptions};
use esvo_core::sample::{Sample, cameras};
use esvo_core::{CastOptions, Caster, View};
use esvo_format::Octree;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut caster = AshCaster::new(&GpuOptions::default())?;
    println!("{} ({})", caster.device().name, caster.device().detail);
    let octree = match std::env::args_os().nth(1) {
        Some(path) => Arc::new(Octree::open(path.as_ref())?),
        None => Sample::plain(9, true).octree()?,
    };
    caster.load(&octree)?;
    println!("{} bytes on the device", caster.resident_bytes());
    let root = octree.objects()[0].root_slot as u32;
    for (contours, beam) in [(false, false), (true, false), (true, true)] {
        let options = CastOptions { contours, beam, ..CastOptions::default() };
        let mut best = f64::MAX;
        for _ in 0..5 {
            let mut seconds = 0.0;
            for camera in &cameras()[..3] {
                let view = View::new(camera, octree.octree_to_mesh(0), root, (1024, 768), &options)?;
                seconds += caster.time(&view)?.total.as_secs_f64();
            }
            best = best.min(seconds / 3.0);
        }
        println!("contours {contours}, beam {beam}: {:.2} Mrays/s", 1024.0 * 768.0 / best / 1e6);
    }
    Ok(())
}
