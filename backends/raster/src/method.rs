//! The methods of voxelization.

use std::fmt;
use std::str::FromStr;

use esvo_device::wgpu::Features;

/// How a mesh is voxelized. The letters are those of tables.
///
/// | | method | pixels that are shaded | voxels of a shaded pixel |
/// |---|---|---|---|
/// | a | `FixedAxis` | centre covered | the one at the depth of the pixel's centre |
/// | b | `DominantAxis` | centre covered | the same |
/// | c | `Expanded` | touched, and more at acute corners | the same |
/// | c' | `ExpandedClipped` | those within the expanded bounding box | the same |
/// | d | `ExpandedTested` | the same | all that pass the separating axis test |
/// | e4, e8 | `Multisampled` | a sample is covered | the one at the depth of the pixel's centre |
/// | f | `Hardware` | touched, by the device | the same |
/// | f+ | `HardwareTested` | touched, by the device | all that pass the separating axis test |
/// | g | `Compute` | none | all that pass the separating axis test |
///
/// All but `FixedAxis` project a triangle along the axis that its normal has its largest component along.
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Debug)]
pub enum Method {
    /// All triangles are projected along the z axis.
    FixedAxis,
    /// Each triangle is projected along the axis in which it is largest.
    DominantAxis,
    /// Conservative rasterization by moving the edges outwards by half a pixel.
    Expanded,
    /// The same; pixels outside of the triangle's bounding box, expanded by half a pixel, are dropped.
    ExpandedClipped,
    /// The same; every voxel of the column that the triangle's plane meets is tested.
    ExpandedTested,
    /// A multisampled target with this many samples, 4 or 8.
    Multisampled(u32),
    /// The device's conservative rasterization.
    Hardware,
    /// The same; every voxel of the column that the triangle's plane meets is tested.
    HardwareTested,
    /// A compute shader that tests voxels. What single precision cannot decide is decided on the processor, so that it finds
    /// exactly the voxels that the caller's own decision gives.
    Compute,
}

impl Method {
    /// All methods, in the order of tables.
    pub const ALL: [Self; 10] = [
        Self::FixedAxis,
        Self::DominantAxis,
        Self::Expanded,
        Self::ExpandedClipped,
        Self::ExpandedTested,
        Self::Multisampled(4),
        Self::Multisampled(8),
        Self::Hardware,
        Self::HardwareTested,
        Self::Compute,
    ];

    /// The letter in tables.
    #[must_use]
    pub fn letter(self) -> &'static str {
        match self {
            Self::FixedAxis => "a",
            Self::DominantAxis => "b",
            Self::Expanded => "c",
            Self::ExpandedClipped => "c'",
            Self::ExpandedTested => "d",
            Self::Multisampled(4) => "e4",
            Self::Multisampled(_) => "e8",
            Self::Hardware => "f",
            Self::HardwareTested => "f+",
            Self::Compute => "g",
        }
    }

    /// The name, as [`FromStr`] reads it.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::FixedAxis => "fixed-axis",
            Self::DominantAxis => "dominant-axis",
            Self::Expanded => "expanded",
            Self::ExpandedClipped => "expanded-clipped",
            Self::ExpandedTested => "expanded-tested",
            Self::Multisampled(4) => "multisampled-4",
            Self::Multisampled(_) => "multisampled-8",
            Self::Hardware => "hardware",
            Self::HardwareTested => "hardware-tested",
            Self::Compute => "compute",
        }
    }

    /// Whether voxels are tested, so that the result differs from the exact one within [`bounds`](crate::bounds) at most.
    #[must_use]
    pub fn is_tested(self) -> bool {
        matches!(self, Self::ExpandedTested | Self::HardwareTested | Self::Compute)
    }

    /// Samples of a pixel.
    pub(crate) fn samples(self) -> u32 {
        if let Self::Multisampled(samples) = self { samples } else { 1 }
    }

    /// What the device must have.
    pub(crate) fn features(self) -> Features {
        match self {
            Self::Hardware | Self::HardwareTested => Features::CONSERVATIVE_RASTERIZATION,
            _ => Features::empty(),
        }
    }
}

impl fmt::Display for Method {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Method {
    type Err = String;

    /// Reads a name or a letter.
    fn from_str(text: &str) -> Result<Self, String> {
        Self::ALL.into_iter().find(|method| method.name() == text || method.letter() == text).ok_or_else(|| {
            let names: Vec<_> =
                Self::ALL.iter().map(|method| format!("{} ({})", method.name(), method.letter())).collect();
            format!("there is no method {text}; there are {}", names.join(", "))
        })
    }
}
