//! Colour, normal and holes of pieces of triangles.
//!
//! Prepared per triangle: if its colour and normal are the same everywhere, these, which makes them almost free; otherwise
//! how they are computed from a position.

use std::sync::Arc;

use esvo_format::RawNormal;
use glam::{DVec3, Vec2, Vec3, Vec3A};
use rayon::prelude::*;

use super::Surface;
use super::look::{Cutout, Look, Ranges};
use super::range::Bounds;
use super::span::Span;
use super::srgb::{decode_srgb, encode_srgb};
use crate::clip::polygon::{area, area_and_centroid};
use crate::clip::{Arena, MAX_VERTICES, Piece};
use crate::mesh::maps::mapped_normal;
use crate::{Mesh, TextureTest, UvTransform};

/// An index into nothing.
const NONE: u32 = u32::MAX;
/// A triangle is flat if the normals at its corners differ from its own by at most this in each component, a quarter of a
/// step of a raw normal.
const FLAT: f32 = 1e-4;

/// The appearance of all triangles.
pub(crate) struct Shading<'a> {
    mesh: &'a Mesh,
    looks: Arc<[Look]>,
    facets: Vec<Facet>,
    frames: Vec<Frame>,
    /// Tangents with their handedness at the corners of triangles with normal maps.
    tangents: Vec<[[f32; 4]; 3]>,
    finest_voxel: f32,
}

/// The appearance of a triangle.
#[derive(Clone, Copy)]
struct Facet {
    /// The geometric normal.
    normal: RawNormal,
    /// Index into `looks`.
    look: u32,
    /// Index into `frames`; `NONE` if colour and normal are the same everywhere.
    frame: u32,
}

/// How the attributes of a triangle on which they vary are computed from a position.
struct Frame {
    /// Gradients of the second and third barycentric coordinate.
    gradients: [Vec3; 2],
    /// Indices of its vertices in the mesh.
    vertices: [u32; 3],
    /// Texels of the colour texture per unit of octree space; 0 without a texture.
    texel_density: f32,
    /// Texels of the normal map per unit of octree space; 0 without a map.
    normal_density: f32,
    /// Index into `tangents`, or `NONE`.
    tangents: u32,
    /// Whether the vertex normals differ from the geometric normal.
    smooth: bool,
}

/// Colour and normal of a piece of surface.
#[derive(Clone, Copy)]
pub(crate) struct Sample {
    /// Linear RGB.
    pub color: Vec3A,
    /// Unit normal.
    pub normal: Vec3A,
}

impl Sample {
    /// sRGB-encoded colour and shading normal.
    pub(crate) fn encode(&self) -> ([u8; 3], RawNormal) {
        (encode_srgb(self.color.into()), RawNormal::encode(self.normal.into()))
    }
}

impl<'a> Shading<'a> {
    /// Prepares triangles. `source` holds the index of each in the mesh; `corners` and `normals` are in octree space.
    pub(crate) fn new(
        mesh: &'a Mesh,
        source: &[u32],
        corners: &[[DVec3; 3]],
        normals: &[Vec3],
        looks: Arc<[Look]>,
        finest_voxel: f32,
    ) -> Self {
        let varies: Vec<bool> = looks.iter().map(Look::varies).collect();
        let material = |t: usize| mesh.triangle_materials.get(source[t] as usize).map_or(0, |m| *m as usize);
        let smooth = |t: usize| {
            let vertices = mesh.triangles[source[t] as usize];
            let differs = |v: u32| (Vec3::from(mesh.normals[v as usize]) - normals[t]).abs().max_element() > FLAT;
            !mesh.normals.is_empty() && vertices.into_iter().any(differs)
        };
        let mut facets: Vec<Facet> = (0..corners.len())
            .into_par_iter()
            .map(|t| {
                let look = material(t);
                let frame = if varies[look] || smooth(t) { 0 } else { NONE };
                Facet { normal: RawNormal::encode(normals[t]), look: look as u32, frame }
            })
            .collect();
        let framed: Vec<u32> = (0..facets.len() as u32).filter(|t| facets[*t as usize].frame != NONE).collect();
        for (frame, t) in framed.iter().enumerate() {
            facets[*t as usize].frame = frame as u32;
        }
        let mut frames: Vec<Frame> = (framed.par_iter())
            .map(|&t| {
                let t = t as usize;
                Frame::new(mesh, mesh.triangles[source[t] as usize], &corners[t], &looks[material(t)], smooth(t))
            })
            .collect();
        let mut tangents = Vec::new();
        for (frame, &t) in frames.iter_mut().zip(&framed) {
            let Some(map) = &looks[material(t as usize)].normal_map else { continue };
            if let Some(given) = mesh.corner_tangents(source[t as usize] as usize, map) {
                frame.tangents = tangents.len() as u32;
                tangents.push(given);
            }
        }
        Self { mesh, looks, facets, frames, tangents, finest_voxel }
    }

    /// Whether some material is cut out.
    pub(crate) fn has_holes(&self) -> bool {
        self.looks.iter().any(|look| !matches!(look.cutout, Cutout::Solid))
    }
}

impl Frame {
    fn new(mesh: &Mesh, vertices: [u32; 3], [a, b, c]: &[DVec3; 3], look: &Look, smooth: bool) -> Self {
        let (ab, ac) = (*b - *a, *c - *a);
        let n = ab.cross(ac);
        let inverse = 1.0 / n.length_squared();
        // Triangles too narrow for gradients are no wider than a point: the attributes of their first corner are used.
        let gradients = [ac.cross(n) * inverse, n.cross(ab) * inverse]
            .map(|g| g.as_vec3())
            .map(|g| if g.is_finite() { g } else { Vec3::ZERO });
        let area = n.length();
        let density = |size: Vec2, map: &dyn Fn([f32; 2]) -> [f32; 2]| {
            let [a, b, c] = vertices.map(|v| Vec2::from(map(mesh.uvs[v as usize])) * size);
            let density = (f64::from((b - a).perp_dot(c - a).abs()) / area).sqrt() as f32;
            if density.is_finite() { density } else { 0.0 }
        };
        let normal_density = look.normal_map.as_ref().map_or(0.0, |map| {
            let mip = &map.texture.mips[0];
            density(Vec2::new(mip.width as f32, mip.height as f32), &|uv| map.uv_transform.apply(uv))
        });
        Self {
            gradients,
            vertices,
            texel_density: look.texture_size().map_or(0.0, |size| density(size, &|uv| uv)),
            normal_density,
            tangents: NONE,
            smooth,
        }
    }

    /// Barycentric coordinates of a point in the plane of the triangle whose first corner is `a`. For a point outside,
    /// approximately those of the nearest point of the triangle.
    fn weights(&self, a: DVec3, p: DVec3) -> [f32; 3] {
        let d = (p - a).as_vec3();
        let v = d.dot(self.gradients[0]).clamp(0.0, 1.0);
        let w = d.dot(self.gradients[1]).clamp(0.0, 1.0 - v);
        [1.0 - v - w, v, w]
    }

    fn uv(&self, mesh: &Mesh, w: [f32; 3]) -> Vec2 {
        let [a, b, c] = self.vertices.map(|v| Vec2::from(mesh.uvs[v as usize]));
        a * w[0] + b * w[1] + c * w[2]
    }

    fn color(&self, mesh: &Mesh, w: [f32; 3]) -> Vec3A {
        mix(self.vertices.map(|v| mesh.colors[v as usize]), w)
    }

    /// The interpolated normal.
    fn normal(&self, mesh: &Mesh, flat: Vec3A, w: [f32; 3]) -> Vec3A {
        if self.smooth { mix(self.vertices.map(|v| mesh.normals[v as usize]), w).normalize_or(flat) } else { flat }
    }
}

fn mix([a, b, c]: [[f32; 3]; 3], w: [f32; 3]) -> Vec3A {
    Vec3A::from(a) * w[0] + Vec3A::from(b) * w[1] + Vec3A::from(c) * w[2]
}

fn mix_tangents([a, b, c]: [[f32; 4]; 3], w: [f32; 3]) -> [f32; 4] {
    let at = |k: usize| a[k] * w[0] + b[k] * w[1] + c[k] * w[2];
    [at(0), at(1), at(2), a[3]]
}

impl Surface<'_> {
    /// The material of a triangle.
    pub(super) fn look(&self, triangle: u32) -> &Look {
        &self.shading.looks[self.shading.facets[triangle as usize].look as usize]
    }

    /// Texture coordinates of a triangle at point `p` of it; `None` if nothing varies on it.
    pub(super) fn uv_at(&self, triangle: u32, p: DVec3) -> Option<Vec2> {
        let frame = self.shading.frames.get(self.shading.facets[triangle as usize].frame as usize)?;
        Some(frame.uv(self.shading.mesh, frame.weights(self.corners[triangle as usize][0], p)))
    }

    /// Texels of a map of this size per unit of octree space on a triangle; 0 if nothing varies on it.
    pub(super) fn map_density(&self, triangle: u32, size: Vec2, transform: &UvTransform) -> f32 {
        let frame = self.shading.frames.get(self.shading.facets[triangle as usize].frame as usize);
        let Some(frame) = frame else { return 0.0 };
        let [a, b, c] = frame.vertices.map(|v| Vec2::from(transform.apply(self.shading.mesh.uvs[v as usize])) * size);
        let [p, q, r] = &self.corners[triangle as usize];
        let density = (f64::from((b - a).perp_dot(c - a).abs()) / (*q - *p).cross(*r - *p).length()).sqrt() as f32;
        if density.is_finite() { density } else { 0.0 }
    }

    /// Least and greatest colour, linear, of the texels of a map on a piece. For the parameters see [`texels`](Self::texels).
    pub(super) fn color_bounds(
        &self,
        triangle: u32,
        vertices: &[DVec3],
        range: &Ranges,
        moved: impl Fn(Vec2) -> Vec2,
        density: f32,
    ) -> Option<[Vec3; 2]> {
        let frame = self.shading.frames.get(self.shading.facets[triangle as usize].frame as usize)?;
        let mut outline = Outline::default();
        let a = self.corners[triangle as usize][0];
        vertices.iter().for_each(|v| outline.push(frame.weights(a, *v)));
        let bounds = self.texels(range, frame, &outline, moved, density, self.color_reach);
        Some([decode_srgb(bounds.min), decode_srgb(bounds.max)])
    }

    /// Edge of the finest voxels in octree units.
    pub(crate) fn finest_voxel(&self) -> f64 {
        f64::from(self.shading.finest_voxel)
    }

    /// The colour (sRGB-encoded) and normal of these pieces, if they are the same everywhere on all of them.
    pub(crate) fn constant(&self, pieces: &[Piece]) -> Option<([u8; 3], RawNormal)> {
        let Shading { facets, looks, .. } = &self.shading;
        let (first, rest) = pieces.split_first()?;
        let first = &facets[first.triangle as usize];
        let same = |piece: &Piece| {
            let facet = &facets[piece.triangle as usize];
            facet.frame == NONE
                && facet.normal == first.normal
                && (facet.look == first.look || looks[facet.look as usize].plain == looks[first.look as usize].plain)
        };
        if first.frame != NONE || !rest.iter().all(same) {
            return None;
        }
        Some((looks[first.look as usize].plain?, first.normal))
    }

    /// The area of a piece in squared units of octree space.
    pub(crate) fn area(&self, triangle: u32, vertices: &[DVec3]) -> f32 {
        area(vertices, self.normals[triangle as usize].into())
    }

    /// The area of a piece in squared units of octree space, and its colour and normal at the centroid, filtered to the size
    /// of a voxel.
    #[inline(always)]
    pub(crate) fn sample(&self, triangle: u32, vertices: &[DVec3], voxel_size: f64) -> (f32, Sample) {
        let facet = &self.shading.facets[triangle as usize];
        let normal = Vec3A::from(self.normals[triangle as usize]);
        if facet.frame == NONE {
            let color = self.shading.looks[facet.look as usize].base.into();
            return (area(vertices, normal), Sample { color, normal });
        }
        let (area, centroid) = area_and_centroid(vertices, normal);
        (area, self.sample_at(triangle, centroid, voxel_size))
    }

    /// Colour and normal of a triangle at point `p` of it, filtered to the size of a voxel.
    pub(crate) fn sample_at(&self, triangle: u32, p: DVec3, voxel_size: f64) -> Sample {
        let facet = &self.shading.facets[triangle as usize];
        let look = &self.shading.looks[facet.look as usize];
        let normal = Vec3A::from(self.normals[triangle as usize]);
        let mut color = Vec3A::from(look.base);
        let Some(frame) = self.shading.frames.get(facet.frame as usize) else { return Sample { color, normal } };
        let w = frame.weights(self.corners[triangle as usize][0], p);
        let mesh = self.shading.mesh;
        if self.colors && !mesh.colors.is_empty() {
            color *= frame.color(mesh, w);
        }
        if let Some(texture) = look.texture.as_ref().filter(|_| self.colors) {
            color *= texture.sample(frame.uv(mesh, w), voxel_size as f32 * frame.texel_density);
        }
        let mut normal = frame.normal(mesh, normal, w);
        if let Some(map) = look.normal_map.as_ref().filter(|_| self.normals_stored) {
            let detail = map.sample(frame.uv(mesh, w).into(), voxel_size as f32 * frame.normal_density);
            normal = self.mapped(frame, normal, w, detail);
        }
        Sample { color, normal }
    }

    /// Whether no part of this triangle is a hole.
    pub(crate) fn is_solid(&self, triangle: u32) -> bool {
        let facet = &self.shading.facets[triangle as usize];
        matches!(self.shading.looks[facet.look as usize].cutout, Cutout::Solid)
    }

    /// `normal` changed by the sample `detail` of a normal map.
    fn mapped(&self, frame: &Frame, normal: Vec3A, w: [f32; 3], detail: [f32; 3]) -> Vec3A {
        let Some(tangents) = self.shading.tangents.get(frame.tangents as usize) else { return normal };
        mapped_normal(normal.to_array(), mix_tangents(*tangents, w), detail).into()
    }

    /// Whether a piece of a cut-out material consists of holes only.
    ///
    /// A piece no larger than the finest voxels is a hole if its centroid is, at a resolution that keeps the share of the
    /// material that is solid. A larger piece is a hole if every part of it is.
    pub(crate) fn is_hole(&self, triangle: u32, vertices: &[DVec3]) -> bool {
        let facet = &self.shading.facets[triangle as usize];
        let map = match &self.shading.looks[facet.look as usize].cutout {
            Cutout::Solid => return false,
            Cutout::Gone => return true,
            Cutout::Map(map) => map,
        };
        let Some(frame) = self.shading.frames.get(facet.frame as usize) else { return false };
        let finest = self.shading.finest_voxel;
        let footprint = finest * frame.texel_density;
        let (lo, hi) = vertices.iter().fold((DVec3::MAX, DVec3::MIN), |(lo, hi), v| (lo.min(*v), hi.max(*v)));
        if (hi - lo).max_element() <= f64::from(finest) * 1.000001 {
            let (_, centroid) = area_and_centroid(vertices, self.normals[triangle as usize].into());
            let w = frame.weights(self.corners[triangle as usize][0], centroid);
            return map.is_hole(frame.uv(self.shading.mesh, w), footprint);
        }
        let (lo, hi) = self.uv_bounds(frame, triangle, vertices);
        !map.in_box(lo, hi, footprint).solid
    }

    /// Whether these pieces contain a hole. Called for pieces that are not all hole.
    pub(crate) fn is_cut_through(&self, arena: &Arena, pieces: &[Piece]) -> bool {
        self.has_holes
            && pieces.iter().any(|piece| {
                let facet = &self.shading.facets[piece.triangle as usize];
                let Cutout::Map(map) = &self.shading.looks[facet.look as usize].cutout else { return false };
                let Some(frame) = self.shading.frames.get(facet.frame as usize) else { return false };
                let (lo, hi) = self.uv_bounds(frame, piece.triangle, arena.vertices(piece, &self.corners));
                map.in_box(lo, hi, self.shading.finest_voxel * frame.texel_density).hole
            })
    }

    fn uv_bounds(&self, frame: &Frame, triangle: u32, vertices: &[DVec3]) -> (Vec2, Vec2) {
        let a = self.corners[triangle as usize][0];
        vertices
            .iter()
            .map(|v| frame.uv(self.shading.mesh, frame.weights(a, *v)))
            .fold((Vec2::MAX, Vec2::MIN), |(lo, hi), uv| (lo.min(uv), hi.max(uv)))
    }

    /// The range of colours and normals over a piece, as the test of the settings sees them. `voxel_size` is the edge of the
    /// voxel that the piece is in.
    pub(crate) fn span(&self, triangle: u32, vertices: &[DVec3], voxel_size: f64) -> Span {
        let facet = &self.shading.facets[triangle as usize];
        let look = &self.shading.looks[facet.look as usize];
        let Some(frame) = self.shading.frames.get(facet.frame as usize) else {
            return Span::of(
                look.plain.unwrap_or_else(|| encode_srgb(look.base)),
                self.normals[triangle as usize].into(),
            );
        };
        if self.test == TextureTest::Centroids {
            let (_, sample) = self.sample(triangle, vertices, voxel_size);
            return Span::of(encode_srgb(sample.color.into()), sample.normal);
        }
        let mut outline = Outline::default();
        let a = self.corners[triangle as usize][0];
        for v in vertices {
            outline.push(frame.weights(a, *v));
        }
        let flat = self.normals[triangle as usize].into();
        Span {
            color: if self.colors { self.color_range(look, frame, &outline) } else { [[0; 3]; 2] },
            normal: if self.normals_stored { self.normal_range(look, frame, &outline, flat) } else { [flat; 2] },
        }
    }

    /// Smallest and largest sRGB-encoded colour of a piece.
    fn color_range(&self, look: &Look, frame: &Frame, outline: &Outline) -> [[u8; 3]; 2] {
        if let Some(plain) = look.plain {
            return [plain; 2];
        }
        let (mut lo, mut hi) = (look.base, look.base);
        let mesh = self.shading.mesh;
        if !mesh.colors.is_empty() {
            let colors = outline.iter().map(|w| Vec3::from(frame.color(mesh, w)));
            let (least, most) = colors.fold((Vec3::MAX, Vec3::MIN), |(lo, hi), c| (lo.min(c), hi.max(c)));
            lo *= least;
            hi *= most;
        }
        if let Some(range) = &look.color_range {
            let bounds = self.texels(range, frame, outline, |uv| uv, frame.texel_density, self.color_reach);
            if lo == Vec3::ONE && hi == Vec3::ONE {
                return [bounds.min, bounds.max];
            }
            lo *= decode_srgb(bounds.min);
            hi *= decode_srgb(bounds.max);
        }
        [encode_srgb(lo), encode_srgb(hi)]
    }

    /// The range of the shading normals of a piece; `flat` is the normal of its triangle.
    fn normal_range(&self, look: &Look, frame: &Frame, outline: &Outline, flat: Vec3A) -> [Vec3A; 2] {
        let mesh = self.shading.mesh;
        let (mut lo, mut hi) = (Vec3A::MAX, Vec3A::MIN);
        let mut add = |normal: Vec3A| (lo, hi) = (lo.min(normal), hi.max(normal));
        if let Some((map, range)) = look.normal_map.as_ref().zip(look.normal_range.as_ref()) {
            let moved = |uv: Vec2| Vec2::from(map.uv_transform.apply(uv.into()));
            let bounds = self.texels(range, frame, outline, moved, frame.normal_density, u8::MAX);
            let component = |c: [u8; 3]| {
                let [x, y, z] = c.map(|c| f32::from(c) / 127.5 - 1.0);
                [x * map.scale, y * map.scale, z]
            };
            let ends = [component(bounds.min), component(bounds.max)];
            for w in outline.iter() {
                let shading = frame.normal(mesh, flat, w);
                // A component is largest at a corner of the box, up to the curvature of the sphere.
                for corner in 0..8 {
                    let detail = std::array::from_fn(|k| ends[corner >> k & 1][k]);
                    add(self.mapped(frame, shading, w, detail));
                }
            }
        } else if frame.smooth {
            outline.iter().for_each(|w| add(frame.normal(mesh, flat, w)));
        } else {
            add(flat);
        }
        [lo, hi]
    }

    /// The range of the texels on a piece. `moved` takes texture coordinates of the mesh to those of the map, which has
    /// `density` texels per unit of octree space. For `enough` see [`TexelMap::in_polygon`](super::texels::TexelMap::in_polygon).
    fn texels(
        &self,
        range: &Ranges,
        frame: &Frame,
        outline: &Outline,
        moved: impl Fn(Vec2) -> Vec2,
        density: f32,
        enough: u8,
    ) -> Bounds<3> {
        let mut at = [Vec2::ZERO; MAX_VERTICES];
        for (at, w) in at.iter_mut().zip(outline.iter()) {
            *at = moved(frame.uv(self.shading.mesh, w));
        }
        let at = &at[..outline.count];
        match range {
            Ranges::Texels(texels) => texels.in_polygon(at, enough),
            Ranges::Averages(averages) => {
                let (lo, hi) = at.iter().fold((Vec2::MAX, Vec2::MIN), |(lo, hi), uv| (lo.min(*uv), hi.max(*uv)));
                averages.in_box(lo, hi, self.shading.finest_voxel * density)
            }
        }
    }
}

/// The vertices of a piece as barycentric coordinates of its triangle.
#[derive(Default)]
struct Outline {
    weights: [[f32; 3]; MAX_VERTICES],
    count: usize,
}

impl Outline {
    fn push(&mut self, weights: [f32; 3]) {
        self.weights[self.count] = weights;
        self.count += 1;
    }

    fn iter(&self) -> impl Iterator<Item = [f32; 3]> + '_ {
        self.weights[..self.count].iter().copied()
    }
}
