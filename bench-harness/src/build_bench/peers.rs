//! Figures of the paper authors' own builder on the same meshes, and those of an earlier commit of ours in the same run.

use serde::Deserialize;

use super::record::BuildRow;
use crate::error::depth::Summary;

/// All figures of the authors' builder.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Authors {
    /// The commit of ours that was measured in the same run, abbreviated.
    pub(crate) commit: String,
    octree: Vec<TheirOctree>,
}

/// One octree by the authors' builder, with contours.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct TheirOctree {
    scene: String,
    levels: u32,
    /// Whether the mesh was the same as ours.
    #[serde(default = "yes")]
    pub(crate) own_mesh: bool,
    pub(crate) authors: Figures,
    /// By [`Authors::commit`] in the same interleaved run.
    pub(crate) esvo: Option<Figures>,
}

/// Figures of an octree, as far as they were measured. Units are those of `authors_builder.toml`.
#[derive(Clone, Copy, PartialEq, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct Figures {
    /// Processor time of the process, import included.
    pub(crate) cpu_seconds: Option<f64>,
    /// By the clock, without import.
    pub(crate) seconds: Option<f64>,
    pub(crate) peak_mib: Option<f64>,
    pub(crate) million_voxels: Option<f64>,
    /// MB (10^6 bytes).
    pub(crate) mb: Option<f64>,
    /// Pixels.
    pub(crate) depth_at_pixel: Percentiles,
    /// Pixels.
    pub(crate) depth_at_leaves: Percentiles,
    /// Degrees.
    pub(crate) normals_at_pixel: Percentiles,
    /// Degrees.
    pub(crate) normals_at_leaves: Percentiles,
    /// Steps of 1/255.
    pub(crate) colors_at_pixel: Percentiles,
    /// Steps of 1/255.
    pub(crate) colors_at_leaves: Percentiles,
    pub(crate) flip_at_pixel: Option<f64>,
}

/// Percentiles of an error over the rays.
#[derive(Clone, Copy, PartialEq, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct Percentiles {
    pub(crate) median: Option<f64>,
    pub(crate) p90: Option<f64>,
    pub(crate) p99: Option<f64>,
}

impl Percentiles {
    fn of(errors: Option<&Summary>) -> Self {
        let of = |value: fn(&Summary) -> f64| errors.map(value);
        Self { median: of(|e| e.median), p90: of(|e| e.p90), p99: of(|e| e.p99) }
    }
}

fn yes() -> bool {
    true
}

impl Figures {
    /// Those of an octree of ours.
    pub(crate) fn of(row: &BuildRow) -> Self {
        let (pixel, leaves) = (row.attributes_at_pixel.as_ref(), row.attributes.as_ref());
        Self {
            cpu_seconds: row.cpu_seconds().map(|seconds| seconds.median),
            seconds: Some(row.seconds()),
            peak_mib: Some(row.peak_mib()),
            million_voxels: Some(row.build.voxels as f64 / 1e6),
            mb: Some(row.build.image_bytes as f64 / 1e6),
            depth_at_pixel: Percentiles::of(row.error_at_pixel.as_ref().map(|e| &e.pixels)),
            depth_at_leaves: Percentiles::of(row.error.as_ref().map(|e| &e.pixels)),
            normals_at_pixel: Percentiles::of(pixel.map(|e| &e.normals)),
            normals_at_leaves: Percentiles::of(leaves.map(|e| &e.normals)),
            colors_at_pixel: Percentiles::of(pixel.map(|e| &e.colors)),
            colors_at_leaves: Percentiles::of(leaves.map(|e| &e.colors)),
            flip_at_pixel: row.flip_at_pixel,
        }
    }
}

impl Authors {
    pub(crate) fn figures() -> Self {
        toml::from_str(include_str!("../../data/authors_builder.toml")).expect("checked by a test")
    }

    /// The authors' octree of a scene.
    pub(crate) fn octree(&self, scene: &str, levels: u32) -> Option<&TheirOctree> {
        self.octree.iter().find(|b| b.scene == scene && b.levels == levels)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_agree_with_each_other() {
        let authors = Authors::figures();
        for octree in &authors.octree {
            let at = format!("{} {}", octree.scene, octree.levels);
            for figures in [Some(octree.authors), octree.esvo].into_iter().flatten() {
                // Between cubes with block-compressed attributes and contours everywhere.
                let bytes = figures.mb.unwrap() / figures.million_voxels.unwrap();
                assert!((5.0..11.0).contains(&bytes), "{at}: {bytes} bytes per voxel");
                for errors in [figures.depth_at_pixel, figures.depth_at_leaves] {
                    assert!(errors.median <= errors.p90 && errors.p90 <= errors.p99, "{at}: {errors:?}");
                }
                assert!(figures.depth_at_leaves.p99 <= figures.depth_at_pixel.p99, "{at}");
            }
            assert_eq!(octree.own_mesh, octree.esvo.is_some(), "{at}");
        }
        assert!(authors.octree("HAIRBALL", 10).is_some_and(|b| !b.own_mesh));
        assert!(authors.octree("SIBENIK", 11).is_none());
        let [textured, plain] = ["SIBENIK", "SIBENIK-PLAIN"].map(|name| authors.octree(name, 12).unwrap().authors);
        assert!(textured.million_voxels > plain.million_voxels && textured.cpu_seconds > plain.cpu_seconds);
        assert!(textured.flip_at_pixel.is_some() && textured.colors_at_leaves.p99.is_some());
    }
}
