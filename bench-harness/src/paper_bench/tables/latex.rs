//! Table 1 and Table 2 as LaTeX, to be included in a document that uses the package booktabs.

use std::fmt::Write;

use crate::paper_bench::figures::{Rate, RateRow, SizeRow, levels, rates, sizes, variants};
use crate::paper_bench::matrix::Variant;
use crate::paper_bench::paper::Paper;
use crate::paper_bench::report::{DeviceRecord, PaperReport};
use crate::paper_bench::tables::device_title;
use crate::text::short;

/// Table 1, and Table 2 of every device, each in an environment `table*`.
pub fn to_latex(report: &PaperReport) -> String {
    let paper = Paper::figures();
    let m = &report.machine;
    let mut out = format!(
        "% esvo bench, {}, commit {}, {}. Needs \\usepackage{{booktabs}}.\n",
        one_line(&m.date),
        one_line(&m.commit),
        one_line(&m.cpu)
    );
    let rows = sizes(report, &paper);
    if !rows.is_empty() {
        out += &table1(&rows, report);
    }
    for device in &report.devices {
        let rows = rates(report, &paper, device);
        if !rows.is_empty() {
            out += &table2(&rows, report, device, &paper);
        }
    }
    out
}

/// A comment of LaTeX ends with its line.
fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// A text with the characters that mean something in LaTeX written so that they mean themselves.
fn escape(text: &str) -> String {
    let mut out = String::new();
    for c in text.chars() {
        match c {
            '&' | '%' | '$' | '#' | '_' | '{' | '}' => out.extend(['\\', c]),
            '\\' => out += "\\textbackslash{}",
            '~' => out += "\\textasciitilde{}",
            '^' => out += "\\textasciicircum{}",
            '±' => out += "$\\pm$",
            '×' => out += "$\\times$",
            '–' => out += "--",
            c if c.is_control() => out.push(' '),
            c => out.push(c),
        }
    }
    out
}

/// A row: its cells, which are LaTeX already.
fn row(cells: &[String]) -> String {
    format!("{} \\\\\n", cells.join(" & "))
}

fn environment(columns: &str, caption: &str, label: &str, body: &str) -> String {
    format!(
        "\n\\begin{{table*}}\n\\centering\\small\n\\caption{{{caption}}}\n\\label{{{label}}}\n\\begin{{tabular}}{{{columns}}}\n\\toprule\n\
         {body}\\bottomrule\n\\end{{tabular}}\n\\end{{table*}}\n"
    )
}

fn table1(rows: &[SizeRow], report: &PaperReport) -> String {
    let levels = levels(rows);
    let mut body = row(&[
        ["scene", "octree", ""].map(String::from).to_vec(),
        levels.iter().map(u32::to_string).collect(),
        vec!["B/voxel".into()],
    ]
    .concat());
    for size in rows {
        body += "\\midrule\n";
        let mut first = [escape(&size.scene), escape(&format!("{}, {}", size.kind(), size.mesh.title()))];
        for (unit, index) in [("MiB", 0), ("s", 1)] {
            let own = |l: &u32| size.cells.get(l).map(|cell| [cell.mib, cell.seconds][index]);
            let theirs = |l: &u32| size.paper.get(l).map(|p| p[index]);
            let bytes = size.largest().map(|(_, cell)| cell.bytes_per_voxel()).filter(|_| index == 0);
            let paper_bytes = size.paper_bytes.map(|(bytes, _)| bytes).filter(|_| index == 0);
            let mut line = |name: &str, of: &dyn Fn(&u32) -> Option<f64>, last: Option<f64>| {
                let mut cells = first.to_vec();
                first = Default::default();
                cells.push(name.into());
                cells.extend(levels.iter().map(|l| of(l).map_or("--".into(), short)));
                cells.push(last.map_or(String::new(), |bytes| format!("{bytes:.2}")));
                body += &row(&cells);
            };
            line(unit, &own, bytes);
            if !size.paper.is_empty() {
                line("\\quad paper", &theirs, paper_bytes);
                let ratio = |l: &u32| Some(own(l)? / theirs(l)?);
                line("\\quad ratio", &ratio, bytes.zip(paper_bytes).map(|(a, b)| a / b));
            }
        }
    }
    let caption = format!(
        "Memory and time of building by the number of levels, on {}, {} threads. The ratio is ours divided by the paper's; its meshes differ.",
        escape(&report.machine.cpu),
        report.machine.threads
    );
    environment(&format!("lll{}r", "r".repeat(levels.len())), &caption, "tab:esvo-size", &body)
}

fn table2(rows: &[RateRow], report: &PaperReport, device: &DeviceRecord, paper: &Paper) -> String {
    let variants = variants(report, device);
    let compared = !device.is_software();
    let width = if compared { 3 } else { 1 };
    let mut head = vec![String::new(); 3];
    head.extend(variants.iter().map(|v| format!("\\multicolumn{{{width}}}{{c}}{{{}}}", escape(v.title()))));
    let filtered = rows.iter().any(|row| row.filter.is_some());
    head.extend(filtered.then(String::new));
    let mut body = row(&head);
    for index in 0..variants.len() {
        let first = 4 + index * width;
        let _ = write!(body, "\\cmidrule(lr){{{first}-{}}}", first + width - 1);
    }
    body.push('\n');
    let mut names = ["scene", "mesh", "picture"].map(String::from).to_vec();
    let columns: &[&str] = if compared { &["ours", "paper", "ratio"] } else { &["ours"] };
    names.extend(variants.iter().flat_map(|_| columns.iter().map(|c| c.to_string())));
    names.extend(filtered.then(|| "filter, ms".into()));
    body += &row(&names);
    for (index, rate) in rows.iter().enumerate() {
        let new = index == 0 || rows[index - 1].scene != rate.scene;
        if new {
            body += "\\midrule\n";
        }
        let name = if new { [escape(&rate.scene), escape(rate.mesh.title())] } else { Default::default() };
        let mut cells = [&name[..], &[escape(&format!("{}×{}", rate.size[0], rate.size[1]))]].concat();
        for cell in &rate.cells {
            cells.push(match cell.rate {
                Rate::Measured(spread) => escape(&spread.to_text()),
                Rate::Wrong => "\\textbf{wrong}".into(),
                Rate::Absent => "--".into(),
            });
            if compared {
                cells.extend([cell.paper, cell.ratio()].map(|x| x.map_or("--".into(), short)));
            }
        }
        cells.extend(filtered.then(|| rate.filter.map_or("--".into(), |s| short(s.median))));
        body += &row(&cells);
        if rows.get(index + 1).is_none_or(|next| next.scene != rate.scene) {
            let levels = rate.levels.map_or(String::new(), |levels| format!("{levels} levels"));
            let mut cells = vec![String::new(), levels, "error, px".into()];
            for cell in &rate.cells {
                let text = match (cell.variant, cell.error) {
                    (Variant::Triangles, _) => "exact".into(),
                    (_, Some([median, p99])) => format!("{} / {}", short(median), short(p99)),
                    (_, None) => "--".into(),
                };
                cells.push(format!("\\multicolumn{{{width}}}{{c}}{{{text}}}"));
            }
            cells.extend(filtered.then(String::new));
            body += &row(&cells);
        }
    }
    let against = if compared {
        format!(" The paper's device: {}. The ratio is ours divided by the paper's.", escape(&paper.machine.gpu))
    } else {
        " This driver runs on the processor: its times say nothing about a GPU.".into()
    };
    let caption = format!(
        "Primary rays, millions per second, {}: {}. Error: depth error against the triangles, median / 99th percentile.{against}",
        escape(device.backend.name()),
        escape(&device_title(device))
    );
    let columns = format!("lll{}", "r".repeat(width * variants.len() + usize::from(filtered)));
    environment(&columns, &caption, &format!("tab:esvo-rate-{}", device.backend.name()), &body)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_mean_themselves() {
        assert_eq!(
            escape("a_b & 5% {x} \\ ~^ ±×"),
            "a\\_b \\& 5\\% \\{x\\} \\textbackslash{} \\textasciitilde{}\\textasciicircum{} $\\pm$$\\times$"
        );
        assert_eq!(escape("a\nb"), "a b");
    }
}
