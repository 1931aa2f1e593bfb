//! Builds in parts: a part has the subtrees of some cubes of level 4, in a file; joined, they give the bytes of a build that was never
//! shared out.
//!
//! Every part knows the nodes above these cubes but for what depends on the subtrees. The join goes through them as a build does, and
//! takes each pair of cubes out of the part that has it, as a build that is continued takes them out of its journal.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use esvo_format::file::ObjectEntry;
use esvo_format::{BlockStore, StoredBlocks, Tree, WriteOptions, pack};
use glam::DMat4;
use rayon::prelude::*;
use sha2::{Digest, Sha256};

use super::journal::{Finished, Journal, RESULTS, fingerprint};
use super::part_file::{self, Header, PartFile};
use super::progress::Progress;
use super::recursion::{Cube, JOURNAL_LEVEL, Recursion, block_nodes, cut, end_node};
use super::share::{BuildPlan, top_key};
use super::{BYTES_PER_THREAD, FileOptions, memory_of, metadata, no_surface, threads_within};
use crate::surface::Surface;
use crate::surface::attributes::Mean;
use crate::{BuildError, BuildSettings, Mesh};

/// A part of a build that was built.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct BuiltPart {
    /// Its number, from 1.
    pub part: u32,
    /// The number of parts.
    pub parts: u32,
    /// Cubes of level 4 with surface in it.
    pub cubes: u32,
    /// Voxels in it, and in the nodes above its cubes.
    pub voxels: u64,
}

/// Builds part `part` of `parts`, counted from 1, of an octree into a file. The parts, one file each, are [joined](join_parts) to the file that
/// [`build_file`](super::build_file) writes. Which cubes belong to which part says [`BuildPlan`].
///
/// Of `options`, those of [`write`](FileOptions::write) have no effect: the join has its own.
///
/// # Errors
/// Those of [`build_file`](super::build_file); a number of parts or of the part that is out of range.
pub fn build_part(
    mesh: &Mesh,
    settings: &BuildSettings,
    (part, parts): (u32, u32),
    path: &Path,
    options: &FileOptions,
    progress: &(dyn Fn(Progress) + Sync),
) -> Result<BuiltPart, BuildError> {
    settings.check()?;
    let threads =
        options.memory_limit.map(|limit| threads_within(memory_of(mesh), BYTES_PER_THREAD, limit)).transpose()?;
    let in_pool = || build_part_here(mesh, settings, (part, parts), path, options, progress);
    match threads.filter(|n| *n < rayon::current_num_threads()) {
        Some(threads) => {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            pool.map_err(|e| BuildError::Threads(e.to_string()))?.install(in_pool)
        }
        None => in_pool(),
    }
}

fn build_part_here(
    mesh: &Mesh,
    settings: &BuildSettings,
    (part, parts): (u32, u32),
    path: &Path,
    options: &FileOptions,
    progress: &(dyn Fn(Progress) + Sync),
) -> Result<BuiltPart, BuildError> {
    let surface = Surface::new(mesh, settings)?;
    if part == 0 || part > parts {
        let value = format!("{part}/{parts}");
        return Err(BuildError::Setting { name: "part", value, range: "1 to the number of parts, as in 2/7" });
    }
    if !super::share::PARTS.contains(&parts) {
        return Err(BuildError::Setting { name: "parts", value: parts.to_string(), range: "1 to 4096" });
    }
    let plan = BuildPlan::of(&surface.corners, settings.levels, parts);
    let build = fingerprint(mesh, None, settings, RESULTS);
    // Parts are kept apart from those of whole builds and of other parts.
    let mut own = Sha256::new();
    own.update(build);
    own.update(format!("part {part} of {parts}"));
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    // Without `resume`, nothing is left of a build that fails.
    let mut hidden = None;
    let beside = if options.resume {
        path.to_owned()
    } else {
        let made = tempfile::tempdir_in(folder).map_err(|e| BuildError::io(folder, e))?;
        hidden.insert(made).path().join("part")
    };
    let (journal, store) = Journal::open_as(&beside, own.finalize().into())?;
    if journal.resumed() > 0 {
        progress(Progress { done: 0.0, voxels: 0, resumed: journal.resumed() });
    }
    let mut header = Header::new(settings, build, (part, parts));
    let (tops, voxels) =
        Recursion::new(&surface, settings, &store, Some(&journal), progress).run_share(plan.cubes(part))?;
    header.tops = tops;
    header.voxels = voxels;
    header.columns = surface.columns.clone();
    header.octree_to_mesh = surface.octree_to_mesh.to_cols_array();
    header.meta = if options.meta.is_empty() { metadata(settings, mesh.triangles.len()) } else { options.meta.clone() };
    for planned in plan.parts() {
        header.owners.extend(plan.cubes(planned.part).iter().map(|path| (*path, planned.part)));
    }
    drop(store);
    let [mut records, mut blocks] = journal.files()?;
    part_file::write(path, &header, &mut records, &mut blocks)?;
    journal.remove()?;
    Ok(BuiltPart { part, parts, cubes: plan.cubes(part).len() as u32, voxels })
}

/// Whether a file is a part of a build.
///
/// # Errors
/// Those of reading it.
pub fn is_part(path: &Path) -> std::io::Result<bool> {
    part_file::is_part(path)
}

/// Joins the parts of a build, in any order, to the file of the whole octree: the bytes are those of [`build_file`](super::build_file) with the
/// same mesh, settings, metadata and options. Memory is needed for what is not in blocks, not for the octree.
///
/// # Errors
/// A file that is no part, is damaged, or belongs to another build or another number of parts; a part that is given twice or is
/// missing: each is named. Those of reading and writing files. Nothing is left half written.
pub fn join_parts(paths: &[PathBuf], output: &Path, options: &WriteOptions) -> Result<ObjectEntry, BuildError> {
    let mut parts: Vec<PartFile> = paths.par_iter().map(|path| PartFile::open(path)).collect::<Result<_, _>>()?;
    check(&parts)?;
    let files = parts.iter_mut().map(|part| {
        let file = part.file.try_clone().map_err(|e| BuildError::io(&part.path, e))?;
        let summaries = part.take_summaries();
        Ok(StoredBlocks { path: part.path.clone(), file, start: part.blocks, summaries })
    });
    let (store, firsts) = BlockStore::in_files(files.collect::<Result<_, BuildError>>()?)?;
    let by_number: BTreeMap<u32, (&PartFile, u32)> =
        parts.iter().zip(firsts).map(|(part, first)| (part.header.part, (part, first))).collect();
    let Some((first, _)) = by_number.values().next().copied() else {
        return Err(BuildError::PartsMissing("no part of a build is given".into()));
    };
    let join = Join {
        header: &first.header,
        parts: by_number,
        store: &store,
        block_nodes: block_nodes(&first.header.settings.assemble),
    };
    let mut tree = join.tree();
    join.push(&mut tree, &Cube::ROOT, 0)?.ok_or_else(no_surface)?;
    let root = store.put(pack(&tree, None, &first.header.settings.assemble)?)?;
    drop(tree);
    let transform = DMat4::from_cols_array(&first.header.octree_to_mesh);
    Ok(store.write(root, transform, &first.header.meta, output, options)?)
}

/// Whether these are all parts of one build, each once.
fn check(parts: &[PartFile]) -> Result<(), BuildError> {
    let Some(first) = parts.first() else { return Ok(()) };
    let shared = first.header.shared();
    let mut found: BTreeMap<u32, &PartFile> = BTreeMap::new();
    for part in parts {
        let bad = |what: String| Err(BuildError::PartFile { path: part.path.clone(), what });
        let (own, other) = (&part.header, &first.header);
        let others = first.path.display();
        if own.build != other.build {
            return bad(format!(
                "is of another build than {others}: another mesh, other settings or another version of esvo; join the parts of \
                 one build"
            ));
        }
        if own.parts != other.parts {
            return bad(format!(
                "is one of {} parts, {others} one of {}; join parts of one division",
                own.parts, other.parts
            ));
        }
        if own.shared() != shared {
            return bad(format!("differs from {others} in what all parts share; build both again with one version"));
        }
        if let Some(twice) = found.insert(own.part, part) {
            let what = format!("is part {} of {}, and so is {}", own.part, own.parts, twice.path.display());
            return bad(what + "; leave one out");
        }
    }
    let count = first.header.parts;
    let missing: Vec<String> = (1..=count).filter(|k| !found.contains_key(k)).map(|k| format!("{k}/{count}")).collect();
    if missing.is_empty() {
        return Ok(());
    }
    let (shown, more) = (missing[..missing.len().min(8)].join(", "), missing.len().saturating_sub(8));
    let more = if more > 0 { format!(" and {more} more") } else { String::new() };
    Err(BuildError::PartsMissing(format!("parts {shown}{more} are missing: build them with --part, and join all")))
}

/// A join of parts.
struct Join<'a> {
    /// Of any part: all have the same nodes above their cubes.
    header: &'a Header,
    /// The parts by their numbers, with the numbers of their first blocks.
    parts: BTreeMap<u32, (&'a PartFile, u32)>,
    store: &'a BlockStore,
    block_nodes: usize,
}

impl Join<'_> {
    fn tree(&self) -> Tree {
        let mut tree = Tree::default();
        tree.plain = self.header.settings.plain_attributes;
        tree.columns = self.header.columns.clone();
        tree
    }

    /// Pushes the node of a cube above those of the parts, and what is below it: `Recursion::push` over what is known. `None`
    /// if there is no surface.
    fn push(&self, tree: &mut Tree, cube: &Cube, path: u32) -> Result<Option<Mean>, BuildError> {
        let Some(top) = self.header.tops.get(&top_key(path, cube.level)) else { return Ok(None) };
        let mut children = top.children();
        let node = tree.open(&std::array::from_fn(|slot| children[slot].voxel));
        let inner: Vec<usize> = (0..8).filter(|slot| children[*slot].voxel.is_some_and(|voxel| !voxel.leaf)).collect();
        let mut found = [None; 8];
        for pair in inner.chunks(2) {
            let child = |slot: usize| (cube.child(slot), path << 3 | slot as u32);
            if cube.level + 1 == JOURNAL_LEVEL {
                let finished = self.finished(child(pair[0]).1)?;
                tree.append(&finished.tree);
                pair.iter().zip(finished.means).for_each(|(slot, mean)| found[*slot] = mean);
            } else {
                let mut own = self.tree();
                for &slot in pair {
                    let (cube, path) = child(slot);
                    found[slot] = self.push(&mut own, &cube, path)?;
                }
                tree.append(&own);
            }
        }
        let settings = &self.header.settings;
        let mean = end_node(tree, node, &mut children, &found, top.keeps, settings);
        if mean.is_some() {
            cut(tree, node, cube, self.block_nodes, settings, self.store)?;
        }
        Ok(mean)
    }

    /// What was made of the cubes whose first has this path.
    fn finished(&self, path: u32) -> Result<Finished, BuildError> {
        let owner = self.header.owners.get(&path).and_then(|part| self.parts.get(part));
        let Some((part, first)) = owner else { return Ok(Finished::default()) };
        let Some(mut finished) = part.finished(path)? else {
            return Err(BuildError::PartFile {
                path: part.path.clone(),
                what: format!("lacks the cube with path {path:o}; build this part again"),
            });
        };
        finished.tree.move_blocks(*first)?;
        Ok(finished)
    }
}
