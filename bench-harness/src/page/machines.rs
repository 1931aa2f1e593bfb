//! Records by machine. Nothing on the page compares times of two machines.

use std::collections::BTreeSet;

use esvo_core::DeviceKind;

use crate::records::{Found, Record};
use crate::system::machine::slug;

/// The records of one machine.
pub(super) struct OnMachine<'a> {
    /// Its name: `AMD EPYC, 2 threads`; GPUs come first.
    pub(super) name: String,
    /// Part of the ids of its elements; empty on a page of one machine.
    pub(super) id: String,
    /// Its records, the newest first.
    pub(super) found: Vec<&'a Found>,
}

impl OnMachine<'_> {
    /// A record in words: `esvo bench sweep of 2026-11-26`; with the time, if the same command made another on that day.
    pub(super) fn name_of(&self, one: &Found) -> String {
        format!("{} of {}", one.record.command(), self.when(one))
    }

    /// `2026-11-26`, or `2026-11-26 20:36` if the same command made another record of this machine on that day.
    pub(super) fn when(&self, one: &Found) -> String {
        let (own, command) = (one.record.machine(), one.record.command());
        let same = self
            .found
            .iter()
            .filter(|other| other.record.command() == command && other.record.machine().day() == own.day());
        let time = own.date.split('T').nth(1).and_then(|time| time.get(..5)).unwrap_or_default();
        if same.count() > 1 { format!("{} {time}", own.day()).trim_end().to_owned() } else { own.day().to_owned() }
    }
}

/// The machines, in the order of their newest record. A machine is known by processor, threads and GPUs; records that name no GPU belong
/// to the machine of that processor, unless there are several.
pub(super) fn by_machine(found: &[Found]) -> Vec<OnMachine<'_>> {
    let plain = |one: &Found| {
        let machine = one.record.machine();
        format!("{}, {} threads", machine.cpu, machine.threads)
    };
    let with_gpus = |one: &Found| {
        let own = gpus(&one.record);
        let same = |other: &&Found| plain(other) == plain(one);
        let all: BTreeSet<_> =
            found.iter().filter(same).map(|other| gpus(&other.record)).filter(|g| !g.is_empty()).collect();
        let names = match (own.is_empty(), all.len()) {
            (true, 1) => all.into_iter().next().unwrap_or_default(),
            _ => own,
        };
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        if names.is_empty() { plain(one) } else { format!("{} with {}", super::verdicts::listed(&names), plain(one)) }
    };
    let mut machines: Vec<OnMachine> = Vec::new();
    for one in found {
        let name = with_gpus(one);
        match machines.iter_mut().find(|machine| machine.name == name) {
            Some(machine) => machine.found.push(one),
            None => machines.push(OnMachine { id: slug(&name), name, found: vec![one] }),
        }
    }
    if let [one] = &mut machines[..] {
        one.id.clear();
    }
    machines
}

/// The GPUs that a record names, without drivers that run on the processor.
fn gpus(record: &Record) -> BTreeSet<String> {
    let mut names = BTreeSet::new();
    let mut add = |name: &str, kind: DeviceKind| {
        if kind == DeviceKind::Gpu {
            names.insert(name.to_owned());
        }
    };
    match record {
        Record::Paper(r) => r.devices.iter().for_each(|d| add(&d.name, d.kind)),
        Record::Sweep(r) => r.devices.iter().for_each(|d| add(&d.name, d.kind)),
        Record::Needs(r) => r.engines.iter().for_each(|row| add(&row.device.name, row.device.kind)),
        Record::Rays(r) => r.engines.iter().flat_map(|row| &row.device).for_each(|d| add(&d.name, d.kind)),
        Record::Stability(r) => r.engines.iter().flat_map(|row| &row.device).for_each(|d| add(&d.name, d.kind)),
        Record::Voxelize(r) => add(&r.device.name, r.device.kind),
        Record::Build(_) | Record::Shadow(_) => {}
    }
    names
}

/// Gives records of the same name those of the folders above, until they differ.
pub(super) fn name_apart(found: &mut [Found]) {
    let paths: Vec<Vec<String>> = found
        .iter()
        .map(|one| {
            let path = one.path.canonicalize().unwrap_or_else(|_| one.path.clone());
            path.iter().map(|part| part.to_string_lossy().into_owned()).collect()
        })
        .collect();
    let last = |path: &[String], parts: usize| path[path.len().saturating_sub(parts)..].join("/");
    let names: Vec<String> = (found.iter().zip(&paths))
        .enumerate()
        .map(|(index, (one, path))| {
            if found.iter().filter(|other| other.name == one.name).count() < 2 {
                return one.name.clone();
            }
            let alone = |parts: &usize| {
                let name = last(path, *parts);
                paths.iter().enumerate().all(|(other, path)| other == index || last(path, *parts) != name)
            };
            (2..path.len()).find(alone).map_or_else(|| one.name.clone(), |parts| last(path, parts))
        })
        .collect();
    for (one, name) in found.iter_mut().zip(names) {
        one.name = name;
    }
}
