//! How much faster a GPU is than the processor of its machine, by records that timed both in one run.

use esvo_core::DeviceKind;

use super::between::timings::{Timing, timings};
use super::html::{Answered, Mark, Question};
use super::machines::OnMachine;
use crate::text::short;
use crate::timing::Spread;

/// The question of a machine, of which some records have GPU times that are too long if `slow_clocks`; `None` if nothing was timed there.
pub(super) fn question(machine: &OnMachine, slow_clocks: bool) -> Option<Question> {
    let by_record: Vec<(String, Vec<Timing>)> =
        machine.found.iter().map(|one| (machine.name_of(one), timings(&one.record))).collect();
    let timed = || by_record.iter().flat_map(|(_, timings)| timings);
    timed().next()?;
    let gpu = timed().any(|timing| timing.kind == DeviceKind::Gpu);
    let software = timed().find(|timing| timing.kind == DeviceKind::SoftwareGpu).map(|timing| timing.device);
    let mut details: Vec<String> = by_record.iter().flat_map(|(name, timings)| of_record(name, timings)).collect();
    let plain = |answer: String, details| Answered { mark: Mark::Plain, answer, details, ..Answered::default() };
    let answer = match (gpu, details.is_empty()) {
        (true, false) => {
            let ratios = by_record.iter().flat_map(|(_, timings)| ratios(timings)).map(|(_, ratio)| ratio);
            let (least, most) = ratios.fold((f64::INFINITY, 0f64), |(a, b), ratio| (a.min(ratio), b.max(ratio)));
            if slow_clocks {
                let why = "Times of the GPU are too long in records of this machine, so that it gains more than this: see the next question.";
                details.push(why.into());
            }
            let words = if least > 1.0 {
                format!("Yes: it casts {} to {} times as many rays per second.", short(least), short(most))
            } else {
                format!("Not everywhere: {} to {} times as many rays per second.", short(least), short(most))
            };
            plain(words, details)
        }
        (true, true) => plain("Not known: no record of this machine timed both in one run.".into(), Vec::new()),
        (false, _) => {
            let software = software.map(|name| format!("{name} is software that runs on the processor, no GPU."));
            plain("Not known: no record of this machine timed a GPU.".into(), software.into_iter().collect())
        }
    };
    Some(Question {
        id: "gpu",
        question: "Is the GPU faster than the processor?".into(),
        machine: machine.name.clone(),
        rule: "Rates of the same picture, octree and settings in one record, divided; all cores of the processor. Times of a GPU are those of \
               the cast alone, without copies."
            .into(),
        answers: vec![answer],
        table: None,
    })
}

/// Rates of a GPU over those of the processor for everything that a record timed on both, with the GPU's timing.
fn ratios<'a, 'b>(timings: &'b [Timing<'a>]) -> Vec<(&'b Timing<'a>, f64)> {
    let of_kind = |kind| timings.iter().filter(move |timing| timing.kind == kind);
    of_kind(DeviceKind::Gpu)
        .filter_map(|gpu| {
            let cpu = of_kind(DeviceKind::Cpu).find(|cpu| cpu.thing == gpu.thing)?;
            let [fast, slow] = gpu.both(cpu)?;
            Some((gpu, fast / slow))
        })
        .collect()
}

/// A sentence for each engine of a GPU and picture size.
fn of_record(name: &str, timings: &[Timing]) -> Vec<String> {
    let all = ratios(timings);
    let mut groups: Vec<(&Timing, Vec<f64>)> = Vec::new();
    for (gpu, ratio) in &all {
        let same = |known: &Timing| known.engine == gpu.engine && known.thing.size == gpu.thing.size;
        match groups.iter_mut().find(|(known, _)| same(known)) {
            Some((_, ratios)) => ratios.push(*ratio),
            None => groups.push((gpu, vec![*ratio])),
        }
    }
    let cpu = timings.iter().find(|timing| timing.kind == DeviceKind::Cpu).map_or("", |timing| timing.detail);
    let sentence = |(gpu, mut ratios): (&Timing, Vec<f64>)| {
        ratios.sort_by(f64::total_cmp);
        let [width, height] = gpu.thing.size;
        let rounds = if gpu.rounds() == 1 { "one round each".into() } else { format!("{} rounds", gpu.rounds()) };
        Some(format!(
            "{} on {} against cpu ({cpu}), {width}x{height}: {} times the rays per second in the middle of {} settings ({} to {}), by {name}, \
             {rounds}.",
            gpu.engine,
            gpu.device,
            short(Spread::of(&ratios)?.median),
            ratios.len(),
            short(*ratios.first()?),
            short(*ratios.last()?)
        ))
    };
    groups.into_iter().filter_map(sentence).collect()
}
