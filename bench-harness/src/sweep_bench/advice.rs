//! `esvo advise`: the settings of a sweep that keep a wish, and why.
//!
//! The rule: of the settings of one engine that keep every limit, the fastest; of those within [`TIE`] of its time, the one with the
//! fewest bytes. If none keeps every limit, the nearest is named: the one whose worst excess, as a factor, is least.

use esvo_engines::EngineId;
use serde::Serialize;

use super::answers::{timed, triangles};
use super::errors::ErrorMeasure;
use super::record::{Cell, ExactKind, SceneSweep, SweepReport};
use crate::text::short;

/// Times that differ by less than this factor count as equal.
pub const TIE: f64 = 1.03;
/// Share of rays that hit only one of octree and triangles above which the octree is taken for one of another mesh.
const OTHER_MESH: f64 = 0.2;

/// What is wished for.
#[derive(Clone, Copy, PartialEq, Debug, Serialize)]
pub struct Wish {
    /// The measure of the error.
    pub measure: ErrorMeasure,
    /// Largest error, above 0.
    pub max_error: f64,
    /// Most milliseconds per frame, above 0.
    pub max_ms: Option<f64>,
    /// Most bytes in memory, above 0.
    pub max_bytes: Option<u64>,
}

/// A setting with what it costs.
#[derive(Clone, PartialEq, Debug, Serialize)]
pub struct AdvisedSetting {
    /// Levels of the octree.
    pub levels: u32,
    /// Whether voxels are clipped by contours.
    pub contours: bool,
    /// Whether the beam optimization is on.
    pub beam: bool,
    /// Rays end at voxels of this many pixels.
    pub max_voxel_pixels: f32,
    /// Its error by the measure of the wish.
    pub error: f64,
    /// Least milliseconds per frame.
    pub ms: f64,
    /// Bytes in memory.
    pub memory_bytes: u64,
    /// Bytes of the uncompressed file.
    pub disk_bytes: u64,
}

/// The advice.
#[derive(Clone, PartialEq, Debug, Serialize)]
pub struct Advice {
    /// Scene or file.
    pub scene: String,
    /// The engine.
    pub engine: EngineId,
    /// Size of the pictures that the errors in pixels are for.
    pub size: [u32; 2],
    /// What the errors are measured against.
    pub exact: ExactKind,
    /// The wish.
    pub wish: Wish,
    /// Whether the setting keeps the wish. If not, it is the nearest.
    pub reached: bool,
    /// The setting.
    pub setting: AdvisedSetting,
    /// Why, line by line.
    pub why: Vec<String>,
}

/// Advice from a scene of a record; of its octrees, that of index `octree`, or any. `None` if no setting of the engine was timed.
pub fn advise(
    report: &SweepReport,
    scene: &SceneSweep,
    octree: Option<usize>,
    engine: EngineId,
    wish: &Wish,
) -> Option<Advice> {
    let candidates: Vec<(&Cell, f64)> =
        timed(scene, engine).filter(|(cell, _)| octree.is_none_or(|octree| cell.octree == Some(octree))).collect();
    let adviser = Adviser { scene, wish, candidates };
    let (chosen, ms, reached) = match adviser.best(|_| true) {
        Some((cell, ms)) => (cell, ms, true),
        None => {
            let (cell, ms) = adviser.nearest()?;
            (cell, ms, false)
        }
    };
    let mut why = if reached { adviser.reasons(chosen, ms) } else { adviser.excuses(chosen, ms) };
    if scene.exact == ExactKind::Leaves {
        why.push(
            "Errors are against the octree's own leaves, as its triangles are not known: what the octree itself lacks is not in them."
                .into(),
        );
    } else if chosen.error.disagreement > OTHER_MESH {
        let share = 100.0 * chosen.error.disagreement;
        why.push(format!(
            "Careful: {share:.0} % of the rays hit only one of octree and triangles; is the octree one of this mesh, and placed as it is?"
        ));
    }
    Some(Advice {
        scene: scene.name.clone(),
        engine,
        size: report.plan.size,
        exact: scene.exact,
        wish: *wish,
        reached,
        setting: AdvisedSetting {
            levels: scene.levels(chosen).unwrap_or(0),
            contours: chosen.contours,
            beam: chosen.beam,
            max_voxel_pixels: chosen.max_voxel_pixels,
            error: wish.measure.of(&chosen.error),
            ms,
            memory_bytes: chosen.memory_bytes,
            disk_bytes: chosen.disk_bytes,
        },
        why,
    })
}

struct Adviser<'a> {
    scene: &'a SceneSweep,
    wish: &'a Wish,
    candidates: Vec<(&'a Cell, f64)>,
}

impl<'a> Adviser<'a> {
    fn error(&self, cell: &Cell) -> f64 {
        self.wish.measure.of(&cell.error)
    }

    /// How far a setting exceeds each limit, as factors: error, time, bytes; at most 1: kept.
    fn excesses(&self, cell: &Cell, ms: f64) -> [f64; 3] {
        let time = self.wish.max_ms.map_or(0.0, |most| ms / most);
        let bytes = self.wish.max_bytes.map_or(0.0, |most| cell.memory_bytes as f64 / most as f64);
        [self.error(cell) / self.wish.max_error, time, bytes]
    }

    fn excess(&self, cell: &Cell, ms: f64) -> f64 {
        self.excesses(cell, ms).into_iter().fold(0.0, f64::max)
    }

    /// The settings that keep the wish.
    fn kept(&self) -> impl Iterator<Item = (&'a Cell, f64)> {
        self.candidates.iter().copied().filter(|(cell, ms)| self.excess(cell, *ms) <= 1.0)
    }

    /// By the rule, the best of some settings that keep the wish.
    fn best(&self, which: impl Fn(&Cell) -> bool) -> Option<(&'a Cell, f64)> {
        let fastest = self.kept().filter(|(cell, _)| which(cell)).map(|(_, ms)| ms).fold(f64::INFINITY, f64::min);
        let equal = self.kept().filter(|(cell, ms)| which(cell) && *ms <= fastest * TIE);
        equal.min_by(|a, b| a.0.memory_bytes.cmp(&b.0.memory_bytes).then(a.1.total_cmp(&b.1)))
    }

    fn nearest(&self) -> Option<(&'a Cell, f64)> {
        let excess = |(cell, ms): &(&Cell, f64)| self.excess(cell, *ms);
        self.candidates.iter().copied().min_by(|a, b| excess(a).total_cmp(&excess(b)).then(a.1.total_cmp(&b.1)))
    }

    fn show(&self, cell: &Cell, ms: f64) -> String {
        let error = self.wish.measure.show(self.error(cell));
        format!("{}: {error}, {} ms, {} MB", self.scene.setting(cell), short(ms), short(cell.memory_bytes as f64 / 1e6))
    }

    /// Why a setting that keeps the wish was chosen.
    fn reasons(&self, chosen: &Cell, ms: f64) -> Vec<String> {
        let kept = self.kept().count();
        let fastest = self.kept().map(|(_, ms)| ms).fold(f64::INFINITY, f64::min);
        let tie = if ms > fastest {
            format!(" but for one that is {:.0} % faster and takes more bytes", 100.0 * (ms / fastest - 1.0))
        } else {
            String::new()
        };
        let mut why = vec![format!(
            "{kept} of {} settings keep the wish, and it is the fastest of them{tie}.",
            self.candidates.len()
        )];
        let mut alternative = |name: &str, found: Option<(&Cell, f64)>| {
            why.push(match found {
                Some((cell, other)) => {
                    format!("The best {name} takes {:.2} times the time: {}.", other / ms, self.show(cell, other))
                }
                None => format!("None {name} keeps it."),
            });
        };
        let on = if chosen.beam { "without the beam" } else { "with the beam" };
        alternative(on, self.best(|cell| cell.beam != chosen.beam));
        if self.candidates.iter().any(|(cell, _)| cell.contours != chosen.contours) {
            let kind = if chosen.contours { "with cubes" } else { "with contours" };
            alternative(kind, self.best(|cell| cell.contours != chosen.contours));
        }
        why.extend(self.neighbours(chosen));
        if let Some((cell, other)) = triangles(self.scene).filter(|(cell, _)| cell.engine == chosen.engine) {
            let than = if other < ms { "faster, and exact" } else { "exact, and slower" };
            why.push(format!("The triangles themselves are {than}: {}.", self.show(cell, other)));
        }
        why
    }

    /// What one level less and the next coarser termination would do.
    fn neighbours(&self, chosen: &Cell) -> Vec<String> {
        let same = |cell: &Cell| cell.beam == chosen.beam && cell.contours == chosen.contours;
        let levels = |cell: &Cell| self.scene.levels(cell);
        let fewer = (self.candidates.iter())
            .filter(|(cell, _)| {
                same(cell) && cell.max_voxel_pixels == chosen.max_voxel_pixels && levels(cell) < levels(chosen)
            })
            .max_by_key(|(cell, _)| levels(cell));
        let coarser = (self.candidates.iter())
            .filter(|(cell, _)| {
                same(cell) && cell.octree == chosen.octree && cell.max_voxel_pixels > chosen.max_voxel_pixels
            })
            .min_by(|a, b| a.0.max_voxel_pixels.total_cmp(&b.0.max_voxel_pixels));
        let line = |name: &str, found: Option<&(&Cell, f64)>| {
            found.map(|(cell, ms)| format!("{name} would be {}{}.", self.show(cell, *ms), self.broken(cell, *ms)))
        };
        line("Fewer levels", fewer).into_iter().chain(line("A coarser termination", coarser)).collect()
    }

    /// Which limits a setting breaks.
    fn broken(&self, cell: &Cell, ms: f64) -> String {
        let names = ["too much error", "too slow", "too many bytes"];
        let broken: Vec<_> = self
            .excesses(cell, ms)
            .into_iter()
            .zip(names)
            .filter(|(excess, _)| *excess > 1.0)
            .map(|(_, name)| name)
            .collect();
        if broken.is_empty() { String::new() } else { format!(" ({})", broken.join(", ")) }
    }

    /// Why nothing keeps the wish, and what is near.
    fn excuses(&self, nearest: &Cell, ms: f64) -> Vec<String> {
        let mut why = vec![format!(
            "None of {} settings keeps the wish; this one exceeds it by the smallest factor, {:.2}{}.",
            self.candidates.len(),
            self.excess(nearest, ms),
            self.broken(nearest, ms)
        )];
        // With one limit lifted, what the others leave.
        let names = ["error", "time", "bytes"];
        let given = [true, self.wish.max_ms.is_some(), self.wish.max_bytes.is_some()];
        for lifted in (0..3).filter(|&k| given[k]) {
            let rest = |cell: &Cell, ms: f64| {
                self.excesses(cell, ms).into_iter().enumerate().all(|(k, excess)| k == lifted || excess <= 1.0)
            };
            let kept = self.candidates.iter().filter(|(cell, ms)| rest(cell, *ms));
            let least = kept.min_by(|a, b| {
                let of = |c: &&(&Cell, f64)| self.excesses(c.0, c.1)[lifted];
                of(a).total_cmp(&of(b)).then(a.1.total_cmp(&b.1))
            });
            why.push(match least {
                Some((cell, ms)) => {
                    format!("Without a limit on {}, the least: {}.", names[lifted], self.show(cell, *ms))
                }
                None => format!("Without a limit on {}, nothing keeps the others either.", names[lifted]),
            });
        }
        if let Some((cell, other)) = triangles(self.scene).filter(|(cell, _)| cell.engine == nearest.engine) {
            why.push(format!("The triangles themselves: {}.", self.show(cell, other)));
        }
        why
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::sample::{cell, report, triangles};
    use super::*;

    const WISH: Wish = Wish { measure: ErrorMeasure::P90, max_error: 1.0, max_ms: None, max_bytes: None };

    fn advice(cells: Vec<Cell>, wish: &Wish) -> Advice {
        let report = report(cells);
        advise(&report, &report.scenes[0], None, EngineId::Cpu, wish).unwrap()
    }

    fn ms(milliseconds: f64) -> Vec<Vec<f64>> {
        vec![vec![milliseconds / 1e3]]
    }

    #[test]
    fn the_fastest_that_keeps_the_wish() {
        let cells = || {
            vec![
                cell(1, false, 1.0, [2.0, 0.1], ms(1.0)),
                cell(3, false, 1.0, [0.9, 0.1], ms(4.0)),
                cell(3, true, 1.0, [0.9, 0.1], ms(3.0)),
                cell(3, true, 2.0, [1.2, 0.1], ms(2.0)),
                cell(4, true, 1.0, [0.8, 0.1], ms(5.0)),
                triangles(2.5),
            ]
        };
        let found = advice(cells(), &WISH);
        let setting = &found.setting;
        assert!(
            found.reached && setting.beam && setting.contours && setting.levels == 6 && setting.ms == 3.0,
            "{found:?}"
        );
        let why = found.why.join("\n");
        for part in [
            "3 of 5 settings keep the wish",
            "The best without the beam takes 1.33 times",
            "The best with cubes takes 1.67 times",
            "A coarser termination would be 6 levels, contours, beam, 2 px: 1.20 px, 2.00 ms, 4.00 MB (too much error)",
            "triangles themselves are faster, and exact",
        ] {
            assert!(why.contains(part), "{part}: {why}");
        }
        // Times that are as good as equal: fewer bytes win.
        let mut equal = cells();
        equal.push(cell(1, true, 1.0, [1.0, 0.1], ms(3.08)));
        assert_eq!(advice(equal.clone(), &WISH).setting.levels, 5);
        equal.last_mut().unwrap().seconds = ms(3.1);
        assert_eq!(advice(equal, &WISH).setting.levels, 6);
        // Another measure.
        assert_eq!(advice(cells(), &Wish { measure: ErrorMeasure::Flip, max_error: 0.1, ..WISH }).setting.ms, 1.0);
    }

    #[test]
    fn what_cannot_be_reached_has_a_nearest() {
        let cells = || {
            vec![
                cell(1, false, 1.0, [2.0, 0.1], ms(1.0)),
                cell(3, false, 1.0, [0.9, 0.1], ms(4.0)),
                cell(5, false, 1.0, [0.6, 0.1], ms(9.0)),
            ]
        };
        let found = advice(cells(), &Wish { max_ms: Some(2.0), ..WISH });
        assert!(!found.reached && found.setting.levels == 5, "2 times the error, not 2 times the time: {found:?}");
        assert!(found.why[0].contains("smallest factor, 2.00 (too much error)"), "{:?}", found.why);
        assert!(found.why[1].contains("Without a limit on error, the least: 5 levels"), "{:?}", found.why);
        assert!(found.why[2].contains("Without a limit on time, the least: 6 levels"), "{:?}", found.why);
        let found = advice(cells(), &Wish { max_error: 0.1, max_bytes: Some(10), ..WISH });
        assert!(found.why[1].contains("on error, nothing keeps the others either"), "{:?}", found.why);
        let report = report(vec![triangles(1.0)]);
        assert_eq!(advise(&report, &report.scenes[0], None, EngineId::Cpu, &WISH), None);
    }

    #[test]
    fn of_a_file_its_own_octree_is_advised() {
        let cells = vec![cell(1, false, 1.0, [0.5, 0.1], ms(1.0)), cell(3, false, 1.0, [0.25, 0.1], ms(4.0))];
        let mut report = report(cells);
        let of = |report: &SweepReport| advise(report, &report.scenes[0], Some(3), EngineId::Cpu, &WISH).unwrap();
        assert_eq!(of(&report).setting.levels, 6);
        report.scenes[0].exact = ExactKind::Leaves;
        assert!(of(&report).why.last().unwrap().contains("own leaves"));
        report.scenes[0].exact = ExactKind::Triangles;
        report.scenes[0].cells[1].error.disagreement = 0.5;
        assert!(of(&report).why.last().unwrap().contains("50 % of the rays"));
    }

    proptest! {
        #[test]
        fn advice_keeps_the_wish_if_anything_does(
            cells in prop::collection::vec((0..8usize, any::<bool>(), 0..4u8, 1..60u32, 1..60u32), 1..30),
            (max_error, max_ms, max_bytes) in (1..60u32, prop::option::of(1..60u32), prop::option::of(1..100u64)),
        ) {
            let cells: Vec<Cell> = cells.iter().map(|&(octree, beam, pixels, error, time)| {
                cell(octree, beam, pixels.into(), [f64::from(error) / 10.0, 0.1], ms(time.into()))
            }).collect();
            let wish = Wish {
                max_error: f64::from(max_error) / 10.0,
                max_ms: max_ms.map(f64::from),
                max_bytes: max_bytes.map(|b| b * 1_000_000),
                ..WISH
            };
            let found = advice(cells.clone(), &wish);
            let excess = |error: f64, ms: f64, bytes: u64| {
                let time = wish.max_ms.map_or(0.0, |most| ms / most);
                let size = wish.max_bytes.map_or(0.0, |most| bytes as f64 / most as f64);
                (error / wish.max_error).max(time).max(size)
            };
            let of = |c: &Cell| (excess(c.error.pixels.p90, c.ms().unwrap(), c.memory_bytes), c.ms().unwrap());
            let own = excess(found.setting.error, found.setting.ms, found.setting.memory_bytes);
            let kept: Vec<_> = cells.iter().map(of).filter(|c| c.0 <= 1.0).collect();
            prop_assert_eq!(found.reached, !kept.is_empty());
            if found.reached {
                prop_assert!(own <= 1.0 && kept.iter().all(|c| c.1 * TIE >= found.setting.ms));
            } else {
                prop_assert!(cells.iter().all(|c| of(c).0 >= own));
            }
        }
    }
}
