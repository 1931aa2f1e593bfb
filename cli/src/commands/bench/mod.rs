//! `esvo bench`.

pub(crate) mod build;
pub(crate) mod format;
pub(crate) mod import;
pub(crate) mod pictures;
pub(crate) mod selection;

use esvo_bench::paper_bench::{run, tables};
use esvo_bench::{Backend, Matrix, Progress, output};

use crate::args::{Bench, BenchCommand};
use crate::fail::{Failure, complain, print};

pub(crate) fn run(arguments: &Bench) -> Result<(), Failure> {
    match &arguments.command {
        None => tables_run(arguments),
        Some(BenchCommand::Build(arguments)) => build::run(arguments),
        Some(BenchCommand::Format(arguments)) => format::run(arguments),
        Some(BenchCommand::Pictures(arguments)) => pictures::run(arguments),
        Some(BenchCommand::Import(arguments)) => import::run(arguments),
    }
}

/// The matrix: the paper's two tables.
fn tables_run(arguments: &Bench) -> Result<(), Failure> {
    let matrix = matrix(arguments)?;
    let selection = &arguments.selection;
    selection.check()?;
    output::check(&arguments.out)?;
    let options =
        run::Options { matrix, scenes_dir: selection.scenes_dir.clone(), threads: arguments.threads.map(Into::into) };
    let progress = Progress::terminal();
    let outcome = run::run(&options, &progress);
    progress.finish();
    let outcome = outcome?;
    let folder = output::write(&outcome, &arguments.out, arguments.machine.as_deref())?;
    let report = &outcome.report;
    let text = if selection.json {
        report.to_json()
    } else {
        format!("{}\nWritten to {}\n", tables::to_text(report), folder.display())
    };
    // A closed pipe must not hide wrong answers.
    let printed = print(&text);
    if selection.json {
        complain("written", &folder.display().to_string());
    }
    let wrong = report.failures().count();
    if wrong > 0 {
        return Err(format!(
            "{wrong} checks failed: an engine's answers differ from the reference caster's; see {}",
            folder.join("tables.md").display()
        )
        .into());
    }
    printed
}

fn matrix(arguments: &Bench) -> Result<Matrix, Failure> {
    let selection = &arguments.selection;
    let mut matrix = match &selection.matrix {
        Some(file) => Matrix::read(file)?,
        None if arguments.full => Matrix::full_run(),
        None => Matrix::default_run(),
    };
    if !selection.scenes.is_empty() {
        matrix.select_scenes(&selection.scenes);
    }
    selection.apply(&mut matrix.scenes, &mut matrix.memory_gb, &mut matrix.time_limit_seconds);
    if !arguments.backends.is_empty() {
        matrix.backends = arguments.backends.iter().map(|&b| Backend::from(b)).collect();
        matrix.backends.dedup();
    }
    if !arguments.resolutions.is_empty() {
        matrix.resolutions.clone_from(&arguments.resolutions);
    }
    matrix.views = arguments.views.unwrap_or(matrix.views);
    matrix.rounds = arguments.rounds.unwrap_or(matrix.rounds);
    matrix.validate()?;
    Ok(matrix)
}
