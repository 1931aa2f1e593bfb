//! What is compared of a record, whichever benchmark made it: named cells with their samples.

use esvo_core::{Device, DeviceKind};
use serde::Serialize;

use crate::PaperReport;
use crate::calibration::{CalibrationRecord, GuardSamples};
use crate::needs_bench::NeedsReport;
use crate::paper_bench::matrix::Variant;
use crate::paper_bench::report::DeviceRecord;
use crate::ray_bench::RayReport;
use crate::scene::NamedView;
use crate::sweep_bench::SweepReport;
use crate::system::machine::Machine;

/// The benchmarks whose records can be compared.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum RecordKind {
    /// `esvo bench`.
    Tables,
    /// `esvo bench sweep`.
    Sweep,
    /// `esvo bench rays`.
    Rays,
    /// `esvo bench needs`.
    Needs,
}

impl RecordKind {
    /// As files and JSON have it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Tables => "tables",
            Self::Sweep => "sweep",
            Self::Rays => "rays",
            Self::Needs => "needs",
        }
    }
}

/// A record's times.
#[derive(Clone, PartialEq, Debug)]
pub struct MeasuredRun {
    /// The benchmark.
    pub kind: RecordKind,
    /// Name of the matrix or plan, or of the scenes.
    pub name: String,
    /// The machine and the software.
    pub machine: Machine,
    /// What its calibration casts were; `None` in old records.
    pub calibration: Option<CalibrationRecord>,
    /// Engines that were slowed on purpose, in words.
    pub slowed: Vec<String>,
    /// Checks of answers that failed, in words.
    pub wrong: Vec<String>,
    /// What was timed.
    pub cells: Vec<MeasuredCell>,
}

/// Something that was timed in every round.
#[derive(Clone, PartialEq, Debug)]
pub struct MeasuredCell {
    /// Scene, engine, and what was cast. Cells of two records with the same name are compared.
    pub name: [String; 3],
    /// What must be equal for times to be comparable: name and value. What only one of two cells has is not looked at.
    pub same: Vec<(&'static str, String)>,
    /// `seconds[round][view]`.
    pub seconds: Vec<Vec<f64>>,
    /// Calibration casts and processor times; empty in old records, and for GPUs, of whose speed they say nothing.
    pub guard: GuardSamples,
}

/// A record with times.
pub trait Measured {
    /// Its cells.
    fn measured(&self) -> MeasuredRun;
}

impl Measured for PaperReport {
    fn measured(&self) -> MeasuredRun {
        let mut cells = Vec::new();
        for scene in &self.scenes {
            for time in &scene.times {
                let mut same = vec![("levels", time.levels.to_string()), ("views", views(&scene.views))];
                let mut gpu = false;
                if let Some(device) = self.devices.iter().find(|device| device.backend == time.backend) {
                    same.extend(device_values(device));
                    gpu = device.kind == DeviceKind::Gpu;
                }
                if time.variant == Variant::Triangles {
                    same.extend(mesh(&scene.identity, scene.triangles));
                    let displaced = scene.builds.iter().rev().find_map(|build| build.displaced_triangles);
                    same.extend(displaced.map(|count| ("displaced triangles", count.to_string())));
                } else if let Some(build) = scene.build(time.variant != Variant::Cubical, time.levels) {
                    same.extend(octree(&build.image_sha256));
                    same.extend([("voxels", build.voxels.to_string()), ("bytes", build.bytes.to_string())]);
                }
                let [width, height] = time.size;
                cells.push(MeasuredCell {
                    name: [
                        scene.name.clone(),
                        time.backend.name().into(),
                        format!("{}, {width}x{height}", time.variant.title()),
                    ],
                    same,
                    seconds: time.samples.seconds.clone(),
                    guard: unless(gpu, &time.samples.guard),
                });
            }
        }
        let wrong = |(scene, check): (&str, &crate::paper_bench::report::CheckRow)| {
            format!("{scene}, {}, {}", check.backend.name(), check.variant.title())
        };
        MeasuredRun {
            kind: RecordKind::Tables,
            name: self.matrix.name.clone(),
            machine: self.machine.clone(),
            calibration: self.calibration.clone(),
            slowed: self.slowed.iter().map(|slowed| format!("{} by {} %", slowed.engine, slowed.percent)).collect(),
            wrong: self.failures().map(wrong).collect(),
            cells,
        }
    }
}

impl Measured for SweepReport {
    fn measured(&self) -> MeasuredRun {
        let mut cells = Vec::new();
        for scene in &self.scenes {
            for cell in scene.cells.iter().filter(|cell| !cell.seconds.is_empty()) {
                let [width, height] = self.plan.size;
                let mut same = vec![("size", format!("{width}x{height}")), ("views", views(&scene.views))];
                let mut gpu = false;
                if let Some(device) = self.devices.iter().find(|device| device.backend == cell.engine) {
                    same.extend(device_values(device));
                    gpu = device.kind == DeviceKind::Gpu;
                }
                let built = match cell.octree.map(|index| &scene.octrees[index]) {
                    Some(row) => {
                        same.extend(octree(&row.image_sha256));
                        // Octrees with contours are cast without them, too.
                        if row.contours && !cell.contours { " of an octree with contours" } else { "" }
                    }
                    None => {
                        same.extend(mesh(&scene.identity, scene.triangles));
                        ""
                    }
                };
                cells.push(MeasuredCell {
                    name: [scene.name.clone(), cell.engine.name().into(), scene.setting(cell) + built],
                    same,
                    seconds: cell.seconds.clone(),
                    guard: unless(gpu, &cell.guard),
                });
            }
        }
        let wrong = |(scene, cell): (&crate::sweep_bench::record::SceneSweep, &crate::sweep_bench::record::Cell)| {
            format!("{}, {}, {}", scene.name, cell.engine, scene.setting(cell))
        };
        MeasuredRun {
            kind: RecordKind::Sweep,
            name: self.plan.name.clone(),
            machine: self.machine.clone(),
            calibration: self.calibration.clone(),
            slowed: Vec::new(),
            wrong: self.failures().map(wrong).collect(),
            cells,
        }
    }
}

impl Measured for RayReport {
    fn measured(&self) -> MeasuredRun {
        let (mut cells, mut wrong) = (Vec::new(), Vec::new());
        for engine in &self.engines {
            let Some(device) = &engine.device else { continue };
            wrong.extend(engine.error.as_ref().map(|error| format!("{}: {error}", engine.name)));
            for (set, cell) in self.sets.iter().zip(&engine.cells) {
                if !cell.agreement.passed() {
                    wrong.push(format!("{}, {}, {}", self.scene, engine.name, set.name));
                }
                let mut same = vec![("levels", self.levels.to_string()), ("voxels", self.voxels.to_string())];
                same.extend(octree(&self.image_sha256));
                let [width, height] = self.size;
                same.extend([("view", self.view.clone()), ("size", format!("{width}x{height}"))]);
                same.extend([("rays", format!("{}, of which {} hit", set.rays, set.hits))]);
                same.extend(device_of(device));
                cells.push(MeasuredCell {
                    name: [self.scene.clone(), engine.name.clone(), set.name.clone()],
                    same,
                    seconds: cell.seconds.iter().map(|&seconds| vec![seconds]).collect(),
                    guard: unless(device.kind == DeviceKind::Gpu, &cell.guard),
                });
            }
        }
        MeasuredRun {
            kind: RecordKind::Rays,
            name: format!("{} {}", self.scene, self.levels),
            machine: self.machine.clone(),
            calibration: self.calibration.clone(),
            slowed: Vec::new(),
            wrong,
            cells,
        }
    }
}

impl Measured for NeedsReport {
    fn measured(&self) -> MeasuredRun {
        let (mut cells, mut wrong) = (Vec::new(), Vec::new());
        for case in &self.cases {
            for cell in &case.cells {
                let Some(engine) = self.engines.get(cell.engine) else { continue };
                let kind = if case.needs.contours { "contours" } else { "cubical" };
                let ends = if case.needs.sizes { "1 px" } else { "leaves" };
                let what = format!("{} levels, {kind}, {ends}, {}", case.levels, cell.variant.name());
                let name = [case.scene.clone(), engine.name.clone(), what];
                if !cell.agreement.passed() {
                    wrong.push(name.join(", "));
                }
                let [width, height] = self.size;
                let mut same = vec![("size", format!("{width}x{height}")), ("rays", case.rays.to_string())];
                same.extend(octree(&case.image_sha256));
                same.push(("bytes", case.image_bytes.to_string()));
                same.extend(device_of(&engine.device));
                cells.push(MeasuredCell {
                    name,
                    same,
                    seconds: cell.seconds.iter().map(|&seconds| vec![seconds]).collect(),
                    guard: unless(engine.device.kind == DeviceKind::Gpu, &cell.guard),
                });
            }
        }
        let mut scenes: Vec<&str> = self.credits.iter().map(|credit| credit[0].as_str()).collect();
        scenes.dedup();
        MeasuredRun {
            kind: RecordKind::Needs,
            name: scenes.join(" "),
            machine: self.machine.clone(),
            calibration: self.calibration.clone(),
            slowed: Vec::new(),
            wrong,
            cells,
        }
    }
}

fn unless(gpu: bool, guard: &GuardSamples) -> GuardSamples {
    if gpu { GuardSamples::default() } else { guard.clone() }
}

fn views(views: &[NamedView]) -> String {
    let name = |view: &NamedView| {
        let camera = &view.camera;
        let clip = [camera.fov_degrees, camera.near, camera.far];
        format!("{} {:?} {:?} {:?} {clip:?}", view.name, camera.eye, camera.forward, camera.up)
    };
    views.iter().map(name).collect::<Vec<_>>().join("; ")
}

fn device_values(device: &DeviceRecord) -> [(&'static str, String); 2] {
    [("device", device.name.clone()), ("instructions, threads or driver", device.detail.clone())]
}

fn device_of(device: &Device) -> [(&'static str, String); 2] {
    [("device", device.name.clone()), ("instructions, threads or driver", device.detail.clone())]
}

fn mesh(identity: &str, triangles: u64) -> [(&'static str, String); 2] {
    [("mesh", identity.into()), ("triangles", triangles.to_string())]
}

fn octree(sha256: &str) -> Option<(&'static str, String)> {
    (!sha256.is_empty()).then(|| ("octree SHA-256", sha256.into()))
}
