//! What a picture shows, and how it is made.

use clap::ValueEnum;
use esvo_core::filter::Radius;
use esvo_engines::EngineId;
use esvo_format::file::attachment;

/// How a picture is made: all that two pictures of one camera can differ by.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct Look {
    pub(crate) engine: EngineId,
    pub(crate) mode: ViewMode,
    pub(crate) filter: Filter,
    pub(crate) contours: bool,
    /// Edge of the blocks of the beam optimization in pixels.
    pub(crate) beam: Option<u32>,
}

impl Look {
    /// How far pixels are blurred; `None` for not at all. Only shaded pictures are.
    pub(crate) fn radius(&self) -> Option<Radius> {
        match self.filter {
            _ if self.mode != ViewMode::Shaded => None,
            Filter::Adapted => Some(Radius::Adapted),
            Filter::Own => Some(Radius::Own),
            Filter::Off => None,
        }
    }
}

/// What a picture shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum ViewMode {
    /// Colours and normals of the voxels, lit by a lamp at the camera
    Shaded,
    /// Iterations of each ray: black, violet, red, yellow; white from 64
    Iterations,
    /// Normals of the voxels as colours
    Normals,
    /// Near is white, far is black
    Depth,
    /// Levels of the voxels: black, violet, red, yellow; white is the deepest
    Levels,
    /// Sizes of the voxels: black is one pixel or less, white 64 pixels
    VoxelSize,
    /// Stored ambient occlusion
    Ambient,
    /// Light that the voxels emit
    Emission,
    /// Roughness of the voxels: smooth is black
    Roughness,
    /// Metalness of the voxels: metal is white
    Metalness,
    /// Opacity of the voxels: what is invisible would be black
    Opacity,
    /// Materials of the voxels, each in a colour of its own
    Material,
}

impl ViewMode {
    /// The type of the components that it shows, if it shows any.
    pub(crate) fn components(self) -> Option<u32> {
        Some(match self {
            Self::Emission => attachment::EMISSION,
            Self::Roughness | Self::Metalness => attachment::ROUGHNESS_METALNESS,
            Self::Opacity => attachment::OPACITY,
            Self::Material => attachment::MATERIAL,
            _ => return None,
        })
    }
}

/// How far a pixel is blurred.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Filter {
    /// As far as its voxel, but no farther than its neighbours: the paper's filter
    Adapted,
    /// As far as its voxel: seams show where levels change, as on the left of the paper's Figure 10
    Own,
    /// Not at all
    Off,
}
