//! A world of things that stay and objects that move.

use std::collections::BTreeMap;

use rayon::prelude::*;

use crate::error::ShadowError;
use crate::extent::{Extent, cluster};
use crate::grid::{Grid, Pose};
use crate::shape::{Shape, Stamp};
use crate::volume::{Bricks, Volume, octant};

/// Names an object of a [`World`].
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub struct ObjectId(u32);

/// An object where it is.
#[derive(Debug)]
struct Object {
    shape: Shape,
    stamp: Stamp,
}

/// A volume, what is fixed in it, and objects that move.
///
/// The volume is the union of all of them after each [`update`](Self::update), as if it had been made from nothing. Fixed things are kept a second time, in bricks,
/// so that they come back where an object leaves.
#[derive(Debug)]
pub struct World {
    grid: Grid,
    volume: Volume,
    fixed: Bricks,
    objects: BTreeMap<u32, Object>,
    /// Number of the next object: no number is used twice.
    next: u32,
    changed: Vec<Extent>,
}

/// What an update did.
#[derive(Clone, PartialEq, Eq, Debug, Default)]
pub struct Changes {
    /// Base cells that were made anew.
    pub cells: u64,
    /// Parts of the volume that have all changes, for [`Volume::level`] to be sent to a device.
    pub regions: Vec<Extent>,
}

impl World {
    /// An empty world of so many voxels along each axis.
    ///
    /// # Errors
    /// As [`Volume::new`].
    pub fn new(grid: Grid, voxels: [u32; 3], mips: u32) -> Result<Self, ShadowError> {
        let volume = Volume::new(voxels, mips)?;
        Ok(Self { grid, volume, fixed: Bricks::new(), objects: BTreeMap::new(), next: 0, changed: Vec::new() })
    }

    /// Where voxels lie.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// The volume, as of the last [`update`](Self::update).
    pub fn volume(&self) -> &Volume {
        &self.volume
    }

    /// What is fixed, inside and outside of the volume.
    pub fn fixed(&self) -> &Bricks {
        &self.fixed
    }

    /// Number of objects.
    pub fn objects(&self) -> usize {
        self.objects.len()
    }

    /// Adds a shape that stays.
    ///
    /// # Errors
    /// As [`Shape::voxels`].
    pub fn add_fixed(&mut self, shape: &Shape, pose: &Pose) -> Result<(), ShadowError> {
        let stamp = shape.voxels(pose, &self.grid)?;
        self.add_fixed_cells(stamp.cells());
        Ok(())
    }

    /// Adds base cells of voxels that stay: their places and bytes, as in a [`Volume`].
    pub fn add_fixed_cells(&mut self, cells: impl IntoIterator<Item = ([i32; 3], u8)>) {
        let mut extent = Extent { low: [0; 3], high: [0; 3] };
        for (cell, byte) in cells {
            self.fixed.merge_byte(cell, byte);
            extent = extent.around(&Extent { low: cell, high: cell.map(|c| c + 1) });
        }
        self.changed.push(extent);
    }

    /// Adds voxels that stay.
    pub fn add_fixed_voxels(&mut self, voxels: impl IntoIterator<Item = [i32; 3]>) {
        self.add_fixed_cells(voxels.into_iter().map(|voxel| (voxel.map(|c| c >> 1), 1 << octant(voxel))));
    }

    /// Puts an object into the world.
    ///
    /// # Errors
    /// As [`Shape::voxels`].
    pub fn insert(&mut self, shape: Shape, pose: &Pose) -> Result<ObjectId, ShadowError> {
        let stamp = shape.voxels(pose, &self.grid)?;
        self.changed.push(stamp.extent());
        let id = self.next;
        self.next += 1;
        self.objects.insert(id, Object { shape, stamp });
        Ok(ObjectId(id))
    }

    /// Moves objects, each to a pose. If one pose is not usable, none is moved.
    ///
    /// # Errors
    /// As [`Shape::voxels`]; an object that is not in the world.
    pub fn move_to(&mut self, poses: &[(ObjectId, Pose)]) -> Result<(), ShadowError> {
        let stamp = |(id, pose): &(ObjectId, Pose)| {
            let object = self.objects.get(&id.0);
            object.ok_or(ShadowError::NoObject(id.0))?.shape.voxels(pose, &self.grid)
        };
        let stamps: Vec<Stamp> = poses.par_iter().map(stamp).collect::<Result<_, _>>()?;
        for ((id, _), stamp) in poses.iter().zip(stamps) {
            if let Some(object) = self.objects.get_mut(&id.0) {
                self.changed.extend([object.stamp.extent(), stamp.extent()]);
                object.stamp = stamp;
            }
        }
        Ok(())
    }

    /// Takes an object out of the world.
    ///
    /// # Errors
    /// An object that is not in the world.
    pub fn remove(&mut self, id: ObjectId) -> Result<(), ShadowError> {
        let object = self.objects.remove(&id.0);
        self.changed.push(object.ok_or(ShadowError::NoObject(id.0))?.stamp.extent());
        Ok(())
    }

    /// What the next [`update`](Self::update) makes anew, one by one: the box of each object before and after it moved. Some may lie outside of the volume.
    pub fn pending(&self) -> &[Extent] {
        &self.changed
    }

    /// Brings the volume up to date. `each`: what a region costs beside its bytes, as a number of base cells; see [`cluster`].
    pub fn update(&mut self, each: u64) -> Changes {
        let whole = self.volume.extent();
        let changed: Vec<Extent> = self.changed.drain(..).map(|extent| extent.intersection(&whole)).collect();
        // Where an object moves little, its old and its new place are one.
        let parts = cluster(&changed, 0);
        for part in &parts {
            let here: Vec<&Stamp> = (self.objects.values().map(|object| &object.stamp))
                .filter(|stamp| !stamp.extent().intersection(part).is_empty())
                .collect();
            let fixed = &self.fixed;
            self.volume.rewrite(part, |cell, row| {
                row.fill(0);
                fixed.merge_row_into(cell, row);
                here.iter().for_each(|stamp| stamp.merge_row_into(cell, row));
            });
        }
        Changes { cells: parts.iter().map(Extent::cells).sum(), regions: cluster(&parts, each) }
    }
}
