//! What must be known before figures of two records of one machine are compared: rates of the same thing that differ, octrees of other
//! sizes, other instruction sets. Nothing here is a fault of a record; it was hidden as long as records stood beside each other.

pub(super) mod timings;

mod octrees;

use std::collections::BTreeMap;

use esvo_core::DeviceKind;

use super::html::{Answered, Block, Mark, PageCell, PageTable, Question, Section};
use super::machines::OnMachine;
use super::verdicts::listed;
use crate::records::Found;
use crate::text::short;
use crate::timing::Spread;
use octrees::{Sizes, sizes};
use timings::{Timing, Twice, timings, twice};

/// Rates of the same thing that differ by more than this factor are said to differ.
const WIDE: f64 = 1.5;
/// Pairs of records that are described; the others are counted.
const LISTED: usize = 4;
/// Since then, GPUs cast for a while before each cast that is timed. Before, they waited for calibration casts on the processor, and
/// lowered their clocks.
const AWAKE_SINCE: &str = "2026-11-27T05:38";

/// Above this ratio of the median time to the least, in the middle of its settings, a record is called disturbed.
pub(super) const DISTURBED: f64 = 1.1;

/// The median time of the rounds over the least, in the middle of the timings that have three rounds.
fn disturbance(timings: &[Timing]) -> Option<f64> {
    Some(Spread::of(&timings.iter().filter_map(Timing::median_over_least).collect::<Vec<_>>())?.median)
}

/// Two records of a machine that timed the same things.
struct Pair<'a, 'b> {
    /// Indices of the records.
    records: [usize; 2],
    met: Vec<&'b Twice<'a>>,
    /// That with the largest ratio.
    widest: &'b Twice<'a>,
}

impl Pair<'_, '_> {
    fn wide(&self) -> usize {
        self.met.iter().filter(|twice| twice.ratio() > WIDE).count()
    }
}

/// What was found among the records of a machine.
pub(super) struct Between<'a> {
    machine: &'a OnMachine<'a>,
    twice: Vec<Twice<'a>>,
    sizes: Vec<Sizes>,
    /// Instruction sets of the processor with the records that used them.
    sets: BTreeMap<String, Vec<usize>>,
}

impl<'a> Between<'a> {
    pub(super) fn of(machine: &'a OnMachine<'a>) -> Self {
        let mut sets: BTreeMap<String, Vec<usize>> = BTreeMap::new();
        for (index, one) in machine.found.iter().enumerate() {
            for timing in timings(&one.record).into_iter().filter(|timing| timing.kind == DeviceKind::Cpu) {
                let set = timing.detail.split(',').next().unwrap_or_default().to_owned();
                let records = sets.entry(set).or_default();
                if records.last() != Some(&index) {
                    records.push(index);
                }
            }
        }
        Self { machine, twice: twice(&machine.found), sizes: sizes(&machine.found), sets }
    }

    fn name(&self, index: usize) -> String {
        self.machine.name_of(self.machine.found[index])
    }

    fn commit(&self, index: usize) -> &str {
        &self.machine.found[index].record.machine().commit
    }

    /// `A, B and C`.
    fn names(&self, indices: &[usize]) -> String {
        let names: Vec<String> = indices.iter().map(|index| self.name(*index)).collect();
        listed(&names.iter().map(String::as_str).collect::<Vec<_>>())
    }

    /// The pairs of records that timed the same, the widest apart first.
    fn pairs(&self) -> Vec<Pair<'a, '_>> {
        let mut pairs: Vec<Pair> = Vec::new();
        for twice in &self.twice {
            let records = [twice.of[0].0, twice.of[1].0];
            match pairs.iter_mut().find(|pair| pair.records == records) {
                Some(pair) => {
                    pair.met.push(twice);
                    if twice.ratio() > pair.widest.ratio() {
                        pair.widest = twice;
                    }
                }
                None => pairs.push(Pair { records, met: vec![twice], widest: twice }),
            }
        }
        pairs.sort_by(|a, b| b.widest.ratio().total_cmp(&a.widest.ratio()));
        pairs
    }

    /// What two records timed, how far apart they are, and what they say of the reason.
    fn describe(&self, pair: &Pair) -> String {
        let [a, b] = pair.records;
        let widest = pair.widest;
        let [first, second] = widest.mrays.map(short);
        format!(
            "{} and {}: {} of {} rates of the same differ by more than {WIDE} times, by up to {}: {}, by {}: {first} and {second} million \
             rays per second (medians of {} and {} rounds, the same views). {}",
            self.name(a),
            self.name(b),
            pair.wide(),
            pair.met.len(),
            short(widest.ratio()),
            widest.thing().words(),
            widest.of[0].1.engine,
            widest.of[0].1.rounds(),
            widest.of[1].1.rounds(),
            self.reasons(pair)
        )
    }

    /// What the records say of why two of them differ.
    fn reasons(&self, pair: &Pair) -> String {
        let [a, b] = pair.records;
        let wide = || pair.met.iter().filter(|twice| twice.ratio() > WIDE);
        let mut reasons: Vec<String> = Vec::new();
        for twice in wide() {
            let [one, other] = [&twice.of[0].1, &twice.of[1].1];
            let words = format!("{} is {} in one and {} in the other", one.engine, one.detail, other.detail);
            if one.detail != other.detail && !reasons.contains(&words) {
                reasons.push(words);
            }
        }
        if self.commit(a) != self.commit(b) {
            reasons.push(format!("the commits are {} and {}", self.commit(a), self.commit(b)));
        }
        let resized = |sizes: &&Sizes| {
            let of = |index| sizes.sizes.iter().position(|(_, records)| records.contains(&index));
            of(a).zip(of(b)).is_some_and(|(a, b)| a != b)
        };
        let resized = self.sizes.iter().filter(resized).count();
        if resized > 0 {
            let octrees = if resized == 1 { "octree has another size" } else { "octrees have other sizes" };
            reasons.push(format!("{resized} {octrees}"));
        }
        for index in pair.records {
            let is = |twice: &&&Twice| twice.of.iter().any(|(of, timing)| *of == index && timing.rounds() == 1);
            if wide().any(|twice| is(&twice)) {
                reasons.push(format!("{} has one round, and so no spread", self.name(index)));
            }
            if let Some(ratio) = disturbance(&timings(&self.machine.found[index].record)).filter(|r| *r > DISTURBED) {
                let name = self.name(index);
                reasons.push(format!(
                    "{name} was disturbed, as its times are {} times their least in the middle",
                    short(ratio)
                ));
            }
        }
        let mut words = match &reasons[..] {
            [] => "The records name the same commit, devices and octrees: they do not say why.".to_owned(),
            some => format!("The records say: {}.", some.join("; ")),
        };
        if wide().any(|twice| twice.of.iter().any(|(_, timing)| timing.kind == DeviceKind::Gpu)) {
            words += " Records keep no clock of a GPU, which falls while the GPU waits.";
        }
        words
    }

    /// Records in which a GPU waited before it was timed.
    fn asleep(&self) -> Vec<usize> {
        let waited = |one: &&Found| {
            let guarded_gpu = |kind, guarded| kind == DeviceKind::Gpu && guarded;
            one.record.machine().date.as_str() < AWAKE_SINCE
                && timings(&one.record).iter().any(|timing| guarded_gpu(timing.kind, timing.guarded))
        };
        (0..self.machine.found.len()).filter(|index| waited(&self.machine.found[*index])).collect()
    }

    /// Whether the GPU times of a record are too long.
    pub(super) fn has_slow_clocks(&self) -> bool {
        !self.asleep().is_empty()
    }

    /// What must be said of the GPU times of some records.
    fn clocks(&self) -> Option<String> {
        let asleep = self.asleep();
        let one = asleep.len() == 1;
        (!asleep.is_empty()).then(|| {
            format!(
                "{} {} made before {} UTC: there, the GPU waited for calibration casts on the processor before it was timed, and lowered its \
                 clock meanwhile. {} GPU times are too long, those of short frames most. Since then it casts for 20 ms before.",
                self.names(&asleep),
                if one { "was" } else { "were" },
                AWAKE_SINCE.replace('T', " "),
                if one { "Its" } else { "Their" },
            )
        })
    }

    /// The question of the summary; `None`: there is one record, or none that can be compared with another.
    pub(super) fn question(&self) -> Option<Question> {
        let answers: Vec<Answered> =
            [self.times(), self.octrees(), self.instructions()].into_iter().flatten().collect();
        (!answers.is_empty()).then(|| Question {
            id: "agree",
            question: "Do the records of this machine agree?".into(),
            machine: self.machine.name.clone(),
            rule: format!(
                "Rates of the same mesh, levels, kind, beam, end of rays, picture and views by the same engine on the same device, in two \
                 records. They are said to differ above {WIDE} times, by the medians of the rounds. Times of one record were taken in one run; \
                 those of two records were not, and a machine that is shared is not the same on two days."
            ),
            answers,
            table: None,
        })
    }

    fn times(&self) -> Option<Answered> {
        let pairs = self.pairs();
        let clocks = self.clocks();
        let of = "Times".to_owned();
        let (mark, answer, mut details) = match pairs.first() {
            None if clocks.is_none() => return None,
            None => (Mark::Mixed, "Not known: no two records time the same.".into(), Vec::new()),
            Some(first) if first.widest.ratio() <= WIDE => (
                Mark::Good,
                format!("Yes: the same is at most {} times as fast in another record.", short(first.widest.ratio())),
                Vec::new(),
            ),
            Some(first) => {
                let wide: Vec<&Pair> = pairs.iter().filter(|pair| pair.wide() > 0).collect();
                let mut details: Vec<String> = wide.iter().take(LISTED).map(|pair| self.describe(pair)).collect();
                if wide.len() > LISTED {
                    details.push(format!(
                        "{} more pairs of records differ: see Between the records.",
                        wide.len() - LISTED
                    ));
                }
                let most = short(first.widest.ratio());
                let answer = format!(
                    "No: the same is up to {most} times as fast in one record as in another. Compare times within one record alone."
                );
                (Mark::Mixed, answer, details)
            }
        };
        details.extend(clocks);
        Some(Answered { of, mark, answer, details, ..Answered::default() })
    }

    fn octrees(&self) -> Option<Answered> {
        let differ: Vec<&Sizes> = self.differing();
        let of = "Sizes of octrees".to_owned();
        if self.sizes.is_empty() {
            return None;
        }
        let Some(most) = differ.first() else {
            let answer =
                format!("Yes: the {} octrees that several records have are of the same size.", self.sizes.len());
            return Some(Answered { of, mark: Mark::Good, answer, ..Answered::default() });
        };
        let answer = format!(
            "No: of {} octrees that several records have, {} differ in size, by up to {} times.",
            self.sizes.len(),
            differ.len(),
            short(most.ratio())
        );
        let parts: Vec<String> =
            most.sizes.iter().map(|(bytes, records)| self.size_in_words(*bytes, records)).collect();
        let details = vec![format!(
            "Most: {}: {}. The mesh is the same; what builds octrees changed between the commits. Sizes and times beside them belong to \
             their own record.",
            most.which.words(),
            parts.join("; ")
        )];
        Some(Answered { of, mark: Mark::Mixed, answer, details, ..Answered::default() })
    }

    /// Octrees whose size differs, the most first.
    fn differing(&self) -> Vec<&Sizes> {
        let mut differ: Vec<&Sizes> = self.sizes.iter().filter(|sizes| sizes.sizes.len() > 1).collect();
        differ.sort_by(|a, b| b.ratio().total_cmp(&a.ratio()));
        differ
    }

    /// `38.8 MB in esvo bench of 2026-11-27 (commit 0123456789ab)`.
    fn size_in_words(&self, bytes: u64, records: &[usize]) -> String {
        let each: Vec<String> =
            records.iter().map(|index| format!("{} (commit {})", self.name(*index), self.commit(*index))).collect();
        let each: Vec<&str> = each.iter().map(String::as_str).collect();
        format!("{} MB in {}", short(bytes as f64 / 1e6), listed(&each))
    }

    fn instructions(&self) -> Option<Answered> {
        if self.sets.len() < 2 {
            return None;
        }
        let each: Vec<String> =
            self.sets.iter().map(|(set, records)| format!("{set} in {}", self.names(records))).collect();
        let answer = format!(
            "No: the processor was used by {} sets. Do not compare milliseconds between them.",
            self.sets.len()
        );
        let details = vec![format!("{}.", each.join("; "))];
        Some(Answered { of: "Instruction sets".into(), mark: Mark::Mixed, answer, details, ..Answered::default() })
    }

    /// What must be said above the times of a record, beside what they are held against.
    pub(super) fn beside_times(&self, one: &Found) -> Vec<String> {
        let Some(index) = self.index(one) else { return Vec::new() };
        let mut lines = Vec::new();
        let pairs = self.pairs();
        let wide = |pair: &&Pair| pair.records.contains(&index) && pair.wide() > 0;
        if let Some(pair) = pairs.iter().find(wide) {
            let other = if pair.records[0] == index { pair.records[1] } else { pair.records[0] };
            lines.push(format!(
                "{} timed some of the same, and the two differ by up to {} times: see “Do the records of this machine agree?” above.",
                self.name(other),
                short(pair.widest.ratio())
            ));
        }
        if self.asleep().contains(&index) {
            lines.push(format!(
                "Times of the GPU are too long: this record was made before {} UTC, when the GPU still waited for calibration casts before \
                 it was timed, and lowered its clock.",
                AWAKE_SINCE.replace('T', " ")
            ));
        }
        if let Some((set, _)) = self.sets.iter().find(|(_, records)| self.sets.len() > 1 && records.contains(&index)) {
            let others = self.sets.iter().filter(|(other, _)| *other != set);
            let others: Vec<String> =
                others.map(|(other, records)| format!("{other} in {}", self.names(records))).collect();
            lines.push(format!("The processor was used by {set} here, by {}.", others.join("; by ")));
        }
        lines
    }

    /// What must be said above the sizes of a record's octrees.
    pub(super) fn beside_sizes(&self, one: &Found) -> Vec<String> {
        let Some(index) = self.index(one) else { return Vec::new() };
        let differ = self.differing();
        let mine: Vec<_> =
            (differ.iter()).filter(|sizes| sizes.sizes.iter().any(|(_, records)| records.contains(&index))).collect();
        let Some(most) = mine.first() else { return Vec::new() };
        vec![format!(
            "{} of these octrees {} another size in another record, by up to {} times ({}): they were built by other commits.",
            mine.len(),
            if mine.len() == 1 { "has" } else { "have" },
            short(most.ratio()),
            most.which.words()
        )]
    }

    fn index(&self, one: &Found) -> Option<usize> {
        self.machine.found.iter().position(|known| std::ptr::eq(*known, one))
    }

    /// The section with all that differs; `None`: nothing does.
    pub(super) fn section(&self) -> Option<Section> {
        let tables: Vec<PageTable> =
            [self.rates(), self.other_sizes()].into_iter().filter(|table| !table.rows.is_empty()).collect();
        (!tables.is_empty()).then(|| Section {
            id: "between".into(),
            title: "Between the records".into(),
            machine: String::new(),
            when: String::new(),
            lead: vec!["What two records of this machine say of the same thing, where they differ.".into()],
            findings: Vec::new(),
            blocks: vec![Block::Folded { title: "Rates and sizes that differ".into(), tables }],
        })
    }

    fn rates(&self) -> PageTable {
        let mut wide: Vec<&Twice> = self.twice.iter().filter(|twice| twice.ratio() > WIDE).collect();
        wide.sort_by(|a, b| b.ratio().total_cmp(&a.ratio()));
        let row = |twice: &&Twice| {
            let side = |at: usize| {
                let (record, timing) = &twice.of[at];
                let rounds = if timing.rounds() == 1 { "round" } else { "rounds" };
                let mut small = vec![self.name(*record), format!("{} {rounds}", timing.rounds())];
                // Drivers are the same in both, or said above.
                small.extend((timing.kind == DeviceKind::Cpu).then(|| timing.detail.to_owned()));
                PageCell::number(short(twice.mrays[at]), twice.mrays[at], small)
            };
            vec![
                PageCell::new(twice.thing().scene.clone()),
                PageCell::new(twice.thing().setting()),
                PageCell::new(twice.of[0].1.engine.name()),
                PageCell::number(short(twice.ratio()), twice.ratio(), Vec::new()),
                side(0),
                side(1),
            ]
        };
        PageTable {
            caption: "Rates of the same in two records".into(),
            notes: vec![format!(
                "Millions of rays per second, medians of the rounds over the views that both cast; those that differ by more than {WIDE} times."
            )],
            head: ["scene", "what", "engine", "times", "Mrays/s", "Mrays/s in the other"].map(Into::into).into(),
            left: 3,
            cards: false,
            rows: wide.iter().map(row).collect(),
        }
    }

    fn other_sizes(&self) -> PageTable {
        let row = |sizes: &&Sizes| {
            let each: Vec<String> =
                sizes.sizes.iter().map(|(bytes, records)| self.size_in_words(*bytes, records)).collect();
            vec![
                PageCell::new(sizes.which.scene.clone()),
                PageCell::new(sizes.which.kind()),
                PageCell::number(short(sizes.ratio()), sizes.ratio(), Vec::new()),
                PageCell { small: each[1..].to_vec(), ..PageCell::new(each[0].clone()) },
            ]
        };
        PageTable {
            caption: "Octrees of other sizes".into(),
            notes: vec!["Bytes in memory of octrees of the same mesh, levels and kind; largest over smallest.".into()],
            head: ["scene", "octree", "times", "sizes, the newest record first"].map(Into::into).into(),
            left: 4,
            cards: false,
            rows: self.differing().iter().map(row).collect(),
        }
    }
}
