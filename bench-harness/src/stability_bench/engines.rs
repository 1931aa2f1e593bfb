//! The engines under test, and what they must find.

use std::sync::Arc;

use esvo_core::testing::compare::Allowed;
use esvo_core::testing::oracle::Oracle;
use esvo_core::{CastError, Caster, Hit, Ray, Rays, View};
use esvo_engines::{EngineId, InstructionSet, OpenOptions};
use esvo_format::Octree;

use super::{EngineRow, StabilityOptions};

/// An engine at work.
pub(super) struct Running {
    pub(super) row: EngineRow,
    caster: Option<Box<dyn Caster>>,
    exact: bool,
    /// Whether it casts [`StabilityOptions::gpu_rays`] and not all.
    pub(super) is_gpu: bool,
}

/// Opens the engines, the CPU caster once for each instruction set. The reference is what they are compared with.
pub(super) fn open(options: &StabilityOptions) -> Vec<Running> {
    let mut running = Vec::new();
    for &id in &options.engines {
        let sets: Vec<_> = match id {
            EngineId::Reference => continue,
            EngineId::Cpu => InstructionSet::available().map(Some).collect(),
            _ => vec![None],
        };
        for instructions in sets {
            let opened = id.open(&OpenOptions { instructions, ..OpenOptions::default() });
            let (caster, error) = match opened {
                Ok(caster) => (Some(caster), None),
                Err(error) => (None, Some(error.to_string())),
            };
            let name = instructions.map_or(id.to_string(), |set| format!("{id}, {}", set.name()));
            let device = caster.as_ref().map(|caster| caster.device().clone());
            let exact = id.allowed() == Allowed::EXACT;
            let row = EngineRow { name, device, error, rays: 0, pixels: 0, different: 0, wrong: 0, first: None };
            running.push(Running { row, caster, exact, is_gpu: id != EngineId::Cpu });
        }
    }
    running
}

/// Whether hits are the same in every bit but for the iterations, and the sign of a zero.
pub(super) fn same(a: &Hit, b: &Hit) -> bool {
    a.same_voxel(b) && a.raw_t == b.raw_t
}

/// The same for an engine whose shading language lets the driver take numbers below 2^-126 for zero, which NVIDIA's does.
fn same_but_for_tiny(a: &Hit, b: &Hit) -> bool {
    let tiny = |t: f32| t.abs() < f32::MIN_POSITIVE;
    same(a, b) || a.same_voxel(b) && tiny(a.raw_t) && tiny(b.raw_t)
}

impl Running {
    pub(super) fn load(&mut self, octree: &Arc<Octree>) {
        self.work(|caster, _| caster.load(octree));
    }

    /// Casts a list of rays and compares with the reference's hits. `case` names the ray of a place in the list.
    pub(super) fn rays(
        &mut self,
        oracle: &Oracle<'_>,
        rays: Rays<'_>,
        expected: &[Hit],
        case: impl Fn(usize) -> String,
    ) {
        let exact = self.exact;
        self.work(|caster, row| {
            let mut hits = Vec::new();
            caster.cast_rays(&rays, &mut hits)?;
            row.rays += rays.rays.len() as u64;
            compare(row, exact, oracle, (rays.rays, rays.contours), (&hits, expected), case);
            Ok(())
        });
    }

    /// The same for a picture.
    pub(super) fn picture(&mut self, oracle: &Oracle<'_>, view: &View, rays: &[Ray], expected: &[Hit], case: &str) {
        let exact = self.exact;
        self.work(|caster, row| {
            let mut hits = Vec::new();
            caster.cast(view, &mut hits)?;
            row.pixels += rays.len() as u64;
            compare(row, exact, oracle, (rays, view.contours()), (&hits, expected), |k| format!("{case}, pixel {k}"));
            Ok(())
        });
    }

    /// After an error, the engine is closed, and its row has the reason.
    fn work(&mut self, work: impl FnOnce(&mut dyn Caster, &mut EngineRow) -> Result<(), CastError>) {
        let Some(caster) = &mut self.caster else { return };
        if let Err(error) = work(&mut **caster, &mut self.row) {
            self.caster = None;
            self.row.error = Some(error.to_string());
        }
    }
}

fn compare(
    row: &mut EngineRow,
    exact: bool,
    oracle: &Oracle<'_>,
    (rays, contours): (&[Ray], bool),
    (hits, expected): (&[Hit], &[Hit]),
    case: impl Fn(usize) -> String,
) {
    if hits.len() != expected.len() {
        row.wrong += 1;
        row.first.get_or_insert(format!("{}: {} hits for {} rays", case(0), hits.len(), expected.len()));
        return;
    }
    for (k, (hit, right)) in hits.iter().zip(expected).enumerate() {
        if same(hit, right) || !exact && same_but_for_tiny(hit, right) {
            continue;
        }
        row.different += 1;
        let mistake = oracle.judge_hit(&rays[k], contours, hit);
        if exact || mistake.is_err() {
            row.wrong += 1;
            let why = mistake.map_or_else(|mistake| mistake.to_string(), |_| "another tie than the reference's".into());
            row.first.get_or_insert(format!("{}: {why}", case(k)));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiny_numbers_may_be_zero_and_others_not() {
        let hit = |t: f32| Hit { raw_t: t, ..Hit::miss(0) };
        assert!(same_but_for_tiny(&hit(1e-40), &hit(0.0)) && !same(&hit(1e-40), &hit(0.0)));
        assert!(!same_but_for_tiny(&hit(f32::MIN_POSITIVE), &hit(0.0)));
        assert!(same(&hit(-0.0), &hit(0.0)) && !same_but_for_tiny(&hit(0.5), &hit(0.25)));
    }
}
