//! Builds through a voxelizer on a GPU.

use clap::ValueEnum;
use esvo_builder::{BuildSettings, BuiltFile, FileOptions, Mesh};

use crate::commands::build::BuildArguments;
use crate::fail::Failure;

/// Who finds the voxels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(crate) enum VoxelizerName {
    /// The builder, on the processor
    #[default]
    Exact,
    /// A rasterizer on a GPU that tests voxels: none is missing, and single precision may add some
    Raster,
    /// A compute shader on a GPU: the same voxels as the builder's
    Compute,
}

/// Refuses options that a build through a voxelizer does not have.
pub(crate) fn check(arguments: &BuildArguments) -> Result<(), Failure> {
    if arguments.voxelizer == VoxelizerName::Exact {
        return Ok(());
    }
    let given = [
        ("--contour-error", arguments.contour_error.is_some()),
        ("--color-error", arguments.color_error.is_some()),
        ("--normal-error", arguments.normal_error.is_some()),
        ("--texture-test", arguments.texture_test.is_some()),
        ("--preset", arguments.preset.is_some()),
        ("--paper", arguments.paper.is_some()),
        ("--resume", arguments.resume),
        ("--memory-limit", arguments.memory_limit.is_some()),
        ("--part", arguments.part.is_some()),
    ];
    if let Some((option, _)) = given.into_iter().find(|(_, given)| *given) {
        let what = "does not apply to --voxelizer raster and compute, which divide all geometry down to the deepest level in memory; leave it out";
        return Err(format!("{option} {what}").into());
    }
    if !arguments.no_contours {
        return Err("--voxelizer raster and compute make no contours; add --no-contours".to_string().into());
    }
    Ok(())
}

/// What of a mesh's looks the voxelizer leaves out.
#[cfg(feature = "wgpu")]
fn left_out(mesh: &Mesh) -> Vec<&'static str> {
    let has = |of: &dyn Fn(&esvo_builder::Material) -> bool| mesh.materials.iter().any(of);
    let mut out = Vec::new();
    if has(&|material| material.alpha_cutoff.is_some()) {
        out.push("holes that alpha cuts are filled");
    }
    if has(&|material| material.normal_map.is_some()) {
        out.push("normal maps are left out");
    }
    out
}

/// Finds the voxels of a mesh on a GPU and writes their octree.
#[cfg(feature = "wgpu")]
pub(crate) fn build(
    arguments: &BuildArguments,
    mesh: &Mesh,
    source: &str,
    settings: &BuildSettings,
    options: &FileOptions,
) -> Result<BuiltFile, Failure> {
    use std::time::Instant;

    use esvo_bench::voxel_bench::voxelize_mesh;
    use esvo_builder::cells::{PreparedMesh, build_cells_file};
    use esvo_raster::{MAX_LEVEL, Method, Voxelizer, Wanted};

    use crate::fail::complain;

    let failed = |error: &dyn ToString| -> Failure { format!("{source}: {}", error.to_string()).into() };
    if settings.levels > MAX_LEVEL {
        return Err(
            format!("--levels {}: --voxelizer raster and compute make at most {MAX_LEVEL}", settings.levels).into()
        );
    }
    let start = Instant::now();
    let voxelizer = Voxelizer::open(None).map_err(|e| format!("--voxelizer: {e}"))?;
    let method = match arguments.voxelizer {
        VoxelizerName::Raster if voxelizer.check(Method::HardwareTested).is_ok() => Method::HardwareTested,
        VoxelizerName::Raster => Method::ExpandedTested,
        _ => Method::Compute,
    };
    for what in left_out(mesh) {
        complain("warning", &format!("{source}: {what} by --voxelizer {method}"));
    }
    let prepared = PreparedMesh::new(mesh, settings.levels).map_err(|e| failed(&e))?;
    let prepare = start.elapsed();
    let wanted = Wanted { colors: settings.colors, normals: settings.normals };
    let found = voxelize_mesh(&voxelizer, mesh, &prepared, settings.levels, method, wanted).map_err(|e| failed(&e))?;
    let voxelize = start.elapsed() - prepare;
    let mut built = build_cells_file(&found.cells, prepared.octree_to_mesh(), settings, &arguments.output, options)
        .map_err(|e| failed(&e))?;
    built.stats.triangles = mesh.triangles.len();
    built.stats.dropped_triangles = prepared.dropped();
    built.stats.prepare += prepare;
    built.stats.voxelize += voxelize;
    Ok(built)
}

/// Without a GPU's voxelizer.
#[cfg(not(feature = "wgpu"))]
pub(crate) fn build(
    _: &BuildArguments,
    _: &Mesh,
    _: &str,
    _: &BuildSettings,
    _: &FileOptions,
) -> Result<BuiltFile, Failure> {
    Err("--voxelizer raster and compute: this program was built without the feature wgpu".to_string().into())
}
