//! Prints how many rays a second the device casts: `cargo run --release -p esvo-wgpu --example speed [file.esvo]`.

use std::sync::Arc;

use esvo_core::testing::sample::Sample;
use esvo_core::testing::speed;
use esvo_format::Octree;
use esvo_wgpu::{GpuOptions, WgpuCaster};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let octree = match std::env::args_os().nth(1) {
        Some(path) => Arc::new(Octree::open(path.as_ref())?),
        None => Sample::plain(9, true).octree()?,
    };
    print!("{}", speed::report(&mut WgpuCaster::new(&GpuOptions::default())?, &octree)?);
    Ok(())
}
