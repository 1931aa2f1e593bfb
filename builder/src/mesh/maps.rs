//! Maps of surface detail: normals in tangent space, and heights.
//!
//! # Tangent space
//! As in glTF. At a point of a surface, `N` is the unit shading normal, `T` the unit tangent perpendicular to it, and
//! `B = w (N x T)`, where `w` is 1 or -1. `T` points where `u` of the map grows, `B` where `v` shrinks, that is, upwards in
//! the image (`v` grows downwards from the first row); `w` is -1 where the image lies mirrored on the surface. A texel whose
//! red, green and blue are `r`, `g`, `b` (0..=1, linear, not sRGB) stands for the normal
//! `(2r - 1) scale T + (2g - 1) scale B + (2b - 1) N`, brought to unit length.
//!
//! `T` and `w` of a vertex are [`Mesh::tangents`](crate::Mesh::tangents). If a mesh has none, they are constant over a
//! triangle and computed from its texture coordinates: see [`Mesh::corner_tangents`](crate::Mesh::corner_tangents).

use std::sync::Arc;

use glam::{Vec2, Vec3};

use super::texture::{TextureError, check_size, fold, halve, mip_level, neighbours};
use super::wrap::Wrap;

/// An image of `N` linear channels with all its mip levels, 16 bits each: 0 stands for 0, 65535 for 1.
#[derive(Clone, Debug)]
pub struct LinearTexture<const N: usize> {
    /// Mip levels, the full image first. Each has half the size of the previous one (rounded down, at least 1).
    pub mips: Vec<LinearMip<N>>,
    /// How it is read at coordinates outside 0..=1, along `u` and `v`.
    pub wrap: [Wrap; 2],
}

/// One mip level of a [`LinearTexture`]: row-major, first row on top.
#[derive(Clone, Debug)]
pub struct LinearMip<const N: usize> {
    /// Width in texels, at least 1.
    pub width: u32,
    /// Height in texels, at least 1.
    pub height: u32,
    /// `width * height` texels.
    pub texels: Vec<[u16; N]>,
}

/// The value of a channel of a [`LinearTexture`] that stands for 1.
const ONE: f32 = 65535.0;

impl<const N: usize> LinearTexture<N> {
    /// Makes a texture with all its mip levels from row-major texels, first row on top. Each texel of a level is the mean
    /// of the area that it covers in the previous level.
    ///
    /// # Errors
    /// See [`TextureError`].
    pub fn new(width: u32, height: u32, texels: Vec<[u16; N]>) -> Result<Self, TextureError> {
        check_size(width, height, 2 * N, 2 * N * texels.len())?;
        let mut mips = vec![LinearMip { width, height, texels }];
        while let Some(last) = mips.last()
            && (last.width > 1 || last.height > 1)
        {
            mips.push(last.halved());
        }
        Ok(Self { mips, wrap: [Wrap::Repeat; 2] })
    }

    /// The same texture, read in another way at coordinates outside 0..=1.
    #[must_use]
    pub fn with_wrap(self, wrap: [Wrap; 2]) -> Self {
        Self { wrap, ..self }
    }

    /// The channels at `uv` (`v` downwards from the first row; outside 0..=1 by `wrap`), 0..=1.
    ///
    /// `footprint_texels` is the width of the area to average, in texels of the full image. 1 or less reads the full image
    /// with bilinear filtering; more blends the two mip levels whose texels are nearest in size. Coordinates or footprints
    /// that are infinite or NaN are taken as 0.
    #[must_use]
    pub fn sample(&self, uv: [f32; 2], footprint_texels: f32) -> [f32; N] {
        let uv = fold(uv, self.wrap);
        let (fine, blend) = mip_level(footprint_texels, self.mips.len());
        let near = self.mips[fine].bilinear(uv, self.wrap);
        let Some(blend) = blend else { return near };
        let far = self.mips[fine + 1].bilinear(uv, self.wrap);
        std::array::from_fn(|c| near[c] + (far[c] - near[c]) * blend)
    }
}

impl<const N: usize> LinearMip<N> {
    /// Bilinear interpolation at `uv` in 0..=1.
    fn bilinear(&self, [u, v]: [f32; 2], [wrap_u, wrap_v]: [Wrap; 2]) -> [f32; N] {
        let (x0, x1, fx) = neighbours(u, self.width, wrap_u);
        let (y0, y1, fy) = neighbours(v, self.height, wrap_v);
        let texel = |x: usize, y: usize| self.texels[y * self.width as usize + x].map(f32::from);
        let [a, b, c, d] = [texel(x0, y0), texel(x1, y0), texel(x0, y1), texel(x1, y1)];
        std::array::from_fn(|i| {
            let (top, bottom) = (a[i] + (b[i] - a[i]) * fx, c[i] + (d[i] - c[i]) * fx);
            (top + (bottom - top) * fy) * (1.0 / ONE)
        })
    }

    /// The next mip level.
    fn halved(&self) -> Self {
        let (width, height, texels) = halve(self.width, self.height, |parts| {
            let mut sum = [0.0f32; N];
            for &(weight, index) in parts {
                for (sum, &part) in sum.iter_mut().zip(&self.texels[index]) {
                    *sum += weight * f32::from(part);
                }
            }
            sum.map(|x| (x + 0.5) as u16)
        });
        Self { width, height, texels }
    }
}

/// An affine map of texture coordinates: row `i` times `[u, v, 1]` gives coordinate `i`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UvTransform {
    /// The matrix. All numbers must be finite.
    pub rows: [[f32; 3]; 2],
}

impl UvTransform {
    /// Leaves coordinates as they are.
    pub const IDENTITY: Self = Self { rows: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]] };

    /// The transformed coordinates.
    #[must_use]
    pub fn apply(&self, [u, v]: [f32; 2]) -> [f32; 2] {
        self.rows.map(|[a, b, c]| a * u + b * v + c)
    }

    /// A transformed difference of coordinates: the offset does not apply.
    #[must_use]
    pub fn apply_to_difference(&self, [u, v]: [f32; 2]) -> [f32; 2] {
        self.rows.map(|[a, b, _]| a * u + b * v)
    }

    /// The transform that first undoes `first` and then applies `self`, or `None` if `first` cannot be inverted.
    #[must_use]
    pub fn after_undoing(&self, first: &Self) -> Option<Self> {
        if self == first {
            return Some(Self::IDENTITY);
        }
        let [[a, b, c], [d, e, f]] = first.rows.map(|row| row.map(f64::from));
        let determinant = a * e - b * d;
        if determinant == 0.0 || !determinant.is_finite() {
            return None;
        }
        let inverse = [
            [e / determinant, -b / determinant, (b * f - c * e) / determinant],
            [-d / determinant, a / determinant, (c * d - a * f) / determinant],
        ];
        let rows = self.rows.map(|row| {
            let [p, q, r] = row.map(f64::from);
            std::array::from_fn(|k| {
                let moved = if k == 2 { r } else { 0.0 };
                (p * inverse[0][k] + q * inverse[1][k] + moved) as f32
            })
        });
        rows.as_flattened().iter().all(|x| x.is_finite()).then_some(Self { rows })
    }
}

impl Default for UvTransform {
    fn default() -> Self {
        Self::IDENTITY
    }
}

/// Normals in tangent space (see the [module](self)).
#[derive(Clone, Debug)]
pub struct NormalMap {
    /// Red, green and blue stand for components from -1 to 1 along the tangent, the bitangent and the normal.
    pub texture: Arc<LinearTexture<3>>,
    /// Factor of the first two components; finite.
    pub scale: f32,
    /// From the texture coordinates of the mesh to those of this texture.
    pub uv_transform: UvTransform,
}

impl NormalMap {
    /// The mean normal in tangent space around `uv` (coordinates of the mesh) over `footprint_texels` (see
    /// [`LinearTexture::sample`]), multiplied by `scale`. *Not* of unit length: the more the normals in the area differ,
    /// the shorter it is.
    #[must_use]
    pub fn sample(&self, uv: [f32; 2], footprint_texels: f32) -> [f32; 3] {
        let [x, y, z] = self.texture.sample(self.uv_transform.apply(uv), footprint_texels).map(|c| 2.0 * c - 1.0);
        [x * self.scale, y * self.scale, z]
    }
}

/// The unit shading normal that a normal map gives: `sample` (of any length, as from [`NormalMap::sample`]) in the tangent
/// space of the unit `normal` and of `tangent` with its handedness. The tangent need neither be of unit length nor
/// perpendicular to `normal`. Returns `normal` itself if the tangent is zero or parallel to it, or if `sample` is zero.
#[must_use]
pub fn mapped_normal(normal: [f32; 3], tangent: [f32; 4], sample: [f32; 3]) -> [f32; 3] {
    let n = Vec3::from(normal);
    let given = Vec3::new(tangent[0], tangent[1], tangent[2]);
    let Some(t) = (given - n * n.dot(given)).try_normalize() else { return normal };
    let b = n.cross(t) * if tangent[3] < 0.0 { -1.0 } else { 1.0 };
    (t * sample[0] + b * sample[1] + n * sample[2]).try_normalize().unwrap_or(n).to_array()
}

/// The tangent and handedness that follow from the corners of a triangle and its texture coordinates in the map. `None` if
/// the triangle or its texture coordinates have no area.
pub(crate) fn derived_tangent(corners: [glam::DVec3; 3], uvs: [[f32; 2]; 3]) -> Option<[f32; 4]> {
    let [a, b, c] = corners;
    let (e1, e2) = (b - a, c - a);
    let [ua, ub, uc] = uvs.map(|uv| Vec2::from(uv).as_dvec2());
    let (d1, d2) = (ub - ua, uc - ua);
    let determinant = d1.perp_dot(d2);
    if determinant == 0.0 || !determinant.is_finite() {
        return None;
    }
    // The derivatives by u and v up to a positive factor: only their directions matter.
    let sign = determinant.signum();
    let (along_u, along_v) = ((e1 * d2.y - e2 * d1.y) * sign, (e2 * d1.x - e1 * d2.x) * sign);
    let largest = along_u.abs().max_element();
    if largest == 0.0 || !largest.is_finite() {
        return None;
    }
    let tangent = (along_u / largest).normalize();
    // v grows downwards, the bitangent points up.
    let mirrored = e1.cross(e2).cross(along_u).dot(along_v) > 0.0;
    let t = tangent.as_vec3();
    Some([t.x, t.y, t.z, if mirrored { -1.0 } else { 1.0 }])
}

/// Heights above the surface, by which [`displace`](crate::displace) moves it along its normal.
#[derive(Clone, Debug)]
pub struct HeightMap {
    /// One channel: the height of a texel as a fraction, 0..=1.
    pub texture: Arc<LinearTexture<1>>,
    /// The height that 1 in the texture stands for, minus `bias`, in mesh units; finite. Importers set the value in the file;
    /// for formats that name no unit, it is a factor of 1.
    pub amplitude: f32,
    /// The height that 0 in the texture stands for, in mesh units; finite.
    pub bias: f32,
    /// From the texture coordinates of the mesh to those of this texture.
    pub uv_transform: UvTransform,
}

impl HeightMap {
    /// The mean displacement around `uv` (coordinates of the mesh) over `footprint_texels` (see
    /// [`LinearTexture::sample`]): `bias + amplitude * height`, in mesh units.
    #[must_use]
    pub fn sample(&self, uv: [f32; 2], footprint_texels: f32) -> f32 {
        let [height] = self.texture.sample(self.uv_transform.apply(uv), footprint_texels);
        self.bias + self.amplitude * height
    }

    /// The largest absolute displacement of a texel, rounded up: no [`sample`](Self::sample) exceeds it.
    pub(crate) fn largest(&self) -> f32 {
        let texels = self.texture.mips[0].texels.iter().map(|t| t[0]);
        let (low, high) = texels.fold((u16::MAX, 0), |(low, high), t| (low.min(t), high.max(t)));
        let height = |t: u16| (self.bias + self.amplitude * (f32::from(t) / ONE)).abs();
        height(low).max(height(high)) + 1e-6 * (self.bias.abs() + self.amplitude.abs())
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    fn grey(width: u32, height: u32, texels: &[u16]) -> LinearTexture<1> {
        LinearTexture::new(width, height, texels.iter().map(|&x| [x]).collect()).unwrap()
    }

    #[test]
    fn samples_are_linear() {
        let t = grey(2, 1, &[0, 65535]);
        assert_eq!(t.mips.len(), 2);
        for (u, expected) in [(0.25, 0.0), (0.75, 1.0), (0.5, 0.5), (0.0, 0.5), (-0.25, 1.0), (f32::NAN, 0.5)] {
            assert!((t.sample([u, 0.5], 1.0)[0] - expected).abs() < 1e-6, "{u}");
        }
        assert!((t.sample([0.25, 0.5], 2.0)[0] - 0.5).abs() < 1e-4);
        assert!((t.sample([0.25, 0.5], 2f32.sqrt())[0] - 0.25).abs() < 1e-4);
        assert!((t.sample([0.25, 0.5], f32::INFINITY)[0] - 0.5).abs() < 1e-4);
    }

    #[test]
    fn odd_sizes_keep_the_mean() {
        for spot in 0..15 {
            let mut texels = [0; 15];
            texels[spot] = 65535;
            let t = grey(5, 3, &texels);
            assert!((t.sample([0.3, 0.3], 100.0)[0] - 1.0 / 15.0).abs() < 1e-4, "{spot}");
        }
    }

    #[test]
    fn bad_sizes_are_refused() {
        assert!(matches!(LinearTexture::<1>::new(0, 1, vec![]), Err(TextureError::Size { .. })));
        let short = LinearTexture::<3>::new(2, 2, vec![[0; 3]; 3]).unwrap_err();
        assert_eq!(short, TextureError::Length { width: 2, height: 2, found: 18, expected: 24 });
    }

    #[test]
    fn transforms_undo_each_other() {
        let a = UvTransform { rows: [[2.0, 0.5, 0.25], [-0.5, 1.0, -3.0]] };
        let b = UvTransform { rows: [[0.0, 1.0, 0.5], [3.0, 0.0, 0.125]] };
        let both = b.after_undoing(&a).unwrap();
        for uv in [[0.0, 0.0], [1.0, 0.25], [-2.0, 0.75]] {
            let (found, expected) = (both.apply(a.apply(uv)), b.apply(uv));
            assert!((0..2).all(|i| (found[i] - expected[i]).abs() < 1e-5), "{uv:?}: {found:?} {expected:?}");
        }
        let flat = UvTransform { rows: [[1.0, 2.0, 0.0], [2.0, 4.0, 0.0]] };
        assert_eq!(b.after_undoing(&flat), None);
        assert_eq!(flat.after_undoing(&flat), Some(UvTransform::IDENTITY));
    }

    #[test]
    fn derived_tangents_follow_the_image() {
        // Seen from +z the image is upright: u to the right, v down.
        let corners = [DVec3::ZERO, DVec3::X, DVec3::Y];
        let tangent = derived_tangent(corners, [[0.0, 1.0], [1.0, 1.0], [0.0, 0.0]]).unwrap();
        assert_eq!(tangent, [1.0, 0.0, 0.0, 1.0]);
        let up = mapped_normal([0.0, 0.0, 1.0], tangent, [0.0, 1.0, 0.0]);
        assert_eq!(up, [0.0, 1.0, 0.0]);
        // Mirrored: u to the left. Up in the image stays up.
        let tangent = derived_tangent(corners, [[1.0, 1.0], [0.0, 1.0], [1.0, 0.0]]).unwrap();
        assert_eq!(tangent, [-1.0, 0.0, 0.0, -1.0]);
        assert_eq!(mapped_normal([0.0, 0.0, 1.0], tangent, [0.0, 1.0, 0.0]), [0.0, 1.0, 0.0]);
        assert_eq!(mapped_normal([0.0, 0.0, 1.0], tangent, [1.0, 0.0, 0.0]), [-1.0, 0.0, 0.0]);
        // Rotated by a quarter turn: u grows upwards, so the top of the image is on the left.
        let tangent = derived_tangent(corners, [[0.0, 0.0], [0.0, 1.0], [1.0, 0.0]]).unwrap();
        assert_eq!(tangent, [0.0, 1.0, 0.0, 1.0]);
        assert_eq!(mapped_normal([0.0, 0.0, 1.0], tangent, [0.0, 1.0, 0.0]), [-1.0, 0.0, 0.0]);
        for flat in [[[0.5; 2]; 3], [[0.0, 0.0], [0.5, 0.5], [1.0, 1.0]]] {
            assert_eq!(derived_tangent(corners, flat), None);
        }
        assert_eq!(derived_tangent([DVec3::X; 3], [[0.0, 1.0], [1.0, 1.0], [0.0, 0.0]]), None);
    }

    #[test]
    fn a_flat_map_leaves_normals_alone() {
        let n = Vec3::new(0.6, 0.0, 0.8).to_array();
        assert_eq!(mapped_normal(n, [1.0, 0.0, 0.0, 1.0], [0.0, 0.0, 0.7]), n);
        // No usable tangent (along the normal, or zero), and a sample without length.
        assert_eq!(mapped_normal(n, [0.6, 0.0, 0.8, 1.0], [0.5, 0.5, 0.5]), n);
        assert_eq!(mapped_normal(n, [0.0; 4], [0.5, 0.5, 0.5]), n);
        assert_eq!(mapped_normal(n, [1.0, 0.0, 0.0, 1.0], [0.0; 3]), n);
    }
}
