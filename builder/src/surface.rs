//! The mesh as the recursion reads it: corners in the root cube, normals, boundary edges, colours.

use std::collections::HashMap;
use std::sync::Arc;

use glam::{DMat4, DVec3, Vec2, Vec3};
use rayon::prelude::*;

use crate::range::{RangeMap, encode_srgb};
use crate::{BuildError, Material, Mesh, Texture};

/// A mesh prepared for building.
pub struct Surface<'a> {
    mesh: &'a Mesh,
    /// Index in the mesh of each triangle that is left after dropping those without area.
    source: Vec<u32>,
    /// Corners in octree space: the root cube is `[0, 1]³`.
    pub corners: Vec<[DVec3; 3]>,
    /// Unit geometric normals.
    pub normals: Vec<Vec3>,
    /// Per triangle: bits 0..3, the edge from corner `i` to `i + 1` belongs to no other triangle.
    pub boundary: Vec<u8>,
    /// Texels per unit of octree space, for textured triangles.
    texel_density: Vec<f32>,
    materials: Vec<Look>,
    /// Octree space to mesh space.
    pub octree_to_mesh: DMat4,
    /// Triangles without area.
    pub dropped: usize,
    /// Edge of the finest voxels in octree units.
    finest_voxel: f32,
    /// Whether some material is cut out by its alpha.
    pub has_holes: bool,
}

/// A material as the recursion reads it.
struct Look {
    base: Vec3,
    /// sRGB-encoded `base`, where there is nothing else to the colour.
    plain: Option<[u8; 3]>,
    alpha: f32,
    alpha_cutoff: Option<f32>,
    texture: Option<(Arc<Texture>, Arc<RangeMap>)>,
}

/// Colour and normal of a piece of surface.
pub struct Sample {
    /// Linear RGB.
    pub color: Vec3,
    /// Unit normal at the centroid.
    pub normal: Vec3,
}

impl<'a> Surface<'a> {
    /// Checks the mesh and moves it into the root cube: centred, its largest extent filling the cube. The finest voxels
    /// will be of level `levels`.
    pub fn new(mesh: &'a Mesh, levels: u32) -> Result<Self, BuildError> {
        mesh.validate().map_err(|e| BuildError::Mesh(e.to_string()))?;
        let octree_to_mesh = place(mesh)?;
        let scale = 1.0 / octree_to_mesh.x_axis.x;
        let origin = octree_to_mesh.w_axis.truncate();
        let corner = |i: u32| (DVec3::from(mesh.positions[i as usize]) - origin) * scale;
        let with_area: Vec<(u32, [DVec3; 3])> = (mesh.triangles.par_iter().enumerate())
            .map(|(i, t)| (i as u32, t.map(corner)))
            .filter(|(_, [a, b, c])| (*b - *a).cross(*c - *a).length_squared() > 0.0)
            .collect();
        if with_area.is_empty() {
            return Err(BuildError::Mesh("no triangle has any area".into()));
        }
        let (source, corners): (Vec<u32>, Vec<[DVec3; 3]>) = with_area.into_iter().unzip();
        let normals =
            (corners.par_iter()).map(|[a, b, c]| (*b - *a).cross(*c - *a).normalize_or(DVec3::Z).as_vec3()).collect();
        let mut ranges: HashMap<*const Texture, Arc<RangeMap>> = HashMap::new();
        let materials: Vec<Look> = mesh.materials.iter().map(|m| Look::new(m, mesh, &mut ranges)).collect();
        let boundary = boundary_edges(&corners);
        let mut surface = Self {
            mesh,
            dropped: mesh.triangles.len() - source.len(),
            finest_voxel: (-(levels as f32)).exp2(),
            has_holes: materials.iter().any(|m| m.alpha_cutoff.is_some()),
            source,
            corners,
            normals,
            boundary,
            texel_density: Vec::new(),
            materials,
            octree_to_mesh,
        };
        if surface.materials.iter().any(|m| m.texture.is_some()) {
            surface.texel_density = (0..surface.corners.len()).into_par_iter().map(|t| surface.density(t)).collect();
        }
        Ok(surface)
    }

    /// Number of triangles.
    pub fn len(&self) -> usize {
        self.corners.len()
    }

    fn look(&self, triangle: u32) -> &Look {
        let source = self.source[triangle as usize] as usize;
        &self.materials[self.mesh.triangle_materials.get(source).map_or(0, |m| *m as usize)]
    }

    fn indices(&self, triangle: u32) -> [usize; 3] {
        self.mesh.triangles[self.source[triangle as usize] as usize].map(|i| i as usize)
    }

    fn uvs(&self, triangle: u32) -> [Vec2; 3] {
        self.indices(triangle).map(|i| Vec2::from(self.mesh.uvs[i]))
    }

    fn density(&self, triangle: usize) -> f32 {
        let Some((texture, _)) = &self.look(triangle as u32).texture else { return 0.0 };
        let [a, b, c] = self.corners[triangle];
        let size = Vec2::new(texture.mips[0].width as f32, texture.mips[0].height as f32);
        let [ua, ub, uc] = self.uvs(triangle as u32).map(|uv| uv * size);
        let texels = (ub - ua).perp_dot(uc - ua).abs();
        let area = (b - a).cross(c - a).length() as f32;
        (texels / area).sqrt()
    }

    /// Whether a piece of a cut-out material is all hole.
    pub fn is_hole(&self, triangle: u32, vertices: &[DVec3]) -> bool {
        let look = self.look(triangle);
        let Some(cutoff) = look.alpha_cutoff else { return false };
        let Some((_, range)) = &look.texture else { return look.alpha < cutoff };
        let (lo, hi) = self.uv_bounds(triangle, vertices);
        range.in_box(lo, hi, 0.0).max_alpha * look.alpha < cutoff
    }

    fn uv_bounds(&self, triangle: u32, vertices: &[DVec3]) -> (Vec2, Vec2) {
        let uvs = self.uvs(triangle);
        let weights = Barycentric::new(&self.corners[triangle as usize]);
        vertices
            .iter()
            .map(|v| mix2(uvs, weights.at(*v)))
            .fold((Vec2::MAX, Vec2::MIN), |(lo, hi), uv| (lo.min(uv), hi.max(uv)))
    }

    /// The colour and normal of a piece with this centroid, in a voxel of this size.
    pub fn sample(&self, triangle: u32, centroid: DVec3, voxel_size: f64) -> Sample {
        let look = self.look(triangle);
        if look.plain.is_some() && self.mesh.normals.is_empty() {
            return Sample { color: look.base, normal: self.normals[triangle as usize] };
        }
        let w = Barycentric::new(&self.corners[triangle as usize]).at(centroid);
        let mut color = look.base;
        if !self.mesh.colors.is_empty() {
            color *= mix3(self.colors(triangle), w);
        }
        if let Some((texture, _)) = &look.texture {
            let footprint = voxel_size as f32 * self.texel_density[triangle as usize];
            let uv = mix2(self.uvs(triangle), w);
            let [r, g, b, _] = texture.sample(uv.into(), footprint);
            color *= Vec3::new(r, g, b);
        }
        Sample { color, normal: self.shading_normal(triangle, w) }
    }

    /// Least and greatest sRGB-encoded colour that the finest voxels will show of a piece.
    pub fn color_range(&self, triangle: u32, vertices: &[DVec3]) -> ([u8; 3], [u8; 3]) {
        let look = self.look(triangle);
        if let Some(plain) = look.plain {
            return (plain, plain);
        }
        let (mut lo, mut hi) = (look.base, look.base);
        if !self.mesh.colors.is_empty() {
            let colors = self.colors(triangle);
            let weights = Barycentric::new(&self.corners[triangle as usize]);
            let (mut least, mut greatest) = (Vec3::MAX, Vec3::MIN);
            for v in vertices {
                let c = mix3(colors, weights.at(*v));
                least = least.min(c);
                greatest = greatest.max(c);
            }
            lo *= least;
            hi *= greatest;
        }
        if let Some((_, range)) = &look.texture {
            let (uv_lo, uv_hi) = self.uv_bounds(triangle, vertices);
            let finest = self.finest_voxel * self.texel_density[triangle as usize];
            let bounds = range.in_box(uv_lo, uv_hi, finest);
            lo *= bounds.min;
            hi *= bounds.max;
        }
        (encode_srgb(lo), encode_srgb(hi))
    }

    fn colors(&self, triangle: u32) -> [Vec3; 3] {
        self.indices(triangle).map(|i| Vec3::from(self.mesh.colors[i]))
    }

    /// The interpolated shading normal, or the geometric one where the mesh has none.
    fn shading_normal(&self, triangle: u32, w: [f32; 3]) -> Vec3 {
        let flat = self.normals[triangle as usize];
        if self.mesh.normals.is_empty() {
            return flat;
        }
        let normals = self.indices(triangle).map(|i| Vec3::from(self.mesh.normals[i]));
        mix3(normals, w).normalize_or(flat)
    }

    /// Largest difference of a component between `normal` and the shading normals at these points.
    pub fn normal_deviation(&self, triangle: u32, vertices: &[DVec3], normal: Vec3) -> f32 {
        if self.mesh.normals.is_empty() {
            return (self.normals[triangle as usize] - normal).abs().max_element();
        }
        let weights = Barycentric::new(&self.corners[triangle as usize]);
        vertices
            .iter()
            .map(|v| (self.shading_normal(triangle, weights.at(*v)) - normal).abs().max_element())
            .fold(0.0, f32::max)
    }
}

impl Look {
    fn new(material: &Material, mesh: &Mesh, ranges: &mut HashMap<*const Texture, Arc<RangeMap>>) -> Self {
        let [r, g, b, alpha] = material.base_color;
        let base = Vec3::new(r, g, b);
        let texture = material.texture.as_ref().filter(|_| !mesh.uvs.is_empty()).map(|texture| {
            let range = ranges.entry(Arc::as_ptr(texture)).or_insert_with(|| Arc::new(RangeMap::new(texture)));
            (texture.clone(), range.clone())
        });
        let plain = (texture.is_none() && mesh.colors.is_empty()).then(|| encode_srgb(base));
        Self { base, plain, alpha, alpha_cutoff: material.alpha_cutoff, texture }
    }
}

/// The transform of the root cube to the mesh's bounding box: uniform scale, centred.
fn place(mesh: &Mesh) -> Result<DMat4, BuildError> {
    let (mut lo, mut hi) = (DVec3::MAX, DVec3::MIN);
    for &i in mesh.triangles.iter().flatten() {
        let p = DVec3::from(mesh.positions[i as usize]);
        lo = lo.min(p);
        hi = hi.max(p);
    }
    let extent = (hi - lo).max_element();
    if !(extent > 0.0 && extent.is_finite()) || (lo.abs().max(hi.abs()).max_element() / extent) > 1e12 {
        return Err(BuildError::Mesh(format!(
            "its extent is {extent:e} around {}: too small or too large",
            (lo + hi) * 0.5
        )));
    }
    let origin = (lo + hi) * 0.5 - DVec3::splat(extent * 0.5);
    Ok(DMat4::from_translation(origin) * DMat4::from_scale(DVec3::splat(extent)))
}

/// Marks edges that only one triangle has, corners being the same where their positions are.
fn boundary_edges(corners: &[[DVec3; 3]]) -> Vec<u8> {
    let key = |p: DVec3| p.to_array().map(|x| (x + 0.0).to_bits());
    let mut order: Vec<u32> = (0..corners.len() as u32 * 3).collect();
    let at = |i: u32| corners[i as usize / 3][i as usize % 3];
    order.par_sort_unstable_by_key(|i| key(at(*i)));
    let mut point = vec![0u32; order.len()];
    let mut id = 0;
    for (k, &i) in order.iter().enumerate() {
        if k > 0 && key(at(order[k - 1])) != key(at(i)) {
            id += 1;
        }
        point[i as usize] = id;
    }
    drop(order);
    let mut edges: Vec<(u64, u32)> = (0..point.len() as u32)
        .map(|i| {
            let next = i - i % 3 + (i + 1) % 3;
            let (a, b) = (point[i as usize], point[next as usize]);
            (u64::from(a.min(b)) << 32 | u64::from(a.max(b)), i)
        })
        .collect();
    edges.par_sort_unstable();
    let mut boundary = vec![0u8; corners.len()];
    for group in edges.chunk_by(|a, b| a.0 == b.0) {
        if let [(_, i)] = group {
            boundary[*i as usize / 3] |= 1 << (i % 3);
        }
    }
    boundary
}

/// Barycentric coordinates of points in the plane of a triangle.
struct Barycentric {
    a: DVec3,
    /// Gradients of the second and third coordinate.
    gradients: [DVec3; 2],
}

impl Barycentric {
    fn new([a, b, c]: &[DVec3; 3]) -> Self {
        let (ab, ac) = (*b - *a, *c - *a);
        let n = ab.cross(ac);
        let inverse = 1.0 / n.length_squared();
        Self { a: *a, gradients: [ac.cross(n) * inverse, n.cross(ab) * inverse] }
    }

    fn at(&self, p: DVec3) -> [f32; 3] {
        let d = p - self.a;
        let v = d.dot(self.gradients[0]).clamp(0.0, 1.0);
        let w = d.dot(self.gradients[1]).clamp(0.0, 1.0);
        [(1.0 - v - w).max(0.0) as f32, v as f32, w as f32]
    }
}

fn mix2(values: [Vec2; 3], w: [f32; 3]) -> Vec2 {
    values[0] * w[0] + values[1] * w[1] + values[2] * w[2]
}

fn mix3(values: [Vec3; 3], w: [f32; 3]) -> Vec3 {
    values[0] * w[0] + values[1] * w[1] + values[2] * w[2]
}
