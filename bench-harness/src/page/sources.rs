//! The records, what was not measured, and whom to thank.

use super::html::{Block, PageTable, Section};
use super::machines::OnMachine;
use crate::records::Record;
use crate::text::TextTable;

/// The last section of the page.
pub(super) fn section(machines: &[OnMachine<'_>], not_shown: &[String]) -> Section {
    let head = ["record", "made by", "machine", "date", "commit", "build", "system"];
    let mut records = TextTable::new("Records", head.len(), &head);
    records.notes.push("Everything on this page is computed from these files alone.".into());
    let mut left = TextTable::new("Not measured", 4, &["what", "why", "machine", "record"]);
    let mut credits = TextTable::new("Credits", 3, &["scene", "credit", "mesh"]);
    for (machine, one) in machines.iter().flat_map(|machine| machine.found.iter().map(move |one| (machine, one))) {
        let m = one.record.machine();
        let row = [&one.name, one.record.command(), &machine.name, &m.date, &m.commit, &m.profile, &m.os];
        records.rows.push(row.map(str::to_owned).into());
        let list = match &one.record {
            Record::Paper(report) => &report.left_out[..],
            Record::Build(report) => &report.left_out[..],
            Record::Sweep(report) => &report.left_out[..],
            Record::Voxelize(report) => &report.left_out[..],
            Record::Shadow(report) => &report.left_out[..],
            _ => &[],
        };
        let row = |what: &String, why: &String| vec![what.clone(), why.clone(), machine.name.clone(), one.name.clone()];
        left.rows.extend(list.iter().map(|l| row(&l.what, &l.reason)));
        let mut add = |scene: &str, credit: &str, identity: &str| {
            let row = [scene, credit, identity].map(str::to_owned).to_vec();
            if !credits.rows.contains(&row) {
                credits.rows.push(row);
            }
        };
        match &one.record {
            Record::Paper(r) => r.scenes.iter().for_each(|s| add(&s.name, &s.credit, &s.identity)),
            Record::Build(r) => r.scenes.iter().for_each(|s| add(&s.name, &s.credit, &s.identity)),
            Record::Sweep(r) => r.scenes.iter().for_each(|s| add(&s.name, &s.credit, &s.identity)),
            Record::Rays(r) => add(&r.scene, &r.credit, &r.identity),
            Record::Needs(r) => r.credits.iter().for_each(|[scene, credit, identity]| add(scene, credit, identity)),
            Record::Shadow(r) => r.scenes.iter().for_each(|s| add(&s.name, &s.credit, &s.identity)),
            Record::Voxelize(r) => r.scenes.iter().for_each(|s| add(&s.name, &s.credit, &s.identity)),
            Record::Stability(_) => {}
        }
    }
    let dash = || "-".to_string();
    left.rows.extend(not_shown.iter().map(|what| vec![what.clone(), "not on this page".into(), dash(), dash()]));
    let tables = [records, left, credits].into_iter().filter(|table| !table.rows.is_empty());
    Section {
        id: "sources".into(),
        title: "Records, what is missing, and credits".into(),
        machine: String::new(),
        when: String::new(),
        lead: vec!["The paper: Samuli Laine and Tero Karras, “Efficient Sparse Voxel Octrees”, I3D 2010.".into()],
        findings: Vec::new(),
        blocks: tables.map(|table| Block::Table(PageTable::from(table).in_cards())).collect(),
    }
}
