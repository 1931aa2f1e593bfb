//! The paper's figures: its Table 1 and Table 2, and what the authors' builder makes of our meshes.

use std::collections::BTreeMap;

use serde::Deserialize;

use crate::paper_bench::matrix::Variant;

/// The figures of the paper's two tables.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Paper {
    /// The machine that they were measured on.
    pub(crate) machine: PaperMachine,
    table1: Table1,
    table2: Table2,
    authors_builder: AuthorsBuilder,
}

/// The paper's machine.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct PaperMachine {
    /// The GPU that cast the rays.
    pub(crate) gpu: String,
    /// The processor that built the octrees.
    pub(crate) cpu: String,
    /// The version of CUDA.
    pub(crate) cuda: String,
}

#[derive(Debug, Deserialize)]
struct Table1 {
    levels: Vec<u32>,
    #[serde(flatten)]
    scenes: BTreeMap<String, Table1Figures>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Table1Figures {
    triangles: u64,
    mb: Vec<f64>,
    seconds: Vec<f64>,
    bytes_per_voxel: f64,
}

#[derive(Debug, Deserialize)]
struct Table2 {
    resolutions: Vec<String>,
    #[serde(flatten)]
    scenes: BTreeMap<String, Table2Figures>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Table2Figures {
    #[serde(default)]
    triangle: Vec<f64>,
    cubical: Vec<f64>,
    contours: Vec<f64>,
    beam: Vec<f64>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct AuthorsBuilder {
    levels: u32,
    bytes_per_voxel: BTreeMap<String, f64>,
}

impl Paper {
    /// All figures.
    pub(crate) fn figures() -> Self {
        toml::from_str(include_str!("../../data/paper_tables.toml")).expect("checked by a test")
    }

    /// Triangles of the paper's copy of a scene.
    pub(crate) fn triangles(&self, scene: &str) -> Option<u64> {
        Some(self.table1.scenes.get(scene)?.triangles)
    }

    /// Table 1: MB and seconds of a scene at a limit on its levels.
    pub(crate) fn build(&self, scene: &str, levels: u32) -> Option<(f64, f64)> {
        let column = self.table1.levels.iter().position(|&l| l == levels)?;
        let row = self.table1.scenes.get(scene)?;
        Some((*row.mb.get(column)?, *row.seconds.get(column)?))
    }

    /// Table 1: bytes per voxel of a scene's largest octree, and its levels.
    pub(crate) fn bytes_per_voxel(&self, scene: &str) -> Option<(f64, u32)> {
        let row = self.table1.scenes.get(scene)?;
        Some((row.bytes_per_voxel, *self.table1.levels.get(row.mb.len().checked_sub(1)?)?))
    }

    /// Bytes per voxel and levels of the octree that the authors' builder makes of our copy of a scene.
    pub(crate) fn authors_builder(&self, scene: &str) -> Option<(f64, u32)> {
        Some((*self.authors_builder.bytes_per_voxel.get(scene)?, self.authors_builder.levels))
    }

    /// Table 2: millions of rays per second.
    pub(crate) fn mrays(&self, scene: &str, [width, height]: [u32; 2], variant: Variant) -> Option<f64> {
        let row = self.table2.scenes.get(scene)?;
        let at = self.table2.resolutions.iter().position(|r| *r == format!("{width}x{height}"))?;
        let column = match variant {
            Variant::Triangles => &row.triangle,
            Variant::Cubical => &row.cubical,
            Variant::Contours => &row.contours,
            Variant::Beam => &row.beam,
        };
        column.get(at).copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_are_found() {
        let paper = Paper::figures();
        assert_eq!(paper.build("SIBENIK", 14), Some((1857.0, 336.0)));
        assert_eq!(paper.build("HAIRBALL", 12), None);
        assert_eq!(paper.bytes_per_voxel("CONFERENCE"), Some((5.16, 15)));
        assert_eq!(paper.authors_builder("SIBENIK"), Some((7.7, 12)));
        assert_eq!(paper.mrays("CONFERENCE", [2048, 1536], Variant::Beam), Some(140.8));
        assert_eq!(paper.mrays("SIBENIK-D", [512, 384], Variant::Triangles), None);
        assert_eq!(paper.triangles("CITY"), Some(879_000));
    }
}
