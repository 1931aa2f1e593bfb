//! Computes what a file decodes to from its bytes and its image, by the formulas of the specification in binary64. Uses no
//! code of the library.

use std::fmt::Write;

use serde_json::{Value, json};

fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap())
}

fn u64_at(bytes: &[u8], at: usize) -> u64 {
    u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap())
}

/// A file that is known to be valid.
struct File<'a> {
    bytes: &'a [u8],
    image: &'a [u8],
}

/// Where the attachments of a block are. Offsets count from the start of the image.
struct Block {
    start: usize,
    pairs_colors: Option<usize>,
    pairs_normals: Option<usize>,
    constant: Option<usize>,
    pairs_ambient: Option<usize>,
    plain_colors: Option<usize>,
    plain_normals: Option<usize>,
    corners: Option<usize>,
    /// Types and places of components.
    components: Vec<(u32, usize)>,
}

impl File<'_> {
    fn section(&self, tag: &[u8; 4]) -> &[u8] {
        let directory = u64_at(self.bytes, 40) as usize;
        let count = u32_at(self.bytes, 48) as usize;
        let entry = (0..count).map(|i| directory + 32 * i).find(|at| &self.bytes[*at..at + 4] == tag);
        let at = entry.expect("the section");
        let (offset, length) = (u64_at(self.bytes, at + 8) as usize, u64_at(self.bytes, at + 16) as usize);
        &self.bytes[offset..offset + length]
    }

    fn block(&self, index: usize) -> Block {
        let start = u64_at(self.section(b"BLKT"), 72 * index + 24) as usize;
        let info = start + 8 * u64_at(self.image, start) as usize;
        let find = |kind: u32| {
            (0..u32_at(self.image, info + 20) as usize)
                .map(|k| info + 32 + 16 * k)
                .find(|at| u32_at(self.image, *at) == kind)
                .map(|at| info + u32_at(self.image, at + 4) as usize)
        };
        Block {
            start,
            pairs_colors: find(1),
            pairs_normals: find(2),
            constant: find(3),
            pairs_ambient: find(4),
            plain_colors: find(5),
            plain_normals: find(6),
            corners: find(7),
            components: (8..=11).chain(16..=31).filter_map(|kind| Some((kind, find(kind)?))).collect(),
        }
    }

    fn color(&self, block: &Block, slot: usize, child: usize) -> Option<Value> {
        if let Some(at) = block.constant {
            return Some(json!([0, 1, 2].map(|k| f64::from(self.image[at + k]) / 255.0)));
        }
        let texel = child + 8 * (slot % 2);
        let at = block.pairs_colors? + 8 * (slot / 2);
        let w = u32_at(self.image, at);
        let index = u32_at(self.image, at + 4) >> (2 * texel) & 3;
        let unit = 2f64.powi(-32);
        let ref0 = [w << 16, w << 21, w << 27].map(|c| f64::from(c) * unit);
        let ref1 = [w, w << 5, w << 11].map(|c| f64::from(c) * unit);
        let color = [0, 1, 2].map(|k| match index {
            0 => ref0[k],
            1 => ref1[k],
            2 => (2.0 * ref0[k] + ref1[k]) / 3.0,
            _ => (ref0[k] + 2.0 * ref1[k]) / 3.0,
        });
        Some(json!(color))
    }

    fn normal(&self, block: &Block, slot: usize, child: usize) -> Option<Value> {
        let texel = child + 8 * (slot % 2);
        let at = block.pairs_normals? + 16 * (slot / 2);
        let [w, us, axes, vs] = [0, 4, 8, 12].map(|k| u32_at(self.image, at + k));
        let base = raw_normal(w);
        let axis = |h: u32| {
            let scale = 2f64.powi((h >> 16 & 15) as i32 - 41);
            [h, h << 4, h << 8].map(|c| f64::from(c as i32) * scale)
        };
        let c = [-1.0, -1.0 / 3.0, 1.0 / 3.0, 1.0];
        let (cu, cv) = (c[(us >> (2 * texel) & 3) as usize], c[(vs >> (2 * texel) & 3) as usize]);
        let (ua, va) = (axis(axes << 16), axis(axes));
        let sum = [0, 1, 2].map(|k| base[k] + cu * ua[k] + cv * va[k]);
        Some(direction(sum))
    }

    /// The word of a voxel in the plain attachment at `at`.
    fn plain(&self, at: usize, slot: usize, child: usize, valid: u32) -> u32 {
        let entry = u32_at(self.image, at + 4 * slot);
        let (mask, first) = (entry & 0xff, (entry >> 8) as usize);
        let own = (0..8).filter(|i| mask & valid & 1 << i != 0);
        let rank = if mask >> child & 1 != 0 { own.filter(|i| *i < child).count() } else { own.count() };
        u32_at(self.image, at + 4 * (first + rank))
    }

    /// The numbers of a voxel in the component attachment at `at`; `None` if its descriptor has no values.
    fn components(&self, at: usize, slot: usize, child: usize, valid: u32) -> Option<Vec<f64>> {
        let [n, format, form] = [0, 1, 2].map(|k| usize::from(self.image[at + k]));
        let width = [0, 1, 1, 2, 2, 2, 4, 4, 0][format];
        let words = if format == 8 { 1 } else { (n * width).div_ceil(4) };
        let mut first = at + 8;
        if form == 0 {
            let entry = u32_at(self.image, at + 8 + 4 * slot);
            if entry == 0 {
                return None;
            }
            let own = (0..8).filter(|i| entry & valid & 1 << i != 0);
            let rank = if entry >> child & 1 != 0 { own.filter(|i| *i < child).count() } else { own.count() };
            first = at + 4 * ((entry >> 8) as usize + words * rank);
        }
        if format == 8 {
            let word = u32_at(self.image, first);
            let unit = 2f64.powi((word >> 27) as i32 - 24);
            return Some([0, 9, 18].map(|shift| f64::from(word >> shift & 511) * unit).to_vec());
        }
        let number = |k: usize| {
            let mut bytes = [0; 4];
            bytes[..width].copy_from_slice(&self.image[first + k * width..first + (k + 1) * width]);
            let bits = u32::from_le_bytes(bytes);
            match format {
                2 => f64::from(bits) / 255.0,
                4 => f64::from(bits) / 65535.0,
                5 => {
                    let (exponent, mantissa) = ((bits >> 10 & 31) as i32, f64::from(bits & 1023));
                    let hidden = if exponent == 0 { 0.0 } else { 1024.0 };
                    let size = (hidden + mantissa) * 2f64.powi(exponent.max(1) - 25);
                    if bits >> 15 == 1 { -size } else { size }
                }
                7 => f64::from(f32::from_bits(bits)),
                _ => f64::from(bits),
            }
        };
        Some((0..n).map(number).collect())
    }

    /// Adds plain values, corners and ambient occlusion to a voxel.
    fn values(&self, block: &Block, slot: usize, child: usize, valid: u32, voxel: &mut Value) {
        if let Some(at) = block.plain_colors {
            let [r, g, b, alpha] = self.plain(at, slot, child, valid).to_le_bytes();
            voxel["color"] = json!([r, g, b].map(|c| f64::from(c) / 255.0));
            voxel["alpha"] = json!(f64::from(alpha) / 255.0);
        }
        if let Some(at) = block.plain_normals {
            voxel["normal"] = json!(normalised(raw_normal(self.plain(at, slot, child, valid))));
        }
        if let Some(at) = block.corners {
            self.corners(at, slot, child, voxel);
        }
        if let Some(at) = block.pairs_ambient {
            let word = u64_at(self.image, at + 8 * (slot / 2));
            let weight = (word >> (16 + 3 * (child + 8 * (slot % 2))) & 7) as f64;
            let (ref0, ref1) = ((word & 0xffff) as f64 / 256.0, (word & 0xff) as f64);
            voxel["ambient"] = json!(((weight * ref0 + (7.0 - weight) * ref1) / (7.0 * 255.0)).min(1.0));
        }
    }

    fn corners(&self, at: usize, slot: usize, child: usize, voxel: &mut Value) {
        let (mask, first) = (u32_at(self.image, at + 8 * slot), u32_at(self.image, at + 8 * slot + 4) as usize);
        let bit = |n: usize, axis: usize| n >> axis & 1;
        let point = |k: usize| [1, 3, 9].iter().enumerate().map(|(a, step)| (bit(child, a) + bit(k, a)) * step).sum();
        let points: [usize; 8] = std::array::from_fn(point);
        let count = |below: usize| (0..below).filter(|n| mask >> n & 1 != 0).count();
        let own = points.iter().all(|n| mask >> n & 1 != 0);
        if !own && mask >> 27 & 1 == 0 {
            return;
        }
        let values = [0, 1, 2, 3, 4, 5, 6, 7].map(|k| {
            let index = if own { count(points[k]) } else { count(27) + k };
            [0, 4].map(|word| u32_at(self.image, at + 4 * first + 8 * index + word))
        });
        voxel["own_corners"] = json!(own);
        let shown = values.map(|[color, normal]| {
            let [r, g, b, alpha] = color.to_le_bytes().map(u32::from);
            [r, g, b, alpha, normal]
        });
        voxel["corners"] = json!(shown);
        let q = [0, 1, 2].map(|axis| if own { 0.5 } else { (bit(child, axis) as f64 + 0.5) / 2.0 });
        let (mut total, mut color, mut normal) = (0.0, [0.0; 4], [0.0; 3]);
        for (k, [r, g, b, alpha, raw]) in shown.into_iter().enumerate() {
            if alpha == 0 {
                continue;
            }
            let weight: f64 = (0..3).map(|axis| if bit(k, axis) != 0 { q[axis] } else { 1.0 - q[axis] }).product();
            total += weight;
            let unit = normalised(raw_normal(raw));
            for axis in 0..3 {
                normal[axis] += weight * unit[axis];
            }
            for (sum, channel) in color.iter_mut().zip([r, g, b, alpha]) {
                *sum += weight * f64::from(channel) / 255.0;
            }
        }
        if total > 0.0 {
            let [r, g, b, alpha] = color.map(|c| c / total);
            voxel["color"] = json!([r, g, b]);
            voxel["alpha"] = json!(alpha);
            voxel["normal"] = direction(normal);
        }
    }

    /// Adds a line for the descriptor at `slot` of the image, then lines for those below it, in slot order.
    fn node(&self, slot: usize, path: &str, position: [u32; 3], index: usize, place: &Place, out: &mut Vec<Value>) {
        let level = path.len();
        let block = self.block(index);
        let local = slot - block.start / 8;
        let at = 8 * slot;
        let (low, high) = (u32_at(self.image, at), u32_at(self.image, at + 4));
        let (leaf, valid, contours) = (low & 0xff, low >> 8 & 0xff, high & 0xff);
        let mut contour_at = at + 4 * (high >> 8) as usize;
        let mut voxels = Vec::new();
        for child in (0..8).filter(|child| valid >> child & 1 != 0) {
            let mut voxel = json!({ "slot": child, "leaf": leaf >> child & 1 != 0 });
            if contours >> child & 1 != 0 {
                let edge = 2f64.powi(-1 - level as i32);
                let centre = [0, 1, 2]
                    .map(|k| f64::from(position[k]) * 2f64.powi(-23) + edge * (f64::from(child as u8 >> k & 1) + 0.5));
                voxel["contour"] = contour(u32_at(self.image, contour_at), centre, edge, place);
                contour_at += 4;
            }
            let attributes =
                [("color", self.color(&block, local, child)), ("normal", self.normal(&block, local, child))];
            for (name, value) in attributes {
                if let Some(value) = value {
                    voxel[name] = value;
                }
            }
            self.values(&block, local, child, valid, &mut voxel);
            for &(kind, at) in &block.components {
                if let Some(numbers) = self.components(at, local, child, valid) {
                    voxel["components"][kind.to_string()] = json!(numbers);
                }
            }
            voxels.push(voxel);
        }
        out.push(json!({
            "path": path, "level": level, "position": position, "block": index, "slot": local,
            "valid": valid, "leaf": leaf, "contours": contours, "far": low >> 16 & 1 != 0, "voxels": voxels,
        }));
        if valid & !leaf == 0 {
            return;
        }
        let near = slot + (low >> 17) as usize;
        let mut first = near;
        if low >> 16 & 1 != 0 {
            first = slot + u32_at(self.image, 8 * near) as usize;
        }
        let table = self.section(b"BLKT");
        let starts = (0..table.len() / 72).map(|i| u64_at(table, 72 * i + 24) as usize / 8);
        let below = starts.take_while(|start| *start <= first).count() - 1;
        for child in (0..8).filter(|child| valid & !leaf & 1 << child != 0) {
            let half = 1u32 << (22 - level);
            let corner = [0, 1, 2].map(|k| position[k] + half * (child >> k & 1));
            self.node(first, &format!("{path}{child}"), corner, below, place, out);
            first += 1;
        }
    }
}

/// A point on the surface of the cube from -1 to 1.
fn raw_normal(w: u32) -> [f64; 3] {
    let t = if w >> 31 != 0 { -1.0 } else { 1.0 };
    let u = f64::from((w << 3) as i32) * 2f64.powi(-31);
    let v = f64::from((w << 18) as i32) * 2f64.powi(-31);
    match w >> 29 & 3 {
        0 => [t, u, v],
        1 => [v, t, u],
        _ => [u, v, t],
    }
}

fn normalised(n: [f64; 3]) -> [f64; 3] {
    let length = n.iter().map(|x| x * x).sum::<f64>().sqrt();
    if length == 0.0 { [0.0, 0.0, 1.0] } else { n.map(|x| x / length) }
}

/// A vector of length 1, or "any" where rounding decides which.
fn direction(n: [f64; 3]) -> Value {
    let length = dot(n, n).sqrt();
    if length < 2f64.powi(-12) { json!("any") } else { json!(n.map(|x| x / length)) }
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|k| a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3])
}

/// The transform of an object: the images of the axes and of the origin.
struct Place {
    axes: [[f64; 3]; 3],
    origin: [f64; 3],
}

impl Place {
    fn new(m: &[f64]) -> Self {
        let column = |c: usize| [0, 1, 2].map(|r| m[4 * c + r]);
        Self { axes: [0, 1, 2].map(column), origin: column(3) }
    }

    /// The transposed inverse of the linear part, times `n`.
    fn plane(&self, n: [f64; 3]) -> [f64; 3] {
        let [x, y, z] = self.axes;
        let cofactors = [cross(y, z), cross(z, x), cross(x, y)];
        let determinant = dot(x, cofactors[0]);
        [0, 1, 2].map(|k| (0..3).map(|c| cofactors[c][k] * n[c]).sum::<f64>() / determinant)
    }
}

/// A contour as it is stored, what it decodes to, and where it is in mesh space: all points between two planes.
fn contour(w: u32, centre: [f64; 3], edge: f64, place: &Place) -> Value {
    let signed = |shift: u32| f64::from((w << shift) as i32);
    let n = [signed(14) * 2f64.powi(-26), signed(20) * 2f64.powi(-26), signed(26) * 2f64.powi(-26)];
    let (position, thickness) = (signed(7) * 2f64.powi(-25) * 0.75, f64::from(w) * 2f64.powi(-25) * 0.75);
    let m = place.plane(n);
    let length = dot(m, m).sqrt();
    let offset = dot(n, centre) + dot(m, place.origin);
    let plane = |side: f64| (offset + edge * (position + side * thickness)) / length;
    json!({
        "word": w, "normal": n, "position": position, "thickness": thickness,
        "mesh": { "normal": m.map(|x| x / length), "low": plane(-0.5), "high": plane(0.5) },
    })
}

/// The JSON file of a vector: short lines, one for each descriptor.
pub(crate) fn describe(name: &str, about: &str, bytes: &[u8], image: &[u8]) -> String {
    let file = File { bytes, image };
    let mut text = String::from("{\n");
    let line = |text: &mut String, key: &str, value: Value| writeln!(text, "\"{key}\": {value},").unwrap();
    line(&mut text, "file", json!(format!("{name}.esvo")));
    line(&mut text, "about", json!(about));
    let version = [u32_at(bytes, 12) & 0xffff, u32_at(bytes, 12) >> 16];
    line(&mut text, "version", json!(version));
    line(&mut text, "required_features", json!(u64_at(bytes, 16)));
    line(&mut text, "optional_features", json!(u64_at(bytes, 24)));
    let directory = u64_at(bytes, 40) as usize;
    let sections = (0..u32_at(bytes, 48) as usize).map(|i| directory + 32 * i).map(|at| {
        // Each byte as the character of this number.
        let tag: String = bytes[at..at + 4].iter().map(|byte| char::from(*byte)).collect();
        json!({ "tag": tag, "flags": u32_at(bytes, at + 4), "bytes": u64_at(bytes, at + 16) })
    });
    list(&mut text, "sections", sections.collect());
    let blocks = file.section(b"BLKT");
    let blocks = blocks.chunks_exact(72).map(|entry| {
        let start = u64_at(entry, 24) as usize;
        let info = start + 8 * u64_at(image, start) as usize;
        let attachments: Vec<Value> = (0..u32_at(image, info + 20) as usize)
            .map(|k| info + 32 + 16 * k)
            .map(|at| json!({ "type": u32_at(image, at), "bytes": u64_at(image, at + 8) }))
            .collect();
        let corner = [8, 12, 16].map(|at| u32_at(entry, at));
        json!({
            "object": u32_at(entry, 0), "parent": u32_at(entry, 4),
            "position": corner, "scale": u32_at(entry, 20),
            "codec": u32_at(entry, 56), "slots": u32_at(image, info + 4), "contours": u32_at(image, info + 16),
            "attachments": attachments,
        })
    });
    list(&mut text, "blocks", blocks.collect());
    text += "\"objects\": [\n";
    let objects = file.section(b"OBJT");
    for (index, entry) in objects.chunks_exact(192).enumerate() {
        text += if index == 0 { "{\n" } else { ",\n{\n" };
        let transform: Vec<f64> = (0..16).map(|k| f64::from_bits(u64_at(entry, 8 * k))).collect();
        line(&mut text, "octree_to_mesh", json!(transform));
        line(&mut text, "levels", json!(u32_at(entry, 132)));
        for (k, name) in ["descriptors", "leaf_voxels", "contours", "far_pointers"].into_iter().enumerate() {
            line(&mut text, name, json!(u64_at(entry, 144 + 8 * k)));
        }
        let mut nodes = Vec::new();
        let (root, place) = (u64_at(entry, 136) as usize, Place::new(&transform));
        file.node(root, "", [0; 3], u32_at(entry, 128) as usize, &place, &mut nodes);
        let lines: Vec<String> = nodes.iter().map(Value::to_string).collect();
        write!(text, "\"nodes\": [\n{}\n]\n}}", lines.join(",\n")).unwrap();
    }
    text + "\n]\n}\n"
}

fn list(text: &mut String, name: &str, values: Vec<Value>) {
    let lines: Vec<String> = values.iter().map(Value::to_string).collect();
    writeln!(text, "\"{name}\": [\n{}\n],", lines.join(",\n")).unwrap();
}
