//! Materials: colour, holes and surface detail of triangles.

use std::sync::Arc;

use super::maps::{HeightMap, NormalMap, UvTransform};
use super::properties::Properties;
use super::texture::Texture;

/// How the surface of a set of triangles looks.
#[derive(Clone, Debug)]
pub struct Material {
    /// The name in the source file, or a generated one.
    pub name: String,
    /// Linear RGB and alpha, 0..=1. Multiplies the texture.
    pub base_color: [f32; 4],
    /// Colour texture, if any.
    pub texture: Option<Arc<Texture>>,
    /// Texels (or plain colours) whose alpha is below this are holes. `None`: the material is opaque.
    pub alpha_cutoff: Option<f32>,
    /// Fine detail of the shading normal, if any.
    pub normal_map: Option<NormalMap>,
    /// Heights for [`displace`](crate::displace), if any. [`build`](crate::build) itself does not read them.
    pub height_map: Option<HeightMap>,
    /// Emission, roughness and metalness, and more.
    pub properties: Properties,
}

impl Material {
    /// The name of a number in this material that is infinite or NaN.
    pub(super) fn non_finite(&self) -> Option<&'static str> {
        let normal = self.normal_map.as_ref();
        let height = self.height_map.as_ref();
        let finite = |transform: &UvTransform| transform.rows.as_flattened().iter().all(|x| x.is_finite());
        [
            ("base colour", self.base_color.iter().all(|x| x.is_finite())),
            ("alpha cutoff", self.alpha_cutoff.is_none_or(f32::is_finite)),
            ("scale of the normal map", normal.is_none_or(|m| m.scale.is_finite())),
            ("texture transform of the normal map", normal.is_none_or(|m| finite(&m.uv_transform))),
            ("amplitude of the height map", height.is_none_or(|m| m.amplitude.is_finite())),
            ("bias of the height map", height.is_none_or(|m| m.bias.is_finite())),
            ("texture transform of the height map", height.is_none_or(|m| finite(&m.uv_transform))),
        ]
        .into_iter()
        .find_map(|(what, finite)| (!finite).then_some(what))
        .or_else(|| self.properties.non_finite())
    }
}

impl Default for Material {
    fn default() -> Self {
        Self {
            name: "default".into(),
            base_color: [0.8, 0.8, 0.8, 1.0],
            texture: None,
            alpha_cutoff: None,
            normal_map: None,
            height_map: None,
            properties: Properties::default(),
        }
    }
}
