//! Counts what the casters do per ray, in a run of its own that measures no time.
//!
//! ```text
//! cargo run --release -p esvo-cpu --features counters --example counters -- [--sets scalar,AVX2] sibenik=sibenik.esvo ...
//! ```
//!
//! Arguments and views are those of the example `packets`. Printed are the means per ray; a visit of a packet, or a test of a
//! tile, counts once for all its rays. Below stand for each level of the octree the visits of packets, in thousands, and the mean
//! number of their sixteen rays that were alive.

mod views;

use esvo_core::Caster;
use esvo_cpu::CpuCaster;
use esvo_cpu::counters::{self, What};

use self::views::{Arguments, Error, MODES, SIZE, views};

fn main() -> Result<(), Error> {
    if counters::take().is_none() {
        return Err("nothing is counted: build this example with --features counters".into());
    }
    let Arguments { sets, scenes, .. } = Arguments::parse()?;
    for (name, octree) in scenes {
        for set in &sets {
            let mut caster = CpuCaster::with_instructions(Some(1), *set)?;
            caster.load(&octree)?;
            for (mode, options) in MODES {
                let views = views(&name, &octree, &options)?;
                counters::take();
                let mut hits = Vec::new();
                for view in &views {
                    caster.cast(view, &mut hits)?;
                }
                let counts = counters::take().ok_or("nothing is counted")?;
                let rays = views.len() as f64 * f64::from(SIZE.0 * SIZE.1);
                println!("{name}, {mode}, {set}, per ray:");
                for what in What::ALL {
                    println!("  {:<14} {:>9.4}", what.name(), counts.get(what) as f64 / rays);
                }
                for (level, (visits, alive)) in counts.alive.iter().enumerate().filter(|(_, (visits, _))| *visits > 0) {
                    println!(
                        "  level {level:<2} {:>9} k visits, {:>5.2} rays",
                        visits / 1000,
                        *alive as f64 / *visits as f64
                    );
                }
            }
        }
    }
    Ok(())
}
