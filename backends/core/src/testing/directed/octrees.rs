//! Octrees that are hard for a caster.

use std::sync::Arc;

use esvo_format::{AssembleOptions, Contour, FormatError, Octree, Tree, Voxel, assemble};
use glam::DMat4;

use super::{noise, one_of};
use crate::testing::sample::{Noise, Sample};

/// An octree of the suite.
#[derive(Clone)]
pub struct DataSet {
    /// Its name, one word.
    pub name: &'static str,
    /// What is hard about it.
    pub about: &'static str,
    /// The octree.
    pub octree: Arc<Octree>,
    /// The octree after each of the [symmetries](Symmetry::SOME), if its voxels are cubes.
    pub turned: Vec<Arc<Octree>>,
}

/// A child of a node of a [`Shape`].
#[derive(Clone, Copy)]
enum Cell {
    Empty,
    Leaf(Option<Contour>),
    /// Number of the node.
    Node(usize, Option<Contour>),
}

/// An octree to be assembled. Node 0 is the root.
#[derive(Default)]
struct Shape {
    nodes: Vec<[Cell; 8]>,
}

/// A symmetry of the cube: axis `i` of the image is axis `axes[i]` of the original, mirrored if bit `i` is set.
#[derive(Clone, Copy, Debug)]
pub struct Symmetry {
    /// The axes.
    pub axes: [usize; 3],
    /// The mirrored ones.
    pub mirrored: u8,
}

impl Symmetry {
    /// Itself, and some that together mirror and exchange all axes.
    const NONE: Self = Self { axes: [0, 1, 2], mirrored: 0 };

    /// Mirrors along each axis and along all, and two turns.
    pub const SOME: [Self; 6] = [
        Self { axes: [0, 1, 2], mirrored: 1 },
        Self { axes: [0, 1, 2], mirrored: 2 },
        Self { axes: [0, 1, 2], mirrored: 4 },
        Self { axes: [0, 1, 2], mirrored: 7 },
        Self { axes: [1, 2, 0], mirrored: 0 },
        Self { axes: [1, 0, 2], mirrored: 5 },
    ];

    /// The image of a vector.
    pub fn turn(&self, vector: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|axis| {
            let x = vector[self.axes[axis]];
            if self.mirrored >> axis & 1 != 0 { -x } else { x }
        })
    }

    /// The image of a point of cast space, the cube `[1, 2]³`.
    pub fn turn_point(&self, point: [f64; 3]) -> [f64; 3] {
        self.turn(point.map(|x| x - 1.5)).map(|x| x + 1.5)
    }

    /// The image of a child slot.
    fn turn_slot(&self, slot: usize) -> usize {
        (0..3).fold(0, |image, axis| image | (slot >> self.axes[axis] & 1) << axis) ^ usize::from(self.mirrored)
    }
}

impl Shape {
    /// Makes the node of a cube by `cell`, which is told level and slot of each child and says what it is; and those below.
    fn grow(&mut self, level: u32, cell: &mut impl FnMut(u32, usize) -> Cell) -> usize {
        let number = self.nodes.len();
        self.nodes.push([Cell::Empty; 8]);
        let mut cells: [Cell; 8] = std::array::from_fn(|slot| cell(level + 1, slot));
        if cells.iter().all(|cell| matches!(cell, Cell::Empty)) {
            cells[number % 8] = Cell::Leaf(None);
        }
        for cell_of in &mut cells {
            if let Cell::Node(_, contour) = *cell_of {
                *cell_of = Cell::Node(self.grow(level + 1, cell), contour);
            }
        }
        self.nodes[number] = cells;
        number
    }

    fn write(&self, tree: &mut Tree, number: usize, symmetry: Symmetry) {
        let mut cells = [Cell::Empty; 8];
        for (slot, cell) in self.nodes[number].iter().enumerate() {
            cells[symmetry.turn_slot(slot)] = *cell;
        }
        let voxels = cells.map(|cell| match cell {
            Cell::Empty => None,
            Cell::Leaf(contour) => Some(Voxel { leaf: true, contour, ..Voxel::default() }),
            Cell::Node(_, contour) => Some(Voxel { leaf: false, contour, ..Voxel::default() }),
        });
        let index = tree.open(&voxels);
        for cell in cells {
            if let Cell::Node(below, _) = cell {
                self.write(tree, below, symmetry);
            }
        }
        tree.close(index);
    }

    fn octree(&self, symmetry: Symmetry, layout: AssembleOptions) -> Result<Arc<Octree>, FormatError> {
        let mut tree = Tree::default();
        self.write(&mut tree, 0, symmetry);
        Ok(Arc::new(assemble(&tree, DMat4::IDENTITY, &layout)?))
    }
}

/// A set of cubes with its images.
fn cubes(
    name: &'static str,
    about: &'static str,
    shape: &Shape,
    layout: AssembleOptions,
) -> Result<DataSet, FormatError> {
    let turned = Symmetry::SOME.iter().map(|symmetry| shape.octree(*symmetry, layout)).collect::<Result<_, _>>()?;
    Ok(DataSet { name, about, octree: shape.octree(Symmetry::NONE, layout)?, turned })
}

/// The names of all sets, in their order.
pub const DATA_SETS: [&str; 12] =
    ["one-voxel", "full", "checkers", "chains", "sparse", "far", "sphere", "thin", "wide", "any", "aside", "dents"];

/// Few nodes, and far pointers wherever there is a pointer.
const FAR: AssembleOptions = AssembleOptions { block_slots: 64, near_limit: 1 };

/// All sets of the suite. The same every time.
///
/// # Errors
/// What [`assemble`] refuses.
pub fn data_sets() -> Result<Vec<DataSet>, FormatError> {
    let near = AssembleOptions::default();
    let grown = |cell: &mut dyn FnMut(u32, usize) -> Cell| {
        let mut shape = Shape::default();
        shape.grow(0, &mut |level, slot| cell(level, slot));
        shape
    };
    let one = grown(&mut |_, slot| if slot == 5 { Cell::Leaf(None) } else { Cell::Empty });
    let full = grown(&mut |level, _| if level == 4 { Cell::Leaf(None) } else { Cell::Node(0, None) });
    let checkers = grown(&mut |level, slot| match (level, (slot ^ slot >> 1 ^ slot >> 2) & 1) {
        (_, 0) => Cell::Empty,
        (6, _) => Cell::Leaf(None),
        _ => Cell::Node(0, None),
    });
    let mut way = noise(3);
    let mut inner = 0;
    let chains = grown(&mut |level, slot| {
        // Three chains from the root; below, one node and now and then a leaf beside it.
        if slot == 0 {
            inner = (way.number() * 8.0) as usize;
        }
        match level {
            1 if [1, 4, 6].contains(&slot) => Cell::Node(0, None),
            2..=22 if slot == inner => Cell::Node(0, None),
            23 if slot == inner => Cell::Leaf(None),
            2..=23 if way.number() < 0.1 => Cell::Leaf(None),
            _ => Cell::Empty,
        }
    });
    let mut sparse_noise = noise(4);
    let mut sparse_nodes = 0;
    let sparse = grown(&mut |level, _| {
        let number = sparse_noise.number();
        if level < 23 && number < if level < 4 { 0.4 } else { 0.15 } && sparse_nodes < 30_000 {
            sparse_nodes += 1;
            Cell::Node(0, None)
        } else if number > 0.75 {
            Cell::Leaf(None)
        } else {
            Cell::Empty
        }
    });
    Ok(vec![
        cubes("one-voxel", "one leaf at level 1", &one, near)?,
        cubes("full", "all voxels of 4 levels", &full, near)?,
        cubes("checkers", "every other child, 6 levels: cubes that touch at edges", &checkers, near)?,
        cubes("chains", "one node per level, 23 levels", &chains, near)?,
        cubes("sparse", "leaves at all of 23 levels", &sparse, near)?,
        cubes("far", "the same with far pointers everywhere and blocks of 64 slots", &sparse, FAR)?,
        cubes("sphere", "a closed shell, 6 levels", &sphere_shape(6), near)?,
        with_contours("thin", "contours of the least thickness, normals at their limits", &mut |noise| {
            word(noise, 0, 0)
        })?,
        with_contours("wide", "contours of the greatest thickness", &mut |noise| word(noise, 127, 127))?,
        with_contours("any", "contours of any word", &mut |noise| (noise.number() * f64::from(u32::MAX)) as u32)?,
        with_contours("aside", "contours at the rim of their voxels or beside them", &mut |noise| {
            let position = one_of(noise, &[-64i32, -63, -33, 32, 62, 63]);
            word(noise, 0, 8) & !(0x7f << 18) | (position as u32 & 0x7f) << 18
        })?,
        DataSet {
            name: "dents",
            about: "a dented sphere with fitting contours, 7 levels, far pointers",
            octree: Sample::scattered(7, true).octree()?,
            turned: Vec::new(),
        },
    ])
}

/// A contour word with a thickness field between two, and a normal that is often at its limits.
fn word(noise: &mut Noise, least: u32, most: u32) -> u32 {
    let mut field = |limits: &[i32]| {
        if noise.number() < 0.5 { one_of(noise, limits) as u32 & 63 } else { (noise.number() * 64.0) as u32 & 63 }
    };
    let normal = field(&[-32, 31, 0, 1, -1]) << 12 | field(&[-32, 31, 0, 1, -1]) << 6 | field(&[-32, 31, 0, 1, -1]);
    let thickness = least + (noise.number() * f64::from(most - least + 1)) as u32;
    thickness << 25 | ((noise.number() * 128.0) as u32 & 127) << 18 | normal
}

/// Random voxels of 6 levels, three of four with a contour.
fn with_contours(
    name: &'static str,
    about: &'static str,
    word: &mut dyn FnMut(&mut Noise) -> u32,
) -> Result<DataSet, FormatError> {
    let mut random = noise(name.len() as u64);
    let mut shape = Shape::default();
    shape.grow(0, &mut |level, _| {
        // A normal of zero is none.
        let whole = |word: u32| if word & 0x3ffff == 0 { word | 1 } else { word };
        let contour = (random.number() < 0.75).then(|| Contour(whole(word(&mut random))));
        match random.number() {
            number if level < 6 && number < 0.5 => Cell::Node(0, contour),
            number if level > 1 && number < 0.7 => Cell::Leaf(contour),
            _ => Cell::Empty,
        }
    });
    Ok(DataSet { name, about, octree: shape.octree(Symmetry::NONE, AssembleOptions::default())?, turned: Vec::new() })
}

/// All cubes that meet the sphere around the middle of cast space of radius 0.37.
fn sphere_shape(levels: u32) -> Shape {
    fn node(shape: &mut Shape, corner: [f64; 3], edge: f64, levels: u32) -> usize {
        let number = shape.nodes.len();
        shape.nodes.push([Cell::Empty; 8]);
        for slot in 0..8 {
            let half = edge * 0.5;
            let at: [f64; 3] = std::array::from_fn(|axis| corner[axis] + half * (slot >> axis & 1) as f64);
            let (mut near, mut far) = (0.0, 0.0);
            for low in at {
                let (low, high) = (low - 1.5, low + half - 1.5);
                let nearest = 0.0f64.clamp(low, high);
                near += nearest * nearest;
                far += low.abs().max(high.abs()).powi(2);
            }
            if near > 0.37 * 0.37 || far < 0.37 * 0.37 {
                continue;
            }
            let cell = if levels == 1 { Cell::Leaf(None) } else { Cell::Node(node(shape, at, half, levels - 1), None) };
            shape.nodes[number][slot] = cell;
        }
        number
    }
    let mut shape = Shape::default();
    node(&mut shape, [1.0; 3], 1.0, levels);
    shape
}

/// All cubes of a level that meet a sphere: a closed surface, without contours.
///
/// # Errors
/// What [`assemble`] refuses.
pub fn sphere(levels: u32) -> Result<Arc<Octree>, FormatError> {
    sphere_shape(levels).octree(Symmetry::NONE, AssembleOptions::default())
}
