//! Counts what the casters do per ray, in a run of its own that measures no time.
//!
//! ```text
//! cargo run --release -p esvo-cpu --features counters --example counters -- [--sets scalar,AVX2] sibenik=sibenik.esvo ...
//! ```
//!
//! Arguments and views are those of the example `packets`. Printed are a table of means per ray, where a visit of a packet, or a
//! test of a tile, counts once for all its rays; and for each level of the octree the visits of packets and the mean number of
//! their sixteen rays that were alive.

mod measuring;

use esvo_core::Caster;
use esvo_cpu::CpuCaster;
use esvo_cpu::counters::{self, Counts, What};

use self::measuring::{Arguments, Error, MODES, SIZE, title, views};

fn main() -> Result<(), Error> {
    if counters::take().is_none() {
        return Err("nothing is counted: build this example with --features counters".into());
    }
    let Arguments { sets, scenes, .. } = Arguments::parse()?;
    let mut runs: Vec<(String, f64, Counts)> = Vec::new();
    for (name, octree) in &scenes {
        for set in &sets {
            let mut caster = CpuCaster::with_instructions(Some(1), *set)?;
            caster.load(octree)?;
            for (mode, options) in MODES {
                let views = views(name, octree, &options)?;
                counters::take();
                let mut hits = Vec::new();
                for view in &views {
                    caster.cast(view, &mut hits)?;
                }
                let counts = counters::take().ok_or("nothing is counted")?;
                let rays = views.len() as f64 * f64::from(SIZE.0 * SIZE.1);
                runs.push((format!("{name}, {mode}, {set}"), rays, counts));
            }
        }
    }
    title("What the octree casters do per ray", "counters", " --features counters");
    println!(
        "Means over all viewpoints. A visit of a packet counts once for its sixteen rays, a test of a tile once for its 256.\n"
    );
    println!("| scene, mode, set | {} |", What::ALL.map(What::name).join(" | "));
    println!("|---|{}", "--:|".repeat(What::ALL.len()));
    for (name, rays, counts) in &runs {
        let cells = What::ALL.map(|what| match counts.get(what) {
            0 => "0".to_owned(),
            n => format!("{:.4}", n as f64 / rays),
        });
        println!("| {name} | {} |", cells.join(" | "));
    }
    println!("\n## Rays alive by level\n\nOf the sixteen rays of a packet, and the visits in thousands.\n");
    runs.retain(|(_, _, counts)| counts.alive.iter().any(|(visits, _)| *visits > 0));
    println!("| level | {} |", runs.iter().map(|(name, ..)| name.as_str()).collect::<Vec<_>>().join(" | "));
    println!("|--:|{}", "--:|".repeat(runs.len()));
    for level in 0..runs.first().map_or(0, |(_, _, counts)| counts.alive.len()) {
        let at = |counts: &Counts| counts.alive[level];
        if runs.iter().all(|(_, _, counts)| at(counts).0 == 0) {
            continue;
        }
        let cells = runs.iter().map(|(_, _, counts)| match at(counts) {
            (0, _) => String::new(),
            (visits, alive) => format!("{:.2} in {}", alive as f64 / visits as f64, visits / 1000),
        });
        println!("| {level} | {} |", cells.collect::<Vec<_>>().join(" | "));
    }
    Ok(())
}
