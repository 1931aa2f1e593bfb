//! Prints how many rays a second an engine casts:
//! `cargo run --release -p esvo-engines --features wgpu,ash --example speed -- wgpu [file.esvo]`.

use std::sync::Arc;

use esvo_core::testing::sample::Sample;
use esvo_core::testing::speed;
use esvo_engines::{EngineId, OpenOptions};
use esvo_format::Octree;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args_os().skip(1);
    let engine: EngineId = arguments.next().unwrap_or("cpu".into()).to_string_lossy().parse()?;
    let octree = match arguments.next() {
        Some(path) => Arc::new(Octree::open(path.as_ref())?),
        None => Sample::plain(9, true).octree()?,
    };
    print!("{}", speed::report(&mut *engine.open(&OpenOptions::default())?, &octree)?);
    Ok(())
}
