//! From a surface to a list of voxels.

use std::time::{Duration, Instant};

use esvo_core::{Device, DeviceKind};
use esvo_device::wgpu::{Buffer, Features};
use esvo_device::{DeviceError, Gpu, Usage};
use esvo_format::morton;
use rayon::prelude::*;

use crate::attributes::{Attributes, Palette, SUM_WORDS, Wanted};
use crate::grid::Grid;
use crate::passes::{Emit, Params, Passes};
use crate::tiles::{Tile, edge, tiles};
use crate::work::{Rooms, Work};
use crate::{MAX_LEVEL, Method, RasterError, Surface, bounds, records};

/// A triangle and a voxel of the grid.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Pair {
    /// Index of the triangle.
    pub triangle: u32,
    /// The voxel.
    pub cell: [u32; 3],
}

/// Decides for pairs that single precision leaves undecided whether triangle and voxel meet.
pub type Decide<'a> = &'a (dyn Fn(&[Pair]) -> Vec<bool> + Sync);

/// What is wanted of a voxelization.
#[derive(Clone, Copy)]
pub struct Options<'a> {
    /// The grid has `2^level` voxels along its edge: 1 to [`MAX_LEVEL`].
    pub level: u32,
    /// The method.
    pub method: Method,
    /// Attributes of voxels. Needs [`Surface::looks`].
    pub wanted: Wanted,
    /// Who decides what [`Method::Compute`] cannot. `None`: double precision, [`bounds::meets`]. Called with pairs that are within the
    /// bounds of single precision only.
    pub decide: Option<Decide<'a>>,
}

impl Options<'_> {
    /// A grid of this level by this method, without attributes.
    #[must_use]
    pub fn new(level: u32, method: Method) -> Self {
        Self { level, method, wanted: Wanted::default(), decide: None }
    }
}

/// The voxels of a surface.
#[derive(Clone, Debug, Default)]
pub struct Voxels {
    /// [Morton codes](morton()), ascending.
    pub codes: Vec<u64>,
    /// One for each voxel, if attributes were wanted.
    pub attributes: Vec<Attributes>,
    /// What it took.
    pub stats: Stats,
}

/// What a voxelization took.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct Stats {
    /// Time on the device to find voxels.
    pub voxelize: Duration,
    /// Time on the device to list them.
    pub compact: Duration,
    /// Time on the device to sum attributes.
    pub attributes: Duration,
    /// Time on the processor to prepare triangles for tiles.
    pub preparation: Duration,
    /// Time on the processor to decide what the device could not.
    pub decisions: Duration,
    /// Pairs of triangle and voxel that the device could not decide.
    pub undecided: u64,
    /// Triangles, counted once for each tile that they are in.
    pub triangles: u64,
    /// Tiles that were worked on.
    pub tiles: u32,
    /// Tiles of the grid.
    pub tiles_of_grid: u32,
    /// Bytes on the device at once: grid, triangles, target.
    pub bytes: u64,
}

/// An open device with the voxelizer's shaders.
pub struct Voxelizer {
    gpu: Gpu,
    passes: Passes,
    largest_tile: u32,
    rooms: Rooms,
}

impl Voxelizer {
    /// Opens a device; see [`Gpu::open`].
    ///
    /// # Errors
    /// No such device; a shader that it refuses.
    pub fn open(name: Option<&str>) -> Result<Self, RasterError> {
        let wanted = Features::CONSERVATIVE_RASTERIZATION | Features::TEXTURE_ADAPTER_SPECIFIC_FORMAT_FEATURES;
        Self::new(Gpu::open_with(name, wanted)?)
    }

    /// Uses an open device. Methods that need a feature which is not switched on are left out.
    ///
    /// # Errors
    /// A shader that the device refuses.
    pub fn new(gpu: Gpu) -> Result<Self, RasterError> {
        let passes = Passes::new(&gpu)?;
        let rooms = Rooms::of(gpu.max_storage_bytes());
        Ok(Self { gpu, passes, largest_tile: u32::MAX, rooms })
    }

    /// The same with tiles of at most this many voxels along the edge, a power of two, instead of the largest that the device allows.
    #[must_use]
    pub fn with_tiles(self, voxels: u32) -> Self {
        Self { largest_tile: voxels.max(2).next_power_of_two(), ..self }
    }

    /// The device.
    pub fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// Name, kind and driver of the device, and which clock its times are of: not that of [`Gpu::about`] on drivers that run on the processor.
    pub fn device(&self) -> Device {
        let mut device = self.gpu.about().clone();
        if device.kind == DeviceKind::SoftwareGpu
            && let Some((driver, _)) = device.detail.rsplit_once(", ")
        {
            device.detail = format!("{driver}, timed by wall clock around submission");
        }
        device
    }

    /// Whether the device has what a method needs.
    ///
    /// # Errors
    /// [`RasterError::Lacks`]; a lost device.
    pub fn check(&self, method: Method) -> Result<(), RasterError> {
        // Pipelines that are made already know nothing of a loss.
        self.gpu.check()?;
        let device = self.gpu.about().name.clone();
        if !self.gpu.features().contains(method.features()) {
            return Err(RasterError::Lacks { method, device, lacks: "has no conservative rasterization" });
        }
        if method == Method::Compute {
            return Ok(());
        }
        match self.passes.raster(&self.gpu, method, Emit::Write) {
            Err(RasterError::Device(DeviceError::Invalid { .. })) if method.samples() > 1 => {
                let lacks =
                    if method.samples() == 4 { "has no targets of 4 samples" } else { "has no targets of 8 samples" };
                Err(RasterError::Lacks { method, device, lacks })
            }
            made => made.map(|_| ()),
        }
    }

    /// Voxels along the edge of the tiles of a grid of this level.
    fn tile_edge(&self, level: u32) -> u32 {
        edge(1 << level, self.gpu.max_storage_bytes()).min(self.largest_tile)
    }

    fn begin(&self, surface: &Surface<'_>, options: &Options<'_>) -> Result<(u32, Vec<Tile>), RasterError> {
        if !(1..=MAX_LEVEL).contains(&options.level) {
            return Err(RasterError::Level(options.level));
        }
        let voxels = 1 << options.level;
        records::check(surface.corners, f64::from(voxels), options.method)?;
        if options.wanted.any() {
            let looks = surface.looks.ok_or_else(|| {
                RasterError::Looks("attributes are wanted, but the surface has no colours and normals".into())
            })?;
            looks.check(surface.corners.len())?;
        }
        self.check(options.method)?;
        Ok((voxels, tiles(surface.corners, voxels, self.tile_edge(options.level))))
    }

    /// Finds the voxels that a surface meets.
    ///
    /// # Errors
    /// A surface, level or method that is not possible: [`RasterError`]; what the device reports.
    pub fn voxelize(&self, surface: &Surface<'_>, options: &Options<'_>) -> Result<Voxels, RasterError> {
        let (voxels, tiles) = self.begin(surface, options)?;
        let edge = self.tile_edge(options.level);
        let mut found = Voxels::default();
        found.stats.tiles = tiles.len() as u32;
        found.stats.tiles_of_grid = (voxels / edge).pow(3);
        let palette = match surface.looks {
            Some(looks) if options.wanted.any() => Some(Palette::new(&self.gpu, looks)?),
            _ => None,
        };
        let grid = Grid::new(&self.gpu, edge, options.wanted.any())?;
        for tile in &tiles {
            self.tile(surface, options, (tile, voxels), &grid, palette.as_ref(), &mut found)?;
        }
        Ok(found)
    }

    fn tile(
        &self,
        surface: &Surface<'_>,
        options: &Options<'_>,
        (tile, voxels): (&Tile, u32),
        grid: &Grid,
        palette: Option<&Palette>,
        found: &mut Voxels,
    ) -> Result<(), RasterError> {
        grid.clear(&self.gpu)?;
        let work = self.work(surface, options.method, grid, (tile, voxels), palette.is_some())?;
        let target = if options.method == Method::Compute {
            0
        } else {
            u64::from(tile.edge).pow(2) * u64::from(options.method.samples())
        };
        let stats = &mut found.stats;
        stats.bytes = stats.bytes.max(grid.bytes() + work.bytes + target);
        stats.preparation += work.preparation;
        stats.triangles += tile.triangles.len() as u64;
        let mut accepted: Vec<Vec<[u32; 2]>> = Vec::new();
        if options.method == Method::Compute {
            let mut undecided: Vec<(usize, [u32; 2])> = Vec::new();
            stats.voxelize += work.compute(
                Emit::Write,
                |_| (),
                &[],
                Some(&mut |index, pairs| undecided.extend(pairs.iter().map(|&pair| (index, pair)))),
            )?;
            stats.undecided += undecided.len() as u64;
            let start = Instant::now();
            accepted = decided(surface, options, &work, &undecided);
            stats.decisions += start.elapsed();
            for (index, pairs) in accepted.iter().enumerate() {
                stats.voxelize += work.apply(Emit::Write, |_| (), &[], (index, pairs))?;
            }
        } else {
            stats.voxelize += work.draw(Emit::Write, |_| (), &[])?;
        }
        let (list, time) = grid.list(&self.gpu, &self.passes.compact, self.rooms.voxels)?;
        stats.compact += time;
        if let Some(palette) = palette {
            stats.attributes += self.sum(options, &work, palette, &accepted, list.len(), &mut found.attributes)?;
        }
        let first = morton(tile.corner);
        found.codes.extend(list.into_iter().map(|code| first + u64::from(code)));
        Ok(())
    }

    fn work<'a>(
        &'a self,
        surface: &Surface<'_>,
        method: Method,
        grid: &'a Grid,
        (tile, voxels): (&'a Tile, u32),
        with_looks: bool,
    ) -> Result<Work<'a>, RasterError> {
        Work::new(&self.gpu, &self.passes, method, grid, (tile, voxels, self.rooms), surface, with_looks)
    }

    /// Appends the attributes of a tile's voxels.
    fn sum(
        &self,
        options: &Options<'_>,
        work: &Work<'_>,
        palette: &Palette,
        accepted: &[Vec<[u32; 2]>],
        voxels: usize,
        attributes: &mut Vec<Attributes>,
    ) -> Result<Duration, RasterError> {
        let bytes = SUM_WORDS as u64 * 4;
        // As many as a binding holds at once, within 512 MiB.
        let fit = self.gpu.max_storage_bytes().min(512 << 20) / bytes;
        let window = fit.min(self.rooms.voxels.into()).min(voxels.max(1) as u64) as usize;
        let usage = Usage::STORAGE | Usage::COPY_SRC | Usage::COPY_DST;
        let sums = self.gpu.buffer("sums", window as u64 * bytes, usage)?;
        let buffers: [&Buffer; 4] = [&work.grid.ranks, &palette.materials, &palette.texels, &sums];
        let mut time = Duration::ZERO;
        for start in (0..voxels).step_by(window) {
            let change = |params: &mut Params| {
                params.wanted = options.wanted.bits();
                params.sum_first = start as u32;
                params.sum_count = window as u32;
            };
            self.gpu.run(|commands| commands.clear_buffer(&sums, 0, None))?;
            if options.method == Method::Compute {
                time += work.compute(Emit::Sum, change, &buffers, None)?;
                for (index, pairs) in accepted.iter().enumerate() {
                    time += work.apply(Emit::Sum, change, &buffers, (index, pairs))?;
                }
            } else {
                time += work.draw(Emit::Sum, change, &buffers)?;
            }
            let count = window.min(voxels - start);
            let words: Vec<u32> = self.gpu.read(&sums, count * SUM_WORDS)?;
            let of_voxel = |sums: &[u32]| Attributes::of_sums(sums, options.wanted);
            attributes.extend(words.par_chunks(SUM_WORDS).map(of_voxel).collect::<Result<Vec<_>, _>>()?);
        }
        Ok(time)
    }

    /// Of the voxels `missing`, ascending, that a method has not found: those in a column of which it has shaded a pixel for a
    /// triangle that meets the voxel. The others are holes: no pixel was shaded for any such triangle.
    ///
    /// # Errors
    /// As [`voxelize`](Self::voxelize).
    pub fn cracks(
        &self,
        surface: &Surface<'_>,
        options: &Options<'_>,
        missing: &[u64],
    ) -> Result<Vec<u64>, RasterError> {
        let (voxels, tiles) = self.begin(surface, options)?;
        let edge = self.tile_edge(options.level);
        let grid = Grid::new(&self.gpu, edge, false)?;
        let mut found = Vec::new();
        for tile in &tiles {
            let first = morton(tile.corner);
            let end = first + u64::from(edge).pow(3);
            let here = &missing[missing.partition_point(|&code| code < first)..];
            let here = &here[..here.partition_point(|&code| code < end)];
            if here.is_empty() || options.method == Method::Compute {
                continue;
            }
            let mut bits = vec![0u32; grid.words as usize];
            for code in here {
                let code = (code - first) as u32;
                bits[(code >> 5) as usize] |= 1 << (code & 31);
            }
            grid.clear(&self.gpu)?;
            let missing = self.gpu.upload("missing", &bits, Usage::STORAGE)?;
            let work = self.work(surface, options.method, &grid, (tile, voxels), false)?;
            work.draw(Emit::Crack, |_| (), &[&missing])?;
            let (list, _) = grid.list(&self.gpu, &self.passes.compact, self.rooms.voxels)?;
            found.extend(list.into_iter().map(|code| first + u64::from(code)));
        }
        Ok(found)
    }

    /// How often a method shades each pixel.
    ///
    /// # Errors
    /// As [`voxelize`](Self::voxelize).
    pub fn pixels(&self, surface: &Surface<'_>, options: &Options<'_>) -> Result<Pixels, RasterError> {
        let (voxels, tiles) = self.begin(surface, options)?;
        let edge = self.tile_edge(options.level);
        let mut pixels = Pixels { edge, shaded: 0, counts: Vec::new() };
        if options.method == Method::Compute {
            return Ok(pixels);
        }
        let grid = Grid::new(&self.gpu, 2, false)?;
        let size = u64::from(edge).pow(2) * 3;
        let usage = Usage::STORAGE | Usage::COPY_SRC | Usage::COPY_DST;
        let buffer = self.gpu.buffer("pixels", size * 4, usage)?;
        for tile in &tiles {
            self.gpu.run(|commands| commands.clear_buffer(&buffer, 0, None))?;
            let work = self.work(surface, options.method, &grid, (tile, voxels), false)?;
            work.draw(Emit::Pixels, |_| (), &[&buffer])?;
            let counts: Vec<u32> = self.gpu.read(&buffer, size as usize)?;
            pixels.shaded += counts.iter().map(|&count| u64::from(count)).sum::<u64>();
            pixels.counts = counts;
        }
        if tiles.len() > 1 {
            pixels.counts.clear();
        }
        Ok(pixels)
    }
}

/// How often pixels are shaded.
#[derive(Clone, Debug)]
pub struct Pixels {
    /// Pixels along the edge of a projection.
    pub edge: u32,
    /// How often any is.
    pub shaded: u64,
    /// For projections along x, y and z: a row for each coordinate of the axis before it, a column for each of the axis after it (x
    /// after z). Empty for grids of several tiles.
    pub counts: Vec<u32>,
}

/// The pairs of each batch that meet, of those that the device has left undecided.
fn decided(
    surface: &Surface<'_>,
    options: &Options<'_>,
    work: &Work<'_>,
    undecided: &[(usize, [u32; 2])],
) -> Vec<Vec<[u32; 2]>> {
    let pairs: Vec<Pair> = undecided.par_iter().map(|&(index, pair)| work.pair(index, pair)).collect();
    let scale = f64::from(1u32 << options.level);
    let meets = |pair: &Pair| {
        let corners = surface.corners[pair.triangle as usize].map(|corner| corner * scale);
        bounds::meets(&corners, pair.cell.map(i64::from))
    };
    let meet = match options.decide {
        Some(decide) => decide(&pairs),
        None => pairs.par_iter().map(meets).collect(),
    };
    let mut accepted: Vec<Vec<[u32; 2]>> = Vec::new();
    for (&(index, pair), _) in undecided.iter().zip(meet).filter(|(_, meets)| *meets) {
        if accepted.len() <= index {
            accepted.resize(index + 1, Vec::new());
        }
        accepted[index].push(pair);
    }
    accepted
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::{Looks, Material, TriangleLook};

    /// Walls in borders, whose touches single precision leaves undecided, and triangles in all directions, with looks.
    fn scene() -> (Vec<[DVec3; 3]>, Looks) {
        let corner = |i: u32| {
            let x = f64::from(i.wrapping_mul(2_654_435_761) >> 8) / f64::from(1 << 24);
            let y = f64::from(i.wrapping_mul(2_246_822_519) >> 8) / f64::from(1 << 24);
            DVec3::new(x, y, f64::from(i % 33) / 32.0)
        };
        let corners: Vec<_> = (0..60).map(|i| [corner(3 * i), corner(3 * i + 1), corner(3 * i + 2)]).collect();
        let look = |i: usize| TriangleLook {
            normals: [[0.6, 0.0, if i.is_multiple_of(2) { 0.8 } else { -0.8 }]; 3],
            uvs: [[0.0; 2]; 3],
            colors: [[i as f32 / 60.0, 0.5, 1.0]; 3],
            material: 0,
        };
        let materials = vec![Material { color: [1.0, 0.5, 0.25], texture: None }];
        let looks = Looks { triangles: (0..corners.len()).map(look).collect(), materials, textures: Vec::new() };
        (corners, looks)
    }

    #[test]
    fn results_do_not_depend_on_how_much_is_done_at_once() {
        let open = || match Voxelizer::open(None) {
            Err(error) if std::env::var_os("ESVO_REQUIRE_GPU").is_none() => {
                println!("skipped: {error}");
                None
            }
            opened => Some(opened.unwrap()),
        };
        let Some(whole) = open() else { return };
        // An item has 256 columns of 32 voxels at most.
        let rooms = Rooms { triangles: 7, items: 11, undecided: 8192, voxels: 1000 };
        let parts = Voxelizer { rooms, ..open().unwrap() };
        let crowded = Voxelizer {
            rooms: Rooms { undecided: 40, items: 1 << 20, triangles: 1 << 20, ..rooms },
            ..open().unwrap()
        };
        let (corners, looks) = scene();
        let surface = Surface { corners: &corners, looks: Some(&looks) };
        for method in [Method::DominantAxis, Method::ExpandedTested, Method::Compute] {
            let wanted = Wanted { colors: true, normals: true };
            let run = |voxelizer: &Voxelizer| {
                voxelizer.voxelize(&surface, &Options { wanted, ..Options::new(5, method) }).unwrap()
            };
            let first = run(&whole);
            assert!(first.codes.len() > 3000 && first.attributes.len() == first.codes.len());
            for voxelizer in [&parts, &crowded] {
                let second = run(voxelizer);
                assert!(first.codes == second.codes && first.attributes == second.attributes, "{method}");
                assert_eq!(first.stats.undecided, second.stats.undecided);
            }
            // So many that the crowded one had to divide its work.
            assert!(method != Method::Compute || first.stats.undecided > 3 * 40, "{}", first.stats.undecided);
        }
    }

    #[test]
    fn the_clock_is_named() {
        if let Ok(voxelizer) = Voxelizer::open(None) {
            let (own, about) = (voxelizer.device(), voxelizer.gpu().about().clone());
            let software = about.kind == DeviceKind::SoftwareGpu;
            assert_eq!(
                own.detail.ends_with("timed by wall clock around submission"),
                software || !voxelizer.gpu().has_clock()
            );
            assert_eq!(own.name, about.name);
        }
    }
}
