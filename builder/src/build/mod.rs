//! A build from start to end: in memory, or directly into a file.

mod cubes;
mod displaced;
mod expectation;
mod in_parts;
mod journal;
mod pair;
mod part_file;
mod progress;
mod recursion;
mod share;
mod subtrees;

use std::path::Path;
use std::time::{Duration, Instant};

use esvo_format::file::ObjectEntry;
use esvo_format::{BlockStore, Octree, WriteOptions};
use serde::Serialize;

pub use self::displaced::{build_displaced, build_displaced_file, visit_displaced, visit_displaced_parts};
pub use self::expectation::expected_leaves;
pub use self::in_parts::{BuiltPart, build_part, is_part, join_parts};
use self::journal::Journal;
pub use self::progress::Progress;
use self::recursion::Recursion;
pub(crate) use self::recursion::{Cube, append_by_slot, block_nodes};
pub use self::share::{BuildPlan, PlannedPart};
pub use self::subtrees::DisplacedPart;
use crate::surface::Surface;
use crate::{BuildError, BuildSettings, DisplaceOptions, Mesh};

/// What a build processed, and how long each phase took.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct BuildStats {
    /// Triangles in the mesh.
    pub triangles: usize,
    /// Triangles left out because they have no area.
    pub dropped_triangles: usize,
    /// Time to prepare the mesh.
    pub prepare: Duration,
    /// Time to find voxels, contours and attributes, and to encode them.
    pub voxelize: Duration,
    /// Time to order the blocks and set the pointers between them; with a file, also to write it.
    pub assemble: Duration,
}

impl BuildStats {
    /// Total time.
    pub fn total(&self) -> Duration {
        self.prepare + self.voxelize + self.assemble
    }
}

/// A finished build.
pub struct Built {
    /// The octree.
    pub octree: Octree,
    /// Counts and times.
    pub stats: BuildStats,
}

/// A finished build in a file.
pub struct BuiltFile {
    /// Counts and levels.
    pub object: ObjectEntry,
    /// Counts and times.
    pub stats: BuildStats,
    /// Whether an earlier, interrupted build had finished some of the voxels.
    pub resumed: bool,
    /// Number of the voxels that were taken over from it.
    pub resumed_voxels: u64,
}

/// How a file is built and written.
#[derive(Clone, Debug, Default)]
pub struct FileOptions {
    /// How the file is written.
    pub write: WriteOptions,
    /// The metadata section, a JSON object. If empty, the builder writes its own.
    pub meta: String,
    /// Keep finished parts in a folder next to the file, named like the file plus `.part`. If the folder exists already and
    /// belongs to the same mesh and settings, the build continues from there; if it belongs to another build, it is kept and
    /// [`BuildError::OtherWork`] is returned. The folder is removed when the file is complete.
    pub resume: bool,
    /// Bytes of memory that the build may use, including the mesh. If that is not enough for all threads, fewer are used.
    pub memory_limit: Option<u64>,
}

/// Builds an octree from a mesh on all threads of the current rayon pool. The result does not depend on their number.
///
/// `progress` is called from time to time, from any thread.
///
/// # Errors
/// A setting out of its range, a mesh that is not valid or has no surface, or an octree that the format cannot hold.
pub fn build(mesh: &Mesh, settings: &BuildSettings, progress: &(dyn Fn(Progress) + Sync)) -> Result<Built, BuildError> {
    settings.check()?;
    let mut watch = Watch::start();
    let surface = Surface::new(mesh, settings)?;
    let prepare = watch.lap();
    let store = BlockStore::in_memory();
    let root = Recursion::new(&surface, settings, &store, None, progress).run()?.ok_or_else(no_surface)?;
    let voxelize = watch.lap();
    let mut octree = store.octree(root, surface.octree_to_mesh)?;
    octree.set_meta(metadata(settings, mesh.triangles.len()));
    Ok(Built { octree, stats: stats(mesh, &surface, prepare, voxelize, watch.lap()) })
}

/// Builds an octree from a mesh directly into a file. Finished blocks go to a temporary file in the same folder at once, so
/// memory is needed for the mesh and the blocks in work, not for the whole octree. The bytes are those of [`build`] followed
/// by [`Octree::write_with`].
///
/// Either the complete file appears or none. A process that is about to end can call
/// [`remove_temporaries`](esvo_format::remove_temporaries).
///
/// # Errors
/// Those of [`build`]; an error of reading or writing files; a memory limit too small for one thread.
pub fn build_file(
    mesh: &Mesh,
    settings: &BuildSettings,
    path: &Path,
    options: &FileOptions,
    progress: &(dyn Fn(Progress) + Sync),
) -> Result<BuiltFile, BuildError> {
    settings.check()?;
    let threads =
        options.memory_limit.map(|limit| threads_within(memory_of(mesh), BYTES_PER_THREAD, limit)).transpose()?;
    let in_pool = || build_file_here(mesh, settings, path, options, progress);
    match threads.filter(|n| *n < rayon::current_num_threads()) {
        Some(threads) => {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            pool.map_err(|e| BuildError::Threads(e.to_string()))?.install(in_pool)
        }
        None => in_pool(),
    }
}

fn build_file_here(
    mesh: &Mesh,
    settings: &BuildSettings,
    path: &Path,
    options: &FileOptions,
    progress: &(dyn Fn(Progress) + Sync),
) -> Result<BuiltFile, BuildError> {
    let mut watch = Watch::start();
    let surface = Surface::new(mesh, settings)?;
    let prepare = watch.lap();
    let open = Opened::new(mesh, None, settings, path, options, progress)?;
    let root = Recursion::new(&surface, settings, &open.store, open.journal.as_ref(), progress).run()?;
    let root = root.ok_or_else(no_surface)?;
    let voxelize = watch.lap();
    let meta = metadata(settings, mesh.triangles.len());
    let (object, resumed_voxels) = open.write(root, surface.octree_to_mesh, &meta, path, options)?;
    let stats = stats(mesh, &surface, prepare, voxelize, watch.lap());
    Ok(BuiltFile { object, stats, resumed: resumed_voxels > 0, resumed_voxels })
}

/// The blocks of a file that is being built, and the journal if the build can be continued.
struct Opened {
    store: BlockStore,
    journal: Option<Journal>,
}

impl Opened {
    fn new(
        mesh: &Mesh,
        displaced: Option<&DisplaceOptions>,
        settings: &BuildSettings,
        path: &Path,
        options: &FileOptions,
        progress: &(dyn Fn(Progress) + Sync),
    ) -> Result<Self, BuildError> {
        if options.resume {
            let (journal, store) = Journal::open(path, mesh, displaced, settings)?;
            if journal.resumed() > 0 {
                progress(Progress { done: 0.0, voxels: 0, resumed: journal.resumed() });
            }
            return Ok(Self { store, journal: Some(journal) });
        }
        let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let file = tempfile::tempfile_in(folder).map_err(|e| BuildError::io(folder, e))?;
        Ok(Self { store: BlockStore::in_file(file, Vec::new()), journal: None })
    }

    /// Writes the file, and removes the journal. Returns the number of voxels that were taken over from an earlier build, too.
    fn write(
        self,
        root: u32,
        octree_to_mesh: glam::DMat4,
        own_meta: &str,
        path: &Path,
        options: &FileOptions,
    ) -> Result<(ObjectEntry, u64), BuildError> {
        let meta = if options.meta.is_empty() { own_meta } else { &options.meta };
        let object = self.store.write(root, octree_to_mesh, meta, path, &options.write)?;
        let resumed_voxels = self.journal.as_ref().map_or(0, Journal::resumed);
        if let Some(journal) = self.journal {
            journal.remove()?;
        }
        Ok((object, resumed_voxels))
    }
}

/// Bytes that one thread may need for the blocks in work, as measured on meshes of a million triangles.
const BYTES_PER_THREAD: u64 = 96 << 20;

/// The number of threads that fit into a memory limit, all in bytes.
fn threads_within(fixed: u64, per_thread: u64, limit: u64) -> Result<usize, BuildError> {
    let threads = limit.saturating_sub(fixed) / per_thread;
    if threads == 0 {
        return Err(BuildError::Memory { limit, least: fixed + per_thread });
    }
    Ok(usize::try_from(threads).unwrap_or(usize::MAX))
}

/// Bytes of a mesh and of what is prepared from it: corners and normals in octree space, textures with their bounds, and
/// the lists of pieces on the upper levels.
fn memory_of(mesh: &Mesh) -> u64 {
    let texels = |m: &crate::Material| m.texture.as_ref().map_or(0, |t| t.mips.iter().map(|l| l.texels.len()).sum());
    let texels: usize = mesh.materials.iter().map(texels).sum();
    let vertices = mesh.positions.len() * (24 + 12 + 8 + 12);
    (vertices + mesh.triangles.len() * (16 + 200) + texels * 14) as u64
}

fn no_surface() -> BuildError {
    BuildError::Mesh("alpha cuts out all of its surface; check the alpha of its materials and textures".into())
}

/// Measures the phases of a build.
struct Watch(Instant);

impl Watch {
    fn start() -> Self {
        Self(Instant::now())
    }

    fn lap(&mut self) -> Duration {
        let elapsed = self.0.elapsed();
        self.0 += elapsed;
        elapsed
    }
}

fn stats(mesh: &Mesh, surface: &Surface, prepare: Duration, voxelize: Duration, assemble: Duration) -> BuildStats {
    let (triangles, dropped_triangles) = (mesh.triangles.len(), surface.dropped);
    BuildStats { triangles, dropped_triangles, prepare, voxelize, assemble }
}

fn metadata(settings: &BuildSettings, triangles: usize) -> String {
    let mut meta = serde_json::json!({
        "generator": concat!("esvo-builder ", env!("CARGO_PKG_VERSION")),
        "triangles": triangles,
        "settings": settings,
    });
    let components = settings.components.names();
    if !components.is_empty() {
        meta["components"] = serde_json::json!(components);
    }
    meta.to_string()
}
