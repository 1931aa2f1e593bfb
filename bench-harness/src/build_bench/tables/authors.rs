//! Comparison with the paper authors' builder: a table for each octree that both have built.

use esvo_scenes::SceneVariant;

use super::{ratio, rows};
use crate::build_bench::peers::{Authors, Figures, TheirOctree};
use crate::build_bench::plan::Contours;
use crate::build_bench::record::{BuildReport, BuildRow, SceneBuilds};
use crate::scene::compared_as;
use crate::text::{TextTable, or_dash, short};

/// Figures that differ by less are called equal: the authors' are rounded to two or three digits.
const EQUAL: f64 = 1.01;

/// A table for each of our octrees that the authors' builder was measured on, too.
pub(super) fn beside_authors(report: &BuildReport, authors: &Authors) -> Vec<TextTable> {
    let with_contours = rows(report).filter(|(_, row)| row.contours == Contours::On);
    let tables = with_contours.filter_map(|(scene, row)| {
        let theirs = authors.octree(compared_as(&scene.name, scene.mesh), row.levels)?;
        let comparable = theirs.own_mesh == (scene.mesh == SceneVariant::Real);
        (comparable || !theirs.own_mesh).then(|| beside(report, scene, row, theirs, authors))
    });
    tables.collect()
}

/// One row of the tables: what it shows, digits after the point (`None`: about three digits), whether it is time.
struct Figure {
    name: &'static str,
    decimals: Option<usize>,
    is_time: bool,
    of: fn(&Figures) -> Option<f64>,
}

const fn size(name: &'static str, of: fn(&Figures) -> Option<f64>) -> Figure {
    Figure { name, decimals: None, is_time: false, of }
}

const fn time(name: &'static str, of: fn(&Figures) -> Option<f64>) -> Figure {
    Figure { name, decimals: None, is_time: true, of }
}

const fn error(name: &'static str, decimals: usize, of: fn(&Figures) -> Option<f64>) -> Figure {
    Figure { name, decimals: Some(decimals), is_time: false, of }
}

const FIGURES: [Figure; 24] = [
    time("CPU seconds, import included", |f| f.cpu_seconds),
    time("seconds, without import", |f| f.seconds),
    size("peak memory, MiB", |f| f.peak_mib),
    size("image, MB", |f| f.mb),
    size("million voxels", |f| f.million_voxels),
    error("depth at one pixel, pixels, median", 3, |f| f.depth_at_pixel.median),
    error("depth at one pixel, pixels, 90th", 3, |f| f.depth_at_pixel.p90),
    error("depth at one pixel, pixels, 99th", 3, |f| f.depth_at_pixel.p99),
    error("depth at leaves, pixels, median", 3, |f| f.depth_at_leaves.median),
    error("depth at leaves, pixels, 90th", 3, |f| f.depth_at_leaves.p90),
    error("depth at leaves, pixels, 99th", 3, |f| f.depth_at_leaves.p99),
    error("normals at one pixel, degrees, median", 2, |f| f.normals_at_pixel.median),
    error("normals at one pixel, degrees, 90th", 2, |f| f.normals_at_pixel.p90),
    error("normals at one pixel, degrees, 99th", 2, |f| f.normals_at_pixel.p99),
    error("normals at leaves, degrees, median", 2, |f| f.normals_at_leaves.median),
    error("normals at leaves, degrees, 90th", 2, |f| f.normals_at_leaves.p90),
    error("normals at leaves, degrees, 99th", 2, |f| f.normals_at_leaves.p99),
    error("colours at one pixel, of 255, median", 1, |f| f.colors_at_pixel.median),
    error("colours at one pixel, of 255, 90th", 1, |f| f.colors_at_pixel.p90),
    error("colours at one pixel, of 255, 99th", 1, |f| f.colors_at_pixel.p99),
    error("colours at leaves, of 255, median", 1, |f| f.colors_at_leaves.median),
    error("colours at leaves, of 255, 90th", 1, |f| f.colors_at_leaves.p90),
    error("colours at leaves, of 255, 99th", 1, |f| f.colors_at_leaves.p99),
    error("FLIP at one pixel", 3, |f| f.flip_at_pixel),
];

fn beside(
    report: &BuildReport,
    scene: &SceneBuilds,
    row: &BuildRow,
    theirs: &TheirOctree,
    authors: &Authors,
) -> TextTable {
    let title = format!("{} at {} levels beside the authors' builder", scene.name, row.levels);
    let (their_run, then) = (format!("esvo {} in their run", authors.commit), "authors / that");
    let head = ["figure", "ours", "authors", "authors / ours", "", &*their_run, then];
    let mut table = TextTable::new(title, 1, &head);
    table.notes = notes(report, scene, row, theirs, authors);
    let ours = Figures::of(row);
    let speed = speed(report, row, theirs, authors);
    for figure in &FIGURES {
        let [ours, old, theirs_now] =
            [Some(&ours), theirs.esvo.as_ref(), Some(&theirs.authors)].map(|f| f.and_then(figure.of));
        if ours.is_none() && theirs_now.is_none() {
            continue;
        }
        let cell = |value: f64| figure.decimals.map_or_else(|| short(value), |d| format!("{value:.d$}"));
        let (quotient, judged) = match (ours, theirs_now) {
            _ if !theirs.own_mesh => (None, ""),
            // Seconds of two machines have no ratio; those of one run do.
            _ if figure.is_time => {
                let speed = speed.filter(|_| figure.name.starts_with("CPU"));
                (speed, speed.map_or("", |speed| judge(1.0, speed)))
            }
            (Some(ours), Some(theirs)) => (Some(theirs / ours), judge(ours, theirs)),
            _ => (None, ""),
        };
        let times = |quotient: f64| ratio(quotient, 1.0);
        table.rows.push(vec![
            figure.name.into(),
            or_dash(ours.map(cell)),
            or_dash(theirs_now.map(cell)),
            or_dash(quotient.map(times)),
            judged.into(),
            or_dash(old.map(cell)),
            or_dash(theirs_now.zip(old).map(|(theirs, old)| times(theirs / old))),
        ]);
    }
    table
}

/// Every figure is better if it is less.
fn judge(ours: f64, theirs: f64) -> &'static str {
    if ours > theirs * EQUAL { "worse" } else { "" }
}

/// The authors' processor time divided by ours: what they took divided by what [`Authors::commit`] took in their run, times what
/// that commit takes divided by what we take in this run. `None` unless it was built beside ours.
fn speed(report: &BuildReport, row: &BuildRow, theirs: &TheirOctree, authors: &Authors) -> Option<f64> {
    let commit = &report.beside.as_ref()?.commit;
    let same = commit.starts_with(&authors.commit) && !commit.ends_with("-dirty");
    let then = theirs.authors.cpu_seconds? / theirs.esvo.as_ref()?.cpu_seconds?;
    same.then_some(then * row.cpu_ratio_beside()?)
}

fn notes(
    report: &BuildReport,
    scene: &SceneBuilds,
    row: &BuildRow,
    theirs: &TheirOctree,
    authors: &Authors,
) -> Vec<String> {
    let settings = &row.build.settings;
    let test = name_of(&settings.texture_test);
    let meaning = if test == "texels" {
        "their test of colours and normals has the same meaning"
    } else {
        "not of equal meaning: they compare colours and normals with the least and greatest of all texels in a voxel"
    };
    let mut notes = vec![
        format!(
            "Authors: ESVO 1.4, contours, errors {} (contour), {} (colour), {} (normal). Ours: the same, --texture-test {test}; {meaning}.",
            settings.contour_error, settings.color_error, settings.normal_error
        ),
        format!(
            "Every figure is better if it is less; worse: ours is more than 1 % above theirs. Ours: {}, medians of {} builds; errors over {} \
             viewpoints at {}x{}.",
            scene.mesh.title(),
            row.samples.len(),
            scene.views.len(),
            scene.size[0],
            scene.size[1]
        ),
    ];
    if !theirs.own_mesh {
        notes.push(
            "Authors: another stand-in of the same name and number of triangles, so that there are no ratios.".into(),
        );
        return notes;
    }
    let commit = &authors.commit;
    let then = theirs.authors.cpu_seconds.zip(theirs.esvo.as_ref().and_then(|esvo| esvo.cpu_seconds));
    let Some((their_cpu, old_cpu)) = then else { return notes };
    notes.push(match (report.beside.as_ref(), row.cpu_ratio_beside(), speed(report, row, theirs, authors)) {
        (_, Some(now), Some(speed)) => format!(
            "CPU seconds, authors / ours: {their_cpu} / {old_cpu} of esvo {commit} in their run, times {now:.2} (that commit / ours, in the same \
             rounds of this run): {speed:.2}. Their seconds themselves are those of another machine."
        ),
        (Some(other), Some(now), None) => format!(
            "Seconds of the authors are those of another machine: compare the last column. The other program, of commit {}, took {now:.2} times \
             our CPU seconds in the same rounds.",
            other.commit
        ),
        _ => format!(
            "Seconds of the authors are those of another machine: compare the last column. --beside an esvo of commit {commit} says how much \
             faster ours is than that."
        ),
    });
    notes
}

/// The name of a setting, as the options of the program have it.
fn name_of(setting: &impl serde::Serialize) -> String {
    let value = serde_json::to_value(setting).unwrap_or_default();
    value.as_str().unwrap_or("unknown").to_owned()
}

#[cfg(test)]
mod tests {
    use super::super::tests::report;
    use super::*;
    use crate::build_bench::record::tests::row;
    use crate::build_bench::record::{BesideBuilds, OtherProgram};
    use crate::error::attributes::AttributeError;
    use crate::error::depth::{DepthError, Summary};

    /// CONFERENCE at 12 levels: fewer bytes than the authors' octree, a larger 99th percentile.
    fn conference() -> BuildReport {
        let mut report = report();
        let mut built = row(12, Contours::On, [2.0, 0.05, 0.2]);
        let pixels = Summary { median: 0.05, p90: 0.3205, p99: 3.0, ..Summary::default() };
        built.error_at_pixel = Some(DepthError { pixels, ..DepthError::default() });
        let normals = Summary { p90: 0.5, ..Summary::default() };
        built.attributes = Some(AttributeError { normals, ..AttributeError::default() });
        report.scenes[0].name = "CONFERENCE".into();
        report.scenes[0].rows = vec![built, row(12, Contours::Off, [2.0, 0.1, 0.2]), row(11, Contours::On, [1.0; 3])];
        report
    }

    fn rows_of(table: &TextTable) -> Vec<String> {
        table.rows.iter().map(|row| row.join(" | ")).collect()
    }

    #[test]
    fn what_is_worse_is_marked_and_seconds_of_two_machines_have_no_ratio() {
        let tables = beside_authors(&conference(), &Authors::figures());
        assert_eq!(tables.len(), 1, "level 11 and cubes have no figures of the authors");
        let rows = rows_of(&tables[0]);
        for expected in [
            "CPU seconds, import included | 4.00 | 15.6 | - |  | 3.68 | 4.24 x",
            "seconds, without import | 2.00 | 9.70 | - |  | - | -",
            "image, MB | 50.0 | 81.7 | 1.63 x |  | 48.1 | 1.70 x",
            "million voxels | 16.8 | 13.1 | 0.78 x | worse | 8.81 | 1.49 x",
            // Within the rounding of their figure, and not.
            "depth at one pixel, pixels, 90th | 0.321 | 0.321 | 1.00 x |  | 0.324 | 0.99 x",
            "depth at one pixel, pixels, 99th | 3.000 | 2.290 | 0.76 x | worse | 2.340 | 0.98 x",
            "normals at leaves, degrees, 90th | 0.50 | 0.14 | 0.28 x | worse | 0.69 | 0.20 x",
            "colours at leaves, of 255, 99th | 0.0 | - | - |  | - | -",
        ] {
            assert!(rows.iter().any(|row| row == expected), "{expected}: {rows:#?}");
        }
        assert!(!rows.iter().any(|row| row.starts_with("FLIP")), "neither has it");
        assert!(tables[0].notes.iter().any(|note| note.contains("--beside an esvo of commit 357f175")));
    }

    #[test]
    fn the_commit_of_their_run_beside_ours_makes_the_ratio() {
        let mut report = conference();
        let built = &mut report.scenes[0].rows[0];
        let mut sample = built.samples[0];
        sample.cpu_seconds = Some(6.0);
        built.beside = Some(BesideBuilds { voxels: 1, image_bytes: 1, samples: vec![sample] });
        let cpu = |report: &BuildReport| rows_of(&beside_authors(report, &Authors::figures())[0])[0].clone();
        report.beside = Some(OtherProgram { commit: "357f17512345".into() });
        // 15.6 / 3.68 times 6 / 4.
        assert_eq!(cpu(&report), "CPU seconds, import included | 4.00 | 15.6 | 6.36 x |  | 3.68 | 4.24 x");
        report.scenes[0].rows[0].samples[0].cpu_seconds = Some(60.0);
        assert_eq!(cpu(&report), "CPU seconds, import included | 60.0 | 15.6 | 0.42 x | worse | 3.68 | 4.24 x");
        // Another commit, or one with changes, was not in their run.
        for commit in ["d6478ea12345", "357f17512345-dirty", "unknown"] {
            report.beside = Some(OtherProgram { commit: commit.into() });
            assert!(cpu(&report).contains("| 15.6 | - |  |"), "{commit}");
        }
    }

    #[test]
    fn another_mesh_has_no_ratios() {
        let mut report = conference();
        report.scenes[0].mesh = SceneVariant::StandIn;
        assert!(beside_authors(&report, &Authors::figures()).is_empty(), "theirs is the real mesh");
        report.scenes[0].name = "HAIRBALL".into();
        report.scenes[0].rows = vec![row(10, Contours::On, [500.0, 0.05, 9.0])];
        let rows = rows_of(&beside_authors(&report, &Authors::figures())[0]);
        assert!(rows.iter().any(|row| row == "peak memory, MiB | 8583 | 1219 | - |  | - | -"), "{rows:#?}");
        report.scenes[0].mesh = SceneVariant::Other;
        assert!(beside_authors(&report, &Authors::figures()).is_empty());
    }
}
