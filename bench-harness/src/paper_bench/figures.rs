//! The figures of Table 1 and Table 2 with the paper's beside them: what CSV, LaTeX and HTML show.

use std::collections::BTreeMap;

use esvo_core::DeviceKind;
use esvo_scenes::SceneVariant;

use crate::build_bench::{BuildReport, Contours};
use crate::growth::predict;
use crate::paper_bench::levels::GROWTH;
use crate::paper_bench::matrix::Variant;
use crate::paper_bench::paper::Paper;
use crate::paper_bench::report::{DeviceRecord, ErrorRow, FilterCell, PaperReport, SceneReport};
use crate::scene::compared_as;
use crate::timing::Spread;
use crate::units::MIB;

/// Memory of the paper's GPU in MiB: 4 GB.
pub(crate) const PAPER_MIB: f64 = 4096.0;
/// The deepest level of the paper's Table 1.
const PAPER_LEVELS: u32 = 16;

/// The deepest octree that fits the memory of the paper's GPU.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(crate) struct Fit {
    pub(crate) levels: u32,
    pub(crate) mib: f64,
    /// Whether it was not built: its size follows from the growth of the last two levels.
    pub(crate) predicted: bool,
}

/// A row of Table 1: the octrees of one scene and one kind.
#[derive(Clone, Debug)]
pub(crate) struct SizeRow {
    pub(crate) scene: String,
    pub(crate) mesh: SceneVariant,
    pub(crate) triangles: u64,
    /// Whether octrees are of the mesh after displacement.
    pub(crate) displaced: bool,
    pub(crate) contours: bool,
    /// By level.
    pub(crate) cells: BTreeMap<u32, SizeCell>,
    /// The paper's figures by level, of octrees with contours; also for levels that were not built.
    pub(crate) paper: BTreeMap<u32, [f64; 2]>,
    /// The paper's bytes per voxel of its largest octree, and the levels of that.
    pub(crate) paper_bytes: Option<(f64, u32)>,
}

/// One octree.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SizeCell {
    pub(crate) mib: f64,
    pub(crate) seconds: f64,
    pub(crate) voxels: u64,
    pub(crate) bytes: u64,
}

impl SizeCell {
    pub(crate) fn bytes_per_voxel(&self) -> f64 {
        self.bytes as f64 / self.voxels.max(1) as f64
    }
}

impl SizeRow {
    fn new(paper: &Paper, scene: &str, mesh: SceneVariant, triangles: u64, contours: bool) -> Self {
        let known = compared_as(scene, mesh);
        let levels = (1..=23).filter(|_| contours);
        Self {
            scene: scene.to_owned(),
            mesh,
            triangles,
            displaced: false,
            contours,
            cells: BTreeMap::new(),
            paper: levels.filter_map(|l| paper.build(known, l).map(|(mb, s)| (l, [mb, s]))).collect(),
            paper_bytes: paper.bytes_per_voxel(known).filter(|_| contours),
        }
    }

    /// `contours` or `cubical`.
    pub(crate) fn kind(&self) -> &'static str {
        if self.contours { "contours" } else { "cubical" }
    }

    /// The deepest octree that fits the memory of the paper's GPU; `None` if the smallest that was built does not, or if the level above is
    /// missing and cannot be predicted.
    pub(crate) fn fit(&self) -> Option<Fit> {
        let (&last, _) = self.cells.last_key_value()?;
        let fits = |mib: f64| mib <= PAPER_MIB;
        let (&levels, cell) = self.cells.iter().rfind(|(_, cell)| fits(cell.mib))?;
        let measured = Fit { levels, mib: cell.mib, predicted: false };
        if levels < last {
            return Some(measured);
        }
        // Deeper levels, by the growth of the last two.
        let mut sizes: Vec<f64> = self.cells.values().map(|cell| cell.mib).collect();
        let mut best = measured;
        while best.levels < PAPER_LEVELS {
            let Some(mib) = predict(&sizes, GROWTH).filter(|mib| fits(*mib)) else { break };
            sizes.push(mib);
            best = Fit { levels: best.levels + 1, mib, predicted: true };
        }
        Some(best)
    }

    /// The paper's largest octree that fits: the deepest of its Table 1.
    pub(crate) fn paper_fit(&self) -> Option<(u32, f64)> {
        self.paper.last_key_value().map(|(levels, [mb, _])| (*levels, *mb))
    }

    /// The largest octree and its levels.
    pub(crate) fn largest(&self) -> Option<(u32, SizeCell)> {
        self.cells.last_key_value().map(|(levels, cell)| (*levels, *cell))
    }
}

/// The rows of Table 1 of a record of `esvo bench`.
pub(crate) fn sizes(report: &PaperReport, paper: &Paper) -> Vec<SizeRow> {
    let mut rows = Vec::new();
    for scene in &report.scenes {
        for contours in [true, false] {
            let mut row = SizeRow::new(paper, &scene.name, scene.mesh, scene.triangles, contours);
            for b in scene.builds.iter().filter(|b| b.contours == contours) {
                let cell = SizeCell { mib: b.mib(), seconds: b.seconds, voxels: b.voxels, bytes: b.bytes };
                row.cells.insert(b.levels, cell);
                row.displaced |= b.displaced_triangles.is_some();
            }
            rows.extend(Some(row).filter(|row| !row.cells.is_empty()));
        }
    }
    rows
}

/// The rows of Table 1 of a record of `esvo bench build`. Seconds are medians over the builds.
pub(crate) fn built_sizes(report: &BuildReport, paper: &Paper) -> Vec<SizeRow> {
    let mut rows = Vec::new();
    for scene in &report.scenes {
        for kind in [Contours::On, Contours::Off] {
            let contours = kind == Contours::On;
            let mut row = SizeRow::new(paper, &scene.name, scene.mesh, scene.triangles, contours);
            for b in scene.rows.iter().filter(|b| b.contours == kind) {
                let all: Vec<f64> = b.samples.iter().map(|sample| sample.seconds.build).collect();
                let seconds = Spread::of(&all).map_or(b.build.seconds.build, |spread| spread.median);
                let (voxels, bytes) = (b.build.voxels, b.build.image_bytes);
                row.cells.insert(b.levels, SizeCell { mib: bytes as f64 / MIB, seconds, voxels, bytes });
            }
            rows.extend(Some(row).filter(|row| !row.cells.is_empty()));
        }
    }
    rows
}

/// The levels of some rows of Table 1, ascending: those that were built, and those of the paper's octrees.
pub(crate) fn levels(rows: &[SizeRow]) -> Vec<u32> {
    let mut levels: Vec<u32> = rows.iter().flat_map(|row| row.cells.keys().chain(row.paper.keys())).copied().collect();
    levels.sort_unstable();
    levels.dedup();
    levels
}

/// A row of Table 2: one scene at one picture size on one device.
#[derive(Clone, Debug)]
pub(crate) struct RateRow {
    pub(crate) scene: String,
    pub(crate) mesh: SceneVariant,
    pub(crate) size: [u32; 2],
    /// Levels of the octrees; `None`: there are none.
    pub(crate) levels: Option<u32>,
    /// One for each of the device's [`variants`].
    pub(crate) cells: Vec<RateCell>,
    /// Milliseconds of the post-process filter for a picture.
    pub(crate) filter: Option<Spread>,
}

/// A cell of Table 2.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RateCell {
    pub(crate) variant: Variant,
    pub(crate) rate: Rate,
    /// The paper's millions of rays per second; `None` also on devices that it is not compared with.
    pub(crate) paper: Option<f64>,
    /// Depth error in pixels, median and 99th percentile, mean over the views; 0 for triangles.
    pub(crate) error: Option<[f64; 2]>,
    /// Mean level of the voxels that are hit.
    pub(crate) hit_level: Option<f64>,
}

/// Millions of rays per second.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Rate {
    Measured(Spread),
    /// The hits are wrong, so that it was not timed.
    Wrong,
    Absent,
}

impl RateCell {
    /// The measured median.
    pub(crate) fn median(&self) -> Option<f64> {
        if let Rate::Measured(spread) = self.rate { Some(spread.median) } else { None }
    }

    /// The measured median over the paper's figure.
    pub(crate) fn ratio(&self) -> Option<f64> {
        Some(self.median()? / self.paper?)
    }
}

/// The columns of Table 2 for a device: what it cast or should have cast.
pub(crate) fn variants(report: &PaperReport, device: &DeviceRecord) -> Vec<Variant> {
    let has = |v: Variant| {
        let timed = |s: &SceneReport| s.times.iter().any(|t| t.backend == device.backend && t.variant == v);
        report.scenes.iter().any(|s| timed(s) || s.check(device.backend, v).is_some())
    };
    Variant::ALL.into_iter().filter(|&v| has(v)).collect()
}

/// The rows of Table 2 for a device.
pub(crate) fn rates(report: &PaperReport, paper: &Paper, device: &DeviceRecord) -> Vec<RateRow> {
    let variants = variants(report, device);
    // The times of a software driver are not those of a GPU: the paper's are not shown next to them.
    let compared = device.kind != DeviceKind::SoftwareGpu;
    let mut rows = Vec::new();
    for scene in &report.scenes {
        let levels = scene.times.iter().map(|t| t.levels).max().filter(|levels| *levels > 0);
        let known = compared_as(&scene.name, scene.mesh);
        for &size in &report.matrix.resolutions {
            let cell = |variant: Variant| {
                let wrong = scene.check(device.backend, variant).is_some_and(|c| !c.agreement.passed());
                let spread = scene.time(device.backend, variant, size).and_then(|t| t.mrays);
                RateCell {
                    variant,
                    rate: match spread {
                        _ if wrong => Rate::Wrong,
                        Some(spread) => Rate::Measured(spread),
                        None => Rate::Absent,
                    },
                    paper: paper.mrays(known, size, variant).filter(|_| compared),
                    error: error(scene, variant, levels),
                    hit_level: row_of(scene, variant, levels).and_then(ErrorRow::mean_hit_level),
                }
            };
            let cells: Vec<_> = variants.iter().map(|&v| cell(v)).collect();
            if cells.iter().any(|cell| !matches!(cell.rate, Rate::Absent)) {
                let filter = scene.filter(device.backend, size).and_then(FilterCell::milliseconds);
                rows.push(RateRow { scene: scene.name.clone(), mesh: scene.mesh, size, levels, cells, filter });
            }
        }
    }
    rows
}

/// Whose viewpoints the scenes were cast from: the authors' own are listed as `paper-1` and so on.
pub(crate) fn viewpoints(report: &PaperReport) -> String {
    let of = |scene: &SceneReport| {
        let authors = scene.views.iter().filter(|view| view.name.starts_with("paper-")).count();
        let count = scene.views.len();
        let stand_in = if scene.mesh == SceneVariant::StandIn { ", on our stand-in" } else { "" };
        match authors {
            0 => format!("{} {count} of our own", scene.name),
            _ if authors == count => format!("{} {count} of the paper's authors{stand_in}", scene.name),
            _ => format!("{} {count}, of which {authors} are the paper's authors'{stand_in}", scene.name),
        }
    };
    format!("Viewpoints: {}.", report.scenes.iter().map(of).collect::<Vec<_>>().join("; "))
}

fn row_of(scene: &SceneReport, variant: Variant, levels: Option<u32>) -> Option<&ErrorRow> {
    scene.errors.iter().find(|e| e.variant == variant && Some(e.levels) == levels)
}

fn error(scene: &SceneReport, variant: Variant, levels: Option<u32>) -> Option<[f64; 2]> {
    if variant == Variant::Triangles {
        return Some([0.0; 2]);
    }
    let row = row_of(scene, variant, levels)?;
    Some([row.mean(|v| v.pixels.median), row.mean(|v| v.pixels.p99)])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fit(sizes: &[(u32, f64)]) -> Option<(u32, bool)> {
        let cell = |mib| SizeCell { mib, seconds: 1.0, voxels: 1, bytes: 1 };
        let mut row = SizeRow::new(&Paper::figures(), "SIBENIK", SceneVariant::Real, 1, true);
        row.cells = sizes.iter().map(|(levels, mib)| (*levels, cell(*mib))).collect();
        row.fit().map(|fit| (fit.levels, fit.predicted))
    }

    #[test]
    fn the_deepest_octree_that_fits_is_measured_or_predicted() {
        assert_eq!(fit(&[]), None);
        assert_eq!(fit(&[(10, 5000.0)]), None);
        assert_eq!(fit(&[(10, 1000.0), (11, 5000.0)]), Some((10, false)));
        // Growth 2: 800, 1600, 3200, and no more.
        assert_eq!(fit(&[(10, 200.0), (11, 400.0)]), Some((14, true)));
        assert_eq!(fit(&[(10, 1.0), (11, 2.0)]), Some((16, true)), "as deep as the paper's, and no deeper");
        assert_eq!(fit(&[(10, 400.0), (11, 2000.0)]), Some((11, false)), "the next one would have 10,000");
    }
}
