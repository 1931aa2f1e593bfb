//! Settings of a build, and named presets.

use esvo_format::{AssembleOptions, RawNormal};
use serde::{Deserialize, Serialize};

use crate::BuildError;

/// What the decoded attributes of a voxel are compared with to decide whether they require finer voxels.
///
/// In every case what counts is what a reader sees: what the block of sixteen voxels decodes to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TextureTest {
    /// The least and greatest of all texels, vertex colours and normals on the surface in the voxel, as the authors' builder
    /// does. Textures are those of the full image, and only texels whose filtered colour shows in the voxel count.
    #[default]
    Texels,
    /// As `Texels`, with the textures averaged to the size of the finest voxels: detail that no voxel could show refines
    /// none. Bounds are of boxes around the surface, so somewhat wider. Fewer voxels than `Texels` where textures are finer
    /// than the finest voxels.
    Averages,
    /// One colour and one normal for each triangle's part of the voxel, taken at its centroid and filtered to the voxel's
    /// size. Detail within a single triangle does not count, so a large flat wall may show its texture no finer than its
    /// shape requires. The smallest files and the shortest builds. Records of before have it as `samples`.
    #[serde(alias = "samples")]
    Centroids,
}

/// Named combinations of settings.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Preset {
    /// For a first look: shapes within the diagonal of a voxel at level 12.
    Fast,
    /// The authors' defaults: 15, 16 steps, 0.01.
    Balanced,
    /// Small files with a moderate shape error: attributes hardly ever require finer voxels.
    Small,
    /// Attributes twice as exact as the authors' defaults, and shapes likewise.
    Fine,
}

/// Which components of the mesh's materials are stored: none by default.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ComponentSettings {
    /// Emitted light. Materials that scatter none are black then, and no longer have the colour of their emission.
    pub emission: bool,
    /// Roughness and metalness.
    pub roughness_metalness: bool,
    /// Opacity of materials that blend.
    pub opacity: bool,
    /// Number of the material.
    pub material: bool,
}

impl ComponentSettings {
    /// Nothing.
    pub const NONE: Self = Self { emission: false, roughness_metalness: false, opacity: false, material: false };
    /// What says how a voxel looks: everything but the number of the material.
    pub const LOOK: Self = Self { emission: true, roughness_metalness: true, opacity: true, material: false };

    /// The names of what is stored, as in `esvo build --components`.
    pub fn names(&self) -> Vec<&'static str> {
        let all = [
            (self.emission, "emission"),
            (self.roughness_metalness, "roughness"),
            (self.opacity, "opacity"),
            (self.material, "material"),
        ];
        all.into_iter().filter(|(stored, _)| *stored).map(|(_, name)| name).collect()
    }
}

/// Settings of a build. The error bounds have the units and, with the default test, the meaning of those in the authors'
/// builder.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct BuildSettings {
    /// Deepest level, 1..=23. The edge of the smallest voxels is `2^-levels` of the root cube's.
    pub levels: u32,
    /// Whether voxels get contours. Without them all geometry is refined to the deepest level.
    pub contours: bool,
    /// Largest distance of a voxel's shape from the surface, given as a level, 0 to 23: the diagonal of a voxel of that level.
    pub contour_error: f64,
    /// Largest deviation of a decoded colour channel from what it represents, in steps of 1/256, 0 to 256.
    pub color_error: f64,
    /// Largest deviation of a decoded normal's component from what it represents, 0 to 2 (components of a unit normal are -1 to
    /// 1).
    pub normal_error: f64,
    /// What `color_error` and `normal_error` are compared with.
    pub texture_test: TextureTest,
    /// Whether colours are stored.
    pub colors: bool,
    /// Whether normals are stored.
    pub normals: bool,
    /// Whether colours and normals are stored uncompressed, 4 bytes each, instead of in compressed blocks: for reference.
    pub plain_attributes: bool,
    /// Which components are stored where some voxel does not have their default.
    #[serde(skip)]
    pub components: ComponentSettings,
    /// How the octree is cut into blocks.
    #[serde(skip)]
    pub assemble: AssembleOptions,
}

impl Default for BuildSettings {
    /// Ten levels, contours, and the authors' defaults 16 / 0.01 / 15.
    fn default() -> Self {
        Self {
            levels: 10,
            contours: true,
            contour_error: 15.0,
            color_error: 16.0,
            normal_error: 0.01,
            texture_test: TextureTest::default(),
            colors: true,
            normals: true,
            plain_attributes: false,
            components: ComponentSettings::NONE,
            assemble: AssembleOptions::default(),
        }
    }
}

impl BuildSettings {
    /// Whether voxels have a colour or a normal. If not, the surface is not looked up for them.
    pub(crate) fn stores_attributes(&self) -> bool {
        self.colors || self.normals
    }

    /// Those of the attributes that are stored.
    pub(crate) fn wanted(&self, color: [u8; 3], normal: RawNormal) -> (Option<[u8; 3]>, Option<RawNormal>) {
        (self.colors.then_some(color), self.normals.then_some(normal))
    }

    /// Checks the ranges.
    ///
    /// # Errors
    /// The first setting that is out of its range.
    pub fn check(&self) -> Result<(), BuildError> {
        let bad = |name, value: String, range| Err(BuildError::Setting { name, value, range });
        if !(1..=23).contains(&self.levels) {
            return bad("levels", self.levels.to_string(), "between 1 and 23");
        }
        for (name, value, most, range) in [
            ("contour-error", self.contour_error, 23.0, "a level, 0 to 23"),
            ("color-error", self.color_error, 256.0, "0 to 256 steps"),
            ("normal-error", self.normal_error, 2.0, "0 to 2"),
        ] {
            if !(0.0..=most).contains(&value) {
                return bad(name, value.to_string(), range);
            }
        }
        Ok(())
    }

    /// The settings of a preset, with ten levels.
    pub fn preset(preset: Preset) -> Self {
        let (contour_error, color_error, normal_error) = match preset {
            Preset::Fast => (12.0, 32.0, 0.1),
            Preset::Balanced => (15.0, 16.0, 0.01),
            Preset::Small => (13.0, 64.0, 0.25),
            Preset::Fine => (16.0, 8.0, 0.01),
        };
        let texture_test = match preset {
            Preset::Balanced | Preset::Fine => TextureTest::Texels,
            Preset::Fast | Preset::Small => TextureTest::Centroids,
        };
        Self { contour_error, color_error, normal_error, texture_test, ..Self::default() }
    }
}
