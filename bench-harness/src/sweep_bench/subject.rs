//! What is swept: octrees, viewpoints, and where the exact answers come from.

use std::io::Write;
use std::sync::Arc;

use esvo_builder::{BuildSettings, Mesh};
use esvo_core::exact::CameraRays;
use esvo_core::{CastError, CastOptions, Object, View};
use esvo_cpu::triangles::TriangleScene;
use esvo_format::Octree;

use super::cache::{Cache, octree_key};
use super::exact::ExactView;
use super::record::OctreeRow;
use crate::content_hash::image_key;
use crate::growth::predict;
use crate::matrix_parts::LeftOut;
use crate::paper_bench::levels::{GROWTH, PEAK};
use crate::scene::{NamedView, Scene};
use crate::system::proc::resident_bytes;
use crate::units::GB;
use crate::{BenchError, Progress};

/// An octree and how it is cast.
pub(crate) struct Sample {
    pub(crate) octree: Arc<Octree>,
    pub(crate) row: OctreeRow,
    pub(crate) casts: Vec<CastOptions>,
}

/// Where exact answers come from.
pub(crate) enum Truth<'a> {
    /// The triangles of a mesh, and the cache's name of the mesh.
    Triangles { mesh: &'a Mesh, triangles: &'a TriangleScene, key: &'a str },
    /// The octree's leaves.
    Leaves,
}

/// What is swept.
pub(crate) struct Subject<'a> {
    /// The scene's name, or the file's.
    pub(crate) name: &'a str,
    pub(crate) samples: Vec<Sample>,
    pub(crate) views: &'a [NamedView],
    pub(crate) size: [u32; 2],
    pub(crate) truth: Truth<'a>,
    pub(crate) cache: &'a Cache,
    /// The exact answers so far. Rays of a view depend on the position of the root cube, which is the same for all octrees of a mesh.
    exact: Vec<ExactView>,
}

impl<'a> Subject<'a> {
    pub(crate) fn new(
        name: &'a str,
        samples: Vec<Sample>,
        views: &'a [NamedView],
        size: [u32; 2],
        truth: Truth<'a>,
        cache: &'a Cache,
    ) -> Self {
        Self { name, samples, views, size, truth, cache, exact: Vec::new() }
    }

    pub(crate) fn failed(&self, error: impl ToString) -> BenchError {
        BenchError::scene(self.name, error)
    }

    /// The views of an octree.
    pub(crate) fn views_of(&self, octree: &Octree, cast: &CastOptions) -> Result<Vec<View>, BenchError> {
        let object = Object::of(octree, 0);
        let views = self.views.iter().map(|named| object.view(&named.camera, self.size.into(), cast));
        views.collect::<Result<_, CastError>>().map_err(|e| self.failed(e))
    }

    /// Indices of the exact answers of an octree's views.
    pub(crate) fn find_exact(&mut self, octree: &Arc<Octree>, views: &[View]) -> Result<Vec<usize>, BenchError> {
        let mut found = Vec::new();
        for view in views {
            let rays = CameraRays::of_view(view, octree.octree_to_mesh(0));
            let known = self.exact.iter().position(|known| *known.rays() == rays);
            let index = match known {
                Some(index) => index,
                None => {
                    let exact = self.answer(octree, view, rays)?;
                    self.exact.push(exact);
                    self.exact.len() - 1
                }
            };
            found.push(index);
        }
        Ok(found)
    }

    fn answer(&self, octree: &Arc<Octree>, view: &View, rays: CameraRays) -> Result<ExactView, BenchError> {
        match self.truth {
            Truth::Triangles { mesh, triangles, key } => {
                ExactView::of_triangles(mesh, triangles, rays, key, self.cache)
            }
            Truth::Leaves => ExactView::of_leaves(octree, view).map_err(|e| self.failed(e)),
        }
    }

    /// An exact answer by its index.
    pub(crate) fn exact(&self, index: usize) -> &ExactView {
        &self.exact[index]
    }
}

/// The row of an octree.
pub(crate) fn row(octree: &Octree, levels: u32, contours: bool, build_seconds: Option<f64>) -> OctreeRow {
    let stats = esvo_format::stats(octree);
    let mut counter = Counter(0);
    // A counter refuses nothing.
    let _ = octree.write_to(&mut counter);
    OctreeRow {
        levels,
        contours,
        image_sha256: image_key(octree),
        voxels: stats.voxels,
        image_bytes: stats.image_bytes,
        file_bytes: counter.0,
        build_seconds,
    }
}

/// Counts bytes.
struct Counter(u64);

impl Write for Counter {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0 += bytes.len() as u64;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

/// Most voxels that the first level that is asked for may have: nothing tells what it takes.
const MOST_LEAVES: f64 = 1e9;

/// The octrees of a scene, with and without contours, at these levels: from the cache, or built. What is expected to need more
/// memory than the limit is left out, and so are the levels below it.
pub(crate) fn build_all(
    scene: &Scene,
    key: &str,
    levels: &[u32],
    memory_gb: f64,
    cache: &Cache,
    progress: &Progress,
    left_out: &mut Vec<LeftOut>,
) -> Result<Vec<(Arc<Octree>, OctreeRow)>, BenchError> {
    let mut all = Vec::new();
    for contours in [false, true] {
        let kind = if contours { "contours" } else { "cubical" };
        let mut bytes: Vec<f64> = Vec::new();
        for &levels in levels {
            let expected = predict(&bytes, GROWTH).unwrap_or(0.0) * PEAK + resident_bytes() as f64;
            if !bytes.is_empty() && expected > memory_gb * GB {
                left_out.push(LeftOut {
                    what: format!("{}, {kind}, from {levels} levels on", scene.name),
                    reason: format!(
                        "would take about {:.1} GB of memory, and the limit is {memory_gb}; see --memory",
                        expected / GB
                    ),
                });
                break;
            }
            let leaves = esvo_builder::expected_leaves(&scene.mesh, levels);
            if bytes.is_empty() && leaves > MOST_LEAVES {
                left_out.push(LeftOut {
                    what: format!("{}, {kind}, from {levels} levels on", scene.name),
                    reason: format!(
                        "may have {:.1} billion voxels, and no level above tells how many; add levels above",
                        leaves / 1e9
                    ),
                });
                break;
            }
            let settings = BuildSettings { levels, contours, ..scene.settings };
            let (octree, seconds) = build(scene, key, &settings, cache, progress)?;
            let row = row(&octree, levels, contours, seconds);
            bytes.push(row.image_bytes as f64);
            all.push((Arc::new(octree), row));
        }
    }
    Ok(all)
}

/// An octree from the cache, or built; with the seconds of the build.
fn build(
    scene: &Scene,
    key: &str,
    settings: &BuildSettings,
    cache: &Cache,
    progress: &Progress,
) -> Result<(Octree, Option<f64>), BenchError> {
    let key = octree_key(key, settings);
    if let Some(octree) = cache.octree(&key) {
        return Ok((octree, None));
    }
    let kind = if settings.contours { "with contours" } else { "cubical" };
    let what = format!("{}: building {} levels {kind}", scene.name, settings.levels);
    let start = std::time::Instant::now();
    let built = esvo_builder::build(&scene.mesh, settings, &|p| {
        progress.fraction(&what, p.done, &format!("{:.1} M voxels", p.voxels as f64 / 1e6));
    })
    .map_err(|e| BenchError::scene(&scene.name, e))?;
    let seconds = start.elapsed().as_secs_f64();
    cache.put_octree(&key, &built.octree)?;
    Ok((built.octree, Some(seconds)))
}
