//! Measures how many rays per second each instruction set casts against octrees of scenes, on one thread, and checks that
//! all find the same.
//!
//! ```text
//! cargo run --release -p esvo-cpu --example packets -- [--rounds N] [--sets scalar,AVX2] sibenik=sibenik.esvo ...
//! ```
//!
//! An argument is the name of a scene of the built-in manifest and an octree of it. Every viewpoint of the manifest is cast at
//! 1024 x 768 with contours, with contours and beam, and with cubes. All sets cast each view in turn in every round. Printed
//! are million rays per second of processor time over all viewpoints: by the least time that each view took in the rounds, so that
//! other work on the machine counts least.

mod views;

use esvo_core::{Caster, Hit};
use esvo_cpu::CpuCaster;

use self::views::{Arguments, Error, MODES, SIZE, views};

fn main() -> Result<(), Error> {
    let Arguments { rounds, sets, scenes } = Arguments::parse()?;
    for (name, octree) in scenes {
        let mut casters = Vec::new();
        for set in &sets {
            let mut caster = CpuCaster::with_instructions(Some(1), *set)?;
            caster.load(&octree)?;
            casters.push(caster);
        }
        for (mode, options) in MODES {
            let views = views(&name, &octree, &options)?;
            let mut seconds = vec![vec![f64::MAX; views.len()]; casters.len()];
            for _ in 0..rounds {
                for (k, view) in views.iter().enumerate() {
                    for (caster, seconds) in casters.iter_mut().zip(&mut seconds) {
                        let start = processor_time();
                        caster.time(view)?;
                        seconds[k] = seconds[k].min(processor_time() - start);
                    }
                }
            }
            let mut different = 0;
            let (mut first, mut other) = (Vec::new(), Vec::new());
            for view in &views {
                for (k, caster) in casters.iter_mut().enumerate() {
                    if k == 0 {
                        caster.cast(view, &mut first)?;
                        continue;
                    }
                    caster.cast(view, &mut other)?;
                    let same = |(a, b): (&Hit, &Hit)| a.raw_t.to_bits() == b.raw_t.to_bits() && a.same_voxel(b);
                    different += first.iter().zip(&other).filter(|pair| !same(*pair)).count();
                }
            }
            print!("{name:<11} {mode:<9}");
            for (set, seconds) in sets.iter().zip(&seconds) {
                let rays = views.len() as f64 * f64::from(SIZE.0 * SIZE.1);
                print!(" {set} {:.2}", rays / seconds.iter().sum::<f64>() / 1e6);
            }
            println!("   {} views, {different} hits differ", views.len());
        }
    }
    Ok(())
}

/// Seconds that the threads of this process have run on a processor, as Linux counts them.
fn processor_time() -> f64 {
    let tasks = std::fs::read_dir("/proc/self/task").into_iter().flatten().flatten();
    let nanoseconds = tasks.filter_map(|task| {
        let text = std::fs::read_to_string(task.path().join("schedstat")).ok()?;
        text.split_whitespace().next()?.parse::<u64>().ok()
    });
    nanoseconds.sum::<u64>() as f64 * 1e-9
}
