//! Octrees of the same mesh, levels and kind that have other sizes in other records of a machine.

use std::collections::BTreeMap;

use crate::build_bench::Contours;
use crate::records::{Found, Record};

/// An octree of a mesh.
#[derive(Clone, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub(in crate::page) struct Which {
    pub(in crate::page) scene: String,
    /// Of its mesh.
    identity: String,
    levels: u32,
    contours: bool,
}

impl Which {
    /// `SIBENIK, 10 levels, contours`.
    pub(in crate::page) fn words(&self) -> String {
        format!("{}, {}", self.scene, self.kind())
    }

    /// `10 levels, contours`.
    pub(in crate::page) fn kind(&self) -> String {
        format!("{} levels, {}", self.levels, if self.contours { "contours" } else { "cubes" })
    }
}

/// An octree that several records have.
pub(in crate::page) struct Sizes {
    pub(in crate::page) which: Which,
    /// Sizes in bytes, each with the records that have it by their index; the first is that of the newest record.
    pub(in crate::page) sizes: Vec<(u64, Vec<usize>)>,
}

impl Sizes {
    /// The largest over the smallest.
    pub(in crate::page) fn ratio(&self) -> f64 {
        let bytes = || self.sizes.iter().map(|(bytes, _)| *bytes as f64);
        bytes().fold(0.0, f64::max) / bytes().fold(f64::INFINITY, f64::min)
    }
}

/// The octrees that more than one of these records has.
pub(in crate::page) fn sizes(found: &[&Found]) -> Vec<Sizes> {
    let mut all: BTreeMap<Which, Vec<(u64, Vec<usize>)>> = BTreeMap::new();
    for (index, one) in found.iter().enumerate() {
        let mut add = |scene: &str, identity: &str, levels: u32, contours: bool, bytes: u64| {
            let which = Which { scene: scene.into(), identity: identity.into(), levels, contours };
            let sizes = all.entry(which).or_default();
            match sizes.iter_mut().find(|(known, _)| *known == bytes) {
                Some((_, records)) if records.last() != Some(&index) => records.push(index),
                Some(_) => {}
                None => sizes.push((bytes, vec![index])),
            }
        };
        match &one.record {
            Record::Paper(report) => {
                for scene in &report.scenes {
                    scene.builds.iter().for_each(|b| add(&scene.name, &scene.identity, b.levels, b.contours, b.bytes));
                }
            }
            Record::Build(report) => {
                for (scene, row) in report.scenes.iter().flat_map(|s| s.rows.iter().map(move |r| (s, r))) {
                    let contours = row.contours == Contours::On;
                    add(&scene.name, &scene.identity, row.levels, contours, row.build.image_bytes);
                }
            }
            Record::Sweep(report) => {
                for (scene, o) in report.scenes.iter().flat_map(|s| s.octrees.iter().map(move |o| (s, o))) {
                    add(&scene.name, &scene.identity, o.levels, o.contours, o.image_bytes);
                }
            }
            Record::Needs(report) => {
                for case in &report.cases {
                    let identity = report.credits.iter().find(|row| row[0] == case.scene).map_or("", |row| &row[2]);
                    add(&case.scene, identity, case.levels, case.needs.contours, case.image_bytes);
                }
            }
            Record::Rays(_) | Record::Stability(_) | Record::Voxelize(_) | Record::Shadow(_) => {}
        }
    }
    let several = |sizes: &Vec<(u64, Vec<usize>)>| sizes.iter().map(|(_, records)| records.len()).sum::<usize>() > 1;
    all.into_iter().filter(|(_, sizes)| several(sizes)).map(|(which, sizes)| Sizes { which, sizes }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sweep_bench::sample::report;

    #[test]
    fn sizes_are_held_against_each_other() {
        let record = |bytes: u64| {
            let mut report = report(Vec::new());
            report.scenes[0].octrees.truncate(2);
            report.scenes[0].octrees[1].image_bytes = bytes;
            Found { path: "a".into(), name: "a".into(), record: Record::Sweep(Box::new(report)) }
        };
        let [a, b, c] = [record(2_000_000), record(3_000_000), record(2_000_000)];
        let found = sizes(&[&a, &b, &c]);
        let ratios: Vec<f64> = found.iter().map(Sizes::ratio).collect();
        assert_eq!(ratios, [1.0, 1.5]);
        assert_eq!(found[1].which.words(), "SIBENIK, 5 levels, contours");
        assert_eq!(found[1].sizes, [(2_000_000, vec![0, 2]), (3_000_000, vec![1])]);
        assert!(sizes(&[&a]).is_empty());
    }
}
