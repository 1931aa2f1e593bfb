//! Figures of the paper authors' own builder on the same meshes. They were measured separately.

use serde::Deserialize;

/// All figures of the authors' builder.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Authors {
    build: Vec<TheirBuild>,
    error: Vec<TheirError>,
}

/// One build by the authors' builder, with contours.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct TheirBuild {
    scene: String,
    levels: u32,
    /// Whether the mesh was the same as ours.
    #[serde(default = "yes")]
    pub(crate) own_mesh: bool,
    pub(crate) seconds: f64,
    /// Seconds of a build while other programs ran, if measured.
    pub(crate) seconds_busy: Option<f64>,
    pub(crate) peak_mib: f64,
    pub(crate) mib: f64,
    /// Millions.
    pub(crate) descriptors: f64,
    /// Millions.
    pub(crate) leaves: f64,
    /// Millions.
    pub(crate) contours: f64,
    pub(crate) bytes_per_voxel: f64,
}

/// The error of one octree of the authors' builder: lowest and highest value of two cameras.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct TheirError {
    scene: String,
    levels: u32,
    termination: Termination,
    pub(crate) median: [f64; 2],
    pub(crate) p90: [f64; 2],
    pub(crate) p99: [f64; 2],
    pub(crate) disagreement_percent: [f64; 2],
}

/// The termination of rays.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Termination {
    /// At voxels of one pixel; errors are in pixels.
    Pixel,
    /// At leaves only; errors are in finest voxels.
    None,
}

fn yes() -> bool {
    true
}

impl Authors {
    pub(crate) fn figures() -> Self {
        toml::from_str(include_str!("../../data/authors_builder.toml")).expect("checked by a test")
    }

    /// The authors' build of a scene.
    pub(crate) fn build(&self, scene: &str, levels: u32) -> Option<&TheirBuild> {
        self.build.iter().find(|b| b.scene == scene && b.levels == levels)
    }

    /// The error of the authors' octree of a scene.
    pub(crate) fn error(&self, scene: &str, levels: u32, termination: Termination) -> Option<&TheirError> {
        self.error.iter().find(|e| e.scene == scene && e.levels == levels && e.termination == termination)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::units::MIB;

    #[test]
    fn figures_agree_with_each_other() {
        let authors = Authors::figures();
        for build in &authors.build {
            let voxels = (build.descriptors + build.leaves) * 1e6;
            let found = build.mib * MIB / voxels;
            assert!((found / build.bytes_per_voxel - 1.0).abs() < 0.02, "{} {}: {found}", build.scene, build.levels);
        }
        assert!(authors.build("HAIRBALL", 10).is_some_and(|b| !b.own_mesh));
        assert!(authors.build("SIBENIK", 11).is_none());
        let error = authors.error("SIBENIK", 12, Termination::Pixel).unwrap();
        assert!(error.median[1] < error.p90[0] && error.p90[1] < error.p99[0]);
    }
}
