//! `esvo bench`.

pub(crate) mod build;
pub(crate) mod cache;
mod casting;
pub(crate) mod compare;
pub(crate) mod format;
mod full;
pub(crate) mod import;
pub(crate) mod needs;
pub(crate) mod page;
pub(crate) mod pictures;
pub(crate) mod rays;
mod record;
mod repeat;
pub(crate) mod selection;
pub(crate) mod serve;
pub(crate) mod shadow;
pub(crate) mod stability;
pub(crate) mod sweep;
pub(crate) mod tables;
pub(crate) mod voxelize;

use clap::{Args, Subcommand};

use crate::fail::Failure;
use build::BenchBuildArguments;
use compare::{BenchBlessArguments, BenchCompareArguments};
use format::BenchFormatArguments;
use import::BenchImportArguments;
use needs::BenchNeedsArguments;
use page::BenchPageArguments;
use pictures::BenchPicturesArguments;
use rays::BenchRaysArguments;
use serve::BenchServeArguments;
use shadow::BenchShadowArguments;
use stability::BenchStabilityArguments;
use sweep::BenchSweepArguments;
use tables::TablesArguments;
use voxelize::BenchVoxelizeArguments;

/// Measure the paper's two tables on this machine.
#[derive(Debug, Args)]
#[command(args_conflicts_with_subcommands = true)]
#[command(after_help = "\
Builds octrees of the paper's scenes (real meshes if they are found, otherwise procedural
stand-ins), checks the answers of every engine against the reference caster, times the engines,
prints the tables and writes report.json, tables.md, tables.csv, tables.tex and pictures to
results/<machine>/<date>/. Exit code 1 if the answers of an engine are wrong.

Examples:
  esvo bench                                    about five minutes on two cores
  esvo bench --full --memory 16                 every report, in over two hours on two cores
  esvo bench --full --memory 16 --resume        the same, after it was stopped
  esvo bench --repeat results/machine/2026-11-26/report.json
  esvo bench --scenes sibenik --levels 9,10,11 --backends cpu")]
pub(crate) struct BenchArguments {
    /// Another benchmark; without one, the paper's tables are measured
    #[command(subcommand)]
    pub(crate) command: Option<BenchCommand>,
    #[command(flatten)]
    tables: TablesArguments,
}

/// The other benchmarks, and what is done with their records.
#[derive(Debug, Subcommand)]
pub(crate) enum BenchCommand {
    Build(BenchBuildArguments),
    Format(BenchFormatArguments),
    Page(BenchPageArguments),
    Pictures(BenchPicturesArguments),
    Import(BenchImportArguments),
    Rays(BenchRaysArguments),
    Needs(BenchNeedsArguments),
    Serve(BenchServeArguments),
    Shadow(BenchShadowArguments),
    Stability(BenchStabilityArguments),
    Sweep(BenchSweepArguments),
    Voxelize(BenchVoxelizeArguments),
    Compare(BenchCompareArguments),
    Bless(BenchBlessArguments),
}

pub(crate) fn run_bench(arguments: &BenchArguments) -> Result<(), Failure> {
    match &arguments.command {
        None => tables::run_bench_tables(&arguments.tables),
        Some(BenchCommand::Build(arguments)) => build::run_bench_build(arguments),
        Some(BenchCommand::Format(arguments)) => format::run_bench_format(arguments),
        Some(BenchCommand::Page(arguments)) => page::run_bench_page(arguments),
        Some(BenchCommand::Pictures(arguments)) => pictures::run_bench_pictures(arguments),
        Some(BenchCommand::Import(arguments)) => import::run_bench_import(arguments),
        Some(BenchCommand::Rays(arguments)) => rays::run_bench_rays(arguments),
        Some(BenchCommand::Needs(arguments)) => needs::run_bench_needs(arguments),
        Some(BenchCommand::Serve(arguments)) => serve::run_bench_serve(arguments),
        Some(BenchCommand::Shadow(arguments)) => shadow::run_bench_shadow(arguments),
        Some(BenchCommand::Stability(arguments)) => stability::run_bench_stability(arguments),
        Some(BenchCommand::Sweep(arguments)) => sweep::run_bench_sweep(arguments),
        Some(BenchCommand::Voxelize(arguments)) => voxelize::run_bench_voxelize(arguments),
        Some(BenchCommand::Compare(arguments)) => compare::run_bench_compare(arguments),
        Some(BenchCommand::Bless(arguments)) => compare::run_bench_bless(arguments),
    }
}
