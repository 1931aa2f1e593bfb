//! The measurements of serving.

use std::fs::File;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use esvo_core::camera::viewpoint::overview_of;
use esvo_core::{Camera, CastOptions, Detail, Nearest, Object, Picture, View, shading};
use esvo_engines::{EngineId, OpenOptions};
use esvo_format::{FormatError, IndexReader, Octree, RangeRead, Region, StreamReader};
use esvo_remote::server::{Pace, Server};
use esvo_remote::{RemoteFile, RemoteOptions};

use super::{SCHEMA, ServeBenchOptions, ServeReport, ServeRow, ServedFile};
use crate::scene::{SceneSource, buildable, manifest};
use crate::system::machine::Machine;
use crate::{BenchError, Progress};

/// Field of view of a camera from outside, in degrees.
const FOV: f64 = 60.0;

pub(super) fn all(options: &ServeBenchOptions, progress: &Progress) -> Result<ServeReport, BenchError> {
    let start = Instant::now();
    let machine = Machine::detect();
    let (name, camera) = camera(options)?;
    let served = options.files.iter().map(|path| file(options, path, camera, progress)).collect::<Result<_, _>>()?;
    Ok(ServeReport {
        schema: SCHEMA,
        machine,
        delay_ms: options.delay_ms,
        mbit: options.mbit,
        camera: name,
        size: options.size,
        served,
        seconds: start.elapsed().as_secs_f64(),
    })
}

/// The camera of the scene, and its name.
fn camera(options: &ServeBenchOptions) -> Result<(String, Option<Camera>), BenchError> {
    let Some(name) = &options.scene else { return Ok(("A camera that sees all from outside".into(), None)) };
    let manifest = manifest(None)?;
    let entry = buildable(&manifest, name)?;
    let views = SceneSource::find(entry, options.scenes_dir.as_deref(), false)?.views();
    let view = views.get(options.view.wrapping_sub(1)).ok_or_else(|| {
        BenchError::option(format!("--view {}", options.view), format!("{name} has views 1 to {}", views.len()))
    })?;
    Ok((format!("Camera {} of {}", view.name, entry.name), Some(view.camera)))
}

/// A reader of a file on the server.
enum Reader {
    Index(Box<IndexReader<Arc<RemoteFile>>>),
    Tables(Box<StreamReader<Arc<RemoteFile>>>),
}

impl Reader {
    fn open(file: &Arc<RemoteFile>, head: u32) -> Result<Self, FormatError> {
        if head > 0 {
            return Ok(Self::Index(Box::new(IndexReader::open(file.clone())?)));
        }
        Ok(Self::Tables(Box::new(StreamReader::open(file.clone())?)))
    }

    fn octree(&mut self, level: &impl Fn(usize, &Region) -> u32) -> Result<Octree, FormatError> {
        match self {
            Self::Index(reader) => reader.octree_by(level),
            Self::Tables(reader) if reader.parts().is_empty() => reader.partial(&reader.blocks_by(level)),
            Self::Tables(reader) => reader.partial_parts(&reader.parts_by(level)),
        }
    }

    /// Stored bytes of the blocks that are wanted, where the tables say so.
    fn stored(&self, level: &impl Fn(usize, &Region) -> u32) -> Option<u64> {
        let Self::Tables(reader) = self else { return None };
        let size = |index: &u32| reader.blocks()[*index as usize].stored_size;
        Some(reader.blocks_by(level).iter().map(size).sum())
    }
}

/// Whatever is asked of the whole file and of what was read of it.
struct Rays<'a> {
    camera: Camera,
    options: &'a ServeBenchOptions,
}

impl Rays<'_> {
    fn views(&self, octree: &Octree, max_voxel_pixels: f32) -> Result<Vec<View>, BenchError> {
        let cast = CastOptions { max_voxel_pixels, ..CastOptions::default() };
        let view = |object: &Object| object.view(&self.camera, self.options.size.into(), &cast);
        let views: Result<Vec<_>, _> = Object::all(octree).iter().map(view).collect();
        views.map_err(cast_error)
    }

    fn picture(&self, octree: &Arc<Octree>, max_voxel_pixels: f32) -> Result<(Nearest, Picture), BenchError> {
        let views = self.views(octree, max_voxel_pixels)?;
        let mut caster = EngineId::Cpu.open(&OpenOptions::default()).map_err(BenchError::Open)?;
        caster.load(octree).map_err(cast_error)?;
        let nearest = Nearest::cast(&mut *caster, &views).map_err(cast_error)?;
        let picture = shading::shade_nearest(octree, &views, &nearest);
        Ok((nearest, picture))
    }
}

fn cast_error(source: esvo_core::CastError) -> BenchError {
    BenchError::Cast { engine: EngineId::Cpu, source }
}

/// Pixels whose `t`, size of voxel, object or colour differs.
fn different(a: &(Nearest, Picture), b: &(Nearest, Picture)) -> u64 {
    let hits = a.0.hits.iter().zip(&b.0.hits).zip(a.0.views.iter().zip(&b.0.views));
    let colors = a.1.rgb8.chunks_exact(3).zip(b.1.rgb8.chunks_exact(3));
    let differs = |((a, b), whose): ((&esvo_core::Hit, &esvo_core::Hit), (&u32, &u32))| {
        a.t() != b.t() || !a.is_miss() && (a.size() != b.size() || whose.0 != whose.1)
    };
    hits.zip(colors).filter(|(hits, (a, b))| differs(*hits) || a != b).count() as u64
}

fn file(
    options: &ServeBenchOptions,
    path: &Path,
    camera: Option<Camera>,
    progress: &Progress,
) -> Result<ServedFile, BenchError> {
    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let bad = |source| BenchError::file(path, source);
    progress.say(format!("{name}: opening the whole"));
    let whole = Arc::new(
        Octree::open_with(path, &esvo_format::OpenOptions { verify: false, ..Default::default() }).map_err(bad)?,
    );
    let local = || File::open(path).map_err(|error| BenchError::io(path, error));
    let length = local()?.metadata().map_err(|error| BenchError::io(path, error))?.len();
    let mut head = [0; 4];
    // The length of the head (specification, section 2.1).
    local()?.read_at(56, &mut head).map_err(|error| BenchError::io(path, error))?;
    let head = u32::from_le_bytes(head);
    let camera = match camera {
        Some(camera) => camera,
        None => {
            let [width, height] = options.size.map(f64::from);
            overview_of(&Object::all(&whole), [0.0, 1.0, 0.0], FOV, width / height)
        }
    };
    let rays = Rays { camera, options };
    let pace = Pace {
        delay: Duration::from_millis(options.delay_ms),
        bytes_per_second: (options.mbit * 1e6 / 8.0).ceil() as u64,
    };
    // A reader that knows nothing: another server, another connection.
    let open = || -> Result<(Server, Arc<RemoteFile>, Reader, Instant), BenchError> {
        let server = Server::of_file(local()?, pace).map_err(|error| BenchError::io(path, error))?;
        let start = Instant::now();
        let file = RemoteFile::open(&server.address("octree.esvo"), RemoteOptions::default());
        let file = Arc::new(file.map_err(|error| bad(FormatError::Source { offset: 0, source: error.into() }))?);
        let reader = Reader::open(&file, head).map_err(bad)?;
        Ok((server, file, reader, start))
    };
    let mut rows = Vec::new();
    {
        progress.say(format!("{name}: opened"));
        let (_server, file, _, start) = open()?;
        rows.push(ServeRow {
            what: "opened".into(),
            bytes: file.bytes(),
            requests: Some(file.requests()),
            seconds: Some(start.elapsed().as_secs_f64()),
            octree_bytes: None,
            different: None,
            control: None,
        });
    }
    let mut wanted = vec![(format!("coarse, level {}", options.coarse_level), None)];
    wanted.extend(
        options
            .pixels
            .iter()
            .map(|pixels| (if *pixels > 0.0 { format!("{pixels} px") } else { "leaves".into() }, Some(*pixels))),
    );
    for (what, pixels) in wanted {
        progress.say(format!("{name}: {what}"));
        let details: Vec<Detail> = match pixels {
            None => Vec::new(),
            Some(pixels) => rays.views(&whole, pixels)?.iter().map(Detail::of).collect(),
        };
        let level = |object: usize, cube: &Region| match pixels {
            None => options.coarse_level,
            Some(_) => details.get(object).map_or(0, |detail| detail.level(cube)),
        };
        let (_server, file, mut reader, start) = open()?;
        if let Some(stored) =
            reader.stored(&level).filter(|s| *s as f64 / pace.bytes_per_second as f64 > options.longest_seconds)
        {
            let bytes = file.bytes() + stored;
            rows.push(ServeRow {
                what,
                bytes,
                requests: None,
                seconds: None,
                octree_bytes: None,
                different: None,
                control: None,
            });
            continue;
        }
        let part = Arc::new(reader.octree(&level).map_err(bad)?);
        let seconds = start.elapsed().as_secs_f64();
        let (bytes, requests) = (file.bytes(), Some(file.requests()));
        let (mut wrong, mut control) = (None, None);
        if let Some(pixels) = pixels {
            let expected = rays.picture(&whole, pixels)?;
            wrong = Some(different(&expected, &rays.picture(&part, pixels)?));
            if head > 0 {
                // Needs nothing that has not been read.
                let less = |object: usize, cube: &Region| level(object, cube).saturating_sub(1);
                let less = Arc::new(reader.octree(&less).map_err(bad)?);
                control = Some(different(&expected, &rays.picture(&less, pixels)?));
            }
        }
        let octree_bytes = Some(size_of_val(part.slots()) as u64);
        rows.push(ServeRow { what, bytes, requests, seconds: Some(seconds), octree_bytes, different: wrong, control });
    }
    let codec = whole.blocks().first().map_or(0, |block| block.codec);
    Ok(ServedFile {
        name,
        stored: ["raw", "Zstandard", "parts by level"].get(codec as usize).copied().unwrap_or("another codec").into(),
        file_bytes: length,
        head_bytes: head.into(),
        levels: whole.objects().iter().map(|object| object.levels).max().unwrap_or(0),
        voxels: whole.objects().iter().map(|object| object.voxels()).sum(),
        rows,
    })
}
