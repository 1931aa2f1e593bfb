//! Measures how many rays per second each instruction set casts against octrees of scenes, on one thread, and checks that
//! all find the same.
//!
//! ```text
//! cargo run --release -p esvo-cpu --example packets -- [--rounds N] [--sets scalar,AVX2] sibenik=sibenik.esvo ...
//! ```
//!
//! An argument is the name of a scene of the built-in manifest and an octree of it. Every viewpoint of the manifest is cast at
//! 1024 x 768 with contours, with contours and beam, and with cubes; rays end at voxels of one pixel. All sets cast each view in
//! turn in every round. Printed is a table of million rays per second of processor time over all viewpoints: by the least time
//! that each view took in the rounds, so that other work on the machine counts least, and by the median of its times.

mod measuring;

use esvo_core::{Caster, Hit};
use esvo_cpu::CpuCaster;

use self::measuring::{Arguments, Error, MODES, SIZE, processor_time, title, views};

fn main() -> Result<(), Error> {
    let Arguments { rounds, sets, scenes } = Arguments::parse()?;
    title("Rays per second by instruction set", "packets", "");
    println!(
        "Million rays per second of processor time on one thread, by the least time of each view in {rounds} rounds; in"
    );
    println!(
        "parentheses by the median. The last column counts hits with another `t` or voxel than the first set's.\n"
    );
    println!("| scene, mode, views | {} | differ |", sets.iter().map(|set| set.name()).collect::<Vec<_>>().join(" | "));
    println!("|---|{}--:|", "--:|".repeat(sets.len()));
    for (name, octree) in scenes {
        let mut casters = Vec::new();
        for set in &sets {
            let mut caster = CpuCaster::with_instructions(Some(1), *set)?;
            caster.load(&octree)?;
            casters.push(caster);
        }
        for (mode, options) in MODES {
            let views = views(&name, &octree, &options)?;
            let mut seconds = vec![vec![Vec::new(); views.len()]; casters.len()];
            for _ in 0..rounds {
                for (k, view) in views.iter().enumerate() {
                    for (caster, seconds) in casters.iter_mut().zip(&mut seconds) {
                        let start = processor_time();
                        caster.time(view)?;
                        seconds[k].push(processor_time() - start);
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
            print!("| {name}, {mode}, {} |", views.len());
            let rays = views.len() as f64 * f64::from(SIZE.0 * SIZE.1);
            for seconds in &mut seconds {
                seconds.iter_mut().for_each(|times| times.sort_by(f64::total_cmp));
                let rate = |at: usize| rays / seconds.iter().map(|times| times[at]).sum::<f64>() / 1e6;
                print!(" {:.2} ({:.2}) |", rate(0), rate(rounds / 2));
            }
            println!(" {different} |");
        }
    }
    Ok(())
}
