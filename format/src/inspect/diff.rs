//! Comparing the contents of two octrees, regardless of their layout.

use std::fmt;

use serde::Serialize;

use crate::file::attachment;
use crate::{ComponentFormat, Contour, CornerCell, FormatError, Octree};

/// A place where two octrees differ.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Difference {
    /// Index of the object.
    pub object: usize,
    /// Path of the voxel: child slots from the root, one digit each. Empty for the root and for the object itself.
    pub path: String,
    /// The property that differs.
    pub what: &'static str,
    /// Its value in the first octree.
    pub first: String,
    /// Its value in the second octree.
    pub second: String,
}

impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let path = if self.path.is_empty() { "/" } else { &self.path };
        write!(
            f,
            "object {}, {path}: {} {} in the first, {} in the second",
            self.object, self.what, self.first, self.second
        )
    }
}

/// The differences of two octrees.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Differences {
    /// The first differences, in depth-first order.
    pub list: Vec<Difference>,
    /// Number of all differences. Descendants of a voxel that only one of the octrees subdivides are not compared.
    pub total: u64,
}

impl Differences {
    /// Whether the octrees are equal.
    pub fn is_empty(&self) -> bool {
        self.total == 0
    }
}

/// Compares the contents of two octrees: number of objects, and for each pair of objects transform, levels, topology,
/// the bits of contours, and the decoded colours, normals, values at corners, ambient light and components. Ignores blocks,
/// pointers, the order within a file, attachments of vendors, unknown sections and metadata. Lists at most `limit`
/// differences. Time is linear in the size of the octrees.
///
/// # Errors
/// An octree of a file that is not [verified](Octree::verified), or one that is not [sound](Octree::sound).
pub fn diff(a: &Octree, b: &Octree, limit: usize) -> Result<Differences, FormatError> {
    compare(a, b, limit, false)
}

/// The same without contours, colours, normals, values at corners, ambient light and components: which voxels there are, and which of them are leaves.
///
/// # Errors
/// As [`diff`].
pub fn diff_topology(a: &Octree, b: &Octree, limit: usize) -> Result<Differences, FormatError> {
    compare(a, b, limit, true)
}

fn compare(a: &Octree, b: &Octree, limit: usize, topology: bool) -> Result<Differences, FormatError> {
    for octree in [a, b] {
        octree.verified()?;
        octree.sound()?;
    }
    let mut kinds: Vec<u32> = [a, b].iter().flat_map(|octree| octree.component_kinds()).collect();
    kinds.sort_unstable();
    kinds.dedup();
    let format = |kind: u32| Some((kind, a.component_format(kind).or_else(|| b.component_format(kind))?));
    let kinds = kinds.into_iter().filter_map(format).collect();
    let mut compare = Compare { a, b, limit, topology, kinds, found: Differences::default(), object: 0 };
    let counts = (a.objects().len(), b.objects().len());
    compare.equal(&[], "number of objects", counts.0, counts.1);
    for object in 0..counts.0.min(counts.1) {
        compare.object = object;
        let (first, second) = (&a.objects()[object], &b.objects()[object]);
        if first.octree_to_mesh != second.octree_to_mesh {
            compare.add(&[], "transform", first.octree_to_mesh.text(), second.octree_to_mesh.text());
        }
        compare.equal(&[], "levels", first.levels, second.levels);
        compare.nodes(first.root_slot as u32, second.root_slot as u32);
    }
    Ok(compare.found)
}

/// A value as text. Floating-point numbers have enough digits to distinguish them.
trait Text {
    fn text(&self) -> String;
}

macro_rules! text_of_numbers {
    ($($number:ty)*) => {
        $(impl Text for $number {
            fn text(&self) -> String {
                self.to_string()
            }
        })*
    };
}

text_of_numbers!(u8 u32 usize f32 f64);

impl<T: Text, const N: usize> Text for [T; N] {
    fn text(&self) -> String {
        self.each_ref().map(T::text).join(" ")
    }
}

impl<T: Text> Text for Option<T> {
    fn text(&self) -> String {
        self.as_ref().map_or("none".into(), T::text)
    }
}

impl Text for Contour {
    fn text(&self) -> String {
        format!("{:08x}", self.0)
    }
}

impl Text for CornerCell {
    /// Stored colour and normal of each corner.
    fn text(&self) -> String {
        let corners = self.corners.map(|c| format!("{:08x} {:08x}", u32::from_be_bytes(c.color), c.normal.0));
        format!("{}, edge {} at {}", corners.join(", "), self.size, self.low.to_array().text())
    }
}

struct Compare<'a> {
    a: &'a Octree,
    b: &'a Octree,
    limit: usize,
    /// Whether what voxels have is left out.
    topology: bool,
    /// Types of component attachments that one of them has, with a format.
    kinds: Vec<(u32, ComponentFormat)>,
    found: Differences,
    object: usize,
}

impl Compare<'_> {
    #[cold]
    fn add(&mut self, path: &[u8], what: &'static str, first: String, second: String) {
        self.found.total += 1;
        if self.found.list.len() < self.limit {
            let path = path.iter().map(|slot| char::from(b'0' + slot)).collect();
            self.found.list.push(Difference { object: self.object, path, what, first, second });
        }
    }

    fn equal<T: PartialEq + Text>(&mut self, path: &[u8], what: &'static str, first: T, second: T) {
        if first != second {
            self.add(path, what, first.text(), second.text());
        }
    }

    /// Walks both octrees in parallel. Ends, as sound octrees are trees of at most 23 levels.
    fn nodes(&mut self, first: u32, second: u32) {
        // Slots of the descriptors, level of their voxel, and its child slot in its parent.
        let mut stack = vec![(first, second, 0usize, 0u8)];
        let mut path: Vec<u8> = Vec::with_capacity(24);
        while let Some((first, second, level, slot)) = stack.pop() {
            path.truncate(level.saturating_sub(1));
            if level > 0 {
                path.push(slot);
            }
            let (a, b) = (self.a.descriptor(first), self.b.descriptor(second));
            for child in 0..8u8 {
                path.push(child);
                self.voxel(
                    &path,
                    (first, a.valid_mask(), a.leaf_mask()),
                    (second, b.valid_mask(), b.leaf_mask()),
                    child,
                );
                path.pop();
            }
            for child in (0..8u8).rev() {
                if let (Some(a), Some(b)) = (self.a.child(first, child), self.b.child(second, child)) {
                    stack.push((a, b, level + 1, child));
                }
            }
        }
    }

    /// Compares child `child`. `first` and `second` are slot, valid mask and leaf mask of the descriptors in either
    /// octree.
    fn voxel(&mut self, path: &[u8], first: (u32, u8, u8), second: (u32, u8, u8), child: u8) {
        let kind = |(_, valid, leaf): (u32, u8, u8)| match (valid >> child & 1, leaf >> child & 1) {
            (0, _) => "nothing",
            (_, 0) => "a divided voxel",
            _ => "a leaf",
        };
        if kind(first) != kind(second) {
            self.add(path, "is", kind(first).into(), kind(second).into());
        }
        if self.topology || (first.1 & second.1) >> child & 1 == 0 {
            return;
        }
        let contours = (self.a.contour(first.0, child), self.b.contour(second.0, child));
        self.equal(path, "contour", contours.0, contours.1);
        self.equal(path, "colour", self.a.color(first.0, child), self.b.color(second.0, child));
        let alpha = |octree: &Octree, slot| octree.plain_color(slot, child).map_or(u8::MAX, |color| color[3]);
        self.equal(path, "alpha", alpha(self.a, first.0), alpha(self.b, second.0));
        self.equal(path, "corners", self.a.corners(first.0, child), self.b.corners(second.0, child));
        self.equal(path, "ambient light", self.a.ambient(first.0, child), self.b.ambient(second.0, child));
        let normal = |octree: &Octree, slot| octree.normal(slot, child).map(|n| n.to_array());
        self.equal(path, "normal", normal(self.a, first.0), normal(self.b, second.0));
        self.components(path, first.0, second.0, child);
    }

    /// Compares components by their numbers. A voxel without has the default.
    fn components(&mut self, path: &[u8], first: u32, second: u32, child: u8) {
        for index in 0..self.kinds.len() {
            let (kind, format) = self.kinds[index];
            let of = |octree: &Octree, slot: u32| {
                let default = || format.decode(&format.default_of(kind));
                octree.components(slot, child, kind).unwrap_or_else(default).numbers
            };
            self.equal(path, attachment::name(kind), of(self.a, first), of(self.b, second));
        }
    }
}
