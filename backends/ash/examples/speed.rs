//! Prints how many rays a second the device casts: `cargo run --release -p esvo-ash --example speed [file.esvo]`.

use std::sync::Arc;

use esvo_ash::{AshCaster, GpuOptions};
use esvo_core::testing::sample::Sample;
use esvo_core::testing::speed;
use esvo_format::Octree;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let octree = match std::env::args_os().nth(1) {
        Some(path) => Arc::new(Octree::open(path.as_ref())?),
        None => Sample::plain(9, true).octree()?,
    };
    print!("{}", speed::report(&mut AshCaster::new(&GpuOptions::default())?, &octree)?);
    Ok(())
}
