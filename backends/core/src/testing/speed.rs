//! A quick measure of a caster's speed for examples. The benchmark is in the crate `esvo-bench`.

use std::fmt::Write as _;
use std::sync::Arc;

use esvo_format::Octree;

use crate::testing::sample::cameras;
use crate::{CastError, CastOptions, Caster, View};

/// Loads an octree and returns a few lines of text: the device, and how many million rays per second it casts. Pictures of
/// 1024 x 768 pixels from the first three of the [`cameras`], the best of five runs, by the caster's own clock.
///
/// # Errors
/// What the caster said.
pub fn report(caster: &mut dyn Caster, octree: &Arc<Octree>) -> Result<String, CastError> {
    let mut text = format!("{} ({})\n", caster.device().name, caster.device().detail);
    caster.load(octree)?;
    let _ = writeln!(text, "{} bytes on the device", caster.resident_bytes());
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
        let _ = writeln!(text, "contours {contours}, beam {beam}: {:.2} Mrays/s", 1024.0 * 768.0 / best / 1e6);
    }
    Ok(text)
}
