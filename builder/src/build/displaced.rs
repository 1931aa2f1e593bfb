//! Builds of a mesh that is displaced while it is built.

use std::path::Path;

use esvo_format::BlockStore;

use super::subtrees::{DisplacedPart, Found, Subtrees};
use super::{
    BYTES_PER_THREAD, BuildStats, Built, BuiltFile, FileOptions, Opened, Progress, Watch, build, build_file, memory_of,
    metadata, no_surface, threads_within,
};
use crate::displace::Source;
use crate::{BuildError, BuildSettings, DisplaceOptions, Mesh};

/// Builds an octree of `mesh` [displaced](crate::displace), without ever having the displaced mesh in memory as a whole.
///
/// Dices and displaces one subtree at a time on each thread, and drops its triangles when it is built. Cells are as large as
/// `displacement` says, however many triangles that makes; [`max_triangles`](DisplaceOptions::max_triangles) limits those of a
/// subtree, about, and so does the builder itself, to a quarter of a million.
///
/// Where [`displace`](crate::displace) does not enlarge the cells, the octree is that of [`build`] over the mesh that it returns, up
/// to the uppermost levels: voxels with more triangles than the limit have no contours here, and the means of their children as
/// attributes. The result does not depend on the number of threads.
///
/// If nothing moves, the octree is that of the mesh as it is.
///
/// # Errors
/// Those of [`displace`](crate::displace) and of [`build`].
pub fn build_displaced(
    mesh: &Mesh,
    displacement: &DisplaceOptions,
    settings: &BuildSettings,
    progress: &(dyn Fn(Progress) + Sync),
) -> Result<Built, BuildError> {
    settings.check()?;
    let mut watch = Watch::start();
    let Some(source) = Source::new(mesh, displacement, true)? else { return build(mesh, settings, progress) };
    let subtrees = Subtrees::new(&source, displacement, settings)?;
    let prepare = watch.lap();
    let store = BlockStore::in_memory();
    let found = subtrees.run(rayon::current_num_threads(), &store, None, progress)?;
    let root = found.root.ok_or_else(no_surface)?;
    let voxelize = watch.lap();
    let mut octree = store.octree(root, subtrees.octree_to_mesh)?;
    octree.set_meta(metadata(settings, found.triangles as usize));
    let stats = BuildStats { prepare, voxelize, assemble: watch.lap(), ..counts(&found) };
    Ok(Built { octree, stats })
}

/// As [`build_displaced`], into a file, with the options of [`build_file`]. The memory limit does not change the octree, only the
/// number of threads.
///
/// # Errors
/// Those of [`displace`](crate::displace) and of [`build_file`].
pub fn build_displaced_file(
    mesh: &Mesh,
    displacement: &DisplaceOptions,
    settings: &BuildSettings,
    path: &Path,
    options: &FileOptions,
    progress: &(dyn Fn(Progress) + Sync),
) -> Result<BuiltFile, BuildError> {
    settings.check()?;
    let mut watch = Watch::start();
    let Some(source) = Source::new(mesh, displacement, true)? else {
        return build_file(mesh, settings, path, options, progress);
    };
    let subtrees = Subtrees::new(&source, displacement, settings)?;
    let (shared, per_thread) = subtrees.bytes();
    // The mesh and its copy with normals.
    let fixed = 2 * memory_of(mesh) + shared;
    let all = rayon::current_num_threads();
    let within = |limit| threads_within(fixed, BYTES_PER_THREAD + per_thread, limit);
    let threads = options.memory_limit.map(within).transpose()?.map_or(all, |threads| threads.min(all));
    let prepare = watch.lap();
    let open = Opened::new(mesh, Some(displacement), settings, path, options, progress)?;
    let found = subtrees.run(threads, &open.store, open.journal.as_ref(), progress)?;
    let root = found.root.ok_or_else(no_surface)?;
    let voxelize = watch.lap();
    let meta = metadata(settings, found.triangles as usize);
    let (object, resumed_voxels) = open.write(root, subtrees.octree_to_mesh, &meta, path, options)?;
    let stats = BuildStats { prepare, voxelize, assemble: watch.lap(), ..counts(&found) };
    Ok(BuiltFile { object, stats, resumed: resumed_voxels > 0, resumed_voxels })
}

/// Calls `visit` with the parts of `mesh` [displaced](crate::displace) that [`build_displaced`] would build one after the other, from
/// all threads: for what needs every triangle but not all at once. Triangles that meet several parts are in all of them. If nothing
/// moves, the only part is the mesh as it is.
///
/// # Errors
/// Those of [`displace`](crate::displace).
pub fn visit_displaced(
    mesh: &Mesh,
    displacement: &DisplaceOptions,
    visit: &(dyn Fn(&Mesh) + Sync),
) -> Result<(), BuildError> {
    let order = |parts: &[DisplacedPart]| (0..parts.len()).map(|part| (part, ())).collect();
    visit_displaced_parts(mesh, displacement, order, |part, ()| {
        let triangles = part.triangles();
        if !triangles.triangles.is_empty() {
            visit(&triangles);
        }
    })
}

/// As [`visit_displaced`], for what needs some of the triangles: `order` is told all parts, and returns the indices of those that are
/// visited, in this order, each with what `visit` is told about it. A part may be visited several times. Nothing is diced but what
/// `visit` [asks for](DisplacedPart::triangles).
///
/// # Errors
/// Those of [`displace`](crate::displace).
pub fn visit_displaced_parts<T: Sync>(
    mesh: &Mesh,
    displacement: &DisplaceOptions,
    order: impl FnOnce(&[DisplacedPart<'_>]) -> Vec<(usize, T)>,
    visit: impl Fn(&DisplacedPart<'_>, &T) + Sync,
) -> Result<(), BuildError> {
    // The levels limit how far the root cube may be divided.
    let settings = BuildSettings { levels: 23, ..BuildSettings::default() };
    match Source::new(mesh, displacement, true)? {
        Some(source) => {
            Subtrees::new(&source, displacement, &settings)?.visit(rayon::current_num_threads(), order, visit)
        }
        None => {
            let whole = [DisplacedPart::whole(mesh)];
            order(&whole).iter().filter(|(part, _)| *part == 0).for_each(|(_, with)| visit(&whole[0], with));
            Ok(())
        }
    }
}

fn counts(found: &Found) -> BuildStats {
    let none = std::time::Duration::ZERO;
    let (triangles, dropped_triangles) = (found.triangles as usize, found.dropped as usize);
    BuildStats { triangles, dropped_triangles, prepare: none, voxelize: none, assemble: none }
}
