//! The trait that every engine implements.

use std::fmt;
use std::sync::Arc;
use std::time::{Duration, Instant};

use esvo_format::Octree;
use serde::{Deserialize, Serialize};

use crate::filter::{self, Frame, Radius};
use crate::{CastError, Checked, Fans, Hit, Instances, Nearest, Picture, Rays, Roots, View};

/// Casts rays against one octree.
///
/// Callers use [`load`](Self::load), [`cast`](Self::cast), [`time`](Self::time), [`cast_rays`](Self::cast_rays),
/// [`cast_fans`](Self::cast_fans) and [`cast_instances`](Self::cast_instances). These check what they are given and hand it to the methods that an engine implements,
/// whose names end in `_checked`. An engine implements only those: it can read a view only after the check, see
/// [`Roots::open`].
pub trait Caster: Send {
    /// Short name of the engine: `reference`, `cpu`, `wgpu`, `ash`.
    fn name(&self) -> &'static str;

    /// What it runs on.
    fn device(&self) -> &Device;

    /// Bytes of octree data that the device holds for casting; 0 if no octree is loaded.
    fn resident_bytes(&self) -> u64;

    /// Loads an octree: checks it, picks kernels by what it [needs](Octree::needs), uploads what casting reads. If that
    /// fails, no octree may be loaded afterwards, neither this one nor the one before.
    ///
    /// The checks are [`Octree::intact`], which compares the checksums of all blocks of a file, and [`Octree::sound`]. Each
    /// is made once per octree. For a file that was verified before, the first can be left out: open it with
    /// [`OpenOptions::verify`](esvo_format::OpenOptions::verify) off.
    ///
    /// # Errors
    /// An octree that is damaged or not sound, or is larger than the device takes.
    fn load(&mut self, octree: &Arc<Octree>) -> Result<(), CastError> {
        octree.intact().map_err(CastError::Damaged)?;
        let roots = Roots::of(octree)?;
        self.load_checked(octree, roots)
    }

    /// Casts one frame: `hits[y * width + x]`, the first row on top. Resizes `hits`.
    ///
    /// A ray misses if it is not finite, or if a component of its direction exceeds 2^20
    /// ([`MAX_COMPONENT`](crate::reference::MAX_COMPONENT)), or one of its origin 2^40.
    ///
    /// # Errors
    /// No octree loaded; a view that [`View::check`] refuses; a root that is not one of the octree's; what the device said.
    fn cast(&mut self, view: &View, hits: &mut Vec<Hit>) -> Result<(), CastError> {
        let view = self.roots().ok_or(CastError::NotLoaded)?.check_view(view)?;
        self.cast_checked(view, hits)
    }

    /// Casts one frame as [`cast`](Self::cast) does, reads nothing back, and tells how long the passes took: on a GPU by
    /// its own timestamps, on a CPU by a monotonic clock.
    ///
    /// # Errors
    /// As `cast`.
    fn time(&mut self, view: &View) -> Result<FrameTime, CastError> {
        let view = self.roots().ok_or(CastError::NotLoaded)?.check_view(view)?;
        self.time_checked(view)
    }

    /// Casts rays of any origin, direction, span and size: `hits[i]` is that of `rays.rays[i]`. Resizes `hits`. A GPU casts
    /// them in one submission, or in a few if their number exceeds what the device takes at once.
    ///
    /// A ray that [is not cast](crate::Ray::is_cast) misses: one with a number that is NaN, or with a direction of more
    /// than 2^20 or an origin of more than 2^40 on an axis.
    ///
    /// # Errors
    /// No octree loaded; a root that is not one of the octree's; what the device said.
    fn cast_rays(&mut self, rays: &Rays, hits: &mut Vec<Hit>) -> Result<(), CastError> {
        let rays = self.roots().ok_or(CastError::NotLoaded)?.check_rays(rays)?;
        self.cast_rays_checked(rays, hits)
    }

    /// Casts the rays of `fans` down to the leaves: `hits[fan * directions + direction]`. Resizes `hits`. Rays miss as in
    /// [`cast`](Self::cast).
    ///
    /// # Errors
    /// No octree loaded; a root that is not one of the octree's; what the device said.
    fn cast_fans(&mut self, fans: &Fans, hits: &mut Vec<Hit>) -> Result<(), CastError> {
        let fans = self.roots().ok_or(CastError::NotLoaded)?.check_fans(fans)?;
        self.cast_fans_checked(fans, hits)
    }

    /// Casts one frame of many placed objects: `nearest` becomes what [`Nearest::cast`] of the views returns, but for the
    /// [`iterations`](Hit::iterations) of its hits, which are those of the instances that were cast for a pixel. A ray goes
    /// through the hierarchy over the instances once, and is cast into those whose part of the picture it is in, front to back.
    ///
    /// # Errors
    /// No octree loaded; a root that is not one of the octree's; what the device said.
    fn cast_instances(&mut self, instances: &Instances, nearest: &mut Nearest) -> Result<(), CastError> {
        let instances = self.roots().ok_or(CastError::NotLoaded)?.check_instances(instances)?;
        self.cast_instances_checked(instances, nearest)
    }

    /// Filters a picture where voxels are larger than a pixel (paper section 4.3). Needs no octree. Without a method of its
    /// own, an engine filters on one thread.
    ///
    /// # Errors
    /// What the device said; a picture that is larger than it takes.
    fn filter(&mut self, frame: &Frame, radius: Radius) -> Result<Filtered, CastError> {
        let start = Instant::now();
        let picture = filter::filter(frame, radius);
        Ok(Filtered { picture, time: start.elapsed() })
    }

    /// For engines: the roots that came with the octree that is loaded; `None` without one.
    fn roots(&self) -> Option<&Roots>;

    /// For engines: takes an octree that is sound, and keeps `roots` for as long as it holds the octree.
    ///
    /// # Errors
    /// As [`load`](Self::load).
    fn load_checked(&mut self, octree: &Arc<Octree>, roots: Roots) -> Result<(), CastError>;

    /// For engines: [`cast`](Self::cast). Without a method of its own, an engine casts the rays of the pixels by
    /// [`cast_rays`](Self::cast_rays), and no beam.
    ///
    /// # Errors
    /// What the device said.
    fn cast_checked(&mut self, view: Checked<View>, hits: &mut Vec<Hit>) -> Result<(), CastError> {
        let view = *self.roots().ok_or(CastError::NotLoaded)?.open(&view)?;
        let pixels = (0..view.height).flat_map(|y| (0..view.width).map(move |x| (x, y)));
        let rays: Vec<_> = pixels.map(|(x, y)| view.ray(x, y)).collect();
        self.cast_rays(&Rays { root: view.root, contours: view.contours(), rays: &rays }, hits)
    }

    /// For engines: [`time`](Self::time). Without a method of its own, an engine casts the frame and looks at the clock.
    ///
    /// # Errors
    /// What the device said.
    fn time_checked(&mut self, view: Checked<View>) -> Result<FrameTime, CastError> {
        let start = Instant::now();
        self.cast_checked(view, &mut Vec::new())?;
        Ok(FrameTime { total: start.elapsed(), coarse: Duration::ZERO })
    }

    /// For engines: [`cast_rays`](Self::cast_rays).
    ///
    /// # Errors
    /// What the device said.
    fn cast_rays_checked(&mut self, rays: Checked<Rays<'_>>, hits: &mut Vec<Hit>) -> Result<(), CastError>;

    /// For engines: [`cast_fans`](Self::cast_fans). Without a method of its own, an engine casts the rays of the fans by
    /// [`cast_rays`](Self::cast_rays).
    ///
    /// # Errors
    /// What the device said.
    fn cast_fans_checked(&mut self, fans: Checked<Fans<'_>>, hits: &mut Vec<Hit>) -> Result<(), CastError> {
        let fans = *self.roots().ok_or(CastError::NotLoaded)?.open(&fans)?;
        let rays: Vec<_> = fans.rays().collect();
        self.cast_rays(&Rays { root: fans.root, contours: fans.contours, rays: &rays }, hits)
    }

    /// For engines: [`cast_instances`](Self::cast_instances). Without a method of its own, an engine goes through the hierarchy on
    /// the processor and casts the rays of one instance after the other by [`cast_rays`](Self::cast_rays).
    ///
    /// # Errors
    /// What the device said.
    fn cast_instances_checked(
        &mut self,
        instances: Checked<&Instances>,
        nearest: &mut Nearest,
    ) -> Result<(), CastError> {
        let instances = *self.roots().ok_or(CastError::NotLoaded)?.open(&instances)?;
        instances.cast_all(nearest, |view, rays, hits| {
            self.cast_rays(&Rays { root: view.root, contours: view.contours(), rays }, hits)
        })
    }
}

/// How long a frame took.
#[derive(Clone, Copy, PartialEq, Debug, Serialize)]
pub struct FrameTime {
    /// Both passes.
    pub total: Duration,
    /// The coarse pass alone; zero without one.
    pub coarse: Duration,
}

/// A picture that was filtered.
#[derive(Clone, PartialEq, Debug)]
pub struct Filtered {
    /// The picture.
    pub picture: Picture,
    /// How long the pass took, without copies: on a GPU by its own timestamps, on a CPU by a monotonic clock.
    pub time: Duration,
}

/// What a caster runs on.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub struct Device {
    /// Name as the driver or the processor gives it.
    pub name: String,
    /// Processor, GPU, or a Vulkan driver that runs on the processor.
    pub kind: DeviceKind,
    /// Driver and version, or instruction set and threads.
    pub detail: String,
}

/// Kind of a [`Device`]. Stored and displayed as `cpu`, `gpu`, `software-gpu`.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DeviceKind {
    /// Native code on the processor.
    Cpu,
    /// A GPU.
    Gpu,
    /// A Vulkan driver that runs on the processor. Its times say nothing about a GPU: never compare the two.
    SoftwareGpu,
}

impl DeviceKind {
    /// Every kind.
    pub const ALL: [Self; 3] = [Self::Cpu, Self::Gpu, Self::SoftwareGpu];

    /// The name under which it is stored.
    pub fn name(self) -> &'static str {
        match self {
            Self::Cpu => "cpu",
            Self::Gpu => "gpu",
            Self::SoftwareGpu => "software-gpu",
        }
    }
}

impl fmt::Display for DeviceKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        // `pad` keeps the width that a table asks for.
        f.pad(self.name())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kinds_are_stored_as_they_are_displayed() {
        for kind in DeviceKind::ALL {
            let stored = serde_json::to_string(&kind).expect("is stored");
            assert_eq!(stored, format!("\"{kind}\""));
            assert_eq!(serde_json::from_str::<DeviceKind>(&stored).expect("is read"), kind);
        }
        assert!(serde_json::from_str::<DeviceKind>("\"Cpu\"").is_err());
        assert_eq!(format!("{:>4}|{:<5}|", DeviceKind::Cpu, DeviceKind::Gpu), " cpu|gpu  |");
    }
}
