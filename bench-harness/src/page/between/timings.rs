//! Every rate that records hold, so that two of the same thing on one machine can be held against each other.

use std::collections::BTreeMap;

use esvo_core::{Device, DeviceKind};
use esvo_engines::EngineId;

use crate::needs_bench::{self, NeedsReport};
use crate::paper_bench::matrix::Variant;
use crate::paper_bench::report::PaperReport;
use crate::ray_bench::RayReport;
use crate::records::{Found, Record};
use crate::sweep_bench::SweepReport;
use crate::timing::Spread;

/// What was cast. Two timings of equal things on one engine should be equal.
#[derive(Clone, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub(in crate::page) struct Thing {
    pub(in crate::page) scene: String,
    /// Of its mesh.
    identity: String,
    /// 0: triangles.
    pub(in crate::page) levels: u32,
    kind: &'static str,
    beam: bool,
    /// Where rays end, in hundredths of a pixel; 0 for leaves and for triangles.
    end: u32,
    pub(in crate::page) size: [u32; 2],
}

impl Thing {
    /// `SIBENIK, 10 levels, contours with the beam, 512x384`.
    pub(in crate::page) fn words(&self) -> String {
        format!("{}, {}", self.scene, self.setting())
    }

    /// `10 levels, contours with the beam, 512x384`; rays that do not end at one pixel are said.
    pub(in crate::page) fn setting(&self) -> String {
        let [width, height] = self.size;
        if self.levels == 0 {
            return format!("triangles, {width}x{height}");
        }
        let beam = if self.beam { " with the beam" } else { "" };
        let end = match self.end {
            100 => String::new(),
            0 => ", rays end at leaves".into(),
            end => format!(", rays end at {} px", f64::from(end) / 100.0),
        };
        format!("{} levels, {}{beam}{end}, {width}x{height}", self.levels, self.kind)
    }
}

/// The views that were cast.
#[derive(Clone, Debug)]
enum Views<'a> {
    /// One time for each.
    Named(Vec<&'a str>),
    /// The first of the scene, so many, with one time for all.
    First(usize),
}

/// A thing that was timed.
#[derive(Clone, Debug)]
pub(in crate::page) struct Timing<'a> {
    pub(in crate::page) thing: Thing,
    pub(in crate::page) engine: EngineId,
    /// Name of the device.
    pub(in crate::page) device: &'a str,
    pub(in crate::page) kind: DeviceKind,
    /// Driver, or instruction set and threads.
    pub(in crate::page) detail: &'a str,
    views: Views<'a>,
    /// `seconds[round][view]`; one number a round for [`Views::First`].
    seconds: Vec<Vec<f64>>,
    /// Whether calibration casts ran on the processor between those that were timed.
    pub(in crate::page) guarded: bool,
}

impl Timing<'_> {
    pub(in crate::page) fn rounds(&self) -> usize {
        self.seconds.len()
    }

    /// The median over the rounds of the time of all views, over the least; `None` below three rounds.
    pub(in crate::page) fn median_over_least(&self) -> Option<f64> {
        let sums: Vec<f64> = self.seconds.iter().map(|round| round.iter().sum()).collect();
        let least = sums.iter().copied().fold(f64::INFINITY, f64::min);
        Some(Spread::of(&sums).filter(|_| sums.len() >= 3 && least > 0.0)?.median / least)
    }

    /// Millions of rays per second of some of the views that have a time of their own: the median over the rounds.
    fn mrays(&self, views: &[usize]) -> Option<f64> {
        let [width, height] = self.thing.size.map(f64::from);
        let frames = if let Views::First(count) = self.views { count } else { views.len() };
        let rate = |round: &Vec<f64>| {
            let sum: Option<f64> = views.iter().map(|view| round.get(*view)).sum();
            Some(width * height * frames as f64 / sum.filter(|sum| *sum > 0.0)? / 1e6)
        };
        Some(Spread::of(&self.seconds.iter().filter_map(rate).collect::<Vec<_>>())?.median)
    }

    /// Millions of rays per second of both, over the views that both cast; `None`: there are none.
    pub(in crate::page) fn both(&self, other: &Self) -> Option<[f64; 2]> {
        let [own, others] = match (&self.views, &other.views) {
            (Views::Named(a), Views::Named(b)) => {
                let pairs = a.iter().enumerate().filter_map(|(i, name)| Some((i, b.iter().position(|n| n == name)?)));
                let (a, b): (Vec<_>, Vec<_>) = pairs.unzip();
                [a, b]
            }
            (Views::Named(names), Views::First(count)) if names.len() >= *count => [(0..*count).collect(), vec![0]],
            (Views::First(count), Views::Named(names)) if names.len() >= *count => [vec![0], (0..*count).collect()],
            (Views::First(a), Views::First(b)) if a == b => [vec![0], vec![0]],
            _ => return None,
        };
        (!own.is_empty()).then_some([self.mrays(&own)?, other.mrays(&others)?])
    }
}

/// All timings of a record.
pub(in crate::page) fn timings(record: &Record) -> Vec<Timing<'_>> {
    let mut all = match record {
        Record::Paper(report) => of_paper(report),
        Record::Sweep(report) => of_sweep(report),
        Record::Needs(report) => of_needs(report),
        Record::Rays(report) => of_rays(report),
        Record::Build(_) | Record::Stability(_) | Record::Voxelize(_) | Record::Shadow(_) => Vec::new(),
    };
    all.retain(|timing| timing.engine != EngineId::Reference && !timing.seconds.is_empty());
    all
}

fn thing(scene: &str, identity: &str, levels: u32, contours: bool, beam: bool, pixels: f32, size: [u32; 2]) -> Thing {
    let kind = if contours { "contours" } else { "cubes" };
    let kind = if levels == 0 { "triangles" } else { kind };
    let end = if levels == 0 { 0 } else { (100.0 * pixels).round() as u32 };
    Thing { scene: scene.into(), identity: identity.into(), levels, kind, beam, end, size }
}

fn of_paper(report: &PaperReport) -> Vec<Timing<'_>> {
    let mut all = Vec::new();
    for scene in &report.scenes {
        for cell in &scene.times {
            let Some(device) = report.devices.iter().find(|d| d.backend == cell.backend) else { continue };
            let (contours, beam) = (cell.variant != Variant::Cubical, cell.variant == Variant::Beam);
            let levels = if cell.variant == Variant::Triangles { 0 } else { cell.levels };
            all.push(Timing {
                thing: thing(&scene.name, &scene.identity, levels, contours && levels > 0, beam, 1.0, cell.size),
                engine: cell.backend,
                device: &device.name,
                kind: device.kind,
                detail: &device.detail,
                views: Views::Named(scene.views.iter().map(|view| view.name.as_str()).collect()),
                seconds: cell.samples.seconds.clone(),
                guarded: !cell.samples.guard.is_empty(),
            });
        }
    }
    all
}

fn of_sweep(report: &SweepReport) -> Vec<Timing<'_>> {
    let mut all = Vec::new();
    for (scene, cell) in report.scenes.iter().flat_map(|scene| scene.cells.iter().map(move |cell| (scene, cell))) {
        let Some(device) = report.devices.iter().find(|d| d.backend == cell.engine) else { continue };
        let levels = scene.levels(cell).unwrap_or(0);
        let (pixels, size) = (cell.max_voxel_pixels, report.plan.size);
        all.push(Timing {
            thing: thing(&scene.name, &scene.identity, levels, cell.contours, cell.beam, pixels, size),
            engine: cell.engine,
            device: &device.name,
            kind: device.kind,
            detail: &device.detail,
            views: Views::Named(scene.views.iter().map(|view| view.name.as_str()).collect()),
            seconds: cell.seconds.clone(),
            guarded: !cell.guard.is_empty(),
        });
    }
    all
}

/// The engine of a row that is named by an instruction set or by its engine; `None` for code that no other record times.
fn engine_of(name: &str, device: &Device) -> Option<EngineId> {
    match name {
        "scalar" | "reference" => None,
        _ if device.kind == DeviceKind::Cpu => Some(EngineId::Cpu),
        name => name.parse().ok(),
    }
}

fn of_needs(report: &NeedsReport) -> Vec<Timing<'_>> {
    let mut all = Vec::new();
    for case in &report.cases {
        let identity = report.credits.iter().find(|row| row[0] == case.scene).map_or("", |row| &row[2]);
        let pixels = u64::from(report.size[0]) * u64::from(report.size[1]);
        let end = if case.needs.sizes { 1.0 } else { 0.0 };
        for cell in case.cells.iter().filter(|cell| cell.variant == needs_bench::Variant::Everything) {
            let Some(row) = report.engines.get(cell.engine) else { continue };
            let Some(engine) = engine_of(&row.name, &row.device) else { continue };
            all.push(Timing {
                thing: thing(&case.scene, identity, case.levels, case.needs.contours, false, end, report.size),
                engine,
                device: &row.device.name,
                kind: row.device.kind,
                detail: &row.device.detail,
                views: Views::First((case.rays / pixels.max(1)) as usize),
                seconds: cell.seconds.iter().map(|seconds| vec![*seconds]).collect(),
                guarded: !cell.guard.is_empty(),
            });
        }
    }
    all
}

/// The picture, which is the first set. On GPUs its time includes the copy of the hits, which no other record times.
fn of_rays(report: &RayReport) -> Vec<Timing<'_>> {
    let mut all = Vec::new();
    for row in &report.engines {
        let (Some(device), Some(cell)) = (&row.device, row.cells.first()) else { continue };
        let Some(engine) = engine_of(&row.name, device).filter(|_| device.kind == DeviceKind::Cpu) else { continue };
        all.push(Timing {
            thing: thing(&report.scene, &report.identity, report.levels, true, false, 1.0, report.size),
            engine,
            device: &device.name,
            kind: device.kind,
            detail: &device.detail,
            views: Views::Named(vec![&report.view]),
            seconds: cell.seconds.iter().map(|seconds| vec![*seconds]).collect(),
            guarded: !cell.guard.is_empty(),
        });
    }
    all
}

/// A timing with the index of its record.
type InRecord<'a> = (usize, Timing<'a>);

/// The same thing on the same engine in two records.
pub(in crate::page) struct Twice<'a> {
    /// The records by their index in the list that was given, with what each timed.
    pub(in crate::page) of: [InRecord<'a>; 2],
    /// Millions of rays per second of each, over the views of both.
    pub(in crate::page) mrays: [f64; 2],
}

impl Twice<'_> {
    /// How many times the slower the faster is.
    pub(in crate::page) fn ratio(&self) -> f64 {
        (self.mrays[0] / self.mrays[1]).max(self.mrays[1] / self.mrays[0])
    }

    pub(in crate::page) fn thing(&self) -> &Thing {
        &self.of[0].1.thing
    }
}

/// Whatever two records of a machine timed, in the order of the records.
pub(in crate::page) fn twice<'a>(found: &[&'a Found]) -> Vec<Twice<'a>> {
    let mut by_thing: BTreeMap<(Thing, String, &str), Vec<InRecord<'a>>> = BTreeMap::new();
    for (index, one) in found.iter().enumerate() {
        for timing in timings(&one.record) {
            let key = (timing.thing.clone(), timing.engine.name().to_owned(), timing.device);
            by_thing.entry(key).or_default().push((index, timing));
        }
    }
    let mut all = Vec::new();
    for same in by_thing.values() {
        for (at, first) in same.iter().enumerate() {
            for second in same[at + 1..].iter().filter(|second| second.0 != first.0) {
                if let Some(mrays) = first.1.both(&second.1) {
                    all.push(Twice { of: [first.clone(), second.clone()], mrays });
                }
            }
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sweep_bench::sample::{cell, report};

    fn timing<'a>(views: Views<'a>, seconds: &[&[f64]]) -> Timing<'a> {
        Timing {
            thing: thing("SIBENIK", "", 10, true, false, 1.0, [1000, 1000]),
            engine: EngineId::Cpu,
            device: "",
            kind: DeviceKind::Cpu,
            detail: "",
            views,
            seconds: seconds.iter().map(|round| round.to_vec()).collect(),
            guarded: false,
        }
    }

    #[test]
    fn rates_are_those_of_the_views_that_both_cast() {
        let three = timing(Views::Named(vec!["a", "b", "c"]), &[&[1.0, 2.0, 4.0], &[1.0, 2.0, 4.0]]);
        let two = timing(Views::Named(vec!["c", "a"]), &[&[2.0, 0.5]]);
        // Three are two frames in 5 s, two are two in 2.5 s.
        assert_eq!(three.both(&two), Some([0.4, 0.8]));
        assert_eq!(two.both(&three), Some([0.8, 0.4]));
        let first = timing(Views::First(2), &[&[6.0], &[4.0], &[5.0]]);
        assert_eq!(first.both(&three), Some([0.4, 2.0 / 3.0]));
        assert_eq!(three.both(&first), Some([2.0 / 3.0, 0.4]));
        // No view of both, or not known which.
        assert_eq!(three.both(&timing(Views::Named(vec!["d"]), &[&[1.0]])), None);
        assert_eq!(first.both(&two).map(|rates| rates[0]), Some(0.4));
        assert_eq!(timing(Views::First(3), &[&[1.0]]).both(&first), None);
        assert_eq!(timing(Views::First(3), &[&[1.0]]).both(&two), None);
    }

    #[test]
    fn the_same_thing_is_met_in_two_records_of_one_engine() {
        let record = |ms: f64, p: f32| {
            let mut report = report(vec![cell(1, true, p, [1.0, 0.1], vec![vec![ms / 1e3]])]);
            let camera = esvo_core::Camera {
                eye: [0.0; 3],
                forward: [0.0, 0.0, -1.0],
                up: [0.0, 1.0, 0.0],
                fov_degrees: 60.0,
                near: 0.1,
                far: 9.0,
            };
            report.scenes[0].views = vec![crate::scene::NamedView { name: "first".into(), camera }];
            Found { path: "a".into(), name: "a".into(), record: Record::Sweep(Box::new(report)) }
        };
        let [a, b, other] = [record(1.0, 1.0), record(4.0, 1.0), record(4.0, 2.0)];
        let met = twice(&[&a, &b, &other]);
        assert_eq!(met.len(), 1);
        assert!((met[0].ratio() - 4.0).abs() < 1e-9);
        assert_eq!((met[0].of[0].0, met[0].of[1].0), (0, 1));
        assert_eq!(met[0].thing().words(), "SIBENIK, 5 levels, contours with the beam, 512x384");
    }
}
