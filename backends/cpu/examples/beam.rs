//! Checks that the beam optimization changes no hit, on every viewpoint of scenes.
//!
//! ```text
//! cargo run --release -p esvo-cpu --example beam -- sibenik=sibenik.esvo ...
//! ```
//!
//! An argument is the name of a scene of the built-in manifest and an octree of it. Every viewpoint of the manifest is cast at
//! 1024 x 768, with contours and with cubes, down to the leaves and to voxels of one and of four pixels; with the beam in blocks of 4 and of 8 pixels
//! and without. Printed is how many rays end in another voxel or at another `t`. The negative control beside each: the same for the
//! first viewpoint with start values that are too large by a twentieth. Exit code 1 if the beam changes a hit, or if the control
//! shows none in a whole scene.

mod measuring;

use std::process::ExitCode;

use esvo_core::reference::{cast_coarse, cast_fine};
use esvo_core::{CastOptions, Caster, Hit, View};
use esvo_cpu::CpuCaster;

use self::measuring::{Arguments, Error, title, views};

/// Rays that end otherwise.
fn differences(a: &[Hit], b: &[Hit]) -> usize {
    a.iter().zip(b).filter(|(a, b)| !a.same_voxel(b) || a.raw_t != b.raw_t).count()
}

fn main() -> Result<ExitCode, Error> {
    let Arguments { scenes, .. } = Arguments::parse()?;
    title("Hits that the beam changes", "beam", "");
    println!(
        "| scene, mode, rays end at | rays | blocks of 4: other hits | control | blocks of 8: other hits | control |"
    );
    println!("|---|--:|--:|--:|--:|--:|");
    let mut right = true;
    for (name, octree) in scenes {
        let mut caster = CpuCaster::new(None)?;
        caster.load(&octree)?;
        let mut controls = [0; 2];
        for contours in [true, false] {
            for pixels in [0.0, 1.0, 4.0] {
                let options = |beam| CastOptions { contours, beam, max_voxel_pixels: pixels };
                let (with, without) = (views(&name, &octree, &options(true))?, views(&name, &octree, &options(false))?);
                let (mut ours, mut theirs) = (Vec::new(), Vec::new());
                let (mut rays, mut other, mut control) = (0, [0; 2], [0; 2]);
                for (number, (with, without)) in with.iter().zip(&without).enumerate() {
                    caster.cast(without, &mut theirs)?;
                    rays += theirs.len();
                    for (wide, (other, control)) in [false, true].into_iter().zip(other.iter_mut().zip(&mut control)) {
                        let with = with.with_wide_beam(wide);
                        caster.cast(&with, &mut ours)?;
                        *other += differences(&ours, &theirs);
                        if number == 0 {
                            *control += too_far(&octree, &with, &theirs);
                        }
                    }
                }
                let mode = if contours { "contours" } else { "cubes" };
                let end = if pixels == 0.0 { "leaves".into() } else { format!("{pixels} pixels") };
                let cells = [other[0], control[0], other[1], control[1]].map(|n| n.to_string()).join(" | ");
                println!("| {name}, {mode}, {end} | {rays} | {cells} |");
                for (all, control) in controls.iter_mut().zip(control) {
                    *all += control;
                }
                right &= other == [0; 2];
            }
        }
        right &= !controls.contains(&0);
    }
    Ok(if right { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// Rays that end otherwise if they start a twentieth too far.
fn too_far(octree: &esvo_format::Octree, view: &View, right: &[Hit]) -> usize {
    let starts: Vec<f32> = cast_coarse(octree, view).iter().map(|start| start * 1.05).collect();
    let mut hits = Vec::new();
    cast_fine(octree, view, &starts, &mut hits);
    differences(&hits, right)
}
