//! What a record says in words: what mips save, what steps cost, how many rays a filter replaces, and which of volume and octree is faster.

use super::tables::{by_effect, rate};
use super::{ErrorRow, RateRow, SceneShadows, ShadowReport, WALK};
use crate::text::{TextTable, short};
use crate::timing::least;

/// Cells of the two mips that the document has, in voxels.
const TWO_MIPS: u32 = 8;

/// The questions that the benchmark is run for, and their answers from the tables below.
pub(super) fn answers(report: &ShadowReport) -> TextTable {
    let mut table = TextTable::new("In words", 3, &["scene", "question", "answer"]);
    table.notes = vec![format!(
        "From the tables below, for voxels of {} cm where no size is said. Times are the least of the rounds. Lists of rays look at bytes of eight voxels even without mips. A filter's rays: as many rays without the filter would have \
         the same error, between two measured numbers by the line through both in a plot with logarithms.",
        report.options.base()
    )];
    if let Some(answer) = leaks(report) {
        table.rows.push(vec!["closed rooms".into(), "how leaky are steps?".into(), answer]);
    }
    for scene in &report.scenes {
        let mut add = |question: &str, answer: Option<String>| {
            table.rows.extend(answer.map(|answer| vec![scene.name.clone(), question.to_owned(), answer]));
        };
        for kind in kinds(scene) {
            add(&format!("{kind}: what do mips save?"), mips(scene, kind));
            add(&format!("{kind}: what do steps cost?"), steps(scene, kind));
            add(&format!("{kind}: volume or octree?"), octree(scene, kind));
        }
        for (effect, rows) in by_effect(&scene.errors) {
            let usual: Vec<&ErrorRow> = usual(&rows, report.options.base());
            add(&format!("{effect}: how many rays does the filter replace?"), filter(&usual));
            add(&format!("{effect}: what is it to begin in the picture?"), picture(&rows, &usual));
        }
    }
    table
}

/// The kinds of rays, in the order of the record.
fn kinds(scene: &SceneShadows) -> Vec<&str> {
    let mut kinds: Vec<&str> = scene.rates.iter().map(|row| row.kind.as_str()).collect();
    kinds.dedup();
    kinds
}

fn leaks(report: &ShadowReport) -> Option<String> {
    let mut of_steps: Vec<(f64, f64)> = Vec::new();
    for row in &report.leaks {
        let (Some(step), share) = (row.step, row.leaks as f64 / row.rays.max(1) as f64) else { continue };
        match of_steps.iter_mut().find(|(other, _)| *other == step) {
            Some((_, most)) => *most = most.max(share),
            None => of_steps.push((step, share)),
        }
    }
    of_steps.sort_by(|a, b| a.0.total_cmp(&b.0));
    let tight: Vec<_> = report.leaks.iter().filter(|row| row.step.is_none()).collect();
    let rays: u64 = tight.iter().map(|row| row.rays).sum();
    let left: u64 = tight.iter().map(|row| row.leaks).sum();
    let shares = of_steps.iter().map(|(step, share)| format!("{} % in steps of {step}", short(100.0 * share)));
    let shares = shares.collect::<Vec<_>>().join(", ");
    (!tight.is_empty() && !of_steps.is_empty()).then(|| {
        format!("through walls one voxel thick: of {rays} rays that look at every voxel {left} leave; of the leakiest walls {shares}")
    })
}

/// The row of a kind of rays on the processor that ask whether anything is in the way. Of several ways to look at every voxel, the fastest.
fn row<'a>(scene: &'a SceneShadows, kind: &str, step: Option<f64>, coarsest: u32) -> Option<&'a RateRow> {
    let name = step.map_or_else(|| WALK.to_owned(), |step| format!("steps of {step}"));
    let of = |row: &&RateRow| {
        let way = row.tracer.strip_prefix(&name);
        row.kind == kind && !row.first && row.coarsest == coarsest && way.is_some_and(|rest| !rest.contains(" on "))
    };
    scene.rates.iter().filter(of).max_by(|a, b| rate(a).total_cmp(&rate(b)))
}

fn mips(scene: &SceneShadows, kind: &str) -> Option<String> {
    let none = row(scene, kind, None, 1)?;
    let of = |what: &str, coarsest: u32| {
        let with = row(scene, kind, None, coarsest)?;
        let other = if with.different == 0 {
            "no other answer".to_owned()
        } else {
            format!("{} OTHER ANSWERS", with.different)
        };
        Some(format!("{what} mips make them {} times as fast, with {other}", short(rate(with) / rate(none))))
    };
    let answers: Vec<String> = [of("two", TWO_MIPS), of("five", 64)].into_iter().flatten().collect();
    (!answers.is_empty()).then(|| format!("{} Mrays/s without; {}", short(rate(none)), answers.join("; ")))
}

fn steps(scene: &SceneShadows, kind: &str) -> Option<String> {
    let every = row(scene, kind, None, TWO_MIPS)?;
    let of = |step: f64| {
        let steps = row(scene, kind, Some(step), TWO_MIPS)?;
        let share = 100.0 * steps.different as f64 / steps.rays.max(1) as f64;
        let speed = short(rate(steps) / rate(every));
        Some(format!("steps of {step} are {speed} times as fast, and {} % of rays have another answer", short(share)))
    };
    let answers: Vec<String> = [0.5, 1.0, 2.0].into_iter().filter_map(of).collect();
    (!answers.is_empty()).then(|| format!("with two mips, beside {}: {}", every.tracer, answers.join("; ")))
}

fn octree(scene: &SceneShadows, kind: &str) -> Option<String> {
    let octree = scene.rates.iter().find(|row| row.kind == kind && row.coarsest == 0)?;
    let volume = [TWO_MIPS, 64].into_iter().filter_map(|coarsest| row(scene, kind, None, coarsest));
    let volume = volume.max_by(|a, b| rate(a).total_cmp(&rate(b)))?;
    let share = rate(volume) / rate(octree);
    let (better, times) = if share >= 1.0 { ("volume", share) } else { ("octree's caster", 1.0 / share) };
    Some(format!(
        "the {better} is {} times as fast: {} Mrays/s through the volume, {} through the octree, which has finer voxels, normals and colours",
        short(times),
        short(rate(volume)),
        short(rate(octree))
    ))
}

/// Rows of the base voxels that look at every voxel, and begin in the picture if any do.
fn usual<'a>(rows: &[&'a ErrorRow], base: f64) -> Vec<&'a ErrorRow> {
    let rows: Vec<&ErrorRow> = rows.iter().copied().filter(|row| row.voxel_cm == base && row.step.is_none()).collect();
    let begins = rows.iter().any(|row| row.screen);
    rows.into_iter().filter(|row| row.screen == begins).collect()
}

/// Rays without a filter that have an error: between two measured numbers by a straight line in logarithms.
fn rays_for(raw: &[(f64, f64)], error: f64) -> Option<Result<f64, f64>> {
    let (first, last) = (raw.first()?, raw.last()?);
    if error >= first.1 {
        return Some(Ok(first.0 * if error > first.1 { 0.0 } else { 1.0 }));
    }
    if error < last.1 {
        return Some(Err(last.0));
    }
    let pair = raw.windows(2).find(|pair| pair[1].1 <= error)?;
    let ([n, m], [e, f]) = ([pair[0].0.ln(), pair[1].0.ln()], [pair[0].1.ln(), pair[1].1.ln()]);
    Some(Ok((n + (m - n) * (e - error.ln()) / (e - f)).exp()))
}

fn filter(rows: &[&ErrorRow]) -> Option<String> {
    let mut raw: Vec<(f64, f64)> =
        rows.iter().filter(|row| !row.smoothed).map(|row| (f64::from(row.rays), row.rmse)).collect();
    raw.sort_by(|a, b| a.0.total_cmp(&b.0));
    // All rays to a point are one: there is no noise to smooth.
    if raw.len() < 2 {
        return None;
    }
    let of = |row: &&ErrorRow| {
        let replaces = match rays_for(&raw, row.rmse)? {
            Ok(0.0) => "are worse than one without".to_owned(),
            Ok(rays) => format!("are as near as {}", short(rays)),
            Err(most) => format!("are nearer than {most}"),
        };
        let (error, ms) = (short(100.0 * row.rmse), short(least(&row.ms)));
        Some(format!("{} with it {replaces} ({error} %, {ms} ms)", row.rays))
    };
    let answers: Vec<String> = rows.iter().filter(|row| row.smoothed).filter_map(of).collect();
    (!answers.is_empty()).then(|| answers.join("; "))
}

fn picture(rows: &[&ErrorRow], usual: &[&ErrorRow]) -> Option<String> {
    let with = usual.iter().filter(|row| row.screen && !row.smoothed).max_by_key(|row| row.rays)?;
    let same = |row: &&&ErrorRow| {
        !row.screen
            && (row.voxel_cm, row.step, row.rays, row.smoothed) == (with.voxel_cm, with.step, with.rays, with.smoothed)
    };
    let without = rows.iter().find(same)?;
    Some(format!(
        "of {} rays, an error of {} % with it and {} % without, in {} times the time",
        with.rays,
        short(100.0 * with.rmse),
        short(100.0 * without.rmse),
        short(least(&with.ms) / least(&without.ms))
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rate(tracer: &str, coarsest: u32, seconds: f64, different: u64) -> RateRow {
        let first = coarsest == 0;
        let (kind, tracer) = ("shadow".into(), tracer.into());
        RateRow { kind, tracer, coarsest, first, rays: 1_000_000, seconds: vec![9.0, seconds], steps: 0.0, different }
    }

    fn error(rays: u32, screen: bool, smoothed: bool, ms: f64, rmse: f64) -> ErrorRow {
        let (effect, voxel_cm, step) = ("fog".into(), 5.0, None);
        ErrorRow { effect, voxel_cm, step, rays, screen, smoothed, ms: vec![ms], rmse, rmse_triangles: rmse, flip: 0.0 }
    }

    fn scene() -> SceneShadows {
        SceneShadows {
            name: "S".into(),
            identity: String::new(),
            credit: String::new(),
            view: String::new(),
            volumes: Vec::new(),
            rates: vec![
                rate("every voxel", 1, 1.0, 0),
                rate("every voxel", 8, 0.5, 0),
                rate("every voxel, in lists", 8, 0.25, 0),
                rate("every voxel on a device", 8, 0.001, 0),
                rate("every voxel", 64, 0.2, 3),
                rate("steps of 1", 8, 0.5, 20_000),
                rate("octree", 0, 0.1, 0),
            ],
            errors: vec![
                error(1, true, false, 1.0, 0.4),
                error(4, true, false, 4.0, 0.2),
                error(1, true, true, 2.0, 0.2),
                error(4, true, true, 5.0, 0.1),
                error(4, false, false, 2.0, 0.3),
            ],
        }
    }

    /// Numbers in the answers are those of the rows: the least of the times, the fastest way on the processor, and no device.
    #[test]
    fn answers_say_what_the_rows_say() {
        let scene = scene();
        let said = |answer: Option<String>| answer.unwrap();
        let mips = said(mips(&scene, "shadow"));
        assert!(
            mips.starts_with("1.00 Mrays/s without; two mips make them 4.00 times as fast, with no other answer"),
            "{mips}"
        );
        assert!(mips.ends_with("five mips make them 5.00 times as fast, with 3 OTHER ANSWERS"), "{mips}");
        let steps = said(steps(&scene, "shadow"));
        assert_eq!(
            steps,
            "with two mips, beside every voxel, in lists: steps of 1 are 0.50 times as fast, and 2.00 % of rays have another answer"
        );
        let octree = said(octree(&scene, "shadow"));
        assert!(octree.starts_with("the octree's caster is 2.00 times as fast: 5.00 Mrays/s"), "{octree}");
        let mut slow = scene.clone();
        slow.rates[6].seconds = vec![0.4];
        let octree = said(super::octree(&slow, "shadow"));
        assert!(octree.starts_with("the volume is 2.00 times as fast"), "{octree}");
        let rows: Vec<&ErrorRow> = scene.errors.iter().collect();
        let usual = usual(&rows, 5.0);
        assert_eq!(usual.len(), 4);
        let filter = said(filter(&usual));
        assert_eq!(
            filter,
            "1 with it are as near as 4.00 (20.0 %, 2.00 ms); 4 with it are nearer than 4 (10.0 %, 5.00 ms)"
        );
        let picture = said(picture(&rows, &usual));
        assert_eq!(picture, "of 4 rays, an error of 20.0 % with it and 30.0 % without, in 2.00 times the time");
        // Where nothing was measured nothing is said.
        assert_eq!((super::mips(&scene, "fog"), super::octree(&scene, "fog"), super::filter(&[])), (None, None, None));
    }

    /// Errors that fall with the root of the number of rays: a quarter of the error of 16 rays is that of 256.
    #[test]
    fn rays_are_found_between_measured_ones() {
        let raw = [(1.0, 0.4), (4.0, 0.2), (16.0, 0.1)];
        let rays = |error: f64| rays_for(&raw, error);
        assert_eq!(rays(0.5), Some(Ok(0.0)));
        assert_eq!(rays(0.05), Some(Err(16.0)));
        for (error, expected) in [(0.4, 1.0), (0.2, 4.0), (0.1, 16.0), (0.2 / 2.0f64.sqrt(), 8.0)] {
            let Some(Ok(found)) = rays(error) else { panic!("{error}") };
            assert!((found - expected).abs() < 1e-9, "{error}: {found}");
        }
        assert_eq!(rays_for(&[], 0.1), None);
    }
}
